//! Pictures of what a window shows, one or a film of them, written without the window waiting for it.
//!
//! A [`Recorder`] takes pictures at any rate, keeps some of them, made smaller and compressed, in a thread of its own, and
//! writes them as an animated GIF or PNG when it is stopped.
//!
//! ```no_run
//! use pliant_viewer::recording::{Recorder, free_name};
//! use std::path::Path;
//!
//! let mut recorder = Recorder::start(&free_name(Path::new("."), "hip", "gif")?)?;
//! for grey in 0..100 {
//!     recorder.push(64, 48, &[grey; 64 * 48 * 3])?;
//! }
//! let mut recording = recorder.stop();
//! while recording.poll().is_none() {}
//! # Ok::<(), pliant_viewer::recording::RecordingError>(())
//! ```
//!
//! *Limitations.* Colours are averaged as they are stored, not as light. When the window changes its size, pictures keep that
//! of the first, with bars.

mod film;

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use film::Kept;
use pliant::io::names::file_name;
use pliant::io::write_whole;
use pliant_render::{Frame, PictureError, write_film_as_apng, write_film_as_gif};

/// From one picture of a film to the next.
pub const PERIOD: Duration = Duration::from_millis(80);

/// Pictures of a film are at most so wide \[px\].
pub const MOST_WIDTH: usize = 720;

/// Pictures of a film at most; then it ends by itself.
pub const MOST_PICTURES: usize = 600;

/// Compressed pictures at most [bytes]; then it ends by itself.
const MOST_BYTES: usize = 256 << 20;

/// Pictures that may wait for the thread; more would only cost memory.
const WAITING: usize = 4;

/// Why a picture or a film is not there.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// Its name says no format.
    #[error("`{0}` does not end as a recording; name it .gif, .png or .apng")]
    Ending(PathBuf),
    /// It would replace something.
    #[error("`{0}` is there already; choose another name")]
    Exists(PathBuf),
    /// Nothing can be written there.
    #[error("`{path}` cannot be written: {source}; choose another folder, or free some space")]
    Write {
        /// What was to be written.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// Its bytes are not those of a picture of its size.
    #[error(
        "a picture of {width} x {height} pixels cannot have {bytes} bytes; it needs three a pixel"
    )]
    Size {
        /// Width \[px\].
        width: usize,
        /// Height \[px\].
        height: usize,
        /// Bytes that were given.
        bytes: usize,
    },
    /// It was stopped before there was a picture.
    #[error("nothing was recorded, so `{0}` was not written; record for longer")]
    Nothing(PathBuf),
    /// It cannot be made into bytes.
    #[error("the recording cannot be encoded: {0}")]
    Picture(#[from] PictureError),
    /// The system gives no thread.
    #[error("the recording cannot have a thread of its own: {0}; end other programs and try again")]
    Thread(io::Error),
    /// The thread panicked.
    #[error("the recording ended before its time, and `{0}` was not written")]
    Ended(PathBuf),
}

/// What became of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pushed {
    /// It is part of the film.
    Taken,
    /// It came too early to be.
    Early,
    /// It should have been, but the thread was behind.
    Dropped,
    /// The film is as long as it may be, or its thread is gone: stop it.
    Full,
}

/// A film that was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recorded {
    /// The file.
    pub path: PathBuf,
    /// Its pictures.
    pub pictures: usize,
    /// Pictures that it lacks because the thread was behind.
    pub dropped: usize,
    /// Whether it ended by itself because it was as long as it may be.
    pub is_full: bool,
}

/// The format of a film.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Gif,
    Apng,
}

/// A picture on its way.
struct Taken {
    size: [usize; 2],
    rgb: Vec<u8>,
    at: Duration,
}

/// What both sides count.
#[derive(Debug, Default)]
struct Counts {
    pictures: AtomicUsize,
    dropped: AtomicUsize,
    is_full: AtomicBool,
}

/// Records a film. Dropped without [`Self::stop`] it still writes what it has, but nobody hears of it.
#[derive(Debug)]
pub struct Recorder {
    path: PathBuf,
    sender: SyncSender<Taken>,
    thread: JoinHandle<Result<Recorded, RecordingError>>,
    counts: Arc<Counts>,
    begun: Instant,
    /// When the next picture is due.
    due: Duration,
}

impl Recorder {
    /// Begins a film, whose format is that of the ending of its name: `.gif`, or `.png` or `.apng` for an animated PNG.
    ///
    /// # Errors
    /// Another ending, a file that is there, a folder that cannot be written to, no thread.
    pub fn start(path: &Path) -> Result<Self, RecordingError> {
        Self::start_with(path, MOST_PICTURES)
    }

    fn start_with(path: &Path, most: usize) -> Result<Self, RecordingError> {
        let ending = path
            .extension()
            .and_then(|e| e.to_str())
            .map(str::to_ascii_lowercase);
        let format = match ending.as_deref() {
            Some("gif") => Format::Gif,
            Some("png" | "apng") => Format::Apng,
            _ => return Err(RecordingError::Ending(path.to_owned())),
        };
        if path.symlink_metadata().is_ok() {
            return Err(RecordingError::Exists(path.to_owned()));
        }
        // Better known now than after a minute of recording.
        let trial = path.with_added_extension(format!("{}.trial", std::process::id()));
        let tried = File::create_new(&trial).and_then(|_| fs::remove_file(&trial));
        tried.map_err(|source| RecordingError::Write {
            path: path.to_owned(),
            source,
        })?;
        let (sender, pictures) = sync_channel(WAITING);
        let (counts, own) = (Arc::<Counts>::default(), path.to_owned());
        let shared = counts.clone();
        let thread = std::thread::Builder::new().name("recording".to_owned());
        let thread = thread.spawn(move || record(own, format, most, &pictures, &shared));
        let thread = thread.map_err(RecordingError::Thread)?;
        let begun = Instant::now();
        Ok(Self {
            path: path.to_owned(),
            sender,
            thread,
            counts,
            begun,
            due: Duration::ZERO,
        })
    }

    /// Where the film will be.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Pictures that it has so far.
    pub fn pictures(&self) -> usize {
        self.counts.pictures.load(Ordering::Relaxed)
    }

    /// Pictures that it lacks because its thread was behind.
    pub fn dropped(&self) -> usize {
        self.counts.dropped.load(Ordering::Relaxed)
    }

    /// Whether it ended by itself.
    pub fn is_full(&self) -> bool {
        self.counts.is_full.load(Ordering::Relaxed) || self.thread.is_finished()
    }

    /// Whether a picture is due: one that is not need not be read from the graphics card.
    pub fn is_due(&self) -> bool {
        self.begun.elapsed() >= self.due
    }

    /// Hands a picture over, rows from the top, red, green and blue a pixel; never waits.
    ///
    /// # Errors
    /// A number of bytes that does not fit.
    pub fn push(
        &mut self,
        width: usize,
        height: usize,
        rgb: &[u8],
    ) -> Result<Pushed, RecordingError> {
        self.push_at(width, height, rgb, self.begun.elapsed())
    }

    /// As [`Self::push`], of a picture that was taken at a time since the start.
    fn push_at(
        &mut self,
        width: usize,
        height: usize,
        rgb: &[u8],
        at: Duration,
    ) -> Result<Pushed, RecordingError> {
        check_size(width, height, rgb)?;
        if self.is_full() {
            return Ok(Pushed::Full);
        }
        if at < self.due {
            return Ok(Pushed::Early);
        }
        // By the clock, so that rounding up to whole pictures of the window does not add up; what is late is not made up for.
        self.due = (self.due + PERIOD).max(at + PERIOD / 2);
        match self.sender.try_send(Taken {
            size: [width, height],
            rgb: rgb.to_vec(),
            at,
        }) {
            Ok(()) => Ok(Pushed::Taken),
            Err(TrySendError::Full(_)) => {
                self.counts.dropped.fetch_add(1, Ordering::Relaxed);
                Ok(Pushed::Dropped)
            }
            Err(TrySendError::Disconnected(_)) => Ok(Pushed::Full),
        }
    }

    /// Ends the film, which is then written.
    pub fn stop(self) -> Recording {
        // Without a sender the thread goes on to write.
        let Self { path, thread, .. } = self;
        Recording {
            path,
            thread: Some(thread),
            result: None,
        }
    }
}

/// A film that is being written.
#[derive(Debug)]
pub struct Recording {
    path: PathBuf,
    thread: Option<JoinHandle<Result<Recorded, RecordingError>>>,
    result: Option<Result<Recorded, RecordingError>>,
}

impl Recording {
    /// What became of it, once that is known; never waits.
    pub fn poll(&mut self) -> Option<&Result<Recorded, RecordingError>> {
        if self.thread.as_ref().is_some_and(JoinHandle::is_finished) {
            self.join();
        }
        self.result.as_ref()
    }

    /// Waits until it is written.
    ///
    /// # Errors
    /// Why it was not.
    pub fn wait(mut self) -> Result<Recorded, RecordingError> {
        self.join();
        self.result.unwrap_or(Err(RecordingError::Ended(self.path)))
    }

    fn join(&mut self) {
        if let Some(thread) = self.thread.take() {
            let ended = |_| Err(RecordingError::Ended(self.path.clone()));
            self.result = Some(thread.join().unwrap_or_else(ended));
        }
    }
}

/// Keeps pictures until nobody sends any more or there are enough, then writes them.
fn record(
    path: PathBuf,
    format: Format,
    most: usize,
    pictures: &Receiver<Taken>,
    counts: &Counts,
) -> Result<Recorded, RecordingError> {
    let mut kept = Kept::default();
    let mut is_full = false;
    for Taken { size, rgb, at } in pictures {
        kept.add(size, &rgb, at);
        counts.pictures.store(kept.len(), Ordering::Relaxed);
        is_full = kept.len() >= most || kept.bytes() >= MOST_BYTES;
        if is_full {
            counts.is_full.store(true, Ordering::Relaxed);
            break;
        }
    }
    if kept.len() == 0 {
        return Err(RecordingError::Nothing(path));
    }
    let mut wrong = None;
    let written = write_whole(&path, |w| {
        let encoded = match format {
            Format::Gif => write_film_as_gif(&kept, w),
            Format::Apng => write_film_as_apng(&kept, w),
        };
        encoded.map_err(|error| match error.into_io() {
            Ok(source) => source,
            Err(error) => {
                wrong = Some(error);
                io::Error::other("it cannot be encoded")
            }
        })
    });
    match (written, wrong) {
        (_, Some(error)) => Err(RecordingError::Picture(error)),
        (Err(source), None) => Err(RecordingError::Write { path, source }),
        (Ok(()), None) => {
            let dropped = counts.dropped.load(Ordering::Relaxed);
            Ok(Recorded {
                path,
                pictures: kept.len(),
                dropped,
                is_full,
            })
        }
    }
}

fn check_size(width: usize, height: usize, rgb: &[u8]) -> Result<(), RecordingError> {
    let needed = width
        .checked_mul(height)
        .and_then(|n| n.checked_mul(3))
        .filter(|n| *n > 0);
    if needed == Some(rgb.len()) {
        Ok(())
    } else {
        Err(RecordingError::Size {
            width,
            height,
            bytes: rgb.len(),
        })
    }
}

/// Writes a picture as a PNG, whole or not at all; in place of one of that name.
///
/// # Errors
/// A number of bytes that does not fit, or a file that cannot be written.
pub fn save_png(
    path: &Path,
    width: usize,
    height: usize,
    rgb: &[u8],
) -> Result<(), RecordingError> {
    check_size(width, height, rgb)?;
    let frame = Frame::from_rgb(width, height, rgb);
    let png = frame
        .ok_or(RecordingError::Size {
            width,
            height,
            bytes: rgb.len(),
        })?
        .to_png()?;
    let written = write_whole(path, |w| io::Write::write_all(w, &png));
    written.map_err(|source| RecordingError::Write {
        path: path.to_owned(),
        source,
    })
}

/// The next name that no file of a folder has: `NAME-0001.ENDING`, `NAME-0002.ENDING`, and so on behind the last.
///
/// # Errors
/// A folder that cannot be read.
pub fn free_name(folder: &Path, name: &str, ending: &str) -> Result<PathBuf, RecordingError> {
    let name = file_name(name);
    let refused = |source| RecordingError::Write {
        path: folder.to_owned(),
        source,
    };
    let number = |file: &str| -> Option<u64> {
        let digits = file
            .strip_prefix(&name)?
            .strip_prefix('-')?
            .strip_suffix(ending)?
            .strip_suffix('.')?;
        digits
            .bytes()
            .all(|b| b.is_ascii_digit())
            .then(|| digits.parse().ok())?
    };
    let mut last = 0;
    let here = if folder.as_os_str().is_empty() {
        Path::new(".")
    } else {
        folder
    };
    for entry in fs::read_dir(here).map_err(refused)? {
        let file = entry.map_err(refused)?.file_name();
        last = last.max(file.to_str().and_then(number).unwrap_or(0));
    }
    Ok(folder.join(format!("{name}-{:04}.{ending}", last.saturating_add(1))))
}

#[cfg(test)]
mod tests;
