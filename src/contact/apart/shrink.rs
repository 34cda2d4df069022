//! Surfaces that no push can part draw back where they overlap.

use super::{Scene, Seen};

/// After this many looks without progress no push will part what is left.
const STALLED: usize = 8;
/// Least share of the depth that counts as progress.
const PROGRESS: f64 = 0.02;
/// Greatest number of rings of vertices around an overlap that draw back.
const RINGS: usize = 8;
/// Sweeps of one ring. Each moves a vertex half the way to its neighbours.
const SWEEPS: usize = 4;
/// Greatest share of a muscle that draws back: more would not be an overlap but another shape.
const SHARE: f64 = 0.25;

/// How long the overlap has not become less.
#[derive(Default)]
pub(super) struct Stall {
    /// The least number of crossings and the least sum of depths [m] so far.
    least: Option<(usize, f64)>,
    /// Looks since then.
    looks: usize,
}

impl Stall {
    /// Takes note of one look. Returns true if too many brought no progress.
    pub fn is_long(&mut self, seen: &Seen) -> bool {
        let now = (seen.count(), seen.depth.iter().sum::<f64>());
        let (count, depth) = self.least.unwrap_or((usize::MAX, f64::INFINITY));
        self.looks += 1;
        if now.0 < count || now.1 < (1.0 - PROGRESS) * depth {
            self.looks = 0;
        }
        self.least = Some((now.0.min(count), now.1.min(depth)));
        self.looks >= STALLED
    }
}

impl Scene {
    /// Lets muscles that overlap flow inward there until they are apart. Their volumes return in
    /// the rounds that follow, at vertices that nothing pushes.
    pub(super) fn shrink(&mut self, mut seen: Seen) -> Seen {
        for rings in 1..=RINGS {
            if seen.is_clear() {
                break;
            }
            let among = self.overlapping(&seen, rings);
            for (solid, among) in self.all[..self.soft].iter_mut().zip(&among) {
                let count = among.iter().filter(|among| **among).count();
                if count > 0 && count as f64 <= SHARE * among.len() as f64 {
                    solid.flow(among, SWEEPS);
                    solid.refit();
                }
            }
            seen = self.look(false);
        }
        seen
    }

    /// For each surface the vertices within `rings` edges of what overlaps.
    fn overlapping(&self, seen: &Seen, rings: usize) -> Vec<Vec<bool>> {
        let mut at: Vec<Vec<bool>> = self.all.iter().map(|s| vec![false; s.x().len()]).collect();
        for (of, crossing) in &seen.crossing {
            for (k, &s) in of.iter().enumerate() {
                let triangles = crossing
                    .iter()
                    .map(|c| self.all[s].triangles()[c[k] as usize]);
                triangles.flatten().for_each(|v| at[s][v as usize] = true);
            }
        }
        let inside = seen.pushes.iter().filter(|p| p.distance(&self.all) < 0.0);
        for push in inside {
            push.vertices().for_each(|(s, v)| at[s][v as usize] = true);
        }
        for (solid, at) in self.all[..self.soft].iter().zip(&mut at) {
            (0..rings).for_each(|_| solid.widen(at));
        }
        at
    }
}
