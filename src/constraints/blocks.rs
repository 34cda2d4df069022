//! Blocks: ranges of particles whose constraints are swept together, so that the particles stay in
//! the first-level cache. The blocks of a phase are swept in parallel.
//!
//! A sweep has up to three phases. In the first phase, all blocks are ranges of equal numbers of
//! particles with the constraints inside them. In the second phase, the ranges are shifted by half
//! a block, for constraints across a border. The third phase is one block with the constraints of
//! greater reach. The blocks depend on the constraints alone, never on the number of threads.

use std::ops::Range;

use super::order::{SweepSchedule, colours};

/// Least number of particles in a block. Their positions and inverse masses fill two thirds of a
/// first-level cache of 48 KiB.
const SMALLEST: usize = 1024;

/// One in this number of constraints can have too great a reach for the first two phases.
const FAR: usize = 64;

/// Constraints that are swept together.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Block {
    /// Range of particles of the constraints.
    pub particles: Range<usize>,
    /// Range of the colours as indices into [`SweepSchedule::colours`].
    pub colours: Range<usize>,
    /// Range of positions in the sweep.
    pub places: Range<usize>,
}

/// Lowest and highest particle.
fn ends<const K: usize>(points: &[u32; K]) -> (usize, usize) {
    points.iter().fold((usize::MAX, 0), |(low, high), &p| {
        (low.min(p as usize), high.max(p as usize))
    })
}

/// Number of particles in a block for these constraints over `count` particles. It is a power of
/// two; at least `count` for a single block.
fn size<const K: usize>(points: &[[u32; K]], count: usize) -> usize {
    let mut reaches: Vec<usize> = points
        .iter()
        .map(ends)
        .map(|(low, high)| high.saturating_sub(low))
        .collect();
    let place = reaches.len().saturating_sub(1 + reaches.len() / FAR);
    let reach = if reaches.is_empty() {
        0
    } else {
        *reaches.select_nth_unstable(place).1
    };
    // A constraint across a border then lies within a shifted block.
    let size = SMALLEST.max(2 * reach).next_power_of_two();
    if size * 2 > count { count } else { size }
}

/// Phase and block of a constraint.
fn home<const K: usize>(points: &[u32; K], size: usize) -> (usize, usize) {
    let (low, high) = ends(points);
    let shifted = |p: usize| (p + size / 2) / size;
    match () {
        () if low / size == high / size => (0, low / size),
        () if shifted(low) == shifted(high) => (1, shifted(low)),
        () => (2, 0),
    }
}

/// The particles of a block.
fn range((phase, block): (usize, usize), size: usize, count: usize) -> Range<usize> {
    match phase {
        0 => block * size..count.min((block + 1) * size),
        1 => (block * size).saturating_sub(size / 2)..count.min(block * size + size / 2),
        _ => 0..count,
    }
}

/// The constraints by phase, block and colour; those of a colour by their lowest particle.
pub(super) fn in_blocks<const K: usize>(points: &[[u32; K]], count: usize) -> SweepSchedule {
    let size = size(points, count).max(1);
    let homes: Vec<_> = points.iter().map(|p| home(p, size)).collect();
    let mut sequence: Vec<u32> = (0..points.len() as u32).collect();
    sequence.sort_by_key(|&c| homes[c as usize]);
    let mut schedule = SweepSchedule {
        independent: true,
        ..SweepSchedule::default()
    };
    let mut last = None;
    for group in sequence.chunk_by(|&a, &b| homes[a as usize] == homes[b as usize]) {
        let home = homes[group[0] as usize];
        let particles = range(home, size, count);
        let base = particles.start as u32;
        let local: Vec<[u32; K]> = group
            .iter()
            .map(|&c| points[c as usize].map(|p| p - base))
            .collect();
        let colour = colours(&local, particles.len());
        let mut inner: Vec<usize> = (0..group.len()).collect();
        // Particles that are neighbours in memory are visited together.
        inner.sort_by_key(|&i| (colour[i], local[i].into_iter().min()));
        let (begin, first) = (schedule.sequence.len(), schedule.colours.len());
        let mut start = begin;
        for same in inner.chunk_by(|&a, &b| colour[a] == colour[b]) {
            schedule.sequence.extend(same.iter().map(|&i| group[i]));
            schedule.colours.push(start..start + same.len());
            start += same.len();
        }
        if last != Some(home.0) {
            schedule.phases.push(Vec::new());
            last = Some(home.0);
        }
        let block = Block {
            particles,
            colours: first..schedule.colours.len(),
            places: begin..start,
        };
        schedule
            .phases
            .last_mut()
            .expect("pushed above")
            .push(block);
    }
    schedule
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The edges of a triangle strip: each particle with the next three.
    fn strip(count: u32) -> Vec<[u32; 2]> {
        (0..count)
            .flat_map(|i| (1..=3).filter_map(move |k| (i + k < count).then_some([i, i + k])))
            .collect()
    }

    #[test]
    fn blocks_hold_each_constraint_once_and_phases_share_no_particle() {
        let mut points = strip(10_000);
        // Some constraints that reach across the whole strip.
        points.extend([[0, 9_999], [5_000, 100]]);
        let schedule = in_blocks(&points, 10_000);
        let mut seen = schedule.sequence.clone();
        seen.sort_unstable();
        assert_eq!(seen, (0..points.len() as u32).collect::<Vec<_>>());
        assert_eq!(
            schedule.phases.iter().map(Vec::len).collect::<Vec<_>>(),
            [10, 9, 1]
        );
        for phase in &schedule.phases {
            assert!(
                phase
                    .windows(2)
                    .all(|two| two[0].particles.end <= two[1].particles.start)
            );
            for block in phase {
                for &c in &schedule.sequence[block.places.clone()] {
                    assert!(
                        points[c as usize]
                            .iter()
                            .all(|&p| block.particles.contains(&(p as usize)))
                    );
                }
                assert_eq!(
                    schedule.colours[block.colours.start].start,
                    block.places.start
                );
                assert_eq!(
                    schedule.colours[block.colours.end - 1].end,
                    block.places.end
                );
            }
        }
    }

    #[test]
    fn a_numbering_without_nearness_is_one_block() {
        let far: Vec<[u32; 2]> = (0..5_000).map(|i| [i, i + 5_000]).collect();
        let schedule = in_blocks(&far, 10_000);
        assert_eq!(
            schedule.phases.iter().map(Vec::len).collect::<Vec<_>>(),
            [1]
        );
        assert_eq!(schedule.phases[0][0].particles, 0..10_000);
        assert_eq!(schedule.colours.len(), 1, "no two share a particle");
    }

    #[test]
    fn nothing_is_no_phase() {
        assert!(in_blocks::<2>(&[], 10).phases.is_empty());
    }
}
