//! Seeded mutations of small files through the checks of the fuzz targets, on a stable toolchain;
//! and earlier findings of fuzzing.
//!
//! `PLIANT_MUTATIONS` sets the number of mutated files per format.

use std::path::{Path, PathBuf};

use nalgebra::Point3;
use pliant::io::ReadProblem;
use pliant::io::{FilePlace, MeshFile, ReadError};
use pliant::mesh::TriangleMesh;
use pliant::testing::{
    Breach, LoadOutcome, Mutator, check_reader, check_target, dictionary, seeds,
};

/// Number of mutated files per format.
const COUNT: usize = 200_000;

/// Greatest stack of a reader [bytes].
const STACK: usize = 256 << 10;

fn fuzz() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz")
}

/// The words that libFuzzer inserts; blocks and meshes of bytes have none.
fn words(target: &str) -> Vec<Vec<u8>> {
    let path = fuzz().join(format!("dictionaries/{target}.dict"));
    std::fs::read_to_string(path)
        .map(|text| dictionary(&text))
        .unwrap_or_default()
}

/// Checks mutated files on a thread with a small stack.
fn changed_files(target: &'static str, share: usize) {
    let asked = std::env::var("PLIANT_MUTATIONS")
        .ok()
        .and_then(|n| n.parse().ok());
    let count = asked.unwrap_or(COUNT) / share;
    let deed = move || {
        let seed = 20_261_124;
        let (mut mutator, files) = (Mutator::new(seed, words(target)), seeds(target));
        let mut accepted = 0;
        for i in 0..count {
            let bytes = mutator.mutate(&files);
            match check_target(target, &bytes) {
                Ok(outcome) => accepted += usize::from(outcome == LoadOutcome::Accepted),
                Err(breach) => {
                    let path =
                        Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{target}-{i}.bin"));
                    std::fs::write(&path, &bytes).expect("the folder of tests can be written");
                    panic!(
                        "{target}, seed {seed}, file {i}, kept as {}: {breach}",
                        path.display()
                    );
                }
            }
        }
        println!("{target}: {count} changed files, {accepted} of them accepted");
        // The test would show nothing if all files were rejected at their first byte, or none was
        // changed. Any mesh can be repaired.
        let most = if target == "repair" {
            count
        } else {
            count - count / 10
        };
        assert!(
            accepted > count / 100 && accepted <= most,
            "{accepted} of {count}"
        );
    };
    let thread = std::thread::Builder::new()
        .stack_size(STACK)
        .spawn(deed)
        .expect("a thread");
    if let Err(panic) = thread.join() {
        std::panic::resume_unwind(panic);
    }
}

#[test]
fn changed_obj() {
    changed_files("obj", 1);
}

#[test]
fn changed_ply() {
    changed_files("ply", 1);
}

#[test]
fn changed_stl() {
    changed_files("stl", 1);
}

#[test]
fn changed_off() {
    changed_files("off", 1);
}

#[test]
fn changed_vtk() {
    changed_files("vtk", 1);
}

#[test]
fn changed_vtp() {
    changed_files("vtp", 1);
}

#[test]
fn changed_directx() {
    changed_files("directx", 1);
}

#[test]
fn changed_medit() {
    changed_files("medit", 1);
}

#[test]
fn changed_files_of_any_format() {
    changed_files("any", 4);
}

#[test]
fn changed_compressed_blocks() {
    changed_files("blocks", 1);
}

#[test]
fn changed_scenes() {
    changed_files("scene", 1);
}

#[test]
fn changed_meshes_are_repaired() {
    changed_files("repair", 10);
}

/// Each mutation needs a new simulation.
#[test]
fn changed_states_are_restored_or_refused() {
    changed_files("state", 100);
}

#[test]
fn changed_spring_systems() {
    changed_files("springs", 4);
}

#[test]
fn changed_collections() {
    changed_files("pvd", 1);
}

#[test]
fn models_and_motions_of_opensim() {
    changed_files("opensim", 1);
}

/// This test writes files, which takes longer than reading.
#[test]
fn meshes_of_any_bytes_come_back_from_every_writer() {
    changed_files("write", 100);
}

/// A naive reader that trusts its file: the checks must detect it.
fn trusting(bytes: &[u8]) -> Result<MeshFile, ReadError> {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for line in String::from_utf8_lossy(bytes).lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => vertices.push(Point3::from(std::array::from_fn(|_| {
                words
                    .next()
                    .and_then(|word| word.parse().ok())
                    .unwrap_or(f64::NAN)
            }))),
            Some("f") => triangles.push(std::array::from_fn(|_| {
                let index: u32 = words.next().and_then(|word| word.parse().ok()).unwrap_or(1);
                index.wrapping_sub(1)
            })),
            _ => {}
        }
    }
    let mesh = TriangleMesh {
        vertices,
        triangles,
    };
    Ok(MeshFile {
        mesh,
        ..MeshFile::default()
    })
}

/// The same reader, which panics for a word that is no number.
fn panicking(bytes: &[u8]) -> Result<MeshFile, ReadError> {
    let text = String::from_utf8_lossy(bytes);
    text.split_whitespace()
        .for_each(|word| assert!(word.len() < 9, "a word of {} bytes", word.len()));
    let vertices = vec![
        Point3::origin(),
        Point3::new(1., 0., 0.),
        Point3::new(0., 1., 0.),
    ];
    Ok(MeshFile {
        mesh: TriangleMesh {
            vertices,
            triangles: vec![[0, 1, 2]],
        },
        ..MeshFile::default()
    })
}

/// The first broken promise among mutated files of a reader.
fn first_breach(reader: fn(&[u8]) -> Result<MeshFile, ReadError>) -> Option<Breach> {
    let files = vec![b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".to_vec()];
    assert_eq!(
        check_reader(&files[0], reader),
        Ok(LoadOutcome::Accepted),
        "the file that was not changed"
    );
    let mut mutator = Mutator::new(1, words("obj"));
    (0..2000).find_map(|_| check_reader(&mutator.mutate(&files), reader).err())
}

#[test]
fn control_readers_that_trust_their_file_are_found() {
    assert!(matches!(
        first_breach(trusting),
        Some(Breach::Invalid { .. })
    ));
    assert!(
        matches!(first_breach(panicking), Some(Breach::Panicked { message }) if message.contains("a word of"))
    );
}

#[test]
fn control_errors_that_do_not_help_are_found() {
    let good = |found: &str, place| ReadError::Content {
        file: "a".into(),
        place,
        within: "".into(),
        column: Some(1),
        read_as: None,
        problem: ReadProblem::ZeroIndex,
        found: found.into(),
    };
    let check = |error| check_reader(b"f 0\nf 1", |_| Err(error));
    assert_eq!(
        check(good("0", FilePlace::Line(2))),
        Ok(LoadOutcome::Refused)
    );
    let missing = ReadError::Io {
        file: "a".into(),
        source: std::io::Error::other("no"),
    };
    let wrong = [
        good("a\nb", FilePlace::Line(1)),
        good(&"x".repeat(65), FilePlace::Line(1)),
        good("0", FilePlace::Line(0)),
        good("0", FilePlace::Line(4)),
        good("0", FilePlace::Offset(8)),
        missing,
    ];
    for error in wrong {
        let text = error.terse();
        assert!(
            matches!(check(error), Err(Breach::Unhelpful { .. })),
            "{text}"
        );
    }
}

/// Replays each `TARGET/NAME.bin` of a folder, which must have a description in `NAME.txt`. Returns
/// their number.
fn replay(folder: &Path) -> Result<usize, String> {
    let entries = |folder: &Path| -> Vec<PathBuf> {
        let mut paths: Vec<_> = std::fs::read_dir(folder)
            .into_iter()
            .flatten()
            .flatten()
            .map(|e| e.path())
            .collect();
        paths.sort();
        paths
    };
    let mut count = 0;
    for target in entries(folder).into_iter().filter(|path| path.is_dir()) {
        let name = target
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        for path in entries(&target)
            .into_iter()
            .filter(|path| path.extension().is_some_and(|e| e == "bin"))
        {
            let shown = path.display();
            let story = std::fs::read_to_string(path.with_extension("txt")).unwrap_or_default();
            if story.trim().is_empty() {
                return Err(format!("{shown} has no story beside it"));
            }
            let bytes = std::fs::read(&path).map_err(|e| format!("{shown}: {e}"))?;
            check_target(&name, &bytes).map_err(|breach| format!("{shown}: {breach}"))?;
            count += 1;
        }
    }
    Ok(count)
}

#[test]
fn what_fuzzing_found_stays_found() {
    match replay(&fuzz().join("crashes")) {
        Ok(count) => println!("{count} files that fuzzing found are replayed"),
        Err(message) => panic!("{message}"),
    }
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("crashes");
    std::fs::create_dir_all(folder.join("obj")).expect("the folder of tests can be written");
    let write = |name: &str, text: &str| {
        std::fs::write(folder.join(name), text).expect("a file can be written")
    };
    write("obj/a.txt", " ");
    write("obj/a.bin", "f");
    assert!(
        replay(&folder).is_err_and(|m| m.contains("has no story")),
        "control: a file without a story"
    );
    write("obj/a.txt", "A face without corners.");
    assert_eq!(replay(&folder), Ok(1));
}
