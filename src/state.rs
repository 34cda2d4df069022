//! State as bytes: the data of later steps, written and read bit by bit.
//!
//! Numbers are little-endian, floating-point numbers by their bits; a list is its length as 64
//! bits, then its entries. A reader accepts any bytes: it rejects those that do not fit, and
//! reserves no memory beyond their number.

use nalgebra::{Point3, Vector3};

/// Error of bytes that are no valid state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("byte {at} of the state: {what}")]
pub struct DecodeError {
    /// Read position from the beginning of the state.
    pub at: usize,
    /// Description of the error.
    pub what: &'static str,
}

/// An object whose state changes from step to step. Data from the constructor, or computed anew in
/// every step, are not saved.
///
/// Implementations destructure themselves without `..`, so that a later field must be saved or
/// named as not saved.
pub trait State {
    /// Appends the state.
    fn save(&self, to: &mut Writer);
    /// Restores the state that [`Self::save`] wrote; `self` must come from the same inputs as the
    /// saved object.
    ///
    /// # Errors
    /// The bytes are no such state; `self` must not be used afterwards.
    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError>;
}

/// A value that its bytes determine completely.
pub trait Value: Sized {
    /// Least number of bytes; not zero.
    const MIN_BYTES: usize;
    /// Appends its bytes.
    fn encode(&self, to: &mut Writer);
    /// Reads the value.
    ///
    /// # Errors
    /// The bytes end, or are no such value.
    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError>;
}

/// Appends state to bytes.
#[derive(Clone, Debug, Default)]
pub struct Writer {
    /// All bytes so far.
    pub bytes: Vec<u8>,
}

impl Writer {
    /// Appends a value.
    pub fn put(&mut self, value: &impl Value) {
        value.encode(self);
    }

    /// Appends a list.
    pub fn list<T: Value>(&mut self, values: &[T]) {
        self.put(&values.len());
        values.iter().for_each(|value| value.encode(self));
    }
}

/// Reads state from the front of bytes.
#[derive(Clone, Debug)]
pub struct Reader<'a> {
    rest: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    /// Reads `bytes` from the beginning.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes, at: 0 }
    }

    /// An error at this position.
    pub fn corrupt(&self, what: &'static str) -> DecodeError {
        DecodeError { at: self.at, what }
    }

    /// `Ok` if a condition holds, otherwise an error at this position.
    ///
    /// # Errors
    /// The condition does not hold.
    pub fn check(&self, holds: bool, what: &'static str) -> Result<(), DecodeError> {
        if holds {
            Ok(())
        } else {
            Err(self.corrupt(what))
        }
    }

    /// The next `count` bytes.
    ///
    /// # Errors
    /// Fewer bytes remain.
    pub fn slice(&mut self, count: usize) -> Result<&'a [u8], DecodeError> {
        let (head, rest) = self
            .rest
            .split_at_checked(count)
            .ok_or(self.corrupt("the bytes end here"))?;
        self.rest = rest;
        self.at += count;
        Ok(head)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], DecodeError> {
        let mut array = [0; N];
        array.copy_from_slice(self.slice(N)?);
        Ok(array)
    }

    /// The next value.
    ///
    /// # Errors
    /// The bytes end, or are no such value.
    pub fn take<T: Value>(&mut self) -> Result<T, DecodeError> {
        T::decode(self)
    }

    /// The length of a list of values of at least `least` bytes each, limited by the remaining
    /// bytes.
    fn length(&mut self, least: usize) -> Result<usize, DecodeError> {
        let count = self.take::<usize>()?;
        self.check(count <= self.rest.len() / least, "more entries than bytes")?;
        Ok(count)
    }

    /// Reads a list of known length into a slice.
    ///
    /// # Errors
    /// Another length, or invalid values.
    pub fn fill<T: Value>(&mut self, values: &mut [T]) -> Result<(), DecodeError> {
        let count = self.length(T::MIN_BYTES)?;
        self.check(count == values.len(), "a list of another length")?;
        for value in values {
            *value = self.take()?;
        }
        Ok(())
    }

    /// A list of `count` values.
    ///
    /// # Errors
    /// Another length, or invalid values.
    pub fn exactly<T: Value>(&mut self, count: usize) -> Result<Vec<T>, DecodeError> {
        let values = self.take::<Vec<T>>()?;
        self.check(values.len() == count, "a list of another length")?;
        Ok(values)
    }

    /// Checks that nothing remains.
    ///
    /// # Errors
    /// Some bytes remain.
    pub fn end(self) -> Result<(), DecodeError> {
        self.check(self.rest.is_empty(), "bytes behind the end")
    }
}

macro_rules! numbers {
    ($($kind:ty),*) => {$(
        impl Value for $kind {
            const MIN_BYTES: usize = size_of::<$kind>();
            fn encode(&self, to: &mut Writer) {
                to.bytes.extend_from_slice(&self.to_le_bytes());
            }
            fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
                Ok(Self::from_le_bytes(from.array()?))
            }
        }
    )*};
}

numbers!(u8, u32, u64, u128, f64);

impl Value for usize {
    const MIN_BYTES: usize = 8;
    fn encode(&self, to: &mut Writer) {
        (*self as u64).encode(to);
    }
    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        let number: u64 = from.take()?;
        usize::try_from(number).map_err(|_| from.corrupt("a number too large for this machine"))
    }
}

impl Value for bool {
    const MIN_BYTES: usize = 1;
    fn encode(&self, to: &mut Writer) {
        u8::from(*self).encode(to);
    }
    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        match u8::decode(from)? {
            0 => Ok(false),
            1 => Ok(true),
            _ => Err(from.corrupt("neither yes nor no")),
        }
    }
}

impl<T: Value, const N: usize> Value for [T; N] {
    const MIN_BYTES: usize = T::MIN_BYTES * N;
    fn encode(&self, to: &mut Writer) {
        self.iter().for_each(|value| value.encode(to));
    }
    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        let values: Vec<T> = (0..N).map(|_| T::decode(from)).collect::<Result<_, _>>()?;
        // Exactly `N` values were read.
        values
            .try_into()
            .map_err(|_| from.corrupt("the bytes end here"))
    }
}

impl Value for Vector3<f64> {
    const MIN_BYTES: usize = 24;
    fn encode(&self, to: &mut Writer) {
        self.iter().for_each(|c| c.encode(to));
    }
    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        Ok(Self::new(from.take()?, from.take()?, from.take()?))
    }
}

impl Value for Point3<f64> {
    const MIN_BYTES: usize = 24;
    fn encode(&self, to: &mut Writer) {
        self.coords.encode(to);
    }
    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        Ok(Self::from(from.take::<Vector3<f64>>()?))
    }
}

impl<A: Value, B: Value> Value for (A, B) {
    const MIN_BYTES: usize = A::MIN_BYTES + B::MIN_BYTES;
    fn encode(&self, to: &mut Writer) {
        self.0.encode(to);
        self.1.encode(to);
    }
    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        Ok((from.take()?, from.take()?))
    }
}

impl<T: Value> Value for Option<T> {
    const MIN_BYTES: usize = 1;
    fn encode(&self, to: &mut Writer) {
        self.is_some().encode(to);
        if let Some(value) = self {
            value.encode(to);
        }
    }
    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        Ok(if from.take()? {
            Some(from.take()?)
        } else {
            None
        })
    }
}

impl<T: Value> Value for Vec<T> {
    const MIN_BYTES: usize = 8;
    fn encode(&self, to: &mut Writer) {
        to.list(self);
    }
    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        let count = from.length(T::MIN_BYTES)?;
        let mut values = Self::with_capacity(count);
        for _ in 0..count {
            values.push(from.take()?);
        }
        Ok(values)
    }
}

impl Value for String {
    const MIN_BYTES: usize = 8;
    fn encode(&self, to: &mut Writer) {
        self.len().encode(to);
        to.bytes.extend_from_slice(self.as_bytes());
    }
    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        let count = from.length(1)?;
        let bytes = from.slice(count)?;
        std::str::from_utf8(bytes)
            .map(str::to_owned)
            .map_err(|_| from.corrupt("a text that is not UTF-8"))
    }
}

/// FNV-1a with 128 bits, over bytes or over formatted text: any single changed byte changes the
/// hash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hash(u128);

impl Default for Hash {
    fn default() -> Self {
        Self(0x6c62_272e_07bb_0142_62b8_2175_6295_c58d)
    }
}

impl Hash {
    /// The hash of bytes.
    pub fn of(bytes: &[u8]) -> u128 {
        let mut hash = Self::default();
        hash.add(bytes);
        hash.value()
    }

    /// Adds bytes.
    pub fn add(&mut self, bytes: &[u8]) {
        // The prime is 2^88 + 0x13b.
        bytes
            .iter()
            .for_each(|b| self.0 = (self.0 ^ u128::from(*b)).wrapping_mul((1 << 88) + 0x13b));
    }

    /// The hash so far.
    pub fn value(self) -> u128 {
        self.0
    }
}

impl std::fmt::Write for Hash {
    fn write_str(&mut self, text: &str) -> std::fmt::Result {
        self.add(text.as_bytes());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type All = (
        Vec<(u32, f64)>,
        (Option<[Point3<f64>; 2]>, (String, (bool, Vec<Vec<usize>>))),
    );

    fn example() -> All {
        let point = Point3::new(-0.0, f64::MIN_POSITIVE / 8.0, f64::INFINITY);
        (
            vec![(7, 0.1), (u32::MAX, -1e300)],
            (
                Some([point; 2]),
                ("fémur".into(), (true, vec![vec![], vec![1, 2]])),
            ),
        )
    }

    #[test]
    fn values_come_back_with_their_bits() {
        let mut writer = Writer::default();
        writer.put(&example());
        let mut reader = Reader::new(&writer.bytes);
        let back: All = reader.take().unwrap();
        assert_eq!(reader.end(), Ok(()));
        let mut again = Writer::default();
        again.put(&back);
        assert_eq!(again.bytes, writer.bytes);
        assert_eq!(back.1.1.0, "fémur");
        // NaN keeps its payload.
        let odd = f64::from_bits(0x7ff8_0000_dead_beef);
        let mut writer = Writer::default();
        writer.put(&odd);
        assert_eq!(
            Reader::new(&writer.bytes).take::<f64>().unwrap().to_bits(),
            odd.to_bits()
        );
    }

    #[test]
    fn every_prefix_is_refused_and_nothing_may_follow() {
        let mut writer = Writer::default();
        writer.put(&example());
        for end in 0..writer.bytes.len() {
            assert!(
                Reader::new(&writer.bytes[..end]).take::<All>().is_err(),
                "{end} bytes"
            );
        }
        writer.put(&0u8);
        let mut reader = Reader::new(&writer.bytes);
        assert!(reader.take::<All>().is_ok());
        assert_eq!(reader.end().unwrap_err().what, "bytes behind the end");
    }

    #[test]
    fn counts_are_checked_before_memory_is_taken() {
        let many = [u64::MAX.to_le_bytes(), [0; 8]].concat();
        assert_eq!(
            Reader::new(&many).take::<Vec<f64>>().unwrap_err().what,
            "more entries than bytes"
        );
        assert_eq!(
            Reader::new(&many).take::<String>().unwrap_err().what,
            "more entries than bytes"
        );
        let two = [2u64.to_le_bytes(), [0; 8], [0; 8]].concat();
        assert_eq!(
            Reader::new(&two).fill(&mut [0.0; 3]).unwrap_err().what,
            "a list of another length"
        );
        assert_eq!(
            Reader::new(&two).exactly::<f64>(3).unwrap_err().what,
            "a list of another length"
        );
        assert_eq!(Reader::new(&two).exactly::<f64>(2).unwrap(), [0.0; 2]);
        assert_eq!(
            Reader::new(&[2]).take::<bool>().unwrap_err().what,
            "neither yes nor no"
        );
    }

    #[test]
    fn the_hash_is_that_of_its_authors() {
        // Their test vectors.
        assert_eq!(Hash::of(b""), 0x6c62_272e_07bb_0142_62b8_2175_6295_c58d);
        assert_eq!(Hash::of(b"a"), 0xd228_cb69_6f1a_8caf_7891_2b70_4e4a_8964);
        assert_eq!(
            Hash::of(b"foobar"),
            0x343e_1662_793c_64bf_6f0d_3597_ba44_6f18
        );
    }
}
