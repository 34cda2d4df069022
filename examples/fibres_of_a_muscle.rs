//! Fibres of a muscle from its origin to its insertion, with their lengths.

use std::error::Error;

use pliant::fibres::harmonic::{HarmonicOptions, decompose};
use pliant::fibres::length;
use pliant::fibres::quality::measure;
use pliant::mesh::shapes::icosphere;
use pliant::{AreaSource, Attachment, TriangleMesh};

/// Half the length of the muscle, and its greatest radius [m].
const SIZE: [f64; 2] = [0.1, 0.025];

/// Runs the example.
pub fn main() -> Result<(), Box<dyn Error>> {
    let muscle = spindle();

    // Both areas are lists of vertices: the last 15 % at either end. An area can also be a surface of its own, or all
    // vertices near a bone.
    let at_end = |sign: f64| -> Vec<u32> {
        let is_near = |p: f64| sign * p > 0.85 * SIZE[0];
        (0u32..)
            .zip(&muscle.vertices)
            .filter(|(_, p)| is_near(p.x))
            .map(|(v, _)| v)
            .collect()
    };
    let (origin, insertion) = (at_end(-1.0), at_end(1.0));
    let areas = Attachment::new(
        &muscle,
        AreaSource::Vertices(&origin),
        AreaSource::Vertices(&insertion),
    )?;

    // The fibres are streamlines of a harmonic field inside the muscle.
    let options = HarmonicOptions {
        count: 30,
        points: 12,
    };
    let made = decompose(&muscle, &areas, options)?;
    assert_eq!(made.fibres.len(), 30);
    assert!(made.fibres.iter().all(|fibre| fibre.len() == 12));

    // Every fibre runs from the origin to the insertion. It is longer than the straight line between the areas, and
    // shorter than a line over the widest place of the surface.
    let [half, radius] = SIZE;
    for fibre in &made.fibres {
        assert!(fibre[0].x < -0.8 * half && fibre[11].x > 0.8 * half);
        let length = length(fibre);
        assert!(length > 1.6 * half, "{length} m");
        assert!(
            length < 2.0 * half.hypot(radius) + 2.0 * radius,
            "{length} m"
        );
    }

    // The measures of quality: no point is outside, no two fibres cross, and the fibres fill the volume.
    let jacobian = made.jacobian(&muscle, &areas);
    let quality = measure(&muscle, &made.closed, &areas, &made.fibres, jacobian);
    assert_eq!(quality.outside, 0);
    assert!(quality.end_distance_max_m <= 1e-5);
    assert!(quality.jacobian_min > 0.0 && quality.spacing_min_m > 0.0);
    assert!(quality.coverage > 0.9, "{}", quality.coverage);
    // A spindle is symmetric: its fibres have a small angle to the line of action.
    assert!(quality.pennation_mean_rad.to_degrees() < 15.0);
    Ok(())
}

/// A muscle in the shape of a spindle along x.
fn spindle() -> TriangleMesh {
    let mut mesh = icosphere(1.0, 3);
    for p in &mut mesh.vertices {
        // Thinner towards both ends than an ellipsoid.
        let radius = SIZE[1] * (1.0 - 0.3 * p.x * p.x);
        (p.x, p.y, p.z) = (SIZE[0] * p.x, radius * p.y, radius * p.z);
    }
    mesh
}
