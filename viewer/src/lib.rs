//! A running simulation that somebody looks at and steers: all of the interactive viewer but its window.
//!
//! A [`Recipe`] is a scene with the changes that were made to it, a [`Session`] runs it in a thread of its own and publishes
//! [`Snapshot`]s, [`panel`] lists what a scene lets one change, [`colour`] colours a surface by a field.
//!
//! ```
//! use pliant_viewer::{Command, Pace, Recipe, Session};
//! use std::time::Duration;
//!
//! let session = Session::start(Recipe::find("distance", &[])?, Pace::paused())?;
//! assert_eq!(session.latest().frame, 0);
//! let ticket = session.send(Command::Step);
//! let seen = session.wait(Duration::from_secs(60), |shot| shot.answered >= ticket);
//! assert_eq!(seen.map(|shot| shot.frame), Some(1));
//! # Ok::<(), pliant_viewer::StartError>(())
//! ```
//!
//! What runs is muscles among bones, skin over implants or over a ball, a lattice of springs, or a geometric muscle, whose file
//! is told from a scene by its key `radii`.
//!
//! *Limitations.* A session goes on beyond the last frame of its scene; bones then rest where their motion ends. An accuracy
//! that the scene asks for chooses no solver here. Skin ends at its last frame, and any change takes it back to the start: it is
//! made ready anew, meshes read again, and the frames up to the one that it was at are computed whether it runs or not. Where
//! an implant that is dragged does not fit, that is told only when the skin was made ready, not with the answer to the move. A
//! lattice with another number of points begins anew; with other springs it goes on, velocities rounded once. A geometric
//! muscle whose nodes, growth or inserted nodes are edited keeps from then on the volume that it has at rest with that; its
//! length is the animation's until it is set, and again when `animation` is set to `on`.
#![cfg_attr(not(test), warn(clippy::unwrap_used))]

mod biceps;
pub mod camera;
pub mod colour;
pub mod history;
mod lattice;
mod muscles;
pub mod panel;
pub mod pick;
mod recipe;
pub mod recording;
mod replay;
mod session;
mod skin;
mod snapshot;
mod subject;
#[cfg(feature = "window")]
pub mod window;

pub use muscles::MOST_TURN;
pub use recipe::{Recipe, Refused, StartError};
pub use replay::{Replay, ReplayError};
pub use session::{Command, Pace, Session, Speed};
pub use snapshot::{
    BodyShot, BoneShot, Handle, Probe, Reading, Shot, Snapshot, Stage, StageBody, Steering, Tissue,
};
pub use subject::{Advanced, Subject, Watch};

/// What scenes that are computed answer to commands for frames that are.
const ONLY_REPLAYED: &str = "only a finished run has frames to go to";
