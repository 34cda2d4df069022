//! How the lists of values of a study become combinations.

/// How lists of values become combinations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Combine {
    /// Every value of a list with every value of the others.
    #[default]
    All,
    /// The scene with its fixed changes, and each value of each list alone.
    OneAtATime,
}

impl Combine {
    /// All of them, as a study file names them.
    pub const ALL: [Self; 2] = [Self::All, Self::OneAtATime];

    /// As a study file names it.
    pub fn name(self) -> &'static str {
        match self {
            Self::All => "all",
            Self::OneAtATime => "one at a time",
        }
    }
}
