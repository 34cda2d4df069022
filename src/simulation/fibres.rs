//! The fibres of a muscle: given lines, or lines computed between its attachments.

use std::sync::Arc;

use nalgebra::{Point3, Vector3};

use super::assets::MuscleAsset;
use super::attachments::Attached;
use super::fault::Fault;
use super::ready::{Fibres, Rest};
use crate::fibres::attachment::{AreaSource, Attachment};
use crate::fibres::harmonic::{HarmonicOptions, decompose};
use crate::mesh::TriangleMesh;
use crate::scene::Muscle;

impl Muscle {
    /// Whether the muscle has fibres.
    pub(super) fn has_fibres(&self, asset: &MuscleAsset) -> bool {
        self.fibre_count.is_some() || !asset.fibres.is_empty()
    }
}

/// The fibres of a muscle in its shape at the start, with the cosines of the edges `points` to them.
///
/// # Errors
/// No fibres can be computed.
pub(super) fn of_muscle(
    muscle: &Muscle,
    asset: &MuscleAsset,
    rest: &Rest,
    ends: Option<&Ends>,
    points: &[[u32; 2]],
) -> Result<Arc<Fibres>, Fault> {
    let Some(count) = muscle.fibre_count else {
        return Ok(rest.fibres(&asset.fibres, points));
    };
    let areas = ends.map_or_else(Default::default, |ends| ends.vertices.clone());
    let computed = rest.computed(areas, count as usize);
    match &computed.lines {
        Ok(lines) => Ok(rest.fibres(lines, points)),
        Err(why) => Err(Fault::NoFibres { why: why.clone() }),
    }
}

/// The two ends of a muscle.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Ends {
    /// The two bones that hold the muscle farthest from each other.
    pub bones: [usize; 2],
    /// The attached vertices at each end: those of its bone, and of other bones that hold the muscle
    /// nearer to this end.
    pub vertices: [Vec<u32>; 2],
    /// The centre of what each of the two bones holds [m].
    pub centres: [Point3<f64>; 2],
}

impl Ends {
    /// The ends of a muscle; `None` if fewer than two bones hold it.
    pub fn of(mesh: &TriangleMesh, attached: &[Attached]) -> Option<Self> {
        let mut bones: Vec<usize> = attached.iter().map(|(_, bone)| *bone).collect();
        bones.sort_unstable();
        bones.dedup();
        let centre = |bone: &usize| {
            let on = attached.iter().filter(|(_, b)| b == bone);
            let (mut sum, mut count) = (Vector3::zeros(), 0.0);
            for (v, _) in on {
                sum += mesh.vertices[*v as usize].coords;
                count += 1.0;
            }
            Point3::from(sum / count)
        };
        let centres: Vec<Point3<f64>> = bones.iter().map(centre).collect();
        let apart = |a: usize, b: usize| (centres[a] - centres[b]).norm_squared();
        let pairs = (0..bones.len()).flat_map(|a| (a + 1..bones.len()).map(move |b| [a, b]));
        let [first, last] = pairs.max_by(|p, q| apart(p[0], p[1]).total_cmp(&apart(q[0], q[1])))?;
        let mut vertices = [Vec::new(), Vec::new()];
        for (v, bone) in attached {
            let b = bones.partition_point(|other| other < bone);
            vertices[usize::from(apart(b, last) < apart(b, first))].push(*v);
        }
        Some(Self {
            bones: [bones[first], bones[last]],
            vertices,
            centres: [centres[first], centres[last]],
        })
    }
}

/// The fibres [m] from one area of vertices to the other, or the reason why there are none.
pub(super) fn compute(
    mesh: &TriangleMesh,
    areas: &[Vec<u32>; 2],
    count: usize,
) -> Result<Vec<Vec<Point3<f64>>>, String> {
    let [origin, insertion] = areas.each_ref().map(|area| AreaSource::Vertices(area));
    let areas = Attachment::new(mesh, origin, insertion).map_err(|error| error.to_string())?;
    let options = HarmonicOptions {
        count,
        ..HarmonicOptions::default()
    };
    let found = decompose(mesh, &areas, options).map_err(|error| error.to_string())?;
    Ok(found.fibres)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bone_between_two_others_belongs_to_the_nearer_end() {
        let at = |x: f64| Point3::new(x, 0.0, 0.0);
        let mesh = TriangleMesh {
            vertices: vec![at(0.0), at(0.1), at(0.3), at(1.0), at(0.5)],
            triangles: Vec::new(),
        };
        let attached = [(3, 2), (0, 4), (1, 4), (2, 7)];
        let ends = Ends::of(&mesh, &attached).expect("two ends");
        assert_eq!(ends.vertices, [vec![3], vec![0, 1, 2]]);
        assert_eq!((ends.bones, ends.centres[1]), ([2, 4], at(0.05)));
        assert_eq!(Ends::of(&mesh, &attached[1..3]), None);
    }
}
