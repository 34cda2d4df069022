//! Skin at the equilibrium of a frame.

use nalgebra::Vector3;

use super::{Balanced, BodyPart, SensitivityError, Settled};
use crate::mesh::measures::max_or_nan;
use crate::mesh::measures::volume;
use crate::progress::Progress;
use crate::scene::Content;
use crate::scene::content::{FillCourse, Support};
use crate::simulation::scenario::Stepped;
use crate::simulation::scenario::skin::named;
use crate::simulation::skin::{SkinPart, SkinRun};
use crate::skin::tangent::Pressing;
use crate::skin::{Areas, Inserted};
use crate::solvers::Tangent;

/// A run of skin up to a frame.
pub(super) struct SettledSkin(SkinRun);

impl SettledSkin {
    /// A run up to a frame.
    fn at_end(
        mut run: SkinRun,
        frame: usize,
        progress: &dyn Progress,
    ) -> Result<Self, SensitivityError> {
        while run.frame() < frame {
            match run.step(progress) {
                Stepped::Done => {}
                Stepped::Interrupted => return Err(SensitivityError::Interrupted),
                Stepped::Failed(reason) => return Err(SensitivityError::Failed(reason)),
            }
        }
        if !run.converged() {
            let message = format!("the skin is not at equilibrium in frame {frame}");
            return Err(SensitivityError::Failed(message));
        }
        run.parts.retain(|part| part.now.is_some());
        Ok(Self(run))
    }

    fn failed(error: crate::skin::SkinError) -> SensitivityError {
        SensitivityError::Failed(format!("{error}; {}", error.help()))
    }

    /// What presses from below a part; with a target area, the volume that was found.
    fn pressing(&self, part: &SkinPart, done: &Inserted) -> Pressing {
        match &self.0.scene.under {
            Support::Ball(_) => pressing(&self.0, part, self.0.frame()),
            Support::Implants(_) => Pressing::Implants(done.volumes()),
        }
    }

    /// True where the volume follows from an area.
    fn seeks_area(&self) -> bool {
        match &self.0.scene.under {
            Support::Implants(all) => all
                .iter()
                .any(|i| matches!(i.course, FillCourse::Target(_))),
            Support::Ball(_) => false,
        }
    }
}

/// What presses from below a part of a run in a frame.
fn pressing(run: &SkinRun, part: &SkinPart, frame: usize) -> Pressing {
    match (&run.scene.under, &part.now) {
        (Support::Ball(ball), _) => Pressing::Ball(run.ball_at(ball, part, frame)),
        _ => Pressing::Implants(run.volumes_at(part, frame)),
    }
}

impl Settled for SettledSkin {
    fn settle(
        content: &Content,
        frame: usize,
        progress: &dyn Progress,
    ) -> Result<Self, SensitivityError> {
        let Content::Skin(scene) = content else {
            return Err(SensitivityError::NotSupported(content.kind()));
        };
        let run = SkinRun::new_with((**scene).clone(), progress)?;
        Self::at_end(run, frame, progress)
    }

    fn tangents(&self) -> Result<Vec<Tangent>, SensitivityError> {
        let each = self.0.parts.iter().filter_map(|part| {
            let done = part.now.as_ref()?;
            Some(part.ready.tangent(&self.pressing(part, done), done))
        });
        each.collect::<Result<_, _>>().map_err(Self::failed)
    }

    fn left(&self) -> f64 {
        let done = self.0.parts.iter().filter_map(|part| part.now.as_ref());
        max_or_nan(done.map(|done| done.progress.residual))
    }

    fn similar(&self, content: &Content) -> Result<Option<Vec<Balanced>>, SensitivityError> {
        let Content::Skin(scene) = content else {
            return Ok(None);
        };
        // The volume of a target area follows from all other values.
        if self.seeks_area() {
            return Ok(None);
        }
        let run = SkinRun::new((**scene).clone())?;
        if run.parts.len() != self.0.parts.len() {
            return Ok(None);
        }
        let mut parts = Vec::new();
        for (part, own) in run.parts.iter().zip(&self.0.parts) {
            let Some(done) = &own.now else { continue };
            let pressing = pressing(&run, part, self.0.frame());
            let found = part.ready.energy_where(&pressing, (&own.ready, done));
            match found.map_err(Self::failed)? {
                Some((energy, x)) => parts.push(Balanced { energy, x }),
                None => return Ok(None),
            }
        }
        Ok(Some(parts))
    }

    fn again(
        &self,
        content: &Content,
        progress: &dyn Progress,
    ) -> Result<Option<Self>, SensitivityError> {
        let Content::Skin(scene) = content else {
            return Ok(None);
        };
        let mut run = SkinRun::new_with((**scene).clone(), progress)?;
        let count = |part: &SkinPart| (part.ready.layers.rest.len(), part.members.len());
        if !run
            .parts
            .iter()
            .map(count)
            .eq(self.0.parts.iter().map(count))
        {
            return Ok(None);
        }
        let frame = self.0.frame();
        run.begin_after(frame - 1, self.0.parts.iter().map(|part| part.now.clone()));
        Self::at_end(run, frame, progress).map(Some)
    }

    fn shift(&mut self, motions: &[Vec<Vector3<f64>>]) {
        for (part, motion) in self.0.parts.iter_mut().zip(motions) {
            if let Some(now) = &mut part.now {
                let each = now.x.iter_mut().zip(motion);
                each.for_each(|(x, by)| *x += by);
            }
        }
    }

    fn own(&self) -> Result<Vec<Balanced>, SensitivityError> {
        let mut parts = Vec::new();
        for part in &self.0.parts {
            let Some(done) = &part.now else { continue };
            let pressing = self.pressing(part, done);
            let found = part.ready.energy_where(&pressing, (&part.ready, done));
            if let Some((energy, x)) = found.map_err(Self::failed)? {
                parts.push(Balanced { energy, x });
            }
        }
        Ok(parts)
    }

    fn measures(
        &self,
        parts: &[Balanced],
        pressures: &[Vec<f64>],
    ) -> Vec<(String, &'static str, f64)> {
        let each = || self.0.parts.iter().zip(parts);
        let areas: Areas = each()
            .map(|(part, at)| Areas::of(&part.ready.layers, &at.x))
            .sum();
        let volumes = each().map(|(part, at)| {
            let shells = part.now.iter().flat_map(|now| &now.shells);
            let of = |shell: &crate::skin::Shell| {
                volume(&at.x[shell.vertices.clone()], &shell.triangles)
            };
            shells.map(of).sum::<f64>()
        });
        let pressure = max_or_nan(pressures.iter().flatten().copied());
        let more = [
            ("implant_volume_m3", volumes.sum::<f64>()),
            ("volume_difference_m3", areas.volume_difference),
            ("stretch_max", areas.stretch_max),
            ("pressure_pa", pressure),
        ];
        let all = named(&areas).into_iter().chain(more);
        all.map(|(name, value)| (String::new(), name, value))
            .collect()
    }

    fn bodies(&self) -> Vec<BodyPart> {
        let each = self.0.parts.iter().enumerate();
        let of = |(k, part): (usize, &SkinPart)| {
            let layers = &part.ready.layers;
            let name = format!("skin over {}", part.name);
            (name, k, 0..layers.count(), layers.triangles.clone())
        };
        each.map(of).collect()
    }
}
