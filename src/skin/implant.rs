//! The implant: a closed shell over its base, at rest a dome of the given volume.

use nalgebra::{Point2, Point3};

use super::shapes::BaseShape;
use super::{SkinError, settle::Stiffness};
use crate::constraints::distance::Distance;
use crate::mesh::{Topology, TriangleMesh};
use crate::skin::layers::springs_of;

/// Bisections of a dome's height: to the last bit.
const HALVINGS: u32 = 200;

/// Greatest width of a dome relative to its base.
pub(super) const BULGE: f64 = 1.3;

/// Greatest height of a dome relative to half of its base.
const HIGHEST: f64 = 20.0;

/// Shape, size and material of an implant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Implant {
    /// Shape of the base.
    pub shape: BaseShape,
    /// Length of the base [m].
    pub base: f64,
    /// Volume [m^3].
    pub volume: f64,
    /// In-plane stiffness E t of the shell [N/m].
    pub membrane: f64,
}

/// In-plane stiffness of a shell of silicone, 1 MPa and 0.5 mm [N/m].
pub const SILICONE: f64 = 500.0;

impl Implant {
    /// Checks the numbers.
    ///
    /// # Errors
    /// A number that is not positive and finite.
    pub fn check(&self) -> Result<(), SkinError> {
        SkinError::positive("the base", self.base)?;
        SkinError::positive("the volume", self.volume)?;
        SkinError::positive("the stiffness of the implant", self.membrane)
    }

    /// The dome with edges of about `edge` [m] and its base in the plane z = 0. Over a round base
    /// the dome is a spherical cap, over others the same cap stretched to the outline. The mesh
    /// encloses the volume up to rounding.
    ///
    /// # Errors
    /// A number that is not positive, or a volume whose dome would be far higher than wide.
    pub fn dome(&self, edge: f64) -> Result<TriangleMesh, SkinError> {
        self.check()?;
        SkinError::positive("the edge length", edge)?;
        self.shape_of(edge).ok_or_else(|| self.too_large(edge))
    }

    /// The error for a volume that is too large for this base.
    pub fn too_large(&self, edge: f64) -> SkinError {
        let (volume_cc, most_cc) = (self.volume * 1e6, self.largest(edge) * 1e6);
        SkinError::TooLarge {
            volume_cc,
            most_cc,
            base_cm: self.base * 1e2,
        }
    }

    /// The largest volume [m^3] whose dome with edges of about `edge` [m] does not overhang its
    /// base too far.
    pub fn largest(&self, edge: f64) -> f64 {
        let (mut low, mut high) = (0.0, 10.0 * self.base.powi(3));
        for _ in 0..40 {
            let tried = Self {
                volume: 0.5 * (low + high),
                ..*self
            };
            let fits = tried
                .shape_of(edge)
                .is_some_and(|dome| tried.bulge(&dome) <= BULGE);
            if fits {
                low = tried.volume
            } else {
                high = tried.volume
            }
        }
        low
    }

    /// The volume of the dome with this height [m^3].
    pub(super) fn volume_of(&self, height: f64, edge: f64) -> f64 {
        let rings = self.rings(edge);
        TriangleMesh {
            vertices: self.vertices(height, rings),
            triangles: triangles(rings),
        }
        .volume()
    }

    fn rings(&self, edge: f64) -> u32 {
        ((0.5 * self.base / edge).round() as u32).clamp(4, 64)
    }

    /// The dome; `None` if it would be far higher than wide.
    fn shape_of(&self, edge: f64) -> Option<TriangleMesh> {
        let rings = self.rings(edge);
        let triangles = triangles(rings);
        let at = |height: f64| TriangleMesh {
            vertices: self.vertices(height, rings),
            triangles: triangles.clone(),
        };
        let (mut low, mut high) = (0.0, HIGHEST * 0.5 * self.base);
        if !(at(high).volume() >= self.volume) {
            return None;
        }
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if middle <= low || middle >= high {
                break;
            }
            if at(middle).volume() < self.volume {
                low = middle
            } else {
                high = middle
            }
        }
        Some(at(high))
    }

    /// Greatest width of the dome relative to the width of its base.
    pub fn bulge(&self, dome: &TriangleMesh) -> f64 {
        let reach = |p: &Point3<f64>| self.shape.reach(p.xy(), self.base);
        crate::mesh::measures::max_or_nan(dome.vertices.iter().map(reach))
    }

    /// The upper sheet from the top to the edge, then the base from the edge's inside to its
    /// centre.
    fn vertices(&self, height: f64, rings: u32) -> Vec<Point3<f64>> {
        let half = 0.5 * self.base;
        let radius = (half * half + height * height) / (2.0 * height.max(1e-9 * half));
        let most = libm::atan2(half, radius - height);
        let mut vertices = Vec::new();
        for k in 0..=rings {
            let angle = most * f64::from(k) / f64::from(rings);
            let out = if k == rings {
                1.0
            } else {
                radius * libm::sin(angle) / half
            };
            // 1 - cos without cancellation for a flat cap.
            let sine = libm::sin(0.5 * angle);
            let z = if k == rings {
                0.0
            } else {
                height - 2.0 * radius * sine * sine
            };
            self.ring(k, out, z, &mut vertices);
        }
        for k in (0..rings).rev() {
            self.ring(k, f64::from(k) / f64::from(rings), 0.0, &mut vertices);
        }
        vertices
    }

    fn ring(&self, k: u32, out: f64, z: f64, vertices: &mut Vec<Point3<f64>>) {
        let count = (6 * k).max(1);
        for j in 0..count {
            let angle = std::f64::consts::TAU * f64::from(j) / f64::from(count);
            let disc = Point2::new(libm::cos(angle), libm::sin(angle)) * out;
            let place = self.shape.place(disc, self.base);
            vertices.push(Point3::new(place.x, place.y, z));
        }
    }

    /// The springs of the shell at rest in the shape of `mesh`; its vertices begin at index
    /// `first`.
    pub fn springs(&self, mesh: &TriangleMesh, first: u32) -> (Vec<Distance>, Stiffness) {
        let (springs, stiffness) = springs_of(mesh, &Topology::new(mesh), self.membrane);
        let moved = springs.into_iter().map(|s| Distance {
            points: s.points.map(|p| p + first),
            ..s
        });
        (moved.collect(), stiffness)
    }
}

/// Number of vertices of the upper sheet including its edge.
pub fn upper(rings: u32) -> u32 {
    1 + 3 * rings * (rings + 1)
}

/// Triangles of both sheets, oriented outward.
fn triangles(rings: u32) -> Vec<[u32; 3]> {
    let mut all = Vec::new();
    for k in 1..=rings {
        all.extend(band(k, [k - 1, k].map(first_above)));
        let below = band(k, [k - 1, k].map(|k| first_below(k, rings)));
        all.extend(below.into_iter().map(|[a, b, c]| [a, c, b]));
    }
    all
}

/// First vertex of ring `k` of the upper sheet; the ring has 6 k vertices.
fn first_above(k: u32) -> u32 {
    if k == 0 { 0 } else { 1 + 3 * k * (k - 1) }
}

/// First vertex of ring `k` of the base; both sheets share the last ring.
fn first_below(k: u32, rings: u32) -> u32 {
    if k == rings {
        first_above(rings)
    } else {
        upper(rings) + (k + 1..rings).map(|j| 6 * j).sum::<u32>()
    }
}

/// Triangles between the rings k - 1 and k, whose first vertices are `inner` and `outer`.
fn band(k: u32, [inner, outer]: [u32; 2]) -> Vec<[u32; 3]> {
    let at_inner = |j: u32| inner + if k == 1 { 0 } else { j % (6 * (k - 1)) };
    let at_outer = |j: u32| outer + j % (6 * k);
    let mut all = Vec::new();
    for sector in 0..6 {
        for j in 0..k {
            let (o, i) = (sector * k + j, sector * (k - 1) + j);
            all.push([at_inner(i), at_outer(o), at_outer(o + 1)]);
            if j + 1 < k {
                all.push([at_inner(i), at_outer(o + 1), at_inner(i + 1)]);
            }
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn round(volume: f64) -> Implant {
        Implant {
            shape: BaseShape::Round,
            base: 0.07,
            volume,
            membrane: SILICONE,
        }
    }

    #[test]
    fn domes_are_closed_and_have_their_volume() {
        for (name, shape) in BaseShape::ALL {
            for volume in [5e-6, 50e-6, 150e-6] {
                let dome = Implant {
                    shape,
                    ..round(volume)
                }
                .dome(0.0035)
                .unwrap();
                let topology = Topology::new(&dome);
                assert!(topology.is_closed() && topology.is_oriented(), "{name}");
                assert!(
                    (dome.volume() / volume - 1.0).abs() <= 1e-12,
                    "{name}: {}",
                    dome.volume()
                );
                assert_eq!(
                    dome.vertices.len() + dome.triangles.len() - topology.edges.len(),
                    2,
                    "{name}"
                );
            }
        }
    }

    #[test]
    fn a_round_dome_is_a_cap() {
        // V = pi h (3 a^2 + h^2) / 6; the mesh lies inside the cap, so it is slightly higher.
        let dome = round(100e-6).dome(0.002).unwrap();
        let height = crate::mesh::measures::max_or_nan(dome.vertices.iter().map(|p| p.z));
        let (a, h) = (0.035, height);
        let volume = std::f64::consts::PI * h * (3.0 * a * a + h * h) / 6.0;
        assert!(volume > 100e-6 && volume < 101e-6, "{volume}");
    }

    #[test]
    fn numbers_that_make_no_implant_are_refused() {
        for volume in [0.0, -1e-6, f64::NAN, f64::INFINITY, 1.0] {
            assert!(round(volume).dome(0.0035).is_err(), "{volume}");
        }
        assert!(
            Implant {
                base: 0.0,
                ..round(1e-6)
            }
            .dome(0.0035)
            .is_err()
        );
    }
}
