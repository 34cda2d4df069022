//! Neighbourhoods of lattice points.

/// Number of neighbours of a lattice point with springs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Neighbours {
    /// The nearest along each axis: preserves lengths, not the shape.
    Six,
    /// The nearest along each axis and across each face of a cell: preserves the shape.
    Eighteen,
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
    /// All kinds.
    pub const ALL: [Self; 3] = [Self::Six, Self::Eighteen, Self::TwentySix];

    /// The kind with this number.
    #[must_use]
    pub fn of_count(count: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.count() == count)
    }

    /// The number: 6, 18 or 26.
    pub fn count(self) -> u32 {
        match self {
            Self::Six => 6,
            Self::Eighteen => 18,
            Self::TwentySix => 26,
        }
    }

    /// Steps along x, y and z to half of them; the others are their opposites.
    pub(super) fn half(self) -> &'static [[i32; 3]] {
        match self {
            Self::Six => &HALF[..3],
            Self::Eighteen => &HALF[..9],
            Self::TwentySix => &HALF,
        }
    }

    /// Exact number of springs of a lattice with these numbers of points along x, y and z. For n^3
    /// points and 6 neighbours 3 n^2 (n - 1); for 18 neighbours additionally 6 n (n - 1)^2; for 26
    /// neighbours 4 (n - 1)^3 more.
    pub fn springs(self, points: [usize; 3]) -> usize {
        let along = |step: &[i32; 3]| -> usize {
            (0..3)
                .map(|k| points[k].saturating_sub(step[k].unsigned_abs() as usize))
                .product()
        };
        self.half().iter().map(along).sum()
    }
}
