//! Reads a scene from TOML, checks it, and converts it to SI units.
//!
//! # The layout
//! All keys, with the optional ones marked. Quantities are texts with their [unit](super::units);
//! ratios without a dimension are plain numbers. Files are in the scene's folder, or have an
//! absolute path, or a path that begins with a variable.
#![doc = concat!("```toml\n", include_str!("layout.toml"), "```")]
//!
//! A scene can contain skin over implants instead of muscles and bones:
#![doc = concat!("```toml\n", include_str!("layout-skin.toml"), "```")]
//!
//! Or a lattice:
#![doc = concat!("```toml\n", include_str!("layout-lattice.toml"), "```")]
//!
//! Or bodies of springs:
#![doc = concat!("```toml\n", include_str!("layout-spring-bodies.toml"), "```")]
//!
//! Or a geometric muscle:
#![doc = concat!("```toml\n", include_str!("layout-geometric.toml"), "```")]

use std::collections::{BTreeMap, HashMap, HashSet};
use std::ffi::OsString;
use std::path::Path;
use std::sync::Arc;

use nalgebra::{Point3, Unit, Vector3};

use super::content::{KINDS, KindSpec};
use super::error::{Gathered, SceneError, SceneProblem};
use super::interval::Intervals;
use super::reader::{Context, Item, Limit, Section};
use super::schema::ROOT;
use super::tree::{self, Node, Sources};
use super::units::{self, Dimension};
use super::{
    BoneSpec, Capsule, Content, Scene, SceneOrigin, Source, interface, limits, motion, overrides,
    parse_effects, parse_muscle, paths,
};
use crate::io::check_mesh;
use crate::mesh::TriangleMesh;
use crate::mesh::repair::{LONGEST_RIM, RepairOptions};
use crate::mesh::shapes;
use crate::spelling::{listed, nearest, shown};

/// Greatest length of a name [bytes]; names become parts of file names.
const LONGEST_NAME: usize = 100;

/// The context of a scene's text.
#[derive(Clone, Copy)]
pub struct Surroundings<'a> {
    /// Folder of the scene file: relative paths start here and stay here.
    pub folder: &'a Path,
    /// Value of a variable at the start of a path; see [`Variables`](super::Variables).
    pub variable: &'a dyn Fn(&str) -> Option<OsString>,
    /// Overrides `path.key=value`, applied in order before the checks.
    pub overrides: &'a [String],
    /// Meshes that stand in place of files, by the path that the scene names.
    pub meshes: &'a BTreeMap<String, Arc<TriangleMesh>>,
}

static NO_MESHES: BTreeMap<String, Arc<TriangleMesh>> = BTreeMap::new();

impl<'a> Surroundings<'a> {
    /// A folder, no variables, no overrides, no meshes.
    #[must_use]
    pub fn of(folder: &'a Path) -> Self {
        Self {
            folder,
            variable: &paths::no_variables,
            overrides: &[],
            meshes: &NO_MESHES,
        }
    }
}

/// Reads and checks a scene. `name` appears in messages; `folder` is the start of relative paths.
///
/// # Errors
/// The first error with its location; see [`SceneProblem`].
///
/// ```
/// let text = "
/// frames = 300
/// frame_rate = '60 Hz'
/// [[muscle]]
/// name = 'calf'
/// shape = 'tetrahedron'
/// [effects.gravity]
/// acceleration = ['0 m/s2', '-9.81 m/s2', '0 m/s2']
/// ";
/// let scene = pliant::scene::parse(text, "calf.toml", std::path::Path::new(".")).unwrap();
/// assert_eq!(scene.name, "calf");
/// let error = pliant::scene::parse(&text.replace("frames", "farmes"), "calf.toml", std::path::Path::new("."));
/// assert_eq!(error.unwrap_err().to_string(), "unknown key `farmes`, did you mean `frames`?");
/// ```
pub fn parse(text: &str, name: &str, folder: &Path) -> Result<Scene, SceneError> {
    parse_with(text, name, &Surroundings::of(folder))
}

/// The same as [`parse`] with overrides and other variables.
///
/// # Errors
/// The first error with its location; see [`SceneProblem`]. A scene without muscles is an error.
pub fn parse_with(
    text: &str,
    name: &str,
    surroundings: &Surroundings<'_>,
) -> Result<Scene, SceneError> {
    match parse_content(text, name, surroundings)? {
        Content::Muscles(scene) => Ok(*scene),
        other => Err(other.origin().error(no_muscle(), "")),
    }
}

/// The same as [`parse_with`] for a scene of any kind.
///
/// # Errors
/// The first error with its location; see [`SceneProblem`].
pub fn parse_content(
    text: &str,
    name: &str,
    surroundings: &Surroundings<'_>,
) -> Result<Content, SceneError> {
    let (document, sources) = changed(text, name, surroundings.overrides)?;
    read(document, sources, name, surroundings, &[])
}

/// The document of a text with overrides.
pub(super) fn changed(
    text: &str,
    name: &str,
    overrides: &[String],
) -> Result<(Node, Sources), SceneError> {
    let mut sources = Sources::new(name, text);
    let mut document = tree::document(&sources)?;
    for text in overrides {
        overrides::apply(text, &mut document, &mut sources)?;
    }
    Ok((document, sources))
}

/// Reads a document with values in place of some with an interval, by their keys and in SI units.
pub(super) fn read(
    document: Node,
    sources: Sources,
    name: &str,
    surroundings: &Surroundings<'_>,
    instead: &[(&str, f64)],
) -> Result<Content, SceneError> {
    let intervals = Intervals {
        instead,
        ..Intervals::default()
    };
    let context = Context {
        sources: &sources,
        surroundings,
        intervals: &intervals,
    };
    let root = Item {
        context,
        node: &document,
        key: String::new(),
    };
    let file_stem = Path::new(name)
        .file_stem()
        .and_then(|s| s.to_str())
        .unwrap_or_default();
    let root = root.section(&ROOT)?;
    let scene = scene_name(&root, file_stem)?;
    let content = (kind(&root)?.read)(&root, scene)?;
    let uncertain = intervals.found.into_inner();
    let origin = SceneOrigin::new(document, sources, name, surroundings, uncertain);
    Ok(content.with_origin(origin))
}

fn scene_name(root: &Section<'_>, file_stem: &str) -> Result<String, SceneError> {
    match root.get("name") {
        Some(item) => checked_name(&item),
        None if name_fault(file_stem).is_none() => Ok(file_stem.to_owned()),
        None => root.fail(SceneProblem::missing("name", "`name = \"...\"`")),
    }
}

/// Determines the kind of a scene, and rejects keys of other kinds.
fn kind(root: &Section<'_>) -> Result<&'static KindSpec, SceneError> {
    let has = |key: &str| root.get(key);
    let Some(kind) = KINDS.iter().find(|kind| has(kind.deciding).is_some()) else {
        let own = |kind: &'static KindSpec| kind.keys.iter().find_map(|(key, _)| has(key));
        return match KINDS[1..].iter().find_map(|kind| Some((kind, own(kind)?))) {
            Some((kind, item)) => item.fail(SceneProblem::missing(kind.deciding, kind.add)),
            // The reader of muscles reports the missing section.
            None => Ok(&KINDS[0]),
        };
    };
    if let (Some(item), false) = (has("accuracy"), kind.deciding == "muscle") {
        let message = "an accuracy is for scenes of muscles".to_owned();
        let hint =
            "leave it out; for skin, `pliant accuracy` tells which `edge_length` keeps an error"
                .to_owned();
        return item.fail(SceneProblem::Override { message, hint });
    }
    for other in KINDS.iter().filter(|other| other.name != kind.name) {
        for (key, _) in other.keys {
            root.exclusive(kind.deciding, key)?;
        }
    }
    for key in kind.without {
        root.exclusive(kind.deciding, key)?;
    }
    Ok(kind)
}

fn no_muscle() -> SceneProblem {
    SceneProblem::missing("muscle", "a section [[muscle]]")
}

/// Reads a scene of muscles. Each part that is wrong gives an error; all are reported at once.
pub(super) fn scene(root: &Section<'_>, name: String) -> Result<Scene, SceneError> {
    let mut all = Gathered::default();
    let frames = all.keep(frames(root));
    let rate = root.need_quantity("frame_rate", Dimension::Rate, Limit::Positive);
    let rate = all.keep(rate);
    let up = root.get("up").map(|item| item.direction()).transpose();
    let up = all.keep(up).flatten();
    let mut taken = HashSet::new();
    let mut bones = bones(root, "bone", &mut taken, &mut all);
    if bones.len() < root.each_section("bone").len() {
        // Without the name of a bone, what names it would be wrong as well.
        all.end()?;
    }
    let opensim = all.keep(super::opensim::read(root, &mut bones, (frames, rate)));
    let known = KnownBones::of(&bones);
    let capsules = all.keep(capsules(root, &known, &mut taken));
    let before = all.count();
    let (mut muscles, mut taken) = (Vec::new(), HashSet::new());
    for section in root.each_section("muscle") {
        let mut read = |section: Section<'_>| {
            let name = unique_name(&section, &mut taken)?;
            parse_muscle::muscle(&section, name, &known)
        };
        muscles.extend(all.keep(section.and_then(&mut read)));
    }
    let are_whole = all.count() == before;
    if muscles.is_empty() && are_whole {
        all.keep::<()>(root.fail(no_muscle()));
    }
    // Interfaces name muscles: where one is missing, an error may only follow from that.
    let interfaces = are_whole.then(|| all.keep(interface::interfaces(root, &muscles)));
    let effects = all.keep(parse_effects::effects(root));
    let solver = all.keep(parse_effects::solver(root));
    let adapts_steps = all.keep(parse_effects::adapts_steps(root));
    let accuracy = root
        .get("accuracy")
        .map(|item| parse_effects::accuracy(&item));
    let accuracy = all.keep(accuracy.transpose());
    all.keep(parse_effects::has_an_energy(
        root,
        accuracy.flatten(),
        solver.as_ref(),
    ));
    let mesh_error = root.get("mesh_error").map(|item| item.flag());
    let mesh_error = all.keep(mesh_error.transpose());
    let limits = all.keep(limits::limits(root));
    all.end()?;
    Ok(Scene {
        most_held: super::MOST_HELD,
        name,
        frames: frames.unwrap_or_default(),
        frame_rate: rate.unwrap_or_default(),
        up: up.map_or_else(Vector3::y, Unit::into_inner),
        bones,
        opensim: opensim.flatten(),
        capsules: capsules.unwrap_or_default(),
        interfaces: interfaces.flatten().unwrap_or_default(),
        muscles,
        effects: effects.unwrap_or_default(),
        solver: solver.unwrap_or_default(),
        adapts_steps: adapts_steps.unwrap_or_default(),
        accuracy: accuracy.flatten(),
        mesh_error: mesh_error.flatten().unwrap_or_default(),
        limits: limits.unwrap_or_default(),
        origin: SceneOrigin::default(),
    })
}

fn frames(root: &Section<'_>) -> Result<usize, SceneError> {
    let frames = root.need("frames", "300")?.whole(1, 10_000_000)?;
    Ok(usize::try_from(frames).unwrap_or(usize::MAX))
}

/// The rigid bodies of a scene of springs: they have the keys of bones.
pub(super) fn rigid_bodies(
    root: &Section<'_>,
    taken: &mut HashSet<String>,
) -> Result<Vec<BoneSpec>, SceneError> {
    let mut all = Gathered::default();
    let bodies = bones(root, "rigid_body", taken, &mut all);
    all.end()?;
    Ok(bodies)
}

/// Reads the bones of a key. A bone with an error keeps its name, so that muscles can name it.
fn bones(
    root: &Section<'_>,
    key: &str,
    taken: &mut HashSet<String>,
    all: &mut Gathered,
) -> Vec<BoneSpec> {
    let mut bones = Vec::new();
    for section in root.each_section(key) {
        let Some(section) = all.keep(section) else {
            continue;
        };
        let Some(name) = all.keep(unique_name(&section, taken)) else {
            continue;
        };
        let (surface, repair) = (all.keep(surface(&section)), all.keep(repair(&section)));
        let edge_length = all.keep(edge_length(&section));
        let motion = section.section("motion").and_then(|of| match of {
            Some(section) => motion::read(&section),
            None => Ok(super::Motion::default()),
        });
        let motion = all.keep(motion);
        bones.push(BoneSpec {
            name,
            surface: surface.unwrap_or_else(|| Source::Shape(String::new())),
            repair: repair.flatten(),
            edge_length: edge_length.flatten(),
            motion: motion.unwrap_or_default(),
        });
    }
    bones
}

/// The edge length \[m\] of a bone, a muscle or a skin after remeshing, if one is given.
pub(super) fn edge_length(section: &Section<'_>) -> Result<Option<f64>, SceneError> {
    let given = section.get("edge_length");
    given
        .map(|item| item.quantity(Dimension::Length, Limit::Positive))
        .transpose()
}

/// Capsules and bones have unique names in common: both are obstacles, and reports show them alike.
fn capsules(
    root: &Section<'_>,
    bones: &KnownBones<'_>,
    taken: &mut HashSet<String>,
) -> Result<Vec<Capsule>, SceneError> {
    let mut capsules = Vec::new();
    for section in root.sections("capsule")? {
        let name = unique_name(&section, taken)?;
        let bone = bones.named_by(&section)?;
        let point = |key| -> Result<_, SceneError> {
            Ok(Point3::from(
                section
                    .need(key, "[\"0 mm\", \"0 mm\", \"0 mm\"]")?
                    .vector(Dimension::Length)?,
            ))
        };
        let segment = [point("from")?, point("to")?];
        let radius = section.need_quantity("radius", Dimension::Length, Limit::Positive)?;
        capsules.push(Capsule {
            name,
            bone,
            segment,
            radius,
        });
    }
    Ok(capsules)
}

/// The bones of a scene, with a fast lookup by name.
pub(super) struct KnownBones<'a> {
    bones: &'a [BoneSpec],
    index: HashMap<&'a str, usize>,
}

impl<'a> KnownBones<'a> {
    fn of(bones: &'a [BoneSpec]) -> Self {
        let index = bones
            .iter()
            .enumerate()
            .map(|(i, b)| (b.name.as_str(), i))
            .collect();
        Self { bones, index }
    }

    /// The index of the bone in the key `bone`.
    pub(super) fn named_by(&self, section: &Section<'_>) -> Result<usize, SceneError> {
        let item = section.need("bone", "\"NAME\"")?;
        let name = item.text("femur")?;
        match self.index.get(name) {
            Some(&index) => Ok(index),
            None => item.fail(unknown_name(
                "bone",
                name,
                self.bones.iter().map(|b| b.name.as_str()),
            )),
        }
    }

    /// The name of a bone.
    pub(super) fn name(&self, index: usize) -> &'a str {
        self.bones.get(index).map_or("", |b| &b.name)
    }
}

/// The error for an unknown name.
pub(super) fn unknown_name<'a>(
    what: &'static str,
    name: &str,
    known: impl Iterator<Item = &'a str> + Clone,
) -> SceneProblem {
    SceneProblem::UnknownName {
        what,
        name: shown(name),
        nearest: nearest(name, known.clone()).map(shown),
        known: listed(known),
    }
}

/// `mesh` with its `unit`, or `shape`.
pub(super) fn surface(section: &Section<'_>) -> Result<Source, SceneError> {
    surface_of(section, shapes::SCENE_NAMES)
}

/// The same as [`surface`] with other shapes.
pub(super) fn surface_of(section: &Section<'_>, shapes: &[&str]) -> Result<Source, SceneError> {
    section.exclusive("mesh", "shape")?;
    if let Some(item) = section.get("shape") {
        section.exclusive("shape", "unit")?;
        return shape(&item, shapes);
    }
    match section.get("mesh") {
        Some(item) => file(&item, section),
        None => section.fail(SceneProblem::Missing {
            what: "the surface".to_owned(),
            add: "`mesh = \"FILE\"` with its `unit`, or `shape = \"NAME\"`".to_owned(),
        }),
    }
}

/// The repair of `repair` and its related keys.
pub(super) fn repair(section: &Section<'_>) -> Result<Option<RepairOptions>, SceneError> {
    section.exclusive("shape", "repair")?;
    let requested = section
        .get("repair")
        .map_or(Ok(false), |item| item.flag())?;
    let more = ["close_holes", "cut_handles", "keep_largest", "merge_within"];
    if !requested {
        return match more.iter().find_map(|key| section.get(key)) {
            Some(item) => item.fail(SceneProblem::missing(
                "repair",
                "`repair = true`, which it is a part of",
            )),
            None => Ok(None),
        };
    }
    let longest = u32::try_from(LONGEST_RIM).unwrap_or(u32::MAX);
    let close_holes = section
        .get("close_holes")
        .map_or(Ok(0), |item| item.whole(0, longest))?;
    let length = |key| section.quantity_or(key, Dimension::Length, Limit::NotNegative, 0.0);
    Ok(Some(RepairOptions {
        merge_within: length("merge_within")?,
        close_holes: close_holes as usize,
        cut_handles: length("cut_handles")?,
        keep_largest: section
            .get("keep_largest")
            .map_or(Ok(false), |item| item.flag())?,
    }))
}

/// The file of a value, with the key `unit` of its section.
pub(super) fn file(item: &Item<'_>, section: &Section<'_>) -> Result<Source, SceneError> {
    let text = item.text("$PLIANT_DATA/body/bones/Femur.r.obj")?;
    file_at(text, item, section)
}

/// The same as [`file`], for a path that is only a part of the value.
pub(super) fn file_at(
    text: &str,
    item: &Item<'_>,
    section: &Section<'_>,
) -> Result<Source, SceneError> {
    let Some(unit) = section.get("unit") else {
        return item.fail(SceneProblem::UnitsRequired {
            found: format!("`{}`", shown(text)),
            example: "`unit = \"m\"`, \"cm\" or \"mm\" below it".to_owned(),
            dimension: Dimension::Length,
        });
    };
    let name = unit.text("mm")?;
    let scale = units::scale(name, Dimension::Length).map_err(|e| unit.error(e.into()))?;
    let around = item.context.surroundings;
    if let Some(mesh) = around.meshes.get(text) {
        return given(text, mesh, scale, item);
    }
    let path = paths::resolve(text, around.folder, around.variable).map_err(|p| item.error(p))?;
    Ok(Source::File { path, scale })
}

/// A mesh in place of a file; a reader of files would reject the same faults.
fn given(
    name: &str,
    mesh: &Arc<TriangleMesh>,
    scale: f64,
    item: &Item<'_>,
) -> Result<Source, SceneError> {
    if let Err(fault) = check_mesh(mesh, &[]) {
        let found = format!("the mesh {}", shown(name));
        return item.fail(SceneProblem::out_of_range(
            &found,
            &format!("a sound mesh: {fault}"),
        ));
    }
    Ok(Source::Given {
        name: name.to_owned(),
        mesh: mesh.clone(),
        scale,
    })
}

/// A generated shape.
pub(super) fn shape(item: &Item<'_>, known: &[&str]) -> Result<Source, SceneError> {
    let name = item.text("tetrahedron")?;
    if known.contains(&name) {
        return Ok(Source::Shape(name.to_owned()));
    }
    item.fail(unknown_name("shape", name, known.iter().copied()))
}

/// A name that is not in `taken`; adds it.
pub(super) fn unique_name(
    section: &Section<'_>,
    taken: &mut HashSet<String>,
) -> Result<String, SceneError> {
    let item = section.need("name", "\"...\"")?;
    let name = checked_name(&item)?;
    if taken.insert(name.clone()) {
        Ok(name)
    } else {
        item.fail(SceneProblem::DuplicateName { name })
    }
}

pub(super) fn checked_name(item: &Item<'_>) -> Result<String, SceneError> {
    let name = item.text("femur")?;
    match name_fault(name) {
        Some(allowed) => item.fail(SceneProblem::out_of_range(name, allowed)),
        None => Ok(name.to_owned()),
    }
}

/// The reason why a name is invalid: it becomes the name of a file or folder on any system.
pub(super) fn name_fault(name: &str) -> Option<&'static str> {
    if name.trim() != name || name.is_empty() || name.len() > LONGEST_NAME {
        return Some("a name of 1 to 100 bytes without space at its ends");
    }
    let bad = |c: char| c.is_control() || r#"/\:*?"<>|"#.contains(c);
    if name.contains(bad) || name.starts_with('.') {
        return Some(r#"a name without / \ : * ? " < > | that does not begin with a dot"#);
    }
    None
}
