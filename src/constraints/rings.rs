//! Sums over the rings of triangles around the vertices of a closed surface: the gradient of the
//! volume.

use rayon::prelude::*;

use super::lanes::{InLanes, Lane, SimdWidth, Triple, cross, dot, run, sub};
use crate::mesh::sum::tree_sum;
use crate::particles::{SHARE, Slot, is_shared};

/// Number of vertices whose rings are stored together: the number of the widest lanes, for every
/// width.
const GROUP: usize = 8;

/// For each vertex the other corners of its triangles, in cyclic order.
#[derive(Clone, Debug)]
pub struct Rings {
    /// First row of each group in `around`, and the end of the last.
    start: Vec<u32>,
    /// Each row contains the next corner of each vertex of a group. Each two successive entries are
    /// the other corners of a triangle, in cyclic order. In the ring of a vertex with several fans,
    /// the index of the vertex itself separates the fans. A short ring repeats its last corner: the
    /// product of a difference with itself or with zero is zero.
    around: Vec<[u32; GROUP]>,
}

/// Terms of the volume's polynomial along a field, one number per vertex.
#[derive(Clone, Debug, Default)]
pub struct Terms([Vec<f64>; 3]);

/// One chunk of each of the three terms.
type ThreeChunks<'a> = ((&'a mut [f64], &'a mut [f64]), &'a mut [f64]);

impl Rings {
    /// The rings of `count` vertices.
    pub fn new(triangles: &[[u32; 3]], count: usize) -> Self {
        let mut pairs = vec![Vec::new(); count];
        for &[a, b, c] in triangles {
            for (i, j, k) in [(a, b, c), (b, c, a), (c, a, b)] {
                pairs[i as usize].push([j, k]);
            }
        }
        let walks: Vec<Vec<u32>> = pairs
            .into_iter()
            .enumerate()
            .map(|(i, left)| walk(i as u32, left))
            .collect();
        let (mut start, mut around) = (vec![0], Vec::new());
        for first in (0..count).step_by(GROUP) {
            let of = |lane: usize| &walks[place(first + lane, count)];
            let rows = (0..GROUP).map(|lane| of(lane).len()).max().unwrap_or(0);
            around.extend(
                (0..rows)
                    .map(|row| std::array::from_fn(|lane| of(lane)[row.min(of(lane).len() - 1)])),
            );
            start.push(around.len() as u32);
        }
        Self { start, around }
    }

    /// Writes the gradient of the volume at `x` for each vertex and returns the volume; `terms` is
    /// a work array.
    pub fn volume(
        &self,
        width: SimdWidth,
        x: &[Slot],
        gradient: &mut [Slot],
        terms: &mut Terms,
    ) -> f64 {
        let Some(&origin) = x.first() else { return 0.0 };
        let [volume, ..] = &mut terms.0;
        volume.resize(x.len().next_multiple_of(GROUP), 0.0);
        let kernel = |(k, (gradient, volume)): (usize, (&mut [Slot], &mut [f64]))| {
            run(
                width,
                Gradient {
                    rings: self,
                    x,
                    origin,
                    first: k * SHARE,
                    gradient,
                    volume,
                },
            );
        };
        if is_shared(x.len()) {
            gradient
                .par_chunks_mut(SHARE)
                .zip(volume.par_chunks_mut(SHARE))
                .enumerate()
                .for_each(kernel);
        } else {
            kernel((0, (gradient, volume)));
        }
        // V = (1/3) sum x_i.g_i, as V is homogeneous of degree 3.
        tree_sum(&volume[..x.len()]) / 3.0
    }

    /// The coefficients of s, s^2 and s^3 of the volume at `x + s field`, from the given gradient
    /// of the volume.
    pub fn along(
        &self,
        width: SimdWidth,
        x: &[Slot],
        gradient: &[Slot],
        field: &[Slot],
        terms: &mut Terms,
    ) -> [f64; 3] {
        let Some(&origin) = x.first() else {
            return [0.0; 3];
        };
        terms
            .0
            .iter_mut()
            .for_each(|t| t.resize(x.len().next_multiple_of(GROUP), 0.0));
        let [linear, square, cubic] = &mut terms.0;
        let kernel = |(k, ((linear, square), cubic)): (usize, ThreeChunks)| {
            run(
                width,
                Along {
                    rings: self,
                    x,
                    origin,
                    gradient,
                    field,
                    first: k * SHARE,
                    terms: [linear, square, cubic],
                },
            );
        };
        if is_shared(x.len()) {
            let both = linear
                .par_chunks_mut(SHARE)
                .zip(square.par_chunks_mut(SHARE));
            both.zip(cubic.par_chunks_mut(SHARE))
                .enumerate()
                .for_each(kernel);
        } else {
            kernel((0, ((linear, square), cubic)));
        }
        let [linear, square, cubic] = terms.0.each_ref().map(|t| tree_sum(&t[..x.len()]));
        [linear, square, cubic / 3.0]
    }

    /// Heap memory held [bytes].
    pub fn bytes(&self) -> usize {
        self.start.capacity() * 4 + self.around.capacity() * size_of::<[u32; GROUP]>()
    }

    /// g_i = (1/6) sum p_j x p_k over the triangles of each vertex `i` from `first`, one vertex per
    /// lane.
    ///
    /// Only the part of p_j x p_k relative to p_i varies with the triangle; on a closed surface the
    /// rest cancels. Differences to p_i are exact where coordinates are large.
    #[inline(always)]
    fn gather<N: Lane>(&self, machine: N::Machine, slots: &[Slot], first: usize) -> Triple<N> {
        let at = of_vertices::<N>(machine, slots, first);
        let zero = N::splat(machine, 0.0);
        let mut sum = [zero; 3];
        let (group, lane) = (first / GROUP, first % GROUP);
        let rows = &self.around[self.start[group] as usize..self.start[group + 1] as usize];
        let Some((row, rest)) = rows.split_first() else {
            return sum;
        };
        let [x, y, z, _] = N::gather(machine, slots, |l| row[lane + l]);
        let mut a = sub([x, y, z], at);
        for row in rest {
            let [x, y, z, _] = N::gather(machine, slots, |l| row[lane + l]);
            let b = sub([x, y, z], at);
            let c = cross(a, b);
            sum = [sum[0] + c[0], sum[1] + c[1], sum[2] + c[2]];
            a = b;
        }
        let sixth = N::splat(machine, 1.0 / 6.0);
        sum.map(|s| s * sixth)
    }
}

impl Terms {
    /// Heap memory held [bytes].
    pub fn bytes(&self) -> usize {
        self.0.iter().map(|t| t.capacity() * 8).sum()
    }
}

/// The corners around vertex `i`; `left` are the other corners of its triangles, never empty.
fn walk(i: u32, mut left: Vec<[u32; 2]>) -> Vec<u32> {
    let mut around = Vec::with_capacity(left.len() + 1);
    while !left.is_empty() {
        if !around.is_empty() {
            around.push(i);
        }
        let [first, mut last] = left.remove(0);
        around.extend([first, last]);
        while let Some(next) = left.iter().position(|pair| pair[0] == last) {
            last = left.remove(next)[1];
            around.push(last);
        }
    }
    if around.is_empty() { vec![i] } else { around }
}

/// The vertex of a lane: lanes beyond the last vertex repeat it.
#[inline(always)]
fn place(i: usize, count: usize) -> usize {
    i.min(count - 1)
}

/// The slots of the vertices from `first`.
#[inline(always)]
fn of_vertices<N: Lane>(machine: N::Machine, slots: &[Slot], first: usize) -> Triple<N> {
    let [x, y, z, _] = N::gather(machine, slots, |l| place(first + l, slots.len()) as u32);
    [x, y, z]
}

/// The coordinates of one point in all lanes.
#[inline(always)]
fn splat<N: Lane>(machine: N::Machine, &Slot([x, y, z, _]): &Slot) -> Triple<N> {
    [
        N::splat(machine, x),
        N::splat(machine, y),
        N::splat(machine, z),
    ]
}

struct Gradient<'a> {
    rings: &'a Rings,
    x: &'a [Slot],
    origin: Slot,
    /// First vertex of the results.
    first: usize,
    gradient: &'a mut [Slot],
    volume: &'a mut [f64],
}

impl InLanes for Gradient<'_> {
    #[inline(always)]
    fn run<N: Lane>(self, machine: N::Machine) {
        let (count, origin) = (self.x.len(), splat::<N>(machine, &self.origin));
        for to in (0..self.gradient.len()).step_by(N::COUNT) {
            let first = self.first + to;
            let [x, y, z] = self.rings.gather::<N>(machine, self.x, first);
            let columns = [x, y, z, N::splat(machine, 0.0)];
            N::scatter(columns, self.gradient, |l| {
                (place(first + l, count) - self.first) as u32
            });
            let at = of_vertices::<N>(machine, self.x, first);
            dot(sub(at, origin), [x, y, z]).store(&mut self.volume[to..]);
        }
    }
}

struct Along<'a> {
    rings: &'a Rings,
    x: &'a [Slot],
    origin: Slot,
    gradient: &'a [Slot],
    field: &'a [Slot],
    /// First vertex of the results.
    first: usize,
    terms: [&'a mut [f64]; 3],
}

impl InLanes for Along<'_> {
    #[inline(always)]
    fn run<N: Lane>(self, machine: N::Machine) {
        let origin = splat::<N>(machine, &self.origin);
        let [linear, square, cubic] = self.terms;
        for to in (0..linear.len()).step_by(N::COUNT) {
            let first = self.first + to;
            // The volume is a symmetric trilinear form. Its gradient at the field times x is the
            // coefficient of s^2. Its gradient at the field times the field is three times the
            // coefficient of s^3.
            let of_field = self.rings.gather::<N>(machine, self.field, first);
            let d = of_vertices::<N>(machine, self.field, first);
            let g = of_vertices::<N>(machine, self.gradient, first);
            let x = of_vertices::<N>(machine, self.x, first);
            dot(g, d).store(&mut linear[to..]);
            dot(sub(x, origin), of_field).store(&mut square[to..]);
            dot(d, of_field).store(&mut cubic[to..]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ring_is_walked_around_and_fans_are_kept_apart() {
        // Two tetrahedra that share a vertex, and a vertex without triangles.
        let one = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]];
        let other = one.map(|t| t.map(|v: u32| if v == 0 { 0 } else { v + 3 }));
        let rings = Rings::new(&[one, other].concat(), 8);
        let ring = |i: usize| rings.around.iter().map(|row| row[i]).collect::<Vec<_>>();
        assert_eq!(rings.start, [0, 9]);
        assert_eq!(ring(0), [1, 2, 3, 1, 0, 4, 5, 6, 4]);
        assert_eq!(ring(1), [2, 0, 3, 2, 2, 2, 2, 2, 2]);
        assert_eq!(ring(7), [7; 9]);
    }
}
