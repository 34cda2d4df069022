//! Methods of contact detection, compared as in the first source (its section 8). A muscle
//! moves through a bone, and the contacts found have no response. The output contains time, memory
//! and error of each method, and the remaining penetration after each response for vertices in the
//! bone.
//!
//! Before them: the time of the gap, the truncated step and the time of impact of one pair of a
//! vertex and a triangle, or of two edges.
//!
//! The data are rebuilt from the description: two spheres by latitude and longitude, and with
//! `PLIANT_DATA` the gluteus maximus before hip bone and femur. `--test` runs everything on small
//! spheres.

mod measured;

use std::collections::BTreeMap;
use std::hint::black_box;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use measured::{key, note, quick};
use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use peak_alloc::PeakAlloc;
use pliant::contact::{Impact, Parts, Surface, gap, time_of_impact, truncate};
use pliant::mesh::{Topology, TriangleMesh};
use pliant::testing::Draw;
use pliant::testing::internals::contact::{
    Errors, Method, MovedBone, Prepared, Query, compare_responses, methods, queries, timed,
};

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

const MILLIMETRE: f64 = 1e-3;
const FRAMES: usize = 10;

/// Distance that matters to a contact step: a few thicknesses.
const REACH: f64 = 2.0 * MILLIMETRE;

/// Rounding error of a distance, relative to the size of the data.
const ROUNDING: f64 = 1e-13;

/// Vertices `around` times `rings` and two poles, as by VTK's source of spheres.
fn sphere(around: u32, rings: u32, radius: f64) -> TriangleMesh {
    let mut vertices = vec![
        Point3::new(0.0, 0.0, radius),
        Point3::new(0.0, 0.0, -radius),
    ];
    for ring in 1..=rings {
        let polar = std::f64::consts::PI * f64::from(ring) / f64::from(rings + 1);
        for k in 0..around {
            let turn = std::f64::consts::TAU * f64::from(k) / f64::from(around);
            let flat = Vector3::new(turn.cos(), turn.sin(), 0.0) * polar.sin();
            vertices.push(Point3::from((flat + Vector3::z() * polar.cos()) * radius));
        }
    }
    let at = |ring: u32, k: u32| 2 + ring * around + k % around;
    let mut triangles = Vec::new();
    for k in 0..around {
        triangles.extend([
            [0, at(0, k), at(0, k + 1)],
            [1, at(rings - 1, k + 1), at(rings - 1, k)],
        ]);
        for ring in 0..rings - 1 {
            let [a, b, c, d] = [
                at(ring, k),
                at(ring + 1, k),
                at(ring + 1, k + 1),
                at(ring, k + 1),
            ];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    TriangleMesh {
        vertices,
        triangles,
    }
}

/// Each triangle is divided into four: the same surface with about four times the vertices.
fn quartered(mesh: &TriangleMesh) -> TriangleMesh {
    let mut vertices = mesh.vertices.clone();
    let mut middles = BTreeMap::new();
    let mut triangles = Vec::with_capacity(4 * mesh.triangles.len());
    for &[a, b, c] in &mesh.triangles {
        let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(u, v)| {
            *middles.entry((u.min(v), u.max(v))).or_insert_with(|| {
                vertices.push(nalgebra::center(
                    &vertices[u as usize],
                    &vertices[v as usize],
                ));
                vertices.len() as u32 - 1
            })
        });
        triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    TriangleMesh {
        vertices,
        triangles,
    }
}

struct Task {
    name: &'static str,
    bones: Vec<TriangleMesh>,
    muscle: TriangleMesh,
    questions: Vec<Query>,
    /// Motion of the muscle in a frame [m].
    step: Vector3<f64>,
    /// Largest coordinate [m].
    size: f64,
}

impl Task {
    /// The muscle moves by `path` [m] in `FRAMES` frames.
    fn new(
        name: &'static str,
        bones: Vec<TriangleMesh>,
        muscle: TriangleMesh,
        path: [Vector3<f64>; 2],
    ) -> Self {
        let step = (path[1] - path[0]) / (FRAMES - 1) as f64;
        let mut questions = Vec::new();
        let mut size = 0.0_f64;
        for (bone, mesh) in bones.iter().enumerate() {
            let topology = Topology::new(mesh);
            assert!(
                topology.is_closed() && topology.is_oriented(),
                "{name}: bone {bone} is not closed and oriented"
            );
            let own = Surface::new(mesh);
            let bounds = mesh.bounding_box();
            size = size
                .max(bounds.min.coords.amax())
                .max(bounds.max.coords.amax());
            for frame in 0..FRAMES {
                let by = path[0] + step * frame as f64;
                let points = muscle.vertices.iter().map(|v| (v + by, v + by - step));
                questions.extend(queries(bone, mesh, &own, points));
            }
        }
        // A shuffled order, in which any part is representative of the whole.
        let count = questions.len();
        let stride = (0..)
            .map(|k| (count * 618 / 1000).max(1) + k)
            .find(|s| gcd(*s, count) == 1)
            .expect("a stride");
        let mut questions: Vec<Option<Query>> = questions.into_iter().map(Some).collect();
        let questions = (0..count)
            .filter_map(|k| questions[k * stride % count].take())
            .collect();
        Self {
            name,
            bones,
            muscle,
            questions,
            step,
            size,
        }
    }

    fn describe(&self) {
        let bones: Vec<String> = self.bones.iter().map(counts).collect();
        let inside = self.questions.iter().filter(|q| q.inside).count();
        let bones = bones.join(" and of ");
        note(
            &format!("contact.{}.data", key(self.name)),
            format!("muscle of {}, bone of {bones}", counts(&self.muscle)),
        );
        let (asked, inside) = (self.questions.len() / FRAMES, inside / FRAMES);
        note(
            &format!("contact.{}.asked", key(self.name)),
            format!(
                "a frame has {asked} vertices in a bone's box and {inside} in a bone, on average of {FRAMES}"
            ),
        );
    }
}

fn counts(mesh: &TriangleMesh) -> String {
    format!(
        "{} vertices and {} triangles",
        mesh.vertices.len(),
        mesh.triangles.len()
    )
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// All methods at all sizes of the first source, and voxels of the size `largest`.
fn rows(largest: usize) -> Vec<Method> {
    methods(|kind| {
        let more = (kind.name == "voxels").then_some(largest);
        kind.sizes.iter().copied().chain(more).collect()
    })
}

fn measure(task: &Task, (name, sort): &Method, base: usize, budget: Duration) {
    let (before, begin) = (ALLOCATOR.current_usage(), Instant::now());
    let sorted: Vec<Prepared> = task.bones.iter().map(sort).collect();
    let built = begin.elapsed();
    let held =
        ALLOCATOR.current_usage() - before - sorted.capacity() * std::mem::size_of::<Prepared>();
    let bytes: usize = sorted.iter().map(|s| s.obstacle().bytes()).sum();
    assert!(
        bytes.abs_diff(held) as f64 <= 0.02 * held as f64 + 4096.0,
        "{name} says {bytes} bytes and holds {held}"
    );
    let mut errors = Errors::default();
    // A query in seconds, and all queries of a frame in milliseconds.
    let of_frame = |each: f64| each * 1e3 * task.questions.len() as f64 / FRAMES as f64;
    let (distance, asked) = timed(&task.questions, budget, |q| {
        errors.add(
            q,
            sorted[q.bone]
                .obstacle()
                .closest(&q.point)
                .map_or(f64::INFINITY, |c| c.distance),
        );
    });
    let mut near = 0;
    let (within, _) = timed(&task.questions, budget, |q| {
        near += usize::from(sorted[q.bone].is_near(q, REACH))
    });
    let (distance, within) = (of_frame(distance), of_frame(within));
    assert!(near > 0, "{name} finds nothing near");
    let mut diagonal = 0.0_f64;
    for prepared in &sorted {
        if let Prepared::Bits(bits) = prepared {
            diagonal = diagonal.max(bits.diagonal());
        }
    }
    let mut name = name.to_owned();
    if diagonal > 0.0 {
        assert!(
            errors.outside > 0.0 && errors.depth > 0.0,
            "{name} has no error"
        );
        name += &format!(", {:.1} mm from corner to corner", diagonal / MILLIMETRE);
    } else {
        let worst = [errors.outside, errors.depth];
        assert!(
            worst
                .iter()
                .all(|error| *error <= ROUNDING * task.size.max(1.0)),
            "{name} is off by {worst:?} m"
        );
        assert_eq!(
            (errors.kept, errors.lost),
            (0, 0),
            "{name} judges vertices wrongly"
        );
    }
    let index = if matches!(sorted[0], Prepared::Bits(_)) {
        bytes
    } else {
        bytes - base
    };
    println!(
        "ROW contact.{}.ways | {name} | {:.0} | {distance:.2} | {within:.2} | {:.3} | {:.3} | {asked} | {}, {} | {:.3}, {:.3} |",
        key(task.name),
        built.as_secs_f64() * 1e3,
        held as f64 / 1e6,
        index as f64 / 1e6,
        errors.kept,
        errors.lost,
        errors.outside / MILLIMETRE,
        errors.depth / MILLIMETRE,
    );
}

fn compare(task: &Task, largest: usize, budget: Duration) {
    task.describe();
    // All methods but the bits store the same mesh with its topology.
    let rows = rows(largest);
    let brute = &rows[1].1;
    let base = task.bones.iter().map(|b| brute(b).obstacle().bytes()).sum();
    rows.iter()
        .for_each(|method| measure(task, method, base, budget));
}

/// The remaining penetration of the vertices in a bone after each response.
fn remedies(task: &Task) {
    // The muscle moves by a step and the bone stays; seen from the muscle, the bone moves back.
    let (before, now) = (Translation3::from(task.step).into(), Isometry3::identity());
    let bones: Vec<MovedBone> = task
        .bones
        .iter()
        .map(|bone| MovedBone::new(bone, &before, &now))
        .collect();
    let all = task.questions.iter().filter(|q| q.inside).copied();
    let inside: Vec<Query> = all.take(1000).collect();
    let deepest = inside.iter().map(|q| -q.distance).fold(0.0, f64::max);
    note(
        &format!("contact.{}.deep", key(task.name)),
        format!(
            "{} vertices in a bone, of all frames, up to {:.1} mm deep",
            inside.len(),
            deepest / MILLIMETRE
        ),
    );
    for row in compare_responses(&bones, &inside) {
        assert_eq!(row.inside_before, inside.len());
        if ["nearest vertex", "nearest point"].contains(&row.response) {
            assert!(
                row.inside == 0 && row.deeper == 0,
                "{} is inside",
                row.response
            );
        }
        if row.response == "motion of the bone" {
            let step = task.step.norm();
            let is_step = (row.motion_max_m - step).abs() <= ROUNDING * task.size.max(1.0);
            assert!(
                is_step && row.inside > 0,
                "the bone carries by its own motion"
            );
        }
        if row.response == "vector field" {
            assert!(row.inside * 50 <= inside.len(), "the field leads out");
        }
        println!(
            "ROW contact.{}.remedies | {} | {} | {:.3} | {} | {} | {:.3} |",
            key(task.name),
            row.response,
            row.inside,
            row.depth_max_m / MILLIMETRE,
            row.deeper,
            row.coincident,
            row.motion_mean_m / MILLIMETRE
        );
    }
}

/// Two spheres. The smaller sphere moves through the larger, slightly off its centre.
fn artificial(muscle: [u32; 2], bone: [u32; 2]) -> Task {
    let [muscle, bone] = [(muscle, 0.04), (bone, 0.05)]
        .map(|([around, rings], radius)| sphere(around, rings, radius));
    let path = [-1.0, 1.0].map(|side| Vector3::new(side * 0.085, 3.1e-3, 1.7e-3));
    Task::new("spheres", vec![bone], muscle, path)
}

/// The gluteus maximus moves 60 mm towards the centre of the bones.
fn measured(data: &std::path::Path) -> Task {
    let read = |name: &str| pliant::io::read(&data.join(name)).expect("a mesh").mesh;
    let muscle = quartered(&quartered(&read(
        "body/muscles/Gluteus_maximus_muscle.r.obj",
    )));
    let hip = quartered(&quartered(&read("body/bones/Hip_bone.r.obj")));
    let femur = quartered(&read("body/bones/Femur.r.obj"));
    let middle = hip.bounding_box().union(&femur.bounding_box()).center();
    let towards = (middle - muscle.bounding_box().center()).normalize();
    Task::new(
        "gluteus maximus",
        vec![hip, femur],
        muscle,
        [Vector3::zeros(), towards * 0.06],
    )
}

/// A drawn pair and its wanted ends: parts of size 1 whose middles are up to two sizes apart and approach.
struct Drawn {
    parts: Parts,
    start: [Point3<f64>; 4],
    wanted: [Point3<f64>; 4],
}

fn drawn(draw: &mut Draw) -> Drawn {
    let parts = [Parts::VertexTriangle, Parts::EdgeEdge][draw.index(2)];
    let apart = draw.direction() * draw.between(0.0, 2.0);
    let start: [Point3<f64>; 4] = std::array::from_fn(|k| {
        let place = Point3::from(draw.direction() * draw.between(0.0, 1.0));
        if k < parts.first() {
            place + apart
        } else {
            place
        }
    });
    let towards = apart * draw.between(0.0, 1.0);
    let wanted = std::array::from_fn(|k| {
        let own = start[k] + draw.direction() * draw.between(0.0, 0.5);
        if k < parts.first() {
            own - towards
        } else {
            own
        }
    });
    Drawn {
        parts,
        start,
        wanted,
    }
}

/// Median time of a call [ns].
fn each<T>(pairs: &[Drawn], rounds: usize, mut call: impl FnMut(&Drawn) -> T) -> f64 {
    let mut times: Vec<f64> = (0..rounds)
        .map(|_| {
            let all =
                measured::seconds(|| pairs.iter().for_each(|pair| drop(black_box(call(pair)))));
            all * 1e9 / pairs.len() as f64
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[rounds / 2]
}

/// Gap, truncated step and time of impact of single pairs.
fn single_pairs(count: usize, rounds: usize) {
    let mut draw = Draw::new(1);
    let pairs: Vec<Drawn> = (0..count).map(|_| drawn(&mut draw)).collect();
    let (mut apart, mut cut, mut met) = (0, 0, 0);
    for Drawn {
        parts,
        start,
        wanted,
    } in &pairs
    {
        let step = truncate(*parts, start, wanted, [false; 4]);
        let impact = time_of_impact(*parts, start, wanted, 1e-6);
        match gap(*parts, start) {
            Some(_) => {
                apart += 1;
                cut += usize::from(!step.kept);
                let after = time_of_impact(*parts, start, &step.ends, 0.0);
                assert_eq!(after, Impact::Free, "a truncated step is free");
            }
            None => assert!(step.normal.is_none() && impact == Impact::Near(0.0)),
        }
        met += usize::from(impact != Impact::Free);
        assert!(
            impact == Impact::Free || !step.kept,
            "a step through a part is cut"
        );
    }
    assert!(apart > count / 2 && cut > count / 50 && met > count / 50);
    let times = [
        each(&pairs, rounds, |pair| gap(pair.parts, &pair.start)),
        each(&pairs, rounds, |pair| {
            truncate(pair.parts, &pair.start, &pair.wanted, [false; 4])
        }),
        each(&pairs, rounds, |pair| {
            time_of_impact(pair.parts, &pair.start, &pair.wanted, 1e-6)
        }),
    ];
    note(
        "contact.single",
        format!("{count} pairs: {apart} apart, {cut} steps cut, {met} meet"),
    );
    for (name, time) in ["gap", "truncate", "time-of-impact"].into_iter().zip(times) {
        note(&format!("contact.single.{name}"), format!("{time:.0} ns"));
    }
}

fn main() {
    single_pairs(4096, if quick() { 3 } else { 200 });
    if quick() {
        let task = artificial([12, 10], [30, 28]);
        compare(&task, 48, Duration::from_millis(60));
        remedies(&task);
        return;
    }
    let tasks = [
        Some(artificial([48, 46], [300, 298])),
        std::env::var_os("PLIANT_DATA").map(|d| measured(&PathBuf::from(d))),
    ];
    if tasks[1].is_none() {
        println!("skipped the gluteus maximus: PLIANT_DATA is not set");
    }
    for task in tasks.iter().flatten() {
        compare(task, 256, Duration::from_secs(2));
        remedies(task);
    }
}
