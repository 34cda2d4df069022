//! Pictures of a morph: intermediate shapes, and both images on the sphere.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::{Morph, Shape};
use crate::report::output::Picture;
use pliant::mesh::measures::{Aabb, max_or_nan};
use pliant::morph::{area_shares, axes};
use pliant_render::{
    Camera, Canvas, ColourMap, Drawing, Frame, Legend, Lines, PictureError, Rgb, Surface,
    TextStyle, View, render, to_gif,
};

/// Width and height of a picture of the film, of the sheet, and of a sphere \[px\].
const FILM: (u32, u32) = (440, 440);
const SHEET: (u32, u32) = (300, 420);
const SPHERE: (u32, u32) = (330, 350);
/// Number of shapes on the sheet.
const SHOWN: usize = 5;
/// Pictures per second.
const RATE: f64 = 12.0;
/// Surfaces with more triangles are drawn without their edges, which would cover everything.
const FEW: usize = 6000;
/// Greatest side of a part of a triangle on the sphere.
const PIECE: f64 = 0.08;
const EDGE: Rgb = [0.25, 0.25, 0.28];
const MARK: Rgb = [0.85, 0.1, 0.1];
/// Range of the colours of a sphere, in powers of ten.
const DECADES: f64 = 1.0;

/// All pictures, encoded.
pub(super) struct Drawn {
    pub(super) film: Vec<u8>,
    pub(super) sheet: Vec<u8>,
    pub(super) spheres: Vec<u8>,
}

impl Drawn {
    /// The pictures as files of a morph whose files are called `file`.
    pub(super) fn pictures(self, file: &str) -> Vec<Picture> {
        let sheet =
            "from A (t = 0) to B (t = 1), each about its own middle, coloured by how far places go";
        let spheres = "images on the sphere from two sides, coloured by the share of the area that each place has there \
                       over that on the surface";
        let all = [
            (format!("{file}.gif"), "over t", self.film, false),
            ("sheet.png".to_owned(), sheet, self.sheet, true),
            ("spheres.png".to_owned(), spheres, self.spheres, true),
        ];
        let picture = |(file, caption, bytes, wide): (String, &str, Vec<u8>, bool)| Picture {
            file,
            caption: caption.to_owned(),
            bytes,
            wide,
        };
        all.into_iter().map(picture).collect()
    }

    pub(super) fn new(morph: &Morph<'_>, unit: &str) -> Result<Self, PictureError> {
        let shapes: Vec<Shape> = morph.shapes.iter().map(centred).collect();
        let distances = match (shapes.first(), shapes.last()) {
            (Some(a), Some(b)) => a
                .places
                .iter()
                .zip(&b.places)
                .map(|(a, b)| (b - a).norm())
                .collect(),
            _ => Vec::new(),
        };
        let range = (0.0, max_or_nan(distances.iter().copied()));
        let legend = Legend::new(
            "Distance",
            if morph.unit.is_some() { unit } else { "" },
            range,
            ColourMap::Viridis,
        );
        let paint = |shape: &Shape, (width, height): (u32, u32), legend: Option<&Legend>| {
            let room = legend.map_or(0.0, Legend::width);
            let camera = camera(
                morph,
                &shapes,
                Canvas::new(width + room as u32, height)
                    .with_right(room)
                    .with_top(26.0),
            );
            let surface = Surface::field(
                &shape.places,
                &morph.between.triangles,
                &distances,
                range,
                ColourMap::Viridis,
            );
            let mut frame = render(&Drawing::of([surface]), &camera);
            if let Some(legend) = legend {
                legend.draw(&mut frame);
            }
            frame.title(&format!("t = {:.2}", shape.t), TextStyle::Small);
            frame
        };
        let film: Vec<Frame> = shapes
            .par_iter()
            .map(|s| paint(s, FILM, Some(&legend)))
            .collect();
        // Forwards and backwards.
        let back = film
            .iter()
            .rev()
            .skip(1)
            .take(film.len().saturating_sub(2))
            .cloned();
        let film: Vec<Frame> = film.iter().cloned().chain(back).collect();
        let last = shapes.len().saturating_sub(1);
        let shown: Vec<usize> = (0..SHOWN).map(|k| k * last / (SHOWN - 1)).collect();
        let each = shown
            .par_iter()
            .map(|&k| paint(&shapes[k], SHEET, (k == last).then_some(&legend)));
        let sheet = Frame::beside(&each.collect::<Vec<Frame>>(), 4, [1.0; 3]);
        Ok(Self {
            film: to_gif(&film, 1.0 / RATE)?,
            sheet: sheet.to_png()?,
            spheres: spheres(morph).to_png()?,
        })
    }
}

/// A shape relative to the centre of its box: distant bodies appear as large as others.
fn centred(shape: &Shape) -> Shape {
    let middle = Aabb::of_points(&shape.places).center();
    Shape {
        t: shape.t,
        places: shape
            .places
            .iter()
            .map(|p| Point3::from(p - middle))
            .collect(),
    }
}

/// A camera for all shapes, with the longest axis upright, at the broad side.
fn camera(morph: &Morph<'_>, shapes: &[Shape], canvas: Canvas) -> Camera {
    let frame = axes(morph.meshes[0]);
    let [long, across] = [0, 2].map(|k| frame.column(k).into_owned());
    // Neither upside down nor from below.
    let up = if long.y < 0.0 { -long } else { long };
    let from = if across.z < 0.0 { -across } else { across };
    let all = shapes.iter().flat_map(|s| s.places.iter().copied());
    Camera::fit(all, &View::orthographic(from, up), canvas)
}

fn spheres(morph: &Morph<'_>) -> Frame {
    let range = (-DECADES, DECADES);
    let legend = Legend::new("Area, log10", "", range, ColourMap::Diverging);
    let mut all = Vec::new();
    for side in 0..2 {
        let (map, mesh) = (&morph.between.maps[side], morph.meshes[side]);
        let values = at_vertices(
            mesh.vertices.len(),
            map.triangles(),
            &area_shares(&mesh.vertices, map.points(), map.triangles()),
        );
        let edges = if map.triangles().len() <= FEW {
            outlines(map.points(), map.triangles())
        } else {
            Vec::new()
        };
        let (points, triangles, values) = rounded(map.points(), map.triangles(), &values);
        let marks: Vec<Vec<Point3<f64>>> = morph
            .pairs
            .iter()
            .map(|pair| ring(&map.points()[pair[side] as usize]))
            .collect();
        for (name, from) in [("front", Vector3::z()), ("back", -Vector3::z())] {
            let last = side == 1 && name == "back";
            let room = if last { legend.width() } else { 0.0 };
            let canvas = Canvas::new(SPHERE.0 + room as u32, SPHERE.1)
                .with_right(room)
                .with_top(26.0);
            let corners = [-1.0, 1.0]
                .into_iter()
                .flat_map(|x| [-1.0, 1.0].map(|y| Point3::new(x, y, 0.0)));
            let camera = Camera::fit(corners, &View::orthographic(from, Vector3::y()), canvas);
            let surface = Surface::field(&points, &triangles, &values, range, ColourMap::Diverging);
            let mut thin = Lines::new(&edges, EDGE);
            thin.width = 0.6;
            let mut thick = Lines::new(&marks, MARK);
            thick.width = 2.5;
            let mut frame = render(
                &Drawing::of([surface]).with_lines(thin).with_lines(thick),
                &camera,
            );
            if last {
                legend.draw(&mut frame);
            }
            frame.title(&format!("{} {name}", ["A", "B"][side]), TextStyle::Small);
            all.push(frame);
        }
    }
    Frame::beside(&all, 4, [1.0; 3])
}

/// Mean of the logarithms of the triangles at each vertex.
fn at_vertices(count: usize, triangles: &[[u32; 3]], shares: &[f64]) -> Vec<f64> {
    let (mut sums, mut numbers) = (vec![0.0; count], vec![0.0; count]);
    for (t, share) in triangles.iter().zip(shares) {
        let value = libm::log10(*share);
        if value.is_finite() {
            t.iter().for_each(|&v| {
                sums[v as usize] += value;
                numbers[v as usize] += 1.0;
            });
        }
    }
    sums.iter().zip(&numbers).map(|(s, n)| s / n).collect()
}

fn outlines(points: &[Point3<f64>], triangles: &[[u32; 3]]) -> Vec<Vec<Point3<f64>>> {
    let edges = triangles
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .filter(|[a, b]| a < b);
    edges
        .map(|[a, b]| arc(&points[a as usize], &points[b as usize]))
        .collect()
}

/// Number of parts of a side so that it looks round.
fn pieces(sides: &[f64]) -> usize {
    (max_or_nan(sides.iter().copied()) / PIECE)
        .ceil()
        .clamp(1.0, 32.0) as usize
}

/// The arc on the sphere.
fn arc(a: &Point3<f64>, b: &Point3<f64>) -> Vec<Point3<f64>> {
    let count = pieces(&[(b - a).norm()]);
    (0..=count)
        .map(|k| Point3::from((a + (b - a) * (k as f64 / count as f64)).coords.normalize()))
        .collect()
}

/// Spherical triangles, divided into small ones.
fn rounded(
    points: &[Point3<f64>],
    triangles: &[[u32; 3]],
    values: &[f64],
) -> (Vec<Point3<f64>>, Vec<[u32; 3]>, Vec<f64>) {
    let (mut x, mut cut, mut fields) = (points.to_vec(), Vec::new(), values.to_vec());
    for &corners in triangles {
        let [a, b, c] = corners.map(|v| points[v as usize]);
        let n = pieces(&[(b - a).norm(), (c - b).norm(), (a - c).norm()]);
        if n == 1 {
            cut.push(corners);
            continue;
        }
        let [va, vb, vc] = corners.map(|v| values[v as usize]);
        let first = x.len() as u32;
        // Rows from a to the side b, c: row i has i + 1 points.
        for i in 0..=n {
            for j in 0..=i {
                let (s, t) = ((i - j) as f64 / n as f64, j as f64 / n as f64);
                x.push(Point3::from(
                    (a + (b - a) * s + (c - a) * t).coords.normalize(),
                ));
                fields.push(va + (vb - va) * s + (vc - va) * t);
            }
        }
        let at = |i: usize, j: usize| first + (i * (i + 1) / 2 + j) as u32;
        for i in 0..n {
            for j in 0..=i {
                cut.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                if j < i {
                    cut.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
                }
            }
        }
    }
    (x, cut, fields)
}

/// A small circle around a point of the unit sphere.
fn ring(about: &Point3<f64>) -> Vec<Point3<f64>> {
    let aside = Vector3::ith(about.coords.iamin(), 1.0);
    let u = about.coords.cross(&aside).normalize();
    let v = about.coords.cross(&u);
    let at = |k: usize| {
        let angle = std::f64::consts::TAU * k as f64 / 16.0;
        about.coords + (u * libm::cos(angle) + v * libm::sin(angle)) * 0.05
    };
    (0..=16).map(|k| Point3::from(at(k) * 1.004)).collect()
}
