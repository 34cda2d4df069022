//! The buckling law of cloth: a strip that bends under compression and has no other resistance.

use super::spring_set::{Law, SpringSet};
use crate::constraints::spring::SpringLaw;

/// Greatest number of Newton steps for the angle of an arc; the function is smooth and monotonic,
/// so few are needed.
const STEPS: usize = 60;

/// A strip that buckles under compression \[choi2002\], between points at distance two in a grid of
/// cloth.
///
/// Below the length `rest` the strip bends to an arc of its own length: curvature
/// `kappa = (2/l) sinc^-1(|x|/l)`, energy `B l kappa^2/2`, tension
/// `B kappa^2/(cos(kappa l/2) - sinc(kappa l/2))`, which is negative. This law jumps to the
/// buckling load `12 B/l^2` at the first shortening. Up to that load a spring of stiffness
/// `compression` is weaker and applies instead. Above the length `rest` there is no force;
/// structural springs resist extension.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Buckling {
    /// Rest length l [m], positive.
    pub rest: f64,
    /// Bending stiffness B [N m2].
    pub bending: f64,
    /// Stiffness before buckling [N/m].
    pub compression: f64,
}

/// Springs with the buckling law.
pub type Strips = SpringSet<Buckling>;

/// `sin y/y`.
fn sinc(y: f64) -> f64 {
    if y.abs() < 1e-4 {
        1.0 - y * y / 6.0
    } else {
        libm::sin(y) / y
    }
}

/// `cos y - sinc y`.
fn cos_less_sinc(y: f64) -> f64 {
    if y.abs() < 1e-2 {
        -y * y / 3.0 * (1.0 - y * y / 10.0)
    } else {
        libm::cos(y) - sinc(y)
    }
}

impl Buckling {
    /// Half the angle of an arc whose chord is this share of its length.
    fn half_angle(share: f64) -> f64 {
        // At most a full circle: the ends of the strip coincide.
        let (mut low, mut high) = (0.0, std::f64::consts::PI);
        for _ in 0..STEPS {
            let middle = 0.5 * (low + high);
            if sinc(middle) > share {
                low = middle
            } else {
                high = middle
            }
        }
        0.5 * (low + high)
    }

    /// True if the strip is shorter than the length at which both laws give the same force.
    fn is_buckled(&self, length: f64) -> bool {
        self.arc_tension(length) > self.compression * (length - self.rest)
    }

    fn arc_tension(&self, length: f64) -> f64 {
        let y = Self::half_angle(length / self.rest);
        let curvature = 2.0 * y / self.rest;
        // Near the straight strip both parts vanish; the limit is the buckling load.
        if y < 1e-6 {
            return -12.0 * self.bending / (self.rest * self.rest);
        }
        self.bending * curvature * curvature / cos_less_sinc(y)
    }
}

impl Law for Buckling {
    const NAME: &'static str = "buckling strips";

    fn parameters(&self) -> [f64; 3] {
        [self.rest, self.bending, self.compression]
    }

    fn is_valid(&self) -> bool {
        let finite = self.parameters().iter().all(|p| p.is_finite());
        finite && self.rest > 0.0 && self.bending >= 0.0 && self.compression >= 0.0
    }
}

impl SpringLaw for Buckling {
    fn energy(&self, length: f64) -> f64 {
        if length >= self.rest {
            return 0.0;
        }
        let spring =
            |length: f64| 0.5 * self.compression * (self.rest - length) * (self.rest - length);
        if !self.is_buckled(length) {
            return spring(length);
        }
        let arc = |length: f64| {
            let curvature = 2.0 * Self::half_angle(length / self.rest) / self.rest;
            0.5 * self.bending * self.rest * curvature * curvature
        };
        // The spring up to the buckling length, then the arc: the tension is continuous, and so is
        // the energy.
        let (mut low, mut high) = (length, self.rest);
        for _ in 0..STEPS {
            let middle = 0.5 * (low + high);
            if self.is_buckled(middle) {
                low = middle
            } else {
                high = middle
            }
        }
        spring(high) + arc(length) - arc(high)
    }

    fn tension(&self, length: f64) -> f64 {
        if length >= self.rest {
            0.0
        } else {
            self.arc_tension(length)
                .max(self.compression * (length - self.rest))
        }
    }

    fn slope(&self, length: f64) -> f64 {
        if length >= self.rest {
            0.0
        } else if self.is_buckled(length) {
            let h = 1e-5 * self.rest;
            let below = (length - h).max(0.0);
            (self.arc_tension(length + h) - self.arc_tension(below)) / (length + h - below)
        } else {
            self.compression
        }
    }
}
