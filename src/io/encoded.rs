//! The bytes of the arrays of VTK XML: raw or base64, uncompressed or in compressed blocks.
//!
//! `miniz_oxide` reads zlib, `lz4_flex` lz4 and `lzma-rust2` LZMA, all in safe Rust and with a
//! limit on their output.

use std::borrow::Cow;
use std::io::Read;

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

/// Greatest ratio of output to input bytes of each compression, by its format; LZMA has none.
const ZLIB_GAIN: u64 = 1032;
const LZ4_GAIN: u64 = 255;

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
            let wanted = if (i as u64) < full { size } else { last };
            let bytes = self.take(usize::try_from(packed).map_err(|_| Fault::Short)?)?;
            unpack(compressor, &bytes, wanted as usize, &mut out)?;
        }
        Ok(out)
    }
}

/// Output size of a block of lz4, from the lengths of its literals and matches; `None` for a
/// damaged block.
fn lz4_length(mut bytes: &[u8]) -> Option<usize> {
    let mut total = 0usize;
    loop {
        let (&token, rest) = bytes.split_first()?;
        let (literals, rest) = lz4_number(token >> 4, rest)?;
        total = total.checked_add(literals)?;
        // No match follows the last literals.
        let rest = rest.get(literals..)?;
        if rest.is_empty() {
            return Some(total);
        }
        let (length, rest) = lz4_number(token & 15, rest.get(2..)?)?;
        total = total.checked_add(length)?.checked_add(4)?;
        bytes = rest;
    }
}

/// A number of four bits, continued in further bytes if it is 15.
fn lz4_number(first: u8, mut bytes: &[u8]) -> Option<(usize, &[u8])> {
    let mut number = usize::from(first);
    if first < 15 {
        return Some((number, bytes));
    }
    loop {
        let (&more, rest) = bytes.split_first()?;
        number = number.checked_add(usize::from(more))?;
        bytes = rest;
        if more < 255 {
            return Some((number, bytes));
        }
    }
}

/// Decompresses a block of a declared size and appends it to `out`.
fn unpack(
    compressor: Compressor,
    bytes: &[u8],
    wanted: usize,
    out: &mut Vec<u8>,
) -> Result<(), Fault> {
    let gain = |gain: u64| {
        let possible = (bytes.len() as u64).saturating_mul(gain).saturating_add(64);
        let declared = wanted as u64;
        if declared > possible {
            Err(Fault::TooMany { declared, possible })
        } else {
            Ok(())
        }
    };
    let block = match compressor {
        Compressor::Zlib => {
            gain(ZLIB_GAIN)?;
            miniz_oxide::inflate::decompress_to_vec_zlib_with_limit(bytes, wanted)
                .map_err(|_| Fault::Expected("undamaged zlib data of the declared size"))?
        }
        Compressor::Lz4 => {
            gain(LZ4_GAIN)?;
            // A check before the reservation: otherwise a small file could reserve 255 times its
            // size.
            if lz4_length(bytes) != Some(wanted) {
                return Err(Fault::Expected("undamaged lz4 data of the declared size"));
            }
            let mut block = vec![0; wanted];
            let length = lz4_flex::block::decompress_into(bytes, &mut block)
                .map_err(|_| Fault::Expected("undamaged lz4 data of the declared size"))?;
            block.truncate(length);
            block
        }
        Compressor::Lzma => {
            let mut block = Vec::new();
            // One extra byte detects a stream longer than declared; its end and checksum are read
            // by then.
            let mut stream = lzma_rust2::XzReader::new(bytes, false).take(wanted as u64 + 1);
            stream
                .read_to_end(&mut block)
                .map_err(|_| Fault::Expected("undamaged LZMA data of the declared size"))?;
            block
        }
    };
    if block.len() != wanted {
        return Err(Fault::Expected("a block of the declared size"));
    }
    if out.is_empty() {
        *out = block
    } else {
        out.extend_from_slice(&block)
    }
    Ok(())
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

    /// `v I J` on 60 lines with I = i mod 7 and J = i * i mod 11, by liblzma with CRC64.
    const LINES: &[u8] = b"\xfd\x37\x7a\x58\x5a\x00\x00\x04\xe6\xd6\xb4\x46\x02\x00\x21\x01\x16\x00\x00\x00\x74\x2f\xe5\xa3\xe0\x01\x67\x00\x62\x5d\x00\x3b\x08\x02\x10\x02\x0a\x80\x54\x52\xdf\x18\xa7\x58\xa0\xb2\x40\x00\x24\xe3\x68\xe7\x50\x9d\x1f\x92\xb0\xaf\x9b\xbd\x95\xd5\x7d\x62\x16\x37\xd9\x76\x24\xa6\x4d\xdc\x7e\xdb\x3a\x49\x96\xee\x5f\x07\x7e\xa3\xfa\x60\xe2\x4b\xa3\x38\x00\x30\xce\x78\x01\xef\x87\x8d\xd2\xb6\x5d\x8d\x5a\x50\xba\xfe\xdf\xab\xfb\x1b\x9e\x80\x40\xce\x26\xc1\xb6\xb1\xf8\xf5\xb3\x09\x70\xcb\xe1\xba\x47\x82\xbd\x63\xa0\x00\x00\x00\xcc\x24\xa8\x40\x88\x05\x8d\xcf\x00\x01\x7e\xe8\x02\x00\x00\x00\xf9\xfc\xd0\x40\xb1\xc4\x67\xfb\x02\x00\x00\x00\x00\x04\x59\x5a";

    /// The bytes from 0 to 39, which do not compress, by liblzma with CRC32.
    const BYTES: &[u8] = b"\xfd\x37\x7a\x58\x5a\x00\x00\x01\x69\x22\xde\x36\x02\x00\x21\x01\x0c\x00\x00\x00\x8f\x98\x41\x9c\x01\x00\x27\x00\x01\x02\x03\x04\x05\x06\x07\x08\x09\x0a\x0b\x0c\x0d\x0e\x0f\x10\x11\x12\x13\x14\x15\x16\x17\x18\x19\x1a\x1b\x1c\x1d\x1e\x1f\x20\x21\x22\x23\x24\x25\x26\x27\x00\x3c\x2e\xa6\x0d\x00\x01\x3c\x28\x2e\x64\xc0\x66\x90\x42\x99\x0d\x01\x00\x00\x00\x00\x01\x59\x5a";

    fn lines() -> Vec<u8> {
        (0..60)
            .flat_map(|i| format!("v {} {}\n", i % 7, i * i % 11).into_bytes())
            .collect()
    }

    fn decode(bytes: &[u8], wanted: usize) -> Result<Vec<u8>, Fault> {
        let mut out = Vec::new();
        unpack(Compressor::Lzma, bytes, wanted, &mut out).map(|()| out)
    }

    #[test]
    fn what_another_encoder_of_lzma_wrote_is_decoded() {
        assert_eq!(decode(LINES, lines().len()).unwrap(), lines());
        assert_eq!(decode(BYTES, 40).unwrap(), (0..40).collect::<Vec<u8>>());
    }

    #[test]
    fn damage_of_lzma_is_found() {
        assert!(decode(LINES, lines().len() - 1).is_err());
        assert!(decode(LINES, lines().len() + 1).is_err());
        for bytes in [LINES, BYTES] {
            let size = if bytes == LINES { lines().len() } else { 40 };
            for bit in 0..8 * bytes.len() {
                let mut changed = bytes.to_vec();
                changed[bit / 8] ^= 1 << (bit % 8);
                if let Ok(out) = decode(&changed, size) {
                    assert_eq!(out, decode(bytes, size).unwrap(), "bit {bit}");
                }
                let _ = decode(&bytes[..bit / 8], size);
            }
        }
    }

    #[test]
    fn the_length_of_lz4_is_known_before_it_is_unpacked() {
        let mut noise = 1u32;
        let mut next = || {
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (noise >> 24) as u8
        };
        for length in (0..40).chain([270, 271, 5000, 70_000]) {
            let mixed: Vec<u8> = (0..length)
                .map(|i| if i % 700 < 300 { next() } else { 7 })
                .collect();
            for bytes in [vec![0; length], mixed] {
                let packed = lz4_flex::compress(&bytes);
                assert_eq!(lz4_length(&packed), Some(length));
                for end in 0..packed.len() {
                    let cut = lz4_length(&packed[..end]);
                    assert!(
                        cut.is_none_or(|n| n <= length),
                        "{end} of {length}: {cut:?}"
                    );
                }
            }
        }
        assert_eq!(lz4_length(b""), None);
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
    fn a_match_of_lz4_before_the_block_is_refused() {
        let decode = |offset: u8| {
            // One letter, a match of four bytes at this distance, five letters.
            let bytes = [0x10, b'a', offset, 0, 0x50, b'b', b'c', b'd', b'e', b'f'];
            let mut out = Vec::new();
            unpack(Compressor::Lz4, &bytes, 10, &mut out).map(|()| out)
        };
        assert_eq!(decode(1), Ok(b"aaaaabcdef".to_vec()));
        assert_eq!(
            decode(2),
            Err(Fault::Expected("undamaged lz4 data of the declared size"))
        );
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
