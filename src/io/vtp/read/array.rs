//! The arrays of a piece of VTK XML polydata, and their numbers.

use std::borrow::Cow;

/// The type of the numbers of an array.
#[derive(Clone, Copy)]
pub(super) enum Kind {
    Signed(usize),
    Unsigned(usize),
    Float,
    Double,
}

impl Kind {
    pub fn parse(word: &[u8]) -> Option<Self> {
        Some(match word {
            b"Int8" => Kind::Signed(1),
            b"Int16" => Kind::Signed(2),
            b"Int32" => Kind::Signed(4),
            b"Int64" => Kind::Signed(8),
            b"UInt8" => Kind::Unsigned(1),
            b"UInt16" => Kind::Unsigned(2),
            b"UInt32" => Kind::Unsigned(4),
            b"UInt64" => Kind::Unsigned(8),
            b"Float32" => Kind::Float,
            b"Float64" => Kind::Double,
            _ => return None,
        })
    }

    pub fn bytes(self) -> usize {
        match self {
            Kind::Signed(n) | Kind::Unsigned(n) => n,
            Kind::Float => 4,
            Kind::Double => 8,
        }
    }
}

/// Location of the numbers of an array.
#[derive(Clone, Copy)]
pub(super) enum Stored<'a> {
    Text(&'a [u8]),
    Base64(&'a [u8]),
    Appended(u64),
}

/// An array before it is read.
#[derive(Clone, Copy)]
pub(super) struct Array<'a> {
    pub kind: Kind,
    pub stored: Stored<'a>,
    pub tag: &'a [u8],
    pub slot: Slot,
    /// Index of its piece, from 1.
    pub piece: usize,
}

impl Array<'_> {
    /// Name in errors.
    pub fn describe(&self) -> String {
        let section = |i: usize| SECTIONS.get(i).map_or("", |(_, _, name)| name);
        let piece = self.piece;
        match self.slot {
            Slot::Points => format!("the array of Points of piece {piece}"),
            Slot::Corners(i) => format!("the connectivity of {} of piece {piece}", section(i)),
            Slot::Ends(i) => format!("the offsets of {} of piece {piece}", section(i)),
            Slot::Data => format!("an array of PointData of piece {piece}"),
        }
    }
}

/// The kinds of cells, in the order of the sections of a piece.
pub(super) const SECTIONS: [(&[u8], &str, &str); 3] = [
    (b"Lines", "NumberOfLines", "Lines"),
    (b"Strips", "NumberOfStrips", "Strips"),
    (b"Polys", "NumberOfPolys", "Polys"),
];

/// The arrays of a piece and its declared numbers of points and cells.
///
/// An empty piece is small: a file can consist of almost nothing but pieces.
#[derive(Default)]
pub(super) struct Piece<'a> {
    pub point_count: Option<u64>,
    pub counts: [Option<u64>; 3],
    pub arrays: Vec<Array<'a>>,
}

/// Content of an array; cells by the index of their section.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Slot {
    Points,
    Corners(usize),
    Ends(usize),
    /// Numbers at the points, which the surface does not use.
    Data,
}

impl<'a> Piece<'a> {
    pub fn get(&self, slot: Slot) -> Option<Array<'a>> {
        self.arrays.iter().find(|array| array.slot == slot).copied()
    }
}

/// The numbers of an array.
pub(super) struct Numbers<'a> {
    pub array: Array<'a>,
    pub values: Values<'a>,
    /// Place for errors.
    pub place: usize,
    pub text: bool,
}

pub(super) enum Values<'a> {
    Bytes {
        bytes: Cow<'a, [u8]>,
        kind: Kind,
        big_endian: bool,
    },
    Whole(Vec<i64>),
    Real(Vec<f64>),
}

impl Numbers<'_> {
    pub fn len(&self) -> usize {
        match &self.values {
            Values::Bytes { bytes, kind, .. } => bytes.len() / kind.bytes(),
            Values::Whole(values) => values.len(),
            Values::Real(values) => values.len(),
        }
    }

    /// The bits of a number and its type; `None` for a number of text.
    pub fn word(&self, i: usize) -> Option<(u64, Kind)> {
        let Values::Bytes {
            bytes,
            kind,
            big_endian,
        } = &self.values
        else {
            return None;
        };
        let bytes = &bytes[i * kind.bytes()..][..kind.bytes()];
        let fold = |word: u64, &b: &u8| word << 8 | u64::from(b);
        Some((
            if *big_endian {
                bytes.iter().fold(0, fold)
            } else {
                bytes.iter().rev().fold(0, fold)
            },
            *kind,
        ))
    }

    pub fn real(&self, i: usize) -> f64 {
        match (&self.values, self.word(i)) {
            (_, Some((word, Kind::Float))) => f64::from(f32::from_bits(word as u32)),
            (_, Some((word, Kind::Double))) => f64::from_bits(word),
            (Values::Real(values), _) => values[i],
            _ => self.whole(i) as f64,
        }
    }

    pub fn whole(&self, i: usize) -> i64 {
        match (&self.values, self.word(i)) {
            (_, Some((word, Kind::Signed(bytes)))) => {
                (word << (64 - 8 * bytes)) as i64 >> (64 - 8 * bytes)
            }
            // A number that needs 64 bits is no index of this file, and neither is a real number.
            (_, Some((word, Kind::Unsigned(_)))) => i64::try_from(word).unwrap_or(i64::MAX),
            (Values::Whole(values), _) => values[i],
            _ => i64::MAX,
        }
    }
}
