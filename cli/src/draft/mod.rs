//! A scene drafted from meshes alone: what each body is, its unit, repair and remeshing, a joint, and the
//! attachments. Every guess is a line of the scene, with its reason beside it.

pub mod attachments;
pub mod fit;
pub mod joint;
pub mod names;
mod tendon;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::PathBuf;

use attachments::{Attachment, LooseEnd, NEAR_MM, WITHIN_MM};
use joint::Joint;
use nalgebra::{Unit, Vector3};
use pliant::contact::Surface;
use pliant::format::counted;
use pliant::io::file_name;
use pliant::mesh::{
    FindingKind, Health, LONGEST_RIM, RepairChange, RepairOptions, RepairStep, Topology,
    TriangleMesh, repair,
};
use pliant::scene::EFFECTS;
use pliant::simulation::Assets;

/// A mesh is even if its shortest edges are not shorter than this share of the median one: one edge in
/// [`SHORTEST`].
const EVEN: f64 = 0.5;
const SHORTEST: usize = 20;

/// Number of vertices of an uneven or a fine mesh after remeshing: a muscle then runs for some ten seconds, and the
/// shape is kept to a tenth of an edge.
const REMESHED: f64 = 2500.0;

/// Segmentations have ten times as many vertices, at the distance of their voxels. What has more than
/// this many times [`REMESHED`] is remeshed.
const MANY: f64 = 2.0;

/// Greatest length of a loop around a handle that is cut before remeshing, in edges after it. A loop of
/// three edges is the shortest that a mesh can have.
const HANDLE: f64 = 4.0;

/// Resistance to bending: with less, muscles of the measured hip lose more than half of their thickness.
const BENDING: &str = "5e-4 N m";

/// Frames of a scene. A joint turns to its end and back in them.
const FRAMES: usize = 300;

/// A body of the draft.
#[derive(Debug, Default)]
pub struct Body {
    /// Its name in the scene.
    pub name: String,
    /// The path of its file.
    pub path: String,
    /// Why it is a bone or a muscle; empty if the user said so.
    pub why: String,
    /// How its mesh is mended; `None` for a sound one.
    pub mended: Option<Mended>,
    /// Why it is remeshed, and to which edges [m]; `None` for a mesh that stays, and before
    /// [`Draft::examine`].
    pub remeshed: Option<(String, f64)>,
}

/// The repair of a mesh.
#[derive(Debug)]
pub struct Mended {
    /// The defects.
    pub why: String,
    pub options: RepairOptions,
}

/// What is known of a muscle from the meshes.
#[derive(Debug, Default)]
pub struct Held {
    pub attachments: Vec<Attachment>,
    pub loose: Vec<LooseEnd>,
    /// The files of its patches, one for each attachment that has one, and their meshes [m].
    pub patches: Vec<Option<(PathBuf, TriangleMesh)>>,
    /// What was cut of a mesh that is remeshed, and the length of loops around it [m].
    pub cut: Option<(String, f64)>,
}

/// The scene.
#[derive(Debug, Default)]
pub struct Draft {
    pub name: String,
    pub unit: String,
    /// Where the unit comes from; empty if the user gave it.
    pub unit_why: String,
    pub bones: Vec<Body>,
    pub muscles: Vec<Body>,
    /// Files of lines along the fibres, for the first muscles.
    pub fibres: Vec<String>,
    pub joint: Option<Joint>,
    /// The folder of meshes, as seen from that of the scene; without one, bones hold all that is near.
    pub parts: Option<PathBuf>,
    /// What was found of each muscle; empty before [`Draft::examine`].
    pub held: Vec<Held>,
}

/// The axis of the coordinates that is nearest to a direction.
fn nearest_axis(direction: &Unit<Vector3<f64>>) -> [i32; 3] {
    let mut axis = [0; 3];
    let most = direction.iamax();
    axis[most] = if direction[most] < 0.0 { -1 } else { 1 };
    axis
}

/// The repair of a mesh that a simulation does not accept as it is; `None` for a sound mesh.
///
/// # Errors
/// The defects that no repair ends.
pub fn mended(mesh: &TriangleMesh) -> Result<Option<Mended>, String> {
    let health = Health::of(mesh);
    if health.is_fit() {
        return Ok(None);
    }
    let defects = |health: &Health| -> Vec<String> {
        let refused = health.findings.iter().filter(|f| f.kind.refuses());
        refused.map(|f| f.message.clone()).collect()
    };
    let why = defects(&health).join("; ");
    let is_open = health
        .findings
        .iter()
        .any(|f| f.kind == FindingKind::OpenBoundary);
    let holes = if is_open { LONGEST_RIM } else { 0 };
    let mut left = Vec::new();
    for keep_largest in [false, true] {
        let options = RepairOptions {
            close_holes: holes,
            keep_largest,
            ..RepairOptions::default()
        };
        let after = Health::of(&repair(mesh, &[], &options).mesh);
        if after.is_fit() {
            return Ok(Some(Mended { why, options }));
        }
        left = defects(&after);
    }
    Err(left.join("; "))
}

impl Draft {
    /// Finds attachments, and muscles to remesh, on the unchanged meshes.
    pub fn examine(&mut self, assets: &Assets) {
        let bones: Vec<Surface> = assets.bones.iter().map(Surface::new).collect();
        let meshes = || assets.muscles.iter().map(|muscle| &muscle.mesh);
        // Contact is no more exact than the edges of the muscles.
        let mut shortest = f64::INFINITY;
        for (muscle, mesh) in self.muscles.iter_mut().zip(meshes()) {
            muscle.remeshed = remeshed(mesh);
            let after = muscle.remeshed.as_ref().map(|(_, edge)| *edge);
            let edge = after.or_else(|| Some(Edges::of(mesh)?.part(2)));
            shortest = shortest.min(edge.unwrap_or(f64::INFINITY));
        }
        for (bone, mesh) in self.bones.iter_mut().zip(&assets.bones) {
            bone.remeshed = coarser(mesh, shortest);
        }
        let each = self.muscles.iter().zip(meshes());
        self.held = each
            .map(|(muscle, mesh)| self.examine_one(muscle, mesh, &bones))
            .collect();
    }

    fn examine_one(&self, muscle: &Body, mesh: &TriangleMesh, bones: &[Surface]) -> Held {
        let turns = self.joint.as_ref().map(|joint| joint.turns.as_slice());
        let joint = self.joint.as_ref();
        let crosses = joint.and_then(|joint| names::crosses(&muscle.name, joint.known.name));
        let (mut attachments, loose) = attachments::find(mesh, bones, turns, crosses);
        if let Some(joint) = &self.joint {
            let is_held_from_afar = |a: &&mut Attachment| joint.turns.contains(&a.bone);
            for attachment in attachments.iter_mut().filter(is_held_from_afar) {
                let Some(far) = &mut attachment.far else {
                    continue;
                };
                let triangles = attachment.patch.iter().flatten();
                let held: BTreeSet<u32> = triangles
                    .flat_map(|&t| mesh.triangles[t as usize])
                    .collect();
                let held: Vec<_> = held.iter().map(|&v| mesh.vertices[v as usize]).collect();
                if tendon::is_carried_into(&held, joint, bones)
                    && let Some((bone, away)) = tendon::nearest_at_rest(&far.middle, joint, bones)
                {
                    attachment.bone = bone;
                    (far.mm, far.lacks_tendon) = (1e3 * away, true);
                }
            }
        }
        let patch = |(k, a): (usize, &Attachment)| {
            let bone = file_name(&self.bones[a.bone].name);
            let file = format!("{}-{}-on-{bone}.obj", file_name(&muscle.name), k + 1);
            let path = self.parts.as_ref()?.join(file);
            Some((path, part(mesh, a.patch.as_ref()?)))
        };
        let remeshed = muscle.remeshed.as_ref();
        Held {
            patches: attachments.iter().enumerate().map(patch).collect(),
            attachments,
            loose,
            cut: remeshed.and_then(|(_, edge)| cut(mesh, *edge)),
        }
    }

    /// The meshes that the scene needs beside those of its bodies, with their files.
    pub fn files(&self) -> impl Iterator<Item = (&PathBuf, &TriangleMesh)> {
        let patches = self
            .held
            .iter()
            .flat_map(|held| held.patches.iter().flatten());
        patches.map(|(path, mesh)| (path, mesh))
    }

    /// The scene as TOML.
    pub fn toml(&self) -> String {
        let mut toml = format!(
            "name = {}\nframes = {FRAMES}\nframe_rate = \"60 Hz\"\n",
            quoted(&self.name)
        );
        if !self.unit_why.is_empty() {
            let _ = writeln!(
                toml,
                "# Lengths of all files are in {}: {}.",
                self.unit, self.unit_why
            );
        }
        if let Some(joint) = &self.joint {
            let up = nearest_axis(&joint.up);
            // It is what a scene without the key has.
            if up != [0, 1, 0] {
                let _ = writeln!(
                    toml,
                    "up = {up:?} # in pictures: along the bones of the joint"
                );
            }
        }
        for (b, bone) in self.bones.iter().enumerate() {
            self.put_body(&mut toml, "bone", bone, None);
            self.put_motion(&mut toml, b);
        }
        for (m, muscle) in self.muscles.iter().enumerate() {
            let cut = self.held.get(m).and_then(|held| held.cut.as_ref());
            self.put_body(&mut toml, "muscle", muscle, cut);
            if let Some(held) = self.held.get(m) {
                self.put_held(&mut toml, held);
            }
            if self.held.get(m).is_some_and(|held| self.has_fibres(held)) {
                toml.push_str("[muscle.fibres] # with their tone it does not buckle as it shortens\nmethod = \"harmonic\"\n");
            }
            if let Some(lines) = self.fibres.get(m) {
                let (lines, unit) = (quoted(lines), quoted(&self.unit));
                let _ = write!(toml, "[muscle.fibres]\nlines = {lines}\nunit = {unit}\n");
            }
        }
        toml.push_str(&usual_effects());
        if self.held.iter().any(|held| self.has_fibres(held)) {
            toml.push_str("[effects.tone]\n");
        }
        toml
    }

    /// Whether fibres are computed for a muscle: a joint turns one of its bones and not another.
    fn has_fibres(&self, held: &Held) -> bool {
        let turns = |a: &Attachment| {
            let joint = self.joint.as_ref();
            joint.map(|joint| joint.turns.contains(&a.bone))
        };
        let has = |turned: bool| held.attachments.iter().any(|a| turns(a) == Some(turned));
        has(true) && has(false)
    }

    fn put_body(&self, toml: &mut String, kind: &str, body: &Body, cut: Option<&(String, f64)>) {
        let name = quoted(&body.name);
        let why = match body.why.as_str() {
            "" => String::new(),
            why => format!(" # {why}"),
        };
        let _ = writeln!(toml, "\n[[{kind}]]{why}\nname = {name}");
        let (path, unit) = (quoted(&body.path), quoted(&self.unit));
        let _ = write!(toml, "mesh = {path}\nunit = {unit}\n");
        let cut = cut.map_or(String::new(), |(why, length)| {
            format!("cut_handles = \"{} mm\" # {why}\n", mm(*length))
        });
        if let Some(Mended { why, options }) = &body.mended {
            let _ = write!(toml, "repair = true # {why}\n{cut}");
            if options.close_holes > 0 {
                let _ = writeln!(toml, "close_holes = {}", options.close_holes);
            }
            if options.keep_largest {
                toml.push_str("keep_largest = true\n");
            }
        } else if !cut.is_empty() {
            let _ = write!(toml, "repair = true\n{cut}");
        }
        if let Some((why, edge)) = &body.remeshed {
            let _ = write!(toml, "# {why}\nedge_length = \"{} mm\"\n", mm(*edge));
        }
    }

    fn put_motion(&self, toml: &mut String, bone: usize) {
        let Some(joint) = self
            .joint
            .as_ref()
            .filter(|joint| joint.turns.contains(&bone))
        else {
            return;
        };
        let known = joint.known;
        let _ = write!(
            toml,
            "[bone.motion] # {} of the {}\njoint = {}\n",
            known.motion,
            known.name,
            quoted(known.name)
        );
        let of = joint.between.map(|b| self.bones[b].name.as_str());
        let centre: Vec<String> = joint
            .fit
            .centre
            .iter()
            .map(|c| format!("\"{:.3} mm\"", 1e3 * c))
            .collect();
        let axis: Vec<String> = joint.axis.iter().map(|a| format!("{a:.5}")).collect();
        let (middle, end) = (FRAMES / 2, FRAMES);
        let _ = write!(
            toml,
            "centre = [{}] # {}\naxis = [{}] # {}\nkeys = [\n    {{ frame = 0, angle = \"0 deg\" }},\n    \
             {{ frame = {middle}, angle = \"{} deg\" }},\n    {{ frame = {end}, angle = \"0 deg\" }},\n]\n",
            centre.join(", "),
            joint.fit_in_words(of),
            axis.join(", "),
            joint.sense,
            known.degrees,
        );
    }

    fn put_held(&self, toml: &mut String, held: &Held) {
        let _ = write!(
            toml,
            "[muscle.material]\nbending = \"{BENDING}\" # a thin muscle keeps its thickness\n"
        );
        let limit = 100.0 * attachments::share(held.attachments.len());
        for (attachment, patch) in held.attachments.iter().zip(&held.patches) {
            let bone = quoted(&self.bones[attachment.bone].name);
            let why = match (&attachment.far, patch) {
                (Some(far), _) if far.lacks_tendon => format!(
                    " # the mesh lacks the tendon over the joint: this bone, {:.0} mm away, holds its end",
                    far.mm
                ),
                (Some(far), _) => format!(
                    " # the nearest bone to this end, {:.0} mm away: the mesh lacks a tendon",
                    far.mm
                ),
                (None, Some(_)) => {
                    " # a part of what is near: elsewhere the muscle passes this bone".to_owned()
                }
                (None, None) => String::new(),
            };
            let _ = writeln!(toml, "[[muscle.attachment]]{why}\nbone = {bone}");
            let _ = match (patch, &attachment.far) {
                (Some((path, _)), _) => {
                    let path = quoted(&path.display().to_string());
                    write!(
                        toml,
                        "patch = {path}\nunit = \"m\"\nwithin = \"{WITHIN_MM} mm\"\n"
                    )
                }
                (None, far) => {
                    let near = far
                        .as_ref()
                        .map_or(NEAR_MM, |far| (far.mm + NEAR_MM).ceil());
                    write!(toml, "near = \"{near} mm\"\nlimit = \"{limit} %\"\n")
                }
            };
        }
    }

    /// What is left loose, in words: an end of a muscle far from every bone.
    pub fn loose(&self) -> Vec<String> {
        let of = |(held, muscle): (&Held, &Body)| -> Vec<String> {
            let each = held.loose.iter().map(|end| {
                let at: Vec<String> = end.at.iter().map(|c| format!("{:.0}", 1e3 * c)).collect();
                let near = match end.nearest {
                    Some((bone, mm)) => {
                        format!("the nearest, {}, is {mm:.0} mm away", self.bones[bone].name)
                    }
                    None => "there are none".to_owned(),
                };
                format!(
                    "{}: no bone holds its end at ({}) mm: {near}",
                    muscle.name,
                    at.join(", ")
                )
            });
            each.collect()
        };
        self.held.iter().zip(&self.muscles).flat_map(of).collect()
    }
}

/// A part of a mesh.
fn part(mesh: &TriangleMesh, triangles: &[u32]) -> TriangleMesh {
    let mut number = BTreeMap::new();
    let mut part = TriangleMesh::default();
    for &t in triangles {
        let corners = mesh.triangles[t as usize].map(|v| {
            *number.entry(v).or_insert_with(|| {
                part.vertices.push(mesh.vertices[v as usize]);
                part.vertices.len() as u32 - 1
            })
        });
        part.triangles.push(corners);
    }
    part
}

/// A text in TOML.
pub fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

/// Every effect that a muscle usually has, as in the built-in hip.
fn usual_effects() -> String {
    let mut toml = "\n".to_owned();
    for effect in &EFFECTS {
        if let Some(keys) = effect.usual {
            let _ = write!(toml, "[effects.{}]\n{keys}", effect.key);
        }
    }
    toml
}

/// Why a mesh is remeshed, and to which edges [m]; `None` for an even mesh of a number of vertices with
/// which a run ends soon. The shortest edges of an uneven one would need the shortest steps, and its
/// longest ones bend in facets.
fn remeshed(mesh: &TriangleMesh) -> Option<(String, f64)> {
    let edges = Edges::of(mesh)?;
    let [short, median] = [SHORTEST, 2].map(|part| edges.part(part));
    let count = mesh.vertices.len();
    let is_even = short >= EVEN * median;
    if is_even && count as f64 <= MANY * REMESHED {
        return None;
    }
    // Of as many vertices in equilateral triangles.
    let edge = (2.0 * mesh.area() / (3.0_f64.sqrt() * REMESHED)).sqrt();
    let why = match is_even {
        true => many(count),
        false => format!(
            "the file has edges of {} to {} mm, half of them below {} mm; without this line they stay",
            mm(edges.0[0]),
            mm(edges.0[edges.0.len() - 1]),
            mm(median)
        ),
    };
    (edge > 0.0).then_some((why, edge))
}

/// Why a bone is remeshed to edges of this length [m], and the length; `None` for one that has not many
/// more vertices.
fn coarser(bone: &TriangleMesh, edge: f64) -> Option<(String, f64)> {
    Edges::of(bone)?;
    let count = bone.vertices.len();
    let after = 2.0 * bone.area() / (3.0_f64.sqrt() * edge * edge);
    let is_fine = count as f64 > MANY * after.max(REMESHED);
    (edge > 0.0 && edge.is_finite() && is_fine).then(|| (many(count), edge))
}

fn many(count: usize) -> String {
    format!(
        "the file has {count} vertices; without this line they stay, and a run takes the longer"
    )
}

/// The lengths of all edges [m] of a mesh that can be remeshed, sorted.
struct Edges(Vec<f64>);

impl Edges {
    fn of(mesh: &TriangleMesh) -> Option<Self> {
        let topology = Topology::new(mesh);
        let is_fit = topology.is_oriented() && topology.non_manifold_vertices(mesh).is_empty();
        let mut lengths = topology.edge_lengths(mesh);
        if !is_fit || lengths.is_empty() || !lengths.iter().all(|l| l.is_finite()) {
            return None;
        }
        lengths.sort_by(f64::total_cmp);
        Some(Self(lengths))
    }

    /// The length below which one edge in so many is.
    fn part(&self, part: usize) -> f64 {
        self.0[self.0.len() / part]
    }
}

/// What is cut of a mesh before it is remeshed to such edges [m], and how long loops around it may be [m]:
/// handles that so long edges cannot follow. `None` if there are none.
fn cut(mesh: &TriangleMesh, edge: f64) -> Option<(String, f64)> {
    let length = HANDLE * edge;
    let options = RepairOptions {
        cut_handles: length,
        ..RepairOptions::default()
    };
    let repaired = repair(mesh, &[], &options);
    let is_cut = |change: &&RepairChange| change.step == RepairStep::CutHandles;
    let count = repaired.changes.iter().find(is_cut)?.count;
    let handles = counted(count, "handle", "handles");
    let why = format!("{handles}, as noise leaves them, with edges too long to follow them");
    Health::of(&repaired.mesh).is_fit().then_some((why, length))
}

/// A length [m] in millimetres with three digits.
fn mm(length: f64) -> String {
    let digits = format!("{:.2e}", length * 1e3);
    digits
        .parse()
        .map_or(digits, |number: f64| number.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use pliant::mesh::shapes::icosphere;

    #[test]
    fn an_uneven_or_a_fine_mesh_is_remeshed_and_another_is_not() {
        let even = icosphere(0.02, 3);
        assert_eq!(remeshed(&even), None);
        // As fine as a segmentation.
        let (why, edge) = remeshed(&icosphere(0.02, 5)).expect("fine");
        let vertices = 2.0 * even.area() / (3.0_f64.sqrt() * edge * edge);
        assert!((vertices / REMESHED - 1.0).abs() <= 0.01, "{vertices}");
        assert!(why.starts_with("the file has 10242 vertices"), "{why}");
        // One side is drawn together: triangles of a tenth of the size.
        let mut drawn = even.clone();
        for v in drawn.vertices.iter_mut().filter(|v| v.z > 0.012) {
            (v.x, v.y) = (0.1 * v.x, 0.1 * v.y);
        }
        let (why, edge) = remeshed(&drawn).expect("uneven");
        let vertices = 2.0 * drawn.area() / (3.0_f64.sqrt() * edge * edge);
        assert!((vertices - REMESHED).abs() <= 1e-9 * REMESHED, "{vertices}");
        assert!(why.contains("without this line"), "{why}");
        // Control: what no remeshing can take stays as it is.
        drawn.triangles.push(drawn.triangles[0]);
        assert_eq!(remeshed(&drawn), None);
    }

    #[test]
    fn a_bone_as_fine_as_a_scan_gets_the_edges_of_the_finest_muscle() {
        let mut bone = icosphere(0.05, 6);
        let (why, edge) = coarser(&bone, 2e-3).expect("40,962 vertices");
        assert!(
            edge == 2e-3 && why.starts_with("the file has 40962"),
            "{why}"
        );
        let body = Body {
            name: "femur".to_owned(),
            remeshed: Some((why, edge)),
            ..Body::default()
        };
        let draft = Draft {
            bones: vec![body],
            ..Draft::default()
        };
        let toml = draft.toml();
        assert!(toml.contains("edge_length = \"2 mm\"\n"), "{toml}");
        // Controls: almost as fine as the muscles, few vertices, no muscle with edges, and what no
        // remeshing takes.
        assert_eq!(coarser(&bone, 9e-4), None);
        assert_eq!(coarser(&icosphere(0.05, 4), 2e-2), None);
        assert_eq!(coarser(&bone, f64::INFINITY), None);
        bone.triangles[0].swap(0, 1);
        assert_eq!(coarser(&bone, 2e-3), None);
    }

    #[test]
    fn a_mesh_is_mended_as_little_as_it_needs() {
        let whole = icosphere(0.02, 2);
        assert!(mended(&whole).expect("sound").is_none());
        let mut open = whole.clone();
        open.triangles.pop();
        let options = mended(&open).expect("closed").expect("a repair").options;
        assert!(options.close_holes > 0 && !options.keep_largest);
        assert!(mended(&TriangleMesh::default()).is_err(), "nothing to mend");
    }

    #[test]
    fn lengths_have_three_digits() {
        assert_eq!(mm(0.004_312), "4.31");
        assert_eq!(mm(0.000_000_5), "0.0005");
        assert_eq!(mm(12.0), "12000");
    }
}
