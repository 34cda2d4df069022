//! The harmonic field in the cells, and its gradient everywhere.
//!
//! The method is finite volumes: the flux through the face between two cells is the difference of
//! their values times the open area over the distance. All entries off the diagonal are negative,
//! so no cell is a local extremum: each cell has a neighbour closer to either area.

use nalgebra::{Point3, Vector3};

use rayon::prelude::*;

use super::super::attachment::{Area, Attachment, over_triangle};
use super::super::solid::Solid;
use super::cells::{Cells, NONE};
use super::directions::extend_directions;
use crate::mesh::TriangleMesh;
use crate::mesh::closest::SurfaceTree;
use crate::mesh::union_find::UnionFind;
use crate::solvers::sparse::{Factor, FactorError};

/// Conductance of an area relative to that of the muscle. A small value distributes the flux over
/// each area as prescribed, like that of \[choi2013\]; the flux does not concentrate at the
/// boundary that faces the other area.
const PASSAGE: f64 = 0.1;
/// Least share of that conductance where most of the flux passes elsewhere.
const LEAST_CONTACT: f64 = 1e-6;

/// Strength of the push on streamlines outside the wall, and the distance inside the wall [cells]
/// at which it begins.
const PUSH: f64 = 0.3;
const PUSH_FROM: f64 = 0.25;
/// Distance from an area, in cubes, that counts as near.
const BY_AREA: usize = 3;

/// Values of the field and its gradient at the middles of the cells.
#[derive(Clone, Debug)]
pub struct Field {
    /// The cells.
    pub cells: Cells,
    /// 0 at the origin, 1 at the insertion; NaN in cells without a connection to both.
    pub values: Vec<f64>,
    /// For each place of the box, true if the cube is near the origin; the same for the insertion.
    pub by_area: [Vec<bool>; 2],
    /// Greatest tangent of the angle between a streamline and the shortest line to its area, beside the
    /// area; with 0 it goes straight to the closest point.
    pub flat: f64,
    /// Gradients of the values; with lines on the surface, unit vectors along the interpolated
    /// directions.
    gradients: Vec<Vector3<f64>>,
    nodes: Vec<Node>,
}

/// The interpolated values of a cell, together in memory: gradient, push, value, and 1, each
/// weighted by the cell's share inside, its measure of reliability; 0 where the cell has no value.
type Node = [f64; 8];

/// Effect of a wall on the flow in a cell.
#[derive(Clone, Copy, Debug)]
struct Lead {
    /// Unit vector off the wall.
    inwards: Vector3<f64>,
    /// Share of the component across the wall that is removed.
    turned: f64,
    /// Strength of the push towards the inside.
    push: f64,
}

/// The field at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Gradient [1/m], or the direction of lines on the surface; parallel to a near wall.
    pub gradient: Vector3<f64>,
    /// Value of the field.
    pub value: f64,
    /// Direction and strength of the push away from the wall, relative to the streamline's
    /// direction.
    pub push: Vector3<f64>,
}

/// Distribution of the flux over an area.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Flux {
    /// Constant over the area.
    Even,
    /// The flux increases with the distance from the other area: as the distance to a power, which
    /// is this factor times the area over the mean cross-section. Fibres cannot begin everywhere on
    /// an area much larger than the cross-section: those near the other area would also have to
    /// cover the space above the rest of the area, and a layer along the area would stay uncovered.
    Crowded(f64),
}

/// Error of [`Field::new`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FieldError {
    /// Origin and insertion are not connected inside.
    NotJoined,
    /// The linear system has no solution.
    Factor(FactorError),
}

impl Field {
    /// Solves for the field: 0 behind the origin, 1 behind the insertion, no flux through the rest
    /// of the surface. With `lines` on the surface [m], streamlines follow their directions,
    /// interpolated to the inside ([`super::directions`]). `flux` is through both areas, and [`Field::flat`]
    /// is `flat`.
    ///
    /// # Errors
    /// The areas are not connected inside, or too little memory.
    pub fn new(
        cells: Cells,
        solid: &Solid<'_>,
        muscle: &TriangleMesh,
        attachment: &Attachment,
        lines: &[Vec<Point3<f64>>],
        (flux, flat): (Flux, f64),
    ) -> Result<Self, FieldError> {
        let ends = [&attachment.origin, &attachment.insertion];
        let contacts = contacts(&cells, muscle, attachment, flux);
        let by_area = contacts.each_ref().map(|contact| {
            let mut marked = vec![false; cells.at.len()];
            for (_, place) in cells
                .places
                .iter()
                .enumerate()
                .filter(|(c, _)| contact[*c] > 0.0)
            {
                marked[cells.index(place.map(|k| k as usize))] = true;
            }
            cells.around(&marked, BY_AREA)
        });
        let links: Vec<(u32, u32, usize)> = cells.links().collect();
        let connected = joined(&cells, &links, &contacts);
        let count = connected.iter().filter(|w| **w).count();
        if count == 0 {
            return Err(FieldError::NotJoined);
        }
        let mut name = vec![NONE; cells.count()];
        (0..cells.count())
            .filter(|&c| connected[c])
            .enumerate()
            .for_each(|(n, c)| name[c] = n as u32);
        let kept: Vec<_> = links
            .into_iter()
            .filter(|&(a, _, _)| connected[a as usize])
            .collect();
        // One thread factorises; the others search for walls.
        let (values, leads) = rayon::join(
            || solved(&cells, &name, &kept, &contacts),
            || leads(&cells, &by_area, solid, &ends.map(|area| area.tree(muscle))),
        );
        let values = values.map_err(FieldError::Factor)?;
        let mut this = Self {
            gradients: Vec::new(),
            nodes: Vec::new(),
            by_area,
            flat,
            cells,
            values,
        };
        this.gradients = this.gradients(&kept);
        if !lines.is_empty() {
            this.follow(lines, &name, &kept)
                .map_err(FieldError::Factor)?;
        }
        this.lead_along_walls(&leads);
        Ok(this)
    }

    /// Replaces the gradients by the directions of lines.
    fn follow(
        &mut self,
        lines: &[Vec<Point3<f64>>],
        name: &[u32],
        links: &[(u32, u32, usize)],
    ) -> Result<(), FactorError> {
        let link = |&(a, b, axis): &(u32, u32, usize)| {
            (
                [a, b].map(|c| name[c as usize]),
                self.cells.open[a as usize][axis],
            )
        };
        let links: Vec<([u32; 2], f64)> = links.iter().map(link).collect();
        self.gradients = extend_directions(&self.cells, name, &links, &self.gradients, lines)?;
        Ok(())
    }

    /// Removes the component across a near wall from the gradients, and stores the push towards the
    /// inside. Each cell has one correction; between cells the correction is as smooth as the
    /// gradient, so no two streamlines merge.
    fn lead_along_walls(&mut self, leads: &[Option<Lead>]) {
        let node = |(c, lead): (usize, &Option<Lead>)| {
            let gradient = self.gradients[c];
            let along =
                |lead: &Lead| gradient - lead.inwards * (gradient.dot(&lead.inwards) * lead.turned);
            let g = lead.as_ref().map_or(gradient, along);
            let push = lead
                .as_ref()
                .map_or_else(Vector3::zeros, |lead| lead.inwards * lead.push);
            let (value, share) = if self.values[c].is_nan() {
                (0.0, 0.0)
            } else {
                (self.values[c], self.cells.shares[c])
            };
            [g.x, g.y, g.z, push.x, push.y, push.z, value, 1.0].map(|n| n * share)
        };
        self.nodes = leads.iter().enumerate().map(node).collect();
        self.gradients = Vec::new();
    }

    /// Mean of the slopes through the two faces along each axis, weighted by their open shares.
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
        sums.into_iter()
            .map(|s| Vector3::from(s.map(mean)))
            .collect()
    }

    /// The field at a point, interpolated between the centres of the cells around it; `None`
    /// outside the cells.
    pub fn at(&self, p: &Point3<f64>) -> Option<Sample> {
        let [x, y, z, a, b, c, value, total] = self.between(p)?;
        let (gradient, push) = (Vector3::new(x, y, z), Vector3::new(a, b, c));
        (total > 0.0).then(|| Sample {
            gradient: gradient / total,
            value: value / total,
            push: push / total,
        })
    }

    /// Unit vector along the flow at a point: towards the insertion for `sign` 1, towards the
    /// origin for -1.
    pub fn direction(&self, p: &Point3<f64>, sign: f64) -> Option<Vector3<f64>> {
        let [x, y, z, a, b, c, _, total] = self.between(p)?;
        let along = Vector3::new(x, y, z).try_normalize(0.0)? * sign;
        let push = Vector3::new(a, b, c);
        if push == Vector3::zeros() {
            Some(along)
        } else {
            (along + push / total).try_normalize(0.0)
        }
    }

    /// The interpolated node at a point.
    fn between(&self, p: &Point3<f64>) -> Option<Node> {
        let cells = &self.cells;
        let [nx, ny, nz] = cells.dims;
        let local = (p - cells.low) / cells.side - Vector3::repeat(0.5);
        // Everything around the box is outside.
        if !(local >= Vector3::zeros()
            && local.x < nx as f64 - 1.0
            && local.y < ny as f64 - 1.0
            && local.z < nz as f64 - 1.0)
        {
            return None;
        }
        let place = [local.x as usize, local.y as usize, local.z as usize];
        let [x, y, z]: [[f64; 2]; 3] = std::array::from_fn(|k| {
            let part = local[k] - place[k] as f64;
            [1.0 - part, part]
        });
        let mut sum = [0.0; 8];
        for (k, z) in z.iter().enumerate() {
            for (j, y) in y.iter().enumerate() {
                let first = ((place[2] + k) * ny + place[1] + j) * nx + place[0];
                for (cell, x) in cells.at[first..first + 2].iter().zip(&x) {
                    if *cell != NONE {
                        let weight = x * y * z;
                        let node = &self.nodes[*cell as usize];
                        sum.iter_mut()
                            .zip(node)
                            .for_each(|(sum, n)| *sum += weight * n);
                    }
                }
            }
        }
        Some(sum)
    }

    /// The neighbour of a cell with the greatest (`sign` = 1) or least value, if that exceeds the
    /// cell's value.
    pub fn onward(&self, cell: u32, sign: f64) -> Option<u32> {
        let place = self.cells.places[cell as usize].map(|k| k as usize);
        let index = self.cells.index(place);
        let mut best = (sign * self.values[cell as usize], None);
        for axis in 0..3 {
            let step = [
                1,
                self.cells.dims[0],
                self.cells.dims[0] * self.cells.dims[1],
            ][axis];
            for (other, holder) in [(index + step, index), (index - step, index - step)] {
                let (other, holder) = (self.cells.at[other], self.cells.at[holder]);
                if other == NONE || holder == NONE || self.cells.open[holder as usize][axis] == 0.0
                {
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

/// Values of the cells with a name, NaN for the others.
fn solved(
    cells: &Cells,
    name: &[u32],
    links: &[(u32, u32, usize)],
    contacts: &[Vec<f64>; 2],
) -> Result<Vec<f64>, FactorError> {
    let count = name.iter().filter(|n| **n != NONE).count();
    let pairs: Vec<[u32; 2]> = links
        .iter()
        .map(|&(a, b, _)| [name[a as usize], name[b as usize]])
        .collect();
    let mut factor = Factor::<1>::new(count, &pairs)?;
    for (&(a, _, axis), &[i, j]) in links.iter().zip(&pairs) {
        let conductance = cells.open[a as usize][axis];
        factor.add(i.max(j), i.min(j), &[[-conductance]]);
        factor.add_diagonal(i, conductance);
        factor.add_diagonal(j, conductance);
    }
    let mut values = vec![0.0; count];
    for (c, &n) in name.iter().enumerate().filter(|(_, n)| **n != NONE) {
        factor.add_diagonal(n, contacts[0][c] + contacts[1][c]);
        values[n as usize] = contacts[1][c];
    }
    factor.factorise()?;
    factor.solve(&mut values, 1);
    Ok(name
        .iter()
        .map(|&n| {
            if n == NONE {
                f64::NAN
            } else {
                values[n as usize]
            }
        })
        .collect())
}

/// Effect of walls on the flow in each cell.
fn leads(
    cells: &Cells,
    by_area: &[Vec<bool>; 2],
    solid: &Solid<'_>,
    areas: &[SurfaceTree; 2],
) -> Vec<Option<Lead>> {
    let lead = |c: usize| -> Option<Lead> {
        let place = cells.places[c].map(|k| k as usize);
        let index = cells.index(place);
        let middle = cells.middle(place);
        // A wall farther away than a cell has no effect.
        let wall = solid.wall(&middle, cells.wall_within(index)?)?;
        let inside = cells.middle_inside[c];
        let inwards = if inside { wall.away } else { -wall.away };
        let depth = if inside {
            wall.distance
        } else {
            -wall.distance
        } / cells.side;
        // 0 where an area is the nearest part of the surface, 1 where both areas are twice as far.
        let to = |k: usize| {
            by_area[k][index]
                .then(|| areas[k].closest(&middle, 2.0 * wall.distance))
                .flatten()
        };
        let nearest = (0..2)
            .filter_map(to)
            .map(|found| found.distance)
            .fold(2.0 * wall.distance, f64::min);
        let is_wall = if wall.distance > 0.0 {
            (nearest / wall.distance - 1.0).clamp(0.0, 1.0)
        } else {
            1.0
        };
        let turned = is_wall * (1.0 - depth).clamp(0.0, 1.0);
        Some(Lead {
            inwards,
            turned,
            push: PUSH * is_wall * (PUSH_FROM - depth).clamp(0.0, 1.0),
        })
    };
    (0..cells.count()).into_par_iter().map(lead).collect()
}

/// Conductance of each cell's part of each area, relative to that of a face.
fn contacts(
    cells: &Cells,
    muscle: &TriangleMesh,
    attachment: &Attachment,
    flux: Flux,
) -> [Vec<f64>; 2] {
    let areas = [&attachment.origin, &attachment.insertion];
    let middles = areas.map(|area| {
        let sum: Vector3<f64> = area
            .vertices
            .iter()
            .map(|&v| muscle.vertices[v as usize].coords)
            .sum();
        Point3::from(sum / area.vertices.len().max(1) as f64)
    });
    let inside: f64 = cells.shares.iter().sum();
    let section = inside / ((middles[1] - middles[0]).norm() / cells.side);
    // Conductance of a bar of the same volume and length, in faces over cells.
    let through = inside * (cells.side / muscle.length()).powi(2);
    [0, 1].map(|end: usize| {
        let mut contact = contact(cells, muscle, areas[end]);
        let power = match flux {
            Flux::Even => 0.0,
            Flux::Crowded(more) => contact.iter().sum::<f64>() / section + more,
        };
        let distance = |c: usize| {
            (cells.middle(cells.places[c].map(|k| k as usize)) - middles[1 - end]).norm()
        };
        let in_contact = |c: &usize| contact[*c] > 0.0;
        let farthest = (0..cells.count())
            .filter(in_contact)
            .map(distance)
            .fold(0.0, f64::max);
        for (c, contact) in contact
            .iter_mut()
            .enumerate()
            .filter(|(_, contact)| **contact > 0.0)
        {
            let share = if farthest > 0.0 {
                distance(c) / farthest
            } else {
                1.0
            };
            *contact *= libm::pow(share, power).max(LEAST_CONTACT);
        }
        let whole: f64 = contact.iter().sum();
        contact
            .iter_mut()
            .for_each(|c| *c *= PASSAGE * through / whole);
        contact
    })
}

/// The area in each cell, in faces.
fn contact(cells: &Cells, muscle: &TriangleMesh, area: &Area) -> Vec<f64> {
    let mut contact = vec![0.0; cells.count()];
    for (corners, sides) in area.pieces(muscle) {
        let samples = over_triangle(&corners, 0.5 * cells.side);
        let [a, b, c] = corners;
        let each = 0.5 * sides * (b - a).cross(&(c - a)).norm()
            / samples.len() as f64
            / (cells.side * cells.side);
        for p in &samples {
            let cell = cells.at[cells.holding(p)];
            if cell != NONE {
                contact[cell as usize] += each;
            }
        }
    }
    contact
}

/// True for each cell in a component that touches both areas.
fn joined(cells: &Cells, links: &[(u32, u32, usize)], contacts: &[Vec<f64>; 2]) -> Vec<bool> {
    let mut sets = UnionFind::new(cells.count());
    for &(a, b, _) in links {
        sets.join(a, b);
    }
    let roots: Vec<usize> = (0..cells.count() as u32)
        .map(|c| sets.root(c) as usize)
        .collect();
    let mut touches = vec![[false; 2]; cells.count()];
    for (c, &r) in roots.iter().enumerate() {
        (0..2)
            .filter(|&k| contacts[k][c] > 0.0)
            .for_each(|k| touches[r][k] = true);
    }
    roots.iter().map(|&r| touches[r] == [true; 2]).collect()
}
