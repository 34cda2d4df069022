use super::*;
use crate::mesh::shapes::icosphere;
use crate::skin::ImplantSpec;
use crate::skin::plan::ImplantPlace;

/// A sphere of 10 cm with edges of about 1.4 cm.
fn ball() -> TriangleMesh {
    icosphere(0.1, 3)
}

fn ready(skin: &TriangleMesh, vertex: usize, edge: f64) -> PreparedPatch {
    let order = ImplantSpec {
        edge: Some(edge),
        ..ImplantSpec::round(ImplantPlace::Vertex(vertex), 0.05, 2e-5)
    };
    PreparedPatch::new(skin, &order, &[]).expect("a region")
}

/// True for a closed, connected mesh of genus 0 with each edge in both directions and without
/// touching surfaces.
fn is_a_ball(mesh: &TriangleMesh) -> bool {
    let topology = Topology::new(mesh);
    let euler =
        mesh.vertices.len() as i64 - topology.edges.len() as i64 + mesh.triangles.len() as i64;
    topology.is_closed()
        && topology.is_oriented()
        && topology.non_manifold_vertices(mesh).is_empty()
        && euler == 2
}

fn thinnest(mesh: &TriangleMesh) -> f64 {
    mesh.smallest_angles()
        .into_iter()
        .fold(f64::INFINITY, f64::min)
}

/// The earlier method: patches beside the rest of the skin.
fn unjoined(skin: &TriangleMesh, ready: &PreparedPatch) -> TriangleMesh {
    let mut mesh = crate::skin::region::Region::of(skin, ready.outside.clone()).mesh;
    let first = mesh.vertices.len() as u32;
    mesh.triangles
        .extend(ready.patch.triangles.iter().map(|t| t.map(|v| v + first)));
    mesh.vertices.extend(&ready.patch.vertices);
    mesh
}

#[test]
fn a_closed_skin_stays_closed_and_the_region_as_it_was() {
    let skin = ball();
    for edge in [0.02, 0.006, 0.0025] {
        let ready = ready(&skin, 5, edge);
        let whole = Whole::of(&skin, &[&ready]);
        assert!(is_a_ball(&whole.mesh), "edges of {edge} m");
        assert!(
            (whole.mesh.volume() / skin.volume() - 1.0).abs() <= 2e-3 && whole.mesh.volume() > 0.0
        );
        assert!(
            thinnest(&whole.mesh) >= 2f64.to_radians(),
            "{} rad",
            thinnest(&whole.mesh)
        );
        // The region's triangles in their order.
        let names = &whole.vertices[0];
        let expected = ready
            .region
            .triangles
            .iter()
            .map(|t| ready.patch.triangles[*t as usize].map(|v| names[v as usize]));
        let found = whole
            .mesh
            .triangles
            .iter()
            .zip(&whole.owner)
            .filter(|(_, owner)| **owner == 0)
            .map(|(t, _)| *t);
        assert!(expected.eq(found), "edges of {edge} m");
        for (v, name) in names.iter().enumerate() {
            assert_eq!(ready.patch.vertices[v], whole.mesh.vertices[*name as usize]);
            assert!(
                ready.origin[v] == NONE
                    || skin.vertices[ready.origin[v] as usize] == ready.patch.vertices[v]
            );
        }
        // Control: the check detects the old error.
        let cracked = unjoined(&skin, &ready);
        assert!(is_a_ball(&skin) && !is_a_ball(&cracked));
    }
}

#[test]
fn rims_of_two_patches_meet_whatever_their_edges() {
    let skin = ball();
    let one = ready(&skin, 5, 0.0025);
    let inside = |r: &PreparedPatch| -> Vec<bool> {
        let mut inside = vec![true; skin.triangles.len()];
        r.outside.iter().for_each(|t| inside[*t as usize] = false);
        inside
    };
    let edges = |r: &PreparedPatch| -> Vec<[u32; 2]> {
        let chains = rim(&r.patch, &Topology::new(&r.patch), &r.origin);
        chains
            .iter()
            .map(|c| [c.ends[0].min(c.ends[1]), c.ends[0].max(c.ends[1])])
            .collect()
    };
    let far = |v: usize| (skin.vertices[v] - skin.vertices[5]).norm();
    let mut order: Vec<usize> = (0..skin.vertices.len())
        .filter(|v| far(*v) > 0.08 && far(*v) < 0.16)
        .collect();
    order.sort_by(|a, b| far(*a).total_cmp(&far(*b)));
    let (mine, known) = (inside(&one), edges(&one));
    let beside = order
        .into_iter()
        .map(|v| ready(&skin, v, 0.006))
        .find(|two| {
            let apart = inside(two).iter().zip(&mine).all(|(a, b)| !(*a && *b));
            apart && edges(two).iter().any(|e| known.contains(e))
        });
    let two = beside.expect("patches that share an edge and no triangle");
    let whole = Whole::of(&skin, &[&one, &two]);
    assert!(is_a_ball(&whole.mesh));
    for (part, ready) in [&one, &two].into_iter().enumerate() {
        assert_eq!(
            whole.owner.iter().filter(|o| **o == part as u32).count(),
            ready.region.triangles.len()
        );
    }
    assert!(is_a_ball(&Whole::of(&skin, &[&two, &one]).mesh));
}

#[test]
fn a_skin_wound_as_it_may_be_looks_outward_everywhere() {
    let skin = ball();
    let mut mixed = skin.clone();
    mixed
        .triangles
        .iter_mut()
        .enumerate()
        .filter(|(t, _)| t % 3 != 0)
        .for_each(|(_, t)| t.swap(0, 1));
    assert!(!is_a_ball(&mixed));
    let whole = Whole::of(&mixed, &[&ready(&mixed, 5, 0.006)]).mesh;
    assert!(is_a_ball(&whole) && whole.volume() > 0.99 * skin.volume());
}

#[test]
fn triangles_with_vertices_within_their_sides_are_cut_into_such_without() {
    let mut joining = Joining {
        skin: &TriangleMesh::default(),
        number: Vec::new(),
        vertices: [
            [0.0, 0.0],
            [4.0, 0.0],
            [0.0, 4.0],
            [1.0, 0.0],
            [2.0, 0.0],
            [2.0, 2.0],
            [0.0, 1.0],
        ]
        .map(|[x, y]| Point3::new(x, y, 0.0))
        .to_vec(),
        split: BTreeMap::new(),
        within: BTreeMap::new(),
    };
    joining.within = [([0, 1], vec![3, 4]), ([1, 2], vec![5]), ([0, 2], vec![6])]
        .into_iter()
        .collect();
    assert_eq!(joining.between(1, 0), [4, 3]);
    let cut = joining.halved(
        [0, 1, 2],
        [(0, 1), (1, 2), (2, 0)].map(|(a, b)| joining.between(a, b)),
    );
    let mesh = TriangleMesh {
        vertices: joining.vertices.clone(),
        triangles: cut,
    };
    let topology = Topology::new(&mesh);
    assert!(
        mesh.triangles.len() == 5 && topology.is_oriented() && topology.boundary_edges().len() == 7
    );
    assert!((mesh.area() - 8.0).abs() <= 1e-14);
    assert!(mesh.triangles.iter().all(|t| {
        let [a, b, c] = t.map(|v| mesh.vertices[v as usize]);
        (b - a).cross(&(c - a)).z > 0.0
    }));
}
