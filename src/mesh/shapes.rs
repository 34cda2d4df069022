//! Generated shapes by name: test bodies, the press, the built-in hip, soft bodies and skins. All
//! lengths are in metres.

mod field;
mod hip;
mod press;
mod primitives;
mod soft;

use nalgebra::Point3;

use super::TriangleMesh;

pub use primitives::{box_surface, icosphere, tetrahedron, tube};
pub use soft::{scalp, sheet};

/// A generated shape.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GeneratedShape {
    /// Surface [m]; without triangles for a chain.
    pub mesh: TriangleMesh,
    /// Edges other than those of the triangles, as vertex indices.
    pub edges: Vec<[u32; 2]>,
    /// Polylines along the fibres [m], each from origin to insertion.
    pub fibres: Vec<Vec<Point3<f64>>>,
}

/// The names that [`make`] knows: those of [`SCENE_NAMES`], then three bodies of tests and benches.
pub const NAMES: &[&str] = &[
    "tetrahedron",
    "chain",
    "press-muscle",
    "press-plate",
    "hip-socket",
    "hip-femur",
    "hip-gluteus",
    "soft-cube",
    "soft-ball",
    "soft-table",
    "skull",
    "icosphere",
    "tube",
    "box",
];

/// The names that `shape = "..."` of a scene accepts.
pub const SCENE_NAMES: &[&str] = NAMES.split_at(NAMES.len() - 3).0;

/// The shapes that a skin can have; the section `sheet` of a scene describes the first one.
pub const SKIN_NAMES: &[&str] = &["sheet", "scalp"];

/// The shapes that also have polylines along their fibres.
pub const FIBRE_NAMES: &[&str] = &["hip-gluteus"];

/// Makes the shape of that name; `None` for a name not in [`NAMES`].
pub fn make(name: &str) -> Option<GeneratedShape> {
    let closed = |mesh| GeneratedShape {
        mesh,
        ..GeneratedShape::default()
    };
    Some(match name {
        "tetrahedron" => closed(tetrahedron()),
        "chain" => primitives::chain(6),
        "icosphere" => closed(icosphere(1.0, 3)),
        "tube" => closed(tube(0.25, 2.0, 24)),
        "box" => closed(box_surface([1.0, 1.0, 1.0], 0.25)),
        "press-muscle" => closed(press::muscle()),
        "press-plate" => closed(press::plate()),
        "hip-socket" => closed(hip::socket()),
        "hip-femur" => closed(hip::femur()),
        "hip-gluteus" => hip::gluteus(),
        "soft-cube" => closed(soft::cube()),
        "soft-ball" => closed(soft::ball()),
        "soft-table" => closed(soft::table()),
        "skull" => closed(soft::skull()),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Topology;

    #[test]
    fn every_name_makes_a_sound_shape() {
        check(NAMES);
    }

    #[test]
    fn every_quick_name_makes_a_sound_shape() {
        check(&[
            "tetrahedron",
            "chain",
            "icosphere",
            "tube",
            "box",
            "press-plate",
            "hip-femur",
            "soft-cube",
            "soft-ball",
            "soft-table",
            "skull",
        ]);
        assert_eq!(make("no such shape"), None);
    }

    fn check(names: &[&str]) {
        for name in names {
            let shape = make(name).expect("a listed name");
            assert_eq!(
                make(name).as_ref(),
                Some(&shape),
                "{name} is not deterministic"
            );
            TriangleMesh::new(shape.mesh.vertices.clone(), shape.mesh.triangles.clone())
                .expect("valid indices");
            if *name == "chain" {
                continue;
            }
            let topology = Topology::new(&shape.mesh);
            assert!(topology.is_closed() && topology.is_oriented(), "{name}");
            assert_eq!(topology.euler_characteristic(), 2, "{name}");
            assert_eq!(topology.components().count, 1, "{name}");
            assert!(
                topology.non_manifold_vertices(&shape.mesh).is_empty(),
                "{name}"
            );
            assert!(shape.mesh.volume() > 0.0, "{name} is inside out");
            let used = topology.components().labels.iter().all(|&l| l == 0);
            assert!(used, "{name} has vertices without triangles");
        }
    }
}
