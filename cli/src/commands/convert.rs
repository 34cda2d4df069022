//! `pliant convert`: conversion of a mesh to another format or unit.

use std::path::{Path, PathBuf};
use std::time::Instant;

use nalgebra::Point3;
use serde_json::json;

use super::failure::Failure;
use super::length_unit;
use super::options::Printing;
use crate::report::output::RunOutput;
use pliant::io::{self, Encoding, MeshFile, WriteError};
use pliant::mesh::{Topology, TriangleMesh};
use pliant::simulation::LoadError;
use pliant::springs::format::{self, SpringFile};

/// Write a mesh in another format or unit
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant convert femur.vtk femur.obj
  pliant convert scan.stl scan.vtp --unit mm --to-unit m
  pliant convert femur.obj femur.ply --ascii
  pliant convert muscle.vtk muscle.springs

The format read is found in the content, the one written in the ending: .obj, .ply, .stl, .vtk or .vtp. Vertices, triangles
and polylines are kept, other data are not. All formats but binary STL keep every bit of a coordinate.

A file of springs (docs/springs.md) is one by its ending, .springs, on either side. Of a mesh all points are points of the surface,
its edges are springs of the stiffness 1/L for the length L, and its polylines are pieces of fibres. From a file of springs come its
triangles, and its fibres as polylines; from one to another, all is kept. Stiffnesses stay as they are in another unit.

Exit codes: 0 done; 2 the file cannot be read as a mesh, or the result cannot be written.")]
pub(super) struct Arguments {
    /// The mesh to read
    input: PathBuf,
    /// The file to write
    output: PathBuf,
    /// Length unit of the input file, such as mm
    #[arg(long, value_name = "UNIT", requires = "to_unit")]
    unit: Option<String>,
    /// Length unit of the output file, such as m
    #[arg(long, value_name = "UNIT", requires = "unit")]
    to_unit: Option<String>,
    /// Write numbers as text if the format permits text and binary
    #[arg(long)]
    ascii: bool,
    /// Overwrite an existing file
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    printing: Printing,
}

/// What is converted: a mesh, or a file of springs.
enum Content {
    Mesh(MeshFile),
    Springs(SpringFile),
}

/// The ending of files of springs.
const SPRINGS: &str = "springs";

fn is_of_springs(path: &Path) -> bool {
    path.extension()
        .is_some_and(|ending| ending.eq_ignore_ascii_case(SPRINGS))
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let begun = Instant::now();
    if arguments.output.exists() && !arguments.force {
        let message = format!("{} is there already", arguments.output.display());
        return Err(Failure::usage(message, "name another file, or add --force"));
    }
    let input = arguments.input.display().to_string();
    let output = arguments.output.display().to_string();
    let content = read(arguments)?;
    let (format, [vertices, triangles, lines], warnings) = match &content {
        Content::Mesh(file) => {
            let warnings = file.warnings.iter().map(|w| w.terse(&input));
            let counts = [
                file.mesh.vertices.len(),
                file.mesh.triangles.len(),
                file.lines.len(),
            ];
            (
                file.format.map_or("none", io::Format::name),
                counts,
                warnings.collect(),
            )
        }
        Content::Springs(file) => {
            let counts = [file.position.len(), file.triangles.len(), file.fibres.len()];
            (SPRINGS, counts, file.notes.clone())
        }
    };
    let lost = write(arguments, content)?;
    let text = format!(
        "{input} ({format}): {vertices} vertices, {triangles} triangles, {lines} polylines -> {output}\n"
    );
    let notes = lost
        .iter()
        .filter(|(_, count)| *count > 0)
        .map(|(what, count)| format!("{output}: {count} {what} are lost: this format has none"));
    let lines_lost = lost.iter().find(|(what, _)| *what == LINES);
    Ok(arguments.printing.finish(RunOutput {
        kind: "convert",
        measures: json!({
            "input": input,
            "input_format": format,
            "output": output,
            "vertices": vertices,
            "triangles": triangles,
            "lines": lines,
            "lines_lost": lines_lost.map_or(0, |(_, count)| *count),
        }),
        notes: notes.chain(warnings).collect(),
        time_s: begun.elapsed().as_secs_f64(),
        name: input,
        text,
        written: vec![output],
        ..RunOutput::default()
    }))
}

/// Reads the file, in the unit of the output.
fn read(arguments: &Arguments) -> Result<Content, Failure> {
    let scale = |unit: &Option<String>| unit.as_deref().map_or(Ok(1.0), length_unit);
    let (from, to) = (scale(&arguments.unit)?, scale(&arguments.to_unit)?);
    let read = match is_of_springs(&arguments.input) {
        true => format::read(&arguments.input).map(Content::Springs),
        false => io::read(&arguments.input).map(Content::Mesh),
    };
    let mut content = read.map_err(|error| LoadError::from(Box::new(error)))?;
    let vertices = match &mut content {
        Content::Mesh(file) => &mut file.mesh.vertices,
        Content::Springs(file) => &mut file.position,
    };
    for vertex in vertices.iter_mut() {
        vertex.coords.apply(|c| *c = rescaled(*c, from, to));
    }
    let is_finite = |v: &Point3<f64>| v.coords.iter().all(|c| c.is_finite());
    if let Some(vertex) = vertices.iter().position(|v| !is_finite(v)) {
        let input = arguments.input.display();
        let message = format!("{input}: vertex {vertex} is too large for a double in the new unit");
        return Err(Failure::usage(message, "choose a larger unit"));
    }
    Ok(content)
}

/// What the format written can lack.
const LINES: &str = "polylines";

/// Writes the file. Returns what its format cannot hold, and how much of it.
fn write(arguments: &Arguments, content: Content) -> Result<Vec<(&'static str, usize)>, Failure> {
    let encoding = if arguments.ascii {
        Encoding::Text
    } else {
        Encoding::Binary
    };
    let refused = |error: WriteError| {
        let hint = match error {
            WriteError::UnknownEnding { .. } => {
                format!("end the name in one of {}, .{SPRINGS}", io::writable())
            }
            WriteError::Io { .. } => "check the folder and whether you may write there".to_owned(),
        };
        Failure::usage(error.to_string(), hint)
    };
    let path = &arguments.output;
    if is_of_springs(path) {
        let file = match content {
            Content::Springs(file) => file,
            Content::Mesh(file) => springs_of(file)?,
        };
        let source = |source| {
            refused(WriteError::Io {
                file: path.display().to_string(),
                source,
            })
        };
        format::write(path, &file).map_err(source)?;
        return Ok(Vec::new());
    }
    let (file, lost) = match content {
        Content::Mesh(file) => (file, Vec::new()),
        Content::Springs(file) => mesh_of(file),
    };
    let lines = io::write(path, &file.mesh, &file.lines, encoding).map_err(refused)?;
    Ok(std::iter::once((LINES, lines)).chain(lost).collect())
}

/// The file of springs of a mesh.
fn springs_of(file: MeshFile) -> Result<SpringFile, Failure> {
    let MeshFile { mesh, lines, .. } = file;
    let topology = Topology::new(&mesh);
    let lengths = topology.edge_lengths(&mesh);
    let edges = topology.edges.iter().zip(lengths);
    let springs: Vec<([u32; 2], f64)> = edges
        .filter(|(_, length)| *length > 0.0)
        .map(|(ends, length)| (*ends, 1.0 / length))
        .collect();
    if let Some((ends, _)) = springs.iter().find(|(_, stiffness)| !stiffness.is_finite()) {
        let message = format!(
            "the edge from {} to {} is too short for a stiffness of 1/L",
            ends[0], ends[1]
        );
        return Err(Failure::usage(message, "give another --unit and --to-unit"));
    }
    let pieces = lines.iter().flat_map(|line| line.windows(2));
    let pieces = pieces.filter(|piece| piece[0] != piece[1]);
    Ok(SpringFile {
        surface: vec![true; mesh.vertices.len()],
        fibres: pieces.map(|piece| [piece[0], piece[1]]).collect(),
        position: mesh.vertices,
        triangles: mesh.triangles,
        springs,
        ..SpringFile::default()
    })
}

/// The mesh of a file of springs, and what of it no mesh has.
fn mesh_of(file: SpringFile) -> (MeshFile, Vec<(&'static str, usize)>) {
    let lost = vec![
        ("springs", file.springs.len()),
        ("points of areas", file.origin.len() + file.insertion.len()),
    ];
    let mesh = TriangleMesh {
        vertices: file.position,
        triangles: file.triangles,
    };
    let lines = chained(&file.fibres);
    (
        MeshFile {
            mesh,
            lines,
            ..MeshFile::default()
        },
        lost,
    )
}

/// Pieces of fibres as polylines: a piece that begins where the one before ends goes on with it.
fn chained(pieces: &[[u32; 2]]) -> Vec<Vec<u32>> {
    let mut lines: Vec<Vec<u32>> = Vec::new();
    for [a, b] in pieces {
        match lines.last_mut().filter(|line| line.last() == Some(a)) {
            Some(line) => line.push(*b),
            None => lines.push(vec![*a, *b]),
        }
    }
    lines
}

/// A coordinate in another unit, rounded once: the factor is always at least 1.
fn rescaled(coordinate: f64, from: f64, to: f64) -> f64 {
    // Powers of ten below 1 are not exact doubles, but their inverses are.
    if from >= to {
        coordinate * (from / to).round_if_near()
    } else {
        coordinate / (to / from).round_if_near()
    }
}

/// A ratio of two units.
trait Ratio {
    /// The nearest integer, if the difference is rounding error.
    fn round_if_near(self) -> f64;
}

impl Ratio for f64 {
    fn round_if_near(self) -> f64 {
        let whole = self.round();
        if (self - whole).abs() <= 4.0 * f64::EPSILON * whole {
            whole
        } else {
            self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_of_fibres_are_polylines_again() {
        let lines = vec![vec![0, 1, 2], vec![5, 4]];
        let pieces: Vec<[u32; 2]> = lines
            .iter()
            .flat_map(|line| line.windows(2))
            .map(|piece| [piece[0], piece[1]])
            .collect();
        assert_eq!(chained(&pieces), lines);
    }

    #[test]
    fn units_are_exact_both_ways() {
        for x in [0.1, 83.56, -1.0 / 3.0, 1e300, 5e-324] {
            assert_eq!(rescaled(x, 1e-3, 1e-3), x);
            assert_eq!(rescaled(x, 1e-3, 1.0), x / 1000.0);
            assert_eq!(rescaled(x, 1.0, 1e-3), x * 1000.0);
            assert_eq!(rescaled(x, 1e-2, 1e-3), x * 10.0);
        }
        assert_eq!(rescaled(1.0, 0.0254, 1e-3), 25.4);
    }
}
