//! A picture, and its PNG.

use super::camera::MAX_SIDE;
use super::colour::{Rgb, mix, quantise};

/// Strength of the pale background behind text.
const PALE: f32 = 0.8;

/// Error of writing a picture.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The file cannot be written.
    #[error("cannot write the picture {path}")]
    Write {
        /// The file.
        path: std::path::PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The PNG encoder failed.
    #[error("cannot encode a PNG")]
    Png(#[from] png::EncodingError),
    /// The GIF encoder failed.
    #[error("cannot encode a GIF")]
    Gif(#[from] gif::EncodingError),
    /// A frame of an animation has another size than the first.
    #[error("frame {frame} has {found:?} pixels, the first frame {expected:?}")]
    Size {
        /// Index of the frame, from 0.
        frame: usize,
        /// Width and height of the frame \[px\].
        found: [usize; 2],
        /// Width and height of the first frame \[px\].
        expected: [usize; 2],
    },
    /// A GIF has at most 65,535 pixels per side, and any animation at least one frame.
    #[error("an animation of {frames} frames of {size:?} pixels cannot be")]
    Shape {
        /// Number of frames.
        frames: usize,
        /// Width and height \[px\].
        size: [usize; 2],
    },
}

impl PictureError {
    /// The error of the writer inside an encoder error.
    ///
    /// # Errors
    /// The error itself if it contains no writer error.
    pub fn into_io(self) -> Result<std::io::Error, Self> {
        match self {
            Self::Gif(gif::EncodingError::Io(source))
            | Self::Png(png::EncodingError::IoError(source)) => Ok(source),
            other => Err(other),
        }
    }
}

/// A picture: rows of pixels from top to bottom, each from left to right.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    width: usize,
    height: usize,
    pixels: Vec<[u8; 3]>,
    dropped: usize,
}

impl Frame {
    /// A picture of one colour. Sides are clamped to 1..=[`MAX_SIDE`].
    pub fn plain(width: u32, height: u32, colour: Rgb) -> Self {
        let [width, height] = [width, height].map(|side| side.clamp(1, MAX_SIDE) as usize);
        Self::from_pixels(width, height, vec![quantise(colour); width * height], 0)
    }

    /// A picture from bytes: red, green and blue of each pixel, rows from the top. `None` if their
    /// number does not match the size, or a side is outside 1..=[`MAX_SIDE`].
    pub fn from_rgb(width: usize, height: usize, rgb: &[u8]) -> Option<Self> {
        let (pixels, rest) = rgb.as_chunks::<3>();
        let fits = [width, height]
            .iter()
            .all(|side| (1..=MAX_SIDE as usize).contains(side))
            && rest.is_empty()
            && pixels.len() == width * height;
        fits.then(|| Self::from_pixels(width, height, pixels.to_vec(), 0))
    }

    pub(super) fn from_pixels(
        width: usize,
        height: usize,
        pixels: Vec<[u8; 3]>,
        dropped: usize,
    ) -> Self {
        Self {
            width,
            height,
            pixels,
            dropped,
        }
    }

    /// Width \[px\].
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height \[px\].
    pub fn height(&self) -> usize {
        self.height
    }

    /// Number of triangles and segments left out because of a coordinate that is not finite or a
    /// missing vertex.
    pub fn dropped(&self) -> usize {
        self.dropped
    }

    /// All pixels (red, green, blue), shape `[height * width]`.
    pub fn pixels(&self) -> &[[u8; 3]] {
        &self.pixels
    }

    /// The pixel at a column and row; `None` outside.
    pub fn pixel(&self, column: usize, row: usize) -> Option<[u8; 3]> {
        if column < self.width {
            self.pixels.get(row * self.width + column).copied()
        } else {
            None
        }
    }

    /// Blends a colour over a pixel: `amount` 1 replaces it. Pixels outside the picture are
    /// ignored.
    pub(super) fn blend(&mut self, column: i64, row: i64, colour: Rgb, amount: f32) {
        let (Ok(column), Ok(row)) = (usize::try_from(column), usize::try_from(row)) else {
            return;
        };
        if column < self.width && row < self.height {
            let pixel = &mut self.pixels[row * self.width + column];
            *pixel = quantise(mix(pixel.map(|c| f32::from(c) / 255.0), colour, amount));
        }
    }

    /// Brightens a rectangle, so that dark text is readable on any background.
    pub(super) fn pale(&mut self, columns: std::ops::Range<i64>, rows: std::ops::Range<i64>) {
        for row in rows.start.max(0)..rows.end.min(self.height as i64) {
            for column in columns.start.max(0)..columns.end.min(self.width as i64) {
                self.blend(column, row, [1.0; 3], PALE);
            }
        }
    }

    /// Fills a rectangle, clipped to the picture.
    pub(super) fn rectangle(
        &mut self,
        columns: std::ops::Range<i64>,
        rows: std::ops::Range<i64>,
        colour: Rgb,
    ) {
        for row in rows.start.max(0)..rows.end.min(self.height as i64) {
            for column in columns.start.max(0)..columns.end.min(self.width as i64) {
                self.blend(column, row, colour, 1.0);
            }
        }
    }

    /// Draws a circle with its centre at a column and row \[px\], clipped to the picture: a line of
    /// `colour`, three pixels wide, between two white ones, so that it is visible on any ground.
    pub fn ring(&mut self, [column, row]: [f64; 2], radius: f64, colour: Rgb) {
        if ![column, row, radius].iter().all(|c| c.is_finite()) {
            return;
        }
        let reach = radius.clamp(0.0, f64::from(MAX_SIDE)) + 4.0;
        let span = |at: f64| (at - reach).floor() as i64..=(at + reach).ceil() as i64;
        for y in span(row) {
            for x in span(column) {
                let away = libm::hypot(x as f64 - column, y as f64 - row) - radius;
                // A pixel is covered by as much of its width as lies on the line.
                let covered = |half: f64| (half + 0.5 - away.abs()).clamp(0.0, 1.0) as f32;
                self.blend(x, y, [1.0; 3], covered(3.0));
                self.blend(x, y, colour, covered(1.5));
            }
        }
    }

    /// Copies another picture over this one, with its upper left corner at a column and row,
    /// clipped to the picture.
    pub fn paste(&mut self, column: usize, row: usize, other: &Self) {
        let width = other.width.min(self.width.saturating_sub(column));
        for (down, line) in other
            .pixels
            .chunks(other.width)
            .enumerate()
            .take(self.height.saturating_sub(row))
        {
            if width > 0 {
                self.pixels[(row + down) * self.width + column..][..width]
                    .copy_from_slice(&line[..width]);
            }
        }
        self.dropped += other.dropped;
    }

    /// Pictures side by side, aligned at the top, with `gap` pixels of `colour` in between.
    pub fn beside(frames: &[Self], gap: usize, colour: Rgb) -> Self {
        let width =
            frames.iter().map(Self::width).sum::<usize>() + gap * frames.len().saturating_sub(1);
        let height = frames.iter().map(Self::height).max().unwrap_or(1);
        let mut pixels = vec![quantise(colour); width.max(1) * height];
        let mut left = 0;
        for frame in frames {
            for (row, source) in frame.pixels.chunks(frame.width).enumerate() {
                pixels[row * width + left..][..frame.width].copy_from_slice(source);
            }
            left += frame.width + gap;
        }
        Self {
            width: width.max(1),
            height,
            pixels,
            dropped: frames.iter().map(Self::dropped).sum(),
        }
    }

    /// The picture as a PNG; equal pixels give equal bytes.
    ///
    /// # Errors
    /// A failure of the encoder.
    pub fn to_png(&self) -> Result<Vec<u8>, PictureError> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::Balanced);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(self.pixels.as_flattened())?;
        writer.finish()?;
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ring_leaves_its_middle_and_ends_at_the_border() {
        let white = Frame::plain(41, 41, [1.0; 3]);
        let mut frame = white.clone();
        frame.ring([20.0, 20.0], 10.0, [1.0, 0.0, 0.0]);
        for at in [(30, 20), (10, 20), (20, 30), (20, 10)] {
            assert_eq!(frame.pixel(at.0, at.1), Some([255, 0, 0]), "{at:?}");
        }
        for at in [(20, 20), (20, 13), (36, 20)] {
            assert_eq!(frame.pixel(at.0, at.1), Some([255; 3]), "{at:?}");
        }
        // Partly outside, far outside, and at no place.
        frame.ring([0.0, 40.0], 5.0, [0.0; 3]);
        assert_eq!(frame.pixel(5, 40), Some([0; 3]));
        let mut none = white.clone();
        for at in [[1e300, -1e300], [f64::NAN, 3.0], [3.0, f64::INFINITY]] {
            none.ring(at, 5.0, [0.0; 3]);
        }
        assert_eq!(none, white);
    }

    #[test]
    fn a_png_reads_back() {
        let mut frame = Frame::plain(7, 3, [1.0, 0.5, 0.0]);
        frame.blend(6, 2, [0.0, 0.0, 1.0], 1.0);
        let bytes = frame.to_png().expect("encodes");
        assert_eq!(bytes, frame.to_png().expect("encodes"));
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes))
            .read_info()
            .expect("reads");
        let mut pixels = vec![0; 7 * 3 * 3];
        reader.next_frame(&mut pixels).expect("reads");
        assert_eq!(pixels, frame.pixels().as_flattened());
        assert_eq!(frame.pixel(6, 2), Some([0, 0, 255]));
        assert_eq!(frame.pixel(7, 0), None);
    }

    #[test]
    fn bytes_make_a_picture_if_they_fit() {
        let frame = Frame::from_rgb(2, 1, &[1, 2, 3, 4, 5, 6]).expect("six bytes");
        assert_eq!(
            (frame.pixel(0, 0), frame.pixel(1, 0)),
            (Some([1, 2, 3]), Some([4, 5, 6]))
        );
        for (width, height, bytes) in [
            (2, 1, 5),
            (2, 1, 7),
            (1, 1, 6),
            (0, 0, 0),
            (0, 2, 0),
            (usize::MAX, 2, 6),
        ] {
            assert_eq!(
                Frame::from_rgb(width, height, &vec![0; bytes]),
                None,
                "{width} x {height}, {bytes} bytes"
            );
        }
    }

    #[test]
    fn painting_outside_changes_nothing() {
        let mut frame = Frame::plain(4, 4, [1.0; 3]);
        let before = frame.clone();
        for (x, y) in [(-1, 0), (0, -1), (4, 0), (0, 4), (i64::MIN, i64::MAX)] {
            frame.blend(x, y, [0.0; 3], 1.0);
        }
        frame.rectangle(i64::MIN..0, 0..4, [0.0; 3]);
        assert_eq!(frame, before);
    }

    #[test]
    fn side_by_side() {
        let both = Frame::beside(
            &[Frame::plain(2, 2, [0.0; 3]), Frame::plain(3, 1, [1.0; 3])],
            1,
            [0.5; 3],
        );
        assert_eq!((both.width(), both.height()), (6, 2));
        assert_eq!(both.pixel(1, 1), Some([0; 3]));
        assert_eq!(both.pixel(2, 0), Some([128; 3]));
        assert_eq!(
            (both.pixel(5, 0), both.pixel(5, 1)),
            (Some([255; 3]), Some([128; 3]))
        );
        assert_eq!(Frame::beside(&[], 3, [0.5; 3]).pixels().len(), 1);
    }

    #[test]
    fn what_is_pasted_is_cut_at_the_sides() {
        let mut frame = Frame::plain(4, 3, [1.0; 3]);
        for (column, row) in [(2, 1), (9, 0), (0, 9), (4, 3)] {
            frame.paste(column, row, &Frame::plain(3, 5, [0.0; 3]));
        }
        let dark: Vec<usize> = (0..12).filter(|p| frame.pixels()[*p] == [0; 3]).collect();
        assert_eq!(dark, [6, 7, 10, 11]);
    }
}
