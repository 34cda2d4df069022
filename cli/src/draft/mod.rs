//! A scene drafted from meshes alone: what each body is, its unit, repair and remeshing, a joint, and the
//! attachments. Every guess is a line of the scene, with its reason beside it.

pub mod attachments;
pub mod fit;
pub mod joint;
pub mod mending;
pub mod names;
pub mod patella;
mod tendon;

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::PathBuf;

use attachments::{Attachment, LooseEnd, NEAR_MM, WITHIN_MM};
use joint::Joint;
use mending::{Edges, Mended, coarser, cut, remeshed};
use nalgebra::{Unit, Vector3};
use patella::PathKey;
use pliant::contact::Surface;
use pliant::io::file_name;
use pliant::mesh::TriangleMesh;
use pliant::scene::EFFECTS;
use pliant::simulation::Assets;
use rayon::prelude::*;
use tendon::{Target, Tendon};

/// Resistance to bending: with less, muscles of the measured hip lose more than half of their thickness.
const BENDING: &str = "5e-4 N m";

/// Frames of a scene. A joint turns to its end and back in them.
const FRAMES: usize = 300;

/// A body of the draft.
#[derive(Debug, Default)]
pub struct Body {
    /// Its name in the scene.
    pub name: String,
    /// The path of its file.
    pub path: String,
    /// Why it is a bone or a muscle; empty if the user said so.
    pub why: String,
    /// How its mesh is mended; `None` for a sound one.
    pub mended: Option<Mended>,
    /// Why it is remeshed, and to which edges [m]; `None` for a mesh that stays, and before
    /// [`Draft::examine`].
    pub remeshed: Option<(String, f64)>,
    /// What was cut of a mesh that is remeshed, and the length of loops around it [m].
    pub cut: Option<(String, f64)>,
}

impl Body {
    /// Notes that its mesh is remeshed, and what is cut of it before.
    fn remesh(&mut self, mesh: &TriangleMesh, remeshed: Option<(String, f64)>) {
        self.cut = remeshed.as_ref().and_then(|(_, edge)| cut(mesh, *edge));
        self.remeshed = remeshed;
    }

    /// The surface that a run simulates; `None` for one that is not remeshed.
    fn simulated(&self, mesh: &TriangleMesh) -> Option<TriangleMesh> {
        let (_, edge) = self.remeshed.as_ref()?;
        mending::simulated(mesh, *edge, self.cut.as_ref().map(|(_, length)| *length))
    }
}

/// What is known of a muscle from the meshes.
#[derive(Debug, Default)]
pub struct Held {
    pub attachments: Vec<Attachment>,
    pub loose: Vec<LooseEnd>,
    /// The files of its patches, one for each attachment that has one, and their meshes [m].
    pub patches: Vec<Option<(PathBuf, TriangleMesh)>>,
    /// The muscle with a tendon that its mesh lacks, and the file of both. The attachment from afar without a
    /// patch of its own holds its end.
    pub tendon: Option<(PathBuf, Tendon)>,
}

/// The scene.
#[derive(Debug, Default)]
pub struct Draft {
    pub name: String,
    pub unit: String,
    /// Where the unit comes from; empty if the user gave it.
    pub unit_why: String,
    pub bones: Vec<Body>,
    pub muscles: Vec<Body>,
    /// Files of lines along the fibres, for the first muscles.
    pub fibres: Vec<String>,
    pub joint: Option<Joint>,
    /// The folder of meshes, as seen from that of the scene; without one, bones hold all that is near.
    pub parts: Option<PathBuf>,
    /// What was found of each muscle; empty before [`Draft::examine`].
    pub held: Vec<Held>,
}

/// The axis of the coordinates that is nearest to a direction.
fn nearest_axis(direction: &Unit<Vector3<f64>>) -> [i32; 3] {
    let mut axis = [0; 3];
    let most = direction.iamax();
    axis[most] = if direction[most] < 0.0 { -1 } else { 1 };
    axis
}

impl Draft {
    /// Finds what to remesh, attachments and missing tendons, on meshes before any parting. Attachments come
    /// from the surfaces that a run simulates. A patch of a coarser one would hold some vertices of a tip and
    /// leave others.
    pub fn examine(&mut self, assets: &Assets) {
        let bones: Vec<Surface> = assets.bones.iter().map(Surface::new).collect();
        let meshes: Vec<&TriangleMesh> = assets.muscles.iter().map(|muscle| &muscle.mesh).collect();
        let each = self.muscles.par_iter_mut().zip(&meshes);
        let simulated: Vec<Cow<TriangleMesh>> = each
            .map(|(muscle, mesh)| {
                muscle.remesh(mesh, remeshed(mesh));
                muscle
                    .simulated(mesh)
                    .map_or(Cow::Borrowed(*mesh), Cow::Owned)
            })
            .collect();
        let each = self.muscles.iter().zip(&simulated);
        let mut held: Vec<Held> = each
            .map(|(muscle, mesh)| self.attach(muscle, mesh, &bones))
            .collect();
        self.add_tendons(&mut held, (&meshes, &simulated), &bones);
        self.draw_patches(&mut held, &simulated);
        self.keep_tendons_clear(&held, assets, &bones);
        // Contact is no more exact than the edges of the muscles.
        let mut shortest = f64::INFINITY;
        for ((muscle, mesh), held) in self.muscles.iter_mut().zip(&meshes).zip(&held) {
            if let Some((_, with)) = &held.tendon {
                muscle.remesh(&with.mesh, remeshed(&with.mesh));
            }
            let after = muscle.remeshed.as_ref().map(|(_, edge)| *edge);
            let edge = after.or_else(|| Some(Edges::of(mesh)?.part(2)));
            shortest = shortest.min(edge.unwrap_or(f64::INFINITY));
        }
        for (bone, mesh) in self.bones.iter_mut().zip(&assets.bones) {
            bone.remesh(mesh, coarser(mesh, shortest));
        }
        self.held = held;
    }

    /// Finds the path of a patella anew, so that the ends of tendons on it keep clear of the femur.
    fn keep_tendons_clear(&mut self, held: &[Held], assets: &Assets, bones: &[Surface]) {
        let Some(joint) = &mut self.joint else { return };
        let mesh = |b: usize| &assets.bones[b];
        let mut glides = Vec::new();
        for (b, before) in &joint.glides {
            let all = held
                .iter()
                .flat_map(|h| h.attachments.iter().zip(&h.patches));
            let patches = all.filter(|(a, _)| a.bone == *b);
            let patches = patches.filter_map(|(_, patch)| patch.as_ref());
            let carried: Vec<_> = patches
                .flat_map(|(_, mesh)| mesh.vertices.clone())
                .collect();
            let found = joint.glide(*b, &mesh, &bones[joint.between[0]], &carried);
            glides.push(found.unwrap_or_else(|| (*b, before.clone())));
        }
        joint.glides = glides;
    }

    fn attach(&self, muscle: &Body, mesh: &TriangleMesh, bones: &[Surface]) -> Held {
        let turns = self.joint.as_ref().map(|joint| joint.turns.as_slice());
        let joint = self.joint.as_ref();
        let crosses = joint.and_then(|joint| names::crosses(&muscle.name, joint.known.name));
        let (mut attachments, loose) = attachments::find(mesh, bones, turns, crosses);
        if let Some(joint) = joint
            && let Some(wanted) = self.insertion(muscle, joint)
        {
            let is_far = |a: &&mut Attachment| a.far.is_some() && joint.turns.contains(&a.bone);
            attachments
                .iter_mut()
                .filter(is_far)
                .for_each(|a| a.move_to(wanted, &bones[wanted]));
        }
        Held {
            attachments,
            loose,
            ..Held::default()
        }
    }

    /// The bone that a joint turns and on which a muscle ends, by their names.
    fn insertion(&self, muscle: &Body, joint: &Joint) -> Option<usize> {
        let wanted = names::insertion(&muscle.name, joint.known.name)?;
        let is_it = |b: usize| {
            names::known_bone(&self.bones[b].name).is_some_and(|k| k.name == wanted.bone)
        };
        joint.turns.iter().copied().find(|&b| is_it(b))
    }

    /// The triangles of a bone on which a muscle ends, by their names; `None` for all of them.
    fn inserts(
        &self,
        muscle: &Body,
        joint: &Joint,
        bone: usize,
        surface: &Surface,
    ) -> Option<Vec<u32>> {
        let along = names::insertion(&muscle.name, joint.known.name)?.along?;
        (self.insertion(muscle, joint) == Some(bone)).then_some(())?;
        let (middle, axis, length) = fit::long_axis(surface.positions())?;
        let away = joint.fit.centre - middle;
        // From the middle to the end at the joint.
        let axis = if axis.dot(&away) < 0.0 { -axis } else { axis };
        let heights = surface.positions().iter().map(|p| (p - middle).dot(&axis));
        let top = heights.max_by(f64::total_cmp)?;
        let [least, most] = along.map(|share| top - share * length);
        let is_there = |t: &[u32; 3]| {
            let of = |v: &u32| (surface.positions()[*v as usize] - middle).dot(&axis);
            t.iter().all(|v| most <= of(v) && of(v) <= least)
        };
        let all = surface.triangles().iter().enumerate();
        let there: Vec<u32> = all
            .filter(|(_, t)| is_there(t))
            .map(|(k, _)| k as u32)
            .collect();
        (!there.is_empty()).then_some(there)
    }

    /// Lengthens each muscle whose tendon crosses the joint, and that its mesh lacks. Where that cannot be
    /// done, and the motion carries the end into a bone that rests, such a bone holds it.
    fn add_tendons(
        &self,
        held: &mut [Held],
        (meshes, simulated): (&[&TriangleMesh], &[Cow<TriangleMesh>]),
        bones: &[Surface],
    ) {
        let Some(joint) = &self.joint else { return };
        let all = || held.iter().flat_map(|held| &held.attachments);
        let surfaces: Vec<Surface> = match all().any(|a| a.far.is_some()) {
            true => simulated.iter().map(|mesh| Surface::new(mesh)).collect(),
            false => return,
        };
        for m in 0..held.len() {
            for a in 0..held[m].attachments.len() {
                let attachment = &held[m].attachments[a];
                let (Some(far), bone) = (&attachment.far, attachment.bone) else {
                    continue;
                };
                let mut others: Vec<&Surface> = surfaces.iter().collect();
                others.remove(m);
                let around = tendon::Around {
                    bones,
                    muscles: others,
                    tendons: held
                        .iter()
                        .filter_map(|held| Some(&held.tendon.as_ref()?.1.course))
                        .collect(),
                };
                let is_first = held[m].tendon.is_none() && self.parts.is_some();
                let part = self.inserts(&self.muscles[m], joint, bone, &bones[bone]);
                let target = Target {
                    bone,
                    part: part.as_deref(),
                };
                let tendon = (is_first && attachment.crosses(joint))
                    .then(|| around.lengthened(meshes[m], far, target))
                    .flatten();
                if let Some(tendon) = tendon {
                    self.lengthen(&mut held[m], m, a, tendon);
                } else if joint.turns.contains(&bone) {
                    held_at_rest(&mut held[m].attachments[a], &simulated[m], joint, bones);
                }
            }
        }
    }

    /// Gives a muscle its tendon for one of its attachments.
    fn lengthen(&self, held: &mut Held, muscle: usize, attachment: usize, tendon: Tendon) {
        let file = format!("{}-with-tendon.obj", file_name(&self.muscles[muscle].name));
        let path = self.parts.iter().map(|parts| parts.join(&file)).next();
        held.attachments[attachment].patch = None;
        held.tendon = path.map(|path| (path, tendon));
    }

    /// The meshes of all patches.
    fn draw_patches(&self, held: &mut [Held], meshes: &[Cow<TriangleMesh>]) {
        for ((held, mesh), muscle) in held.iter_mut().zip(meshes).zip(&self.muscles) {
            let Held {
                attachments,
                tendon,
                ..
            } = &*held;
            let patch = |(k, a): (usize, &Attachment)| {
                let bone = file_name(&self.bones[a.bone].name);
                let file = format!("{}-{}-on-{bone}.obj", file_name(&muscle.name), k + 1);
                let path = self.parts.as_ref()?.join(file);
                let mesh = match (&a.patch, &a.far, tendon) {
                    (Some(patch), _, _) => part(mesh, patch),
                    (None, Some(_), Some((_, with))) => part(&with.mesh, &with.end),
                    _ => return None,
                };
                Some((path, mesh))
            };
            held.patches = attachments.iter().enumerate().map(patch).collect();
        }
    }

    /// The meshes that the scene needs beside those of its bodies, with their files.
    pub fn files(&self) -> impl Iterator<Item = (&PathBuf, &TriangleMesh)> {
        let patches = self
            .held
            .iter()
            .flat_map(|held| held.patches.iter().flatten());
        let tendons = self.held.iter().filter_map(|held| held.tendon.as_ref());
        patches
            .map(|(path, mesh)| (path, mesh))
            .chain(tendons.map(|(path, with)| (path, &with.mesh)))
    }

    /// The scene as TOML.
    pub fn toml(&self) -> String {
        let mut toml = format!(
            "name = {}\nframes = {FRAMES}\nframe_rate = \"60 Hz\"\n",
            quoted(&self.name)
        );
        if !self.unit_why.is_empty() {
            let _ = writeln!(
                toml,
                "# Lengths of all files are in {}: {}.",
                self.unit, self.unit_why
            );
        }
        if let Some(joint) = &self.joint {
            let up = nearest_axis(&joint.up);
            // It is what a scene without the key has.
            if up != [0, 1, 0] {
                let _ = writeln!(
                    toml,
                    "up = {up:?} # in pictures: along the bones of the joint"
                );
            }
        }
        for (b, bone) in self.bones.iter().enumerate() {
            self.put_body(&mut toml, "bone", bone, None);
            self.put_motion(&mut toml, b);
        }
        for (m, muscle) in self.muscles.iter().enumerate() {
            let tendon = self.held.get(m).and_then(|held| held.tendon.as_ref());
            self.put_body(&mut toml, "muscle", muscle, tendon);
            if let Some(held) = self.held.get(m) {
                self.put_held(&mut toml, held);
            }
            if self.held.get(m).is_some_and(|held| self.has_fibres(held)) {
                toml.push_str("[muscle.fibres] # with their tone it does not buckle as it shortens\nmethod = \"harmonic\"\n");
            }
            if let Some(lines) = self.fibres.get(m) {
                let (lines, unit) = (quoted(lines), quoted(&self.unit));
                let _ = write!(toml, "[muscle.fibres]\nlines = {lines}\nunit = {unit}\n");
            }
        }
        toml.push_str(&usual_effects());
        if self.held.iter().any(|held| self.has_fibres(held)) {
            toml.push_str("[effects.tone]\n");
        }
        toml
    }

    /// Whether fibres are computed for a muscle: a joint turns one of its bones and not another.
    fn has_fibres(&self, held: &Held) -> bool {
        let turns = |a: &Attachment| {
            let joint = self.joint.as_ref();
            joint.map(|joint| joint.turns.contains(&a.bone))
        };
        let has = |turned: bool| held.attachments.iter().any(|a| turns(a) == Some(turned));
        has(true) && has(false)
    }

    fn put_body(
        &self,
        toml: &mut String,
        kind: &str,
        body: &Body,
        tendon: Option<&(PathBuf, Tendon)>,
    ) {
        let name = quoted(&body.name);
        let why = match body.why.as_str() {
            "" => String::new(),
            why => format!(" # {why}"),
        };
        let _ = writeln!(toml, "\n[[{kind}]]{why}\nname = {name}");
        let (path, unit) = (quoted(&body.path), quoted(&self.unit));
        let _ = match tendon {
            None => write!(toml, "mesh = {path}\nunit = {unit}\n"),
            Some((with, tendon)) => write!(
                toml,
                "# {path}, and a tendon of {} mm with a radius of {} mm, the shortest way round the bones\n\
                 mesh = {}\nunit = \"m\"\n",
                mm(tendon.course.length()),
                mm(tendon.course.radius),
                quoted(&with.display().to_string()),
            ),
        };
        let cut = body.cut.as_ref().map_or(String::new(), |(why, length)| {
            format!("cut_handles = \"{} mm\" # {why}\n", mm(*length))
        });
        // What was lengthened was mended before.
        let mended = body.mended.as_ref().filter(|_| tendon.is_none());
        if let Some(Mended { why, options }) = mended {
            let _ = write!(toml, "repair = true # {why}\n{cut}");
            if options.close_holes > 0 {
                let _ = writeln!(toml, "close_holes = {}", options.close_holes);
            }
            if options.keep_largest {
                toml.push_str("keep_largest = true\n");
            }
        } else if !cut.is_empty() {
            let _ = write!(toml, "repair = true\n{cut}");
        }
        if let Some((why, edge)) = &body.remeshed {
            let _ = write!(toml, "# {why}\nedge_length = \"{} mm\"\n", mm(*edge));
        }
    }

    fn put_motion(&self, toml: &mut String, bone: usize) {
        let Some(joint) = self
            .joint
            .as_ref()
            .filter(|joint| joint.turns.contains(&bone))
        else {
            return;
        };
        let known = joint.known;
        let _ = write!(
            toml,
            "[bone.motion] # {} of the {}\njoint = {}\n",
            known.motion,
            known.name,
            quoted(known.name)
        );
        let of = joint.between.map(|b| self.bones[b].name.as_str());
        let centre: Vec<String> = joint
            .fit
            .centre
            .iter()
            .map(|c| format!("\"{:.3} mm\"", 1e3 * c))
            .collect();
        let axis: Vec<String> = joint.axis.iter().map(|a| format!("{a:.5}")).collect();
        let (middle, end) = (FRAMES / 2, FRAMES);
        let _ = write!(
            toml,
            "centre = [{}] # {}\naxis = [{}] # {}\nkeys = [\n    {{ frame = 0, angle = \"0 deg\" }},\n    \
             {{ frame = {middle}, angle = \"{} deg\" }},\n    {{ frame = {end}, angle = \"0 deg\" }},\n]\n",
            centre.join(", "),
            joint.fit_in_words(of),
            axis.join(", "),
            joint.sense,
            known.degrees,
        );
        let Some((_, path)) = joint.glides.iter().find(|(glides, _)| *glides == bone) else {
            return;
        };
        let _ = writeln!(
            toml,
            "path = [ # it glides over the femur, at the length of its ligament, where the quadriceps is shortest"
        );
        for PathKey {
            at,
            angle,
            translation,
        } in &path.keys
        {
            let [at, angle] = [at, angle].map(|a| a.to_degrees());
            let translation = translation.map(|c| format!("\"{:.3} mm\"", 1e3 * c));
            let translation: Vec<&str> = translation.iter().map(String::as_str).collect();
            let _ = writeln!(
                toml,
                "    {{ at = \"{at:.0} deg\", angle = \"{angle:.3} deg\", translation = [{}] }},",
                translation.join(", "),
            );
        }
        toml.push_str("]\n");
    }

    fn put_held(&self, toml: &mut String, held: &Held) {
        let _ = write!(
            toml,
            "[muscle.material]\nbending = \"{BENDING}\" # a thin muscle keeps its thickness\n"
        );
        let limit = 100.0 * attachments::share(held.attachments.len());
        for (attachment, patch) in held.attachments.iter().zip(&held.patches) {
            let bone = quoted(&self.bones[attachment.bone].name);
            let is_tendon = attachment.patch.is_none() && held.tendon.is_some();
            let why = match (&attachment.far, patch) {
                (Some(_), _) if is_tendon => {
                    " # the end of the tendon, which the file lacks".to_owned()
                }
                (Some(far), _) if far.lacks_tendon => format!(
                    " # the mesh lacks the tendon over the joint: this bone, {:.0} mm away, holds its end",
                    far.mm
                ),
                (Some(far), _) => format!(
                    " # the nearest bone to this end, {:.0} mm away: the mesh lacks a tendon",
                    far.mm
                ),
                (None, Some(_)) => {
                    " # a part of what is near: elsewhere the muscle passes this bone".to_owned()
                }
                (None, None) => String::new(),
            };
            let _ = writeln!(toml, "[[muscle.attachment]]{why}\nbone = {bone}");
            let _ = match (patch, &attachment.far) {
                (Some((path, _)), _) => {
                    let path = quoted(&path.display().to_string());
                    write!(
                        toml,
                        "patch = {path}\nunit = \"m\"\nwithin = \"{WITHIN_MM} mm\"\n"
                    )
                }
                (None, far) => {
                    let near = far
                        .as_ref()
                        .map_or(NEAR_MM, |far| (far.mm + NEAR_MM).ceil());
                    write!(toml, "near = \"{near} mm\"\nlimit = \"{limit} %\"\n")
                }
            };
        }
    }

    /// What is left loose, in words: an end of a muscle far from every bone.
    pub fn loose(&self) -> Vec<String> {
        let of = |(held, muscle): (&Held, &Body)| -> Vec<String> {
            let each = held.loose.iter().map(|end| {
                let at: Vec<String> = end.at.iter().map(|c| format!("{:.0}", 1e3 * c)).collect();
                let near = match end.nearest {
                    Some((bone, mm)) => {
                        format!("the nearest, {}, is {mm:.0} mm away", self.bones[bone].name)
                    }
                    None => "there are none".to_owned(),
                };
                format!(
                    "{}: no bone holds its end at ({}) mm: {near}",
                    muscle.name,
                    at.join(", ")
                )
            });
            each.collect()
        };
        self.held.iter().zip(&self.muscles).flat_map(of).collect()
    }
}

/// Lets a bone that rests hold an end, if the motion would carry it into one.
fn held_at_rest(
    attachment: &mut Attachment,
    mesh: &TriangleMesh,
    joint: &Joint,
    bones: &[Surface],
) {
    let Some(far) = &mut attachment.far else {
        return;
    };
    let triangles = attachment.patch.iter().flatten();
    let held: BTreeSet<u32> = triangles
        .flat_map(|&t| mesh.triangles[t as usize])
        .collect();
    let held: Vec<_> = held.iter().map(|&v| mesh.vertices[v as usize]).collect();
    // What glides is not carried like a part of the bones that turn.
    if !joint.glides.iter().any(|(b, _)| *b == attachment.bone)
        && tendon::is_carried_into(&held, joint, bones)
        && let Some((bone, away)) = tendon::nearest_at_rest(&far.middle, joint, bones)
    {
        attachment.bone = bone;
        (far.mm, far.lacks_tendon) = (1e3 * away, true);
    }
}

/// A part of a mesh.
fn part(mesh: &TriangleMesh, triangles: &[u32]) -> TriangleMesh {
    let mut number = BTreeMap::new();
    let mut part = TriangleMesh::default();
    for &t in triangles {
        let corners = mesh.triangles[t as usize].map(|v| {
            *number.entry(v).or_insert_with(|| {
                part.vertices.push(mesh.vertices[v as usize]);
                part.vertices.len() as u32 - 1
            })
        });
        part.triangles.push(corners);
    }
    part
}

/// A text in TOML.
pub fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

/// Every effect that a muscle usually has, as in the built-in hip.
fn usual_effects() -> String {
    let mut toml = "\n".to_owned();
    for effect in &EFFECTS {
        if let Some(keys) = effect.usual {
            let _ = write!(toml, "[effects.{}]\n{keys}", effect.key);
        }
    }
    toml
}

/// A length [m] in millimetres with three digits.
fn mm(length: f64) -> String {
    let digits = format!("{:.2e}", length * 1e3);
    digits
        .parse()
        .map_or(digits, |number: f64| number.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_body_is_remeshed_to_is_a_line_of_the_scene() {
        let body = Body {
            name: "femur".to_owned(),
            remeshed: Some(("it is fine".to_owned(), 2e-3)),
            cut: Some(("1 handle".to_owned(), 8e-3)),
            ..Body::default()
        };
        let draft = Draft {
            bones: vec![body],
            ..Draft::default()
        };
        let toml = draft.toml();
        for line in [
            "repair = true\ncut_handles = \"8 mm\" # 1 handle\n",
            "# it is fine\nedge_length = \"2 mm\"\n",
        ] {
            assert!(toml.contains(line), "{toml}");
        }
    }

    #[test]
    fn lengths_have_three_digits() {
        assert_eq!(mm(0.004_312), "4.31");
        assert_eq!(mm(0.000_000_5), "0.0005");
        assert_eq!(mm(12.0), "12000");
    }
}
