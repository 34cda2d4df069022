//! The harmonic field in the cells, and its gradient everywhere.
//!
//! Finite volumes: the flux through the face between two cells is the difference of their values times the open area over
//! the distance. All entries off the diagonal are negative, so that no cell is a peak or a pit: from each, some neighbour
//! leads on towards either area.

use nalgebra::{Point3, Vector3};

use rayon::prelude::*;

use super::super::attachment::{Area, over_triangle};
use super::super::solid::Solid;
use super::cells::{Cells, NONE};
use super::spread::spread;
use crate::mesh::TriangleMesh;
use crate::mesh::closest::SurfaceTree;
use crate::solvers::sparse::{Factor, FactorError};

/// What passes through an area over what passes through the muscle, for the same difference of values. Small: the flux is
/// spread evenly over each area, as \[choi2013\] prescribes it, and does not crowd at the rim that faces the other area.
const PASSAGE: f64 = 0.1;

/// How strongly streamlines outside the wall are led back, and how far inside it [cells] that begins.
const PUSH: f64 = 0.3;
const PUSH_FROM: f64 = 0.25;
/// How many cubes from an area count as near it.
const BY_AREA: usize = 3;

/// Values of the field and its gradient at the middles of the cells.
#[derive(Clone, Debug)]
pub struct Field {
    /// The cells.
    pub cells: Cells,
    /// 0 at the origin, 1 at the insertion; NaN in cells that are not joined to both.
    pub values: Vec<f64>,
    /// Whether an area passes near a cube, for each place of the box: of the origin, of the insertion.
    pub by_area: [Vec<bool>; 2],
    /// Of the values; where lines on the surface were given, unit vectors along what they say.
    gradients: Vec<Vector3<f64>>,
    nodes: Vec<Node>,
}

/// What is interpolated of a cell, together in memory: streamlines ask for nothing else.
#[derive(Clone, Copy, Debug)]
struct Node {
    gradient: Vector3<f64>,
    push: Vector3<f64>,
    value: f64,
    /// Share of the cell inside; 0 where it has no value.
    share: f64,
}

/// Gradient along the wall, and push off it.
type Led = (Vector3<f64>, Vector3<f64>);

/// The field at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Its gradient [1/m], or the direction of lines on the surface, along the wall where that is near.
    pub gradient: Vector3<f64>,
    /// Its value.
    pub value: f64,
    /// Direction and strength in which streamlines are kept off the wall, relative to their own direction.
    pub push: Vector3<f64>,
}

/// Why there is no field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FieldError {
    /// No way leads from the origin to the insertion inside.
    NotJoined,
    /// The system could not be solved.
    Factor(FactorError),
}

impl Field {
    /// Solves for the field: 0 behind the origin, 1 behind the insertion, no flux through the rest of the surface. If there are
    /// `lines` on the surface [m], streamlines follow their directions, spread through the inside ([`super::spread`]).
    ///
    /// # Errors
    /// The areas are not joined inside, no memory.
    pub fn new(
        cells: Cells,
        solid: &Solid<'_>,
        muscle: &TriangleMesh,
        origin: &Area,
        insertion: &Area,
        lines: &[Vec<Point3<f64>>],
    ) -> Result<Self, FieldError> {
        let mut contacts = [contact(&cells, muscle, origin), contact(&cells, muscle, insertion)];
        let by_area = [0, 1].map(|end: usize| {
            let mut marked = vec![false; cells.at.len()];
            for (_, place) in cells.places.iter().enumerate().filter(|(c, _)| contacts[end][*c] > 0.0) {
                marked[cells.index(place.map(|k| k as usize))] = true;
            }
            cells.around(&marked, BY_AREA)
        });
        // Of a bar of the same volume and length, in faces over cells.
        let inside: f64 = cells.shares.iter().sum();
        let through = inside * (cells.side / muscle.length()).powi(2);
        for contact in &mut contacts {
            let whole: f64 = contact.iter().sum();
            contact.iter_mut().for_each(|c| *c *= PASSAGE * through / whole);
        }
        let links: Vec<(u32, u32, usize)> = cells.links().collect();
        let wanted = joined(&cells, &links, &contacts);
        let count = wanted.iter().filter(|w| **w).count();
        if count == 0 {
            return Err(FieldError::NotJoined);
        }
        let mut name = vec![NONE; cells.count()];
        (0..cells.count()).filter(|&c| wanted[c]).enumerate().for_each(|(n, c)| name[c] = n as u32);
        let kept: Vec<_> = links.into_iter().filter(|&(a, _, _)| wanted[a as usize]).collect();
        let pairs: Vec<[u32; 2]> = kept.iter().map(|&(a, b, _)| [name[a as usize], name[b as usize]]).collect();
        let mut factor = Factor::<1>::new(count, &pairs).map_err(FieldError::Factor)?;
        for (&(a, _, axis), &[i, j]) in kept.iter().zip(&pairs) {
            let conductance = cells.open[a as usize][axis];
            factor.add(i.max(j), i.min(j), &[[-conductance]]);
            factor.add_diagonal(i, conductance);
            factor.add_diagonal(j, conductance);
        }
        let mut values = vec![0.0; count];
        for c in (0..cells.count()).filter(|&c| wanted[c]) {
            let n = name[c];
            factor.add_diagonal(n, contacts[0][c] + contacts[1][c]);
            values[n as usize] = contacts[1][c];
        }
        factor.factorise().map_err(FieldError::Factor)?;
        factor.solve(&mut values, 1);
        let values = name.iter().map(|&n| if n == NONE { f64::NAN } else { values[n as usize] }).collect();
        let mut this = Self { gradients: Vec::new(), nodes: Vec::new(), by_area, cells, values };
        this.gradients = this.gradients(&kept);
        if !lines.is_empty() {
            this.follow(lines, &name, &kept).map_err(FieldError::Factor)?;
        }
        this.lead_along_walls(solid, &[origin, insertion].map(|area| area.tree(muscle)));
        Ok(this)
    }

    /// Puts directions of lines in the place of the gradients.
    fn follow(
        &mut self,
        lines: &[Vec<Point3<f64>>],
        name: &[u32],
        links: &[(u32, u32, usize)],
    ) -> Result<(), FactorError> {
        let link =
            |&(a, b, axis): &(u32, u32, usize)| ([a, b].map(|c| name[c as usize]), self.cells.open[a as usize][axis]);
        let links: Vec<([u32; 2], f64)> = links.iter().map(link).collect();
        self.gradients = spread(&self.cells, name, &links, &self.gradients, lines)?;
        Ok(())
    }

    /// Takes from the gradients near a wall what points across it, and notes where to lead back: once for each cell, and
    /// between cells as smooth as the gradient itself, so that no two streamlines are thrown together.
    fn lead_along_walls(&mut self, solid: &Solid<'_>, areas: &[SurfaceTree; 2]) {
        let (cells, by_area) = (&self.cells, &self.by_area);
        let led = |c: usize| -> Option<Led> {
            let place = cells.places[c].map(|k| k as usize);
            let index = cells.index(place);
            if !cells.by_wall[index] {
                return None;
            }
            let middle = cells.middle(place);
            let wall = solid.wall(&middle, 2.0 * cells.side)?;
            let inside = solid.contains(&middle);
            let inwards = if inside { wall.away } else { -wall.away };
            let depth = if inside { wall.distance } else { -wall.distance } / cells.side;
            // 0 where what is nearest of the surface is an area, 1 where both areas are twice as far.
            let to = |k: usize| by_area[k][index].then(|| areas[k].closest(&middle, 2.0 * wall.distance)).flatten();
            let nearest = (0..2).filter_map(to).map(|found| found.distance).fold(2.0 * wall.distance, f64::min);
            let is_wall = if wall.distance > 0.0 { (nearest / wall.distance - 1.0).clamp(0.0, 1.0) } else { 1.0 };
            let gradient = self.gradients[c];
            let across = inwards * (gradient.dot(&inwards) * is_wall * (1.0 - depth).clamp(0.0, 1.0));
            Some((gradient - across, inwards * (PUSH * is_wall * (PUSH_FROM - depth).clamp(0.0, 1.0))))
        };
        let all: Vec<_> = (0..cells.count()).into_par_iter().map(led).collect();
        let node = |(c, led): (usize, Option<Led>)| {
            let (gradient, push) = led.unwrap_or((self.gradients[c], Vector3::zeros()));
            let known = !self.values[c].is_nan();
            let (value, share) = if known { (self.values[c], self.cells.shares[c]) } else { (0.0, 0.0) };
            Node { gradient, push, value, share }
        };
        self.nodes = all.into_iter().enumerate().map(node).collect();
        self.gradients = Vec::new();
    }

    /// Mean of the slopes through the two faces along each axis, each by how far it is open.
    fn gradients(&self, links: &[(u32, u32, usize)]) -> Vec<Vector3<f64>> {
        let mut sums = vec![[[0.0; 2]; 3]; self.cells.count()];
        for &(a, b, axis) in links {
            let (a, b) = (a as usize, b as usize);
            let open = self.cells.open[a][axis];
            let slope = (self.values[b] - self.values[a]) / self.cells.side;
            for c in [a, b] {
                sums[c][axis][0] += open * slope;
                sums[c][axis][1] += open;
            }
        }
        let mean = |[sum, weight]: [f64; 2]| if weight > 0.0 { sum / weight } else { 0.0 };
        sums.into_iter().map(|s| Vector3::from(s.map(mean))).collect()
    }

    /// The field at a point, between the middles of the cells around it; `None` where there is no cell.
    pub fn at(&self, p: &Point3<f64>) -> Option<Sample> {
        let cells = &self.cells;
        let local = (p - cells.low) / cells.side - Vector3::repeat(0.5);
        let base = local.map(f64::floor);
        let part = local - base;
        let sides: [[f64; 2]; 3] = std::array::from_fn(|k| [1.0 - part[k], part[k]]);
        let place: [isize; 3] = std::array::from_fn(|k| base[k] as isize);
        let [nx, ny, nz] = cells.dims.map(|n| n as isize);
        let (mut gradient, mut push, mut value, mut total) = (Vector3::zeros(), Vector3::zeros(), 0.0, 0.0);
        for bit in 0..8usize {
            let bits = [bit & 1, bit >> 1 & 1, bit >> 2 & 1];
            let [i, j, k] = [0, 1, 2].map(|axis: usize| place[axis] + bits[axis] as isize);
            if i < 0 || j < 0 || k < 0 || i >= nx || j >= ny || k >= nz {
                continue;
            }
            let cell = cells.at[((k * ny + j) * nx + i) as usize];
            if cell == NONE {
                continue;
            }
            let node = &self.nodes[cell as usize];
            // What is known of a cell is as good as its share inside.
            let weight = sides[0][bits[0]] * sides[1][bits[1]] * sides[2][bits[2]] * node.share;
            push += node.push * weight;
            gradient += node.gradient * weight;
            value += node.value * weight;
            total += weight;
        }
        (total > 0.0).then(|| Sample { gradient: gradient / total, value: value / total, push: push / total })
    }

    /// The neighbour of a cell with the greatest (`sign` = 1) or least value, if it is beyond that of the cell.
    pub fn onward(&self, cell: u32, sign: f64) -> Option<u32> {
        let place = self.cells.places[cell as usize].map(|k| k as usize);
        let index = self.cells.index(place);
        let mut best = (sign * self.values[cell as usize], None);
        for axis in 0..3 {
            let step = [1, self.cells.dims[0], self.cells.dims[0] * self.cells.dims[1]][axis];
            for (other, holder) in [(index + step, index), (index - step, index - step)] {
                let (other, holder) = (self.cells.at[other], self.cells.at[holder]);
                if other == NONE || holder == NONE || self.cells.open[holder as usize][axis] == 0.0 {
                    continue;
                }
                let value = sign * self.values[other as usize];
                if value > best.0 {
                    best = (value, Some(other));
                }
            }
        }
        best.1
    }
}

/// The area in each cell, in faces.
fn contact(cells: &Cells, muscle: &TriangleMesh, area: &Area) -> Vec<f64> {
    let mut contact = vec![0.0; cells.count()];
    for &t in &area.triangles {
        let corners = muscle.corners(t as usize);
        let samples = over_triangle(&corners, 0.5 * cells.side);
        let [a, b, c] = corners;
        let each = 0.5 * (b - a).cross(&(c - a)).norm() / samples.len() as f64 / (cells.side * cells.side);
        for p in &samples {
            let cell = cells.at[cells.holding(p)];
            if cell != NONE {
                contact[cell as usize] += each;
            }
        }
    }
    contact
}

/// Whether a cell belongs to a piece that touches both areas.
fn joined(cells: &Cells, links: &[(u32, u32, usize)], contacts: &[Vec<f64>; 2]) -> Vec<bool> {
    let mut parents: Vec<u32> = (0..cells.count() as u32).collect();
    fn root(parents: &mut [u32], mut c: u32) -> u32 {
        while parents[c as usize] != c {
            parents[c as usize] = parents[parents[c as usize] as usize];
            c = parents[c as usize];
        }
        c
    }
    for &(a, b, _) in links {
        let (a, b) = (root(&mut parents, a), root(&mut parents, b));
        parents[a.max(b) as usize] = a.min(b);
    }
    let roots: Vec<usize> = (0..cells.count() as u32).map(|c| root(&mut parents, c) as usize).collect();
    let mut touches = vec![[false; 2]; cells.count()];
    for (c, &r) in roots.iter().enumerate() {
        (0..2).filter(|&k| contacts[k][c] > 0.0).for_each(|k| touches[r][k] = true);
    }
    roots.iter().map(|&r| touches[r] == [true; 2]).collect()
}
