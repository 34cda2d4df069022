//! Runs a case of a campaign, and judges how it ends.

use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::report::audit::RunAudit;
use crate::report::muscles::TORN;
use pliant::mesh::measures::{max_or_nan, volume};
use pliant::progress::Progress;
use pliant::scene::{ContactEffect, Content, Scene, SceneError};
use pliant::simulation::{
    Body, LoadError, Measures, PairSummary, Scenario, Simulation, Stepped, VOLUME_HELD,
    scenario_with,
};

/// How a case ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ended {
    /// Every frame is converged, and no check of its result fails.
    Converged,
    /// Its result says why it is not to be trusted.
    NotConverged(String),
    /// It was refused before its first frame, with the key at fault.
    Refused(String),
    /// It ended in a way in which no case may end: its kind, a colon, and what was found.
    Found(String),
    /// The user stopped it.
    Interrupted,
}

impl Ended {
    /// Its name in tables.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::NotConverged(_) => "not converged",
            Self::Refused(_) => "refused",
            Self::Found(_) => "finding",
            Self::Interrupted => "interrupted",
        }
    }

    /// The kind of a finding; `None` for another end.
    pub fn defect(&self) -> Option<&str> {
        match self {
            Self::Found(what) => what.split(':').next(),
            _ => None,
        }
    }

    /// What more there is to say.
    pub fn why(&self) -> &str {
        match self {
            Self::NotConverged(why) | Self::Refused(why) | Self::Found(why) => why,
            Self::Converged | Self::Interrupted => "",
        }
    }
}

/// The conditions of all cases.
pub struct Trial<'a> {
    /// Reads the scene with changes.
    pub load: &'a (dyn Fn(&[String]) -> Result<Content, SceneError> + Sync),
    /// Makes the simulation of a scene of muscles.
    pub make: fn(Scene) -> Result<Simulation, LoadError>,
    /// The greatest work of a case of muscles, in steps of vertices.
    pub most_work: u64,
    /// The longest time of a case.
    pub longest: Duration,
    /// A flag that stops all cases.
    pub stop: &'a AtomicBool,
}

/// Stops a case that lasts too long.
struct Watch<'a> {
    stop: &'a AtomicBool,
    end: Instant,
}

impl Progress for Watch<'_> {
    fn report(&self, _: &str, _: usize, _: usize) -> ControlFlow<()> {
        if self.stop.load(Ordering::Relaxed) || Instant::now() >= self.end {
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    }
}

/// What a case is examined for beside the rest.
#[derive(Clone, Copy, Debug, Default)]
pub struct Examined {
    /// Nothing moves it, so that it must come to rest.
    pub still: bool,
    /// Its first frames are computed by other threads too.
    pub threads: bool,
}

/// The frames that other threads compute too, and the number of those threads.
const TWIN_FRAMES: usize = 2;
const TWIN_THREADS: usize = 3;

/// The kinetic energy of a case that stands still grows if two things hold. In the last third of the frames it
/// is above this multiple of the greatest one before, and it moves a vertex in a frame by more than this share
/// of an edge.
const GROWS: f64 = 2.0;
const AT_REST: f64 = 1e-3;

/// An edge that grows by more than this factor in a frame, from its length before it or at rest, leaps.
const LEAP: f64 = 5.0;

impl Trial<'_> {
    /// Runs the scene with these changes.
    pub fn run(&self, changes: &[String], examined: Examined) -> Ended {
        self.measured(changes, examined).0
    }

    /// The same, with the work of muscles [steps of vertices].
    pub fn measured(&self, changes: &[String], examined: Examined) -> (Ended, u64) {
        let mut work = 0;
        let watch = Watch {
            stop: self.stop,
            end: Instant::now() + self.longest,
        };
        let run = || match (self.load)(changes) {
            Err(error) => refused(&error),
            Ok(Content::Muscles(scene)) => self.of_muscles(*scene, &watch, examined, &mut work),
            Ok(other) => self.of_others(&other, &watch),
        };
        let ended = catch_unwind(AssertUnwindSafe(run)).unwrap_or_else(|panic| {
            let text = panic.downcast_ref::<String>().map(String::as_str);
            let text = text.or(panic.downcast_ref::<&str>().copied());
            Ended::Found(format!("panic: {}", text.unwrap_or("without a message")))
        });
        (ended, work)
    }

    fn of_muscles(
        &self,
        scene: Scene,
        watch: &Watch<'_>,
        examined: Examined,
        work: &mut u64,
    ) -> Ended {
        let contact = scene.effects.contact;
        let twin = examined.threads.then(|| (self.make)(scene.clone()));
        let made = (self.make)(scene).and_then(|made| Ok((made, twin.transpose()?)));
        let (mut simulation, mut twin) = match made {
            Ok(made) => made,
            Err(error) => return not_loaded(&error),
        };
        if let Some(twin) = &mut twin {
            twin.set_threads(TWIN_THREADS);
        }
        for simulation in twin.iter_mut().chain([&mut simulation]) {
            simulation.limit_work(self.most_work);
        }
        let mut energies = Vec::new();
        // Several cases run at once. Within a pool of theirs nobody could stop a frame.
        simulation.set_threads(1);
        if watch.is_stopped() {
            return self.stopped(0);
        }
        let mut audit = RunAudit::new();
        audit.frame(&simulation);
        let at_start = audit.summary.crossings_max.all;
        let mut why = None;
        while !simulation.is_finished() {
            let before = positions(&simulation);
            let stepped = simulation.step(watch);
            *work = simulation.work();
            match stepped {
                Stepped::Done => {}
                Stepped::Interrupted if simulation.work() > self.most_work => {
                    let (frame, all) = (simulation.frame() + 1, simulation.scene.frames);
                    let spent = format!("its work is spent in frame {frame} of {all}");
                    why = why.or(Some(spent));
                    break;
                }
                Stepped::Interrupted => return self.stopped(simulation.frame()),
                Stepped::Failed(reason) => return Ended::NotConverged(reason),
            }
            let measures = simulation.measure();
            let leapt = leapt(&simulation, &before);
            if let Some(found) = unsound(&simulation, &measures).or(leapt) {
                return Ended::Found(found);
            }
            why = why.or(doubted(&simulation, &measures));
            audit.frame(&simulation);
            if let Some(twin) = twin.as_mut().filter(|_| simulation.frame() <= TWIN_FRAMES) {
                match twin.step(watch) {
                    Stepped::Done => {}
                    Stepped::Interrupted => return self.stopped(simulation.frame()),
                    Stepped::Failed(reason) => return Ended::NotConverged(reason),
                }
                if let Some(found) = differs(&simulation, twin) {
                    return Ended::Found(found);
                }
            }
            energies.push(measures.iter().map(|m| m.kinetic_energy_j).sum::<f64>());
            if watch.is_stopped() && !simulation.is_finished() {
                return self.stopped(simulation.frame());
            }
            if simulation.bodies.iter().all(|body| body.stopped.is_some()) {
                break;
            }
        }
        audit.finish(&simulation);
        let grown = || {
            let all_converged = why.is_none() && examined.still;
            all_converged.then(|| grows(&simulation, &energies))?
        };
        let crossed = crossed((&simulation, contact), &audit, at_start);
        if let Some(found) = crossed.or_else(grown) {
            return Ended::Found(found);
        }
        why.map_or(Ended::Converged, Ended::NotConverged)
    }

    fn of_others(&self, content: &Content, watch: &Watch<'_>) -> Ended {
        let mut run = match scenario_with(content, watch) {
            Ok(run) => run,
            Err(_) if watch.is_stopped() => return self.stopped(0),
            Err(error) => return not_loaded(&error),
        };
        while !run.is_finished() {
            match run.step(watch) {
                Stepped::Done => {}
                Stepped::Interrupted => return self.stopped(run.frame()),
                Stepped::Failed(reason) => return Ended::NotConverged(reason),
            }
            let finite = |(x, _): &(Vec<_>, _)| x.iter().all(is_finite);
            if !run.bodies().iter().all(finite) {
                return Ended::Found(format!("not finite: a position of frame {}", run.frame()));
            }
        }
        if run.converged() {
            Ended::Converged
        } else {
            Ended::NotConverged("the last frame is not converged".to_owned())
        }
    }

    fn stopped(&self, frame: usize) -> Ended {
        if self.stop.load(Ordering::Relaxed) {
            return Ended::Interrupted;
        }
        let seconds = self.longest.as_secs_f64();
        Ended::Found(format!(
            "no end: not finished within {seconds} s, in frame {}",
            frame + 1
        ))
    }
}

/// The end of a scene that cannot be read.
fn refused(error: &SceneError) -> Ended {
    let (code, key, problem) = (error.problem().code(), error.key(), error.problem());
    if key.is_empty() {
        return Ended::Found(format!("no key: refused with {code}: {problem}"));
    }
    Ended::Refused(format!("{code} {key}: {problem}"))
}

/// The end of a scene whose bodies cannot be made.
fn not_loaded(error: &LoadError) -> Ended {
    match error {
        LoadError::Unfit(unfit) => refused(unfit.scene_error()),
        LoadError::Read(_) => Ended::Refused(format!("mesh: {error}")),
        LoadError::Several(all) => {
            let mut ends: Vec<Ended> = all.iter().map(not_loaded).collect();
            let found = ends.iter().position(|end| matches!(end, Ended::Found(_)));
            ends.swap_remove(found.unwrap_or(0))
        }
    }
}

fn is_finite(x: &nalgebra::Point3<f64>) -> bool {
    x.coords.iter().all(|c| c.is_finite())
}

/// What a frame must not have, whatever it says of itself.
fn unsound(simulation: &Simulation, measures: &[Measures]) -> Option<String> {
    let frame = simulation.frame();
    measures
        .iter()
        .zip(&simulation.bodies)
        .find_map(|(measures, body)| {
            let x = &body.system.particles.position;
            if !x.iter().all(is_finite) {
                return Some(format!(
                    "not finite: a position of {} in frame {frame}",
                    body.name
                ));
            }
            let error = volume_error(simulation, body)?;
            let lost = measures.converged && !(error <= VOLUME_HELD);
            lost.then(|| {
                format!(
                    "volume: {} loses {error:.1e} in a converged frame {frame}",
                    body.name
                )
            })
        })
}

/// The positions of all bodies.
fn positions(simulation: &Simulation) -> Vec<Vec<nalgebra::Point3<f64>>> {
    let bodies = simulation.bodies.iter();
    bodies
        .map(|body| body.system.particles.position.clone())
        .collect()
}

/// An edge that a frame stretches as no stable step does, from the positions before the frame: such a
/// frame is made again with shorter steps, or stops its body.
fn leapt(simulation: &Simulation, before: &[Vec<nalgebra::Point3<f64>>]) -> Option<String> {
    let scene = &simulation.scene;
    if !scene.effects.stretch || scene.solver.minimisation().is_some() {
        return None;
    }
    let mut each = simulation.bodies.iter().zip(before);
    each.find_map(|(body, before)| {
        let (now, rest) = (&body.system.particles.position, &body.rest.vertices);
        let is_held = |v: u32| body.system.particles.inverse_mass[v as usize] == 0.0;
        let leaps = |&[a, b]: &[u32; 2]| {
            let [now, before, rest] =
                [now, before, rest].map(|x| (x[a as usize] - x[b as usize]).norm());
            !(now <= LEAP * before.max(rest) || is_held(a) && is_held(b))
        };
        let sides = body.rest.triangles.iter();
        let mut sides = sides.flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
        let [a, _] = sides.find(leaps)?;
        let frame = simulation.frame();
        Some(format!(
            "leap: an edge of {} at vertex {a} grows by more than {LEAP} in frame {frame}",
            body.name
        ))
    })
}

/// Crossings that contact must prevent and did not announce, of those that the start had not.
fn crossed(
    (simulation, contact): (&Simulation, Option<ContactEffect>),
    audit: &RunAudit,
    at_start: usize,
) -> Option<String> {
    let contact = contact?;
    let is_kept = contact.between.muscles && contact.between.bones && contact.between.itself;
    let crossings = audit.summary.crossings_max.all;
    if !is_kept || simulation.certificate().open > 0 || crossings <= at_start {
        return None;
    }
    let worst = audit.summary.worst(|_| true);
    let place = worst.map_or(String::new(), PairSummary::place);
    let what = "pairs of triangles cross, and no pair is open";
    Some(format!("crossing: {crossings} {what}: {place}"))
}

/// Positions that depend on the number of threads.
fn differs(simulation: &Simulation, twin: &Simulation) -> Option<String> {
    let mut both = simulation.bodies.iter().zip(&twin.bodies);
    let other = both.find(|(body, twin)| {
        let [x, y] = [body, twin].map(|body| &body.system.particles.position);
        x != y
    });
    let frame = simulation.frame();
    other.map(|(body, _)| {
        format!(
            "threads: {} has other positions in frame {frame} by {TWIN_THREADS} threads than by one",
            body.name
        )
    })
}

/// Kinetic energy that grows although no bone moves, from that of each frame [J].
fn grows(simulation: &Simulation, energies: &[f64]) -> Option<String> {
    let (before, last) = energies.split_at(energies.len() - energies.len() / 3);
    let [before, last] = [before, last].map(|part| max_or_nan(part.iter().copied()));
    let bodies = &simulation.bodies;
    let mass: f64 = bodies.iter().map(|body| mass(&body.system.particles)).sum();
    let edge = bodies.iter().map(|body| body.edge_length);
    let edge = edge.min_by(f64::total_cmp).unwrap_or(0.0);
    let in_a_frame = (2.0 * last / mass).sqrt() / simulation.scene.frame_rate;
    let is_still = last <= GROWS * before || in_a_frame <= AT_REST * edge;
    (!is_still && mass > 0.0).then(|| {
        format!(
            "energy: {last:.1e} J in the last third of the frames, at most {before:.1e} J before"
        )
    })
}

/// The mass of the free vertices [kg].
fn mass(particles: &pliant::Particles) -> f64 {
    let free = particles.inverse_mass.iter().filter(|w| **w > 0.0);
    free.map(|w| 1.0 / w).sum()
}

/// The error of a volume that is kept exactly, relative to its target, computed anew.
fn volume_error(simulation: &Simulation, body: &Body) -> Option<f64> {
    let muscle = simulation
        .scene
        .muscles
        .iter()
        .find(|m| m.name == body.name)?;
    let is_exact = body.target_volume > 0.0 && muscle.material.bulk.is_none();
    let now = volume(&body.system.particles.position, &body.rest.triangles);
    is_exact.then(|| (now / body.target_volume - 1.0).abs())
}

/// Why a frame is not to be trusted, by its own measures.
fn doubted(simulation: &Simulation, measures: &[Measures]) -> Option<String> {
    let frame = simulation.frame();
    let of_bodies = measures.iter().zip(&simulation.bodies);
    let mut each = of_bodies.filter_map(|(measures, body)| {
        let name = &body.name;
        if let Some((stop, broken)) = &body.stopped {
            return Some(format!("{name} stops in frame {stop}: {broken}"));
        }
        if !(measures.edge_stretch_max <= TORN) {
            return Some(format!(
                "an edge of {name} is strained by more than {TORN} in frame {frame}"
            ));
        }
        let open = simulation.certificate().open > 0;
        (!measures.converged || open).then(|| format!("{name} does not converge in frame {frame}"))
    });
    each.next()
}

#[cfg(test)]
mod tests {
    use super::*;
    use pliant::scene::builtin::load_content;

    fn ended(scene: &'static str, changes: &[&str], longest: f64) -> Ended {
        let load = move |changes: &[String]| load_content(scene, changes);
        let trial = Trial {
            load: &load,
            make: Simulation::new,
            most_work: u64::MAX,
            longest: Duration::from_secs_f64(longest),
            stop: &AtomicBool::new(false),
        };
        trial.run(
            &changes.iter().map(|c| (*c).to_owned()).collect::<Vec<_>>(),
            Examined::default(),
        )
    }

    #[test]
    fn each_way_to_end_has_its_name() {
        let lattice = |more: &[&str]| {
            ended(
                "lattice",
                &[&["lattice.points=[4,4,4]", "frames=40"], more].concat(),
                60.0,
            )
        };
        assert_eq!(lattice(&[]), Ended::Converged);
        let small = "muscle.0.edge_length=20 mm";
        let pressed = ended("press", &[small, "frames=4"], 60.0);
        assert_eq!(pressed, Ended::Converged);
        let loose = ended(
            "press",
            &[small, "frames=30", "solver.xpbd.tolerance=1e-12"],
            60.0,
        );
        assert!(matches!(loose, Ended::NotConverged(_)), "{loose:?}");
        // What only a later frame has is found too.
        let later = ended(
            "press",
            &[
                small,
                "frames=8",
                "solver.xpbd.substeps=1",
                "solver.xpbd.tolerance=2e-4",
            ],
            60.0,
        );
        assert!(
            matches!(&later, Ended::NotConverged(why) if !why.ends_with("frame 1")),
            "{later:?}"
        );
        let refused = ended("press", &["muscle.0.material.density=-1 kg/m3"], 60.0);
        assert!(
            matches!(&refused, Ended::Refused(why) if why.contains("muscle.0.material.density")),
            "{refused:?}"
        );
        let long = ended("press", &[small, "solver.xpbd.substeps=100000"], 0.3);
        assert!(
            matches!(&long, Ended::Found(why) if why.contains("not finished")),
            "{long:?}"
        );
    }

    #[test]
    fn a_panic_is_a_finding() {
        let load = |_: &[String]| panic!("a defect");
        let trial = Trial {
            load: &load,
            make: Simulation::new,
            most_work: u64::MAX,
            longest: Duration::from_secs(1),
            stop: &AtomicBool::new(false),
        };
        assert_eq!(
            trial.run(&[], Examined::default()),
            Ended::Found("panic: a defect".to_owned())
        );
    }

    /// A press at its start, with its muscle moved.
    fn moved(by: impl FnMut(&mut nalgebra::Point3<f64>)) -> Simulation {
        let changes = ["muscle.0.edge_length=20 mm".to_owned()];
        let Ok(Content::Muscles(scene)) = load_content("press", &changes) else {
            panic!("a scene of muscles");
        };
        let mut simulation = Simulation::new(*scene).expect("meshes");
        simulation.step_frame();
        let x = &mut simulation.bodies[0].system.particles.position;
        x.iter_mut().for_each(by);
        simulation
    }

    #[test]
    fn each_defect_is_found() {
        let found = |simulation: &Simulation, converged: bool| {
            let mut measures = simulation.measure();
            measures[0].converged = converged;
            let mut audit = RunAudit::new();
            audit.finish(simulation);
            let contact = simulation.scene.effects.contact;
            unsound(simulation, &measures).or(crossed((simulation, contact), &audit, 0))
        };
        let is = |found: Option<String>, defect: &str| {
            let found = found.map(Ended::Found);
            assert_eq!(
                found.as_ref().and_then(Ended::defect),
                Some(defect),
                "{found:?}"
            );
        };
        assert_eq!(found(&moved(|_| ()), true), None, "control");
        is(found(&moved(|x| x.z = f64::NAN), true), "not finite");
        let mut one = 0;
        let spoilt = moved(|x| {
            x.z = if one == 7 { f64::NAN } else { x.z };
            one += 1;
        });
        is(found(&spoilt, true), "not finite");
        let smaller = moved(|x| x.coords *= 1.0 - 1e-6);
        is(found(&smaller, true), "volume");
        assert_eq!(found(&smaller, false), None, "control");
        is(found(&moved(|x| x.y += 0.02), true), "crossing");
        let (one, same) = (moved(|_| ()), moved(|_| ()));
        assert_eq!(differs(&one, &same), None, "control");
        is(
            differs(&one, &moved(|x| x.z *= 1.0 + f64::EPSILON)),
            "threads",
        );
        let calm = [0.0, 2.0, 1.0, 0.5, 0.2, 0.1];
        assert_eq!(grows(&one, &calm), None, "control");
        is(grows(&one, &[0.0, 0.2, 0.1, 0.2, 0.2, 0.5]), "energy");
        is(grows(&one, &[0.0, 0.2, 0.1, 0.2, 0.2, f64::NAN]), "energy");
        let tiny = [0.0, 0.0, 0.0, 0.0, 0.0, 1e-12];
        assert_eq!(grows(&one, &tiny), None, "rounding");
    }

    #[test]
    fn a_case_ends_when_its_work_is_spent_and_threads_change_nothing() {
        let load = |changes: &[String]| load_content("press", changes);
        let trial = |most_work: u64| {
            Trial {
                load: &load,
                make: Simulation::new,
                most_work,
                longest: Duration::from_secs(60),
                stop: &AtomicBool::new(false),
            }
            .run(
                &["muscle.0.edge_length=20 mm", "frames=4"].map(str::to_owned),
                Examined {
                    still: true,
                    threads: true,
                },
            )
        };
        assert_eq!(trial(u64::MAX), Ended::Converged);
        let spent = "its work is spent in frame 1 of 4".to_owned();
        assert_eq!(trial(1), Ended::NotConverged(spent));
    }
}
