//! The software renderer: pictures of meshes, fibres and fields, without a GPU and without a
//! window.
//!
//! A [`Drawing`] contains the objects, a [`Camera`] the projection, a [`Frame`] the picture. Opaque
//! surfaces and lines use a depth buffer with four samples per pixel. The nearest two layers of
//! translucent front faces (bones) are blended over them. Brightness is interpolated between
//! vertices (Gouraud) and follows Lambert's law.
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
//! *Limitations.* There are no shadows and no highlights. A third translucent layer behind two
//! others is invisible. Lines are opaque except inside their own surface, where they are fainter
//! with depth. The bytes are the same for any number of threads and any order of surfaces. Another
//! order of the triangles in one surface changes its normals by rounding, and so some bytes.
#![cfg_attr(not(test), warn(clippy::unwrap_used))]

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
pub use camera::{Camera, Canvas, MAX_SIDE, View};
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

/// Colour of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SurfaceColour<'a> {
    /// One colour.
    Plain(Rgb),
    /// A number at each vertex. The shading is weaker than for a plain colour, so that the colours
    /// are readable in the shade.
    Field {
        /// Values, shape `[vertex_count]`, in the unit of `range`. NaN or missing: grey.
        values: &'a [f64],
        /// Values at the two ends of the map.
        range: (f64, f64),
        /// The colours.
        map: ColourMap,
    },
}

/// A triangle mesh to draw. Both sides of an opaque mesh are lit. Of a translucent one only
/// triangles counter-clockwise to the viewer are drawn (of a closed mesh that is inside out, the
/// others).
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

    /// The same surface with an opacity.
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
    /// Colour of all lines.
    pub colour: Rgb,
    /// Width \[px\]; 1.5 is a good value.
    pub width: f64,
    /// Offset of the lines towards the viewer \[px\], so that a line on a surface is not half
    /// hidden.
    pub lift: f64,
    /// Index of the opaque surface in the drawing through which the lines are visible where they
    /// lie inside it; everything else hides them.
    pub through: Option<usize>,
}

impl<'a> Lines<'a> {
    /// Lines of 1.5 px, offset by 2 px towards the viewer.
    pub fn new(polylines: &'a [Vec<Point3<f64>>], colour: Rgb) -> Self {
        Self {
            polylines,
            colour,
            width: 1.5,
            lift: 2.0,
            through: None,
        }
    }

    /// The same lines, visible through an opaque surface of the drawing.
    pub fn seen_through(mut self, surface: usize) -> Self {
        self.through = Some(surface);
        self
    }
}

/// The objects of a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing<'a> {
    /// Meshes, in any order.
    pub surfaces: Vec<Surface<'a>>,
    /// Lines, in any order.
    pub lines: Vec<Lines<'a>>,
    /// Background colour.
    pub background: Rgb,
    /// The lights; `None` means [`Lighting::studio`].
    pub lighting: Option<Lighting>,
}

impl<'a> Drawing<'a> {
    /// Surfaces on a white background.
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

/// Renders a picture. Triangles and segments with a coordinate that is not finite, or with a
/// missing vertex, are left out and counted in [`Frame::dropped`].
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
        // Surfaces come first, so the index of a surface is the index of its paint.
        let host = lines
            .through
            .filter(|s| *s < drawing.surfaces.len())
            .map(|s| s as u32);
        add_lines(&mut screen, lines, host, camera);
    }
    screen.fill(drawing.background)
}

/// Strength of the shading of a field.
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

/// The vertices in camera coordinates, with the brightness of both sides.
fn lit_vertices(
    surface: &Surface,
    camera: &Camera,
    lighting: &Lighting,
    inside_out: bool,
) -> Vec<Option<EyeVertex>> {
    let normals = vertex_normals(surface.positions, surface.triangles);
    let to_viewer = camera.towards_viewer();
    let lit = |(index, (point, normal)): (usize, (&Point3<f64>, nalgebra::Vector3<f64>))| {
        let normal = if inside_out { -normal } else { normal };
        let place = match surface.colour {
            SurfaceColour::Plain(_) => 0.0,
            SurfaceColour::Field { values, range, .. } => {
                // A value far outside counts as outside; f32 must not overflow.
                ColourMap::place(values.get(index).copied().unwrap_or(f64::NAN), range)
                    .clamp(-1e6, 1e6)
            }
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

/// True if the surface encloses a negative volume.
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
