//! The picture of a section through an implant.

use nalgebra::{Point3, Vector3};

use super::pictures::SIZE;
use super::{Insertion, Shown, Single};
use pliant::mesh::{Cut, Orientation, Topology, TriangleMesh, cut, filled};
use pliant::skin::{Layers, Whole};
use pliant_render::{
    Camera, Canvas, Drawing, Lines, PictureError, Rgb, Surface, TextStyle, View, colour, render,
};

/// Colours of skin, cut skin, the cut implant, cut bone, the original bed, lines of the section,
/// the skin before.
const SKIN: Rgb = [0.86, 0.74, 0.66];
const FLESH: Rgb = [0.84, 0.50, 0.45];
const FILLING: Rgb = [0.66, 0.78, 0.92];
const MARROW: Rgb = [0.80, 0.73, 0.58];
const BED: Rgb = [0.72, 0.52, 0.48];
const INK: Rgb = [0.16, 0.17, 0.19];
const BEFORE: Rgb = [0.30, 0.45, 0.35];

/// What a section shows, cut by its plane.
struct Section {
    /// The skin without the region of the implant.
    rest: Cut,
    /// The region before.
    before: Cut,
    upper: Cut,
    lower: Cut,
    /// The bed of the implant, seen from its top: the bone, or else the original surface below the
    /// lower layer.
    bed: Cut,
    /// Implants of the region. Only the cut is drawn: the rest is under the skin, or slightly inside
    /// the bed.
    shells: Vec<Cut>,
    /// Bones, and true for a closed one.
    bones: Vec<(Cut, bool)>,
}

impl Insertion<'_> {
    /// A section through the middle of an implant, along its frame.
    pub(super) fn section(&self, shown: &Shown, k: usize) -> Result<Vec<u8>, PictureError> {
        let all = self.each();
        let one = &all[k];
        let (layers, n) = (&one.ready.layers, one.ready.layers.count());
        let [up, out] = [Vector3::y(), Vector3::z()].map(|axis| one.frame * axis);
        let section = self.cut(shown, &all, one, &up);
        // A closed region is filled at the cut.
        let fillings = section.fillings(&up);
        let mut surfaces = vec![
            plain(&section.rest.mesh, SKIN),
            plain(&section.lower.mesh, FLESH),
            plain(&section.bed.mesh, BED),
            plain(&section.upper.mesh, SKIN),
        ];
        let bones = section.bones.iter();
        surfaces.extend(bones.map(|(c, _)| plain(&c.mesh, colour::BONE)));
        surfaces.extend(fillings.iter().map(|(mesh, colour)| plain(mesh, *colour)));
        let mut drawing = Drawing::of(surfaces).with_lines(Lines {
            width: 1.6,
            ..Lines::new(&section.before.line, BEFORE)
        });
        for outline in section.outlines() {
            drawing = drawing.with_lines(Lines {
                width: 2.2,
                ..Lines::new(&outline.line, INK)
            });
        }
        let view = View::orthographic(-up + out * 0.18, out);
        let focus = one.done.x.iter().chain(&layers.rest[..n]).copied();
        let canvas = Canvas::new(SIZE.0, SIZE.1);
        let mut frame = render(&drawing, &Camera::fit(focus, &view, canvas));
        let title = format!("section through {}", self.which(&[k]));
        frame.title(&title, TextStyle::Title);
        frame.to_png()
    }

    /// Cuts everything near an implant at the plane through its middle, perpendicular to `up`.
    fn cut(
        &self,
        shown: &Shown,
        all: &[Single<'_>],
        one: &Single<'_>,
        up: &Vector3<f64>,
    ) -> Section {
        let (layers, n, done) = (&one.ready.layers, one.ready.layers.count(), one.done);
        let middle = middle(one);
        let halved = |mesh: &TriangleMesh| {
            let height: Vec<f64> = mesh
                .vertices
                .iter()
                .map(|p| (p.coords - middle).dot(up))
                .collect();
            cut(mesh, &[], &height)
        };
        let layer = |vertices: &[Point3<f64>]| TriangleMesh {
            vertices: vertices.to_vec(),
            triangles: layers.triangles.clone(),
        };
        let rest = part(&shown.whole, &shown.skin, |owner| {
            owner != one.region as u32
        });
        // Other implants that share its skin are cut with it.
        let shells = all.iter().filter(|o| o.region == one.region);
        Section {
            rest: halved(&rest),
            before: halved(&layer(&layers.rest[..n])),
            upper: halved(&layer(&done.x[..n])),
            lower: halved(&under(layers, &done.x)),
            bed: if self.obstacles.is_empty() {
                halved(&layers.support())
            } else {
                Cut::default()
            },
            shells: shells.map(|o| halved(&o.mesh())).collect(),
            bones: self
                .obstacles
                .iter()
                .map(oriented)
                .map(|(mesh, is_closed)| (halved(&mesh), is_closed))
                .collect(),
        }
    }
}

impl Section {
    /// The cut areas of closed bones, of the implants and of the skin, with their colours.
    fn fillings(&self, up: &Vector3<f64>) -> Vec<(TriangleMesh, Rgb)> {
        let skin_line = [self.upper.line.as_slice(), &self.lower.line].concat();
        let bones = self.bones.iter().filter(|(_, is_closed)| *is_closed);
        bones
            .map(|(c, _)| (c.line.as_slice(), MARROW))
            .chain(self.shells.iter().map(|c| (c.line.as_slice(), FILLING)))
            .chain([(skin_line.as_slice(), FLESH)])
            .map(|(line, colour)| (filled(line, &-up), colour))
            .collect()
    }

    /// Everything with an outline, in the order of drawing.
    fn outlines(&self) -> impl Iterator<Item = &Cut> {
        [&self.rest, &self.upper, &self.lower, &self.bed]
            .into_iter()
            .chain(&self.shells)
            .chain(self.bones.iter().map(|(c, _)| c))
    }
}

/// The mean of the vertices of an implant.
fn middle(one: &Single<'_>) -> Vector3<f64> {
    let shell = one.mesh().vertices;
    if shell.is_empty() {
        one.frame.translation.vector
    } else {
        shell.iter().map(|p| p.coords).sum::<Vector3<f64>>() / shell.len() as f64
    }
}

/// Triangles with the given owners.
pub(super) fn part(
    whole: &Whole,
    at: &TriangleMesh,
    is_owner: impl Fn(u32) -> bool,
) -> TriangleMesh {
    let triangles = at
        .triangles
        .iter()
        .zip(&whole.owner)
        .filter(|(_, owner)| is_owner(**owner))
        .map(|(t, _)| *t);
    TriangleMesh {
        vertices: at.vertices.clone(),
        triangles: triangles.collect(),
    }
}

fn plain(mesh: &TriangleMesh, colour: Rgb) -> Surface<'_> {
    Surface::plain(&mesh.vertices, &mesh.triangles, colour)
}

/// The lower layer with a wall to the boundary of the upper one: together with the upper layer a
/// closed surface.
pub(super) fn under(layers: &Layers, x: &[Point3<f64>]) -> TriangleMesh {
    let n = layers.count() as u32;
    let vertices = x[..2 * n as usize].to_vec();
    let topology = Topology::new(&TriangleMesh {
        vertices: vertices.clone(),
        triangles: layers.triangles.clone(),
    });
    let mut triangles: Vec<[u32; 3]> = layers
        .lower()
        .into_iter()
        .map(|[a, b, c]| [a, c, b])
        .collect();
    for e in topology.boundary_edges() {
        let [a, b] = topology.edges[e as usize];
        let t = layers.triangles[topology.triangles_of_edge(e as usize)[0] as usize];
        let forward = (0..3).any(|k| [t[k], t[(k + 1) % 3]] == [a, b]);
        let [a, b] = if forward { [a, b] } else { [b, a] };
        triangles.extend([[b, a, a + n], [b, a + n, b + n]]);
    }
    TriangleMesh {
        vertices,
        triangles,
    }
}

/// A consistently oriented surface, outward if closed, and whether it is closed.
pub(super) fn oriented(mesh: &TriangleMesh) -> (TriangleMesh, bool) {
    let (mut mesh, topology) = (mesh.clone(), Topology::new(mesh));
    let orientation = Orientation::new(&topology, &mesh.triangles);
    if orientation.one_sided.is_some() {
        return (mesh, false);
    }
    mesh.triangles
        .iter_mut()
        .zip(&orientation.turn)
        .filter(|(_, turn)| **turn)
        .for_each(|(t, _)| t.swap(1, 2));
    if mesh.volume() < 0.0 {
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    (mesh, topology.is_closed())
}
