use super::*;
use crate::mesh::shapes::{box_surface, icosphere};
use crate::testing::Draw;
use nalgebra::Vector3;

fn moved(mesh: &TriangleMesh, by: [f64; 3]) -> TriangleMesh {
    TriangleMesh {
        vertices: mesh
            .vertices
            .iter()
            .map(|p| p + Vector3::from(by))
            .collect(),
        triangles: mesh.triangles.clone(),
    }
}

/// The audit of one frame of surfaces, each with a name and whether it is rigid.
fn audit(surfaces: &[(&str, bool, &TriangleMesh)]) -> FrameAudit {
    Audit::new().frame(&list(surfaces))
}

fn list<'a>(surfaces: &[(&'a str, bool, &'a TriangleMesh)]) -> Vec<AuditedSurface<'a>> {
    let one = |&(name, rigid, mesh): &(&'a str, bool, &'a TriangleMesh)| AuditedSurface {
        name,
        rigid,
        vertices: &mesh.vertices,
        triangles: &mesh.triangles,
        held: &[],
    };
    surfaces.iter().map(one).collect()
}

#[test]
fn spheres_apart_are_clean() {
    let ball = icosphere(0.05, 3);
    let found = audit(&[
        ("a", false, &ball),
        ("b", false, &moved(&ball, [0.1, 0.0, 1e-9])),
        ("c", true, &moved(&ball, [0.0, 0.1001, 0.0])),
    ]);
    assert_eq!(found.crossings, CrossingCounts::default());
    assert!(found.complete && found.pairs.is_empty() && found.open.is_empty());
    assert_eq!(found.shared_volume_m3, 0.0);
}

#[test]
fn one_triangle_through_a_sphere() {
    let ball = icosphere(0.05, 3);
    let mut other = moved(&ball, [0.12, 0.004, 0.003]);
    let tip = (0..other.vertices.len())
        .min_by(|a, b| other.vertices[*a].x.total_cmp(&other.vertices[*b].x))
        .expect("vertices");
    other.vertices[tip].x = 0.045;
    let found = audit(&[("a", false, &ball), ("b", false, &other)]);
    assert!(found.crossings.soft_soft > 0, "{found:?}");
    assert_eq!(found.crossings.all, found.crossings.soft_soft);
    assert_eq!(found.vertices_inside_muscles, 1);
    let pair = &found.pairs[0];
    assert_eq!(pair.surfaces, ["a", "b"]);
    let [x, y, z] = pair.point_m.expect("a point");
    let from = (x * x + y * y + z * z).sqrt();
    assert!((from - 0.05).abs() < 1e-3, "a point of the sphere: {from}");
    assert!(found.shared_volume_m3 > 0.0 && found.shared_volume_m3 < 1e-6);
    // The same with a bone: the vertex is deeper than touching.
    let found = audit(&[("a", true, &ball), ("b", false, &other)]);
    assert_eq!(found.crossings.soft_rigid, found.crossings.all);
    assert!(found.crossings.all > 0);
    assert_eq!(
        (found.vertices_inside_bones, found.vertices_inside_muscles),
        (1, 0)
    );
    assert_eq!(found.pairs[0].surfaces, ["b", "a"], "the soft one first");
    // Two bones may touch.
    let found = audit(&[("a", true, &ball), ("b", true, &other)]);
    assert_eq!(found.crossings.all, 0);
}

#[test]
fn a_vertex_barely_inside() {
    let plate = box_surface([0.2, 0.02, 0.2], 0.05);
    let ball = icosphere(0.03, 2);
    let lowest = ball.vertices.iter().map(|p| p.y).fold(0.0, f64::min);
    for (depth, crosses) in [(-1e-12, false), (1e-12, true), (2e-5, true)] {
        let over = moved(&ball, [0.011, 0.01 - lowest - depth, 0.007]);
        let soft = audit(&[("plate", false, &plate), ("ball", false, &over)]);
        assert_eq!(soft.crossings.all > 0, crosses, "{depth}");
        assert_eq!(soft.vertices_inside_muscles > 0, crosses, "{depth}");
        let bone = audit(&[("plate", true, &plate), ("ball", false, &over)]);
        assert_eq!(bone.crossings.soft_rigid > 0, crosses, "{depth}");
        // Only a vertex deeper than the touching depth counts in a bone; its crossings count always.
        assert_eq!(bone.vertices_inside_bones > 0, depth > DEPTH, "{depth}");
    }
}

#[test]
fn an_edge_through_a_thin_plate() {
    // A long muscle around a plate that is thinner than an edge: no vertex of either is inside the
    // other, as with a muscle that passes through an ilium of 5 mm.
    let plate = box_surface([0.2, 0.005, 0.2], 0.04);
    let mut muscle = box_surface([0.021, 0.2, 0.023], 1.0);
    muscle
        .vertices
        .iter_mut()
        .for_each(|p| *p += Vector3::new(0.001, 0.0, 0.002));
    let found = audit(&[("ilium", true, &plate), ("medius", false, &muscle)]);
    assert!(found.crossings.soft_rigid > 0);
    assert_eq!(
        (found.vertices_inside_bones, found.bone_vertices_inside),
        (0, 0)
    );
    assert_eq!(found.pairs[0].vertices_inside, [0, 0]);
    let [_, y, _] = found.pairs[0].point_m.expect("a point");
    assert!(y.abs() <= 0.0025 + 1e-12, "{y}");
    // Between two muscles the shared volume is that of the common box.
    let found = audit(&[("ilium", false, &plate), ("medius", false, &muscle)]);
    let exact = 0.021 * 0.005 * 0.023;
    assert!(
        (found.shared_volume_m3 / exact - 1.0).abs() <= 1e-2,
        "{found:?}"
    );
    assert_eq!(found.vertices_inside_muscles, 0);
}

#[test]
fn a_surface_through_itself() {
    let mut ball = icosphere(0.05, 3);
    assert_eq!(audit(&[("a", false, &ball)]).crossings.all, 0);
    let top = (0..ball.vertices.len())
        .max_by(|a, b| ball.vertices[*a].z.total_cmp(&ball.vertices[*b].z))
        .expect("vertices");
    ball.vertices[top].z = -0.06;
    let found = audit(&[("a", false, &ball)]);
    assert!(found.crossings.self_ > 0);
    assert_eq!(found.crossings.all, found.crossings.self_);
    assert_eq!(found.pairs[0].surfaces, ["a", "a"]);
    assert_eq!(
        audit(&[("a", true, &ball)]).crossings.all,
        0,
        "a bone as it is"
    );
}

#[test]
fn a_doubled_triangle_lies_on_the_other() {
    let mut ball = icosphere(0.05, 1);
    let [a, b, c] = ball.triangles[4];
    ball.triangles.push([b, c, a]);
    let found = audit(&[("a", false, &ball)]);
    assert_eq!(found.crossings.self_, 1);
    assert_eq!(found.open, ["a"]);
}

#[test]
fn a_seam_is_joined_until_it_opens() {
    // Two copies of each vertex of a triangle pair, as some programs write them.
    let strip = |gap: f64| TriangleMesh {
        vertices: vec![
            Point3::new(0.0, 0.0, 0.0),
            Point3::new(1.0, 0.0, 0.0),
            Point3::new(0.0, 1.0, 0.0),
            Point3::new(1.0 + gap, 0.0, 0.0),
            Point3::new(1.0, 1.0, 0.0),
            Point3::new(gap, 1.0, 0.0),
        ],
        triangles: vec![[0, 1, 2], [3, 4, 5]],
    };
    let mut kept = Audit::new();
    assert_eq!(
        kept.frame(&list(&[("a", false, &strip(0.0))]))
            .crossings
            .all,
        0
    );
    assert_eq!(
        kept.frame(&list(&[("a", false, &strip(0.1))]))
            .crossings
            .all,
        0
    );
    assert_eq!(
        kept.frame(&list(&[("a", false, &strip(-0.1))]))
            .crossings
            .all,
        1
    );
    assert_eq!(
        kept.frame(&list(&[("a", false, &strip(0.0))]))
            .crossings
            .all,
        0
    );
    // Vertices that only meet later are not joined.
    let mut kept = Audit::new();
    assert_eq!(
        kept.frame(&list(&[("a", false, &strip(0.1))]))
            .crossings
            .all,
        0
    );
    assert_eq!(
        kept.frame(&list(&[("a", false, &strip(0.0))]))
            .crossings
            .all,
        1
    );
}

#[test]
fn a_coordinate_that_is_no_number() {
    let ball = icosphere(0.05, 2);
    let mut bad = moved(&ball, [0.03, 0.0, 0.0]);
    bad.vertices[17].y = f64::NAN;
    let mut kept = Audit::new();
    let mut all = AuditSummary::new();
    all.add(
        0,
        &kept.frame(&list(&[("a", true, &ball), ("b", false, &bad)])),
    );
    assert_eq!(all.not_finite, Some(("b".to_owned(), 17, 0)));
    bad.vertices[17].y = 0.0;
    all.add(
        1,
        &kept.frame(&list(&[("a", true, &ball), ("b", false, &bad)])),
    );
    assert!(all.crossings_max.soft_rigid > 0);
    assert_eq!(all.frames, 2);
}

#[test]
fn volumes_are_those_of_the_first_frame() {
    let ball = icosphere(0.05, 2);
    let mut kept = Audit::new();
    let mut all = AuditSummary::new();
    for (frame, factor) in [1.0, 1.0 + 1e-7, 0.99, 1.0].into_iter().enumerate() {
        let mut now = ball.clone();
        now.vertices.iter_mut().for_each(|p| p.z *= factor);
        all.add(frame, &kept.frame(&list(&[("a", false, &now)])));
    }
    assert!((all.volume_error_max - 0.01).abs() < 1e-12, "{all:?}");
    assert_eq!(all.volume_error_at, Some(("a".to_owned(), 2)));
}

#[test]
fn rigid_surfaces_that_run_into_each_other() {
    let block = box_surface([0.1, 0.02, 0.02], 0.01);
    let over = |depth: f64| moved(&block, [0.0, 0.02 - depth, 0.0]);
    let summary = |depths: &[f64], rigid: bool| {
        let mut kept = Audit::new();
        let mut all = AuditSummary::new();
        for (frame, depth) in depths.iter().enumerate() {
            let frame_of = [("a", true, &block), ("b", rigid, &over(*depth))];
            all.add(frame, &kept.frame(&list(&frame_of)));
        }
        all
    };
    // The block is 0.1 m long. Its vertices reach the other block's inside 3 mm below its surface.
    let at = |names: [&str; 2], frame| Some((names.map(str::to_owned), frame));
    let found = summary(&[-0.01, 0.001, 0.003, 0.002], true);
    assert!((found.rigid_depth_max - 0.03).abs() < 1e-12, "{found:?}");
    assert_eq!(found.rigid_depth_at, at(["a", "b"], 2));
    // What a scan has from the start does not count, nor does a way out.
    let found = summary(&[0.002, 0.003, 0.003, -0.01], true);
    assert!((found.rigid_depth_max - 0.01).abs() < 1e-12, "{found:?}");
    assert_eq!(found.rigid_depth_at, at(["a", "b"], 1));
    let found = summary(&[0.002, 0.002, 0.001, -0.01], true);
    assert_eq!((found.rigid_depth_max, found.rigid_depth_at), (0.0, None));
    // A soft surface is no bone.
    let found = summary(&[-0.01, 0.003], false);
    assert_eq!((found.rigid_depth_max, found.rigid_depth_at), (0.0, None));
}

#[test]
fn held_vertices_are_counted_apart() {
    let ball = icosphere(0.05, 3);
    let bone = moved(&ball, [0.08, 0.0, 0.0]);
    let held: Vec<Option<usize>> = ball
        .vertices
        .iter()
        .map(|p| (p.x > 0.02).then_some(1))
        .collect();
    let mut surfaces = list(&[("m", false, &ball), ("b", true, &bone)]);
    let found = Audit::new().frame(&surfaces);
    assert_eq!(found.crossings_held, None, "not known");
    surfaces[0].held = &held;
    let found = Audit::new().frame(&surfaces);
    assert!(found.crossings.all > 0);
    assert_eq!(found.crossings_held, Some(found.crossings.all));
    let none = vec![None; held.len()];
    surfaces[0].held = &none;
    assert_eq!(Audit::new().frame(&surfaces).crossings_held, Some(0));
    assert!(found.vertices_inside_bones > 0, "free or held");
}

#[test]
fn later_frames_and_other_orders_change_no_number() {
    let ball = icosphere(0.05, 3);
    let mut draw = Draw::new(21);
    let mut kept = Audit::new();
    let mut seen = 0;
    for _ in 0..6 {
        let shaken = |draw: &mut Draw, by: [f64; 3]| {
            let mut mesh = moved(&ball, by);
            mesh.vertices
                .iter_mut()
                .for_each(|p| *p += draw.direction() * 0.004);
            mesh
        };
        let a = shaken(&mut draw, [0.0; 3]);
        let b = shaken(&mut draw, [0.09, 0.01, 0.0]);
        let c = shaken(&mut draw, [0.02, 0.095, 0.0]);
        let all = [("a", false, &a), ("b", false, &b), ("c", true, &c)];
        let found = kept.frame(&list(&all));
        let fresh = Audit::new().frame(&list(&[all[2], all[1], all[0]]));
        assert_eq!(found.crossings, fresh.crossings);
        assert_eq!(found.vertices_inside_bones, fresh.vertices_inside_bones);
        assert_eq!(found.bone_vertices_inside, fresh.bone_vertices_inside);
        assert_eq!(found.vertices_inside_muscles, fresh.vertices_inside_muscles);
        let (one, other) = (found.shared_volume_m3, fresh.shared_volume_m3);
        assert!((one - other).abs() <= 1e-12 * one, "{one} {other}");
        seen += found.crossings.all;
        let one_thread = rayon::ThreadPoolBuilder::new()
            .num_threads(1)
            .build()
            .expect("a pool");
        let alone = one_thread.install(|| Audit::new().frame(&list(&all)));
        let three = rayon::ThreadPoolBuilder::new()
            .num_threads(3)
            .build()
            .expect("a pool");
        let shared = three.install(|| Audit::new().frame(&list(&all)));
        assert_eq!(alone, shared);
    }
    assert!(seen > 0);
}
