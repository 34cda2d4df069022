//! The solvers. [`SOLVERS`] declares each one once. Scene files, overrides, the panel, reports and
//! the candidates of an accuracy study read the table.

use super::keys::{KeyKind, KeySpec, KeyValue, Limit, Slider};
use super::schema::Schema;
use crate::constraints::SweepOrder;

/// Usual number of steps where a scene names none, as in most scenes of muscles, and the least one.
const UNNAMED: u32 = 64;
const FEWEST_USUAL: u32 = 16;

/// How the motion is computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Solver {
    /// Extended position-based dynamics with small steps and material stiffness.
    Xpbd(Xpbd),
    /// Classic position-based dynamics with stiffness 0..1, for comparison.
    Pbd(Pbd),
    /// Equilibrium at every frame, without mass and velocity.
    QuasiStatic(Minimisation),
    /// Implicit Euler steps, each solved as the minimum of energy and inertia.
    ImplicitEuler(Minimisation),
}

/// Settings of small-step XPBD.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Xpbd {
    /// Steps per frame.
    pub substeps: u32,
    /// Sweeps per step.
    pub iterations: u32,
    /// Order of a sweep.
    pub order: SweepOrder,
    /// Largest relative residual at which a frame counts as converged.
    pub tolerance: f64,
}

/// Settings of classic PBD.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pbd {
    /// Steps per frame.
    pub substeps: u32,
    /// Sweeps per step.
    pub iterations: u32,
    /// Stiffness of edges, 0..1.
    pub stretch: f64,
    /// Stiffness of hinges, 0..1.
    pub bending: f64,
    /// Stiffness of the volume, 0..1.
    pub volume: f64,
    /// Factor on velocities in each frame, 0..1.
    pub velocity_damping: f64,
    /// Order of a sweep.
    pub order: SweepOrder,
    /// Largest relative residual at which a frame counts as converged.
    pub tolerance: f64,
}

/// Settings of the solvers that minimise an energy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Minimisation {
    /// Steps per frame. The bones move between them.
    pub substeps: u32,
    /// Greatest number of iterations per step.
    pub iterations: u32,
    /// Largest residual force at which a frame counts as converged, relative to the force at a
    /// strain of one.
    pub tolerance: f64,
}

/// The problem that a solver solves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SolverQuestion {
    /// The motion of the muscles in time, with mass and damping.
    Motion,
    /// The equilibrium of the muscles at each pose of the bones.
    Equilibrium,
}

/// A mutable setting of a solver.
enum Setting<'a> {
    Number(&'a mut f64),
    Whole(&'a mut u32),
    Order(&'a mut SweepOrder),
}

impl Setting<'_> {
    fn value(&self) -> KeyValue {
        match self {
            Self::Number(number) => KeyValue::Number(**number),
            Self::Whole(number) => KeyValue::Whole(**number),
            Self::Order(order) => KeyValue::Order(**order),
        }
    }

    /// Sets the value if it has the right type.
    fn set(self, value: KeyValue) {
        match (self, value) {
            (Self::Number(to), KeyValue::Number(number)) => *to = number,
            (Self::Whole(to), KeyValue::Whole(number)) => *to = number,
            (Self::Order(to), KeyValue::Order(order)) => *to = order,
            _ => {}
        }
    }
}

/// The declaration of a solver.
#[derive(Debug)]
pub struct SolverSpec {
    /// Key of the section in a scene file.
    pub key: &'static str,
    /// Name in reports.
    pub name: &'static str,
    /// Description in one sentence.
    pub help: &'static str,
    /// Settings.
    pub keys: &'static [KeySpec],
    /// The solver with its default settings.
    pub default: Solver,
    /// The problem that the solver solves; `None` for a solver that minimises no energy.
    pub question: Option<SolverQuestion>,
    pub(super) schema: Schema,
    /// The settings of `keys`; `None` for another solver.
    settings: fn(&mut Solver) -> Option<Vec<Setting<'_>>>,
    /// Settings that an accuracy study compares for a scene with the given solver, the cheap ones
    /// first.
    candidates: fn(&Solver) -> Vec<Solver>,
}

/// Every solver; a scene without a section `[solver]` has the first one.
pub static SOLVERS: [SolverSpec; 4] = [
    SolverSpec {
        key: "xpbd",
        name: "small-step XPBD",
        help: "Extended position-based dynamics with small steps and material stiffness.",
        keys: XPBD,
        default: Solver::Xpbd(Xpbd {
            substeps: 20,
            iterations: 1,
            order: SweepOrder::Coloured,
            tolerance: RESIDUAL,
        }),
        question: Some(SolverQuestion::Motion),
        schema: Schema::Keys(XPBD),
        settings: |solver| match solver {
            Solver::Xpbd(s) => Some(vec![
                Setting::Whole(&mut s.substeps),
                Setting::Whole(&mut s.iterations),
                Setting::Number(&mut s.tolerance),
                Setting::Order(&mut s.order),
            ]),
            _ => None,
        },
        candidates: small_steps,
    },
    SolverSpec {
        key: "pbd",
        name: "classic PBD",
        help: "Classic position-based dynamics with stiffness from 0 to 1, for comparison.",
        keys: PBD,
        default: Solver::Pbd(Pbd {
            substeps: 1,
            iterations: 3,
            stretch: 1.0,
            bending: 0.9,
            volume: 1.0,
            velocity_damping: 0.99,
            order: SweepOrder::Coloured,
            tolerance: RESIDUAL,
        }),
        question: None,
        schema: Schema::Keys(PBD),
        settings: |solver| match solver {
            Solver::Pbd(s) => Some(vec![
                Setting::Whole(&mut s.substeps),
                Setting::Whole(&mut s.iterations),
                Setting::Number(&mut s.tolerance),
                Setting::Order(&mut s.order),
                Setting::Number(&mut s.stretch),
                Setting::Number(&mut s.bending),
                Setting::Number(&mut s.volume),
                Setting::Number(&mut s.velocity_damping),
            ]),
            _ => None,
        },
        candidates: |_| Vec::new(),
    },
    SolverSpec {
        key: "quasi_static",
        name: "quasi-static",
        help: "Equilibrium at every frame, without mass and velocity.",
        keys: MINIMISATION,
        default: Solver::QuasiStatic(TO_TOLERANCE),
        question: Some(SolverQuestion::Equilibrium),
        schema: Schema::Keys(MINIMISATION),
        settings: |solver| match solver {
            Solver::QuasiStatic(s) => Some(s.settings()),
            _ => None,
        },
        candidates: equilibria,
    },
    SolverSpec {
        key: "implicit_euler",
        name: "implicit Euler",
        help: "Implicit Euler steps, each the minimum of energy and inertia.",
        keys: MINIMISATION,
        default: Solver::ImplicitEuler(TO_TOLERANCE),
        question: Some(SolverQuestion::Motion),
        schema: Schema::Keys(MINIMISATION),
        settings: |solver| match solver {
            Solver::ImplicitEuler(s) => Some(s.settings()),
            _ => None,
        },
        candidates: implicit_steps,
    },
];

/// A number of iterations that suffices for any tolerance.
pub const ENOUGH_ITERATIONS: u32 = 500;

/// Largest relative residual of a frame that counts as converged.
const RESIDUAL: f64 = 0.01;

/// The tolerance of the residual force is relative to the force at a strain of one. With this
/// tolerance the error of a pose is about a thousandth of a muscle's length.
const TO_TOLERANCE: Minimisation = Minimisation {
    substeps: 1,
    iterations: ENOUGH_ITERATIONS,
    tolerance: 2e-4,
};

const XPBD: &[KeySpec] = &[substeps(200), sweeps(), tolerance(), order()];

/// The key of a stiffness is the key of its effect; see [`Solver::share`].
const PBD: &[KeySpec] = &[
    substeps(200),
    sweeps(),
    tolerance(),
    order(),
    share("stretch", "Stiffness of edges."),
    share("bending", "Stiffness of hinges."),
    share("volume", "Stiffness of the volume."),
    share("velocity_damping", "Factor on velocities each frame.").labelled("velocity damping"),
];

const MINIMISATION: &[KeySpec] = &[substeps(20), iterations(), tolerance()];

/// Greatest number of steps per frame and of iterations per step.
const MOST: u32 = 1_000_000;

const fn substeps(most: u32) -> KeySpec {
    KeySpec::new("substeps", KeyKind::Whole(MOST), "Steps a frame.")
        .over(Slider::Factors(1.0, most as f64))
}

const fn sweeps() -> KeySpec {
    KeySpec::new("iterations", KeyKind::Whole(MOST), "Sweeps a step.")
        .over(Slider::Factors(1.0, 100.0))
}

const fn iterations() -> KeySpec {
    KeySpec::new(
        "iterations",
        KeyKind::Whole(MOST),
        "Iterations a step, at most.",
    )
    .over(Slider::Factors(1.0, 2000.0))
}

const fn tolerance() -> KeySpec {
    let help = "Largest residual at which a frame counts as converged.";
    KeySpec::new("tolerance", KeyKind::Number(Limit::Positive), help)
        .over(Slider::Factors(1e-6, 1.0))
}

const fn order() -> KeySpec {
    KeySpec::new("order", KeyKind::Order, "Order of a sweep.").labelled("order of a sweep")
}

const fn share(key: &'static str, help: &'static str) -> KeySpec {
    KeySpec::new(key, KeyKind::Number(Limit::Within(0.0, 1.0)), help)
}

impl SolverSpec {
    /// The solver whose settings have these values, in the order of [`SolverSpec::keys`].
    pub(super) fn with(&self, values: &[KeyValue]) -> Solver {
        let mut solver = self.default;
        let settings = (self.settings)(&mut solver).unwrap_or_default();
        for (setting, value) in settings.into_iter().zip(values) {
            setting.set(*value);
        }
        solver
    }

    /// The values of the settings of a solver; `None` for another solver.
    fn values(&self, solver: &Solver) -> Option<Vec<KeyValue>> {
        let mut solver = *solver;
        let settings = (self.settings)(&mut solver)?;
        Some(settings.iter().map(Setting::value).collect())
    }

    /// The declaration of the solver with a key.
    #[must_use]
    pub fn named(key: &str) -> Option<&'static Self> {
        SOLVERS.iter().find(|spec| spec.key == key)
    }
}

impl Default for Solver {
    fn default() -> Self {
        SOLVERS[0].default
    }
}

impl Solver {
    /// The declaration of this solver.
    #[must_use]
    pub fn spec(&self) -> &'static SolverSpec {
        SOLVERS
            .iter()
            .find(|spec| spec.values(self).is_some())
            .unwrap_or(&SOLVERS[0])
    }

    /// The settings of this solver.
    #[must_use]
    pub fn settings(&self) -> Vec<(&'static KeySpec, KeyValue)> {
        let spec = self.spec();
        let values = spec.values(self).unwrap_or_default();
        spec.keys.iter().zip(values).collect()
    }

    /// Steps per frame.
    #[must_use]
    pub fn substeps(&self) -> u32 {
        match self {
            Self::Xpbd(s) => s.substeps,
            Self::Pbd(s) => s.substeps,
            Self::QuasiStatic(s) | Self::ImplicitEuler(s) => s.substeps,
        }
    }

    /// Greatest number of sweeps or iterations per step.
    #[must_use]
    pub fn iterations(&self) -> u32 {
        match self {
            Self::Xpbd(s) => s.iterations,
            Self::Pbd(s) => s.iterations,
            Self::QuasiStatic(s) | Self::ImplicitEuler(s) => s.iterations,
        }
    }

    /// Largest relative residual at which a frame counts as converged.
    #[must_use]
    pub fn tolerance(&self) -> f64 {
        match self {
            Self::Xpbd(s) => s.tolerance,
            Self::Pbd(s) => s.tolerance,
            Self::QuasiStatic(s) | Self::ImplicitEuler(s) => s.tolerance,
        }
    }

    /// Order of a sweep; a solver without sweeps has none.
    #[must_use]
    pub fn order(&self) -> SweepOrder {
        match self {
            Self::Xpbd(s) => s.order,
            Self::Pbd(s) => s.order,
            Self::QuasiStatic(_) | Self::ImplicitEuler(_) => SweepOrder::default(),
        }
    }

    /// The same solver with another order of a sweep; `None` for a solver without sweeps.
    #[must_use]
    pub fn with_order(self, order: SweepOrder) -> Option<Self> {
        match self {
            Self::Xpbd(s) => Some(Self::Xpbd(Xpbd { order, ..s })),
            Self::Pbd(s) => Some(Self::Pbd(Pbd { order, ..s })),
            Self::QuasiStatic(_) | Self::ImplicitEuler(_) => None,
        }
    }

    /// The settings of a solver that minimises an energy; `None` for a solver that sweeps over
    /// constraints.
    #[must_use]
    pub fn minimisation(&self) -> Option<Minimisation> {
        match *self {
            Self::QuasiStatic(s) | Self::ImplicitEuler(s) => Some(s),
            Self::Xpbd(_) | Self::Pbd(_) => None,
        }
    }

    /// Whether bodies have velocities and inertia.
    #[must_use]
    pub fn has_inertia(&self) -> bool {
        self.question() != Some(SolverQuestion::Equilibrium)
    }

    /// The problem that this solver solves; `None` for a solver that minimises no energy.
    #[must_use]
    pub fn question(&self) -> Option<SolverQuestion> {
        self.spec().question
    }

    /// The stiffness 0..1 of the effect with a key; `None` for a solver that uses the stiffness of
    /// the material.
    #[must_use]
    pub fn share(&self, effect: &str) -> Option<f64> {
        self.settings()
            .into_iter()
            .find_map(|setting| match setting {
                (key, KeyValue::Number(share)) if key.key == effect => Some(share),
                _ => None,
            })
    }

    /// True if the stiffness of a material belongs to a step, whatever its length.
    pub(crate) fn has_classic_stiffness(&self) -> bool {
        matches!(self, Self::Pbd(_))
    }

    /// The solver whose steps can change from frame to frame, for the same motion; otherwise the same one.
    pub(crate) fn of_any_steps(self) -> Self {
        match self {
            Self::ImplicitEuler(_) => Self::default(),
            Self::Xpbd(s) => Self::Xpbd(Xpbd { iterations: 1, ..s }),
            other => other,
        }
    }

    /// The same solver with twice as many steps, if it sweeps: for a mesh with half the edge length.
    pub(crate) fn with_twice_the_steps(self) -> Self {
        match self {
            Self::Xpbd(s) => Self::Xpbd(Xpbd {
                substeps: s.substeps.saturating_mul(2),
                ..s
            }),
            other => other,
        }
    }

    /// The number of steps of a frame that is enough for most frames; `is_unnamed` if the scene names none.
    pub(crate) fn usual_steps(&self, is_unnamed: bool) -> u32 {
        match self {
            Self::Xpbd(s) if !is_unnamed => s.substeps.max(FEWEST_USUAL),
            _ => UNNAMED,
        }
    }

    /// The solver's own factor on velocities in each frame; `None` for a solver without one.
    #[must_use]
    pub fn velocity_damping(&self) -> Option<f64> {
        self.share("velocity_damping")
    }
}

impl SolverQuestion {
    /// The problem that `solver` solves; `None` for a solver that minimises no energy.
    #[must_use]
    pub fn of(solver: &Solver) -> Option<Self> {
        solver.question()
    }

    /// The solver for this problem that minimises an energy to a tolerance.
    #[must_use]
    pub fn minimised(self, substeps: u32, tolerance: f64) -> Solver {
        let settings = Minimisation {
            substeps,
            iterations: ENOUGH_ITERATIONS,
            tolerance,
        };
        match self {
            Self::Motion => Solver::ImplicitEuler(settings),
            Self::Equilibrium => Solver::QuasiStatic(settings),
        }
    }
}

impl Minimisation {
    fn settings(&mut self) -> Vec<Setting<'_>> {
        vec![
            Setting::Whole(&mut self.substeps),
            Setting::Whole(&mut self.iterations),
            Setting::Number(&mut self.tolerance),
        ]
    }
}

/// Settings of every solver that an accuracy study compares for a scene with the given solver.
#[must_use]
pub fn candidates(solver: &Solver) -> Vec<Solver> {
    SOLVERS
        .iter()
        .flat_map(|spec| (spec.candidates)(solver))
        .collect()
}

fn small_steps(solver: &Solver) -> Vec<Solver> {
    let own = matches!(solver, Solver::Xpbd(_)).then_some(*solver);
    let tolerance = own.map_or(RESIDUAL, |s| s.tolerance());
    let settings = |substeps, iterations, order| {
        Solver::Xpbd(Xpbd {
            substeps,
            iterations,
            order,
            tolerance,
        })
    };
    let mut all = Vec::new();
    for substeps in [2, 4, 8, 16, 32, 64, 128, 256] {
        all.push(settings(substeps, 1, SweepOrder::Coloured));
    }
    for substeps in [8, 16, 32] {
        all.push(settings(substeps, 4, SweepOrder::Coloured));
    }
    all.push(settings(32, 1, SweepOrder::Stored));
    all.extend(own);
    all
}

/// With limited iterations, the muscles follow a moving bone at a fixed cost. With a tolerance,
/// they follow at a fixed accuracy.
fn equilibria(_: &Solver) -> Vec<Solver> {
    let mut all = Vec::new();
    for iterations in [1, 2, 4, 8] {
        all.push(Solver::QuasiStatic(Minimisation {
            iterations,
            ..TO_TOLERANCE
        }));
    }
    for tolerance in [1e-2, 3e-3, 1e-3, 3e-4, 1e-4] {
        all.push(SolverQuestion::Equilibrium.minimised(1, tolerance));
    }
    all
}

fn implicit_steps(_: &Solver) -> Vec<Solver> {
    let mut all = Vec::new();
    for substeps in [1, 2, 4] {
        for tolerance in [1e-2, 1e-3, 1e-4] {
            all.push(SolverQuestion::Motion.minimised(substeps, tolerance));
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_solver_gives_back_the_values_it_takes() {
        for spec in &SOLVERS {
            let values = spec.values(&spec.default).expect("its own settings");
            assert_eq!(values.len(), spec.keys.len(), "{}", spec.key);
            let mut others = values.clone();
            for value in &mut others {
                match value {
                    KeyValue::Number(number) => *number *= 0.5,
                    KeyValue::Whole(number) => *number += 1,
                    KeyValue::Order(order) => *order = SweepOrder::Reversed,
                    KeyValue::Vector(vector) => *vector *= 2.0,
                    KeyValue::Names(_, chosen) => *chosen ^= 1,
                }
            }
            let other = spec.with(&others);
            assert_eq!(spec.values(&other), Some(others), "{}", spec.key);
            assert!(std::ptr::eq(other.spec(), spec), "{}", spec.key);
            // Control: values of other types change nothing; the comparison above would show it.
            let vectors = vec![KeyValue::Vector(nalgebra::Vector3::zeros()); values.len()];
            assert_eq!(spec.with(&vectors), spec.default, "{}", spec.key);
            for candidate in (spec.candidates)(&SOLVERS[1].default) {
                assert!(std::ptr::eq(candidate.spec(), spec), "{}", spec.key);
            }
        }
    }

    #[test]
    fn a_share_is_found_by_the_key_of_its_effect() {
        let pbd = SolverSpec::named("pbd").expect("there is one").default;
        assert_eq!(
            (pbd.share("bending"), pbd.share("contact")),
            (Some(0.9), None)
        );
        assert_eq!(Solver::default().share("bending"), None);
    }
}
