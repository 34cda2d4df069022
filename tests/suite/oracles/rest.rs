//! Bodies of edges and hinges that the crate's equilibrium solvers bring to equilibrium.

use nalgebra::{Point3, Vector3};
use pliant::constraints::{Bending, Distance, EnclosedVolume, Quadratic};
use pliant::solvers::{DescentOutcome, DescentSettings, Energy, Newton, NoContact, QuasiStatic};
use pliant::testing::internals::solvers::Inertia;

use crate::tolerances::{T17, worst};

/// Constraints with a stiffness each, and the forces on the points.
#[derive(Clone)]
pub struct Body {
    pub edges: (Vec<Distance>, Vec<f64>),
    pub hinges: (Vec<Bending>, Vec<f64>),
    /// Fixed points.
    pub held: Vec<usize>,
    /// Constant forces [N], one per point.
    pub forces: Vec<Vector3<f64>>,
    /// Greatest remaining force [N] on a point.
    pub left: f64,
    /// A spring [N/m] from each point to its position. It prevents the drift of a body without
    /// fixed points.
    pub anchor: f64,
}

impl Body {
    /// Edges without fixed points and forces. They are at equilibrium when at most T17 of
    /// `load` remains.
    pub fn new(edges: (Vec<Distance>, Vec<f64>), count: usize, load: f64) -> Self {
        let forces = vec![Vector3::zeros(); count];
        Self {
            edges,
            hinges: (Vec::new(), Vec::new()),
            held: Vec::new(),
            forces,
            left: T17 * load,
            anchor: 0.0,
        }
    }

    fn energy(&self, x: &[Point3<f64>]) -> Energy {
        let mut energy = Energy {
            forces: self.forces.clone(),
            ..Energy::default()
        };
        energy.elastic.push(Box::new(Quadratic::<_, 2>::new(
            self.edges.0.clone(),
            self.edges.1.clone(),
        )));
        if !self.hinges.0.is_empty() {
            energy.elastic.push(Box::new(Quadratic::<_, 4>::new(
                self.hinges.0.clone(),
                self.hinges.1.clone(),
            )));
        }
        energy.inertia = (self.anchor > 0.0).then(|| Inertia {
            weight: vec![self.anchor; x.len()],
            target: x.to_vec(),
        });
        energy
    }

    fn inverse_mass(&self) -> Vec<f64> {
        (0..self.forces.len())
            .map(|i| if self.held.contains(&i) { 0.0 } else { 1.0 })
            .collect()
    }

    /// Equilibrium by Newton's method, to the greatest remaining force.
    pub fn rest(&self, x: &mut [Point3<f64>]) {
        // The anchor moves with the point, so its remaining force falls by its share of the
        // stiffness each time.
        for _ in 0..if self.anchor > 0.0 { 3 } else { 1 } {
            let settings = DescentSettings {
                tolerance: 0.0,
                iterations: 200,
            };
            let mut solver =
                Newton::new(self.energy(x), x, &self.inverse_mass(), settings).expect("memory");
            solver.problem.settings.tolerance = self.left / solver.problem.force_scale();
            let outcome = solver
                .solve(x, &mut NoContact, |_, _| true)
                .expect("nothing moves freely");
            assert!(outcome.converged, "{outcome:?}");
        }
    }

    /// Equilibrium by the constant matrix, with a conserved volume.
    pub fn inflate(&self, x: &mut [Point3<f64>], volume: EnclosedVolume) -> DescentOutcome {
        let settings = DescentSettings {
            tolerance: 0.0,
            iterations: 2000,
        };
        let energy = Energy {
            volumes: vec![volume],
            ..self.energy(x)
        };
        let mut solver =
            QuasiStatic::new(energy, x, &self.inverse_mass(), settings).expect("anchored");
        solver.problem.settings.tolerance = self.left / solver.problem.force_scale();
        let outcome = solver.solve(x, &mut NoContact, |_, _| true);
        assert!(outcome.converged, "{outcome:?}");
        outcome
    }

    /// [`Self::rest`] for edges that keep their lengths, by the method of multipliers. Each
    /// edge is shortened by its excess length until it has its tension at its own length. Returns
    /// the remaining strain.
    pub fn rest_without_stretch(&self, x: &mut [Point3<f64>]) -> f64 {
        let mut body = self.clone();
        body.rest(x);
        let excess = |x: &[Point3<f64>], edge: &Distance| {
            let [a, b] = edge.points.map(|p| x[p as usize]);
            (a - b).norm() - edge.rest
        };
        for _ in 0..4 {
            for (edge, own) in body.edges.0.iter_mut().zip(&self.edges.0) {
                edge.rest -= excess(x, own);
            }
            body.rest(x);
        }
        worst(
            self.edges
                .0
                .iter()
                .map(|own| (excess(x, own) / own.rest).abs()),
        )
    }
}
