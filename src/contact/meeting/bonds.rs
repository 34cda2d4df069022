//! Bonds of soft surfaces: springs from the vertices of each to their places on the other one.

use nalgebra::{Point3, Vector3};

use super::super::surface::Surface;
use super::{Meeting, SoftMember};
use crate::constraints::bond::ElasticBond;
use crate::constraints::{Batch, Bond, Constraint, Potential, Project, Stencils, SweepOrder};
use crate::mesh::TriangleMesh;
use crate::particles::Particles;

/// A bond of two soft surfaces of a meeting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BondSpec {
    /// The two surfaces.
    pub members: [usize; 2],
    /// Greatest distance of a vertex from the other surface at rest [m].
    pub within: f64,
    /// Stiffness for each area [N/m^3]. Each surface has half of it.
    pub stiffness: f64,
}

/// The bonds of a meeting, over all of its soft vertices.
pub(super) struct Bonds {
    elastic: Vec<ElasticBond>,
    batch: Batch<Bond, 4>,
    particles: Particles,
}

impl Bonds {
    pub fn begin_step(&mut self) {
        self.batch.begin_step();
    }
}

impl Meeting {
    /// Adds bonds between soft surfaces as they are at rest. Returns their number for each of
    /// `specs`.
    ///
    /// A vertex that is near the other surface is bonded to its place over the nearest triangle, with
    /// the stiffness of its area there, unless its foot lies far from this triangle.
    pub fn bond(&mut self, soft: &[SoftMember<'_>], specs: &[BondSpec]) -> Vec<usize> {
        let (mut elastic, mut counts) = (Vec::new(), Vec::new());
        for spec in specs {
            let before = elastic.len();
            let [a, b] = spec.members;
            for [one, other] in [[a, b], [b, a]] {
                let first = [one, other].map(|member| self.members[member].first as u32);
                let places = places([soft[one].mesh, soft[other].mesh], first, spec.within);
                for (bond, area) in places {
                    let stiffness = 0.5 * spec.stiffness * area;
                    if stiffness > 0.0 {
                        elastic.push(ElasticBond { bond, stiffness });
                    }
                }
            }
            counts.push(elastic.len() - before);
        }
        let count = self.soft_count;
        let all = elastic.iter().map(|elastic| elastic.bond).collect();
        let compliance = elastic.iter().map(|elastic| 1.0 / elastic.stiffness);
        let compliance = compliance.collect();
        self.bonds = (!elastic.is_empty()).then(|| Bonds {
            batch: Batch::new(all, compliance, SweepOrder::Coloured, count, &[]),
            elastic,
            particles: Particles::at_rest(
                self.start[..count].to_vec(),
                self.mass[..count].to_vec(),
            ),
        });
        counts
    }

    /// Their energy over all soft vertices, for a solver that sweeps over nothing.
    pub fn elastic_bonds(&self) -> Option<Box<dyn Potential>> {
        let bonds = self.bonds.as_ref()?;
        Some(Box::new(Stencils::new(Bond::NAME, bonds.elastic.clone())))
    }

    /// One sweep over the bonds with a step of `dt` [s], at the given positions of each soft surface
    /// [m]. Returns true if there are bonds.
    pub fn project_bonds(&mut self, bodies: &mut [&mut [Point3<f64>]], dt: f64) -> bool {
        let Some(bonds) = &mut self.bonds else {
            return false;
        };
        let Bonds {
            elastic: _,
            batch,
            particles,
        } = bonds;
        for (member, x) in self.members.iter().zip(bodies.iter()) {
            particles.position[member.first..member.first + member.count].copy_from_slice(x);
        }
        batch.project(particles, dt);
        for (member, x) in self.members.iter().zip(bodies) {
            x.copy_from_slice(&particles.position[member.first..member.first + member.count]);
        }
        true
    }
}

/// The bonds of the vertices of the first of two surfaces to places on the second one, each with the
/// area of the vertex as seen along the normal of its place [m^2]; `first` are the numbers of their
/// first vertices.
fn places([one, other]: [&TriangleMesh; 2], first: [u32; 2], within: f64) -> Vec<(Bond, f64)> {
    let surface = Surface::new(other);
    let mut found: Vec<Option<(Bond, Vector3<f64>, f64)>> = Vec::new();
    for (v, x) in one.vertices.iter().enumerate() {
        found.push(surface.nearest(x, within).and_then(|place| {
            let triangle = place.triangle as usize;
            let [a, b, c] = other.triangles[triangle].map(|v| first[1] + v);
            let [p, q, r] = other.corners(triangle);
            let bond = Bond::at_rest([first[0] + v as u32, a, b, c], &[*x, p, q, r])?;
            Some((bond, (q - p).cross(&(r - p)).normalize(), 0.0))
        }));
    }
    for (t, corners) in one.triangles.iter().enumerate() {
        let [p, q, r] = one.corners(t);
        let twice = (q - p).cross(&(r - p));
        for &v in corners {
            if let Some((_, normal, area)) = &mut found[v as usize] {
                *area += twice.dot(normal).abs() / 6.0;
            }
        }
    }
    let bonds = found.into_iter().flatten();
    bonds.map(|(bond, _, area)| (bond, area)).collect()
}
