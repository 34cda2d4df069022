//! Scenes from meshes in memory: the same as from files, with the same checks.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use pliant::io::obj;
use pliant::mesh::shapes::icosphere;
use pliant::scene::{Joint, Key, SceneBuilder, Surroundings, parse_with};
use pliant::testing::Scratch;
use pliant::{Scene, Simulation, TriangleMesh, text_of};

/// A ball of soft tissue on a ball of bone that turns about the origin.
fn on_a_ball(bone: TriangleMesh, ball: TriangleMesh) -> SceneBuilder {
    let joint = Joint {
        path: Vec::new(),
        name: Some("a \"joint\"".to_owned()),
        centre: Point3::new(0.0, 0.3, 0.0),
        axis: Vector3::z_axis(),
    };
    Scene::builder("ball on a ball", 4, 60.0)
        .bone("bone's end", bone)
        .turn(&joint, &[(0.0, 0.0), (4.0, -0.02)])
        .muscle("ball", ball)
        .attach("bone's end", 2e-3)
        .set("effects.stretch", "on")
        .set("effects.volume", "on")
        .set("effects.contact.thickness", "1 mm")
        .set("muscle.ball.material.stretch", "500 N/m")
}

fn meshes() -> [TriangleMesh; 2] {
    let mut bone = icosphere(0.02, 2);
    bone.vertices.iter_mut().for_each(|v| v.x += 0.0695);
    [bone, icosphere(0.05, 2)]
}

fn frames(scene: Scene) -> Vec<[u64; 3]> {
    let mut simulation = Simulation::new(scene).expect("a scene that runs");
    (0..4).for_each(|_| simulation.step_frame());
    let x = &simulation.bodies[0].system.particles.position;
    x.iter()
        .map(|p| [p.x, p.y, p.z].map(f64::to_bits))
        .collect()
}

#[test]
fn meshes_in_memory_and_in_files_give_the_same_bits() {
    let [bone, ball] = meshes();
    let built = on_a_ball(bone.clone(), ball.clone())
        .build()
        .expect("a scene");
    assert_eq!(built.bones[0].motion.keys.len(), 2);

    let folder = Scratch::folder();
    for (name, mesh) in [("bone", &bone), ("ball", &ball)] {
        obj::write(&folder.join(format!("{name}.obj")), mesh, &[]).expect("a file");
    }
    let text = "frames = 4\nframe_rate = '60 Hz'\n[[bone]]\nname = 'bone'\nmesh = 'bone.obj'\nunit = 'm'\n\
                [bone.motion]\ncentre = ['0 m', '0.3 m', '0 m']\naxis = [0, 0, 1]\n\
                keys = [{ frame = 0 }, { frame = 4, angle = '-0.02 rad' }]\n\
                [[muscle]]\nname = 'ball'\nmesh = 'ball.obj'\nunit = 'm'\n\
                [muscle.material]\nstretch = '500 N/m'\n\
                [[muscle.attachment]]\nbone = 'bone'\nnear = '2 mm'\n\
                [effects.stretch]\n[effects.volume]\n[effects.contact]\nthickness = '1 mm'\n";
    let read = parse_with(text, "ball.toml", &Surroundings::of(&folder)).expect("a scene");
    assert_eq!(frames(built), frames(read));
}

#[test]
fn a_joint_with_a_path_keeps_it() {
    let [bone, ball] = meshes();
    let key = |frame: f64, angle: f64, x: f64| Key {
        frame,
        pose: Isometry3::translation(x, 0.0, 0.0)
            * Isometry3::rotation_wrt_point(
                UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle),
                Point3::new(0.0, 0.3, 0.0),
            ),
    };
    let joint = Joint {
        path: vec![
            key(-0.5, -0.2, 1e-3),
            key(0.0, 0.0, 0.0),
            key(1.0, 0.6, -2e-3),
        ],
        name: Some("glides".to_owned()),
        centre: Point3::new(0.0, 0.3, 0.0),
        axis: Vector3::z_axis(),
    };
    let scene = Scene::builder("glides", 4, 60.0)
        .bone("bone", bone)
        .turn(&joint, &[(0.0, 0.0), (4.0, 0.5)])
        .muscle("ball", ball)
        .attach("bone", 2e-3)
        .set("effects.stretch", "on")
        .build()
        .expect("a scene");
    let built = scene.bones[0].motion.joint.as_ref().expect("a joint");
    for at in [-0.5, -0.1, 0.0, 0.4, 1.0] {
        let off = built.pose(at).inverse() * joint.pose(at);
        assert!(
            off.translation.vector.norm() <= 1e-15 && off.rotation.angle() <= 1e-7,
            "{at}"
        );
    }
    assert_eq!(built.path_range(), joint.path_range());
}

#[test]
fn each_bit_of_a_mesh_is_part_of_the_scene() {
    let [bone, ball] = meshes();
    let scene = |bone: &TriangleMesh| {
        let scene = on_a_ball(bone.clone(), ball.clone())
            .build()
            .expect("a scene");
        text_of("scene", &scene)
    };
    let mut other = bone.clone();
    other.vertices[3].y = other.vertices[3].y.next_up();
    assert_eq!(scene(&bone), scene(&bone));
    assert_ne!(scene(&bone), scene(&other));
    let mut turned = bone.clone();
    turned.triangles[0].rotate_left(1);
    assert_ne!(scene(&bone), scene(&turned));
}

#[test]
fn mistakes_are_those_of_the_reader() {
    let [bone, ball] = meshes();
    let error = |builder: SceneBuilder| {
        let error = builder.build().expect_err("a mistake");
        format!("{}: {}", error.key(), error.terse())
    };
    let spoiled = |spoil: fn(&mut TriangleMesh)| {
        let mut bone = bone.clone();
        spoil(&mut bone);
        error(on_a_ball(bone, ball.clone()))
    };
    let usual = || on_a_ball(bone.clone(), ball.clone());
    let cases = [
        (
            spoiled(|m| m.vertices[5].z = f64::NAN),
            "vertex 5 has a coordinate that is not finite",
        ),
        (
            spoiled(|m| m.triangles[0][1] = 9999),
            "vertex index 9999 is out of range",
        ),
        (
            error(usual().attach("tibia", 2e-3)),
            "there is no bone `tibia`",
        ),
        (error(usual().attach("bone's end", f64::NAN)), "NaN m"),
        (error(usual().attach("bone's end", -1.0)), "-1.0 m"),
        (error(usual().muscle("ball", ball.clone())), "ball"),
        (
            error(usual().set("effects.contact.frictoin", "0.2")),
            "did you mean `friction`",
        ),
        (error(Scene::builder("empty", 3, 60.0)), "muscle"),
        (
            error(Scene::builder("none", 0, 60.0).muscle("a", ball.clone())),
            "0",
        ),
        (
            error(Scene::builder("slow", 3, f64::NAN).muscle("a", ball.clone())),
            "NaN Hz",
        ),
        (
            error(Scene::builder("a/b", 3, 60.0).muscle("a", ball.clone())),
            "a/b",
        ),
    ];
    for (found, expected) in cases {
        assert!(found.contains(expected), "{found}\nexpected: {expected}");
    }
    // A turn before any bone is text at a place where no reader accepts it.
    let joint = Joint {
        path: Vec::new(),
        name: None,
        centre: Point3::origin(),
        axis: Vector3::z_axis(),
    };
    let early = Scene::builder("early", 3, 60.0).turn(&joint, &[(0.0, 0.0)]);
    assert!(
        early
            .bone("b", bone.clone())
            .muscle("m", ball.clone())
            .build()
            .is_err()
    );
}

#[test]
fn a_mesh_can_be_shared_between_scenes() {
    let [bone, ball] = meshes().map(Arc::new);
    let scene = |name: &str| {
        Scene::builder(name, 1, 60.0)
            .bone("bone", bone.clone())
            .muscle("ball", ball.clone())
            .build()
    };
    assert!(scene("one").is_ok() && scene("two").is_ok());
    assert_eq!(Arc::strong_count(&bone), 1);
}
