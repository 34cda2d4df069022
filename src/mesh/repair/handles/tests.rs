use super::super::{RepairOptions, RepairStep, repair};
use crate::mesh::shapes::icosphere;
use crate::mesh::topology::Topology;
use crate::mesh::{Health, TriangleMesh};
use crate::testing::cubes;

/// Handles of a closed surface of one piece.
fn handles(mesh: &TriangleMesh) -> i64 {
    1 - Topology::new(mesh).euler_characteristic() / 2
}

fn options(length: f64) -> RepairOptions {
    RepairOptions {
        cut_handles: length,
        ..RepairOptions::default()
    }
}

#[test]
fn a_tunnel_is_filled_and_a_bridge_is_cut() {
    let mm3 = 1e-9;
    // A plate of 9 x 9 x 3 mm with a tunnel of 1 mm, around which a loop of 4 mm leads.
    let plate = cubes([9, 9, 3], |[x, y, _]| [x, y] != [4, 4]);
    // Two blocks of 4 x 3 x 3 mm with a wide and a thin bridge of 3 mm between them.
    let bridges = cubes([4, 9, 3], |[x, y, z]| {
        !(3..6).contains(&y) || x < 2 || [x, z] == [3, 1]
    });
    for (mesh, loop_of, volume) in [(plate, 4.0, 243.0), (bridges, 4.0, 72.0 + 18.0)] {
        assert_eq!(handles(&mesh), 1);
        let found = repair(&mesh, &[], &options(1e-3 * loop_of));
        assert_eq!(handles(&found.mesh), 0);
        assert!(Health::of(&found.mesh).is_fit());
        // The caps lie within an edge of the faces.
        let error = (found.mesh.volume() - volume * mm3).abs();
        assert!(error <= 6.0 * mm3, "{}", found.mesh.volume() / mm3);
        let change = &found.changes[0];
        assert_eq!((change.step, change.count), (RepairStep::CutHandles, 1));
        assert!(!change.elements.is_empty());
        // Control: no loop is as short.
        let found = repair(&mesh, &[], &options(0.99e-3 * loop_of));
        assert_eq!((found.mesh, found.changes), (mesh, Vec::new()));
    }
}

#[test]
fn many_handles_go_at_once_and_large_ones_stay() {
    // A frame of 60 mm with a row of small tunnels in one side, some of which have a wall of 1 mm between
    // them.
    let tunnels = [4, 6, 9, 13, 15, 17, 22, 30];
    let mesh = cubes([60, 60, 3], |[x, y, _]| {
        let is_frame = !(8..52).contains(&x) || !(8..52).contains(&y);
        is_frame && !(x == 4 && tunnels.contains(&y))
    });
    assert_eq!(handles(&mesh), tunnels.len() as i64 + 1);
    let found = repair(&mesh, &[], &options(6e-3));
    assert_eq!(handles(&found.mesh), 1);
    assert!(Health::of(&found.mesh).is_fit());
    assert_eq!(found.changes[0].count, tunnels.len());
    let again = repair(&mesh, &[], &options(6e-3));
    assert_eq!(found.mesh, again.mesh, "the same each time");
}

#[test]
fn a_thin_part_is_no_handle() {
    // A block with a rod of 1 mm: loops around the rod are short, and divide the surface.
    let rod = cubes([20, 3, 3], |[x, y, z]| x < 3 || [y, z] == [1, 1]);
    let ball = icosphere(0.01, 2);
    for mesh in [rod, ball] {
        let found = repair(&mesh, &[], &options(1.0));
        assert_eq!((found.mesh, found.changes), (mesh, Vec::new()));
    }
}

#[test]
fn an_open_surface_stays() {
    let mut plate = cubes([9, 9, 3], |[x, y, _]| [x, y] != [4, 4]);
    plate.triangles.pop();
    let found = repair(&plate, &[], &options(4e-3));
    assert!(found.changes.is_empty(), "{:?}", found.changes);
}
