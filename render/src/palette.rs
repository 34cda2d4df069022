//! A small palette for several pictures, by median cut of their colours.

use super::frame::Frame;

/// Bits per channel that distinguish colours in the counts.
const BITS: u32 = 6;

/// A palette, with the nearest of its colours for any colour.
pub(super) struct Palette {
    colours: Vec<[u8; 3]>,
    /// Index of the nearest palette colour for each counted colour, once computed.
    nearest: Vec<Option<u8>>,
}

/// Pixels of one counted colour.
#[derive(Clone, Copy, Default)]
struct Count {
    pixels: u64,
    sum: [u64; 3],
}

/// Counted colours of a sequence of frames.
pub(super) struct Colours {
    counts: Vec<Count>,
    background: Option<[u8; 3]>,
}

impl Colours {
    /// Counts of no frame.
    pub fn new() -> Self {
        Self {
            counts: vec![Count::default(); 1 << (3 * BITS)],
            background: None,
        }
    }

    /// Counts the colours of a frame; the first pixel of the first frame is the background.
    pub fn see(&mut self, frame: &Frame) {
        self.background = self.background.or_else(|| frame.pixel(0, 0));
        for pixel in frame.pixels() {
            let count = &mut self.counts[key(*pixel)];
            count.pixels += 1;
            (0..3).for_each(|k| count.sum[k] += u64::from(pixel[k]));
        }
    }
}

impl Palette {
    /// At most `most` (at least 2) colours for these frames. The first pixel, the background, keeps
    /// its exact colour.
    pub fn of(frames: &[Frame], most: usize) -> Self {
        let mut colours = Colours::new();
        frames.iter().for_each(|frame| colours.see(frame));
        Self::new(colours, most)
    }

    /// At most `most` (at least 2) colours for the counted ones. The background keeps its exact
    /// colour.
    pub fn new(seen: Colours, most: usize) -> Self {
        let background = seen.background.unwrap_or([255; 3]);
        let counts: Vec<Count> = seen
            .counts
            .into_iter()
            .filter(|count| count.pixels > 0)
            .collect();
        let mut boxes = vec![(weight(&counts), counts)];
        while boxes.len() + 1 < most {
            // The first of equal boxes, so that the palette is deterministic.
            let heaviest = (0..boxes.len()).max_by_key(|i| (boxes[*i].0, std::cmp::Reverse(*i)));
            let Some((was, whole)) = heaviest
                .and_then(|i| boxes.get_mut(i))
                .filter(|(weight, _)| *weight > 0)
            else {
                break;
            };
            let half = split(whole);
            *was = weight(whole);
            boxes.push((weight(&half), half));
        }
        let mut colours = vec![background];
        colours.extend(
            boxes
                .iter()
                .filter(|(_, counts)| !counts.is_empty())
                .map(|(_, counts)| mean(counts)),
        );
        let mut nearest = vec![None; 1 << (3 * BITS)];
        nearest[key(background)] = Some(0);
        Self { colours, nearest }
    }

    /// Red, green, blue of all colours in sequence.
    pub fn bytes(&self) -> &[u8] {
        self.colours.as_flattened()
    }

    /// The number of colours.
    pub fn len(&self) -> usize {
        self.colours.len()
    }

    /// The index of the colour nearest to this one.
    pub fn index(&mut self, pixel: [u8; 3]) -> u8 {
        let distance = |colour: &[u8; 3]| -> u32 {
            // Green has the greatest weight for the eye, blue the least.
            [2, 4, 1]
                .iter()
                .zip(pixel.iter().zip(colour))
                .map(|(w, (a, b))| w * u32::from(a.abs_diff(*b)).pow(2))
                .sum()
        };
        *self.nearest[key(pixel)].get_or_insert_with(|| {
            let best = (0..self.colours.len())
                .min_by_key(|i| distance(&self.colours[*i]))
                .unwrap_or(0);
            u8::try_from(best).unwrap_or(u8::MAX)
        })
    }
}

fn key(pixel: [u8; 3]) -> usize {
    pixel
        .iter()
        .fold(0, |key, c| (key << BITS) | usize::from(c >> (8 - BITS)))
}

fn channel(count: &Count, k: usize) -> u64 {
    count.sum[k] / count.pixels.max(1)
}

fn mean(counts: &[Count]) -> [u8; 3] {
    let pixels: u64 = counts.iter().map(|c| c.pixels).sum();
    std::array::from_fn(|k| {
        (counts.iter().map(|c| c.sum[k]).sum::<u64>() / pixels.max(1)).min(255) as u8
    })
}

/// The gain of a cut through a box; 0 for a single colour.
fn weight(counts: &[Count]) -> u64 {
    let (_, extent) = longest(counts);
    extent * extent * counts.iter().map(|c| c.pixels).sum::<u64>().isqrt()
}

/// The channel with the greatest range of colours, and its range.
fn longest(counts: &[Count]) -> (usize, u64) {
    let spread = |k: usize| {
        let values = || counts.iter().map(move |c| channel(c, k));
        values().max().unwrap_or(0) - values().min().unwrap_or(0)
    };
    (0..3)
        .map(|k| (k, spread(k)))
        .max_by_key(|(_, spread)| *spread)
        .unwrap_or((0, 0))
}

/// Removes the upper half of the pixels from a box of at least two colours.
fn split(counts: &mut Vec<Count>) -> Vec<Count> {
    let (axis, _) = longest(counts);
    counts.sort_by_key(|c| channel(c, axis));
    let half = counts.iter().map(|c| c.pixels).sum::<u64>() / 2;
    let mut before = 0;
    let cut = counts.iter().take_while(|c| {
        before += c.pixels;
        before <= half
    });
    let cut = cut.count().clamp(1, counts.len() - 1);
    counts.split_off(cut)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_colours_are_kept_exactly_and_many_nearly() {
        let mut frame = Frame::plain(64, 64, [1.0; 3]);
        frame.rectangle(0..64, 32..64, [1.0, 0.0, 0.0]);
        let mut palette = Palette::of(std::slice::from_ref(&frame), 255);
        for pixel in [[255, 255, 255], [255, 0, 0]] {
            let index = usize::from(palette.index(pixel));
            assert_eq!(palette.colours[index], pixel);
        }
        for x in 0..64 {
            for y in 0..64 {
                frame.blend(x, y, [x as f32 / 63.0, y as f32 / 63.0, 0.5], 1.0);
            }
        }
        let mut palette = Palette::of(std::slice::from_ref(&frame), 255);
        assert!(palette.len() <= 255);
        for pixel in frame.pixels() {
            let index = usize::from(palette.index(*pixel));
            assert!(
                palette.colours[index]
                    .iter()
                    .zip(pixel)
                    .all(|(a, b)| a.abs_diff(*b) <= 16)
            );
        }
    }

    #[test]
    fn no_frames() {
        assert_eq!(Palette::of(&[], 255).index([255, 255, 255]), 0);
    }
}
