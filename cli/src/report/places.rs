//! Pictures of the places where checks failed: the whole scene and the surroundings, from a side from
//! which the place is visible.

use nalgebra::{Point3, Vector3};

use super::output::{Picture, Spot, Verdict};
use super::pictures::{Painter, Stage, covered_stretch};
use pliant::contact::Surface;
use pliant::mesh::TriangleMesh;
use pliant::mesh::measures::Aabb;
use pliant::simulation::{FrameState, SceneDescription};
use pliant_render::{Frame, PictureError, TextStyle};

/// Beginning of the names of files.
const FILE: &str = "place-";

/// True for the file of such a picture, whose number depends on the run.
pub fn is_picture(file: &str) -> bool {
    file.starts_with(FILE) && file.ends_with(".png")
}

/// Greatest number of pictures of a run.
const MOST: usize = 8;

/// Distance that a close picture shows around the place, relative to the longest side of the bodies:
/// 3 cm of a muscle of 30 cm.
const NEAR: f64 = 0.1;

/// Radius of the ring in the picture of the whole scene and in the close one [px].
const RINGS: [f64; 2] = [14.0, 26.0];

/// Distance from the surface at which it counts as left, relative to the longest side of the bodies.
const LEFT: f64 = 1e-3;

/// The pictures of the places of failed checks, and a note on those left out. `read` returns a frame
/// that was written, if it can still be read.
///
/// # Errors
/// A picture that cannot be encoded.
pub fn pictures(
    cast: &SceneDescription,
    verdicts: &[Verdict],
    read: impl Fn(usize) -> Option<FrameState>,
) -> Result<(Vec<Picture>, Option<String>), PictureError> {
    let mut spots: Vec<(Spot, Vec<String>)> = Vec::new();
    for verdict in verdicts.iter().filter(|verdict| !verdict.passed) {
        let is_finite = |spot: &Spot| spot.point_m.iter().all(|c| c.is_finite());
        let Some(spot) = verdict.spot.filter(is_finite) else {
            continue;
        };
        match spots.iter_mut().find(|(known, _)| *known == spot) {
            Some((_, names)) => names.push(verdict.to_text()),
            None => spots.push((spot, vec![verdict.to_text()])),
        }
    }
    let mut pictures = Vec::new();
    for (spot, names) in spots.iter().take(MOST) {
        let Some(shot) = read(spot.frame) else {
            continue;
        };
        let Some(frame) = picture(cast, &shot, spot) else {
            continue;
        };
        pictures.push(Picture {
            file: format!("{FILE}{}.png", pictures.len() + 1),
            caption: names.join("; "),
            bytes: frame.to_png()?,
            wide: false,
        });
    }
    let missing = spots.len() - pictures.len();
    let note = (missing > 0).then(|| {
        let shown = pictures.len();
        format!(
            "of {} places of failed checks {shown} have a picture; `at` has all",
            spots.len()
        )
    });
    Ok((pictures, note))
}

/// The place in the whole scene and with its surroundings; `None` without a body.
fn picture(cast: &SceneDescription, shot: &FrameState, spot: &Spot) -> Option<Frame> {
    let point = Point3::from(spot.point_m);
    let boxes = shot.bodies.iter().filter(|(x, _)| !x.is_empty());
    let bounds = boxes
        .map(|(x, _)| Aabb::of_points(x))
        .reduce(|a, b| a.union(&b))?;
    let size = bounds.extents().amax();
    let stretch = covered_stretch(cast, shot.bodies.iter().map(|(x, _)| x.as_slice()));
    let stage = Stage::new(cast, shot, &bounds, stretch);
    let from = clearest(cast, shot, &point, &stage.towards_viewer(), LEFT * size);
    let whole = stage.from(from);
    let near = whole.around(&point, NEAR * size);
    let [mut whole, near] = [(whole, RINGS[0]), (near, RINGS[1])]
        .map(|(stage, radius)| Painter::on(cast, &stage).marked(shot, &point, radius));
    whole.title(&format!("frame {}", spot.frame), TextStyle::Small);
    Some(Frame::beside(&[whole, near], 2, [1.0; 3]))
}

/// The direction from which the fewest surfaces hide a point; of equal ones that nearest to `usual`.
/// Bodies hide more than bones, which are translucent.
fn clearest(
    cast: &SceneDescription,
    shot: &FrameState,
    point: &Point3<f64>,
    usual: &Vector3<f64>,
    left: f64,
) -> Vector3<f64> {
    let bodies = cast.bodies.iter().zip(&shot.bodies);
    let bodies = bodies.map(|(body, (x, _))| (x.clone(), &body.rest.triangles, 2));
    let bones = cast.bones.iter().zip(&shot.bones);
    let bones = bones.map(|((_, mesh), pose)| {
        let x = mesh.vertices.iter().map(|p| pose * p).collect();
        (x, &mesh.triangles, 1)
    });
    let is_usable = |(x, triangles, _): &(Vec<Point3<f64>>, &Vec<[u32; 3]>, usize)| {
        !triangles.is_empty() && x.iter().all(|p| p.iter().all(|c| c.is_finite()))
    };
    let surfaces: Vec<(Surface, usize)> = (bodies.chain(bones).filter(is_usable))
        .map(|(vertices, triangles, weight)| {
            let triangles = triangles.clone();
            (
                Surface::new(&TriangleMesh {
                    vertices,
                    triangles,
                }),
                weight,
            )
        })
        .collect();
    let usual = usual.try_normalize(0.0).unwrap_or_else(Vector3::z);
    let steps = [-1.0, 0.0, 1.0];
    let all = steps
        .iter()
        .flat_map(|x| steps.iter().map(move |y| (*x, *y)));
    let all = all.flat_map(|(x, y)| steps.iter().map(move |z| Vector3::new(x, y, *z)));
    let each = [usual]
        .into_iter()
        .chain(all.filter_map(|d| d.try_normalize(0.5)));
    let hidden = |from: &Vector3<f64>| -> usize {
        let start = point + from * left;
        let hits = surfaces
            .iter()
            .filter(|(surface, _)| surface.first_hit(&start, from).is_some());
        hits.map(|(_, weight)| weight).sum()
    };
    let rated = each.map(|from| (hidden(&from), -from.dot(&usual), from));
    let best = rated.min_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    best.map_or(usual, |(_, _, from)| from)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pliant::scene::builtin::load;
    use pliant::simulation::{Scenario, Simulation};

    fn red(frame: usize, point_m: [f64; 3]) -> Verdict {
        let verdict = Verdict::at_most("fold", 70.0, 60.0);
        verdict.seen(Some(Spot { frame, point_m }))
    }

    #[test]
    fn each_failed_place_has_one_picture_and_passed_checks_have_none() {
        let simulation = Simulation::new(load("cube", &[]).expect("a scene")).expect("a scene");
        let (cast, state) = (simulation.description(), simulation.state());
        let corner = state.bodies[0].0[0].into();
        let mut green = red(0, corner);
        green.passed = true;
        let twice = [red(0, corner), green, red(0, corner)];
        let read = |frame| (frame == 0).then(|| state.clone());
        let (found, note) = pictures(&cast, &twice, read).expect("pictures");
        assert_eq!((found.len(), note), (1, None));
        assert!(found[0].caption.matches("fold").count() == 2);
        // A frame that cannot be read and a point that is no number have none.
        let lost = [red(7, corner), red(0, [f64::NAN, 0.0, 0.0])];
        let (found, note) = pictures(&cast, &lost, read).expect("pictures");
        assert!(found.is_empty() && note.is_some_and(|note| note.starts_with("of 1 places")));
        let many: Vec<Verdict> = (0..11).map(|k| red(0, [f64::from(k) * 1e-3; 3])).collect();
        let (found, note) = pictures(&cast, &many, read).expect("pictures");
        assert_eq!(found.len(), MOST);
        assert!(note.is_some_and(|note| note.starts_with("of 11 places")));
    }

    #[test]
    fn a_place_is_seen_from_where_nothing_hides_it() {
        let simulation = Simulation::new(load("cube", &[]).expect("a scene")).expect("a scene");
        let (cast, mut state) = (simulation.description(), simulation.state());
        let x = &state.bodies[0].0;
        let bounds = Aabb::of_points(x);
        let top = x.iter().copied().max_by(|a, b| a.y.total_cmp(&b.y));
        let mut top = top.expect("a vertex");
        (top.x, top.z) = (bounds.center().x, bounds.center().z);
        let from = |state: &FrameState, usual: Vector3<f64>| {
            clearest(&cast, state, &top, &usual, 1e-3 * bounds.extents().amax())
        };
        let above = from(&state, Vector3::y());
        assert!(
            above.y >= 0.0 && above.y < 0.99,
            "the ball hides it from above: {above}"
        );
        let below = from(&state, -Vector3::y());
        assert!(below.y >= 0.0, "the cube hides its top from below: {below}");
        state.bones[0].translation.vector.x += 1.0;
        assert_eq!(
            from(&state, Vector3::y()),
            Vector3::y(),
            "control: nothing is above"
        );
    }
}
