//! A closed triangle mesh of a chain: a body of revolution about the x axis with round ends.

use std::f64::consts::PI;

use nalgebra::Point3;

use super::chain::Chain;
use crate::mesh::TriangleMesh;

/// Resolution of the mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fineness {
    /// Vertices of a ring, at least 3.
    pub around: u32,
    /// Number of rings of a hemisphere; 0 closes the ends flat.
    pub cap: u32,
}

impl Default for Fineness {
    fn default() -> Self {
        Self { around: 72, cap: 9 }
    }
}

/// A closed mesh of the chain from x = 0 on, with outward triangles. A ring has the area of its
/// circle, not its radius, so the frusta of the mesh have the volumes of those of the chain. The
/// triangles are the same at every length.
pub fn surface(chain: &Chain, fineness: Fineness) -> TriangleMesh {
    let around = fineness.around.max(3);
    let rings = profile(chain, fineness.cap);
    let step = 2.0 * PI / f64::from(around);
    let wider = (step / libm::sin(step)).sqrt();
    let mut mesh = TriangleMesh::default();
    let mut firsts: Vec<(u32, u32)> = Vec::new();
    for (x, r) in rings {
        let first = mesh.vertices.len() as u32;
        if let Some(r) = r {
            let corner = |k: u32| {
                let angle = step * f64::from(k);
                Point3::new(
                    x,
                    r * wider * libm::cos(angle),
                    r * wider * libm::sin(angle),
                )
            };
            mesh.vertices.extend((0..around).map(corner));
            firsts.push((first, around));
        } else {
            mesh.vertices.push(Point3::new(x, 0.0, 0.0));
            firsts.push((first, 1));
        }
    }
    for pair in firsts.windows(2) {
        join(&mut mesh.triangles, pair[0], pair[1]);
    }
    mesh
}

/// Positions along the axis with their radii, from tip to tip; `None` for a single vertex. A node
/// whose radius is 0 at every length has a single vertex.
fn profile(chain: &Chain, cap: u32) -> Vec<(f64, Option<f64>)> {
    let (radii, spacing) = (chain.radii(), chain.spacing());
    let rest = chain.rest();
    let ring = |i: usize| (rest.radii[i] > 0.0 || rest.growth[i] > 0.0).then_some(radii[i]);
    let (first, last) = (ring(0), ring(radii.len() - 1));
    let arc = |r: f64| {
        // From the rim to the tip, without the rim.
        (1..=cap).map(move |k| {
            let angle = 0.5 * PI * f64::from(k) / f64::from(cap.max(1));
            let radius = (k < cap).then(|| r * libm::cos(angle));
            (r * libm::sin(angle), radius)
        })
    };
    let mut rings: Vec<(f64, Option<f64>)> = Vec::new();
    if let Some(first) = first {
        rings.extend(arc(first).map(|(out, r)| (-out, r)));
        rings.reverse();
        if cap == 0 {
            rings.push((0.0, None));
        }
    }
    rings.extend((0..radii.len()).map(|i| (spacing * i as f64, ring(i))));
    if let Some(last) = last {
        rings.extend(arc(last).map(|(out, r)| (chain.length() + out, r)));
        if cap == 0 {
            rings.push((chain.length(), None));
        }
    }
    rings
}

/// Triangles between two rings; each of them can be a point.
fn join(triangles: &mut Vec<[u32; 3]>, (a, around_a): (u32, u32), (b, around_b): (u32, u32)) {
    let around = around_a.max(around_b);
    let at = |first: u32, count: u32, k: u32| first + k % count;
    for k in 0..around {
        let [p, q] = [k, k + 1].map(|k| at(a, around_a, k));
        let [r, s] = [k, k + 1].map(|k| at(b, around_b, k));
        if around_a > 1 {
            triangles.push([p, q, r]);
        }
        if around_b > 1 {
            triangles.push([q, s, r]);
        }
    }
}
