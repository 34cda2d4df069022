//! Spheres and axes that fit the surfaces of a joint.

use nalgebra::{
    DMatrix, DVector, Matrix2, Matrix3, Matrix4, Point3, Unit, Vector2, Vector3, Vector4,
};

use pliant::contact::Surface;
use pliant::mesh::TriangleMesh;
use pliant::mesh::measures::{max_or_nan, median};

/// A surface faces another one within their gap and this share of the length of its bone: cartilage
/// and the measurement of both lie between.
const FACING: f64 = 0.015;

/// Vertices belong to a sphere within this share of its radius.
const BAND: f64 = 0.05;

/// Cosine of the greatest angle between the normal of such a vertex and the radius.
const ALONG: f64 = 0.85;

/// Least number of vertices that a sphere or an axis rests on.
const FEWEST: usize = 30;

/// Rounds in which a surface grows from what faces the other bone.
const ROUNDS: usize = 30;

/// Greatest RMS misfit of a sphere, and greatest median misfit of a condyle, relative to the radius. The
/// measured femoral and humeral heads have 0.02 and 0.025, condyles 0.1.
const ROUND: f64 = 0.06;
const CURVED: f64 = 0.25;

/// A fitted joint.
#[derive(Clone, Debug)]
pub struct Fit {
    /// Centre [m].
    pub centre: Point3<f64>,
    /// The axis of a hinge and the side to which its roller stands out from the shaft; `None` for a ball.
    pub axis: Option<(Unit<Vector3<f64>>, Vector3<f64>)>,
    /// Radius of the sphere, or of both condyles [m].
    pub radius: Vec<f64>,
    /// RMS misfit of the sphere, or the greater median misfit of the condyles [m].
    pub misfit: f64,
    /// Number of vertices.
    pub count: usize,
}

/// The vertices of a mesh that face other surfaces.
fn facing(mesh: &TriangleMesh, others: &[&Surface], length: f64) -> Vec<usize> {
    let distance = |p: &Point3<f64>| {
        let each = others.iter().filter_map(|s| s.nearest(p, f64::MAX));
        each.map(|found| found.closest.distance.abs())
            .fold(f64::INFINITY, |least, d| if d < least { d } else { least })
    };
    let all: Vec<f64> = mesh.vertices.iter().map(distance).collect();
    let gap = all
        .iter()
        .copied()
        .fold(f64::INFINITY, |a, b| if b < a { b } else { a });
    let reach = gap + FACING * length;
    (0..all.len()).filter(|&v| all[v] <= reach).collect()
}

/// The long axis of points through their middle, and their length along it [m].
pub fn long_axis(points: &[Point3<f64>]) -> Option<(Point3<f64>, Unit<Vector3<f64>>, f64)> {
    let middle = mean(points.iter())?;
    let mut spread = Matrix3::zeros();
    for v in points {
        let d = v - middle;
        spread += d * d.transpose();
    }
    let eigen = spread.symmetric_eigen();
    let axis = Unit::try_new(
        eigen.eigenvectors.column(eigen.eigenvalues.imax()).into(),
        0.0,
    )?;
    let along = points.iter().map(|v| (v - middle).dot(&axis));
    let length = max_or_nan(along.clone()) + max_or_nan(along.map(|h| -h));
    (length > 0.0).then_some((middle, axis, length))
}

fn mean<'a>(points: impl Iterator<Item = &'a Point3<f64>>) -> Option<Point3<f64>> {
    let (mut sum, mut count) = (Vector3::zeros(), 0.0);
    for p in points {
        sum += p.coords;
        count += 1.0;
    }
    let all: Vector3<f64> = sum / count;
    all.iter().all(|c| c.is_finite()).then(|| all.into())
}

/// The sphere with the least squares of the distances of points from it: centre and radius [m]. `None`
/// for fewer than four points, or points in a plane.
pub fn sphere(points: &[Point3<f64>]) -> Option<(Point3<f64>, f64)> {
    if points.len() < 4 {
        return None;
    }
    let middle = mean(points.iter())?;
    let size = max_or_nan(points.iter().map(|p| (p - middle).norm()));
    // In units of the size: |p|^2 = 2 p.c + (r^2 - |c|^2) is linear.
    let scaled: Vec<Vector3<f64>> = points.iter().map(|p| (p - middle) / size).collect();
    let mut matrix = DMatrix::zeros(points.len(), 4);
    let mut right = DVector::zeros(points.len());
    for (k, p) in scaled.iter().enumerate() {
        matrix
            .row_mut(k)
            .copy_from_slice(&[2.0 * p.x, 2.0 * p.y, 2.0 * p.z, 1.0]);
        right[k] = p.norm_squared();
    }
    let svd = matrix.svd(true, true);
    let flat = svd.singular_values.min() <= 1e-6 * svd.singular_values.max();
    let found = (!flat).then(|| svd.solve(&right, 0.0).ok()).flatten()?;
    let mut c = Vector3::new(found[0], found[1], found[2]);
    let mut r = (found[3] + c.norm_squared()).sqrt();
    for _ in 0..ROUNDS {
        let (mut normal, mut pull) = (Matrix4::zeros(), Vector4::zeros());
        for p in &scaled {
            let d = p - c;
            let away = d.norm();
            let slope = (-d / away).push(-1.0);
            normal += slope * slope.transpose();
            pull -= slope * (away - r);
        }
        let change = normal.cholesky()?.solve(&pull);
        c += change.xyz();
        r += change.w;
        if change.norm() <= 1e-12 {
            break;
        }
    }
    let sound = r.is_finite() && r > 0.0 && c.iter().all(|c| c.is_finite());
    sound.then(|| (middle + c * size, r * size))
}

/// The sphere of the head of a joint, which faces `sockets`.
pub fn ball(head: &TriangleMesh, sockets: &[&Surface]) -> Option<Fit> {
    let (_, _, length) = long_axis(&head.vertices)?;
    let normals = head.vertex_normals();
    let points = |chosen: &[usize]| -> Vec<Point3<f64>> {
        chosen.iter().map(|&v| head.vertices[v]).collect()
    };
    let mut chosen = facing(head, sockets, length);
    let (mut centre, mut radius) = sphere(&points(&chosen))?;
    for _ in 0..ROUNDS {
        let is_on = |&v: &usize| {
            let d = head.vertices[v] - centre;
            let away = d.norm();
            (away - radius).abs() <= BAND * radius && d.dot(&normals[v]) >= ALONG * away
        };
        let next: Vec<usize> = (0..head.vertices.len()).filter(is_on).collect();
        if next == chosen {
            break;
        }
        chosen = next;
        (centre, radius) = sphere(&points(&chosen))?;
    }
    let squares: f64 = points(&chosen)
        .iter()
        .map(|p| ((p - centre).norm() - radius).powi(2))
        .sum();
    let misfit = (squares / chosen.len() as f64).sqrt();
    let fits = chosen.len() >= FEWEST && misfit <= ROUND * radius && radius <= 0.5 * length;
    fits.then(|| Fit {
        centre,
        axis: None,
        radius: vec![radius],
        misfit,
        count: chosen.len(),
    })
}

/// Greatest part of a normal along the axis of a condyle.
const ACROSS: f64 = 0.45;

/// The roller of a hinge takes part up to this share of the width of what faces the other bone, along and
/// beside the axis.
const SLAB: [f64; 2] = [0.15, 0.6];

/// Half of the angle of a condyle, seen along the axis.
const HALF: f64 = 50.0 * RADIAN;
const RADIAN: f64 = std::f64::consts::PI / 180.0;

/// Half of the part of a bone that is the middle of its shaft.
const SHAFT: f64 = 0.15;

/// Greatest ratio of the radii of two condyles.
const UNLIKE: f64 = 2.5;

/// Rounds in which an axis is found from condyles that are found along it.
const TURNS: usize = 4;

/// The axis of a hinge: the line through the centres of the two halves, the condyles, of its roller, which
/// faces `others`. `shaft` points from the joint into the bone with the shaft. The middle of the condyles is
/// at the angle `from_below` [rad] from the end of the shaft to the side to which the roller stands out. The
/// centre of a condyle is where the normals of its surface meet, seen along the axis.
pub fn hinge(
    roller: &TriangleMesh,
    others: &[&Surface],
    shaft: &Unit<Vector3<f64>>,
    from_below: f64,
) -> Option<Fit> {
    let (centroid, _, length) = long_axis(&roller.vertices)?;
    let near = |v: &&Point3<f64>| (*v - centroid).dot(shaft).abs() <= SHAFT * length;
    let of_shaft = mean(roller.vertices.iter().filter(near)).unwrap_or(centroid);
    let faces = facing(roller, others, length);
    let middle = mean(faces.iter().map(|&v| &roller.vertices[v]))?;
    let faces: Vec<Vector3<f64>> = faces.iter().map(|&v| roller.vertices[v] - middle).collect();
    let roller = Roller {
        out: roller.vertices.iter().map(|x| x - middle).collect(),
        normals: roller.vertex_normals(),
        shaft: *shaft,
        of_shaft: of_shaft - middle,
        from_below,
    };
    let mut axis = widest(faces.iter().copied(), shaft)?;
    let mut found = None;
    for _ in 0..TURNS {
        let view = roller.along(axis, &faces)?;
        let [first, second] = [roller.condyle(&view, false)?, roller.condyle(&view, true)?];
        axis = Unit::try_new(second.centre - first.centre, 0.0)?;
        found = Some((first, second, view.across));
    }
    let (first, second, across) = found?;
    let alike = first.radius <= UNLIKE * second.radius && second.radius <= UNLIKE * first.radius;
    (first.fits() && second.fits() && alike).then(|| Fit {
        centre: middle + first.centre - axis.scale(first.centre.dot(&axis)),
        axis: Some((axis, across)),
        radius: vec![first.radius, second.radius],
        misfit: max_or_nan([first.misfit, second.misfit]),
        count: first.count + second.count,
    })
}

/// The bone of a hinge with its condyles, seen from the middle of what faces the other bone.
struct Roller {
    /// The vertices, and a point in the middle of the shaft, from there [m].
    out: Vec<Vector3<f64>>,
    of_shaft: Vector3<f64>,
    normals: Vec<Vector3<f64>>,
    shaft: Unit<Vector3<f64>>,
    from_below: f64,
}

/// The directions of a roller along an axis.
struct View {
    axis: Unit<Vector3<f64>>,
    up: Unit<Vector3<f64>>,
    /// To the side to which the roller stands out.
    across: Vector3<f64>,
    /// Range along the axis of what faces the other bone [m].
    range: [f64; 2],
}

impl View {
    fn width(&self) -> f64 {
        self.range[1] - self.range[0]
    }

    /// A vector seen along the axis.
    fn seen(&self, d: &Vector3<f64>) -> Vector2<f64> {
        Vector2::new(d.dot(&self.across), d.dot(&self.up))
    }
}

/// A half of a roller.
struct Condyle {
    centre: Vector3<f64>,
    radius: f64,
    misfit: f64,
    count: usize,
}

impl Condyle {
    fn fits(&self) -> bool {
        self.count >= FEWEST && self.misfit <= CURVED * self.radius
    }
}

impl Roller {
    /// The directions along an axis; `faces` is what faces the other bone.
    fn along(&self, axis: Unit<Vector3<f64>>, faces: &[Vector3<f64>]) -> Option<View> {
        let heights = faces.iter().map(|d| d.dot(&axis));
        let range = [
            -max_or_nan(heights.clone().map(|h| -h)),
            max_or_nan(heights),
        ];
        let up = self.shaft.into_inner() - axis.scale(self.shaft.dot(&axis));
        let up = Unit::try_new(up, 0.0)?;
        let across = axis.cross(&up);
        let mut view = View {
            axis,
            up,
            across,
            range,
        };
        let at_end = |d: &&Vector3<f64>| d.dot(&up).abs() <= SLAB[1] * view.width();
        let end = self.out.iter().filter(at_end);
        let out = end.map(|d| (d - self.of_shaft).dot(&across));
        if max_or_nan(out.clone().map(|d| -d)) > max_or_nan(out) {
            view.across = -across;
        }
        Some(view)
    }

    /// Whether a vertex is on a condyle.
    fn is_of_condyle(&self, view: &View, v: usize) -> bool {
        let (d, n) = (&self.out[v], &self.normals[v]);
        let [low, high] = view.range;
        let beside = SLAB[0] * view.width();
        let out = view.seen(n);
        let off = libm::atan2(out.x, -out.y) - self.from_below;
        (low - beside..=high + beside).contains(&d.dot(&view.axis))
            && d.dot(&view.up).abs() <= SLAB[1] * view.width()
            && n.dot(&view.axis).abs() <= ACROSS
            && libm::cos(off) >= libm::cos(HALF)
    }

    /// The first or the second condyle along the axis.
    fn condyle(&self, view: &View, second: bool) -> Option<Condyle> {
        let half = 0.5 * (view.range[0] + view.range[1]);
        let is_own = |v: &usize| (self.out[*v].dot(&view.axis) >= half) == second;
        let all = (0..self.out.len()).filter(|&v| self.is_of_condyle(view, v));
        let own: Vec<usize> = all.filter(is_own).collect();
        let line = |&v: &usize| {
            let normal = view.seen(&self.normals[v]).try_normalize(0.0)?;
            Some((view.seen(&self.out[v]), normal))
        };
        let lines: Vec<(Vector2<f64>, Vector2<f64>)> = own.iter().filter_map(line).collect();
        let (at, misfit) = meeting(&lines, 1e-3 * view.width())?;
        let radius = median(lines.iter().map(|(p, n)| (p - at).dot(n)).collect())?;
        let height = median(own.iter().map(|&v| self.out[v].dot(&view.axis)).collect())?;
        Some(Condyle {
            centre: view.across * at.x + view.up.scale(at.y) + view.axis.scale(height),
            radius,
            misfit,
            count: own.len(),
        })
    }
}

/// The direction in which vectors spread most, square to `shaft`.
pub fn widest(
    all: impl Iterator<Item = Vector3<f64>>,
    shaft: &Unit<Vector3<f64>>,
) -> Option<Unit<Vector3<f64>>> {
    let mut spread = Matrix3::zeros();
    for d in all {
        let d = d - shaft.scale(d.dot(shaft));
        spread += d * d.transpose();
    }
    let eigen = spread.symmetric_eigen();
    let widest: Vector3<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into();
    Unit::try_new(widest, 0.0)
}

/// The point with the least sum of distances from lines in a plane, each of a point and a direction of
/// length one, and the median of these distances. Squares are weighed anew by the inverse distances;
/// `least` [m] bounds the weights.
fn meeting(lines: &[(Vector2<f64>, Vector2<f64>)], least: f64) -> Option<(Vector2<f64>, f64)> {
    let square = |n: &Vector2<f64>| Matrix2::identity() - n * n.transpose();
    let mut weights = vec![1.0; lines.len()];
    let mut at = Vector2::zeros();
    for _ in 0..ROUNDS {
        let (mut matrix, mut right) = (Matrix2::zeros(), Vector2::zeros());
        for ((p, n), weight) in lines.iter().zip(&weights) {
            matrix += square(n) * *weight;
            right += square(n) * p * *weight;
        }
        at = matrix.cholesky()?.solve(&right);
        for ((p, n), weight) in lines.iter().zip(&mut weights) {
            *weight = 1.0 / ((square(n) * (p - at)).norm() + least);
        }
    }
    let away = lines.iter().map(|(p, n)| (square(n) * (p - at)).norm());
    Some((at, median(away.collect())?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Isometry3;
    use pliant::mesh::shapes::icosphere;
    use proptest::prelude::*;

    fn moved(mesh: &TriangleMesh, by: &Isometry3<f64>, scale: f64) -> TriangleMesh {
        TriangleMesh {
            vertices: mesh.vertices.iter().map(|v| by * (v * scale)).collect(),
            triangles: mesh.triangles.clone(),
        }
    }

    /// A ball at the end of a rod, as one point cloud with outward normals.
    fn head() -> TriangleMesh {
        let ball = icosphere(0.023, 3);
        let mut rod = icosphere(0.2, 3);
        for v in &mut rod.vertices {
            (v.x, v.y) = (0.06 * v.x + 0.03, 0.06 * v.y);
            v.z -= 0.2;
        }
        let first = ball.vertices.len() as u32;
        let mut all = ball;
        all.vertices.extend(rod.vertices);
        all.triangles
            .extend(rod.triangles.iter().map(|t| t.map(|v| v + first)));
        all
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn a_sphere_is_found_from_a_cap(
            c in prop::array::uniform3(-1.0..1.0_f64),
            r in 1e-3..1e3_f64,
            cap in -0.5..0.8_f64,
        ) {
            let c = Point3::from(Vector3::from(c) * r);
            let whole = icosphere(r, 3);
            let points: Vec<Point3<f64>> = whole.vertices.iter()
                .filter(|v| v.z >= cap * r)
                .map(|v| v + c.coords)
                .collect();
            let (centre, radius) = sphere(&points).expect("a sphere");
            // The points are exact but for rounding, which a small cap amplifies.
            prop_assert!((centre - c).norm() <= 1e-9 * r && (radius - r).abs() <= 1e-9 * r);
            // Control: a cap with its points drawn out is no such sphere.
            let long: Vec<Point3<f64>> = points.iter().map(|p| p + Vector3::z() * (p.z - c.z)).collect();
            prop_assert!(sphere(&long).is_none_or(|(_, other)| (other - r).abs() > 1e-3 * r));
        }

        #[test]
        fn a_head_is_found_wherever_it_lies_and_in_every_unit(
            turn in prop::array::uniform3(-3.0..3.0_f64),
            shift in prop::array::uniform3(-1.0..1.0_f64),
            scale in prop::sample::select(vec![1e-3, 1.0, 1e3]),
        ) {
            let by = Isometry3::new(Vector3::from(shift) * scale, Vector3::from(turn));
            // A socket over one side of the head.
            let mut socket = icosphere(0.025, 3);
            socket.triangles.retain(|t| t.iter().all(|&v| socket.vertices[v as usize].x < -0.01));
            let fit = ball(&moved(&head(), &by, scale), &[&Surface::new(&moved(&socket, &by, scale))]);
            let fit = fit.expect("a head");
            // The faces of the icosphere lie on its sphere only at their corners.
            let centre = by * Point3::origin();
            prop_assert!((fit.centre - centre).norm() <= 1e-4 * scale, "{fit:?}");
            prop_assert!((fit.radius[0] - 0.023 * scale).abs() <= 1e-4 * scale);
        }
    }

    #[test]
    fn points_in_a_plane_have_no_sphere() {
        let points: Vec<Point3<f64>> = (0..20)
            .map(|k| Point3::new(f64::from(k), f64::from(k * k % 7), 2.0))
            .collect();
        assert_eq!(sphere(&points), None);
        assert_eq!(sphere(&points[..3]), None);
    }

    /// Two condyles below a shaft along z: tubes about x with half circles, behind the shaft.
    fn condyles() -> TriangleMesh {
        let mut mesh = TriangleMesh::default();
        let mut strip = |from: f64, to: f64, r: f64| {
            let (rows, columns) = (24_u32, 8_u32);
            let first = mesh.vertices.len() as u32;
            for row in 0..=rows {
                let angle = -0.4 + 3.6 * f64::from(row) / f64::from(rows);
                for column in 0..=columns {
                    let x = from + (to - from) * f64::from(column) / f64::from(columns);
                    mesh.vertices.push(Point3::new(
                        x,
                        -0.012 - r * libm::cos(angle),
                        -r * libm::sin(angle),
                    ));
                }
            }
            for row in 0..rows {
                for column in 0..columns {
                    let a = first + row * (columns + 1) + column;
                    let (b, c, d) = (a + 1, a + columns + 1, a + columns + 2);
                    mesh.triangles.extend([[a, c, b], [b, c, d]]);
                }
            }
        };
        strip(-0.035, -0.01, 0.020);
        strip(0.01, 0.035, 0.020);
        let mut shaft = icosphere(0.2, 3);
        for v in &mut shaft.vertices {
            (v.x, v.y) = (0.07 * v.x, 0.07 * v.y);
            v.z += 0.21;
        }
        let first = mesh.vertices.len() as u32;
        mesh.vertices.extend(shaft.vertices);
        mesh.triangles
            .extend(shaft.triangles.iter().map(|t| t.map(|v| v + first)));
        mesh
    }

    #[test]
    fn the_axis_of_two_condyles_is_found() {
        let roller = condyles();
        let mut plate = pliant::mesh::shapes::box_surface([0.08, 0.05, 0.02], 0.005);
        plate.vertices.iter_mut().for_each(|v| v.z -= 0.033);
        let up = Unit::new_unchecked(Vector3::z());
        let turned = Isometry3::new(Vector3::new(0.3, 1.0, -0.2), Vector3::new(0.4, -1.0, 0.7));
        for (by, scale) in [(Isometry3::identity(), 1.0), (turned, 1e3)] {
            let fit = hinge(
                &moved(&roller, &by, scale),
                &[&Surface::new(&moved(&plate, &by, scale))],
                &(by * up),
                1.0,
            )
            .expect("an axis");
            let axis = by.inverse() * fit.axis.expect("a hinge").0;
            assert!(axis.x.abs() >= 0.999, "{axis:?}");
            let centre = by.inverse() * fit.centre / scale;
            let off = Vector2::new(centre.y + 0.012, centre.z).norm();
            assert!(off <= 5e-4, "{centre:?}");
            assert!(
                fit.radius.iter().all(|r| (r / scale - 0.020).abs() <= 5e-4),
                "{fit:?}"
            );
        }
        // Control: a plane has no axis.
        let flat = pliant::mesh::shapes::box_surface([0.08, 0.05, 0.2], 0.01);
        let below = Surface::new(&moved(&plate, &Isometry3::translation(0.0, 0.0, -0.1), 1.0));
        assert!(hinge(&flat, &[&below], &up, 1.0).is_none());
    }
}
