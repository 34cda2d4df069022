//! Paths of muscles for OpenSim 4.5 and later: a set of polynomials (`FunctionBasedPath`), tables
//! (`.sto`) with the column names of its own fitter, and a model with the paths in place.
//!
//! The path length is the mean length of the fibres. A tendon adds a constant, which moment arms do
//! not see: the tendon slack length of the muscle takes it up.

use std::io::Write as _;

use serde_json::{Value, json};

use super::super::Table;
use super::super::output::OutputFile;
use pliant::format::number;
use pliant::io::{file_name, write_whole};
use pliant::moment_arms::Arms;
use pliant::opensim::paths::{
    FittedPath, MOST_ORDER, PathSamples, TOLERANCE, write_set, write_table,
};

/// Names of a model.
#[derive(Clone, Debug, Default)]
pub struct OpenSimNames {
    /// Absolute path of the coordinate, such as `/jointset/hip_r/hip_flexion_r`.
    pub coordinate: String,
    /// Names of muscles of the scene with the forces of the model, one for each bundle.
    pub forces: Vec<(String, Vec<String>)>,
}

impl OpenSimNames {
    /// The absolute paths of the forces of a muscle.
    pub fn of(&self, muscle: &str) -> Vec<String> {
        let named = self.forces.iter().find(|(name, _)| name == muscle);
        // A name of OpenSim has no spaces.
        let own = vec![muscle.replace(char::is_whitespace, "_")];
        let forces = named.map_or(&own, |(_, forces)| forces).iter();
        let absolute = |force: &String| match force.starts_with('/') {
            true => force.clone(),
            false => format!("/forceset/{force}"),
        };
        forces.map(absolute).collect()
    }

    /// The first force that two of these muscles have.
    pub fn shared<'m>(&self, muscles: impl IntoIterator<Item = &'m str>) -> Option<String> {
        let mut all = std::collections::BTreeSet::new();
        let mut forces = muscles.into_iter().flat_map(|muscle| self.of(muscle));
        forces.find(|force| !all.insert(force.clone()))
    }

    /// The samples of each muscle of a sweep.
    pub fn samples(&self, arms: &[Arms]) -> Vec<(String, PathSamples)> {
        let of = |a: &Arms| {
            let count = a.angles.len().min(a.length.len()).min(a.mean.len());
            let samples = PathSamples {
                force: self.of(&a.name).remove(0),
                coordinates: vec![self.coordinate.clone()],
                values: a.angles[..count].iter().map(|q| vec![*q]).collect(),
                lengths: a.length[..count].to_vec(),
                arms: a.mean[..count].iter().map(|r| vec![*r]).collect(),
            };
            (a.name.clone(), samples)
        };
        arms.iter().map(of).collect()
    }
}

/// A path with the muscle that it stands for.
pub struct Fitted {
    pub muscle: String,
    pub path: FittedPath,
}

/// The path of each muscle, and a finding for each without one, or whose path does not meet the
/// tolerance.
pub fn fit(samples: &[(String, PathSamples)], most_order: usize) -> (Vec<Fitted>, Vec<String>) {
    let (mut paths, mut findings) = (Vec::new(), Vec::new());
    for (muscle, samples) in samples {
        let Some(path) = samples.fit(TOLERANCE, most_order) else {
            findings.push(format!(
                "{muscle}: no path for OpenSim, as {} poses are too few for a polynomial, or no coordinate moves it",
                samples.values.len()
            ));
            continue;
        };
        if !path.meets(TOLERANCE) {
            findings.push(format!(
                "{muscle}: no polynomial up to order {} for {} meets {} mm: its moment arm is off by {} mm (RMS) where a muscle snaps or leaves a \
                 bone, or where poses are too few; see opensim in summary.json",
                most_order.min(MOST_ORDER),
                path.force,
                1e3 * TOLERANCE,
                number(1e3 * path.arm_error[0])
            ));
        }
        paths.push(Fitted {
            muscle: muscle.clone(),
            path,
        });
    }
    (paths, findings)
}

/// The paths as JSON.
pub fn to_json(paths: &[Fitted]) -> Value {
    let one = |Fitted { muscle, path }: &Fitted| {
        json!({
            "muscle": muscle,
            "force": path.force,
            "coordinates": path.coordinates,
            "order": path.order,
            "coefficients": path.coefficients,
            "length_rms_m": path.length_error[0],
            "length_max_m": path.length_error[1],
            "moment_arm_rms_m": path.arm_error[0],
            "moment_arm_max_m": path.arm_error[1],
            "meets": path.meets(TOLERANCE),
        })
    };
    paths.iter().map(one).collect()
}

/// The paths as a table.
pub fn table(paths: &[Fitted]) -> Table {
    let columns = [
        "muscle",
        "force",
        "order",
        "length, RMS [mm]",
        "greatest [mm]",
        "moment arm, RMS [mm]",
        "greatest [mm]",
    ];
    let mut table = Table::new("Paths for OpenSim, at poses left out of the fit", columns);
    for Fitted { muscle, path } in paths {
        let mm = |m: f64| number(1e3 * m);
        table.row([
            muscle.clone(),
            path.force.clone(),
            path.order.to_string(),
            mm(path.length_error[0]),
            mm(path.length_error[1]),
            mm(path.arm_error[0]),
            mm(path.arm_error[1]),
        ]);
    }
    table
}

/// The set of paths, the tables of lengths, moment arms and coordinates, and the model with the
/// paths in place if its text is given.
pub fn files<'a>(
    name: &str,
    paths: Vec<Fitted>,
    samples: Vec<(String, PathSamples)>,
    spliced: Option<String>,
) -> Vec<OutputFile<'a>> {
    let file = file_name(name);
    let samples: Vec<PathSamples> = samples.into_iter().map(|(_, samples)| samples).collect();
    let fitted: Vec<FittedPath> = paths.into_iter().map(|fitted| fitted.path).collect();
    let coordinates = samples
        .first()
        .map_or(Vec::new(), |s| s.coordinates.clone());
    let count = samples.iter().map(|s| s.values.len()).min().unwrap_or(0);
    let lengths: Vec<String> = samples
        .iter()
        .map(|s| format!("{}_length", s.force))
        .collect();
    let mut arms = Vec::new();
    for s in &samples {
        for coordinate in &s.coordinates {
            let short = coordinate.rsplit('/').next().unwrap_or_default();
            arms.push(format!("{}_moment_arm_{short}", s.force));
        }
    }
    let values: Vec<String> = coordinates.iter().map(|c| format!("{c}/value")).collect();
    let samples = std::rc::Rc::new(samples);
    let table =
        |what: &'static str, columns: Vec<String>, row: fn(&[PathSamples], usize) -> Vec<f64>| {
            let samples = samples.clone();
            OutputFile::new(format!("{file}_{what}.sto"), move |path| {
                write_table(path, what, &columns, (0..count).map(|k| row(&samples, k)))
            })
        };
    let mut files = vec![
        OutputFile::new(format!("{file}_FunctionBasedPathSet.xml"), move |path| {
            write_set(path, &fitted)
        }),
        table("path_lengths", lengths, |all, k| {
            all.iter().map(|s| s.lengths[k]).collect()
        }),
        table("moment_arms", arms, |all, k| {
            all.iter().flat_map(|s| s.arms[k].clone()).collect()
        }),
        table("coordinate_values", values, |all, k| {
            all[0].values[k].clone()
        }),
    ];
    if let Some(text) = spliced {
        files.push(OutputFile::new(format!("{file}_model.osim"), move |path| {
            write_whole(path, |w| w.write_all(text.as_bytes()))
        }));
    }
    files
}
