//! Defects that are put into a solver on purpose: a small campaign finds each of them.

use std::sync::atomic::AtomicBool;
use std::time::Duration;

use pliant::scene::builtin::{find, load_content};
use pliant::scene::{Content, Scene};
use pliant::simulation::{LoadError, Simulation};

use super::{Drawing, Ended, Examined, Trial};

/// Why a campaign of a scene is red: its first finding, or too many usual cases that do not converge.
fn red(
    (name, seed, cases): (&str, u64, usize),
    make: fn(Scene) -> Result<Simulation, LoadError>,
) -> Option<String> {
    let load = |changes: &[String]| -> Result<Content, _> { load_content(name, changes) };
    let text = find(name).expect("a scene").text;
    let drawing = Drawing::new(&text.parse().expect("toml"), seed, 30, Vec::new());
    let trial = Trial {
        load: &load,
        make,
        most_work: 20_000_000,
        longest: Duration::from_secs(600),
        stop: &AtomicBool::new(false),
    };
    let mut failed = 0;
    for number in 0..cases {
        let case = drawing.case(number);
        let examined = Examined {
            still: case.still,
            threads: false,
        };
        match trial.run(&case.changes, examined) {
            Ended::Found(what) => return Some(what),
            Ended::NotConverged(_) if !case.beyond => failed += 1,
            _ => {}
        }
        // More than a tenth of all usual cases, which are at most half of all.
        if failed > cases / 20 {
            return Some(format!("{failed} usual cases do not converge"));
        }
    }
    None
}

/// So few cases that the first usual one which does not converge is too many.
const CAMPAIGN: (&str, u64, usize) = ("cube", 3, 12);

#[test]
fn contact_that_is_off_is_found() {
    let found = red(CAMPAIGN, |mut scene| {
        scene.effects.contact = None;
        Simulation::new(scene)
    });
    let found = found.expect("a finding");
    assert!(found.starts_with("crossing"), "{found}");
}

#[test]
fn a_hinge_of_the_wrong_sign_is_found() {
    let found = red(CAMPAIGN, |mut scene| {
        for muscle in &mut scene.muscles {
            muscle.material.bending *= -1.0;
        }
        Simulation::new(scene)
    });
    let found = found.expect("too few that converge");
    assert!(found.ends_with("do not converge"), "{found}");
}

#[test]
fn the_solver_as_it_is_has_no_finding() {
    assert_eq!(red(CAMPAIGN, Simulation::new), None);
}
