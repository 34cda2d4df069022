//! Contents of reports: the form of a study of accuracy, verdicts over inserted implants.

use std::time::Duration;

use nalgebra::Point3;
use pliant::accuracy::{Study, StudyOptions, measure};
use pliant::mesh::shapes::sheet;
use pliant::progress::Silent;
use pliant::scene::builtin::load;
use pliant::simulation::Assets;
use pliant::skin::{ImplantPlace, ImplantSpec, SettleProgress, insert};
use pliant_cli::report::implant::{Insertion, Point};
use pliant_cli::report::work_precision;

const CENTRE: ImplantPlace = ImplantPlace::Point(Point3::new(0.0, 0.0, 0.0));

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

#[test]
fn a_volume_of_a_curve_that_is_not_at_rest_fails_and_far_stretched_skin_does_not() {
    let skin = sheet(0.2, 24);
    let order = ImplantSpec {
        edge: Some(8e-3),
        ..ImplantSpec::round(CENTRE, 0.07, 6e-5)
    };
    let (ready, done) = insert(&skin, &order, &[], |_| true).expect("settled");
    assert!(done.progress.converged, "{:?}", done.progress);
    let point = |volume, converged| {
        let progress = SettleProgress {
            converged,
            ..done.progress
        };
        Point {
            implant: 1,
            day: None,
            volume,
            areas: done.areas,
            progress,
        }
    };
    let all = |curve: Vec<Point>, limit: f64, interrupted: bool| {
        let implants = vec![(ready.clone(), done.clone())];
        let name = "sheet".to_owned();
        let insertion = Insertion {
            name,
            skin: &skin,
            implants,
            numbers: vec![vec![0]],
            obstacles: &[],
            curve,
            limit,
            interrupted,
            wanted: None,
            time: 0.0,
            under: "implant",
        };
        let kept: Vec<bool> = insertion.verdicts().iter().map(|v| v.passed).collect();
        let output = insertion.output().expect("pictures");
        (kept, output.summary())
    };
    let (kept, json) = all(vec![point(4e-5, true), point(6e-5, true)], 1.01, false);
    assert_eq!(
        (kept, &json["implant"]["converged"]),
        (vec![true, true], &true.into())
    );
    assert!(
        json["implant"]["area_over_limit_m2"]
            .as_f64()
            .is_some_and(|area| area > 1e-4),
        "{json}"
    );
    let (kept, json) = all(vec![point(4e-5, false), point(6e-5, true)], 9.0, false);
    assert_eq!(
        (kept, &json["implant"]["converged"]),
        (vec![false, true], &false.into())
    );
    assert_eq!(
        (
            &json["verdicts"][0]["passed"],
            &json["implant"]["area_over_limit_m2"]
        ),
        (&false.into(), &0.0.into())
    );
    let (kept, json) = all(Vec::new(), 9.0, true);
    assert_eq!(
        (kept, &json["implant"]["converged"], &json["interrupted"]),
        (vec![false, true], &false.into(), &true.into())
    );
}
