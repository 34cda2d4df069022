//! The frames of a run that its pictures show.

use std::sync::Arc;

use pliant::simulation::FrameState;

/// Number of frames between two pictures of an animation.
const ANIMATION_STEP: usize = 4;

/// Greatest number of pictures of an animation; a longer run shows every second, and so on.
const MOST_PICTURES: usize = 500;

/// Greatest number of frames of the turntable, besides the last.
const MOST_TURNED: usize = 23;

/// Frames at equal distances, a bounded number for a run of any length.
#[derive(Clone, Debug)]
pub struct Evenly {
    /// The frames so far.
    pub shots: Vec<Arc<FrameState>>,
    /// Number of frames from one to the next; 0 for none at all.
    step: usize,
    /// Greatest number of frames; a longer run keeps every second, and so on.
    most: usize,
}

impl Evenly {
    /// An empty sample: every `step`-th frame, at most `most`.
    fn new(step: usize, most: usize) -> Self {
        Self {
            shots: Vec::new(),
            step,
            most,
        }
    }

    fn add(&mut self, snapshot: &Arc<FrameState>) {
        if self.step > 0 && snapshot.frame.is_multiple_of(self.step) {
            self.shots.push(snapshot.clone());
            if self.shots.len() > self.most {
                self.step = self.step.saturating_mul(2);
                let step = self.step;
                self.shots.retain(|s| s.frame.is_multiple_of(step));
            }
        }
    }
}

/// The frames of the pictures.
#[derive(Clone, Debug)]
pub struct Shots {
    /// The start.
    pub first: Option<Arc<FrameState>>,
    /// The frame with the greatest severity, and the severity.
    pub worst: Option<(f64, Arc<FrameState>)>,
    /// The last frame.
    pub last: Option<Arc<FrameState>>,
    /// Frames of the animation; none without one.
    pub animation: Evenly,
    /// Frames of the turntable, without the last.
    pub turned: Evenly,
}

impl Shots {
    /// Empty shots, with an animation if requested.
    pub(super) fn new(animate: bool) -> Self {
        Self {
            first: None,
            worst: None,
            last: None,
            animation: Evenly::new(if animate { ANIMATION_STEP } else { 0 }, MOST_PICTURES),
            turned: Evenly::new(1, MOST_TURNED),
        }
    }

    /// The frames of the turntable, including the first and the last.
    pub fn of_turntable(&self) -> Vec<Arc<FrameState>> {
        let mut all = self.turned.shots.clone();
        if let Some(last) = self
            .last
            .iter()
            .find(|last| all.last().is_none_or(|shown| shown.frame != last.frame))
        {
            all.push(last.clone());
        }
        all
    }

    /// Rounds the positions of bodies to those of compact files, so that a resumed run, which reads frames from files, draws the
    /// same pictures.
    pub(super) fn round(&mut self) {
        for shot in self.all_mut() {
            for (x, _) in &mut Arc::make_mut(shot).bodies {
                x.iter_mut()
                    .for_each(|p| *p = p.map(|c| f64::from(c as f32)));
            }
        }
    }

    /// All stored frames; a frame of several pictures appears several times.
    pub(super) fn all_mut(&mut self) -> impl Iterator<Item = &mut Arc<FrameState>> {
        let Self {
            first,
            worst,
            last,
            animation,
            turned,
        } = self;
        let single = first
            .iter_mut()
            .chain(worst.iter_mut().map(|(_, shot)| shot))
            .chain(last);
        single.chain(&mut animation.shots).chain(&mut turned.shots)
    }

    /// The same as [`Self::all_mut`].
    pub(super) fn all(&self) -> impl Iterator<Item = &Arc<FrameState>> {
        let single = self
            .first
            .iter()
            .chain(self.worst.iter().map(|(_, shot)| shot))
            .chain(&self.last);
        single
            .chain(&self.animation.shots)
            .chain(&self.turned.shots)
    }

    /// Adds a frame with its severity; the greatest marks the worst frame.
    pub(super) fn add(&mut self, snapshot: &Arc<FrameState>, severity: f64) {
        self.first.get_or_insert_with(|| snapshot.clone());
        if self.worst.as_ref().is_none_or(|(most, _)| severity > *most) {
            self.worst = Some((severity, snapshot.clone()));
        }
        self.last = Some(snapshot.clone());
        self.animation.add(snapshot);
        self.turned.add(snapshot);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(shots: &[Arc<FrameState>]) -> Vec<usize> {
        shots.iter().map(|s| s.frame).collect()
    }

    #[test]
    fn a_run_of_any_length_keeps_few_frames_evenly_apart() {
        let mut shots = Shots::new(true);
        let mut most = 0;
        for frame in 0..=100_000 {
            let snapshot = FrameState {
                frame,
                time: frame as f64,
                bodies: Vec::new(),
                bones: Vec::new(),
            };
            shots.add(&Arc::new(snapshot), 0.0);
            let turned = frames(&shots.of_turntable());
            most = most.max(turned.len());
            assert!(
                turned.first() == Some(&0) && turned.last() == Some(&frame),
                "{turned:?}"
            );
            assert!(
                shots.turned.shots.len() <= MOST_TURNED
                    && turned.len() >= (frame + 1).min(MOST_TURNED / 2)
            );
            // All except the last have the distance of the first two.
            let even = |pair: &[usize]| pair[1] - pair[0] == turned[1];
            assert!(
                turned
                    .split_last()
                    .is_some_and(|(_, all)| all.windows(2).all(even)),
                "{turned:?}"
            );
        }
        assert_eq!(most, MOST_TURNED + 1);
        assert!(shots.animation.shots.len() <= MOST_PICTURES);
        assert_eq!(frames(&shots.animation.shots)[..3], [0, 256, 512]);
        assert!(
            Shots::new(false).animation.shots.is_empty()
                && Shots::new(false).of_turntable().is_empty()
        );
    }
}
