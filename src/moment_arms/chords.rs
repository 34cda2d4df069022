//! Straight lines between the ends of fibres: the path of a muscle without bones or neighbours.

use nalgebra::{Isometry3, Point3};

use crate::contact::Surface;

/// The part of a line at each end that does not count as blocked: the ends lie at bones.
const AT_ENDS: f64 = 0.1;

/// Mean length of the straight lines [m].
pub(super) fn mean_length(fibres: &[Vec<Point3<f64>>]) -> f64 {
    let chords = fibres.iter().map(|f| (f[f.len() - 1] - f[0]).norm());
    chords.sum::<f64>() / fibres.len() as f64
}

/// Share of the straight lines that pass through none of the posed bones.
pub(super) fn share_clear<'a>(
    fibres: &[Vec<Point3<f64>>],
    bones: impl Iterator<Item = (&'a Surface, Isometry3<f64>)> + Clone,
) -> f64 {
    let is_clear = |fibre: &&Vec<Point3<f64>>| {
        let (from, to) = (fibre[0], fibre[fibre.len() - 1]);
        let line = to - from;
        let (start, middle) = (from + line * AT_ENDS, line * (1.0 - 2.0 * AT_ENDS));
        bones.clone().all(|(surface, pose)| {
            let back = pose.inverse();
            let (start, way) = (back * start, back * middle);
            let hit = surface.first_hit(&start, &way);
            hit.is_none_or(|(triangle, weights)| {
                let corners = surface.triangles()[triangle as usize];
                let at = corners
                    .iter()
                    .zip(weights)
                    .map(|(v, w)| surface.positions()[*v as usize].coords * w)
                    .sum::<nalgebra::Vector3<f64>>();
                (at - start.coords).norm_squared() > way.norm_squared()
            })
        })
    };
    fibres.iter().filter(is_clear).count() as f64 / fibres.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::icosphere;

    #[test]
    fn a_line_is_blocked_by_what_lies_between_its_ends() {
        let ball = Surface::new(&icosphere(0.1, 3));
        let aside = Isometry3::translation(0.0, 0.3, 0.0);
        let line =
            |from: f64, to: f64| vec![Point3::new(from, 0.0, 0.0), Point3::new(to, 0.0, 0.0)];
        let clear =
            |fibres: &[Vec<Point3<f64>>], pose| share_clear(fibres, std::iter::once((&ball, pose)));
        let through = line(-1.0, 1.0);
        assert_eq!(
            clear(std::slice::from_ref(&through), Isometry3::identity()),
            0.0
        );
        assert_eq!(clear(std::slice::from_ref(&through), aside), 1.0);
        // It ends before the ball, and it begins just inside of it.
        let others = [line(-1.0, -0.2), line(0.099, 1.0), through];
        assert_eq!(clear(&others, Isometry3::identity()), 2.0 / 3.0);
        assert_eq!(mean_length(&others), (0.8 + 0.901 + 2.0) / 3.0);
    }
}
