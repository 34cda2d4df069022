//! All inputs of a run's result, as a text for comparison and as a file name.

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use pliant::scene::{AreaSpec, Content, Scene, SkinSurface, Source};
use pliant::state::Hash;
use pliant::text_of;

/// Version of the layout of stored results: another number invalidates all old ones.
const LAYOUT: u32 = 2;

/// Hashes of files, each read once.
#[derive(Debug, Default)]
pub struct Contents(HashMap<PathBuf, u128>);

impl Contents {
    fn of(&mut self, path: &Path) -> io::Result<u128> {
        if let Some(hash) = self.0.get(path) {
            return Ok(*hash);
        }
        let mut file = File::open(path)?;
        let (mut hash, mut block) = (Hash::default(), vec![0; 1 << 16]);
        loop {
            match file.read(&mut block)? {
                0 => break,
                count => hash.add(&block[..count]),
            }
        }
        self.0.insert(path.to_owned(), hash.value());
        Ok(hash.value())
    }
}

/// The scene in SI units with every change, the contents of its files, this program, and the stored
/// frames.
///
/// # Errors
/// A file that cannot be read.
pub fn key_of(content: &Content, frames: &[usize], contents: &mut Contents) -> io::Result<String> {
    let mut hashes = Vec::new();
    for path in files(content) {
        hashes.push((path, contents.of(path)?));
    }
    Ok(key_with(pliant::DIGEST, content, frames, &hashes))
}

fn key_with(
    library: &str,
    content: &Content,
    frames: &[usize],
    files: &[(&PathBuf, u128)],
) -> String {
    let version = env!("CARGO_PKG_VERSION");
    let mut key = format!("layout {LAYOUT}\npliant {version} {library}\n");
    key.push_str(&text_of("frames", frames));
    for (path, hash) in files {
        key.push_str(&text_of("file", *path));
        key.push_str(&format!("{hash:032x}\n"));
    }
    key.push_str(&text_of(content.kind(), content));
    key
}

fn files(content: &Content) -> Vec<&PathBuf> {
    let sources: Vec<&Source> = match content {
        Content::Muscles(scene) => sources(scene).collect(),
        Content::Skin(scene) => {
            let skin = match &scene.skin.surface {
                SkinSurface::Source(source) => Some(source),
                SkinSurface::Sheet { .. } => None,
            };
            skin.into_iter()
                .chain(scene.obstacles.iter().map(|o| &o.surface))
                .collect()
        }
        _ => Vec::new(),
    };
    sources.into_iter().filter_map(path_of).collect()
}

fn sources(scene: &Scene) -> impl Iterator<Item = &Source> {
    let bones = scene.bones.iter().map(|bone| &bone.surface);
    let muscles = scene.muscles.iter().flat_map(|muscle| {
        let patches = muscle.attachments.iter().filter_map(|a| match &a.area {
            AreaSpec::Patch { source, .. } => Some(source),
            AreaSpec::Near(_) | AreaSpec::Vertices(_) => None,
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
        Source::Shape(_) | Source::Given { .. } => None,
    }
}

/// The name of a file for a key.
pub fn name_of(key: &str) -> String {
    format!("{:032x}", Hash::of(key.as_bytes()))
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
    fn another_library_makes_another_key_and_another_command_the_same() {
        let scene = load_content("distance", &[]).unwrap();
        let key = |library: &str| key_with(library, &scene, &[1], &[]);
        assert_ne!(key(pliant::DIGEST), key(&"0".repeat(32)));
        let own = key_of(&scene, &[1], &mut Contents::default()).unwrap();
        assert_eq!(own, key(pliant::DIGEST));
        // The program that runs this test is not the command. Its path and bytes are not part of
        // the key.
        let program = std::env::current_exe().unwrap();
        let bytes = format!("{:032x}", Contents::default().of(&program).unwrap());
        assert!(!own.contains(&bytes) && !own.contains(&*program.to_string_lossy()));
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
