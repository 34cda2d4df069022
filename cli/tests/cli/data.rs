//! `pliant data`: meshes to begin with.

use std::fs;

use serde_json::Value;

use super::{Scratch, measures, names_in, pliant, run, shown, text};

#[test]
fn a_first_muscle_becomes_a_scene_that_runs() {
    let scratch = Scratch::folder();
    let folder = scratch.join("first-muscle");
    let done = run(&["data", shown(&folder), "--json"]);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let written: Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!(written["files"].as_array().map(Vec::len), Some(3));
    let names = ["Femur.r.obj", "Gluteus_medius.r.obj", "Hip_bone.r.obj"];
    assert_eq!(names_in(&folder), names);
    let init = pliant()
        .current_dir(&*scratch)
        .args(["init", "first-muscle", "--joint", "hip"])
        .output()
        .unwrap();
    assert_eq!(init.status.code(), Some(0), "{}", text(&init.stderr));
    let scene = fs::read_to_string(scratch.join("hip.toml")).unwrap();
    assert!(
        scene.contains("Gluteus_medius.r") && scene.contains("joint = \"hip\""),
        "{scene}"
    );
    assert!(scratch.join("pliant-out/hip/attachments.png").is_file());
    // Nothing is written over.
    let again = run(&["data", shown(&folder)]);
    let said = text(&again.stderr);
    assert_eq!(again.status.code(), Some(2));
    assert!(
        said.contains("is there already; name another folder"),
        "{said}"
    );
}

#[test]
fn sets_of_measured_meshes_have_an_address_and_a_licence() {
    let done = run(&["data", "--json"]);
    let found: Value = serde_json::from_slice(&done.stdout).unwrap();
    let sets = measures(&found)["sets"].as_array().unwrap().clone();
    assert!(sets.len() >= 3);
    for set in &sets {
        assert!(
            set["address"].as_str().unwrap().starts_with("https://"),
            "{set}"
        );
        assert!(!set["licence"].as_str().unwrap().is_empty(), "{set}");
    }
    assert!(text(&run(&["data"]).stdout).contains("BodyParts3D"));
}
