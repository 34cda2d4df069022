//! The inside of a muscle, defined by a closed and outward copy of its surface; the surface itself
//! is unchanged.

use nalgebra::{Point3, Vector3};

use crate::mesh::closest::SurfaceTree;
use crate::mesh::inside::{Inside, ParityLine};
use crate::mesh::repair::{LONGEST_RIM, RepairOptions, repair};
use crate::mesh::winding::WindingTree;
use crate::mesh::{Topology, TriangleMesh};

/// Winding number from which a point is inside \[jacobson2013\].
const HALF: f64 = 0.5;

/// A muscle's surface as given, and the closed, outward surface that bounds its inside.
#[derive(Debug)]
pub struct Closed {
    /// The surface that bounds the inside.
    pub mesh: TriangleMesh,
    /// Winding numbers of the given surface, if the closed surface differs from it.
    given: Option<WindingTree>,
    /// Winding numbers of the closed surface, if no repair made it closed and oriented.
    open: Option<WindingTree>,
}

impl Closed {
    /// Closes holes and turns triangles where necessary; a mesh without defects is unchanged.
    pub fn new(muscle: &TriangleMesh) -> Self {
        let fit = |mesh: &TriangleMesh| {
            let topology = Topology::new(mesh);
            topology.is_closed() && topology.is_oriented()
        };
        if fit(muscle) && muscle.volume() > 0.0 {
            return Self {
                mesh: muscle.clone(),
                given: None,
                open: None,
            };
        }
        let options = RepairOptions {
            close_holes: LONGEST_RIM,
            ..RepairOptions::default()
        };
        let mesh = repair(muscle, &[], &options).mesh;
        let open = (!fit(&mesh)).then(|| WindingTree::new(&mesh));
        let given = (!fit(muscle)).then(|| WindingTree::new(muscle));
        Self { mesh, given, open }
    }

    /// The inside and outside tests.
    pub fn solid(&self) -> Solid<'_> {
        let tree = SurfaceTree::new(&self.mesh.vertices, &self.mesh.triangles);
        Solid {
            closed: self,
            inside: Inside::new(&self.mesh.vertices, &self.mesh.triangles),
            tree,
        }
    }
}

/// Inside and outside tests, and distances to the wall.
#[derive(Debug)]
pub struct Solid<'a> {
    closed: &'a Closed,
    inside: Inside<'a>,
    tree: SurfaceTree,
}

/// The nearest point of a wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wall {
    /// The closest point of the surface [m].
    pub point: Point3<f64>,
    /// Unit vector from that point to the query point.
    pub away: Vector3<f64>,
    /// Distance to that point [m].
    pub distance: f64,
}

impl Solid<'_> {
    /// True if a point is inside the closed surface; by exact signed crossings where the surface is
    /// closed.
    pub fn contains(&self, p: &Point3<f64>) -> bool {
        match &self.closed.open {
            Some(tree) => tree.number(p).abs() >= HALF,
            None => self.inside.winding(p) > 0,
        }
    }

    /// The line along x at `y`, `z` [m], for tests of many points on it.
    pub fn row(&self, y: f64, z: f64) -> WallRow<'_> {
        WallRow {
            solid: self,
            line: self.closed.open.is_none().then(|| self.inside.line(y, z)),
            y,
            z,
        }
    }

    /// The same as [`Solid::contains`]; for a surface given open or with turned triangles the point
    /// must also be inside by that surface's absolute winding number.
    pub fn contains_as_given(&self, p: &Point3<f64>) -> bool {
        self.contains(p)
            && self
                .closed
                .given
                .as_ref()
                .is_none_or(|tree| tree.number(p).abs() >= HALF)
    }

    /// The closest point of the wall within the distance `within` [m].
    pub fn wall(&self, p: &Point3<f64>, within: f64) -> Option<Wall> {
        let found = self.tree.closest(p, within)?;
        let away = (p - found.point)
            .try_normalize(0.0)
            .unwrap_or_else(Vector3::zeros);
        Some(Wall {
            point: found.point,
            away,
            distance: found.distance,
        })
    }

    /// The surface that bounds the inside.
    pub fn mesh(&self) -> &TriangleMesh {
        &self.closed.mesh
    }
}

/// Inside and outside test along a line.
#[derive(Debug)]
pub struct WallRow<'a> {
    solid: &'a Solid<'a>,
    line: Option<ParityLine<'a>>,
    y: f64,
    z: f64,
}

impl WallRow<'_> {
    /// [`Solid::contains`] of the point of the line at `x` [m].
    pub fn contains(&self, x: f64) -> bool {
        match &self.line {
            Some(line) => line.winding(x) > 0,
            None => self.solid.contains(&Point3::new(x, self.y, self.z)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::icosphere;

    #[test]
    fn open_and_inside_out_surfaces_have_the_same_inside() {
        let mut mesh = icosphere(1.0, 3);
        mesh.triangles.iter_mut().for_each(|t| t.swap(0, 1));
        mesh.triangles.drain(10..14);
        let closed = Closed::new(&mesh);
        let solid = closed.solid();
        let along = |r: f64| Point3::from(Vector3::new(0.3, -0.5, 0.8).normalize() * r);
        assert!(solid.contains(&along(0.9)) && solid.contains_as_given(&along(0.9)));
        assert!(!solid.contains(&along(1.1)) && !solid.contains_as_given(&along(1.1)));
        let wall = solid.wall(&along(0.9), 0.5).expect("near");
        assert!(wall.away.dot(&along(1.0).coords) < -0.9 && wall.distance < 0.1 + 1e-12);
    }
}
