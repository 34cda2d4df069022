//! A build without the feature `contact`: the type of contacts with triangle meshes has no values.

use nalgebra::{Point3, Vector3};

use super::PosedObstacle;
use super::active_normals::ActiveNormals;
use crate::particles::Particles;
use crate::state::{DecodeError, Reader, State, Writer};

/// Contacts of a body with obstacles; without the feature `contact` there are none.
pub enum Contacts {}

impl Contacts {
    pub(crate) fn begin_step(&mut self, _: &[Point3<f64>]) {
        match *self {}
    }

    pub(crate) fn project(&mut self, _: &[PosedObstacle], _: &mut Particles) {
        match *self {}
    }

    pub(crate) fn barred(&self, _: &[Point3<f64>], _: &[(u32, Vector3<f64>)]) -> ActiveNormals {
        match *self {}
    }

    pub(crate) fn bear(&mut self, _: impl Fn(u32) -> Vector3<f64>) {
        match *self {}
    }

    pub(crate) fn end_step(&mut self, _: &[PosedObstacle], _: &mut Particles, _: f64) {
        match *self {}
    }

    pub(crate) fn is_clear(&mut self, _: &[PosedObstacle], _: &[Point3<f64>], _: f64) -> bool {
        match *self {}
    }
}

impl State for Contacts {
    fn save(&self, _: &mut Writer) {
        match *self {}
    }

    fn restore(&mut self, _: &mut Reader<'_>) -> Result<(), DecodeError> {
        match *self {}
    }
}
