//! Skin over implants: a patch of skin in two layers, an implant under it, and their equilibrium.
//!
//! The skin is a membrane of springs \[vangelder1998\], with half of its thickness in each layer.
//! Two crossing diagonals per edge connect the layers; the boundary of the region is fixed. The
//! implant is a closed elastic shell of constant volume. The lower layer, the implant and the
//! surfaces below have frictionless contact. There is no motion in time: the result is a minimum of
//! the energy \[`settle`\].
//!
//! *Limitations.* Skin is elastic and isotropic, without tension at rest; it does not grow during
//! the computation (predictions of growth use published ratios, [`areas`]). There is no friction
//! and no self-contact of skin.

pub mod areas;
pub mod ball;
pub mod coarse;
pub mod contact;
mod detector;
pub mod envelope;
mod error;
pub mod fill;
pub mod implant;
pub mod layers;
pub mod limits;
mod patch;
mod place;
pub mod plan;
pub mod prolongation;
pub mod region;
pub mod settle;
pub mod shapes;
mod solve_for_area;
mod start;
pub mod support_surface;
pub mod thickness;
pub mod together;
pub mod whole;

pub use areas::{Areas, Interval};
pub use ball::Ball;
pub use error::SkinError;
pub use fill::{Filling, Schedule};
pub use plan::{ImplantSpec, Inserted, insert};
pub use shapes::Shape;
