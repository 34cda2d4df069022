//! Sums over the rings of triangles around the vertices of a closed surface: the gradient of its volume.

use super::lanes::{InTrios, Trio, Width, run_in_trios};
use crate::mesh::sum::tree_sum;
use crate::particles::Slot;

/// For each vertex the other corners of its triangles, walked around once.
#[derive(Clone, Debug)]
pub struct Rings {
    start: Vec<u32>,
    /// Each two that follow each other are the other corners of a triangle, in cyclic order. Where a vertex has several
    /// fans it stands itself between them: the product with a difference of nothing adds nothing.
    around: Vec<u32>,
}

/// Terms of the volume's polynomial along a field, a number a vertex.
#[derive(Clone, Debug, Default)]
pub struct Terms([Vec<f64>; 3]);

impl Rings {
    /// The rings of `count` vertices.
    pub fn new(triangles: &[[u32; 3]], count: usize) -> Self {
        let mut pairs = vec![Vec::new(); count];
        for &[a, b, c] in triangles {
            for (i, j, k) in [(a, b, c), (b, c, a), (c, a, b)] {
                pairs[i as usize].push([j, k]);
            }
        }
        let (mut start, mut around) = (vec![0], Vec::new());
        for (i, mut left) in pairs.into_iter().enumerate() {
            while !left.is_empty() {
                if around.len() > start[i] as usize {
                    around.push(i as u32);
                }
                let [first, mut last] = left.remove(0);
                around.extend([first, last]);
                while let Some(next) = left.iter().position(|pair| pair[0] == last) {
                    last = left.remove(next)[1];
                    around.push(last);
                }
            }
            start.push(around.len() as u32);
        }
        Self { start, around }
    }

    /// Writes the gradient of the volume at `x` of each vertex and returns the volume; `terms` is room to work in.
    pub fn volume(&self, width: Width, x: &[Slot], gradient: &mut [Slot], terms: &mut Terms) -> f64 {
        let Some(&origin) = x.first() else { return 0.0 };
        let [volume, ..] = &mut terms.0;
        volume.resize(x.len(), 0.0);
        run_in_trios(width, Gradient { rings: self, x, origin, gradient, volume });
        // V = (1/3) sum x_i.g_i, as V is homogeneous of degree 3.
        tree_sum(volume) / 3.0
    }

    /// The factors before s, s^2 and s^3 of the volume at `x + s field`, where the volume has the given gradient.
    pub fn along(&self, width: Width, x: &[Slot], gradient: &[Slot], field: &[Slot], terms: &mut Terms) -> [f64; 3] {
        let Some(&origin) = x.first() else { return [0.0; 3] };
        terms.0.iter_mut().for_each(|t| t.resize(x.len(), 0.0));
        run_in_trios(width, Along { rings: self, x, origin, gradient, field, terms });
        let [linear, square, cubic] = terms.0.each_ref().map(|t| tree_sum(t));
        [linear, square, cubic / 3.0]
    }

    /// Heap memory held [bytes].
    pub fn bytes(&self) -> usize {
        (self.start.capacity() + self.around.capacity()) * 4
    }

    /// g_i = (1/6) sum p_j x p_k over the triangles of vertex `i`.
    ///
    /// Of p_j x p_k only the part relative to p_i changes with the triangle; on a closed surface the rest cancels, so
    /// differences to p_i are exact where coordinates are large.
    #[inline(always)]
    fn gather<P: Trio>(&self, machine: P::Machine, slots: &[Slot], i: usize) -> P {
        let at = P::read(machine, &slots[i]);
        let mut sum = P::splat(machine, 0.0);
        let Some((&first, rest)) = self.around[self.start[i] as usize..self.start[i + 1] as usize].split_first() else {
            return sum;
        };
        let mut a = P::read(machine, &slots[first as usize]) - at;
        let mut a_turned = a.turned();
        for &next in rest {
            let b = P::read(machine, &slots[next as usize]) - at;
            let b_turned = b.turned();
            // The cross product, its components turned back by one place.
            sum = sum + (a * b_turned - a_turned * b);
            (a, a_turned) = (b, b_turned);
        }
        sum.turned() * P::splat(machine, 1.0 / 6.0)
    }
}

impl Terms {
    /// Heap memory held [bytes].
    pub fn bytes(&self) -> usize {
        self.0.iter().map(|t| t.capacity() * 8).sum()
    }
}

/// The scalar product, summed in turn.
#[inline(always)]
fn dot<P: Trio>(a: P, b: P) -> f64 {
    let Slot([x, y, z, _]) = (a * b).slot();
    x + y + z
}

struct Gradient<'a> {
    rings: &'a Rings,
    x: &'a [Slot],
    origin: Slot,
    gradient: &'a mut [Slot],
    volume: &'a mut [f64],
}

impl InTrios for Gradient<'_> {
    #[inline(always)]
    fn run<P: Trio>(self, machine: P::Machine) {
        let origin = P::read(machine, &self.origin);
        let both = self.gradient.iter_mut().zip(self.volume);
        for (i, ((gradient, volume), x)) in both.zip(self.x).enumerate() {
            let g: P = self.rings.gather(machine, self.x, i);
            *gradient = g.slot();
            *volume = dot(P::read(machine, x) - origin, g);
        }
    }
}

struct Along<'a> {
    rings: &'a Rings,
    x: &'a [Slot],
    origin: Slot,
    gradient: &'a [Slot],
    field: &'a [Slot],
    terms: &'a mut Terms,
}

impl InTrios for Along<'_> {
    #[inline(always)]
    fn run<P: Trio>(self, machine: P::Machine) {
        let origin = P::read(machine, &self.origin);
        let [linear, square, cubic] = &mut self.terms.0;
        let terms = linear.iter_mut().zip(square).zip(cubic);
        let given = self.x.iter().zip(self.gradient).zip(self.field);
        for (i, (((linear, square), cubic), ((x, g), d))) in terms.zip(given).enumerate() {
            // The volume is a symmetric trilinear form: its gradient at the field d times x is before s^2, times d
            // three times what is before s^3.
            let of_field: P = self.rings.gather(machine, self.field, i);
            let d = P::read(machine, d);
            *linear = dot(P::read(machine, g), d);
            *square = dot(P::read(machine, x) - origin, of_field);
            *cubic = dot(d, of_field);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ring_is_walked_around_and_fans_are_kept_apart() {
        // Two tetrahedra that share a vertex.
        let one = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]];
        let other = one.map(|t| t.map(|v: u32| if v == 0 { 0 } else { v + 3 }));
        let rings = Rings::new(&[one, other].concat(), 8);
        let ring = |i: usize| &rings.around[rings.start[i] as usize..rings.start[i + 1] as usize];
        assert_eq!(ring(0), [1, 2, 3, 1, 0, 4, 5, 6, 4]);
        assert_eq!(ring(1), [2, 0, 3, 2]);
        assert!(ring(7).is_empty(), "a vertex without triangles");
    }
}
