//! `pliant fit`: values of a scene from a measured shape.

use std::path::{Path, PathBuf};
use std::time::Instant;

use super::failure::Failure;
use super::morph::read;
use super::options::Output;
use super::progress::Stoppable;
use super::run::stop_on_interrupt;
use super::sensitivities::{frame_of, refused};
use super::{environment, length_unit};
use crate::report::fit;
use crate::report::folder::{Folder, FolderError};
use crate::report::output::RunOutput;
use pliant::scene::uncertain_quantity;
use pliant::scene::units::{Dimension, parse};
use pliant::simulation::FitTarget;

/// Find values of a scene, such as stiffnesses, with which its result has a measured shape
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant fit scene.toml --target scan.stl --unit mm --noise '0.5 mm' --set 'muscle.*.material.bending=2e-4 N m +- 80 %'
  pliant fit implant.toml --measured 'pressure_pa=6.1 +- 0.2 kPa' --set 'skin.modulus=200 kPa +- 60 %'

Each value of the scene with an interval is fitted. Its interval counts as known beforehand, unless --no-prior is given; the fit
begins at its middle. --target is the measured shape of a body: the same vertices in the same order, or any other surface, to which
each vertex of the body is compared. --measured is a number, by the names that `pliant sensitivities` gives: MEASURE or BODY:MEASURE.

A shape alone cannot tell everything: where bones move as prescribed and no force is known, all stiffnesses times a number give the
same shape. The table of combinations says what the measurement tells, and which combination it cannot tell; give a measured
pressure or force with --measured, or a scene with gravity, to learn that one.

Results in pliant-out/NAME-fit: report.html, summary.json, fit.csv, BODY.vtp with the distance from the measured shape.
Exit codes: 0 done; 1 the fit did not converge, or a combination cannot be told; 2 bad usage or input; 130 or 143 interrupted.")]
pub(super) struct Arguments {
    /// A scene file, or the name of a built-in scene
    scene: String,
    /// The measured shape: FILE, or BODY=FILE where the scene has several bodies; may be given several times
    #[arg(long, value_name = "[BODY=]FILE", required_unless_present = "measured")]
    target: Vec<String>,
    /// Length unit of the measured shapes [default: m]
    #[arg(long, value_name = "UNIT", requires = "target")]
    unit: Option<String>,
    /// Standard deviation of each coordinate of a measured shape [default: what is left after the fit]
    #[arg(long, value_name = "LENGTH", requires = "target")]
    noise: Option<String>,
    /// A measured number with its interval, [BODY:]MEASURE=VALUE; may be given several times
    #[arg(long, value_name = "[BODY:]MEASURE=VALUE")]
    measured: Vec<String>,
    /// Frame of the measurement [default: the last one]
    #[arg(long, value_name = "FRAME", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    at: Option<u32>,
    /// Take the intervals of the scene for the start only
    #[arg(long)]
    no_prior: bool,
    #[command(flatten)]
    output: Output,
    #[arg(long, value_name = "KEY=VALUE", help = "Change the scene; may be given several times", long_help = super::options::set_help())]
    set: Vec<String>,
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let begun = Instant::now();
    let content = environment::load_content(&arguments.scene, &arguments.set)?;
    let frame = frame_of(&content, arguments.at)?;
    let target = target(arguments)?;
    let stop = stop_on_interrupt("stopping");
    arguments.output.threads.start();
    let folder = Folder::open(&arguments.output.folder(content.name(), "fit"))?;
    let said = Stoppable::new(frame, &stop);
    let variables = environment::variable;
    let found = pliant::simulation::fit(&content, frame, &target, variables, &said);
    said.bar.end();
    let found = match found {
        Ok(found) => found,
        Err(error) => return refused(error),
    };
    let output = fit::output(content.name(), frame, &found).map_err(FolderError::from)?;
    let output = RunOutput {
        time_s: begun.elapsed().as_secs_f64(),
        ..output
    };
    arguments.output.finish(&folder, output)
}

/// What the options say was measured.
fn target(arguments: &Arguments) -> Result<FitTarget, Failure> {
    let scale = arguments.unit.as_deref().map_or(Ok(1.0), length_unit)?;
    let mut target = FitTarget {
        has_prior: !arguments.no_prior,
        ..FitTarget::default()
    };
    for text in &arguments.target {
        // A file of this name needs no body.
        let (body, file) = match text.split_once('=') {
            Some((body, file)) if !Path::new(text).is_file() => (body.trim(), PathBuf::from(file)),
            _ => ("", PathBuf::from(text)),
        };
        target
            .shapes
            .push((body.to_owned(), read(&file, scale)?.mesh));
    }
    if let Some(text) = &arguments.noise {
        let bad = |message: String| Failure::usage(message, "give one such as --noise '0.5 mm'");
        let noise =
            parse(text, Dimension::Length).map_err(|e| bad(format!("--noise {text}: {e}")))?;
        if !(noise > 0.0) {
            return Err(bad(format!("--noise {text}: it is not greater than zero")));
        }
        target.noise = Some(noise);
    }
    for text in &arguments.measured {
        target.numbers.push(measured(text)?);
    }
    Ok(target)
}

/// A measured number: body, name, value and half of its interval.
fn measured(text: &str) -> Result<(String, String, f64, f64), Failure> {
    let bad = |message: String| {
        let hint = "give one such as --measured 'pressure_pa=6.1 +- 0.2 kPa' or --measured 'psoas:fibre_length_m=120 +- 2 mm'";
        Failure::usage(format!("--measured {text}: {message}"), hint)
    };
    let Some((name, value)) = text.split_once('=') else {
        return Err(bad("there is no `=`".to_owned()));
    };
    let (body, name) = name.split_once(':').unwrap_or(("", name));
    let name = name.trim();
    if name.is_empty() {
        return Err(bad("there is no name before the `=`".to_owned()));
    }
    let ends = [
        ("_m2", Dimension::Area),
        ("_m3", Dimension::Volume),
        ("_pa", Dimension::Pressure),
        ("_n", Dimension::Force),
        ("_m", Dimension::Length),
    ];
    let end = ends.iter().find(|(end, _)| name.ends_with(end));
    let dimension = end.map_or(Dimension::Ratio, |(_, dimension)| *dimension);
    let (value, half) =
        uncertain_quantity(value, dimension).map_err(|e| bad(format!("{e}; {}", e.help())))?;
    let half = half.ok_or_else(|| bad("it has no interval".to_owned()))?;
    Ok((body.trim().to_owned(), name.to_owned(), value, half))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn measured_numbers_have_a_unit_and_an_interval() {
        let read = |text: &str| measured(text).map_err(|e| e.terse());
        let pressure = read("pressure_pa=6 +- 0.2 kPa").expect("one");
        assert_eq!(
            (pressure.0.as_str(), pressure.1.as_str()),
            ("", "pressure_pa")
        );
        assert!((pressure.2 - 6e3).abs() <= 1e-9 && (pressure.3 - 200.0).abs() <= 1e-9);
        let length = read("psoas : fibre_length_m = 12 cm +- 1 %").expect("one");
        assert_eq!(
            (length.0.as_str(), length.1.as_str()),
            ("psoas", "fibre_length_m")
        );
        assert!((length.3 - 1.2e-3).abs() <= 1e-12);
        for wrong in [
            "pressure_pa",
            "pressure_pa=6 kPa",
            "pressure_pa=6 mm +- 1 mm",
            "=3 +- 1",
        ] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
    }
}
