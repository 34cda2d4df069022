//! Vertices at the same position, and triangles with the same corners.

use nalgebra::Point3;

/// For each vertex the lowest vertex at exactly the same position (-0 equals 0); the vertex itself
/// if it is the lowest.
pub fn first_in_place(vertices: &[Point3<f64>]) -> Vec<u32> {
    // Adding 0 makes -0 into 0 and changes nothing else.
    let key = |v: u32| vertices[v as usize].coords.add_scalar(0.0);
    let mut order: Vec<u32> = (0..vertices.len() as u32).collect();
    let compare = |a: &u32, b: &u32| {
        let (p, q) = (key(*a), key(*b));
        p.x.total_cmp(&q.x)
            .then(p.y.total_cmp(&q.y))
            .then(p.z.total_cmp(&q.z))
    };
    order.sort_unstable_by(|a, b| compare(a, b).then(a.cmp(b)));
    let mut first = vec![0; vertices.len()];
    for same in order.chunk_by(|a, b| compare(a, b).is_eq()) {
        same.iter().for_each(|&v| first[v as usize] = same[0]);
    }
    first
}

/// Groups of two or more triangles with the same three corners in any order, ascending.
pub fn same_corners(triangles: &[[u32; 3]]) -> Vec<Vec<u32>> {
    let key = |t: &u32| {
        let mut corners = triangles[*t as usize];
        corners.sort_unstable();
        corners
    };
    let mut order: Vec<u32> = (0..triangles.len() as u32).collect();
    order.sort_unstable_by_key(|t| (key(t), *t));
    let groups = order.chunk_by(|a, b| key(a) == key(b));
    let mut groups: Vec<Vec<u32>> = groups
        .filter(|g| g.len() > 1)
        .map(<[u32]>::to_vec)
        .collect();
    groups.sort_unstable();
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_exact() {
        let at = |x: f64| Point3::new(x, -0.0, 1.0);
        let mut points = vec![at(1.0), at(0.0), at(1.0), at(-0.0), at(1.0 + f64::EPSILON)];
        points[1].y = 0.0;
        assert_eq!(first_in_place(&points), [0, 1, 0, 1, 4]);
    }

    #[test]
    fn corners_in_any_turn() {
        let groups = same_corners(&[
            [3, 4, 5],
            [0, 1, 2],
            [4, 3, 5],
            [0, 1, 3],
            [5, 3, 4],
            [2, 1, 0],
        ]);
        assert_eq!(groups, [vec![0, 2, 4], vec![1, 5]]);
    }
}
