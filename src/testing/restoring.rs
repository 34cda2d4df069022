//! Promise of the reader of a simulation's state for any bytes: the state in the bytes, or an
//! error.

use std::path::Path;

use super::loaders::{Breach, LoadOutcome, caught};
use crate::scene::parse;
use crate::simulation::Simulation;
use crate::simulation::checkpoint::Checkpoint;
use crate::state::{Reader, State, Writer};

/// A tetrahedron in contact with another, small but with contact, history and volume.
const SCENE: &str = r#"
name = "small"
frames = 9
frame_rate = "60 Hz"
[[bone]]
name = "bone"
shape = "tetrahedron"
[bone.motion]
keys = [
    { frame = 0, translation = ["0 m", "0 m", "-1.2 m"] },
    { frame = 9, translation = ["0 m", "0 m", "-0.9 m"] },
]
[[muscle]]
name = "muscle"
shape = "tetrahedron"
[muscle.material]
vertex_mass = "1 kg"
[[muscle.attachment]]
bone = "bone"
vertices = [0]
limit = "50 %"
[[muscle.force]]
vertices = [3]
force = ["0 N", "0 N", "-10 N"]
[effects.stretch]
[effects.bending]
[effects.volume]
[effects.contact]
thickness = "10 mm"
"#;

/// Settings of the solvers with different states.
const SOLVERS: [&str; 3] = [
    "[solver.pbd]",
    "[solver.xpbd]\nsubsteps = 4",
    "[solver.implicit_euler]\niterations = 20",
];

fn small(solver: usize) -> Option<Simulation> {
    let text = format!("{SCENE}{}\n", SOLVERS[solver % SOLVERS.len()]);
    Simulation::new(parse(&text, "small.toml", Path::new(".")).ok()?).ok()
}

/// States of small simulations after some frames, each after the index of its solver.
pub(super) fn states() -> Vec<Vec<u8>> {
    let mut all = Vec::new();
    for solver in 0..SOLVERS.len() {
        let Some(mut simulation) = small(solver) else {
            continue;
        };
        for _ in 0..2 {
            (0..3).for_each(|_| simulation.step_frame());
            let mut writer = Writer {
                bytes: vec![solver as u8],
            };
            simulation.save(&mut writer);
            all.push(writer.bytes);
        }
    }
    all
}

/// Checks that bytes, the first one the index of a solver, are rejected or are a state that is
/// saved as the same bytes; and that as a checkpoint they are rejected or opened.
///
/// # Errors
/// The first broken promise.
pub fn check_state(bytes: &[u8]) -> Result<LoadOutcome, Breach> {
    let opened = caught(|| {
        Checkpoint::open(bytes)
            .err()
            .map(|refused| refused.to_string())
    })?;
    check_words(opened.unwrap_or_default())?;
    let [solver, state @ ..] = bytes else {
        return Ok(LoadOutcome::Refused);
    };
    let Some(mut simulation) = small(usize::from(*solver)) else {
        return Err(Breach::Invalid {
            detail: "the small scene does not run".to_owned(),
        });
    };
    let mut from = Reader::new(state);
    let restored = caught(|| simulation.restore(&mut from).and_then(|()| from.end()))?;
    if let Err(corrupt) = restored {
        check_words(corrupt.to_string())?;
        return Ok(LoadOutcome::Refused);
    }
    let mut writer = Writer::default();
    simulation.save(&mut writer);
    if writer.bytes == state {
        return Ok(LoadOutcome::Accepted);
    }
    Err(Breach::Changed {
        writer: "state",
        detail: "what was read is saved as other bytes".to_owned(),
    })
}

fn check_words(text: String) -> Result<(), Breach> {
    if text.len() > 300 || text.chars().any(char::is_control) {
        return Err(Breach::Unhelpful {
            expected: "one printable line",
            text,
        });
    }
    Ok(())
}
