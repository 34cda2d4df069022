//! Compressed blocks of VTK XML: zlib by `miniz_oxide`, lz4 by `lz4_flex`, LZMA by `lzma-rust2`.
//!
//! All three are in safe Rust. None returns more than the declared size.

use std::io::Read;

use super::encoded::{Compressor, Fault};

/// Greatest number of bytes that one byte of each compression can decompress to, by its format.
/// LZMA has no such bound.
const ZLIB_GAIN: u64 = 1032;
const LZ4_GAIN: u64 = 255;

/// Decompressed size of an lz4 block [bytes], from the lengths of its literals and matches; `None`
/// for a damaged block.
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

/// A number of four bits. Further bytes follow if it is 15.
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

/// Decompresses a block with the declared size `size` [bytes]. The memory is proportional to the
/// actual data.
pub(super) fn decompress(
    compressor: Compressor,
    bytes: &[u8],
    size: usize,
) -> Result<Vec<u8>, Fault> {
    let gain = |gain: u64| {
        let possible = (bytes.len() as u64).saturating_mul(gain).saturating_add(64);
        let declared = size as u64;
        if declared > possible {
            Err(Fault::TooMany { declared, possible })
        } else {
            Ok(())
        }
    };
    match compressor {
        Compressor::Zlib => {
            gain(ZLIB_GAIN)?;
            miniz_oxide::inflate::decompress_to_vec_zlib_with_limit(bytes, size)
                .map_err(|_| Fault::Expected("undamaged zlib data of the declared size"))
        }
        Compressor::Lz4 => {
            gain(LZ4_GAIN)?;
            // Reserving the declared size without this test would let a small file allocate 255
            // times its size.
            if lz4_length(bytes) != Some(size) {
                return Err(Fault::Expected("undamaged lz4 data of the declared size"));
            }
            let mut block = vec![0; size];
            let length = lz4_flex::block::decompress_into(bytes, &mut block)
                .map_err(|_| Fault::Expected("undamaged lz4 data of the declared size"))?;
            block.truncate(length);
            Ok(block)
        }
        Compressor::Lzma => {
            let mut block = Vec::new();
            // One additional byte reveals a stream that is longer than declared. At that point its
            // end and its checksum have been read.
            let mut stream = lzma_rust2::XzReader::new(bytes, false).take(size as u64 + 1);
            stream
                .read_to_end(&mut block)
                .map_err(|_| Fault::Expected("undamaged LZMA data of the declared size"))?;
            Ok(block)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the block if it has the declared size.
    fn exactly(compressor: Compressor, bytes: &[u8], size: usize) -> Result<Vec<u8>, Fault> {
        let block = decompress(compressor, bytes, size)?;
        if block.len() == size {
            Ok(block)
        } else {
            Err(Fault::Expected("a block of the declared size"))
        }
    }

    /// `v I J` on 60 lines with I = i mod 7 and J = i * i mod 11, by liblzma with CRC64.
    const LINES: &[u8] = b"\xfd\x37\x7a\x58\x5a\x00\x00\x04\xe6\xd6\xb4\x46\x02\x00\x21\x01\x16\x00\x00\x00\x74\x2f\xe5\xa3\xe0\x01\x67\x00\x62\x5d\x00\x3b\x08\x02\x10\x02\x0a\x80\x54\x52\xdf\x18\xa7\x58\xa0\xb2\x40\x00\x24\xe3\x68\xe7\x50\x9d\x1f\x92\xb0\xaf\x9b\xbd\x95\xd5\x7d\x62\x16\x37\xd9\x76\x24\xa6\x4d\xdc\x7e\xdb\x3a\x49\x96\xee\x5f\x07\x7e\xa3\xfa\x60\xe2\x4b\xa3\x38\x00\x30\xce\x78\x01\xef\x87\x8d\xd2\xb6\x5d\x8d\x5a\x50\xba\xfe\xdf\xab\xfb\x1b\x9e\x80\x40\xce\x26\xc1\xb6\xb1\xf8\xf5\xb3\x09\x70\xcb\xe1\xba\x47\x82\xbd\x63\xa0\x00\x00\x00\xcc\x24\xa8\x40\x88\x05\x8d\xcf\x00\x01\x7e\xe8\x02\x00\x00\x00\xf9\xfc\xd0\x40\xb1\xc4\x67\xfb\x02\x00\x00\x00\x00\x04\x59\x5a";

    /// The bytes from 0 to 39, which compression does not shorten, by liblzma with CRC32.
    const BYTES: &[u8] = b"\xfd\x37\x7a\x58\x5a\x00\x00\x01\x69\x22\xde\x36\x02\x00\x21\x01\x0c\x00\x00\x00\x8f\x98\x41\x9c\x01\x00\x27\x00\x01\x02\x03\x04\x05\x06\x07\x08\x09\x0a\x0b\x0c\x0d\x0e\x0f\x10\x11\x12\x13\x14\x15\x16\x17\x18\x19\x1a\x1b\x1c\x1d\x1e\x1f\x20\x21\x22\x23\x24\x25\x26\x27\x00\x3c\x2e\xa6\x0d\x00\x01\x3c\x28\x2e\x64\xc0\x66\x90\x42\x99\x0d\x01\x00\x00\x00\x00\x01\x59\x5a";

    fn lines() -> Vec<u8> {
        (0..60)
            .flat_map(|i| format!("v {} {}\n", i % 7, i * i % 11).into_bytes())
            .collect()
    }

    fn decode(bytes: &[u8], size: usize) -> Result<Vec<u8>, Fault> {
        exactly(Compressor::Lzma, bytes, size)
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
    fn a_match_of_lz4_before_the_block_is_refused() {
        let decode = |offset: u8| {
            // One letter, a match of four bytes at this distance, five letters.
            let bytes = [0x10, b'a', offset, 0, 0x50, b'b', b'c', b'd', b'e', b'f'];
            exactly(Compressor::Lz4, &bytes, 10)
        };
        assert_eq!(decode(1), Ok(b"aaaaabcdef".to_vec()));
        assert_eq!(
            decode(2),
            Err(Fault::Expected("undamaged lz4 data of the declared size"))
        );
    }
}
