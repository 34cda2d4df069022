//! Quantities conserved through 1000 steps of twisting: the volume of a body of tetrahedra, the
//! balance of pressure with a finite bulk modulus, and the sums that define a volume (P36).

use nalgebra::{Point3, Rotation3, Vector3};
use pliant::Particles;
use pliant::constraints::{Distance, EnclosedVolume, Project, SweepOrder};
use pliant::mesh::TriangleMesh;
use pliant::mesh::measures::volume;
use pliant::mesh::shapes::{icosphere, tube};
use pliant::solvers::System;
use pliant::testing::internals::mesh::{NeumaierSum, tree_sum};

use crate::bodies::{batch, edges, finite, hinges, settings};
use crate::tolerances::{T6, worst};

/// Rounding error of a sum of volumes relative to the sum of their sizes, as in the row of P36.
const SUM: f64 = 8.0 * f64::EPSILON;

/// A block of cubes of side `side` [m], each of six tetrahedra about its diagonal.
struct Block {
    vertices: Vec<Point3<f64>>,
    tetrahedra: Vec<[u32; 4]>,
    /// Faces that belong to one tetrahedron only, oriented outward.
    surface: Vec<[u32; 3]>,
    edges: Vec<Distance>,
}

impl Block {
    fn new(cubes: [u32; 3], side: f64) -> Self {
        let [nx, ny, nz] = cubes.map(|n| n + 1);
        let at = |x: u32, y: u32, z: u32| (z * ny + y) * nx + x;
        let mut vertices = Vec::new();
        for (z, y, x) in
            (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| (z, y, x))))
        {
            vertices.push(Point3::new(f64::from(x), f64::from(y), f64::from(z)) * side);
        }
        let mut tetrahedra = Vec::new();
        for (z, y, x) in (0..cubes[2])
            .flat_map(|z| (0..cubes[1]).flat_map(move |y| (0..cubes[0]).map(move |x| (z, y, x))))
        {
            for [a, b] in [[1, 3], [3, 2], [2, 6], [6, 4], [4, 5], [5, 1]] {
                let corner = |k: u32| at(x + (k & 1), y + (k >> 1 & 1), z + (k >> 2));
                tetrahedra.push([0, a, b, 7].map(corner));
            }
        }
        let (surface, pairs) = (boundary(&tetrahedra), pairs(&tetrahedra));
        let length = |[a, b]: [u32; 2]| (vertices[a as usize] - vertices[b as usize]).norm();
        let edges = pairs
            .iter()
            .map(|&points| Distance {
                points,
                rest: length(points),
            })
            .collect();
        Self {
            vertices,
            tetrahedra,
            surface,
            edges,
        }
    }

    /// Volumes of the tetrahedra [m^3].
    fn volumes(&self, x: &[Point3<f64>]) -> Vec<f64> {
        let of = |t: &[u32; 4]| {
            let [o, a, b, c] = t.map(|v| x[v as usize]);
            (a - o).dot(&(b - o).cross(&(c - o))) / 6.0
        };
        self.tetrahedra.iter().map(of).collect()
    }
}

fn pairs(tetrahedra: &[[u32; 4]]) -> Vec<[u32; 2]> {
    let mut all: Vec<[u32; 2]> = Vec::new();
    for t in tetrahedra {
        all.extend(
            [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]].map(|[a, b]: [usize; 2]| {
                let [a, b] = [t[a], t[b]];
                [a.min(b), a.max(b)]
            }),
        );
    }
    all.sort_unstable();
    all.dedup();
    all
}

fn boundary(tetrahedra: &[[u32; 4]]) -> Vec<[u32; 3]> {
    let sorted = |mut t: [u32; 3]| {
        t.sort_unstable();
        t
    };
    let faces: Vec<[u32; 3]> = tetrahedra
        .iter()
        .flat_map(|&[o, a, b, c]| [[o, b, a], [o, a, c], [o, c, b], [a, b, c]])
        .collect();
    let mut keys: Vec<[u32; 3]> = faces.iter().map(|&f| sorted(f)).collect();
    keys.sort_unstable();
    let count =
        |key: [u32; 3]| keys.partition_point(|k| *k <= key) - keys.partition_point(|k| *k < key);
    faces
        .into_iter()
        .filter(|&f| count(sorted(f)) == 1)
        .collect()
}

/// The angle [rad] of the rotated end at a step: back and forth, twice.
fn angle(step: u32) -> f64 {
    1.5 * (f64::from(step) * 0.0126).sin()
}

/// Vertices at both ends along x, and whether each is rotated.
fn ends(vertices: &[Point3<f64>]) -> Vec<(usize, bool)> {
    let low = vertices.iter().map(|p| p.x).fold(f64::INFINITY, f64::min);
    let high = vertices
        .iter()
        .map(|p| p.x)
        .fold(f64::NEG_INFINITY, f64::max);
    let near = 1e-9 * (high - low);
    let at = |v: usize| (vertices[v].x - low <= near || high - vertices[v].x <= near).then_some(v);
    (0..vertices.len())
        .filter_map(at)
        .map(|v| (v, high - vertices[v].x <= near))
        .collect()
}

/// Rotates one end about the axis through `centre` along x.
fn pose(
    x: &mut [Point3<f64>],
    rest: &[Point3<f64>],
    ends: &[(usize, bool)],
    centre: &Point3<f64>,
    angle: f64,
) {
    let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), angle);
    ends.iter()
        .filter(|(_, turned)| *turned)
        .for_each(|&(v, _)| x[v] = centre + turn * (rest[v] - centre));
}

#[test]
fn p36_a_body_of_tetrahedra_keeps_its_volume_through_twisting() {
    let block = Block::new([6, 2, 2], 0.05);
    let rest = tree_sum(&block.volumes(&block.vertices));
    assert!((rest - 0.3 * 0.1 * 0.1).abs() <= SUM * rest, "{rest}");
    let (count, held) = (block.vertices.len(), ends(&block.vertices));
    let centre = Point3::new(0.0, 0.05, 0.05);
    for k in [0.7, 1.0, 1.5] {
        let mut particles = Particles::at_rest(block.vertices.clone(), vec![1e3; count]);
        held.iter()
            .for_each(|&(v, _)| particles.inverse_mass[v] = 0.0);
        let mut system = System::new(particles, settings(1));
        system.elastic.push(Box::new(batch(
            block.edges.clone(),
            1e-3,
            SweepOrder::Coloured,
            count,
        )));
        system.volume = Some(EnclosedVolume::new(&block.surface, count, k * rest, 0.0));
        let (mut kept, mut same) = (Vec::new(), Vec::new());
        for step in 0..1000 {
            pose(
                &mut system.particles.position,
                &block.vertices,
                &held,
                &centre,
                angle(step),
            );
            system.step(&[], 0.002).expect("finite");
            assert!(finite(&system.particles));
            let of = block.volumes(&system.particles.position);
            let sizes: f64 = of.iter().map(|v| v.abs()).sum();
            let whole = tree_sum(&of);
            kept.push((whole / (k * rest) - 1.0).abs());
            same.push((volume(&system.particles.position, &block.surface) - whole).abs() / sizes);
        }
        println!(
            "tetrahedra, k {k}: volume off by {:.1e}, sums by {:.1e}",
            worst(kept.clone()),
            worst(same.clone())
        );
        assert!(worst(kept) <= T6, "k {k}");
        assert!(
            worst(same.iter().copied()) <= SUM,
            "k {k}: {:e}",
            worst(same)
        );
    }
}

#[test]
fn without_the_constraint_a_body_of_tetrahedra_does_not() {
    let block = Block::new([6, 2, 2], 0.05);
    let mut twisted = block.vertices.clone();
    for p in &mut twisted {
        let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), 1.5 * p.x / 0.3);
        *p = turn * *p;
    }
    let ratio = tree_sum(&block.volumes(&twisted)) / tree_sum(&block.volumes(&block.vertices));
    assert!(!((ratio - 1.0).abs() <= T6), "{ratio}");
    // Control of the identity: a surface with a missing triangle.
    let open = &block.surface[1..];
    let off = (volume(&twisted, open) - tree_sum(&block.volumes(&twisted))).abs();
    assert!(!(off <= SUM * tree_sum(&block.volumes(&twisted))));
}

/// Greatest difference between the applied pressure and that of the bulk modulus, and between
/// any vertex's displacement and that of the pressure; both relative to the greatest value.
fn imbalance(bulk: f64, claimed: f64) -> [f64; 2] {
    let mesh = tube(0.05, 0.3, 10);
    let (count, dt, v0) = (mesh.vertices.len(), 0.002, mesh.volume());
    let held = ends(&mesh.vertices);
    let mut particles = Particles::at_rest(mesh.vertices.clone(), vec![1e3; count]);
    held.iter()
        .for_each(|&(v, _)| particles.inverse_mass[v] = 0.0);
    let mut net = batch(edges(&mesh), 1e-3, SweepOrder::Coloured, count);
    let mut bent = batch(hinges(&mesh), 1e2, SweepOrder::Coloured, count);
    let mut closed = EnclosedVolume::new(&mesh.triangles, count, v0, v0 / bulk);
    let (mut pressures, mut off, mut astray, mut sizes) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for step in 0..1000 {
        let start = particles.position.clone();
        particles
            .position
            .iter_mut()
            .zip(&particles.velocity)
            .for_each(|(x, v)| *x += v * dt);
        pose(
            &mut particles.position,
            &mesh.vertices,
            &held,
            &Point3::origin(),
            angle(step),
        );
        net.begin_step();
        bent.begin_step();
        closed.begin_step();
        net.project(&mut particles, dt);
        bent.project(&mut particles, dt);
        let before = particles.position.clone();
        closed.project(&mut particles, dt).expect("a root");
        let (_, gradient) = closed.value_and_gradient(&before);
        let moved: Vec<Vector3<f64>> = particles
            .position
            .iter()
            .zip(&before)
            .map(|(x, b)| x - b)
            .collect();
        let weighed = || particles.inverse_mass.iter().zip(&gradient);
        let along: f64 = moved.iter().zip(&gradient).map(|(d, g)| d.dot(g)).sum();
        let impulse = along / weighed().map(|(w, g)| w * g.norm_squared()).sum::<f64>();
        sizes.push(worst(moved.iter().map(Vector3::norm)));
        astray.push(worst(
            moved
                .iter()
                .zip(weighed())
                .map(|(d, (w, g))| (d - g * (w * impulse)).norm()),
        ));
        let strain = volume(&particles.position, &mesh.triangles) / v0 - 1.0;
        pressures.push(impulse / (dt * dt));
        off.push(impulse / (dt * dt) + claimed * strain);
        particles.velocity = particles
            .position
            .iter()
            .zip(&start)
            .map(|(x, s)| (x - s) / dt)
            .collect();
        held.iter()
            .for_each(|&(v, _)| particles.velocity[v] = Vector3::zeros());
    }
    let greatest = worst(pressures.iter().map(|p| p.abs()));
    [
        worst(off.iter().map(|o| o.abs())) / greatest,
        worst(astray) / worst(sizes),
    ]
}

#[test]
fn p36_the_pressure_balances_the_bulk_modulus_after_every_step() {
    for bulk in [1e3, 2e4] {
        let [off, astray] = imbalance(bulk, bulk);
        println!("bulk modulus {bulk}: pressure off by {off:.1e}, displacements by {astray:.1e}");
        assert!(off <= T6, "bulk modulus {bulk}: {off:e}");
        assert!(
            astray <= T6,
            "bulk modulus {bulk}: displacements off by {astray:e}"
        );
        let [wrong, _] = imbalance(bulk, 1.001 * bulk);
        assert!(!(wrong <= T6), "control: another bulk modulus, {wrong:e}");
    }
}

#[test]
fn p36_volumes_are_sums_and_do_not_depend_on_the_place() {
    let grid = f64::from(1 << 20);
    let shapes = [icosphere(0.3, 3), tube(0.05, 0.3, 10)];
    for mut mesh in shapes {
        mesh.vertices
            .iter_mut()
            .for_each(|p| *p = p.map(|c| (c * grid).round() / grid));
        let cones = |apex: Vector3<f64>| {
            let of = |t: &[u32; 3]| {
                let [a, b, c] = t.map(|v| mesh.vertices[v as usize].coords - apex);
                a.dot(&b.cross(&c)) / 6.0
            };
            mesh.triangles.iter().map(of).collect::<Vec<f64>>()
        };
        for apex in [
            Vector3::zeros(),
            Vector3::new(0.2, -0.1, 0.3),
            Vector3::new(-3.0, 2.0, 1.0),
        ] {
            let of = cones(apex);
            let mut kept = NeumaierSum::default();
            of.iter().for_each(|v| kept.add(*v));
            let sizes: f64 = of.iter().map(|v| v.abs()).sum();
            let off = (kept.total() - mesh.volume()).abs() / sizes;
            assert!(off <= SUM, "{off:e}");
            assert!((tree_sum(&of) - kept.total()).abs() <= SUM * sizes);
        }
        // On a grid of 2^-20 m the translation rounds no coordinate.
        let by = Vector3::new(1.0, -1.0, 0.5) * f64::from(1 << 25);
        let moved = TriangleMesh {
            vertices: mesh.vertices.iter().map(|p| p + by).collect(),
            ..mesh.clone()
        };
        assert_eq!(moved.volume().to_bits(), mesh.volume().to_bits());
        let of = |m: &TriangleMesh| {
            EnclosedVolume::new(&m.triangles, m.vertices.len(), 0.0, 0.0)
                .value_and_gradient(&m.vertices)
        };
        assert!(
            of(&moved) == of(&mesh),
            "volume and gradient far off differ"
        );
        // Control: relative to the origin of space instead of the body, digits are lost.
        let far = |m: &TriangleMesh| {
            let of = |t: &[u32; 3]| {
                let [a, b, c] = t.map(|v| m.vertices[v as usize].coords);
                a.dot(&b.cross(&c)) / 6.0
            };
            tree_sum(&m.triangles.iter().map(of).collect::<Vec<_>>())
        };
        assert!(!((far(&moved) / mesh.volume() - 1.0).abs() <= T6));
    }
}
