use super::super::section::{oriented, under};
use super::*;
use pliant::mesh::Topology;
use pliant::mesh::shapes::icosphere;
use pliant::skin::{ImplantPlace, ImplantSpec, insert};

/// A sphere of 10 cm, and one of radius `around` around it if that is not 0 [m].
fn ball(around: f64) -> TriangleMesh {
    let mut skin = icosphere(0.1, 3);
    if around > 0.0 {
        let (first, outer) = (skin.vertices.len() as u32, icosphere(around, 3));
        skin.vertices.extend(outer.vertices);
        skin.triangles
            .extend(outer.triangles.iter().map(|t| t.map(|v| v + first)));
    }
    skin
}

fn inserted<'a>(skin: &'a TriangleMesh, places: &[Vector3<f64>]) -> Insertion<'a> {
    let implants = places.iter().map(|at| {
        let place = ImplantPlace::Point(Point3::from(at.normalize() * 0.1));
        let order = ImplantSpec {
            edge: Some(6e-3),
            ..ImplantSpec::round(place, 0.04, 1e-5)
        };
        insert(skin, &order, &[], |_| true).expect("inserted")
    });
    Insertion {
        skin,
        implants: implants.collect(),
        numbers: (0..places.len()).map(|k| vec![k]).collect(),
        obstacles: &[],
        curve: Vec::new(),
        limit: 1.05,
        up: None,
        under: "implant",
    }
}

#[test]
fn what_hides_the_implant_is_left_out_and_nothing_else_is() {
    for (around, hidden) in [(0.0, false), (0.2, true)] {
        let skin = ball(around);
        let insertion = inserted(&skin, &[Vector3::new(0.3, 0.2, 1.0)]);
        let shown = insertion.shown();
        let groups = insertion.groups();
        let stage = Stage::new(&insertion, &shown, &groups[0]);
        assert_eq!(stage.front.is_finite(), hidden);
        // Control: the sphere around hides the whole region from everywhere.
        let rays = Rays::new(&shown.skin);
        let above = Point3::from(groups[0].axes[0] * 0.15);
        assert_eq!(
            is_hidden(&above, &stage.view.from, f64::INFINITY, &rays),
            hidden
        );
        let open = stage.open(&shown.skin, &shown.stretch);
        let rest = Rays::new(&part(&shown.whole, &shown.skin, |owner| owner == u32::MAX));
        let n = insertion.implants[0].0.layers.count();
        let mut free = (0..n)
            .filter(|v| !insertion.implants[0].0.layers.held[*v])
            .map(|v| insertion.implants[0].1.x[v]);
        assert!(free.all(|p| !is_hidden(&p, &stage.view.from, stage.front, &rest)));
        assert!(
            open.mesh.area() > 0.5 * skin.area(),
            "more is left out than hides"
        );
    }
}

#[test]
fn implants_that_look_apart_have_pictures_of_their_own() {
    let skin = ball(0.0);
    let names = |places: &[Vector3<f64>]| -> Vec<String> {
        let insertion = inserted(&skin, places);
        let pictures = insertion.pictures(&insertion.shown()).expect("pictures");
        assert!(
            pictures
                .iter()
                .all(|picture| picture.bytes.starts_with(b"\x89PNG"))
        );
        pictures
            .into_iter()
            .map(|picture| picture.file.replace(".png", ""))
            .collect()
    };
    let (top, aside, bottom) = (Vector3::z(), Vector3::new(0.9, 0.0, 1.0), -Vector3::z());
    assert_eq!(names(&[top]), ["stretch", "side", "before", "overview"]);
    assert_eq!(
        names(&[top, aside]),
        ["stretch", "side", "side_2", "before", "overview"]
    );
    assert_eq!(
        names(&[top, bottom]),
        [
            "stretch",
            "side",
            "before",
            "stretch_2",
            "side_2",
            "before_2",
            "overview"
        ]
    );
}

#[test]
fn colours_reach_the_greatest_stretch_and_the_limit_is_marked() {
    let skin = ball(0.0);
    let insertion = inserted(&skin, &[Vector3::z()]);
    for (greatest, end) in [
        (1.0, 1.05),
        (1.05, 1.05),
        (1.21, 1.25),
        (1.5, 1.5),
        (1.51, 1.6),
        (2.34, 2.4),
        (f64::NAN, 1.05),
    ] {
        let legend = insertion.legend(&[1.0, greatest, 1.02]);
        assert!(
            (legend.range.1 - end).abs() <= 1e-12 && legend.range.0 == 1.0,
            "{greatest}: {:?}",
            legend.range
        );
        assert_eq!(legend.mark.map(|(at, _)| at), Some(1.05));
    }
    // Skin beyond the limit has an outline, and the text mentions it.
    let shown = insertion.shown();
    assert!(shown.stretch.iter().any(|s| *s > 1.05));
    let groups = insertion.groups();
    let within = Stage::new(&insertion, &shown, &groups[0])
        .over()
        .expect("a picture");
    let loose = Insertion {
        limit: 9.0,
        ..inserted(&skin, &[Vector3::z()])
    };
    let without = Stage::new(&loose, &shown, &groups[0])
        .over()
        .expect("a picture");
    assert!(
        within.1.contains("red line") && without.1.contains("nowhere") && within.0 != without.0
    );
}

#[test]
fn the_layers_with_their_wall_are_closed() {
    let skin = ball(0.0);
    let insertion = inserted(&skin, &[Vector3::z()]);
    let (ready, done) = &insertion.implants[0];
    let mut solid = under(&ready.layers, &done.x);
    assert!(!Topology::new(&solid).is_closed());
    solid.triangles.extend(&ready.layers.triangles);
    let topology = Topology::new(&solid);
    assert!(topology.is_closed() && topology.is_oriented() && solid.volume() > 0.0);
    // A bone with inward triangles is reversed; an open one is reported.
    let mut bone = icosphere(1.0, 1);
    bone.triangles.iter_mut().for_each(|t| t.swap(0, 1));
    bone.triangles[3].swap(0, 1);
    let (turned, closed) = oriented(&bone);
    assert!(closed && turned.volume() > 0.0 && Topology::new(&turned).is_oriented());
    bone.triangles.pop();
    assert!(!oriented(&bone).1);
}
