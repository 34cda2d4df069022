//! Animated GIFs and PNGs.

use std::borrow::Cow;
use std::io::Write;

use super::frame::{Frame, PictureError};
use super::palette::{Colours, Palette};

/// Frames of one size, requested one at a time, so that memory need not hold all of them.
pub trait Film {
    /// Number of frames.
    fn len(&self) -> usize;

    /// True for no frames.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Frame `k`; the caller can request it more than once.
    ///
    /// # Errors
    /// The frame is not available.
    fn picture(&self, k: usize) -> Result<Frame, PictureError>;

    /// Display time of a frame [s].
    fn seconds(&self, k: usize) -> f64;
}

/// Frames in memory with one display time.
struct Even<'a> {
    frames: &'a [Frame],
    seconds: f64,
}

impl Film for Even<'_> {
    fn len(&self) -> usize {
        self.frames.len()
    }

    fn picture(&self, k: usize) -> Result<Frame, PictureError> {
        self.frames.get(k).cloned().ok_or(PictureError::Shape {
            frames: self.frames.len(),
            size: [0, 0],
        })
    }

    fn seconds(&self, _: usize) -> f64 {
        self.seconds
    }
}

/// Frame `k` of a film; an error if its size differs from `size`.
fn sized(film: &dyn Film, k: usize, size: [usize; 2]) -> Result<Frame, PictureError> {
    let frame = film.picture(k)?;
    let found = [frame.width(), frame.height()];
    if found == size {
        Ok(frame)
    } else {
        Err(PictureError::Size {
            frame: k,
            found,
            expected: size,
        })
    }
}

/// The size of a film.
fn size_of(film: &dyn Film) -> Result<[usize; 2], PictureError> {
    if film.is_empty() {
        return Err(PictureError::Shape {
            frames: 0,
            size: [0, 0],
        });
    }
    film.picture(0).map(|frame| [frame.width(), frame.height()])
}

/// The frames as a GIF that repeats without end, `seconds` for each frame (in steps of 0.01 s, at
/// least 0.02: browsers slow down faster ones). All frames share one palette, and each frame stores
/// only its changes: small, and without flicker. Equal frames give equal bytes.
///
/// # Errors
/// No frames, frames of different sizes, or a failure of the encoder.
pub fn to_gif(frames: &[Frame], seconds: f64) -> Result<Vec<u8>, PictureError> {
    let mut bytes = Vec::new();
    write_film_as_gif(&Even { frames, seconds }, &mut bytes)?;
    Ok(bytes)
}

/// Writes a film as a GIF; see [`to_gif`].
///
/// # Errors
/// Those of [`to_gif`], or a frame that is not available.
pub fn write_film_as_gif(film: &dyn Film, w: &mut dyn Write) -> Result<(), PictureError> {
    let size = size_of(film)?;
    let shape = PictureError::Shape {
        frames: film.len(),
        size,
    };
    let (Ok(width), Ok(height)) = (u16::try_from(size[0]), u16::try_from(size[1])) else {
        return Err(shape);
    };
    let mut seen = Colours::new();
    for k in 0..film.len() {
        seen.see(&sized(film, k, size)?);
    }
    // The last index is reserved for "unchanged".
    let mut palette = Palette::new(seen, 255);
    let unchanged = u8::try_from(palette.len()).unwrap_or(u8::MAX);
    let mut colours = palette.bytes().to_vec();
    colours.extend([0; 3]);
    let mut encoder = gif::Encoder::new(w, width, height, &colours)?;
    encoder.set_repeat(gif::Repeat::Infinite)?;
    let mut before: Option<Vec<u8>> = None;
    for k in 0..film.len() {
        let indices: Vec<u8> = sized(film, k, size)?
            .pixels()
            .iter()
            .map(|pixel| palette.index(*pixel))
            .collect();
        let mut encoded = difference(before.as_deref(), &indices, size, unchanged);
        encoded.delay = (film.seconds(k) * 100.0).round().clamp(2.0, 65_535.0) as u16;
        encoder.write_frame(&encoded)?;
        before = Some(indices);
    }
    Ok(())
}

/// The frames as an animated PNG that repeats without end, `seconds` for each frame (in steps of
/// 0.001 s, at least 0.01). Colours are exact, and each frame stores only the rectangle that
/// changed. Equal frames give equal bytes.
///
/// # Errors
/// No frames, frames of different sizes, or a failure of the encoder.
pub fn to_apng(frames: &[Frame], seconds: f64) -> Result<Vec<u8>, PictureError> {
    let mut bytes = Vec::new();
    write_film_as_apng(&Even { frames, seconds }, &mut bytes)?;
    Ok(bytes)
}

/// Writes a film as an animated PNG; see [`to_apng`].
///
/// # Errors
/// Those of [`to_apng`], or a frame that is not available.
pub fn write_film_as_apng(film: &dyn Film, w: &mut dyn Write) -> Result<(), PictureError> {
    let size = size_of(film)?;
    let count = u32::try_from(film.len()).map_err(|_| PictureError::Shape {
        frames: film.len(),
        size,
    })?;
    let mut encoder = png::Encoder::new(w, size[0] as u32, size[1] as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    // Fast compression, since the user waits.
    encoder.set_compression(png::Compression::Fast);
    encoder.set_animated(count, 0)?;
    let mut writer = encoder.write_header()?;
    let mut before: Option<Frame> = None;
    for k in 0..film.len() {
        let frame = sized(film, k, size)?;
        let changed = |at: usize| {
            before
                .as_ref()
                .is_none_or(|b| b.pixels()[at] != frame.pixels()[at])
        };
        let [left, top, right, bottom] = rectangle(size, changed);
        writer.reset_frame_position()?;
        // The sides of a frame are at most MAX_SIDE.
        writer.set_frame_dimension((right - left) as u32, (bottom - top) as u32)?;
        writer.set_frame_position(left as u32, top as u32)?;
        writer.set_frame_delay(
            (film.seconds(k) * 1000.0).round().clamp(10.0, 65_535.0) as u16,
            1000,
        )?;
        let rows = frame.pixels().chunks_exact(size[0]).take(bottom).skip(top);
        let part: Vec<u8> = rows
            .flat_map(|row| row[left..right].as_flattened())
            .copied()
            .collect();
        writer.write_image_data(&part)?;
        before = Some(frame);
    }
    writer.finish()?;
    Ok(())
}

/// Left, top, right and bottom of the changed rectangle, the latter two exclusive; one pixel if
/// nothing changed.
fn rectangle([width, height]: [usize; 2], changed: impl Fn(usize) -> bool) -> [usize; 4] {
    let (mut left, mut top, mut right, mut bottom) = (width, height, 0, 0);
    for (x, y) in (0..height)
        .flat_map(|y| (0..width).map(move |x| (x, y)))
        .filter(|(x, y)| changed(y * width + x))
    {
        (left, top, right, bottom) = (left.min(x), top.min(y), right.max(x + 1), bottom.max(y + 1));
    }
    // A frame has at least one pixel.
    if right == 0 {
        [0, 0, 1, 1]
    } else {
        [left, top, right, bottom]
    }
}

/// The changed rectangle, with its unchanged pixels marked: long runs of one index compress well.
fn difference(
    before: Option<&[u8]>,
    now: &[u8],
    size: [usize; 2],
    unchanged: u8,
) -> gif::Frame<'static> {
    let [width, height] = size;
    let changed = |at: usize| before.is_none_or(|before| before[at] != now[at]);
    let [left, top, right, bottom] = rectangle([width, height], changed);
    let buffer: Vec<u8> = (top..bottom)
        .flat_map(|y| (left..right).map(move |x| y * width + x))
        .map(|at| if changed(at) { now[at] } else { unchanged })
        .collect();
    // The sides are already checked.
    let [left, top, width, height] =
        [left, top, right - left, bottom - top].map(|s| u16::try_from(s).unwrap_or(0));
    gif::Frame {
        left,
        top,
        width,
        height,
        buffer: Cow::Owned(buffer),
        transparent: before.map(|_| unchanged),
        dispose: gif::DisposalMethod::Keep,
        ..gif::Frame::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The frames as a viewer displays them.
    fn shown(bytes: &[u8]) -> Vec<Vec<[u8; 3]>> {
        let mut decoder = gif::Decoder::new(bytes).expect("reads");
        let (width, height) = (usize::from(decoder.width()), usize::from(decoder.height()));
        let colours = decoder.global_palette().expect("one palette").to_vec();
        let mut canvas = vec![[0; 3]; width * height];
        let mut frames = Vec::new();
        while let Some(frame) = decoder.read_next_frame().expect("reads") {
            for (k, index) in frame.buffer.iter().enumerate() {
                let (x, y) = (k % usize::from(frame.width), k / usize::from(frame.width));
                if frame.transparent != Some(*index) {
                    let at = (usize::from(frame.top) + y) * width + usize::from(frame.left) + x;
                    canvas[at] = std::array::from_fn(|c| colours[usize::from(*index) * 3 + c]);
                }
            }
            frames.push(canvas.clone());
        }
        frames
    }

    #[test]
    fn a_moving_square_reads_back() {
        let frame = |step: i64| {
            let mut frame = Frame::plain(40, 30, [1.0; 3]);
            frame.rectangle(step..step + 10, 5..15, [0.8, 0.2, 0.2]);
            frame
        };
        let frames: Vec<Frame> = [0, 3, 3, 20].map(frame).to_vec();
        let bytes = to_gif(&frames, 0.05).expect("encodes");
        assert_eq!(bytes, to_gif(&frames, 0.05).expect("encodes"));
        let shown = shown(&bytes);
        assert_eq!(shown.len(), 4);
        for (shown, frame) in shown.iter().zip(&frames) {
            assert_eq!(shown, frame.pixels());
        }
    }

    /// The frames of an animated PNG as a viewer displays them, and their delays [ms].
    fn played(bytes: &[u8]) -> Vec<(Vec<[u8; 3]>, u32)> {
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes))
            .read_info()
            .expect("reads");
        let (width, height) = (reader.info().width as usize, reader.info().height as usize);
        let control = *reader.info().animation_control().expect("an animation");
        assert_eq!(control.num_plays, 0, "for ever");
        let mut canvas = vec![[0; 3]; width * height];
        let mut all = Vec::new();
        for _ in 0..control.num_frames {
            let mut part = vec![0; width * height * 3];
            let shape = reader.next_frame(&mut part).expect("a frame");
            let frame = *reader.info().frame_control().expect("its place");
            let (across, down) = (shape.width as usize, shape.height as usize);
            for (k, pixel) in part
                .as_chunks::<3>()
                .0
                .iter()
                .take(across * down)
                .enumerate()
            {
                let at = (frame.y_offset as usize + k / across) * width
                    + frame.x_offset as usize
                    + k % across;
                canvas[at] = *pixel;
            }
            assert_eq!(frame.delay_den, 1000);
            all.push((canvas.clone(), u32::from(frame.delay_num)));
        }
        all
    }

    #[test]
    fn an_animated_png_reads_back() {
        let frame = |step: i64| {
            let mut frame = Frame::plain(40, 30, [1.0; 3]);
            // More colours than a GIF has.
            (0..30).for_each(|y| {
                (0..40)
                    .for_each(|x| frame.blend(x, y, [x as f32 / 39.0, y as f32 / 29.0, 0.3], 0.2))
            });
            frame.rectangle(step..step + 10, 5..15, [0.8, 0.2, 0.2]);
            frame
        };
        let frames: Vec<Frame> = [0, 3, 3, 20].map(frame).to_vec();
        let bytes = to_apng(&frames, 0.08).expect("encodes");
        assert_eq!(bytes, to_apng(&frames, 0.08).expect("encodes"));
        let played = played(&bytes);
        assert_eq!(played.len(), 4);
        for ((shown, delay), frame) in played.iter().zip(&frames) {
            assert_eq!((shown.as_slice(), *delay), (frame.pixels(), 80));
        }
        assert_ne!(played[0].0, frames[1].pixels(), "control: another frame");
        // Unchanged frames are almost free.
        let still = to_apng(&vec![frames[0].clone(); 20], 0.08).expect("encodes");
        let one = to_apng(&frames[..1], 0.08).expect("encodes");
        assert!(
            still.len() < one.len() + 20 * 200,
            "{} and {} bytes",
            still.len(),
            one.len()
        );
    }

    #[test]
    fn what_cannot_be_an_animated_png() {
        assert!(matches!(
            to_apng(&[], 0.1),
            Err(PictureError::Shape { frames: 0, .. })
        ));
        let frames = [Frame::plain(3, 3, [0.0; 3]), Frame::plain(4, 3, [0.0; 3])];
        assert!(matches!(
            to_apng(&frames, 0.1),
            Err(PictureError::Size { frame: 1, .. })
        ));
        assert_eq!(
            played(&to_apng(&frames[..1], 1e9).expect("encodes"))[0].1,
            65_535
        );
    }

    #[test]
    fn what_cannot_be_a_gif() {
        assert!(matches!(
            to_gif(&[], 0.1),
            Err(PictureError::Shape { frames: 0, .. })
        ));
        let frames = [Frame::plain(3, 3, [0.0; 3]), Frame::plain(4, 3, [0.0; 3])];
        assert!(matches!(
            to_gif(&frames, 0.1),
            Err(PictureError::Size { frame: 1, .. })
        ));
        assert!(to_gif(&[Frame::plain(1, 1, [0.0; 3])], f64::NAN).is_ok());
    }
}
