//! VTP files whose compressed arrays are arbitrary bytes; the surrounding parts are corrected,
//! since most mutations would make them invalid.

use super::loaders::{Breach, LoadOutcome, check_reader};
use crate::io::read_bytes;

/// Compressor names, indexed by the lowest two bits of the first byte.
const COMPRESSORS: [&str; 4] = [
    "vtkZLibDataCompressor",
    "vtkLZ4DataCompressor",
    "vtkLZMADataCompressor",
    "",
];

/// An `.xz` stream without a data check around chunks of LZMA2, with a correct index and footer.
pub(super) fn xz(chunks: &[u8]) -> Vec<u8> {
    let mut stream = b"\xfd7zXZ\0\0\0\xff\x12\xd9\x41".to_vec();
    // Three words: no optional sizes, LZMA2 with a dictionary of 64 KiB, padding, CRC32.
    let header = b"\x02\x00\x21\x01\x08\0\0\0\xd8\x0f\x23\x13";
    stream.extend(header);
    stream.extend(chunks);
    stream.resize(stream.len().next_multiple_of(4), 0);
    // One block: its size, and an uncompressed size that no reader compares.
    let mut index = vec![0, 1];
    let mut size = header.len() + chunks.len();
    while size >= 128 {
        index.push((size & 127) as u8 | 128);
        size >>= 7;
    }
    index.extend([size as u8, 1]);
    index.resize(index.len().next_multiple_of(4), 0);
    index.extend(crc32(&index).to_le_bytes());
    let mut footer = (index.len() as u32 / 4 - 1).to_le_bytes().to_vec();
    footer.extend([0, 0]);
    stream.extend(index);
    stream.extend(crc32(&footer).to_le_bytes());
    stream.extend(footer);
    stream.extend(b"YZ");
    stream
}

/// The check sum of IEEE 802.3, bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    let bit = |crc: u32, _| {
        if crc & 1 == 1 {
            crc >> 1 ^ 0xedb8_8320
        } else {
            crc >> 1
        }
    };
    !bytes
        .iter()
        .fold(!0, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), bit))
}

/// The letters of bytes in base64, with padding.
pub(super) fn base64(bytes: &[u8]) -> Vec<u8> {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = Vec::new();
    for group in bytes.chunks(3) {
        let word = group
            .iter()
            .chain(&[0, 0])
            .take(3)
            .fold(0u32, |word, &b| word << 8 | u32::from(b));
        let letter = |k: usize| LETTERS[(word >> (18 - 6 * k)) as usize & 63];
        text.extend((0..4).map(|k| if k <= group.len() { letter(k) } else { b'=' }));
    }
    text
}

/// A file whose points are one block of compressed bytes.
///
/// The first byte selects compressor, header, byte order and encoding, the next two the size of the
/// block.
pub(super) fn file(bytes: &[u8]) -> Vec<u8> {
    let at = |i: usize| bytes.get(i).copied().unwrap_or(0);
    block_file(
        at(0),
        u64::from(at(1)) << 4 | u64::from(at(2)) & 15,
        bytes.get(3..).unwrap_or_default(),
    )
}

/// A VTP file of one triangle with the given bytes as points: one compressed block of a declared
/// size.
///
/// The two lowest bits of `choice` are the compressor (0: zlib, 1: lz4, 2: LZMA2 without its
/// stream, 3: none); the next bits mean 64-bit headers, big-endian numbers and base64.
pub fn block_file(choice: u8, size: u64, payload: &[u8]) -> Vec<u8> {
    let packed = if choice & 3 == 2 {
        xz(payload)
    } else {
        payload.to_vec()
    };
    let (long, big, encoded) = (choice & 4 != 0, choice & 8 != 0, choice & 16 != 0);
    let number = |n: u64| {
        let little = n.to_le_bytes();
        let bytes = if long { &little[..] } else { &little[..4] };
        if big {
            bytes.iter().rev().copied().collect()
        } else {
            bytes.to_vec()
        }
    };
    let header: Vec<u8> = match choice & 3 {
        3 => number(packed.len() as u64),
        _ => [1, size, 0, packed.len() as u64]
            .into_iter()
            .flat_map(number)
            .collect(),
    };
    let order = if big { "BigEndian" } else { "LittleEndian" };
    let kind = if long { "UInt64" } else { "UInt32" };
    let name = COMPRESSORS[usize::from(choice & 3)];
    let mut file = format!(
        "<VTKFile type=\"PolyData\" byte_order=\"{order}\" header_type=\"{kind}\" compressor=\"{name}\"><PolyData><Piece>\
         <Points><DataArray type=\"Int8\" format=\"appended\" offset=\"0\"/></Points>\
         <Polys><DataArray type=\"Int8\" Name=\"connectivity\">0 1 2</DataArray>\
         <DataArray type=\"Int8\" Name=\"offsets\">3</DataArray></Polys></Piece></PolyData>"
    )
    .into_bytes();
    file.extend(
        format!(
            "<AppendedData encoding=\"{}\">_",
            if encoded { "base64" } else { "raw" }
        )
        .bytes(),
    );
    if encoded {
        file.extend(base64(&header));
        file.extend(base64(&packed));
    } else {
        file.extend(header);
        file.extend(packed);
    }
    file
}

/// Checks the reader with a file whose compressed points are the bytes.
///
/// # Errors
/// The first broken promise.
pub fn check_blocks(bytes: &[u8]) -> Result<LoadOutcome, Breach> {
    check_reader(&file(bytes), |bytes| read_bytes(bytes, "a.vtp"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const POINTS: [u8; 9] = [0, 0, 0, 1, 0, 0, 0, 1, 0];

    /// Bytes that select and contain a valid block.
    fn whole(choice: u8, packed: &[u8]) -> Vec<u8> {
        [&[choice, 0, 9], packed].concat()
    }

    #[test]
    fn each_compressor_gives_a_mesh() {
        let chunk = [&[1, 0, 8], &POINTS[..], &[0]].concat();
        let packed = [
            miniz_oxide::deflate::compress_to_vec_zlib(&POINTS, 6),
            lz4_flex::compress(&POINTS),
            chunk,
            POINTS.into(),
        ];
        for (choice, packed) in (0u8..).zip(packed) {
            // Without a compressor base64 is one stream with its header, which this function does
            // not produce.
            let choices = if choice == 3 { 0..4 } else { 0..8 };
            for more in choices {
                let bytes = whole(choice | more << 2, &packed);
                assert_eq!(
                    check_blocks(&bytes),
                    Ok(LoadOutcome::Accepted),
                    "{choice} {more}"
                );
                assert_eq!(
                    check_blocks(&bytes[..bytes.len() - 3]),
                    Ok(LoadOutcome::Refused),
                    "{choice} {more}"
                );
            }
        }
    }

    #[test]
    fn base64_is_that_of_the_standard() {
        assert_eq!(
            [base64(b"f"), base64(b"fo"), base64(b"foobar")],
            [&b"Zg=="[..], b"Zm8=", b"Zm9vYmFy"]
        );
    }
}
