use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Instant;

use nalgebra::Point3;
use proptest::prelude::*;

use super::*;
use crate::mesh::shapes::{box_surface, icosphere, tetrahedron, tube};

/// The folder of real data, if there is one.
fn data() -> Option<PathBuf> {
    let folder = std::env::var_os("PLIANT_DATA")
        .map_or_else(|| PathBuf::from("../shared/data"), PathBuf::from);
    folder.is_dir().then_some(folder)
}

fn read_obj(path: &std::path::Path) -> TriangleMesh {
    let text = std::fs::read_to_string(path).expect("readable");
    let mut mesh = TriangleMesh::default();
    for line in text.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let c: Vec<f64> = words.take(3).map(|w| w.parse().expect("number")).collect();
                mesh.vertices.push(Point3::new(c[0], c[1], c[2]));
            }
            Some("f") => {
                let index = |w: &str| {
                    w.split('/')
                        .next()
                        .and_then(|n| n.parse::<u32>().ok())
                        .expect("index")
                        - 1
                };
                let c: Vec<u32> = words.map(index).collect();
                (1..c.len() - 1).for_each(|k| mesh.triangles.push([c[0], c[k], c[k + 1]]));
            }
            _ => {}
        }
    }
    mesh
}

fn assert_same_kind(before: &TriangleMesh, after: &TriangleMesh) {
    let (b, a) = (Topology::new(before), Topology::new(after));
    assert_eq!(a.is_closed(), b.is_closed());
    assert!(a.is_oriented());
    assert_eq!(a.euler_characteristic(), b.euler_characteristic());
    assert_eq!(a.components().count, b.components().count);
    assert!(a.non_manifold_edges().is_empty() && a.non_manifold_vertices(after).is_empty());
    TriangleMesh::new(after.vertices.clone(), after.triangles.clone()).expect("valid");
}

#[test]
fn real_muscles() {
    let names = [
        "Gluteus_maximus_muscle.r",
        "Gluteus_medius_muscle.r",
        "Iliacus_muscle.r",
    ];
    let Some(data) = data() else {
        println!("skipped: {} muscles, no data folder", names.len());
        return;
    };
    let target = 0.004;
    for name in names {
        let mesh = read_obj(&data.join("body/muscles").join(format!("{name}.obj")));
        let start = Instant::now();
        let Refined {
            mesh: refined,
            report,
        } = refine(&mesh, target).expect("sound");
        println!(
            "{name}: {} -> {} vertices, edges {:.2}..{:.2} mm, angle {:.1} deg, deviation {:.3} mm, volume {:+.4} %, {:.2} s",
            mesh.vertices.len(),
            refined.vertices.len(),
            1e3 * report.min_edge,
            1e3 * report.max_edge,
            report.min_angle.to_degrees(),
            1e3 * report.deviation,
            1e2 * report.volume_change,
            start.elapsed().as_secs_f64()
        );
        assert_same_kind(&mesh, &refined);
        assert!(report.max_edge <= 1.6 * target, "{report:?}");
        assert!(report.min_edge >= 0.3 * target, "{report:?}");
        assert!(report.min_angle.to_degrees() >= 15.0, "{report:?}");
        assert!(report.deviation <= 0.125 * target, "{report:?}");
        assert!(report.volume_change.abs() < 1.25 * target, "{report:?}");
    }
}

#[test]
fn slivers_are_removed() {
    // A tube with forty segments, rings three times as far apart, and fans of needles at its ends.
    let mut mesh = tube(0.5, 2.0, 40);
    mesh.vertices.iter_mut().for_each(|p| p.x *= 3.0);
    let sharpest = mesh
        .smallest_angles()
        .into_iter()
        .fold(f64::INFINITY, f64::min);
    assert!(sharpest.to_degrees() < 10.0);
    let Refined {
        mesh: refined,
        report,
    } = refine(&mesh, 0.25).expect("sound");
    assert_same_kind(&mesh, &refined);
    assert!(report.min_angle.to_degrees() > 20.0, "{report:?}");
    assert!(
        report.max_edge < 1.6 * 0.25 && report.min_edge > 0.3 * 0.25,
        "{report:?}"
    );
    assert!(
        report.deviation < 0.1 * 0.25 && report.deviation > 0.0,
        "{report:?}"
    );
    assert!(report.volume_change.abs() < 2e-2, "{report:?}");
}

#[test]
fn sharp_edges_and_corners_of_a_box_stay() {
    let mesh = box_surface([1.0, 0.5, 0.7], 0.35);
    let Refined {
        mesh: refined,
        report,
    } = refine(&mesh, 0.12).expect("sound");
    assert_same_kind(&mesh, &refined);
    assert!(report.deviation < 0.1 * 0.12, "{report:?}");
    assert!(report.volume_change.abs() < 0.02, "{report:?}");
    assert!(report.min_angle.to_degrees() > 15.0, "{report:?}");
    let bounds = (mesh.bounding_box(), refined.bounding_box());
    assert!(
        (bounds.0.min - bounds.1.min).norm() < 0.012
            && (bounds.0.max - bounds.1.max).norm() < 0.012
    );
}

#[test]
fn an_open_mesh_keeps_its_boundary() {
    let mut mesh = icosphere(1.0, 2);
    mesh.triangles
        .retain(|t| t.iter().all(|&v| mesh.vertices[v as usize].y > -0.3));
    let before = Topology::new(&mesh);
    let Refined {
        mesh: refined,
        report,
    } = refine(&mesh, 0.12).expect("sound");
    assert_same_kind(&mesh, &refined);
    let after = Topology::new(&refined);
    assert!(!after.is_closed() && after.boundary_edges().len() > before.boundary_edges().len());
    for e in before.boundary_edges() {
        for v in before.edges[e as usize] {
            assert!(refined.vertices.contains(&mesh.vertices[v as usize]));
        }
    }
    assert!(report.min_angle.to_degrees() > 15.0, "{report:?}");
    assert!(report.max_edge < 1.6 * 0.12, "{report:?}");
}

#[test]
fn what_cannot_be_refined_is_named() {
    let mesh = tetrahedron();
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(
            refine(&mesh, bad),
            Err(RefineError::EdgeLength(_))
        ));
    }
    assert_eq!(
        refine(&TriangleMesh::default(), 0.1),
        Err(RefineError::Empty)
    );
    assert!(matches!(
        refine(&mesh, 1e-6),
        Err(RefineError::TooManyTriangles { .. })
    ));
    let mut flipped = mesh.clone();
    flipped.triangles[1].swap(0, 1);
    assert_eq!(refine(&flipped, 0.5), Err(RefineError::NotOriented));
    let mut fin = mesh.clone();
    fin.vertices.push(Point3::new(3.0, 0.0, 0.0));
    fin.triangles.push([0, 1, 4]);
    assert_eq!(
        refine(&fin, 0.5),
        Err(RefineError::NotManifold {
            edges: 1,
            vertices: 0
        })
    );
    let mut broken = mesh;
    broken.triangles[0][0] = 9;
    assert!(matches!(refine(&broken, 0.5), Err(RefineError::Mesh(_))));
}

#[test]
fn the_same_input_gives_the_same_bits() {
    let mesh = tube(0.5, 2.0, 30);
    assert_eq!(refine(&mesh, 0.3), refine(&mesh, 0.3));
}

#[test]
fn it_can_be_stopped_wherever_it_is_and_not_being_stopped_changes_nothing() {
    let mesh = tube(0.5, 2.0, 30);
    let queries = std::cell::Cell::new(0);
    let counted = |_: &str, _: usize, _: usize| {
        queries.set(queries.get() + 1);
        ControlFlow::Continue(())
    };
    assert_eq!(refine_with(&mesh, 0.05, &counted), refine(&mesh, 0.05));
    let all = queries.get();
    assert!(all > 50, "queries {all} times only");
    for at in [0, 1, all / 4, all / 2, all - 2, all - 1] {
        let left = std::cell::Cell::new(at);
        let progress = |_: &str, _: usize, _: usize| match left.replace(left.get() - 1) {
            1.. => ControlFlow::Continue(()),
            _ => ControlFlow::Break(()),
        };
        assert_eq!(
            refine_with(&mesh, 0.05, &progress),
            Err(RefineError::Stopped),
            "after {at} of {all}"
        );
        assert_eq!(left.get(), -1, "queries again after it had said no");
    }
}

#[test]
fn a_surface_without_extent_does_not_panic() {
    let mesh = TriangleMesh {
        vertices: vec![Point3::origin(); 4],
        triangles: tetrahedron().triangles,
    };
    let refined = refine(&mesh, 0.1).expect("manifold");
    assert_eq!(refined.mesh.triangles.len(), 4);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4))]
    #[test]
    fn ellipsoids_at_any_scale(axes in prop::array::uniform3(0.5f64..2.0), edge in 0.25f64..0.5, scale in prop::sample::select(vec![1e-3, 1.0, 1e3])) {
        let mut mesh = icosphere(scale, 2);
        mesh.vertices.iter_mut().for_each(|p| (0..3).for_each(|k| p[k] *= axes[k]));
        let edge = edge * scale;
        let refined = refine(&mesh, edge).expect("sound");
        assert_same_kind(&mesh, &refined.mesh);
        let report = refined.report;
        prop_assert!(report.max_edge < 1.6 * edge, "{:?}", report);
        prop_assert!(report.deviation < 0.15 * edge, "{:?}", report);
        prop_assert!(report.min_angle.to_degrees() > 15.0, "{:?}", report);
    }
}

#[test]
fn a_hair_thinner_than_the_deviation_does_not_cross_itself() {
    use crate::testing::{Draw, cubes};
    // A block with a hair of 0.05 mm that is bent at random, as a row of voxels is after smoothing.
    let edge = 3.2e-3;
    let mut draw = Draw::new(5);
    let mut crossed_before = 0;
    for _ in 0..20 {
        let mut mesh = cubes([18, 17, 17], |[x, y, z]| x < 14 || [y, z] == [8, 8]);
        let bend: Vec<nalgebra::Vector3<f64>> =
            (0..19).map(|_| draw.direction() * 0.4e-3).collect();
        for v in mesh.vertices.iter_mut().filter(|v| v.x > 14.5e-3) {
            let station = (v.x * 1e3).round() as usize;
            let middle = nalgebra::Point3::new(v.x, 8.5e-3, 8.5e-3);
            *v = middle + (*v - middle) * 0.05 + bend[station];
        }
        let topology = Topology::new(&mesh);
        let tree = SurfaceTree::new(&mesh.vertices, &mesh.triangles);
        let (plain, _, _) =
            remeshed(&mesh, &topology, &tree, edge, &crate::progress::Silent).expect("remeshed");
        let crossings = |mesh: &TriangleMesh| {
            crate::mesh::crossings::crossings_of(&mesh.vertices, &mesh.triangles).count
        };
        crossed_before += usize::from(crossings(&plain) > 0);
        let found = refine(&mesh, edge).expect("remeshed");
        assert_eq!(crossings(&found.mesh), 0);
        assert!(crate::Health::of(&found.mesh).is_fit());
        // What is cut off is told.
        let deviation = apart::farthest(&mesh, &found.mesh);
        assert!(deviation <= found.report.deviation * (1.0 + 1e-9));
        assert!((found.mesh.volume() / plain.volume() - 1.0).abs() <= 0.02);
        // Nothing is left of it with edges far too short, which would shorten the steps of a run.
        assert!(
            found.report.min_edge >= 0.1 * edge,
            "{}",
            found.report.min_edge
        );
    }
    assert!(crossed_before > 0, "control: some cross without it");
}

#[test]
fn crossings_of_the_original_stay() {
    // The pole of a sphere is pushed out of its other side.
    let mut mesh = icosphere(1.0, 3);
    let height = |v: &Point3<f64>| v.z;
    let pole = (0..mesh.vertices.len())
        .max_by(|a, b| height(&mesh.vertices[*a]).total_cmp(&height(&mesh.vertices[*b])));
    mesh.vertices[pole.expect("vertices")].z = -1.5;
    let crossings = |mesh: &TriangleMesh| {
        crate::mesh::crossings::crossings_of(&mesh.vertices, &mesh.triangles).count
    };
    assert!(crossings(&mesh) > 0, "control");
    let found = refine(&mesh, 0.1).expect("remeshed");
    assert!(crossings(&found.mesh) > 0);
    assert!(found.report.deviation <= 0.1, "{}", found.report.deviation);
}

#[test]
fn the_end_of_a_hair_is_cut_off_where_it_is_thin_and_small() {
    use crate::testing::cubes;
    // A column of a voxel on a block, drawn in at one station to a waist.
    let mut mesh = cubes([12, 9, 9], |[x, y, z]| x < 8 || [y, z] == [4, 4]);
    let middle = |v: &Point3<f64>| Point3::new(v.x, 4.5e-3, 4.5e-3);
    for v in mesh.vertices.iter_mut().filter(|v| v.x > 9.5e-3) {
        let thin = if (v.x - 10e-3).abs() < 0.1e-3 {
            0.01
        } else {
            0.2
        };
        *v = middle(v) + (*v - middle(v)) * thin;
    }
    let found = refine(&mesh, 4e-3).expect("remeshed");
    assert_same_kind(&mesh, &found.mesh);
    assert!(found.report.min_edge >= TINY * 4e-3);
    let farthest = apart::farthest(&mesh, &found.mesh);
    assert!(farthest <= found.report.deviation * (1.0 + 1e-9));
}
