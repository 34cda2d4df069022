//! Pictures and films of the window, written in the background.
//!
//! A [`Recorder`] receives pictures at any rate, scales and compresses some of them in its own
//! thread, and writes them as an animated GIF or PNG at the end.
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
//! *Limitations.* Colours are averaged as stored sRGB values, not as light. If the size of the
//! window changes, pictures keep the size of the first, with bars.

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
use pliant::io::{file_name, write_whole};
use pliant_render::{Frame, PictureError, write_film_as_apng, write_film_as_gif};

/// Time from one picture of a film to the next.
pub const PERIOD: Duration = Duration::from_millis(80);

/// Greatest width of the pictures of a film \[px\].
pub const MOST_WIDTH: usize = 720;

/// Greatest number of pictures of a film; the film then ends.
pub const MOST_PICTURES: usize = 600;

/// Greatest total size of compressed pictures [bytes]; the film then ends.
const MOST_BYTES: usize = 256 << 20;

/// Greatest number of pictures in the queue of the thread; more would only use memory.
const WAITING: usize = 4;

/// Error of a picture or a film.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file name has no known extension.
    #[error("`{0}` does not end as a recording; name it .gif, .png or .apng")]
    Ending(PathBuf),
    /// The file already exists.
    #[error("`{0}` is there already; choose another name")]
    Exists(PathBuf),
    /// The file cannot be written.
    #[error("`{path}` cannot be written: {source}; choose another folder, or free some space")]
    Write {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
    /// The number of bytes does not match the size of the picture.
    #[error(
        "a picture of {width} x {height} pixels cannot have {bytes} bytes; it needs three a pixel"
    )]
    Size {
        /// Width \[px\].
        width: usize,
        /// Height \[px\].
        height: usize,
        /// Given number of bytes.
        bytes: usize,
    },
    /// The film was stopped before its first picture.
    #[error("nothing was recorded, so `{0}` was not written; record for longer")]
    Nothing(PathBuf),
    /// The picture cannot be encoded.
    #[error("the recording cannot be encoded: {0}")]
    Picture(#[from] PictureError),
    /// The system could not start a thread.
    #[error("the recording cannot have a thread of its own: {0}; end other programs and try again")]
    Thread(io::Error),
    /// The thread panicked.
    #[error("the recording ended before its time, and `{0}` was not written")]
    Ended(PathBuf),
}

/// Result of a pushed picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pushed {
    /// The picture is part of the film.
    Taken,
    /// The picture came too early.
    Early,
    /// The picture was due, but the thread was too slow.
    Dropped,
    /// The film has its greatest length, or its thread ended: stop it.
    Full,
}

/// A written film.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recorded {
    /// The file.
    pub path: PathBuf,
    /// Number of pictures.
    pub pictures: usize,
    /// Number of pictures lost because the thread was too slow.
    pub dropped: usize,
    /// True if the film ended at its greatest length.
    pub is_full: bool,
}

/// The format of a film.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Gif,
    Apng,
}

/// A picture in the queue.
struct Taken {
    size: [usize; 2],
    rgb: Vec<u8>,
    at: Duration,
}

/// Counters of both threads.
#[derive(Debug, Default)]
struct Counts {
    pictures: AtomicUsize,
    dropped: AtomicUsize,
    is_full: AtomicBool,
}

/// Records a film. A recorder dropped without [`Self::stop`] still writes the film, without a
/// result.
#[derive(Debug)]
pub struct Recorder {
    path: PathBuf,
    sender: SyncSender<Taken>,
    thread: JoinHandle<Result<Recorded, RecordingError>>,
    counts: Arc<Counts>,
    begun: Instant,
    /// Time of the next picture.
    due: Duration,
}

impl Recorder {
    /// Starts a film; the extension selects the format: `.gif`, or `.png` or `.apng` for an
    /// animated PNG.
    ///
    /// # Errors
    /// Another extension, an existing file, a folder that is not writable, or no thread.
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
        // An error now is better than one after a minute of recording.
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

    /// Path of the film.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Number of pictures so far.
    pub fn pictures(&self) -> usize {
        self.counts.pictures.load(Ordering::Relaxed)
    }

    /// Number of pictures lost because the thread was too slow.
    pub fn dropped(&self) -> usize {
        self.counts.dropped.load(Ordering::Relaxed)
    }

    /// True if the film ended at its greatest length.
    pub fn is_full(&self) -> bool {
        self.counts.is_full.load(Ordering::Relaxed) || self.thread.is_finished()
    }

    /// True if a picture is due; other pictures need not be read from the graphics card.
    pub fn is_due(&self) -> bool {
        self.begun.elapsed() >= self.due
    }

    /// Pushes a picture, rows from the top, red, green and blue of each pixel; never waits.
    ///
    /// # Errors
    /// A number of bytes that does not match the size.
    pub fn push(
        &mut self,
        width: usize,
        height: usize,
        rgb: &[u8],
    ) -> Result<Pushed, RecordingError> {
        self.push_at(width, height, rgb, self.begun.elapsed())
    }

    /// The same as [`Self::push`] for a picture at a given time since the start.
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
        // By the clock, so that rounding to whole pictures does not add up; late pictures are not
        // repeated.
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
        // Without a sender the thread proceeds to writing.
        let Self { path, thread, .. } = self;
        Recording {
            path,
            thread: Some(thread),
            result: None,
        }
    }
}

/// A film during writing.
#[derive(Debug)]
pub struct Recording {
    path: PathBuf,
    thread: Option<JoinHandle<Result<Recorded, RecordingError>>>,
    result: Option<Result<Recorded, RecordingError>>,
}

impl Recording {
    /// The result, once available; never waits.
    pub fn poll(&mut self) -> Option<&Result<Recorded, RecordingError>> {
        if self.thread.as_ref().is_some_and(JoinHandle::is_finished) {
            self.join();
        }
        self.result.as_ref()
    }

    /// Waits until the film is written.
    ///
    /// # Errors
    /// The error of the writing.
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

/// Stores pictures until the sender ends or there are enough, then writes them.
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

/// Writes a picture as a complete PNG; replaces a file of that name.
///
/// # Errors
/// A number of bytes that does not match the size, or a file that cannot be written.
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

/// The next unused name in a folder: `NAME-0001.ENDING`, `NAME-0002.ENDING`, and so on after the
/// last.
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
