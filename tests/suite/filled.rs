//! Implants that are filled step by step, and a ball that moves up, as in scenes.

use pliant::progress::Silent;
use pliant::scene::builtin::load_content;
use pliant::scene::{Content, Support, Surroundings, parse_content};
use pliant::simulation::{SkinMeasures, SkinPart, SkinRun, Stepped};

/// The flat implant on a coarse mesh, run to its last frame.
fn run(changes: &[&str]) -> SkinRun {
    of(
        "flat-implant",
        &[&["sheet.cells=24", "skin.edge_length=8.4 mm"], changes].concat(),
    )
}

fn of(scene: &str, changes: &[&str]) -> SkinRun {
    let changes: Vec<String> = changes.iter().map(|&c| c.to_owned()).collect();
    let Ok(Content::Skin(scene)) = load_content(scene, &changes) else {
        panic!("no skin")
    };
    let mut run = SkinRun::new(*scene).expect("a scene that runs");
    while run.frame() < run.scene.frames {
        assert_eq!(run.step(&Silent), Stepped::Done);
    }
    assert!(run.converged());
    run
}

fn gain(run: &SkinRun) -> f64 {
    run.parts[0].frames.last().expect("a frame").areas.gain() * 1e4
}

#[test]
fn a_fill_by_steps_ends_where_one_filling_does() {
    let at_once = gain(&run(&["implant.volume=60cc"]));
    let steps = run(&["implant.volume=60cc", "frames=3"]);
    let volumes: Vec<f64> = steps.parts[0]
        .frames
        .iter()
        .map(|f| f.shells[0].0 * 1e6)
        .collect();
    assert!(
        volumes
            .iter()
            .zip([20.0, 40.0, 60.0])
            .all(|(v, w)| (v - w).abs() <= 1e-6 * w),
        "{volumes:?}"
    );
    // An area may still change by a thousandth in a round that counts as at rest, which is up to
    // a fiftieth of its gain.
    let found = gain(&steps);
    assert!(
        (found / at_once - 1.0).abs() <= 0.03,
        "{found} and {at_once} cm2"
    );
    let less = gain(&run(&["implant.volume=50cc"]));
    assert!(
        !((less / at_once - 1.0).abs() <= 0.03),
        "control: {less} and {at_once} cm2"
    );
}

#[test]
fn an_implant_that_is_emptied_gives_its_skin_back() {
    let schedule =
        "implant.fill=[{ frame = 1, volume = \"60 cc\" }, { frame = 2, volume = \"20 cc\" }]";
    let down = gain(&run(&["implant.volume=off", schedule]));
    let up = gain(&run(&["implant.volume=20cc"]));
    // As above; a small gain is a smaller share of the area.
    assert!((down - up).abs() <= 0.3, "{down} and {up} cm2");
}

#[test]
fn a_frame_that_is_given_up_leaves_the_last_one() {
    let mut run = run(&["implant.volume=60cc", "frames=2"]);
    run.scene.frames = 3;
    let Support::Implants(implants) = &mut run.scene.under else {
        panic!("no implants")
    };
    implants[0].fill.push((3, 90e-6));
    let before = run.skin_at();
    let stop = |_: &str, _: usize, _: usize| std::ops::ControlFlow::Break(());
    assert_eq!(run.step(&stop), Stepped::Interrupted);
    assert!(run.frame() == 2 && run.skin_at() == before);
}

#[test]
fn a_ball_that_comes_up_by_steps_ends_where_it_comes_at_once() {
    let up = |changes: &[&str]| gain(&of("sheet", changes));
    let (at_once, steps) = (up(&[]), up(&["frames=4"]));
    // A single filling starts from a coarser skin, the steps start from the frame before. Both
    // are at rest to a thousandth of the area, which is three times the gain.
    assert!(
        (steps / at_once - 1.0).abs() <= 3e-3,
        "{steps} and {at_once} cm2"
    );
    let newton = up(&["skin.method=newton"]);
    assert!(
        (newton / at_once - 1.0).abs() <= 3e-3,
        "{newton} and {at_once} cm2"
    );
    let lower = up(&["ball.to=[\"0 mm\", \"0 mm\", \"-0.1 mm\"]"]);
    assert!(
        !((lower / at_once - 1.0).abs() <= 3e-3),
        "control: {lower} and {at_once} cm2"
    );
}

#[test]
fn days_of_filling_hold_their_volumes_and_a_part_waits_for_its_own_days() {
    let text = "
name = 'two'
[[skin]]
shape = 'sheet'
edge_length = '5 mm'
[sheet]
side = '30 cm'
cells = 40
[[implant]]
name = 'left'
at = ['-8 cm', '0 mm', '0 mm']
base = '4 cm'
fill = [{ day = 0, volume = '5 cc' }, { day = 14, volume = '12 cc' }]
[[implant]]
name = 'right'
at = ['8 cm', '0 mm', '0 mm']
base = '4 cm'
fill = [{ day = 7, volume = '8 cc' }]
[[implant]]
name = 'third'
at = ['0 mm', '10 cm', '0 mm']
base = '4 cm'
volume = '6 cc'
";
    let parsed = |text: &str| {
        let around = Surroundings::of(std::path::Path::new("."));
        parse_content(text, "two.toml", &around)
    };
    let Ok(Content::Skin(scene)) = parsed(text) else {
        panic!("no skin")
    };
    assert_eq!(
        (scene.frames, scene.days.as_slice()),
        (3, &[0.0, 7.0, 14.0][..])
    );
    let mut run = SkinRun::new(*scene).expect("a scene that runs");
    while run.frame() < run.scene.frames {
        assert_eq!(run.step(&Silent), Stepped::Done);
    }
    let computed = |part: &SkinPart| -> Vec<(usize, f64)> {
        let cc = |f: &SkinMeasures| (f.frame, (f.volume() * 1e9).round() * 1e-3);
        part.frames.iter().map(cc).collect()
    };
    let [left, right, third] = &run.parts[..] else {
        panic!("they share no skin")
    };
    assert_eq!(computed(left), [(1, 5.0), (3, 12.0)]);
    assert_eq!(computed(right), [(2, 8.0)]);
    assert_eq!(computed(third), [(1, 6.0)]);
    let [before, after] = [1, 2].map(|frame| right.areas_at(frame).gain());
    assert!(before == 0.0 && after > 0.0 && right.areas_at(3).gain() == after);
    for (from, to, said) in [
        (
            "name = 'two'",
            "name = 'two'\nframes = 3",
            "`frames` and `fill.day`",
        ),
        (
            "day = 14, volume = '12 cc'",
            "day = 14, volume = '4 cc'",
            "less than the one before",
        ),
        ("day = 7", "frame = 7", "`fill.frame` and `fill.day`"),
        (
            "volume = '6 cc'",
            "target_area = '3 cm2'",
            "a target area of several implants",
        ),
    ] {
        let error = parsed(&text.replace(from, to)).expect_err(to);
        assert!(error.terse().contains(said), "{error:?}");
    }
}

#[test]
fn a_target_area_finds_its_volume() {
    let found = run(&["implant.volume=off", "implant.target_area=12 cm2"]);
    assert!(
        (gain(&found) / 12.0 - 1.0).abs() <= 5e-3,
        "{}",
        gain(&found)
    );
    let volume = found.parts[0].frames[0].volume();
    let direct = gain(&run(&[&format!("implant.volume={} m3", volume)]));
    assert!((direct / 12.0 - 1.0).abs() <= 0.03, "{direct}");
}
