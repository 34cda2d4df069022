//! The motion of a muscle as an anatomist judges it: jitter, snaps, distance from bones, thickness,
//! folds.

mod worst;

use std::collections::{BTreeMap, VecDeque};

use nalgebra::{Isometry3, Point3, Vector3};
use serde::Serialize;

use super::output::Verdict;
use pliant::contact::{Obstacle, Surface};
use pliant::mesh::measures::{max_or_nan, quantile};
use pliant::mesh::{Topology, TriangleMesh};
use pliant::scene::Limits;
use pliant::simulation::{Body, Simulation};
use pliant::state::{DecodeError, Reader, Writer};
pub use worst::Worst;
use worst::{Found, located};

/// Number of frames of a mean, odd.
const WINDOW: usize = 7;

/// What holds a muscle moves steadily if it departs from its own mean by at most this share of its
/// way in the window: a turn by 0.01 rad a frame departs by 0.003 of it.
const STEADY: f64 = 0.01;

/// Thickness and distance from bones are measured in every frame with a multiple of this number.
const EVERY: usize = 10;

/// Vertices lie on a bone that are nearer than this at rest, relative to the length of the muscle:
/// 4 mm of a muscle of 27 cm.
const ON_BONE: f64 = 0.015;

/// A muscle passes a bone that holds none of it within this share of its length.
const BESIDE: f64 = 0.25;

/// Share of the vertices on bones that have lifted off less than the given distance.
const MOST: f64 = 0.95;

/// Share of the vertices whose thickness is above the least one that is compared: rims taper to
/// nothing at rest.
const THIN: f64 = 0.01;

/// A ray into the muscle begins at this depth, relative to the median edge.
const BELOW: f64 = 1e-6;

/// Of a hinge that is sharper at rest only the growth of its angle counts [deg]. It is ten degrees
/// below the usual limit: the tips and rims of a muscle are sharp, and turn by a few degrees.
const SHARP: f64 = 50.0;

/// Advice for a motion that is not smooth.
const SMOOTHER: &str = "use smooth keys, a higher `effects.damping.retardation` or `rate`, or \
                        `[effects.tone]`; `[limits]` changes the limit";
/// Advice for a muscle that leaves its bone.
const TAUTER: &str = "use `[effects.tone]` or `[muscle.activation]`, or hold more of it (`limit`); \
                      `[limits]` changes the limit";
/// Advice for a muscle that is deformed too much.
const STIFFER: &str = "use a shorter `edge_length`, a lower `bending.limit`, or a greater `stretch` \
                       or `bending`; `[limits]` changes the limit";

/// The measures of a muscle over a run; `None` for what cannot be measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Quality {
    /// Greatest distance of a free vertex from its mean over seven frames, beyond that of what holds
    /// the muscle, in frames in which this moves steadily [m].
    pub jitter_m: Option<f64>,
    /// Greatest speed of a free vertex, relative to the greatest one of a vertex that a bone holds.
    pub snap_ratio: Option<f64>,
    /// Growth of the distance from the nearest bone that 95 % of the vertices on bones at rest have
    /// at most, in the worst frame [m]. Vertices with another muscle between do not count. Of a bone that
    /// does not hold the muscle counts what is farther from the straight line between both ends, too.
    pub lift_off_m: Option<f64>,
    /// Thickness that 1 % of the free vertices have at most, least over the frames, relative to that
    /// at rest.
    pub thickness_ratio_min: Option<f64>,
    /// Greatest angle between the normals of two triangles with a free vertex [deg], without what it
    /// has at rest beyond 50 degrees.
    pub hinge_max_deg: Option<f64>,
}

/// The quality of the muscles of a run, gathered frame by frame.
#[derive(Debug, Default)]
pub struct RunQuality {
    muscles: Vec<Watched>,
    /// The last frame.
    last: Option<usize>,
}

/// A muscle.
#[derive(Debug, Default)]
struct Watched {
    /// Hinges with a free vertex, each with the part of its angle at rest that does not count [deg].
    hinges: Vec<([u32; 4], f64)>,
    /// Free vertices on a bone.
    on_bone: Vec<OnBone>,
    /// Thickness at rest [m].
    thick: Option<f64>,
    /// The last positions [m].
    recent: VecDeque<Vec<Point3<f64>>>,
    /// Greatest motion of a held vertex in a frame [m].
    held: f64,
    /// That of a held vertex in the whole motion of its bone, of which a run can make a part.
    scheduled: f64,
    worst: Worst,
}

/// A free vertex on a bone at rest.
#[derive(Clone, Copy, Debug)]
struct OnBone {
    vertex: u32,
    /// The bone.
    bone: usize,
    /// Its distance from the bone at rest [m].
    at_rest: f64,
    /// How far it lies beyond the straight line between both ends of the muscle, away from the bone, at rest
    /// [m], for a bone that the muscle passes here. There it leaves the bone as it gets straight.
    beyond: Option<f64>,
}

impl RunQuality {
    /// Prepares the muscles at rest.
    fn begin(&mut self, simulation: &Simulation) {
        self.muscles = simulation.bodies.iter().map(Watched::default_of).collect();
        let surfaces: Vec<Surface> = simulation.bodies.iter().map(at_rest).collect();
        for (k, body) in simulation.bodies.iter().enumerate() {
            let x = &body.rest.vertices;
            let watched = &mut self.muscles[k];
            watched.scheduled = scheduled(simulation, body);
            watched.thick = thickness(body, x, &surfaces[k]).map(|(thick, _)| thick);
            let bones = Bones::of(simulation, 0);
            let free = (0..x.len()).filter(|&v| body.is_free(v));
            // Without contact with bones nothing keeps a muscle near them.
            let touches = !simulation.plan.muscles[k].obstacles.is_empty();
            let ends = ends(body, x);
            let near = free.filter(|_| touches).filter_map(|v| {
                let (at_rest, _, bone) = bones.nearest(&x[v])?;
                if !(at_rest <= ON_BONE * body.length) {
                    return None;
                }
                let is_held = |&(other, by): &(u32, usize)| {
                    by == bone && (x[other as usize] - x[v]).norm() <= BESIDE * body.length
                };
                let passed = ends.as_ref().filter(|_| !body.attached.iter().any(is_held));
                Some(OnBone {
                    vertex: v as u32,
                    bone,
                    at_rest,
                    beyond: passed.and_then(|ends| bones.beyond_line(bone, &x[v], ends)),
                })
            });
            watched.on_bone = near.collect();
        }
    }

    /// Adds the present frame.
    pub fn frame(&mut self, simulation: &Simulation) {
        if self.muscles.is_empty() {
            self.begin(simulation);
        }
        let frame = simulation.frame();
        for (watched, body) in self.muscles.iter_mut().zip(&simulation.bodies) {
            if body.stopped.is_none() && !body.rest.triangles.is_empty() {
                watched.add(body, frame);
            }
        }
        if frame.is_multiple_of(EVERY) {
            self.examine(simulation);
        }
        self.last = Some(frame);
    }

    /// Examines the last frame if it has not been.
    pub fn finish(&mut self, simulation: &Simulation) {
        if self.last.is_some_and(|frame| !frame.is_multiple_of(EVERY)) {
            self.examine(simulation);
        }
    }

    /// Measures thickness and distance from bones.
    fn examine(&mut self, simulation: &Simulation) {
        let (bodies, frame) = (&simulation.bodies, simulation.frame());
        let surfaces: Vec<Surface> = bodies.iter().map(now).collect();
        let bones = Bones::of(simulation, simulation.frame());
        for (k, (watched, body)) in self.muscles.iter_mut().zip(bodies).enumerate() {
            if body.stopped.is_some() {
                continue;
            }
            let x = &body.system.particles.position;
            if let Some((thin, vertex)) = thickness(body, x, &surfaces[k]) {
                Found::of(thin, vertex, frame, x).keep_least(&mut watched.worst.thinnest);
            }
            let ends = ends(body, x);
            let lifted = watched.on_bone.iter().filter_map(|on| {
                let from = &x[on.vertex as usize];
                let (distance, to, _) = bones.nearest(from)?;
                let lift = distance - on.at_rest;
                let now = ends
                    .as_ref()
                    .map(|ends| bones.beyond_line(on.bone, from, ends));
                let lift = match on.beyond.zip(now.flatten()) {
                    Some((at_rest, now)) => {
                        let most = max_or_nan([now - at_rest, 0.0]);
                        if most <= lift { most } else { lift }
                    }
                    None => lift,
                };
                let others = surfaces.iter().enumerate().filter(|(other, _)| *other != k);
                let is_between = |surface: &Surface| is_hit(surface, from, &(to - from));
                let is_covered = others.into_iter().any(|(_, surface)| is_between(surface));
                Some((if is_covered { 0.0 } else { lift }, on.vertex))
            });
            if let Some((lift, vertex)) = at_quantile(lifted.collect(), MOST) {
                Found::of(lift, vertex, frame, x).keep_greatest(&mut watched.worst.lift);
            }
        }
    }

    /// The measures of each muscle.
    pub fn of_muscles(&self) -> Vec<Quality> {
        self.muscles.iter().map(Watched::quality).collect()
    }

    /// The worst values of a muscle, with their places.
    pub fn worst(&self, muscle: usize) -> Worst {
        let watched = self.muscles.get(muscle);
        watched.map_or_else(Worst::default, |watched| watched.worst)
    }

    /// Writes what later frames depend on.
    pub(super) fn save(&self, to: &mut Writer) {
        to.put(&self.last);
        for watched in &self.muscles {
            let recent = watched.recent.iter().flatten();
            let coordinates: Vec<f64> = recent.flat_map(|p| [p.x, p.y, p.z]).collect();
            to.put(&watched.recent.len());
            to.put(&coordinates);
            to.put(&watched.held);
            to.put(&watched.worst);
        }
    }

    /// Reads it for the muscles of `simulation`.
    ///
    /// # Errors
    /// The bytes are damaged, or of other muscles.
    pub(super) fn open(
        from: &mut Reader<'_>,
        simulation: &Simulation,
    ) -> Result<Self, DecodeError> {
        let mut all = Self {
            last: from.take()?,
            ..Self::default()
        };
        if all.last.is_none() {
            return Ok(all);
        }
        all.begin(simulation);
        for (watched, body) in all.muscles.iter_mut().zip(&simulation.bodies) {
            let frames: usize = from.take()?;
            let coordinates: Vec<f64> = from.take()?;
            let count = body.rest.vertices.len();
            let is_whole = frames <= WINDOW && coordinates.len() == 3 * frames * count;
            from.check(is_whole, "positions of another muscle")?;
            let points: Vec<Point3<f64>> = coordinates
                .chunks_exact(3)
                .map(|p| Point3::new(p[0], p[1], p[2]))
                .collect();
            watched.recent = points.chunks(count.max(1)).map(<[_]>::to_vec).collect();
            watched.held = from.take()?;
            watched.worst = from.take()?;
        }
        Ok(all)
    }
}

impl Watched {
    fn default_of(body: &Body) -> Self {
        let topology = Topology::new(&body.rest);
        let x = &body.rest.vertices;
        let is_free = |hinge: &&[u32; 4]| hinge.iter().any(|&v| body.is_free(v as usize));
        let free = topology.hinges.iter().filter(is_free);
        Self {
            hinges: free
                .map(|&hinge| (hinge, (fold(x, hinge) - SHARP).max(0.0)))
                .collect(),
            ..Self::default()
        }
    }

    /// Adds a frame.
    fn add(&mut self, body: &Body, frame: usize) {
        let x = &body.system.particles.position;
        let at = |value, vertex| Found::of(value, vertex, frame, x);
        if let Some(before) = self.recent.back() {
            for (v, (to, before)) in x.iter().zip(before).enumerate() {
                let way = (to - before).norm();
                if body.is_free(v) {
                    at(way, v as u32).keep_greatest(&mut self.worst.way);
                } else {
                    self.held = max_or_nan([self.held, way]);
                }
            }
        }
        for &(hinge, at_rest) in &self.hinges {
            let angle = fold(x, hinge) - at_rest;
            at(angle, hinge[0]).keep_greatest(&mut self.worst.hinge);
        }
        for edge in &body.edges {
            let [a, b] = edge.points;
            let strain = (x[a as usize] - x[b as usize]).norm() / edge.rest - 1.0;
            at(strain.abs(), a).keep_greatest(&mut self.worst.strain);
        }
        self.recent.push_back(x.clone());
        if self.recent.len() > WINDOW {
            self.recent.pop_front();
        }
        if self.recent.len() == WINDOW {
            self.add_window(body, frame.saturating_sub(WINDOW / 2));
        }
    }

    /// Compares the middle of the window, the frame `middle`, with its mean.
    fn add_window(&mut self, body: &Body, middle: usize) {
        let (mut free, mut held, mut way) = (None, 0.0_f64, 0.0_f64);
        let x = &self.recent[WINDOW / 2];
        for v in 0..body.rest.vertices.len() {
            // Differences are exact zeros for what rests.
            let sum: Vector3<f64> = self.recent.iter().map(|other| other[v] - x[v]).sum();
            let by = sum.norm() / WINDOW as f64;
            if body.is_free(v) {
                Found::of(by, v as u32, middle, x).keep_greatest(&mut free);
            } else {
                held = max_or_nan([held, by]);
                let through = self.recent[WINDOW - 1][v] - self.recent[0][v];
                way = way.max(through.norm());
            }
        }
        let is_held = body
            .attached
            .iter()
            .any(|(v, _)| !body.is_free(*v as usize));
        // Of what rests nothing is asked: a muscle may swing or sink.
        if is_held && way > 0.0 && held <= STEADY * way {
            let jitter = free.map(|free| Found {
                value: max_or_nan([free.value - held, 0.0]),
                ..free
            });
            if let Some(jitter) = jitter {
                jitter.keep_greatest(&mut self.worst.jitter);
            }
        }
    }

    fn quality(&self) -> Quality {
        let ratio = |a: f64, b: f64| (b > 0.0).then(|| a / b);
        let value = |found: Option<Found>| found.map(|found| found.value);
        let way = value(self.worst.way).unwrap_or(0.0);
        let thinnest = value(self.worst.thinnest).zip(self.thick);
        Quality {
            jitter_m: value(self.worst.jitter),
            snap_ratio: ratio(way, max_or_nan([self.held, self.scheduled])),
            lift_off_m: value(self.worst.lift),
            thickness_ratio_min: thinnest.and_then(|(a, b)| ratio(a, b)),
            hinge_max_deg: value(self.worst.hinge).map(|angle| max_or_nan([angle, 0.0])),
        }
    }
}

/// The bones at a frame.
struct Bones<'a>(Vec<(&'a Surface, Isometry3<f64>)>);

impl<'a> Bones<'a> {
    fn of(simulation: &'a Simulation, frame: usize) -> Self {
        let bones = 0..simulation.bones.len();
        Self(
            bones
                .map(|b| (simulation.surface(b), simulation.pose(b, frame as f64)))
                .collect(),
        )
    }

    /// The distance of a point from the nearest bone, the point there [m], and the bone.
    fn nearest(&self, point: &Point3<f64>) -> Option<(f64, Point3<f64>, usize)> {
        let each = self
            .0
            .iter()
            .enumerate()
            .filter_map(|(b, (surface, pose))| {
                let found = surface.closest(&pose.inverse_transform_point(point))?;
                Some((found.distance, pose * found.point, b))
            });
        each.min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// How far a point lies beyond the line between two others, away from a bone [m].
    fn beyond_line(
        &self,
        bone: usize,
        point: &Point3<f64>,
        [one, other]: &[Point3<f64>; 2],
    ) -> Option<f64> {
        let (surface, pose) = &self.0[bone];
        let away = pose
            * surface
                .closest(&pose.inverse_transform_point(point))?
                .normal;
        let along = other - one;
        let share = (point - one).dot(&along) / along.norm_squared();
        let nearest = match share.is_finite() {
            true => one + along * share.clamp(0.0, 1.0),
            false => *one,
        };
        Some(away.dot(&(point - nearest)))
    }
}

/// The middles of what two bones hold, those that are farthest from each other [m]; `None` for fewer bones.
fn ends(body: &Body, x: &[Point3<f64>]) -> Option<[Point3<f64>; 2]> {
    let mut held: BTreeMap<usize, (usize, Vector3<f64>)> = BTreeMap::new();
    for &(v, bone) in &body.attached {
        let (count, sum) = held.entry(bone).or_default();
        *count += 1;
        *sum += x[v as usize].coords;
    }
    let middles: Vec<Point3<f64>> = held
        .into_values()
        .map(|(count, sum)| Point3::from(sum / count as f64))
        .collect();
    let pairs = middles
        .iter()
        .enumerate()
        .flat_map(|(k, one)| middles[k + 1..].iter().map(move |other| [*one, *other]));
    let apart = |[one, other]: &[Point3<f64>; 2]| (one - other).norm();
    pairs.max_by(|a, b| apart(a).total_cmp(&apart(b)))
}

/// Greatest number of frames of a motion that are looked at.
const LOOKED_AT: usize = 1000;

/// Greatest motion of a held vertex in a frame, over all key frames of the bones [m].
fn scheduled(simulation: &Simulation, body: &Body) -> f64 {
    let bones = simulation.scene.bones.iter();
    let last = bones.filter_map(|bone| Some(bone.motion.keys.last()?.frame));
    let last = max_or_nan(last.chain([0.0])).ceil() as usize;
    let held = |&&(v, _): &&(u32, usize)| !body.is_free(v as usize);
    let poses = |frame: usize| -> Vec<Isometry3<f64>> {
        let all = 0..simulation.bones.len();
        all.map(|b| simulation.pose(b, frame as f64)).collect()
    };
    let rest = poses(0);
    let ways = (0..last).step_by(last / LOOKED_AT + 1).flat_map(|frame| {
        let (before, after) = (poses(frame), poses(frame + 1));
        let rest = &rest;
        body.attached.iter().filter(held).map(move |&(v, b)| {
            let local = rest[b].inverse_transform_point(&body.rest.vertices[v as usize]);
            (after[b] * local - before[b] * local).norm()
        })
    });
    max_or_nan(ways.chain([0.0]))
}

fn at_rest(body: &Body) -> Surface {
    Surface::new(&body.rest)
}

fn now(body: &Body) -> Surface {
    Surface::new(&TriangleMesh {
        vertices: body.system.particles.position.clone(),
        triangles: body.rest.triangles.clone(),
    })
}

/// True if a surface lies between a point and the end of a way.
fn is_hit(surface: &Surface, from: &Point3<f64>, way: &Vector3<f64>) -> bool {
    let length = way.norm();
    length > 0.0
        && surface
            .first_hit(from, &(way / length))
            .is_some_and(|(triangle, weights)| {
                (place(surface, triangle, weights) - from).norm() < length
            })
}

/// A point of a surface.
fn place(surface: &Surface, triangle: u32, weights: [f64; 3]) -> Point3<f64> {
    let corners = surface.triangles()[triangle as usize];
    let each = corners.iter().zip(weights);
    let sum = each.map(|(&v, w)| surface.positions()[v as usize].coords * w);
    Point3::from(sum.sum::<Vector3<f64>>())
}

/// The value that a share of vertices has at most, and the first vertex with it.
fn at_quantile(all: Vec<(f64, u32)>, share: f64) -> Option<(f64, u32)> {
    let value = quantile(all.iter().map(|(value, _)| *value).collect(), share)?;
    all.into_iter()
        .find(|(other, _)| other.total_cmp(&value).is_eq())
}

/// The thickness that a small share of the free vertices has at most [m], and a vertex with it: the
/// way from a vertex to the opposite side, against its normal. `None` for a surface that encloses
/// nothing.
fn thickness(body: &Body, x: &[Point3<f64>], surface: &Surface) -> Option<(f64, u32)> {
    if !(body.rest_volume > 0.0) {
        return None;
    }
    let mesh = TriangleMesh {
        vertices: x.to_vec(),
        triangles: body.rest.triangles.clone(),
    };
    let normals = mesh.vertex_normals();
    let free = (0..x.len()).filter(|&v| body.is_free(v));
    let ways = free.filter_map(|v| {
        let inwards = -normals[v].try_normalize(0.0)?;
        let from = x[v] + inwards * (BELOW * body.edge_length);
        let (triangle, weights) = surface.first_hit(&from, &inwards)?;
        Some(((place(surface, triangle, weights) - x[v]).norm(), v as u32))
    });
    at_quantile(ways.collect(), THIN)
}

/// The angle between the normals of the two triangles of a hinge [deg]. Its edge is `[p1, p2]`.
fn fold(x: &[Point3<f64>], [p1, p2, p3, p4]: [u32; 4]) -> f64 {
    let [p1, p2, p3, p4] = [p1, p2, p3, p4].map(|v| x[v as usize]);
    let first = (p2 - p1).cross(&(p3 - p1));
    let second = (p4 - p1).cross(&(p2 - p1));
    first.angle(&second).to_degrees()
}

/// What an anatomist asks of the motion of a muscle with this name and length [m]. NaN fails.
pub(super) fn verdicts(
    quality: &Quality,
    worst: &Worst,
    limits: &Limits,
    (name, length): (&str, f64),
) -> Vec<Verdict> {
    let Limits {
        jitter,
        snap,
        lift_off,
        thickness,
        hinge,
    } = limits.or_default(length);
    let most = |name: &str, value: Option<f64>, limit: Option<f64>| {
        Some(Verdict::at_most(name, value?, limit?))
    };
    let least = |name: &str, value: Option<f64>, limit: Option<f64>| {
        Some(Verdict::at_least(name, value?, limit?))
    };
    let jitter = most("jitter while bones move steadily", quality.jitter_m, jitter);
    let snap = most(
        "greatest speed, relative to the attachments",
        quality.snap_ratio,
        snap,
    );
    let lift = most("lift-off from bones", quality.lift_off_m, lift_off);
    let thick = least(
        "least thickness, relative to that at rest",
        quality.thickness_ratio_min,
        thickness,
    );
    let hinge = hinge.map(f64::to_degrees);
    let fold = most("greatest angle of a fold", quality.hinge_max_deg, hinge);
    let all = [
        (jitter.map(|v| v.in_unit("m")), SMOOTHER, worst.jitter),
        (snap, SMOOTHER, worst.way),
        (lift.map(|v| v.in_unit("m")), TAUTER, worst.lift),
        (thick, STIFFER, worst.thinnest),
        (fold.map(|v| v.in_unit("deg")), STIFFER, worst.hinge),
    ];
    all.into_iter()
        .filter_map(|(verdict, advice, found)| Some(located(verdict?.else_do(advice), name, found)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::output::Spot;
    use super::*;
    use pliant::Scene;
    use pliant::mesh::shapes::{icosphere, tube};
    use pliant::scene::builtin::load;

    /// A cube on a table, of which frames are given instead of computed.
    fn cube() -> Simulation {
        Simulation::new(load("cube", &[]).expect("a scene")).expect("a simulation")
    }

    /// The quality after frames at the places of `at`: body, frame and vertex give a position.
    fn after(frames: usize, at: impl Fn(&Body, usize, usize) -> Point3<f64>) -> Quality {
        let mut simulation = cube();
        let mut quality = RunQuality::default();
        quality.frame(&simulation);
        for frame in 1..=frames {
            let body = &simulation.bodies[0];
            let x = (0..body.rest.vertices.len()).map(|v| at(body, frame, v));
            simulation.bodies[0].system.particles.position = x.collect();
            quality.frame(&simulation);
        }
        // Frame 0 of the simulation is a multiple of ten: every given frame was examined.
        quality.of_muscles()[0]
    }

    fn rest(body: &Body, v: usize) -> Point3<f64> {
        body.rest.vertices[v]
    }

    /// The names of the verdicts that fail for a muscle of 20 cm with the default limits.
    fn failed(quality: &Quality) -> Vec<String> {
        let all = verdicts(quality, &Worst::default(), &Limits::default(), ("a", 0.2));
        let failed = all.into_iter().filter(|verdict| !verdict.passed);
        failed.map(|verdict| verdict.name).collect()
    }

    fn is_near(value: Option<f64>, expected: f64, tolerance: f64) -> bool {
        value.is_some_and(|value| (value - expected).abs() <= tolerance)
    }

    #[test]
    fn a_steady_motion_of_the_whole_muscle_is_believed() {
        let step = Vector3::new(1e-3, -2e-3, 0.5e-3);
        let quality = after(9, |body, frame, v| rest(body, v) + step * frame as f64);
        assert!(is_near(quality.jitter_m, 0.0, 1e-12), "{quality:?}");
        assert!(is_near(quality.snap_ratio, 1.0, 1e-9), "{quality:?}");
        assert!(
            is_near(quality.thickness_ratio_min, 1.0, 1e-6),
            "{quality:?}"
        );
        let still = after(9, |body, _, v| rest(body, v));
        // Without motion there is no speed to compare.
        assert_eq!((still.snap_ratio, still.lift_off_m), (None, Some(0.0)));
        assert_eq!(failed(&still), Vec::<String>::new());
    }

    #[test]
    fn each_fault_has_its_own_measure() {
        let free = |body: &Body| (0..body.rest.vertices.len()).find(|&v| body.is_free(v));
        let one = free(&cube().bodies[0]).expect("a free vertex");
        let shaken = |by: f64, only: Option<usize>| {
            after(9, move |body, frame, v| {
                let way = Vector3::new(1e-3 * frame as f64, 0.0, 0.0);
                let is_here = body.is_free(v) && only.is_none_or(|only| only == v);
                let shake = if frame == 5 && is_here { by } else { 0.0 };
                rest(body, v) + way + Vector3::new(0.0, 0.0, shake)
            })
        };
        // Six sevenths of a deviation in the middle of seven frames.
        let jitter = shaken(0.7e-3, Some(one));
        assert!(is_near(jitter.jitter_m, 0.6e-3, 1e-9), "{jitter:?}");
        let snapped = shaken(3e-3, None);
        assert!(
            is_near(snapped.snap_ratio, 10.0_f64.sqrt(), 1e-6),
            "{snapped:?}"
        );
        // All free vertices leave the middle by a centimetre.
        let lifted = after(1, |body, _, v| {
            let out = if body.is_free(v) { 0.01 } else { 0.0 };
            let normal = body.rest.surface_centroid().expect("a surface");
            rest(body, v) + (rest(body, v) - normal).normalize() * out
        });
        assert!(lifted.lift_off_m > Some(1e-3), "{lifted:?}");
        assert!(lifted.hinge_max_deg > Some(60.0), "{lifted:?}");
        // Drawn out along a diagonal of a side, two edges of the cube turn by 37 degrees. The sides
        // stay flat.
        let drawn = after(1, |body, _, v| {
            let centre = body.rest.surface_centroid().expect("a surface");
            let diagonal = Vector3::new(1.0, 1.0, 0.0).normalize();
            let by = rest(body, v) - centre;
            rest(body, v) + diagonal * diagonal.dot(&by)
        });
        let turned = 2.0 * 2.0_f64.atan().to_degrees() - 90.0;
        assert!(
            is_near(drawn.hinge_max_deg, 50.0 + turned, 1e-6),
            "{drawn:?}"
        );
        // A muscle that is pressed flat along each of its axes loses thickness.
        let thin = after(1, |body, _, v| {
            let centre = body.rest.surface_centroid().expect("a surface");
            centre + (rest(body, v) - centre) * 0.3
        });
        assert!(is_near(thin.thickness_ratio_min, 0.3, 1e-6), "{thin:?}");
        let failed_now = failed(&shaken(3e-3, Some(one)));
        let says = |words: &str| failed_now.iter().any(|name| name.contains(words));
        assert!(says("jitter") && says("speed"), "{failed_now:?}");
        let nan = Quality {
            jitter_m: Some(f64::NAN),
            ..Quality::default()
        };
        assert_eq!(failed(&nan).len(), 1);
        // A failed one has the place of its worst vertex, one that passed has none.
        let spot = Spot {
            frame: 3,
            point_m: [1.0, 2.0, 3.0],
        };
        let worst = Worst {
            jitter: Some(Found {
                value: f64::NAN,
                vertex: 7,
                spot,
            }),
            ..Worst::default()
        };
        let at = |quality: &Quality| {
            let all = verdicts(quality, &worst, &Limits::default(), ("a", 0.2));
            (all[0].place.clone(), all[0].spot)
        };
        let place = "a, frame 3, vertex 7".to_owned();
        assert_eq!(at(&nan), (Some(place), Some(spot)));
        let steady = Quality {
            jitter_m: Some(0.0),
            ..nan
        };
        assert_eq!(at(&steady), (Some("a".to_owned()), None));
        // Limits of the scene replace the default.
        let wide = Limits {
            jitter: Some(1.0),
            snap: Some(100.0),
            lift_off: Some(1.0),
            thickness: Some(0.0),
            hinge: Some(std::f64::consts::PI),
        };
        let judged = verdicts(
            &shaken(3e-3, Some(one)),
            &Worst::default(),
            &wide,
            ("a", 0.2),
        );
        assert!(judged.iter().all(|verdict| verdict.passed), "{judged:?}");
    }

    #[test]
    fn a_muscle_leaves_a_bone_that_it_passes_as_it_gets_straight() {
        let moved = |mut mesh: TriangleMesh, by: Vector3<f64>| {
            mesh.vertices.iter_mut().for_each(|v| *v += by);
            mesh
        };
        let muscle = tube(0.01, 0.12, 24);
        let bounds = muscle.bounding_box();
        let (along, length) = (bounds.extents().iamax(), bounds.extents().amax());
        let across = (along + 1) % 3;
        let end = |sign: f64| {
            let mut by = bounds.center().coords;
            by[along] += sign * (0.5 * length + 0.0095);
            moved(icosphere(0.01, 3), by)
        };
        let mut below = bounds.center().coords;
        below[across] -= 0.0305;
        // The lift-off where all vertices move by `way` of each, away from the bone below the middle, which
        // holds the muscle or not.
        let lifted = |holds: bool, way: &dyn Fn(f64) -> f64| {
            let mut scene = Scene::builder("passes", 2, 60.0)
                .bone("one", end(-1.0))
                .bone("other", end(1.0))
                .bone("below", moved(icosphere(0.02, 4), below))
                .muscle("muscle", muscle.clone())
                .attach("one", 2e-3)
                .attach("other", 2e-3)
                .set("effects.stretch", "on")
                .set("effects.contact.thickness", "0.1 mm");
            if holds {
                scene = scene.attach("below", 0.7e-3);
            }
            let scene = scene.build().expect("a scene");
            let mut simulation = Simulation::new(scene).expect("a simulation");
            let mut quality = RunQuality::default();
            quality.frame(&simulation);
            for p in &mut simulation.bodies[0].system.particles.position {
                let from_middle = (p[along] - bounds.center()[along]).abs() / (0.5 * length);
                p[across] += way(from_middle);
            }
            quality.frame(&simulation);
            quality.of_muscles()[0]
                .lift_off_m
                .expect("a vertex on a bone")
        };
        // As a whole: the line between the ends comes along.
        let as_a_whole = lifted(false, &|_| 0.01);
        assert!(as_a_whole <= 1e-9, "{as_a_whole}");
        // Only the middle: it bulges.
        let bulge = lifted(false, &|off| 0.01 * (1.0 - off));
        assert!(bulge > 5e-3, "{bulge}");
        let held = lifted(true, &|_| 0.01);
        assert!(held > 5e-3, "control: {held}");
    }

    #[test]
    fn a_resumed_run_has_the_same_quality() {
        let mut simulation = cube();
        let mut straight = RunQuality::default();
        straight.frame(&simulation);
        let mut resumed = None;
        for frame in 1..=12 {
            simulation.step_frame();
            straight.frame(&simulation);
            let mut bytes = Writer::default();
            match &mut resumed {
                None if frame == 5 => {
                    straight.save(&mut bytes);
                    let read = RunQuality::open(&mut Reader::new(&bytes.bytes), &simulation);
                    resumed = Some(read.expect("the same muscles"));
                }
                None => {}
                Some(resumed) => resumed.frame(&simulation),
            }
        }
        let resumed = resumed.expect("resumed in frame 5");
        assert_eq!(straight.of_muscles(), resumed.of_muscles());
        let bytes = Writer::default().bytes;
        assert!(RunQuality::open(&mut Reader::new(&bytes), &simulation).is_err());
    }
}
