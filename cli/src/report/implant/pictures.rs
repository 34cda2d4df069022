//! Pictures of skin over implants: from outside, in section, and before the insertion.

use nalgebra::{Point3, Unit, UnitQuaternion, Vector3};

use super::{Insertion, Picture, Shown, Single};
use pliant::contact::Surface as Rays;
use pliant::mesh::{Cut, Orientation, Topology, TriangleMesh, cut, filled};
use pliant::skin::{Layers, Whole};
use pliant_render::{
    Camera, Canvas, ColourMap, Drawing, Frame, Legend, Lines, PictureError, Rgb, Surface,
    TextStyle, View, colour, render,
};

/// Size of a picture [px].
const SIZE: (u32, u32) = (720, 560);

/// Implants with a greater angle between their directions have separate pictures [degrees].
const APART: f64 = 60.0;

/// Implants with a greater distance, in their bases, have separate pictures.
const DISTANT: f64 = 4.0;

/// Least visible share of each region in a picture.
const SEEN: f64 = 0.97;

/// Approximate number of tested vertices of a region.
const LOOKS: usize = 400;

/// Least upper end of the colour range, which is a round stretch.
const LEAST: f64 = 1.05;

/// Colours of skin, cut skin, the cut implant, cut bone, the original bed, lines of the section,
/// the skin before.
const SKIN: Rgb = [0.86, 0.74, 0.66];
const FLESH: Rgb = [0.84, 0.50, 0.45];
const FILLING: Rgb = [0.66, 0.78, 0.92];
const MARROW: Rgb = [0.80, 0.73, 0.58];
const BED: Rgb = [0.72, 0.52, 0.48];
const INK: Rgb = [0.16, 0.17, 0.19];
const BEFORE: Rgb = [0.30, 0.45, 0.35];

/// Colour of the limit of the stretch.
const LIMIT: Rgb = [0.88, 0.10, 0.12];

/// Implants with a common picture.
struct Group {
    implants: Vec<usize>,
    /// Axes out of the body, along the skin, and perpendicular to both.
    axes: [Vector3<f64>; 3],
}

impl Insertion<'_> {
    /// Pictures from outside with colours, in section and before, for all implants.
    pub(in crate::report) fn pictures(&self, shown: &Shown) -> Result<Vec<Picture>, PictureError> {
        let mut all = Vec::new();
        let groups = self.groups();
        for (g, group) in groups.iter().enumerate() {
            let which = self.which(&group.implants);
            let picture = |what: &str, number: usize, caption: String, bytes: Vec<u8>| Picture {
                file: format!("{}.png", numbered(what, number)),
                caption,
                bytes,
                wide: false,
            };
            let stage = Stage::new(self, shown, group);
            let (over, limit) = stage.over()?;
            let caption = format!("Skin over {which}, coloured by its greatest stretch; {limit}");
            all.push(picture("stretch", g, caption, over));
            for &k in &group.implants {
                let one = self.which(&[k]);
                let caption = format!(
                    "Section through {one}: skin, {} and what is below; green line: skin before",
                    self.under
                );
                let number = self.each()[k].number;
                all.push(picture("side", number, caption, self.section(shown, k)?));
            }
            let caption = if groups.len() == 1 {
                "Before".to_owned()
            } else {
                format!("Before, at {which}")
            };
            all.push(picture("before", g, caption, stage.before()?));
        }
        Ok(all)
    }

    /// The names of some implants.
    fn which(&self, implants: &[usize]) -> String {
        let each = self.each();
        let numbers: Vec<String> = implants
            .iter()
            .map(|k| (each[*k].number + 1).to_string())
            .collect();
        match (self.each().len(), numbers.as_slice()) {
            (1, _) => format!("the {}", self.under),
            (_, [one]) => format!("{} {one}", self.under),
            (all, some) if all == some.len() => format!("the {}s", self.under),
            (_, some) => format!("{}s {}", self.under, some.join(", ")),
        }
    }

    fn groups(&self) -> Vec<Group> {
        let each = self.each();
        let place = |k: usize| {
            let (order, frame) = (each[k].order, each[k].frame);
            (
                frame * Vector3::z(),
                frame.translation.vector,
                order.implant.base,
            )
        };
        let together = |i: usize, j: usize| {
            let ((a, p, b), (c, q, d)) = (place(i), place(j));
            a.angle(&c) <= APART.to_radians() && (p - q).norm() <= DISTANT * b.max(d)
        };
        let mut groups: Vec<Vec<usize>> = Vec::new();
        for k in 0..each.len() {
            match groups
                .iter_mut()
                .find(|all| all.iter().all(|&i| together(i, k)))
            {
                Some(all) => all.push(k),
                None => groups.push(vec![k]),
            }
        }
        let axes = |implants: &[usize]| {
            let first = each[implants[0]].frame;
            let sum: Vector3<f64> = implants.iter().map(|k| place(*k).0).sum();
            let out = sum
                .try_normalize(0.0)
                .unwrap_or_else(|| first * Vector3::z());
            // At most 60 degrees from the first normal, so a part of its axis is perpendicular.
            let level = first * Vector3::y();
            let up = (level - out * level.dot(&out))
                .try_normalize(0.0)
                .unwrap_or(level);
            [out, up, up.cross(&out)]
        };
        groups
            .into_iter()
            .map(|implants| Group {
                axes: axes(&implants),
                implants,
            })
            .collect()
    }

    /// The legend: up to the greatest visible stretch, with a mark for the limit.
    fn legend(&self, stretch: &[f64]) -> Legend {
        let most = stretch
            .iter()
            .copied()
            .filter(|s| s.is_finite())
            .fold(LEAST, f64::max);
        let step = if most <= 1.5 { 0.05 } else { 0.1 };
        // Numbers that are round up to rounding stay.
        let range = (1.0, (most / step - 1e-6).ceil() * step);
        Legend::new("Stretch", "", range, ColourMap::Viridis)
            .large()
            .with_mark(self.limit, LIMIT)
    }

    /// A section through the middle of an implant, along its frame.
    fn section(&self, shown: &Shown, k: usize) -> Result<Vec<u8>, PictureError> {
        let all = self.each();
        let one = &all[k];
        let (layers, n, done) = (&one.ready.layers, one.ready.layers.count(), one.done);
        let [up, out] = [Vector3::y(), Vector3::z()].map(|axis| one.frame * axis);
        // Other implants that share its skin are cut with it.
        let shells: Vec<TriangleMesh> = all
            .iter()
            .filter(|o| o.region == one.region)
            .map(Single::mesh)
            .collect();
        let shell = one.mesh().vertices;
        let middle = if shell.is_empty() {
            one.frame.translation.vector
        } else {
            shell.iter().map(|p| p.coords).sum::<Vector3<f64>>() / shell.len() as f64
        };
        let halved = |mesh: &TriangleMesh| {
            let height: Vec<f64> = mesh
                .vertices
                .iter()
                .map(|p| (p.coords - middle).dot(&up))
                .collect();
            cut(mesh, &[], &height)
        };
        let rest = part(&shown.whole, &shown.skin, |owner| {
            owner != one.region as u32
        });
        let before = TriangleMesh {
            vertices: layers.rest[..n].to_vec(),
            triangles: layers.triangles.clone(),
        };
        let upper = TriangleMesh {
            vertices: done.x[..n].to_vec(),
            triangles: layers.triangles.clone(),
        };
        let upper = halved(&upper);
        let lower = halved(&under(layers, &done.x));
        // The bed of the implant, seen from its top: the bone, or else the original surface below
        // the lower layer.
        let bed = if self.obstacles.is_empty() {
            halved(&layers.support())
        } else {
            Cut::default()
        };
        let [rest, before] = [rest, before].map(|mesh| halved(&mesh));
        // Only the cut of the implant is drawn: the rest is under the skin, or slightly inside the
        // bed.
        let inside: Vec<Cut> = shells.iter().map(halved).collect();
        let bones: Vec<(Cut, bool)> = self
            .obstacles
            .iter()
            .map(oriented)
            .map(|(mesh, closed)| (halved(&mesh), closed))
            .collect();
        let mut surfaces = vec![
            plain(&rest.mesh, SKIN),
            plain(&lower.mesh, FLESH),
            plain(&bed.mesh, BED),
            plain(&upper.mesh, SKIN),
        ];
        surfaces.extend(bones.iter().map(|(c, _)| plain(&c.mesh, colour::BONE)));
        // A closed region is filled at the cut.
        let skin_line = [upper.line.as_slice(), &lower.line].concat();
        let closed = bones
            .iter()
            .filter(|(_, closed)| *closed)
            .map(|(c, _)| (c.line.as_slice(), MARROW));
        let shells = inside.iter().map(|shell| (&shell.line[..], FILLING));
        let closed = closed.chain(shells).chain([(&skin_line[..], FLESH)]);
        let fillings: Vec<(TriangleMesh, Rgb)> = closed
            .map(|(line, colour)| (filled(line, &-up), colour))
            .collect();
        surfaces.extend(fillings.iter().map(|(mesh, colour)| plain(mesh, *colour)));
        let mut drawing = Drawing::of(surfaces).with_lines(Lines {
            width: 1.6,
            ..Lines::new(&before.line, BEFORE)
        });
        let outlines = [&rest, &upper, &lower, &bed]
            .into_iter()
            .chain(&inside)
            .chain(bones.iter().map(|(c, _)| c));
        for outline in outlines {
            drawing = drawing.with_lines(Lines {
                width: 2.2,
                ..Lines::new(&outline.line, INK)
            });
        }
        let view = View::orthographic(-up + out * 0.18, out);
        let focus = done.x.iter().chain(&layers.rest[..n]).copied();
        let mut frame = render(
            &drawing,
            &Camera::fit(focus, &view, Canvas::new(SIZE.0, SIZE.1)),
        );
        frame.title(
            &format!("section through {}", self.which(&[k])),
            TextStyle::Title,
        );
        frame.to_png()
    }
}

/// `side`, `side_2` and so on.
fn numbered(what: &str, k: usize) -> String {
    if k == 0 {
        what.to_owned()
    } else {
        format!("{what}_{}", k + 1)
    }
}

/// Triangles with the given owners.
fn part(whole: &Whole, at: &TriangleMesh, wanted: impl Fn(u32) -> bool) -> TriangleMesh {
    let triangles = at
        .triangles
        .iter()
        .zip(&whole.owner)
        .filter(|(_, owner)| wanted(**owner))
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
fn under(layers: &Layers, x: &[Point3<f64>]) -> TriangleMesh {
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
fn oriented(mesh: &TriangleMesh) -> (TriangleMesh, bool) {
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

/// The view of a group of implants, and the visible skin.
struct Stage<'a> {
    insertion: &'a Insertion<'a>,
    shown: &'a Shown,
    group: &'a Group,
    view: View,
    /// Height along the line of sight beyond which nearer parts are left out [m].
    front: f64,
    focus: Vec<Point3<f64>>,
}

impl<'a> Stage<'a> {
    fn new(insertion: &'a Insertion<'a>, shown: &'a Shown, group: &'a Group) -> Self {
        let mut focus = Vec::new();
        let mut looked = Vec::new();
        let all = insertion.each();
        let mut regions: Vec<usize> = group.implants.iter().map(|&k| all[k].region).collect();
        regions.sort_unstable();
        regions.dedup();
        for (ready, done) in regions.iter().map(|&k| &insertion.implants[k]) {
            let n = ready.layers.count();
            focus.extend(done.x[..n].iter().chain(&ready.layers.rest[n..]).copied());
            let free: Vec<Point3<f64>> = (0..n)
                .filter(|v| !ready.layers.held[*v])
                .map(|v| done.x[v])
                .collect();
            looked.push(
                free.iter()
                    .copied()
                    .step_by(free.len() / LOOKS + 1)
                    .collect::<Vec<_>>(),
            );
        }
        let rest = part(&shown.whole, &shown.skin, |owner| {
            !regions.iter().any(|k| *k as u32 == owner)
        });
        let rays = (!rest.triangles.is_empty()).then(|| Rays::new(&rest));
        let free = |from: &Vector3<f64>, front: f64| {
            let seen = |all: &Vec<Point3<f64>>| {
                let free = all
                    .iter()
                    .filter(|p| !rays.as_ref().is_some_and(|r| is_hidden(p, from, front, r)))
                    .count();
                free as f64 / all.len().max(1) as f64
            };
            looked.iter().map(seen).fold(1.0, f64::min)
        };
        let ways = directions(&group.axes);
        // Parts are only removed if no direction is free.
        let clear = ways
            .iter()
            .find(|from| free(from, f64::INFINITY) >= SEEN)
            .map(|from| (*from, f64::INFINITY));
        let opened = || {
            let fronts = ways.iter().map(|from| (*from, front_of(&looked, from)));
            let seen: Vec<_> = fronts
                .map(|(from, front)| (free(&from, front), from, front))
                .collect();
            // The first of equal directions.
            let best = seen.into_iter().rev().max_by(|a, b| a.0.total_cmp(&b.0));
            best.map_or((group.axes[0], f64::INFINITY), |(_, from, front)| {
                (from, front)
            })
        };
        let (from, front) = clear.unwrap_or_else(opened);
        let up = if from.cross(&group.axes[0]).norm() > 0.1 {
            group.axes[0]
        } else {
            group.axes[1]
        };
        Self {
            insertion,
            shown,
            group,
            view: View::orthographic(from, up),
            front,
            focus,
        }
    }

    /// A surface without the parts in front of all regions.
    fn open(&self, mesh: &TriangleMesh, values: &[f64]) -> Cut {
        if self.front == f64::INFINITY {
            return Cut {
                mesh: mesh.clone(),
                values: values.to_vec(),
                line: Vec::new(),
            };
        }
        let from = self.view.from;
        let height: Vec<f64> = mesh
            .vertices
            .iter()
            .map(|p| self.front - p.coords.dot(&from))
            .collect();
        cut(mesh, values, &height)
    }

    fn shot(
        &self,
        drawing: &Drawing,
        title: &str,
        legend: Option<&Legend>,
    ) -> Result<Vec<u8>, PictureError> {
        let canvas = Canvas::new(SIZE.0, SIZE.1).with_right(legend.map_or(0.0, Legend::width));
        let mut frame: Frame = render(
            drawing,
            &Camera::fit(self.focus.iter().copied(), &self.view, canvas),
        );
        if let Some(legend) = legend {
            legend.draw(&mut frame);
        }
        frame.title(title, TextStyle::Title);
        frame.to_png()
    }

    /// The picture of the skin over the implants, with a text about the limit of its stretch.
    fn over(&self) -> Result<(Vec<u8>, String), PictureError> {
        let limit = self.insertion.limit;
        let legend = self.insertion.legend(&self.shown.stretch);
        let skin = self.open(&self.shown.skin, &self.shown.stretch);
        let beyond: Vec<f64> = skin.values.iter().map(|s| s - limit).collect();
        let outline = cut(&skin.mesh, &skin.values, &beyond).line;
        let surface = Surface::field(
            &skin.mesh.vertices,
            &skin.mesh.triangles,
            &skin.values,
            legend.range,
            legend.map,
        );
        let lines = Lines {
            width: 2.4,
            lift: 3.0,
            ..Lines::new(&outline, LIMIT)
        };
        let said = if outline.is_empty() {
            format!("nowhere more than the limit of {limit:.2}")
        } else {
            format!("more than the limit of {limit:.2} within the red line")
        };
        let title = format!("over {}", self.insertion.which(&self.group.implants));
        Ok((
            self.shot(
                &Drawing::of([surface]).with_lines(lines),
                &title,
                Some(&legend),
            )?,
            said,
        ))
    }

    /// The picture of the skin before, with the same view.
    fn before(&self) -> Result<Vec<u8>, PictureError> {
        let skin = self.open(&self.shown.whole.mesh, &[]);
        let surface = Surface::plain(&skin.mesh.vertices, &skin.mesh.triangles, colour::BONE);
        let legend = self.insertion.legend(&self.shown.stretch);
        // As wide as with a legend, so that both pictures match.
        let canvas = Canvas::new(SIZE.0, SIZE.1).with_right(legend.width());
        let camera = Camera::fit(self.focus.iter().copied(), &self.view, canvas);
        let mut frame = render(&Drawing::of([surface]), &camera);
        frame.title("before", TextStyle::Title);
        frame.to_png()
    }
}

/// View directions, the most suitable first: obliquely from all sides, then steeper.
fn directions([out, up, right]: &[Vector3<f64>; 3]) -> Vec<Vector3<f64>> {
    let about = Unit::new_normalize(*out);
    let mut all = Vec::new();
    for tilt in [1.0, 0.5] {
        let first = out * 0.7 + (right * 0.25 - up * 0.6) * tilt;
        let turns = [0.0, 45.0, -45.0, 90.0, -90.0, 135.0, -135.0, 180.0f64];
        all.extend(turns.map(|t| {
            (UnitQuaternion::from_axis_angle(&about, t.to_radians()) * first).normalize()
        }));
    }
    all.push(*out);
    all
}

/// Depth of the nearest of some points, with a margin [m].
fn front_of(points: &[Vec<Point3<f64>>], from: &Vector3<f64>) -> f64 {
    let heights = || points.iter().flatten().map(|p| p.coords.dot(from));
    let (low, high) = heights().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), h| {
        (a.min(h), b.max(h))
    });
    high + 0.02 * (high - low)
}

/// True if other skin is in front of a point, unless it is so near to the viewer that it is left
/// out.
fn is_hidden(p: &Point3<f64>, from: &Vector3<f64>, front: f64, rays: &Rays) -> bool {
    rays.first_hit(p, from).is_some_and(|(t, w)| {
        let corners = rays.triangles()[t as usize].map(|v| rays.positions()[v as usize].coords);
        (corners[0] * w[0] + corners[1] * w[1] + corners[2] * w[2]).dot(from) <= front
    })
}

#[cfg(test)]
mod tests;
