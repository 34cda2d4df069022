//! Models of OpenSim: places of bodies as OpenSim computes them, motions, and what is refused.

use std::path::{Path, PathBuf};

use nalgebra::Point3;
use pliant::opensim::Model;

const GOLDEN: f64 = 0.618_033_988_749_894_9;

fn file(name: &str) -> PathBuf {
    Path::new("tests/suite/opensim").join(name)
}

/// A file of the shared data; `None`, said, where it is absent.
fn shared(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("PLIANT_DATA").map_or("../shared/data".into(), PathBuf::from);
    let path = folder.join("opensim").join(name);
    if !path.exists() {
        println!("skipped: no {}", path.display());
        return None;
    }
    Some(path)
}

/// The values of pose `i`, as `opensim/oracle.py` chooses them.
fn chosen(model: &Model, i: usize) -> Vec<f64> {
    let of = |(k, c): (usize, &pliant::opensim::Coordinate)| {
        let [low, high] = [c.range[0].max(-2.0), c.range[1].min(2.0)];
        let share = ((i + 1) as f64 * (k + 1) as f64 * GOLDEN) % 1.0;
        low + (high - low) * share
    };
    let mut values: Vec<f64> = model.coordinates.iter().enumerate().map(of).collect();
    model.couple(&mut values);
    values
}

/// Greatest distance of places of bodies from those of OpenSim [m], over all poses of a table.
fn off(model: &Model, table: &str) -> f64 {
    let mut worst = 0.0_f64;
    for (i, row) in table.lines().enumerate() {
        let poses = model.poses(&chosen(model, i));
        let real: Vec<f64> = row.split(',').map(|n| n.parse().expect("a number")).collect();
        assert_eq!(real.len(), 3 * (poses.len() - 1));
        for (pose, real) in poses[1..].iter().zip(real.chunks(3)) {
            let place = pose * Point3::new(0.1, 0.2, 0.3);
            let distance = (place - Point3::new(real[0], real[1], real[2])).norm();
            worst = if distance <= worst { worst } else { distance };
        }
    }
    worst
}

#[test]
fn each_kind_of_joint_and_function_places_bodies_as_opensim_does() {
    let model = Model::read(&file("joints.osim")).expect("a model");
    let table = std::fs::read_to_string(file("joints.csv")).expect("a table");
    let worst = off(&model, &table);
    assert!(worst <= 1e-12, "{worst:e} m");
    // A point of a body that a joint turns the other way is far off.
    let turned = std::fs::read_to_string(file("joints.osim")).expect("a text");
    let turned = turned.replacen("<axis>1 2 0.5</axis>", "<axis>-1 2 0.5</axis>", 1);
    let wrong = Model::parse(&turned, "turned.osim").expect("a model");
    assert!(off(&wrong, &table) > 1e-3);
}

#[test]
fn rajagopals_bodies_are_where_opensim_places_them() {
    let Some(path) = shared("Rajagopal_2015.osim") else {
        return;
    };
    let model = Model::read(&path).expect("a model");
    assert_eq!((model.bodies.len(), model.coordinates.len()), (23, 39));
    let table = std::fs::read_to_string(file("rajagopal.csv")).expect("a table");
    let worst = off(&model, &table);
    assert!(worst <= 1e-12, "{worst:e} m");
}
