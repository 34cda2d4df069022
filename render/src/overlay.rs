//! Pictures of one scene as a first picture with overlays: unchanged pixels are stored once.

use rayon::prelude::*;

use super::frame::{Frame, PictureError};
use super::palette::Palette;

/// The first frame as a PNG, and for each other frame a PNG that is transparent where the frame
/// equals the first; over the first it gives the frame. All frames share at most 255 colours. The
/// overlays are small where little moves. Equal frames give equal bytes for any number of threads;
/// the result is empty for no frames.
///
/// # Errors
/// Frames of different sizes, or a failure of the encoder.
pub fn to_overlays(frames: &[Frame]) -> Result<Vec<Vec<u8>>, PictureError> {
    let mut palette = Palette::of(frames, 255);
    let mut indices: Vec<Vec<u8>> = Vec::with_capacity(frames.len());
    for (number, frame) in frames.iter().enumerate() {
        let [found, expected] = [frame, &frames[0]].map(|frame| [frame.width(), frame.height()]);
        if found != expected {
            return Err(PictureError::Size {
                frame: number,
                found,
                expected,
            });
        }
        // The first index is reserved for "as in the first".
        indices.push(
            frame
                .pixels()
                .iter()
                .map(|pixel| palette.index(*pixel).saturating_add(1))
                .collect(),
        );
    }
    let Some((first, others)) = indices.split_first_mut() else {
        return Ok(Vec::new());
    };
    others.par_iter_mut().for_each(|frame| {
        for (index, _) in frame
            .iter_mut()
            .zip(&*first)
            .filter(|(index, before)| *index == *before)
        {
            *index = 0;
        }
    });
    let colours = [&[0; 3], palette.bytes()].concat();
    indices
        .par_iter()
        .map(|picture| to_png(picture, [frames[0].width(), frames[0].height()], &colours))
        .collect()
}

/// A PNG of colour indices; the first colour is transparent.
fn to_png(
    indices: &[u8],
    [width, height]: [usize; 2],
    colours: &[u8],
) -> Result<Vec<u8>, PictureError> {
    let mut bytes = Vec::new();
    // The sides of a frame fit.
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_palette(colours);
    encoder.set_trns(&[0][..]);
    encoder.set_compression(png::Compression::Balanced);
    // Neighbouring indices are not neighbouring colours, so their differences do not compress.
    encoder.set_filter(png::Filter::NoFilter);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(indices)?;
    writer.finish()?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Red, green, blue, opacity of a picture's pixels.
    fn decoded(bytes: &[u8]) -> Vec<[u8; 4]> {
        let mut decoder = png::Decoder::new(std::io::Cursor::new(bytes));
        decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::ALPHA);
        let mut reader = decoder.read_info().expect("reads");
        let mut pixels = vec![0; reader.output_buffer_size().expect("small")];
        reader.next_frame(&mut pixels).expect("reads");
        pixels.as_chunks().0.to_vec()
    }

    fn moving(step: i64) -> Frame {
        let mut frame = Frame::plain(40, 30, [1.0; 3]);
        frame.rectangle(20..30, 10..20, [0.1, 0.2, 0.8]);
        frame.rectangle(step..step + 10, 5..15, [0.8, 0.2, 0.2]);
        frame
    }

    #[test]
    fn overlays_laid_over_the_first_are_the_frames() {
        let frames: Vec<Frame> = [0, 3, 0, 17].map(moving).to_vec();
        let bytes = to_overlays(&frames).expect("encodes");
        assert_eq!(bytes, to_overlays(&frames).expect("encodes"));
        let shown: Vec<Vec<[u8; 4]>> = bytes.iter().map(|picture| decoded(picture)).collect();
        assert!(shown[0].iter().all(|p| p[3] == 255), "the first is opaque");
        assert!(
            shown[2].iter().all(|p| p[3] == 0),
            "nothing of what did not change"
        );
        for (frame, over) in frames.iter().zip(&shown) {
            let placed = shown[0]
                .iter()
                .zip(over)
                .map(|(first, over)| if over[3] == 0 { first } else { over });
            assert!(
                placed
                    .map(|p| &p[..3])
                    .eq(frame.pixels().iter().map(|p| &p[..]))
            );
        }
        // A square of 10 that moves by 3 leaves and takes 3 columns.
        assert_eq!(shown[1].iter().filter(|p| p[3] == 255).count(), 2 * 3 * 10);
    }

    #[test]
    fn many_colours_are_kept_nearly_and_sizes_must_agree() {
        let mut frame = moving(0);
        for (x, y) in (0..40).flat_map(|x| (0..30).map(move |y| (x, y))) {
            frame.blend(x, y, [x as f32 / 39.0, y as f32 / 29.0, 0.5], 1.0);
        }
        let bytes = to_overlays(std::slice::from_ref(&frame)).expect("encodes");
        for (shown, pixel) in decoded(&bytes[0]).iter().zip(frame.pixels()) {
            assert!(
                shown.iter().zip(pixel).all(|(a, b)| a.abs_diff(*b) <= 16),
                "{shown:?} {pixel:?}"
            );
        }
        assert!(to_overlays(&[]).expect("encodes").is_empty());
        let other = Frame::plain(41, 30, [1.0; 3]);
        assert!(matches!(
            to_overlays(&[frame, other]),
            Err(PictureError::Size { frame: 1, .. })
        ));
    }
}
