//! Skin over implants: a patch of skin in two layers, an implant under it, and the place where both come to rest.
//!
//! The skin is a membrane of springs \[vangelder1998\], half of its thickness in each layer, with two crossing diagonals
//! for each edge between them; the rim of the region is held. The implant is a closed elastic shell that keeps its
//! volume. Between the lower layer, the implant and what lies under it there is contact without friction. Nothing moves
//! in time: what is found is a minimum of the energy \[`settle`\].
//!
//! *Limitations.* Skin is elastic, of one stiffness in every direction and without tension at rest; it does not grow while it
//! settles (what grows is told from published ratios, [`areas`]). No friction, no contact of skin with itself.

pub mod areas;
pub mod ball;
pub mod coarse;
pub mod contact;
mod detector;
pub mod elastic;
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
