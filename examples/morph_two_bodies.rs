//! A body turns into another one: common vertices for two meshes, and the shapes between them.

use std::error::Error;

use pliant::mesh::measures::volume;
use pliant::mesh::shapes::{box_surface, icosphere};
use pliant::morph::CorrespondenceSettings;
use pliant::morph::blend::linear;
use pliant::{Aabb, Correspondence, Silent, Topology};

/// Runs the example.
pub fn main() -> Result<(), Box<dyn Error>> {
    // A ball and a box. Their numbers of vertices differ, and no vertex of one belongs to a vertex of the other.
    let ball = icosphere(0.05, 2);
    let block = box_surface([0.14, 0.08, 0.06], 0.02);

    // The correspondence has the vertices of both meshes, and those where their edges cross. Pairs of vertices can say
    // which places belong together; here the shapes alone decide. `Silent` shows no progress.
    let settings = CorrespondenceSettings::default();
    let both = Correspondence::new([&ball, &block], &[], &settings, &Silent)?;

    // The common triangles make a closed surface.
    let count = both.kinds.len();
    let topology = Topology::of_triangles(count, &both.triangles);
    assert!(topology.is_closed() && topology.is_oriented());

    // At the ends, the common surface is the ball and the box, with their volumes.
    let [first, second] = &both.places;
    assert_eq!(first[..ball.vertices.len()], ball.vertices);
    let volumes = [first, second].map(|x| volume(x, &both.triangles));
    assert!((volumes[0] / ball.volume() - 1.0).abs() <= 1e-9);
    assert!((volumes[1] / block.volume() - 1.0).abs() <= 1e-9);

    // Halfway between both, the body is longer than the ball and shorter than the box.
    let half = linear(first, second, 0.5)?;
    let lengths = [first, &half, second].map(|x| Aabb::of_points(x).extents().max());
    assert!(lengths.is_sorted(), "{lengths:?}");
    let between = volume(&half, &both.triangles);
    assert!(
        between > volumes[0] && between < volumes[1],
        "{between} {volumes:?}"
    );

    // Numbers at the vertices of the ball are carried to the common vertices: here the height z of each.
    let heights: Vec<f64> = ball.vertices.iter().map(|p| p.z).collect();
    let carried = both.carried(0, &heights, 1);
    let mut errors = carried.iter().zip(first).map(|(z, p)| (z - p.z).abs());
    assert!(errors.all(|error| error <= 1e-12));
    Ok(())
}
