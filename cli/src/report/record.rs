//! Measures and times of a run, frame by frame, and their tables.

use std::collections::BTreeMap;
use std::time::Duration;

use super::output::DataFile;
use pliant::simulation::{Measures, Simulation};
use pliant::solvers::effect_of_name;
use pliant::state::{DecodeError, Reader, Value, Writer};

/// Times of one frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameTimes {
    /// Index of the frame.
    pub frame: usize,
    /// Time of the frame without the audit [ms].
    pub step_ms: f64,
    /// Time of the measures and the independent audit [ms].
    pub audit_ms: f64,
    /// Time of each effect, summed over muscles [ms].
    pub effects_ms: BTreeMap<&'static str, f64>,
}

/// All frames of a run.
#[derive(Clone, Debug, Default)]
pub struct Record {
    /// Measures, frame by frame and within it muscle by muscle.
    pub measures: Vec<Measures>,
    /// Times of each frame after the start.
    pub times: Vec<FrameTimes>,
    before: BTreeMap<&'static str, f64>,
}

/// The name of an effect in scenes and plans, from the name of its constraint.
pub(super) fn effect_name(constraint: &str) -> &str {
    match constraint {
        "distance" | "fibre distance" => "stretch",
        "direction" => "tone",
        other => other,
    }
}

/// The effect with a name from [`effect_name`].
fn known_effect(name: &str) -> Option<&'static str> {
    if name == "stretch" {
        Some("stretch")
    } else {
        effect_of_name(name)
    }
}

impl Value for FrameTimes {
    const MIN_BYTES: usize = 8 + 8 + 8 + 8;

    fn encode(&self, to: &mut Writer) {
        let Self {
            frame,
            step_ms,
            audit_ms,
            effects_ms,
        } = self;
        to.put(frame);
        to.put(&(*step_ms, *audit_ms));
        to.put(
            &effects_ms
                .iter()
                .map(|(name, ms)| ((*name).to_owned(), *ms))
                .collect::<Vec<_>>(),
        );
    }

    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        let frame = from.take()?;
        let (step_ms, audit_ms) = from.take()?;
        let named: Vec<(String, f64)> = from.take()?;
        let known = |(name, ms): (String, f64)| known_effect(&name).map(|name| (name, ms));
        let effects_ms = named.into_iter().map(known).collect::<Option<_>>();
        Ok(Self {
            frame,
            step_ms,
            audit_ms,
            effects_ms: effects_ms.ok_or(from.corrupt("no effect has this name"))?,
        })
    }
}

/// Time of each effect so far, summed over muscles [s].
fn effect_seconds(simulation: &Simulation) -> BTreeMap<&'static str, f64> {
    let mut sums = BTreeMap::new();
    for (effect, (seconds, _)) in simulation
        .bodies
        .iter()
        .flat_map(|b| &b.system.clock.effects)
    {
        *sums.entry(effect_name(effect)).or_insert(0.0) += seconds;
    }
    sums
}

impl Record {
    /// The record up to the frame of `simulation`, whose clocks continue from there.
    pub fn going_on(
        simulation: &Simulation,
        measures: Vec<Measures>,
        times: Vec<FrameTimes>,
    ) -> Self {
        Self {
            measures,
            times,
            before: effect_seconds(simulation),
        }
    }

    /// Adds the frame that `simulation` has just computed, or its start, with its measures.
    pub fn add(
        &mut self,
        simulation: &Simulation,
        measures: Vec<Measures>,
        step: Duration,
        audit: Duration,
    ) {
        let now = effect_seconds(simulation);
        if simulation.frame() > 0 {
            let ms = |(effect, seconds): (&&'static str, &f64)| {
                let before = self.before.get(effect).copied().unwrap_or(0.0);
                (*effect, (seconds - before) * 1e3)
            };
            self.times.push(FrameTimes {
                frame: simulation.frame(),
                step_ms: step.as_secs_f64() * 1e3,
                audit_ms: audit.as_secs_f64() * 1e3,
                effects_ms: now.iter().map(ms).collect(),
            });
        }
        self.before = now;
        self.measures.extend(measures);
    }

    /// Time of each effect over the run [s].
    pub fn effects_s(&self) -> &BTreeMap<&'static str, f64> {
        &self.before
    }

    /// Measures of one muscle, by frame.
    pub fn of_muscle<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a Measures> + 'a {
        self.measures.iter().filter(move |m| m.muscle == name)
    }

    /// `measures.csv` and `times.csv`.
    pub fn into_data(self) -> [DataFile<'static>; 2] {
        let Self {
            measures,
            times,
            before,
        } = self;
        let measures = measures.into_iter().map(|m| row(&m).to_vec());
        let names = before.keys().map(|effect| format!("{effect}_s"));
        let columns = ["frame", "step_s", "audit_s"].map(str::to_owned);
        let columns: Vec<String> = columns.into_iter().chain(names).collect();
        let times = times.into_iter().map(move |t| {
            let of = |effect| t.effects_ms.get(effect).copied().unwrap_or(0.0);
            let numbers = [t.step_ms, t.audit_ms].into_iter();
            let numbers = numbers.chain(before.keys().map(of));
            let numbers = numbers.map(|ms| format!("{:.7}", ms * 1e-3));
            [t.frame.to_string()].into_iter().chain(numbers).collect()
        });
        [
            DataFile::new("measures.csv", COLUMNS, measures),
            DataFile::new("times.csv", columns, times),
        ]
    }
}

/// Columns of `measures.csv`: the fields of [`Measures`]; a test checks this.
const COLUMNS: [&str; 17] = [
    "frame",
    "time_s",
    "muscle",
    "volume_error",
    "volume_ratio",
    "edge_stretch_rms",
    "edge_stretch_max",
    "penetration_m",
    "vertices_inside_bones",
    "bone_vertices_inside",
    "vertices_touching",
    "vertices_pinched",
    "residual_m",
    "kinetic_energy_j",
    "distance_from_start_rms_m",
    "error_m",
    "converged",
];

fn row(m: &Measures) -> [String; 17] {
    // `{:?}` is the shortest text that reads back to the same bits.
    let number = |x: f64| format!("{x:?}");
    [
        m.frame.to_string(),
        number(m.time_s),
        m.muscle.clone(),
        number(m.volume_error),
        number(m.volume_ratio),
        number(m.edge_stretch_rms),
        number(m.edge_stretch_max),
        number(m.penetration_m),
        m.vertices_inside_bones.to_string(),
        m.bone_vertices_inside.to_string(),
        m.vertices_touching.to_string(),
        m.vertices_pinched.to_string(),
        number(m.residual_m),
        number(m.kinetic_energy_j),
        number(m.distance_from_start_rms_m),
        number(m.error_m),
        m.converged.to_string(),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_columns_are_the_fields_of_measures() {
        let scene = {
            // With an accuracy each value is a number.
            let changes = ["solver=xpbd", "accuracy=1 %"].map(str::to_owned);
            pliant::scene::builtin::load("distance", &changes).unwrap()
        };
        let mut simulation = Simulation::new(scene).unwrap();
        // The start has no residual, and JSON has no NaN.
        simulation.step_frame();
        let measures = simulation.measure();
        let serde_json::Value::Object(fields) = serde_json::to_value(&measures[0]).unwrap() else {
            panic!()
        };
        let mut known: Vec<&str> = fields.keys().map(String::as_str).collect();
        let mut columns = COLUMNS.to_vec();
        known.sort_unstable();
        columns.sort_unstable();
        assert_eq!(known, columns);
        // Each value is in the column of its name.
        for (name, value) in COLUMNS.iter().zip(row(&measures[0])) {
            let field = &fields[*name];
            match field.as_f64() {
                Some(number) => assert_eq!(value.parse::<f64>().unwrap(), number, "{name}"),
                None => assert_eq!(field.to_string().trim_matches('"'), value, "{name}"),
            }
        }
    }
}
