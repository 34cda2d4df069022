//! Pictures of a run: bones translucent, muscles coloured by the stretch of their edges, fibres as pale
//! lines inside them.

use nalgebra::{Point3, Unit, Vector3};
use rayon::prelude::*;

use super::frames::stretch;
use super::shots::Shots;
use super::turntable::{Side, Turntable};
use crate::draft::fit::long_axis;
use pliant::mesh::measures::{Aabb, max_or_nan};
use pliant::simulation::{BodyDescription, FrameState, SceneDescription};
use pliant_render::{
    Camera, Canvas, ColourMap, Drawing, Frame, Legend, Lines, PictureError, Surface, TextStyle,
    View, colour, render, to_overlays,
};

/// Size of a picture [px].
const SIZE: (u32, u32) = (720, 640);

/// Size of a picture of the animation [px]; every pixel adds to the size of a GIF.
const SMALL: (u32, u32) = (480, 420);

/// Size of a picture of the turntable [px]: only one is visible at a time, so it is larger than
/// pictures side by side.
const TURNED: (u32, u32) = (560, 480);

/// Elevation of a view, relative to its horizontal direction: bodies look flat without it.
const RAISED: f64 = 0.15;

/// Margin around the muscles, relative to their length.
const AROUND: f64 = 0.08;

/// Least upper end of the colour scale [%]: smaller differences are noise.
const LEAST_RANGE: f64 = 0.1;

/// Share of vertices within the colour scale in the worst frame, so that a single extreme vertex
/// does not make the rest pale.
const COVERED: f64 = 0.98;

/// Muscles are long if they have this many times their width.
const LONG: f64 = 1.5;

/// Number of fibres of a muscle in a picture: more of them hide its colours.
const DRAWN: usize = 24;

/// Colour of a mark, which no colour scale has.
const MARK: colour::Rgb = [0.85, 0.1, 0.1];

/// Colour of fibres on bright muscles, where the renderer's colour is unsuitable.
const LINE: colour::Rgb = [0.95, 0.95, 0.97];

/// View and colours, equal for all pictures that are compared.
#[derive(Clone, Debug)]
pub struct Stage {
    view: View,
    /// The direction that is up, of length 1.
    up: Vector3<f64>,
    /// True if the view is from outside the bones.
    is_outside: bool,
    focus: Vec<Point3<f64>>,
    range: (f64, f64),
}

impl Stage {
    /// Creates the stage for muscles within `bounds`, with a suitable view of a cast at its first
    /// frame; the colours end at the strain `stretch`.
    pub fn new(cast: &SceneDescription, first: &FrameState, bounds: &Aabb, stretch: f64) -> Self {
        let bounds = bounds.inflate(AROUND * bounds.extents().amax());
        let most = (stretch * 100.0).max(LEAST_RANGE);
        let (view, is_outside) = view(cast, first, &bounds);
        Self {
            view,
            up: cast.up,
            is_outside,
            focus: bounds.corners().to_vec(),
            range: (0.0, most),
        }
    }

    /// The stage seen from a direction.
    pub fn from(&self, from: Vector3<f64>) -> Self {
        Self {
            view: View::orthographic(from, self.up),
            ..self.clone()
        }
    }

    /// The stage around a point, to this distance [m].
    pub fn around(&self, point: &Point3<f64>, distance: f64) -> Self {
        let near = Aabb::of_points(&[*point]).inflate(distance);
        Self {
            focus: near.corners().to_vec(),
            ..self.clone()
        }
    }

    /// The direction to the viewer.
    pub fn towards_viewer(&self) -> Vector3<f64> {
        self.view.from
    }

    /// The stage from three sides, with their names: unchanged, from the side, and from above, or
    /// from the front if the view is already from above or below.
    fn sides(&self) -> [(&'static str, Self); 3] {
        let up = self.up;
        let from = self.view.from.try_normalize(0.0).unwrap_or_else(Vector3::z);
        let level = from - up * from.dot(&up);
        // If the side is arbitrary, bodies lie along the axes; otherwise the sine of the angle to
        // the vertical decides.
        let ahead = level
            .try_normalize(1e-6)
            .filter(|_| self.is_outside)
            .unwrap_or_else(|| ahead(&up));
        let is_level = !self.is_outside || level.norm() > 0.5;
        let seen = |from: Vector3<f64>, up| Self {
            view: View::orthographic(from, up),
            ..self.clone()
        };
        // A flat body would be a line directly from the side or from above.
        let side = seen(up.cross(&ahead) + (up + ahead) * RAISED, up);
        let third = if is_level {
            ("above", seen(up + ahead * RAISED, -ahead))
        } else {
            ("the front", seen(ahead + up * RAISED, up))
        };
        [
            (
                if self.is_outside {
                    "outside"
                } else {
                    "the front"
                },
                self.clone(),
            ),
            ("the side", side),
            third,
        ]
    }

    /// Aspect ratio (height over width) of the visible region.
    pub fn aspect(&self) -> f64 {
        let camera = Camera::fit(
            self.focus.iter().copied(),
            &self.view,
            Canvas::new(1000, 1000),
        );
        let pixels: Vec<[f64; 2]> = self
            .focus
            .iter()
            .filter_map(|p| camera.pixel(p))
            .map(|(at, _)| at)
            .collect();
        let [width, height] = [0, 1].map(|k| {
            let along = || pixels.iter().map(|at| at[k]);
            along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
        });
        if width > 0.0 && height.is_finite() {
            height / width
        } else {
            1.0
        }
    }

    /// The legend of the colours.
    pub fn legend(&self) -> Legend {
        Legend::new("Mean edge stretch", "%", self.range, ColourMap::Viridis)
    }
}

/// What the colours of muscles show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shown {
    Stretch,
    Attached,
}

/// Draws all pictures of one run with the same view and colours.
#[derive(Debug)]
pub struct Painter<'a> {
    cast: &'a SceneDescription,
    stage: Stage,
    shown: Shown,
}

/// The boxes around the bones that move, in each frame that is shown.
fn moving_bones(cast: &SceneDescription, shots: &Shots) -> Vec<Aabb> {
    let mut boxes = Vec::new();
    for (b, (_, mesh)) in cast.bones.iter().enumerate() {
        let poses: Vec<_> = shots.all().filter_map(|shot| shot.bones.get(b)).collect();
        if poses.iter().all(|pose| *pose == poses[0]) {
            continue;
        }
        for pose in poses {
            let points: Vec<Point3<f64>> = mesh.vertices.iter().map(|p| pose * p).collect();
            boxes.push(Aabb::of_points(&points));
        }
    }
    boxes
}

impl<'a> Painter<'a> {
    /// A painter for these shots; `None` without any.
    pub fn new(cast: &'a SceneDescription, shots: &Shots) -> Option<Self> {
        let (first, last) = (shots.first.as_deref()?, shots.last.as_deref()?);
        let worst = shots.worst.as_ref().map_or(last, |(_, s)| s.as_ref());
        let bounds = shots
            .all()
            .flat_map(|s| &s.bodies)
            .map(|(x, _)| Aabb::of_points(x))
            .reduce(|a, b| a.union(&b))?;
        let bones = moving_bones(cast, shots).into_iter();
        let bounds = bones.fold(bounds, |a, b| a.union(&b));
        let covered = covered_stretch(cast, worst.bodies.iter().map(|(x, _)| x.as_slice()));
        Some(Self {
            cast,
            stage: Stage::new(cast, first, &bounds, covered),
            shown: Shown::Stretch,
        })
    }

    /// A painter with a given stage.
    pub fn on(cast: &'a SceneDescription, stage: &Stage) -> Self {
        Self {
            cast,
            stage: stage.clone(),
            shown: Shown::Stretch,
        }
    }

    /// The muscles from three sides, with the vertices that bones hold in another colour.
    pub fn of_attachments(&self, shot: &FrameState) -> Frame {
        let seen = self.stage.sides().map(|(name, stage)| {
            let painter = Painter {
                cast: self.cast,
                stage: Stage {
                    range: (0.0, 1.0),
                    ..stage
                },
                shown: Shown::Attached,
            };
            let mut frame = painter.paint(shot, Canvas::new(TURNED.0, TURNED.1));
            frame.title(&format!("from {name}; yellow: held"), TextStyle::Small);
            frame
        });
        Frame::beside(&seen, 2, [1.0; 3])
    }

    /// A picture for the report.
    pub fn picture(&self, shot: &FrameState) -> Frame {
        self.titled(shot, SIZE, true)
    }

    /// The pictures of an animation, and the display time of each [s].
    pub fn animation(&self, shots: &Shots) -> (Vec<Frame>, f64) {
        let pictures = shots
            .animation
            .shots
            .par_iter()
            .map(|s| self.titled(s, SMALL, false))
            .collect();
        let apart = match shots.animation.shots.as_slice() {
            [first, second, ..] => second.time - first.time,
            _ => 1.0,
        };
        (pictures, apart)
    }

    /// The frames of a run from three sides; `None` for a single frame.
    ///
    /// # Errors
    /// A picture that cannot be encoded.
    pub fn turntable(&self, shots: &Shots) -> Result<Option<Turntable>, PictureError> {
        let shown = shots.of_turntable();
        let ([first, .., last], frames) =
            (shown.as_slice(), shown.iter().map(|s| s.frame).collect())
        else {
            return Ok(None);
        };
        let mut caption = format!(
            "{} of the frames {} to {}",
            shown.len(),
            first.frame,
            last.frame
        );
        if shown.len() > last.frame - first.frame {
            caption = format!("Every frame from {} to {}", first.frame, last.frame);
        }
        let mut sides = Vec::new();
        // One side at a time: the pictures of all would need three times the memory.
        for (name, stage) in self.stage.sides() {
            let painter = Self::on(self.cast, &stage);
            let pictures: Vec<Frame> = shown
                .par_iter()
                .map(|s| painter.with_legend(s, TURNED, stage.legend()))
                .collect();
            sides.push(Side {
                name: name.to_owned(),
                pictures: to_overlays(&pictures)?,
            });
        }
        Ok(Some(Turntable {
            caption,
            frames,
            sides,
            size: [TURNED.0, TURNED.1],
        }))
    }

    fn with_legend(&self, shot: &FrameState, size: (u32, u32), legend: Legend) -> Frame {
        let mut frame = self.paint(shot, Canvas::new(size.0, size.1).with_right(legend.width()));
        legend.draw(&mut frame);
        frame
    }

    fn titled(&self, shot: &FrameState, size: (u32, u32), large: bool) -> Frame {
        let legend = if large {
            self.stage.legend().large()
        } else {
            self.stage.legend()
        };
        let mut frame = self.with_legend(shot, size, legend);
        let title = format!("frame {}", shot.frame);
        frame.title(
            &title,
            if large {
                TextStyle::Title
            } else {
                TextStyle::Small
            },
        );
        frame
    }

    /// A picture with a ring around a point; `radius` is that of the ring [px].
    pub fn marked(&self, shot: &FrameState, point: &Point3<f64>, radius: f64) -> Frame {
        let canvas = Canvas::new(SMALL.0, SMALL.1);
        let mut frame = self.paint(shot, canvas);
        if let Some((at, _)) = self.camera(canvas).pixel(point) {
            frame.ring(at, radius, MARK);
        }
        frame
    }

    fn camera(&self, canvas: Canvas) -> Camera {
        Camera::fit(self.stage.focus.iter().copied(), &self.stage.view, canvas)
    }

    /// A picture without title and legend.
    pub fn paint(&self, shot: &FrameState, canvas: Canvas) -> Frame {
        let range = self.stage.range;
        let camera = self.camera(canvas);
        let values = match self.shown {
            Shown::Stretch => stretches(self.cast, shot),
            Shown::Attached => self
                .cast
                .bodies
                .iter()
                .map(|b| b.attached.clone())
                .collect(),
        };
        let posed = |((_, mesh), pose): (
            &(String, pliant::mesh::TriangleMesh),
            &nalgebra::Isometry3<f64>,
        )| {
            mesh.vertices
                .iter()
                .map(|v| pose * v)
                .collect::<Vec<Point3<f64>>>()
        };
        let bones: Vec<Vec<Point3<f64>>> =
            self.cast.bones.iter().zip(&shot.bones).map(posed).collect();
        let surfaces = self.cast.bodies.iter().zip(&shot.bodies).zip(&values).map(
            |((actor, (x, _)), values)| {
                Surface::field(x, &actor.rest.triangles, values, range, ColourMap::Viridis)
            },
        );
        let around = self.cast.bones.iter().zip(&bones).map(|((_, mesh), x)| {
            Surface::plain(x, &mesh.triangles, colour::BONE).with_opacity(0.45)
        });
        let lines: Vec<Vec<Vec<Point3<f64>>>> = self
            .cast
            .bodies
            .iter()
            .zip(&shot.bodies)
            .map(|(actor, (x, _))| {
                let bare = actor
                    .lines
                    .iter()
                    .map(|line| line.iter().map(|&v| x[v as usize]).collect());
                // They would hide what is held.
                let fibres = match self.shown {
                    Shown::Stretch => actor.fibres.at(x),
                    Shown::Attached => Vec::new(),
                };
                let every = fibres.len().div_ceil(DRAWN).max(1);
                fibres.into_iter().step_by(every).chain(bare).collect()
            })
            .collect();
        let mut drawing = Drawing::of(surfaces.chain(around));
        for (m, (actor, lines)) in self.cast.bodies.iter().zip(&lines).enumerate() {
            let ink = if actor.lines.is_empty() {
                LINE
            } else {
                colour::MUSCLE
            };
            // Fibres are inside their muscle, the surface with the same index.
            drawing = drawing.with_lines(Lines::new(lines, ink).seen_through(m));
        }
        render(&drawing, &camera)
    }
}

/// A high quantile over the vertices of the mean absolute strain of their edges, for positions of
/// each muscle.
pub fn covered_stretch<'a>(
    cast: &SceneDescription,
    positions: impl IntoIterator<Item = &'a [Point3<f64>]>,
) -> f64 {
    let mut all: Vec<f64> = cast
        .bodies
        .iter()
        .zip(positions)
        .flat_map(|(actor, x)| stretch(actor, x))
        .collect();
    all.sort_unstable_by(f64::total_cmp);
    all.get((COVERED * all.len() as f64) as usize)
        .or(all.last())
        .copied()
        .unwrap_or(0.0)
}

/// Mean absolute strain of the edges at each vertex of each muscle [%].
fn stretches(cast: &SceneDescription, shot: &FrameState) -> Vec<Vec<f64>> {
    let percent = |(actor, (x, _)): (&BodyDescription, &(Vec<Point3<f64>>, _))| {
        stretch(actor, x).into_iter().map(|s| s * 100.0).collect()
    };
    cast.bodies.iter().zip(&shot.bodies).map(percent).collect()
}

/// The outward direction: from the bones near the muscles to the muscles, slightly from above; and
/// whether it is known or arbitrary.
fn view(cast: &SceneDescription, first: &FrameState, bounds: &Aabb) -> (View, bool) {
    let mean = |points: &[Point3<f64>]| {
        let sum: Vector3<f64> = points.iter().map(|p| p.coords).sum();
        (!points.is_empty()).then(|| sum / points.len() as f64)
    };
    let muscles: Vec<Point3<f64>> = first
        .bodies
        .iter()
        .flat_map(|(x, _)| x.iter().copied())
        .collect();
    let bones = cast
        .bones
        .iter()
        .zip(&first.bones)
        .flat_map(|((_, mesh), pose)| mesh.vertices.iter().map(move |v| pose * v));
    let bones: Vec<Point3<f64>> = bones.filter(|p| bounds.contains(p)).collect();
    let outward = mean(&muscles).zip(mean(&bones)).map(|(m, b)| m - b);
    // What is long is not seen from its end.
    let outward = outward.map(|o| match long(&muscles) {
        Some(axis) => o - axis.scale(o.dot(&axis)),
        None => o,
    });
    // If bones are on all sides, as with two plates, any side is suitable.
    let clear = outward.filter(|o| o.norm() > 0.03 * bounds.extents().amax());
    let outward = clear.and_then(|o| o.try_normalize(0.0));
    let up = cast.up;
    let aside = |ahead: Vector3<f64>| (ahead + 0.5 * up.cross(&ahead)).normalize();
    let from = outward.unwrap_or_else(|| aside(ahead(&up)));
    (
        View::orthographic(from + up * RAISED, up),
        outward.is_some(),
    )
}

/// The axis of what is long.
fn long(points: &[Point3<f64>]) -> Option<Unit<Vector3<f64>>> {
    let (middle, axis, length) = long_axis(points)?;
    let aside = points.iter().map(|p| (p - middle).cross(&axis).norm());
    (length >= LONG * 2.0 * max_or_nan(aside)).then_some(axis)
}

/// A level direction, of length 1: that of z with y up.
fn ahead(up: &Vector3<f64>) -> Vector3<f64> {
    [Vector3::x(), Vector3::y()]
        .iter()
        .find_map(|side| side.cross(up).try_normalize(0.5))
        .unwrap_or_else(Vector3::z)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stage(from: Vector3<f64>, is_outside: bool) -> Stage {
        let view = View::orthographic(from, Vector3::y());
        Stage {
            view,
            up: Vector3::y(),
            is_outside,
            focus: vec![Point3::origin(), Point3::new(1.0, 2.0, 3.0)],
            range: (0.0, 1.0),
        }
    }

    #[test]
    fn what_is_long_has_an_axis_and_what_is_wide_has_none() {
        let points = |[x, y]: [f64; 2]| -> Vec<Point3<f64>> {
            let grid = |k: i32| Point3::new(x * f64::from(k % 5), y * f64::from(k / 5), 0.0);
            (0..25).map(grid).collect()
        };
        let axis = long(&points([0.01, 0.04])).expect("a long one");
        assert!(axis.y.abs() >= 0.999, "{axis:?}");
        assert_eq!(long(&points([0.03, 0.04])), None);
        assert_eq!(long(&[]), None);
    }

    #[test]
    fn three_sides_are_nearly_at_right_angles_and_named_for_where_one_looks_from() {
        for (from, is_outside, names) in [
            (
                Vector3::new(2.0, 0.3, 1.0),
                true,
                ["outside", "the side", "above"],
            ),
            (
                Vector3::new(-1.0, -0.8, 0.0),
                true,
                ["outside", "the side", "above"],
            ),
            (
                Vector3::new(0.1, 3.0, 0.2),
                true,
                ["outside", "the side", "the front"],
            ),
            (
                Vector3::new(0.0, -2.0, 0.0),
                true,
                ["outside", "the side", "the front"],
            ),
            (
                Vector3::new(0.5, 0.15, 1.0),
                false,
                ["the front", "the side", "above"],
            ),
            (Vector3::zeros(), true, ["outside", "the side", "above"]),
        ] {
            let sides = stage(from, is_outside).sides();
            assert_eq!(sides.each_ref().map(|(name, _)| *name), names, "{from}");
            let directions = sides.map(|(_, stage)| {
                assert!(
                    (stage.focus.len(), stage.range) == (2, (0.0, 1.0)),
                    "what is shown is the same"
                );
                let camera = Camera::fit(stage.focus, &stage.view, Canvas::new(100, 100));
                (camera.towards_viewer(), camera.right_and_up()[1])
            });
            for (k, (direction, up)) in directions.iter().enumerate() {
                let is_from = match names[k] {
                    "above" => direction.y >= 0.9,
                    "outside" => direction.dot(&from) >= 0.999 * from.norm(),
                    _ => (0.0..=0.2).contains(&direction.y) && up.y >= 0.9,
                };
                assert!(is_from, "{}: {direction} {up}", names[k]);
                for (other, _) in &directions[..k] {
                    assert!(direction.dot(other).abs() <= 0.6, "{direction} {other}");
                }
            }
            // From above the front is at the bottom, as on a map.
            if names[2] == "above" {
                assert!(directions[2].1.dot(&directions[0].0) < 0.0);
            }
        }
    }
}
