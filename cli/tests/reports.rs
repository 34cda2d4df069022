//! Contents of reports: the form of a study of accuracy.

use std::time::Duration;

use pliant::accuracy::{Study, StudyOptions, measure};
use pliant::progress::Silent;
use pliant::scene::builtin::load;
use pliant::simulation::Assets;
use pliant_cli::report::work_precision;

/// Three frames of a built-in scene.
fn study() -> Study {
    let scene = load("distance", &["solver=xpbd".to_owned()]).expect("a built-in scene");
    let assets = Assets::load(&scene).expect("shapes made by code");
    let options = StudyOptions {
        budget: Duration::from_secs(20),
        frames: Some(3),
        threads: 1,
    };
    measure(&scene, &assets, options, &Silent).expect("a study")
}

#[test]
fn a_study_has_the_form_that_was_promised() {
    let mut study = study();
    study.interrupted = true;
    assert!(work_precision::output(&study).summary()["interrupted"] == true);
    study.interrupted = false;
    assert!(work_precision::output(&study).summary()["interrupted"] == false);
    let json = work_precision::to_json(&study);
    assert!(json["reference"]["uncertainty_m"].is_f64() && json["reference"]["solver"].is_string());
    for row in json["rows"].as_array().expect("rows") {
        for key in ["rms_error_m", "max_error_m", "volume_error", "time_s"] {
            assert!(row[key].is_number(), "{key} of {row}");
        }
        assert!(row["solver"].is_string() && row["settings"].is_object());
        let status = row["status"].as_str().expect("a status");
        assert!(
            ["converged", "not converged", "diverged"].contains(&status),
            "{status}"
        );
    }
    let targets: Vec<f64> = json["recommended"]
        .as_array()
        .expect("a list")
        .iter()
        .filter_map(|r| r["target"].as_f64())
        .collect();
    assert_eq!(targets, [0.1, 0.01, 0.001]);
    let mut csv = Vec::new();
    work_precision::data(&study)
        .write(&mut csv)
        .expect("memory");
    let text = String::from_utf8(csv).expect("text");
    let cells: Vec<usize> = text.lines().map(|line| line.split(',').count()).collect();
    assert_eq!(cells.len(), study.rows.len() + 1);
    assert!(cells.iter().all(|n| *n == cells[0]), "{cells:?}");
    assert!(work_precision::plot(&study).to_svg().contains("<circle"));
    assert!(
        work_precision::recommendation(&study).rows.len() == 3
            && work_precision::table(&study).rows.len() == study.rows.len()
    );
}
