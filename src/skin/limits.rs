//! What an order may ask for: numbers that make sense beside its base.

use nalgebra::{Point3, Vector3};

use super::SkinError;
use super::implant::Implant;
use super::plan::{FINE, ImplantSpec};
use super::region::REACH;
use crate::mesh::TriangleMesh;
use crate::mesh::closest::SurfaceTree;

/// Skin is at most so deep and so thick over an implant, in bases: beyond, it is a block that is about as thick as the implant
/// is wide, and no sheet whose two layers stretch alike.
const THICKEST: f64 = 0.5;

/// Edges are at most so long, in bases: with longer ones the region, 1.5 bases across, is fewer than six edges wide.
const LONGEST_EDGE: f64 = 0.25;

/// The dome of an implant is at least so high, in bases: twice of what bodies at rest may sink into each other. What is flatter
/// is an answer about contact, not about skin.
const FLATTEST: f64 = 0.01;

/// An obstacle that is nearer to the skin than this, in bases, lies in it: a number of a file has seven digits or more.
const TOUCHES: f64 = 1e-6;

impl ImplantSpec {
    /// The wanted edges [m].
    pub fn edge(&self) -> f64 {
        self.edge.unwrap_or(self.implant.base / FINE)
    }

    /// Checks its numbers.
    ///
    /// # Errors
    /// One that is not positive and finite, skin that is too thick or too deep for the base, a direction that is none.
    pub fn check(&self) -> Result<(), SkinError> {
        self.implant.check()?;
        self.tissue.check()?;
        SkinError::positive("the edge length", self.edge())?;
        let (base, most) = (self.implant.base, THICKEST * self.implant.base);
        for (what, value) in [
            ("depth", self.tissue.depth),
            ("thickness of the skin", self.tissue.thickness),
        ] {
            if value > most * (1.0 + 1e-9) {
                return Err(SkinError::TooThick {
                    what,
                    value,
                    most,
                    base,
                });
            }
        }
        let is_direction = |v: &Vector3<f64>| v.norm() > 0.0 && v.norm().is_finite();
        if self.long.as_ref().is_some_and(|v| !is_direction(v)) {
            return Err(SkinError::NoDirection);
        }
        Ok(())
    }

    /// Checks what only a person gets wrong: edges that are too long for the base, which a coarser level or a study of meshes may
    /// well have.
    ///
    /// # Errors
    /// Edges longer than a quarter of the base; see also [`ImplantSpec::check`].
    pub fn check_edge(&self) -> Result<(), SkinError> {
        self.check()?;
        let (edge, base) = (self.edge(), self.implant.base);
        let most = LONGEST_EDGE * base;
        if edge <= most * (1.0 + 1e-9) {
            Ok(())
        } else {
            Err(SkinError::TooLong { edge, most, base })
        }
    }

    /// Refuses an obstacle of which the skin about the middle is a part, such as the skin itself.
    pub(super) fn check_obstacles(
        &self,
        skin: &TriangleMesh,
        centre: &Point3<f64>,
        obstacles: &[TriangleMesh],
    ) -> Result<(), SkinError> {
        let (base, reach) = (self.implant.base, 0.5 * REACH * self.implant.base);
        let near = skin
            .vertices
            .iter()
            .filter(|p| (*p - centre).norm() <= reach);
        let places: Vec<&Point3<f64>> = near.chain([centre]).collect();
        for (k, obstacle) in obstacles.iter().enumerate() {
            let tree = SurfaceTree::new(&obstacle.vertices, &obstacle.triangles);
            let touching = places
                .iter()
                .filter(|p| tree.closest(p, TOUCHES * base).is_some())
                .count();
            if 2 * touching > places.len() {
                return Err(SkinError::ObstacleIsSkin { obstacle: k + 1 });
            }
        }
        Ok(())
    }
}

impl Implant {
    /// The least volume that is an implant and no sheet [m^3]: a dome of a hundredth of its base.
    pub fn least(&self, edge: f64) -> f64 {
        self.volume_of(FLATTEST * self.base, edge)
    }
}
