//! Promise of the readers of OpenSim's models and motions for any bytes: finite poses, or an error
//! with its place (P45).

use super::loaders::{Breach, LoadOutcome, caught};
use crate::opensim::{Model, ModelError, MotionTable};

/// Checks the reader of models with bytes that begin with `<`, and that of motions with others.
///
/// # Errors
/// The first broken promise.
pub fn check_model(bytes: &[u8]) -> Result<LoadOutcome, Breach> {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return Ok(LoadOutcome::Refused);
    };
    if !text.trim_start().starts_with('<') {
        return match caught(|| MotionTable::parse(text, "a.mot"))? {
            Err(error) => check_error(&error, text),
            Ok(table) => {
                let fits = table
                    .rows
                    .iter()
                    .all(|row| row.len() == table.columns.len());
                match fits && table.times.windows(2).all(|pair| pair[0] < pair[1]) {
                    true => Ok(LoadOutcome::Accepted),
                    false => Err(Breach::Invalid {
                        detail: "rows of different lengths, or times that do not ascend".to_owned(),
                    }),
                }
            }
        };
    }
    let model = match caught(|| Model::parse(text, "a.osim"))? {
        Err(error) => return check_error(&error, text),
        Ok(model) => model,
    };
    let poses = caught(|| model.poses(&model.defaults()))?;
    match poses.len() == model.bodies.len() {
        true => Ok(LoadOutcome::Accepted),
        false => Err(Breach::Invalid {
            detail: format!("{} poses of {} bodies", poses.len(), model.bodies.len()),
        }),
    }
}

/// An error is one printable line with a code, and its place exists.
fn check_error(error: &ModelError, text: &str) -> Result<LoadOutcome, Breach> {
    let terse = error.terse();
    let unhelpful = |expected| {
        Err(Breach::Unhelpful {
            expected,
            text: terse.clone(),
        })
    };
    if terse.chars().any(char::is_control) || !terse.contains("error[E") {
        return unhelpful("one printable line with a code");
    }
    let lines = text.lines().count().max(1);
    if error.line as usize > lines + 1 {
        return unhelpful("a line that the text has");
    }
    Ok(LoadOutcome::Refused)
}
