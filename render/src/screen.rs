//! The list of screen triangles, and their rasterisation into bands of rows with a depth buffer
//! each.

use std::ops::Range;

use rayon::prelude::*;

use super::camera::Camera;
use super::clip::{Clipper, EyeVertex, SAFE};
use super::colour::{ColourMap, NO_VALUE, Rgb, mix, quantise};
use super::frame::Frame;
use super::raster::GridTriangle;

/// Samples along each side of a pixel; their mean smooths edges.
const SAMPLES: usize = 2;

/// Rows of pixels per band. Bands are independent, so the picture has the same bytes for any number
/// of threads, and the buffers of a band stay in the cache.
const BAND: usize = 32;

/// Entries of a colour table: its steps are smaller than those of a byte.
const TABLE: usize = 1024;

/// Paint of a triangle.
pub(super) struct Paint {
    /// One colour, or the colours from the start to the end of a field's range.
    pub colours: Vec<Rgb>,
    /// Opacity where the surface faces the viewer.
    pub opacity: f32,
    /// The paint of the opaque surface through which this paint is visible.
    pub host: Option<u32>,
}

impl Paint {
    pub fn plain(colour: Rgb, opacity: f32) -> Self {
        Self {
            colours: vec![colour],
            opacity,
            host: None,
        }
    }

    pub fn field(map: ColourMap, opacity: f32) -> Self {
        let colours = (0..TABLE)
            .map(|i| map.colour(i as f64 / (TABLE - 1) as f64))
            .collect();
        Self {
            colours,
            opacity,
            host: None,
        }
    }

    fn colour(&self, place: f32, brightness: f32) -> Rgb {
        let plain = match self.colours.as_slice() {
            [one] => *one,
            _ if place.is_nan() => NO_VALUE,
            // `as` saturates at 0.
            table => table[((place * (TABLE - 1) as f32 + 0.5) as usize).min(table.len() - 1)],
        };
        plain.map(|c| (c * brightness).clamp(0.0, 1.0))
    }

    /// Translucent surfaces are denser at their silhouettes, like frosted glass.
    fn alpha(&self, facing: f32) -> f32 {
        let away = 1.0 - facing.clamp(0.0, 1.0);
        self.opacity + (1.0 - self.opacity) * 0.6 * away * away
    }
}

/// A triangle on the screen.
struct ScreenTriangle {
    grid: GridTriangle,
    paint: u32,
    /// Larger is nearer; linear on the screen.
    near: [f64; 3],
    /// Brightness, position in the range, cosine to the viewer.
    shade: [[f32; 3]; 3],
}

/// The triangles to draw, in pixels.
pub(super) struct Screen<'a> {
    camera: &'a Camera,
    clipper: Clipper,
    paints: Vec<Paint>,
    opaque: Vec<ScreenTriangle>,
    translucent: Vec<ScreenTriangle>,
    /// Number of triangles and segments left out because of a coordinate that is not finite or a
    /// missing vertex.
    pub dropped: usize,
}

impl<'a> Screen<'a> {
    pub fn new(camera: &'a Camera) -> Self {
        let clipper = Clipper::new(camera);
        Self {
            camera,
            clipper,
            paints: Vec::new(),
            opaque: Vec::new(),
            translucent: Vec::new(),
            dropped: 0,
        }
    }

    /// Adds a paint. Returns its index.
    pub fn paint(&mut self, paint: Paint) -> u32 {
        self.paints.push(paint);
        (self.paints.len() - 1) as u32
    }

    /// Adds a triangle; a translucent one only if it faces the viewer.
    pub fn triangle(&mut self, corners: &[EyeVertex; 3], paint: u32) {
        let polygon = self.clipper.triangle(corners);
        let Some((first, rest)) = polygon.corners().split_first() else {
            return;
        };
        for pair in rest.windows(2) {
            let fan = [*first, pair[0], pair[1]];
            let places = fan.map(|corner| self.place(&corner));
            self.add(fan.map(|corner| corner.shade), places, paint);
        }
    }

    /// Adds a segment, `width` pixels wide and `lift` pixels in front of its position.
    pub fn segment(&mut self, ends: &[EyeVertex; 2], paint: u32, width: f64, lift: f64) {
        let Some(ends) = self.clipper.segment(ends) else {
            return;
        };
        let places = ends.map(|end| self.place(&end));
        let [from, to] = places.map(|(xy, _)| xy);
        let along = [to[0] - from[0], to[1] - from[1]];
        let length = libm::hypot(along[0], along[1]);
        let half = width / 2.0 * SAMPLES as f64;
        // A segment seen end on is a square dot.
        let [x, y] = if length > 0.0 {
            along.map(|c| c / length * half)
        } else {
            [half, 0.0]
        };
        let near = ends.map(|end| self.lifted(&end, lift));
        let corner = |end: usize, back: f64, side: f64| {
            let [px, py] = places[end].0;
            (
                [px + back * x - side * y, py + back * y + side * x],
                near[end],
            )
        };
        let quad = [
            corner(0, -1.0, -1.0),
            corner(0, -1.0, 1.0),
            corner(1, 1.0, 1.0),
            corner(1, 1.0, -1.0),
        ];
        for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
            self.add(
                [[1.0, 1.0, f32::NAN, 1.0]; 3],
                [quad[a], quad[b], quad[c]],
                paint,
            );
        }
    }

    /// The sample (right, down) of a vertex, and its nearness.
    fn place(&self, vertex: &EyeVertex) -> ([f64; 2], f64) {
        let [x, y, depth] = vertex.place;
        let camera = self.camera;
        let scale = camera.scale / SAFE;
        let sample = [camera.centre[0] + x * scale, camera.centre[1] - y * scale]
            .map(|c| c * SAMPLES as f64);
        (sample, -depth)
    }

    /// The nearness of a vertex moved `pixels` towards the viewer.
    fn lifted(&self, vertex: &EyeVertex, pixels: f64) -> f64 {
        pixels / self.camera.scale * SAFE - vertex.place[2]
    }

    /// The distance of a point behind a nearer one [px].
    fn pixels_behind(&self, near: f64, nearer: f64) -> f64 {
        (nearer - near) / SAFE * self.camera.scale
    }

    fn add(&mut self, shade: [[f32; 4]; 3], places: [([f64; 2], f64); 3], paint: u32) {
        let Some(oriented) = GridTriangle::on_grid(places.map(|(sample, _)| sample)) else {
            return;
        };
        // Counter-clockwise with y up is clockwise with y down: a front has swapped corners.
        let front = oriented.swapped;
        let translucent = self.paints[paint as usize].opacity < 1.0;
        if translucent && !front {
            return;
        }
        let order = if oriented.swapped {
            [0, 2, 1]
        } else {
            [0, 1, 2]
        };
        let triangle = ScreenTriangle {
            grid: oriented.triangle,
            paint,
            near: order.map(|k| places[k].1),
            shade: order.map(|k| [shade[k][usize::from(!front)], shade[k][2], shade[k][3]]),
        };
        if translucent {
            self.translucent.push(triangle)
        } else {
            self.opaque.push(triangle)
        }
    }

    /// Fills all bands.
    pub fn fill(&self, background: Rgb) -> Frame {
        let [width, height] =
            [self.camera.canvas.width, self.camera.canvas.height].map(|s| s as usize);
        let mut pixels = vec![[0; 3]; width * height];
        let bands = height.div_ceil(BAND);
        let (opaque, translucent) = (
            sort_into_bands(&self.opaque, bands),
            sort_into_bands(&self.translucent, bands),
        );
        // Each thread reuses its buffers for all bands: new memory costs more than the
        // rasterisation.
        pixels
            .par_chunks_mut(width * BAND)
            .enumerate()
            .for_each_init(Buffers::default, |buffers, (number, pixels)| {
                let rows = pixels.len() / width * SAMPLES;
                let first = number * BAND * SAMPLES;
                let mut band = Band::new(
                    self,
                    width * SAMPLES,
                    first..first + rows,
                    background,
                    buffers,
                );
                opaque[number]
                    .iter()
                    .for_each(|&i| band.opaque(&self.opaque[i as usize]));
                if self.paints.iter().any(|p| p.host.is_some()) {
                    band.lay_inner();
                }
                if !translucent[number].is_empty() {
                    band.clear_layers();
                    translucent[number]
                        .iter()
                        .for_each(|&i| band.translucent(&self.translucent[i as usize]));
                    band.blend();
                }
                band.resolve(pixels);
            });
        Frame::from_pixels(width, height, pixels, self.dropped)
    }
}

/// The indices of the triangles of each band.
fn sort_into_bands(triangles: &[ScreenTriangle], bands: usize) -> Vec<Vec<u32>> {
    let mut sorted = vec![Vec::new(); bands];
    let rows_of_band = (BAND * SAMPLES) as i64;
    for (index, triangle) in triangles.iter().enumerate() {
        let rows = triangle.grid.rows();
        let first = rows.start.div_euclid(rows_of_band).max(0);
        let last = (rows.end - 1)
            .div_euclid(rows_of_band)
            .min(bands as i64 - 1);
        for band in first..=last {
            sorted[band as usize].push(index as u32);
        }
    }
    sorted
}

/// The nearest opaque object at a sample.
#[derive(Clone, Copy)]
struct Nearest {
    near: f64,
    colour: Rgb,
    /// Paint of the object.
    paint: u32,
    /// The strongest of the lines visible through the object, with its strength. Strengths do not
    /// add up: the segments of a line overlap where they meet.
    inner: (Rgb, f32),
}

/// The paint of the background.
const NO_PAINT: u32 = u32::MAX;

/// No line is visible through a surface.
const NO_LINE: (Rgb, f32) = ([0.0; 3], 0.0);

/// Strength of a line just below its surface: the colours of the surface must remain readable.
const INNER: f32 = 0.8;

/// A line has half the strength for each such depth, so that layers of lines are distinguishable
/// [px].
const HALVED: f32 = 5.0;

/// A translucent object at a sample.
#[derive(Clone, Copy)]
struct Layer {
    near: f64,
    colour: Rgb,
    alpha: f32,
}

impl Layer {
    const NONE: Self = Self {
        near: f64::NEG_INFINITY,
        colour: [0.0; 3],
        alpha: 0.0,
    };
}

/// The nearer wins; at equal depth the brighter, so that the order of drawing never matters.
fn beats(near: f64, colour: Rgb, other_near: f64, other: Rgb) -> bool {
    near > other_near || (near == other_near && colour > other)
}

/// The contents of each sample of a band.
#[derive(Default)]
struct Buffers {
    nearest: Vec<Nearest>,
    /// The two nearest translucent layers, nearest first.
    layers: Vec<[Layer; 2]>,
}

/// The samples of some rows of pixels.
struct Band<'a> {
    screen: &'a Screen<'a>,
    width: usize,
    rows: Range<usize>,
    buffers: &'a mut Buffers,
}

impl<'a> Band<'a> {
    fn new(
        screen: &'a Screen<'a>,
        width: usize,
        rows: Range<usize>,
        background: Rgb,
        buffers: &'a mut Buffers,
    ) -> Self {
        let empty = Nearest {
            near: f64::NEG_INFINITY,
            colour: background,
            paint: NO_PAINT,
            inner: NO_LINE,
        };
        buffers.nearest.clear();
        buffers.nearest.resize(width * rows.len(), empty);
        Self {
            screen,
            width,
            rows,
            buffers,
        }
    }

    fn clear_layers(&mut self) {
        let count = self.buffers.nearest.len();
        self.buffers.layers.clear();
        self.buffers.layers.resize(count, [Layer::NONE; 2]);
    }

    fn ranges(&self) -> (Range<i64>, Range<i64>) {
        (
            0..self.width as i64,
            self.rows.start as i64..self.rows.end as i64,
        )
    }

    fn opaque(&mut self, triangle: &ScreenTriangle) {
        let paint = &self.screen.paints[triangle.paint as usize];
        let (columns, rows) = self.ranges();
        let (width, first) = (self.width, self.rows.start);
        let nearest = &mut self.buffers.nearest;
        triangle.grid.fill(columns, rows, |x, y, weights| {
            let sample = &mut nearest[(y - first) * width + x];
            let near = dot(weights, triangle.near);
            if near < sample.near {
                if paint.host == Some(sample.paint) {
                    let alpha = INNER
                        * libm::exp2f(
                            -self.screen.pixels_behind(near, sample.near) as f32 / HALVED,
                        );
                    if alpha > sample.inner.1 {
                        sample.inner = (paint.colour(f32::NAN, 1.0), alpha);
                    }
                }
                return;
            }
            let [brightness, place, _] = triangle.shade_at(weights);
            let colour = paint.colour(place, brightness);
            if beats(near, colour, sample.near, sample.colour) {
                *sample = Nearest {
                    near,
                    colour,
                    paint: triangle.paint,
                    inner: NO_LINE,
                };
            }
        });
    }

    /// Blends the lines inside a surface over it.
    fn lay_inner(&mut self) {
        for sample in &mut self.buffers.nearest {
            let (colour, alpha) = sample.inner;
            sample.colour = mix(sample.colour, colour, alpha);
        }
    }

    fn translucent(&mut self, triangle: &ScreenTriangle) {
        let paint = &self.screen.paints[triangle.paint as usize];
        let (columns, rows) = self.ranges();
        let (width, first) = (self.width, self.rows.start);
        let Buffers { nearest, layers } = &mut *self.buffers;
        triangle.grid.fill(columns, rows, |x, y, weights| {
            let index = (y - first) * width + x;
            let near = dot(weights, triangle.near);
            let [front, behind] = &mut layers[index];
            if near <= nearest[index].near || near < behind.near {
                return;
            }
            let [brightness, place, facing] = triangle.shade_at(weights);
            let layer = Layer {
                near,
                colour: paint.colour(place, brightness),
                alpha: paint.alpha(facing),
            };
            if beats(near, layer.colour, front.near, front.colour) {
                *behind = std::mem::replace(front, layer);
            } else if beats(near, layer.colour, behind.near, behind.colour) {
                *behind = layer;
            }
        });
    }

    /// Blends the translucent layers over the objects behind them.
    fn blend(&mut self) {
        for (sample, [front, behind]) in self.buffers.nearest.iter_mut().zip(&self.buffers.layers) {
            sample.colour = mix(
                mix(sample.colour, behind.colour, behind.alpha),
                front.colour,
                front.alpha,
            );
        }
    }

    /// The mean of the samples of each pixel.
    fn resolve(&self, pixels: &mut [[u8; 3]]) {
        let across = self.width / SAMPLES;
        for (index, pixel) in pixels.iter_mut().enumerate() {
            let (x, y) = (index % across * SAMPLES, index / across * SAMPLES);
            let mut sum = [0.0f32; 3];
            for sample in
                (0..SAMPLES * SAMPLES).map(|k| (y + k / SAMPLES) * self.width + x + k % SAMPLES)
            {
                let colour = self.buffers.nearest[sample].colour;
                sum = std::array::from_fn(|k| sum[k] + colour[k]);
            }
            *pixel = quantise(sum.map(|c| c / (SAMPLES * SAMPLES) as f32));
        }
    }
}

fn dot(weights: [f64; 3], values: [f64; 3]) -> f64 {
    weights[0] * values[0] + weights[1] * values[1] + weights[2] * values[2]
}

impl ScreenTriangle {
    /// The shade at a sample.
    fn shade_at(&self, weights: [f64; 3]) -> [f32; 3] {
        let [a, b, c] = weights.map(|w| w as f32);
        std::array::from_fn(|k| a * self.shade[0][k] + b * self.shade[1][k] + c * self.shade[2][k])
    }
}
