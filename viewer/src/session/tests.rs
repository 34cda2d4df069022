//! Behaviour with a faulty simulation.

use super::super::Recipe;
use super::super::muscles::Muscles;
use super::*;
use pliant::simulation::Simulation;

const LONG: Duration = Duration::from_secs(120);

fn started(step: fn(&mut Simulation)) -> Session {
    let recipe = Recipe::find("distance", &[]).unwrap_or_else(|e| panic!("{}", e.terse()));
    let scene = recipe.scene().unwrap_or_else(|e| panic!("{}", e.terse()));
    let muscles = Muscles::new(recipe, scene, step).unwrap_or_else(|e| panic!("{e}"));
    Session::of(Box::new(muscles), Pace::paused()).unwrap_or_else(|e| panic!("{e}"))
}

fn fails_at_two(simulation: &mut Simulation) {
    assert!(simulation.frame() < 1, "the second frame is too much");
    simulation.step_frame();
}

#[test]
fn a_panic_is_reported_and_a_reset_helps() {
    let session = started(fails_at_two);
    let first = session.send(Command::Step);
    let shot = session
        .wait(LONG, |s| s.answered >= first)
        .expect("an answer");
    assert_eq!(
        (shot.frame, &shot.failed),
        (1, &None),
        "the first frame does not fail"
    );
    session.send(Command::Run);
    let shot = session
        .wait(LONG, |s| s.failed.is_some())
        .expect("a report");
    assert_eq!(
        shot.failed.as_deref(),
        Some("frame 2: the simulation panicked: the second frame is too much")
    );
    assert!(!shot.running);
    let refused = session.send(Command::Step);
    let shot = session
        .wait(LONG, |s| s.answered >= refused)
        .expect("an answer");
    let (number, why) = shot.refused.clone().expect("a refusal");
    assert!(
        number == refused && why.ends_with("reset it first"),
        "{why}"
    );
    session.send(Command::Reset);
    let again = session.send(Command::Step);
    let shot = session
        .wait(LONG, |s| s.answered >= again)
        .expect("an answer");
    assert_eq!((shot.frame, &shot.failed), (1, &None));
}

#[test]
fn a_muscle_that_is_stopped_is_reported() {
    let session = started(|simulation| {
        if simulation.frame() == 2 {
            simulation.bodies[0].system.particles.velocity[3].x = f64::NAN;
        }
        simulation.step_frame();
    });
    session.send(Command::Run);
    let shot = session
        .wait(LONG, |s| s.bodies[0].stopped.is_some())
        .expect("a report");
    let (frame, why) = shot.bodies[0].stopped.clone().expect("why");
    assert!(frame == 3 && why.contains("not finite"), "{frame} {why}");
    assert!(!shot.running && shot.failed.is_none());
    assert!(
        shot.bodies[0]
            .positions
            .iter()
            .all(|x| x.coords.iter().all(|c| c.is_finite()))
    );
}
