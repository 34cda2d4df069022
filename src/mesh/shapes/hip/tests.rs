use std::time::Instant;

use nalgebra::Rotation3;

use super::*;
use crate::mesh::Topology;
use crate::mesh::closest::SurfaceTree;

fn tree(mesh: &TriangleMesh) -> SurfaceTree {
    SurfaceTree::new(&mesh.vertices, &mesh.triangles)
}

fn flexion(angle: f64) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&-Vector3::x_axis(), angle)
}

fn distances(points: &[Point3<f64>], surface: &SurfaceTree) -> Vec<f64> {
    points
        .iter()
        .map(|p| {
            surface
                .closest(p, f64::INFINITY)
                .expect("a surface")
                .distance
        })
        .collect()
}

#[test]
fn bones_have_the_stated_form() {
    let start = Instant::now();
    let (socket, femur) = (socket(), femur());
    println!(
        "socket {} vertices, femur {} vertices, {:.2} s",
        socket.vertices.len(),
        femur.vertices.len(),
        start.elapsed().as_secs_f64()
    );
    assert!((femur.bounding_box().min.y + 0.36).abs() < 1e-3);
    // The head is a sphere away from the neck, and the cup lies 3 mm around its inner half.
    for p in femur
        .vertices
        .iter()
        .filter(|p| p.x > -0.003 && p.y > -0.005)
    {
        assert!((p.coords.norm() - 0.0235).abs() < 1e-5, "{p}");
    }
    let nearest = socket
        .vertices
        .iter()
        .map(|p| p.coords.norm())
        .fold(f64::INFINITY, f64::min);
    assert!((nearest - 0.0265).abs() < 1e-4, "{nearest}");
    let covered = [
        [0.8, 0.6, 0.0],
        [0.0, 1.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.5, 0.5, 0.7],
        [0.5, 0.5, -0.7],
    ];
    for direction in covered {
        let d = Vector3::from(direction).normalize();
        assert!(socket_field(Point3::from(d * 0.030)) < 0.0, "{direction:?}");
        assert!(socket_field(Point3::from(d * 0.025)) > 0.0, "{direction:?}");
    }
}

#[test]
fn bones_stay_apart_while_the_femur_flexes() {
    let (socket, femur) = (socket(), femur());
    assert!(
        flexion(0.5).transform_point(&mm(0.0, -300.0, 0.0)).z > 0.1,
        "the knee moves forward"
    );
    let mut gap = f64::INFINITY;
    for step in 0..=20 {
        let turn = flexion(f64::from(step) / 20.0);
        for p in &femur.vertices {
            gap = gap.min(socket_field(turn * p));
        }
        for p in &socket.vertices {
            gap = gap.min(femur_field(turn.inverse() * p));
        }
    }
    println!("bones at least {:.2} mm apart from 0 to 1 rad", 1e3 * gap);
    assert!(gap > 2e-3, "{gap}");
}

#[test]
fn muscle_is_even_and_clear_of_bone() {
    let start = Instant::now();
    let muscle = gluteus().mesh;
    let topology = Topology::new(&muscle);
    let seconds = start.elapsed().as_secs_f64();
    let lengths = topology.edge_lengths(&muscle);
    let (shortest, longest) = lengths
        .iter()
        .fold((f64::INFINITY, 0.0f64), |(s, l), &e| (s.min(e), l.max(e)));
    let angle = muscle
        .smallest_angles()
        .into_iter()
        .fold(f64::INFINITY, f64::min)
        .to_degrees();
    let (mut nearest, mut inner) = (f64::INFINITY, f64::INFINITY);
    for bone in [socket(), femur()] {
        nearest = distances(&muscle.vertices, &tree(&bone))
            .into_iter()
            .fold(nearest, f64::min);
        // From the bone's vertices to the muscle's triangles, to detect a bone that penetrates a
        // triangle.
        nearest = distances(&bone.vertices, &tree(&muscle))
            .into_iter()
            .fold(nearest, f64::min);
    }
    for t in 0..muscle.triangles.len() {
        let [a, b, c] = muscle.corners(t);
        for p in [
            nalgebra::center(&a, &b),
            Point3::from((a.coords + b.coords + c.coords) / 3.0),
        ] {
            inner = inner.min(socket_field(p).min(femur_field(p)));
        }
    }
    println!(
        "{} vertices, edges {:.2}..{:.2} mm (median {:.2}), angle {angle:.1} deg, {:.1} cm3, bone at least {:.3} mm from vertices, {:.3} mm from triangles, {seconds:.2} s",
        muscle.vertices.len(),
        1e3 * shortest,
        1e3 * longest,
        1e3 * muscle.median_edge_length(&topology).expect("edges"),
        1e6 * muscle.volume(),
        1e3 * nearest,
        1e3 * inner
    );
    assert!(muscle.vertices.len() >= 5000);
    assert!(angle > 20.0 && shortest > 0.3 * MUSCLE_EDGE && longest < 1.6 * MUSCLE_EDGE);
    assert!(nearest >= 0.7e-3 && inner >= 0.7e-3);
}

#[test]
fn muscle_is_held_at_both_ends_and_slides_between() {
    let muscle = gluteus().mesh;
    let [socket, femur] = [socket(), femur()].map(|bone| distances(&muscle.vertices, &tree(&bone)));
    let count = muscle.vertices.len();
    let patch = |distances: &[f64], within: f64| -> Vec<Point3<f64>> {
        (0..count)
            .filter(|&v| distances[v] <= within)
            .map(|v| muscle.vertices[v])
            .collect()
    };
    // The gap at the ends is smaller than between them, so a small radius takes the ends alone.
    let (origin, insertion) = (patch(&socket, 1.2e-3), patch(&femur, 1.2e-3));
    println!(
        "origin {} vertices, insertion {} of {count}",
        origin.len(),
        insertion.len()
    );
    println!(
        "within 4 mm: {} of the socket, {} of the femur",
        patch(&socket, 4e-3).len(),
        patch(&femur, 4e-3).len()
    );
    for held in [&origin, &insertion] {
        assert!((100..=400).contains(&held.len()), "{}", held.len());
    }
    assert!(10 * (origin.len() + insertion.len()) <= count);
    assert!(origin.iter().all(|p| p.y > 0.05 && p.z < -0.03));
    assert!(
        insertion.iter().all(|p| p.y < -0.075 && p.y > -0.14),
        "insertion reaches {:?}",
        insertion.iter().map(|p| p.y).fold(-1.0, f64::max)
    );
    let sliding =
        (0..count).filter(|&v| (1e-3..3e-3).contains(&femur[v]) && muscle.vertices[v].y > -0.075);
    let heights: Vec<f64> = sliding.map(|v| muscle.vertices[v].y).collect();
    let (low, high) = heights
        .iter()
        .fold((1.0f64, -1.0f64), |(l, h), &y| (l.min(y), h.max(y)));
    println!(
        "{} vertices lie 1 to 3 mm above the femur, y {low:.3}..{high:.3}",
        heights.len()
    );
    assert!(heights.len() > 200 && high - low > 0.05);
    // With the femur flexed a straight muscle would cut deep into bone.
    let middle = |points: &[Point3<f64>]| {
        points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len() as f64
    };
    let turn = flexion(1.0);
    let (from, to) = (middle(&origin), turn * middle(&insertion));
    let line = (0..=200).map(|i| Point3::from(from.lerp(&to, f64::from(i) / 200.0)));
    let deepest = line
        .map(|p| socket_field(p).min(femur_field(turn.inverse() * p)))
        .fold(f64::INFINITY, f64::min);
    println!(
        "line of pull {:.0} -> {:.0} mm, {:.1} mm deep in bone at 1 rad",
        1e3 * (from - middle(&insertion)).norm(),
        1e3 * (from - to).norm(),
        -1e3 * deepest
    );
    assert!(deepest < -8e-3, "{deepest}");
    assert!(
        (to - from).norm() > (middle(&insertion) - from).norm(),
        "flexion lengthens the muscle"
    );
}

#[test]
fn fibres_run_inside_from_end_to_end() {
    let shape = gluteus();
    let strap = Strap::new();
    assert!(shape.fibres.len() >= 40);
    for fibre in &shape.fibres {
        assert!(fibre.len() >= 20);
        assert!(fibre.iter().all(|&p| strap.field(p) < 0.0));
        assert!(fibre[0].y > 0.04 && fibre[fibre.len() - 1].y < -0.09);
    }
}
