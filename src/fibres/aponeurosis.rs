//! Aponeuroses: the tendon plates on which the fibres of pennate muscles begin and end.
//!
//! The origin's plate begins at the area of the origin and covers one face of the muscle, or runs
//! through its middle; that of the insertion covers the opposite face. Fibres lead from plate to
//! plate through the thickness, so they are much shorter than the muscle.

use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};

use super::attachment::{Area, Attachment, AttachmentError, MuscleEnd, from_patch, of_triangles};
use super::solid::{Closed, Solid};
use crate::mesh::TriangleMesh;
use crate::mesh::closest::SurfaceTree;
use crate::mesh::measures::median;

/// Least cosine between the outward normal of a triangle and the direction of its plate's face: 60
/// degrees.
const FACES: f64 = 0.5;
/// Below it the side of the plates follows from the axes.
const UNDECIDED: f64 = 1e-6;
/// Number of sections of the muscle along its line of action, for the middle of a central plate.
const SECTIONS: usize = 24;
/// Number of points of a central plate across a section.
const ACROSS: usize = 24;
/// A central plate ends at this share of the muscle's length below the surface.
const BELOW: f64 = 0.01;
/// Median distance from the surface, in lengths of the muscle, up to which a given plate lies on it.
const ON_SURFACE: f64 = 0.01;

impl Attachment {
    /// Adds the plates of a muscle with this architecture to both areas. Each covers the part
    /// `share` of the muscle's length, from its own end on. The origin's plate lies on the face
    /// that its area looks to, or with `central` in the middle, between two plates of the
    /// insertion.
    ///
    /// The length of the fibres is about (1 - share) times that of the muscle, over the cosine of
    /// their pennation.
    pub fn with_aponeuroses(&self, muscle: &TriangleMesh, share: f64, central: bool) -> Self {
        let frame = Frame::new(muscle, self);
        let share = if share >= 0.0 { share.min(1.0) } else { 0.0 };
        let mut origin = Vec::new();
        let mut insertion = Vec::new();
        for t in 0..muscle.triangles.len() {
            let corners = muscle.corners(t);
            let middle = (corners[0].coords + corners[1].coords + corners[2].coords) / 3.0;
            let along = frame.along(&Point3::from(middle));
            let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
            let Some(normal) = normal.try_normalize(0.0) else {
                continue;
            };
            let normal = normal * frame.outward;
            let face = if central {
                normal.dot(&frame.wide).abs()
            } else {
                -normal.dot(&frame.thin)
            };
            if !central && -face >= FACES && along <= share {
                origin.push(t as u32);
            }
            if face >= FACES && along >= 1.0 - share {
                insertion.push(t as u32);
            }
        }
        let mut made = self.clone();
        made.action = Some(frame.action);
        if central {
            let closed = Closed::new(muscle);
            made.origin.sheet = Some(frame.central(muscle, &closed.solid(), share));
        }
        made.origin.widen(muscle, origin, &self.insertion);
        made.insertion.widen(muscle, insertion, &made.origin);
        made.guides = frame.guides(muscle, &made);
        made
    }

    /// Share of the muscle's length that each plate covers, where fibres lead from plate to plate
    /// at this angle to the line of action [rad]: 1 - thickness / (length tan angle), with the mean
    /// thickness between the plates. Not above 0 for a muscle that is too thick for the angle.
    pub fn share_of_pennation(&self, muscle: &TriangleMesh, angle: f64, central: bool) -> f64 {
        let frame = Frame::new(muscle, self);
        let across = if central { frame.wide } else { frame.thin };
        let shadow = |t: usize| {
            let [a, b, c] = muscle.corners(t);
            0.25 * (b - a).cross(&(c - a)).dot(&across).abs()
        };
        let shadow: f64 = (0..muscle.triangles.len()).map(shadow).sum();
        let thickness = Closed::new(muscle).mesh.volume().abs() / shadow;
        // A plate in the middle has fibres on both of its sides.
        let between = if central { 0.5 * thickness } else { thickness };
        1.0 - between / (frame.length * libm::tan(angle))
    }

    /// How far the two areas look to opposite sides along the least extent of the muscle, 0 to 2.
    /// Near 0, as for areas at both tips, the side of the plates is an arbitrary one.
    pub fn looks_apart(&self, muscle: &TriangleMesh) -> f64 {
        Frame::new(muscle, self).apart
    }

    /// Adds given plates to the areas, each to the area that is nearer to its nearest point: as a
    /// part of the surface where they lie on it, and as sheets inside otherwise. Where plates of
    /// both ends meet on the surface, those of the origin have the triangles.
    ///
    /// # Errors
    /// A plate is empty or lies off the muscle.
    pub fn with_plates(
        &self,
        muscle: &TriangleMesh,
        plates: &[TriangleMesh],
    ) -> Result<Self, AttachmentError> {
        let frame = Frame::new(muscle, self);
        let tree = SurfaceTree::new(&muscle.vertices, &muscle.triangles);
        let closed = Closed::new(muscle);
        let solid = closed.solid();
        let areas = [self.origin.tree(muscle), self.insertion.tree(muscle)];
        let mut made = self.clone();
        made.action = Some(frame.action);
        let mut wide = [Vec::new(), Vec::new()];
        for plate in plates {
            // A component of a file has the vertices of all of them.
            let own: Vec<Point3<f64>> = (0..plate.triangles.len())
                .flat_map(|t| plate.corners(t))
                .collect();
            let far = areas.each_ref().map(|area| {
                let to = |p: &Point3<f64>| {
                    area.closest(p, f64::INFINITY)
                        .map_or(f64::INFINITY, |found| found.distance)
                };
                own.iter().map(to).fold(f64::INFINITY, f64::min)
            });
            let k = usize::from(far[1] < far[0]);
            let end = [MuscleEnd::Origin, MuscleEnd::Insertion][k];
            let off = own
                .iter()
                .filter_map(|p| tree.closest(p, f64::INFINITY).map(|found| found.distance));
            let off = median(off.collect()).ok_or(AttachmentError::Empty { end })?;
            let inside = own.iter().filter(|p| solid.contains(p)).count();
            if off > ON_SURFACE * muscle.length() && 2 * inside > own.len() {
                let area = match end {
                    MuscleEnd::Origin => &mut made.origin,
                    MuscleEnd::Insertion => &mut made.insertion,
                };
                area.sheet = Some(match area.sheet.take() {
                    Some(mut both) => {
                        let first = both.vertices.len() as u32;
                        both.vertices.extend(&plate.vertices);
                        let moved = plate.triangles.iter().map(|t| t.map(|v| v + first));
                        both.triangles.extend(moved);
                        both
                    }
                    None => plate.clone(),
                });
            } else {
                wide[k].extend(from_patch(muscle, &tree, end, plate)?.triangles);
            }
        }
        let [origin, insertion] = wide;
        made.origin.widen(muscle, origin, &self.insertion);
        made.insertion.widen(muscle, insertion, &made.origin);
        made.guides = frame.guides(muscle, &made);
        Ok(made)
    }
}

impl Area {
    /// Adds triangles that share no vertex with another area.
    fn widen(&mut self, muscle: &TriangleMesh, more: Vec<u32>, other: &Area) {
        let free = |t: &u32| {
            let corners = &muscle.triangles[*t as usize];
            corners
                .iter()
                .all(|v| other.vertices.binary_search(v).is_err())
        };
        let mut triangles = self.triangles.clone();
        triangles.extend(more.into_iter().filter(free));
        let wide = of_triangles(muscle, triangles);
        let distance = |v: &u32| {
            self.vertices
                .binary_search(v)
                .map_or(0.0, |at| self.distances[at])
        };
        self.distances = wide.vertices.iter().map(distance).collect();
        self.triangles = wide.triangles;
        self.vertices = wide.vertices;
    }
}

/// Directions of a muscle between its areas.
struct Frame {
    /// Unit vector from the middle of the origin to that of the insertion.
    action: Vector3<f64>,
    /// Unit vectors across it: along the least and the greatest extent. The first points to the
    /// side to which the origin looks, and away from that of the insertion.
    thin: Vector3<f64>,
    wide: Vector3<f64>,
    /// Least coordinate along the line of action, and the length [m].
    from: f64,
    length: f64,
    /// -1 for a surface that is inside out.
    outward: f64,
    /// See [`Attachment::looks_apart`].
    apart: f64,
}

impl Frame {
    fn new(muscle: &TriangleMesh, attachment: &Attachment) -> Self {
        let outward = if muscle.volume() < 0.0 { -1.0 } else { 1.0 };
        let whole: Vec<u32> = (0..muscle.triangles.len() as u32).collect();
        let (middle, _) = middle_and_normal(muscle, &whole);
        let [(a, looks), (b, other)] = [&attachment.origin, &attachment.insertion]
            .map(|area| middle_and_normal(muscle, &area.triangles));
        let (looks, other) = (looks * outward, other * outward);
        let action = (b - a).try_normalize(0.0).unwrap_or_else(Vector3::x);
        let mut spread = Matrix3::zeros();
        for t in 0..muscle.triangles.len() {
            let corners = muscle.corners(t);
            let area = (corners[1] - corners[0])
                .cross(&(corners[2] - corners[0]))
                .norm();
            for p in corners {
                let off = p.coords - middle;
                let off = off - action * off.dot(&action);
                spread += off * off.transpose() * area;
            }
        }
        // Both are across the line of action: its own spread is made the greatest.
        let scale = spread.trace();
        let eigen = SymmetricEigen::new(spread + action * action.transpose() * (4.0 * scale));
        let mut order = [0, 1, 2];
        order.sort_by(|i, j| eigen.eigenvalues[*i].total_cmp(&eigen.eigenvalues[*j]));
        let thin: Vector3<f64> = eigen.eigenvectors.column(order[0]).into_owned();
        let side = (looks - other).dot(&thin);
        // Without a side, rounding must not decide.
        let positive = thin[thin.iamax()] > 0.0;
        let keeps = if side.abs() > UNDECIDED {
            side > 0.0
        } else {
            positive
        };
        let thin = if keeps { thin } else { -thin };
        let coordinates = muscle.vertices.iter().map(|p| p.coords.dot(&action));
        let (from, to) = coordinates.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), c| {
            (a.min(c), b.max(c))
        });
        Self {
            action,
            thin,
            wide: action.cross(&thin),
            from,
            length: to - from,
            outward,
            apart: side.abs(),
        }
    }

    /// Position along the line of action: 0 at one end of the muscle, 1 at the other.
    fn along(&self, p: &Point3<f64>) -> f64 {
        (p.coords.dot(&self.action) - self.from) / self.length
    }

    /// Segments from plate to plate, side by side; none where no plates lie opposite each other.
    /// There the harmonic field leads straight across, but fibres have about one direction in the
    /// whole muscle: that of the fibres between the ends of the plates.
    fn guides(&self, muscle: &TriangleMesh, attachment: &Attachment) -> Vec<Vec<Point3<f64>>> {
        let areas = [&attachment.origin, &attachment.insertion];
        let middle = |([a, b, c], _): ([Point3<f64>; 3], f64)| {
            Point3::from((a.coords + b.coords + c.coords) / 3.0)
        };
        let starts = areas.map(|area| area.pieces(muscle).map(middle).collect::<Vec<_>>());
        let last = starts[0].iter().map(|p| self.along(p));
        let first = starts[1].iter().map(|p| self.along(p));
        let last = last.fold(f64::NEG_INFINITY, f64::max);
        let first = first.fold(f64::INFINITY, f64::min);
        if !(first < last) {
            return Vec::new();
        }
        // Each plate covers this part of the length on the mean: fibres pass the rest.
        let share = 0.5 * (last + 1.0 - first);
        let onward = self.action * ((1.0 - share) * self.length);
        let trees = areas.map(|area| area.tree(muscle));
        let segment = |p: &Point3<f64>, to: &SurfaceTree, onward: Vector3<f64>| {
            to.closest(&(p + onward), f64::INFINITY)
                .map(|found| vec![*p, found.point])
        };
        let from_origin = starts[0]
            .iter()
            .filter_map(|p| segment(p, &trees[1], onward));
        let from_insertion = starts[1]
            .iter()
            .filter_map(|p| segment(p, &trees[0], -onward));
        from_origin.chain(from_insertion).collect()
    }

    /// A sheet through the middle of each section, across the wide side, over the first part of
    /// the length.
    fn central(&self, muscle: &TriangleMesh, solid: &Solid<'_>, share: f64) -> TriangleMesh {
        let mut sections =
            vec![(Vector3::zeros(), 0.0, [f64::INFINITY, f64::NEG_INFINITY]); SECTIONS];
        let areas = muscle.vertex_areas();
        for (p, area) in muscle.vertices.iter().zip(areas) {
            let k = (self.along(p) * SECTIONS as f64) as usize;
            let (sum, weight, [least, most]) = &mut sections[k.min(SECTIONS - 1)];
            *sum += p.coords * area;
            *weight += area;
            let across = p.coords.dot(&self.thin);
            *least = least.min(across);
            *most = most.max(across);
        }
        let mut vertices = Vec::new();
        let mut rows: Vec<Vec<Option<u32>>> = Vec::new();
        for (k, (sum, weight, [least, most])) in sections.iter().enumerate() {
            let along = (k as f64 + 0.5) / SECTIONS as f64;
            if along > share || !(*weight > 0.0) {
                continue;
            }
            let middle = sum / *weight;
            let middle =
                middle + self.action * (self.from + along * self.length - middle.dot(&self.action));
            let point = |i: usize| {
                let across = least + (most - least) * (i as f64 + 0.5) / ACROSS as f64;
                let p = Point3::from(middle + self.thin * (across - middle.dot(&self.thin)));
                let deep =
                    solid.contains_as_given(&p) && solid.wall(&p, BELOW * self.length).is_none();
                deep.then_some(p)
            };
            let row = (0..ACROSS).map(|i| {
                point(i).map(|p| {
                    vertices.push(p);
                    vertices.len() as u32 - 1
                })
            });
            rows.push(row.collect());
        }
        let mut triangles = Vec::new();
        for pair in rows.windows(2) {
            for i in 1..ACROSS {
                if let [Some(a), Some(b), Some(c), Some(d)] =
                    [pair[0][i - 1], pair[0][i], pair[1][i], pair[1][i - 1]]
                {
                    triangles.extend([[a, b, c], [a, c, d]]);
                }
            }
        }
        TriangleMesh {
            vertices,
            triangles,
        }
    }
}

/// Area-weighted middle and mean normal of some triangles.
fn middle_and_normal(muscle: &TriangleMesh, triangles: &[u32]) -> (Vector3<f64>, Vector3<f64>) {
    let (mut middle, mut normal, mut whole) = (Vector3::zeros(), Vector3::zeros(), 0.0);
    for &t in triangles {
        let [a, b, c] = muscle.corners(t as usize);
        let twice = (b - a).cross(&(c - a));
        let area = twice.norm();
        middle += (a.coords + b.coords + c.coords) * (area / 3.0);
        normal += twice;
        whole += area;
    }
    if whole > 0.0 {
        (middle / whole, normal / whole)
    } else {
        (middle, normal)
    }
}
