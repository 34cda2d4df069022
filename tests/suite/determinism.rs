//! The same bits for any number of threads and any order within a colour (P42, P43).

use nalgebra::{Point3, Vector3};
use pliant::Particles;
use pliant::constraints::{Batch, Constraint, Distance, Project, SweepOrder};
use pliant::contact::Contacts;
use pliant::mesh::shapes::icosphere;
use pliant::mesh::{Topology, TriangleMesh};
use pliant::testing::Draw;
use pliant::testing::internals::constraints::Block;
use pliant::testing::internals::mesh::{order, tree_sum};
use pliant::testing::internals::particles::Numbering;

use crate::bodies::{batch, bits, edges, elastic, finite, hinges, still};

/// Sets of at least this number of constraints, times their points squared, are swept in parallel;
/// as in `constraints/batch.rs`.
const PARALLEL: usize = 262_144;

fn with_threads<T: Send>(threads: usize, deed: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("a pool")
        .install(deed)
}

/// 163,842 vertices in an order with blocks, perturbed so that every constraint is violated.
fn shaken() -> (TriangleMesh, Vec<Point3<f64>>) {
    let mesh = icosphere(1.0, 7);
    shake(order::apply(
        &mesh,
        &order::permutation(&Topology::new(&mesh)),
    ))
}

fn shake(mesh: TriangleMesh) -> (TriangleMesh, Vec<Point3<f64>>) {
    let mut draw = Draw::new(42);
    let moved = mesh
        .vertices
        .iter()
        .map(|p| p + draw.direction() * 0.003)
        .collect();
    (mesh, moved)
}

fn sweep(batches: &mut [Box<dyn Project>], x: &[Point3<f64>]) -> Vec<u64> {
    let mut particles = Particles::at_rest(
        x.to_vec(),
        (0..x.len()).map(|i| 1.0 + (i % 7) as f64).collect(),
    );
    for _ in 0..3 {
        batches
            .iter_mut()
            .for_each(|b| b.project(&mut particles, 0.01));
    }
    assert!(finite(&particles));
    bits(&particles)
}

#[test]
fn p42_threads_change_no_bit() {
    let (mesh, x) = shaken();
    let make = |order: SweepOrder| -> Vec<Box<dyn Project>> {
        let stretch = batch(edges(&mesh), 1e-6, order, x.len());
        let bending = batch(hinges(&mesh), 1e-2, order, x.len());
        assert!(stretch.len() * 4 >= PARALLEL && bending.len() * 16 >= PARALLEL);
        let blocks = |phases: &[Vec<Block>]| phases.iter().take(2).map(Vec::len).min();
        assert!(order != SweepOrder::Coloured || blocks(&stretch.schedule().phases) >= Some(8));
        assert!(order != SweepOrder::Coloured || blocks(&bending.schedule().phases) >= Some(8));
        vec![Box::new(stretch), Box::new(bending)]
    };
    let reference = with_threads(1, || sweep(&mut make(SweepOrder::Coloured), &x));
    for threads in [2, 3, 4, 8] {
        let other = with_threads(threads, || sweep(&mut make(SweepOrder::Coloured), &x));
        assert!(other == reference, "{threads} threads");
    }
    // Control: another order of colours gives another result, so equality is no accident.
    assert!(with_threads(1, || sweep(&mut make(SweepOrder::Stored), &x)) != reference);
}

#[test]
fn p42_order_within_a_colour_changes_no_bit() {
    let (mesh, x) = shaken();
    let coloured: Batch<Distance, 2> = batch(edges(&mesh), 1e-6, SweepOrder::Coloured, x.len());
    let mut draw = Draw::new(421);
    let mut reference: Vec<Box<dyn Project>> = vec![Box::new(coloured.clone())];
    let reference = with_threads(1, || sweep(&mut reference, &x));
    for _ in 0..3 {
        let mut shuffled = coloured.constraints();
        for range in &coloured.schedule().colours {
            for i in (range.start + 1..range.end).rev() {
                shuffled.swap(i, range.start + draw.index(i + 1 - range.start));
            }
        }
        assert_ne!(shuffled, coloured.constraints());
        let mut other: Vec<Box<dyn Project>> =
            vec![Box::new(batch(shuffled, 1e-6, SweepOrder::Stored, x.len()))];
        assert!(
            with_threads(1, || sweep(&mut other, &x)) == reference,
            "seed {}",
            draw.seed
        );
    }
}

#[test]
fn p42_a_numbering_moves_memory_and_no_bit() {
    // The same constraints on the same particles: once with new indices, once with a numbering.
    let (mesh, x) = shake(icosphere(1.0, 6));
    let permutation = order::permutation(&Topology::new(&mesh));
    let numbering = Numbering::new(permutation.clone());
    let place = |p: u32| numbering.place(p);
    let there = edges(&mesh);
    let anew = there
        .iter()
        .map(|e| Distance {
            points: e.points.map(place),
            ..*e
        })
        .collect();
    let compliance = vec![1e-6; there.len()];
    let over = (&numbering, x.len());
    let mut numbered = Batch::numbered(
        there.clone(),
        compliance.clone(),
        SweepOrder::Coloured,
        over,
        &[],
    );
    let run = |batch: &mut dyn Project, x: &[Point3<f64>], order: &[u32]| {
        let masses = (0..x.len()).map(|i| 1.0 + (order[i] % 7) as f64).collect();
        let mut particles = Particles::at_rest(x.to_vec(), masses);
        (0..3).for_each(|_| batch.project(&mut particles, 0.01));
        particles.position
    };
    let straight: Vec<u32> = (0..x.len() as u32).collect();
    let kept = run(&mut numbered, &x, &straight);
    let moved: Vec<Point3<f64>> = permutation.iter().map(|&p| x[p as usize]).collect();
    let mut batch: Batch<Distance, 2> =
        Batch::new(anew, compliance.clone(), SweepOrder::Coloured, x.len(), &[]);
    let other = run(&mut batch, &moved, &permutation);
    assert!((0..x.len()).all(|p| kept[p] == other[place(p as u32) as usize]));
    // Control: without the numbering the blocks differ, and so do the bits.
    let mut plain: Batch<Distance, 2> =
        Batch::new(there, compliance, SweepOrder::Coloured, x.len(), &[]);
    assert!(run(&mut plain, &x, &straight) != kept);
}

/// True if two constraints of a range share a particle.
fn shares<C: Constraint<K>, const K: usize>(all: &[C], count: usize) -> bool {
    let mut seen = vec![false; count];
    all.iter()
        .flat_map(|c| c.points())
        .any(|p| std::mem::replace(&mut seen[p as usize], true))
}

#[test]
fn p42_no_two_constraints_of_a_colour_share_a_particle() {
    let (mesh, x) = shaken();
    let stretch: Batch<Distance, 2> = batch(edges(&mesh), 0.0, SweepOrder::Coloured, x.len());
    let bending = batch(hinges(&mesh), 0.0, SweepOrder::Coloured, x.len());
    assert!(
        stretch
            .schedule()
            .colours
            .iter()
            .all(|r| !shares(&stretch.constraints()[r.clone()], x.len()))
    );
    assert!(
        bending
            .schedule()
            .colours
            .iter()
            .all(|r| !shares(&bending.constraints()[r.clone()], x.len()))
    );
    assert!(
        shares(&edges(&mesh), x.len()),
        "control: edges of a mesh share vertices"
    );
}

#[test]
fn p43_sums_are_the_same_and_near_the_exact_one() {
    let mut draw = Draw::new(43);
    for cancel in [false, true] {
        let mut values: Vec<f64> = (0..200_000)
            .map(|_| draw.between(0.5, 1.5) * draw.decades(-8.0, 8.0))
            .collect();
        if cancel {
            let opposite: Vec<f64> = values.iter().map(|v| -v).collect();
            values.extend(opposite);
            values.push(1e-3);
        }
        let sums: Vec<u64> = [1, 2, 3, 8]
            .map(|t| with_threads(t, || tree_sum(&values).to_bits()))
            .to_vec();
        assert!(sums.iter().all(|s| *s == sums[0]), "seed {}", draw.seed);
        let exact = {
            // Two-sum compensation: exact to an ulp of the condition seen here.
            let (mut sum, mut lost) = (0.0_f64, 0.0_f64);
            for &v in &values {
                let next = sum + v;
                lost += if sum.abs() >= v.abs() {
                    (sum - next) + v
                } else {
                    (v - next) + sum
                };
                sum = next;
            }
            sum + lost
        };
        let size: f64 = values.iter().map(|v| v.abs()).sum();
        let n = values.len() as f64;
        // Leaves of 4096 in 8 lanes: 512 additions in sequence, then a tree; roundings add up like
        // a random walk.
        let bound = f64::EPSILON / 2.0 * (512.0 + n.log2()) * size;
        assert!((f64::from_bits(sums[0]) - exact).abs() <= bound);
    }
}

#[test]
fn p42_a_whole_body_with_contact() {
    let bone = icosphere(1.0, 3);
    let run = |threads: usize| {
        with_threads(threads, || {
            let mut mesh = icosphere(0.5, 3);
            mesh.vertices.iter_mut().for_each(|p| p.z += 1.52);
            let placed = [still(&bone)];
            let mut system = elastic(&mesh, 1e-3, [1e-4, 1e1, 0.0], 1);
            system.settings.gravity = Vector3::new(0.1, 0.0, -9.81);
            system.contacts = Some(Contacts::new(
                &mesh,
                &system.particles,
                &placed,
                vec![0],
                0.005,
                0.3,
            ));
            (0..80).for_each(|_| system.step(&placed, 0.004).expect("finite"));
            let counts = system
                .contacts
                .as_ref()
                .expect("contact")
                .counts(&system.particles.position);
            (bits(&system.particles), counts)
        })
    };
    let reference = run(1);
    assert!(
        reference.1.touching > 0,
        "nothing touches: the test would show little"
    );
    for threads in [2, 8] {
        let other = run(threads);
        assert_eq!(other.1, reference.1);
        assert!(other.0 == reference.0, "{threads} threads");
    }
}

/// Two frames of the cube with steps of a fixed number.
fn worked(contact: &str, threads: usize) -> (u64, u64) {
    use pliant::simulation::Scenario as _;
    let changes = ["frames=2", "solver.xpbd.substeps=10", contact].map(str::to_owned);
    let scene = pliant::scene::builtin::load("cube", &changes).expect("a scene");
    let mut simulation = pliant::simulation::Simulation::new(scene).expect("a simulation");
    simulation.set_threads(threads);
    while !simulation.is_finished() {
        simulation.step(&pliant::progress::Silent);
    }
    let vertices: usize = simulation
        .bodies
        .iter()
        .map(|b| b.rest.vertices.len())
        .sum();
    (simulation.work(), 20 * vertices as u64)
}

#[test]
fn contact_between_surfaces_counts_as_work_whatever_the_threads() {
    let (work, steps) = worked("effects.contact.friction=0", 1);
    assert!(work > steps, "{work} {steps}");
    assert_eq!(worked("effects.contact.friction=0", 3).0, work);
    assert_eq!(worked("effects.contact=off", 1), (steps, steps), "control");
}
