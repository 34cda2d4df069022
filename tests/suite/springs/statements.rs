//! Statements of the thesis on morphing and springs compared with its own numbers: errata M12, M14,
//! M15, M18, M20, M22.

use nalgebra::Vector3;
use pliant::mesh::Topology;
use pliant::mesh::shapes::icosphere;
use pliant::morph::SphereError;
use pliant::springs::integrators::{Integrator, Verlet};
use pliant::springs::{Mode, Neighbours};
use pliant::testing::internals::morph::{Locator, SphereMap};

#[test]
fn m12_points_on_shared_edges_are_found_once_and_weights_sum_to_one() {
    let map = SphereMap::robust(&icosphere(1.0, 2)).expect("a map");
    let locator = Locator::new(&map);
    let topology = Topology::of_triangles(map.points().len(), map.triangles());
    for &[a, b] in &topology.edges {
        let [a, b] = [a, b].map(|v| map.points()[v as usize].coords);
        for share in [0.0, 0.25, 0.5, 1.0] {
            let direction: Vector3<f64> = a + (b - a) * share;
            let found = locator
                .locate(&direction)
                .expect("a triangle, whatever rounding does");
            assert!(
                (found.weights.iter().sum::<f64>() - 1.0).abs() <= 1e-14
                    && found.weights.iter().all(|w| *w >= 0.0)
            );
            // The point in the triangle's plane lies in the given direction.
            let place = found.of(map.triangles(), map.points()).coords;
            assert!(place.normalize().cross(&direction.normalize()).norm() <= 1e-12);
        }
    }
    // The printed test without exact signs: rounding puts some midpoints of edges in no triangle or
    // in two.
    let printed = |p: &Vector3<f64>| {
        let inside = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| map.points()[v as usize].coords);
            a.cross(&b).dot(p) >= 0.0 && b.cross(&c).dot(p) >= 0.0 && c.cross(&a).dot(p) >= 0.0
        };
        map.triangles().iter().filter(|t| inside(t)).count()
    };
    let middles = topology.edges.iter().map(|e| {
        let [a, b] = e.map(|v| map.points()[v as usize].coords);
        printed(&((a + b) * 0.5).normalize())
    });
    assert!(
        middles.into_iter().any(|count| count != 1),
        "control: each middle of an edge is in one triangle"
    );
}

#[test]
fn m14_the_mass_of_a_point_is_not_that_of_muscle() {
    // 1 m3 of muscle at 1060 kg/m3 over 125 points.
    let (real, printed) = (1060.0_f64 / 125.0, 1.1_f64 / 125.0);
    assert!(
        (real - 8.48).abs() <= 1e-12 && (printed - 0.0088).abs() <= 1e-12 && real / printed > 900.0
    );
    // A small mass shortens the longest step: at c from (7.2) by the root of the ratio.
    let limit =
        |mass: f64| Verlet::default().limit(Mode::of(14.47, (8.0 * mass * 3.0).sqrt(), mass));
    assert!(
        (limit(printed) - 0.0269).abs() <= 2e-4,
        "{}",
        limit(printed)
    );
    assert!((limit(real) / limit(printed) / (real / printed).sqrt() - 1.0).abs() <= 1e-12);
}

#[test]
fn m15_claims_about_the_tables_are_not_what_they_say() {
    // Table 7.2: 26 neighbours, edge method on the CPU's 10^3; tables 7.1 and 7.2: CPU over GPU.
    let (cpu, edge, shader) = ([0.83, 59.42, 59.42], [0.95, 5.31, 5.31], [0.28, 7.04, 7.04]);
    assert!(
        edge[0] > cpu[0] && shader[0] < cpu[0],
        "the edge method is slower than the CPU on the smallest grid"
    );
    assert!(
        cpu[1] / edge[1] > 11.0 && cpu[2] / shader[2] < 8.5,
        "more than tenfold by one method, never by the other"
    );
    // Ratio of the points at 70^3 to those at 60^3: not two.
    assert!((70.0_f64.powi(3) / 60.0_f64.powi(3) - 1.588).abs() <= 1e-3);
    // "Best" dampings that are not best, tables 7.5 and 7.6.
    for (best, estimate) in [
        ((2.35, 141), (2.45, 125)),
        ((1.75, 91), (1.73, 90)),
        ((8.75, 448), (8.84, 446)),
    ] {
        assert!(best.0 != estimate.0 && estimate.1 < best.1);
    }
}

#[test]
fn m18_springs_of_the_largest_lattice_exceed_the_texture_of_the_next_smaller_one() {
    let springs = Neighbours::TwentySix.springs([70; 3]);
    assert_eq!(springs, 4_327_956);
    assert!(springs > 2048 * 2048 && Neighbours::TwentySix.springs([60; 3]) < 2048 * 2048);
    // Two of the next power of two at 16 bytes do not fit into 512 MB.
    assert!(2 * 4096_usize.pow(2) * 16 > 512_000_000 && 2 * 2048_usize.pow(2) * 16 < 512_000_000);
}

#[test]
fn m20_counts_of_the_tensor_are_not_those_of_a_closed_surface() {
    // V - F/2 of table 7.7: 2 for a closed surface without handles.
    for (vertices, triangles, left) in [(7502, 14_998, 3), (7502, 15_000, 2), (3258, 6512, 2)] {
        assert_eq!(vertices - triangles / 2, left);
    }
    let mut ball = icosphere(1.0, 2);
    assert_eq!(ball.vertices.len() - ball.triangles.len() / 2, 2);
    ball.vertices.push(nalgebra::Point3::origin());
    let error = SphereMap::robust(&ball).expect_err("refused");
    assert!(
        matches!(
            error,
            SphereError::Unused {
                count: 1,
                vertex: 162
            }
        ),
        "{error}"
    );
}

#[test]
fn m22_half_the_valence_times_the_points_is_too_many_springs() {
    let over = |n: usize, neighbours: Neighbours, valence: usize| {
        (valence / 2 * n.pow(3)) as f64 / neighbours.springs([n; 3]) as f64 - 1.0
    };
    let (six, all) = (Neighbours::Six, Neighbours::TwentySix);
    for (found, printed) in [
        (over(5, six, 6), 0.25),
        (over(10, six, 6), 0.11),
        (over(5, all, 26), 0.57),
        (over(10, all, 26), 0.24),
        (over(100, all, 26), 0.021),
    ] {
        assert!((found - printed).abs() <= 5e-3, "{found} for {printed}");
    }
    // Exact: 3 n^2 (n - 1), and with diagonals 6 n (n - 1)^2 + 4 (n - 1)^3 more.
    for n in [2, 5, 10, 33] {
        let plain = 3 * n * n * (n - 1);
        assert_eq!(six.springs([n; 3]), plain);
        assert_eq!(
            all.springs([n; 3]),
            plain + 6 * n * (n - 1).pow(2) + 4 * (n - 1_usize).pow(3)
        );
    }
}
