//! The cases of a campaign: changes of a scene's text, drawn by a seed.

use pliant::scene::{EFFECTS, SOLVERS, SolverQuestion};
use toml::{Table, Value};

use super::Worse;

/// Keys that are no parameters: names, files, places, and numbers of elements.
const FIXED: [&str; 23] = [
    "frames",
    "frame",
    "frame_rate",
    "axis",
    "centre",
    "limit",
    "within",
    "near",
    "vertices",
    "seed",
    "points",
    "release",
    "substeps",
    "tolerance",
    "base",
    "at",
    "stages",
    "iterations",
    "width",
    "radii",
    "size",
    "power",
    "neighbours",
];

/// Half the decades of a factor: of usual cases, and of cases beyond.
const USUAL: f64 = 0.5;
const BEYOND: f64 = 1.5;

/// The key of the size of a mesh, which stays in a decade: a thirtieth of it is a thousand times as
/// many triangles.
const EDGE_LENGTH: &str = "edge_length";

/// The share of cases without a motion, and of those with a worse mesh where one can be had.
const STILL: f64 = 0.05;
const OTHER_MESH: f64 = 0.2;

/// Greatest number of parameters that a case changes.
const MOST_CHANGED: usize = 4;

/// A case of a campaign.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Its number, from 0.
    pub number: usize,
    /// Changes of the scene, as with `--set`: those of all cases first.
    pub changes: Vec<String>,
    /// Number of changes that all cases have.
    pub common: usize,
    /// Whether its numbers leave a decade around those of the scene, or its solver is another one.
    pub beyond: bool,
    /// Whether no bone moves.
    pub still: bool,
    /// A muscle, by its number, whose mesh is a worse one.
    pub mesh: Option<(usize, Worse)>,
}

/// What is drawn of a scene.
#[derive(Clone, Debug)]
pub struct Drawing {
    seed: u64,
    /// Changes of all cases: few frames across the whole motion.
    common: Vec<String>,
    /// Numbers that a factor changes: their keys and values.
    parameters: Vec<(String, Value)>,
    /// The numbers of motions.
    motion: Vec<(String, Value)>,
    /// The frames a second, with the factor of all cases.
    frame_rate: Option<Value>,
    effects: Vec<String>,
    solver: Option<String>,
    /// The muscles whose meshes can be others, by their numbers.
    meshes: Vec<usize>,
    /// Number of frames of the scene that one of a case takes the place of.
    shortened: i64,
}

impl Drawing {
    /// Draws cases of a scene, with its text; those of muscles have at most `frames` frames, and other meshes
    /// for the muscles with these numbers.
    pub fn new(scene: &Table, seed: u64, frames: usize, meshes: Vec<usize>) -> Self {
        let mut numbers = Vec::new();
        walk("", scene, &mut numbers);
        let is_of_motion = |key: &str| key.contains(".motion.keys.");
        let (motion, others): (Vec<_>, Vec<_>) =
            numbers.into_iter().partition(|(key, _)| is_of_motion(key));
        let (times, motion): (Vec<_>, Vec<_>) = motion
            .into_iter()
            .partition(|(key, _)| key.ends_with(".frame"));
        let is_free = |key: &str| !FIXED.contains(&last(key)) && !key.starts_with("limits.");
        let parameters = others.into_iter().filter(|(key, _)| is_free(key)).collect();
        let moved: Vec<_> = motion.into_iter().filter(|(key, _)| is_free(key)).collect();
        let of_muscles = scene.contains_key("muscle");
        let mut common = Vec::new();
        let (mut frame_rate, mut shortened) = (scene.get("frame_rate").cloned(), 1);
        let given = scene.get("frames").and_then(Value::as_integer);
        if let Some(given) = given.filter(|n| of_muscles && *n > frames as i64) {
            let share = frames as f64 / given as f64;
            shortened = (given as f64 / frames as f64).ceil() as i64;
            common.push(format!("frames={frames}"));
            let sooner = times
                .iter()
                .map(|(key, at)| format!("{key}={}", scaled(at, share)));
            common.extend(sooner);
            frame_rate = frame_rate.map(|rate| scaled(&rate, share));
            // Steps that suit a frame of the scene are too long for one of so few.
            for solver in keys_of(scene, "solver") {
                let settings = scene["solver"].get(&solver);
                if settings.is_some_and(|settings| settings.get("substeps").is_some()) {
                    common.push(format!("solver.{solver}.substeps=off"));
                }
            }
        }
        common.extend(frame_rate.iter().map(|rate| format!("frame_rate={rate}")));
        let effects = keys_of(scene, "effects");
        Self {
            seed,
            common,
            parameters,
            motion: moved,
            frame_rate,
            effects: if of_muscles { effects } else { Vec::new() },
            solver: keys_of(scene, "solver")
                .first()
                .cloned()
                .filter(|_| of_muscles),
            meshes,
            shortened,
        }
    }

    /// The changes of all cases.
    pub fn common(&self) -> &[String] {
        &self.common
    }

    /// The case with this number; the same for the same seed.
    pub fn case(&self, number: usize) -> Case {
        // Far apart for neighbouring seeds, whose streams would else be the same but for a shift.
        let of_seed = (pliant::random::units(self.seed)() * 2_f64.powi(53)) as u64;
        let mut next = pliant::random::units((of_seed << 11).wrapping_add(number as u64));
        let wide = number % 2 == 1;
        let decades = if wide { BEYOND } else { USUAL };
        let mut beyond = wide;
        let mut changes = self.common.clone();
        if let Some(solver) = &self.solver
            && next() < 0.25
        {
            let others: Vec<_> = SOLVERS.iter().filter(|other| other.key != solver).collect();
            let other = others[index(next(), others.len())];
            changes.retain(|change| !change.starts_with("solver."));
            changes.push(format!("solver={}", other.key));
            // The numbers of the scene suit its own solver.
            beyond = true;
            // Steps of a whole frame stay as long as those of the scene.
            if other.question != Some(SolverQuestion::Equilibrium) && other.default.substeps() == 1
            {
                let (solver, steps) = (other.key, self.shortened);
                changes.push(format!("solver.{solver}.substeps={steps}"));
            }
        }
        let kept = |key: &str| {
            !key.starts_with("solver.") || !changes.iter().any(|c| c.starts_with("solver="))
        };
        let mut free: Vec<_> = self
            .parameters
            .iter()
            .filter(|(key, _)| kept(key))
            .collect();
        let wanted = 1 + index(next(), MOST_CHANGED);
        let mut drawn = Vec::new();
        for _ in 0..wanted.min(free.len()) {
            let (key, value) = free.remove(index(next(), free.len()));
            let decades = if last(key) == EDGE_LENGTH {
                USUAL
            } else {
                decades
            };
            let factor = three_digits(factor(next(), decades));
            let value = scaled(value, factor);
            let kept = if wide { value } else { within(key, value) };
            drawn.push(format!("{key}={kept}"));
        }
        let still = !self.motion.is_empty() && next() < STILL;
        if still {
            drawn.extend(self.moved(0.0));
        } else if next() < 0.25 {
            let factor = three_digits(factor(next(), decades));
            // The motion of the scene is the widest that it is made for.
            drawn.extend(self.moved(if wide { factor } else { factor.min(1.0) }));
        }
        if let Some(rate) = self.frame_rate.as_ref().filter(|_| next() < 0.25) {
            let factor = three_digits(factor(next(), decades));
            drawn.push(format!("frame_rate={}", scaled(rate, factor)));
        }
        if !self.effects.is_empty() && next() < 0.15 {
            let off = &self.effects[index(next(), self.effects.len())];
            drawn.retain(|change| !change.starts_with(&format!("effects.{off}.")));
            drawn.push(format!("effects.{off}=off"));
        }
        let mesh = (!self.meshes.is_empty() && next() < OTHER_MESH).then(|| {
            let muscle = self.meshes[index(next(), self.meshes.len())];
            (muscle, Worse::ALL[index(next(), Worse::ALL.len())])
        });
        let common = changes.len();
        changes.extend(drawn);
        Case {
            number,
            changes,
            common,
            beyond,
            still,
            mesh,
        }
    }
}

impl Drawing {
    /// The changes that make motions wider by a factor: each starts where it did.
    fn moved(&self, factor: f64) -> impl Iterator<Item = String> {
        self.motion.iter().filter_map(move |(key, value)| {
            let (of_key, name) = key.rsplit_once('.')?;
            let (keys, number) = of_key.rsplit_once('.')?;
            let first = format!("{keys}.0.{name}");
            let first = self.motion.iter().find(|(key, _)| *key == first);
            let wider = match first {
                Some((_, from)) => apart(value, from, factor)?,
                None => scaled(value, factor),
            };
            (number != "0").then(|| format!("{key}={wider}"))
        })
    }
}

/// The keys of a section; none without it.
fn keys_of(scene: &Table, name: &str) -> Vec<String> {
    let section = scene.get(name).and_then(Value::as_table);
    section.map_or(Vec::new(), |table| table.keys().cloned().collect())
}

/// The numbers of a section with their keys: plain ones, quantities, and lists of them.
fn walk(above: &str, section: &Table, to: &mut Vec<(String, Value)>) {
    let key_of = |key: &str| match above {
        "" => key.to_owned(),
        above => format!("{above}.{key}"),
    };
    for (name, value) in section {
        let key = key_of(name);
        match value {
            Value::Table(table) => walk(&key, table, to),
            Value::Array(list) if list.iter().all(Value::is_table) => {
                for (k, element) in list.iter().enumerate() {
                    element
                        .as_table()
                        .iter()
                        .for_each(|table| walk(&format!("{key}.{k}"), table, to));
                }
            }
            value if is_number(value) => to.push((key, value.clone())),
            _ => {}
        }
    }
}

fn is_number(value: &Value) -> bool {
    match value {
        Value::Float(_) | Value::Integer(_) => true,
        Value::String(text) => quantity(text).is_some(),
        Value::Array(list) => list.iter().all(is_number),
        _ => false,
    }
}

/// Number and unit of a text such as `4 mm`.
fn quantity(text: &str) -> Option<(f64, &str)> {
    let (number, unit) = text.trim().split_once(' ')?;
    Some((number.parse().ok()?, unit))
}

fn scaled(value: &Value, factor: f64) -> Value {
    match value {
        Value::Float(number) => Value::Float(three_digits(number * factor)),
        Value::Integer(number) => {
            let scaled = (*number as f64 * factor).round();
            Value::Integer(scaled as i64)
        }
        Value::String(text) => quantity(text).map_or(value.clone(), |(number, unit)| {
            Value::String(format!("{} {unit}", three_digits(number * factor)))
        }),
        Value::Array(list) => Value::Array(list.iter().map(|one| scaled(one, factor)).collect()),
        other => other.clone(),
    }
}

/// The value of a key, within the range that its effect has.
fn within(key: &str, value: Value) -> Value {
    let found = key.strip_prefix("effects.").and_then(|rest| {
        let (effect, key) = rest.split_once('.')?;
        let effect = EFFECTS.iter().find(|one| one.key == effect)?;
        effect.keys.iter().find(|one| one.key == key)?.range()
    });
    match (found, value) {
        (Some((least, greatest)), Value::Float(value)) => {
            Value::Float(value.clamp(least, greatest))
        }
        (_, value) => value,
    }
}

/// A value that is `factor` times as far from another one; `None` for other units.
fn apart(value: &Value, from: &Value, factor: f64) -> Option<Value> {
    let mix = |to: f64, from: f64| three_digits(from + (to - from) * factor);
    match (value, from) {
        (Value::String(to), Value::String(from)) => {
            let ((to, unit), (from, other)) = (quantity(to)?, quantity(from)?);
            (unit == other).then(|| Value::String(format!("{} {unit}", mix(to, from))))
        }
        (Value::Array(to), Value::Array(from)) => {
            let both = to.iter().zip(from);
            let each: Option<Vec<Value>> = both.map(|(to, from)| apart(to, from, factor)).collect();
            each.map(Value::Array)
        }
        _ => None,
    }
}

/// The last name of a key.
fn last(key: &str) -> &str {
    key.rsplit('.').next().unwrap_or(key)
}

/// A number with three digits, which is easy to read and to type.
fn three_digits(number: f64) -> f64 {
    format!("{number:.2e}").parse().unwrap_or(number)
}

/// A factor of at most this number of decades up or down, for a number in `0..1`.
fn factor(drawn: f64, decades: f64) -> f64 {
    10_f64.powf((2.0 * drawn - 1.0) * decades)
}

pub(super) fn index(drawn: f64, count: usize) -> usize {
    ((drawn * count as f64) as usize).min(count.saturating_sub(1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use pliant::scene::builtin::{self, builtin, load_content};

    fn drawing(name: &str, seed: u64) -> Drawing {
        let text = builtin(name).expect("a built-in scene");
        Drawing::new(&text.parse().expect("TOML"), seed, 30, vec![0])
    }

    #[test]
    fn cases_follow_from_the_seed_and_change_the_scene() {
        for name in ["hip", "press", "flat-implant", "lattice"] {
            let (one, other) = (drawing(name, 1), drawing(name, 2));
            let all: Vec<Case> = (0..40).map(|k| one.case(k)).collect();
            assert_eq!(all, (0..40).map(|k| one.case(k)).collect::<Vec<_>>());
            assert!((0..40).all(|k| other.case(k) != all[k]), "control");
            assert!(
                all.iter().all(|case| case.changes.len() > case.common),
                "{name}"
            );
        }
    }

    #[test]
    fn usual_cases_are_scenes_that_load() {
        for name in ["hip", "press", "flat-implant", "lattice"] {
            let drawing = drawing(name, 3);
            let usual = (0..60).map(|k| drawing.case(k)).filter(|case| !case.beyond);
            let refused = usual.filter_map(|case| load_content(name, &case.changes).err());
            let refused: Vec<String> = refused.map(|e| e.to_string()).collect();
            assert!(refused.len() <= 3, "{name}: {refused:#?}");
        }
    }

    #[test]
    fn numbers_are_drawn_of_the_scene_with_its_changes() {
        let set = ["solver=quasi_static".to_owned()];
        let both = [&set[..], &[]].map(|set| {
            let table = builtin::table("press", set).expect("TOML");
            Drawing::new(&table, 3, 30, vec![0])
        });
        let [excluded, control] = both.map(|drawing| {
            let cases = (0..60).map(|k| [&set[..], &drawing.case(k).changes].concat());
            let refused = cases.filter_map(|all| load_content("press", &all).err());
            let codes = refused.map(|error| error.problem().code());
            codes.filter(|code| *code == "E056").count()
        });
        assert_eq!(excluded, 0);
        assert!(control > 0, "control");
    }

    #[test]
    fn a_motion_of_many_frames_is_made_in_few() {
        let case = drawing("press", 1).case(0);
        let keys = [
            "frames=30",
            "bone.0.motion.keys.1.frame=10",
            "bone.1.motion.keys.2.frame=20",
        ];
        let wider: Vec<String> = drawing("press", 1).moved(0.5).collect();
        let half = "bone.0.motion.keys.1.translation=[\"0 mm\", \"22.1 mm\", \"0 mm\"]";
        assert_eq!((wider.len(), wider[0].as_str()), (4, half));
        for key in keys {
            assert!(
                case.changes.iter().any(|c| c == key),
                "{key}: {:?}",
                case.changes
            );
        }
        assert!(
            case.changes.contains(&"frame_rate=\"6 Hz\"".to_owned()),
            "{:?}",
            case.changes
        );
    }

    #[test]
    fn each_kind_of_change_is_as_frequent_as_it_should_be() {
        let drawing = drawing("press", 5);
        let count = 600;
        let all: Vec<Case> = (0..count).map(|k| drawing.case(k)).collect();
        let share = |is: &dyn Fn(&Case, &str) -> bool| {
            let has = |case: &&Case| case.changes[case.common..].iter().any(|c| is(case, c));
            all.iter().filter(has).count() as f64 / count as f64
        };
        let of_motion = |_: &Case, c: &str| c.contains(".motion.keys.");
        let of_rate = |_: &Case, c: &str| c.starts_with("frame_rate=");
        let off = |_: &Case, c: &str| c.starts_with("effects.") && c.ends_with("=off");
        // Within four standard deviations.
        for (what, found, wanted) in [
            ("motion", share(&of_motion), STILL + (1.0 - STILL) * 0.25),
            ("no motion", share(&|case, _| case.still), STILL),
            ("mesh", share(&|case, _| case.mesh.is_some()), OTHER_MESH),
            ("frame rate", share(&of_rate), 0.25),
            ("effect off", share(&off), 0.15),
        ] {
            assert!((found - wanted).abs() <= 0.07, "{what}: {found}");
        }
        let solver = |case: &Case| {
            case.changes
                .iter()
                .find_map(|c| Some(c.strip_prefix("solver=")?.to_owned()))
        };
        let others: Vec<(&Case, String)> =
            all.iter().filter_map(|c| Some((c, solver(c)?))).collect();
        let found = others.len() as f64 / count as f64;
        assert!((found - 0.25).abs() <= 0.07, "solver: {found}");
        // Where one step of 30 frames takes the place of as many of the scene as before.
        let frames = builtin("press").and_then(|text| text.parse::<Table>().ok());
        let frames = frames
            .and_then(|scene| scene["frames"].as_integer())
            .expect("frames");
        let steps = format!("substeps={}", (frames as usize).div_ceil(30));
        for (case, solver) in others {
            let has_steps = solver != "quasi_static";
            let has = case.changes[..case.common]
                .iter()
                .any(|c| *c == format!("solver.{solver}.{steps}"));
            assert_eq!(has, has_steps, "{solver}: {:?}", case.changes);
        }
    }
}
