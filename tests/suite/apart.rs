//! Parting of muscles that overlap at the start. Crossings are counted by `Health` on both surfaces
//! as one mesh, which shares no search with the parting.

use nalgebra::{Isometry3, Point3, Vector3};
use pliant::contact::{
    Gaps, Inseparable, Parted, PosedObstacle, RigidBody, SoftBody, Surface, overlaps, part,
    untangle,
};
use pliant::mesh::Inside;
use pliant::mesh::shapes::{box_surface, icosphere};
use pliant::mesh::{RepairOptions, refine, repair};
use pliant::{Health, Scene, Simulation, TriangleMesh};
use std::sync::Arc;

const GAPS: Gaps = Gaps {
    to_bones: 1e-3,
    between: 1e-4,
};

fn moved(mut mesh: TriangleMesh, by: [f64; 3]) -> TriangleMesh {
    let by = Vector3::from(by);
    mesh.vertices.iter_mut().for_each(|v| *v += by);
    mesh
}

/// Number of pairs of crossing triangles of all meshes together, those of one mesh included.
fn crossings(meshes: &[TriangleMesh]) -> usize {
    let mut all = TriangleMesh::default();
    for mesh in meshes {
        let first = all.vertices.len() as u32;
        all.vertices.extend(&mesh.vertices);
        all.triangles
            .extend(mesh.triangles.iter().map(|t| t.map(|v| v + first)));
    }
    let health = Health::of(&all);
    assert!(health.self_intersections_complete);
    health.self_intersections
}

/// Number of vertices of one mesh inside another one.
fn inside(one: &TriangleMesh, other: &TriangleMesh) -> usize {
    let of = Inside::new(&other.vertices, &other.triangles);
    one.vertices.iter().filter(|p| of.winding(p) != 0).count()
}

fn parted(
    soft: &[TriangleMesh],
    fixed: &[usize],
    rigid: &[TriangleMesh],
) -> Result<Parted, Inseparable> {
    parted_with(soft, fixed, rigid, GAPS)
}

fn parted_with(
    soft: &[TriangleMesh],
    fixed: &[usize],
    rigid: &[TriangleMesh],
    gaps: Gaps,
) -> Result<Parted, Inseparable> {
    let surfaces: Vec<Surface> = soft.iter().chain(rigid).map(Surface::new).collect();
    let names = ["one", "two", "three", "four"];
    let bodies: Vec<SoftBody<'_>> = (0..soft.len())
        .map(|m| SoftBody {
            name: names[m],
            mesh: &soft[m],
            surface: &surfaces[m],
            held: Vec::new(),
            fixed: fixed.contains(&m),
        })
        .collect();
    let bones: Vec<RigidBody<'_>> = surfaces[soft.len()..]
        .iter()
        .map(|surface| RigidBody {
            name: "bone",
            surface,
            pose: Isometry3::identity(),
        })
        .collect();
    let found = overlaps(&bodies, &bones);
    let done = part(&bodies, &bones, gaps);
    assert_eq!(found.len(), done.pairs.len());
    match done.left.first() {
        Some(pair) => Err(pair.clone()),
        None => Ok(done),
    }
}

/// The meshes with their new positions.
fn placed(meshes: &[TriangleMesh], parted: &Parted) -> Vec<TriangleMesh> {
    let pairs = meshes.iter().zip(&parted.positions);
    pairs
        .map(|(mesh, x)| TriangleMesh {
            vertices: x.clone().unwrap_or_else(|| mesh.vertices.clone()),
            triangles: mesh.triangles.clone(),
        })
        .collect()
}

/// A slab above a plate, with a bulge through the plate.
fn slab_through_plate() -> (TriangleMesh, TriangleMesh) {
    let plate = box_surface([0.3, 0.3, 0.004], 0.02);
    let mut slab = moved(box_surface([0.16, 0.16, 0.04], 0.01), [0.0, 0.0, 0.024]);
    for v in &mut slab.vertices {
        let from_middle = (v.x * v.x + v.y * v.y).sqrt();
        if v.z < 0.01 && from_middle < 0.03 {
            v.z -= 0.008 * (1.0 - from_middle / 0.05);
        }
    }
    (slab, plate)
}

#[test]
fn spheres_are_parted_half_and_half() {
    let two = [
        icosphere(0.05, 3),
        moved(icosphere(0.05, 3), [0.09, 0.003, 0.001]),
    ];
    assert!(crossings(&two) > 0, "control: they overlap");
    let done = parted(&two, &[], &[]).expect("they can be parted");
    let after = placed(&two, &done);
    assert_eq!(crossings(&after), 0);
    assert_eq!(
        inside(&after[0], &after[1]) + inside(&after[1], &after[0]),
        0
    );
    for moved in &done.moved {
        assert!(moved.volume_change.abs() <= 1e-9, "{moved:?}");
        assert!(moved.rms > 0.0 && moved.rms <= 2e-3, "{moved:?}");
    }
    let share = done.moved[0].rms / done.moved[1].rms;
    assert!((0.8..=1.25).contains(&share), "{share}");
    assert!(done.pairs[0].depth > 5e-3 && done.pairs[0].crossings > 0);
}

#[test]
fn what_does_not_overlap_is_unchanged() {
    let two = [
        icosphere(0.05, 2),
        moved(icosphere(0.05, 2), [0.101, 0.0, 0.0]),
    ];
    let done = parted(&two, &[], &[]).expect("nothing to part");
    assert!(done.pairs.is_empty() && done.positions.iter().all(Option::is_none));
}

#[test]
fn a_bulge_through_a_thin_plate_returns_to_its_side() {
    let (slab, plate) = slab_through_plate();
    let beyond = |mesh: &TriangleMesh| mesh.vertices.iter().filter(|v| v.z < 0.0).count();
    assert!(beyond(&slab) > 0 && crossings(&[slab.clone(), plate.clone()]) > 0);

    // Control: out to the nearest side leaves edges through the plate.
    let mut nearest = slab.clone();
    let obstacle = PosedObstacle {
        name: "plate".into(),
        obstacle: Arc::new(Surface::new(&plate)),
        before: Isometry3::identity(),
        now: Isometry3::identity(),
    };
    untangle(&mut nearest, &[obstacle], &[0], GAPS.to_bones);
    assert!(crossings(&[nearest.clone(), plate.clone()]) > 0 && beyond(&nearest) > 0);

    let done = parted(
        std::slice::from_ref(&slab),
        &[],
        std::slice::from_ref(&plate),
    )
    .expect("it can leave the plate");
    let after = placed(&[slab], &done).remove(0);
    assert_eq!(beyond(&after), 0);
    assert_eq!(crossings(&[after, plate]), 0);
    assert!(done.moved[0].volume_change.abs() <= 1e-9);
}

#[test]
fn a_sphere_held_fast_in_another_is_refused_with_both_names() {
    let two = [icosphere(0.05, 2), icosphere(0.02, 2)];
    let error = parted(&two, &[0, 1], &[]).expect_err("none can move");
    assert_eq!(error.pair, ["one", "two"].map(String::from));
    let place = Point3::from(error.place);
    assert!(place.coords.norm() <= 0.06, "{place}");
}

#[test]
fn any_number_of_threads_parts_alike() {
    let two = [
        icosphere(0.05, 3),
        moved(icosphere(0.05, 3), [0.09, 0.0, 0.0]),
    ];
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("a pool").install(|| parted(&two, &[], &[]))
    };
    assert_eq!(on(1), on(8));
}

/// A muscle with a slender end, and a bone with a blunt tip in that end.
fn tip_in_a_slender_end() -> (TriangleMesh, TriangleMesh) {
    let mut muscle = icosphere(0.1, 3);
    for v in &mut muscle.vertices {
        let width = 0.03 + 0.22 * (0.5 - 0.5 * v.z / 0.1).powi(2);
        (v.x, v.y) = (width * v.x, width * v.y);
    }
    let mut bone = icosphere(0.004, 3);
    for v in &mut bone.vertices {
        v.z = 0.092 + if v.z > 0.0 { 8.0 * v.z } else { v.z };
        v.x += 0.001;
    }
    (muscle, bone)
}

#[test]
fn a_bone_leaves_the_slender_end_of_a_muscle() {
    let (muscle, bone) = tip_in_a_slender_end();
    let before = [muscle.clone(), bone.clone()];
    assert!(crossings(&before) > 0 && inside(&muscle, &bone) > 0);
    let done = parted(
        std::slice::from_ref(&muscle),
        &[],
        std::slice::from_ref(&bone),
    )
    .expect("it can leave");
    let after = placed(&[muscle], &done).remove(0);
    assert_eq!(crossings(&[after.clone(), bone.clone()]), 0);
    assert_eq!(inside(&after, &bone) + inside(&bone, &after), 0);
    let moved = done.moved[0];
    assert!(moved.volume_change.abs() <= 1e-9, "{moved:?}");
    assert!(moved.rms <= 2e-3, "{moved:?}");
}

#[test]
fn a_deep_overlap_elsewhere_does_not_keep_a_pair_from_its_shape() {
    let pair = |apart: f64, at: f64| {
        let first = icosphere(0.05, 3);
        [
            moved(first.clone(), [0.0, at, 0.0]),
            moved(first, [apart, at, 0.0]),
        ]
    };
    let light = pair(0.096, 0.0);
    let both = [light.clone(), pair(0.07, 0.3)].concat();
    let alone = parted(&light, &[], &[]).expect("it can be parted");
    let beside = parted(&both, &[], &[]).expect("they can be parted");
    assert_eq!(crossings(&placed(&both, &beside)), 0);
    for (alone, beside) in alone.moved.iter().zip(&beside.moved) {
        assert!(beside.rms <= 1.2 * alone.rms, "{beside:?} {alone:?}");
    }
}

/// A mesh of the measured data without holes; `None` without the data.
fn measured(name: &str) -> Option<TriangleMesh> {
    let folder = std::path::PathBuf::from(crate::measured_data("PLIANT_DATA")?).join("body");
    if !folder.is_dir() {
        return None;
    }
    let mesh = pliant::io::read(&folder.join(name)).expect("a mesh").mesh;
    let options = RepairOptions {
        close_holes: 30,
        ..RepairOptions::default()
    };
    Some(repair(&mesh, &[], &options).mesh)
}

#[test]
fn the_short_head_of_biceps_leaves_the_coracoid_process() {
    let names = [
        "muscles/Short_head_of_biceps_brachii.r.obj",
        "bones/Scapula.r.obj",
    ];
    let [Some(muscle), Some(bone)] = names.map(measured) else {
        println!("skipped: 1 test, because there is no folder of measured data");
        return;
    };
    // A small gap is harder: no push reaches past the overlap.
    let gaps = Gaps {
        to_bones: 3e-5,
        between: 3e-5,
    };
    let done = parted_with(
        std::slice::from_ref(&muscle),
        &[],
        std::slice::from_ref(&bone),
        gaps,
    )
    .expect("it can leave");
    let after = placed(&[muscle], &done).remove(0);
    let both = [after, bone];
    assert_eq!(crossings(&both), crossings(&both[1..]));
    assert!(done.moved[0].rms <= 2e-3, "{:?}", done.moved);
}

#[test]
fn a_left_adductor_leaves_its_bones_without_a_fold_and_with_its_volume() {
    let names = [
        "muscles/Adductor_magnus.r.obj",
        "bones/Femur.r.obj",
        "bones/Hip_bone.r.obj",
    ];
    let [Some(muscle), Some(femur), Some(hip)] = names.map(measured) else {
        println!("skipped: 1 test, because there is no folder of measured data");
        return;
    };
    // The other side of the body, with the single precision of an STL file.
    let left = |mut mesh: TriangleMesh| {
        let mirror = |c: f64| f64::from(c as f32);
        for v in &mut mesh.vertices {
            *v = Point3::new(mirror(-v.x), mirror(v.y), mirror(v.z));
        }
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        mesh
    };
    let read = refine(&left(muscle), 4.77e-3).expect("a closed mesh").mesh;
    let (femur, hip) = (left(femur), left(hip));
    let scene = Scene::builder("adductor", 1, 60.0)
        .bone("femur", femur)
        .bone("hip bone", hip)
        .muscle("adductor", read.clone())
        .attach("femur", 3e-3)
        .attach("hip bone", 3e-3)
        .set("muscle.adductor.attachment.*.limit", "4 %")
        .set("effects.stretch", "on")
        .set("effects.contact.thickness", "0.5 mm")
        .build()
        .expect("a scene");
    let simulation = Simulation::new(scene).expect("meshes that can be parted");
    let start = TriangleMesh {
        vertices: simulation.bodies[0].system.particles.position.clone(),
        triangles: read.triangles.clone(),
    };
    assert_eq!(crossings(std::slice::from_ref(&start)), 0);
    let change = start.volume() / read.volume() - 1.0;
    assert!(change.abs() <= 1e-6, "{change:e}");
    assert_eq!(simulation.parted.len(), 2, "both bones are named");
    let most = simulation.parted.iter().map(|pair| pair.moved.rms);
    assert!(
        most.clone().all(|rms| rms <= 2e-3),
        "{:?}",
        most.collect::<Vec<_>>()
    );
}

#[test]
fn iliacus_and_psoas_are_parted_on_their_bones() {
    let names = [
        "muscles/Iliacus_muscle.r.obj",
        "muscles/Psoas_major.r.obj",
        "bones/Hip_bone.r.obj",
        "bones/Femur.r.obj",
    ];
    let [Some(iliacus), Some(psoas), Some(hip), Some(femur)] = names.map(measured) else {
        println!("skipped: 1 test, because there is no folder of measured data");
        return;
    };
    let (muscles, bones) = ([iliacus, psoas], [hip, femur]);
    assert!(crossings(&muscles) > 100, "control: they overlap");
    let done = parted(&muscles, &[], &bones).expect("they can be parted");
    let after = placed(&muscles, &done);
    assert_eq!(crossings(&after), 0);
    for (muscle, moved) in after.iter().zip(&done.moved) {
        assert!(moved.volume_change.abs() <= 1e-9, "{moved:?}");
        for bone in &bones {
            let both = [muscle.clone(), bone.clone()];
            assert_eq!(crossings(&both), crossings(&both[1..]));
        }
    }
}
