//! Promise of the reader of spring systems for any bytes: a valid system, or a helpful error (P45).

use super::loaders::{Breach, LoadOutcome, caught, check_error};
use crate::springs::format::{SpringFile, read_bytes, write_to};

/// Checks the reader and the writer of spring systems with the given bytes.
///
/// # Errors
/// The first broken promise.
pub fn check_spring_file(bytes: &[u8]) -> Result<LoadOutcome, Breach> {
    match caught(|| read_bytes(bytes, "a.springs"))? {
        Err(error) => check_error(&error, bytes),
        Ok(file) => check_file(file),
    }
}

fn check_file(file: SpringFile) -> Result<LoadOutcome, Breach> {
    let invalid = |detail: &str| {
        Err(Breach::Invalid {
            detail: detail.to_owned(),
        })
    };
    let count = file.position.len();
    let triangles = file.triangles.iter().flatten();
    let lines = file
        .springs
        .iter()
        .flat_map(|(ends, _)| ends)
        .chain(file.fibres.iter().flatten());
    let mut named = triangles
        .chain(lines)
        .chain(&file.origin)
        .chain(&file.insertion);
    if count == 0 || file.surface.len() != count || named.any(|&p| p as usize >= count) {
        return invalid("points that do not exist");
    }
    if !file
        .position
        .iter()
        .flat_map(|p| p.iter())
        .all(|c| c.is_finite())
    {
        return invalid("a coordinate that is not finite");
    }
    // The distance of finite coordinates can overflow: then there is no rest length.
    let far = file
        .position
        .iter()
        .any(|p| p.iter().any(|c| c.abs() > 1e150));
    if !far && file.springs().is_err() {
        return invalid("springs that are none");
    }
    let mut text = Vec::new();
    // Writing to a vector cannot fail.
    let _ = write_to(&mut text, &file);
    // Notes belong to the original file.
    let without = |file: SpringFile| SpringFile {
        notes: Vec::new(),
        ..file
    };
    match read_bytes(&text, "a.springs") {
        Ok(again) if without(again.clone()) == without(file.clone()) => Ok(LoadOutcome::Accepted),
        Ok(_) => Err(Breach::Changed {
            writer: "springs",
            detail: "something else is read".to_owned(),
        }),
        Err(error) => Err(Breach::Changed {
            writer: "springs",
            detail: error.terse(),
        }),
    }
}
