//! An interactive simulation: all of the viewer except its window.
//!
//! A [`Recipe`] is a scene with its changes. A [`Session`] runs it in its own thread and publishes
//! [`Snapshot`]s. [`panel`] lists the controls of a scene, and [`colour`] colours a surface by a
//! field.
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
//! A session runs a scene of any kind: muscles among bones, skin over implants or over a ball, a
//! lattice of springs, a geometric muscle. A kind without controls of its own is shown without
//! controls.
//!
//! *Limitations.* A session continues after the last frame of its scene; bones then stay where
//! their motion ends. Where something moves by hand, no requested accuracy is kept. Skin ends at its
//! last frame. Any change of skin restarts it: meshes are read and skin is prepared again, and the
//! frames up to the present one are computed even in a pause. If a dragged implant does not fit,
//! the error appears only after the preparation, not with the answer to the move. A lattice with
//! another number of points restarts; with other springs it continues, with velocities rounded
//! once. A geometric muscle with edited nodes, growth or inserted nodes keeps its new rest volume
//! from then on. Its length follows the frames until it is set, and again after `animation` is set
//! to `on`.
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
mod running;
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

/// The answer of a computed scene to commands for finished runs.
const ONLY_REPLAYED: &str = "only a finished run has frames to go to";
