//! Models of OpenSim: places of bodies as OpenSim computes them, motions, and what is refused.

use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Point3, Vector3};
use pliant::mesh::measures::max_or_nan;
use pliant::opensim::paths::{self, PathSamples};
use pliant::opensim::{Model, MotionTable, MuscleParameters, normalised_lengths};
use pliant::scene::{Scene, SceneError, parse};
use pliant::testing::Scratch;

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
        let real: Vec<f64> = row
            .split(',')
            .map(|n| n.parse().expect("a number"))
            .collect();
        assert_eq!(real.len(), 3 * (poses.len() - 1));
        for (pose, real) in poses[1..].iter().zip(real.chunks(3)) {
            let place = pose * Point3::new(0.1, 0.2, 0.3);
            let distance = (place - Point3::new(real[0], real[1], real[2])).norm();
            worst = max_or_nan([worst, distance]);
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

/// A scene of two balls that the model of all joints moves, with a motion from a file.
fn driven(folder: &Path, change: impl Fn(String) -> String) -> Result<Scene, SceneError> {
    std::fs::copy(file("joints.osim"), folder.join("m.osim")).expect("copied");
    let mut table =
        "motion\ninDegrees=no\nnColumns=3\nendheader\ntime\t/jointset/Pin/pin_0/value\tp\tq\n"
            .to_owned();
    for k in 0..5 {
        let t = f64::from(k);
        table += &format!(
            "{}\t{}\t{}\t{}\n",
            0.5 * t,
            0.1 * t,
            0.3 - 0.2 * t,
            0.05 * t * t
        );
    }
    std::fs::write(folder.join("walk.mot"), table).expect("written");
    let text = "frames = 10\nframe_rate = '60 Hz'\n\
        [[bone]]\nname = 'upper'\nshape = 'tetrahedron'\n\
        [[bone]]\nname = 'lower'\nshape = 'tetrahedron'\n\
        [[bone]]\nname = 'aside'\nshape = 'tetrahedron'\n\
        [[muscle]]\nname = 'm'\nshape = 'tetrahedron'\n\
        [effects.gravity]\nacceleration = ['0 m/s2', '-9.81 m/s2', '0 m/s2']\n\
        [opensim]\nmodel = 'm.osim'\nbones = { upper = 'planar', lower = 'custom' }\nmotion = 'walk.mot'\nspeed = 15\nlead_in = 2\n"
        .to_owned();
    parse(&change(text), "driven.toml", folder)
}

#[test]
fn bones_follow_a_motion_from_a_file() {
    let folder = Scratch::folder();
    let scene = driven(&folder, |text| text).expect("a scene");
    let model = Model::read(&file("joints.osim")).expect("a model");
    let [planar, custom] = ["planar", "custom"].map(|name| model.body(name).expect("a body"));
    let index = |name: &str| model.coordinate(name).expect("a coordinate");
    let rest = model.poses(&model.defaults());
    // The first body carries the other and rests; bones without a body rest.
    assert!(scene.bones[0].motion.keys.is_empty() && scene.bones[2].motion.keys.is_empty());
    for frame in 2..=10 {
        // Fifteen seconds a second at 60 frames: eight frames over two seconds.
        let t = 15.0 * f64::from(frame - 2) / 60.0;
        let row = |of: &dyn Fn(f64) -> f64| {
            let k = (2.0 * t).floor().min(3.0);
            of(k) + (2.0 * t - k) * (of(k + 1.0) - of(k))
        };
        let mut values = model.defaults();
        values[index("pin_0")] = row(&|k| 0.1 * k);
        values[index("p")] = row(&|k| 0.3 - 0.2 * k);
        values[index("q")] = row(&|k| 0.05 * k * k);
        model.couple(&mut values);
        let poses = model.poses(&values);
        let expected =
            rest[planar] * poses[planar].inverse() * poses[custom] * rest[custom].inverse();
        let found = scene.bones[1].motion.pose(f64::from(frame));
        let point = Point3::new(0.3, -0.2, 0.5);
        let off = (found * point - expected * point).norm();
        assert!(off <= 1e-12, "frame {frame}: {off:e} m");
    }
    // From the pose of the meshes, without a jump.
    assert_eq!(scene.bones[1].motion.pose(0.0), Isometry3::identity());
    let elsewhere = driven(&folder, |text| {
        text.replace("lead_in = 2", "lead_in = 2\nfrom = '1 s'")
    })
    .expect("a scene");
    assert!(elsewhere.bones[1].motion != scene.bones[1].motion);
    // Fewer frames end sooner, and change nothing before.
    let short = driven(&folder, |text| text.replace("frames = 10", "frames = 5")).expect("a scene");
    let keys = &short.bones[1].motion.keys;
    assert_eq!(keys[..], scene.bones[1].motion.keys[..6]);
}

/// A joint acts at its place in the scene, and about the scene's directions.
#[test]
fn a_joint_has_its_place_in_the_scene() {
    let folder = Scratch::folder();
    let placed =
        |text: String| text + "centres = { Custom = ['1 m', '2 m', '3 m'] }\nforward = [0, 0, 1]\n";
    let scene = driven(&folder, placed).expect("a scene");
    let drive = scene.opensim.as_ref().expect("a model");
    let at = (0..drive.joints())
        .find(|k| drive.joint_name(*k) == "Custom")
        .expect("a joint");
    assert!((drive.place(at) - Point3::new(1.0, 2.0, 3.0)).norm() <= 1e-12);
    // The model's x is forward, which is z here; its own displacement is that of the model turned.
    let free = driven(&folder, |text| text).expect("a scene");
    let own = free.opensim.as_ref().expect("a model");
    let values: Vec<f64> = own.rest.iter().map(|v| v + 0.2).collect();
    let [here, there] = [drive, own].map(|d| d.displacements(&values)[at].rotation);
    let turn =
        nalgebra::UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -std::f64::consts::FRAC_PI_2);
    assert!((here.inverse() * (turn * there * turn.inverse())).angle() <= 1e-12);
}

#[test]
fn what_is_wrong_with_a_model_or_a_motion_is_said() {
    let folder = Scratch::folder();
    std::fs::write(
        folder.join("old.osim"),
        "<?xml version='1.0'?>\n<OpenSimDocument Version='30000'/>\n",
    )
    .expect("written");
    std::fs::write(
        folder.join("cut.osim"),
        "<OpenSimDocument Version=\"40600\"><Model name='m'>",
    )
    .expect("written");
    std::fs::write(folder.join("other.mot"), "endheader\ntime\tx\n0\t1\n").expect("written");
    std::fs::write(folder.join("back.mot"), "endheader\ntime\tp\n1\t1\n0\t1\n").expect("written");
    std::fs::write(folder.join("few.mot"), "endheader\ntime\tp\n0\t1\n1\n").expect("written");
    std::fs::write(folder.join("nan.mot"), "endheader\ntime\tp\n0\tnan\n").expect("written");
    let wrong = [
        ("model = 'm.osim'", "model = 'none.osim'", "no file"),
        (
            "model = 'm.osim'",
            "model = 'old.osim'",
            "older than OpenSim 4.0",
        ),
        ("model = 'm.osim'", "model = 'cut.osim'", "cut.osim:1:"),
        (
            "lower = 'custom'",
            "lower = 'custon'",
            "did you mean `custom`?",
        ),
        (
            "lower = 'custom'",
            "lover = 'custom'",
            "did you mean `lower`?",
        ),
        ("upper = 'planar', ", "", "no joint between them"),
        (
            "motion = 'walk.mot'",
            "motion = 'other.mot'",
            "no column is a coordinate",
        ),
        (
            "motion = 'walk.mot'",
            "motion = 'back.mot'",
            "back.mot:4: the time 0",
        ),
        (
            "motion = 'walk.mot'",
            "motion = 'few.mot'",
            "few.mot:4: 1 values for 2 columns",
        ),
        ("motion = 'walk.mot'", "motion = 'nan.mot'", "not finite"),
        (
            "motion = 'walk.mot'\nspeed = 15\n",
            "",
            "`motion` is missing",
        ),
        ("lead_in = 2", "lead_in = -1", "lead_in"),
        ("speed = 15", "speed = 0", "greater than zero"),
        ("lead_in = 2", "from = '3 s'", "is not allowed"),
        ("lead_in = 2", "from = '1 s'\nto = '0.5 s'", "0.5"),
        (
            "lead_in = 2",
            "at = { pin_1 = '1 deg' }",
            "did you mean `pin_0`?",
        ),
        ("lead_in = 2", "at = { pin_0 = '1 m' }", "m"),
        (
            "lead_in = 2",
            "centres = { Costum = ['0 m', '0 m', '0 m'] }",
            "joint of the model",
        ),
        ("lead_in = 2", "forward = [0, 1, 0]", "forward"),
        (
            "bones = { upper = 'planar', lower = 'custom' }",
            "bones = {}",
            "no joint between them",
        ),
    ];
    for (from, to, says) in wrong {
        let error = driven(&folder, |text| text.replace(from, to)).expect_err(to);
        assert!(error.terse().contains(says), "{to}: {}", error.terse());
    }
}

/// Samples of a polynomial of two coordinates, and of a third that does not move the muscle.
fn samples(count: usize, length: impl Fn(f64, f64) -> (f64, f64, f64)) -> PathSamples {
    let mut next = pliant::random::units(3);
    let mut samples = PathSamples {
        force: "/forceset/m".to_owned(),
        coordinates: vec![
            "/jointset/a/x".to_owned(),
            "/jointset/b/idle".to_owned(),
            "/jointset/a/y".to_owned(),
        ],
        ..PathSamples::default()
    };
    for _ in 0..count {
        let (x, y) = (2.0 * next() - 1.0, 2.0 * next() - 1.0);
        let (l, dx, dy) = length(x, y);
        samples.values.push(vec![x, next(), y]);
        samples.lengths.push(l);
        samples.arms.push(vec![-dx, 0.0, -dy]);
    }
    samples
}

#[test]
fn a_path_has_the_least_order_that_meets_the_tolerance() {
    let cubic = |x: f64, y: f64| {
        let l = 0.3 + 0.02 * x - 0.01 * y + 0.03 * x * x * y;
        (l, 0.02 + 0.06 * x * y, -0.01 + 0.03 * x * x)
    };
    let path = samples(60, cubic).fit(1e-4, 9).expect("a path");
    assert_eq!(
        (path.order, path.coordinates.len(), path.coefficients.len()),
        (3, 2, 10)
    );
    let (length, arms) = path.at(&[0.4, -0.7]);
    let (l, dx, dy) = cubic(0.4, -0.7);
    assert!(
        (length - l).abs() <= 1e-12
            && (arms[0] + dx).abs() <= 1e-12
            && (arms[1] + dy).abs() <= 1e-12
    );
    // A kink is met by no order, and says so.
    let kink = |x: f64, _: f64| (0.3 + 0.02 * x.abs(), 0.02 * x.signum(), 0.0);
    let worst = samples(200, kink).fit(1e-4, 9).expect("a path");
    assert!(!worst.meets(1e-4) && worst.arm_error[0] > 1e-3);
    assert!(
        samples(4, cubic).fit(1e-4, 9).is_none(),
        "fewer poses than coefficients"
    );
    assert!(
        samples(60, |_, _| (0.3, 0.0, 0.0)).fit(1e-4, 9).is_none(),
        "nothing moves it"
    );
}

#[test]
fn a_spliced_model_keeps_every_other_byte() {
    let path = samples(40, |x, y| (0.3 + 0.01 * x * y, 0.01 * y, 0.01 * x))
        .fit(1e-4, 9)
        .expect("a path");
    let before = "<?xml version=\"1.0\"?>\n<OpenSimDocument Version=\"40600\">\n\t<Model name=\"m\">\n\t\t<defaults><Thelen name=\"m\"><GeometryPath/></Thelen></defaults>\n\
        \t\t<ForceSet name=\"forceset\"><objects>\n\t\t\t<Thelen name=\"m\">\n\t\t\t\t";
    let after = "<!-- ü --><a b='c'/>\n\t\t\t</Thelen></objects></ForceSet>\n\t</Model>\n</OpenSimDocument>\n";
    let old = "<GeometryPath name=\"path\"><PathPointSet/></GeometryPath>";
    let spliced = paths::splice(
        &format!("{before}{old}{after}"),
        "m.osim",
        std::slice::from_ref(&path),
        &[],
    )
    .expect("spliced");
    assert!(spliced.starts_with(before) && spliced.ends_with(after));
    let new = &spliced[before.len()..spliced.len() - after.len()];
    assert!(new.contains("<FunctionBasedPath name=\"path\">") && !new.contains("GeometryPath"));
    // It can be read, and spliced again.
    let again =
        paths::splice(&spliced, "m.osim", std::slice::from_ref(&path), &[]).expect("spliced");
    assert_eq!(again.matches("<FunctionBasedPath").count(), 1);
    for (text, says) in [
        (
            format!("{before}{old}{after}")
                .replace("name=\"m\">\n\t\t\t\t<G", "name=\"n\">\n\t\t\t\t<G"),
            "no force",
        ),
        (format!("{before}{after}"), "has no path"),
    ] {
        let error =
            paths::splice(&text, "m.osim", std::slice::from_ref(&path), &[]).expect_err(says);
        assert!(error.to_string().contains(says), "{error}");
    }
    let twice = paths::splice(
        &format!("{before}{old}{after}"),
        "m.osim",
        &[path.clone(), path],
        &[],
    );
    assert!(twice.is_err());
}

#[test]
fn motions_of_the_field_are_read() {
    let (Some(degrees), Some(radians)) = (
        shared("subject01_walk1_ik.mot"),
        shared("walking_coordinates.sto"),
    ) else {
        return;
    };
    let Some(model) = shared("Rajagopal_2015.osim") else {
        return;
    };
    let model = Model::read(&model).expect("a model");
    let knee = model.coordinate("knee_angle_r").expect("a coordinate");
    for (path, in_degrees, count) in [(degrees, true, 20), (radians, false, 31)] {
        let table = MotionTable::read(&path).expect("a table");
        assert_eq!(table.in_degrees, in_degrees);
        let columns = table.coordinates(&model).expect("coordinates");
        assert!(columns.len() >= count, "{}", columns.len());
        let [from, to] = table.span();
        let at =
            |k: i32| table.values(&model, &columns, from + (to - from) * f64::from(k) / 50.0)[knee];
        let bent: Vec<f64> = (0..=50).map(at).collect();
        // A knee bends by about a radian in a step, and its patella follows.
        let range = max_or_nan(
            bent.iter()
                .flat_map(|a| bent.iter().map(move |b| (a - b).abs())),
        );
        assert!((0.7..1.5).contains(&range), "{range}");
        let values = table.values(&model, &columns, to);
        let beta = model.coordinate("knee_angle_r_beta").expect("a coordinate");
        assert_eq!(values[beta], values[knee]);
    }
}

/// Curves of OpenSim's own models need the orders that its own fitter needs: counts of the reference.
#[test]
fn tables_of_the_field_need_the_known_orders() {
    let folder = std::env::var_os("PLIANT_DATA").map_or("../shared/data".into(), PathBuf::from);
    let path = folder.join("tables/rajagopal2016_hip_flexion_r.csv");
    let Ok(text) = std::fs::read_to_string(&path) else {
        println!("skipped: no {}", path.display());
        return;
    };
    let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let head = lines.next().expect("a header");
    let rows: Vec<Vec<f64>> = lines
        .map(|line| line.iter().map(|n| n.parse().expect("a number")).collect())
        .collect();
    let mut orders = std::collections::BTreeMap::new();
    for (k, name) in head.iter().enumerate() {
        let Some(name) = name.strip_suffix("_moment_arm_m") else {
            continue;
        };
        let length = head
            .iter()
            .position(|h| *h == format!("{name}_path_length_m"));
        let length = length.expect("a length");
        // Each row twice, so that the samples left out are all rows.
        let twice = || rows.iter().flat_map(|row| [row, row]);
        let samples = PathSamples {
            force: format!("/forceset/{name}"),
            coordinates: vec!["/jointset/hip_r/hip_flexion_r".to_owned()],
            values: twice().map(|row| vec![row[0].to_radians()]).collect(),
            lengths: twice().map(|row| row[length]).collect(),
            arms: twice().map(|row| vec![row[k]]).collect(),
        };
        if let Some(path) = samples.fit(paths::TOLERANCE, 9) {
            let order = if path.meets(paths::TOLERANCE) {
                path.order
            } else {
                99
            };
            *orders.entry(order).or_insert(0) += 1;
        }
    }
    println!("{orders:?}");
    assert_eq!(
        (orders.get(&4), orders.get(&5)),
        (Some(&9), Some(&12)),
        "{orders:?}"
    );
    assert_eq!(
        (orders.get(&9), orders.get(&99)),
        (Some(&2), Some(&2)),
        "{orders:?}"
    );
}

/// Parameters that are mapped, and the bytes of the model that they replace.
#[test]
fn parameters_go_into_their_places() {
    let before = "<OpenSimDocument Version=\"40600\"><Model name=\"m\"><ForceSet name=\"forceset\"><objects><Thelen name=\"m\">\
        <GeometryPath/><max_isometric_force> 1 </max_isometric_force><optimal_fiber_length>2</optimal_fiber_length>\
        <tendon_slack_length>3</tendon_slack_length><pennation_angle_at_optimal>0</pennation_angle_at_optimal><other>5</other>\
        </Thelen></objects></ForceSet></Model></OpenSimDocument>";
    let samples: Vec<(f64, f64)> = (0..5)
        .map(|k| {
            (
                0.02 + 0.1 * (0.8 + 0.1 * f64::from(k)),
                0.8 + 0.1 * f64::from(k),
            )
        })
        .collect();
    let mapped = MuscleParameters::new("/forceset/m", 1e-3, &[0.1], 0.25, &samples);
    let spliced =
        paths::splice(before, "m.osim", &[], std::slice::from_ref(&mapped)).expect("spliced");
    assert!(
        spliced.contains("<max_isometric_force>600</max_isometric_force>")
            && spliced.contains("<other>5</other>")
    );
    assert!(
        spliced.contains("<pennation_angle_at_optimal>0.25<")
            && !spliced.contains("<tendon_slack_length>3<")
    );
    // Without a mapping, lengths stay.
    let by_rest = MuscleParameters::new("/forceset/m", 1e-3, &[0.1], 0.25, &[]);
    let kept = paths::splice(before, "m.osim", &[], &[by_rest]).expect("spliced");
    assert!(kept.contains("<tendon_slack_length>3<") && kept.contains("<optimal_fiber_length>2<"));
}

/// The lengths of a model's own muscle, normalised, are those of its parameters.
#[test]
fn a_polyline_has_normalised_lengths() {
    let text = std::fs::read_to_string(file("joints.osim")).expect("a text");
    let muscle = |more: &str| {
        format!(
            "<ForceSet name=\"forceset\"><objects><Thelen name=\"m\"><GeometryPath name=\"path\"><PathPointSet><objects>\
             <PathPoint name=\"a\"><socket_parent_frame>/bodyset/weld</socket_parent_frame><location>0 0.1 0</location></PathPoint>\
             <PathPoint name=\"b\"><socket_parent_frame>/bodyset/pin</socket_parent_frame><location>0 -0.3 0</location></PathPoint>\
             </objects></PathPointSet>{more}</GeometryPath><max_isometric_force>1</max_isometric_force>\
             <optimal_fiber_length>0.1</optimal_fiber_length><tendon_slack_length>0.05</tendon_slack_length></Thelen></objects></ForceSet></Model>"
        )
    };
    let model = Model::parse(&text.replace("</Model>", &muscle("")), "m.osim").expect("a model");
    let own = &model.muscles[0];
    assert!(own.is_polyline && own.path == "/forceset/m");
    let pin = model.coordinate("pin_0").expect("a coordinate");
    let pose = |q: f64| {
        let mut values = model.defaults();
        values[pin] = q;
        values
    };
    let found = normalised_lengths(&model, own, &[pose(0.0), pose(0.5)]).expect("lengths");
    let length = |q: f64| model.straight_length(own, &model.poses(&pose(q)));
    assert!((found[1] - (length(0.5) - 0.05) / 0.1).abs() <= 1e-12 && found[0] != found[1]);
    let wraps = muscle("<PathWrapSet><objects><PathWrap/></objects></PathWrapSet>");
    let model = Model::parse(&text.replace("</Model>", &wraps), "m.osim").expect("a model");
    assert!(normalised_lengths(&model, &model.muscles[0], &[pose(0.0)]).is_none());
}

/// A model of two bodies, each with a frame of the same name, with more inside.
fn two_bodies(joint: &str, more: &str) -> Result<Model, pliant::opensim::ModelError> {
    let body = |name: &str, z: f64| {
        format!(
            "<Body name=\"{name}\"><components><PhysicalOffsetFrame name=\"knee\"><socket_parent>..</socket_parent>\
             <translation>0 0 {z}</translation></PhysicalOffsetFrame></components></Body>"
        )
    };
    let text = format!(
        "<OpenSimDocument Version=\"40600\"><Model name=\"m\"><BodySet name=\"bodyset\"><objects>{}{}{}</objects></BodySet>\
         <JointSet name=\"jointset\"><objects>\
         <WeldJoint name=\"a\"><socket_parent_frame>/ground</socket_parent_frame><socket_child_frame>/bodyset/right</socket_child_frame></WeldJoint>\
         <WeldJoint name=\"b\"><socket_parent_frame>/ground</socket_parent_frame><socket_child_frame>/bodyset/left</socket_child_frame></WeldJoint>\
         {joint}</objects></JointSet>{more}</Model></OpenSimDocument>",
        body("right", 0.1),
        body("left", -0.1),
        body("shank", 0.0)
    );
    Model::parse(&text, "two.osim")
}

/// A joint with these coordinates and axes on the right body.
fn shank(socket: &str, coordinates: &[&str], axes: &str) -> String {
    let own: String = coordinates
        .iter()
        .map(|c| format!("<Coordinate name=\"{c}\"/>"))
        .collect();
    format!(
        "<CustomJoint name=\"c\"><socket_parent_frame>{socket}</socket_parent_frame><socket_child_frame>/bodyset/shank</socket_child_frame>\
         <coordinates>{own}</coordinates><SpatialTransform>{axes}</SpatialTransform></CustomJoint>"
    )
}

#[test]
fn frames_are_found_by_their_whole_paths() {
    for (socket, z) in [
        ("/bodyset/right/knee", 0.1),
        ("/bodyset/left/knee", -0.1),
        ("../../bodyset/left/knee", -0.1),
    ] {
        let model = two_bodies(&shank(socket, &[], ""), "").expect("a model");
        let body = model.body("shank").expect("a body");
        let pose = model.poses(&model.defaults())[body];
        assert!((pose.translation.z - z).abs() <= 1e-15, "{socket}: {pose}");
    }
    let unclear = two_bodies(&shank("knee", &[], ""), "").expect_err("three frames have this name");
    assert!(unclear.message.contains("/bodyset/right/knee"), "{unclear}");
}

/// OpenSim converts an angle that turns by itself, and leaves what drives a spline or half a turn.
#[test]
fn tables_in_degrees_have_only_some_coordinates_in_degrees() {
    let axis = |slot: &str, of: &str, function: &str| {
        format!(
            "<TransformAxis name=\"{slot}\"><coordinates>{of}</coordinates><axis>0 0 1</axis>{function}</TransformAxis>"
        )
    };
    let linear = |slope: f64| {
        format!("<LinearFunction><coefficients>{slope} 0</coefficients></LinearFunction>")
    };
    let axes = [
        axis("rotation1", "turns", &linear(-1.0)),
        axis("rotation2", "half", &linear(0.5)),
        axis(
            "rotation3",
            "slides",
            "<SimmSpline><x>0 1</x><y>0 2</y></SimmSpline>",
        ),
        axis("translation1", "slides", &linear(1.0)),
    ];
    let joint = shank(
        "/bodyset/right",
        &["turns", "half", "slides"],
        &axes.concat(),
    );
    let model = two_bodies(&joint, "").expect("a model");
    let kinds: Vec<(bool, bool)> = model
        .coordinates
        .iter()
        .map(|c| (c.is_angle, c.in_degrees))
        .collect();
    assert_eq!(kinds, [(true, true), (true, false), (false, false)]);
    let table = |header: &str| {
        MotionTable::parse(
            &format!("{header}endheader\ntime\tturns\thalf\tslides\n0\t60\t60\t60\n"),
            "a.mot",
        )
        .expect("a table")
    };
    let values = |header: &str| {
        let table = table(header);
        table.values(&model, &table.coordinates(&model).expect("columns"), 0.0)
    };
    assert_eq!(values("inDegrees=yes\n"), [60_f64.to_radians(), 60.0, 60.0]);
    // Without the key, radians; under the old header of SIMM, degrees.
    assert_eq!(values("nRows=1\n"), [60.0; 3]);
    assert_eq!(
        values("name m\ndatacolumns 4\ndatarows 1\nrange 0 0\n")[0],
        60_f64.to_radians()
    );
}

#[test]
fn couplers_follow_each_other_and_other_constraints_are_told() {
    let coupler = |name: &str, from: &str, to: &str, slope: f64| {
        format!(
            "<CoordinateCouplerConstraint name=\"{name}\"><coupled_coordinates_function><LinearFunction><coefficients>{slope} 0.1</coefficients>\
             </LinearFunction></coupled_coordinates_function><independent_coordinate_names>{from}</independent_coordinate_names>\
             <dependent_coordinate_name>{to}</dependent_coordinate_name></CoordinateCouplerConstraint>"
        )
    };
    let joint = shank("/bodyset/right", &["a", "b", "c"], "");
    let of = |constraints: &str| {
        two_bodies(
            &joint,
            &format!(
                "<ConstraintSet name=\"constraintset\"><objects>{constraints}</objects></ConstraintSet>"
            ),
        )
    };
    // The second of the chain stands first in the file.
    let chain = [coupler("k1", "b", "c", 2.0), coupler("k2", "a", "b", 1.5)].concat();
    let model = of(&chain).expect("a model");
    let mut values = [0.2, 0.0, 0.0];
    model.couple(&mut values);
    assert!(
        (values[1] - 0.4).abs() <= 1e-15 && (values[2] - 0.9).abs() <= 1e-15,
        "{values:?}"
    );
    for circle in [
        [coupler("k1", "b", "c", 2.0), coupler("k2", "c", "b", 1.0)].concat(),
        coupler("k", "b", "b", 2.0),
    ] {
        assert!(of(&circle).is_err());
    }
    assert!(of(&[coupler("k1", "a", "c", 2.0), coupler("k2", "b", "c", 1.0)].concat()).is_err());
    let loops = of(
        "<WeldConstraint name=\"loop\"/><PointConstraint name=\"off\"><isEnforced>false</isEnforced></PointConstraint>",
    );
    let notes = loops.expect("a model").notes;
    assert!(notes.len() == 1 && notes[0].contains("loop"), "{notes:?}");
}

/// Nesting takes time in proportion to the text, and has a limit.
#[test]
fn deep_elements_are_refused() {
    let deep = format!(
        "<OpenSimDocument Version=\"40600\"><Model name=\"m\">{}{}</Model></OpenSimDocument>",
        "<a>".repeat(100_000),
        "</a>".repeat(100_000)
    );
    let error = Model::parse(&deep, "deep.osim").expect_err("too deep");
    assert!(error.message.contains("nested"), "{error}");
}

#[test]
fn a_motion_that_the_frames_cut_is_told() {
    let folder = Scratch::folder();
    let notes = |frames: &str| {
        let scene = driven(&folder, |text| text.replace("frames = 10", frames)).expect("a scene");
        scene
            .opensim
            .as_ref()
            .map_or(Vec::new(), |drive| drive.notes.clone())
    };
    assert_eq!(notes("frames = 10"), Vec::<String>::new());
    let cut = notes("frames = 5");
    assert!(
        cut.len() == 1 && cut[0].contains("needs 10 frames"),
        "{cut:?}"
    );
    // A place of a joint that moves nothing means nothing.
    let unused = driven(&folder, |text| {
        text + "centres = { Ball = ['0 m', '0 m', '0 m'] }\n"
    });
    assert!(unused.is_err_and(|e| e.terse().contains("a joint between two bodies")));
}
