//! A campaign that strains a scene: cases with parameters drawn at random, each of which must end
//! converged, not converged, or refused. Anything else is a finding.
//!
//! A [`Drawing`] draws the changes of a case by a seed, and a [`Trial`] runs it and judges its end by
//! means of its own: numbers that are not finite, crossings although no pair is open, lost volumes,
//! other bits by other threads, energy that grows at rest, panics, and frames that do not end.

pub mod drawing;
pub mod meshes;
#[cfg(test)]
mod seeded;
pub mod trial;

pub use drawing::{Case, Drawing};
pub use meshes::{Worse, worsened};
pub use trial::{Ended, Examined, Trial};
