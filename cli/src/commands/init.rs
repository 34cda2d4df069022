//! `pliant init`: a scene of muscles from meshes, each guess a line that can be changed.

mod files;

use std::collections::HashSet;
use std::fmt::Write as _;
use std::io::{IsTerminal, Write as _};
use std::path::{Path, PathBuf};

use super::failure::Failure;
use super::from_meshes::{HERE, examine, named, parse};
use super::options::Output;
use super::{length_unit, note, run, say, warn};
use crate::draft::attachments::Attachment;
use crate::draft::joint::{self, JOINTS, Joint, KnownJoint, NamedBone, NoJoint};
use crate::draft::mending::mended;
use crate::draft::names::{self, Kind};
use crate::draft::{Body, Draft};
use pliant::contact::Surface;
use pliant::io::{self, FORMATS, file_name};
use pliant::mesh::TriangleMesh;
use pliant::scene::likely_units;
use pliant::simulation::Assets;

/// Frames of the trial.
const TRIED: u32 = 10;

/// Write a scene of muscles and bones from their meshes, and try its first frames
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant init scans --joint knee
  pliant init scans --joint knee --between Femur.r Tibia.r --unit mm
  pliant init Femur.stl Hip_bone.stl Iliacus.stl Psoas.stl

Reads every mesh of a folder. Names tell bones from muscles (--bones and --muscles for others) and find the
joint. A sphere is fitted to a head, and the axis of a hinge is the line through two condyles. Bones within
3 mm hold a muscle; an end that is farther away is held by the bone nearest to it. Meshes that a simulation
refuses are repaired. Uneven and very fine meshes are remeshed. NAME.toml has every guess as a line with
its reason. Then the first ten frames are run, with a report. Next:
  pliant plan NAME.toml
  pliant run NAME.toml

Exit codes: 0 every check of the ten frames passes; 1 one fails; 2 bad input, a bone is missing, or a guess is
not certain: the message says which option decides.")]
pub(super) struct Arguments {
    /// Meshes of bones and muscles, or folders of them
    #[arg(required = true, value_name = "MESH")]
    meshes: Vec<PathBuf>,
    /// The joint that moves: hip, knee, ankle, shoulder, elbow; none for bones that rest
    /// [default: the one that most muscles cross]
    #[arg(long, value_name = "NAME")]
    joint: Option<String>,
    /// The two bones of the joint, by the names of their files
    #[arg(long, value_name = "BONE", num_args = 2, requires = "joint")]
    between: Option<Vec<String>>,
    /// Length unit of the files, such as mm [default: from the sizes of known bones]
    #[arg(long, value_name = "UNIT")]
    unit: Option<String>,
    /// Files that are bones, by name, where names do not tell
    #[arg(long, value_name = "NAME", num_args = 1..)]
    bones: Vec<String>,
    /// Files that are muscles, by name, where names do not tell
    #[arg(long, value_name = "NAME", num_args = 1..)]
    muscles: Vec<String>,
    /// Files to leave out, by name
    #[arg(long, value_name = "NAME", num_args = 1..)]
    without: Vec<String>,
    /// The scene file to write [default: NAME.toml, named after the joint]
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Overwrite an existing scene file, and remove its patches
    #[arg(long)]
    force: bool,
    /// Write the scene, and run no frame
    #[arg(long)]
    no_trial: bool,
    #[command(flatten)]
    output: Output,
}

impl Arguments {
    /// Files of bones that rest, and of muscles, in a unit; no frame is run.
    pub(super) fn of_files(
        bones: &[PathBuf],
        muscles: &[PathBuf],
        (unit, scene): (&str, &Path),
        output: Output,
    ) -> Self {
        let names = |files: &[PathBuf]| {
            let stems = files.iter().filter_map(|file| file.file_name());
            stems
                .map(|name| name.to_string_lossy().into_owned())
                .collect()
        };
        Self {
            meshes: bones.iter().chain(muscles).cloned().collect(),
            joint: Some("none".to_owned()),
            between: None,
            unit: Some(unit.to_owned()),
            bones: names(bones),
            muscles: names(muscles),
            without: Vec::new(),
            scene: Some(scene.to_owned()),
            force: true,
            no_trial: true,
            output,
        }
    }
}

/// A mesh with its kind.
struct Read {
    body: Body,
    kind: Kind,
    mesh: TriangleMesh,
}

impl Read {
    /// Its longest side, in the unit of its file.
    fn size(&self) -> f64 {
        self.mesh.bounding_box().extents().max()
    }

    /// The bone that its name tells, if it is one.
    fn known_bone(&self) -> Option<&'static names::KnownBone> {
        names::known_bone(&self.body.name).filter(|_| self.kind == Kind::Bone)
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let wanted = match arguments.joint.as_deref() {
        None | Some("none") => None,
        Some(name) => Some(joint::known(name).ok_or_else(|| unknown_joint(name))?),
    };
    let files = files(arguments)?;
    let read = read(arguments, &files)?;
    let (unit, unit_why) = unit(arguments, &read)?;
    let mut draft = Draft {
        unit,
        unit_why,
        ..Draft::default()
    };
    for Read { body, kind, .. } in read {
        match kind {
            Kind::Bone => draft.bones.push(body),
            Kind::Muscle => draft.muscles.push(body),
        }
    }
    if draft.muscles.is_empty() {
        return Err(Failure::usage(
            "none of the files is a muscle",
            "add one, or name it with --muscles",
        ));
    }
    draft.name = wanted.map_or("meshes", |joint| joint.name).to_owned();
    let assets = Assets::load(&parse(&draft.toml(), HERE, &[])?).map_err(Failure::of_meshes)?;
    draft.joint = joint(arguments, wanted, &draft, &assets)?;
    if let Some(joint) = &draft.joint {
        draft.name = joint.known.name.to_owned();
    }
    let path = arguments
        .scene
        .clone()
        .unwrap_or_else(|| PathBuf::from(format!("{}.toml", file_name(&draft.name))));
    draft.name = path
        .file_stem()
        .map_or(draft.name, |stem| stem.to_string_lossy().into_owned());
    if path.exists() && !arguments.force {
        return Err(Failure::usage(
            format!("{} is there already", path.display()),
            "name another file with --scene, or add --force",
        ));
    }
    let folder = path.parent().unwrap_or(Path::new("")).to_owned();
    files::can_be_written(&path, &folder)?;
    draft.parts = path.with_extension("meshes").file_name().map(PathBuf::from);
    examine(&mut draft, &[])?;
    let loose = draft.loose();
    if !loose.is_empty() {
        let mut names: Vec<&str> = loose.iter().filter_map(|l| l.split(':').next()).collect();
        names.dedup();
        let quoted = names.iter().map(|name| match name.contains(' ') {
            true => format!("'{name}'"),
            false => (*name).to_owned(),
        });
        let quoted: Vec<String> = quoted.collect();
        return Err(Failure::usage(
            loose.join("; "),
            format!(
                "add the bones that hold them, or leave the muscles out with --without {}",
                quoted.join(" ")
            ),
        ));
    }
    let toml = files::heading(&path) + &draft.toml();
    let before = std::fs::read_to_string(&path).unwrap_or_default();
    for (file, mesh) in draft.files() {
        files::write_mesh(&folder.join(file), mesh)?;
    }
    parse(&toml, &folder, &[])?;
    files::write(&path, &toml)?;
    files::remove_replaced(&before, &path, &draft, &files);
    tell(arguments, &in_words(&draft, &path));
    if arguments.no_trial {
        return Ok(super::DONE);
    }
    trial(arguments, &path)
}

/// Writes a text where it disturbs no JSON.
fn tell(arguments: &Arguments, text: &str) {
    let printing = &arguments.output.printing;
    match printing.json {
        true => note(text.trim_end()),
        false if !printing.quiet => say(text),
        false => {}
    }
}

fn unknown_joint(name: &str) -> Failure {
    let known: Vec<&str> = JOINTS.iter().map(|joint| joint.name).collect();
    Failure::usage(
        format!("`{name}` is no joint that is known here"),
        format!(
            "known: {}; or `--joint none`, and write [bone.motion] in the scene",
            known.join(", ")
        ),
    )
}

/// Files, and the meshes in folders, by name.
pub(super) fn mesh_files(meshes: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let mut all = Vec::new();
    for path in meshes {
        if !path.is_dir() {
            all.push(path.clone());
            continue;
        }
        let unreadable = |e: std::io::Error| {
            Failure::usage(format!("{}: {e}", path.display()), "name another folder")
        };
        let mut inside = Vec::new();
        for entry in std::fs::read_dir(path).map_err(unreadable)? {
            let file = entry.map_err(unreadable)?.path();
            let ending = file.extension().map(|e| e.to_string_lossy().to_lowercase());
            if ending.is_some_and(|ending| FORMATS.iter().any(|known| known.ending == ending)) {
                inside.push(file);
            }
        }
        if inside.is_empty() {
            return Err(Failure::usage(
                format!("{}: there is no mesh in this folder", path.display()),
                "name a folder of mesh files, or the files",
            ));
        }
        inside.sort();
        all.extend(inside);
    }
    Ok(all)
}

/// The files: those named, and the meshes in folders, without those to leave out.
fn files(arguments: &Arguments) -> Result<Vec<PathBuf>, Failure> {
    let mut all = mesh_files(&arguments.meshes)?;
    let is_left_out = |file: &PathBuf| arguments.without.iter().any(|name| is_named(file, name));
    for name in [&arguments.without, &arguments.bones, &arguments.muscles]
        .into_iter()
        .flatten()
    {
        if !all.iter().any(|file| is_named(file, name)) {
            return Err(Failure::usage(
                format!("no file is named `{name}`"),
                "give the name of a file without its ending",
            ));
        }
    }
    all.retain(|file| !is_left_out(file));
    Ok(all)
}

/// Whether a file has this name, without its ending; small and capital letters are the same.
fn is_named(file: &Path, name: &str) -> bool {
    let same = |part: Option<&std::ffi::OsStr>| {
        part.is_some_and(|part| part.to_string_lossy().eq_ignore_ascii_case(name))
    };
    same(file.file_stem()) || same(file.file_name())
}

/// Reads the files, and tells what each of them is.
fn read(arguments: &Arguments, files: &[PathBuf]) -> Result<Vec<Read>, Failure> {
    let bodies = named(files, &mut HashSet::new())?;
    let mut all = Vec::new();
    for (file, mut body) in files.iter().zip(bodies) {
        let has = |names: &[String]| names.iter().any(|name| is_named(file, name));
        let told = names::kind(&body.name);
        let (kind, why) = match (has(&arguments.bones), has(&arguments.muscles), told) {
            (true, false, _) => (Kind::Bone, String::new()),
            (false, true, _) => (Kind::Muscle, String::new()),
            (true, true, _) => {
                return Err(Failure::usage(
                    format!("{} is named by --bones and by --muscles", file.display()),
                    "leave it out of one of them",
                ));
            }
            (false, false, Some((kind, word))) => (kind, format!("by its name: {word}")),
            (false, false, None) => {
                return Err(Failure::usage(
                    format!(
                        "{}: its name does not tell whether it is a bone or a muscle",
                        file.display()
                    ),
                    format!(
                        "add `--bones {0}` or `--muscles {0}`, or leave it out with `--without {0}`",
                        body.name
                    ),
                ));
            }
        };
        let mesh = io::read(file)
            .map_err(|error| Failure::of_meshes(Box::new(error).into()))?
            .mesh;
        body.why = why;
        body.mended = mended(&mesh).map_err(|defects| {
            Failure::usage(
                format!("{}: no repair makes it fit: {defects}", file.display()),
                format!("see `pliant check {}`", file.display()),
            )
        })?;
        all.push(Read { body, kind, mesh });
    }
    Ok(all)
}

/// The unit of the files, and where it comes from: the user, the sizes of bones that names tell, or the
/// sizes of all.
fn unit(arguments: &Arguments, read: &[Read]) -> Result<(String, String), Failure> {
    if let Some(unit) = &arguments.unit {
        length_unit(unit)?;
        return Ok((unit.clone(), String::new()));
    }
    let largest = read.iter().max_by(|a, b| a.size().total_cmp(&b.size()));
    let largest = largest.map_or(0.0, Read::size);
    let plausible: Vec<(&str, f64)> = likely_units(largest)
        .into_iter()
        .filter(|(unit, _)| suits_bones(unit, read))
        .collect();
    let known = read.iter().find(|r| r.known_bone().is_some());
    match (plausible.as_slice(), known) {
        ([(unit, _)], Some(bone)) => {
            let mm = 1e3 * bone.size() * length_unit(unit)?;
            let why = format!("{} is then {mm:.0} mm long", bone.body.name);
            Ok(((*unit).to_owned(), why))
        }
        (some, bone) => {
            let why = match (some, bone) {
                ([], Some(bone)) => format!("no unit of length suits {}", bone.body.name),
                _ => "the sizes of the meshes do not tell their unit".to_owned(),
            };
            let first = some.first().map_or("mm", |(unit, _)| unit);
            asked(&why, first).map_or_else(
                || {
                    Err(Failure::usage(
                        why.clone(),
                        format!("add it, for example --unit {first}"),
                    ))
                },
                |unit| {
                    length_unit(&unit)?;
                    Ok((unit, "as answered".to_owned()))
                },
            )
        }
    }
}

/// Whether all bones that names tell have a size that such a bone can have, in this unit.
fn suits_bones(unit: &str, read: &[Read]) -> bool {
    let metres = length_unit(unit).unwrap_or(f64::NAN);
    let mut known = read.iter().filter_map(|r| Some((r.known_bone()?, r)));
    known.all(|(bone, r)| (bone.length[0]..=bone.length[1]).contains(&(r.size() * metres)))
}

/// The answer of the user to the question for the unit; `None` if nobody sits at a terminal.
fn asked(why: &str, first: &str) -> Option<String> {
    if !std::io::stdin().is_terminal() || !std::io::stderr().is_terminal() {
        return None;
    }
    let _ = write!(std::io::stderr(), "{why}; unit [{first}]: ");
    let mut answer = String::new();
    std::io::stdin().read_line(&mut answer).ok()?;
    let answer = answer.trim();
    Some(if answer.is_empty() { first } else { answer }.to_owned())
}

/// The joint that moves.
fn joint(
    arguments: &Arguments,
    wanted: Option<&'static KnownJoint>,
    draft: &Draft,
    assets: &Assets,
) -> Result<Option<Joint>, Failure> {
    if arguments.joint.as_deref() == Some("none") {
        return Ok(None);
    }
    let surfaces: Vec<Surface> = assets.bones.iter().map(Surface::new).collect();
    let bones: Vec<NamedBone<'_>> = draft
        .bones
        .iter()
        .zip(assets.bones.iter().zip(&surfaces))
        .map(|(body, (mesh, surface))| NamedBone {
            name: &body.name,
            mesh,
            surface,
        })
        .collect();
    let no_joint = |error: NoJoint| {
        let hint = match &error {
            NoJoint::MissingBone { .. } => {
                "add its mesh, or name the two bones of the joint with --between"
            }
            NoJoint::NoFit { .. } | NoJoint::NoSense { .. } => {
                "check both bones and the unit; or use `--joint none`, and write [bone.motion] in the scene"
            }
        };
        Failure::usage(error.to_string(), hint)
    };
    if let Some(known) = wanted {
        let chosen = between(arguments, &bones)?;
        return known.fit(&bones, chosen).map(Some).map_err(no_joint);
    }
    let mut possible = Vec::new();
    for known in JOINTS.iter().filter(|known| known.is_among(&bones)) {
        let joint = known.fit(&bones, None).map_err(no_joint)?;
        possible.push((crossing(&joint, draft, assets, &surfaces), joint));
    }
    // The first of those that most muscles cross.
    let most = possible.iter().map(|(count, _)| *count).max().unwrap_or(0);
    let joint = possible
        .into_iter()
        .find(|(count, _)| *count == most && most > 0);
    if joint.is_none() {
        warn("note: no muscle crosses a joint that is known here, so the bones rest; see --joint");
    }
    Ok(joint.map(|(_, joint)| joint))
}

/// Number of muscles with attachments to bones that rest and to bones that turn.
fn crossing(joint: &Joint, draft: &Draft, assets: &Assets, surfaces: &[Surface]) -> usize {
    let crosses = |name: &str, mesh: &TriangleMesh| {
        let told = crate::draft::names::crosses(name, joint.known.name);
        let turning = Some(joint.turns.as_slice());
        let (found, _) = crate::draft::attachments::find(mesh, surfaces, turning, told);
        let turns = |turns: bool| found.iter().any(|a| joint.turns.contains(&a.bone) == turns);
        turns(true) && turns(false)
    };
    let muscles = draft.muscles.iter().zip(&assets.muscles);
    muscles
        .filter(|(body, asset)| crosses(&body.name, &asset.mesh))
        .count()
}

/// The two bones that the user names.
fn between(arguments: &Arguments, bones: &[NamedBone<'_>]) -> Result<Option<[usize; 2]>, Failure> {
    let Some(named) = &arguments.between else {
        return Ok(None);
    };
    let mut found = [0, 0];
    for (found, name) in found.iter_mut().zip(named) {
        let same = |bone: &NamedBone<'_>| {
            let known =
                names::known_bone(bone.name).is_some_and(|k| k.name.eq_ignore_ascii_case(name));
            known || bone.name.eq_ignore_ascii_case(name)
        };
        let exact = bones
            .iter()
            .position(|bone| bone.name.eq_ignore_ascii_case(name));
        *found = exact.or(bones.iter().position(same)).ok_or_else(|| {
            let all: Vec<&str> = bones.iter().map(|bone| bone.name).collect();
            Failure::usage(
                format!("--between: no bone is named `{name}`"),
                format!("the bones are {}", all.join(", ")),
            )
        })?;
    }
    if found[0] == found[1] {
        return Err(Failure::usage(
            format!("--between names {} twice", bones[found[0]].name),
            "name two bones",
        ));
    }
    Ok(Some(found))
}

/// What the draft says, in words.
fn in_words(draft: &Draft, path: &Path) -> String {
    let mut text = String::new();
    if !draft.unit_why.is_empty() {
        let _ = writeln!(text, "unit: {} ({})", draft.unit, draft.unit_why);
    }
    for (kind, bodies) in [("bone", &draft.bones), ("muscle", &draft.muscles)] {
        for (k, body) in bodies.iter().enumerate() {
            let mut told = Vec::new();
            if !body.why.is_empty() {
                told.push(body.why.clone());
            }
            if let Some(mended) = &body.mended {
                told.push(format!("repaired: {}", mended.why));
            }
            if kind == "muscle"
                && let Some(held) = draft.held.get(k)
            {
                let bones = held.attachments.iter().map(|a| {
                    let name = &draft.bones[a.bone].name;
                    let tendon = held.tendon.as_ref().filter(|_| a.patch.is_none());
                    match (&a.far, tendon) {
                        (Some(_), Some((_, tendon))) => {
                            let mm = 1e3 * tendon.course.length();
                            format!(
                                "{name} by a tendon of {mm:.0} mm, which the file lacks and the draft adds"
                            )
                        }
                        (Some(far), _) if far.lacks_tendon => {
                            let mm = far.mm;
                            format!("{name} from {mm:.0} mm away, as the mesh lacks its tendon over the joint")
                        }
                        (Some(far), _) => format!("{name} from {:.0} mm away", far.mm),
                        (None, _) => name.clone(),
                    }
                });
                told.push(format!("held by {}", bones.collect::<Vec<_>>().join(", ")));
                let turns = |a: &Attachment| {
                    let joint = draft.joint.as_ref();
                    joint.is_some_and(|joint| joint.turns.contains(&a.bone))
                };
                let of_one = |side: bool| held.attachments.iter().all(|a| turns(a) == side);
                if draft.joint.is_some() && (of_one(true) || of_one(false)) {
                    told.push("does not cross the joint".to_owned());
                }
            }
            if body.remeshed.is_some() {
                told.push("remeshed".to_owned());
            }
            let _ = writeln!(text, "{kind} {}: {}", body.name, told.join("; "));
        }
    }
    if let Some(joint) = &draft.joint {
        let of = joint.between.map(|b| draft.bones[b].name.as_str());
        let moving: Vec<&str> = joint
            .turns
            .iter()
            .map(|&b| draft.bones[b].name.as_str())
            .collect();
        let centre: Vec<String> = joint
            .fit
            .centre
            .iter()
            .map(|c| format!("{:.1}", 1e3 * c))
            .collect();
        let axis: Vec<String> = joint.axis.iter().map(|a| format!("{a:.3}")).collect();
        let _ = writeln!(
            text,
            "{}: {} of {} by {} degrees about ({}) mm, axis ({})\n  centre: {}\n  sense: {}",
            joint.known.name,
            joint.known.motion,
            moving.join(", "),
            joint.known.degrees,
            centre.join(", "),
            axis.join(", "),
            joint.fit_in_words(of),
            joint.sense,
        );
    } else {
        text.push_str(STILL);
        text.push('\n');
    }
    let _ = writeln!(text, "\nScene in {}", path.display());
    text
}

/// What is said of a draft without a joint.
const STILL: &str = "no joint: no bone moves, and the checks say nothing about a motion. With two bones of a joint \
                     `--joint NAME` makes one; `[bone.motion]` in the scene moves a bone";

/// Runs the first frames of the scene.
pub(super) fn trial(arguments: &Arguments, path: &Path) -> Result<u8, Failure> {
    let tried = run::Arguments::of_first_frames(path, TRIED, arguments.output.clone());
    let code = run::run(&tried)?;
    let name = path.display();
    tell(
        arguments,
        &format!(
            "\nThese were the first {TRIED} frames. Next: pliant plan {name}; pliant run {name}\n"
        ),
    );
    Ok(code)
}
