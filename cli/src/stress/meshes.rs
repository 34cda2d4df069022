//! Meshes of poor quality: the surface of a mesh with triangles as scanners and segmentations leave them.

use std::collections::HashMap;

use pliant::mesh::{Topology, TriangleMesh};

/// In what way a mesh is worse than that of the scene. The surface stays what it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Worse {
    /// Edges are cut close to an end: triangles with one side a hundredth of the others.
    Needles,
    /// Triangles have a further vertex close to a side: angles near 180 degrees.
    Caps,
    /// Numbers in micrometres.
    Micrometres,
    /// Numbers in kilometres.
    Kilometres,
}

impl Worse {
    /// All of them.
    pub const ALL: [Self; 4] = [
        Self::Needles,
        Self::Caps,
        Self::Micrometres,
        Self::Kilometres,
    ];

    /// The unit of its numbers in a scene, and its length [m].
    pub fn unit(self) -> (&'static str, f64) {
        match self {
            Self::Needles | Self::Caps => ("m", 1.0),
            Self::Micrometres => ("um", 1e-6),
            Self::Kilometres => ("km", 1e3),
        }
    }
}

/// Where a new vertex lies, relative to the side on which, or the height at which it lies.
const CLOSE: f64 = 0.01;

/// The share of triangles that become worse.
const SHARE: f64 = 0.02;

/// The mesh [m] made worse, in the unit of `worse`; the same for the same seed.
pub fn worsened(mesh: &TriangleMesh, worse: Worse, seed: u64) -> TriangleMesh {
    let mut new = mesh.clone();
    let wanted = (mesh.triangles.len() as f64 * SHARE).ceil() as usize;
    match worse {
        Worse::Needles => cut_edges(&mut new, wanted, seed),
        Worse::Caps => {
            for t in drawn(mesh.triangles.len(), wanted, seed) {
                let [a, b, c] = mesh.triangles[t];
                let [x, y, z] = mesh.corners(t);
                let middle = nalgebra::center(&x, &y);
                let m = added(&mut new, middle + (z - middle) * CLOSE);
                new.triangles[t] = [a, b, m];
                new.triangles.extend([[b, c, m], [c, a, m]]);
            }
        }
        Worse::Micrometres | Worse::Kilometres => {}
    }
    let unit = worse.unit().1;
    new.vertices.iter_mut().for_each(|x| x.coords /= unit);
    new
}

fn added(mesh: &mut TriangleMesh, vertex: nalgebra::Point3<f64>) -> u32 {
    mesh.vertices.push(vertex);
    (mesh.vertices.len() - 1) as u32
}

/// `wanted` different numbers below `count`, in the order in which they are drawn.
fn drawn(count: usize, wanted: usize, seed: u64) -> Vec<usize> {
    let mut next = pliant::random::units(seed);
    let mut all: Vec<usize> = (0..count).collect();
    let wanted = wanted.min(count);
    for k in 0..wanted {
        let other = k + super::drawing::index(next(), count - k);
        all.swap(k, other);
    }
    all.truncate(wanted);
    all
}

/// Cuts edges close to one end; no triangle is cut twice.
fn cut_edges(mesh: &mut TriangleMesh, wanted: usize, seed: u64) {
    let sorted = |mut t: [u32; 3]| {
        t.sort_unstable();
        t
    };
    let each = mesh.triangles.iter().enumerate();
    let mut place: HashMap<[u32; 3], usize> = each.map(|(t, c)| (sorted(*c), t)).collect();
    let hinges = Topology::new(mesh).hinges;
    for k in drawn(hinges.len(), wanted, seed) {
        let [a, b, c, d] = hinges[k];
        let of = [sorted([a, b, c]), sorted([b, a, d])];
        let [Some(&s), Some(&t)] = of.map(|sides| place.get(&sides)) else {
            continue;
        };
        place.retain(|_, cut| *cut != s && *cut != t);
        let [x, y] = [a, b].map(|v| mesh.vertices[v as usize]);
        let m = added(mesh, x + (y - x) * CLOSE);
        mesh.triangles[s] = [a, m, c];
        mesh.triangles[t] = [b, m, d];
        mesh.triangles.extend([[m, b, c], [m, a, d]]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pliant::mesh::shapes::icosphere;

    #[test]
    fn a_worse_mesh_has_the_same_surface() {
        let ball = icosphere(0.1, 3);
        for worse in Worse::ALL {
            let mut new = worsened(&ball, worse, 5);
            assert_eq!(new, worsened(&ball, worse, 5));
            new.vertices
                .iter_mut()
                .for_each(|x| x.coords *= worse.unit().1);
            assert!((new.volume() / ball.volume() - 1.0).abs() <= 1e-14);
            assert!((new.area() / ball.area() - 1.0).abs() <= 1e-4, "{worse:?}");
            assert!(Topology::new(&new).hinges.len() * 2 == new.triangles.len() * 3);
            let thinnest = |mesh: &TriangleMesh| {
                let each = (0..mesh.triangles.len()).map(|t| {
                    let [a, b, c] = mesh.corners(t);
                    let sides = [(b - a).norm(), (c - b).norm(), (a - c).norm()];
                    let longest = sides.iter().copied().max_by(f64::total_cmp).unwrap_or(0.0);
                    (b - a).cross(&(c - a)).norm() / (longest * longest)
                });
                each.min_by(f64::total_cmp).unwrap_or(0.0)
            };
            let is_thin = thinnest(&new) <= 0.02;
            let is_worse = matches!(worse, Worse::Needles | Worse::Caps);
            assert_eq!(is_thin, is_worse, "{worse:?}: {}", thinnest(&new));
        }
    }
}
