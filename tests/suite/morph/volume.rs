//! Morphs by distance fields: exact shapes, handles that vanish, ends, refusals.

use nalgebra::Point3;
use pliant::mesh::shapes::icosphere;
use pliant::mesh::{Topology, TriangleMesh, isosurface};
use pliant::morph::{CorrespondenceError, SphereError, by_volume};
use pliant::progress::Silent;

use crate::tolerances::worst;

/// Cells along the longest side.
const CELLS: usize = 32;

/// A ring of radius 1 about z, 0.4 thick.
fn ring() -> TriangleMesh {
    let distance = |p: Point3<f64>| (p.xy().coords.norm() - 1.0).hypot(p.z) - 0.4;
    let corner = Point3::new(1.6, 1.6, 0.6);
    isosurface(distance, -corner, corner, 0.1)
}

/// Number of handles.
fn handles(mesh: &TriangleMesh) -> i64 {
    let topology = Topology::new(mesh);
    assert!(topology.is_closed() && topology.is_oriented());
    topology.components().count as i64 - topology.euler_characteristic() / 2
}

#[test]
fn a_ball_grows_and_moves_as_a_ball() {
    let small = icosphere(1.0, 4);
    let mut large = icosphere(2.0, 4);
    large.vertices.iter_mut().for_each(|p| p.x += 3.0);
    let shape = by_volume([&small, &large], CELLS, &Silent).expect("closed bodies");
    for t in [0.0, 0.25, 0.5, 1.0] {
        let mesh = shape(t);
        let off = mesh.vertices.iter().map(|p| {
            let away = (p - Point3::new(3.0 * t, 0.0, 0.0)).norm();
            (away - (1.0 + t)).abs()
        });
        // A ball of triangles lies below the round one by 0.2 % of the radius.
        assert!(worst(off) <= 0.01, "{t}");
        assert_eq!(handles(&mesh), 0);
    }
}

#[test]
fn a_handle_closes_on_the_way() {
    let (ring, ball) = (ring(), icosphere(1.2, 4));
    assert_eq!(handles(&ring), 1);
    let shape = by_volume([&ring, &ball], CELLS, &Silent).expect("closed bodies");
    let counts: Vec<i64> = (0..=8)
        .map(|k| handles(&shape(f64::from(k) / 8.0)))
        .collect();
    assert_eq!((counts[0], counts[8]), (1, 0), "{counts:?}");
    assert!(counts.is_sorted_by(|a, b| a >= b), "{counts:?}");
    // The ends lie on the bodies.
    let cell = 3.2 / CELLS as f64;
    let tree = pliant::mesh::SurfaceTree::new(&ring.vertices, &ring.triangles);
    let first = shape(0.0);
    let off = first
        .vertices
        .iter()
        .map(|p| tree.closest(p, 1.0).expect("near").distance);
    assert!(worst(off) <= 0.1 * cell);
    // The same bits for any number of threads.
    let alone = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .expect("a pool");
    assert_eq!(alone.install(|| shape(0.4)), shape(0.4));
}

#[test]
fn what_is_open_or_inside_out_is_refused() {
    let ball = icosphere(1.0, 2);
    let mut open = ball.clone();
    open.triangles.pop();
    let error = by_volume([&ball, &open], CELLS, &Silent).err();
    let expected = |error: &CorrespondenceError| {
        matches!(
            error,
            CorrespondenceError::Surface {
                side: 1,
                error: SphereError::Open { .. }
            }
        )
    };
    assert!(error.as_ref().is_some_and(expected), "{error:?}");
    let mut turned = ball.clone();
    turned.triangles.iter_mut().for_each(|t| t.swap(0, 1));
    let error = by_volume([&turned, &ball], CELLS, &Silent).err();
    assert!(
        matches!(error, Some(CorrespondenceError::InsideOut { side: 0, .. })),
        "{error:?}"
    );
}
