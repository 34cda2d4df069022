//! Pictures of skin over implants: from outside, in section, and before the insertion.

use nalgebra::{Point3, Unit, UnitQuaternion, Vector3};

use super::overview::{Outlines, overview, upright};
use super::section::part;
use super::{Insertion, Picture, Shown, Single};
use pliant::contact::Surface as Rays;
use pliant::mesh::{Cut, TriangleMesh, cut};
use pliant_render::{
    Camera, Canvas, ColourMap, Drawing, Frame, Legend, Lines, PictureError, Rgb, Surface,
    TextStyle, View, colour, render,
};

/// Size of a picture [px].
pub(super) const SIZE: (u32, u32) = (720, 560);

/// Implants with a greater angle between their directions have separate pictures [degrees].
const APART: f64 = 60.0;

/// Implants with a greater distance, in their bases, have separate pictures.
const DISTANT: f64 = 4.0;

/// Least visible share of each region in a picture.
const SEEN: f64 = 0.97;

/// Approximate number of tested vertices of a region.
const TESTED: usize = 400;

/// Least upper end of the colour range, which is a round stretch.
const LEAST: f64 = 1.05;

/// Least sine of the angle between the direction of view and what is up.
const LEVEL: f64 = 0.3;

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
                "Before: outline of the base (red) and of the region (blue)".to_owned()
            } else {
                format!("Before, at {which}")
            };
            all.push(picture("before", g, caption, stage.before()?));
        }
        let ready: Vec<_> = self.implants.iter().map(|(ready, _)| ready).collect();
        if !ready.is_empty() {
            all.push(overview(self.skin, &ready, self.up)?);
        }
        Ok(all)
    }

    /// The names of some implants.
    pub(super) fn which(&self, implants: &[usize]) -> String {
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
        let mut groups: Vec<Vec<usize>> = Vec::new();
        for k in 0..each.len() {
            match groups
                .iter_mut()
                .find(|all| all.iter().all(|&i| are_near(&each[i], &each[k])))
            {
                Some(all) => all.push(k),
                None => groups.push(vec![k]),
            }
        }
        groups
            .into_iter()
            .map(|implants| Group {
                axes: axes(&each, &implants),
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
}

/// True if one picture can show two implants.
fn are_near(a: &Single<'_>, b: &Single<'_>) -> bool {
    let distance = (a.frame.translation.vector - b.frame.translation.vector).norm();
    let base = a.order.implant.base.max(b.order.implant.base);
    outward(a).angle(&outward(b)) <= APART.to_radians() && distance <= DISTANT * base
}

/// The direction of an implant out of the body.
fn outward(one: &Single<'_>) -> Vector3<f64> {
    one.frame * Vector3::z()
}

/// The axes of a group of implants: out of the body, along the skin, and perpendicular to both.
fn axes(each: &[Single<'_>], implants: &[usize]) -> [Vector3<f64>; 3] {
    let first = &each[implants[0]];
    let sum: Vector3<f64> = implants.iter().map(|k| outward(&each[*k])).sum();
    let out = sum.try_normalize(0.0).unwrap_or_else(|| outward(first));
    // At most 60 degrees from the first normal, so a part of its axis is perpendicular.
    let level = first.frame * Vector3::y();
    let up = (level - out * level.dot(&out))
        .try_normalize(0.0)
        .unwrap_or(level);
    [out, up, up.cross(&out)]
}

/// `side`, `side_2` and so on.
fn numbered(what: &str, k: usize) -> String {
    if k == 0 {
        what.to_owned()
    } else {
        format!("{what}_{}", k + 1)
    }
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
        let mut tested: Vec<Vec<Point3<f64>>> = Vec::new();
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
            let every = free.len() / TESTED + 1;
            tested.push(free.into_iter().step_by(every).collect());
        }
        let rest = part(&shown.whole, &shown.skin, |owner| {
            !regions.iter().any(|k| *k as u32 == owner)
        });
        let rays = (!rest.triangles.is_empty()).then(|| Rays::new(&rest));
        let (from, front) = free_direction(&group.axes, &tested, rays.as_ref());
        // Upright where one does not look from above or below.
        let upright = upright(insertion.skin, insertion.up);
        let ups = [upright, group.axes[0], group.axes[1]];
        let up = ups
            .into_iter()
            .find(|up| from.cross(up).norm() > LEVEL)
            .unwrap_or(group.axes[1]);
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
        let outlines = Outlines::of(self.insertion.implants.iter().map(|(ready, _)| ready));
        let [rims, bases] = outlines.lines();
        let drawing = Drawing::of([surface]).with_lines(rims).with_lines(bases);
        let mut frame = render(&drawing, &camera);
        frame.title("before: base red, region blue", TextStyle::Title);
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

/// The first direction that shows each region. If there is none, the one that shows most after the
/// removal of nearer parts. Returns also the height beyond which parts are left out [m].
fn free_direction(
    axes: &[Vector3<f64>; 3],
    tested: &[Vec<Point3<f64>>],
    rays: Option<&Rays>,
) -> (Vector3<f64>, f64) {
    let directions = directions(axes);
    let clear = directions
        .iter()
        .find(|from| visible_share(tested, from, f64::INFINITY, rays) >= SEEN);
    if let Some(from) = clear {
        return (*from, f64::INFINITY);
    }
    let mut best = (f64::NEG_INFINITY, axes[0], f64::INFINITY);
    for from in directions {
        let front = front_of(tested, &from);
        let share = visible_share(tested, &from, front, rays);
        // The first of equal directions.
        if share.total_cmp(&best.0).is_gt() {
            best = (share, from, front);
        }
    }
    (best.1, best.2)
}

/// The least visible share of the points of a region.
fn visible_share(
    regions: &[Vec<Point3<f64>>],
    from: &Vector3<f64>,
    front: f64,
    rays: Option<&Rays>,
) -> f64 {
    let share = |all: &Vec<Point3<f64>>| {
        let free = all
            .iter()
            .filter(|p| !rays.is_some_and(|r| is_hidden(p, from, front, r)))
            .count();
        free as f64 / all.len().max(1) as f64
    };
    regions.iter().map(share).fold(1.0, f64::min)
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
