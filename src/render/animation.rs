//! Animated GIFs.

use std::borrow::Cow;
use std::path::Path;

use super::frame::{Frame, PictureError};
use super::palette::Palette;

/// The frames as a GIF that repeats for ever, `seconds` for each frame (in steps of 0.01 s, at least 0.02: browsers
/// slow down what is faster). One palette for all frames, and of each frame only what changed: small, and without
/// flicker. The same bytes for the same frames.
///
/// # Errors
/// No frames, frames of different sizes, or the encoder failed.
pub fn to_gif(frames: &[Frame], seconds: f64) -> Result<Vec<u8>, PictureError> {
    let size = frames.first().map_or([0, 0], |frame| [frame.width(), frame.height()]);
    let shape = PictureError::Shape { frames: frames.len(), size };
    let (Ok(width), Ok(height), false) = (u16::try_from(size[0]), u16::try_from(size[1]), frames.is_empty()) else {
        return Err(shape);
    };
    // The last index is left for "as before".
    let mut palette = Palette::of(frames, 255);
    let unchanged = u8::try_from(palette.len()).unwrap_or(u8::MAX);
    let mut colours = palette.bytes().to_vec();
    colours.extend([0; 3]);
    let mut bytes = Vec::new();
    let mut encoder = gif::Encoder::new(&mut bytes, width, height, &colours)?;
    encoder.set_repeat(gif::Repeat::Infinite)?;
    let delay = (seconds * 100.0).round().clamp(2.0, 65_535.0) as u16;
    let mut before: Option<Vec<u8>> = None;
    for (number, frame) in frames.iter().enumerate() {
        let found = [frame.width(), frame.height()];
        if found != size {
            return Err(PictureError::Size { frame: number, found, expected: size });
        }
        let indices: Vec<u8> = frame.pixels().iter().map(|pixel| palette.index(*pixel)).collect();
        let mut encoded = difference(before.as_deref(), &indices, size, unchanged);
        encoded.delay = delay;
        encoder.write_frame(&encoded)?;
        before = Some(indices);
    }
    drop(encoder);
    Ok(bytes)
}

/// Writes the frames as a GIF; see [`to_gif`].
///
/// # Errors
/// Those of [`to_gif`], or the file cannot be written.
pub fn write_gif(path: &Path, frames: &[Frame], seconds: f64) -> Result<(), PictureError> {
    std::fs::write(path, to_gif(frames, seconds)?).map_err(|source| PictureError::Write { path: path.into(), source })
}

/// The rectangle that changed, with what did not change inside it marked as such: long runs of one index, which pack
/// well.
fn difference(before: Option<&[u8]>, now: &[u8], size: [usize; 2], unchanged: u8) -> gif::Frame<'static> {
    let [width, height] = size;
    let changed = |x: usize, y: usize| before.is_none_or(|before| before[y * width + x] != now[y * width + x]);
    let (mut left, mut top, mut right, mut bottom) = (width, height, 0, 0);
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).filter(|(x, y)| changed(*x, *y)) {
        (left, top, right, bottom) = (left.min(x), top.min(y), right.max(x + 1), bottom.max(y + 1));
    }
    if right == 0 {
        // Nothing changed; a frame still has to have a pixel.
        (left, top, right, bottom) = (0, 0, 1, 1);
    }
    let buffer: Vec<u8> = (top..bottom)
        .flat_map(|y| (left..right).map(move |x| (x, y)))
        .map(|(x, y)| if changed(x, y) { now[y * width + x] } else { unchanged })
        .collect();
    // The sides were checked to fit.
    let [left, top, width, height] = [left, top, right - left, bottom - top].map(|s| u16::try_from(s).unwrap_or(0));
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

    /// The frames as a viewer shows them.
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

    #[test]
    fn what_cannot_be_a_gif() {
        assert!(matches!(to_gif(&[], 0.1), Err(PictureError::Shape { frames: 0, .. })));
        let frames = [Frame::plain(3, 3, [0.0; 3]), Frame::plain(4, 3, [0.0; 3])];
        assert!(matches!(to_gif(&frames, 0.1), Err(PictureError::Size { frame: 1, .. })));
        assert!(to_gif(&[Frame::plain(1, 1, [0.0; 3])], f64::NAN).is_ok());
    }
}
