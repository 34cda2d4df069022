//! No text makes the reader panic.

use pliant::scene::builtin::BUILTIN;
use proptest::prelude::*;

use super::{SMALL, read, read_with};

/// The parts of a mutated scene.
fn piece() -> impl Strategy<Value = String> {
    let tokens = [
        "[",
        "]",
        "[[",
        "]]",
        "{",
        "}",
        "=",
        ".",
        ",",
        "#",
        "\"",
        "'",
        "\n",
        "\\u0000",
        "0",
        "-1",
        "1e999",
        "nan",
        "inf",
        "true",
        "none",
        "\"1 mm\"",
        "\"-1 mm\"",
        "\"$HERE/femur.obj\"",
        "\"../x\"",
        "1979-05-27",
        "é",
        "\u{0}",
        "[[muscle]]",
        "[effects.contact]",
        "[solver.pbd]",
        "[bone.motion]",
        "frames",
        "name",
        "shape",
        "keys",
    ];
    prop_oneof![
        prop::sample::select(tokens.map(str::to_owned).to_vec()),
        any::<String>()
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    /// A built-in scene with inserted pieces, removed pieces and swapped lines is a scene or an
    /// error with its place.
    #[test]
    fn no_mutation_makes_the_reader_panic(
        scene in 0..BUILTIN.len(),
        cuts in prop::collection::vec((any::<prop::sample::Index>(), 0..12_usize, piece()), 1..6),
        swap in any::<(prop::sample::Index, prop::sample::Index)>(),
    ) {
        let mut lines: Vec<&str> = BUILTIN[scene].1.lines().collect();
        let count = lines.len();
        lines.swap(swap.0.index(count), swap.1.index(count));
        let mut text: Vec<char> = lines.join("\n").chars().collect();
        for (at, length, piece) in cuts {
            let at = at.index(text.len() + 1);
            let end = (at + length).min(text.len());
            text.splice(at..end, piece.chars());
        }
        let text: String = text.into_iter().collect();
        if let Err(error) = read(&text) {
            prop_assert!(error.place().is_some());
            // A caret is drawn below these bytes.
            prop_assert!(error.source_text().get(error.span()).is_some());
            prop_assert!(!error.terse().contains('\n'), "{}", error.terse());
        }
    }

    /// No text of any kind and no override makes the reader panic.
    #[test]
    fn no_text_makes_the_reader_panic(pieces in prop::collection::vec(piece(), 0..40), value in any::<String>()) {
        let text = pieces.concat();
        let _ = read(&text);
        for change in [text, format!("effects.contact.friction={value}"), format!("muscle.{value}.edge_length=1 mm")] {
            if let Err(error) = read_with(SMALL, &[&change]) {
                prop_assert!(error.terse().starts_with("change "), "{}", error.terse());
            }
        }
    }
}
