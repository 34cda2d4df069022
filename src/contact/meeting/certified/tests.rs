//! Acceptance of the guarantee: shots at thin sheets, a pressed stack, folds and tubes that meet
//! themselves, momentum, mirror images. Crossings are counted by the search of the audit.

use nalgebra::{Point3, Vector3};

use super::{Draw, Meeting, MeetingSettings, Parts, SoftMember, TriangleMesh, keep};
use crate::mesh::SurfaceTree;
use crate::mesh::crossings::{Crossed, self_crossings};
use crate::mesh::predicates::is_flat;
use crate::mesh::shapes::{box_surface, icosphere, sheet, tube};
use crate::testing::tolerances::{T8, cases};

type Places = Vec<Vec<Point3<f64>>>;

/// What of the guarantee acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Guard {
    All,
    /// Pairs of a vertex and a triangle alone.
    WithoutEdges,
    Nothing,
}

/// Surfaces that meet.
struct Scene {
    meshes: Vec<TriangleMesh>,
    meeting: Meeting,
    guard: Guard,
}

impl Scene {
    /// Surfaces with one inverse mass each; those of zero are held.
    fn new(thickness: f64, meshes: Vec<TriangleMesh>, mass: &[f64], guard: Guard) -> Self {
        let masses: Vec<Vec<f64>> = meshes
            .iter()
            .zip(mass)
            .map(|(mesh, w)| vec![*w; mesh.vertices.len()])
            .collect();
        let members: Vec<SoftMember<'_>> = meshes
            .iter()
            .zip(&masses)
            .map(|(mesh, inverse_mass)| SoftMember {
                mesh,
                inverse_mass,
                obstacles: &[],
            })
            .collect();
        let mut partners = Vec::new();
        for a in 0..meshes.len() {
            partners.extend((a + 1..meshes.len()).map(|b| [a, b]));
        }
        let settings = MeetingSettings {
            thickness,
            over_bone: 0.5,
            rounding: 0.0,
            friction: 0.0,
            others: true,
            bones: false,
            itself: true,
        };
        let mut meeting = Meeting::new(settings, &members, &partners, &[], |_| None);
        if guard == Guard::WithoutEdges {
            // Lists of all pairs, which are never made anew.
            meeting.margin = 1e3;
        }
        Self {
            meshes,
            meeting,
            guard,
        }
    }

    fn starts(&self) -> Places {
        self.meshes.iter().map(|m| m.vertices.clone()).collect()
    }

    /// A step to `ends`, as far as the guarantee lets it.
    fn step(&mut self, ends: Places) {
        let starts = self.starts();
        let starts: Vec<&[Point3<f64>]> = starts.iter().map(Vec::as_slice).collect();
        for (mesh, end) in self.meshes.iter_mut().zip(ends) {
            mesh.vertices = end;
        }
        if self.guard == Guard::Nothing {
            return;
        }
        if self.guard == Guard::WithoutEdges {
            self.meeting.begin_frame(&starts, &[]);
            self.meeting.look(|_, _, _, _: &mut Vec<()>| ());
            keep(&mut self.meeting, |pair, _| {
                pair.parts == Parts::VertexTriangle
            });
        }
        self.meeting.begin_step(&starts, &[]);
        let mut bodies: Vec<&mut [Point3<f64>]> = self
            .meshes
            .iter_mut()
            .map(|m| m.vertices.as_mut_slice())
            .collect();
        self.meeting.respond(&mut bodies, None);
        self.meeting.hold(&mut bodies, None);
    }

    /// Pairs of triangles that cross, of all surfaces and within each.
    fn crossings(&self) -> usize {
        let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
        for mesh in &self.meshes {
            let first = vertices.len() as u32;
            vertices.extend_from_slice(&mesh.vertices);
            triangles.extend(mesh.triangles.iter().map(|t| t.map(|v| v + first)));
        }
        let names: Vec<u32> = (0..vertices.len() as u32).collect();
        let flat = |t: &[u32; 3]| is_flat(&t.map(|v| vertices[v as usize]));
        let skipped: Vec<bool> = triangles.iter().map(flat).collect();
        let found = self_crossings(
            Crossed {
                vertices: &vertices,
                triangles: &triangles,
                names: &names,
                skipped: &skipped,
                tree: &SurfaceTree::new(&vertices, &triangles),
            },
            1,
        );
        assert!(found.complete);
        found.count
    }
}

/// Thickness of a sheet with sides of 1 m [m].
const THIN: f64 = 1e-4;

/// A body over the sheet: small, or longer than the sheet.
fn body(draw: &mut Draw, is_long: bool) -> TriangleMesh {
    let size = draw.decades(-3.0, -1.0);
    let mut vertices: Vec<Point3<f64>> = draw.shape(4).iter().map(|x| x * size).collect();
    if is_long {
        vertices[3] += Vector3::new(0.2, 0.1, 2.5) + draw.direction() * 0.2;
    }
    let least = vertices.iter().map(|x| x.z).fold(f64::INFINITY, f64::min);
    let up = 0.5 * THIN + draw.decades(-6.0, -0.3) - least;
    let at = Vector3::new(draw.between(-0.3, 0.3), draw.between(-0.3, 0.3), up);
    vertices.iter_mut().for_each(|x| *x += at);
    TriangleMesh {
        vertices,
        triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
    }
}

/// Shoots a body at a sheet, in two steps of up to 10,000 thicknesses. Returns true if something is
/// where it must not be.
fn shot(seed: u64, guard: Guard) -> bool {
    let mut draw = Draw::new(seed);
    // Bodies that a free sheet could let through whole are not seen by crossings.
    let is_long = draw.index(2) == 0;
    let is_held = !is_long || draw.index(2) == 0;
    let sheet = box_surface([1.0, 1.0, THIN], 0.25);
    let masses = [if is_held { 0.0 } else { 1.0 }, draw.decades(-2.0, 2.0)];
    let mut scene = Scene::new(
        0.1 * THIN,
        vec![sheet, body(&mut draw, is_long)],
        &masses,
        guard,
    );
    let aside = draw.decades(-4.0, 0.0) * 0.1;
    let by = Vector3::new(
        draw.between(-1.0, 1.0) * aside,
        draw.between(-1.0, 1.0) * aside,
        -draw.decades(-6.0, 0.0),
    );
    let noise = by.norm() * 0.1;
    for _ in 0..2 {
        let mut ends = scene.starts();
        for x in &mut ends[1] {
            *x += by + draw.direction() * draw.between(0.0, noise);
        }
        scene.step(ends);
        let over = |x: &&Point3<f64>| x.x.abs() <= 0.5 && x.y.abs() <= 0.5;
        let mut below = scene.meshes[1].vertices.iter().filter(over);
        // The top of a held sheet is a plane of constant z: the comparison is exact.
        if is_held && below.any(|x| !(x.z > 0.5 * THIN)) {
            return true;
        }
        if scene.crossings() > 0 {
            return true;
        }
    }
    assert_eq!(scene.meeting.take_certificate().open, 0, "seed {seed}");
    false
}

#[test]
fn a4_no_shot_goes_through_a_thin_sheet() {
    let count = cases(300) as u64;
    for seed in 0..count {
        assert!(!shot(seed, Guard::All), "seed {seed}");
    }
    let through = (0..100).filter(|&seed| shot(seed, Guard::Nothing)).count();
    println!("{count} shots, none through; without the guarantee {through} of 100");
    assert!(through > 50, "control: {through}");
}

/// Height of sheet `top` over sheet `low` at a vertex, if it is over a triangle: the sign of the
/// height over the plane of that triangle.
fn is_above(x: &Point3<f64>, low: &TriangleMesh) -> Option<bool> {
    use crate::mesh::predicates::{side, turn};
    let (corners, signs) = (0..low.triangles.len()).find_map(|t| {
        let corners = low.corners(t);
        let [a, b, c] = &corners;
        let signs = [turn(2, a, b, x), turn(2, b, c, x), turn(2, c, a, x)];
        let is_in = signs.iter().all(|s| *s >= 0.0) || signs.iter().all(|s| *s <= 0.0);
        is_in.then_some((corners, signs))
    })?;
    let is_up = signs.iter().sum::<f64>() > 0.0;
    // `side` is negative above a triangle that is counterclockwise from above.
    Some((side(&corners, x) < 0.0) == is_up)
}

/// 50 sheets, 1 mm apart; the last or the first one is driven towards the other end, to 60 % of the
/// height in `frames` steps. Returns
/// crossings, vertices out of order and open pairs.
fn stack(frames: usize, from_top: bool, guard: Guard) -> (usize, usize, u64) {
    const SHEETS: usize = 50;
    let gap = 1e-3;
    let meshes: Vec<TriangleMesh> = (0..SHEETS)
        .map(|k| {
            let mut mesh = sheet(0.1, 4);
            mesh.vertices.iter_mut().for_each(|x| x.z = gap * k as f64);
            mesh
        })
        .collect();
    let is_held = |k: usize| k == 0 || k == SHEETS - 1;
    let mass: Vec<f64> = (0..SHEETS)
        .map(|k| if is_held(k) { 0.0 } else { 1.0 })
        .collect();
    let rest = meshes.clone();
    let mut scene = Scene::new(0.5 * gap, meshes, &mass, guard);
    let mut draw = Draw::new(50);
    let down = 0.4 * gap * (SHEETS - 1) as f64 / frames as f64;
    let (mut crossed, mut swapped) = (0, 0);
    for frame in 0..frames {
        let mut ends = scene.starts();
        for (k, x) in ends.iter_mut().enumerate() {
            if is_held(k) {
                let by = if (k > 0) == from_top { down } else { 0.0 };
                x.iter_mut()
                    .for_each(|x| x.z -= if k > 0 { by } else { -by });
            } else {
                for (x, rest) in x.iter_mut().zip(&rest[k].vertices) {
                    let back = (rest - *x) * 0.2;
                    *x += Vector3::new(back.x, back.y, 0.0) + draw.direction() * (0.3 * gap);
                }
            }
        }
        scene.step(ends);
        if frame % 5 == 4 || frame + 1 == frames {
            crossed += scene.crossings();
            for k in 1..SHEETS {
                let low = &scene.meshes[k - 1];
                let over = scene.meshes[k]
                    .vertices
                    .iter()
                    .filter_map(|x| is_above(x, low));
                swapped += over.filter(|above| !above).count();
            }
        }
        if crossed + swapped > 0 {
            break;
        }
    }
    (crossed, swapped, scene.meeting.take_certificate().open)
}

#[test]
fn a5_a_pressed_stack_keeps_its_order() {
    assert_eq!(stack(cases(80), false, Guard::All), (0, 0, 0));
    // Against the order of pairs, and by half a gap a step.
    assert_eq!(stack(40, true, Guard::All), (0, 0, 0));
    let (crossed, swapped, _) = stack(40, false, Guard::Nothing);
    assert!(crossed > 0 && swapped > 0, "control: {crossed} {swapped}");
}

/// Squeezes a surface by a map of each vertex and by noise, in `steps`. Returns the crossings at the
/// first step that has some.
fn squeezed(
    (mesh, thickness, noise): (TriangleMesh, f64, f64),
    steps: usize,
    seed: u64,
    guard: Guard,
    map: impl Fn(&Point3<f64>) -> Point3<f64>,
) -> usize {
    let mut draw = Draw::new(seed);
    let mut scene = Scene::new(thickness, vec![mesh], &[1.0], guard);
    for _ in 0..steps {
        let mut ends = scene.starts();
        for x in &mut ends[0] {
            *x = map(x) + draw.direction() * draw.between(0.0, noise);
        }
        scene.step(ends);
        let count = scene.crossings();
        if count > 0 {
            return count;
        }
    }
    0
}

/// A sheet folded like a fan is closed to a fist.
fn fist(seed: u64, guard: Guard) -> usize {
    let mut mesh = sheet(0.2, 10);
    for x in &mut mesh.vertices {
        let column = ((x.x / 0.2 + 0.5) * 10.0).round();
        (x.x, x.z) = (
            0.006 * (column - 5.0),
            if column % 2.0 == 0.0 { 0.01 } else { -0.01 },
        );
    }
    squeezed((mesh, 5e-4, 6e-3), 25, seed, guard, |x| x * 0.92)
}

/// A tube is pressed flat in its middle.
fn flattened(seed: u64, guard: Guard) -> usize {
    let mesh = tube(0.03, 0.12, 12);
    squeezed((mesh, 5e-4, 4e-3), 25, seed, guard, |x| {
        let share = 0.75 + 0.25 * (x.x / 0.06).powi(2).min(1.0);
        Point3::new(x.x, x.y, x.z * share)
    })
}

#[test]
fn a7_a_fist_and_a_squeezed_tube_do_not_cross_themselves() {
    for squeeze in [fist, flattened] {
        for seed in 0..cases(4) as u64 {
            assert_eq!(squeeze(seed, Guard::All), 0, "seed {seed}");
        }
        let without = (0..20)
            .map(|seed| squeeze(seed, Guard::WithoutEdges))
            .find(|n| *n > 0);
        println!("without planes of edges: {without:?} crossings");
        assert!(without.is_some(), "control: planes of edges are needed");
    }
}

/// Two balls of 10 cm, mirror images in x = 0, 2 mm apart.
fn mirrored_balls() -> Vec<TriangleMesh> {
    let mut left = icosphere(0.1, 2);
    left.vertices
        .iter_mut()
        .for_each(|x| *x = Point3::new(x.x - 0.101, 0.9 * x.y, 1.2 * x.z));
    let mut right = left.clone();
    right.vertices.iter_mut().for_each(|x| x.x = -x.x);
    vec![left, right]
}

#[test]
fn a8_the_impulses_of_a_pair_sum_to_zero() {
    let mut scene = Scene::new(2e-3, mirrored_balls(), &[1.0, 0.3], Guard::All);
    let mut draw = Draw::new(8);
    let mut count = 0;
    for _ in 0..10 {
        let mut ends = scene.starts();
        for (x, sign) in ends.iter_mut().zip([1.0, -1.0]) {
            x.iter_mut()
                .for_each(|x| *x += Vector3::x() * (sign * 1e-3) + draw.direction() * 2e-4);
        }
        scene.step(ends);
        for row in scene.meeting.rows.iter().filter(|row| row.is_pushed()) {
            let impulses = row.impulses();
            let sizes: f64 = impulses.iter().map(|(_, p)| p.norm()).sum();
            let sum: Vector3<f64> = impulses.iter().map(|(_, p)| p).sum();
            assert!(sum.norm() <= T8 * sizes, "{} of {sizes}", sum.norm());
            // Closest points at the start lie on one line along the normal.
            let arm = |v: &u32| scene.meeting.start[*v as usize].coords;
            let torque: Vector3<f64> = impulses.iter().map(|(v, p)| arm(v).cross(p)).sum();
            let levers: f64 = impulses.iter().map(|(v, p)| arm(v).norm() * p.norm()).sum();
            assert!(
                torque.norm() <= 1e3 * T8 * levers,
                "{} of {levers}",
                torque.norm()
            );
            let forgotten: Vector3<f64> = impulses[1..].iter().map(|(_, p)| p).sum();
            assert!(
                forgotten.norm() > 1e-3 * sizes,
                "control: one corner is left out"
            );
            count += 1;
        }
    }
    assert!(count > 50, "{count}");
}

/// Drives two mirrored balls into each other for some steps, all reflected in x = 0 if `sign` is -1.
fn driven(sign: f64) -> Places {
    let mut meshes = mirrored_balls();
    let reflect = |x: &mut Point3<f64>| x.x *= sign;
    meshes
        .iter_mut()
        .flat_map(|m| &mut m.vertices)
        .for_each(reflect);
    let mut scene = Scene::new(2e-3, meshes, &[1.0, 1.0], Guard::All);
    let mut draw = Draw::new(80);
    for _ in 0..8 {
        let mut ends = scene.starts();
        for v in 0..ends[0].len() {
            let by = Vector3::x() * 2e-3 + draw.direction() * 1e-3;
            ends[0][v] += Vector3::new(sign * by.x, by.y, by.z);
            ends[1][v] += Vector3::new(-sign * by.x, by.y, by.z);
        }
        scene.step(ends);
    }
    let counts = scene.meeting.take_certificate();
    assert!(counts.pairs > 0 && counts.open == 0);
    scene.starts()
}

#[test]
fn a8_a_reflected_scene_has_the_reflected_bits() {
    let (one, other) = (driven(1.0), driven(-1.0));
    for (a, b) in one.iter().flatten().zip(other.iter().flatten()) {
        assert_eq!([a.x, a.y, a.z], [-b.x, b.y, b.z]);
    }
}
