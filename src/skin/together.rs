//! Several implants: those with overlapping regions share skin and a common equilibrium.

use super::SkinError;
use super::plan::{ImplantSpec, PreparedPatch};
use crate::mesh::TriangleMesh;
use crate::progress::Progress;

/// Skin prepared for a group of implants, with their indices in the list of all orders.
pub type Group = (PreparedPatch, Vec<usize>);

/// Prepares skin for all orders: one group for all that share skin, in the order of the first of
/// each. `obstacles` are those that an order can touch.
///
/// # Errors
/// See [`Ready::new`]; the error comes with the index of the rejected order, from 0.
pub fn grouped(
    skin: &TriangleMesh,
    orders: &[ImplantSpec],
    obstacles: impl Fn(&[usize]) -> Vec<TriangleMesh>,
    progress: &dyn Progress,
) -> Result<Vec<Group>, (usize, SkinError)> {
    let mut groups = Vec::new();
    for (k, order) in orders.iter().enumerate() {
        let ready = PreparedPatch::new_with(skin, order, &obstacles(&[k]), progress)
            .map_err(|error| (k, error))?;
        groups.push((ready, vec![k]));
    }
    // A common patch has other edges and can extend farther than those of its implants alone:
    // repeats until no two overlap.
    loop {
        let each: Vec<Vec<bool>> = groups.iter().map(|(ready, _)| taken(skin, ready)).collect();
        let meeting = meeting(&each);
        if meeting.len() == groups.len() {
            return Ok(groups);
        }
        let mut before: Vec<Option<Group>> = groups.into_iter().map(Some).collect();
        groups = Vec::new();
        for numbers in meeting {
            let mut own: Vec<Group> = numbers.iter().filter_map(|k| before[*k].take()).collect();
            if own.len() == 1 {
                groups.append(&mut own);
                continue;
            }
            let mut members: Vec<usize> =
                own.into_iter().flat_map(|(_, members)| members).collect();
            members.sort_unstable();
            let more: Vec<ImplantSpec> = members[1..].iter().map(|k| orders[*k].clone()).collect();
            let all = obstacles(&members);
            let ready = PreparedPatch::together(skin, &orders[members[0]], &more, &all, progress);
            groups.push((
                ready.map_err(|(site, error)| of_all(site, error, &members))?,
                members,
            ));
        }
    }
}

/// Converts an error of a group, with implants counted from 1, to the numbering of all orders.
fn of_all(site: usize, error: SkinError, members: &[usize]) -> (usize, SkinError) {
    match error {
        SkinError::Overlap { first, second } => {
            let [first, second] = [first, second].map(|k| members[k - 1]);
            (
                second,
                SkinError::Overlap {
                    first: first + 1,
                    second: second + 1,
                },
            )
        }
        other => (members[site], other),
    }
}

/// True for each triangle of the skin in the patch of an implant.
fn taken(skin: &TriangleMesh, ready: &PreparedPatch) -> Vec<bool> {
    let mut inside = vec![true; skin.triangles.len()];
    ready
        .outside
        .iter()
        .for_each(|t| inside[*t as usize] = false);
    inside
}

/// Connected groups of overlapping sets, as ascending lists of indices.
fn meeting(each: &[Vec<bool>]) -> Vec<Vec<usize>> {
    let meet = |a: usize, b: usize| each[a].iter().zip(&each[b]).any(|(a, b)| *a && *b);
    let mut group: Vec<usize> = (0..each.len()).collect();
    for a in 0..each.len() {
        for b in 0..a {
            if group[a] != group[b] && meet(a, b) {
                let (low, high) = (group[a].min(group[b]), group[a].max(group[b]));
                group
                    .iter_mut()
                    .filter(|g| **g == high)
                    .for_each(|g| *g = low);
            }
        }
    }
    let firsts = (0..each.len()).filter(|k| group[*k] == *k);
    firsts
        .map(|first| (first..each.len()).filter(|k| group[*k] == first).collect())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_meets_through_others_is_one_group() {
        let masks = |all: &[&str]| {
            all.iter()
                .map(|m| m.bytes().map(|b| b == b'x').collect())
                .collect::<Vec<Vec<bool>>>()
        };
        assert_eq!(
            meeting(&masks(&["xx......", "....xx..", "......xx"])),
            [vec![0], vec![1], vec![2]]
        );
        assert_eq!(
            meeting(&masks(&["xx......", "....xx..", ".xxxx...", "......xx"])),
            [vec![0, 1, 2], vec![3]]
        );
        assert_eq!(
            meeting(&masks(&["xx......", "....xx..", "xx......"])),
            [vec![0, 2], vec![1]]
        );
        assert!(meeting(&[]).is_empty());
    }
}
