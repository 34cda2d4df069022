//! A chain of frusta of equal length with constant volume: the radii follow from the length in
//! closed form.
//!
//! The nodes lie at equal distances on the axis. Node i has the radius r_i and the growth
//! multiplier m_i. At another length each radius changes by m_i s, with one s for all nodes, so
//! that the volume stays the volume at rest. This is a quadratic in s, and a cubic with hemispheres
//! at the ends. The coefficients are those of the corrected source (errata G1, G3 to G5, G7) and
//! belong to the state at rest. No drift accumulates over changes of length: the radii depend on
//! the length alone.

use std::f64::consts::PI;

/// Whether the constant volume contains the hemispheres at both ends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Caps {
    /// The ends are drawn round; the constant volume is that of the frusta, as in the source
    /// (erratum G8).
    #[default]
    Out,
    /// The volume contains the hemispheres.
    In,
}

/// Parameters of a chain at rest.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChainShape {
    /// Radii of the nodes at rest, from one end to the other \[m\].
    pub radii: Vec<f64>,
    /// Growth multiplier of each node, at least 0; the radius of a node with multiplier 0 is
    /// constant.
    pub growth: Vec<f64>,
    /// Distance between the first and the last node at rest \[m\].
    pub length: f64,
    /// Whether the hemispheres are part of the volume.
    pub caps: Caps,
}

/// Error of [`Chain::new`] and [`Chain::set_length`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ChainError {
    /// Fewer than two nodes.
    #[error("{0} nodes; a chain needs at least 2 radii")]
    Nodes(usize),
    /// The numbers of multipliers and radii differ.
    #[error("{growth} growth multipliers for {radii} radii; give one for each")]
    Lengths {
        /// Number of radii.
        radii: usize,
        /// Number of multipliers.
        growth: usize,
    },
    /// A radius or a multiplier is negative or NaN.
    #[error("{what} of node {node} is {value}; it must be a number of at least 0")]
    Negative {
        /// Names the radius or the multiplier.
        what: &'static str,
        /// Index of the node, from 1.
        node: usize,
        /// The rejected value.
        value: f64,
    },
    /// The length is not positive.
    #[error("a length of {0} m; it must be greater than 0")]
    Length(f64),
    /// All radii are 0.
    #[error("all radii are 0: there is no volume to keep")]
    Empty,
    /// No multiplier is positive.
    #[error(
        "no growth multiplier is greater than 0: no radius can change, so the volume cannot be kept at another length"
    )]
    Rigid,
    /// A radius would be negative.
    #[error(
        "at a length of {length} m the radius of node {node} would be negative; the chain can be stretched to {longest} m"
    )]
    TooLong {
        /// The requested length \[m\].
        length: f64,
        /// The node whose radius becomes negative first, from 1.
        node: usize,
        /// The greatest possible length \[m\].
        longest: f64,
    },
}

/// A chain at its present length.
#[derive(Clone, Debug, PartialEq)]
pub struct Chain {
    rest: ChainShape,
    /// Coefficients of the sum of the squares in s: A, B and C.
    square: [f64; 3],
    /// The smallest change s without a negative radius, and the node that limits it.
    least: (f64, usize),
    volume: f64,
    length: f64,
    radii: Vec<f64>,
}

/// Volume of the hemispheres at both ends, divided by pi \[m^3\].
fn caps(first: f64, last: f64) -> f64 {
    2.0 / 3.0 * (first.powi(3) + last.powi(3))
}

/// Sum over neighbours of (a_i b_i + (a_i b_j + a_j b_i)/2 + a_j b_j)/3.
fn paired(a: &[f64], b: &[f64]) -> f64 {
    let each = a.windows(2).zip(b.windows(2));
    each.map(|(a, b)| (a[0] * b[0] + 0.5 * (a[0] * b[1] + a[1] * b[0]) + a[1] * b[1]) / 3.0)
        .sum()
}

impl ChainShape {
    fn check(&self) -> Result<(), ChainError> {
        let Self {
            radii,
            growth,
            length,
            caps: _,
        } = self;
        if radii.len() < 2 {
            return Err(ChainError::Nodes(radii.len()));
        }
        if radii.len() != growth.len() {
            return Err(ChainError::Lengths {
                radii: radii.len(),
                growth: growth.len(),
            });
        }
        for (what, values) in [("the radius", radii), ("the growth multiplier", growth)] {
            if let Some(at) = values.iter().position(|v| !(v.is_finite() && *v >= 0.0)) {
                return Err(ChainError::Negative {
                    what,
                    node: at + 1,
                    value: values[at],
                });
            }
        }
        if !(length.is_finite() && *length > 0.0) {
            return Err(ChainError::Length(*length));
        }
        if radii.iter().all(|r| *r == 0.0) {
            return Err(ChainError::Empty);
        }
        Ok(())
    }

    /// The same body at rest with another resolution: inserts `count` nodes between each two
    /// neighbours, on straight lines.
    pub fn refined(&self, count: usize) -> Self {
        let parts = count + 1;
        let between = |values: &[f64]| {
            let mut all: Vec<f64> = values
                .windows(2)
                .flat_map(|v| {
                    (0..parts).map(move |k| v[0] + (v[1] - v[0]) * k as f64 / parts as f64)
                })
                .collect();
            all.extend(values.last());
            all
        };
        Self {
            radii: between(&self.radii),
            growth: between(&self.growth),
            ..self.clone()
        }
    }
}

impl Chain {
    /// Creates the chain at rest.
    ///
    /// # Errors
    /// An invalid shape: see [`ChainError`].
    pub fn new(rest: ChainShape) -> Result<Self, ChainError> {
        rest.check()?;
        let square = [
            paired(&rest.growth, &rest.growth),
            2.0 * paired(&rest.radii, &rest.growth),
            paired(&rest.radii, &rest.radii),
        ];
        let ratios = rest
            .radii
            .iter()
            .zip(&rest.growth)
            .enumerate()
            .filter(|(_, (_, m))| **m > 0.0);
        let least = ratios
            .map(|(i, (r, m))| (-r / m, i))
            .min_by(|a, b| b.0.total_cmp(&a.0));
        let mut chain = Self {
            square,
            least: least.unwrap_or((0.0, 0)),
            volume: 0.0,
            length: rest.length,
            radii: rest.radii.clone(),
            rest,
        };
        chain.volume = chain.volume_now();
        Ok(chain)
    }

    /// The parameters at rest.
    pub fn rest(&self) -> &ChainShape {
        &self.rest
    }

    /// Distance between the first and the last node \[m\].
    pub fn length(&self) -> f64 {
        self.length
    }

    /// Distance between neighbours \[m\].
    pub fn spacing(&self) -> f64 {
        self.length / (self.radii.len() - 1) as f64
    }

    /// Radii at the present length \[m\].
    pub fn radii(&self) -> &[f64] {
        &self.radii
    }

    /// The volume at rest, which stays constant \[m^3\].
    pub fn volume(&self) -> f64 {
        self.volume
    }

    /// The volume of the present radii and length, computed again from them \[m^3\].
    pub fn volume_now(&self) -> f64 {
        let (first, last) = (self.radii[0], self.radii[self.radii.len() - 1]);
        let ends = if self.rest.caps == Caps::In {
            caps(first, last)
        } else {
            0.0
        };
        PI * (self.spacing() * paired(&self.radii, &self.radii) + ends)
    }

    /// The length at which the first radius becomes 0 \[m\]; infinite if no radius ever does.
    pub fn longest(&self) -> f64 {
        let s = self.least.0;
        let (frusta, ends) = self.volume_over_pi(s);
        let room = self.volume / PI - ends;
        if frusta <= 0.0 {
            f64::INFINITY
        } else {
            room / frusta * (self.radii.len() - 1) as f64
        }
    }

    /// Radius of a node at a change s [m]; rounding can make it negative.
    fn radius_at(&self, node: usize, s: f64) -> f64 {
        self.rest.radii[node] + self.rest.growth[node] * s
    }

    /// Sum of the squares of all frusta, and the volume of the caps divided by pi, at a change s.
    fn volume_over_pi(&self, s: f64) -> (f64, f64) {
        let [a, b, c] = self.square;
        let n = self.radii.len();
        let ends = if self.rest.caps == Caps::In {
            caps(self.radius_at(0, s), self.radius_at(n - 1, s))
        } else {
            0.0
        };
        ((a * s + b) * s + c, ends)
    }

    /// Sets another length; the radii follow. After an error the chain is unchanged.
    ///
    /// # Errors
    /// An invalid length, or a length at which no radii of at least 0 keep the volume.
    pub fn set_length(&mut self, length: f64) -> Result<(), ChainError> {
        if !(length.is_finite() && length > 0.0) {
            return Err(ChainError::Length(length));
        }
        if length == self.rest.length {
            self.length = length;
            self.radii.copy_from_slice(&self.rest.radii);
            return Ok(());
        }
        if self.square[0] == 0.0 {
            return Err(ChainError::Rigid);
        }
        let s = self.change(length).filter(|s| *s >= self.least.0);
        let Some(s) = s else {
            return Err(ChainError::TooLong {
                length,
                node: self.least.1 + 1,
                longest: self.longest(),
            });
        };
        self.length = length;
        for ((radius, r), m) in self
            .radii
            .iter_mut()
            .zip(&self.rest.radii)
            .zip(&self.rest.growth)
        {
            // At the limit, rounding can give a slightly negative radius.
            *radius = (r + m * s).max(0.0);
        }
        Ok(())
    }

    /// The change s that keeps the volume constant at a length.
    fn change(&self, length: f64) -> Option<f64> {
        let [a, b, c] = self.square;
        let spacing = length / (self.radii.len() - 1) as f64;
        if self.rest.caps == Caps::Out {
            // Avoids the difference of nearly equal numbers; exactly 0 where nothing changes
            // (errata G5, G7).
            let lack = c * (self.rest.length / length - 1.0);
            let root = b * b + 4.0 * a * lack;
            return (root >= 0.0 && b + root.sqrt() > 0.0).then(|| 2.0 * lack / (b + root.sqrt()));
        }
        self.change_with_caps(spacing)
    }

    /// The change s with hemispheres. The cubic rises and is convex wherever no radius is negative,
    /// so Newton's method converges to the root from the right.
    fn change_with_caps(&self, spacing: f64) -> Option<f64> {
        let [a, b, _] = self.square;
        let n = self.radii.len();
        let target = self.volume / PI;
        let value = |s: f64| {
            let (frusta, ends) = self.volume_over_pi(s);
            spacing * frusta + ends - target
        };
        let slope = |s: f64| {
            let [first, last] =
                [0, n - 1].map(|i| 2.0 * self.rest.growth[i] * self.radius_at(i, s).powi(2));
            spacing * (2.0 * a * s + b) + first + last
        };
        if value(self.least.0) > 0.0 {
            return None;
        }
        // The root for the frusta alone is at least as large.
        let volume_of_frusta = target / spacing;
        let mut s = 2.0 * volume_of_frusta / (b + (b * b + 4.0 * a * volume_of_frusta).sqrt());
        for _ in 0..200 {
            let next = (s - value(s) / slope(s)).max(self.least.0);
            if !(next < s) {
                return s.is_finite().then_some(s);
            }
            s = next;
        }
        Some(s)
    }
}
