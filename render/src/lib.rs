//! The software renderer: pictures of meshes, fibres and fields, with no GPU and no window.
//!
//! A [`Drawing`] is what there is to see, a [`Camera`] where from, a [`Frame`] the picture. Opaque surfaces and lines
//! go through a depth buffer with four samples a pixel; translucent surfaces (bones) are laid over them, the nearest
//! two layers of front faces. Brightness is interpolated between vertices (Gouraud) and follows Lambert's law.
//!
//! ```
//! use nalgebra::{Point3, Vector3};
//! use pliant_render::{Camera, Canvas, Drawing, Surface, View, colour, render};
//!
//! let positions = [Point3::origin(), Point3::new(1.0, 0.0, 0.0), Point3::new(0.0, 1.0, 0.0)];
//! let drawing = Drawing::of([Surface::plain(&positions, &[[0, 1, 2]], colour::MUSCLE)]);
//! let view = View::orthographic(Vector3::z(), Vector3::y());
//! let camera = Camera::fit(positions, &view, Canvas::new(80, 60));
//! let png = render(&drawing, &camera).to_png()?;
//! # assert!(png.starts_with(b"\x89PNG"));
//! # Ok::<(), pliant_render::PictureError>(())
//! ```
//!
//! *Limitations.* No shadows, no highlights; a third translucent layer behind two others is not seen; lines are not
//! translucent but where they are seen through their own surface, the fainter the deeper. The bytes are the same for any
//! number of threads and any order of surfaces; another order of the triangles in one surface changes its normals by
//! rounding, and so a byte here and there.
#![forbid(unsafe_code)]
#![warn(missing_docs)]
// Units are written in brackets, [m], which rustdoc would take for links.
#![allow(rustdoc::broken_intra_doc_links)]
// `!(error <= bound)` is meant: it also catches NaN.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

mod animation;
mod camera;
mod clip;
pub mod colour;
mod frame;
mod legend;
mod lighting;
mod overlay;
mod palette;
mod raster;
mod screen;
mod text;
mod ticks;

pub use animation::{Film, to_apng, to_gif, write_film_as_apng, write_film_as_gif};
pub use camera::{Camera, Canvas, Lens, MAX_SIDE, View};
pub use colour::{ColourMap, Rgb};
pub use frame::{Frame, PictureError};
pub use legend::Legend;
pub use lighting::{Light, Lighting, vertex_normals};
pub use overlay::to_overlays;
pub use text::TextStyle;
pub use ticks::Ticks;

use nalgebra::Point3;

use clip::EyeVertex;
use screen::{Paint, Screen};

/// What a surface is coloured by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SurfaceColour<'a> {
    /// One colour.
    Plain(Rgb),
    /// A number at each vertex. Shaded less than a plain colour, so that the colours can be read in the shade too.
    Field {
        /// Values, shape `[vertex_count]`, in the unit of `range`. NaN or missing: grey.
        values: &'a [f64],
        /// What the two ends of the map stand for.
        range: (f64, f64),
        /// The colours.
        map: ColourMap,
    },
}

/// A triangle mesh to draw. Both sides of an opaque one are lit; of a translucent one only triangles that are
/// counter-clockwise to the viewer are drawn (of a closed mesh that is inside out, the others).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface<'a> {
    /// Vertex positions \[m\], shape `[vertex_count]`.
    pub positions: &'a [Point3<f64>],
    /// Vertex indices, shape `[triangle_count]`.
    pub triangles: &'a [[u32; 3]],
    /// One colour, or a field.
    pub colour: SurfaceColour<'a>,
    /// 1: opaque; less: translucent.
    pub opacity: f32,
}

impl<'a> Surface<'a> {
    /// An opaque surface of one colour.
    pub fn plain(positions: &'a [Point3<f64>], triangles: &'a [[u32; 3]], colour: Rgb) -> Self {
        Self {
            positions,
            triangles,
            colour: SurfaceColour::Plain(colour),
            opacity: 1.0,
        }
    }

    /// An opaque surface coloured by a number at each vertex.
    pub fn field(
        positions: &'a [Point3<f64>],
        triangles: &'a [[u32; 3]],
        values: &'a [f64],
        range: (f64, f64),
        map: ColourMap,
    ) -> Self {
        Self {
            positions,
            triangles,
            colour: SurfaceColour::Field { values, range, map },
            opacity: 1.0,
        }
    }

    /// The same surface, translucent.
    pub fn with_opacity(mut self, opacity: f32) -> Self {
        self.opacity = if opacity.is_nan() {
            1.0
        } else {
            opacity.clamp(0.0, 1.0)
        };
        self
    }
}

/// Lines to draw, such as fibres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lines<'a> {
    /// Points along each line \[m\].
    pub polylines: &'a [Vec<Point3<f64>>],
    /// One colour for all.
    pub colour: Rgb,
    /// Width \[px\]; about 1.5 looks well.
    pub width: f64,
    /// How far the lines are brought to the viewer \[px\], so that one that lies on a surface is not half hidden in it.
    pub lift: f64,
    /// The opaque surface, by its index in the drawing, through which the lines are seen where they lie inside it;
    /// they are hidden behind everything else.
    pub through: Option<usize>,
}

impl<'a> Lines<'a> {
    /// Lines of 1.5 px, brought forward by 2 px.
    pub fn new(polylines: &'a [Vec<Point3<f64>>], colour: Rgb) -> Self {
        Self {
            polylines,
            colour,
            width: 1.5,
            lift: 2.0,
            through: None,
        }
    }

    /// The same lines, seen through an opaque surface of the drawing.
    pub fn seen_through(mut self, surface: usize) -> Self {
        self.through = Some(surface);
        self
    }
}

/// What there is to see.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing<'a> {
    /// Meshes, in any order.
    pub surfaces: Vec<Surface<'a>>,
    /// Lines, in any order.
    pub lines: Vec<Lines<'a>>,
    /// What is behind everything.
    pub background: Rgb,
    /// The lights; `None`: [`Lighting::studio`].
    pub lighting: Option<Lighting>,
}

impl<'a> Drawing<'a> {
    /// Surfaces before white.
    pub fn of(surfaces: impl IntoIterator<Item = Surface<'a>>) -> Self {
        Self {
            surfaces: surfaces.into_iter().collect(),
            lines: Vec::new(),
            background: [1.0; 3],
            lighting: None,
        }
    }

    /// The same, with lines.
    pub fn with_lines(mut self, lines: Lines<'a>) -> Self {
        self.lines.push(lines);
        self
    }
}

/// Draws a picture. Any numbers are accepted: triangles and segments with a coordinate that is not finite, or with a
/// vertex that does not exist, are left out and counted in [`Frame::dropped`].
pub fn render(drawing: &Drawing, camera: &Camera) -> Frame {
    let mut screen = Screen::new(camera);
    let lighting = drawing
        .lighting
        .clone()
        .unwrap_or_else(|| Lighting::studio(camera));
    for surface in &drawing.surfaces {
        add_surface(&mut screen, surface, camera, &lighting);
    }
    for lines in &drawing.lines {
        // Surfaces come first, so the index of one is the number of its paint.
        let host = lines
            .through
            .filter(|s| *s < drawing.surfaces.len())
            .map(|s| s as u32);
        add_lines(&mut screen, lines, host, camera);
    }
    screen.fill(drawing.background)
}

/// The share of the shading that a field gets.
const FIELD_SHADE: f64 = 0.6;

fn add_surface(screen: &mut Screen, surface: &Surface, camera: &Camera, lighting: &Lighting) {
    let paint = screen.paint(match surface.colour {
        SurfaceColour::Plain(colour) => Paint::plain(colour, surface.opacity),
        SurfaceColour::Field { map, .. } => Paint::field(map, surface.opacity),
    });
    let inside_out = surface.opacity < 1.0 && is_inside_out(surface);
    let vertices = lit_vertices(surface, camera, lighting, inside_out);
    for &[a, b, c] in surface.triangles {
        let corners = if inside_out { [a, c, b] } else { [a, b, c] };
        match corners.map(|i| vertices.get(i as usize).copied().flatten()) {
            [Some(a), Some(b), Some(c)] => screen.triangle(&[a, b, c], paint),
            _ => screen.dropped += 1,
        }
    }
}

/// The vertices as the camera sees them, with the brightness of both sides.
fn lit_vertices(
    surface: &Surface,
    camera: &Camera,
    lighting: &Lighting,
    inside_out: bool,
) -> Vec<Option<EyeVertex>> {
    let normals = vertex_normals(surface.positions, surface.triangles);
    let lit = |(index, (point, normal)): (usize, (&Point3<f64>, nalgebra::Vector3<f64>))| {
        let normal = if inside_out { -normal } else { normal };
        let place = match surface.colour {
            SurfaceColour::Plain(_) => 0.0,
            SurfaceColour::Field { values, range, .. } => {
                // Far outside is the same as outside; f32 must not overflow.
                ColourMap::place(values.get(index).copied().unwrap_or(f64::NAN), range)
                    .clamp(-1e6, 1e6)
            }
        };
        let to_viewer = if camera.perspective {
            lighting::unit(camera.eye - point).unwrap_or_else(|| camera.towards_viewer())
        } else {
            camera.towards_viewer()
        };
        let depth_of_shade = if matches!(surface.colour, SurfaceColour::Plain(_)) {
            1.0
        } else {
            FIELD_SHADE
        };
        let [front, back] = [normal, -normal]
            .map(|n| 1.0 + depth_of_shade * (lighting.brightness(point, &n) - 1.0));
        let shade = [front, back, place, normal.dot(&to_viewer)].map(|s| s as f32);
        EyeVertex::new(camera, point, shade)
    };
    surface
        .positions
        .iter()
        .zip(normals)
        .enumerate()
        .map(lit)
        .collect()
}

/// Whether the volume that the surface encloses is negative.
fn is_inside_out(surface: &Surface) -> bool {
    let Some(origin) = surface.positions.first() else {
        return false;
    };
    let mut volume = 0.0;
    for triangle in surface.triangles {
        if let [Some(a), Some(b), Some(c)] = triangle.map(|i| surface.positions.get(i as usize)) {
            volume += (a - origin).dot(&(b - origin).cross(&(c - origin)));
        }
    }
    volume < 0.0
}

fn add_lines(screen: &mut Screen, lines: &Lines, host: Option<u32>, camera: &Camera) {
    let paint = screen.paint(Paint {
        host,
        ..Paint::plain(lines.colour, 1.0)
    });
    let [width, lift] = [lines.width, lines.lift].map(|pixels| {
        if pixels.is_finite() {
            pixels.max(0.0)
        } else {
            0.0
        }
    });
    for line in lines.polylines {
        for ends in line.windows(2) {
            match [&ends[0], &ends[1]].map(|point| EyeVertex::new(camera, point, [1.0; 4])) {
                [Some(from), Some(to)] => screen.segment(&[from, to], paint, width, lift),
                _ => screen.dropped += 1,
            }
        }
    }
}

#[cfg(test)]
mod tests;
