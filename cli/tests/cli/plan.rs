//! `pliant plan`: what a run does before its first frame, and all mistakes at once.

use std::fs;

use serde_json::Value;

use super::{Scratch, json, measures, run, run_into, shown, text};

/// Changes of `press` with plates that close on the vertices that one of them holds.
fn closing(to: &str) -> Vec<String> {
    let attached = "muscle.0.attachment=[{bone='upper plate', near='9 mm', limit='8 %'}]";
    let to = format!("bone.0.motion.keys.1.translation=['0 mm', '{to} mm', '0 mm']");
    let sets = ["muscle.0.edge_length=8 mm", attached, to.as_str()];
    let sets = sets.iter().flat_map(|set| ["--set", set]);
    sets.map(str::to_owned).collect()
}

fn plan(scene: &str, more: &[String]) -> std::process::Output {
    let more: Vec<&str> = more.iter().map(String::as_str).collect();
    run(&[&["plan", scene][..], &more].concat())
}

#[test]
fn a_plan_shows_effects_and_attachments() {
    let done = plan("distance", &["--json".to_owned()]);
    let found: Value = serde_json::from_slice(&done.stdout).unwrap();
    let plan_of = measures(&found);
    assert_eq!(plan_of["effects"]["run"][0]["effect"], "stretch");
    let left_out = plan_of["effects"]["left_out"].as_array();
    assert!(left_out.is_some_and(|l| !l.is_empty()));
    let held = &plan_of["attachments"][0];
    assert_eq!(
        (held["bone"].as_str(), held["vertices"].as_u64()),
        (Some("bone"), Some(2))
    );
    assert_eq!(held["share"], 0.5);
    let table = text(&plan("distance", &[]).stdout);
    for part in [
        "stretch",
        "the scene has no [effects.contact]",
        "vertices held",
    ] {
        assert!(table.contains(part), "{part}: {table}");
    }
    let loose = text(&plan("press", &[]).stdout);
    assert!(loose.contains("muscle: no bone holds it"), "{loose}");
    // Other kinds of scenes hold nothing.
    assert_eq!(plan("expander", &[]).status.code(), Some(0));
}

#[test]
fn the_size_of_the_frames_is_known_before() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    // Frames without motion have hardly any numbers at points: those that follow count.
    run_into(&out, &["hip", "--frames", "20"]);
    let files = fs::read_dir(out.join("frames")).unwrap();
    let size: u64 = files.map(|f| f.unwrap().metadata().unwrap().len()).sum();
    let done = plan("hip", &["--json", "--set", "frames=20"].map(str::to_owned));
    let found: Value = serde_json::from_slice(&done.stdout).unwrap();
    let said = measures(&found)["disk_bytes"].as_u64().unwrap();
    let ratio = said as f64 / size as f64;
    assert!((0.99..=1.01).contains(&ratio), "{said} of {size}");
}

#[test]
fn a_start_that_is_wrong_is_red_before_a_run() {
    let done = plan("press", &closing("14"));
    let said = text(&done.stderr);
    assert_eq!(done.status.code(), Some(1), "{said}");
    let name = "share of an attachment that the motion would carry into another bone: 0.86";
    assert!(said.contains(name), "{said}");
    let done = plan("press", &closing("26"));
    assert_eq!(
        done.status.code(),
        Some(0),
        "control: {}",
        text(&done.stderr)
    );
}

#[test]
fn all_mistakes_are_reported_at_once() {
    let scratch = Scratch::folder();
    let file = scratch.join("scene.toml");
    let scene = |speed: &str, wrong: &str, mesh: &str, friction: &str| {
        format!(
            "frames = 3\nframe_rate = '{speed}'\n\
             [[bone]]\nname = 'plate'\nshape = 'press-plate'\n\
             [[muscle]]\nname = 'one'\nshape = 'press-muscle'\n\
             [[muscle.attachment]]\nbone = 'plate'\nvertices = [0, {wrong}]\n\
             [[muscle.attachment]]\nbone = 'plate'\nvertices = [99999999]\n\
             [[muscle]]\nname = 'two'\nmesh = '{mesh}'\nunit = 'm'\n\
             [effects.contact]\nthickness = '1 mm'\nfriction = {friction}\n\
             [effects.damping]\nrate = '{friction} 1/s'\n"
        )
    };
    let codes = |toml: &str| {
        fs::write(&file, toml).unwrap();
        let done = plan(shown(&file), &[]);
        let said = text(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{said}");
        assert!(done.stdout.is_empty());
        let code = |line: &str| line.split(['[', ']']).nth(1).map(str::to_owned);
        said.lines().filter_map(code).collect::<Vec<_>>()
    };
    // Mistakes of the text: each section reports its own.
    let text_of = scene("60", "1", "nowhere.obj", "-1");
    assert_eq!(codes(&text_of), ["E050", "E060", "E051", "E051"]);
    // Mistakes of the meshes: of two attachments, and of a file that is no mesh.
    fs::write(scratch.join("broken.obj"), "v 1 2\n").unwrap();
    assert_eq!(codes(&scene("60 Hz", "1", "broken.obj", "0")).len(), 1);
    fs::write(
        scratch.join("whole.obj"),
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    )
    .unwrap();
    let at = scene("60 Hz", "88888888", "whole.obj", "0");
    assert_eq!(codes(&at), ["E020", "E020"]);
}

#[test]
fn a_preview_is_a_picture_from_three_sides() {
    let scratch = Scratch::folder();
    let picture = scratch.join("start.png");
    let more = ["--preview", shown(&picture), "--json"].map(str::to_owned);
    let done = plan("hip", &more);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let found: Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!(found["files"][0], shown(&picture));
    let bytes = fs::read(&picture).unwrap();
    assert!(bytes.starts_with(b"\x89PNG"));
    // The page of a run shows such a picture, too.
    let out = scratch.join("out");
    run_into(&out, &["hip", "--frames", "1"]);
    let on_page = fs::read(out.join("attachments.png")).unwrap();
    assert!(on_page.starts_with(b"\x89PNG") && on_page[16..24] == bytes[16..24]);
    let files = &json(&out.join("summary.json"))["files"];
    assert!(
        files
            .as_array()
            .unwrap()
            .contains(&"attachments.png".into())
    );
    let done = plan("expander", &more);
    assert_eq!(done.status.code(), Some(2));
    // The name of a scene by mistake: it stays.
    let scene = scratch.join("scene.toml");
    fs::write(&scene, "frames = 3\n").unwrap();
    let done = plan("hip", &["--preview", shown(&scene)].map(str::to_owned));
    let said = text(&done.stderr);
    assert_eq!(done.status.code(), Some(2), "{said}");
    assert!(said.contains("does not end in .png"), "{said}");
    assert_eq!(fs::read_to_string(&scene).unwrap(), "frames = 3\n");
}

#[test]
fn every_key_of_a_scene_is_explained() {
    let page = text(&run(&["scenes", "explain", "--page"]).stdout);
    let docs = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/scene.md");
    let written = fs::read_to_string(docs).unwrap();
    assert_eq!(
        page, written,
        "write it anew: pliant scenes explain --page > docs/scene.md"
    );
    let keys = |path: &[&str]| -> Vec<Value> {
        let done = run(&[&["scenes", "explain"], path, &["--json"]].concat());
        let found: Value = serde_json::from_slice(&done.stdout).unwrap();
        measures(&found)["keys"].as_array().unwrap().clone()
    };
    let all = keys(&[]);
    assert!(all.len() > 150, "{}", all.len());
    for key in &all {
        // A section has neither example nor value.
        let [example, takes] = ["example", "takes"].map(|part| key[part].as_str().unwrap());
        assert_eq!(example.is_empty(), takes.is_empty(), "{key}");
        // A key has a default or is needed.
        let default = key["default"].as_str().unwrap();
        assert!(takes.is_empty() || !default.is_empty(), "{key}");
    }
    let friction = keys(&["effects.contact.friction"]);
    assert_eq!(friction[0]["takes"], "a number of at least zero");
    assert_eq!(keys(&["muscle.0.attachment"]).len(), 8);
    let done = run(&["scenes", "explain", "friction"]);
    let said = text(&done.stderr);
    assert_eq!(done.status.code(), Some(2));
    assert!(
        said.contains("did you mean effects.contact.friction or collision.friction?"),
        "{said}"
    );
}
