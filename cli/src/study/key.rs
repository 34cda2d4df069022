//! All inputs of a run's result, as a text for comparison and as a file name.

use std::collections::HashMap;
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use pliant::scene::content::{Content, SkinSurface, Staged};
use pliant::scene::{Area, Scene, Source};

/// Version of the layout of stored results: another number invalidates all old ones.
const LAYOUT: u32 = 1;

/// The FNV-1a hash with 128 bits: no protection against intent, but accidental collisions are
/// practically impossible.
#[derive(Clone, Copy)]
struct Hash(u128);

impl Hash {
    const fn new() -> Self {
        Self(0x6c62_272e_07bb_0142_62b8_2175_6295_c58d)
    }

    fn add(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.0 =
                (self.0 ^ u128::from(byte)).wrapping_mul(0x0000_0000_0100_0000_0000_0000_0000_013b);
        }
    }
}

/// Hashes of files, each read once.
#[derive(Debug, Default)]
pub struct Contents(HashMap<PathBuf, u128>);

impl Contents {
    fn of(&mut self, path: &Path) -> io::Result<u128> {
        if let Some(hash) = self.0.get(path) {
            return Ok(*hash);
        }
        let mut file = File::open(path)?;
        let (mut hash, mut block) = (Hash::new(), vec![0; 1 << 16]);
        loop {
            match file.read(&mut block)? {
                0 => break,
                count => hash.add(&block[..count]),
            }
        }
        self.0.insert(path.to_owned(), hash.0);
        Ok(hash.0)
    }
}

/// The scene in SI units with every change, the contents of its files, this program, and the stored
/// frames.
///
/// # Errors
/// A file that cannot be read.
pub fn key_of(content: &Content, frames: &[usize], contents: &mut Contents) -> io::Result<String> {
    let mut key = format!("layout {LAYOUT}\npliant {}", env!("CARGO_PKG_VERSION"));
    // Another build of the same version can compute other results; if the program cannot be read,
    // the version is used.
    if let Ok(program) = std::env::current_exe().and_then(|path| contents.of(&path)) {
        let _ = write!(key, " {program:032x}");
    }
    let _ = write!(key, "\nframes {frames:?}");
    for path in files(content) {
        let _ = write!(key, "\nfile {} {:032x}", path.display(), contents.of(path)?);
    }
    // Numbers are the shortest texts that read back to the same bits.
    let _ = write!(key, "\n{content:?}");
    Ok(key)
}

fn files(content: &Content) -> Vec<&PathBuf> {
    let sources: Vec<&Source> = match content {
        Content::Muscles(scene) => sources(scene).collect(),
        Content::Staged(Staged::Skin(scene)) => {
            let skin = match &scene.skin.surface {
                SkinSurface::Source(source) => Some(source),
                SkinSurface::Sheet { .. } => None,
            };
            skin.into_iter()
                .chain(scene.obstacles.iter().map(|o| &o.surface))
                .collect()
        }
        Content::Staged(Staged::Lattice(_)) => Vec::new(),
    };
    sources.into_iter().filter_map(path_of).collect()
}

fn sources(scene: &Scene) -> impl Iterator<Item = &Source> {
    let bones = scene.bones.iter().map(|bone| &bone.surface);
    let muscles = scene.muscles.iter().flat_map(|muscle| {
        let patches = muscle.attachments.iter().filter_map(|a| match &a.area {
            Area::Patch { source, .. } => Some(source),
            Area::Near(_) | Area::Vertices(_) => None,
        });
        std::iter::once(&muscle.surface)
            .chain(&muscle.fibres)
            .chain(patches)
    });
    bones.chain(muscles)
}

fn path_of(source: &Source) -> Option<&PathBuf> {
    match source {
        Source::File { path, .. } => Some(path),
        Source::Shape(_) => None,
    }
}

/// The name of a file for a key.
pub fn name_of(key: &str) -> String {
    let mut hash = Hash::new();
    hash.add(key.as_bytes());
    format!("{:032x}", hash.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pliant::scene::builtin::load_content;

    #[test]
    fn the_hash_is_the_published_one() {
        // FNV-1a, 128 bits, of the empty text and of "foobar".
        assert_eq!(name_of(""), "6c62272e07bb014262b821756295c58d");
        assert_eq!(name_of("foobar"), "343e1662793c64bf6f0d3597ba446f18");
    }

    #[test]
    fn whatever_may_change_a_result_changes_its_key() {
        let key = |changes: &[&str], frames: &[usize]| {
            let changes: Vec<String> = changes.iter().map(|&c| c.to_owned()).collect();
            key_of(
                &load_content("distance", &changes).unwrap(),
                frames,
                &mut Contents::default(),
            )
            .unwrap()
        };
        assert_eq!(key(&[], &[1, 2]), key(&[], &[1, 2]));
        assert_eq!(
            key(&["solver.pbd.iterations=3"], &[1]),
            key(&["iterations=3"], &[1]),
            "however it is written"
        );
        let all = [
            key(&[], &[1]),
            key(&[], &[2]),
            key(&["iterations=4"], &[1]),
            key(&["frames=7"], &[1]),
            key(
                &["muscle.0.force.0.force=[\"0 N\", \"-10.000000000000002 N\", \"0 N\"]"],
                &[1],
            ),
        ];
        for (k, one) in all.iter().enumerate() {
            assert!(
                all[..k]
                    .iter()
                    .all(|other| other != one && name_of(other) != name_of(one)),
                "{one}"
            );
        }
    }
}
