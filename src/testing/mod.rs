//! Conformance checks of constraints and readers, generators of difficult cases; this module may
//! import all others.
//!
//! Available to this crate's tests, and to other crates with the feature `testing`.

mod blocks;
mod collections;
mod conformance;
mod controls;
mod cubes;
mod draw;
mod dual;
#[cfg(feature = "testing")]
pub mod internals;
mod loaders;
mod mending;
mod models;
mod mutations;
mod restoring;
mod round_trip;
mod scratch;
mod seeds;
mod spring_files;
mod subject;
pub mod tolerances;

pub use blocks::block_file;
pub use collections::check_collection;
pub use conformance::{Failure, check, check_constraint};
pub use controls::{BrokenConstraint, CONTROLS};
pub use cubes::cubes;
pub use draw::Draw;
pub use dual::{Dual, TrackedNumber};
pub use loaders::{
    Breach, LoadOutcome, Loader, check_loader, check_reader, check_scene, check_target, loaders,
};
pub use mending::{check_repair, check_repaired};
pub use models::check_model;
pub use mutations::{Mutator, dictionary};
pub use restoring::check_state;
pub use round_trip::{check_round_trip, drawing};
pub use scratch::Scratch;
pub use seeds::seeds;
pub use spring_files::check_spring_file;
pub use subject::{Subject, VolumeSubject};
