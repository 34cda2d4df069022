//! Ends of muscles without a tendon over the joint.
//!
//! A bone that holds an end from afar carries it like a part of itself. That is right where a tendon
//! runs along the bone. Where a mesh ends before the joint that its tendon crosses, the end would turn
//! into the bone that rests, or about an axis that it lies beyond. There the mesh is lengthened by a
//! tendon, the shortest way round the bones.

use nalgebra::{Point3, Rotation3, Vector3};

use super::attachments::FarEnd;
use super::joint::Joint;
use super::mending;
use pliant::contact::{Obstacle, Surface};
use pliant::mesh::{Health, TriangleMesh, lengthened, rim_pose, stump};

/// Radius of a tendon, in edges of the muscle after remeshing: the thinnest that they can follow. A real one
/// is thinner.
const RADIUS: f64 = 1.3;

/// Distance of a tendon from bones and other muscles [m]: more than half of the thickness of their contact.
const GAP: f64 = 1e-3;

/// What is cut off a muscle's tip, relative to its length: the least that leaves one rim.
const CUTS: [f64; 5] = [0.015, 0.02, 0.03, 0.05, 0.08];

/// Distance of the points of a course, in radii of the tendon, and the greatest number of them.
const APART: f64 = 2.0;
const POINTS: f64 = 40.0;

/// Passes that draw a course tight, for each of its points: a disturbance spreads by a point a pass, and the
/// square of that until it is even.
const PASSES: usize = 60;

/// How much nearer to a bone than wanted a course may end.
const NEARER: f64 = 0.8;

/// Greatest length of a tendon, relative to the distance of the end from its bone.
const DETOUR: f64 = 2.0;

/// The course of a tendon, from the muscle to the bone.
#[derive(Debug)]
pub struct Course {
    points: Vec<Point3<f64>>,
    /// Its radius [m].
    pub radius: f64,
}

impl Course {
    /// Its length [m].
    pub fn length(&self) -> f64 {
        self.points.windows(2).map(|p| (p[1] - p[0]).norm()).sum()
    }

    /// The nearest of its points, with its distance [m].
    fn nearest(&self, to: &Point3<f64>) -> Option<(&Point3<f64>, f64)> {
        let each = self.points.iter().map(|p| (p, (to - p).norm()));
        each.min_by(|a, b| a.1.total_cmp(&b.1))
    }
}

/// A muscle with a tendon that its mesh lacks.
#[derive(Debug)]
pub struct Tendon {
    /// The whole surface [m].
    pub mesh: TriangleMesh,
    /// The triangles of the end at the bone.
    pub end: Vec<u32>,
    pub course: Course,
}

/// What a tendon keeps clear of.
pub struct Around<'a> {
    pub bones: &'a [Surface],
    pub muscles: Vec<&'a Surface>,
    pub tendons: Vec<&'a Course>,
}

impl Around<'_> {
    /// A point moved out of what it is nearer to than `clear` [m].
    fn kept_clear(&self, mut at: Point3<f64>, clear: f64) -> Point3<f64> {
        let surfaces = self.bones.iter().chain(self.muscles.iter().copied());
        for surface in surfaces {
            if let Some(closest) = surface.closest(&at).filter(|c| c.distance < clear) {
                at = closest.point + closest.normal * clear;
            }
        }
        for tendon in &self.tendons {
            let apart = clear + tendon.radius;
            if let Some((from, away)) = tendon.nearest(&at).filter(|n| n.1 < apart)
                && let Some(direction) = (at - from).try_normalize(1e-9 * away)
            {
                at = from + direction * apart;
            }
        }
        at
    }

    /// The shortest course from a point to a bone that keeps clear of everything. The point after the first
    /// leads out of the muscle. `None` if there is none in reach.
    fn course(&self, from: Point3<f64>, lead: Vector3<f64>, bone: usize, radius: f64) -> Option<Course> {
        let clear = radius + GAP;
        let first = self.kept_clear(from + lead, clear);
        let onto = |at: &Point3<f64>| {
            let closest = self.bones[bone].closest(at)?;
            Some(closest.point + closest.normal * clear)
        };
        let last = onto(&first)?;
        let straight = (last - first).norm();
        let count = (straight / (APART * radius)).ceil().clamp(3.0, POINTS) as usize;
        let between = |k: usize| first + (last - first) * (k as f64 / count as f64);
        let mut points: Vec<Point3<f64>> = (0..=count).map(between).collect();
        for _ in 0..PASSES * count {
            for k in 1..count {
                let middle = nalgebra::center(&points[k - 1], &points[k + 1]);
                points[k] = self.kept_clear(middle, clear);
            }
            let drawn = nalgebra::center(&points[count - 1], &points[count]);
            points[count] = self.kept_clear(onto(&drawn)?, clear);
        }
        let clearances = points[1..]
            .iter()
            .flat_map(|at| self.bones.iter().filter_map(move |bone| bone.closest(at)));
        let is_clear = clearances.map(|c| c.distance).all(|d| d >= NEARER * clear);
        points.insert(0, from);
        let course = Course { points, radius };
        let is_short = course.length() <= DETOUR * (straight + lead.norm()) + 2.0 * clear;
        (is_clear && is_short).then_some(course)
    }

    /// The muscle with a tendon from an end to a bone; `None` if the end cannot be cut with one rim, if there
    /// is no course, or if the surface would cross itself.
    pub fn lengthened(&self, muscle: &TriangleMesh, far: &FarEnd, bone: usize) -> Option<Tendon> {
        let radius = RADIUS * mending::edge_of(muscle);
        let heights: Vec<f64> = muscle.vertices.iter().map(|v| -far.outward.dot(&v.coords)).collect();
        let tip = heights.iter().copied().min_by(f64::total_cmp)?;
        CUTS.iter().find_map(|share| {
            let from = tip + share * far.length;
            let heights: Vec<f64> = heights.iter().map(|h| h - from).collect();
            let (part, rim) = stump(muscle, &heights)?;
            let (middle, out) = rim_pose(&part, &rim)?;
            let course = self.course(middle, *out * radius, bone, radius)?;
            let (mut mesh, end) = lengthened(&part, &rim, &course.points, radius)?;
            for v in &mut mesh.vertices[part.vertices.len()..] {
                for bone in self.bones {
                    if let Some(closest) = bone.closest(v).filter(|c| c.distance < 0.5 * GAP) {
                        *v = closest.point + closest.normal * (0.5 * GAP);
                    }
                }
            }
            let is_fit = Health::of(&mesh).is_fit();
            is_fit.then_some(Tendon { mesh, end, course })
        })
    }
}

/// Steps of the motion at which an end is looked at.
const LOOKED_AT: u32 = 12;

/// An end crosses the joint if more than this share of what is held of it turns into a bone: a run, which
/// frees such vertices, is red if they are half of an attachment.
const CROSSES: f64 = 0.25;

/// Whether the motion of a joint carries an end, by points of what is held of it, into one of the bones that
/// rest.
pub fn is_carried_into(points: &[Point3<f64>], joint: &Joint, bones: &[Surface]) -> bool {
    let centre = joint.fit.centre;
    let turned = |step: u32| {
        let share = f64::from(step) / f64::from(LOOKED_AT);
        let angle = share * f64::from(joint.known.degrees).to_radians();
        Rotation3::from_axis_angle(&joint.axis, angle)
    };
    let turned: Vec<Rotation3<f64>> = (1..=LOOKED_AT).map(turned).collect();
    let rests: Vec<&Surface> = (0..bones.len())
        .filter(|b| !joint.turns.contains(b))
        .map(|b| &bones[b])
        .collect();
    let goes_in = |at: &&Point3<f64>| {
        let places = turned.iter().map(|turn| centre + turn * (*at - centre));
        places
            .flat_map(|there| rests.iter().filter_map(move |bone| bone.closest(&there)))
            .any(|closest| closest.distance <= 0.0)
    };
    points.iter().filter(goes_in).count() as f64 > CROSSES * points.len() as f64
}

/// The bone that rests and is nearest to an end, with its distance [m].
pub fn nearest_at_rest(at: &Point3<f64>, joint: &Joint, bones: &[Surface]) -> Option<(usize, f64)> {
    let rests = (0..bones.len()).filter(|b| !joint.turns.contains(b));
    let each = rests.filter_map(|b| Some((b, bones[b].closest(at)?.distance)));
    each.min_by(|a, b| a.1.total_cmp(&b.1))
}
