//! A subject that runs in a thread of its own, at its own rate; whoever looks at it never waits for it.

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

/// How fast frames follow one another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Speed {
    /// A share of real time: 1 for as many frames a second as the scene has. Slower where a frame takes longer.
    Share(f64),
    /// As fast as it can.
    Free,
}

/// How a session begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    /// Whether frames follow by themselves.
    pub running: bool,
    /// How fast.
    pub speed: Speed,
}

impl Pace {
    /// In real time.
    pub fn real_time() -> Self {
        Self {
            running: true,
            speed: Speed::Share(1.0),
        }
    }

    /// As fast as it can.
    pub fn free() -> Self {
        Self {
            running: true,
            speed: Speed::Free,
        }
    }

    /// Not before it is told to.
    pub fn paused() -> Self {
        Self {
            running: false,
            speed: Speed::Share(1.0),
        }
    }
}

/// What a session can be told.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// No more frames by themselves.
    Pause,
    /// Frames by themselves.
    Run,
    /// One frame, then pause.
    Step,
    /// Back to the start, with the changes made so far; nothing is dragged, fixed or turned by hand any more.
    Reset,
    /// How fast frames follow.
    Speed(Speed),
    /// Another value at a path of the scene, both as `--set` takes them.
    Set {
        /// As in `muscle.0.material.stretch`.
        path: String,
        /// As in `200 N/m`.
        value: String,
    },
    /// The value that the scene was started with.
    Restore {
        /// As of [`Self::Set`].
        path: String,
    },
    /// Turns a bone about its joint to an angle, by at most [`MOST_TURN`] a frame.
    Turn {
        /// Which bone.
        bone: usize,
        /// The angle from where its file has it [rad].
        angle: f64,
    },
    /// Keeps a bone at the angle that it has now, until it is turned or given back to its motion.
    Hold {
        /// Which bone.
        bone: usize,
    },
    /// Gives a bone back to its motion, as slowly.
    ByMotion {
        /// Which bone.
        bone: usize,
    },
    /// Drags a vertex by a spring, in place of the one that was dragged before.
    Drag {
        /// Which body.
        body: usize,
        /// Which vertex of it.
        vertex: usize,
        /// Where to [m].
        to: Point3<f64>,
        /// Stiffness of the spring [N/m]; `None` for three times that of the muscle's surface.
        stiffness: Option<f64>,
    },
    /// Lets go of what is dragged.
    LetGo {
        /// Which body.
        body: usize,
    },
    /// Fixes a vertex where it is.
    Fix {
        /// Which body.
        body: usize,
        /// Which vertex of it.
        vertex: usize,
    },
    /// Frees a vertex that was fixed.
    Free {
        /// Which body.
        body: usize,
        /// Which vertex of it.
        vertex: usize,
    },
    /// Moves a handle.
    Move {
        /// Which handle.
        handle: usize,
        /// Where to [m].
        to: Point3<f64>,
    },
    /// Tells the numbers of a vertex of a body from now on; `None` of none.
    Probe(Option<(usize, usize)>),
    /// Goes to a frame of a finished run.
    Seek {
        /// Which.
        frame: usize,
    },
    /// Whether the frames of a finished run follow backwards.
    Backwards(bool),
}

/// Where snapshots are published.
#[derive(Debug)]
struct Board {
    latest: Mutex<Arc<Snapshot>>,
    news: Condvar,
}

impl Board {
    /// Holds the lock for as long as it takes to copy a pointer; a thread that panicked leaves a whole pointer behind.
    fn latest(&self) -> Arc<Snapshot> {
        self.latest
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }

    fn publish(&self, snapshot: Snapshot) {
        let fresh = Arc::new(snapshot);
        // The old one is dropped after the lock.
        let _old = std::mem::replace(
            &mut *self.latest.lock().unwrap_or_else(PoisonError::into_inner),
            fresh,
        );
        self.news.notify_all();
    }
}

/// A running subject. Dropping it ends its thread after the frame that is being computed, and waits for that.
#[derive(Debug)]
pub struct Session {
    commands: Option<Sender<(u64, Command)>>,
    sent: Arc<AtomicU64>,
    ended: Arc<AtomicBool>,
    board: Arc<Board>,
    thread: Option<JoinHandle<()>>,
}

impl Session {
    /// Reads a scene and its meshes and lets it run. The first snapshot, the start, is there when this returns.
    ///
    /// # Errors
    /// A scene or a mesh that is wrong; no thread.
    pub fn start(recipe: Recipe, pace: Pace) -> Result<Self, StartError> {
        Self::of(recipe.subject()?, pace)
    }

    /// Lets a subject run.
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

    /// Sends a command and returns its number, which [`Snapshot::answered`] reaches when it was done or refused.
    pub fn send(&self, command: Command) -> u64 {
        let number = self.sent.fetch_add(1, Ordering::Relaxed) + 1;
        if let Some(commands) = &self.commands {
            // Its thread ends only when this does.
            let _ = commands.send((number, command));
        }
        number
    }

    /// The last snapshot; waits for nothing but a pointer being copied.
    pub fn latest(&self) -> Arc<Snapshot> {
        self.board.latest()
    }

    /// The first snapshot from now on for which something holds; `None` if there is none in time.
    pub fn wait(
        &self,
        longest: Duration,
        wanted: impl Fn(&Snapshot) -> bool,
    ) -> Option<Arc<Snapshot>> {
        let end = Instant::now() + longest;
        let mut latest = self
            .board
            .latest
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        loop {
            if wanted(&latest) {
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
