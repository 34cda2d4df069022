//! A subject that runs in its own thread at its own rate, without blocking the display.

mod worker;

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use nalgebra::Point3;

use super::recipe::{Recipe, StartError};
use super::snapshot::Snapshot;
use super::subject::Subject;
use worker::Worker;

/// Rate of frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Speed {
    /// A multiple of real time: at 1 the frame rate of the scene; slower where a frame takes
    /// longer.
    Share(f64),
    /// As fast as possible.
    Free,
}

/// Start state of a session.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    /// True if frames follow automatically.
    pub running: bool,
    /// Rate of frames.
    pub speed: Speed,
}

impl Pace {
    /// Runs in real time.
    pub fn real_time() -> Self {
        Self {
            running: true,
            speed: Speed::Share(1.0),
        }
    }

    /// Runs as fast as possible.
    pub fn free() -> Self {
        Self {
            running: true,
            speed: Speed::Free,
        }
    }

    /// Paused until a command.
    pub fn paused() -> Self {
        Self {
            running: false,
            speed: Speed::Share(1.0),
        }
    }
}

/// Commands of a session.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// Stops the frames.
    Pause,
    /// Starts the frames.
    Run,
    /// Computes one frame, then pauses.
    Step,
    /// Returns to the start with the changes so far; releases dragged and fixed vertices and
    /// rotated bones.
    Reset,
    /// Sets the rate of frames.
    Speed(Speed),
    /// Sets a value at a path of the scene, both in the form of `--set`.
    Set {
        /// A path such as `muscle.0.material.stretch`.
        path: String,
        /// A value such as `200 N/m`.
        value: String,
    },
    /// Restores the start value at a path.
    Restore {
        /// A path as in [`Self::Set`].
        path: String,
    },
    /// Rotates a bone about its joint to an angle, by at most [`MOST_TURN`] per frame.
    Turn {
        /// Index of the bone.
        bone: usize,
        /// The angle relative to the pose in the file [rad].
        angle: f64,
    },
    /// Holds a bone at its present angle, until it is rotated or returned to its motion.
    Hold {
        /// Index of the bone.
        bone: usize,
    },
    /// Returns a bone to its motion, at the same rate.
    ByMotion {
        /// Index of the bone.
        bone: usize,
    },
    /// Drags a vertex by a spring; replaces an earlier one.
    Drag {
        /// Index of the body.
        body: usize,
        /// Index of the vertex.
        vertex: usize,
        /// Target [m].
        to: Point3<f64>,
        /// Stiffness of the spring [N/m]; `None` means three times that of the muscle's surface.
        stiffness: Option<f64>,
    },
    /// Releases the dragged vertex.
    LetGo {
        /// Index of the body.
        body: usize,
    },
    /// Fixes a vertex at its position.
    Fix {
        /// Index of the body.
        body: usize,
        /// Index of the vertex.
        vertex: usize,
    },
    /// Releases a fixed vertex.
    Free {
        /// Index of the body.
        body: usize,
        /// Index of the vertex.
        vertex: usize,
    },
    /// Moves a handle.
    Move {
        /// Index of the handle.
        handle: usize,
        /// Target [m].
        to: Point3<f64>,
    },
    /// Selects a vertex of a body for its measures; `None` for none.
    Probe(Option<(usize, usize)>),
    /// Moves to a frame of a finished run.
    Seek {
        /// Index of the frame.
        frame: usize,
    },
    /// Sets whether the frames of a finished run follow backwards.
    Backwards(bool),
}

/// The published snapshots.
#[derive(Debug)]
struct Board {
    latest: Mutex<Arc<Snapshot>>,
    news: Condvar,
}

impl Board {
    /// Holds the lock only to copy a pointer, which stays valid if a thread panics.
    fn latest(&self) -> Arc<Snapshot> {
        self.latest
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }

    fn publish(&self, snapshot: Snapshot) {
        let fresh = Arc::new(snapshot);
        // The old snapshot is dropped after the lock.
        let _old = std::mem::replace(
            &mut *self.latest.lock().unwrap_or_else(PoisonError::into_inner),
            fresh,
        );
        self.news.notify_all();
    }
}

/// A running subject. Dropping the session ends its thread after the present frame, and waits for
/// it.
#[derive(Debug)]
pub struct Session {
    commands: Option<Sender<(u64, Command)>>,
    sent: Arc<AtomicU64>,
    ended: Arc<AtomicBool>,
    board: Arc<Board>,
    thread: Option<JoinHandle<()>>,
}

impl Session {
    /// Reads a scene with its meshes and runs it. The first snapshot is available on return.
    ///
    /// # Errors
    /// An invalid scene or mesh, or no thread.
    pub fn start(recipe: Recipe, pace: Pace) -> Result<Self, StartError> {
        Self::of(recipe.subject()?, pace)
    }

    /// Runs a subject.
    ///
    /// # Errors
    /// No thread.
    pub fn of(subject: Box<dyn Subject>, pace: Pace) -> Result<Self, StartError> {
        let (sent, ended) = (
            Arc::new(AtomicU64::new(0)),
            Arc::new(AtomicBool::new(false)),
        );
        let mut worker = Worker::new(subject, pace, (sent.clone(), ended.clone()));
        let board = Arc::new(Board {
            latest: Mutex::new(Arc::new(worker.snapshot())),
            news: Condvar::new(),
        });
        let (commands, received) = channel();
        let shown = board.clone();
        let thread = std::thread::Builder::new()
            .name("simulation".to_owned())
            .spawn(move || worker.run(&received, |snapshot| shown.publish(snapshot)))?;
        Ok(Self {
            commands: Some(commands),
            sent,
            ended,
            board,
            thread: Some(thread),
        })
    }

    /// Sends a command. Returns its number, which [`Snapshot::answered`] reaches when the command
    /// was done or rejected.
    pub fn send(&self, command: Command) -> u64 {
        let number = self.sent.fetch_add(1, Ordering::Relaxed) + 1;
        if let Some(commands) = &self.commands {
            // The thread ends only together with this session.
            let _ = commands.send((number, command));
        }
        number
    }

    /// The last snapshot; waits only for the copy of a pointer.
    pub fn latest(&self) -> Arc<Snapshot> {
        self.board.latest()
    }

    /// The first snapshot from now on that satisfies a condition; `None` after the timeout.
    pub fn wait(
        &self,
        longest: Duration,
        condition: impl Fn(&Snapshot) -> bool,
    ) -> Option<Arc<Snapshot>> {
        let end = Instant::now() + longest;
        let mut latest = self
            .board
            .latest
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        loop {
            if condition(&latest) {
                return Some(latest.clone());
            }
            let left = end
                .checked_duration_since(Instant::now())
                .filter(|left| !left.is_zero())?;
            latest = self
                .board
                .news
                .wait_timeout(latest, left)
                .unwrap_or_else(PoisonError::into_inner)
                .0;
        }
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::Relaxed);
        // Without a sender the thread ends.
        self.commands = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests;
