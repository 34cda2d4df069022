//! What no skin over an implant may do: cross itself, an implant or an obstacle, or fold over. The
//! counts rest on exact predicates and on nothing that the equilibrium computes.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::FRAC_PI_2;

use nalgebra::{Point3, Vector3, center};

use crate::mesh::SurfaceTree;
use crate::mesh::crossings::{Crossed, Crossings, crossings_between, self_crossings};
use crate::mesh::predicates::{crossing_point, is_flat};

/// Greatest angle between the normals of two triangles that share an edge [rad]. Skin that is
/// folded further lies on itself.
pub const STEEPEST_FOLD: f64 = FRAC_PI_2;

/// Defects of one kind, with the place of the first.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Defects {
    /// Number of pairs of triangles.
    pub count: usize,
    /// A point of the first pair [m].
    pub place: Option<Point3<f64>>,
}

/// Crossings and folds of skin that were not there before the insertion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Soundness {
    /// Crossings of the skin with itself: the whole skin with itself, the lower layer with itself
    /// and with the upper one.
    pub itself: Defects,
    /// Crossings of skin or an implant with an implant.
    pub implants: Defects,
    /// Crossings of skin or an implant with an obstacle.
    pub obstacles: Defects,
    /// Edges of either layer that are folded beyond [`STEEPEST_FOLD`], and further than before.
    pub folds: Defects,
    /// The greatest angle of an edge that is folded further than before [rad].
    pub greatest_fold: f64,
    /// True if all pairs of triangles were tested.
    pub complete: bool,
}

impl Defects {
    /// Adds other defects; the first place stays.
    pub fn add(&mut self, other: &Self) {
        self.count += other.count;
        self.place = self.place.or(other.place);
    }
}

impl Soundness {
    /// No defect, before any surface is looked at.
    pub fn none() -> Self {
        Self {
            complete: true,
            ..Self::default()
        }
    }

    /// True if there is no crossing and no fold.
    pub fn is_sound(&self) -> bool {
        let counts = [self.itself, self.implants, self.obstacles, self.folds];
        self.complete
            && counts.iter().all(|defects| defects.count == 0)
            && self.greatest_fold <= STEEPEST_FOLD
    }

    /// Adds the crossings of pairs of surfaces to the field that `of` gives.
    pub fn cross(&mut self, of: fn(&mut Self) -> &mut Defects, found: &(Defects, bool)) {
        of(self).add(&found.0);
        self.complete &= found.1;
    }

    /// Adds the folds of a surface.
    pub fn fold(&mut self, surface: &MovedSurface<'_>) {
        let (folds, greatest) = surface.folds();
        self.folds.add(&folds);
        // NaN stays.
        if !(greatest <= self.greatest_fold) {
            self.greatest_fold = greatest;
        }
    }
}

/// A surface before and after a motion.
#[derive(Clone, Copy, Debug)]
pub struct MovedSurface<'a> {
    /// Positions before [m], shape `[vertex_count]`.
    pub before: &'a [Point3<f64>],
    /// Positions after [m], shape `[vertex_count]`.
    pub after: &'a [Point3<f64>],
    /// Triangles, shape `[triangle_count]`.
    pub triangles: &'a [[u32; 3]],
}

/// Positions and triangles of a surface.
type Placed<'a> = (&'a [Point3<f64>], &'a [[u32; 3]]);

/// The crossings of one surface, or of two, with these positions.
pub(super) fn crossings(first: Placed<'_>, second: Option<Placed<'_>>) -> Crossings {
    let flat = |(x, triangles): Placed<'_>| -> Vec<bool> {
        let corners = |t: &[u32; 3]| t.map(|v| x[v as usize]);
        triangles.iter().map(|t| is_flat(&corners(t))).collect()
    };
    let count = first.0.len().max(second.map_or(0, |s| s.0.len()));
    let names: Vec<u32> = (0..count as u32).collect();
    let (tree, skipped) = (SurfaceTree::new(first.0, first.1), flat(first));
    let one = Crossed {
        vertices: first.0,
        triangles: first.1,
        names: &names,
        skipped: &skipped,
        tree: &tree,
    };
    let Some(second) = second else {
        return self_crossings(one, usize::MAX);
    };
    let (tree, skipped) = (SurfaceTree::new(second.0, second.1), flat(second));
    let other = Crossed {
        vertices: second.0,
        triangles: second.1,
        names: &names,
        skipped: &skipped,
        tree: &tree,
    };
    crossings_between(one, other, usize::MAX)
}

impl<'a> MovedSurface<'a> {
    /// A surface that does not move.
    pub fn still(vertices: &'a [Point3<f64>], triangles: &'a [[u32; 3]]) -> Self {
        Self {
            before: vertices,
            after: vertices,
            triangles,
        }
    }

    /// Crossings with itself that were not there before, of pairs that `is_own` accepts by one of
    /// their triangles, and true if all pairs were tested.
    pub fn self_crossings(&self, is_own: impl Fn(u32) -> bool) -> (Defects, bool) {
        self.fresh(None, |[s, t]| is_own(s) || is_own(t))
    }

    /// Crossings with another surface that were not there before, and true if all pairs were
    /// tested.
    pub fn crossings_with(&self, other: &Self) -> (Defects, bool) {
        self.fresh(Some(other), |_| true)
    }

    fn fresh(&self, other: Option<&Self>, is_own: impl Fn([u32; 2]) -> bool) -> (Defects, bool) {
        let (triangles, partner) = (self.triangles, other.unwrap_or(self));
        let mut now = crossings(
            (self.after, triangles),
            other.map(|o| (o.after, o.triangles)),
        );
        now.pairs.retain(|pair| is_own(*pair));
        if !now.pairs.is_empty() {
            let with = other.map(|o| (o.before, o.triangles));
            let before = crossings((self.before, triangles), with);
            let known: BTreeSet<[u32; 2]> = before.pairs.into_iter().collect();
            now.pairs.retain(|pair| !known.contains(pair));
        }
        let corners = |of: &Self, t: u32| of.triangles[t as usize].map(|v| of.after[v as usize]);
        let place = |[s, t]: &[u32; 2]| crossing_point(&corners(self, *s), &corners(partner, *t));
        let defects = Defects {
            count: now.pairs.len(),
            place: now.pairs.first().map(place),
        };
        (defects, now.complete)
    }

    /// The edges that are folded beyond [`STEEPEST_FOLD`], with the middle of the steepest one, and
    /// the greatest angle [rad]; only edges that are folded further than before count.
    pub fn folds(&self) -> (Defects, f64) {
        let mut sides: BTreeMap<[u32; 2], Vec<usize>> = BTreeMap::new();
        let mut is_changed = Vec::with_capacity(self.triangles.len());
        for (t, corners) in self.triangles.iter().enumerate() {
            let changed = |v: &u32| self.before[*v as usize] != self.after[*v as usize];
            is_changed.push(corners.iter().any(changed));
            for k in 0..3 {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                sides.entry([a.min(b), a.max(b)]).or_default().push(t);
            }
        }
        let (mut found, mut greatest) = (Defects::default(), 0.0);
        for (side, triangles) in sides {
            let [s, t] = triangles[..] else { continue };
            // One of them may lie outside of what moves.
            if !is_changed[s] && !is_changed[t] {
                continue;
            }
            let angle = |x: &[Point3<f64>]| {
                let [n, m] = [s, t].map(|t| self.normal(t, x));
                libm::atan2(n.cross(&m).norm(), n.dot(&m))
            };
            let now = angle(self.after);
            if now <= angle(self.before) {
                continue;
            }
            found.count += usize::from(!(now <= STEEPEST_FOLD));
            if !(now <= greatest) {
                greatest = now;
                let [a, b] = side.map(|v| self.after[v as usize]);
                found.place = Some(center(&a, &b));
            }
        }
        (found, greatest)
    }

    /// The area vector of a triangle, times two [m^2].
    fn normal(&self, t: usize, x: &[Point3<f64>]) -> Vector3<f64> {
        let [a, b, c] = self.triangles[t].map(|v| x[v as usize]);
        (b - a).cross(&(c - a))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::sheet;

    /// A sheet of 1 m in its plane, and bent about the line x = 0 by an angle [rad].
    fn bent(angle: f64) -> (crate::mesh::TriangleMesh, Vec<Point3<f64>>) {
        let mesh = sheet(1.0, 8);
        let turned = |p: &Point3<f64>| {
            let along = p.x.max(0.0);
            let flat = p.x - along;
            let (x, z) = (along * libm::cos(angle), along * libm::sin(angle));
            Point3::new(flat + x, p.y, p.z + z)
        };
        let after = mesh.vertices.iter().map(turned).collect();
        (mesh, after)
    }

    fn of<'a>(mesh: &'a crate::mesh::TriangleMesh, after: &'a [Point3<f64>]) -> MovedSurface<'a> {
        MovedSurface {
            before: &mesh.vertices,
            after,
            triangles: &mesh.triangles,
        }
    }

    #[test]
    fn a_fold_beyond_a_right_angle_is_a_defect_and_has_a_place() {
        for (degrees, count) in [(0.0, 0), (60.0, 0), (89.0, 0), (91.0, 8), (170.0, 8)] {
            let (mesh, after) = bent(f64::to_radians(degrees));
            let mut sound = Soundness::none();
            sound.fold(&of(&mesh, &after));
            assert_eq!(sound.folds.count, count, "{degrees}");
            assert!((sound.greatest_fold.to_degrees() - degrees).abs() <= 1e-6);
            assert_eq!(sound.is_sound(), count == 0);
            if let Some(place) = sound.folds.place {
                assert!(place.x.abs() <= 1e-12 && place.z.abs() <= 1e-12, "{place}");
            }
        }
    }

    #[test]
    fn a_fold_of_the_skin_as_read_is_no_defect() {
        let (mesh, after) = bent(2.0);
        let still = MovedSurface {
            before: &after,
            ..of(&mesh, &after)
        };
        assert_eq!(still.folds(), (Defects::default(), 0.0));
    }

    #[test]
    fn what_is_not_a_number_is_not_sound() {
        let (mesh, mut after) = bent(0.1);
        after[40].x = f64::NAN;
        let mut sound = Soundness::none();
        sound.fold(&of(&mesh, &after));
        assert!(!sound.is_sound());
    }

    #[test]
    fn crossings_are_found_unless_they_were_there_before() {
        // The bent half passes through the other one.
        let (mesh, mut after) = bent(3.0);
        let turned = of(&mesh, &after);
        assert_eq!(turned.self_crossings(|_| true).0.count, 0);
        let tip = |p: &Point3<f64>, q: &Point3<f64>| p.x > 0.2 && q.z > 0.0;
        for (p, q) in mesh.vertices.iter().zip(&mut after) {
            if tip(p, q) {
                q.z = -0.05;
            }
        }
        let crossed = of(&mesh, &after);
        let (found, complete) = crossed.self_crossings(|_| true);
        assert!(complete && found.count > 0);
        let place = found.place.expect("a place");
        assert!(place.z.abs() <= 0.06 && place.x < 0.0, "{place}");
        assert_eq!(crossed.self_crossings(|_| false).0.count, 0);
        let known = MovedSurface {
            before: &after,
            ..crossed
        };
        assert_eq!(known.self_crossings(|_| true).0.count, 0);
        // Another surface: through it, and beside it.
        let wall = sheet(1.0, 3);
        let through = |z: f64| -> Vec<Point3<f64>> {
            let at = |p: &Point3<f64>| Point3::new(0.013, p.y, p.x + z);
            wall.vertices.iter().map(at).collect()
        };
        for (z, crosses) in [(0.0, true), (0.7, false)] {
            let wall_at = through(z);
            let other = MovedSurface::still(&wall_at, &wall.triangles);
            let beside: Vec<Point3<f64>> = mesh
                .vertices
                .iter()
                .map(|p| p + Vector3::z() * 2.0)
                .collect();
            let moved = MovedSurface {
                before: &beside,
                after: &mesh.vertices,
                triangles: &mesh.triangles,
            };
            let (found, _) = moved.crossings_with(&other);
            assert_eq!(found.count > 0, crosses);
            let still = of(&mesh, &mesh.vertices);
            assert_eq!(still.crossings_with(&other).0.count, 0);
        }
    }
}
