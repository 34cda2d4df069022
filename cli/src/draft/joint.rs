//! The joint of a scene: which bones it turns, and its centre, axis and sense, from the shapes of two bones.

use nalgebra::{Point3, Unit, Vector3};

use super::fit::{self, Fit, long_axis, widest};
use super::names::{self, known_bone};
use super::patella::{Knee, Path};
use pliant::contact::Surface;
use pliant::mesh::TriangleMesh;
use pliant::mesh::measures::max_or_nan;

/// A joint that names tell.
#[derive(Debug)]
pub struct KnownJoint {
    /// Its name.
    pub name: &'static str,
    /// The motion of a positive angle, and its range [deg]: 60, or less where a joint has less.
    pub motion: &'static str,
    pub degrees: u32,
    /// Bones that rest, and bones that turn, by their names in [`names::BONES`]: each has one at least.
    rests: &'static [&'static str],
    turns: &'static [&'static str],
    /// Bones that turn with these.
    along: &'static [&'static str],
    shape: Shape,
}

/// The shape of the surfaces of a joint.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Shape {
    /// A head of the bone that turns, in a socket.
    Ball,
    /// A roller of the bone that rests, or of the one that turns. The middle of its condyles is at this
    /// angle from the end of the shaft to the side to which the roller stands out [deg].
    Hinge { of_resting: bool, middle: f64 },
}

/// The joints.
pub const JOINTS: [KnownJoint; 5] = [
    KnownJoint {
        name: "hip",
        motion: "flexion",
        degrees: 60,
        rests: &["hip bone"],
        turns: &["femur"],
        along: &["patella", "tibia", "fibula", "talus", "calcaneus", "foot"],
        shape: Shape::Ball,
    },
    KnownJoint {
        name: "knee",
        motion: "flexion",
        degrees: 60,
        rests: &["femur"],
        turns: &["tibia"],
        along: &["patella", "fibula", "talus", "calcaneus", "foot"],
        shape: Shape::Hinge {
            of_resting: true,
            middle: 60.0,
        },
    },
    KnownJoint {
        name: "ankle",
        motion: "dorsiflexion",
        degrees: 20,
        rests: &["tibia", "fibula"],
        turns: &["talus", "foot", "calcaneus"],
        along: &[],
        shape: Shape::Hinge {
            of_resting: false,
            middle: 180.0,
        },
    },
    KnownJoint {
        name: "shoulder",
        motion: "abduction",
        degrees: 60,
        rests: &["scapula"],
        turns: &["humerus"],
        along: &["radius", "ulna", "hand"],
        shape: Shape::Ball,
    },
    KnownJoint {
        name: "elbow",
        motion: "flexion",
        degrees: 60,
        rests: &["humerus"],
        turns: &["ulna", "radius"],
        along: &["hand"],
        shape: Shape::Hinge {
            of_resting: true,
            middle: 0.0,
        },
    },
];

/// A bone with its name.
pub struct NamedBone<'a> {
    pub name: &'a str,
    pub mesh: &'a TriangleMesh,
    pub surface: &'a Surface,
}

impl NamedBone<'_> {
    fn is(&self, known: &[&str]) -> bool {
        known_bone(self.name).is_some_and(|bone| known.contains(&bone.name))
    }
}

/// A joint between the bones of a scene.
#[derive(Debug)]
pub struct Joint {
    pub known: &'static KnownJoint,
    /// Indices of the bones between which it lies: one that rests, and one that turns.
    pub between: [usize; 2],
    /// Indices of all bones that turn.
    pub turns: Vec<usize>,
    pub fit: Fit,
    /// The axis; a positive angle about it is the motion of the joint.
    pub axis: Unit<Vector3<f64>>,
    /// What the sense of the axis comes from.
    pub sense: &'static str,
    /// Along the bone from which the other one hangs, or that hangs from it.
    pub up: Unit<Vector3<f64>>,
    /// Bones among those that turn which glide on a path of their own.
    pub glides: Vec<(usize, Path)>,
}

impl Joint {
    /// The fit, and the bones from which it comes, in words.
    pub fn fit_in_words(&self, [rests, turns]: [&str; 2]) -> String {
        let mm = |length: &f64| format!("{:.1}", 1e3 * length);
        let radius: Vec<String> = self.fit.radius.iter().map(mm).collect();
        let (count, misfit) = (self.fit.count, mm(&self.fit.misfit));
        match self.fit.axis {
            None => format!(
                "a sphere of radius {} mm fits {count} vertices of {turns} that face {rests}, to {misfit} mm RMS",
                radius.join(" and ")
            ),
            Some(_) => format!(
                "between condyles of radius {} mm, of {count} vertices between {rests} and {turns}, to {misfit} mm (median)",
                radius.join(" and ")
            ),
        }
    }
}

impl Joint {
    /// The path of a patella, with points that it carries [m]; `None` where the shapes tell none. `mesh` gives
    /// that of each bone, `resting` is the surface of the femur.
    pub fn glide<'a>(
        &self,
        patella: usize,
        mesh: &dyn Fn(usize) -> &'a TriangleMesh,
        resting: &Surface,
        carried: &[Point3<f64>],
    ) -> Option<(usize, Path)> {
        let [femur, tibia] = self.between.map(mesh);
        let knee = Knee {
            femur,
            surface: resting,
            tibia,
            patella: mesh(patella),
            carried,
            centre: self.fit.centre,
            axis: self.axis,
            up: self.up,
        };
        Some((patella, knee.path()?))
    }
}

/// Why no joint was found.
#[derive(Debug, thiserror::Error)]
pub enum NoJoint {
    #[error("{joint}: no {} among {}", .needs.join(" or "), names_of(.bones))]
    MissingBone {
        joint: &'static str,
        needs: &'static [&'static str],
        bones: Vec<String>,
    },
    #[error("{joint}: no {what} fits the surfaces of {} and {} that face each other", .between[0], .between[1])]
    NoFit {
        joint: &'static str,
        what: &'static str,
        between: [String; 2],
    },
    #[error("{joint}: the side to which {bone} bends does not follow from its shape")]
    NoSense { joint: &'static str, bone: String },
}

fn names_of(bones: &[String]) -> String {
    match bones {
        [] => "no bones".to_owned(),
        some => some.join(", "),
    }
}

/// The joint of this name.
pub fn known(name: &str) -> Option<&'static KnownJoint> {
    JOINTS
        .iter()
        .find(|joint| joint.name.eq_ignore_ascii_case(name))
}

impl KnownJoint {
    /// The first bones between which it lies; `chosen` are those that a user names, in any order.
    fn bones(
        &'static self,
        bones: &[NamedBone<'_>],
        chosen: Option<[usize; 2]>,
    ) -> Result<[usize; 2], NoJoint> {
        if let Some([a, b]) = chosen {
            let is_turned = bones[a].is(self.turns) || bones[b].is(self.rests);
            return Ok(if is_turned { [b, a] } else { [a, b] });
        }
        let first = |of: &'static [&'static str]| {
            let of_kind = |kind: &&str| bones.iter().position(|bone| bone.is(&[kind]));
            of.iter()
                .find_map(of_kind)
                .ok_or_else(|| NoJoint::MissingBone {
                    joint: self.name,
                    needs: of,
                    bones: bones.iter().map(|bone| bone.name.to_owned()).collect(),
                })
        };
        Ok([first(self.rests)?, first(self.turns)?])
    }

    /// Whether its bones are among these.
    pub fn is_among(&'static self, bones: &[NamedBone<'_>]) -> bool {
        self.bones(bones, None).is_ok()
    }

    /// The joint between these bones, or between the two `chosen`.
    ///
    /// # Errors
    /// A bone is missing, or no sphere or axis fits.
    pub fn fit(
        &'static self,
        bones: &[NamedBone<'_>],
        chosen: Option<[usize; 2]>,
    ) -> Result<Joint, NoJoint> {
        let between = self.bones(bones, chosen)?;
        let [rests, turns] = between;
        let no_fit = |what| NoJoint::NoFit {
            joint: self.name,
            what,
            between: between.map(|b| bones[b].name.to_owned()),
        };
        let (fit, up) = match self.shape {
            Shape::Ball => {
                let sockets = surfaces_of(bones, self.rests, [rests, turns]);
                let fit = fit::ball(bones[turns].mesh, &sockets);
                let fit = fit.ok_or_else(|| no_fit("sphere"))?;
                let shaft = long_axis(&bones[turns].mesh.vertices);
                let (middle, axis, _) = shaft.ok_or_else(|| no_fit("sphere"))?;
                // From the bone to its head.
                (fit.clone(), toward(axis, fit.centre - middle))
            }
            Shape::Hinge {
                of_resting,
                middle: from_below,
            } => {
                let shaft = long_axis(&bones[rests].mesh.vertices);
                let (middle, axis, _) = shaft.ok_or_else(|| no_fit("axis"))?;
                let far = bones[turns].mesh.bounding_box().center();
                let up = toward(axis, middle - far);
                let (roller, others) = match of_resting {
                    true => (rests, surfaces_of(bones, self.turns, [turns, rests])),
                    false => (turns, surfaces_of(bones, self.rests, [rests, turns])),
                };
                let found = fit::hinge(bones[roller].mesh, &others, &up, from_below.to_radians());
                (found.ok_or_else(|| no_fit("axis"))?, up)
            }
        };
        let (axis, sense) =
            self.axis(bones, between, &fit, &up)
                .ok_or_else(|| NoJoint::NoSense {
                    joint: self.name,
                    bone: bones[turns].name.to_owned(),
                })?;
        let turning = (0..bones.len()).filter(|&b| self.moves(bones, b, between));
        let turns: Vec<usize> = turning.collect();
        let is_knee = bones[rests].is(&["femur"]) && bones[between[1]].is(&["tibia"]);
        let patellae: Vec<usize> = turns
            .iter()
            .copied()
            .filter(|&b| is_knee && bones[b].is(&["patella"]))
            .collect();
        let mut joint = Joint {
            known: self,
            between,
            turns,
            fit,
            axis,
            sense,
            up,
            glides: Vec::new(),
        };
        let mesh = |b: usize| bones[b].mesh;
        let glides = patellae
            .iter()
            .filter_map(|&b| joint.glide(b, &mesh, bones[rests].surface, &[]));
        joint.glides = glides.collect();
        Ok(joint)
    }

    /// Whether the joint between two bones turns a bone.
    fn moves(&self, bones: &[NamedBone<'_>], b: usize, [rests, turns]: [usize; 2]) -> bool {
        b == turns || (b != rests && (bones[b].is(self.turns) || bones[b].is(self.along)))
    }

    /// The axis in the sense of the motion, and what that comes from. `up` points along the shaft, away
    /// from what hangs down from it.
    fn axis(
        &self,
        bones: &[NamedBone<'_>],
        [rests, turns]: [usize; 2],
        fit: &Fit,
        up: &Unit<Vector3<f64>>,
    ) -> Option<(Unit<Vector3<f64>>, &'static str)> {
        let down = -up.into_inner();
        // Turns what hangs down to this side.
        let to_side = |side: Vector3<f64>| Unit::try_new(down.cross(&side), 0.0);
        let own = |side: Vector3<f64>| {
            let (axis, _) = fit.axis?;
            let wanted = down.cross(&side).dot(&axis);
            (wanted != 0.0).then(|| if wanted > 0.0 { axis } else { -axis })
        };
        match self.name {
            "hip" => {
                let (back, is_told) = back_of_femur(&bones[turns], fit, up)?;
                let from = if is_told {
                    "the neck of the femur, and the side in its name"
                } else {
                    "the condyles of the femur stand out to the back"
                };
                Some((to_side(-back)?, from))
            }
            "knee" => {
                let (_, back) = fit.axis?;
                Some((
                    own(back)?,
                    "the condyles of the femur stand out to the back",
                ))
            }
            "elbow" => {
                let back = olecranon(bones, [rests, turns], fit, up)?;
                Some((own(-back)?, "the olecranon is at the back"))
            }
            "ankle" => {
                // The greater part of the foot lies in front of the ankle; it moves up.
                let middle = bones[turns].mesh.centroid()?;
                let front = middle - fit.centre;
                let (axis, _) = fit.axis?;
                let rises = axis.cross(&front).dot(up);
                let axis = if rises > 0.0 { axis } else { -axis };
                Some((axis, "the foot lies in front of the ankle"))
            }
            _ => {
                // The arm moves away from the body of the scapula, in its plane.
                let middle = bones[rests].mesh.centroid()?;
                let out = fit.centre - middle;
                Some((
                    to_side(out)?,
                    "the arm moves away from the scapula, in its plane",
                ))
            }
        }
    }
}

/// The surfaces of all bones of a side, which has these names, of a bone of it, and without the bone on the
/// other side.
fn surfaces_of<'a>(
    bones: &[NamedBone<'a>],
    side: &[&str],
    [own, other]: [usize; 2],
) -> Vec<&'a Surface> {
    let of_side = |b: &usize| *b == own || (*b != other && bones[*b].is(side));
    let all = (0..bones.len()).filter(of_side);
    all.map(|b| bones[b].surface).collect()
}

/// An axis in the sense of a vector.
fn toward(axis: Unit<Vector3<f64>>, along: Vector3<f64>) -> Unit<Vector3<f64>> {
    if axis.dot(&along) < 0.0 { -axis } else { axis }
}

/// Share of the length of a femur that has its condyles.
const CONDYLES: f64 = 0.1;

/// Least ratio of what stands out to the back of a femur to what stands out to the front.
const STANDS_OUT: f64 = 1.3;

/// The direction to the back of a femur, and whether it comes from its name: that of a femur without
/// condyles does.
fn back_of_femur(
    femur: &NamedBone<'_>,
    fit: &Fit,
    up: &Unit<Vector3<f64>>,
) -> Option<(Vector3<f64>, bool)> {
    let (middle, _, length) = long_axis(&femur.mesh.vertices)?;
    let height = |v: &Point3<f64>| (v - middle).dot(up);
    let lowest = -max_or_nan(femur.mesh.vertices.iter().map(|v| -height(v)));
    let low: Vec<Vector3<f64>> = femur
        .mesh
        .vertices
        .iter()
        .filter(|v| height(v) <= lowest + CONDYLES * length)
        .map(|v| v - middle)
        .collect();
    let count = low.len() as f64;
    let centre: Vector3<f64> = low.iter().sum::<Vector3<f64>>() / count;
    let wide = widest(low.iter().map(|d| d - centre), up)?;
    let across = up.cross(&wide);
    let out = |sign: f64| max_or_nan(low.iter().map(|d| sign * d.dot(&across)));
    let (one, other) = (out(1.0), out(-1.0));
    if one >= STANDS_OUT * other || other >= STANDS_OUT * one {
        return Some((if one > other { across } else { -across }, false));
    }
    let is_right = names::is_right(femur.name)?;
    let neck = middle - fit.centre;
    let lateral = neck - up.scale(neck.dot(up));
    let front = up.cross(&lateral);
    Some((if is_right { -front } else { front }, true))
}

/// The direction from the axis of an elbow to what reaches beyond it: the olecranon of the ulna. For a
/// radius alone, the roller of the humerus stands out to the front.
fn olecranon(
    bones: &[NamedBone<'_>],
    [rests, turns]: [usize; 2],
    fit: &Fit,
    up: &Unit<Vector3<f64>>,
) -> Option<Vector3<f64>> {
    let (axis, _) = fit.axis?;
    let across = axis.cross(up);
    let ulna = bones.iter().find(|bone| bone.is(&["ulna"]));
    let ulna = ulna.or(bones.get(turns).filter(|bone| !bone.is(&["radius"])));
    let mean = |all: Vec<f64>| {
        let sum: f64 = all.iter().sum();
        (!all.is_empty()).then(|| sum / all.len() as f64)
    };
    let off = match ulna {
        Some(ulna) => {
            let beyond = ulna.mesh.vertices.iter().map(|v| v - fit.centre);
            mean(
                beyond
                    .filter(|d| d.dot(up) >= 0.0)
                    .map(|d| d.dot(&across))
                    .collect(),
            )?
        }
        None => {
            let (middle, _, _) = long_axis(&bones[rests].mesh.vertices)?;
            (middle - fit.centre).dot(&across)
        }
    };
    (off != 0.0).then(|| across * off.signum())
}
