//! The bytes of the arrays of VTK XML: raw or base64, uncompressed or in compressed blocks.
//!
//! [`decompress`](super::decompress) unpacks the blocks.

use std::borrow::Cow;

#[cfg(feature = "compression")]
use super::decompress::decompress;

/// Compression of the blocks of an array.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Compressor {
    Zlib,
    Lz4,
    Lzma,
}

/// Attributes of a file that define the layout of its arrays.
#[derive(Clone, Copy)]
pub(super) struct Layout {
    pub(super) big_endian: bool,
    /// Size of a number in the header of an array [bytes].
    pub(super) header_bytes: usize,
    /// `None` for uncompressed bytes.
    pub(super) compressor: Option<Compressor>,
    /// Greatest total size of all arrays [bytes].
    pub(super) limit: u64,
}

/// Error in the bytes of an array.
#[derive(Debug, PartialEq)]
pub(super) enum Fault {
    /// The file has fewer bytes.
    Short,
    /// Another item is expected here.
    Expected(&'static str),
    /// The declared size exceeds that of the file.
    TooMany { declared: u64, possible: u64 },
    /// The size exceeds the limit.
    TooLarge { bytes: u64 },
}

/// The value of each letter of base64; 255 for other bytes.
const VALUES: [u8; 256] = {
    let letters = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut values = [255; 256];
    let mut i = 0;
    while i < letters.len() {
        values[letters[i] as usize] = i as u8;
        i += 1;
    }
    values
};

/// Encoded bytes, read from the front.
pub(super) struct Source<'a> {
    text: &'a [u8],
    base64: bool,
    /// Decoded, unread bytes of the last group of base64.
    left: Vec<u8>,
    start: usize,
}

impl<'a> Source<'a> {
    pub(super) fn new(text: &'a [u8], base64: bool) -> Self {
        Self {
            text,
            base64,
            left: Vec::new(),
            start: text.len(),
        }
    }

    /// Number of encoded bytes read.
    pub(super) fn used(&self) -> usize {
        self.start - self.text.len()
    }

    /// Upper bound of the remaining bytes.
    fn room(&self) -> usize {
        if self.base64 {
            self.left.len() + self.text.len() / 4 * 3
        } else {
            self.text.len()
        }
    }

    fn take(&mut self, count: usize) -> Result<Cow<'a, [u8]>, Fault> {
        if count > self.room() {
            return Err(Fault::Short);
        }
        if !self.base64 {
            let (taken, rest) = self.text.split_at(count);
            self.text = rest;
            return Ok(Cow::Borrowed(taken));
        }
        let mut taken = Vec::with_capacity(count + 2);
        taken.append(&mut self.left);
        while taken.len() < count {
            self.plain_groups(&mut taken, count);
            if taken.len() < count {
                self.group(&mut taken)?;
            }
        }
        self.left = taken.split_off(count);
        Ok(Cow::Owned(taken))
    }

    /// Decodes letters in groups of four, up to another byte or until there are `count` bytes.
    fn plain_groups(&mut self, out: &mut Vec<u8>, count: usize) {
        while out.len() < count
            && let Some((letters, rest)) = self.text.split_first_chunk::<4>()
        {
            let values = letters.map(|letter| u32::from(VALUES[usize::from(letter)]));
            if values.iter().any(|&value| value > 63) {
                return;
            }
            let word = values.iter().fold(0, |word, value| word << 6 | value);
            out.extend_from_slice(&word.to_be_bytes()[1..]);
            self.text = rest;
        }
    }

    /// Decodes four letters. White space between them is skipped; `=` ends a stream, and another
    /// stream can follow.
    fn group(&mut self, out: &mut Vec<u8>) -> Result<(), Fault> {
        let (mut word, mut letters, mut padding) = (0u32, 0, 0);
        while letters < 4 {
            let (&letter, rest) = self.text.split_first().ok_or(Fault::Short)?;
            self.text = rest;
            let value = match VALUES[usize::from(letter)] {
                value @ 0..64 => value,
                _ if letter == b'=' && letters >= 2 => {
                    padding += 1;
                    0
                }
                _ if letter.is_ascii_whitespace() => continue,
                _ => return Err(Fault::Expected("base64")),
            };
            if padding > 0 && letter != b'=' {
                return Err(Fault::Expected("base64 that ends with its padding"));
            }
            word = word << 6 | u32::from(value);
            letters += 1;
        }
        out.extend_from_slice(&word.to_be_bytes()[1..4 - padding]);
        Ok(())
    }

    /// A number of the header of an array.
    fn number(&mut self, layout: Layout) -> Result<u64, Fault> {
        let bytes = self.take(layout.header_bytes)?;
        let fold = |word: u64, &b: &u8| word << 8 | u64::from(b);
        Ok(if layout.big_endian {
            bytes.iter().fold(0, fold)
        } else {
            bytes.iter().rev().fold(0, fold)
        })
    }

    /// The bytes of an array, decompressed.
    pub(super) fn array(&mut self, layout: Layout) -> Result<Cow<'a, [u8]>, Fault> {
        if let Some(compressor) = layout.compressor {
            return self.blocks(layout, compressor).map(Cow::Owned);
        }
        let count = self.number(layout)?;
        let possible = self.room() as u64;
        match usize::try_from(count) {
            Ok(count) if count as u64 <= possible => self.take(count),
            _ => Err(Fault::TooMany {
                declared: count,
                possible,
            }),
        }
    }

    /// Compressed array: number of blocks, size of each block, size of a shorter last block, all
    /// compressed sizes.
    fn blocks(&mut self, layout: Layout, compressor: Compressor) -> Result<Vec<u8>, Fault> {
        let blocks = self.number(layout)?;
        if blocks == 0 {
            return Ok(Vec::new());
        }
        let (size, last) = (self.number(layout)?, self.number(layout)?);
        let possible = self.room() as u64 / layout.header_bytes as u64;
        if blocks > possible {
            return Err(Fault::TooMany {
                declared: blocks,
                possible,
            });
        }
        let full = if last == 0 { blocks } else { blocks - 1 };
        let total = size
            .checked_mul(full)
            .and_then(|n| n.checked_add(last))
            .unwrap_or(u64::MAX);
        if last > size || total > layout.limit {
            return Err(Fault::TooLarge { bytes: total });
        }
        let packed = (0..blocks)
            .map(|_| self.number(layout))
            .collect::<Result<Vec<u64>, Fault>>()?;
        // The header is a separate stream of base64 with its own padding.
        self.left.clear();
        let mut out = Vec::new();
        for (i, &packed) in packed.iter().enumerate() {
            let size_of_block = if (i as u64) < full { size } else { last };
            let bytes = self.take(usize::try_from(packed).map_err(|_| Fault::Short)?)?;
            unpack(compressor, &bytes, size_of_block as usize, &mut out)?;
        }
        Ok(out)
    }
}

/// Decompresses a block of a declared size and appends it to `out`.
fn unpack(
    compressor: Compressor,
    bytes: &[u8],
    size_of_block: usize,
    out: &mut Vec<u8>,
) -> Result<(), Fault> {
    let block = decompress(compressor, bytes, size_of_block)?;
    if block.len() != size_of_block {
        return Err(Fault::Expected("a block of the declared size"));
    }
    if out.is_empty() {
        *out = block
    } else {
        out.extend_from_slice(&block)
    }
    Ok(())
}

/// A build without the feature `compression` reads no compressed block.
#[cfg(not(feature = "compression"))]
fn decompress(_: Compressor, _: &[u8], _: usize) -> Result<Vec<u8>, Fault> {
    Err(Fault::Expected(
        "uncompressed data: this build has no decompression (feature `compression`)",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAIN: Layout = Layout {
        big_endian: false,
        header_bytes: 4,
        compressor: None,
        limit: 1 << 20,
    };

    #[test]
    fn base64_with_padding_inside_and_white_space() {
        let mut source = Source::new(b"AwAA AA==YWJj\nZGU=", true);
        assert_eq!(&*source.array(PLAIN).unwrap(), b"abc");
        assert_eq!(source.take(2).unwrap().as_ref(), b"de");
        assert_eq!(source.used(), 18);
        for wrong in [&b"AwAAAA"[..], b"AwA*AA==", b"A=AA", b"AwAAAA=A"] {
            assert!(Source::new(wrong, true).array(PLAIN).is_err());
        }
    }

    #[test]
    fn blocks_follow_one_another_and_the_last_may_be_shorter() {
        let all: Vec<u8> = (0..250).collect();
        let array = |last: u32, parts: &[&[u8]]| {
            let packed: Vec<Vec<u8>> = parts
                .iter()
                .map(|part| miniz_oxide::deflate::compress_to_vec_zlib(part, 6))
                .collect();
            let head = [parts.len() as u32, 100, last]
                .into_iter()
                .chain(packed.iter().map(|part| part.len() as u32));
            let bytes = [head.flat_map(u32::to_le_bytes).collect(), packed.concat()].concat();
            let layout = Layout {
                compressor: Some(Compressor::Zlib),
                ..PLAIN
            };
            Source::new(&bytes, false)
                .array(layout)
                .map(Cow::into_owned)
        };
        assert_eq!(
            array(50, &[&all[..100], &all[100..200], &all[200..]]).as_ref(),
            Ok(&all)
        );
        assert_eq!(
            array(0, &[&all[..100], &all[100..200]]).as_deref(),
            Ok(&all[..200])
        );
        let other = Err(Fault::Expected("a block of the declared size"));
        assert_eq!(array(50, &[&all[..99], &all[99..149]]), other);
        assert_eq!(array(50, &[&all[..100], &all[100..149]]), other);
    }

    #[test]
    fn sizes_that_cannot_be_are_refused() {
        let zlib = Layout {
            compressor: Some(Compressor::Zlib),
            ..PLAIN
        };
        let words = |words: &[u32]| {
            words
                .iter()
                .flat_map(|w| w.to_le_bytes())
                .collect::<Vec<u8>>()
        };
        let array = |w: &[u32], layout| {
            Source::new(&words(w), false)
                .array(layout)
                .map(Cow::into_owned)
        };
        assert_eq!(
            array(&[9, 0], PLAIN),
            Err(Fault::TooMany {
                declared: 9,
                possible: 4
            })
        );
        assert_eq!(array(&[0], zlib), Ok(Vec::new()));
        assert_eq!(
            array(&[9, 1, 0, 0], zlib),
            Err(Fault::TooMany {
                declared: 9,
                possible: 1
            })
        );
        assert_eq!(
            array(&[1, 1 << 21, 0, 4, 0], zlib),
            Err(Fault::TooLarge { bytes: 1 << 21 })
        );
        assert!(matches!(
            array(&[1, 1 << 20, 0, 4, 0], zlib),
            Err(Fault::TooMany { .. })
        ));
        assert_eq!(array(&[1, 8, 0, 400, 0], zlib), Err(Fault::Short));
        for compressor in [Compressor::Zlib, Compressor::Lz4, Compressor::Lzma] {
            assert!(
                array(
                    &[1, 8, 0, 4, 0xffff_ffff],
                    Layout {
                        compressor: Some(compressor),
                        ..PLAIN
                    }
                )
                .is_err()
            );
        }
    }
}
