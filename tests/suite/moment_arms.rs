//! Moment arms of fibres that follow the rotation of a joint.

use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Unit, Vector3};
use pliant::io;
use pliant::mesh::TriangleMesh;
use pliant::mesh::measures::max_or_nan;
use pliant::mesh::shapes::{icosphere, tube};
use pliant::moment_arms::{Arms, MuscleStepper, PoseSet, Sweep, SweepError, SweepRun, joint_of};
use pliant::opensim::{Model, ModelDrive};
use pliant::progress::Silent;
use pliant::scene::{Scene, parse};
use pliant::simulation::run;

use crate::tolerances::{T9, T22, T23};

/// Distance of the joint axis from the muscle's own axis [m].
const ARM: f64 = 0.05;

struct Folder(PathBuf);

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn moved(mut mesh: TriangleMesh, by: Vector3<f64>) -> TriangleMesh {
    mesh.vertices.iter_mut().for_each(|v| *v += by);
    mesh
}

/// A straight muscle between two balls, one of which rotates about an axis beside it.
fn scene(name: &str, change: impl Fn(String) -> String) -> (Folder, Scene) {
    let path = std::env::temp_dir().join(format!("pliant-arms-{}-{name}", std::process::id()));
    std::fs::create_dir_all(&path).expect("a folder");
    let folder = Folder(path.clone());
    let muscle = tube(0.012, 0.12, 24);
    let bounds = muscle.bounding_box();
    let along = bounds.extents().iamax();
    let end = |sign: f64| {
        let mut at = bounds.center().coords;
        at[along] += sign * (0.5 * bounds.extents()[along] + 0.009);
        moved(icosphere(0.01, 3), at)
    };
    for (file, mesh) in [
        ("muscle", muscle.clone()),
        ("upper", end(-1.0)),
        ("lower", end(1.0)),
    ] {
        io::write(
            &path.join(format!("{file}.obj")),
            &mesh,
            &[],
            io::Encoding::Text,
        )
        .expect("written");
    }
    let mut axis = [0, 0, 0];
    let mut centre = bounds.center().coords;
    let across = (along + 1) % 3;
    centre[across] += ARM;
    axis[(along + 2) % 3] = 1;
    let text = format!(
        "name = \"hinge\"\nframes = 1\nframe_rate = \"60 Hz\"\n\
         [[bone]]\nname = \"upper\"\nmesh = \"upper.obj\"\nunit = \"m\"\n\
         [[bone]]\nname = \"lower\"\nmesh = \"lower.obj\"\nunit = \"m\"\n[bone.motion]\njoint = \"hinge\"\n\
         centre = [\"{} m\", \"{} m\", \"{} m\"]\naxis = {axis:?}\nkeys = [{{ frame = 0 }}]\n\
         [[muscle]]\nname = \"straight\"\nmesh = \"muscle.obj\"\nunit = \"m\"\n[muscle.material]\n\
         density = \"1060 kg/m3\"\nstretch = \"300 N/m\"\nbending = \"2e-4 N m\"\n\
         [[muscle.attachment]]\nbone = \"upper\"\nnear = \"6 mm\"\nlimit = \"4 %\"\n\
         [[muscle.attachment]]\nbone = \"lower\"\nnear = \"6 mm\"\nlimit = \"4 %\"\n\
         [effects.stretch]\n[effects.bending]\n[effects.volume]\npressure = 1.0\n[effects.damping]\nrate = \"5 1/s\"\n\
         [solver.xpbd]\nsubsteps = 10\niterations = 1\norder = \"coloured\"\ntolerance = 0.01\n",
        centre.x, centre.y, centre.z
    );
    let scene = parse(&change(text), "hinge.toml", Path::new(&path)).expect("a scene");
    (folder, scene)
}

fn sweep(from: f64, to: f64) -> Sweep {
    let fibres = pliant::fibres::harmonic::HarmonicOptions {
        count: 12,
        points: 9,
    };
    let (joint, by) = ("hinge".to_owned(), MuscleStepper::Spread);
    Sweep {
        joint,
        axis: None,
        from,
        to,
        step: 0.02,
        frames: 1,
        fibres,
        by,
    }
}

fn swept(scene: Scene, sweep: &Sweep) -> SweepRun {
    let mut running = SweepRun::new(scene, sweep).expect("ready");
    run(&mut running, &mut [], &Silent);
    assert_eq!(running.done(), running.angles.len());
    running
}

/// About an axis beside a straight muscle the moment arm is the distance of the muscle from the
/// axis, for every solver.
#[test]
fn a_straight_muscle_has_its_distance_to_the_axis() {
    let (_folder, scene) = scene("straight", |text| text);
    let running = swept(scene, &sweep(-0.06, 0.06));
    let arms = Arms::new(&running.muscles[0], &running, 0);
    let middle = arms.mean[3].abs();
    // Fibres lie within the muscle's radius of its axis, with nearly uniform density. Their mean
    // lies within a tenth of the radius.
    assert!((middle - ARM).abs() <= T22 * ARM, "{middle}");
    for (fibre, arm) in running.muscles[0].fibres.iter().zip(&arms.fibres) {
        let mid = fibre[4];
        let centre = running.joint.centre;
        let axis = running.joint.axis;
        let way = (fibre[8] - fibre[0]).normalize();
        let expected = -(axis.cross(&(mid - centre))).dot(&way);
        // The chord of a fibre is its tangent except for the spread from its area.
        assert!(
            (arm[3] - expected).abs() <= T22 * ARM,
            "{} {expected}",
            arm[3]
        );
    }
    assert!(
        (middle - 1.05 * ARM).abs() > T22 * ARM,
        "control: another distance is not taken for it"
    );
    // Fibres of a straight muscle are nearly straight.
    assert!(
        (arms.straight[3] - arms.mean[3]).abs() <= T22 * ARM,
        "{}",
        arms.straight[3]
    );
    assert_eq!(running.muscles[0].unconverged, 0);
    assert!(
        running.muscles[0].volume_error <= T9,
        "{}",
        running.muscles[0].volume_error
    );
}

/// Fixed vertices move with their bone. The rest depends only on the angle, not on the start of
/// the sweep.
#[test]
fn the_shape_depends_on_the_angle_alone() {
    let (_a, first) = scene("from-below", |text| text);
    let (_b, second) = scene("from-rest", |text| text);
    let long = swept(first, &sweep(-0.2, 0.2));
    let short = swept(second, &sweep(0.0, 0.2));
    let [long_last, short_last] = [&long, &short].map(|r| r.muscles[0].now());
    let apart = long_last
        .iter()
        .flatten()
        .zip(short_last.iter().flatten())
        .map(|(a, b)| (a - b).norm());
    // Both equilibria are accurate to forces below 1e-8 of the scale; the errors add up over the
    // muscle's length.
    let apart = max_or_nan(apart) / 0.12;
    assert!(apart <= T23, "{apart}");
    let other = long.muscles[0]
        .fibres
        .iter()
        .flatten()
        .zip(short_last.iter().flatten())
        .map(|(a, b)| (a - b).norm());
    assert!(
        max_or_nan(other) / 0.12 > 1e-2,
        "control: at another angle it is elsewhere"
    );
    let pose: Isometry3<f64> = long.joint.pose(0.2);
    // An end is left within 2e-6 of the length of its area, and what is so near goes with it but for the strain there.
    let near = 1e-5 * 0.12;
    for (rest, now) in long.muscles[0].fibres.iter().zip(long_last) {
        assert!((rest[0] - now[0]).norm() <= near, "ends at rest stay");
        assert!(
            (rest[8] - now[8]).norm() > 1e2 * near,
            "control: it does go"
        );
        assert!(
            (pose * rest[8] - now[8]).norm() <= near,
            "ends that turn go with the bone"
        );
    }
}

#[test]
fn what_cannot_be_swept_says_why() {
    let refused = |change: &dyn Fn(String) -> String, sweep: &Sweep| {
        let (_folder, scene) = scene("refused", change);
        match SweepRun::new(scene, sweep) {
            Ok(_) => panic!("taken"),
            Err(error) => error,
        }
    };
    let same = |text: String| text;
    let named = |joint: &str| Sweep {
        joint: joint.to_owned(),
        ..sweep(0.0, 0.1)
    };
    assert!(
        refused(&same, &named("knee"))
            .to_string()
            .contains("no joint `knee`; known: hinge")
    );
    assert!(matches!(
        refused(&same, &sweep(0.1, 0.0)),
        SweepError::Range(_)
    ));
    assert!(matches!(
        refused(
            &same,
            &Sweep {
                step: f64::NAN,
                ..sweep(0.0, 0.1)
            }
        ),
        SweepError::Range(_)
    ));
    assert!(matches!(
        refused(&same, &sweep(-4.0, 0.1)),
        SweepError::Range(_)
    ));
    let one_side = |text: String| {
        text.replacen(
            "bone = \"lower\"\nnear = \"6 mm\"",
            "bone = \"upper\"\nnear = \"8 mm\"",
            1,
        )
    };
    assert!(matches!(
        refused(&one_side, &sweep(0.0, 0.1)),
        SweepError::NothingCrosses(_)
    ));
    let (_folder, taken) = scene("taken", same);
    assert!(
        SweepRun::new(taken, &named("lower")).is_ok(),
        "control: a bone's name will do"
    );
}

/// A bone that glides at half the angle of its joint gives half the moment arm; at the whole angle, that of a
/// bone that turns.
#[test]
fn a_bone_on_a_path_moves_by_it() {
    let glides = |share: f64| {
        move |text: String| {
            let key = |at: f64| format!("{{ at = '{at} rad', angle = '{} rad' }}", share * at);
            let keys: Vec<String> = [-0.1, -0.05, 0.0, 0.02, 0.1].map(key).to_vec();
            let path = format!("path = [{}]\n[[muscle]]", keys.join(", "));
            text.replacen("[[muscle]]", &path, 1)
        }
    };
    let arm = |name: &str, change: &dyn Fn(String) -> String| {
        let (_folder, scene) = scene(name, change);
        let running = swept(scene, &sweep(-0.06, 0.06));
        Arms::new(&running.muscles[0], &running, 0).mean[3]
    };
    let turns = arm("turns", &|text| text);
    let [whole, half] = [1.0, 0.5].map(|share| arm("glides", &glides(share)));
    assert!((whole / turns - 1.0).abs() <= 1e-9, "{whole} {turns}");
    assert!((half / turns - 0.5).abs() <= T22, "{half} {turns}");
    // A third bone that turns as the second one: on a path that is the turn it changes nothing.
    let third = |path: &'static str| {
        move |text: String| {
            let of_lower = text.find("[bone.motion]").map(|at| &text[at..]);
            let of_lower = of_lower.and_then(|motion| motion.split("[[muscle]]").next());
            let motion = of_lower.expect("a motion");
            let bone = format!(
                "[[bone]]\nname = \"third\"\nmesh = \"lower.obj\"\nunit = \"m\"\n{motion}{path}\n[[muscle]]"
            );
            let held = "[[muscle.attachment]]\nbone = \"third\"\nnear = \"8 mm\"\nlimit = \"5 %\"\n[effects.stretch]";
            let text = text.replacen("[[muscle]]", &bone, 1);
            text.replacen("[effects.stretch]", held, 1)
        }
    };
    let keys = "path = [{ at = '-0.1 rad', angle = '-0.1 rad' }, { at = '0 rad' }, { at = '0.1 rad', angle = '0.1 rad' }]";
    let [as_one, as_path] = ["", keys].map(|path| arm("third", &third(path)));
    // Shares of the turn differ between one joint and two; in a like scene fibres from
    // the wrong bones gave 0.84 of it.
    assert!((as_path / as_one - 1.0).abs() <= T22, "{as_path} {as_one}");
    // The pose of the file is where a sweep begins.
    let shifted = |text: String| {
        let path = "path = [{ at = '-1 rad', translation = ['1 mm', '0 m', '0 m'] }, \
                    { at = '1 rad', translation = ['1 mm', '0 m', '0 m'] }]\n[[muscle]]";
        text.replacen("[[muscle]]", path, 1)
    };
    let (_folder, shifted) = scene("shifted", shifted);
    let refused = SweepRun::new(shifted, &sweep(0.0, 0.1)).err();
    assert!(refused.is_some_and(|why| why.to_string().contains("another pose at 0 deg")));
    let (_folder, short) = scene("short-path", glides(1.0));
    let refused = SweepRun::new(short, &sweep(0.0, 0.2))
        .err()
        .map(|e| e.to_string());
    assert!(refused.is_some_and(|why| why.contains("from -5.73 to 5.73 deg")));
    let (_folder, other) = scene("other-axis", glides(1.0));
    let own = other.bones[1].motion.joint.as_ref().map(|joint| joint.axis);
    let about = Sweep {
        axis: own.map(|axis| Unit::new_unchecked(axis.yzx())),
        ..sweep(0.0, 0.05)
    };
    assert!(matches!(
        SweepRun::new(other, &about),
        Err(SweepError::Range(_))
    ));
}

/// Four muscles of the right hip: every angle reaches equilibrium, no muscle is in a bone, and
/// the gluteus extends where the psoas flexes.
#[test]
fn the_real_hip() {
    let data = crate::measured_data("PLIANT_DATA").filter(|d| Path::new(d).join("body").is_dir());
    if data.is_none() {
        println!("skipped: 1 test, because there is no folder of measured data");
        return;
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/right-hip-muscles.toml");
    let scene = pliant::scene::builtin::load_with(
        path.to_str().expect("a plain name"),
        &[],
        crate::measured_data,
    )
    .expect("a scene");
    let fibres = pliant::fibres::harmonic::HarmonicOptions {
        count: 40,
        points: 15,
    };
    let sweep = Sweep {
        joint: "hip".to_owned(),
        step: 0.1,
        fibres,
        ..sweep(-0.2, 1.0)
    };
    let running = swept(scene, &sweep);
    assert_eq!(running.muscles.len(), 4);
    for muscle in &running.muscles {
        assert_eq!(
            (muscle.unconverged, muscle.points_in_bone),
            (0, 0),
            "{}",
            muscle.name
        );
        assert!(
            muscle.vertex_depth <= 0.0,
            "{}: {}",
            muscle.name,
            muscle.vertex_depth
        );
        assert!(
            muscle.volume_error <= T9,
            "{}: {}",
            muscle.name,
            muscle.volume_error
        );
        let flexes = muscle.name == "iliacus" || muscle.name == "psoas";
        let arms = Arms::new(muscle, &running, 0);
        assert!(
            arms.mean.iter().all(|r| (*r > 0.0) == flexes),
            "{}: {:?}",
            muscle.name,
            arms.mean
        );
        // The muscle of a person is within a hand's breadth of its joint.
        assert!(
            arms.mean.iter().all(|r| r.abs() > 0.01 && r.abs() < 0.1),
            "{}: {:?}",
            muscle.name,
            arms.mean
        );
    }
}

/// A run through poses of a model of one joint gives the lengths of a sweep about the same joint, and
/// its central differences the moment arms.
#[test]
fn poses_of_a_model_are_those_of_a_sweep() {
    let (_folder, first) = scene("of-a-sweep", |text| text);
    let (_other, mut second) = scene("of-a-model", |text| text);
    let running = swept(first, &sweep(-0.1, 0.1));
    let (joint, turning) = joint_of(&second, "hinge").expect("a joint");
    let model = Model::read(Path::new("tests/suite/opensim/joints.osim")).expect("a model");
    let pin = model.coordinate("pin_0").expect("a coordinate");
    // Any direction across the axis is up.
    let up = joint.axis.cross(&Vector3::new(0.3, 0.5, 0.7)).normalize();
    let joints = [(pin, (joint.centre, joint.axis.into_inner()), turning)];
    let drive = ModelDrive::about_joints(model, &joints, up).expect("a drive");
    let set = PoseSet::grid(&drive.model, &drive.rest, &[(pin, [-0.1, 0.1])], 3);
    assert_eq!((set.samples.len(), set.poses.len(), set.each()), (3, 9, 3));
    second.opensim = Some(std::sync::Arc::new(drive));
    let mut through = SweepRun::through(second, &set.poses, sweep(0.0, 1.0).fibres).expect("ready");
    run(&mut through, &mut [], &Silent);
    assert_eq!(through.done(), 9);
    let (muscle, arms) = (
        &through.muscles[0],
        Arms::new(&running.muscles[0], &running, 4),
    );
    let all: Vec<usize> = (0..muscle.fibres.len()).collect();
    for (sample, value) in [(0, 0), (1, 5), (2, 10)] {
        let (length, moment) = set.length_and_arms(muscle, &all, sample);
        assert!(
            (length - arms.length[value]).abs() <= T23 * 0.12,
            "{length} {}",
            arms.length[value]
        );
        // Both are differences over some degrees.
        assert!(
            (moment[0] - arms.mean[value]).abs() <= T22 * ARM,
            "{} {}",
            moment[0],
            arms.mean[value]
        );
    }
    let apart = (set.length_and_arms(muscle, &all, 0).0 - arms.length[10]).abs();
    assert!(
        apart > 1e-3,
        "control: at another angle the length is another"
    );
}

#[test]
fn a_hypercube_has_a_sample_in_each_part_of_each_range() {
    let model = Model::read(Path::new("tests/suite/opensim/joints.osim")).expect("a model");
    let index = |name: &str| model.coordinate(name).expect("a coordinate");
    let ranges = [
        (index("pin_0"), [-1.0, 1.0]),
        (index("slider_0"), [0.0, 0.1]),
    ];
    let set = PoseSet::hypercube(&model, &model.defaults(), &ranges, 16, 7);
    for (k, (_, [low, high])) in ranges.iter().enumerate() {
        let mut parts: Vec<usize> = set
            .samples
            .iter()
            .map(|s| ((s[k] - low) / (high - low) * 16.0) as usize)
            .collect();
        parts.sort_unstable();
        assert_eq!(parts, (0..16).collect::<Vec<_>>());
    }
    assert_eq!(
        set,
        PoseSet::hypercube(&model, &model.defaults(), &ranges, 16, 7)
    );
    let grid = PoseSet::grid(&model, &model.defaults(), &ranges, 4);
    assert_eq!(grid.samples.len(), 16);
    // Neighbours in the list are neighbours in the grid.
    for pair in grid.samples.windows(2) {
        let moved = (0..2).filter(|k| pair[0][*k] != pair[1][*k]).count();
        assert_eq!(moved, 1, "{pair:?}");
    }
}
