//! A geometric muscle as a scene: its length changes over the frames at constant volume.

use crate::encode::{Encode, Encoder};
use crate::geometric::chain::Caps;
use crate::geometric::frame::{Frame, FrameError};
use crate::geometric::muscle::GeometricError;
use crate::geometric::{ChainError, ChainShape, GeometricMuscle};
use crate::scene::error::{SceneError, SceneProblem};
use crate::scene::reader::{Item, Limit, Section};
use crate::scene::schema::Kind::{self, Plain, Text};
use crate::scene::units::{self, Dimension};
use crate::scene::{Content, Measure, SceneOrigin};

type Read<T> = Result<T, SceneError>;

/// The keys; the first one decides that a scene is a geometric muscle.
pub(super) const KEYS: &[(&str, Kind)] = &[
    ("radii", Plain),
    ("grow_mults", Plain),
    ("length", Plain),
    ("unit", Text),
    ("frame", Plain),
    ("min_part", Plain),
    ("max_part", Plain),
    ("insert", Plain),
    ("caps", Text),
    ("fixed_length", Plain),
];

pub(super) const MEASURES: &[Measure] = &[
    ("length_m", "length [mm]", 1e3),
    ("radius_max_m", "greatest radius [mm]", 1e3),
    ("joint_angle_deg", "joint angle [degrees]", 1.0),
    ("volume_error", "volume error", 1.0),
];

/// Greatest number of nodes of a chain; a greater number in a file is a mistake.
const MOST_NODES: usize = 1_000_000;

/// Frames and frames per second [1/s] if the file does not give them: a cycle of two seconds.
const FRAMES: usize = 60;
const FRAME_RATE: f64 = 30.0;

/// Shortest and longest length relative to the length at rest if the file does not give them. The
/// source gives no bounds.
const PARTS: [f64; 2] = [0.6, 1.4];

/// A geometric muscle. Over the frames its length goes from rest to the longest, to the shortest
/// and back to rest; or every frame has the same length.
#[derive(Clone, Debug, PartialEq)]
pub struct GeometricScene {
    /// Name, also of the results folder.
    pub name: String,
    /// Number of frames after the start.
    pub frames: usize,
    /// Frames a second [1/s].
    pub frame_rate: f64,
    /// The unit of plain numbers in the file [m].
    pub unit: f64,
    /// The chain at rest, without inserted nodes.
    pub shape: ChainShape,
    /// Number of nodes inserted between each two.
    pub insert: usize,
    /// The bars; `None` without a frame.
    pub frame: Option<Frame>,
    /// Shortest and longest length relative to the length at rest.
    pub parts: [f64; 2],
    /// The muscle of these values at rest, with inserted nodes.
    pub muscle: GeometricMuscle,
    /// The length in every frame [m]; `None` for the whole range.
    pub fixed_length: Option<f64>,
    /// Origin of the scene's text.
    pub origin: SceneOrigin,
}

impl GeometricScene {
    /// The length in a frame [m].
    pub fn length_in(&self, frame: usize) -> f64 {
        self.fixed_length
            .unwrap_or_else(|| self.muscle.length_at(frame, self.frames))
    }

    /// The text of a scene file with exactly these values, in SI units.
    pub fn to_toml(&self) -> String {
        let list = |values: &[f64]| {
            let values: Vec<String> = values.iter().map(f64::to_string).collect();
            format!("[{}]", values.join(", "))
        };
        let mut text = format!(
            "name = {}\nframes = {}\nframe_rate = \"{} Hz\"\nunit = \"m\"\nradii = {}\ngrow_mults = {}\nlength = {}\n",
            toml::Value::from(self.name.as_str()),
            self.frames,
            self.frame_rate,
            list(&self.shape.radii),
            list(&self.shape.growth),
            self.shape.length,
        );
        if let Some(f) = &self.frame {
            let bars = [f.first_free, f.first, f.second, f.second_free];
            text += &format!("frame = {}\n", list(&bars));
        }
        let caps = match self.shape.caps {
            Caps::Out => "out",
            Caps::In => "in",
        };
        let [least, most] = self.parts;
        text += &format!(
            "min_part = {least}\nmax_part = {most}\ninsert = {}\ncaps = \"{caps}\"\n",
            self.insert
        );
        if let Some(length) = self.fixed_length {
            text += &format!("fixed_length = {length}\n");
        }
        text
    }
}

/// Reads a scene of a geometric muscle.
pub(super) fn read(root: &Section<'_>, name: String) -> Read<Content> {
    let unit = root.get("unit").map_or(Ok(1.0), |item| {
        units::scale(item.text("cm")?, Dimension::Length).map_err(|e| item.error(e.into()))
    })?;
    let shape = ChainShape {
        radii: lengths(&root.need("radii", "[1.0, 2.0, 1.0]")?, unit)?,
        growth: growth(root)?,
        length: length(&root.need("length", "20.0")?, unit, Limit::Positive)?,
        caps: caps(root)?,
    };
    let frame = root
        .get("frame")
        .map(|item| bars(&item, unit))
        .transpose()?;
    let insert = insert(root, shape.radii.len())?;
    let parts = [
        root.number_or("min_part", Limit::Within(1e-6, 1.0), PARTS[0])?,
        root.number_or("max_part", Limit::Within(1.0, 1e6), PARTS[1])?,
    ];
    let muscle = GeometricMuscle::new(&shape, insert, frame, parts)
        .map_err(|error| root.error_at(key(&error), problem(&error)))?;
    let fixed_length = root
        .get("fixed_length")
        .map(|item| within(&item, unit, &muscle))
        .transpose()?;
    Ok(Content::Geometric(Box::new(GeometricScene {
        name,
        frames: root.get("frames").map_or(Ok(FRAMES), |item| {
            item.whole(1, 10_000_000).map(|n| n as usize)
        })?,
        frame_rate: root.quantity_or("frame_rate", Dimension::Rate, Limit::Positive, FRAME_RATE)?,
        unit,
        shape,
        insert,
        frame,
        parts,
        muscle,
        fixed_length,
        origin: SceneOrigin::default(),
    })))
}

const NUMBERS: &str = "a list of numbers such as [1.0, 2.0, 1.0]";
const FOUR: &str = "four lengths: free end, muscle to joint, joint to muscle, free end";

/// A number in the unit of the file, or a text with a unit [m].
fn length(item: &Item<'_>, unit: f64, limit: Limit) -> Read<f64> {
    if item.is_text() {
        item.quantity(Dimension::Length, limit)
    } else {
        Ok(item.number(limit)? * unit)
    }
}

fn lengths(item: &Item<'_>, unit: f64) -> Read<Vec<f64>> {
    let items = item.list(NUMBERS)?;
    items
        .iter()
        .map(|item| length(item, unit, Limit::NotNegative))
        .collect()
}

fn bars(item: &Item<'_>, unit: f64) -> Read<Frame> {
    let Ok(bars) = <[f64; 4]>::try_from(lengths(item, unit)?) else {
        return item.fail(SceneProblem::out_of_range("the list", FOUR));
    };
    Frame::new(bars).map_err(|error| item.error(problem(&error.into())))
}

fn growth(root: &Section<'_>) -> Read<Vec<f64>> {
    let items = root.need("grow_mults", "[0.0, 1.0, 0.0]")?.list(NUMBERS)?;
    items.iter().map(|i| i.number(Limit::NotNegative)).collect()
}

fn caps(root: &Section<'_>) -> Read<Caps> {
    let Some(item) = root.get("caps") else {
        return Ok(Caps::Out);
    };
    match item.text("out")? {
        "out" => Ok(Caps::Out),
        "in" => Ok(Caps::In),
        other => item.fail(SceneProblem::out_of_range(other, "`out` or `in`")),
    }
}

fn insert(root: &Section<'_>, nodes: usize) -> Read<usize> {
    let Some(item) = root.get("insert") else {
        return Ok(0);
    };
    let insert = item.whole(0, u32::MAX)? as usize;
    let all = nodes.saturating_mul(insert.saturating_add(1));
    if all > MOST_NODES {
        let allowed = format!("a number that makes at most {MOST_NODES} nodes");
        return item.fail(SceneProblem::out_of_range(&insert.to_string(), &allowed));
    }
    Ok(insert)
}

/// A length in the range of the muscle [m], which rounding may exceed.
fn within(item: &Item<'_>, unit: f64, muscle: &GeometricMuscle) -> Read<f64> {
    let length = length(item, unit, Limit::Positive)?;
    let [least, most] = muscle.range;
    let slack = 1e-12 * most;
    if least - slack <= length && length <= most + slack {
        return Ok(length.clamp(least, most));
    }
    let cm = |length: f64| crate::format::number(1e2 * length);
    item.fail(SceneProblem::out_of_range(
        &format!("{} cm", cm(length)),
        &format!("a length from {} to {} cm", cm(least), cm(most)),
    ))
}

/// The key that causes an error.
fn key(error: &GeometricError) -> &'static str {
    match error {
        GeometricError::Frame(_) => "frame",
        GeometricError::Chain(ChainError::Lengths { .. } | ChainError::Rigid) => "grow_mults",
        GeometricError::Chain(ChainError::Length(_)) => "length",
        GeometricError::Chain(ChainError::TooLong { .. }) => "min_part",
        GeometricError::Chain(_) => "radii",
    }
}

fn problem(error: &GeometricError) -> SceneProblem {
    let help = match error {
        GeometricError::Frame(FrameError::Length { .. }) => "change this length of `frame`",
        GeometricError::Frame(FrameError::Range { .. }) => "change `frame` or `length`",
        GeometricError::Chain(ChainError::TooLong { .. }) => {
            "give a greater `min_part`, or a smaller `max_part`"
        }
        GeometricError::Chain(_) => "change `radii`, `grow_mults` or `length`",
    };
    SceneProblem::Unfit {
        code: "E078",
        message: error.to_string(),
        help: help.to_owned(),
    }
}

impl Encode for GeometricScene {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self {
            name,
            frames,
            frame_rate,
            unit: _,
            shape,
            insert,
            frame,
            parts,
            muscle: _,
            fixed_length,
            origin: _,
        } = self;
        let ChainShape {
            radii,
            growth,
            length,
            caps,
        } = shape;
        to.field("name", name);
        to.field("frames", frames);
        to.field("frame_rate", frame_rate);
        to.field("radii", radii);
        to.field("grow_mults", growth);
        to.field("length", length);
        to.field("caps_in", &(*caps == Caps::In));
        to.field("insert", insert);
        let bars = frame.map(|f| [f.first_free, f.first, f.second, f.second_free]);
        to.field("frame", &bars);
        to.field("parts", parts);
        to.field("fixed_length", fixed_length);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Surroundings, parse_content};

    const FILE: &str = "unit = \"cm\"\nradii = [1.0, 2.0, 1.0]\ngrow_mults = [0.0, 1.0, 0.0]\nlength = 20\nframe = [1, 18, 5, 2]\n";

    fn scene(text: &str, overrides: &[&str]) -> Result<GeometricScene, SceneError> {
        let overrides: Vec<String> = overrides.iter().map(|&o| o.to_owned()).collect();
        let around = Surroundings {
            overrides: &overrides,
            ..Surroundings::of(std::path::Path::new("."))
        };
        match parse_content(text, "arm.toml", &around)? {
            Content::Geometric(scene) => Ok(*scene),
            _ => panic!("no geometric muscle"),
        }
    }

    #[test]
    fn a_printed_scene_has_the_same_bits() {
        let first = scene(FILE, &["caps=in", "insert=2", "fixed_length=21 cm"]).expect("a scene");
        let again = scene(&first.to_toml(), &[]).expect("the printed scene");
        assert_eq!(
            GeometricScene {
                unit: 0.01,
                ..again
            },
            first
        );
        let other = scene(FILE, &["caps=in", "radii.1=2.1"]).expect("a scene");
        assert_ne!(other.shape, first.shape, "control");
    }

    #[test]
    fn errors_have_the_place_and_the_key_of_the_value() {
        for (from, to, expected) in [
            (
                "length",
                "lenght",
                "arm.toml:4:1: error[E052]: unknown key `lenght`, did you mean `length`",
            ),
            ("2.0", "\"two\"", "arm.toml:2:15: error[E058]: radii.1"),
            ("2.0", "-2.0", "arm.toml:2:15: error[E051]: radii.1"),
            ("cm", "parsec", "arm.toml:1:8: error[E058]: unit"),
            ("20", "nan", "arm.toml:4:10: error[E051]: length"),
            (
                "20\n",
                "20\nmin_part = 1.5\n",
                "arm.toml:5:12: error[E051]: min_part",
            ),
            (
                "20\n",
                "20\ninsert = 100000000\n",
                "arm.toml:5:10: error[E051]: insert",
            ),
            (
                "20\n",
                "20\nfixed_length = 40\n",
                "a length from 13 to 23 cm",
            ),
            (
                "[1, 18, 5, 2]",
                "[1, 18, 5]",
                "arm.toml:5:9: error[E051]: frame",
            ),
            (
                "[1, 18, 5, 2]",
                "[1, 1, 5, 2]",
                "arm.toml:5:9: error[E078]: frame: a muscle of 0.2 m does not fit",
            ),
            (
                "[0.0, 1.0, 0.0]",
                "[0.0, 1.0]",
                "arm.toml:3:14: error[E078]: grow_mults: 2 growth multipliers for 3 radii",
            ),
            ("radii = [1.0, 2.0, 1.0]", "", "error[E055]: "),
        ] {
            let error = scene(&FILE.replacen(from, to, 1), &[]).expect_err(to);
            assert!(error.terse().contains(expected), "{to}: {}", error.terse());
        }
    }
}
