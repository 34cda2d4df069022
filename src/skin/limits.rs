//! Limits of an order: numbers that are plausible relative to its base.

use nalgebra::{Point3, Vector3};

use super::SkinError;
use super::implant::Implant;
use super::plan::{FINE, ImplantSpec};
use super::region::REACH;
use crate::mesh::TriangleMesh;
use crate::mesh::closest::SurfaceTree;

/// Greatest depth and thickness of skin over an implant, in bases. Thicker skin is a block about as
/// thick as the implant is wide, not a sheet whose two layers stretch equally.
const THICKEST: f64 = 0.5;

/// Greatest edge length, in bases: with longer edges the region, 1.5 bases across, is less than six
/// edges wide.
const LONGEST_EDGE: f64 = 0.25;

/// Least height of an implant's dome, in bases: twice the permitted penetration at equilibrium. A
/// result for a flatter dome describes contact, not skin.
const FLATTEST: f64 = 0.01;

/// An obstacle nearer to the skin than this, in bases, is part of it: numbers in files have at
/// least seven digits.
const TOUCHES: f64 = 1e-6;

impl ImplantSpec {
    /// The target edge length [m].
    pub fn edge(&self) -> f64 {
        self.edge.unwrap_or(self.implant.base / FINE)
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// A number that is not positive and finite, skin that is too thick or too deep for the base,
    /// or an invalid direction.
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

    /// Checks user input only: edges that are too long for the base, which a coarser level or a
    /// mesh study can have.
    ///
    /// # Errors
    /// Edges longer than a quarter of the base; also those of [`Order::check`].
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

    /// Checks that a volume [m^3] fits on the base.
    ///
    /// # Errors
    /// A volume so flat that contact decides on the shape, or too large for the base.
    pub fn check_volume(&self, volume: f64) -> Result<(), SkinError> {
        let (implant, edge) = (self.implant, self.edge());
        let least = implant.least(edge);
        if !(volume >= least) {
            return Err(SkinError::TooFlat {
                volume_cc: volume * 1e6,
                least_cc: least * 1e6,
                base_cm: implant.base * 1e2,
            });
        }
        if volume <= implant.largest(edge) {
            return Ok(());
        }
        Err(Implant { volume, ..implant }.too_large(edge))
    }

    /// Rejects an obstacle that contains the skin about the centre, such as the skin itself.
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
    /// The least volume of an implant that is no sheet [m^3]: a dome with a height of a hundredth
    /// of its base.
    pub fn least(&self, edge: f64) -> f64 {
        self.volume_of(FLATTEST * self.base, edge)
    }
}
