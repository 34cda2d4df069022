//! Bases of implants: outlines as maps of the unit disc, so that one mesh of rings serves all
//! shapes.

use nalgebra::Point2;

/// Ratio of width to length of an oval base.
const OVAL: f64 = 0.65;
/// Ratio of width to length of a rectangular base, and the exponent of its outline |x|^n + |y|^n =
/// 1.
const RECTANGULAR: f64 = 0.65;
const CORNERS: i32 = 6;
/// Ratio of width to length of a crescent along its arc, and half of the angle of that arc [rad].
const CRESCENT: f64 = 0.42;
const BEND: f64 = 1.0;

/// The shape of an implant's base.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BaseShape {
    /// A circle.
    Round,
    /// An ellipse, 0.65 times as wide as it is long.
    Oval,
    /// An oval bent along an arc.
    Crescent,
    /// A rectangle with rounded corners, 0.65 times as wide as it is long.
    Rectangular,
}

impl BaseShape {
    /// All shapes with their names.
    pub const ALL: [(&'static str, Self); 4] = [
        ("round", Self::Round),
        ("oval", Self::Oval),
        ("crescent", Self::Crescent),
        ("rectangular", Self::Rectangular),
    ];

    /// Name of the shape.
    pub fn name(self) -> &'static str {
        Self::ALL
            .iter()
            .find(|(_, shape)| *shape == self)
            .map_or("", |(name, _)| name)
    }

    /// The point of the base [m] for a point of the plane of the unit disc; `base` is its length
    /// [m].
    pub fn place(self, disc: Point2<f64>, base: f64) -> Point2<f64> {
        let half = 0.5 * base;
        match self {
            Self::Round => disc * half,
            Self::Oval => Point2::new(half * disc.x, OVAL * half * disc.y),
            Self::Rectangular => {
                let (radius, power) = (disc.coords.norm(), power_norm(disc));
                let stretch = if power > 0.0 { radius / power } else { 1.0 };
                Point2::new(
                    half * stretch * disc.x,
                    RECTANGULAR * half * stretch * disc.y,
                )
            }
            Self::Crescent => {
                // The chord of the arc with its two ends has the length `base`.
                let arc = half / libm::sin(BEND);
                let (angle, across) = (disc.x * BEND, arc * BEND * CRESCENT * disc.y);
                Point2::new(
                    (arc + across) * libm::sin(angle),
                    (arc + across) * libm::cos(angle) - arc,
                )
            }
        }
    }

    /// Relative distance of a point [m] from the centre, 1 on the outline of the base: the radius
    /// of its point of the disc.
    pub fn reach(self, place: Point2<f64>, base: f64) -> f64 {
        let half = 0.5 * base;
        match self {
            Self::Round => place.coords.norm() / half,
            Self::Oval => libm::hypot(place.x / half, place.y / (OVAL * half)),
            Self::Rectangular => {
                power_norm(Point2::new(place.x / half, place.y / (RECTANGULAR * half)))
            }
            Self::Crescent => {
                let arc = half / libm::sin(BEND);
                let up = place.y + arc;
                let angle = libm::atan2(place.x, up);
                let across = (libm::hypot(place.x, up) - arc) / (arc * BEND * CRESCENT);
                libm::hypot(angle / BEND, across)
            }
        }
    }
}

fn power_norm(p: Point2<f64>) -> f64 {
    libm::pow(
        p.x.abs().powi(CORNERS) + p.y.abs().powi(CORNERS),
        1.0 / f64::from(CORNERS),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reach_undoes_place() {
        for (name, shape) in BaseShape::ALL {
            for k in 0..40 {
                let (angle, radius) = (0.157 * f64::from(k), 0.03 * f64::from(k));
                let disc = Point2::new(radius * angle.cos(), radius * angle.sin());
                let reach = shape.reach(shape.place(disc, 0.07), 0.07);
                assert!(
                    (reach - radius).abs() <= 1e-12,
                    "{name}: {reach} for {radius}"
                );
            }
        }
    }

    #[test]
    fn the_base_is_as_long_as_it_says() {
        for (name, shape) in BaseShape::ALL {
            let ends = [-1.0, 1.0].map(|x| shape.place(Point2::new(x, 0.0), 0.07).x);
            assert!(
                (ends[1] - ends[0] - 0.07).abs() <= 1e-15,
                "{name}: {ends:?}"
            );
        }
    }
}
