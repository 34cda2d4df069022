//! Text in pictures, from a rasterised monospaced font.

use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};

use super::colour::Rgb;
use super::frame::Frame;

/// Size and weight of text.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TextStyle {
    /// Lines of 16 px.
    #[default]
    Small,
    /// Lines of 20 px.
    Large,
    /// Lines of 20 px, bold.
    Title,
}

impl TextStyle {
    fn font(self) -> (FontWeight, RasterHeight) {
        match self {
            Self::Small => (FontWeight::Regular, RasterHeight::Size16),
            Self::Large => (FontWeight::Regular, RasterHeight::Size20),
            Self::Title => (FontWeight::Bold, RasterHeight::Size20),
        }
    }

    /// Height of a line \[px\].
    pub fn height(self) -> i64 {
        self.font().1.val() as i64
    }

    /// Width of a text \[px\].
    pub fn width(self, text: &str) -> i64 {
        let (weight, size) = self.font();
        (text.chars().count().min(MOST_CHARACTERS) * get_raster_width(weight, size)) as i64
    }
}

/// Longer text leaves every picture.
const MOST_CHARACTERS: usize = 4096;

/// Colour of titles.
const INK: Rgb = [0.16, 0.17, 0.19];

impl Frame {
    /// Writes a title into the upper left corner, on a brightened background.
    pub fn title(&mut self, text: &str, style: TextStyle) {
        let (left, top) = (12, 10);
        self.pale(
            left - 4..left + style.width(text) + 4,
            top - 2..top + style.height() + 2,
        );
        self.text(left, top, text, style, INK);
    }

    /// Writes a line of text with its upper left corner at a column and row \[px\], clipped to the
    /// picture. A character missing from the font (it has the Latin ones) becomes `?`.
    pub fn text(&mut self, column: i64, row: i64, text: &str, style: TextStyle, colour: Rgb) {
        let (weight, size) = style.font();
        let advance = get_raster_width(weight, size) as i64;
        let mut left = column;
        for character in text.chars().take(MOST_CHARACTERS) {
            let Some(glyph) =
                get_raster(character, weight, size).or_else(|| get_raster('?', weight, size))
            else {
                continue;
            };
            for (down, line) in (0..).zip(glyph.rows()) {
                for (across, intensity) in (0..).zip(line) {
                    if *intensity > 0 {
                        let (x, y): (i64, i64) =
                            (left.saturating_add(across), row.saturating_add(down));
                        self.blend(x, y, colour, f32::from(*intensity) / 255.0);
                    }
                }
            }
            left = left.saturating_add(advance);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ink(text: &str, column: i64, row: i64) -> usize {
        let mut frame = Frame::plain(120, 24, [1.0; 3]);
        frame.text(column, row, text, TextStyle::Small, [0.0; 3]);
        frame.pixels().iter().filter(|p| p[0] < 128).count()
    }

    #[test]
    fn a_title_can_be_read_on_dark_ground() {
        let mut frame = Frame::plain(120, 40, [0.15, 0.1, 0.3]);
        frame.title("over", TextStyle::Title);
        let bright = frame.pixels().iter().filter(|p| p[0] > 200).count();
        let dark = frame
            .pixels()
            .iter()
            .filter(|p| p[0] < 60 && p[2] < 60)
            .count();
        assert!(bright > 300 && dark > 50, "{bright} {dark}");
        assert_eq!(
            frame.pixel(118, 38),
            Frame::plain(1, 1, [0.15, 0.1, 0.3]).pixel(0, 0)
        );
    }

    #[test]
    fn text_leaves_ink_and_stays_in_the_picture() {
        assert!(ink("Strain [%]", 2, 2) > 100);
        assert_eq!(ink("", 2, 2), 0);
        assert_eq!(ink("far away", i64::MAX - 3, i64::MIN), 0);
        assert!(ink("cut off", -10, -4) > 0);
        assert_eq!(ink("\u{4e2d}", 2, 2), ink("?", 2, 2));
        assert_eq!(
            TextStyle::Small.width("abc"),
            3 * TextStyle::Small.width("a")
        );
    }
}
