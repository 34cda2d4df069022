//! Models, motions and paths of OpenSim \[seth2018\].
//!
//! [`Model::read`] reads the part of an `.osim` file of OpenSim 4 that positions bodies: joints,
//! coordinates with their couplings, and functions of them. It also reads meshes and muscles.
//! [`Model::poses`] computes the pose of each body. [`MotionTable::read`] reads values of
//! coordinates over time (`.mot`, `.sto`). [`ModelDrive`] applies a model to the bones of a scene.
//! [`paths`] fits muscle paths to sampled lengths and moment arms and writes them for OpenSim 4.5
//! and later.
//!
//! A model is a tree of bodies. Each joint has a parent and a child body. With the frames of the
//! joint on both bodies, `P` and `C`, and the transform `J(q)` of the joint between these frames,
//! the pose of the child is `X_child = X_parent P J(q) C^-1`.

mod document;
mod drive;
mod functions;
mod joints;
mod model;
mod motion;
mod parameters;
pub mod paths;

pub use document::ModelError;
pub use drive::ModelDrive;
pub(crate) use functions::Spline;
pub use model::{Coordinate, Model, ModelBody, ModelMesh, ModelMuscle};
pub use motion::MotionTable;
pub use parameters::{MuscleParameters, SPECIFIC_TENSION, normalised_lengths};
