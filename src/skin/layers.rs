//! Skin as two layers of springs.

use std::collections::BTreeSet;

use nalgebra::{Point3, Vector3};

use super::SkinError;
use super::hinges::Hinge;
use super::region::Region;
use super::settle::Stiffness;
use crate::constraints::Bending;
use crate::constraints::distance::Distance;
use crate::mesh::{Topology, TriangleMesh};
use crate::solvers::stiffness::hinges;

/// Poisson's ratio for which springs along edges represent a membrane \[vangelder1998\].
const NU: f64 = 1.0 / 3.0;

/// Least stiffness of a spring relative to van Gelder's simpler formula: the formula can be
/// negative where the angle opposite an edge is obtuse.
const LEAST: f64 = 0.05;

/// Stiffness of a diagonal between the layers relative to that of its edge in one layer.
const THROUGH: f64 = 0.5;

/// Flexural rigidity of hinges over their bending stiffness (`docs/verification.md`).
const HINGED: f64 = 3.0;

/// Material of the skin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tissue {
    /// Young's modulus [Pa].
    pub modulus: f64,
    /// Thickness of the membrane [m].
    pub thickness: f64,
    /// Distance of the lower layer below the upper one: the depth of the implant [m].
    pub depth: f64,
    /// Stiffness of the bond of the lower layer to what lies below it, for each area [N/m^3]; 0 for
    /// none.
    pub bond: f64,
    /// Size of the pocket without a bond, relative to the base of the implant: 1 for a pocket that
    /// is cut to the base, 0 for none.
    pub pocket: f64,
}

impl Default for Tissue {
    /// Assumed values: 0.2 MPa, 2 mm, 5 mm deep, without a bond.
    fn default() -> Self {
        Self {
            modulus: 2e5,
            thickness: 2e-3,
            depth: 5e-3,
            bond: 0.0,
            pocket: 1.0,
        }
    }
}

impl Tissue {
    /// Checks the numbers.
    ///
    /// # Errors
    /// A number that is not positive and finite.
    pub fn check(&self) -> Result<(), SkinError> {
        SkinError::positive("the stiffness of the skin", self.modulus)?;
        SkinError::positive("the thickness of the skin", self.thickness)?;
        SkinError::positive("the depth", self.depth)?;
        SkinError::not_negative("the bond of the skin", self.bond)?;
        SkinError::not_negative("the size of the pocket", self.pocket)
    }

    /// In-plane stiffness E t [N/m].
    pub fn membrane(&self) -> f64 {
        self.modulus * self.thickness
    }

    /// Flexural rigidity E t^3 / 12 (1 - nu^2) [N m].
    pub fn rigidity(&self) -> f64 {
        self.membrane() * self.thickness * self.thickness / (12.0 * (1.0 - NU * NU))
    }
}

/// Edges of a mesh at rest with their stiffness [N/m], for a membrane of in-plane stiffness
/// `membrane` E t [N/m]: k = E t/(1+nu) A/c^2 + E t nu/(1-nu^2) (a^2+b^2-c^2)/(8A) at nu = 1/3,
/// summed over the triangles of the edge of length c \[vangelder1998\]. This is half of the formula
/// printed in the second source (its erratum B02).
pub fn springs_of(
    mesh: &TriangleMesh,
    topology: &Topology,
    membrane: f64,
) -> (Vec<Distance>, Stiffness) {
    let lengths = topology.edge_lengths(mesh);
    let springs = topology
        .edges
        .iter()
        .zip(&lengths)
        .map(|(&points, &rest)| Distance { points, rest });
    let mut stiffness = vec![0.0; lengths.len()];
    let mut simple = vec![0.0; lengths.len()];
    for (t, edges) in topology.triangle_edges.iter().enumerate() {
        let [p, q, r] = mesh.corners(t);
        let area = 0.5 * (q - p).cross(&(r - p)).norm();
        let squares = edges.map(|e| lengths[e as usize] * lengths[e as usize]);
        let all: f64 = squares.iter().sum();
        for (edge, square) in edges.iter().zip(squares) {
            let angle = NU / (1.0 - NU * NU) * (all - 2.0 * square) / (8.0 * area);
            stiffness[*edge as usize] += membrane * (area / square / (1.0 + NU) + angle);
            simple[*edge as usize] += membrane * area / square;
        }
    }
    stiffness.iter_mut().zip(simple).for_each(|(k, simple)| {
        *k = if *k > LEAST * simple {
            *k
        } else {
            LEAST * simple
        }
    });
    (springs.collect(), stiffness)
}

/// A region of skin in two layers: vertices 0 to n - 1 are the upper layer, n to 2 n - 1 the lower
/// one.
#[derive(Clone, Debug)]
pub struct Layers {
    /// Triangles of the upper layer.
    pub triangles: Vec<[u32; 3]>,
    /// Positions at rest [m], shape `[2 n]`.
    pub rest: Vec<Point3<f64>>,
    /// True for each fixed vertex, shape `[2 n]`.
    pub held: Vec<bool>,
    /// Every spring with a free end.
    pub springs: Vec<Distance>,
    /// Stiffness of each spring [N/m].
    pub stiffness: Stiffness,
    /// Hinges of both layers with a free corner.
    pub hinges: Vec<Hinge>,
    /// Stiffness of the bond of each vertex of the lower layer to its position at rest [N/m], shape
    /// `[n]`; empty without a bond.
    pub bonds: Vec<f64>,
    /// Median edge [m].
    pub edge: f64,
}

impl Layers {
    /// Doubles a region; `inward` is the vector from each vertex to its lower one [m].
    pub fn new(region: &Region, tissue: &Tissue, inward: &[Vector3<f64>]) -> Self {
        let upper = &region.mesh;
        let topology = Topology::new(upper);
        let n = upper.vertices.len() as u32;
        let below = upper.vertices.iter().zip(inward).map(|(p, d)| p + d);
        let lower = TriangleMesh {
            vertices: below.collect(),
            triangles: upper.triangles.clone(),
        };
        let rim = region.rim(&topology);
        let half = 0.5 * tissue.membrane();
        let [above, under] = [upper, &lower].map(|mesh| springs_of(mesh, &topology, half));
        let (mut springs, mut stiffness) = (Vec::new(), Vec::new());
        for (e, &[a, b]) in topology.edges.iter().enumerate() {
            if rim[a as usize] && rim[b as usize] {
                continue;
            }
            let through = THROUGH * 0.5 * (above.1[e] + under.1[e]);
            let across = |a: u32, b: u32| {
                let rest = (lower.vertices[b as usize] - upper.vertices[a as usize]).norm();
                Distance {
                    points: [a, b + n],
                    rest,
                }
            };
            let low = Distance {
                points: [a + n, b + n],
                rest: under.0[e].rest,
            };
            springs.extend([above.0[e], low, across(a, b), across(b, a)]);
            stiffness.extend([above.1[e], under.1[e], through, through]);
        }
        let mut bent = Vec::new();
        for (mesh, first) in [(upper, 0), (&lower, n)] {
            let (hinges, stiffness) = hinges(mesh, &topology, tissue.rigidity() / HINGED);
            for (hinge, stiffness) in hinges.into_iter().zip(stiffness) {
                if !hinge.points.iter().all(|v| rim[*v as usize]) {
                    let points = hinge.points.map(|v| v + first);
                    bent.push(Hinge::new(Bending { points, ..hinge }, stiffness));
                }
            }
        }
        let edge = upper.median_edge_length(&topology).unwrap_or(0.0);
        let rest = upper
            .vertices
            .iter()
            .chain(&lower.vertices)
            .copied()
            .collect();
        Self {
            triangles: upper.triangles.clone(),
            rest,
            held: [rim.clone(), rim].concat(),
            springs,
            stiffness,
            hinges: bent,
            bonds: Vec::new(),
            edge,
        }
    }

    /// Bonds the lower layer to its position at rest, with `stiffness` for each area [N/m^3], at
    /// the vertices for which `is_bonded` holds of the upper vertex at rest.
    pub fn bond(&mut self, stiffness: f64, is_bonded: impl Fn(&Point3<f64>) -> bool) {
        if !(stiffness > 0.0) {
            return;
        }
        let areas = self.support().vertex_areas();
        let upper = self.rest[..self.count()].iter();
        self.bonds = upper
            .zip(areas)
            .map(|(p, area)| if is_bonded(p) { stiffness * area } else { 0.0 })
            .collect();
    }

    /// Adds the hinges of the upper layer at its rim: with the triangles of the `skin` beside the
    /// region, which do not move.
    pub fn join(&mut self, skin: &TriangleMesh, region: &Region, tissue: &Tissue) {
        let mut number = vec![None; skin.vertices.len()];
        for (own, &v) in region.vertices.iter().enumerate() {
            number[v as usize] = Some(own as u32);
        }
        let sorted = |mut corners: [u32; 3]| {
            corners.sort_unstable();
            corners
        };
        let own = region.triangles.iter();
        let own: BTreeSet<[u32; 3]> = own.map(|&t| sorted(skin.triangles[t as usize])).collect();
        let (all, stiffness) = hinges(skin, &Topology::new(skin), tissue.rigidity() / HINGED);
        for (hinge, stiffness) in all.into_iter().zip(stiffness) {
            let [a, b, c, d] = hinge.points;
            let [first, second] = [[a, b, c], [b, a, d]].map(|t| own.contains(&sorted(t)));
            // The angle is the same from the other side.
            let [a, b, tip, beyond] = match (first, second) {
                (true, false) => [a, b, c, d],
                (false, true) => [b, a, d, c],
                _ => continue,
            };
            let [Some(a), Some(b), Some(tip)] = [a, b, tip].map(|v| number[v as usize]) else {
                continue;
            };
            if !self.held[tip as usize] {
                let points = [a, b, tip, tip];
                let hinge = Hinge::new(Bending { points, ..hinge }, stiffness);
                self.hinges
                    .push(hinge.beside(skin.vertices[beyond as usize]));
            }
        }
    }

    /// No skin: for an implant alone with edges of about `edge` [m].
    pub fn none(edge: f64) -> Self {
        let (triangles, rest, held, springs, stiffness) = Default::default();
        let (hinges, bonds) = Default::default();
        Self {
            bonds,
            triangles,
            rest,
            held,
            springs,
            stiffness,
            hinges,
            edge,
        }
    }

    /// Number of vertices in one layer.
    pub fn count(&self) -> usize {
        self.rest.len() / 2
    }

    /// Triangles of the lower layer.
    pub fn lower(&self) -> Vec<[u32; 3]> {
        let n = self.count() as u32;
        self.triangles.iter().map(|t| t.map(|v| v + n)).collect()
    }

    /// The lower layer at rest as a mesh.
    pub fn support(&self) -> TriangleMesh {
        TriangleMesh {
            vertices: self.rest[self.count()..].to_vec(),
            triangles: self.triangles.clone(),
        }
    }
}
