//! An explicit encoding of the inputs of a result: one line for each number, with its path and its
//! exact bits.
//!
//! A checkpoint's fingerprint is a hash of these lines. A study recognises its runs by them. Debug
//! text would change with the formatting of a dependency; these lines change with the values alone.
//!
//! ```
//! use pliant::testing::internals::encode::{Encode, text_of};
//!
//! assert_eq!(text_of("x", &[1.0, -0.0]), "x.count 2\nx.0 3ff0000000000000\nx.1 8000000000000000\n");
//! assert_eq!(text_of("name", "left"), "name \"left\"\n");
//! assert_eq!(text_of("limit", &None::<f64>), "limit none\n");
//! ```

use std::fmt::Write;
use std::path::PathBuf;

use nalgebra::{Isometry3, Point3, Unit, Vector3};

use crate::state::Hash;

/// Receives the lines of an encoding.
pub struct Encoder<'a> {
    to: &'a mut dyn Write,
    path: String,
}

/// A value that can be encoded.
pub trait Encode {
    /// Writes one line for each number, text or choice.
    fn encode(&self, to: &mut Encoder<'_>);
}

/// The lines of a value with a name.
#[must_use]
pub fn text_of(name: &str, value: &(impl Encode + ?Sized)) -> String {
    let mut text = String::new();
    Encoder::new(&mut text).field(name, value);
    text
}

/// The hash of the lines of a value.
#[must_use]
pub fn hash_of(value: &(impl Encode + ?Sized)) -> u128 {
    let mut hash = Hash::default();
    value.encode(&mut Encoder::new(&mut hash));
    hash.value()
}

impl<'a> Encoder<'a> {
    /// An encoder that writes its lines to a text or a hash.
    pub fn new(to: &'a mut dyn Write) -> Self {
        Self {
            to,
            path: String::new(),
        }
    }

    /// Encodes the value of a field.
    pub fn field(&mut self, name: &str, value: &(impl Encode + ?Sized)) {
        let length = self.path.len();
        if length > 0 {
            self.path.push('.');
        }
        self.path.push_str(name);
        value.encode(self);
        self.path.truncate(length);
    }

    /// Encodes which of several alternatives a value is.
    pub fn choice(&mut self, name: &str) {
        self.leaf(format_args!("{name}"));
    }

    fn leaf(&mut self, value: std::fmt::Arguments<'_>) {
        // Writing to a text or a hash never fails.
        let _ = writeln!(self.to, "{} {value}", self.path);
    }
}

impl Encode for f64 {
    fn encode(&self, to: &mut Encoder<'_>) {
        to.leaf(format_args!("{:016x}", self.to_bits()));
    }
}

impl Encode for bool {
    fn encode(&self, to: &mut Encoder<'_>) {
        to.choice(if *self { "true" } else { "false" });
    }
}

impl Encode for u32 {
    fn encode(&self, to: &mut Encoder<'_>) {
        to.leaf(format_args!("{self}"));
    }
}

impl Encode for usize {
    fn encode(&self, to: &mut Encoder<'_>) {
        to.leaf(format_args!("{self}"));
    }
}

impl Encode for str {
    fn encode(&self, to: &mut Encoder<'_>) {
        to.leaf(format_args!("\"{}\"", self.escape_default()));
    }
}

impl Encode for String {
    fn encode(&self, to: &mut Encoder<'_>) {
        self.as_str().encode(to);
    }
}

impl Encode for PathBuf {
    fn encode(&self, to: &mut Encoder<'_>) {
        let bytes = self.as_os_str().as_encoded_bytes();
        to.leaf(format_args!("\"{}\"", bytes.escape_ascii()));
    }
}

impl<T: Encode + ?Sized> Encode for &T {
    fn encode(&self, to: &mut Encoder<'_>) {
        (*self).encode(to);
    }
}

impl<T: Encode> Encode for Option<T> {
    fn encode(&self, to: &mut Encoder<'_>) {
        match self {
            Some(value) => value.encode(to),
            None => to.choice("none"),
        }
    }
}

impl<T: Encode> Encode for [T] {
    fn encode(&self, to: &mut Encoder<'_>) {
        to.field("count", &self.len());
        for (k, value) in self.iter().enumerate() {
            to.field(&k.to_string(), value);
        }
    }
}

impl<T: Encode> Encode for Vec<T> {
    fn encode(&self, to: &mut Encoder<'_>) {
        self.as_slice().encode(to);
    }
}

impl<T: Encode, const N: usize> Encode for [T; N] {
    fn encode(&self, to: &mut Encoder<'_>) {
        self.as_slice().encode(to);
    }
}

impl<A: Encode, B: Encode> Encode for (A, B) {
    fn encode(&self, to: &mut Encoder<'_>) {
        to.field("0", &self.0);
        to.field("1", &self.1);
    }
}

impl Encode for Point3<f64> {
    fn encode(&self, to: &mut Encoder<'_>) {
        self.coords.encode(to);
    }
}

impl Encode for Vector3<f64> {
    fn encode(&self, to: &mut Encoder<'_>) {
        for (name, value) in ["x", "y", "z"].into_iter().zip(self.iter()) {
            to.field(name, value);
        }
    }
}

impl Encode for Unit<Vector3<f64>> {
    fn encode(&self, to: &mut Encoder<'_>) {
        self.as_ref().encode(to);
    }
}

impl Encode for Isometry3<f64> {
    fn encode(&self, to: &mut Encoder<'_>) {
        to.field("translation", &self.translation.vector);
        let [i, j, k, w] = [
            self.rotation.i,
            self.rotation.j,
            self.rotation.k,
            self.rotation.w,
        ];
        to.field("rotation", &[i, j, k, w]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_bit_of_a_number_counts() {
        let x = 0.1 + 0.2;
        assert_ne!(hash_of(&x), hash_of(&0.3));
        assert_ne!(hash_of(&0.0), hash_of(&-0.0));
        assert_eq!(hash_of(&x), hash_of(&(0.1 + 0.2)));
    }

    #[test]
    fn what_differs_in_shape_alone_differs() {
        let texts = [
            text_of("a", &vec![vec![1u32], vec![2, 3]]),
            text_of("a", &vec![vec![1u32, 2], vec![3]]),
            text_of("a", &vec![1u32, 2, 3]),
            text_of("a", &(1u32, vec![2u32, 3])),
            text_of("a", "none"),
            text_of("a", &None::<u32>),
            text_of("a", "x\na none"),
        ];
        for (k, one) in texts.iter().enumerate() {
            assert!(texts[..k].iter().all(|other| other != one), "{one}");
        }
    }

    #[test]
    fn the_encoding_of_a_pose_is_fixed() {
        let pose = Isometry3::translation(1.0, 2.0, -0.5);
        let expected = "p.translation.x 3ff0000000000000\np.translation.y 4000000000000000\n\
            p.translation.z bfe0000000000000\np.rotation.count 4\np.rotation.0 0000000000000000\n\
            p.rotation.1 0000000000000000\np.rotation.2 0000000000000000\np.rotation.3 3ff0000000000000\n";
        assert_eq!(text_of("p", &pose), expected);
    }
}
