//! The pictures of a film, scaled and compressed.

use std::time::Duration;

use miniz_oxide::deflate::compress_to_vec;
use miniz_oxide::inflate::decompress_to_vec_with_limit;

use super::{MOST_WIDTH, PERIOD};
use pliant_render::{Film, Frame, PictureError};

/// Compression level: the lowest, since the thread must keep up.
const LEVEL: u8 = 1;

/// Stored pictures.
#[derive(Debug, Default)]
pub(super) struct Kept {
    size: [usize; 2],
    pictures: Vec<(Vec<u8>, Duration)>,
    bytes: usize,
}

impl Kept {
    /// Stores a picture with its time; its bytes match its size.
    pub fn add(&mut self, size: [usize; 2], rgb: &[u8], at: Duration) {
        if self.pictures.is_empty() {
            self.size = within(size, [MOST_WIDTH, usize::MAX]);
        }
        let packed = compress_to_vec(&resized(rgb, size, self.size), LEVEL);
        self.bytes += packed.len();
        self.pictures.push((packed, at));
    }

    /// Number of pictures.
    pub fn len(&self) -> usize {
        self.pictures.len()
    }

    /// Total size [bytes].
    pub fn bytes(&self) -> usize {
        self.bytes
    }
}

impl Film for Kept {
    fn len(&self) -> usize {
        self.pictures.len()
    }

    fn picture(&self, k: usize) -> Result<Frame, PictureError> {
        let [width, height] = self.size;
        let bytes = self
            .pictures
            .get(k)
            .and_then(|(packed, _)| decompress_to_vec_with_limit(packed, width * height * 3).ok());
        let frame = bytes.and_then(|rgb| Frame::from_rgb(width, height, &rgb));
        frame.ok_or(PictureError::Shape {
            frames: self.pictures.len(),
            size: self.size,
        })
    }

    /// Display time, in hundredths of a second without accumulated rounding.
    fn seconds(&self, k: usize) -> f64 {
        let hundredths = |k: usize| {
            self.pictures
                .get(k)
                .map(|(_, at)| (at.as_secs_f64() * 100.0).round())
        };
        match (hundredths(k), hundredths(k + 1)) {
            (Some(now), Some(next)) => (next - now) / 100.0,
            _ => PERIOD.as_secs_f64(),
        }
    }
}

/// The largest size with this aspect ratio within another size.
fn within([width, height]: [usize; 2], [most_width, most_height]: [usize; 2]) -> [usize; 2] {
    if width <= most_width && height <= most_height {
        return [width, height];
    }
    let share = (most_width as f64 / width as f64).min(most_height as f64 / height as f64);
    let side =
        |length: usize, most: usize| ((length as f64 * share).round() as usize).clamp(1, most);
    [side(width, most_width), side(height, most_height)]
}

/// A picture in another size: as large as possible, centred, with bars in the colour of its corner.
fn resized(rgb: &[u8], size: [usize; 2], onto: [usize; 2]) -> Vec<u8> {
    // A picture smaller than the film is enlarged, too.
    let factor = [0, 1].map(|k| onto[k] as f64 / size[k] as f64);
    let larger = factor[0].min(factor[1]).max(1.0);
    let enlarged = size.map(|side| (side as f64 * larger).round() as usize);
    let inner = within(enlarged, onto);
    let small = scaled(rgb, size, inner);
    if inner == onto {
        return small;
    }
    let mut canvas = small[..3].repeat(onto[0] * onto[1]);
    let [left, top] = [0, 1].map(|k| (onto[k] - inner[k]) / 2);
    for (row, line) in small.chunks_exact(3 * inner[0]).enumerate() {
        canvas[3 * ((top + row) * onto[0] + left)..][..line.len()].copy_from_slice(line);
    }
    canvas
}

/// A picture in another size: each pixel is the mean of its area, exact up to rounding to a byte.
fn scaled(rgb: &[u8], [w, h]: [usize; 2], [width, height]: [usize; 2]) -> Vec<u8> {
    if [w, h] == [width, height] {
        return rgb.to_vec();
    }
    let (across, down) = (covered(w, width), covered(h, height));
    let mut rows = vec![[0u64; 3]; h * width];
    for (row, line) in rows.chunks_exact_mut(width).zip(rgb.chunks_exact(3 * w)) {
        for (pixel, shares) in row.iter_mut().zip(&across) {
            for &(from, share) in shares {
                (0..3).for_each(|c| pixel[c] += share * u64::from(line[3 * from + c]));
            }
        }
    }
    let whole = (w * h) as u64;
    let mut out = Vec::with_capacity(3 * width * height);
    for shares in &down {
        for x in 0..width {
            let sum = |c: usize| {
                shares
                    .iter()
                    .map(|&(from, share)| share * rows[from * width + x][c])
                    .sum::<u64>()
            };
            out.extend([0, 1, 2].map(|c| ((sum(c) + whole / 2) / whole).min(255) as u8));
        }
    }
    out
}

/// For each of `many` pixels in a line, the old ones (of `length`) in its area with their shares;
/// the shares of one pixel add up to `length`.
fn covered(length: usize, many: usize) -> Vec<Vec<(usize, u64)>> {
    let of = |k: usize| {
        let (begin, end) = (k * length, (k + 1) * length);
        let share = |old: usize| ((old + 1) * many).min(end) - (old * many).max(begin);
        (begin / many..end.div_ceil(many))
            .map(|old| (old, share(old) as u64))
            .collect()
    };
    (0..many).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture with equal values in all three channels.
    fn grey(values: &[u8]) -> Vec<u8> {
        values.iter().flat_map(|v| [*v; 3]).collect()
    }

    #[test]
    fn a_smaller_picture_has_the_mean_of_what_it_covers() {
        assert_eq!(
            scaled(&grey(&[0, 100, 200, 100]), [4, 1], [2, 1]),
            grey(&[50, 150])
        );
        assert_eq!(
            scaled(&grey(&[0, 100, 200, 100]), [2, 2], [1, 1]),
            grey(&[100])
        );
        // Two thirds of one and a third of the other, rounded to the nearest.
        assert_eq!(scaled(&grey(&[0, 30, 90]), [3, 1], [2, 1]), grey(&[10, 70]));
        assert_eq!(scaled(&grey(&[0, 90]), [2, 1], [3, 1]), grey(&[0, 45, 90]));
        assert_eq!(scaled(&[1, 2, 3, 3, 4, 5], [2, 1], [1, 1]), [2, 3, 4]);
        // A uniform picture stays uniform for any sizes; nothing is lost at an edge.
        for (size, other) in [([7, 5], [3, 2]), ([720, 3], [719, 2]), ([13, 1], [13, 4])] {
            assert_eq!(
                scaled(&vec![217; 3 * size[0] * size[1]], size, other),
                vec![217; 3 * other[0] * other[1]]
            );
        }
        assert_eq!(covered(3, 2), [vec![(0, 2), (1, 1)], vec![(1, 1), (2, 2)]]);
    }

    #[test]
    fn sizes_keep_their_shape() {
        assert_eq!(within([1440, 900], [720, usize::MAX]), [720, 450]);
        assert_eq!(within([640, 480], [720, usize::MAX]), [640, 480]);
        assert_eq!(within([100_000, 3], [720, usize::MAX]), [720, 1]);
        assert_eq!(within([300, 300], [720, 100]), [100, 100]);
    }

    #[test]
    fn another_shape_gets_bars() {
        let wide = resized(&grey(&[9, 9, 9, 9]), [4, 1], [2, 3]);
        assert_eq!(wide, grey(&[9; 6]));
        let mut picture = grey(&[5, 200, 200, 200]);
        assert_eq!(
            resized(&picture, [1, 4], [2, 4]),
            grey(&[5, 5, 200, 5, 200, 5, 200, 5])
        );
        picture.truncate(3);
        assert_eq!(
            resized(&picture, [1, 1], [3, 2]),
            grey(&[5; 6]),
            "smaller ones are made larger"
        );
    }

    #[test]
    fn what_is_kept_comes_back() {
        let mut kept = Kept::default();
        let noise: Vec<u8> = (0..3 * 20 * 10)
            .map(|k: u32| (k.wrapping_mul(2_654_435_761) >> 24) as u8)
            .collect();
        for (k, ms) in [0, 83, 161, 400].into_iter().enumerate() {
            let mut picture = noise.clone();
            picture[0] = k as u8;
            kept.add([20, 10], &picture, Duration::from_millis(ms));
        }
        assert!(kept.bytes() > 0 && Film::len(&kept) == 4);
        for k in 0..4 {
            let frame = kept.picture(k).expect("it was kept");
            assert_eq!(frame.pixels().as_flattened()[1..], noise[1..]);
            assert_eq!(frame.pixel(0, 0).map(|p| p[0]), Some(k as u8));
        }
        let seconds: Vec<f64> = (0..4).map(|k| kept.seconds(k)).collect();
        assert_eq!(seconds, [0.08, 0.08, 0.24, 0.08]);
        assert!(kept.picture(4).is_err());
        kept.pictures[1].0.truncate(5);
        assert!(kept.picture(1).is_err(), "half a picture");
    }
}
