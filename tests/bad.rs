//! The folder `tests/bad`: invalid or unusual files, each with the exact text of its messages.
//!
//! `NNN_name.ext` has the number of its row in the catalogue of bad inputs. At least one
//! expectation is beside it: `NNN_name.err`, the error in one line; `NNN_name.ok`, the content with
//! warnings; `NNN_name.check`, the defects of the mesh and the changes by a repair. `NNN_name.gen`
//! generates a file that is too large or too unusual to be stored. Referenced files are in
//! `tests/bad/meshes`.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use pliant::io;
use pliant::mesh::{Health, RepairOptions, repair};
use pliant::scene::builtin;
use pliant::simulation::Simulation;

/// Examines a file and returns the text.
type Look = fn(&Path) -> String;

/// The kinds of expectations with their functions, one line each.
const EXPECTATIONS: [(&str, Look); 3] = [("err", refused), ("ok", accepted), ("check", examined)];

/// The text for a file that must be rejected.
fn refused(path: &Path) -> String {
    match look(path) {
        Ok(read) => format!("not refused: {read}"),
        Err(error) => error,
    }
}

/// The content of a file that must be accepted.
fn accepted(path: &Path) -> String {
    look(path).unwrap_or_else(|error| format!("not accepted: {error}"))
}

/// The content, or the error in one line.
fn look(path: &Path) -> Result<String, String> {
    if path.extension().is_some_and(|e| e == "toml") {
        let scene = builtin::load(&path.display().to_string(), &[]).map_err(|e| e.terse())?;
        let (bones, muscles) = (scene.bones.len(), scene.muscles.len());
        Simulation::new(scene).map_err(|e| e.terse())?;
        return Ok(format!("{bones} bones, {muscles} muscles"));
    }
    let file = io::read(path).map_err(|e| e.terse())?;
    let format = file.format.map_or("no format", io::Format::name);
    let (vertices, triangles, lines) = (
        file.mesh.vertices.len(),
        file.mesh.triangles.len(),
        file.lines.len(),
    );
    let hash = fingerprint(&file);
    let mut text = format!(
        "{format}: {vertices} vertices, {triangles} triangles, {lines} lines, fingerprint {hash:016x}"
    );
    for warned in file.warnings.iter() {
        text.push('\n');
        text.push_str(&warned.terse(&path.display().to_string()));
    }
    Ok(text)
}

/// The defects of a mesh, the changes by a repair, and the remaining defects.
fn examined(path: &Path) -> String {
    let file = match io::read(path) {
        Ok(file) => file,
        Err(error) => return error.terse(),
    };
    let verdict = |health: &Health| {
        let genus = health
            .genus
            .map_or_else(|| "none".to_owned(), |g| g.to_string());
        let fit = if health.is_fit() { "fit" } else { "refused" };
        format!(
            "{fit}, {} pieces, genus {genus}, volume {:.6}\n",
            health.components, health.volume
        )
    };
    let health = Health::of(&file.mesh);
    let mut text = verdict(&health);
    for finding in &health.findings {
        text.push_str(&format!(
            "{}: {}; {}\n",
            finding.kind.code(),
            finding.message,
            finding.kind.repair()
        ));
    }
    let repaired = repair(
        &file.mesh,
        &file.lines,
        &RepairOptions {
            close_holes: 9,
            ..Default::default()
        },
    );
    for change in &repaired.changes {
        text.push_str(&format!(
            "repair: {} {:?}\n",
            change.message, change.elements
        ));
    }
    text.push_str(&format!(
        "then {}",
        verdict(&Health::of(&repaired.mesh)).trim_end()
    ));
    text
}

/// A hash of every bit of a mesh (FNV-1a), to compare two files that must give the same mesh.
fn fingerprint(file: &io::MeshFile) -> u64 {
    let coordinates = file
        .mesh
        .vertices
        .iter()
        .flat_map(|v| [v.x, v.y, v.z].map(f64::to_bits));
    let corners = file
        .mesh
        .triangles
        .iter()
        .flatten()
        .chain(file.lines.iter().flatten())
        .map(|&i| u64::from(i));
    let bytes = coordinates.chain(corners).flat_map(u64::to_le_bytes);
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// A generated file, and its length if that exceeds its bytes.
struct Made {
    extension: String,
    bytes: Vec<u8>,
    sparse: Option<u64>,
}

/// Follows the instructions of a generator, one per line: `as EXT`, `text ...` with `\n`, `\r`,
/// `\t`, `\\` and `\xNN`, `hex NN ...`, `times N` before one of these two, `sparse N`; a line that
/// begins with `#` is a comment.
fn generate(instructions: &str) -> Result<Made, String> {
    let mut made = Made {
        extension: String::new(),
        bytes: Vec::new(),
        sparse: None,
    };
    for line in instructions
        .lines()
        .filter(|l| !l.is_empty() && !l.starts_with('#'))
    {
        let (times, line) = match line
            .strip_prefix("times ")
            .and_then(|rest| rest.split_once(' '))
        {
            Some((count, rest)) => (
                count.parse().map_err(|_| format!("no count: {count}"))?,
                rest,
            ),
            None => (1, line),
        };
        let wrong = || format!("no instruction: {line}");
        let (word, rest) = line.split_once(' ').ok_or_else(wrong)?;
        match word {
            "as" => rest.clone_into(&mut made.extension),
            "text" => made
                .bytes
                .extend(unescaped(rest).ok_or_else(wrong)?.repeat(times)),
            "hex" => {
                let bytes = rest
                    .split(' ')
                    .map(|b| u8::from_str_radix(b, 16))
                    .collect::<Result<Vec<u8>, _>>();
                made.bytes.extend(bytes.map_err(|_| wrong())?.repeat(times));
            }
            "sparse" => made.sparse = Some(rest.parse().map_err(|_| wrong())?),
            _ => return Err(wrong()),
        }
    }
    if made.extension.is_empty() {
        Err("`as EXT` is missing".to_owned())
    } else {
        Ok(made)
    }
}

fn unescaped(text: &str) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut rest = text.bytes();
    while let Some(byte) = rest.next() {
        bytes.push(match byte {
            b'\\' => match rest.next()? {
                b'n' => b'\n',
                b'r' => b'\r',
                b't' => b'\t',
                b'\\' => b'\\',
                b'x' => u8::from_str_radix(str::from_utf8(&[rest.next()?, rest.next()?]).ok()?, 16)
                    .ok()?,
                _ => return None,
            },
            other => other,
        });
    }
    Some(bytes)
}

/// Writes the file of a generator; it is removed after the examination.
fn make(generator: &Path, stem: &str) -> Result<PathBuf, String> {
    let text = fs::read_to_string(generator).map_err(|e| e.to_string())?;
    let made = generate(&text)?;
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("bad");
    let path = folder.join(format!("{stem}.{}", made.extension));
    let write = || -> std::io::Result<()> {
        fs::create_dir_all(&folder)?;
        fs::write(&path, &made.bytes)?;
        if let Some(length) = made.sparse {
            fs::File::options()
                .write(true)
                .open(&path)?
                .set_len(length)?;
        }
        Ok(())
    };
    write().map_err(|e| e.to_string())?;
    Ok(path)
}

/// The fixtures of a folder by stem, with their expectations.
fn pairs(folder: &Path) -> BTreeMap<String, (Vec<PathBuf>, Vec<PathBuf>)> {
    let mut all: BTreeMap<String, (Vec<PathBuf>, Vec<PathBuf>)> = BTreeMap::new();
    for entry in fs::read_dir(folder)
        .expect("the folder can be read")
        .map(|e| e.expect("an entry"))
    {
        let path = entry.path();
        let part = |part: Option<&std::ffi::OsStr>| {
            part.unwrap_or_default().to_string_lossy().into_owned()
        };
        let (stem, extension) = (part(path.file_stem()), part(path.extension()));
        if path.is_dir() || extension == "md" {
            continue;
        }
        let (fixtures, expectations) = all.entry(stem).or_default();
        let expected = EXPECTATIONS.iter().any(|(ending, _)| *ending == extension);
        if expected {
            expectations.push(path)
        } else {
            fixtures.push(path)
        }
    }
    all
}

/// All deviations in a folder, and the number of fixtures.
fn faults(folder: &Path) -> (Vec<String>, usize) {
    let (mut faults, mut count) = (Vec::new(), 0);
    for (stem, (fixtures, expectations)) in pairs(folder) {
        let [fixture] = fixtures.as_slice() else {
            faults.push(format!(
                "{stem}: {} fixtures instead of one",
                fixtures.len()
            ));
            continue;
        };
        count += 1;
        if expectations.is_empty() {
            faults.push(format!(
                "{stem}: no expectation, {stem}.err, {stem}.ok or {stem}.check"
            ));
        }
        let made = if fixture.extension().is_some_and(|e| e == "gen") {
            Some(make(fixture, &stem))
        } else {
            None
        };
        let path = match &made {
            None => fixture,
            Some(Ok(path)) => path,
            Some(Err(why)) => {
                faults.push(format!("{stem}.gen: {why}"));
                continue;
            }
        };
        for expectation in expectations {
            let expected = fs::read_to_string(&expectation).unwrap_or_default();
            let ending = expectation.extension().unwrap_or_default();
            for (_, look) in EXPECTATIONS.iter().filter(|(known, _)| ending == *known) {
                // Fixtures are named without their folder, which differs between machines.
                let parent = path.parent().unwrap_or(folder).display().to_string();
                let found = look(path).replace(&format!("{parent}/"), "");
                if found != expected.trim_end_matches('\n') {
                    faults.push(format!(
                        "{}:\n  found  {found}\n  expected {}",
                        expectation.display(),
                        expected.trim_end()
                    ));
                }
            }
        }
        if made.is_some() {
            let _ = fs::remove_file(path);
        }
    }
    (faults, count)
}

#[test]
fn every_bad_file_is_treated_as_expected() {
    let (faults, count) = faults(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/bad"));
    println!("{count} fixtures");
    assert!(
        faults.is_empty(),
        "{} of {count}:\n{}",
        faults.len(),
        faults.join("\n")
    );
    assert!(count >= 80, "only {count} fixtures");
}

/// Names and texts of the files of a folder.
type Files<'a> = &'a [(&'a str, &'a str)];

/// The deviations in a folder of one test with these files.
fn faults_of(name: &str, files: Files<'_>) -> Vec<String> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("bad-{name}"));
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).expect("the folder of tests can be written");
    for (name, text) in files {
        fs::write(folder.join(name), text).expect("the folder of tests can be written");
    }
    let (faults, _) = faults(&folder);
    fs::remove_dir_all(&folder).expect("the folder of tests can be written");
    faults
}

#[test]
fn control_each_kind_of_fault_is_found() {
    let right = "a.obj: error[E001]: the file is empty; the file is cut off or damaged: copy or export it again\n";
    assert_eq!(
        faults_of("right", &[("a.obj", ""), ("a.err", right)]),
        [""; 0]
    );
    assert_eq!(
        faults_of("made", &[("a.gen", "# why\nas obj\n"), ("a.err", right)]),
        [""; 0]
    );
    let cases: [(&str, Files<'_>, &str); 7] = [
        ("no-expectation", &[("a.obj", "")], "a: no expectation"),
        ("no-fixture", &[("a.err", right)], "a: 0 fixtures"),
        (
            "two-fixtures",
            &[("a.obj", ""), ("a.ply", ""), ("a.err", right)],
            "a: 2 fixtures",
        ),
        (
            "other-text",
            &[("a.obj", "# no bytes\n"), ("a.err", right)],
            "error[E002]",
        ),
        (
            "not-refused",
            &[("a.obj", "v 0 0 0\nv 1 0 0\nl 1 2\n"), ("a.err", right)],
            "not refused: OBJ: 2 vertices",
        ),
        (
            "not-accepted",
            &[("a.obj", ""), ("a.ok", "OBJ")],
            "not accepted: a.obj: error[E001]",
        ),
        (
            "no-generator",
            &[("a.gen", "as obj\nbytes 3\n"), ("a.err", right)],
            "a.gen: no instruction: bytes 3",
        ),
    ];
    for (name, files, expected) in cases {
        let found = faults_of(name, files);
        assert!(
            found.len() == 1 && found[0].contains(expected),
            "{name}: {found:?}"
        );
    }
}

#[test]
fn generators_give_the_bytes_they_say() {
    let made =
        generate("as x\ntext a\\n\\\\\\x00 \ntimes 2 hex 0a ff\ntimes 3 text bc\nsparse 99\n")
            .expect("a file");
    assert_eq!((made.extension.as_str(), made.sparse), ("x", Some(99)));
    assert_eq!(made.bytes, b"a\n\\\0 \x0a\xff\x0a\xffbcbcbc");
    for wrong in [
        "",
        "as x\ntext \\q",
        "as x\nhex zz",
        "as x\ntimes a text b",
        "as x\nsparse",
        "as x\ntext \\x0",
    ] {
        assert!(generate(wrong).is_err(), "{wrong}");
    }
}
