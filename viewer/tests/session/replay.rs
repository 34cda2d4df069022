//! A finished run is played as computed, to the bits of its files. Missing or damaged files are
//! reported.

use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use nalgebra::{Isometry3, Point3};
use pliant::progress::Silent;
use pliant::scene::builtin;
use pliant::simulation::{Ended, Simulation, scenario};
use pliant::testing::Scratch;
use pliant_cli::report::folder::Folder;
use pliant_cli::report::frames::Stored;
use pliant_cli::report::results::Results;
use pliant_cli::report::run::{RunOptions, perform};
use pliant_viewer::{Command, Pace, Replay, ReplayError, Session, Snapshot, Tissue};

use super::{HIP, LONG, answer_to, bits, done, simulation, why_refused};
use pliant::testing::tolerances::T18;

/// The state of a frame: vertices of muscles and points of their fibres, poses of bones,
/// readings.
struct Was {
    muscles: Vec<Vec<Point3<f64>>>,
    fibres: Vec<Vec<Point3<f64>>>,
    bones: Vec<Isometry3<f64>>,
    readings: Vec<[f64; 2]>,
}

fn was(simulation: &Simulation) -> Was {
    let x = |m: usize| &simulation.bodies[m].system.particles.position;
    let all = 0..simulation.bodies.len();
    Was {
        muscles: all.clone().map(|m| x(m).clone()).collect(),
        fibres: all
            .map(|m| simulation.bodies[m].fibres.at(x(m)).concat())
            .collect(),
        bones: (0..simulation.bones.len())
            .map(|b| simulation.pose(b, simulation.frame() as f64))
            .collect(),
        readings: simulation
            .measure()
            .iter()
            .map(|m| [m.volume_error.abs(), 1e3 * m.penetration_m])
            .collect(),
    }
}

/// Frames with all digits.
fn exact() -> Stored {
    Stored {
        exact: true,
        ..Stored::default()
    }
}

/// Runs muscles and writes their results.
fn run_into(out: &Path, name: &str, overrides: &[&str], frames: usize) -> (Simulation, Vec<Was>) {
    let mut simulation = simulation(name, overrides);
    let folder = Folder::open(out).unwrap_or_else(|e| panic!("{e}"));
    let mut results = Results::begin(folder, &simulation, exact(), false, Instant::now());
    assert!(results.frame(&simulation, Duration::ZERO));
    let mut all = vec![was(&simulation)];
    for _ in 0..frames {
        simulation.step_frame();
        assert!(results.frame(&simulation, Duration::ZERO));
        all.push(was(&simulation));
    }
    let finished = results
        .finish(&simulation, &[], &Ended::Finished)
        .unwrap_or_else(|e| panic!("{e}"));
    let written = finished.output.write(&finished.folder);
    written.unwrap_or_else(|e| panic!("{e}"));
    (simulation, all)
}

fn opened(path: &Path, pace: Pace) -> Session {
    let replay = Replay::open(path).unwrap_or_else(|e| panic!("{e}"));
    Session::of(Box::new(replay), pace).unwrap_or_else(|e| panic!("{e}"))
}

fn refused(path: &Path) -> String {
    match Replay::open(path) {
        Ok(_) => panic!("{} was opened", path.display()),
        Err(error) => error.to_string(),
    }
}

/// The greatest distance of a bone's vertices from their computed positions, relative to its
/// size.
fn bone_off(simulation: &Simulation, was: &Was, shot: &Snapshot) -> f64 {
    let mut worst = 0.0;
    for (b, mesh) in simulation.bones.iter().enumerate() {
        let (_, own) = &shot.stage.bones[b];
        let size = mesh
            .vertices
            .iter()
            .map(|p| (p - mesh.vertices[0]).norm())
            .fold(0.0, f64::max);
        for (p, q) in mesh.vertices.iter().zip(&own.vertices) {
            let off = (was.bones[b] * p - shot.bones[b].pose * q).norm() / size;
            assert!(off.is_finite());
            worst = f64::max(worst, off);
        }
    }
    worst
}

/// Differences between a played frame and the computed frame.
fn difference(simulation: &Simulation, was: &Was, shot: &Snapshot) -> Option<String> {
    let of = |name: &str| {
        shot.stage
            .bodies
            .iter()
            .position(|b| b.name == name)
            .expect("a body of that name")
    };
    for (m, body) in simulation.bodies.iter().enumerate() {
        if bits(&shot.bodies[of(&body.name)].positions) != bits(&was.muscles[m]) {
            return Some(format!("{} is elsewhere", body.name));
        }
        let fibres = format!("{}_fibres", body.name);
        if !was.fibres[m].is_empty()
            && bits(&shot.bodies[of(&fibres)].positions) != bits(&was.fibres[m])
        {
            return Some(format!("{fibres} are elsewhere"));
        }
    }
    let off = bone_off(simulation, was, shot);
    (!(off <= T18)).then(|| format!("a bone is off by {off:e} of its size"))
}

#[test]
fn every_frame_of_a_run_is_played_as_it_was() {
    let out = Scratch::folder();
    let (simulation, all) = run_into(&out, "hip", &HIP, 8);
    let session = opened(&out, Pace::paused());
    let stage = session.latest().stage.clone();
    let names: Vec<_> = stage
        .bodies
        .iter()
        .map(|b| (b.name.as_str(), b.tissue, b.triangles.is_empty()))
        .collect();
    assert_eq!(
        names,
        [
            ("gluteus", Tissue::Muscle, false),
            ("gluteus_fibres", Tissue::Plain, true)
        ]
    );
    let bones: Vec<_> = stage.bones.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(bones, ["socket", "femur"]);
    let held: Vec<u32> = simulation.bodies[0]
        .attached
        .iter()
        .map(|(v, _)| *v)
        .collect();
    let sorted = |mut some: Vec<u32>| {
        some.sort_unstable();
        some
    };
    assert_eq!(sorted(stage.bodies[0].held.clone()), sorted(held));
    assert_eq!(
        stage.bodies[0].edges.len(),
        3 * stage.bodies[0].triangles.len() / 2,
        "edges of a closed surface"
    );
    assert!(!stage.bodies[1].edges.is_empty());
    let seek = |frame: usize| done(&session, Command::Seek { frame });
    // Forwards, backwards, and in random order.
    for frame in (0..=8).chain((0..=8).rev()).chain([3, 7, 1, 8, 0]) {
        let shot = seek(frame);
        assert_eq!((shot.frame, shot.last_frame), (frame, 8));
        assert_eq!(
            difference(&simulation, &all[frame], &shot),
            None,
            "frame {frame}"
        );
        assert!(
            Arc::ptr_eq(&shot.stage, &stage),
            "the same triangles are the same stage"
        );
        let value = |name: &str| {
            shot.readings
                .iter()
                .find(|r| r.name == name)
                .map(|r| (r.of.as_str(), r.value))
        };
        let [volume, depth] = all[frame].readings[0];
        assert_eq!(
            (value("Volume error"), value("Greatest depth")),
            (Some(("", volume)), Some(("", depth)))
        );
        assert_eq!(shot.bodies[0].volume_error.abs(), volume);
    }
    // Controls: another frame is recognised as different.
    let shot = seek(5);
    assert!(
        difference(&simulation, &all[6], &shot)
            .is_some_and(|why| why.contains("gluteus is elsewhere"))
    );
    let moved = Was {
        muscles: all[5].muscles.clone(),
        fibres: all[5].fibres.clone(),
        ..was(&simulation)
    };
    assert!(
        difference(&simulation, &moved, &shot).is_some_and(|why| why.contains("a bone is off"))
    );
}

#[test]
fn fields_are_those_of_the_session_that_runs() {
    let out = Scratch::folder();
    run_into(&out, "hip", &HIP, 4);
    let session = opened(&out, Pace::paused());
    let running = super::session("hip", &HIP, Pace::paused());
    (0..4).for_each(|_| drop(done(&running, Command::Step)));
    let live = running.latest();
    let shot = done(&session, Command::Seek { frame: 4 });
    assert_eq!(shot.bodies[0].stretch, live.bodies[0].stretch);
    assert_eq!(shot.bodies[0].speed, live.bodies[0].speed);
    assert!(
        shot.bodies[0].depth.is_empty() && shot.bodies[1].stretch.is_empty(),
        "the files have none"
    );
    let readings = |shot: &Snapshot| -> Vec<_> {
        shot.readings
            .iter()
            .map(|r| (r.name, r.of.clone(), r.unit))
            .collect()
    };
    assert_eq!(readings(&shot), readings(&live), "the plots of a run");
    let stretch = |shot: &Snapshot| {
        shot.readings
            .iter()
            .find(|r| r.name == "Greatest stretch")
            .expect("stretch")
            .value
    };
    assert_eq!(stretch(&shot), stretch(&live));
    assert_ne!(
        stretch(&shot),
        stretch(&session_at(&session, 3)),
        "control: another frame is stretched otherwise"
    );
    let vertex = 40;
    let probed = done(&session, Command::Probe(Some((0, vertex))));
    let probe = probed.probe.clone().expect("a probe");
    let names: Vec<_> = probe
        .values
        .iter()
        .map(|(name, _, unit)| (*name, *unit))
        .collect();
    assert_eq!(names, [("stretch", "%"), ("speed", "mm/s")]);
    assert_eq!(probe.values[0].1, 100.0 * probed.bodies[0].stretch[vertex]);
    assert!(why_refused(&session, Command::Probe(Some((9, 0)))).contains("there is no body 9"));
    assert!(
        why_refused(&session, Command::Probe(Some((0, 1 << 30)))).contains("there is no vertex")
    );
}

fn session_at(session: &Session, frame: usize) -> Arc<Snapshot> {
    done(session, Command::Seek { frame })
}

#[test]
fn it_runs_forwards_and_backwards_and_rests_at_the_ends() {
    let out = Scratch::folder();
    run_into(&out, "distance", &[], 12);
    let session = opened(&out, Pace::free());
    let end = session.wait(LONG, |shot| !shot.running).expect("an end");
    assert_eq!((end.frame, &end.failed), (12, &None));
    assert_eq!(done(&session, Command::Step).frame, 12, "nothing follows");
    done(&session, Command::Backwards(true));
    assert_eq!(done(&session, Command::Step).frame, 11);
    done(&session, Command::Run);
    let begin = session
        .wait(LONG, |shot| !shot.running && shot.frame == 0)
        .expect("the begin");
    assert!(begin.failed.is_none());
    done(&session, Command::Backwards(false));
    assert_eq!(done(&session, Command::Step).frame, 1);
    done(&session, Command::Seek { frame: 9 });
    assert_eq!(done(&session, Command::Reset).frame, 0);
    assert!(
        why_refused(&session, Command::Seek { frame: 13 })
            .contains("there is no frame 13; the scene has 13")
    );
    for command in [
        Command::Drag {
            body: 0,
            vertex: 0,
            to: Point3::origin(),
            stiffness: None,
        },
        Command::Fix { body: 0, vertex: 0 },
        Command::Turn {
            bone: 0,
            angle: 0.1,
        },
        super::set("pbd.iterations", "3"),
        Command::Move {
            handle: 0,
            to: Point3::origin(),
        },
    ] {
        let why = why_refused(&session, command);
        assert!(
            why.contains("only played; run the scene to change it: pliant view SCENE"),
            "{why}"
        );
    }
    assert_eq!(session.latest().frame, 0);
}

#[test]
fn missing_and_damaged_frames_are_reported_and_passed_over() {
    let out = Scratch::folder();
    let (simulation, all) = run_into(&out, "distance", &[], 8);
    let file = |frame: usize| out.join(format!("frames/muscle_{frame:04}.vtp"));
    let whole = fs::read(file(5)).expect("a frame");
    fs::remove_file(file(3)).expect("a frame");
    fs::write(file(5), &whole[..whole.len() / 2]).expect("a file");
    fs::write(file(8), "").expect("a file");
    let session = opened(&out, Pace::paused());
    let mut seen = vec![session.latest().frame];
    for _ in 0..10 {
        let shot = done(&session, Command::Step);
        assert!(shot.failed.is_none());
        seen.push(shot.frame);
        assert_eq!(difference(&simulation, &all[shot.frame], &shot), None);
    }
    assert_eq!(seen, [0, 1, 2, 4, 6, 7, 7, 7, 7, 7, 7]);
    let notes = session.latest().notes.join("\n");
    for says in [
        "frame 3: ",
        "muscle_0003.vtp",
        "E060",
        "frame 5: ",
        "ends too early",
        "frame 8: ",
        "the file is empty",
    ] {
        assert!(notes.contains(says), "`{says}` is not in: {notes}");
    }
    let before = done(&session, Command::Seek { frame: 6 });
    let why = why_refused(&session, Command::Seek { frame: 5 });
    assert!(
        why.starts_with("frame 5 cannot be shown: ") && why.contains("muscle_0005.vtp"),
        "{why}"
    );
    let after = session.latest();
    assert_eq!(
        (after.frame, super::shown(&after)),
        (6, super::shown(&before)),
        "what is seen stays"
    );
    // Control: the restored file is shown, and no longer reported.
    fs::write(file(5), &whole).expect("a file");
    let shot = done(&session, Command::Seek { frame: 5 });
    assert_eq!(
        (shot.frame, difference(&simulation, &all[5], &shot)),
        (5, None)
    );
    assert!(!shot.notes.join("\n").contains("frame 5"));
    // If the first file is missing, the next is the start. If all are missing, there is nothing.
    fs::remove_file(file(0)).expect("a frame");
    assert_eq!(opened(&out, Pace::paused()).latest().frame, 1);
    (0..=8).for_each(|frame| drop(fs::remove_file(file(frame))));
    let error = refused(&out);
    assert!(
        error.starts_with("none of the 9 frames can be shown; frame 0: ")
            && error.contains("_0000.vtp"),
        "{error}"
    );
    // Frames read before are still available.
    assert_eq!(done(&session, Command::Seek { frame: 6 }).frame, 6);
}

#[test]
fn damaged_tables_cost_their_numbers_alone() {
    let out = Scratch::folder();
    run_into(&out, "hip", &HIP, 1);
    let names = |out: &Path| -> Vec<_> {
        opened(out, Pace::paused())
            .latest()
            .readings
            .iter()
            .map(|r| r.name)
            .collect()
    };
    assert_eq!(
        names(&out),
        ["Volume error", "Greatest stretch", "Greatest depth"]
    );
    let table = fs::read_to_string(out.join("measures.csv")).expect("a table");
    fs::write(
        out.join("measures.csv"),
        table.replace("gluteus,", "gluteus,x"),
    )
    .expect("a table");
    fs::write(out.join("summary.json"), "{").expect("a summary");
    assert_eq!(names(&out), ["Greatest stretch"]);
    let notes = opened(&out, Pace::paused()).latest().notes.join("\n");
    assert!(
        notes.contains("measures.csv: line 2: `x") && notes.contains("summary.json: EOF"),
        "{notes}"
    );
    for file in ["measures.csv", "summary.json"] {
        fs::remove_file(out.join(file)).expect("a file");
    }
    assert!(opened(&out, Pace::paused()).latest().notes.is_empty());
}

#[test]
fn what_is_no_run_is_refused_with_what_to_do() {
    let out = Scratch::folder();
    let error = refused(&out.join("nowhere"));
    assert!(
        error.contains("there is no folder") && error.contains("nowhere"),
        "{error}"
    );
    assert!(
        refused(&out).contains("has no .pvd, so there are no frames"),
        "{}",
        refused(&out)
    );
    fs::write(out.join("a.txt"), "a").expect("a file");
    assert!(refused(&out.join("a.txt")).contains("is no folder and no .pvd"));
    let run = out.join("run");
    run_into(&run, "distance", &[], 2);
    let pvd = run.join("distance.pvd");
    // The path of a collection is accepted as well.
    assert_eq!(opened(&pvd, Pace::paused()).latest().last_frame, 2);
    let text = fs::read_to_string(&pvd).expect("a collection");
    fs::write(run.join("b.pvd"), &text).expect("a file");
    let error = refused(&run);
    assert!(
        error.contains("has 2 collections")
            && error.contains("b.pvd, ")
            && error.contains("distance.pvd"),
        "{error}"
    );
    fs::remove_file(run.join("b.pvd")).expect("a file");
    fs::write(&pvd, &text[..text.len() / 2]).expect("a file");
    assert!(refused(&run).contains("distance.pvd:"), "{}", refused(&run));
    fs::write(&pvd, "<VTKFile type='Collection'><Collection/></VTKFile>").expect("a file");
    assert!(refused(&run).contains("lists no frames"));
    // Frames without a list of them.
    fs::remove_file(&pvd).expect("a file");
    let error = refused(&run);
    assert!(
        error.contains("has no .pvd yet: its run goes on, or was killed"),
        "{error}"
    );
    assert!(matches!(Replay::open(&run), Err(ReplayError::Unfinished(path)) if path == run));
}

fn run_staged(out: &Path, name: &str, overrides: &[&str]) {
    let overrides: Vec<String> = overrides.iter().map(|o| (*o).to_owned()).collect();
    let scene = builtin::load_content(name, &overrides).unwrap_or_else(|e| panic!("{}", e.terse()));
    let mut run = scenario(&scene).unwrap_or_else(|e| panic!("{}", e.terse()));
    let folder = Folder::open(out).unwrap_or_else(|e| panic!("{e}"));
    let options = RunOptions {
        kind: None,
        animate: false,
        stored: exact(),
        begun: Instant::now(),
        settings: Vec::new(),
    };
    let finished = perform(&mut *run, folder, &options, &Silent).unwrap_or_else(|e| panic!("{e}"));
    let written = finished.output.write(&finished.folder);
    written.unwrap_or_else(|e| panic!("{e}"));
}

/// Points of a file, read separately.
fn file_of(out: &Path, file: &str) -> Vec<Point3<f64>> {
    pliant::io::read(&out.join("frames").join(file))
        .unwrap_or_else(|e| panic!("{}", e.terse()))
        .mesh
        .vertices
}

#[test]
fn skin_over_a_ball_is_played() {
    let out = Scratch::folder();
    run_staged(
        &out,
        "sheet",
        &["sheet.cells=24", "skin.edge_length=0.5 mm", "frames=2"],
    );
    let session = opened(&out, Pace::paused());
    let stage = session.latest().stage.clone();
    let parts: Vec<_> = stage
        .bodies
        .iter()
        .map(|b| (b.name.as_str(), b.tissue))
        .collect();
    assert_eq!(parts, [("sheet", Tissue::Skin)]);
    assert!(
        stage
            .bones
            .iter()
            .map(|(name, _)| name.as_str())
            .eq(["ball"])
    );
    for frame in 0..=2 {
        let shot = done(&session, Command::Seek { frame });
        assert_eq!(
            bits(&shot.bodies[0].positions),
            bits(&file_of(&out, &format!("sheet_{frame:04}.vtp")))
        );
        let ball = file_of(&out, &format!("ball_{frame:04}.vtp"));
        let placed = stage.bones[0]
            .1
            .vertices
            .iter()
            .map(|p| shot.bones[0].pose * p);
        let off = placed
            .zip(&ball)
            .map(|(p, q)| (p - q).norm())
            .fold(0.0, f64::max);
        assert!(off <= T18 * 1e-3, "{off} m of a ball of millimetres");
        assert_eq!(shot.bodies[0].stretch.iter().any(|s| *s > 0.01), frame > 0);
        assert!(shot.readings.iter().any(|r| r.name == "Greatest stretch"));
    }
    let away = (session.latest().bones[0].pose.translation.vector).norm();
    assert!(away > 1e-4, "control: the ball moves, by {away} m");
}

#[test]
fn an_implant_under_skin_is_played() {
    let out = Scratch::folder();
    run_staged(
        &out,
        "flat-implant",
        &[
            "sheet.cells=32",
            "skin.edge_length=6.25 mm",
            "implant.volume=50cc",
        ],
    );
    let session = opened(&out, Pace::paused());
    let parts: Vec<_> = session
        .latest()
        .stage
        .bodies
        .iter()
        .map(|b| (b.name.clone(), b.tissue))
        .collect();
    assert_eq!(
        parts.iter().map(|(_, tissue)| *tissue).collect::<Vec<_>>(),
        [Tissue::Skin, Tissue::Implant]
    );
    let end = done(&session, Command::Step);
    for (shot, (name, _)) in end.bodies.iter().zip(&parts) {
        assert_eq!(
            bits(&shot.positions),
            bits(&file_of(&out, &format!("{name}_0001.vtp")))
        );
    }
    let stretched: Vec<_> = end
        .readings
        .iter()
        .filter(|r| r.name == "Greatest stretch")
        .collect();
    assert!(
        stretched.len() == 1 && stretched[0].value > 1.0,
        "only skin has lengths at rest: {stretched:?}"
    );
}

#[test]
fn a_lattice_is_played() {
    let out = Scratch::folder();
    run_staged(
        &out,
        "lattice",
        &["lattice.points=[4,5,6]", "lattice.release=10", "frames=20"],
    );
    let session = opened(&out, Pace::free());
    let end = session.wait(LONG, |shot| !shot.running).expect("an end");
    assert_eq!((end.frame, end.stage.bodies[0].tissue), (20, Tissue::Plain));
    for frame in [20, 0, 7] {
        let shot = done(&session, Command::Seek { frame });
        assert_eq!(
            bits(&shot.bodies[0].positions),
            bits(&file_of(&out, &format!("lattice_{frame:04}.vtp")))
        );
    }
    assert_ne!(
        bits(&done(&session, Command::Seek { frame: 7 }).bodies[0].positions),
        bits(&file_of(&out, "lattice_0008.vtp")),
        "control"
    );
    assert!(answer_to(&session, Command::Pause).refused.is_none());
}
