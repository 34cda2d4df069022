use pliant::opensim::{Model, MotionTable};
use nalgebra::Point3;
fn main() {
    for (m, t) in [("tests/suite/opensim/joints.osim","tests/suite/opensim/joints.csv"),("/work/shared/data/opensim/Rajagopal_2015.osim","tests/suite/opensim/rajagopal.csv")] {
        let model = Model::read(std::path::Path::new(m)).map_err(|e| e.terse()).unwrap();
        let table = std::fs::read_to_string(t).unwrap();
        let mut worst = vec![0.0f64; model.bodies.len()];
        for (i, row) in table.lines().enumerate() {
            let mut values: Vec<f64> = model.coordinates.iter().enumerate().map(|(k, c)| {
                let [low, high] = [c.range[0].max(-2.0), c.range[1].min(2.0)];
                low + (high - low) * (((i + 1) as f64 * (k + 1) as f64 * 0.6180339887498949) % 1.0)
            }).collect();
            model.couple(&mut values);
            let poses = model.poses(&values);
            let real: Vec<f64> = row.split(',').map(|n| n.parse().unwrap()).collect();
            for b in 1..poses.len() {
                let p = poses[b] * Point3::new(0.1,0.2,0.3);
                let r = Point3::new(real[3*b-3], real[3*b-2], real[3*b-1]);
                worst[b] = worst[b].max((p-r).norm());
            }
        }
        for (b, w) in model.bodies.iter().zip(&worst) { println!("{} {w:e}", b.name); }
        println!("{} muscles", model.muscles.len());
    }
    for t in ["subject01_walk1_ik.mot","walking_coordinates.sto"] {
        let t = MotionTable::read(&std::path::Path::new("/work/shared/data/opensim").join(t)).unwrap();
        println!("{:?} {} {}", t.span(), t.columns.len(), t.in_degrees);
    }
    println!("{}", Model::read(std::path::Path::new("/work/shared/data/opensim/gait10dof18musc_subject01.osim")).unwrap_err().terse());
}
