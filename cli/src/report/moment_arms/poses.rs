//! Files of a run through poses of a model: lengths and moment arms of fibres, bundles and muscles
//! over several coordinates, and paths for OpenSim.

use serde_json::json;

use super::super::output::{DataFile, OutputFile, Plot, RunOutput, Verdict};
use super::super::{LinePlot, Table};
use super::opensim::{self, Fitted};
use super::{across_check, encoded, explanations, straight_verdict};
use pliant::fibres::length;
use pliant::format::number;
use pliant::io::file_name;
use pliant::io::pvd::Collection;
use pliant::moment_arms::{MuscleStepper, PoseSet, SweepRun, extremes};
use pliant::opensim::paths::{FittedPath, PathSamples};
use pliant::opensim::{ModelDrive, MuscleParameters, normalised_lengths};
use pliant_render::{Frame, PictureError};

/// Number of points of a plotted curve.
const PLOTTED: usize = 41;

/// Parameters of a run through poses, for the report.
pub struct Posed {
    /// Name of the scene.
    pub scene: String,
    /// The model with the bones of the scene.
    pub drive: std::sync::Arc<ModelDrive>,
    /// The poses.
    pub set: PoseSet,
    /// Bundles of fibres of each muscle, with their forces.
    pub bundles: Vec<Vec<(String, Vec<usize>)>>,
    /// Greatest order of a polynomial.
    pub most_order: usize,
    /// Name and text of the model, if a model with the paths in place is written.
    pub splice: Option<(String, String)>,
    /// True if this model also gets the parameters of the muscles.
    pub replaces_parameters: bool,
    /// Time [s].
    pub time_s: f64,
    /// True if the user stopped the run.
    pub interrupted: bool,
}

impl Posed {
    fn coordinate(&self, k: usize) -> &pliant::opensim::Coordinate {
        &self.drive.model.coordinates[self.set.coordinates[k]]
    }

    /// A value of coordinate `k` in degrees, or in millimetres.
    fn shown(&self, k: usize, value: f64) -> f64 {
        match self.coordinate(k).is_angle {
            true => value.to_degrees(),
            false => 1e3 * value,
        }
    }

    fn unit(&self, k: usize) -> &'static str {
        if self.coordinate(k).is_angle {
            "deg"
        } else {
            "mm"
        }
    }
}

/// Writes all files except the fibres.
///
/// # Errors
/// A picture that cannot be encoded.
pub fn output_of_poses<'a>(
    posed: &'a Posed,
    running: &'a SweepRun,
    series: Collection,
    pictures: &[(String, Frame)],
) -> Result<RunOutput<'a>, PictureError> {
    let Posed { drive, set, .. } = posed;
    let mut samples: Vec<(String, PathSamples)> = Vec::new();
    for (muscle, bundles) in running.muscles.iter().zip(&posed.bundles) {
        for (force, fibres) in bundles {
            let path = set.path(&drive.model, muscle, fibres, force);
            samples.push((muscle.name.clone(), path));
        }
    }
    let (paths, mut findings) = opensim::fit(&samples, posed.most_order);
    let parameters = parameters(posed, running, &samples);
    let fitted: Vec<FittedPath> = paths.iter().map(|f| f.path.clone()).collect();
    // A slack length of a path that stays would be wrong.
    let with_path = |p: &&MuscleParameters| fitted.iter().any(|path| path.force == p.force);
    let replaced: Vec<MuscleParameters> = match posed.replaces_parameters {
        true => parameters.iter().filter(with_path).cloned().collect(),
        false => Vec::new(),
    };
    if posed.splice.is_some() {
        findings.extend(slack(&fitted, &replaced));
    }
    let spliced = posed.splice.as_ref().and_then(|(file, text)| {
        let spliced = pliant::opensim::paths::splice(text, file, &fitted, &replaced);
        spliced
            .map_err(|error| findings.push(error.to_string()))
            .ok()
    });
    let tables = vec![
        arms_table(posed, &samples),
        opensim::table(&paths),
        parameter_table(&parameters),
    ];
    let plots = samples
        .iter()
        .flat_map(|(muscle, samples)| plots(posed, muscle, samples, &paths))
        .collect();
    let mut notes = running.simulation.notes.clone();
    if !running.left_out.is_empty() {
        notes.push(format!(
            "over none of these joints, and left out: {}",
            running.left_out.join(", ")
        ));
    }
    let complete = set.complete(running.done());
    let names: Vec<&str> = (0..set.coordinates.len())
        .map(|k| posed.coordinate(k).name.as_str())
        .collect();
    let measures = json!({
        "model": drive.model.name,
        "coordinates": names,
        "samples": set.samples.len(),
        "samples_done": complete,
        "left_out": running.left_out,
        "muscles": running.muscles.iter().map(|m| json!({
            "muscle": m.name,
            "fibres": m.fibres.len(),
            "coverage": m.quality.coverage,
            "length_mean_at_rest_m": m.quality.length_mean_m,
            "pennation_mean_deg": m.quality.pennation_mean_rad.to_degrees(),
            "cross_section_m2": m.physiological_area,
            "points_in_bone": m.points_in_bone,
            "point_depth_max_m": m.depth,
            "vertex_depth_max_m": m.vertex_depth,
            "volume_error_max": m.volume_error,
            "values_not_converged": m.unconverged,
        })).collect::<Vec<_>>(),
        "opensim": opensim::to_json(&paths),
        "parameters": parameters.iter().map(|p| json!({
            "force": p.force,
            "max_isometric_force_n": p.max_isometric_force,
            "optimal_fibre_length_m": p.optimal_fibre_length,
            "tendon_slack_length_m": p.tendon_slack_length,
            "pennation_deg": p.pennation.to_degrees(),
            "mapped": p.is_mapped(),
        })).collect::<Vec<_>>(),
    });
    let data = vec![bundle_rows(posed, &samples), fibre_rows(posed, running)];
    let mut files = vec![OutputFile::new("fibres.pvd", move |path| {
        series.write(path)
    })];
    files.extend(opensim::files(&posed.scene, paths, samples, spliced));
    Ok(RunOutput {
        kind: "moment_arms_over_poses",
        name: posed.scene.clone(),
        measures,
        findings,
        verdicts: verdicts(posed, running),
        notes,
        interrupted: posed.interrupted,
        time_s: posed.time_s,
        title: format!("{}: moment arms about {}", posed.scene, names.join(", ")),
        text: format!(
            "{}: {complete} of {} samples over {} in {:.1} s\n",
            posed.scene,
            set.samples.len(),
            names.join(", "),
            posed.time_s
        ),
        tables_of_text: tables.len(),
        tables,
        plots_title: "Over each coordinate, the others in the middle of their ranges".to_owned(),
        plots,
        pictures: encoded(pictures)?,
        explanations: explanations(MuscleStepper::Spread),
        data,
        files,
        ..RunOutput::default()
    })
}

/// Whether each muscle was moved through all poses.
fn verdicts(posed: &Posed, running: &SweepRun) -> Vec<Verdict> {
    let mut all = Vec::new();
    for (body, m) in running.muscles.iter().enumerate() {
        let at = match &m.stopped {
            None => m.name.clone(),
            Some((frame, why)) => format!("{}, frame {frame}: {why:?}", m.name),
        };
        let moved = "the muscle moves without being stopped";
        all.push(Verdict::new(moved, m.stopped.is_none()).at(at));
        all.extend(across_check(&running.simulation, body, &m.name));
        let unconverged = Verdict::none("poses that did not converge", m.unconverged);
        all.push(unconverged.at(m.name.as_str()).else_do(
            "forces, volume or depth are above their tolerances there; choose smaller ranges",
        ));
        all.extend(straight_verdict(posed.set.off_straight(m), &m.name));
    }
    all
}

/// The forces whose path has the length of the fibres, and whose tendon slack length stays that of the
/// model's own path.
fn slack(paths: &[FittedPath], replaced: &[MuscleParameters]) -> Option<String> {
    let is_mapped = |force: &str| replaced.iter().any(|p| p.force == force && p.is_mapped());
    let stay = paths.iter().filter(|path| !is_mapped(&path.force));
    let stay: Vec<&str> = stay.map(|path| path.force.as_str()).collect();
    (!stay.is_empty()).then(|| {
        format!(
            "the model with the paths in place keeps the tendon slack length of {}, but these paths have the length of the fibres alone: \
             set it by hand, or use --parameters where the model's own path has no wrapping",
            stay.join(", ")
        )
    })
}

/// Parameters of each bundle; lengths are mapped where the model has the force.
fn parameters(
    posed: &Posed,
    running: &SweepRun,
    samples: &[(String, PathSamples)],
) -> Vec<MuscleParameters> {
    let model = &posed.drive.model;
    let each = posed.set.each();
    let mut all = Vec::new();
    let mut paths = samples.iter().map(|(_, samples)| samples);
    for (muscle, bundles) in running.muscles.iter().zip(&posed.bundles) {
        for ((force, fibres), path) in bundles.iter().zip(&mut paths) {
            let at_rest: Vec<f64> = fibres.iter().map(|f| length(&muscle.fibres[*f])).collect();
            let share = fibres.len() as f64 / muscle.fibres.len() as f64;
            let own = model.muscles.iter().find(|m| m.path == *force);
            let poses: Vec<Vec<f64>> = posed.set.poses.iter().step_by(each).cloned().collect();
            let lengths = own.and_then(|own| normalised_lengths(model, own, &poses));
            let both = path
                .lengths
                .iter()
                .copied()
                .zip(lengths.into_iter().flatten());
            all.push(MuscleParameters::new(
                force,
                share * muscle.physiological_area,
                &at_rest,
                muscle.quality.pennation_mean_rad,
                &both.collect::<Vec<_>>(),
            ));
        }
    }
    all
}

/// The parameters as a table, each value with its interval.
fn parameter_table(parameters: &[MuscleParameters]) -> Table {
    let columns = [
        "force",
        "maximum isometric force [N]",
        "optimal fibre length [mm]",
        "tendon slack length [mm]",
        "pennation [deg]",
    ];
    let mut table = Table::new(
        "Parameters of the muscles, with their intervals; the tendon is that of a path with the length of the fibres",
        columns,
    );
    let shown = |[low, value, high]: [f64; 3], scale: f64| {
        let [low, value, high] = [low, value, high].map(|v| number(scale * v));
        format!("{value} ({low} to {high})")
    };
    for p in parameters {
        table.row([
            p.force.clone(),
            shown(p.max_isometric_force, 1.0),
            shown(p.optimal_fibre_length, 1e3),
            p.tendon_slack_length
                .map_or("-".to_owned(), |slack| shown(slack, 1e3)),
            number(p.pennation.to_degrees()),
        ]);
    }
    table
}

/// Least and greatest moment arm of each bundle about each coordinate.
fn arms_table(posed: &Posed, samples: &[(String, PathSamples)]) -> Table {
    let arm = |k: usize| format!("about {} [mm]", posed.coordinate(k).name);
    let columns = ["muscle", "force", "length [mm]"].map(str::to_owned);
    let columns = columns
        .into_iter()
        .chain((0..posed.set.coordinates.len()).map(arm));
    let mut table = Table::new(
        "Lengths and moment arms over all samples, least to greatest",
        columns,
    );
    let range = |all: &mut dyn Iterator<Item = f64>| {
        extremes(all).map_or("-".to_owned(), |[low, high]| {
            format!("{} to {}", number(1e3 * low), number(1e3 * high))
        })
    };
    for (muscle, s) in samples {
        let arms = (0..s.coordinates.len()).map(|k| range(&mut s.arms.iter().map(|a| a[k])));
        let first = [
            muscle.clone(),
            s.force.clone(),
            range(&mut s.lengths.iter().copied()),
        ];
        table.row(first.into_iter().chain(arms).collect::<Vec<_>>());
    }
    table
}

/// The fitted moment arm of a bundle over each coordinate.
fn plots(posed: &Posed, muscle: &str, samples: &PathSamples, paths: &[Fitted]) -> Vec<Plot> {
    let Some(path) = paths
        .iter()
        .map(|f| &f.path)
        .find(|p| p.force == samples.force)
    else {
        return Vec::new();
    };
    let short = samples.force.rsplit('/').next().unwrap_or_default();
    let middle: Vec<f64> = path
        .ranges
        .iter()
        .map(|[low, high]| 0.5 * (low + high))
        .collect();
    let mut plots = Vec::new();
    for (c, coordinate) in path.coordinates.iter().enumerate() {
        let Some(k) = samples
            .coordinates
            .iter()
            .position(|other| other == coordinate)
        else {
            continue;
        };
        let [low, high] = path.ranges[c];
        let points = (0..PLOTTED).map(|n| {
            let mut at = middle.clone();
            at[c] = low + (high - low) * n as f64 / (PLOTTED - 1) as f64;
            (posed.shown(k, at[c]), 1e3 * path.at(&at).1[c])
        });
        let name = &posed.coordinate(k).name;
        let title = format!("{muscle}, {short}: moment arm [mm]");
        plots.push(Plot {
            file: Some(format!("{}_{name}.svg", file_name(short))),
            plot: LinePlot::new(title, format!("{name} [{}]", posed.unit(k)))
                .with("polynomial", points),
        });
    }
    plots
}

/// Names of the columns of coordinates and of moment arms.
fn columns(posed: &Posed, first: &[&str], last: &str) -> Vec<String> {
    let count = posed.set.coordinates.len();
    let value = |k: usize| format!("{}_{}", posed.coordinate(k).name, posed.unit(k));
    let arm = |k: usize| format!("moment_arm_{}_m", posed.coordinate(k).name);
    let first = first.iter().map(|c| (*c).to_owned());
    let all = first.chain((0..count).map(value)).chain([last.to_owned()]);
    all.chain((0..count).map(arm)).collect()
}

/// A row for each bundle and sample.
fn bundle_rows<'a>(posed: &'a Posed, samples: &[(String, PathSamples)]) -> DataFile<'a> {
    let mut rows = Vec::new();
    for (muscle, s) in samples {
        for (n, values) in s.values.iter().enumerate() {
            let shown = values.iter().enumerate().map(|(k, v)| posed.shown(k, *v));
            let numbers = shown.chain([s.lengths[n]]).chain(s.arms[n].iter().copied());
            let first = [muscle.clone(), s.force.clone(), n.to_string()].into_iter();
            rows.push(first.chain(numbers.map(|v| v.to_string())).collect());
        }
    }
    let columns = columns(posed, &["muscle", "force", "sample"], "length_mean_m");
    DataFile::new("moment_arms.csv", columns, rows)
}

/// A row for each fibre and sample.
fn fibre_rows<'a>(posed: &'a Posed, running: &'a SweepRun) -> DataFile<'a> {
    let rows = running.muscles.iter().flat_map(move |m| {
        let complete = posed.set.complete(m.lengths.len());
        let all = (0..m.fibres.len()).flat_map(move |f| (0..complete).map(move |n| (f, n)));
        all.map(move |(f, n)| {
            let (length, arms) = posed.set.length_and_arms(m, &[f], n);
            let values = posed.set.samples[n].iter().enumerate();
            let shown = values.map(|(k, v)| posed.shown(k, *v));
            let numbers = shown.chain([length]).chain(arms);
            let first = [m.name.clone(), f.to_string(), n.to_string()].into_iter();
            first.chain(numbers.map(|v| v.to_string())).collect()
        })
    });
    let columns = columns(posed, &["muscle", "fibre", "sample"], "length_m");
    DataFile::new("fibres.csv", columns, rows)
}
