//! Shortening of the fibres of a muscle over time, by activation and by tone.
//!
//! A surface keeps its length, so a muscle that shortens would buckle. A living muscle does not: its
//! fibres keep some tension. Activation shortens the rest lengths along the fibres as the scene says.
//! Tone shortens slack fibres until they are stretched by the strain at which the stress of the scene
//! acts. The muscle was measured under its tone, so tone moves nothing in that pose of its bones: there
//! it only keeps fibres in their directions.

use nalgebra::{Matrix3, Point3, Vector3};

use super::effects::share_along_fibres;
use super::fault::Fault;
use super::fibres::Ends;
use super::ready::{Fibres, Rest};
use crate::constraints::distance::Distance;
use crate::constraints::{Constraint, Direction, FibreDistance};
use crate::contact::PosedObstacle;
use crate::scene::{Muscle, Scene, smooth_step};
use crate::simulation::plan::MusclePlan;
use crate::state::{DecodeError, Reader, State, Writer};

/// Greatest strain of tone. A surface that is stretched more has another shape at rest.
const MOST_STRAIN: f64 = 0.25;

/// Greatest shortening by tone; muscles shorten by half at most.
const MOST: f64 = 0.5;

/// Tone is whole where one end has moved from the other by this share of its strain, relative to the
/// length of the muscle. If it began later, the fibres would buckle first.
const WHOLE_FROM: f64 = 0.5;

/// The name of activation in a plan.
pub(super) const ACTIVATION: &str = "activation";

/// Exponent of the cosine: the share of an edge is the square.
const SQUARE: i32 = 2;

/// A determinant below this share of the squared sum of lengths: all edges have one direction.
const SINGULAR: f64 = 1e-6;

/// The shortening of a muscle's fibres.
#[derive(Clone, Debug, Default)]
pub(super) struct Contraction {
    /// The edges, with their shares of the shortening; empty without activation and tone.
    edges: Vec<FibreDistance>,
    /// Shortening by activation, by frame.
    keys: Vec<(f64, f64)>,
    tone: Option<Tone>,
    /// The edges along fibres as they were measured; empty without tone.
    measured: Vec<Measured>,
}

/// The direction of an edge when the muscle was measured.
#[derive(Clone, Copy, Debug)]
struct Measured {
    /// Place among the edges.
    edge: usize,
    /// Its parts, each in the frame of the bone at one end of the muscle.
    parts: [Vector3<f64>; 2],
}

/// The tone of a muscle.
#[derive(Clone, Debug)]
struct Tone {
    /// Strain of the fibres under tone.
    strain: f64,
    /// The bones at both ends.
    bones: [usize; 2],
    /// The centre of the second end in its bone, and at rest in that of the first end [m].
    end: [Point3<f64>; 2],
    /// Length of the muscle [m].
    length: f64,
    /// Shortening at the start and at the end of the present frame.
    shortening: [f64; 2],
}

impl Contraction {
    /// The shortening of a muscle; `edges` are at rest, `placed` the obstacles in the first frame.
    ///
    /// # Errors
    /// A tone that stretches the muscle too much, or one without two ends.
    pub(super) fn new(
        scene: &Scene,
        muscle: &Muscle,
        plan: &MusclePlan,
        rest: &Rest,
        (edges, stiffness): (&[Distance], &[f64]),
        fibres: &Fibres,
        (ends, placed): (Option<&Ends>, &[PosedObstacle]),
    ) -> Result<Self, Fault> {
        let is_active = plan.runs(ACTIVATION);
        if !is_active && !plan.runs("tone") {
            return Ok(Self::default());
        }
        let tone = match scene.effects.tone.filter(|_| plan.runs("tone")) {
            Some(stress) => {
                let strain = strain_under(stress, scene, muscle, plan, rest)?;
                Some(Tone::new(strain, ends, placed, rest.mesh.length())?)
            }
            None => None,
        };
        let cosines = fibres.cosines(rest);
        let along = |(edge, cosine): (&Distance, &Option<f64>)| {
            FibreDistance::new(*edge, cosine.map_or(0.0, |cosine| cosine.powi(SQUARE)))
        };
        let keys = muscle.activation.iter().filter(|_| is_active);
        let edges: Vec<FibreDistance> = edges.iter().zip(&*cosines).map(along).collect();
        let measured = match (&tone, ends) {
            (Some(_), Some(ends)) => {
                measured((&edges, stiffness), &rest.mesh.vertices, ends, placed)
            }
            _ => Vec::new(),
        };
        Ok(Self {
            edges,
            keys: keys.copied().collect(),
            tone,
            measured,
        })
    }

    /// What keeps edges in their directions near the pose of the measurement, at `x` [m]: the place of each
    /// among the edges, and the share of its stiffness that is the tension of the tone over the length.
    pub(super) fn directions(
        &self,
        x: &[Point3<f64>],
    ) -> impl Iterator<Item = (usize, Direction, f64)> {
        let strain = self.tone.as_ref().map_or(0.0, |tone| tone.strain);
        let share = strain / (1.0 + strain);
        self.measured.iter().map(move |measured| {
            let edge = &self.edges[measured.edge];
            let points = edge.points();
            let [p, q] = points.map(|p| x[p as usize]);
            let along = (p - q).normalize();
            let direction = Direction { points, along };
            (measured.edge, direction, edge.along() * share)
        })
    }

    /// The directions in which edges are kept in a step among the obstacles `placed`; empty where none
    /// is: without tone, and far from the pose of the measurement.
    pub(super) fn turned(&self, placed: &[PosedObstacle]) -> Vec<Vector3<f64>> {
        let Some(tone) = &self.tone else {
            return Vec::new();
        };
        let left = 1.0 - tone.share(placed);
        if !(left > 0.0) {
            return Vec::new();
        }
        let [first, last] = tone.bones.map(|bone| {
            let turn: Matrix3<f64> = placed[bone].now.rotation.to_rotation_matrix().into();
            turn * left.sqrt()
        });
        let turn = |measured: &Measured| first * measured.parts[0] + last * measured.parts[1];
        self.measured.iter().map(turn).collect()
    }

    /// The edges, with their shares of the shortening; empty without activation and tone.
    pub(super) fn edges(&self) -> &[FibreDistance] {
        &self.edges
    }

    /// Begins a frame at positions `x` [m]; `placed` are the obstacles at its end.
    pub(super) fn begin_frame(
        &mut self,
        x: &[Point3<f64>],
        inverse_mass: &[f64],
        placed: &[PosedObstacle],
    ) {
        let Some(tone) = &mut self.tone else { return };
        // An edge between two held vertices does not show what the fibres do.
        let is_free =
            |e: &&FibreDistance| e.points().iter().any(|&p| inverse_mass[p as usize] > 0.0);
        let strain = fibre_strain(self.edges.iter().filter(is_free), x);
        tone.follow(strain, placed);
    }

    /// The shortening at a time [frames], when the share `done` of the present frame has passed; `None`
    /// without activation and tone.
    pub(super) fn at(&self, time: f64, done: f64) -> Option<f64> {
        let [from, to] = self.tone.as_ref().map_or([0.0; 2], |tone| tone.shortening);
        let tone = from + done * (to - from);
        (!self.edges.is_empty()).then(|| tone.max(activation(&self.keys, time)))
    }

    /// Takes over the state of the same muscle in another simulation.
    pub(super) fn continue_from(&mut self, other: &Self) {
        if let (Some(tone), Some(other)) = (&mut self.tone, &other.tone) {
            tone.shortening = [other.shortening[1]; 2];
        }
    }
}

impl Tone {
    fn new(
        strain: f64,
        ends: Option<&Ends>,
        placed: &[PosedObstacle],
        length: f64,
    ) -> Result<Self, Fault> {
        let Some(ends) = ends else {
            let why = "one bone holds all attached vertices".to_owned();
            return Err(Fault::NoFibres { why });
        };
        let in_bone = |bone: usize| placed[bone].now.inverse_transform_point(&ends.centres[1]);
        let [first, last] = ends.bones;
        Ok(Self {
            strain,
            bones: ends.bones,
            end: [in_bone(first), in_bone(last)],
            length,
            shortening: [0.0; 2],
        })
    }

    /// How far the bones at both ends are from the pose of the measurement: 1 where tone is whole.
    fn share(&self, placed: &[PosedObstacle]) -> f64 {
        let [first, last] = self.bones.map(|bone| placed[bone].now);
        let moved = first.inverse_transform_point(&(last * self.end[1])) - self.end[0];
        let share = moved.norm() / (WHOLE_FROM * self.strain * self.length);
        if share < 1.0 { smooth_step(share) } else { 1.0 }
    }

    /// Begins a frame with the strain of the fibres that the last one left.
    fn follow(&mut self, strain: f64, placed: &[PosedObstacle]) {
        let end = self.share(placed) * (1.0 - (1.0 + strain) / (1.0 + self.strain));
        // Without a number, the shortening stays.
        let end = if end.is_nan() {
            self.shortening[1]
        } else {
            end.clamp(0.0, MOST)
        };
        self.shortening = [self.shortening[1], end];
    }
}

/// The directions at rest, at `x` [m], of the edges that have a stiffness [N/m] and a share of the tone.
/// Each bone has a part, by the distance of the edge from both ends.
fn measured(
    (edges, stiffness): (&[FibreDistance], &[f64]),
    x: &[Point3<f64>],
    ends: &Ends,
    placed: &[PosedObstacle],
) -> Vec<Measured> {
    let axis = ends.centres[1] - ends.centres[0];
    let back = ends.bones.map(|bone| placed[bone].now.rotation.inverse());
    let of = |(edge, fibre): (usize, &FibreDistance)| {
        let [p, q] = fibre.points().map(|p| x[p as usize]);
        let has_tone = fibre.along() * stiffness[edge] > 0.0;
        let along = (p - q).try_normalize(0.0).filter(|_| has_tone)?;
        let share = (nalgebra::center(&p, &q) - ends.centres[0]).dot(&axis) / axis.norm_squared();
        let share = if share.is_nan() {
            0.5
        } else {
            share.clamp(0.0, 1.0)
        };
        let parts = [back[0] * along * (1.0 - share), back[1] * along * share];
        Some(Measured { edge, parts })
    };
    edges.iter().enumerate().filter_map(of).collect()
}

/// The strain of the fibres of a muscle at which a stress [Pa] acts along them.
fn strain_under(
    stress: f64,
    scene: &Scene,
    muscle: &Muscle,
    plan: &MusclePlan,
    rest: &Rest,
) -> Result<f64, Fault> {
    // Stress times cross-section is the tension of the surface times its girth.
    let width = rest.mesh.volume() / rest.mesh.area();
    let stiffness = share_along_fibres(scene, plan) * muscle.material.stretch;
    let strain = stress * width / stiffness;
    if strain <= MOST_STRAIN {
        return Ok(strain);
    }
    let [percent, most] = [100.0 * strain, 100.0 * MOST_STRAIN];
    Err(Fault::TooMuchTone {
        stress,
        percent,
        most,
    })
}

/// The shortening by activation at a time [frames].
fn activation(keys: &[(f64, f64)], time: f64) -> f64 {
    let next = keys.partition_point(|(frame, _)| *frame <= time);
    let before = next.checked_sub(1).map(|k| keys[k]);
    match (before, keys.get(next).copied()) {
        (None, None) => 0.0,
        (Some((_, only)), None) | (None, Some((_, only))) => only,
        (Some((start, from)), Some((end, to))) => {
            from + smooth_step((time - start) / (end - start)) * (to - from)
        }
    }
}

/// The mean strain along the fibres: that which explains the strains of the edges best, beside one
/// across the fibres, by least squares over the lengths of the edges. 0 if no edge has both.
fn fibre_strain<'a>(edges: impl Iterator<Item = &'a FibreDistance>, x: &[Point3<f64>]) -> f64 {
    let [mut aa, mut ac, mut cc, mut ar, mut cr, mut all] = [0.0; 6];
    for edge in edges {
        let [p, q] = edge.points().map(|p| x[p as usize]);
        let (along, across) = (edge.along(), 1.0 - edge.along());
        // The change of length is the strain times the length.
        let change = (p - q).norm() - edge.rest();
        aa += along * along * edge.rest();
        ac += along * across * edge.rest();
        cc += across * across * edge.rest();
        ar += along * change;
        cr += across * change;
        all += edge.rest();
    }
    let determinant = aa * cc - ac * ac;
    if determinant <= SINGULAR * all * all {
        return 0.0;
    }
    (ar * cc - cr * ac) / determinant
}

impl State for Contraction {
    fn save(&self, to: &mut Writer) {
        let Self {
            edges: _,
            keys: _,
            tone,
            measured: _,
        } = self;
        to.put(&tone.as_ref().map(|tone| tone.shortening[1]));
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError> {
        let shortening: Option<f64> = from.take()?;
        let is_known = shortening.is_none_or(|s| (0.0..=MOST).contains(&s));
        let is_due = shortening.is_some() == self.tone.is_some();
        from.check(
            is_known && is_due,
            "a shortening that the muscle cannot have",
        )?;
        if let (Some(tone), Some(shortening)) = (&mut self.tone, shortening) {
            tone.shortening = [shortening; 2];
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::mesh::TriangleMesh;
    use crate::mesh::shapes::{icosphere, tube};
    use crate::mesh::topology::Topology;
    use crate::scene::{Surroundings, parse_with};
    use crate::simulation::Simulation;
    use crate::testing::Scratch;

    #[test]
    fn activation_is_smooth_between_its_keys_and_constant_outside_them() {
        let keys = [(10.0, 0.1), (20.0, 0.3), (40.0, 0.0)];
        let at = |time: f64| activation(&keys, time);
        assert_eq!(
            [0.0, 10.0, 20.0, 40.0, 99.0].map(at),
            [0.1, 0.1, 0.3, 0.0, 0.0]
        );
        assert!((at(15.0) - 0.2).abs() <= 1e-15);
        // No speed at a key; control: there is one between keys.
        let speed = |time: f64| (at(time + 1e-4) - at(time - 1e-4)) / 2e-4;
        assert!(speed(20.0).abs() <= 1e-7 && speed(15.0) > 0.03);
        assert_eq!(activation(&[], 3.0), 0.0);
    }

    #[test]
    fn the_strain_of_a_stretched_body_is_found_along_its_fibres() {
        let mesh = icosphere(0.05, 2);
        let fibre = Vector3::new(2.0, -1.0, 0.5).normalize();
        let x = &mesh.vertices;
        let edge = |&[a, b]: &[u32; 2]| {
            let along = x[b as usize] - x[a as usize];
            let rest = along.norm();
            let edge = Distance {
                points: [a, b],
                rest,
            };
            FibreDistance::new(edge, (along.dot(&fibre) / rest).powi(SQUARE))
        };
        let edges: Vec<FibreDistance> = Topology::new(&mesh).edges.iter().map(edge).collect();
        let stretched = |along: f64, across: f64| -> Vec<Point3<f64>> {
            let each = x.iter().map(|p| {
                let part = fibre * p.coords.dot(&fibre);
                Point3::from(part * (1.0 + along) + (p.coords - part) * (1.0 + across))
            });
            each.collect()
        };
        for (along, across) in [(0.01, 0.0), (-0.01, 0.005), (0.0, 0.01)] {
            let found = fibre_strain(edges.iter(), &stretched(along, across));
            // The error is of second order in the strains.
            assert!((found - along).abs() <= 1e-4, "{along} {across}: {found}");
        }
        assert_eq!(fibre_strain(edges.iter().take(1), x), 0.0);
        let none = [edges[0]; 3];
        assert_eq!(fibre_strain(none.iter(), &stretched(0.1, 0.0)), 0.0);
    }

    /// A straight muscle of 2 cm by 10 cm between two plates that approach each other by 5 mm, under a
    /// tone [kPa].
    fn held(stress: f64, stiffness: f64) -> Result<Simulation, String> {
        let scratch = Scratch::folder();
        let put = |name: &str, mesh: &TriangleMesh| {
            let encoding = crate::io::Encoding::Text;
            crate::io::write(&scratch.join(name), mesh, &[], encoding).expect("a mesh");
        };
        put("muscle.vtk", &tube(0.01, 0.1, 16));
        put(
            "plate.vtk",
            &crate::mesh::shapes::box_surface([0.01, 0.04, 0.04], 0.02),
        );
        let plate = |name: &str, from: f64, to: f64| {
            format!(
                "[[bone]]\nname = '{name}'\nmesh = 'plate.vtk'\nunit = 'm'\n[bone.motion]\n\
                 keys = [{{ frame = 0, translation = ['{from} m', '0 m', '0 m'] }},
                 {{ frame = 20, translation = ['{to} m', '0 m', '0 m'] }}]\n"
            )
        };
        let text = format!(
            "frames = 40\nframe_rate = '60 Hz'\n{}{}[[muscle]]\nname = 'm'\nmesh = 'muscle.vtk'\nunit = 'm'
            [muscle.material]\nstretch = '{stiffness} N/m'
            [[muscle.attachment]]\nbone = 'low'\nnear = '0.2 mm'\nlimit = '20 %'
            [[muscle.attachment]]\nbone = 'high'\nnear = '0.2 mm'\nlimit = '20 %'
            [muscle.fibres]\nmethod = 'harmonic'\n[effects.stretch]\n[effects.volume]
            [effects.tone]\nstress = '{stress} kPa'\n[solver.quasi_static]\n",
            plate("low", -0.0551, -0.0551),
            plate("high", 0.0551, 0.0501),
        );
        let around = Surroundings {
            ..Surroundings::of(&scratch)
        };
        let scene = parse_with(&text, "tone.toml", &around).map_err(|e| e.terse())?;
        Simulation::new(scene).map_err(|e| e.to_string())
    }

    /// The force along x on the held vertices of one end [N], by the muscle and its pressure.
    fn pull(sim: &mut Simulation) -> f64 {
        let body = &mut sim.bodies[0];
        let x = body.system.particles.position.clone();
        let low: Vec<u32> = body
            .attached
            .iter()
            .filter(|a| a.1 == 0)
            .map(|a| a.0)
            .collect();
        let equilibrium = body.equilibrium_mut().expect("an equilibrium");
        let pressure = equilibrium.outcome.pressure;
        let energy = equilibrium.energy_mut();
        let mut gradient = vec![Vector3::zeros(); x.len()];
        for part in &energy.elastic {
            part.energy_and_gradient(&x, &mut gradient);
        }
        for volume in &energy.volumes {
            for (v, g) in volume.value_and_gradient(&x).1.iter().enumerate() {
                gradient[v] -= g * pressure;
            }
        }
        -low.iter().map(|&v| gradient[v as usize].x).sum::<f64>()
    }

    /// Energy [J] of the part that keeps directions, for the body at `x` [m] among bones at `placed`.
    fn of_directions(sim: &mut Simulation, x: &[Point3<f64>], placed: &[PosedObstacle]) -> f64 {
        let body = &mut sim.bodies[0];
        let along = body.contraction.turned(placed);
        let equilibrium = body.equilibrium_mut().expect("an equilibrium");
        let parts = equilibrium.energy_mut().elastic.iter_mut();
        let mut part = parts.filter(|part| part.name() == Direction::NAME);
        let part = part.next().expect("directions");
        part.turn(&along);
        part.energy(x)
    }

    /// A cord under the tension T that bends aside by A sin(pi x / L) has the energy T (pi A)^2 / 4 L.
    #[test]
    fn a_muscle_where_it_was_measured_resists_a_bend_as_a_cord_under_its_tone() {
        let mut sim = held(1.0, 300.0).expect("a muscle");
        let (placed, rest) = (sim.placed.clone(), sim.bodies[0].rest.vertices.clone());
        let (radius, length, most) = (0.01, 0.1, 1e-3);
        let aside = |x: &Point3<f64>| {
            let phase = std::f64::consts::PI * (x.x / length + 0.5);
            x + Vector3::y() * (most * phase.sin())
        };
        let bent: Vec<Point3<f64>> = rest.iter().map(aside).collect();
        let pi = std::f64::consts::PI;
        let tension = 1000.0 * pi * radius * radius;
        let cord = tension * (pi * most).powi(2) / (4.0 * length);
        let found = of_directions(&mut sim, &bent, &placed);
        assert!((found / cord - 1.0).abs() <= 0.25, "{found} {cord}");
        // Control: at rest there is none, to rounding.
        let at_rest = of_directions(&mut sim, &rest, &placed);
        assert!(at_rest <= 1e-20 * cord, "{at_rest}");
    }

    #[test]
    fn directions_turn_with_the_bones_and_end_far_from_the_pose_of_the_measurement() {
        let mut sim = held(1.0, 300.0).expect("a muscle");
        let rest = sim.bodies[0].rest.vertices.clone();
        let turn = nalgebra::Isometry3::rotation(Vector3::new(0.3, -1.1, 0.4));
        let with = |sim: &Simulation, poses: [nalgebra::Isometry3<f64>; 2]| {
            let each = sim.placed.iter().zip(poses);
            let moved =
                |(placed, pose): (&PosedObstacle, nalgebra::Isometry3<f64>)| PosedObstacle {
                    now: pose * placed.now,
                    ..placed.clone()
                };
            each.map(moved).collect::<Vec<PosedObstacle>>()
        };
        let together = with(&sim, [turn; 2]);
        let turned: Vec<Point3<f64>> = rest.iter().map(|x| turn * x).collect();
        let found = of_directions(&mut sim, &turned, &together);
        // Control: those that stay behind.
        let control = of_directions(&mut sim, &rest, &together);
        assert!(
            found <= 1e-20 * control && control > 0.0,
            "{found} {control}"
        );
        let apart = nalgebra::Isometry3::translation(0.02, 0.0, 0.0);
        let far = with(&sim, [nalgebra::Isometry3::identity(), apart]);
        assert!(sim.bodies[0].contraction.turned(&far).is_empty());
        assert_eq!(of_directions(&mut sim, &turned, &far), 0.0);
    }

    /// The surface that becomes shorter and wider resists as well, at any tone alike.
    #[test]
    fn a_tone_pulls_with_its_stress_times_the_cross_section() {
        let area = std::f64::consts::PI * 0.01 * 0.01;
        let mut pull = |stress: f64| {
            let mut sim = held(stress, 300.0).expect("a muscle");
            (0..40).for_each(|_| sim.step_frame());
            pull(&mut sim)
        };
        let pulls = [0.5, 1.0, 2.0].map(&mut pull);
        for (more, less, stress) in [(1, 0, 500.0), (2, 1, 1000.0)] {
            let share = (pulls[more] - pulls[less]) / (stress * area);
            assert!((0.8..=1.1).contains(&share), "{pulls:?}");
        }
        // A stress that the surface cannot bear is refused.
        let refused = held(1.0, 10.0).err().expect("a refusal");
        assert!(refused.contains("more than 25 %"), "{refused}");
    }
}
