//! A scene from meshes on the command line, without a scene file.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use super::failure::Failure;
use super::scene_text::{name_after, quoted};
use super::{environment, length_unit};
use pliant::contact::{Obstacle, Surface};
use pliant::mesh::{Topology, TriangleMesh};
use pliant::scene::{EFFECTS, Scene, Surroundings, parse_with};
use pliant::simulation::Assets;

/// Distance from a bone within which a muscle is attached [mm].
const NEAR_MM: f64 = 3.0;

/// Greatest share of a muscle that is attached to one bone [%]; for all bones together twice as
/// much.
const LIMIT_PERCENT: f64 = 5.0;

/// A mesh is even if its shortest edges are not shorter than this share of the median one: one edge in
/// [`SHORTEST`].
const EVEN: f64 = 0.5;
const SHORTEST: usize = 20;

/// Number of vertices of an uneven mesh after remeshing: a muscle then runs for some ten seconds, and the
/// shape is kept to a tenth of an edge.
const REMESHED: f64 = 2500.0;

/// Meshes to run without a scene file.
#[derive(Debug, Default, clap::Args)]
pub(super) struct Meshes {
    /// Muscle meshes to run without a scene file; requires --unit
    #[arg(long, value_name = "FILE", num_args = 1.., help_heading = "Without a scene file")]
    muscles: Vec<PathBuf>,
    /// Bone meshes; bones do not move, and a muscle is attached to a bone within 3 mm
    #[arg(long, value_name = "FILE", num_args = 1.., requires = "muscles", help_heading = "Without a scene file")]
    bones: Vec<PathBuf>,
    /// Lines along the fibres of the muscles: one file of legacy VTK LINES, or of OBJ `l`, per
    /// muscle in the same order
    #[arg(long, value_name = "FILE", num_args = 1.., requires = "muscles", help_heading = "Without a scene file")]
    fibre_lines: Vec<PathBuf>,
    /// Length unit of all these files, such as mm
    #[arg(
        long,
        value_name = "UNIT",
        requires = "muscles",
        help_heading = "Without a scene file"
    )]
    unit: Option<String>,
}

/// A muscle or bone of the scene.
struct Named {
    name: String,
    path: String,
}

impl Meshes {
    /// True if meshes are given.
    pub(super) fn are_given(&self) -> bool {
        !self.muscles.is_empty()
    }
}

/// The scene of these meshes with the changes of the command line, and its TOML text without them.
pub(super) fn scene(meshes: &Meshes, changes: &[String]) -> Result<(Scene, String), Failure> {
    let Some(unit) = &meshes.unit else {
        let hint = "add the unit of their coordinates, for example --unit mm";
        return Err(Failure::usage(
            "mesh files do not say their length unit",
            hint,
        ));
    };
    length_unit(unit)?;
    if meshes.fibre_lines.len() > meshes.muscles.len() {
        let (fibres, muscles) = (meshes.fibre_lines.len(), meshes.muscles.len());
        let message = format!("{fibres} files of fibre lines for {muscles} muscles");
        return Err(Failure::usage(
            message,
            "give at most one for each muscle, in their order",
        ));
    }
    let mut used = HashSet::new();
    let muscles = named(&meshes.muscles, &mut used)?;
    let bones = named(&meshes.bones, &mut used)?;
    let fibres = named(&meshes.fibre_lines, &mut HashSet::new())?;
    let base = Written {
        unit,
        muscles,
        bones,
        fibres,
    };
    // Only the unchanged meshes show which bones a muscle is attached to.
    let free = base.toml(&[]);
    let assets = Assets::load(&parse(&free, changes)?).map_err(Failure::of_meshes)?;
    let toml = base.toml(&of_muscles(&assets));
    Ok((parse(&toml, changes)?, toml))
}

fn parse(toml: &str, changes: &[String]) -> Result<Scene, Failure> {
    let surroundings = Surroundings {
        folder: Path::new("."),
        variable: &environment::variable,
        overrides: changes,
    };
    Ok(parse_with(toml, "scene.toml", &surroundings)?)
}

/// Names the bodies after the stems of their files, each name once, with absolute paths.
fn named(paths: &[PathBuf], used: &mut HashSet<String>) -> Result<Vec<Named>, Failure> {
    let mut all = Vec::new();
    for path in paths {
        let shown = path.display();
        let absolute = path.canonicalize().map_err(|e| {
            let why = if e.kind() == std::io::ErrorKind::NotFound {
                String::new()
            } else {
                format!(": {e}")
            };
            let from = if path.is_absolute() {
                "check the path"
            } else {
                "check the path; it is relative to the working folder"
            };
            Failure::usage(format!("no file `{shown}`{why}"), from)
        })?;
        let Some(text) = absolute.to_str() else {
            return Err(Failure::usage(
                format!("the name of `{shown}` is not UTF-8"),
                "rename it",
            ));
        };
        let name = name_after(path, used)?;
        all.push(Named {
            name,
            path: text.to_owned(),
        });
    }
    Ok(all)
}

/// What the unchanged meshes show of a muscle.
struct Found {
    /// The bones near it.
    holders: Vec<usize>,
    /// Why it is remeshed, and to which edges [m]; `None` for an even mesh.
    remeshed: Option<(String, f64)>,
}

fn of_muscles(assets: &Assets) -> Vec<Found> {
    let each = holders(assets).into_iter().zip(&assets.muscles);
    each.map(|(holders, muscle)| Found {
        holders,
        remeshed: uneven(&muscle.mesh),
    })
    .collect()
}

/// Why a mesh with edges of unlike lengths is remeshed, and to which edges [m]. Its shortest edges
/// would need the shortest steps, and its longest ones bend in facets.
fn uneven(mesh: &TriangleMesh) -> Option<(String, f64)> {
    let topology = Topology::new(mesh);
    let is_fit = topology.is_oriented() && topology.non_manifold_vertices(mesh).is_empty();
    let mut lengths = topology.edge_lengths(mesh);
    if !is_fit || lengths.is_empty() || !lengths.iter().all(|l| l.is_finite()) {
        return None;
    }
    lengths.sort_by(f64::total_cmp);
    let (short, median) = (
        lengths[lengths.len() / SHORTEST],
        lengths[lengths.len() / 2],
    );
    if short >= EVEN * median {
        return None;
    }
    // Of as many vertices in equilateral triangles.
    let edge = (2.0 * mesh.area() / (3.0_f64.sqrt() * REMESHED)).sqrt();
    let (shortest, longest) = (lengths[0], lengths[lengths.len() - 1]);
    let why = format!(
        "the file has edges of {} to {} mm, half of them below {} mm; without this line they stay",
        mm(shortest),
        mm(longest),
        mm(median)
    );
    (edge > 0.0).then_some((why, edge))
}

/// A length [m] in millimetres with three digits.
fn mm(length: f64) -> String {
    let digits = format!("{:.2e}", length * 1e3);
    digits
        .parse()
        .map_or(digits, |number: f64| number.to_string())
}

/// The bones near each muscle.
fn holders(assets: &Assets) -> Vec<Vec<usize>> {
    let surfaces: Vec<Surface> = assets.bones.iter().map(Surface::new).collect();
    let near = |muscle: &TriangleMesh, bone: &Surface| {
        muscle.vertices.iter().any(|v| {
            bone.closest(v)
                .is_some_and(|c| c.distance.abs() <= NEAR_MM * 1e-3)
        })
    };
    let of = |mesh| {
        (0..surfaces.len())
            .filter(|&b| near(mesh, &surfaces[b]))
            .collect()
    };
    assets.muscles.iter().map(|m| of(&m.mesh)).collect()
}

struct Written<'a> {
    unit: &'a str,
    muscles: Vec<Named>,
    bones: Vec<Named>,
    fibres: Vec<Named>,
}

impl Written<'_> {
    /// The scene as TOML, with what was `found` of each muscle.
    fn toml(&self, found: &[Found]) -> String {
        let text = quoted;
        let unit = text(self.unit);
        let scene = self.muscles.first().map_or("meshes", |m| m.name.as_str());
        let mut toml = format!(
            "name = {}\nframes = 300\nframe_rate = \"60 Hz\"\n",
            text(scene)
        );
        for bone in &self.bones {
            let (name, path) = (text(&bone.name), text(&bone.path));
            toml.push_str(&format!(
                "\n[[bone]]\nname = {name}\nmesh = {path}\nunit = {unit}\n"
            ));
        }
        for (m, muscle) in self.muscles.iter().enumerate() {
            let (name, path) = (text(&muscle.name), text(&muscle.path));
            toml.push_str(&format!(
                "\n[[muscle]]\nname = {name}\nmesh = {path}\nunit = {unit}\n"
            ));
            let found = found.get(m);
            if let Some((why, edge)) = found.and_then(|found| found.remeshed.as_ref()) {
                let edge = mm(*edge);
                toml.push_str(&format!("# {why}\nedge_length = \"{edge} mm\"\n"));
            }
            let held = found.map_or(&[][..], |found| found.holders.as_slice());
            // All bones together can fix a tenth of a muscle's vertices.
            let limit = LIMIT_PERCENT.min(2.0 * LIMIT_PERCENT / held.len().max(1) as f64);
            for &b in held {
                let bone = text(&self.bones[b].name);
                toml.push_str(&format!(
                    "[[muscle.attachment]]\nbone = {bone}\nnear = \"{NEAR_MM} mm\"\nlimit = \"{limit} %\"\n"
                ));
            }
            if let Some(fibres) = self.fibres.get(m) {
                toml.push_str(&format!(
                    "[muscle.fibres]\nlines = {}\nunit = {unit}\n",
                    text(&fibres.path)
                ));
            }
        }
        toml.push_str(&usual_effects());
        toml
    }
}

/// Every effect that a muscle usually has, as in the built-in hip.
fn usual_effects() -> String {
    let mut toml = "\n".to_owned();
    for effect in &EFFECTS {
        if let Some(keys) = effect.usual {
            toml.push_str(&format!("[effects.{}]\n{keys}", effect.key));
        }
    }
    toml
}

#[cfg(test)]
mod tests {
    use super::*;
    use pliant::mesh::shapes::icosphere;

    #[test]
    fn a_mesh_with_edges_of_unlike_lengths_is_remeshed_and_an_even_one_is_not() {
        let even = icosphere(0.02, 3);
        assert_eq!(uneven(&even), None);
        // One side is drawn together: triangles of a tenth of the size.
        let mut drawn = even.clone();
        for v in drawn.vertices.iter_mut().filter(|v| v.z > 0.012) {
            (v.x, v.y) = (0.1 * v.x, 0.1 * v.y);
        }
        let (why, edge) = uneven(&drawn).expect("uneven");
        let vertices = 2.0 * drawn.area() / (3.0_f64.sqrt() * edge * edge);
        assert!((vertices - REMESHED).abs() <= 1e-9 * REMESHED, "{vertices}");
        assert!(why.contains("without this line"), "{why}");
        // Control: what no remeshing can take stays as it is.
        drawn.triangles.push(drawn.triangles[0]);
        assert_eq!(uneven(&drawn), None);
    }

    #[test]
    fn lengths_have_three_digits() {
        assert_eq!(mm(0.004_312), "4.31");
        assert_eq!(mm(0.000_000_5), "0.0005");
        assert_eq!(mm(12.0), "12000");
    }
}
