//! Overlap between several meshes, and its removal.

use std::path::{Path, PathBuf};

use pliant::TriangleMesh;
use pliant::contact::{
    Gaps, Inseparable, PartedPair, RigidBody, SoftBody, Surface, overlaps, part,
};
use pliant::io::{self, Encoding, MeshFile};
use pliant::mesh::Health;
use serde_json::{Value, json};

use crate::commands::failure::Failure;
use crate::report::output::Verdict;

/// Distance that parted meshes keep, relative to the median length of an edge.
const GAP: f64 = 0.01;

/// Overlap of the meshes that enclose a volume.
#[derive(Default)]
pub(super) struct Overlaps {
    /// The pairs, after a parting with its motion.
    pub pairs: Vec<PartedPair>,
    /// True if they were parted.
    pub parted: bool,
    /// The pairs that still cross.
    left: Vec<Inseparable>,
    /// The written meshes.
    pub written: Vec<PathBuf>,
}

/// A mesh with its name.
struct Named {
    name: String,
    file: MeshFile,
    surface: Surface,
}

/// Searches for overlap between `meshes`, and with `targets` parts and writes them; `still` are the
/// meshes that may not move. Meshes that do not enclose a volume are left out.
///
/// # Errors
/// A file that cannot be written.
pub(super) fn find(
    meshes: &[PathBuf],
    still: &[PathBuf],
    targets: &[PathBuf],
) -> Result<Overlaps, Failure> {
    let soft: Vec<(Named, Option<&PathBuf>)> = meshes
        .iter()
        .enumerate()
        .filter_map(|(k, path)| Some((closed(path)?, targets.get(k))))
        .collect();
    let rigid: Vec<Named> = still.iter().filter_map(|path| closed(path)).collect();
    let bodies: Vec<SoftBody<'_>> = soft
        .iter()
        .map(|(named, _)| SoftBody {
            name: &named.name,
            mesh: &named.file.mesh,
            surface: &named.surface,
            held: Vec::new(),
            fixed: false,
        })
        .collect();
    let bones: Vec<RigidBody<'_>> = rigid
        .iter()
        .map(|named| RigidBody {
            name: &named.name,
            surface: &named.surface,
            pose: nalgebra::Isometry3::identity(),
        })
        .collect();
    if targets.is_empty() {
        return Ok(Overlaps {
            pairs: overlaps(&bodies, &bones),
            ..Overlaps::default()
        });
    }
    let edges = bodies.iter().filter_map(|body| {
        body.mesh
            .median_edge_length(&pliant::Topology::new(body.mesh))
    });
    let gap = GAP * edges.fold(f64::INFINITY, f64::min);
    let gaps = Gaps {
        to_bones: gap,
        between: gap,
    };
    let parted = part(&bodies, &bones, gaps);
    let mut written = Vec::new();
    for ((named, target), vertices) in soft.iter().zip(&parted.positions) {
        let mesh = match vertices {
            Some(vertices) => &TriangleMesh {
                vertices: vertices.clone(),
                triangles: named.file.mesh.triangles.clone(),
            },
            None => &named.file.mesh,
        };
        if let Some(target) = target {
            io::write(target, mesh, &named.file.lines, Encoding::Binary)
                .map_err(|error| unwritable(&error))?;
            written.push((*target).clone());
        }
    }
    Ok(Overlaps {
        pairs: parted.pairs,
        parted: true,
        left: parted.left,
        written,
    })
}

fn unwritable(error: &io::WriteError) -> Failure {
    Failure::usage(error.to_string(), "name another folder for --part")
}

/// A mesh that encloses a volume; `None` for any other, of which the examination of the meshes
/// tells.
fn closed(path: &Path) -> Option<Named> {
    let file = io::read(path).ok()?;
    let fit = Health::of(&file.mesh).is_fit() && !file.mesh.triangles.is_empty();
    fit.then(|| Named {
        name: path.display().to_string(),
        surface: Surface::new(&file.mesh),
        file,
    })
}

impl Overlaps {
    /// The pairs for the summary; lengths are in the unit of the files.
    pub fn measures(&self) -> Value {
        let pair = |pair: &PartedPair| {
            json!({
                "pair": pair.pair,
                "crossings": pair.crossings,
                "vertices_inside": pair.inside,
                "depth": pair.depth,
                "place": [pair.place.x, pair.place.y, pair.place.z],
                "moved_rms": self.parted.then_some(pair.moved.rms),
                "moved_max": self.parted.then_some(pair.moved.max),
                "volume_change": self.parted.then_some(pair.moved.volume_change),
            })
        };
        self.pairs.iter().map(pair).collect()
    }

    /// A verdict for each pair that could not be parted; one that passes if all could.
    pub fn verdicts(&self) -> Vec<Verdict> {
        let left = self.left.iter().map(|left| {
            let ([a, b], [x, y, z]) = (&left.pair, left.place);
            Verdict::none("pairs of triangles that still cross", left.crossings)
                .at(format!("{a} and {b}, near ({x:.4}, {y:.4}, {z:.4})"))
                .else_do("check that they belong together and have one unit, or part them in a program for meshes")
        });
        let mut all: Vec<Verdict> = left.collect();
        if self.parted && all.is_empty() {
            all.push(Verdict::none("pairs of triangles that still cross", 0));
        }
        all
    }

    /// The pairs as text, one line each.
    pub fn text(&self) -> String {
        let mut text = String::new();
        for pair in &self.pairs {
            let [a, b] = &pair.pair;
            let p = pair.place;
            text.push_str(&format!(
                "{a} and {b} overlap: {} pairs of triangles cross, {} and {} vertices are inside the other, at most {:.3e} deep, \
                 near ({:.4}, {:.4}, {:.4})",
                pair.crossings, pair.inside[0], pair.inside[1], pair.depth, p.x, p.y, p.z
            ));
            let is_left = |left: &Inseparable| left.pair == pair.pair;
            if self.parted && !self.left.iter().any(is_left) {
                text.push_str(&format!(
                    "; parted, with vertices moved by {:.3e} (RMS), at most {:.3e}",
                    pair.moved.rms, pair.moved.max
                ));
            }
            text.push('\n');
        }
        text
    }
}
