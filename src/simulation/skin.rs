//! Simulation of skin over implants, or over a ball: each frame is an equilibrium that starts from
//! the previous one.

mod read;

use std::collections::BTreeSet;
use std::time::Instant;

use nalgebra::{Point3, Vector3};

use super::fault::{Fault, LoadError};
use super::plan::Plan;
use super::scenario::Stepped;
use crate::mesh::TriangleMesh;
use crate::mesh::measures::Aabb;
use crate::progress::{Progress, Silent};
use crate::scene::content::{BallSpec, FillCourse, ImplantFill, SkinScene, Support};
use crate::skin::coarse::halved_near;
use crate::skin::implant::Implant;
use crate::skin::plan::{ImplantPlace, Inserted, PreparedPatch};
use crate::skin::settle;
use crate::skin::soundness::{MovedSurface, Soundness};
use crate::skin::together::grouped;
use crate::skin::whole::Whole;
use crate::skin::{self, Areas, ImplantSpec, SkinError};
use read::{read_obstacle, read_skin, size_of, small};

/// An obstacle farther from the place of an implant than this along any axis, in its bases, is
/// never touched.
const REACH: f64 = 2.0;

/// Measures of one frame, for implants that share skin or for the ball.
#[derive(Clone, Debug, PartialEq)]
pub struct SkinMeasures {
    /// Index of the frame.
    pub frame: usize,
    /// Volume [m^3] and pressure [Pa] of each implant; empty for a ball.
    pub shells: Vec<(f64, f64)>,
    /// Areas of the region.
    pub areas: Areas,
    /// State of the solution.
    pub progress: settle::SettleProgress,
    /// Crossings and folds.
    pub soundness: Soundness,
    /// Wall time [s].
    pub time_s: f64,
}

/// One or several implants that share skin, or the ball, with the skin above.
#[derive(Clone, Debug)]
pub struct SkinPart {
    /// Name; for several implants all their names.
    pub name: String,
    /// Indices of the implants in the scene; empty for a ball.
    pub members: Vec<usize>,
    /// The prepared skin.
    pub ready: PreparedPatch,
    /// Shells at the start [m].
    pub shells: Vec<TriangleMesh>,
    /// Indices of the obstacles within reach.
    pub obstacles: Vec<usize>,
    /// Result of the last frame; `None` at the start.
    pub now: Option<Inserted>,
    /// Measures of every frame after the start.
    pub frames: Vec<SkinMeasures>,
    /// The vertex of the whole skin for each vertex of the patch.
    whole: Vec<u32>,
}

impl SkinPart {
    /// Positions of each shell in the last frame [m].
    pub fn shells_at(&self) -> impl Iterator<Item = &[Point3<f64>]> {
        let at = |k: usize| match &self.now {
            Some(now) => now.shell_at(&now.shells[k]),
            None => &self.shells[k].vertices,
        };
        (0..self.shells.len()).map(at)
    }

    /// Each vertex of the region with that of the whole skin.
    pub fn vertices(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.ready
            .region
            .vertices
            .iter()
            .enumerate()
            .map(|(v, patch)| (v, self.whole[*patch as usize] as usize))
    }

    /// Number of all solver iterations.
    pub fn steps(&self) -> u32 {
        self.frames.iter().map(|f| f.progress.iterations).sum()
    }

    /// Wall time of all frames [s].
    pub fn time_s(&self) -> f64 {
        self.frames.iter().map(|f| f.time_s).sum()
    }

    /// True if every frame reached its equilibrium.
    pub fn converged(&self) -> bool {
        self.frames.iter().all(|f| f.progress.converged)
    }

    /// The measures that hold in a frame: those of the last computed frame up to it.
    pub fn measures_at(&self, frame: usize) -> Option<&SkinMeasures> {
        self.frames.iter().rev().find(|f| f.frame <= frame)
    }
}

/// A simulation of skin.
pub struct SkinRun {
    /// The scene.
    pub scene: SkinScene,
    /// The skin as read [m], with large triangles bisected near implants.
    pub skin: TriangleMesh,
    /// Obstacles as read [m].
    pub obstacles: Vec<TriangleMesh>,
    /// The effects that run.
    pub plan: Plan,
    /// Groups of implants, or the ball.
    pub parts: Vec<SkinPart>,
    /// The whole skin at the start, refined near implants [m].
    pub whole: TriangleMesh,
    /// Notes from reading.
    pub notes: Vec<String>,
    frame: usize,
}

impl SkinRun {
    /// Reads the meshes, chooses the regions, creates the layers of skin.
    ///
    /// # Errors
    /// A mesh that cannot be read or used, or an implant that does not fit at its place.
    pub fn new(scene: SkinScene) -> Result<Self, LoadError> {
        Self::new_with(scene, &Silent)
    }

    /// The same; stops when `go_on` returns false, which is called during the refinement of skin.
    ///
    /// # Errors
    /// As of [`Self::new`]; also where the progress ends it.
    pub fn new_with(scene: SkinScene, progress: &dyn Progress) -> Result<Self, LoadError> {
        let mut notes = Vec::new();
        let skin = read_skin(&scene, &mut notes)?;
        notes.extend(size_of(&scene, &skin));
        let obstacles: Vec<TriangleMesh> = (0..scene.obstacles.len())
            .map(|o| read_obstacle(&scene, o, &mut notes))
            .collect::<Result<_, _>>()?;
        let skin = match &scene.under {
            Support::Implants(all) => halved_near(
                skin,
                &all.iter()
                    .map(|filled| filled.order.clone())
                    .collect::<Vec<_>>(),
            ),
            Support::Ball(_) => skin,
        };
        let (parts, whole) = Making {
            scene: &scene,
            skin: &skin,
            obstacles: &obstacles,
            progress,
        }
        .parts()?;
        let plan = Plan::of_skin(&scene, &parts, &obstacles);
        notes.extend(parts.iter().filter_map(|part| small(part, &skin)));
        notes.extend(parts.iter().filter_map(held_at_border));
        Ok(Self {
            scene,
            skin,
            obstacles,
            plan,
            parts,
            whole,
            notes,
            frame: 0,
        })
    }

    /// The name of an implant.
    pub fn name_of(&self, implant: usize) -> &str {
        match &self.scene.under {
            Support::Implants(all) => &all[implant].name,
            Support::Ball(_) => "ball",
        }
    }

    /// The last computed frame; 0 is the start.
    pub fn frame(&self) -> usize {
        self.frame
    }

    /// Begins after a frame from results of a similar run, one for each part.
    pub(super) fn begin_after(
        &mut self,
        frame: usize,
        results: impl Iterator<Item = Option<Inserted>>,
    ) {
        self.frame = frame;
        let each = self.parts.iter_mut().zip(results);
        each.for_each(|(part, result)| part.now = result);
    }

    /// True if all parts reached their equilibrium in every frame.
    pub fn converged(&self) -> bool {
        self.parts.iter().all(SkinPart::converged)
    }

    /// The volume of each implant of a part in a frame [m^3]. An implant before its first day of
    /// filling is as flat as permitted.
    pub fn volumes_at(&self, part: &SkinPart, frame: usize) -> Vec<f64> {
        let Support::Implants(all) = &self.scene.under else {
            return Vec::new();
        };
        let volume = |k: &usize| {
            let (filled, edge) = (&all[*k], part.ready.layers.edge);
            match filled.course {
                FillCourse::Days => filled
                    .volume_at(frame)
                    .max(filled.order.implant.least(edge)),
                _ => filled.volume_at(frame),
            }
        };
        part.members.iter().map(volume).collect()
    }

    /// True if a frame has an equilibrium of its own. With days of filling, a part keeps its
    /// equilibrium on the days of other parts.
    fn is_due(&self, part: &SkinPart, frame: usize) -> bool {
        let Support::Implants(all) = &self.scene.under else {
            return true;
        };
        if self.scene.days.is_empty() {
            return true;
        }
        let filled = part.members.iter().map(|k| &all[*k]);
        let mut by_days = filled
            .filter(|filled| filled.course == FillCourse::Days)
            .peekable();
        match by_days.peek() {
            None => frame == 1,
            Some(_) => by_days.any(|filled| filled.fill.iter().any(|(at, _)| *at == frame)),
        }
    }

    /// The equilibrium of a part in a frame.
    fn settled(
        &self,
        part: &SkinPart,
        frame: usize,
        heard: &mut dyn FnMut(&settle::SettleProgress) -> bool,
    ) -> Result<Inserted, SkinError> {
        let before = part.now.as_ref();
        match &self.scene.under {
            Support::Implants(all) => match part.members.first().map(|k| all[*k].course) {
                Some(FillCourse::Target(area)) => part.ready.solve_for_area(area, heard),
                _ => part
                    .ready
                    .insert_after(before, &self.volumes_at(part, frame), heard),
            },
            Support::Ball(ball) => {
                let at = |frame| self.ball_at(ball, part, frame);
                let before = before.map(|now| (now, at(self.frame)));
                part.ready.over_ball(at(frame), before, heard)
            }
        }
    }

    /// Computes the next frame; `progress` hears of each round of each part.
    pub fn step(&mut self, progress: &dyn Progress) -> Stepped {
        let frame = self.frame + 1;
        let mut found = Vec::new();
        for part in &self.parts {
            match self.computed(part, frame, progress) {
                Ok(computed) => found.push(computed),
                Err(SkinError::Stopped) => return Stepped::Interrupted,
                Err(error) => {
                    return Stepped::Failed(format!(
                        "frame {frame}, {}: {error}; {}",
                        part.name,
                        error.help()
                    ));
                }
            }
        }
        for (part, (now, measures)) in self.parts.iter_mut().zip(found) {
            part.frames.extend(measures);
            part.now = now;
        }
        self.frame = frame;
        let skin = self.skin_at();
        for k in 0..self.parts.len() {
            let soundness = self.soundness(&self.parts[k], &skin);
            if let Some(own) = self.parts[k].frames.last_mut().filter(|f| f.frame == frame) {
                own.soundness = soundness;
            }
        }
        Stepped::Done
    }

    /// The result of a part in a frame, with measures if the frame has an equilibrium of its own;
    /// without a result before the first day of filling.
    fn computed(
        &self,
        part: &SkinPart,
        frame: usize,
        progress: &dyn Progress,
    ) -> Result<(Option<Inserted>, Option<SkinMeasures>), SkinError> {
        let (begun, due) = (Instant::now(), self.is_due(part, frame));
        let frames = self.scene.frames;
        let mut heard = |p: &settle::SettleProgress| {
            let stage = format!(
                "frame {frame}, {}: round {}, moved {:.3} mm",
                part.name,
                p.rounds,
                p.moved * 1e3
            );
            progress.report(&stage, self.frame, frames).is_continue()
        };
        let mut now = match (due, &part.now) {
            (true, _) => self.settled(part, frame, &mut heard)?,
            (false, Some(now)) => now.clone(),
            (false, None) => return Ok((None, None)),
        };
        if frame == frames {
            part.ready.compare(&mut now, &mut heard);
        }
        let shells = now.shells.iter();
        let measures = due.then(|| SkinMeasures {
            frame,
            shells: shells.map(|shell| (shell.volume, shell.pressure)).collect(),
            areas: now.areas,
            progress: now.progress,
            soundness: Soundness::default(),
            time_s: begun.elapsed().as_secs_f64(),
        });
        Ok((Some(now), measures))
    }

    /// Position of the ball in a frame.
    pub fn ball_at(&self, ball: &BallSpec, part: &SkinPart, frame: usize) -> skin::Ball {
        let down = part.ready.frame * -Vector3::z();
        // In contact with the lower layer from below.
        let from = ball
            .from
            .unwrap_or_else(|| ball.to + down * (ball.radius + ball.order.tissue.depth));
        let share = frame as f64 / self.scene.frames as f64;
        skin::Ball {
            centre: from + (ball.to - from) * share,
            radius: ball.radius,
        }
    }

    /// Crossings and folds of a part in the last frame, with the whole skin there [m]. Those of the
    /// skin as read do not count.
    fn soundness(&self, part: &SkinPart, skin: &[Point3<f64>]) -> Soundness {
        let mut found = Soundness::none();
        let Some(now) = &part.now else { return found };
        let (layers, n) = (&part.ready.layers, part.ready.layers.count());
        let moved = |from, to, triangles| MovedSurface {
            before: from,
            after: to,
            triangles,
        };
        let whole = moved(&self.whole.vertices, skin, &self.whole.triangles);
        let [upper, lower] = [0..n, n..2 * n]
            .map(|own| moved(&layers.rest[own.clone()], &now.x[own], &layers.triangles));
        let mut own = vec![false; skin.len()];
        part.vertices().for_each(|(_, vertex)| own[vertex] = true);
        let is_own = |t: u32| {
            self.whole.triangles[t as usize]
                .iter()
                .any(|v| own[*v as usize])
        };
        found.fold(&whole);
        found.fold(&lower);
        found.cross(|s| &mut s.itself, &whole.self_crossings(is_own));
        found.cross(|s| &mut s.itself, &lower.self_crossings(|_| true));
        found.cross(|s| &mut s.itself, &upper.crossings_with(&lower));
        let mut bodies = vec![lower, upper];
        for (shell, before) in now.shells.iter().zip(&part.shells) {
            let shell = moved(&before.vertices, now.shell_at(shell), &before.triangles);
            for body in &bodies {
                found.cross(|s| &mut s.implants, &shell.crossings_with(body));
            }
            found.cross(|s| &mut s.implants, &shell.self_crossings(|_| true));
            bodies.push(shell);
        }
        for &o in &part.obstacles {
            let TriangleMesh {
                vertices,
                triangles,
            } = &self.obstacles[o];
            let obstacle = MovedSurface::still(vertices, triangles);
            for body in &bodies {
                found.cross(|s| &mut s.obstacles, &body.crossings_with(&obstacle));
            }
        }
        found
    }

    /// The whole skin in the last frame [m].
    pub fn skin_at(&self) -> Vec<Point3<f64>> {
        let mut x = self.whole.vertices.clone();
        for part in &self.parts {
            let Some(now) = &part.now else { continue };
            part.vertices().for_each(|(v, vertex)| x[vertex] = now.x[v]);
        }
        x
    }
}

/// A note on a region that ends at the border of the skin.
fn held_at_border(part: &SkinPart) -> Option<String> {
    let edges = part.ready.at_border;
    (edges > 0).then(|| {
        format!(
            "{}: the region ends at the border of the skin, which is held there ({edges} edges); beyond it real skin would give way, \
             so areas and stretch are upper bounds",
            part.name
        )
    })
}

/// Parts under construction.
struct Making<'a> {
    scene: &'a SkinScene,
    skin: &'a TriangleMesh,
    obstacles: &'a [TriangleMesh],
    progress: &'a dyn Progress,
}

impl Making<'_> {
    /// All parts, of which no two share skin, and the whole skin with their patches.
    fn parts(&self) -> Result<(Vec<SkinPart>, TriangleMesh), LoadError> {
        let mut parts = match &self.scene.under {
            Support::Implants(all) => self.implants(all)?,
            Support::Ball(ball) => {
                let refused = |error| self.refused("ball", "the ball".to_owned(), error);
                let mut ready = PreparedPatch::new(self.skin, &ball.order, &[]).map_err(refused)?;
                ready.method = self.scene.skin.method;
                vec![part("ball".to_owned(), ready)]
            }
        };
        let ready: Vec<&PreparedPatch> = parts.iter().map(|part| &part.ready).collect();
        let Whole {
            mesh: whole,
            vertices,
            ..
        } = Whole::of(self.skin, &ready);
        parts
            .iter_mut()
            .zip(vertices)
            .for_each(|(part, vertices)| part.whole = vertices);
        Ok((parts, whole))
    }

    /// Groups of implants that share skin.
    fn implants(&self, all: &[ImplantFill]) -> Result<Vec<SkinPart>, LoadError> {
        let orders: Vec<ImplantSpec> = all.iter().map(|filled| filled.order.clone()).collect();
        let obstacles = |members: &[usize]| {
            self.near_any(all, members)
                .into_iter()
                .map(|o| self.obstacles[o].clone())
                .collect()
        };
        let groups = grouped(self.skin, &orders, obstacles, self.progress)
            .map_err(|(k, error)| self.refused_implant(all, k, error))?;
        groups
            .into_iter()
            .map(|(ready, members)| self.group(all, ready, members))
            .collect()
    }

    /// The part for implants that share skin.
    fn group(
        &self,
        all: &[ImplantFill],
        mut ready: PreparedPatch,
        members: Vec<usize>,
    ) -> Result<SkinPart, LoadError> {
        ready.method = self.scene.skin.method;
        let mut volumes = Vec::with_capacity(members.len());
        for &k in &members {
            let volume = self.greatest_volume(&all[k]);
            let implant = all[k].order.implant;
            if volume > implant.largest(ready.layers.edge) {
                let error = Implant { volume, ..implant }.too_large(ready.layers.edge);
                return Err(self.refused_implant(all, k, error));
            }
            volumes.push(volume);
        }
        let refused = |error| self.refused_implant(all, members[0], error);
        ready.takes(&volumes).map_err(refused)?;
        let shells = ready.pockets().map_err(refused)?;
        let names: Vec<&str> = members.iter().map(|k| all[*k].name.as_str()).collect();
        let obstacles = self.near_any(all, &members);
        Ok(SkinPart {
            members,
            shells,
            obstacles,
            ..part(names.join(" and "), ready)
        })
    }

    /// The greatest volume of an implant in the frames of the scene [m^3].
    fn greatest_volume(&self, filled: &ImplantFill) -> f64 {
        if let FillCourse::Target(_) = filled.course {
            return filled.order.implant.volume;
        }
        let last = self.scene.frames;
        filled
            .fill
            .iter()
            .filter(|(at, _)| *at <= last)
            .map(|(_, volume)| *volume)
            .fold(filled.volume_at(last), f64::max)
    }

    /// The obstacles that any of several implants can touch, ascending. All obstacles if no implant
    /// of the scene can touch one: the preparation of the skin then rejects them.
    fn near_any(&self, all: &[ImplantFill], members: &[usize]) -> Vec<usize> {
        if all.iter().all(|filled| self.near(&filled.order).is_empty()) {
            return (0..self.obstacles.len()).collect();
        }
        let mut each = BTreeSet::new();
        for k in members {
            each.extend(self.near(&all[*k].order));
        }
        each.into_iter().collect()
    }

    /// The obstacles that an implant can touch.
    fn near(&self, order: &ImplantSpec) -> Vec<usize> {
        let place = match order.place {
            ImplantPlace::Vertex(v) => self.skin.vertices.get(v).copied(),
            ImplantPlace::Point(at) => Some(at),
        };
        // The preparation of the skin rejects an implant without a place.
        let Some(place) = place else {
            return Vec::new();
        };
        let around = Aabb {
            min: place,
            max: place,
        }
        .inflate(REACH * order.implant.base);
        (0..self.obstacles.len())
            .filter(|&o| self.obstacles[o].bounding_box().intersects(&around))
            .collect()
    }

    fn refused_implant(&self, all: &[ImplantFill], k: usize, error: SkinError) -> LoadError {
        let key = format!("implant.{k}{}", key_of(&error));
        let ImplantFill { name, order, .. } = &all[k];
        self.refused(&key, format!("implant `{name}` at {}", order.place), error)
    }

    fn refused(&self, key: &str, part: String, error: SkinError) -> LoadError {
        // Errors of the skin refer to the key of the skin.
        let skin = match &error {
            SkinError::TooFine { .. } | SkinError::Refine(_) => Some("skin.0.edge_length"),
            SkinError::Empty
            | SkinError::Mesh(_)
            | SkinError::NotManifold { .. }
            | SkinError::OneSided => Some("skin.0.mesh"),
            _ => None,
        };
        LoadError::at(
            &self.scene.origin,
            skin.unwrap_or(key),
            part,
            Fault::Skin(error),
        )
    }
}

/// The key of an implant that an error refers to.
fn key_of(error: &SkinError) -> &'static str {
    match error {
        SkinError::NoVertex { .. } => ".near_vertex",
        SkinError::FarAway { .. } | SkinError::AtBorder { .. } | SkinError::TooCurved { .. } => {
            ".at"
        }
        SkinError::TooLarge { .. } | SkinError::Beyond { .. } => ".volume",
        SkinError::WrapsAround { .. } => ".base",
        _ => "",
    }
}

fn part(name: String, ready: PreparedPatch) -> SkinPart {
    let (members, shells, obstacles, frames, whole) = Default::default();
    SkinPart {
        name,
        members,
        ready,
        shells,
        obstacles,
        now: None,
        frames,
        whole,
    }
}
