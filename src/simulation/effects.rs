//! The plan, the cost and the constraints or energies of each effect of [`crate::scene::effects`].

use std::f64::consts::PI;

use super::body::Builder;
use super::plan::{MusclePlan, Planner, obstacle, swept};
use crate::constraints::{Bending, Constraint, EnclosedVolume};
use crate::fibres::anisotropy;
use crate::scene::{ContactEffect, ContactPartners, EffectSpec, Scene};
use crate::solvers::stiffness;

/// The computation of an effect.
pub(super) struct EffectModel {
    /// Key in a scene.
    pub key: &'static str,
    /// Whether the effect is planned for each muscle or once for the scene.
    pub scope: Scope,
    /// Time per element in a sweep, or in a step for contact, measured in the built-in hip on two
    /// cores [ns]. It is only for estimates.
    pub nanoseconds: f64,
    /// Decides whether the effect runs. Called if the scene has the effect and its stiffness is not
    /// zero.
    pub plan: fn(&mut Planner<'_>),
    /// Adds the part of the effect to a muscle; `None` for an effect that changes a number of
    /// another part.
    pub build: Option<fn(&mut Builder<'_>)>,
}

/// The object of an effect.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Scope {
    Muscle,
    Scene,
}

/// Memory of an edge that is kept in its direction [bytes].
const DIRECTION: usize = 128;

/// Every effect, in the order of planning and building.
pub(super) static MODELS: [EffectModel; 9] = [
    EffectModel {
        key: "stretch",
        scope: Scope::Muscle,
        nanoseconds: 5.0,
        plan: |planner| {
            let edges = planner.edges;
            planner.run("stretch", edges, edges * 52);
        },
        build: Some(build_stretch),
    },
    EffectModel {
        key: "bending",
        scope: Scope::Muscle,
        nanoseconds: 14.0,
        plan: |planner| match planner.hinges {
            0 => planner.leave("bending", "no two triangles share an edge"),
            hinges => planner.run("bending", hinges, hinges * 68),
        },
        build: Some(build_bending),
    },
    EffectModel {
        key: "volume",
        scope: Scope::Muscle,
        nanoseconds: 20.0,
        plan: plan_volume,
        build: Some(build_volume),
    },
    EffectModel {
        key: "anisotropy",
        scope: Scope::Muscle,
        // The stiffness of each edge contains it from the start: no own memory, no own time.
        nanoseconds: 0.0,
        plan: plan_anisotropy,
        build: None,
    },
    EffectModel {
        key: "tone",
        scope: Scope::Muscle,
        // It changes the rest lengths of edges in no time. What keeps directions near the pose of the start
        // takes 25 ns an edge, which estimates leave out: they are for motions that leave this pose.
        nanoseconds: 0.0,
        plan: plan_tone,
        build: Some(build_tone),
    },
    EffectModel {
        key: "contact",
        scope: Scope::Muscle,
        nanoseconds: 18.0,
        plan: plan_contact,
        build: None,
    },
    EffectModel {
        key: "fascia",
        scope: Scope::Muscle,
        nanoseconds: 3.0,
        plan: plan_fascia,
        build: Some(|builder| {
            if let Some(fascia) = builder.ties.part() {
                builder.add_part(fascia);
            }
        }),
    },
    EffectModel {
        key: "gravity",
        scope: Scope::Scene,
        nanoseconds: 0.0,
        plan: plan_gravity,
        build: None,
    },
    EffectModel {
        key: "damping",
        scope: Scope::Scene,
        nanoseconds: 0.0,
        plan: plan_damping,
        build: None,
    },
];

impl EffectModel {
    /// The computation of a declared effect.
    pub(super) fn of(spec: &EffectSpec) -> Option<&'static Self> {
        MODELS.iter().find(|model| model.key == spec.key)
    }
}

fn plan_volume(planner: &mut Planner<'_>) {
    let mesh = planner.mesh();
    if mesh.triangles.is_empty() {
        let why = "the body has no triangles that could enclose one";
        return planner.leave("volume", why);
    }
    let (count, triangles) = (mesh.vertices.len(), mesh.triangles.len());
    planner.run("volume", count, count * 52 + triangles * 36);
}

fn plan_anisotropy(planner: &mut Planner<'_>) {
    let strength = planner.scene.effects.anisotropy.map_or(0.0, |a| a.strength);
    let why = if strength == 0.0 {
        "its strength is zero"
    } else if !planner.has_fibres() {
        "the muscle has no fibres"
    } else if !planner.runs("stretch") {
        "it scales stretch, which is left out"
    } else {
        let edges = planner.edges;
        return planner.run("anisotropy", edges, 0);
    };
    planner.leave("anisotropy", why);
}

fn plan_tone(planner: &mut Planner<'_>) {
    let why = if planner.scene.effects.tone == Some(0.0) {
        "its stress is zero"
    } else if !planner.has_fibres() {
        "the muscle has no fibres"
    } else if !planner.runs("stretch") {
        "it shortens what stretch holds, which is left out"
    } else if !planner.encloses_a_volume() {
        "the muscle encloses no volume, so it has no cross-section"
    } else if !planner.is_held_by_two_bones() {
        "fewer than two bones hold the muscle"
    } else if planner.scene.solver.has_classic_stiffness() {
        "classic PBD has no stiffness in N/m against which a stress acts"
    } else {
        let edges = planner.edges;
        return planner.run("tone", edges, edges * DIRECTION);
    };
    planner.leave("tone", why);
}

fn plan_contact(planner: &mut Planner<'_>) {
    let (scene, assets) = (planner.scene, planner.assets);
    let mesh = planner.mesh();
    if mesh.triangles.is_empty() {
        return planner.leave("contact", "the body has no triangles");
    }
    let Some(between) = scene.effects.contact.map(|contact| contact.between) else {
        return;
    };
    plan_meetings(planner, between);
    if !between.bones {
        return planner.leave("contact with bones", "`between` does not name bones");
    }
    if scene.bones.is_empty() {
        return planner.leave("contact with bones", "the scene has no bones");
    }
    let reach = planner.reach();
    let n = mesh.vertices.len();
    for o in 0..scene.bones.len() + scene.capsules.len() {
        let (other, bone, bounds) = obstacle(scene, assets, o);
        let effect = format!("contact with {other}");
        let swept = swept(scene, bone, &bounds);
        if reach.is_none_or(|r| r.intersects(&swept)) {
            let points = assets.bones.get(o).map_or(0, |bone| bone.vertices.len());
            let elements = n + points;
            planner.reaches(o, &effect, elements, n * 96 + elements * 8);
        } else {
            planner.leave(&effect, "the boxes that muscle and bone sweep never meet");
        }
    }
}

fn plan_fascia(planner: &mut Planner<'_>) {
    let is_kept_out = |contact: ContactEffect| contact.between.bones;
    let why = if planner.scene.effects.fascia == Some(0.0) {
        "its stiffness is zero"
    } else if !planner.scene.effects.contact.is_some_and(is_kept_out) {
        "it holds muscles to the bones that `contact` keeps them out of"
    } else if planner.scene.solver.has_classic_stiffness() {
        "classic PBD has no stiffness in N/m"
    } else if !planner.has_obstacles() {
        "no bone is within reach"
    } else {
        let count = planner.mesh().vertices.len();
        return planner.run("fascia", count, count * 72);
    };
    planner.leave("fascia", why);
}

/// Contact of a muscle with itself and with the muscles after it.
fn plan_meetings(planner: &mut Planner<'_>, between: ContactPartners) {
    let (scene, m) = (planner.scene, planner.index());
    let reach = planner.reach();
    let is_near = |other: usize| match (reach, planner.reach_of(other)) {
        (Some(a), Some(b)) => a.intersects(&b),
        _ => true,
    };
    let others = (0..scene.muscles.len()).filter(|other| *other != m);
    let near: Vec<usize> = others.filter(|other| is_near(*other)).collect();
    let is_alone = !between.muscles || near.is_empty();
    if !between.itself {
        planner.leave("contact with itself", "`between` does not name self");
    } else if is_alone && scene.solver.minimisation().is_some() {
        let why =
            "a minimum of energy of one muscle keeps out of bones alone; `solver.xpbd` has it";
        planner.leave("contact with itself", why);
    } else {
        planner.meets(None, "contact with itself");
    }
    for other in m + 1..scene.muscles.len() {
        let effect = format!("contact with {}", scene.muscles[other].name);
        if !between.muscles {
            planner.leave(&effect, "`between` does not name muscles");
        } else if !near.contains(&other) {
            planner.leave(&effect, "the boxes that the muscles sweep never meet");
        } else {
            planner.meets(Some(other), &effect);
        }
    }
}

fn plan_gravity(planner: &mut Planner<'_>) {
    if planner
        .scene
        .effects
        .gravity
        .is_some_and(|g| g.norm() == 0.0)
    {
        return planner.leave("gravity", "its acceleration is zero");
    }
    planner.run("gravity", planner.scene.muscles.len(), 0);
}

fn plan_damping(planner: &mut Planner<'_>) {
    if !planner.scene.effects.damps() {
        planner.leave("damping", "its rate and retardation are zero");
    } else if !planner.scene.solver.has_inertia() {
        planner.leave("damping", "an equilibrium has no velocities");
    } else {
        planner.run("damping", planner.scene.muscles.len(), 0);
    }
}

fn build_stretch(builder: &mut Builder<'_>) {
    match builder.contraction.edges() {
        [] => build_edges(builder, builder.edges),
        contracting => build_edges(builder, contracting),
    }
}

fn build_tone(builder: &mut Builder<'_>) {
    let factors = stretch_factors(builder);
    let stiffness_of = |edge: usize| builder.edge_stiffness[edge] * factors[edge];
    let all = builder.contraction.directions(&builder.rest.mesh.vertices);
    let all = all.map(|(edge, direction, share)| (direction, share * stiffness_of(edge)));
    let (directions, stiffness) = all.unzip();
    builder.add(directions, stiffness);
}

fn build_edges<C: Constraint<2> + 'static>(builder: &mut Builder<'_>, all: &[C]) {
    let factors = stretch_factors(builder);
    if let Some(share) = builder.scene.solver.share("stretch") {
        let relaxation: Vec<f64> = factors.iter().map(|f| f * share).collect();
        return builder.add_relaxed(all.to_vec(), &relaxation);
    }
    let (mut edges, mut stiffness) = (Vec::new(), Vec::new());
    let weighed = builder.edge_stiffness.iter().zip(&factors);
    for (edge, (k, factor)) in all.iter().zip(weighed) {
        // An edge without stiffness (parallel to a fibre, at full strength) is no constraint.
        if k * factor > 0.0 {
            edges.push(*edge);
            stiffness.push(k * factor);
        }
    }
    builder.add(edges, stiffness);
}

/// Factors on the stiffness of edges, from their direction relative to the fibres; 1 without
/// anisotropy.
fn stretch_factors(builder: &Builder<'_>) -> Vec<f64> {
    let is_anisotropic = builder.plan.runs("anisotropy");
    match builder.scene.effects.anisotropy.filter(|_| is_anisotropic) {
        Some(a) => {
            let cosines = builder.fibres.cosines(builder.rest);
            anisotropy::factors(&cosines, a.strength, a.power)
        }
        None => vec![1.0; builder.fibres.points.len()],
    }
}

/// The share of its stiffness that an edge along the fibres has.
pub(super) fn share_along_fibres(scene: &Scene, plan: &MusclePlan) -> f64 {
    let weaker = scene.effects.anisotropy.filter(|_| plan.runs("anisotropy"));
    weaker.map_or(1.0, |a| anisotropy::factor(1.0, a.strength, a.power))
}

fn build_bending(builder: &mut Builder<'_>) {
    let mesh = &builder.rest.mesh;
    let topology = builder.rest.topology();
    let (hinges, k) = stiffness::hinges(mesh, &topology, builder.muscle.material.bending);
    match builder.scene.solver.share("bending") {
        Some(share) => {
            let relaxation = vec![share; hinges.len()];
            builder.add_relaxed(hinges, &relaxation);
        }
        None => {
            let limit = builder.scene.effects.bending.filter(|limit| *limit < PI);
            let limit = limit.unwrap_or(f64::INFINITY);
            let limited = |hinge: Bending| hinge.with_limit(limit);
            builder.add(hinges.into_iter().map(limited).collect(), k);
        }
    }
}

fn build_volume(builder: &mut Builder<'_>) {
    let mesh = &builder.rest.mesh;
    let (count, target) = (mesh.vertices.len(), builder.target_volume);
    builder.volume = Some(match builder.scene.solver.share("volume") {
        Some(share) => {
            EnclosedVolume::new(&mesh.triangles, count, target, 0.0).with_relaxation(share)
        }
        None => {
            let bulk = builder.muscle.material.bulk;
            let compliance = bulk.map_or(0.0, |bulk| builder.rest_volume / bulk);
            EnclosedVolume::new(&mesh.triangles, count, target, compliance)
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::constraints::bending::dihedral;
    use crate::mesh::measures::max_or_nan;
    use crate::scene::builtin::load;
    use crate::scene::effects::EFFECTS;
    use crate::simulation::Simulation;

    /// The sharpest fold of a muscle between plates that close on it [rad].
    fn fold(limit: &str) -> f64 {
        let changes = ["muscle.0.edge_length='20 mm'", "frames=100", limit];
        let scene = load("press", &changes.map(str::to_owned)).expect("a scene");
        let mut run = Simulation::new(scene).expect("meshes");
        (0..60).for_each(|_| run.step_frame());
        let body = &run.bodies[0];
        let x = &body.system.particles.position;
        let topology = crate::mesh::Topology::new(&body.rest);
        let hinges = topology.hinges.iter();
        max_or_nan(hinges.map(|hinge| dihedral(&hinge.map(|v| x[v as usize])).abs()))
    }

    #[test]
    fn a_limit_of_hinges_makes_folds_blunt() {
        let (plain, none) = (fold("frames=100"), fold("effects.bending.limit='180 deg'"));
        let blunt = fold("effects.bending.limit='60 deg'");
        let limit = PI / 3.0;
        assert_eq!(plain, none);
        assert!(plain >= 1.1 * limit, "control: {plain}");
        assert!(blunt <= 1.02 * limit, "{blunt} of {plain}");
    }

    #[test]
    fn every_effect_of_a_scene_has_its_model() {
        let declared: Vec<&str> = EFFECTS.iter().map(|spec| spec.key).collect();
        let modelled: Vec<&str> = MODELS.iter().map(|model| model.key).collect();
        assert_eq!(declared, modelled);
    }
}
