//! Which mistakes are made: some of each folder, by a fixed seed.

use std::collections::BTreeMap;
use std::path::Path;
use std::{fs, io};

use crate::sites::{Site, sites};

/// Least number of mistakes in a folder.
const LEAST: usize = 10;

/// A drawn mistake.
#[derive(Clone, Debug, PartialEq)]
pub struct Mutant {
    /// Its number, which the environment names.
    pub id: u32,
    /// The first folder below a `src`.
    pub folder: String,
    /// Its file, from the root.
    pub file: String,
    /// Where and what.
    pub site: Site,
    /// What stands there.
    pub right: String,
}

/// Numbers that look random: SplitMix64.
struct Random(u64);

impl Random {
    fn next(&mut self, below: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % below as u64) as usize
    }
}

/// The folder of a file of the sources; `None` for other files and for tests.
fn folder(file: &str) -> Option<String> {
    let (root, below) = [("", "src/"), ("cli/", "cli/src/")]
        .into_iter()
        .find_map(|(root, start)| Some((root, file.strip_prefix(start)?)))?;
    let is_test = |part: &str| matches!(part, "tests" | "tests.rs" | "testing");
    if !below.ends_with(".rs") || below.split('/').any(is_test) {
        return None;
    }
    let first = below.split_once('/').map_or("files of src", |(first, _)| first);
    Some(format!("{root}{first}"))
}

/// Some mistakes in each folder: about `all` of them, in proportion to its sites, and half as many
/// again, since some do not compile. `files` are relative to `root`.
///
/// # Errors
/// A file that cannot be read or parsed.
pub fn draw(root: &Path, files: &[String], all: usize, seed: u64) -> io::Result<Vec<Mutant>> {
    let mut folders: BTreeMap<String, Vec<Mutant>> = BTreeMap::new();
    for file in files {
        let Some(folder) = folder(file) else { continue };
        let text = fs::read_to_string(root.join(file))?;
        let found = sites(&text).map_err(|e| io::Error::other(format!("{file}: {e}")))?;
        folders.entry(folder.clone()).or_default().extend(found.into_iter().map(|site| Mutant {
            id: 0,
            folder: folder.clone(),
            file: file.clone(),
            right: text[site.range.clone()].to_owned(),
            site,
        }));
    }
    let sites: usize = folders.values().map(Vec::len).sum();
    let mut random = Random(seed);
    let mut drawn: Vec<Mutant> = Vec::new();
    for (_, mut of) in folders {
        let wanted = quota(all, of.len(), sites);
        let mut taken: Vec<Mutant> = Vec::new();
        while taken.len() < wanted + wanted.div_ceil(2) && !of.is_empty() {
            let next = of.swap_remove(random.next(of.len()));
            // One text cannot hold two mistakes, one in another.
            let apart = |t: &Mutant| {
                let [a, b] = [&t.site.range, &next.site.range];
                t.file != next.file || a.end <= b.start || b.end <= a.start
            };
            if taken.iter().all(apart) {
                taken.push(next);
            }
        }
        drawn.extend(taken);
    }
    for (id, mutant) in drawn.iter_mut().enumerate() {
        mutant.id = id as u32;
    }
    Ok(drawn)
}

fn quota(all: usize, of: usize, sites: usize) -> usize {
    (all * of).div_ceil(sites.max(1)).max(LEAST)
}

/// Leaves the first of each folder that compile, as many as were wanted.
pub fn cut(drawn: &mut Vec<Mutant>, refused: &[u32]) {
    let mut wanted: BTreeMap<String, usize> = BTreeMap::new();
    for mutant in drawn.iter() {
        *wanted.entry(mutant.folder.clone()).or_default() += 1;
    }
    // Half as many again were drawn.
    wanted.values_mut().for_each(|n| *n = (*n * 2).div_ceil(3));
    drawn.retain(|mutant| !refused.contains(&mutant.id));
    let mut seen: BTreeMap<String, usize> = BTreeMap::new();
    drawn.retain(|mutant| {
        let n = seen.entry(mutant.folder.clone()).or_default();
        *n += 1;
        *n <= wanted[&mutant.folder]
    });
}
