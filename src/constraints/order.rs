//! Orders in which a sweep visits constraints, and the colouring that lets a sweep run in parallel.

use std::ops::Range;

use super::blocks::{Block, in_blocks};

/// Order in which a sweep visits constraints.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SweepOrder {
    /// As stored.
    Stored,
    /// Last to first.
    Reversed,
    /// By the number of constraints between them and the loaded or displaced particles.
    FromLoadedEnd,
    /// By blocks of particles with close indices; in each block by colour. No two constraints of a
    /// colour share a particle.
    #[default]
    Coloured,
}

impl SweepOrder {
    /// Every order with its name in scenes.
    pub const NAMES: [(&'static str, Self); 4] = [
        ("stored", Self::Stored),
        ("reversed", Self::Reversed),
        ("from-loaded-end", Self::FromLoadedEnd),
        ("coloured", Self::Coloured),
    ];

    /// Name in scenes.
    pub fn name(self) -> &'static str {
        Self::NAMES
            .iter()
            .find(|(_, order)| *order == self)
            .map_or("", |(name, _)| name)
    }
}

/// Visiting order of constraints, with ranges in which no two constraints share a particle.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SweepSchedule {
    /// Index of the constraint at each position of the sweep.
    pub sequence: Vec<u32>,
    /// Ranges of positions; the constraints of one range are independent. If `independent` is
    /// false, each constraint has its own range.
    pub colours: Vec<Range<usize>>,
    /// Whether the ranges are colours.
    pub independent: bool,
    /// Phases of the sweep in order; the blocks of a phase share no particle.
    pub phases: Vec<Vec<Block>>,
}

/// Orders the constraints with the given `points` over `count` particles. [`SweepOrder::FromLoadedEnd`]
/// starts at `loaded`.
///
/// Neighbouring particles should have close indices, because blocks are ranges of indices.
pub fn schedule<const K: usize>(
    order: SweepOrder,
    points: &[[u32; K]],
    count: usize,
    loaded: &[u32],
) -> SweepSchedule {
    let stored = 0..points.len() as u32;
    match order {
        SweepOrder::Coloured => in_blocks(points, count),
        SweepOrder::Stored => sequential(stored.collect(), count),
        SweepOrder::Reversed => sequential(stored.rev().collect(), count),
        SweepOrder::FromLoadedEnd => {
            let level = levels(points, count, loaded);
            let mut sequence: Vec<u32> = stored.collect();
            // Stable: constraints at the same distance keep their stored order.
            sequence.sort_by_key(|&c| {
                let of = points[c as usize].map(|p| level[p as usize]);
                let nearest = of.into_iter().min().unwrap_or(0);
                (nearest, of.into_iter().map(u64::from).sum::<u64>())
            });
            sequential(sequence, count)
        }
    }
}

fn sequential(sequence: Vec<u32>, count: usize) -> SweepSchedule {
    let all = 0..sequence.len();
    let block = Block {
        particles: 0..count,
        colours: 0..1,
        places: all.clone(),
    };
    SweepSchedule {
        sequence,
        colours: vec![all],
        independent: false,
        phases: vec![vec![block]],
    }
}

/// Number of constraints between each particle and the nearest one of `from`; `u32::MAX` without a
/// path.
fn levels<const K: usize>(points: &[[u32; K]], count: usize, from: &[u32]) -> Vec<u32> {
    let mut at: Vec<Vec<u32>> = vec![Vec::new(); count];
    for (c, p) in points.iter().enumerate() {
        p.iter().for_each(|&p| at[p as usize].push(c as u32));
    }
    let mut level = vec![u32::MAX; count];
    let mut queue = std::collections::VecDeque::new();
    for &p in from {
        level[p as usize] = 0;
        queue.push_back(p);
    }
    while let Some(p) = queue.pop_front() {
        for &c in &at[p as usize] {
            for &q in &points[c as usize] {
                if level[q as usize] == u32::MAX {
                    level[q as usize] = level[p as usize] + 1;
                    queue.push_back(q);
                }
            }
        }
    }
    level
}

/// Greedy colouring by index: each constraint takes the first colour that none of its particles
/// has.
///
/// `points` are counted from the first of the `count` particles. Returns a colour for each
/// constraint.
pub(super) fn colours<const K: usize>(points: &[[u32; K]], count: usize) -> Vec<u32> {
    const BITS: usize = 64;
    let mut words = 1;
    let mut used = vec![0u64; count];
    let mut colour_of = Vec::with_capacity(points.len());
    for p in points {
        let taken = |used: &[u64], w: usize, words: usize| {
            p.iter().fold(0, |t, &p| t | used[p as usize * words + w])
        };
        let mut free = None;
        for w in 0..words {
            let t = taken(&used, w, words);
            if t != u64::MAX {
                free = Some(w * BITS + t.trailing_ones() as usize);
                break;
            }
        }
        let colour = free.unwrap_or_else(|| {
            // A particle has more constraints than there are colours so far: adds a word for every
            // particle.
            used = used
                .chunks(words)
                .flat_map(|c| c.iter().copied().chain([0]))
                .collect();
            words += 1;
            (words - 1) * BITS
        });
        p.iter()
            .for_each(|&p| used[p as usize * words + colour / BITS] |= 1 << (colour % BITS));
        colour_of.push(colour as u32);
    }
    colour_of
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_share_no_particle_and_lose_no_constraint() {
        // A particle with 200 edges needs 200 colours: more than the bits of one word.
        let spokes: Vec<[u32; 2]> = (1..=200)
            .map(|i| [0, i])
            .chain((1..200).map(|i| [i, i + 1]))
            .collect();
        let schedule = schedule(SweepOrder::Coloured, &spokes, 201, &[]);
        let mut seen = schedule.sequence.clone();
        seen.sort_unstable();
        assert_eq!(seen, (0..spokes.len() as u32).collect::<Vec<_>>());
        assert!(schedule.colours.len() >= 200);
        for range in &schedule.colours {
            let mut particles: Vec<u32> = schedule.sequence[range.clone()]
                .iter()
                .flat_map(|&c| spokes[c as usize])
                .collect();
            let all = particles.len();
            particles.sort_unstable();
            particles.dedup();
            assert_eq!(particles.len(), all);
        }
    }

    #[test]
    fn from_the_loaded_end_is_by_distance() {
        let chain: Vec<[u32; 2]> = (0..5).map(|i| [i, i + 1]).collect();
        assert_eq!(
            schedule(SweepOrder::FromLoadedEnd, &chain, 6, &[5]).sequence,
            [4, 3, 2, 1, 0]
        );
        assert_eq!(
            schedule(SweepOrder::FromLoadedEnd, &chain, 6, &[0]).sequence,
            [0, 1, 2, 3, 4]
        );
        assert_eq!(
            schedule(SweepOrder::Reversed, &chain, 6, &[]).sequence,
            [4, 3, 2, 1, 0]
        );
    }
}
