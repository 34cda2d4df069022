//! Arrays of VTK XML as bytes: each is compressed on its own by LZMA in the container `.xz`, which VTK reads since
//! version 8.1. Its literal coder takes the position of a byte within its number into account, so that noise in the low bytes
//! does not spoil the high ones: without that, zlib leaves a quarter more.

use std::collections::HashMap;
use std::io::{self, Write};
use std::path::Path;

use super::{Blocks, PolyData, escape};
use crate::io::part::write_whole;

/// Attribute of the file that names the compression.
#[cfg(feature = "compression")]
pub(super) const ATTRIBUTE: &str = " compressor=\"vtkLZMADataCompressor\"";
#[cfg(not(feature = "compression"))]
pub(super) const ATTRIBUTE: &str = "";

/// Bytes of a block [bytes]: a multiple of the size of every number.
#[cfg(feature = "compression")]
const BLOCK: usize = 1 << 20;

/// Shares of the greatest value to which compact point data are rounded: two steps.
const SHARES: f64 = 4096.0;

/// Greatest size of the arrays that a series keeps [bytes].
const KEPT: usize = 256 << 20;

/// Name of the array of positions.
pub(super) const POINTS: &str = "Points";

/// How an array repeats itself.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(not(feature = "compression"), allow(dead_code))]
enum Repeats {
    /// Noise but for the high bytes.
    Not,
    /// The high bytes of a coordinate change little from point to point.
    Points,
    /// In long stretches, or by equal differences.
    Indices,
}

/// Type of the numbers of an array.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
    Float64,
    Float32,
    Int64,
    Int32,
}

impl Kind {
    /// The type of real numbers.
    pub(super) fn of(compact: bool) -> Self {
        if compact {
            Self::Float32
        } else {
            Self::Float64
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Float64 => "Float64",
            Self::Float32 => "Float32",
            Self::Int64 => "Int64",
            Self::Int32 => "Int32",
        }
    }

    #[cfg(feature = "compression")]
    fn size(self) -> u32 {
        match self {
            Self::Float64 | Self::Int64 => 8,
            Self::Float32 | Self::Int32 => 4,
        }
    }
}

/// An array with its description and its bytes in the file.
pub(super) struct Array {
    name: String,
    components: usize,
    kind: Kind,
    /// With the header of its blocks.
    pub(super) bytes: Vec<u8>,
}

impl Array {
    /// An array of real numbers.
    pub(super) fn reals(
        name: &str,
        components: usize,
        kind: Kind,
        values: impl Iterator<Item = f64>,
    ) -> io::Result<Self> {
        let raw: Vec<u8> = match kind {
            Kind::Float32 => values.flat_map(|v| (v as f32).to_le_bytes()).collect(),
            _ => values.flat_map(f64::to_le_bytes).collect(),
        };
        Ok(Self {
            name: name.to_owned(),
            components,
            kind,
            bytes: encoded(
                &raw,
                kind,
                if name == POINTS {
                    Repeats::Points
                } else {
                    Repeats::Not
                },
            )?,
        })
    }

    /// Writes the element that describes the array; `offset` is the start of its bytes.
    pub(super) fn declare(&self, w: &mut dyn Write, offset: u64) -> io::Result<()> {
        writeln!(
            w,
            "        <DataArray type=\"{}\" Name=\"{}\" NumberOfComponents=\"{}\" format=\"appended\" offset=\"{offset}\"/>",
            self.kind.name(),
            escape(&self.name),
            self.components
        )
    }
}

/// Writes the files of a series, such as the frames of a run: connectivity that several of them have is compressed once.
#[derive(Debug, Default)]
pub struct SeriesWriter {
    /// Compressed bytes of the arrays of indices so far, by their bytes.
    kept: HashMap<Vec<u8>, Vec<u8>>,
    /// Their size [bytes].
    size: usize,
}

impl SeriesWriter {
    /// A writer that knows no connectivity yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Writes a file like [`super::write()`].
    ///
    /// # Errors
    /// Those of [`super::write()`].
    pub fn write(&mut self, path: &Path, data: &PolyData<'_>) -> io::Result<()> {
        self.write_with_cells(path, data, &[])
    }

    /// Writes a file like [`super::write_with_cells()`].
    ///
    /// # Errors
    /// Those of [`super::write_with_cells()`].
    pub fn write_with_cells(
        &mut self,
        path: &Path,
        data: &PolyData<'_>,
        cell_data: &[(&str, Vec<f64>)],
    ) -> io::Result<()> {
        let blocks = Blocks::of(self, data, cell_data)?;
        write_whole(path, |w| blocks.write(w, data))
    }

    /// An array of indices.
    pub(super) fn indices(
        &mut self,
        name: &str,
        values: impl Iterator<Item = u64> + Clone,
    ) -> io::Result<Array> {
        let is_small = values.clone().all(|v| v <= i32::MAX as u64);
        let (kind, raw): (Kind, Vec<u8>) = match is_small {
            true => (
                Kind::Int32,
                values.flat_map(|v| (v as u32).to_le_bytes()).collect(),
            ),
            false => (Kind::Int64, values.flat_map(u64::to_le_bytes).collect()),
        };
        let bytes = match self.kept.get(&raw) {
            Some(bytes) => bytes.clone(),
            None => {
                let bytes = encoded(&raw, kind, Repeats::Indices)?;
                let size = raw.len() + bytes.len();
                if self.size + size > KEPT {
                    (self.size, self.kept) = (0, HashMap::new());
                }
                self.size += size;
                self.kept.insert(raw, bytes.clone());
                bytes
            }
        };
        Ok(Array {
            name: name.to_owned(),
            components: 1,
            kind,
            bytes,
        })
    }
}

/// The step to which values are rounded: a power of two, [`SHARES`] of which reach half of the greatest value or more.
/// 0 without a finite value other than zero.
pub(super) fn step(values: &[f64]) -> f64 {
    let finite = values.iter().map(|v| v.abs()).filter(|v| v.is_finite());
    let greatest = finite.fold(0.0, |a: f64, b| if b > a { b } else { a });
    if greatest < f64::from(f32::MIN_POSITIVE) * SHARES {
        return 0.0;
    }
    // The bits of the exponent alone are the greatest power of two below.
    f64::from_bits(greatest.to_bits() & 0x7ff0_0000_0000_0000) / SHARES
}

/// A value at the nearest multiple of `step`, or itself if that is 0.
pub(super) fn rounded(value: f64, step: f64) -> f64 {
    if step > 0.0 {
        (value / step).round() * step
    } else {
        value
    }
}

/// The bytes of an array as they stand in a file.
#[cfg(not(feature = "compression"))]
fn encoded(raw: &[u8], _: Kind, _: Repeats) -> io::Result<Vec<u8>> {
    let mut bytes = (raw.len() as u64).to_le_bytes().to_vec();
    bytes.extend_from_slice(raw);
    Ok(bytes)
}

/// The bytes of an array as they stand in a file: the number of blocks, the size of each and of a last one that is shorter,
/// the compressed size of each, the blocks.
#[cfg(feature = "compression")]
fn encoded(raw: &[u8], kind: Kind, repeats: Repeats) -> io::Result<Vec<u8>> {
    let blocks: Vec<Vec<u8>> = raw
        .chunks(BLOCK)
        .map(|block| match repeats {
            Repeats::Not => pack(block, kind, 0, false),
            Repeats::Points => pack(block, kind, 3, false),
            Repeats::Indices => {
                let [plain, by_differences] = [0, 1].map(|apart| pack(block, kind, apart, true));
                let (plain, by_differences) = (plain?, by_differences?);
                Ok(if by_differences.len() < plain.len() {
                    by_differences
                } else {
                    plain
                })
            }
        })
        .collect::<io::Result<_>>()?;
    let mut bytes = Vec::new();
    let sizes = blocks.iter().map(|block| block.len() as u64);
    let header = [blocks.len(), BLOCK, raw.len() % BLOCK].map(|n| n as u64);
    for word in header.into_iter().chain(sizes) {
        bytes.extend_from_slice(&word.to_le_bytes());
    }
    blocks
        .iter()
        .for_each(|block| bytes.extend_from_slice(block));
    Ok(bytes)
}

/// A block as a stream of `.xz`: of the differences of bytes in numbers that are `apart` from each other, or as it is with 0.
/// `thorough` looks longer for repetitions.
#[cfg(feature = "compression")]
fn pack(block: &[u8], kind: Kind, apart: u32, thorough: bool) -> io::Result<Vec<u8>> {
    use lzma_rust2::{CheckType, EncodeMode, FilterType, MfType, XzOptions, XzWriter};

    let mut options = XzOptions::with_preset(6);
    options.set_check_sum_type(CheckType::Crc32);
    if apart > 0 {
        options.prepend_pre_filter(FilterType::Delta, apart * kind.size());
    }
    let own = &mut options.lzma_options;
    let place = kind.size().trailing_zeros();
    (own.lc, own.lp, own.pb) = (0, place, place);
    // A dictionary beyond the block would only take memory.
    own.dict_size = (block.len() as u32).next_power_of_two().max(4096);
    if !thorough {
        // Longer searches take three times as long on noise and find nothing.
        (own.mode, own.mf, own.nice_len, own.depth_limit) =
            (EncodeMode::Normal, MfType::Hc4, 16, 4);
    }
    let mut writer = XzWriter::new(Vec::new(), options)?;
    writer.write_all(block)?;
    writer.finish()
}
