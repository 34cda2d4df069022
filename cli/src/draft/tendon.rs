//! Ends of muscles without a tendon over the joint.
//!
//! A bone that holds an end from afar carries it like a part of itself. That is right where a tendon
//! runs along the bone. Where a mesh ends before the joint that its tendon crosses, the end would turn
//! into the bone that rests, or about an axis that it lies beyond. There the mesh is lengthened by a
//! tendon, the shortest way round the bones.

use nalgebra::{Point3, Rotation3, Vector3};

use super::attachments::{FarEnd, NEAR_MM};
use super::joint::Joint;
use super::mending;
use pliant::contact::{Obstacle, Projection, Surface};
use pliant::mesh::{Finding, FindingKind, Health, TriangleMesh, lengthened, rim_pose, stump};

/// Radius of a tendon, in edges of the muscle after remeshing: the thinnest that they can follow. A real one
/// is thinner.
const RADIUS: f64 = 1.3;

/// Distance of a tendon from bones and other muscles [m], as of cartilage between them. It is more than
/// [`NEAR_MM`], so that no bone holds a tendon that passes it.
const GAP: f64 = 4e-3;

/// How much nearer to a bone remeshing may bring a surface [m].
const REMESHED: f64 = 5e-4;

/// Distance of the last point of a course from its bone, in radii, and of the foot there from the bone [m].
const FOOT: f64 = 0.6;
const AT_BONE: f64 = 3e-4;

/// What is cut off a muscle's tip, relative to its length: the least that leaves one rim.
const CUTS: [f64; 5] = [0.015, 0.02, 0.03, 0.05, 0.08];

/// Distance of the points of a course, in radii of the tendon, and the greatest number of them.
const APART: f64 = 2.0;
const POINTS: f64 = 40.0;

/// Passes that draw a course tight, for each of its points: a disturbance spreads by a point a pass, and the
/// square of that until it is even.
const PASSES: usize = 60;

/// Least distance of a course from bones, relative to the wanted one: its chords cut the bends of a bone. It is
/// looked at in this many places between two points.
const NEARER: f64 = 0.7;
const LOOKED_BETWEEN: u32 = 4;

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

/// Where a tendon ends: on a bone, or on a part of it.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    pub bone: usize,
    /// Its triangles, ascending; `None` for all.
    pub part: Option<&'a [u32]>,
}

/// What a tendon keeps clear of.
pub struct Around<'a> {
    pub bones: &'a [Surface],
    pub muscles: Vec<&'a Surface>,
    pub tendons: Vec<&'a Course>,
}

impl Around<'_> {
    /// A point moved out of what it is nearer to than `clear` [m]. Bones come last: a run parts muscles.
    fn kept_clear(&self, mut at: Point3<f64>, clear: f64) -> Point3<f64> {
        for tendon in &self.tendons {
            let apart = clear + tendon.radius;
            if let Some((from, away)) = tendon.nearest(&at).filter(|n| n.1 < apart)
                && let Some(direction) = (at - from).try_normalize(1e-9 * away)
            {
                at = from + direction * apart;
            }
        }
        for surface in self.muscles.iter().copied().chain(self.bones) {
            if let Some(closest) = surface.closest(&at).filter(|c| c.distance < clear) {
                at = closest.point + closest.normal * clear;
            }
        }
        at
    }

    /// The point of a target that is nearest to another one.
    fn closest(&self, at: &Point3<f64>, target: Target<'_>) -> Option<Projection> {
        let surface = &self.bones[target.bone];
        match target.part {
            None => surface.closest(at),
            Some(part) => {
                let likely = *part.first()?;
                let found = surface.nearest_among(at, part, likely, surface.positions())?;
                Some(found.closest)
            }
        }
    }

    /// The shortest course from a point to a bone that keeps clear of everything. The point after the first
    /// leads out of the muscle. `None` if there is none in reach.
    fn course(
        &self,
        from: Point3<f64>,
        lead: Vector3<f64>,
        target: Target<'_>,
        radius: f64,
    ) -> Option<Course> {
        let clear = radius + GAP;
        let first = self.kept_clear(from + lead, clear);
        let onto = |at: &Point3<f64>| {
            let closest = self.closest(at, target)?;
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
        // Bones can be thinner than the points are apart.
        let between = points.windows(2).flat_map(|p| {
            (1..=LOOKED_BETWEEN)
                .map(|k| p[0] + (p[1] - p[0]) * (f64::from(k) / f64::from(LOOKED_BETWEEN)))
        });
        let clearances =
            between.flat_map(|at| self.bones.iter().filter_map(move |bone| bone.closest(&at)));
        let is_clear = clearances.map(|c| c.distance).all(|d| d >= NEARER * clear);
        // It meets the bone with a foot.
        let foot = self.closest(&points[count], target)?;
        points.push(foot.point + foot.normal * (FOOT * radius));
        points.insert(0, from);
        let course = Course { points, radius };
        let is_short = course.length() <= DETOUR * (straight + lead.norm()) + 2.0 * clear;
        (is_clear && is_short).then_some(course)
    }

    /// The muscle with a tendon from an end to a bone; `None` if the end cannot be cut with one rim, if there
    /// is no course, or if the surface would cross itself.
    pub fn lengthened(
        &self,
        muscle: &TriangleMesh,
        far: &FarEnd,
        target: Target<'_>,
    ) -> Option<Tendon> {
        let radius = RADIUS * mending::edge_of(muscle);
        let heights: Vec<f64> = muscle
            .vertices
            .iter()
            .map(|v| -far.outward.dot(&v.coords))
            .collect();
        let tip = heights.iter().copied().min_by(f64::total_cmp)?;
        let before = Health::of(muscle);
        CUTS.iter().find_map(|share| {
            let from = tip + share * far.length;
            let heights: Vec<f64> = heights.iter().map(|h| h - from).collect();
            let (part, rim) = stump(muscle, &heights)?;
            let (middle, out) = rim_pose(&part, &rim)?;
            let course = self.course(middle, *out * radius, target, radius)?;
            let (mut mesh, end) = lengthened(&part, &rim, &course.points, radius)?;
            for v in &mut mesh.vertices[part.vertices.len()..] {
                for (b, surface) in self.bones.iter().enumerate() {
                    let apart = match b == target.bone {
                        true => AT_BONE,
                        false => 1e-3 * NEAR_MM + REMESHED,
                    };
                    if let Some(closest) = surface.closest(v).filter(|c| c.distance < apart) {
                        *v = closest.point + closest.normal * apart;
                    }
                }
            }
            let after = Health::of(&mesh);
            let is_fit = after.is_fit() && crossings(&after) <= crossings(&before);
            is_fit.then_some(Tendon { mesh, end, course })
        })
    }
}

/// Steps of the motion at which an end is looked at.
const LOOKED_AT: u32 = 12;

/// An end crosses the joint if more than this share of what is held of it turns into a bone: a run, which
/// frees such vertices, is red if they are half of an attachment.
const CROSSES: f64 = 0.25;

/// Number of triangles that cross others.
fn crossings(health: &Health) -> usize {
    let is_it = |finding: &&Finding| finding.kind == FindingKind::SelfIntersection;
    health.findings.iter().find(is_it).map_or(0, |f| f.count)
}

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

#[cfg(test)]
mod tests {
    use super::*;
    use pliant::mesh::shapes::{box_surface, icosphere};

    const WHOLE: Target<'_> = Target {
        bone: 1,
        part: None,
    };

    /// A ball of 3 cm, a plate below it, and beside it a muscle of 20 cm whose lower end is above the ball.
    fn knee() -> ([Surface; 2], TriangleMesh) {
        let mut plate = box_surface([0.2, 0.2, 0.02], 0.02);
        plate.vertices.iter_mut().for_each(|v| v.z -= 0.07);
        let bones = [icosphere(0.03, 4), plate].map(|mesh| Surface::new(&mesh));
        let mut muscle = icosphere(0.1, 5);
        for v in &mut muscle.vertices {
            *v = Point3::new(0.2 * v.x + 0.015, 0.2 * v.y, v.z + 0.15);
        }
        (bones, muscle)
    }

    #[test]
    fn a_course_is_the_shortest_way_round_a_bone() {
        let (bones, _) = knee();
        let around = Around {
            bones: &bones,
            muscles: Vec::new(),
            tendons: Vec::new(),
        };
        let (from, radius) = (Point3::new(0.015, 0.0, 0.06), 0.002);
        let course = around
            .course(from, Vector3::zeros(), WHOLE, radius)
            .expect("a course");
        // A tangent to the ball, an arc to its side, and straight down.
        let clear = radius + GAP;
        let (reach, ball) = (from.coords.norm(), 0.03 + clear);
        let arc = (0.06_f64).atan2(0.015) - (ball / reach).acos();
        let way = (reach * reach - ball * ball).sqrt() + ball * arc + (0.06 - FOOT * radius);
        let length = course.length();
        assert!((length / way - 1.0).abs() <= 0.01, "{length} {way}");
        // Another tendon beside it keeps clear of the first one.
        let both = Around {
            tendons: vec![&course],
            muscles: Vec::new(),
            ..around
        };
        let start = from + Vector3::y() * 0.006;
        let second = both
            .course(start, Vector3::zeros(), WHOLE, radius)
            .expect("a course");
        for at in &second.points[1..] {
            let away = course.nearest(at).expect("points").1;
            assert!(away >= NEARER * (2.0 * radius + GAP), "{away}");
        }
        // It ends on the part of the plate that is asked, here beyond 4 cm to the side.
        let plate = &bones[1];
        let is_aside = |t: &[u32; 3]| t.iter().all(|&v| plate.positions()[v as usize].y >= 0.04);
        let part: Vec<u32> = (0..)
            .zip(plate.triangles())
            .filter(|(_, t)| is_aside(t))
            .map(|(k, _)| k)
            .collect();
        let aside = Target {
            part: Some(&part),
            ..WHOLE
        };
        let to_the_side = around_of(&bones)
            .course(from, Vector3::zeros(), aside, radius)
            .expect("a course");
        let end = |course: &Course| course.points[course.points.len() - 1].y;
        assert!(end(&to_the_side) >= 0.0399 && end(&course) < 0.01);
        // Controls: a straight line would lie in the ball, and there is no way to a bone behind a wall.
        let straight = from + Vector3::new(0.0, 0.0, -0.04);
        assert!(bones[0].closest(&straight).expect("a ball").distance < 0.0);
        let mut wall = box_surface([0.6, 0.6, 0.01], 0.05);
        wall.vertices.iter_mut().for_each(|v| v.z += 0.045);
        let walled = [bones[0].clone(), bones[1].clone(), Surface::new(&wall)];
        let none = Around {
            bones: &walled,
            ..around_of(&[])
        };
        assert!(none.course(from, Vector3::zeros(), WHOLE, radius).is_none());
    }

    fn around_of(bones: &[Surface]) -> Around<'_> {
        Around {
            bones,
            muscles: Vec::new(),
            tendons: Vec::new(),
        }
    }

    #[test]
    fn a_muscle_gets_the_tendon_that_it_lacks() {
        let (bones, muscle) = knee();
        let far = FarEnd {
            mm: 100.0,
            middle: Point3::new(0.015, 0.0, 0.06),
            outward: -Vector3::z(),
            length: 0.2,
            nearest: Some(0),
            lacks_tendon: false,
        };
        let with = around_of(&bones)
            .lengthened(&muscle, &far, WHOLE)
            .expect("a tendon");
        let health = Health::of(&with.mesh);
        assert!(health.is_fit() && crossings(&health) == 0);
        // It ends at the plate, in no bone.
        let lowest = with.mesh.bounding_box().min.z;
        assert!((-0.06..=-0.059).contains(&lowest), "{lowest}");
        let points = with.mesh.vertices.iter();
        let each = points.flat_map(|v| bones.iter().filter_map(move |b| b.closest(v)));
        let least = each.map(|c| c.distance).fold(f64::INFINITY, f64::min);
        assert!(least >= 0.9 * AT_BONE, "{least}");
        let to_ball = with
            .mesh
            .vertices
            .iter()
            .filter_map(|v| bones[0].closest(v));
        let least = to_ball.map(|c| c.distance).fold(f64::INFINITY, f64::min);
        assert!(1e3 * least >= NEAR_MM, "{least}");
        // What is held is the end alone, and the belly is the old one.
        let held = with.end.iter().flat_map(|&t| with.mesh.corners(t as usize));
        assert!(held.map(|p| p.z).all(|z| z <= -0.045));
        let added = with.mesh.volume() / muscle.volume() - 1.0;
        assert!((0.0..=0.2).contains(&added), "{added}");
        // Control: the ball is too near to go round, and the way back up is no tendon.
        let far = FarEnd {
            outward: Vector3::z(),
            ..far
        };
        assert!(around_of(&bones).lengthened(&muscle, &far, WHOLE).is_none());
    }
}
