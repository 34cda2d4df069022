//! The tables of effects, solvers, kinds of scenes and formats: how many files mention an element, and whether the
//! documents describe it correctly.
//!
//! A new effect, solver or format touches the files that mention an existing one.

use std::fs;
use std::path::Path;

use pliant::io::FORMATS;
use pliant::scene::{EFFECTS, KeySpec, KeyValue, Material, SOLVERS, Slider};
use pliant::testing::internals::scene::{KeyKind, Limit, material_constants};

/// A file: its path from the root and its code.
type Source = (String, String);

const ROOTS: [&str; 4] = ["src", "render/src", "viewer/src", "cli/src"];

fn collect(root: &Path, folder: &str, found: &mut Vec<Source>) {
    for entry in fs::read_dir(root.join(folder)).expect("a folder of sources") {
        let entry = entry.expect("an entry");
        let name = entry.file_name().into_string().expect("UTF-8");
        let path = format!("{folder}/{name}");
        if entry.path().is_dir() {
            collect(root, &path, found);
        } else if name.ends_with(".rs") && !is_test(&path) {
            let text = fs::read_to_string(entry.path()).expect("a source");
            found.push((path, code(&text)));
        }
    }
}

fn is_test(path: &str) -> bool {
    path.ends_with("/tests.rs") || path.contains("/tests/") || path.starts_with("src/testing/")
}

/// A source without its comments and its tests.
fn code(text: &str) -> String {
    let text = text
        .split("\n#[cfg(test)]\nmod ")
        .next()
        .unwrap_or_default();
    let mut code = String::new();
    for line in text.lines() {
        let line = match line.find("// ") {
            _ if line.trim_start().starts_with("//") => "",
            Some(at) if line[..at].ends_with(' ') => &line[..at],
            _ => line,
        };
        code.push_str(line);
        code.push('\n');
    }
    code
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Whether some code contains a text that is not part of a longer word.
fn mentions(code: &str, text: &str) -> bool {
    code.match_indices(text).any(|(at, _)| {
        let before = code[..at].chars().next_back();
        let after = code[at + text.len()..].chars().next();
        let cut = |inner: Option<char>, outer: Option<char>| {
            !(inner.is_some_and(is_word) && outer.is_some_and(is_word))
        };
        cut(text.chars().next(), before) && cut(text.chars().next_back(), after)
    })
}

/// The files that contain one of some texts, and the file of the given name.
fn naming(sources: &[Source], file: &str, texts: &[&str]) -> Vec<String> {
    let own = format!("/{file}.rs");
    let mut paths = Vec::new();
    for (path, code) in sources {
        if path.ends_with(&own) || texts.iter().any(|text| mentions(code, text)) {
            paths.push(path.clone());
        }
    }
    paths.sort();
    paths
}

fn sources() -> Vec<Source> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = Vec::new();
    for folder in ROOTS {
        collect(root, folder, &mut found);
    }
    assert!(found.len() > 300, "{}", found.len());
    found
}

#[test]
fn an_effect_is_named_in_the_two_tables_and_in_its_own_file() {
    let sources = sources();
    let files = |key: &str| {
        let (quoted, field) = (format!("\"{key}\""), format!("effects.{key}"));
        naming(&sources, key, &[&quoted, &field])
    };
    let (declared, modelled) = ("src/scene/effects.rs", "src/simulation/effects.rs");
    assert_eq!(
        files("anisotropy"),
        ["src/fibres/anisotropy.rs", declared, modelled]
    );
    // Classic PBD has its own stiffness for it, and a page explains why skin has none.
    assert_eq!(
        files("bending"),
        [
            "src/constraints/bending.rs",
            declared,
            "src/scene/solvers.rs",
            modelled,
            "src/simulation/plan/staged.rs"
        ]
    );
}

#[test]
fn a_solver_is_named_in_its_table_and_where_one_is_chosen() {
    let sources = sources();
    let files = |key: &str, variant: &str| {
        let (quoted, variant) = (format!("\"{key}\""), format!("Solver::{variant}"));
        naming(&sources, key, &[&quoted, &variant])
    };
    let table = "src/scene/solvers.rs";
    // An integrator of mass-spring systems has the same name.
    assert_eq!(
        files("implicit_euler", "ImplicitEuler"),
        [table, "src/springs/integrators/implicit_euler.rs"]
    );
    assert_eq!(files("pbd", "Pbd"), [table]);
    // Friction has no energy: its reference is a run with many short steps.
    assert_eq!(files("xpbd", "Xpbd"), ["src/accuracy/reference.rs", table]);
    // A method of skin has the same name; the sweep of a joint chooses this solver.
    assert_eq!(
        files("quasi_static", "QuasiStatic"),
        [
            "src/accuracy/skin.rs",
            "src/moment_arms/sweep.rs",
            "src/scene/parse_skin.rs",
            table,
            "src/solvers/quasi_static.rs"
        ]
    );
}

#[test]
fn a_kind_of_scenes_is_named_in_four_files_and_where_it_has_a_command_or_controls() {
    let texts = [
        "Content::Geometric",
        "ScenarioKind::Geometric",
        "GeometricScene",
        "GeometricRun",
    ];
    // With these four, `pliant run`, `plan`, `study` and `view` take a scene of the kind.
    let needed = [
        "src/scene/content.rs",
        "src/scene/content/geometric.rs",
        "src/simulation/scenario.rs",
        "src/simulation/scenario/geometric.rs",
    ];
    // A command and controls of its own, and the export that both import.
    let own = [
        "cli/src/commands/biceps.rs",
        "cli/src/report/biceps.rs",
        "src/simulation/mod.rs",
        "viewer/src/biceps.rs",
    ];
    let mut expected = [needed, own].concat();
    expected.sort_unstable();
    let found = naming(&sources(), "scenario/geometric", &texts);
    assert_eq!(found, expected);
}

#[test]
fn a_format_is_named_in_its_table_and_in_its_own_file() {
    let sources = sources();
    let files = |module: &str, variant: &str| {
        let (own, used) = (format!("mod {module}"), format!("{module}::"));
        naming(
            &sources,
            module,
            &[&own, &used, &format!("Format::{variant}")],
        )
    };
    for (module, variant) in [("off", "Off"), ("directx", "DirectX"), ("medit", "Medit")] {
        let own = format!("src/io/{module}.rs");
        let mut expected = ["src/io/formats.rs", "src/io/mod.rs", &own];
        expected.sort_unstable();
        assert_eq!(files(module, variant), expected);
    }
}

#[test]
fn control_another_file_and_a_longer_word_are_told_apart_and_comments_and_tests_do_not_count() {
    let one = |text: &str| vec![("src/a.rs".to_owned(), code(text))];
    let found =
        |text: &str| naming(&one(text), "bending", &["\"bending\"", "effects.bending"]).len();
    assert_eq!(found("fn f() { plan.runs(\"bending\"); }"), 1);
    assert_eq!(found("fn f() { scene.effects.bending = true; }"), 1);
    assert_eq!(found("fn f() { scene.effects.bending_more = true; }"), 0);
    assert_eq!(found("/// As \"bending\".\nfn f() {} // \"bending\""), 0);
    assert_eq!(
        found("fn f() {}\n\n#[cfg(test)]\nmod tests {\n    \"bending\"\n}"),
        0
    );
    let file = vec![("src/new/bending.rs".to_owned(), String::new())];
    assert_eq!(naming(&file, "bending", &[]).len(), 1);
}

const LAYOUT: &str = include_str!("../../src/scene/layout.toml");

/// The text of the layout from a heading to the next section or alternative.
fn part<'a>(layout: &'a str, heading: &str) -> &'a str {
    let at = layout
        .find(heading)
        .unwrap_or_else(|| panic!("{heading} is not in the layout"));
    let rest = &layout[at + heading.len()..];
    let ends = ["\n[", "\n# Or"].map(|end| rest.find(end).unwrap_or(rest.len()));
    &rest[..ends[0].min(ends[1])]
}

/// The value after `key = ` in a text, and the rest of the line.
fn value<'a>(text: &'a str, key: &str) -> Option<(&'a str, &'a str)> {
    let begin = format!("{key} = ");
    let (at, _) = text
        .match_indices(&begin)
        .find(|(at, _)| !text[..*at].chars().next_back().is_some_and(is_word))?;
    let line = text[at + begin.len()..].lines().next()?;
    let end = if line.starts_with('[') {
        line.find(']').map(|end| end + 1)
    } else {
        line.find([',', '#'])
    };
    let end = end.unwrap_or(line.len());
    Some((line[..end].trim().trim_matches('"'), line))
}

fn is_default(shown: &str, default: KeyValue) -> bool {
    match default {
        KeyValue::Number(number) => {
            let (digits, unit) = shown.split_once(' ').unwrap_or((shown, ""));
            let value: Option<f64> = digits.parse().ok();
            // Other defaults are shown in units of the SI.
            let in_si = |n: f64| if unit == "deg" { n.to_radians() } else { n };
            value.map(in_si) == Some(number)
        }
        other => shown == other.to_string(),
    }
}

/// The faults of a layout in its description of effects and solvers.
fn faults(layout: &str) -> Vec<String> {
    let mut faults = Vec::new();
    for spec in &EFFECTS {
        let text = part(layout, &format!("[effects.{}]", spec.key));
        for key in spec.keys {
            let found = value(text, key.key);
            let says_optional = found.is_some_and(|(_, line)| line.contains("optional"));
            let right = found.is_some_and(|(shown, _)| {
                key.default.is_none_or(|default| is_default(shown, default))
            });
            if !right || says_optional != key.default.is_some() {
                faults.push(format!("effects.{}.{}", spec.key, key.key));
            }
        }
    }
    let text = part(layout, "[muscle.material]");
    for constant in material_constants() {
        let found = value(text, constant.key.key);
        let default = constant.value(&Material::default()).map(KeyValue::Number);
        let right = found.is_some_and(|(shown, _)| default.is_none_or(|d| is_default(shown, d)));
        if !right {
            faults.push(format!("material.{}", constant.key.key));
        }
    }
    for spec in &SOLVERS {
        let text = part(layout, &format!("[solver.{}]", spec.key));
        for (key, default) in spec.default.settings() {
            if !value(text, key.key).is_some_and(|(shown, _)| is_default(shown, default)) {
                faults.push(format!("solver.{}.{}", spec.key, key.key));
            }
        }
    }
    faults
}

#[test]
fn the_layout_of_scenes_shows_every_key_with_its_default() {
    let layout = LAYOUT.replace("\n# velocity_damping", " velocity_damping");
    assert_eq!(faults(&layout), [""; 0]);
    // Controls: another default, a missing key.
    assert_eq!(
        faults(&layout.replace("bending = 0.9", "bending = 0.8")),
        ["solver.pbd.bending"]
    );
    assert_eq!(
        faults(&layout.replace("friction = 0 ", "frictions = 0 ")),
        ["effects.contact.friction"]
    );
}

#[test]
fn the_page_about_formats_has_a_row_for_each() {
    let page = include_str!("../../docs/formats.md");
    for spec in &FORMATS {
        let name = if spec.ending == "vtp" {
            "VTP"
        } else {
            spec.name
        };
        let row = page
            .lines()
            .find(|line| line.starts_with(&format!("| {name} |")));
        let cells: Vec<&str> = row.unwrap_or_default().split('|').map(str::trim).collect();
        assert!(cells.len() >= 5, "{name}");
        let is_written = FORMATS
            .iter()
            .any(|f| f.name == spec.name && f.is_written());
        assert_eq!(cells[3] != "–", is_written, "{name}");
    }
}

/// Whether both ends of a slider, in the unit of the file, are permitted values of the key.
fn slides_within(key: &KeySpec) -> bool {
    let limit = match key.kind {
        KeyKind::Number(limit) | KeyKind::Quantity(_, limit) => limit,
        KeyKind::Whole(_) => Limit::Within(1.0, 1e6),
        KeyKind::Vector(_) | KeyKind::Order | KeyKind::Names(_) => return true,
    };
    let allowed = |value: f64| match limit {
        Limit::Any => true,
        Limit::Positive => value > 0.0,
        Limit::NotNegative => value >= 0.0,
        Limit::Within(low, high) => (low..=high).contains(&value),
    };
    match key.slider {
        Slider::Even(low, high) | Slider::Factors(low, high) => allowed(low) && allowed(high),
        Slider::About { .. } | Slider::UpTo { .. } => true,
    }
}

#[test]
fn every_slider_stays_within_what_its_key_may_have() {
    let effects = EFFECTS.iter().flat_map(|spec| spec.keys);
    let solvers = SOLVERS.iter().flat_map(|spec| spec.keys);
    for key in effects.chain(solvers) {
        assert!(slides_within(key), "{}", key.key);
        assert!(key.help.ends_with('.'), "{}", key.key);
    }
    // Control: a slider beyond the limit.
    let mut wrong = EFFECTS[2].keys[0];
    wrong.slider = Slider::Even(0.0, 2.0);
    assert!(!slides_within(&wrong));
}
