//! Decoder of `.xz` streams with the LZMA2 filter, as VTK writes them in its `vtkLZMADataCompressor`.
//!
//! Own code, so that memory is bounded by what comes out and not by the dictionary that the header declares (up to 4 GiB):
//! here the output is the dictionary, and decoding stops at the declared size. No crate was measured against it yet. CRC32
//! and CRC64 are checked; SHA-256 is skipped.

/// What is wrong in a stream, for `Problem::Expected`.
type Wrong = &'static str;

const DAMAGED: Wrong = "undamaged LZMA data";
const SHORT: Wrong = "more bytes of LZMA data";

/// Decodes a stream of which `size` bytes must come out.
pub(super) fn decode(bytes: &[u8], size: usize) -> Result<Vec<u8>, Wrong> {
    let mut input = Input { bytes };
    if input.take(6)? != b"\xfd7zXZ\0" {
        return Err("an .xz stream");
    }
    let flags = input.take(2)?;
    let check = Check::of(flags[1]).ok_or(DAMAGED)?;
    input.checked(flags)?;
    let mut out = Vec::new();
    loop {
        let whole = input.bytes;
        let header = input.byte()?;
        if header == 0 {
            break;
        }
        block_header(&mut input, whole, header)?;
        let (start, before) = (out.len(), input.bytes.len());
        lzma2(&mut input, &mut out, size)?;
        input.take((4 - (before - input.bytes.len()) % 4) % 4)?;
        check.verify(&out[start..], &mut input)?;
    }
    // The index behind the blocks repeats what is known.
    if out.len() == size { Ok(out) } else { Err("LZMA data of the declared size") }
}

struct Input<'a> {
    bytes: &'a [u8],
}

impl<'a> Input<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], Wrong> {
        let (taken, rest) = self.bytes.split_at_checked(count).ok_or(SHORT)?;
        self.bytes = rest;
        Ok(taken)
    }

    fn byte(&mut self) -> Result<u8, Wrong> {
        Ok(self.take(1)?[0])
    }

    /// Compares the CRC32 of bytes with the one that follows.
    fn checked(&mut self, bytes: &[u8]) -> Result<(), Wrong> {
        Check::Crc32.verify(bytes, self)
    }

    /// A number in groups of seven bits.
    fn number(&mut self) -> Result<u64, Wrong> {
        let mut value = 0;
        for i in 0..9 {
            let byte = self.byte()?;
            value |= u64::from(byte & 0x7f) << (7 * i);
            if byte & 0x80 == 0 {
                return Ok(value);
            }
        }
        Err(DAMAGED)
    }
}

/// Reads the header of a block, of which the first byte was read; only LZMA2 without other filters is known.
fn block_header(input: &mut Input<'_>, whole: &[u8], first: u8) -> Result<(), Wrong> {
    let length = usize::from(first) * 4;
    let mut header = Input { bytes: input.take(length - 1)? };
    input.checked(&whole[..length])?;
    let flags = header.byte()?;
    if flags & 0x3f != 0 {
        return Err("LZMA2 as the only filter");
    }
    for bit in [0x40, 0x80] {
        if flags & bit != 0 {
            header.number()?;
        }
    }
    if header.number()? == 0x21 && header.number()? == 1 { Ok(()) } else { Err("LZMA2 as the only filter") }
}

/// The check behind each block.
#[derive(Clone, Copy)]
enum Check {
    None,
    Crc32,
    Crc64,
    Sha256,
}

impl Check {
    fn of(flag: u8) -> Option<Self> {
        Some(match flag {
            0 => Check::None,
            1 => Check::Crc32,
            4 => Check::Crc64,
            10 => Check::Sha256,
            _ => return None,
        })
    }

    fn verify(self, bytes: &[u8], input: &mut Input<'_>) -> Result<(), Wrong> {
        let (length, polynomial) = match self {
            Check::None => return Ok(()),
            Check::Sha256 => return input.take(32).map(|_| ()),
            Check::Crc32 => (4, 0xedb8_8320),
            Check::Crc64 => (8, 0xc96c_5795_d787_0f42),
        };
        let found = input.take(length)?.iter().rev().fold(0, |word: u64, &b| word << 8 | u64::from(b));
        if crc(bytes, polynomial, u64::MAX >> (64 - 8 * length)) == found { Ok(()) } else { Err(DAMAGED) }
    }
}

/// The reflected cyclic redundancy check of a polynomial, with all bits of `ones` set at both ends.
fn crc(bytes: &[u8], polynomial: u64, ones: u64) -> u64 {
    let mut table = [0; 256];
    for (i, entry) in table.iter_mut().enumerate() {
        *entry = (0..8).fold(i as u64, |r, _| if r & 1 == 1 { r >> 1 ^ polynomial } else { r >> 1 });
    }
    bytes.iter().fold(ones, |r, &b| table[usize::from(r as u8 ^ b)] ^ r >> 8) ^ ones
}

/// Decodes the chunks of LZMA2 behind `out`, which may not become longer than `size`.
fn lzma2(input: &mut Input<'_>, out: &mut Vec<u8>, size: usize) -> Result<(), Wrong> {
    let mut lzma: Option<Lzma> = None;
    let mut start = None;
    loop {
        let control = input.byte()?;
        if control == 0 {
            return Ok(());
        }
        if control == 1 || control >= 0xe0 {
            start = Some(out.len());
        }
        let start = start.ok_or(DAMAGED)?;
        let sizes = input.take(2)?;
        let length = usize::from(sizes[0]) << 8 | usize::from(sizes[1]);
        if control < 0x80 {
            if control > 2 || out.len() + length + 1 > size {
                return Err(DAMAGED);
            }
            out.extend_from_slice(input.take(length + 1)?);
            continue;
        }
        let end = out.len() + (usize::from(control & 0x1f) << 16) + length + 1;
        let packed = input.take(2)?;
        let packed = usize::from(packed[0]) << 8 | usize::from(packed[1]);
        if end > size {
            return Err("LZMA data of the declared size");
        }
        match (control >> 5 & 3, &mut lzma) {
            (2.., _) => lzma = Some(Lzma::new(input.byte()?)?),
            (1, Some(lzma)) => lzma.reset(),
            (0, Some(_)) => {}
            _ => return Err(DAMAGED),
        }
        let mut range = Range::new(input.take(packed + 1)?)?;
        lzma.as_mut().ok_or(DAMAGED)?.decode(&mut range, out, start, end)?;
    }
}

/// A probability of a zero bit, of 2048.
type Probability = u16;

const HALF: Probability = 1024;

/// The range decoder.
struct Range<'a> {
    input: Input<'a>,
    range: u32,
    code: u32,
}

impl<'a> Range<'a> {
    fn new(bytes: &'a [u8]) -> Result<Self, Wrong> {
        let mut input = Input { bytes };
        let first = input.take(5)?;
        let code = first[1..].iter().fold(0, |code, &b| code << 8 | u32::from(b));
        Ok(Self { input, range: u32::MAX, code })
    }

    fn normalize(&mut self) -> Result<(), Wrong> {
        if self.range < 1 << 24 {
            self.range <<= 8;
            self.code = self.code << 8 | u32::from(self.input.byte()?);
        }
        Ok(())
    }

    fn bit(&mut self, probability: &mut Probability) -> Result<usize, Wrong> {
        let bound = (self.range >> 11) * u32::from(*probability);
        let bit = self.code >= bound;
        if bit {
            self.range -= bound;
            self.code -= bound;
            *probability -= *probability >> 5;
        } else {
            self.range = bound;
            *probability += (2048 - *probability) >> 5;
        }
        self.normalize()?;
        Ok(usize::from(bit))
    }

    /// Bits of even probability, the highest first.
    fn direct(&mut self, count: u32) -> Result<u32, Wrong> {
        let mut value = 0;
        for _ in 0..count {
            self.range >>= 1;
            let bit = self.code >= self.range;
            if bit {
                self.code -= self.range;
            }
            value = value << 1 | u32::from(bit);
            self.normalize()?;
        }
        Ok(value)
    }

    /// Bits of a tree of probabilities, the highest first.
    fn tree(&mut self, probabilities: &mut [Probability], bits: u32) -> Result<usize, Wrong> {
        let mut node = 1;
        for _ in 0..bits {
            node = node << 1 | self.bit(&mut probabilities[node])?;
        }
        Ok(node - (1 << bits))
    }

    /// Bits of a tree, the lowest first; the tree begins at index `base` + 1.
    fn reverse(&mut self, probabilities: &mut [Probability], base: usize, bits: u32) -> Result<u32, Wrong> {
        let (mut node, mut value) = (1, 0);
        for i in 0..bits {
            let bit = self.bit(&mut probabilities[base + node])?;
            node = node << 1 | bit;
            value |= (bit as u32) << i;
        }
        Ok(value)
    }
}

/// Probabilities of the length of a match.
struct Lengths {
    choice: [Probability; 2],
    low: [[Probability; 8]; 16],
    middle: [[Probability; 8]; 16],
    high: [Probability; 256],
}

impl Lengths {
    const FRESH: Self = Self { choice: [HALF; 2], low: [[HALF; 8]; 16], middle: [[HALF; 8]; 16], high: [HALF; 256] };

    /// The length less 2.
    fn decode(&mut self, range: &mut Range<'_>, position: usize) -> Result<usize, Wrong> {
        if range.bit(&mut self.choice[0])? == 0 {
            range.tree(&mut self.low[position], 3)
        } else if range.bit(&mut self.choice[1])? == 0 {
            Ok(8 + range.tree(&mut self.middle[position], 3)?)
        } else {
            Ok(16 + range.tree(&mut self.high, 8)?)
        }
    }
}

/// The decoder of one LZMA stream: its properties, probabilities, state and last distances less 1.
struct Lzma {
    context_bits: u32,
    position_mask_of_literals: usize,
    position_mask: usize,
    literals: Vec<Probability>,
    models: Models,
    state: usize,
    distances: [u32; 4],
}

struct Models {
    is_match: [[Probability; 16]; 12],
    is_repeated: [Probability; 12],
    is_not_first: [Probability; 12],
    is_long: [[Probability; 16]; 12],
    is_not_second: [Probability; 12],
    is_not_third: [Probability; 12],
    slots: [[Probability; 64]; 4],
    distances: [Probability; 115],
    align: [Probability; 16],
    lengths: Lengths,
    repeated_lengths: Lengths,
}

impl Models {
    const FRESH: Self = Self {
        is_match: [[HALF; 16]; 12],
        is_repeated: [HALF; 12],
        is_not_first: [HALF; 12],
        is_long: [[HALF; 16]; 12],
        is_not_second: [HALF; 12],
        is_not_third: [HALF; 12],
        slots: [[HALF; 64]; 4],
        distances: [HALF; 115],
        align: [HALF; 16],
        lengths: Lengths::FRESH,
        repeated_lengths: Lengths::FRESH,
    };
}

impl Lzma {
    fn new(properties: u8) -> Result<Self, Wrong> {
        let (lc, lp, pb) = (properties % 9, properties / 9 % 5, properties / 45);
        if pb > 4 || lc + lp > 4 {
            return Err(DAMAGED);
        }
        Ok(Self {
            context_bits: u32::from(lc),
            position_mask_of_literals: (1 << lp) - 1,
            position_mask: (1 << pb) - 1,
            literals: vec![HALF; 0x300 << (lc + lp)],
            models: Models::FRESH,
            state: 0,
            distances: [0; 4],
        })
    }

    fn reset(&mut self) {
        self.literals.fill(HALF);
        self.models = Models::FRESH;
        self.state = 0;
        self.distances = [0; 4];
    }

    /// Decodes up to length `end` of `out`; nothing before `start` may be copied.
    fn decode(&mut self, range: &mut Range<'_>, out: &mut Vec<u8>, start: usize, end: usize) -> Result<(), Wrong> {
        while out.len() < end {
            let position = (out.len() - start) & self.position_mask;
            if range.bit(&mut self.models.is_match[self.state][position])? == 0 {
                self.literal(range, out, start)?;
                continue;
            }
            let length = if range.bit(&mut self.models.is_repeated[self.state])? == 0 {
                self.distances.rotate_right(1);
                let length = self.models.lengths.decode(range, position)?;
                self.distances[0] = self.distance(range, length)?;
                self.state = if self.state < 7 { 7 } else { 10 };
                length + 2
            } else {
                self.repeated(range, position)?
            };
            let distance = self.distances[0] as usize + 1;
            if distance > out.len() - start || length > end - out.len() {
                return Err(DAMAGED);
            }
            // A match may overlap what it writes.
            for _ in 0..length {
                out.push(out[out.len() - distance]);
            }
        }
        Ok(())
    }

    fn literal(&mut self, range: &mut Range<'_>, out: &mut Vec<u8>, start: usize) -> Result<(), Wrong> {
        let position = out.len() - start;
        let before = if position == 0 { 0 } else { usize::from(out[out.len() - 1]) };
        let context =
            (position & self.position_mask_of_literals) << self.context_bits | before >> (8 - self.context_bits);
        let models = &mut self.literals[0x300 * context..][..0x300];
        let mut symbol = 1;
        if self.state >= 7 {
            let distance = self.distances[0] as usize + 1;
            if distance > position {
                return Err(DAMAGED);
            }
            // Behind a match the byte that would have gone on with it is a good guess.
            let mut guess = usize::from(out[out.len() - distance]);
            while symbol < 0x100 {
                let expected = guess >> 7 & 1;
                guess <<= 1;
                let bit = range.bit(&mut models[(1 + expected) << 8 | symbol])?;
                symbol = symbol << 1 | bit;
                if bit != expected {
                    break;
                }
            }
        }
        while symbol < 0x100 {
            symbol = symbol << 1 | range.bit(&mut models[symbol])?;
        }
        out.push(symbol as u8);
        self.state = match self.state {
            0..4 => 0,
            state @ 4..10 => state - 3,
            state => state - 6,
        };
        Ok(())
    }

    /// A match at one of the last four distances; returns its length.
    fn repeated(&mut self, range: &mut Range<'_>, position: usize) -> Result<usize, Wrong> {
        let state = self.state;
        if range.bit(&mut self.models.is_not_first[state])? == 0 {
            if range.bit(&mut self.models.is_long[state][position])? == 0 {
                self.state = if state < 7 { 9 } else { 11 };
                return Ok(1);
            }
        } else {
            let which = if range.bit(&mut self.models.is_not_second[state])? == 0 {
                1
            } else {
                2 + range.bit(&mut self.models.is_not_third[state])?
            };
            self.distances[..=which].rotate_right(1);
        }
        let length = self.models.repeated_lengths.decode(range, position)?;
        self.state = if state < 7 { 8 } else { 11 };
        Ok(length + 2)
    }

    /// The distance less 1 of a match of a length less 2.
    fn distance(&mut self, range: &mut Range<'_>, length: usize) -> Result<u32, Wrong> {
        let slot = range.tree(&mut self.models.slots[length.min(3)], 6)?;
        if slot < 4 {
            return Ok(slot as u32);
        }
        let bits = (slot as u32 >> 1) - 1;
        let base = (2 | slot as u32 & 1) << bits;
        if slot < 14 {
            return Ok(base + range.reverse(&mut self.models.distances, base as usize - slot, bits)?);
        }
        let high = range.direct(bits - 4)? << 4;
        // The largest value is the mark of an end, which LZMA2 does not have; it fails as a distance too far.
        Ok(base.wrapping_add(high).wrapping_add(range.reverse(&mut self.models.align, 0, 4)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checks_are_those_of_the_catalogue() {
        assert_eq!(crc(b"123456789", 0xedb8_8320, u64::from(u32::MAX)), 0xcbf4_3926);
        assert_eq!(crc(b"123456789", 0xc96c_5795_d787_0f42, u64::MAX), 0x995d_c9bb_df19_39fa);
    }

    /// `v I J` on 60 lines with I = i mod 7 and J = i * i mod 11, by liblzma with CRC64.
    const LINES: &[u8] = b"\xfd\x37\x7a\x58\x5a\x00\x00\x04\xe6\xd6\xb4\x46\x02\x00\x21\x01\x16\x00\x00\x00\x74\x2f\xe5\xa3\xe0\x01\x67\x00\x62\x5d\x00\x3b\x08\x02\x10\x02\x0a\x80\x54\x52\xdf\x18\xa7\x58\xa0\xb2\x40\x00\x24\xe3\x68\xe7\x50\x9d\x1f\x92\xb0\xaf\x9b\xbd\x95\xd5\x7d\x62\x16\x37\xd9\x76\x24\xa6\x4d\xdc\x7e\xdb\x3a\x49\x96\xee\x5f\x07\x7e\xa3\xfa\x60\xe2\x4b\xa3\x38\x00\x30\xce\x78\x01\xef\x87\x8d\xd2\xb6\x5d\x8d\x5a\x50\xba\xfe\xdf\xab\xfb\x1b\x9e\x80\x40\xce\x26\xc1\xb6\xb1\xf8\xf5\xb3\x09\x70\xcb\xe1\xba\x47\x82\xbd\x63\xa0\x00\x00\x00\xcc\x24\xa8\x40\x88\x05\x8d\xcf\x00\x01\x7e\xe8\x02\x00\x00\x00\xf9\xfc\xd0\x40\xb1\xc4\x67\xfb\x02\x00\x00\x00\x00\x04\x59\x5a";

    /// The bytes from 0 to 39, which do not become shorter, by liblzma with CRC32.
    const BYTES: &[u8] = b"\xfd\x37\x7a\x58\x5a\x00\x00\x01\x69\x22\xde\x36\x02\x00\x21\x01\x0c\x00\x00\x00\x8f\x98\x41\x9c\x01\x00\x27\x00\x01\x02\x03\x04\x05\x06\x07\x08\x09\x0a\x0b\x0c\x0d\x0e\x0f\x10\x11\x12\x13\x14\x15\x16\x17\x18\x19\x1a\x1b\x1c\x1d\x1e\x1f\x20\x21\x22\x23\x24\x25\x26\x27\x00\x3c\x2e\xa6\x0d\x00\x01\x3c\x28\x2e\x64\xc0\x66\x90\x42\x99\x0d\x01\x00\x00\x00\x00\x01\x59\x5a";

    fn lines() -> Vec<u8> {
        (0..60).flat_map(|i| format!("v {} {}\n", i % 7, i * i % 11).into_bytes()).collect()
    }

    #[test]
    fn what_another_encoder_wrote_is_decoded() {
        assert_eq!(decode(LINES, lines().len()).unwrap(), lines());
        assert_eq!(decode(BYTES, 40).unwrap(), (0..40).collect::<Vec<u8>>());
    }

    #[test]
    fn damage_is_found() {
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
}
