//! The scene of the options of `pliant springs --lattice`.

use super::super::failure::Failure;
use super::super::scene_text::{SceneText, number, quoted};
use super::Arguments;
use pliant::scene::{PRECISIONS, RestCourse, SpringsDamping};
use pliant::simulation::SpringsModelError;
use pliant::springs::Neighbours;
use pliant::springs::integrators::INTEGRATORS;
use pliant::springs::lattice::DEVICES;

/// Words of scenes in advice, and those of this command.
const WORDS: &[(&str, &str)] = &[
    ("`integrator = \"implicit\"`", "--integrator implicit"),
    ("`integrator`", "--integrator"),
    ("`adaptive = true`", "--adaptive"),
    ("`time_step`", "--dt"),
    ("`damping`", "--damping"),
    ("`points`", "--lattice"),
    ("`tolerance`", "--tolerance"),
    ("`precision = \"f64\"`", "--precision f64"),
    ("`precision`", "--precision"),
    ("`device = \"cpu\"`", "--device cpu"),
    ("`device = \"gpu\"`", "--device gpu"),
    ("`device`", "--device"),
    ("`method`", "--method"),
    ("`integrator = \"verlet\"`", "--integrator verlet"),
    ("`side`", "--side"),
    ("`mass`", "--mass"),
];

/// Reads "50x50x50".
pub(super) fn sides(text: &str) -> Result<[usize; 3], String> {
    let wrong = || "expected three numbers of points, such as 50x50x50".to_owned();
    let sides: Vec<usize> = text
        .split('x')
        .map(str::parse)
        .collect::<Result<_, _>>()
        .map_err(|_| wrong())?;
    if let Some(few) = sides.iter().find(|n| **n < 2) {
        return Err(format!(
            "a lattice needs at least 2 points along each side, not {few}"
        ));
    }
    sides.try_into().map_err(|_| wrong())
}

/// The scene of a lattice of `points` that makes at most `frames` steps.
pub(super) fn scene(arguments: &Arguments, points: [usize; 3], frames: usize) -> SceneText {
    let neighbours = arguments.neighbours.unwrap_or(Neighbours::Six).count();
    let [a, b, c] = points;
    let mut made = SceneText::new(&format!("lattice-{a}x{b}x{c}-{neighbours}"), WORDS);
    made.put("frames", frames.to_string(), "--steps");
    made.begin("[lattice]", "lattice", "");
    made.put("points", format!("[{a}, {b}, {c}]"), "--lattice");
    let side = arguments.side.unwrap_or(1.0);
    made.put_text("side", "--side", &format!("{side:?} m"));
    made.put("neighbours", neighbours.to_string(), "--neighbours");
    made.put("stiffness", quoted("1/L"), "");
    made.put_text("mass", "--mass", &format!("{:?} kg", arguments.mass));
    if let Some(damping) = arguments.damping {
        made.put_text("damping", "--damping", &format!("{damping:?} N s/m"));
    }
    made.begin("[lattice.rest]", "lattice.rest", "");
    made.put("shrink", number(arguments.shrink), "--shrink");
    made.put("held", holds(arguments).to_string(), "--pin");
    made.put_text("integrator", "--integrator", &arguments.integrator);
    if let Some(dt) = arguments.dt {
        made.put_text("time_step", "--dt", &format!("{dt:?} s"));
    }
    made.put("adaptive", arguments.adaptive.to_string(), "--adaptive");
    made.put("tolerance", number(arguments.tolerance), "--tolerance");
    if let Some(precision) = &arguments.precision {
        made.put_text("precision", "--precision", precision);
    }
    if arguments.device != DEVICES[0] {
        made.put_text("device", "--device", &arguments.device);
    }
    if let Some(method) = &arguments.method {
        made.put_text("method", "--method", method);
    }
    made
}

fn holds(arguments: &Arguments) -> bool {
    arguments.pin == "surface"
}

/// Damping and course of the system of a file.
pub(super) fn course(arguments: &Arguments) -> Result<(SpringsDamping, RestCourse), Failure> {
    let name = arguments.integrator.as_str();
    let known = INTEGRATORS.into_iter().find(|known| *known == name);
    let integrator = known.ok_or_else(|| {
        Failure::usage(
            format!("no integrator is called {name}"),
            INTEGRATORS.join(", "),
        )
    })?;
    let damping = match arguments.damping {
        Some(damping) => SpringsDamping::Absolute(damping),
        None => SpringsDamping::Share(1.0),
    };
    let course = RestCourse {
        shrink: arguments.shrink,
        held: holds(arguments),
        integrator,
        time_step: arguments.dt,
        adaptive: arguments.adaptive,
        tolerance: arguments.tolerance,
        ..RestCourse::default()
    };
    let is_single = arguments.precision.as_deref() == Some(PRECISIONS[0]);
    let of_lattices = [
        (is_single, "single precision is", "--precision"),
        (
            arguments.device != DEVICES[0],
            "a graphics card is",
            "--device",
        ),
        (
            arguments.method.is_some(),
            "the method of a graphics card is",
            "--method",
        ),
    ];
    if let Some((_, what, option)) = of_lattices.into_iter().find(|(is_given, ..)| *is_given) {
        return Err(Failure::usage(
            format!("{what} for lattices"),
            format!("leave {option} out, or give --lattice"),
        ));
    }
    Ok((damping, course))
}

/// The refusal of the system of a file.
pub(super) fn refused(error: &SpringsModelError) -> Failure {
    SceneText::new("", WORDS).refused(error.key(), &error.to_string(), error.help())
}
