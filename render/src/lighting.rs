//! Vertex normals and Lambert light.

use nalgebra::{Point3, Vector3};

use super::camera::Camera;

/// A unit vector along `v`; `None` for zero and for components that are not finite. Accurate from
/// 1e-300 to 1e300, where the squares of a plain norm would underflow or overflow.
pub(super) fn unit(v: Vector3<f64>) -> Option<Vector3<f64>> {
    let largest = v.amax();
    if !(largest.is_finite() && largest > 0.0) || v.iter().any(|c| c.is_nan()) {
        return None;
    }
    let scaled = v / largest;
    Some(scaled / scaled.norm())
}

/// Vertex normals: the unit normals of the triangles around a vertex, weighted by their angles
/// there, so that they do not depend on the triangulation of a flat surface. Counter-clockwise
/// triangles face the viewer. Zero where no normal is defined. Triangles with a missing vertex are
/// left out.
pub fn vertex_normals(positions: &[Point3<f64>], triangles: &[[u32; 3]]) -> Vec<Vector3<f64>> {
    let mut normals = vec![Vector3::zeros(); positions.len()];
    for &triangle in triangles {
        let [Some(a), Some(b), Some(c)] = triangle.map(|i| positions.get(i as usize)) else {
            continue;
        };
        let (Some(ab), Some(bc), Some(ca)) = (unit(b - a), unit(c - b), unit(a - c)) else {
            continue;
        };
        let Some(normal) = unit(ab.cross(&-ca)) else {
            continue;
        };
        let angles = [
            corner_angle(&ab, &-ca),
            corner_angle(&bc, &-ab),
            corner_angle(&ca, &-bc),
        ];
        for (vertex, angle) in triangle.into_iter().zip(angles) {
            normals[vertex as usize] += normal * angle;
        }
    }
    for normal in &mut normals {
        *normal = unit(*normal).unwrap_or_else(Vector3::zeros);
    }
    normals
}

/// The angle between unit vectors \[rad\].
fn corner_angle(u: &Vector3<f64>, v: &Vector3<f64>) -> f64 {
    libm::atan2(u.cross(v).norm(), u.dot(v))
}

/// A light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Light {
    /// A distant light with a constant unit direction from the scene to the light.
    Distant(Vector3<f64>),
    /// A light at a point \[m\].
    At(Point3<f64>),
}

impl Light {
    /// Lambert's law: the cosine between the unit normal and the direction to the light; 0 where
    /// the light is behind the surface.
    pub fn cosine(&self, point: &Point3<f64>, normal: &Vector3<f64>) -> f64 {
        let direction = match self {
            Self::Distant(direction) => Some(*direction),
            Self::At(place) => unit(place - point),
        };
        // `max` maps NaN to 0.
        direction.map_or(0.0, |d| normal.dot(&d)).max(0.0)
    }
}

/// The lights of a picture: brightness = ambient + sum of strength times cosine.
#[derive(Clone, Debug, PartialEq)]
pub struct Lighting {
    /// Brightness without any light.
    pub ambient: f64,
    /// Lights and their strengths.
    pub lights: Vec<(Light, f64)>,
}

impl Lighting {
    /// A light at the viewer, one from the upper left for the shape, and a weak one from the right
    /// for the shadows.
    pub fn studio(camera: &Camera) -> Self {
        let head = camera.towards_viewer();
        let [right, up] = camera.right_and_up();
        let from = |sideways: f64, upwards: f64| {
            unit(head + right * sideways + up * upwards)
                .map_or(Light::Distant(head), Light::Distant)
        };
        let lights = vec![
            (Light::Distant(head), 0.32),
            (from(-0.9, 1.1), 0.42),
            (from(1.6, -0.2), 0.12),
        ];
        Self {
            ambient: 0.3,
            lights,
        }
    }

    /// The brightness of the front of a surface point with this unit normal.
    pub fn brightness(&self, point: &Point3<f64>, normal: &Vector3<f64>) -> f64 {
        self.ambient
            + self
                .lights
                .iter()
                .map(|(light, strength)| strength * light.cosine(point, normal))
                .sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn unit_at_every_size() {
        for size in [f64::MIN_POSITIVE / 1e10, 1e-200, 1.0, 1e200, f64::MAX] {
            let v = unit(Vector3::new(size, 0.0, -size)).expect("finite and not zero");
            assert_relative_eq!(
                v,
                Vector3::new(0.5f64.sqrt(), 0.0, -(0.5f64.sqrt())),
                epsilon = 1e-12
            );
        }
        assert_eq!(unit(Vector3::zeros()), None);
        assert_eq!(unit(Vector3::new(1.0, f64::NAN, 0.0)), None);
        assert_eq!(unit(Vector3::new(1.0, f64::NEG_INFINITY, 0.0)), None);
    }

    /// A cube corner has the same normal for any triangulation of its faces.
    #[test]
    fn normals_do_not_depend_on_the_triangulation() {
        let cube: Vec<Point3<f64>> = (0..8)
            .map(|i| {
                Point3::new(
                    f64::from(i & 1),
                    f64::from(i >> 1 & 1),
                    f64::from(i >> 2 & 1),
                )
            })
            .collect();
        let quads = [
            [0, 2, 3, 1],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 4, 6, 2],
            [1, 3, 7, 5],
        ]
        .map(|q| q.map(|i| i as u32));
        for cut in 0..64 {
            let triangles: Vec<[u32; 3]> = quads
                .iter()
                .enumerate()
                .flat_map(|(i, &[a, b, c, d])| {
                    if cut >> i & 1 == 0 {
                        [[a, b, c], [a, c, d]]
                    } else {
                        [[b, c, d], [b, d, a]]
                    }
                })
                .collect();
            for (p, n) in cube.iter().zip(vertex_normals(&cube, &triangles)) {
                let expected = p.coords.map(|c| (2.0 * c - 1.0) / 3f64.sqrt());
                assert_relative_eq!(n, expected, epsilon = 1e-14);
            }
        }
    }

    /// Erratum G12: the printed form sorted points and normals, then paired the sorted normals with the unsorted
    /// points, and got 0.447 where 1 is right, and 1 where 0.408 is right.
    #[test]
    fn g12_light_pairs_each_normal_with_its_own_point() {
        let light = Light::At(Point3::new(0.0, 0.0, 5.0));
        let normal = Vector3::z();
        let vertices = [(0.0, 10.0, 0.447), (0.0, 0.0, 1.0), (10.0, 5.0, 0.408)];
        for (x, y, expected) in vertices {
            assert_relative_eq!(
                light.cosine(&Point3::new(x, y, 0.0), &normal),
                expected,
                epsilon = 5e-4
            );
        }
    }

    #[test]
    fn light_from_behind_is_dark_not_negative() {
        let light = Light::Distant(Vector3::z());
        assert_eq!(light.cosine(&Point3::origin(), &-Vector3::z()), 0.0);
        assert_eq!(
            Light::At(Point3::origin()).cosine(&Point3::origin(), &Vector3::z()),
            0.0
        );
        assert_eq!(
            light.cosine(&Point3::origin(), &Vector3::repeat(f64::NAN)),
            0.0
        );
    }
}
