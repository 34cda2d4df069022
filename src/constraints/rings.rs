//! Sums over the rings of triangles around the vertices of a closed surface: the gradient of the
//! volume.

use rayon::prelude::*;

use super::lanes::{InLanes, Lane, SimdWidth, Triple, cross, dot, run, sub};
use crate::mesh::sum::{LEAF, LEAF_PARTS, pairwise};
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

/// Sums over the leaves of a fixed tree. The bits do not depend on lanes and threads.
#[derive(Clone, Debug, Default)]
pub struct Terms([Vec<f64>; 3]);

/// What a leaf writes: gradients, their field and the sum for the volume.
type Leaf<'a> = ((&'a mut [Slot], &'a mut [Slot]), &'a mut f64);

/// The sum of each of the three terms of a leaf.
type ThreeSums<'a> = ((&'a mut f64, &'a mut f64), &'a mut f64);

/// A leaf of the tree is what one thread computes at least.
const _: () = assert!(SHARE == LEAF && GROUP == LEAF_PARTS);

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

    /// Writes the gradient of the volume at `x` for each vertex, and the gradient times the inverse mass of
    /// the vertex. Returns the volume; `terms` is a work array.
    pub fn volume(
        &self,
        width: SimdWidth,
        x: &[Slot],
        [gradient, field]: [&mut [Slot]; 2],
        terms: &mut Terms,
    ) -> f64 {
        let Some(&origin) = x.first() else { return 0.0 };
        let [volume, ..] = &mut terms.0;
        volume.resize(x.len().div_ceil(SHARE), 0.0);
        let kernel = |(k, ((gradient, field), volume)): (usize, Leaf<'_>)| {
            let work = Gradient {
                rings: self,
                x,
                origin,
                first: k * SHARE,
                gradient,
                field,
                volume,
            };
            run(width, work);
        };
        if is_shared(x.len()) {
            let both = gradient.par_chunks_mut(SHARE);
            let both = both.zip(field.par_chunks_mut(SHARE));
            both.zip(volume).enumerate().for_each(kernel);
        } else {
            let both = gradient.chunks_mut(SHARE).zip(field.chunks_mut(SHARE));
            both.zip(volume).enumerate().for_each(kernel);
        }
        // V = (1/3) sum x_i.g_i, as V is homogeneous of degree 3.
        pairwise(&terms.0[0]) / 3.0
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
        let leaves = x.len().div_ceil(SHARE);
        terms.0.iter_mut().for_each(|t| t.resize(leaves, 0.0));
        let [linear, square, cubic] = &mut terms.0;
        let kernel = |(k, ((linear, square), cubic)): (usize, ThreeSums<'_>)| {
            let work = Along {
                rings: self,
                x,
                origin,
                gradient,
                field,
                first: k * SHARE,
                terms: [linear, square, cubic],
            };
            run(width, work);
        };
        if is_shared(x.len()) {
            let both = linear.par_iter_mut().zip(square);
            both.zip(cubic).enumerate().for_each(kernel);
        } else {
            let both = linear.iter_mut().zip(square);
            both.zip(cubic).enumerate().for_each(kernel);
        }
        let [linear, square, cubic] = terms.0.each_ref().map(|t| pairwise(t));
        [linear, square, cubic / 3.0]
    }

    /// Heap memory held [bytes].
    pub fn bytes(&self) -> usize {
        self.start.capacity() * 4 + self.around.capacity() * size_of::<[u32; GROUP]>()
    }

    /// g_i = (1/6) sum p_j x p_k over the triangles of the vertices `i` of a group whose points are `at`, from
    /// lane `lane` on, one vertex per lane.
    ///
    /// Only the part of p_j x p_k relative to p_i varies with the triangle; on a closed surface the
    /// rest cancels. Differences to p_i are exact where coordinates are large.
    #[inline(always)]
    fn gather<N: Lane>(
        &self,
        machine: N::Machine,
        slots: &[Slot],
        (group, lane): (usize, usize),
        at: Triple<N>,
    ) -> Triple<N> {
        let zero = N::splat(machine, 0.0);
        let mut sum = [zero; 3];
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
fn of_vertices<N: Lane>(machine: N::Machine, slots: &[Slot], first: usize) -> [N; 4] {
    // In all groups but the last one all vertices exist, and no index needs a check.
    match slots.get(first..first + N::COUNT) {
        Some(these) => N::gather(machine, these, |l| l as u32),
        None => N::gather(machine, slots, |l| place(first + l, slots.len()) as u32),
    }
}

/// Writes the slots of the vertices from `first`; lanes beyond the last vertex repeat it.
#[inline(always)]
fn to_vertices<N: Lane>(columns: [N; 4], slots: &mut [Slot], first: usize) {
    let count = slots.len();
    match slots.get_mut(first..first + N::COUNT) {
        Some(these) => N::scatter(columns, these, |l| l as u32),
        None => N::scatter(columns, slots, |l| place(first + l, count) as u32),
    }
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

/// Sums of a leaf in as many parts as a group has vertices, as [`crate::mesh::sum::tree_sum`] adds.
struct Parts([f64; GROUP]);

impl Parts {
    /// Adds the lanes that begin at `lane` of a group, of which only the first `count` vertices exist.
    #[inline(always)]
    fn add<N: Lane>(&mut self, machine: N::Machine, value: N, (lane, count): (usize, usize)) {
        let parts = &mut self.0[lane..lane + N::COUNT];
        let sum = N::load(machine, parts) + value;
        if lane + N::COUNT <= count {
            return sum.store(parts);
        }
        let mut all = [0.0; GROUP];
        sum.store(&mut all);
        let few = count.saturating_sub(lane);
        parts[..few].copy_from_slice(&all[..few]);
    }

    fn total(&self) -> f64 {
        pairwise(&self.0)
    }
}

struct Gradient<'a> {
    rings: &'a Rings,
    x: &'a [Slot],
    origin: Slot,
    /// First vertex of the results.
    first: usize,
    gradient: &'a mut [Slot],
    field: &'a mut [Slot],
    volume: &'a mut f64,
}

impl InLanes for Gradient<'_> {
    #[inline(always)]
    fn run<N: Lane>(self, machine: N::Machine) {
        let (count, origin) = (self.gradient.len(), splat::<N>(machine, &self.origin));
        let zero = N::splat(machine, 0.0);
        let mut sum = Parts([0.0; GROUP]);
        for to in (0..count).step_by(GROUP) {
            for lane in (0..GROUP).step_by(N::COUNT) {
                let first = self.first + to + lane;
                let [x, y, z, w] = of_vertices::<N>(machine, self.x, first);
                let (at, place_of) = ([x, y, z], ((self.first + to) / GROUP, lane));
                let [x, y, z] = self.rings.gather::<N>(machine, self.x, place_of, at);
                to_vertices([x, y, z, zero], self.gradient, to + lane);
                to_vertices([x * w, y * w, z * w, zero], self.field, to + lane);
                let term = dot(sub(at, origin), [x, y, z]);
                sum.add(machine, term, (lane, count - to));
            }
        }
        *self.volume = sum.total();
    }
}

struct Along<'a> {
    rings: &'a Rings,
    x: &'a [Slot],
    origin: Slot,
    gradient: &'a [Slot],
    field: &'a [Slot],
    /// First vertex of the leaf.
    first: usize,
    terms: [&'a mut f64; 3],
}

impl InLanes for Along<'_> {
    #[inline(always)]
    fn run<N: Lane>(self, machine: N::Machine) {
        let origin = splat::<N>(machine, &self.origin);
        let count = (self.x.len() - self.first).min(SHARE);
        let (mut linear, mut square, mut cubic) = (
            Parts([0.0; GROUP]),
            Parts([0.0; GROUP]),
            Parts([0.0; GROUP]),
        );
        for from in (0..count).step_by(GROUP) {
            for lane in (0..GROUP).step_by(N::COUNT) {
                let first = self.first + from + lane;
                let [dx, dy, dz, _] = of_vertices::<N>(machine, self.field, first);
                let [gx, gy, gz, _] = of_vertices::<N>(machine, self.gradient, first);
                let [x, y, z, _] = of_vertices::<N>(machine, self.x, first);
                let (d, group) = ([dx, dy, dz], (self.first + from) / GROUP);
                // The volume is a symmetric trilinear form. Its gradient at the field times x is the
                // coefficient of s^2. Its gradient at the field times the field is three times the
                // coefficient of s^3.
                let of_field = self
                    .rings
                    .gather::<N>(machine, self.field, (group, lane), d);
                let at = (lane, count - from);
                linear.add(machine, dot([gx, gy, gz], d), at);
                square.add(machine, dot(sub([x, y, z], origin), of_field), at);
                cubic.add(machine, dot(d, of_field), at);
            }
        }
        let [to_linear, to_square, to_cubic] = self.terms;
        *to_linear = linear.total();
        *to_square = square.total();
        *to_cubic = cubic.total();
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
