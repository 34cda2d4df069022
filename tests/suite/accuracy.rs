//! Cost of accuracy: references converge, and errors fall towards them.

use std::cell::Cell;
use std::fs;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::LazyLock;
use std::time::Duration;

use nalgebra::{Point3, Vector3};
use pliant::accuracy::{FrameDistance, Status, Study, StudyError, StudyOptions, StudyRow, measure};
use pliant::io::Encoding;
use pliant::mesh::shapes::{icosphere, tube};
use pliant::progress::{Progress, Silent};
use pliant::scene::SolverQuestion;
use pliant::scene::{Scene, Solver, parse};
use pliant::simulation::Assets;

use crate::tolerances::{T4, worst};

/// Stops after some stages.
struct Impatient(Cell<u32>);

impl Impatient {
    fn after(stages: u32) -> Self {
        Self(Cell::new(stages))
    }
}

impl Progress for Impatient {
    fn report(&self, stage: &str, _: usize, _: usize) -> ControlFlow<()> {
        if !stage.is_empty() {
            self.0.set(self.0.get().saturating_sub(1));
        }
        match self.0.get() {
            0 => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        }
    }
}

/// A tube of 100 mm with both ends fixed to bones, one of which rotates by 20 degrees in six
/// frames.
fn scene(name: &str, solver: &str) -> (Scene, Assets) {
    let folder =
        std::env::temp_dir().join(format!("pliant-accuracy-{}-{name}", std::process::id()));
    fs::create_dir_all(&folder).expect("a folder for the test");
    let muscle = tube(0.012, 0.1, 16);
    let far = |at: f64| {
        let mut ball = icosphere(0.005, 1);
        ball.vertices
            .iter_mut()
            .for_each(|p| *p += Vector3::new(0.0, 0.0, at));
        ball
    };
    let save = |file: &str, mesh| {
        pliant::io::write(&folder.join(file), mesh, &[], Encoding::Text).expect("written")
    };
    save("muscle.obj", &muscle);
    let (fixed, moving) = (far(-1.0), far(1.0));
    save("fixed.obj", &fixed);
    save("moving.obj", &moving);
    let bounds = muscle.bounding_box();
    let axis = bounds.extents().imax();
    let along = |p: &Point3<f64>| (p[axis] - bounds.min[axis]) / bounds.extents()[axis];
    let middle = bounds.center().map(|c| format!("'{c} m'"));
    let across = if axis == 0 { [0, 1, 0] } else { [1, 0, 0] };
    let held = |expected: fn(f64) -> bool| {
        let all = muscle
            .vertices
            .iter()
            .enumerate()
            .filter(|(_, p)| expected(along(p)))
            .map(|(v, _)| v.to_string());
        all.collect::<Vec<_>>().join(", ")
    };
    let (low, high) = (held(|s| s < 0.04), held(|s| s > 0.96));
    let text = format!(
        "frames = 6\nframe_rate = '60 Hz'\n\
         [[bone]]\nname = 'fixed'\nmesh = 'fixed.obj'\nunit = 'm'\n\
         [[bone]]\nname = 'moving'\nmesh = 'moving.obj'\nunit = 'm'\n\
         [bone.motion]\ncentre = [{}, {}, {}]\naxis = {across:?}\n\
         keys = [{{ frame = 0 }}, {{ frame = 6, angle = '20deg' }}]\n\
         [[muscle]]\nname = 'calf'\nmesh = 'muscle.obj'\nunit = 'm'\n\
         [muscle.material]\ndensity = '1060 kg/m3'\nstretch = '300 N/m'\nbending = '2e-4 N m'\n\
         [[muscle.attachment]]\nbone = 'fixed'\nvertices = [{low}]\n\
         [[muscle.attachment]]\nbone = 'moving'\nvertices = [{high}]\n\
         [effects.stretch]\n[effects.bending]\n[effects.volume]\n[effects.damping]\nrate = '5 1/s'\n{solver}",
        middle.x, middle.y, middle.z
    );
    let scene = parse(&text, "calf.toml", &folder).unwrap_or_else(|e| panic!("{}", e.terse()));
    let assets = Assets::load(&scene).expect("meshes that can be read");
    let _: Result<(), _> = fs::remove_dir_all(&folder);
    let _: PathBuf = folder;
    (scene, assets)
}

fn study(name: &str, solver: &str) -> Study {
    let (scene, assets) = scene(name, solver);
    let options = StudyOptions {
        budget: Duration::from_secs(20),
        frames: Some(3),
        threads: 1,
    };
    measure(&scene, &assets, options, &Silent).expect("a study")
}

/// The study of a motion, measured once for all tests that use it.
static MOTION: LazyLock<Study> =
    LazyLock::new(|| study("motion", "[solver.xpbd]\nsubsteps = 20\n"));

fn of<'a>(study: &'a Study, solver: &'a str) -> impl Iterator<Item = &'a StudyRow> {
    study
        .rows
        .iter()
        .filter(move |row| row.candidate.solver_key() == solver)
}

fn with_one_sweep(study: &Study, substeps: u32) -> &StudyRow {
    let expected = |row: &&StudyRow| {
        row.candidate.solver.substeps() == substeps && row.candidate.solver.iterations() == 1
    };
    of(study, "xpbd")
        .find(expected)
        .expect("that many substeps are tried")
}

#[test]
fn errors_of_a_motion_fall_towards_its_reference() {
    let study = &*MOTION;
    assert_eq!((study.question, study.frames), (SolverQuestion::Motion, 3));
    let uncertainty = study.reference.uncertainty.rms;
    assert!(
        uncertainty <= 0.01 * study.length,
        "{uncertainty:e}: {:?}",
        study.reference.steps
    );
    for name in ["xpbd", "implicit_euler", "quasi_static"] {
        assert!(of(study, name).next().is_some(), "no row of {name}");
    }
    let errors: Vec<f64> = [4, 16, 64]
        .map(|n| with_one_sweep(study, n).error.rms)
        .into();
    assert!(errors.windows(2).all(|e| e[1] < e[0]), "{errors:?}");
    // Two independent methods converge to the same motion.
    let apart = with_one_sweep(study, 256).error.rms;
    assert!(
        apart <= errors[0] / 10.0 + uncertainty,
        "{apart:e} for {uncertainty:e} and {errors:?}"
    );
    assert!(
        study.model_distance_m > 10.0 * uncertainty,
        "an equilibrium is no motion: {:e}",
        study.model_distance_m
    );
    for row in &study.rows {
        assert!(row.volume_error <= 1e-6, "{row:?}");
        let own = SolverQuestion::of(&row.candidate.solver) == Some(study.question);
        assert_eq!(row.model_error_m == 0.0, own, "{row:?}");
    }
    let chosen = &study.recommended[0];
    let row = &study.rows[chosen
        .row
        .expect("something is within a tenth of the length")];
    assert!(row.error.rms + row.model_error_m <= chosen.target * study.length);
    for other in study
        .rows
        .iter()
        .filter(|r| pliant::testing::internals::accuracy::reaches(r, chosen.target * study.length))
    {
        assert!(row.time_s <= other.time_s, "{other:?} is faster");
    }
}

#[test]
fn errors_of_an_equilibrium_fall_with_its_tolerance() {
    let study = study("equilibrium", "[solver.quasi_static]\n");
    assert_eq!(study.question, SolverQuestion::Equilibrium);
    let tolerance = |row: &StudyRow| match row.candidate.solver {
        Solver::QuasiStatic(s) if s.iterations > 100 => Some(s.tolerance),
        _ => None,
    };
    let mut rows: Vec<(f64, f64)> = of(&study, "quasi_static")
        .filter_map(|r| Some((tolerance(r)?, r.error.rms)))
        .collect();
    rows.sort_by(|a, b| b.0.total_cmp(&a.0));
    let (first, last) = (rows[0].1, rows[rows.len() - 1].1);
    assert!(rows.len() >= 4 && last <= first / 10.0, "{rows:?}");
    assert!(
        of(&study, "quasi_static").all(|r| r.model_error_m == 0.0 && r.status != Status::Diverged)
    );
}

#[test]
fn a_wrong_reference_is_seen() {
    let study = &*MOTION;
    let shift = Vector3::repeat(0.01 * study.length);
    let moved: Vec<Vec<Point3<f64>>> = study
        .reference
        .frames()
        .iter()
        .map(|frame| frame.iter().map(|p| p + shift).collect())
        .collect();
    let distance = FrameDistance::between(study.reference.frames(), &moved);
    assert!((distance.rms - shift.norm()).abs() <= T4 * shift.norm());
    assert!(worst([(distance.max - distance.rms).abs()]) <= T4 * shift.norm());
}

#[test]
fn what_has_no_energy_or_no_time_is_refused() {
    let (pbd, assets) = scene("refused", "[solver.pbd]\n");
    let options = StudyOptions {
        budget: Duration::from_secs(5),
        frames: Some(2),
        threads: 1,
    };
    assert!(matches!(
        measure(&pbd, &assets, options, &Silent),
        Err(StudyError::NoEnergy)
    ));
    let (xpbd, assets) = scene("stopped", "[solver.xpbd]\n");
    let stopped = measure(&xpbd, &assets, options, &Impatient::after(1));
    assert!(matches!(stopped, Err(StudyError::NoReference(why)) if why.contains("interrupted")));
    let late = measure(&xpbd, &assets, options, &Impatient::after(12)).expect("what there is");
    assert!(
        late.interrupted && !late.left_out.is_empty(),
        "{} rows",
        late.rows.len()
    );
}
