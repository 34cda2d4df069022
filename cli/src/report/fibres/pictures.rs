//! Pictures of fibres in their muscle: from its broad and its narrow side, and in sections.

use nalgebra::{Matrix3, Point3, Vector3};

use super::Bundle;
use crate::report::output::Picture;
use pliant::fibres::{Area, action};
use pliant::mesh::{Topology, TriangleMesh, cut, filled};
use pliant_render::{
    Camera, Canvas, ColourMap, Drawing, Frame, Legend, Lines, PictureError, Rgb, Surface,
    TextStyle, View, colour, render,
};

/// Size of a picture from a side, and of a section [px].
const SIZE: (u32, u32) = (620, 760);
const SECTION: (u32, u32) = (460, 460);
/// Number of colour classes of fibres.
const STEPS: usize = 24;
/// Opacity of the muscle.
const OPACITY: f32 = 0.3;
/// Positions of the sections, relative to the muscle's length along the line of action.
const SECTIONS: [f64; 3] = [0.25, 0.5, 0.75];
/// Radius of a fibre in a section, in mean spacings.
const DOT: f64 = 0.16;

/// Colours of area boundaries, tendons, lines on the surface, cut tissue, and fibres in it.
const ORIGIN: Rgb = [0.13, 0.33, 0.85];
const INSERTION: Rgb = [0.80, 0.08, 0.15];
const TENDON: Rgb = [0.25, 0.25, 0.27];
const SEEN: Rgb = [0.05, 0.05, 0.05];
const FLESH: Rgb = [0.86, 0.55, 0.50];
const INK: Rgb = [0.16, 0.17, 0.19];

/// Axes along the line of action, along the broad side across it, and out of the broad side.
fn axes(muscle: &TriangleMesh, action: &Vector3<f64>) -> [Vector3<f64>; 3] {
    let along = action.try_normalize(0.0).unwrap_or_else(Vector3::z);
    let helper = Vector3::ith(along.iamin(), 1.0);
    let first = along.cross(&helper).normalize();
    let second = along.cross(&first);
    let count = muscle.vertices.len().max(1) as f64;
    let mean = muscle
        .vertices
        .iter()
        .map(|p| p.coords)
        .sum::<Vector3<f64>>()
        / count;
    let spread: Matrix3<f64> = muscle
        .vertices
        .iter()
        .map(|p| (p.coords - mean) * (p.coords - mean).transpose())
        .sum();
    // The angle with the greatest variance across the line of action.
    let [a, b, c] =
        [(first, first), (first, second), (second, second)].map(|(u, v)| u.dot(&(spread * v)));
    let angle = 0.5 * libm::atan2(2.0 * b, a - c);
    let broad = first * libm::cos(angle) + second * libm::sin(angle);
    [along, broad, along.cross(&broad)]
}

/// The edges of an area with exactly one of its triangles.
fn rim(muscle: &TriangleMesh, area: &Area) -> Vec<Vec<Point3<f64>>> {
    let triangles = area
        .triangles
        .iter()
        .map(|&t| muscle.triangles[t as usize])
        .collect();
    let part = TriangleMesh {
        vertices: muscle.vertices.clone(),
        triangles,
    };
    let topology = Topology::new(&part);
    let edge = |e: u32| {
        topology.edges[e as usize]
            .map(|v| muscle.vertices[v as usize])
            .to_vec()
    };
    topology.boundary_edges().into_iter().map(edge).collect()
}

/// Fibres in classes of a number, with the legend of the colours.
fn coloured(
    fibres: &[Vec<Point3<f64>>],
    legend: &Legend,
    values: &[f64],
) -> Vec<(Rgb, Vec<Vec<Point3<f64>>>)> {
    let mut groups = vec![Vec::new(); STEPS];
    for (fibre, value) in fibres.iter().zip(values) {
        let place = ColourMap::place(*value, legend.range).clamp(0.0, 1.0);
        groups[((place * STEPS as f64) as usize).min(STEPS - 1)].push(fibre.clone());
    }
    let colour = |step: usize| legend.map.colour((step as f64 + 0.5) / STEPS as f64);
    groups
        .into_iter()
        .enumerate()
        .map(|(step, group)| (colour(step), group))
        .collect()
}

fn legend(title: &str, unit: &str, values: &[f64]) -> Legend {
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    Legend::new(title, unit, (least, most), ColourMap::Viridis).large()
}

impl Bundle<'_> {
    pub(super) fn pictures(&self) -> Result<Vec<Picture>, PictureError> {
        let axes = axes(self.muscle, &action(self.fibres));
        let [_, broad, out] = axes;
        let lengths: Vec<f64> = self.each.iter().map(|e| 1e3 * e.length_m).collect();
        let angles: Vec<f64> = self
            .each
            .iter()
            .map(|e| e.pennation_rad.to_degrees())
            .collect();
        let tendons = if self.tendons.iter().any(|t| !t.is_empty()) {
            "; grey: tendons"
        } else {
            ""
        };
        let lines = if self.lines.is_empty() {
            ""
        } else {
            "; black: lines on the surface that were given"
        };
        let caption = |side: &str, by: &str| {
            format!(
                "{side}, fibres coloured by {by}; blue rim: origin (above), red rim: insertion{tendons}{lines}"
            )
        };
        let length = legend("Length", "mm", &lengths);
        let pennation = legend("Pennation", "degrees", &angles);
        let sections = "Sections across the line of action at a quarter, half and three quarters of the muscle's \
                        length; each dot is a fibre";
        Ok(vec![
            Picture {
                file: "broad.png".to_owned(),
                caption: caption("From its broad side", "length"),
                bytes: self.side(&axes, out, &length, &lengths)?,
                wide: false,
            },
            Picture {
                file: "narrow.png".to_owned(),
                caption: caption("From its narrow side", "pennation"),
                bytes: self.side(&axes, broad, &pennation, &angles)?,
                wide: false,
            },
            Picture {
                file: "sections.png".to_owned(),
                caption: sections.to_owned(),
                bytes: self.sections(&axes)?,
                wide: true,
            },
        ])
    }

    /// The meshes of the areas of attachment that have one, with their colours.
    fn patches(&self) -> Vec<(&TriangleMesh, Rgb)> {
        let areas = [&self.attachment.origin, &self.attachment.insertion];
        areas
            .into_iter()
            .zip([ORIGIN, INSERTION])
            .filter_map(|(area, colour)| Some((area.patch.as_ref()?, colour)))
            .collect()
    }

    fn side(
        &self,
        axes: &[Vector3<f64>; 3],
        from: Vector3<f64>,
        legend: &Legend,
        values: &[f64],
    ) -> Result<Vec<u8>, PictureError> {
        let groups = coloured(self.fibres, legend, values);
        let rims = [
            rim(self.muscle, &self.attachment.origin),
            rim(self.muscle, &self.attachment.insertion),
        ];
        let tendons: Vec<Vec<Point3<f64>>> =
            self.tendons.iter().flatten().map(|t| t.to_vec()).collect();
        let muscle = Surface::plain(
            &self.muscle.vertices,
            &self.muscle.triangles,
            colour::MUSCLE,
        )
        .with_opacity(OPACITY);
        let patches = self.patches();
        // A component has all vertices of its file, also those of other components.
        let ends = patches.iter().flat_map(|(mesh, _)| {
            let used = mesh.triangles.iter().flatten();
            used.map(|&v| mesh.vertices[v as usize])
        });
        let surfaces = patches
            .iter()
            .map(|(mesh, colour)| Surface::plain(&mesh.vertices, &mesh.triangles, *colour));
        let mut drawing = Drawing::of(surfaces.chain([muscle]));
        for (colour, group) in &groups {
            drawing = drawing.with_lines(Lines {
                width: 1.8,
                lift: 0.0,
                ..Lines::new(group, *colour)
            });
        }
        drawing = drawing.with_lines(Lines {
            width: 1.4,
            lift: 0.0,
            ..Lines::new(&tendons, TENDON)
        });
        drawing = drawing.with_lines(Lines {
            width: 2.6,
            lift: 0.0,
            ..Lines::new(self.lines, SEEN)
        });
        for (rim, colour) in rims.iter().zip([ORIGIN, INSERTION]) {
            drawing = drawing.with_lines(Lines {
                width: 3.0,
                ..Lines::new(rim, colour)
            });
        }
        let points = self.muscle.vertices.iter().copied().chain(ends);
        let view = View::orthographic(from, -axes[0]);
        let canvas = Canvas::new(SIZE.0, SIZE.1).with_right(legend.width());
        let mut frame = render(&drawing, &Camera::fit(points, &view, canvas));
        legend.draw(&mut frame);
        frame.to_png()
    }

    fn sections(&self, axes: &[Vector3<f64>; 3]) -> Result<Vec<u8>, PictureError> {
        let frames: Vec<Frame> = SECTIONS
            .iter()
            .map(|share| self.section(axes, *share))
            .collect();
        Frame::beside(&frames, 6, [1.0; 3]).to_png()
    }

    /// The section by a plane across the line of action, with the fibres through it.
    fn section(&self, [along, _, out]: &[Vector3<f64>; 3], share: f64) -> Frame {
        let heights = || self.muscle.vertices.iter().map(|p| p.coords.dot(along));
        let (low, high) = heights().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), h| {
            (a.min(h), b.max(h))
        });
        let at = low + share * (high - low);
        let height: Vec<f64> = heights().map(|h| h - at).collect();
        let outline = cut(self.muscle, &[], &height).line;
        let flesh = filled(&outline, along);
        let spacing =
            (self.summary.volume_m3 / self.each.iter().map(|e| e.length_m).sum::<f64>()).sqrt();
        let mut dots = TriangleMesh::default();
        for s in self.fibres.iter().flat_map(|f| f.windows(2)) {
            let [a, b] = [s[0], s[1]].map(|p| p.coords.dot(along) - at);
            if (a < 0.0) != (b < 0.0) {
                // Raised so that the tissue does not hide it.
                let middle = s[0] + (s[1] - s[0]) * (a / (a - b)) + along * (DOT * spacing);
                dot(&mut dots, &middle, along, DOT * spacing);
            }
        }
        let surfaces = [
            Surface::plain(&flesh.vertices, &flesh.triangles, FLESH),
            Surface::plain(&dots.vertices, &dots.triangles, INK),
        ];
        let drawing = Drawing::of(surfaces).with_lines(Lines {
            width: 2.0,
            ..Lines::new(&outline, INK)
        });
        let view = View::orthographic(*along, *out);
        // The line of an open surface encloses nothing and can be far away.
        let focus = flesh.vertices.iter().chain(&dots.vertices).copied();
        let mut frame = render(
            &drawing,
            &Camera::fit(focus, &view, Canvas::new(SECTION.0, SECTION.1)),
        );
        frame.title(&format!("at {:.0} %", 100.0 * share), TextStyle::Title);
        frame
    }
}

/// Adds a disc of `radius` [m] perpendicular to `normal`.
fn dot(mesh: &mut TriangleMesh, middle: &Point3<f64>, normal: &Vector3<f64>, radius: f64) {
    let helper = Vector3::ith(normal.iamin(), 1.0);
    let first = normal.cross(&helper).normalize() * radius;
    let second = normal.cross(&first);
    let start = mesh.vertices.len() as u32;
    for k in 0..12 {
        let (sin, cos) = libm::sincos(std::f64::consts::TAU * f64::from(k) / 12.0);
        mesh.vertices.push(middle + first * cos + second * sin);
    }
    mesh.triangles
        .extend((1..11).map(|k| [start, start + k, start + k + 1]));
}
