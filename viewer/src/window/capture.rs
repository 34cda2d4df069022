//! Pictures and recordings of the window without the panel.

use std::path::{Path, PathBuf};

use kiss3d::prelude::Window;

use crate::recording::{
    Pushed, Recorded, Recorder, Recording, RecordingError, free_name, save_png,
};

/// The present recording and the written files.
pub struct Capture {
    folder: PathBuf,
    name: String,
    film: Option<Recorder>,
    writing: Option<Recording>,
    /// True while a picture is read from the graphics card.
    is_read: bool,
    /// True if the next rendered picture is saved.
    is_requested: bool,
}

impl Capture {
    /// Saves pictures in `folder` with names based on `name`.
    pub fn new(folder: &Path, name: &str) -> Self {
        let (folder, name) = (folder.to_owned(), name.to_owned());
        Self {
            folder,
            name,
            film: None,
            writing: None,
            is_read: false,
            is_requested: false,
        }
    }

    /// True during the recording of a film.
    pub fn is_recording(&self) -> bool {
        self.film.is_some()
    }

    /// True if overlays are left out of the next rendered picture.
    pub fn is_taking(&self) -> bool {
        self.is_requested || self.film.is_some()
    }

    /// True if the next rendered picture is saved.
    pub fn is_picture_requested(&self) -> bool {
        self.is_requested
    }

    /// Saves the next rendered picture.
    pub fn picture(&mut self) {
        self.is_requested = true;
    }

    /// Starts or ends a film. Returns a message.
    pub fn record(&mut self) -> String {
        if let Some(film) = self.film.take() {
            let text = format!("writing {}", film.path().display());
            self.writing = Some(film.stop());
            return text;
        }
        let begun = self
            .next_name("gif")
            .and_then(|path| Recorder::start(&path));
        match begun {
            Ok(film) => {
                let text = format!("recording {}", film.path().display());
                self.film = Some(film);
                text
            }
            Err(error) => error.to_string(),
        }
    }

    fn next_name(&self, ending: &str) -> Result<PathBuf, RecordingError> {
        let refused = |source| RecordingError::Write {
            path: self.folder.clone(),
            source,
        };
        std::fs::create_dir_all(&self.folder).map_err(refused)?;
        free_name(&self.folder, &self.name, ending)
    }

    /// To be called after each picture, of which the left `width` pixels are the scene. Returns a
    /// message, if any.
    pub fn rendered(&mut self, window: &Window, width: usize) -> Option<String> {
        let mut said = None;
        if self.is_read {
            // A read that started after the last picture is complete by now.
            self.is_read = false;
            if let Some(image) = window.snap_finish() {
                said = self.push(
                    image.width() as usize,
                    image.height() as usize,
                    image.as_raw(),
                    width,
                );
            }
        }
        if self.film.as_ref().is_some_and(Recorder::is_due) {
            window.snap_begin();
            self.is_read = true;
        }
        if std::mem::take(&mut self.is_requested) {
            said = Some(
                self.save(window, width)
                    .unwrap_or_else(|error| error.to_string()),
            );
        }
        said.or_else(|| self.written())
    }

    fn push(&mut self, width: usize, height: usize, rgb: &[u8], columns: usize) -> Option<String> {
        let film = self.film.as_mut()?;
        let (width, rgb) = left(width, rgb, columns);
        match film.push(width, height, &rgb) {
            // The film ends at its greatest length.
            Ok(Pushed::Full) => Some(self.record()),
            Ok(_) => None,
            Err(error) => {
                self.film = None;
                Some(error.to_string())
            }
        }
    }

    /// The result of a stopped film.
    fn written(&mut self) -> Option<String> {
        let said = match self.writing.as_mut()?.poll()? {
            Ok(film) => in_words(film),
            Err(error) => error.to_string(),
        };
        self.writing = None;
        Some(said)
    }

    fn save(&self, window: &Window, columns: usize) -> Result<String, RecordingError> {
        let image = window.snap_image();
        let (width, rgb) = left(image.width() as usize, image.as_raw(), columns);
        let path = self.next_name("png")?;
        save_png(&path, width, image.height() as usize, &rgb)?;
        Ok(format!("wrote {}", path.display()))
    }

    /// Ends a film and waits until it is written, when the window closes.
    pub fn close(mut self) -> Option<String> {
        if self.film.is_some() {
            self.record();
        }
        let done = self.writing.take()?.wait();
        Some(done.map_or_else(|error| error.to_string(), |film| in_words(&film)))
    }
}

fn in_words(film: &Recorded) -> String {
    let Recorded {
        path,
        pictures,
        dropped,
        is_full,
    } = film;
    let lacks = if *dropped > 0 {
        format!(", {dropped} more were dropped")
    } else {
        String::new()
    };
    let full = if *is_full {
        "; it was as long as it may be"
    } else {
        ""
    };
    format!("wrote {}: {pictures} pictures{lacks}{full}", path.display())
}

/// The leftmost columns of a picture.
fn left(width: usize, rgb: &[u8], columns: usize) -> (usize, Vec<u8>) {
    let columns = columns.clamp(1, width.max(1));
    (
        columns,
        rgb.chunks_exact(3 * width.max(1))
            .flat_map(|row| row[..3 * columns].iter().copied())
            .collect(),
    )
}
