//! Skin over implants: a patch of skin in two layers, an implant under it, and their equilibrium.
//!
//! The skin is a membrane of springs \[vangelder1998\], with half of its thickness in each layer.
//! Two crossing diagonals per edge connect the layers; the boundary of the region is fixed. The
//! implant is a closed elastic shell of constant volume. The lower layer, the implant and the
//! surfaces below have frictionless contact. There is no motion in time: the result is a minimum of
//! the energy \[`settle`\].
//!
//! *Limitations.* Skin is elastic and isotropic, without tension at rest; it does not grow during
//! the computation (predictions of growth use published ratios, [`areas`]). There is no friction,
//! and skin is not pushed away from itself: its crossings are counted \[`Soundness`\].

pub(crate) mod areas;
pub(crate) mod ball;
mod hinges;
pub(crate) mod coarse;
mod collapse;
pub(crate) mod contact;
mod detector;
pub(crate) mod envelope;
mod error;
pub(crate) mod fill;
pub(crate) mod implant;
pub(crate) mod layers;
pub(crate) mod limits;
mod patch;
mod place;
pub(crate) mod plan;
pub(crate) mod prolongation;
pub(crate) mod region;
pub(crate) mod settle;
pub(crate) mod shapes;
mod solve_for_area;
pub(crate) mod soundness;
mod start;
pub(crate) mod support_surface;
pub(crate) mod tangent;
pub(crate) mod thickness;
pub(crate) mod together;
pub(crate) mod whole;

pub use areas::{CAVEATS, GROWN_SOURCE, RETRACTED_SOURCE, stretches};
pub use coarse::halved_near;
pub use implant::{Implant, SILICONE};
pub use layers::{Layers, Tissue};
pub use plan::{ImplantPlace, PreparedPatch, Shell};
pub use region::frame;
pub use settle::{SettleMethod, SettleProgress, deepest};
pub use soundness::{Defects, STEEPEST_FOLD, Soundness};
pub use together::{Group, grouped};
pub use whole::Whole;

pub use areas::{Areas, Interval};
pub(crate) use ball::Ball;
pub use error::SkinError;
pub use fill::{Filling, Schedule};
pub use plan::{ImplantSpec, Inserted, insert};
pub use shapes::BaseShape;
