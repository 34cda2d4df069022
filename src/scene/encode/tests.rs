//! Every key of a scene is part of its encoding: of the keys of runs and of comparisons.

use std::path::Path;

use super::super::overrides;
use super::super::tree::{self, Node, Sources, Value};
use super::super::{Content, LAYOUTS, Material, SOLVERS, Surroundings, parse_content};
use crate::encode::text_of;
use crate::testing::Scratch;

/// Texts that are the other choice of some key.
const WORDS: [&str; 31] = [
    "linear",
    "stored",
    "reversed",
    "sliding",
    "hip-femur",
    "tetrahedron",
    "scalp",
    "skull",
    "quasi_static",
    "oval",
    "implicit",
    "in",
    "1/L",
    "mm",
    "m",
    "cm",
    "km",
    "femur",
    "hip bone",
    "another name",
    "gluteus medius",
    "patch.obj",
    "patch.obj#0",
    "patch.obj#1",
    "skin.obj",
    "fibres.vtk",
    "['bones']",
    "['0 mm', '1 mm', '2 mm']",
    "[0, 0, 1]",
    "off",
    "7",
];

/// What no other value can take the place of in the layouts: names that stand elsewhere as well, and
/// keys of which the others of their section depend.
const TIED: [&str; 13] = [
    "bone.0.name",
    "bone.0.repair",
    "bone.1.name",
    "effects.contact.between.0",
    "effects.contact.between.1",
    "effects.contact.between.2",
    "interface.0.between.0",
    "interface.0.between.1",
    "interface.0.kind",
    "muscle.0.name",
    "muscle.1.name",
    "skin.0.shape",
    "unit",
];

/// The scenes of the layouts, and parts that exclude others in them.
fn scenes() -> Vec<(&'static str, Vec<String>)> {
    let mut scenes: Vec<_> = LAYOUTS.map(|(_, text)| (text, Vec::new())).into();
    let [muscles, skin, lattice, ..] = LAYOUTS.map(|(_, text)| text);
    let change = |change: &str| change.to_owned();
    for solver in &SOLVERS {
        let mut changes = vec![format!("solver={}", solver.key)];
        for key in solver.keys {
            let value = match key.key {
                "substeps" | "iterations" => "20",
                "order" => "coloured",
                "tolerance" => "0.01",
                _ => "0.9",
            };
            changes.push(format!("solver.{}.{}={value}", solver.key, key.key));
        }
        if solver.question.is_none() {
            changes.push(change("accuracy=off"));
        }
        scenes.push((muscles, changes));
    }
    scenes.push((
        muscles,
        vec![
            change("muscle.0.material.density=off"),
            change("muscle.0.material.vertex_mass=1 g"),
        ],
    ));
    scenes.push((lattice, vec![
        change("lattice.drag=off"),
        change("lattice.release=off"),
        change(
            "lattice.rest={ shrink = 0.02, held = true, integrator = 'verlet', time_step = '5 ms', \
             adaptive = false, tolerance = 1e-6 }",
        ),
    ]));
    scenes.push((lattice, vec![change("lattice.damping=0.4 N s/m")]));
    let ball = [
        "implant=off",
        "obstacle=off",
        "skin.0.mesh=off",
        "skin.0.unit=off",
        "skin.0.repair=off",
        "skin.0.shape=sheet",
        "sheet={ side = '20 cm', cells = 64 }",
        "ball={ radius = '2.5 mm', to = ['0 mm', '0 mm', '0 mm'], from = ['0 mm', '0 mm', '-9 mm'], depth = '0.1 mm' }",
    ];
    scenes.push((skin, ball.map(change).into()));
    scenes
}

/// The paths of all plain values of a document, with other values that might be accepted.
fn leaves(node: &Node, path: &str, out: &mut Vec<(String, Vec<String>)>) {
    let below = |key: &str| match path {
        "" => key.to_owned(),
        _ => format!("{path}.{key}"),
    };
    let numbers = |n: f64, rest: &str| -> Vec<String> {
        let others = [0.9 * n, 1.1 * n, 0.5 * n, -n, n + 0.25, 0.3 * n];
        others.iter().map(|n| format!("{n}{rest}")).collect()
    };
    let mut others = match &node.value {
        Value::Table(table) => {
            for entry in &table.entries {
                leaves(&entry.node, &below(&entry.key), out);
            }
            return;
        }
        Value::List(list) => {
            for (k, node) in list.iter().enumerate() {
                leaves(node, &below(&k.to_string()), out);
            }
            // Its elements are names of which each can stand once.
            if path != "effects.contact.between" {
                return;
            }
            Vec::new()
        }
        Value::Text(text) => {
            let is_of_number = |c: char| c.is_ascii_digit() || "+-.".contains(c);
            let end = text.find(|c| !is_of_number(c)).unwrap_or(text.len());
            let number = text[..end].parse();
            number.map_or_else(|_| Vec::new(), |n| numbers(n, &text[end..]))
        }
        Value::Integer(n) => [n + 1, n - 1, 2 * n, n + 2, 6, -n]
            .map(|n| n.to_string())
            .into(),
        Value::Float(n) => numbers(*n, ""),
        Value::Boolean(flag) => vec![(!flag).to_string()],
        Value::Date => Vec::new(),
    };
    others.extend(WORDS.map(str::to_owned));
    out.push((path.to_owned(), others));
}

/// A folder with the files of the layouts.
fn folder() -> Scratch {
    let folder = Scratch::folder();
    for name in [
        "femur.obj",
        "gluteus.obj",
        "patch.obj",
        "fibres.vtk",
        "skin.obj",
        "ribs.obj",
        "ball.obj",
    ] {
        std::fs::write(folder.join(name), "").expect("a file");
    }
    folder
}

#[test]
fn muscles_of_an_interface_change_the_encoding_and_the_layout_has_the_default_material() {
    let folder = folder();
    let around = Surroundings::of(&folder);
    let content = parse_content(LAYOUTS[0].1, "layout.toml", &around);
    let Ok(Content::Muscles(mut scene)) = content else {
        panic!("a scene of muscles");
    };
    let [given, absent] = [0, 1].map(|m: usize| scene.muscles[m].material);
    let as_absent = Material {
        bulk: absent.bulk,
        ..given
    };
    assert_eq!(as_absent, absent);
    let before = text_of("scene", &*scene);
    scene.interfaces[0].between.reverse();
    assert_ne!(text_of("scene", &*scene), before);
}

#[test]
fn every_key_of_every_layout_changes_the_encoding() {
    let folder = folder();
    let folder: &Path = &folder;
    let encoded = |text: &str, changes: &[String]| {
        let around = Surroundings {
            overrides: changes,
            ..Surroundings::of(folder)
        };
        let content = parse_content(text, "layout.toml", &around);
        content.map(|content| text_of("scene", &content))
    };
    let (mut count, mut silent) = (0, Vec::new());
    for (text, given) in scenes() {
        let plain = encoded(text, &given).unwrap_or_else(|e| panic!("{given:?}: {}", e.terse()));
        assert_eq!(
            encoded(&format!("\n{text}"), &given).ok(),
            Some(plain.clone())
        );
        let mut sources = Sources::new("layout.toml", text);
        let mut document = tree::document(&sources).expect("TOML");
        for change in &given {
            overrides::apply(change, &mut document, &mut sources).expect("a change");
        }
        let mut all = Vec::new();
        leaves(&document, "", &mut all);
        for (path, others) in all {
            count += 1;
            let differs = |other: &String| {
                let changes = [given.as_slice(), &[format!("{path}={other}")]].concat();
                encoded(text, &changes).is_ok_and(|changed| changed != plain)
            };
            if !others.iter().any(differs) {
                silent.push(path);
            }
        }
    }
    silent.retain(|path: &String| !TIED.contains(&path.as_str()));
    silent.sort();
    silent.dedup();
    assert!(count > 400, "{count}");
    assert_eq!(silent, Vec::<String>::new());
}
