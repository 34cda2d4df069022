//! Promise of the reader of collections for any bytes: a collection that is read again unchanged,
//! or a helpful error (P45).

use super::loaders::{Breach, LoadOutcome, caught, check_error};
use crate::io::pvd::{is_below, read_bytes};

/// Checks the reader and the writer of collections with the given bytes.
///
/// # Errors
/// The first broken promise.
pub fn check_collection(bytes: &[u8]) -> Result<LoadOutcome, Breach> {
    let collection = match caught(|| read_bytes(bytes, "a.pvd"))? {
        Err(error) => return check_error(&error, bytes),
        Ok(collection) => collection,
    };
    if let Some(entry) = collection
        .entries()
        .iter()
        .find(|e| !e.time.is_finite() || !is_below(&e.file))
    {
        return Err(Breach::Invalid {
            detail: format!("{entry:?}"),
        });
    }
    let mut text = Vec::new();
    // Writing to a vector cannot fail.
    let _ = collection.write_to(&mut text);
    let changed = |detail| {
        Err(Breach::Changed {
            writer: "pvd",
            detail,
        })
    };
    match read_bytes(&text, "a.pvd") {
        Ok(again) if again == collection => Ok(LoadOutcome::Accepted),
        Ok(_) => changed("something else is read".to_owned()),
        Err(error) => changed(error.terse()),
    }
}
