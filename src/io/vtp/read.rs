//! Reader of VTK XML polydata: arrays as text, in base64 or appended, uncompressed or compressed,
//! in one or more pieces.

mod array;
mod data;

use nalgebra::Point3;

use crate::io::MeshFile;
use crate::io::cursor::{Cursor, beyond_double, coordinate, count, finite, integer};
use crate::io::encoded::{Compressor, Fault, Layout, Source};
use crate::io::error::{FilePlace, ReadError, ReadProblem};
use crate::io::surface::Surface;
use crate::io::xml::{Tag, Xml};
use array::{Array, Kind, Numbers, Piece, SECTIONS, Slot, Stored, Values};
pub(in crate::io) use data::point_data;

struct Reader<'a> {
    xml: Xml<'a>,
    layout: Layout,
    surface: Surface,
    /// The appended data after their underscore, and whether they are base64.
    appended: Option<(&'a [u8], bool)>,
    /// Encoded bytes that may still be read: arrays that share bytes could make a small file slow.
    encoded_left: usize,
}

/// Reads the points, polygons, strips and lines of VTK XML polydata.
///
/// # Errors
/// Another XML file, an array that is missing, damaged or of another size than declared, or an
/// index out of range.
pub(in crate::io) fn read(bytes: &[u8], name: &str, limit: u64) -> Result<MeshFile, ReadError> {
    let mut reader = Reader::new(bytes, name, limit);
    let pieces = reader.structure()?;
    for piece in &pieces {
        reader.piece(piece)?;
    }
    reader.surface.finish(&reader.xml.cursor)
}

impl<'a> Reader<'a> {
    fn new(bytes: &'a [u8], name: &'a str, limit: u64) -> Self {
        let layout = Layout {
            big_endian: false,
            header_bytes: 4,
            compressor: None,
            limit,
        };
        let xml = Xml::new(name, bytes);
        Self {
            xml,
            layout,
            surface: Surface::default(),
            appended: None,
            encoded_left: bytes.len(),
        }
    }

    /// Reads all tags without numbers.
    fn structure(&mut self) -> Result<Vec<Piece<'a>>, ReadError> {
        let mut pieces: Vec<Piece<'a>> = Vec::new();
        let mut section: &[u8] = b"";
        let (mut begun, mut ended) = (false, false);
        while let Some(tag) = self.xml.tag()? {
            if !begun {
                self.root(&tag)?;
                begun = true;
                continue;
            }
            match tag.name {
                b"Piece" if !tag.closes => pieces.push(self.new_piece(&tag)?),
                b"PolyData" if tag.closes || tag.empty => ended = true,
                b"AppendedData" if !tag.closes => {
                    self.appended = Some(self.appended_data(&tag)?);
                    // Binary data can follow; only end tags come after them.
                    break;
                }
                b"PointData" | b"CellData" | b"FieldData" | b"Points" | b"Verts" | b"Lines"
                | b"Strips" | b"Polys" => {
                    section = if tag.closes || tag.empty {
                        b""
                    } else {
                        tag.name
                    };
                }
                b"DataArray" if !tag.closes => {
                    let number = pieces.len();
                    if let Some(piece) = pieces.last_mut() {
                        piece.arrays.extend(self.array(&tag, section, number)?);
                    }
                }
                _ => {}
            }
        }
        if !ended {
            return Err(self.xml.fail(
                ReadProblem::Truncated {
                    what: "the element PolyData",
                },
                b"",
            ));
        }
        Ok(pieces)
    }

    fn expected(&self, what: &'static str, found: &[u8]) -> ReadError {
        self.xml.fail(ReadProblem::Expected { what }, found)
    }

    fn root(&mut self, tag: &Tag<'a>) -> Result<(), ReadError> {
        if tag.name != b"VTKFile" {
            return Err(self.xml.fail(
                ReadProblem::Unsupported {
                    what: "XML other than VTK's",
                },
                tag.name,
            ));
        }
        let kind = tag.attribute("type").unwrap_or_default();
        if kind != b"PolyData" {
            let what = "VTK XML of another type than PolyData";
            return Err(self.xml.fail(
                ReadProblem::Unsupported { what },
                if kind.is_empty() { tag.name } else { kind },
            ));
        }
        self.layout.big_endian = match tag.attribute("byte_order") {
            None | Some(b"LittleEndian") => false,
            Some(b"BigEndian") => true,
            Some(other) => return Err(self.expected("LittleEndian or BigEndian", other)),
        };
        self.layout.header_bytes = match tag.attribute("header_type") {
            None | Some(b"UInt32") => 4,
            Some(b"UInt64") => 8,
            Some(other) => return Err(self.expected("UInt32 or UInt64", other)),
        };
        self.layout.compressor = match tag.attribute("compressor") {
            None | Some(b"") => None,
            Some(b"vtkZLibDataCompressor") => Some(Compressor::Zlib),
            Some(b"vtkLZ4DataCompressor") => Some(Compressor::Lz4),
            Some(b"vtkLZMADataCompressor") => Some(Compressor::Lzma),
            Some(other) => {
                return Err(self.expected("the compressor of VTK for zlib, lz4 or LZMA", other));
            }
        };
        Ok(())
    }

    fn new_piece(&self, tag: &Tag<'a>) -> Result<Piece<'a>, ReadError> {
        let mut piece = Piece {
            point_count: self.count(tag, "NumberOfPoints")?,
            ..Piece::default()
        };
        for (count, (_, attribute, _)) in piece.counts.iter_mut().zip(SECTIONS) {
            *count = self.count(tag, attribute)?;
        }
        Ok(piece)
    }

    fn count(&self, tag: &Tag<'a>, attribute: &str) -> Result<Option<u64>, ReadError> {
        let Some(word) = tag.attribute(attribute) else {
            return Ok(None);
        };
        let count = count(word.trim_ascii(), "a number of points or cells");
        count
            .map(Some)
            .map_err(|problem| self.xml.fail(problem, word))
    }

    fn appended_data(&self, tag: &Tag<'a>) -> Result<(&'a [u8], bool), ReadError> {
        let base64 = match tag.attribute("encoding") {
            Some(b"raw") => false,
            Some(b"base64") => true,
            other => {
                return Err(self.expected("raw or base64 as encoding", other.unwrap_or(tag.name)));
            }
        };
        match self.xml.bytes[tag.end..]
            .trim_ascii_start()
            .strip_prefix(b"_")
        {
            Some(data) => Ok((data, base64)),
            None => Err(self.expected("an underscore before the appended data", b"")),
        }
    }

    /// An array of points or cells; `None` for others, which are skipped.
    fn array(
        &self,
        tag: &Tag<'a>,
        section: &[u8],
        piece: usize,
    ) -> Result<Option<Array<'a>>, ReadError> {
        let name = tag.attribute("Name").unwrap_or_default();
        let cells = SECTIONS.iter().position(|(name, ..)| *name == section);
        let slot = match (section, cells, name) {
            (b"Points", ..) => Slot::Points,
            (_, Some(i), b"connectivity") => Slot::Corners(i),
            (_, Some(i), b"offsets") => Slot::Ends(i),
            _ => return Ok(None),
        };
        self.stored(tag, slot, piece).map(Some)
    }

    fn stored(&self, tag: &Tag<'a>, slot: Slot, piece: usize) -> Result<Array<'a>, ReadError> {
        let word = tag.attribute("type").unwrap_or_default();
        let Some(kind) = Kind::parse(word) else {
            return Err(self.expected(
                "a type such as Int64 or Float32",
                if word.is_empty() { tag.name } else { word },
            ));
        };
        let stored = match tag.attribute("format") {
            None | Some(b"ascii") => Stored::Text(if tag.empty {
                b""
            } else {
                self.xml.text_behind(tag)
            }),
            Some(b"binary") => Stored::Base64(if tag.empty {
                b""
            } else {
                self.xml.text_behind(tag)
            }),
            Some(b"appended") => {
                let offset = tag.attribute("offset").unwrap_or_default().trim_ascii();
                let found = if offset.is_empty() { tag.name } else { offset };
                Stored::Appended(
                    count(offset, "an offset").map_err(|problem| self.xml.fail(problem, found))?,
                )
            }
            Some(other) => return Err(self.expected("ascii, binary or appended", other)),
        };
        Ok(Array {
            kind,
            stored,
            tag: tag.name,
            slot,
            piece,
        })
    }

    fn piece(&mut self, piece: &Piece<'a>) -> Result<(), ReadError> {
        let first = self.surface.vertices.len();
        if let (Some(array), Some(1..) | None) = (piece.get(Slot::Points), piece.point_count) {
            self.points(array, piece.point_count)?;
        } else if let Some(declared @ 1..) = piece.point_count {
            let what = "the number of points";
            return Err(self.xml.fail(
                ReadProblem::SizeMismatch {
                    what,
                    declared,
                    used: 0,
                },
                b"",
            ));
        }
        for i in 0..SECTIONS.len() {
            match (
                piece.get(Slot::Corners(i)),
                piece.get(Slot::Ends(i)),
                piece.counts[i],
            ) {
                (_, _, Some(0)) | (None, None, None) => {}
                (Some(corners), Some(ends), count) => self.cells(i, corners, ends, count, first)?,
                (corners, ends, _) => {
                    let tag = corners.or(ends).map(|array| array.tag).unwrap_or_default();
                    return Err(self.expected("both connectivity and offsets of the cells", tag));
                }
            }
        }
        Ok(())
    }

    fn points(&mut self, array: Array<'a>, declared: Option<u64>) -> Result<(), ReadError> {
        let numbers = self.numbers(array, true)?;
        let used = (numbers.len() / 3) as u64;
        if numbers.len() % 3 != 0 || declared.is_some_and(|declared| declared != used) {
            let problem = ReadProblem::SizeMismatch {
                what: "the number of points",
                declared: declared.unwrap_or(used + 1),
                used,
            };
            return Err(self.fail_in(&numbers, problem, b""));
        }
        self.surface.vertices.reserve_exact(numbers.len() / 3);
        for i in 0..numbers.len() / 3 {
            let mut position = Point3::origin();
            for axis in 0..3 {
                let value = numbers.real(3 * i + axis);
                let vertex = self.surface.vertices.len();
                position[axis] = finite(value, vertex)
                    .map_err(|p| self.fail_in(&numbers, p, value.to_string().as_bytes()))?;
            }
            self.surface.vertices.push(position);
        }
        Ok(())
    }

    /// Adds the cells of a section; their corners count from the first point of the piece.
    fn cells(
        &mut self,
        section: usize,
        corners: Array<'a>,
        ends: Array<'a>,
        declared: Option<u64>,
        first: usize,
    ) -> Result<(), ReadError> {
        let (corners, ends) = (self.numbers(corners, false)?, self.numbers(ends, false)?);
        if let Some(declared) = declared.filter(|&n| n != ends.len() as u64) {
            let problem = ReadProblem::SizeMismatch {
                what: "the number of cells",
                declared,
                used: ends.len() as u64,
            };
            return Err(self.fail_in(&ends, problem, b""));
        }
        let count = self.surface.vertices.len() - first;
        let mut cell = Vec::new();
        let mut start = 0;
        for i in 0..ends.len() {
            let end = usize::try_from(ends.whole(i))
                .ok()
                .filter(|&end| end >= start && end <= corners.len());
            let Some(end) = end else {
                let problem = ReadProblem::Expected {
                    what: "offsets that rise and stay within the connectivity",
                };
                return Err(self.fail_in(&ends, problem, ends.whole(i).to_string().as_bytes()));
            };
            cell.clear();
            cell.reserve_exact(end - start);
            for k in start..end {
                let index = corners.whole(k);
                if !usize::try_from(index).is_ok_and(|i| i < count) {
                    let problem = ReadProblem::IndexOutOfRange {
                        index,
                        count,
                        from_one: false,
                    };
                    return Err(self.fail_in(&corners, problem, index.to_string().as_bytes()));
                }
                // A file of at most 2 GiB has fewer vertices than 32 bits count.
                cell.push((first + index as usize) as u32);
            }
            let at = || self.xml.cursor.place_of(corners.place, corners.text);
            let added = match section {
                0 => self.surface.line(&cell),
                1 => self.surface.strip(&cell, &at),
                _ => self.surface.polygon(&cell, &at),
            };
            added.map_err(|problem| self.fail_in(&corners, problem, b""))?;
            start = end;
        }
        if start != corners.len() {
            let (what, declared) = ("the connectivity of the cells", corners.len() as u64);
            let problem = ReadProblem::SizeMismatch {
                what,
                declared,
                used: start as u64,
            };
            return Err(self.fail_in(&corners, problem, b""));
        }
        Ok(())
    }

    fn fail_in(&self, numbers: &Numbers<'_>, problem: ReadProblem, found: &[u8]) -> ReadError {
        self.xml
            .cursor
            .fail_at_offset(numbers.place, numbers.text, problem, found)
            .within(numbers.array.describe())
    }

    fn numbers(&mut self, array: Array<'a>, real: bool) -> Result<Numbers<'a>, ReadError> {
        self.decoded(array, real)
            .map_err(|error| error.within(array.describe()))
    }

    fn decoded(&mut self, array: Array<'a>, real: bool) -> Result<Numbers<'a>, ReadError> {
        let (text, base64) = match array.stored {
            Stored::Text(text) => return self.text(text, array, real),
            Stored::Base64(text) => (text, true),
            Stored::Appended(offset) => {
                let Some((data, base64)) = self.appended else {
                    return Err(
                        self.expected("AppendedData for an array with an offset", array.tag)
                    );
                };
                let data = usize::try_from(offset)
                    .ok()
                    .and_then(|offset| data.get(offset..));
                let problem = ReadProblem::Expected {
                    what: "an offset within the appended data",
                };
                (
                    data.ok_or_else(|| self.xml.fail(problem, array.tag))?,
                    base64,
                )
            }
        };
        let place = self
            .xml
            .cursor
            .offset_of(text)
            .unwrap_or(self.xml.bytes.len());
        let mut source = Source::new(text, base64);
        let bytes = source
            .array(self.layout)
            .map_err(|fault| self.fault(fault, place))?;
        self.layout.limit = self.layout.limit.saturating_sub(bytes.len() as u64);
        let Some(left) = self.encoded_left.checked_sub(source.used()) else {
            let problem = ReadProblem::Expected {
                what: "arrays that share no bytes",
            };
            return Err(self.xml.fail(problem, array.tag));
        };
        self.encoded_left = left;
        if bytes.len() % array.kind.bytes() != 0 {
            let (declared, used) = (bytes.len() as u64, array.kind.bytes() as u64);
            let problem = ReadProblem::SizeMismatch {
                what: "bytes of an array and of its type",
                declared,
                used,
            };
            return Err(self
                .xml
                .cursor
                .fail_at(FilePlace::Offset(place), problem, b""));
        }
        let values = Values::Bytes {
            bytes,
            kind: array.kind,
            big_endian: self.layout.big_endian,
        };
        Ok(Numbers {
            array,
            values,
            place,
            text: false,
        })
    }

    fn text(
        &mut self,
        text: &'a [u8],
        array: Array<'a>,
        real: bool,
    ) -> Result<Numbers<'a>, ReadError> {
        let mut words = Cursor::new("", text);
        let cursor = self.xml.cursor;
        let place = cursor
            .offset_of(text)
            .or(cursor.offset_of(array.tag))
            .unwrap_or_default();
        let (mut reals, mut wholes) = (Vec::new(), Vec::new());
        while let Some(word) = words.token() {
            if real {
                let value = coordinate(word, self.surface.vertices.len() + reals.len() / 3);
                let value = value.map_err(|problem| self.xml.fail(problem, word))?;
                if beyond_double(word, value) {
                    self.surface.underflow(&|| {
                        cursor.place_of(cursor.offset_of(word).unwrap_or(place), true)
                    });
                }
                reals.push(value);
            } else {
                wholes.push(integer(word).map_err(|problem| self.xml.fail(problem, word))?);
            }
        }
        let values = if real {
            Values::Real(reals)
        } else {
            Values::Whole(wholes)
        };
        Ok(Numbers {
            array,
            values,
            place,
            text: true,
        })
    }

    fn fault(&self, fault: Fault, place: usize) -> ReadError {
        let problem = match fault {
            Fault::Short => ReadProblem::Truncated { what: "an array" },
            Fault::Expected(what) => ReadProblem::Expected { what },
            Fault::TooMany { declared, possible } => {
                ReadProblem::CountExceedsFile { declared, possible }
            }
            Fault::TooLarge { bytes } => ReadProblem::TooLarge {
                bytes,
                limit: self.layout.limit,
            },
        };
        self.xml
            .cursor
            .fail_at(FilePlace::Offset(place), problem, b"")
    }
}

#[cfg(test)]
mod tests;
