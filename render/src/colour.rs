//! Colours and colour maps.

/// A colour: red, green, blue in 0..1, in the sRGB space of a screen.
pub type Rgb = [f32; 3];

/// Colour for a field without a value: a grey that no map contains.
pub const NO_VALUE: Rgb = [0.55, 0.55, 0.55];

/// Muscle, for surfaces without a field.
pub const MUSCLE: Rgb = [0.76, 0.31, 0.27];

/// Bone.
pub const BONE: Rgb = [0.91, 0.86, 0.74];

/// Fibres on a muscle.
pub const FIBRE: Rgb = [0.99, 0.91, 0.83];

/// Map from numbers to colours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColourMap {
    /// Dark blue, green, yellow: lightness increases uniformly, so equal steps of the field look
    /// equal and a grey print keeps the order. For fields without a special middle.
    #[default]
    Viridis,
    /// Blue, light grey, red. For fields with a zero in the middle of their range, such as strain.
    Diverging,
}

/// Viridis at 16 equal steps; linear interpolation differs from the full table by less than is
/// visible.
const VIRIDIS: [u32; 16] = [
    0x44_01_54, 0x48_1a_6c, 0x47_2f_7d, 0x41_44_87, 0x39_56_8c, 0x31_68_8e, 0x2a_78_8e, 0x23_88_8e,
    0x1f_98_8b, 0x22_a8_84, 0x35_b7_79, 0x54_c5_68, 0x7a_d1_51, 0xa5_db_36, 0xd2_e2_1b, 0xfd_e7_25,
];

/// Cool to warm at 9 equal steps: lightness increases to the middle and decreases symmetrically.
const DIVERGING: [u32; 9] = [
    0x3b_4c_c0, 0x62_82_ea, 0x8d_b0_fe, 0xb8_d0_f9, 0xdd_dd_dd, 0xf5_c4_ad, 0xf4_9a_7b, 0xde_60_4d,
    0xb4_04_26,
];

impl ColourMap {
    /// The colour at `t` in 0..1; outside, the colour of the nearer end; for NaN, [`NO_VALUE`].
    pub fn colour(self, t: f64) -> Rgb {
        if t.is_nan() {
            return NO_VALUE;
        }
        let anchors: &[u32] = match self {
            Self::Viridis => &VIRIDIS,
            Self::Diverging => &DIVERGING,
        };
        let last = anchors.len() - 1;
        let along = t.clamp(0.0, 1.0) * last as f64;
        let step = (along as usize).min(last - 1);
        let blend = (along - step as f64) as f32;
        let (from, to) = (unpack(anchors[step]), unpack(anchors[step + 1]));
        std::array::from_fn(|k| from[k] + (to[k] - from[k]) * blend)
    }

    /// Position of `value` in `range`, 0 at its start and 1 at its end; NaN if the value or the
    /// range is NaN. A value on a range of zero width is in the middle.
    pub fn place(value: f64, range: (f64, f64)) -> f64 {
        let (start, end) = range;
        if start == end {
            return match value.partial_cmp(&start) {
                Some(std::cmp::Ordering::Less) => 0.0,
                Some(std::cmp::Ordering::Equal) => 0.5,
                Some(std::cmp::Ordering::Greater) => 1.0,
                None => f64::NAN,
            };
        }
        // Halves: the width of a range from -f64::MAX to f64::MAX is not finite.
        (value / 2.0 - start / 2.0) / (end / 2.0 - start / 2.0)
    }
}

fn unpack(hex: u32) -> Rgb {
    let [_, red, green, blue] = hex.to_be_bytes();
    [red, green, blue].map(|byte| f32::from(byte) / 255.0)
}

/// The bytes of a colour, rounded.
pub(super) fn quantise(colour: Rgb) -> [u8; 3] {
    // `as` saturates and maps NaN to 0, as intended.
    colour.map(|c| (c * 255.0 + 0.5) as u8)
}

/// The mix `from (1 - amount) + to amount`.
pub(super) fn mix(from: Rgb, to: Rgb, amount: f32) -> Rgb {
    std::array::from_fn(|k| from[k] + (to[k] - from[k]) * amount)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// CIE lightness of an sRGB colour, 0 to 100.
    fn lightness(colour: Rgb) -> f64 {
        let linear = colour.map(|c| {
            let c = f64::from(c);
            if c <= 0.04045 {
                c / 12.92
            } else {
                ((c + 0.055) / 1.055).powf(2.4)
            }
        });
        let y = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
        116.0
            * if y > 0.008856 {
                y.cbrt()
            } else {
                7.787 * y + 16.0 / 116.0
            }
            - 16.0
    }

    #[test]
    fn viridis_gets_lighter_in_even_steps() {
        let steps: Vec<f64> = (0..=20)
            .map(|i| lightness(ColourMap::Viridis.colour(f64::from(i) / 20.0)))
            .collect();
        let mean = (steps[20] - steps[0]) / 20.0;
        for pair in steps.windows(2) {
            let step = pair[1] - pair[0];
            assert!(
                step > 0.75 * mean && step < 1.25 * mean,
                "step {step}, mean {mean}"
            );
        }
    }

    #[test]
    fn diverging_is_lightest_in_the_middle_and_even_at_both_ends() {
        let at = |t| lightness(ColourMap::Diverging.colour(t));
        for i in 0..10 {
            let t = f64::from(i) / 20.0;
            assert!(at(t) < at(t + 0.05));
            assert!(at(1.0 - t) < at(0.95 - t));
            assert!((at(t) - at(1.0 - t)).abs() < 8.0);
        }
    }

    #[test]
    fn every_number_has_a_colour() {
        for map in [ColourMap::Viridis, ColourMap::Diverging] {
            assert_eq!(map.colour(f64::NAN), NO_VALUE);
            assert_eq!(map.colour(f64::INFINITY), map.colour(1.0));
            assert_eq!(map.colour(-1e300), map.colour(0.0));
        }
    }

    #[test]
    fn places_in_hard_ranges() {
        assert_eq!(ColourMap::place(0.0, (-f64::MAX, f64::MAX)), 0.5);
        assert_eq!(ColourMap::place(3.0, (3.0, 3.0)), 0.5);
        assert_eq!(ColourMap::place(4.0, (3.0, 3.0)), 1.0);
        assert_eq!(ColourMap::place(0.25, (1.0, 0.0)), 0.75);
        assert!(ColourMap::place(f64::NAN, (0.0, 1.0)).is_nan());
        assert!(ColourMap::place(1.0, (0.0, f64::NAN)).is_nan());
    }
}
