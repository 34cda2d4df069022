//! The parts that effects add to a muscle.

use crate::constraints::distance::Distance;
use crate::constraints::{Batch, Constraint, EnclosedVolume, Project};
use crate::constraints::{Potential, Quadratic};
use crate::scene::{Muscle, Scene};
use crate::simulation::contraction::Contraction;
use crate::simulation::effects::MODELS;
use crate::simulation::fascia::Ties;
use crate::simulation::plan::MusclePlan;
use crate::simulation::ready::{Fibres, Rest};
use crate::solvers::stiffness;

/// A muscle under construction. Each effect reads the data of the muscle and adds a part.
pub(in crate::simulation) struct Builder<'a> {
    pub scene: &'a Scene,
    pub muscle: &'a Muscle,
    pub plan: &'a MusclePlan,
    pub rest: &'a Rest,
    pub edges: &'a [Distance],
    /// How its fibres shorten.
    pub contraction: &'a Contraction,
    /// Stiffness of the edges [N/m].
    pub edge_stiffness: &'a [f64],
    pub fibres: &'a Fibres,
    /// What fascia holds.
    pub ties: &'a Ties,
    /// Vertices with prescribed forces or displacements.
    loaded: Vec<u32>,
    /// Target volume [m^3].
    pub target_volume: f64,
    /// Volume at rest [m^3].
    pub rest_volume: f64,
    /// The constraint of the enclosed volume, if it is an effect of the scene.
    pub volume: Option<EnclosedVolume>,
    /// Constraints of a solver that sweeps.
    pub elastic: Vec<Box<dyn Project>>,
    /// Energies of a solver that minimises.
    pub potentials: Vec<Box<dyn Potential>>,
}

impl<'a> Builder<'a> {
    /// A muscle without the parts of any effect.
    pub fn new(
        scene: &'a Scene,
        m: usize,
        plan: &'a MusclePlan,
        rest: &'a Rest,
        (edges, contraction): (&'a [Distance], &'a Contraction),
        edge_stiffness: &'a [f64],
        (fibres, ties): (&'a Fibres, &'a Ties),
    ) -> Self {
        let muscle = &scene.muscles[m];
        let is_closed = rest.topology().is_closed();
        let rest_volume = if is_closed { rest.mesh.volume() } else { 0.0 };
        let pressure = scene.effects.volume.map_or(1.0, |v| v.pressure);
        let is_kept = plan.runs("volume");
        let target_volume = if is_kept { pressure * rest_volume } else { 0.0 };
        Self {
            scene,
            muscle,
            plan,
            rest,
            edges,
            contraction,
            edge_stiffness,
            fibres,
            ties,
            loaded: loaded_vertices(muscle),
            target_volume,
            rest_volume,
            volume: None,
            elastic: Vec::new(),
            potentials: Vec::new(),
        }
    }

    /// Adds the part of each effect that runs.
    pub fn build(&mut self) {
        for model in &MODELS {
            if let Some(build) = model.build.filter(|_| self.plan.runs(model.key)) {
                build(self);
            }
        }
    }

    /// Adds constraints with their stiffness, as a batch or as an energy, depending on the solver.
    pub fn add<C: Constraint<K> + 'static, const K: usize>(
        &mut self,
        constraints: Vec<C>,
        stiffness: Vec<f64>,
    ) {
        if self.scene.solver.minimisation().is_none() {
            let compliance = stiffness::compliance(&stiffness);
            let batch = self.batch(constraints, compliance);
            self.elastic.push(Box::new(batch));
        } else if !constraints.is_empty() {
            let energy = Quadratic::<C, K>::new(constraints, stiffness);
            self.potentials.push(Box::new(energy));
        }
    }

    /// Adds a part that is both a constraint and an energy.
    pub fn add_part(&mut self, part: impl Project + Potential + 'static) {
        if self.scene.solver.minimisation().is_none() {
            self.elastic.push(Box::new(part));
        } else {
            self.potentials.push(Box::new(part));
        }
    }

    /// Adds constraints that are projected with a relaxation factor each, 0..1.
    pub fn add_relaxed<C: Constraint<K> + 'static, const K: usize>(
        &mut self,
        constraints: Vec<C>,
        relaxation: &[f64],
    ) {
        let compliance = vec![0.0; constraints.len()];
        let batch = self.batch(constraints, compliance);
        self.elastic
            .push(Box::new(batch.with_relaxation(relaxation)));
    }

    fn batch<C: Constraint<K>, const K: usize>(
        &self,
        constraints: Vec<C>,
        compliance: Vec<f64>,
    ) -> Batch<C, K> {
        let count = self.rest.mesh.vertices.len();
        let numbering = self.rest.numbering();
        let order = self.scene.solver.order();
        let particles = (&*numbering, count);
        Batch::numbered(constraints, compliance, order, particles, &self.loaded)
    }
}

fn loaded_vertices(muscle: &Muscle) -> Vec<u32> {
    let forces = muscle.forces.iter().flat_map(|f| &f.vertices);
    let displaced = muscle.displacements.iter().flat_map(|d| &d.vertices);
    forces.chain(displaced).copied().collect()
}
