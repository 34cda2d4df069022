//! Seeded mutations of files: bytes, words, lines, numbers, splices, lengths.

use super::draw::Draw;

/// Difficult numbers for readers of text.
const HARD_TEXT: [&[u8]; 34] = [
    b"0",
    b"-0",
    b"1",
    b"-1",
    b"2",
    b"3",
    b"7",
    b"255",
    b"256",
    b"65535",
    b"65536",
    b"2147483647",
    b"2147483648",
    b"-2147483648",
    b"4294967295",
    b"4294967296",
    b"9223372036854775807",
    b"9223372036854775808",
    b"-9223372036854775808",
    b"18446744073709551615",
    b"18446744073709551616",
    b"1e308",
    b"1e309",
    b"-1e309",
    b"5e-324",
    b"1e-400",
    b"2.2250738585072011e-308",
    b"nan",
    b"inf",
    b"1,5",
    b"1e",
    b".",
    b"+1",
    b"0x10",
];

/// Difficult numbers for readers of binary data, in both byte orders.
const HARD_BYTES: [&[u8]; 20] = [
    &[0],
    &[1],
    &[0x7f],
    &[0x80],
    &[0xff],
    &[0xff, 0xff],
    &[0xff, 0xff, 0xff, 0xff],
    &[0xff; 8],
    &[0x7f, 0xff, 0xff, 0xff],
    &[0xff, 0xff, 0xff, 0x7f],
    &[0x80, 0, 0, 0],
    &[0, 0, 0, 0x80],
    &[0; 4],
    &[0; 8],
    &[1, 0, 0, 0],
    &[0, 0, 0, 1],
    &[0, 0, 0xc0, 0x7f],
    &[0x7f, 0xc0, 0, 0],
    &[0, 0, 0x80, 0x7f],
    &[0x7f, 0xf0, 0, 0, 0, 0, 0, 0],
];

/// Greatest length of a mutated file [bytes].
const LONGEST: usize = 8192;

/// Mutates files, deterministically for a seed.
pub struct Mutator {
    draw: Draw,
    words: Vec<Vec<u8>>,
}

impl Mutator {
    /// Creates a mutator from a seed, with the words of a format that it inserts occasionally.
    pub fn new(seed: u64, words: Vec<Vec<u8>>) -> Self {
        Self {
            draw: Draw::new(seed),
            words,
        }
    }

    /// A mutated file: up to six changes of one of several files, more often few than many.
    ///
    /// # Panics
    /// If there is no file.
    pub fn mutate(&mut self, files: &[Vec<u8>]) -> Vec<u8> {
        let mut bytes = files[self.draw.index(files.len())].clone();
        let most = 1 + self.draw.index(6);
        for _ in 0..=self.draw.index(most) {
            match self.draw.index(6) {
                0 => self.change_byte(&mut bytes),
                1 => self.change_word(&mut bytes),
                2 => self.change_line(&mut bytes),
                3 => self.change_number(&mut bytes),
                4 => {
                    let other = self.draw.index(files.len());
                    self.splice(&mut bytes, &files[other]);
                }
                _ => self.change_length(&mut bytes),
            }
            bytes.truncate(LONGEST);
        }
        bytes
    }

    /// A part of `0..length`, mostly short.
    fn part(&mut self, length: usize) -> std::ops::Range<usize> {
        let start = self.draw.index(length + 1);
        let reach = [1, 4, 16, 256][self.draw.index(4)];
        start..(start + self.draw.index(reach + 1)).min(length)
    }

    fn change_byte(&mut self, bytes: &mut Vec<u8>) {
        let at = self.draw.index(bytes.len() + 1);
        let byte = self.draw.bits() as u8;
        match (self.draw.index(4), bytes.get_mut(at)) {
            (0, Some(old)) => *old = byte,
            (1, Some(old)) => *old ^= 1 << (byte % 8),
            (2, Some(_)) => {
                bytes.remove(at);
            }
            _ => bytes.insert(at, byte),
        }
    }

    /// Replaces a word by a word of the format, or inserts it before.
    fn change_word(&mut self, bytes: &mut Vec<u8>) {
        if self.words.is_empty() {
            return;
        }
        let word = self.words[self.draw.index(self.words.len())].clone();
        let mut place = self.around(bytes, |b| !b.is_ascii_whitespace());
        if self.draw.index(2) == 0 {
            place.end = place.start;
        }
        bytes.splice(place, word);
    }

    /// The bytes of one kind around a position.
    fn around(&mut self, bytes: &[u8], inside: impl Fn(u8) -> bool) -> std::ops::Range<usize> {
        let at = self.draw.index(bytes.len() + 1);
        let start = bytes[..at]
            .iter()
            .rposition(|&b| !inside(b))
            .map_or(0, |i| i + 1);
        let end = bytes[at..]
            .iter()
            .position(|&b| !inside(b))
            .map_or(bytes.len(), |i| at + i);
        start..end
    }

    /// Removes a line, duplicates it, or replaces it by another.
    fn change_line(&mut self, bytes: &mut Vec<u8>) {
        let line = self.around(bytes, |b| b != b'\n');
        let line = line.start..(line.end + 1).min(bytes.len());
        let other = self.around(bytes, |b| b != b'\n');
        let text = bytes[other.start..(other.end + 1).min(bytes.len())].to_vec();
        match self.draw.index(3) {
            0 => drop(bytes.drain(line)),
            1 => drop(bytes.splice(line.start..line.start, text)),
            _ => drop(bytes.splice(line, text)),
        }
    }

    /// Replaces a number of text, or some bytes, by a difficult number.
    fn change_number(&mut self, bytes: &mut Vec<u8>) {
        if self.draw.index(2) == 0 {
            let hard = HARD_BYTES[self.draw.index(HARD_BYTES.len())];
            let at = self.draw.index(bytes.len() + 1);
            let end = (at + hard.len()).min(bytes.len());
            bytes.splice(at..end, hard.iter().copied());
            return;
        }
        let hard = HARD_TEXT[self.draw.index(HARD_TEXT.len())];
        let number = self.around(bytes, |b| b.is_ascii_digit() || b"+-.eE".contains(&b));
        bytes.splice(number, hard.iter().copied());
    }

    /// Continues with a part of another file.
    fn splice(&mut self, bytes: &mut Vec<u8>, other: &[u8]) {
        let place = self.part(bytes.len());
        let part = if self.draw.index(2) == 0 {
            self.draw.index(other.len() + 1)..other.len()
        } else {
            self.part(other.len())
        };
        bytes.splice(place, other[part].iter().copied());
    }

    /// Truncates, repeats a part, or appends bytes.
    fn change_length(&mut self, bytes: &mut Vec<u8>) {
        let part = self.part(bytes.len());
        match self.draw.index(4) {
            0 => bytes.truncate(part.start),
            1 => drop(bytes.drain(part)),
            2 => {
                let again = bytes[part.clone()].repeat(1 + self.draw.index(40));
                bytes.splice(part.end..part.end, again);
            }
            _ => {
                let byte = if self.draw.index(2) == 0 {
                    b' '
                } else {
                    self.draw.bits() as u8
                };
                bytes.extend(std::iter::repeat_n(byte, self.draw.index(300)));
            }
        }
    }
}

/// The words of a libFuzzer dictionary: one per line, in quotes, with `\"`, `\\` and `\xNN`.
pub fn dictionary(text: &str) -> Vec<Vec<u8>> {
    text.lines()
        .filter_map(|line| line.trim().strip_prefix('"')?.strip_suffix('"'))
        .map(unescape)
        .collect()
}

fn unescape(text: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut rest = text.as_bytes();
    while let [first, tail @ ..] = rest {
        (bytes, rest) = match (first, tail) {
            (b'\\', [b'x', digits @ ..]) if digits.len() >= 2 => {
                let byte = std::str::from_utf8(&digits[..2])
                    .ok()
                    .and_then(|d| u8::from_str_radix(d, 16).ok());
                (push(bytes, byte.unwrap_or(b'?')), &digits[2..])
            }
            (b'\\', [escaped, tail @ ..]) => (push(bytes, *escaped), tail),
            _ => (push(bytes, *first), tail),
        };
    }
    bytes
}

fn push(mut bytes: Vec<u8>, byte: u8) -> Vec<u8> {
    bytes.push(byte);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn changes_are_many_and_repeatable() {
        let files = vec![b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".to_vec(), Vec::new()];
        let run = |seed| {
            let mut mutator = Mutator::new(
                seed,
                dictionary("# words\nname=ignored\n\"f -1\"\n\"\\x00\\\"\"\n"),
            );
            (0..2000)
                .map(|_| mutator.mutate(&files))
                .collect::<Vec<_>>()
        };
        let made = run(1);
        assert_eq!(made, run(1));
        assert_ne!(made, run(2));
        assert!(made.iter().collect::<HashSet<_>>().len() > 1200);
        assert!(made.iter().all(|m| m.len() <= LONGEST));
        let holds = |part: &[u8]| {
            made.iter()
                .any(|m| m.windows(part.len()).any(|w| w == part))
        };
        assert!(
            holds(b"f -1") && holds(b"\0\"") && holds(b"18446744073709551616") && holds(&[0xff; 8])
        );
    }

    #[test]
    fn a_dictionary_is_read_as_libfuzzer_reads_it() {
        assert_eq!(
            dictionary("\"a b\"\n# \"c\"\n\"\\x41\\\\\\\"\"\n"),
            [b"a b".to_vec(), b"A\\\"".to_vec()]
        );
    }
}
