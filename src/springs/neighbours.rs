//! Neighbourhoods of lattice points.

/// Number of neighbours of a lattice point with springs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Neighbours {
    /// The nearest along each axis: preserves lengths, not the shape.
    Six,
    /// All around, including diagonals: preserves the shape.
    TwentySix,
}

/// Half of the 26 neighbours, sorted by distance; the others are their opposites.
const HALF: [[i32; 3]; 13] = [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
    [1, 1, 0],
    [1, -1, 0],
    [1, 0, 1],
    [1, 0, -1],
    [0, 1, 1],
    [0, 1, -1],
    [1, 1, 1],
    [1, 1, -1],
    [1, -1, 1],
    [1, -1, -1],
];

impl Neighbours {
    /// The number: 6 or 26.
    pub fn count(self) -> u32 {
        match self {
            Self::Six => 6,
            Self::TwentySix => 26,
        }
    }

    /// Steps along x, y and z to half of them; the others are their opposites.
    pub(super) fn half(self) -> &'static [[i32; 3]] {
        match self {
            Self::Six => &HALF[..3],
            Self::TwentySix => &HALF,
        }
    }

    /// Exact number of springs of a lattice with these numbers of points along x, y and z. For n^3
    /// points and 6 neighbours 3 n^2 (n - 1); for 26 neighbours additionally 6 n (n - 1)^2 + 4 (n -
    /// 1)^3.
    pub fn springs(self, points: [usize; 3]) -> usize {
        let along = |step: &[i32; 3]| -> usize {
            (0..3)
                .map(|k| points[k].saturating_sub(step[k].unsigned_abs() as usize))
                .product()
        };
        self.half().iter().map(along).sum()
    }
}
