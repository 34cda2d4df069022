//! The way of a patella over the femur while the knee bends.
//!
//! The patella is a rigid body in the plane of the knee's motion: the quadriceps pulls its base along the
//! femur with a constant force, the patellar ligament keeps its length, and the femur keeps its distance.
//! At each angle it lies where the quadriceps is shortest, without friction. This is the planar model of
//! \[vaneijden1986\] with the shapes of the bones in place of curves, and an elastic layer for cartilage.

use nalgebra::{Isometry3, Matrix3, Point3, Translation3, Unit, Vector3};

use pliant::contact::Surface;
use pliant::mesh::TriangleMesh;
use pliant::mesh::measures::max_or_nan;
use pliant::scene::Joint;

/// Angles of the knee at which poses are found [deg], and those that become keys.
const FROM: i32 = -10;
const TO: i32 = 100;
const STEP: i32 = 2;
const KEY: i32 = 10;

/// A path that ends before this angle [deg] is none.
const ENOUGH: i32 = 70;

/// Stretch of the ligament under the whole force of the quadriceps, relative to the size of the patella:
/// 0.05 mm.
const GIVES: f64 = 1e-3;

/// Depth at which the force of the quadriceps presses all of the patella's back into the cartilage, relative
/// to its size. A sixth of it is in contact, so that it is 0.4 mm deep: more than the steps of a
/// segmentation.
const SOFT: f64 = 1.5e-3;

/// Rounds in which the thickness of the cartilage follows from the distance of the bones.
const LAYERS: usize = 2;

/// Distance that ends of tendons keep from the femur, relative to the size of the patella, unless they are
/// nearer in the files: 1.5 mm.
const CLEAR: f64 = 0.035;

/// How often the patella is pushed forwards until it is clear, and how far at most, relative to its size:
/// 4 mm.
const PUSHES: usize = 8;
const FARTHEST: f64 = 0.1;

/// Least cosine of the angle between the femur's normal and forwards that a push takes into account: along a
/// side of the femur it would never end.
const STEEPEST: f64 = 0.3;

/// Force that holds the patella to the femur where the quadriceps does not, relative to that of the
/// quadriceps: that of its retinacula.
const HELD: f64 = 0.1;

/// Standard deviation of the weights of the mean over neighbouring angles [deg]: cartilage is smooth where the
/// bones below it are not.
const SMOOTH: f64 = 8.0;

/// Greatest distance of both bones that cartilage fills, relative to the size of the patella: 5 mm of
/// 45 mm.
const CARTILAGE: f64 = 0.11;

/// Least and greatest number of points of the patella that touch, and the cosine of the greatest angle of
/// their normals to the back.
const FEWEST: usize = 20;
const MOST_POINTS: usize = 250;
const FACES: f64 = 0.1;

/// The points within this share of the extent from an end make a tip.
const TIP: f64 = 0.05;

/// Share of the length of the tibia, from its top, that has the tuberosity.
const TUBEROSITY: f64 = 0.25;

/// Share of the length of the femur over which the quadriceps pulls.
const PULL: f64 = 0.4;

/// The pose of the file is believed if the patella of the model lies within this share of its size, and
/// within this angle [rad], of it.
const OFF: f64 = 0.35;
const TURNED: f64 = 0.4;

/// The difference of both fades by a factor of e over this angle of the knee [rad].
const FADES: f64 = 0.2;

/// Greatest motion in a step, relative to the size of the patella.
const JUMP: f64 = 0.2;

/// Greatest number of steps of a search for a place.
const ROUNDS: usize = 100;

/// Greatest last step of a search that has ended, relative to the size of the patella.
const NEARLY: f64 = 1e-3;

/// Greatest depth of a point in the femur that is felt, relative to the size of the patella.
const DEEPEST: f64 = 0.2;

/// The knee.
pub struct Knee<'a> {
    pub femur: &'a TriangleMesh,
    pub surface: &'a Surface,
    pub tibia: &'a TriangleMesh,
    pub patella: &'a TriangleMesh,
    /// Points that the patella carries, such as the ends of tendons [m].
    pub carried: &'a [Point3<f64>],
    /// Centre [m] and axis; a positive angle bends the knee.
    pub centre: Point3<f64>,
    pub axis: Unit<Vector3<f64>>,
    /// Along the femur, away from the knee.
    pub up: Unit<Vector3<f64>>,
}

/// Poses of the patella at angles of the knee.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    pub keys: Vec<PathKey>,
}

/// A pose of the patella: a turn about the axis through the centre of the knee, then a translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathKey {
    /// Angle of the knee, and of the patella [rad].
    pub at: f64,
    pub angle: f64,
    /// [m].
    pub translation: Vector3<f64>,
}

/// A place of the patella in its plane: forwards and up [m], and the turn times its size [m].
type Place = Vector3<f64>;

/// What holds a patella.
struct Model<'a> {
    femur: &'a Surface,
    /// Points of the back of the patella, which keep the distance `gap`.
    points: Vec<Point3<f64>>,
    /// Points that it carries, each with its least distance from the femur [m].
    carried: Vec<(Point3<f64>, f64)>,
    middle: Point3<f64>,
    axis: Unit<Vector3<f64>>,
    /// Forwards and up.
    plane: [Vector3<f64>; 2],
    size: f64,
    base: Point3<f64>,
    apex: Point3<f64>,
    /// Where the quadriceps comes from.
    origin: Point3<f64>,
    /// Where the ligament ends on the tibia, at rest; the axis turns it about the centre.
    tuberosity: Point3<f64>,
    centre: Point3<f64>,
    ligament: f64,
    gap: f64,
}

impl Knee<'_> {
    /// The path of the patella; `None` where the shapes tell none, as for a patella that is far from the
    /// femur.
    pub fn path(&self) -> Option<Path> {
        let mut model = self.model()?;
        let gap = model.gap;
        let mut all = model.walk()?;
        for _ in 0..LAYERS {
            let least = all.iter().map(|(_, place)| model.least_gap(place));
            let least = least.min_by(f64::total_cmp)?;
            // Nowhere are the bones nearer to each other than in the files.
            model.gap = (model.gap + gap - least).clamp(gap, gap + CARTILAGE * model.size);
            all = model.walk()?;
        }
        let rest = all.iter().find(|(at, _)| *at == 0)?.1;
        let keys = all.iter().filter(|(at, _)| at % KEY == 0);
        let key = |&(at, place): &(i32, Place)| {
            let at = f64::from(at).to_radians();
            // The pose of the file is kept, and the difference from it fades.
            let place = place - rest * libm::exp(-at.abs() / FADES);
            let pose = model.pose(&place);
            // The same turn about the centre of the knee.
            let about = pose.rotation * self.centre.coords;
            let translation = pose.translation.vector + about - self.centre.coords;
            PathKey {
                at,
                angle: place.z / model.size,
                translation,
            }
        };
        let keys: Vec<PathKey> = keys.map(key).collect();
        let mut numbers = keys
            .iter()
            .flat_map(|key| [key.angle, key.translation.norm()]);
        numbers.all(f64::is_finite).then_some(Path { keys })
    }

    fn model(&self) -> Option<Model<'_>> {
        let up = self.up.into_inner() - self.axis.scale(self.up.dot(&self.axis));
        let up = up.try_normalize(0.0)?;
        // A positive angle carries what hangs down to the back.
        let front = self.axis.cross(&up);
        let middle = self.patella.bounding_box().center();
        let end = |mesh: &TriangleMesh, sign: f64| tip(&mesh.vertices, &(up * sign));
        let (base, apex) = (end(self.patella, 1.0)?, end(self.patella, -1.0)?);
        let size = (base - apex).norm();
        let (top, bottom) = (end(self.tibia, 1.0)?, end(self.tibia, -1.0)?);
        let least = top.coords.dot(&up) - TUBEROSITY * (top - bottom).dot(&up);
        let upper = self.tibia.vertices.iter().copied();
        let upper: Vec<Point3<f64>> = upper.filter(|p| p.coords.dot(&up) >= least).collect();
        let tuberosity = tip(&upper, &front)?;
        let length = (end(self.femur, 1.0)? - end(self.femur, -1.0)?).dot(&up);
        let normals = self.patella.vertex_normals();
        let faces = |v: &usize| normals[*v].dot(&front) < -FACES * normals[*v].norm();
        let facing: Vec<usize> = (0..normals.len()).filter(faces).collect();
        let every = facing.len().div_ceil(MOST_POINTS).max(1);
        let points: Vec<Point3<f64>> = (facing.iter().step_by(every))
            .map(|&v| self.patella.vertices[v])
            .collect();
        let ahead = (middle - self.centre).dot(&front);
        if !(size > 0.0 && ahead > 0.0 && points.len() >= FEWEST) {
            return None;
        }
        let carried = self.carried.iter().map(|p| {
            let near = self.surface.nearest(p, CLEAR * size);
            let least = near.map_or(CLEAR * size, |found| found.closest.distance);
            (*p, least.clamp(0.0, CLEAR * size))
        });
        let mut model = Model {
            femur: self.surface,
            points,
            carried: carried.collect(),
            middle,
            axis: self.axis,
            plane: [front, up],
            size,
            base,
            apex,
            origin: base + up * (PULL * length),
            tuberosity,
            centre: self.centre,
            ligament: (apex - tuberosity).norm(),
            gap: 0.0,
        };
        let gap = model.least_gap(&Place::zeros());
        model.gap = gap.clamp(0.0, CARTILAGE * size);
        (gap <= size).then_some(model)
    }
}

/// Weighted means over neighbouring angles, which leave a steady motion as it is; beyond an end it goes on as
/// mirrored in the end.
fn smooth(all: &[(i32, Place)]) -> Vec<(i32, Place)> {
    let last = all.len() as i32 - 1;
    let at = |k: i32| {
        let inside = k.clamp(0, last);
        let mirrored = (2 * inside - k).clamp(0, last);
        let (end, other) = (all[inside as usize].1, all[mirrored as usize].1);
        if inside == k { end } else { end * 2.0 - other }
    };
    let reach = (3.0 * SMOOTH) as i32 / STEP;
    let mean = |k: i32| {
        let (mut sum, mut weights) = (Place::zeros(), 0.0);
        for off in -reach..=reach {
            let share = f64::from(off * STEP) / SMOOTH;
            let weight = libm::exp(-0.5 * share * share);
            sum += at(k + off) * weight;
            weights += weight;
        }
        sum / weights
    };
    all.iter()
        .zip(0..)
        .map(|((angle, _), k)| (*angle, mean(k)))
        .collect()
}

/// The mean of the points that are farthest in a direction.
fn tip(points: &[Point3<f64>], direction: &Vector3<f64>) -> Option<Point3<f64>> {
    let along = |p: &Point3<f64>| p.coords.dot(direction);
    let most = points.iter().map(along).max_by(f64::total_cmp)?;
    let least = points.iter().map(along).min_by(f64::total_cmp)?;
    let is_there = |p: &&Point3<f64>| along(p) >= most - TIP * (most - least);
    let (mut sum, mut count) = (Vector3::zeros(), 0.0);
    for p in points.iter().filter(is_there) {
        sum += p.coords;
        count += 1.0;
    }
    Some(Point3::from(sum / count))
}

impl Model<'_> {
    /// Places at angles of the knee [deg]; `None` for one that the shapes do not hold.
    fn walk(&self) -> Option<Vec<(i32, Place)>> {
        let rest = self.lies(&Place::zeros(), 0.0)?;
        let off = Vector3::new(rest.x, rest.y, 0.0).norm();
        if !(off <= OFF * self.size && (rest.z / self.size).abs() <= TURNED) {
            return None;
        }
        let (back, forth) = (self.steps(rest, FROM, -STEP), self.steps(rest, TO, STEP));
        let reached = |found: &[(i32, Place)]| found.last().map_or(0, |(at, _)| *at);
        if reached(&back) != FROM || reached(&forth) < ENOUGH {
            return None;
        }
        let back = back.into_iter().rev();
        let all: Vec<(i32, Place)> = back.chain(forth.into_iter().skip(1)).collect();
        let mut all = smooth(&all);
        // Forwards alone: a tendon that is as thick as a mesh draws it does not turn the patella. The ligament
        // gets longer by it.
        let ahead: Vec<(i32, Place)> = all
            .iter()
            .map(|(at, place)| (*at, Place::x() * self.ahead(place)))
            .collect();
        let rest = ahead.iter().find(|(at, _)| *at == 0)?.1;
        for ((_, place), (_, ahead)) in all.iter_mut().zip(smooth(&ahead)) {
            *place += ahead - rest;
        }
        Some(all)
    }

    /// Places from rest to an angle [deg], or to where the patella leaves the groove.
    fn steps(&self, rest: Place, last: i32, step: i32) -> Vec<(i32, Place)> {
        let mut found = vec![(0, rest)];
        while let Some(&(at, before)) = found.last().filter(|(at, _)| *at != last) {
            let next = at + step;
            let place = self.lies(&before, f64::from(next).to_radians());
            let is_near = |place: &Place| (place - before).norm() <= JUMP * self.size;
            let Some(place) = place.filter(is_near) else {
                break;
            };
            found.push((next, place));
        }
        found
    }

    /// How far forwards the patella keeps clear of the femur with what it carries [m].
    fn ahead(&self, place: &Place) -> f64 {
        let mut ahead = 0.0_f64;
        for _ in 0..PUSHES {
            let pose = self.pose(&(place + Place::x() * ahead));
            let missing = self.carried.iter().filter_map(|(point, clear)| {
                let reach = clear + DEEPEST * self.size;
                let found = self.femur.nearest(&(pose * point), reach)?.closest;
                let forwards = found.normal.dot(&self.plane[0]).max(STEEPEST);
                Some((clear - found.distance) / forwards)
            });
            let next = ahead + max_or_nan(missing.chain([0.0]));
            let most = FARTHEST * self.size;
            ahead = if next > most { most } else { next };
        }
        ahead
    }

    /// The least distance of the patella from the femur [m].
    fn least_gap(&self, place: &Place) -> f64 {
        let pose = self.pose(place);
        let near = self
            .points
            .iter()
            .filter_map(|p| self.femur.nearest(&(pose * p), f64::MAX));
        let distances = near.map(|found| found.closest.distance);
        distances.min_by(f64::total_cmp).unwrap_or(f64::NAN)
    }

    fn pose(&self, place: &Place) -> Isometry3<f64> {
        let [front, up] = self.plane;
        let moved = Translation3::from(front * place.x + up * place.y);
        moved * self.turned(self.middle, place.z / self.size)
    }

    /// The turn by an angle [rad] about the axis through a centre.
    fn turned(&self, centre: Point3<f64>, angle: f64) -> Isometry3<f64> {
        let joint = Joint {
            name: None,
            centre,
            axis: self.axis,
            path: Vec::new(),
        };
        joint.pose(angle)
    }

    /// Where the patella lies at an angle of the knee [rad], from a place nearby.
    fn lies(&self, from: &Place, angle: f64) -> Option<Place> {
        let end = self.turned(self.centre, angle) * self.tuberosity;
        let (mut place, mut damping) = (*from, 1e-3);
        let (mut energy, mut slope, mut curve) = self.energy(&place, &end);
        let mut last = f64::INFINITY;
        for _ in 0..ROUNDS {
            let damped = curve + Matrix3::from_diagonal_element(damping / self.size);
            let step = -damped.try_inverse()? * slope;
            let next = self.energy(&(place + step), &end);
            // The last digits of the energy are not asked.
            if next.0 <= energy + 1e-12 * self.size {
                place += step;
                (energy, slope, curve) = next;
                damping = (damping * 0.2).max(1e-6);
                last = step.norm();
                if last <= 1e-6 * self.size {
                    return Some(place);
                }
            } else {
                damping *= 8.0;
            }
            if !energy.is_finite() {
                return None;
            }
        }
        // On a kink of the shapes steps end small, but not at once.
        (last <= NEARLY * self.size).then_some(place)
    }

    /// The length of the quadriceps [m] with the springs of ligament and contact, and both derivatives.
    fn energy(&self, place: &Place, end: &Point3<f64>) -> (f64, Vector3<f64>, Matrix3<f64>) {
        let pose = self.pose(place);
        let [front, up] = self.plane;
        let centre = pose * self.middle;
        let spring = 1.0 / (GIVES * self.size);
        let bed = 1.0 / (SOFT * self.size * self.points.len() as f64);
        // The derivative of a distance along a direction by the place of the patella.
        let along = |x: &Point3<f64>, direction: &Vector3<f64>| {
            let turn = self.axis.cross(&(x - centre)) / self.size;
            Vector3::new(
                direction.dot(&front),
                direction.dot(&up),
                direction.dot(&turn),
            )
        };
        let base = pose * self.base;
        let pull = base - self.origin;
        let length = pull.norm();
        let mut energy = length;
        let mut slope = along(&base, &(pull / length));
        let mut curve = Matrix3::identity() / self.size * 1e-3;
        energy += HELD * place.x;
        slope.x += HELD;
        let apex = pose * self.apex;
        let stretched = apex - end;
        let over = stretched.norm() - self.ligament;
        if over > 0.0 {
            let row = along(&apex, &(stretched / stretched.norm()));
            energy += 0.5 * spring * over * over;
            slope += row * (spring * over);
            curve += row * row.transpose() * spring;
        }
        for point in &self.points {
            let x = pose * point;
            let Some(found) = self.femur.nearest(&x, self.gap + DEEPEST * self.size) else {
                continue;
            };
            let deep = self.gap - found.closest.distance;
            if deep > 0.0 {
                let row = along(&x, &found.closest.normal);
                energy += 0.5 * bed * deep * deep;
                slope -= row * (bed * deep);
                curve += row * row.transpose() * bed;
            }
        }
        (energy, slope, curve)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::draft::joint::{NamedBone, known};
    use nalgebra::{Rotation3, Similarity3, UnitQuaternion};
    use pliant::mesh::shapes::{box_surface, icosphere};

    /// A knee of a ball with a centre in front of the axis, a box for the patella and one for the tibia.
    struct Bones {
        femur: TriangleMesh,
        tibia: TriangleMesh,
        patella: TriangleMesh,
        into: Similarity3<f64>,
    }

    fn bones(into: Similarity3<f64>) -> Bones {
        let at = |mut mesh: TriangleMesh, x: f64, y: f64| {
            for p in &mut mesh.vertices {
                *p = into * Point3::new(p.x + x, p.y + y, p.z);
            }
            mesh
        };
        let mut femur = icosphere(0.025, 4);
        // A shaft: a spike upwards tells its length.
        let top = femur.vertices.iter().enumerate();
        let top = top.max_by(|a, b| a.1.y.total_cmp(&b.1.y)).map(|(v, _)| v);
        femur.vertices[top.expect("a vertex")].y = 0.4;
        Bones {
            femur: at(femur, 0.008, 0.0),
            tibia: at(box_surface([0.05, 0.3, 0.05], 0.01), 0.01, -0.2),
            patella: at(box_surface([0.015, 0.045, 0.03], 0.003), 0.043, 0.005),
            into,
        }
    }

    impl Bones {
        fn knee<'a>(&'a self, surface: &'a Surface) -> Knee<'a> {
            // What hangs down goes to the back, -x, by a turn about -z.
            let turned = |v: Vector3<f64>| Unit::new_normalize(self.into.isometry.rotation * v);
            Knee {
                femur: &self.femur,
                surface,
                tibia: &self.tibia,
                patella: &self.patella,
                carried: &[],
                centre: self.into * Point3::origin(),
                axis: turned(-Vector3::z()),
                up: turned(Vector3::y()),
            }
        }
    }

    fn posed(knee: &Knee<'_>, key: &PathKey, points: &[Point3<f64>]) -> Vec<Point3<f64>> {
        let turn = UnitQuaternion::from_axis_angle(&knee.axis, key.angle);
        let at = |p: &Point3<f64>| knee.centre + turn * (p - knee.centre) + key.translation;
        points.iter().map(at).collect()
    }

    fn least_gap(surface: &Surface, points: &[Point3<f64>]) -> f64 {
        let all = points.iter().filter_map(|p| surface.nearest(p, f64::MAX));
        let least = all.map(|found| found.closest.distance);
        least.min_by(f64::total_cmp).expect("a point")
    }

    #[test]
    fn the_ligament_keeps_its_length_and_the_femur_its_distance() {
        let bones = bones(Similarity3::identity());
        let surface = Surface::new(&bones.femur);
        let knee = bones.knee(&surface);
        let (path, model) = (knee.path().expect("a path"), knee.model().expect("a model"));
        assert!(model.gap > 1e-3 && model.points.len() > 50, "{}", model.gap);
        let mut rigid = 0.0_f64;
        for key in &path.keys {
            let turn = UnitQuaternion::from_axis_angle(&knee.axis, key.at);
            let end = knee.centre + turn * (model.tuberosity - knee.centre);
            let length = (posed(&knee, key, &[model.apex])[0] - end).norm();
            let gap = least_gap(&surface, &posed(&knee, key, &model.points));
            if key.at >= 3.0 * FADES {
                assert!(
                    (length / model.ligament - 1.0).abs() <= 0.02,
                    "{key:?} {length}"
                );
            }
            assert!(gap >= 0.8 * model.gap, "{key:?}: {gap}");
            let whole = PathKey {
                angle: key.at,
                translation: Vector3::zeros(),
                ..*key
            };
            let gap = least_gap(&surface, &posed(&knee, &whole, &model.points));
            rigid = rigid.max((gap - model.gap).abs());
        }
        assert!(
            rigid >= 2.0 * model.gap,
            "control: the ball is not about the axis"
        );
        let zero = path
            .keys
            .iter()
            .find(|key| key.at == 0.0)
            .expect("a key at rest");
        assert!(
            zero.angle == 0.0 && zero.translation.norm() <= 1e-17,
            "{zero:?}"
        );
        let [first, last] = [path.keys[0], path.keys[path.keys.len() - 1]];
        assert!(first.at < 0.0 && last.at >= 1.5, "{first:?} {last:?}");
        let grows = |pair: &[PathKey]| pair[1].at > pair[0].at && pair[1].angle > pair[0].angle;
        assert!(
            path.keys.windows(2).all(grows),
            "the patella bends with the knee"
        );
    }

    #[test]
    fn what_the_patella_carries_stays_out_of_the_femur() {
        let bones = bones(Similarity3::identity());
        let surface = Surface::new(&bones.femur);
        let knee = bones.knee(&surface);
        // The end of a tendon behind the upper rim of the patella.
        let end: Vec<Point3<f64>> = (0..5)
            .map(|k| Point3::new(0.032, 0.022, 0.002 * f64::from(k) - 0.004))
            .collect();
        let least = |path: &Path| {
            let gaps = path.keys.iter().map(|key| {
                let there = posed(&knee, key, &end);
                least_gap(&surface, &there)
            });
            gaps.min_by(f64::total_cmp).expect("a key")
        };
        let with = Knee {
            carried: &end,
            ..bones.knee(&surface)
        };
        let [without, with] = [knee.path(), with.path()].map(|path| path.expect("a path"));
        assert!(least(&with) >= 0.0, "{}", least(&with));
        assert!(least(&without) < -5e-4, "control: {}", least(&without));
    }

    #[test]
    fn a_knee_anywhere_and_of_any_size_has_the_same_path() {
        let turn = Rotation3::from_euler_angles(0.4, -1.1, 2.0);
        let into = Similarity3::new(Vector3::new(0.3, -0.9, 0.1), turn.scaled_axis(), 0.6);
        let paths = [Similarity3::identity(), into].map(|into| {
            let bones = bones(into);
            let surface = Surface::new(&bones.femur);
            bones.knee(&surface).path().expect("a path")
        });
        let [usual, other] = &paths;
        assert_eq!(usual.keys.len(), other.keys.len());
        for (a, b) in usual.keys.iter().zip(&other.keys) {
            let moved = turn * a.translation * 0.6 - b.translation;
            assert!((a.angle - b.angle).abs() <= 1e-4, "{a:?} {b:?}");
            assert!(moved.norm() <= 5e-6, "{a:?} {b:?}");
        }
    }

    #[test]
    fn the_slope_of_the_energy_is_its_derivative() {
        let bones = bones(Similarity3::identity());
        let surface = Surface::new(&bones.femur);
        let knee = bones.knee(&surface);
        let model = knee.model().expect("a model");
        for (x, y, z) in [
            (-0.002, 0.001, 0.003),
            (-0.004, -0.006, 0.01),
            (0.0, 0.003, -0.004),
        ] {
            let (place, end) = (Place::new(x, y, z), model.tuberosity);
            let (_, slope, _) = model.energy(&place, &end);
            for k in 0..3 {
                let mut by = Place::zeros();
                by[k] = 1e-7;
                let [low, high] =
                    [-1.0, 1.0].map(|sign| model.energy(&(place + by * sign), &end).0);
                let difference = (high - low) / 2e-7;
                assert!(
                    (difference - slope[k]).abs() <= 1e-3 * slope.norm(),
                    "{k}: {difference} {slope}"
                );
            }
        }
    }

    #[test]
    fn a_patella_that_is_far_away_has_no_path() {
        let mut bones = bones(Similarity3::identity());
        bones.patella.vertices.iter_mut().for_each(|p| p.x += 0.1);
        let surface = Surface::new(&bones.femur);
        assert_eq!(bones.knee(&surface).path(), None);
    }

    /// The bends of the patella [deg] in the model of Rajagopal and others (2016), from cadavers, at 20, 40,
    /// 60, 80 and 90 degrees of the knee.
    const MEASURED: [(f64, f64); 5] = [
        (20.0, 6.0),
        (40.0, 23.7),
        (60.0, 42.8),
        (80.0, 62.5),
        (90.0, 72.4),
    ];

    #[test]
    fn a_real_patella_bends_as_measured_ones() {
        let beside = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
        let folder = std::env::var_os("PLIANT_DATA").map_or(beside, Into::into);
        let bones = folder.join("body/bones");
        if !bones.is_dir() {
            eprintln!("skipped: no measured data; set PLIANT_DATA");
            return;
        }
        let read = |name: &str| pliant::io::read(&bones.join(name)).expect("a bone").mesh;
        let [femur, tibia, patella] = ["Femur.r.obj", "Tibia.r.obj", "Patella.r.obj"].map(read);
        let surfaces = [&femur, &tibia, &patella].map(Surface::new);
        let named = [("femur", &femur), ("tibia", &tibia), ("patella", &patella)];
        let named: Vec<NamedBone<'_>> = named
            .into_iter()
            .zip(&surfaces)
            .map(|((name, mesh), surface)| NamedBone {
                name,
                mesh,
                surface,
            })
            .collect();
        let knee = known("knee")
            .expect("a joint")
            .fit(&named, None)
            .expect("a fit");
        let [(bone, path)] = knee.glides.as_slice() else {
            panic!("one bone glides: {:?}", knee.glides);
        };
        assert_eq!(*bone, 2);
        for (at, measured) in MEASURED {
            let is_it = |key: &&PathKey| (key.at.to_degrees() - at).abs() <= 1e-9;
            let key = path.keys.iter().find(is_it).expect("a key");
            let off = key.angle.to_degrees() - measured;
            // Subjects differ by this much.
            assert!(off.abs() <= 12.0, "{at}: {key:?}");
        }
    }
}
