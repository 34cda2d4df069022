//! Examination and optional repair of one mesh.

use std::path::Path;

use serde::Serialize;

use crate::commands::failure::Failure;
use pliant::io::{self, Encoding, FilePlace, Format, MeshFile, ReadError};
use pliant::mesh::{
    Deviation, Finding, Health, Repair, RepairChange, RepairOptions, deviation, repair,
};
use pliant::scene::likely_units;
use pliant::simulation::LoadError;

/// Result for one file.
pub(super) enum Outcome {
    /// The file is a mesh.
    Checked(Box<Checked>),
    /// The file cannot be read, or its repaired form cannot be written.
    Failed {
        /// Name of the file.
        file: String,
        /// The cause.
        failure: Failure,
    },
}

impl Outcome {
    /// Name of the file as given.
    pub fn file(&self) -> &str {
        match self {
            Self::Checked(checked) => &checked.file,
            Self::Failed { file, .. } => file,
        }
    }

    pub fn checked(&self) -> Option<&Checked> {
        match self {
            Self::Checked(checked) => Some(checked),
            Self::Failed { .. } => None,
        }
    }

    pub fn failure(&self) -> Option<&Failure> {
        match self {
            Self::Checked(_) => None,
            Self::Failed { failure, .. } => Some(failure),
        }
    }
}

impl Serialize for Outcome {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Failed<'a> {
            file: &'a str,
            fit: bool,
            error: String,
        }
        match self {
            Self::Checked(checked) => checked.serialize(serializer),
            Self::Failed { file, failure } => Failed {
                file,
                fit: false,
                error: failure.terse(),
            }
            .serialize(serializer),
        }
    }
}

/// Results for one mesh; lengths, areas and volumes are in the unit of the file.
#[derive(Serialize)]
pub(super) struct Checked {
    /// Name of the file as given.
    pub file: String,
    /// The format of its content.
    pub format: &'static str,
    /// Length of the unit [m], if known.
    pub unit_m: Option<f64>,
    /// Units for which the size is plausible for a part of a body, the most likely first; empty if
    /// the unit is known.
    pub likely_units: Vec<&'static str>,
    /// True if a simulation accepts the mesh unchanged.
    pub fit: bool,
    /// Number of polylines.
    pub lines: usize,
    #[serde(flatten)]
    pub health: Health,
    /// Defects of the mesh.
    pub findings: Vec<Observation>,
    /// Result of the repair.
    pub repair: Option<Mended>,
}

/// A defect of the mesh or a warning of the reader, with its repair.
#[derive(Clone, Serialize)]
pub(super) struct Observation {
    pub code: &'static str,
    pub count: usize,
    pub message: String,
    pub repair: String,
    /// First place in the mesh.
    pub place: Option<pliant::mesh::FindingPlace>,
    /// First line in the file, if known.
    pub line: Option<usize>,
    /// First byte in the file, if known.
    pub offset: Option<usize>,
}

impl Observation {
    fn of(finding: &Finding) -> Self {
        Self {
            code: finding.kind.code(),
            count: finding.count,
            message: finding.message.clone(),
            repair: in_options(finding.kind.repair()),
            place: Some(finding.place.clone()),
            line: None,
            offset: None,
        }
    }

    fn of_reader(warned: &io::Warned) -> Self {
        let (line, offset) = match warned.first {
            FilePlace::Whole => (None, None),
            FilePlace::Line(line) => (Some(line), None),
            FilePlace::Offset(offset) => (None, Some(offset)),
        };
        Self {
            code: warned.warning.code(),
            count: warned.count,
            message: warned.to_string(),
            repair: warned.warning.help().to_owned(),
            place: None,
            line,
            offset,
        }
    }

    pub fn refuses(&self) -> bool {
        self.code.starts_with('E')
    }
}

/// A repair in words of the command line.
fn in_options(repair: Repair) -> String {
    match repair {
        Repair::Automatic(does) => format!("--repair {does}"),
        Repair::CloseHoles => {
            "--repair joins rims whose vertices coincide; --close-holes closes the others"
                .to_owned()
        }
        Repair::KeepLargest => "--keep-largest drops all pieces but the largest".to_owned(),
        Repair::ByHand(what) => what.to_owned(),
    }
}

/// A repaired mesh.
#[derive(Serialize)]
pub(super) struct Mended {
    /// Path of the repaired mesh.
    pub file: String,
    /// True if a simulation accepts it.
    pub fit: bool,
    pub changes: Vec<RepairChange>,
    /// Greatest displacement of a vertex.
    pub moved: f64,
    /// Distance between the surfaces before and after; `None` without a change.
    pub distance: Option<Deviation>,
    /// Number of polylines that the format of the file cannot store.
    pub lines_lost: usize,
    pub health: Health,
    pub findings: Vec<Observation>,
}

impl Checked {
    /// True if a simulation accepts the final mesh.
    pub fn is_fit(&self) -> bool {
        self.repair.as_ref().map_or(self.fit, |mended| mended.fit)
    }
}

/// Reads, examines and, with a target, repairs and writes one mesh.
pub(super) fn check(
    path: &Path,
    unit: Option<f64>,
    target: Option<&Path>,
    options: &RepairOptions,
) -> Outcome {
    let file = path.display().to_string();
    let failed = |failure| Outcome::Failed {
        file: file.clone(),
        failure,
    };
    let read = match io::read(path) {
        Ok(read) => read,
        Err(error) => return failed(of_reading(error)),
    };
    let health = Health::with_lines(&read.mesh, &read.lines);
    let mut findings: Vec<Observation> = health.findings.iter().map(Observation::of).collect();
    findings.extend(read.warnings.iter().map(Observation::of_reader));
    findings.extend(size_warning(&health, unit));
    let likely = if unit.is_some() {
        Vec::new()
    } else {
        likely_units(health.length())
    };
    let mended = match target
        .map(|target| mend(&read, target, options))
        .transpose()
    {
        Ok(mended) => mended,
        Err(error) => {
            return failed(Failure::usage(
                error.to_string(),
                format!("repair into another folder or format: {}", io::writable()),
            ));
        }
    };
    Outcome::Checked(Box::new(Checked {
        file: file.clone(),
        format: read.format.map_or("none", Format::name),
        unit_m: unit,
        likely_units: likely.into_iter().map(|(name, _)| name).collect(),
        fit: health.is_fit(),
        lines: read.lines.len(),
        health,
        findings,
        repair: mended,
    }))
}

fn of_reading(error: ReadError) -> Failure {
    LoadError::from(Box::new(error)).into()
}

fn mend(read: &MeshFile, target: &Path, options: &RepairOptions) -> Result<Mended, io::WriteError> {
    let repaired = repair(&read.mesh, &read.lines, options);
    let lines_lost = io::write(target, &repaired.mesh, &repaired.lines, Encoding::Binary)?;
    let health = Health::with_lines(&repaired.mesh, &repaired.lines);
    let unchanged = repaired.changes.is_empty();
    Ok(Mended {
        file: target.display().to_string(),
        fit: health.is_fit(),
        findings: health.findings.iter().map(Observation::of).collect(),
        changes: repaired.changes,
        moved: repaired.moved,
        distance: (!unchanged).then(|| deviation(&read.mesh, &repaired.mesh)),
        lines_lost,
        health,
    })
}

/// Limits of plausible sizes [m].
const ODD: [f64; 2] = [1e-3, 100.0];

fn size_warning(health: &Health, unit: Option<f64>) -> Option<Observation> {
    let side = health.length() * unit?;
    let odd = !(ODD[0]..=ODD[1]).contains(&side);
    odd.then(|| Observation {
        code: "W014",
        count: 1,
        message: format!("in this unit the longest side is {side:e} m"),
        repair: "check the unit".to_owned(),
        place: None,
        line: None,
        offset: None,
    })
}
