//! Registration of lines on the surface of a muscle, such as fibres drawn on a specimen, to its
//! mesh.

use nalgebra::Point3;

use super::polyline::length;
use crate::mesh::TriangleMesh;
use crate::mesh::closest::SurfaceTree;
use crate::mesh::measures::{max_or_nan, median};

/// A line is off the surface if its median distance exceeds this share of the muscle's length.
pub const FARTHEST: f64 = 0.05;

/// Lines on a muscle's surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RegisteredLines {
    /// The lines on the surface [m].
    pub lines: Vec<Vec<Point3<f64>>>,
    /// Greatest distance of a point to the surface before the registration [m].
    pub distance_max: f64,
}

/// Error of [`register`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LinesError {
    /// There is no line, or no line with a positive length.
    #[error(
        "there is no line with a length; give polylines along the fibres that are seen on the surface"
    )]
    None,
    /// A line is not on the surface.
    #[error(
        "line {line}, counted from 0, lies off the surface: half of its points are more than {distance:.6} m away, and the \
         muscle is {length:.6} m long; check that both are of the same body, in the same unit and frame"
    )]
    Off {
        /// Index of the line, from 0.
        line: usize,
        /// Median distance of the points of the line [m].
        distance: f64,
        /// Length of the muscle's bounding box [m].
        length: f64,
    },
}

/// Moves every point of the lines onto the surface.
///
/// # Errors
/// No line, a line off the surface.
pub fn register(
    muscle: &TriangleMesh,
    lines: &[Vec<Point3<f64>>],
) -> Result<RegisteredLines, LinesError> {
    let tree = SurfaceTree::new(&muscle.vertices, &muscle.triangles);
    let mut all = RegisteredLines::default();
    for (k, line) in lines
        .iter()
        .enumerate()
        .filter(|(_, line)| length(line) > 0.0)
    {
        let found: Vec<_> = line
            .iter()
            .filter_map(|p| tree.closest(p, f64::INFINITY))
            .collect();
        let distances = || found.iter().map(|f| f.distance);
        let (middle, whole) = (
            median(distances().collect()).unwrap_or(0.0),
            muscle.length(),
        );
        if middle > FARTHEST * whole {
            return Err(LinesError::Off {
                line: k,
                distance: middle,
                length: whole,
            });
        }
        all.distance_max = max_or_nan(distances().chain([all.distance_max]));
        all.lines.push(found.iter().map(|f| f.point).collect());
    }
    if all.lines.is_empty() {
        Err(LinesError::None)
    } else {
        Ok(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::icosphere;

    #[test]
    fn lines_come_to_lie_on_the_surface_or_are_refused() {
        let mesh = icosphere(1.0, 4);
        let arc = |r: f64| {
            (0..9)
                .map(|k| 0.1 * f64::from(k))
                .map(|a| Point3::new(r * a.cos(), r * a.sin(), 0.0))
                .collect()
        };
        let found = register(&mesh, &[arc(1.05)]).expect("on the surface");
        assert!(
            found.distance_max >= 0.05 && found.distance_max <= 0.06,
            "{}",
            found.distance_max
        );
        let tree = SurfaceTree::new(&mesh.vertices, &mesh.triangles);
        let off = |p: &Point3<f64>| {
            tree.closest(p, f64::INFINITY)
                .map_or(f64::INFINITY, |f| f.distance)
        };
        assert!(found.lines[0].iter().all(|p| off(p) <= 1e-12));
        let error = register(&mesh, &[arc(1.0), arc(1.3)]).expect_err("off");
        assert!(
            matches!(error, LinesError::Off { line: 1, .. })
                && error.to_string().contains("line 1"),
            "{error}"
        );
        assert_eq!(register(&mesh, &[]), Err(LinesError::None));
        assert_eq!(
            register(&mesh, &[vec![Point3::origin(); 3]]),
            Err(LinesError::None)
        );
    }
}
