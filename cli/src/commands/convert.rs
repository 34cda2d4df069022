//! `pliant convert`: conversion of a mesh to another format or unit.

use std::path::PathBuf;
use std::time::Instant;

use nalgebra::Point3;
use serde_json::json;

use super::failure::Failure;
use super::length_unit;
use super::options::Printing;
use crate::report::output::RunOutput;
use pliant::io::{self, Encoding, MeshFile, WriteError};
use pliant::simulation::LoadError;

/// Write a mesh in another format or unit
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant convert femur.vtk femur.obj
  pliant convert scan.stl scan.vtp --unit mm --to-unit m
  pliant convert femur.obj femur.ply --ascii

The format read is found in the content, the one written in the ending: .obj, .ply, .stl, .vtk or .vtp. Vertices, triangles
and polylines are kept, other data are not. All formats but binary STL keep every bit of a coordinate.

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

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let begun = Instant::now();
    if arguments.output.exists() && !arguments.force {
        let message = format!("{} is there already", arguments.output.display());
        return Err(Failure::usage(message, "name another file, or add --force"));
    }
    let file = read(arguments)?;
    let lines_lost = write(arguments, &file)?;
    let input = arguments.input.display().to_string();
    let output = arguments.output.display().to_string();
    let format = file.format.map_or("none", io::Format::name);
    let (vertices, triangles, lines) = (
        file.mesh.vertices.len(),
        file.mesh.triangles.len(),
        file.lines.len(),
    );
    let text = format!(
        "{input} ({format}): {vertices} vertices, {triangles} triangles, {lines} polylines -> {output}\n"
    );
    let lost = (lines_lost > 0)
        .then(|| format!("{output}: {lines_lost} polylines are lost: this format has none"));
    let warnings = file.warnings.iter().map(|w| w.terse(&input));
    Ok(arguments.printing.finish(RunOutput {
        kind: "convert",
        measures: json!({
            "input": input,
            "input_format": format,
            "output": output,
            "vertices": vertices,
            "triangles": triangles,
            "lines": lines,
            "lines_lost": lines_lost,
        }),
        notes: lost.into_iter().chain(warnings).collect(),
        time_s: begun.elapsed().as_secs_f64(),
        name: input,
        text,
        written: vec![output],
        ..RunOutput::default()
    }))
}

/// Reads the mesh, in the unit of the output.
fn read(arguments: &Arguments) -> Result<MeshFile, Failure> {
    let scale = |unit: &Option<String>| unit.as_deref().map_or(Ok(1.0), length_unit);
    let (from, to) = (scale(&arguments.unit)?, scale(&arguments.to_unit)?);
    let mut file = io::read(&arguments.input).map_err(|e| LoadError::from(Box::new(e)))?;
    for vertex in &mut file.mesh.vertices {
        vertex.coords.apply(|c| *c = rescaled(*c, from, to));
    }
    let is_finite = |v: &Point3<f64>| v.coords.iter().all(|c| c.is_finite());
    if let Some(vertex) = file.mesh.vertices.iter().position(|v| !is_finite(v)) {
        let input = arguments.input.display();
        let message = format!("{input}: vertex {vertex} is too large for a double in the new unit");
        return Err(Failure::usage(message, "choose a larger unit"));
    }
    Ok(file)
}

/// Writes the mesh. Returns the number of polylines that its format cannot store.
fn write(arguments: &Arguments, file: &MeshFile) -> Result<usize, Failure> {
    let encoding = if arguments.ascii {
        Encoding::Text
    } else {
        Encoding::Binary
    };
    io::write(&arguments.output, &file.mesh, &file.lines, encoding).map_err(|error| {
        let hint = match error {
            WriteError::UnknownEnding { .. } => {
                format!("end the name in one of {}", io::writable())
            }
            WriteError::Io { .. } => "check the folder and whether you may write there".to_owned(),
        };
        Failure::usage(error.to_string(), hint)
    })
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
