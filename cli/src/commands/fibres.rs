//! `pliant fibres`: decomposition of a muscle into fibres.

use std::cell::OnceCell;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use nalgebra::Point3;

mod architecture;

use super::areas::{Written, read_file, read_mesh};
use super::failure::Failure;
use super::morph::nothing_written;
use super::options::Output;
use super::progress::{Bar, if_raised};
use super::run::stop_on_interrupt;
use super::{length_unit, note};
use crate::report::fibres::{Bundle, FILES, Summary, size};
use crate::report::folder::{Folder, FolderError};
use pliant::contact::Surface;
use pliant::fibres::SlicesError;
use pliant::fibres::SpringsError;
use pliant::fibres::harmonic::{DecompositionError, HarmonicOptions};
use pliant::fibres::quality::{Quality, measure, tendons};
use pliant::fibres::{
    Area, Attachment, AttachmentError, BoundLines, FibreMeasures, FibreMethod, Fibres, MethodError,
    RegisteredLines, Smoothing, Template, Tendon, decompose_by, measure_fibres, median_tilt,
    register, turns_back,
};
use pliant::mesh::TriangleMesh;
use pliant::mesh::measures::{max_or_nan, median};
use pliant::progress::Progress;

/// Plausible lengths of animal muscles [m]; another length suggests a wrong unit.
const LENGTHS: [f64; 2] = [0.001, 5.0];

/// A shorter computation shows no progress.
const SILENT: Duration = Duration::from_millis(500);

/// The methods by their names.
const METHODS: [&str; 4] = ["harmonic", "springs", "slices", "superficial"];
/// Methods with a template.
const BY_TEMPLATE: [&str; 2] = ["springs", "slices"];

/// Fill a muscle with fibres from its origin to its insertion
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant fibres gluteus.obj --unit m --origin areas.obj#1 --insertion areas.obj#0
  pliant fibres soleus.obj --unit mm --origin near:fibula.obj,5mm --insertion near:tibia.obj,2mm --count 200 --json
  pliant fibres muscle.obj --unit m --origin hip.obj --insertion vertices:end.txt --smooth-steps 10
  pliant fibres muscle.obj --unit cm --origin a.obj --insertion b.obj --method superficial --lines drawn.vtp
  pliant fibres vastus.obj --unit m --origin a.obj --insertion b.obj --method springs --template pennate
  pliant fibres rectus_femoris.obj --unit m --origin hip.obj --insertion knee.obj --aponeurosis auto --architecture table.csv#recfem_r
  pliant fibres run/frames/gluteus_0020.vtp --unit m --rest run/frames/gluteus_0000.vtp --origin areas.obj#1 --insertion areas.obj#0

AREA is one of
  FILE               a patch: an open surface on or near the muscle, such as an area on a bone; all of the file
  FILE#0             its largest component alone; components are counted from 0, by falling area
  near:BONE.obj,5mm  all of the muscle at most so far from a bone
  [0,1,2]            vertices of the muscle, counted from 0
  vertices:FILE      the same in a text file, apart by spaces, commas or lines; `#` begins a remark
An area is projected onto the muscle. A patch off the muscle (median distance above 2 % of its length) is reached by straight
tendons, which are no part of the fibres.

Methods: `harmonic`, along the gradient of a harmonic field between the areas, for any surface; `superficial`, along the lines of
--lines on the surface, whose directions are spread through the inside; `springs` and `slices`, older ones to compare with, along
the fibres of a --template, mapped onto the surface with springs inside, or slice by slice. Springs need a closed surface without
handles; both may leave the muscle, fold, and slices miss the areas: both are measured and reported.

Aponeuroses are the tendon plates on which the fibres of pennate muscles begin and end. The origin's plate covers the face of the
muscle to which its area looks, from its end on, and the insertion's the opposite face: each 0.4 of the length with `parallel`, so far
that fibres make 15 degrees with the line of action with `pennate`, and 28 with `multipennate`; with `bipennate` that of the origin
lies in the middle, between two of the insertion, at 15 degrees. A share of the length, 0.75, or an angle, 15deg, may be given.
`auto` takes the architecture that textbooks of anatomy give for the muscle's name. A FILE holds open surfaces, each a component: on
the surface or as a sheet inside; each belongs to the area that is nearer.

Templates: `parallel`, areas at opposite ends; `pennate`, at opposite sides, fibres oblique; `curved`, on the same side, fibres in
arches; `rectus`, areas narrower than the belly.

Results in pliant-out/NAME-fibres: fibres.vtp (polylines with `fibre`, `part` (0 fibre, 1 tendon of the origin, 2 of the
insertion), `length_m` and `pennation_rad`), muscle.vtp (with `area`: 1 origin, 2 insertion), fibres.csv (a row a fibre), points.csv,
pictures from two sides and in section, summary.json, report.html. All lengths are in m.

Exit codes: 0 done; 1 points lie outside, ends off their areas, fibres are out of order, turn back, go round, lie across the line of
action, or end in hooks;
2 bad usage or input; 130 or 143 interrupted.")]
pub(super) struct Arguments {
    /// The muscle's surface; it may have holes and may be inside out
    muscle: PathBuf,
    /// Length unit of all files, such as mm
    #[arg(long, value_name = "UNIT")]
    unit: String,
    /// Area where fibres begin
    #[arg(long, value_name = "AREA")]
    origin: String,
    /// Area where fibres end
    #[arg(long, value_name = "AREA")]
    insertion: String,
    /// Method of the decomposition
    #[arg(long, value_name = "NAME", default_value = "harmonic", value_parser = METHODS)]
    method: String,
    /// Course of the fibres, for --method springs and slices [default: parallel]
    #[arg(long, value_name = "NAME", value_parser = Template::NAMED.map(|(name, _)| name))]
    template: Option<String>,
    /// Aponeuroses on which fibres begin and end: auto (by the muscle's name), parallel, pennate, bipennate, multipennate,
    /// a share of the length, an angle of pennation, or a file
    #[arg(long, value_name = "PLATES")]
    aponeurosis: Option<String>,
    /// Row of a table of architecture, as FILE#ROW or FILE#ROW,ROW: fibre lengths relative to its
    /// optimal_fiber_length_m
    #[arg(long, value_name = "TABLE")]
    architecture: Option<String>,
    /// Polylines along fibres on the surface (.vtp, .vtk, .obj), for --method superficial
    #[arg(long, value_name = "FILE", required_if_eq("method", "superficial"))]
    lines: Option<PathBuf>,
    /// The muscle in the shape of the areas and lines, with the triangles of MUSCLE, a frame of a
    /// run
    #[arg(long, value_name = "MESH")]
    rest: Option<PathBuf>,
    /// Number of fibres
    #[arg(long, value_name = "N", default_value = "100", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    count: u32,
    /// Points of each fibre, including its ends
    #[arg(long, value_name = "N", default_value = "15", value_parser = clap::value_parser!(u32).range(2..=10_000))]
    points: u32,
    /// Number of smoothing passes; each evens out bends of few points, and keeps those of the whole
    /// fibre
    #[arg(long, value_name = "N", default_value = "0", value_parser = clap::value_parser!(u32).range(0..=100_000))]
    smooth_steps: u32,
    /// Share of the sharpest zigzag that a pass removes, 0 to 1
    #[arg(long, value_name = "SHARE", default_value = "0.5", allow_negative_numbers = true, value_parser = share)]
    smooth_factor: f64,
    #[command(flatten)]
    output: Output,
}

fn share(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|n: &f64| (0.0..=1.0).contains(n));
    number.ok_or_else(|| "expected a share from 0 to 1, such as 0.5".to_owned())
}

/// The input.
struct Given {
    muscle: TriangleMesh,
    attachment: Attachment,
    lines: RegisteredLines,
    /// Optimal length of its fibres [m], if a table is given.
    optimal_m: Option<f64>,
    notes: Vec<String>,
}

/// The fibres by the chosen method; `None` after Ctrl-C.
fn decomposed(
    arguments: &Arguments,
    given: &Given,
    template: Option<(&str, Template)>,
    begun: Instant,
    stop: &AtomicBool,
) -> Result<Option<Fibres>, Failure> {
    let method = match (arguments.method.as_str(), template) {
        ("springs", Some((_, template))) => FibreMethod::Springs(template),
        ("slices", Some((_, template))) => FibreMethod::Slices(template),
        ("superficial", _) => FibreMethod::Superficial(&given.lines.lines),
        _ => FibreMethod::Harmonic,
    };
    let options = HarmonicOptions {
        count: arguments.count as usize,
        points: arguments.points as usize,
    };
    let smoothing = Smoothing {
        steps: arguments.smooth_steps,
        factor: arguments.smooth_factor,
    };
    let (muscle, attachment) = (&given.muscle, &given.attachment);
    match followed(begun, stop, |progress| {
        decompose_by(muscle, attachment, method, options, smoothing, progress)
    }) {
        Err(MethodError::Flow(DecompositionError::Stopped)) => Ok(None),
        other => other.map(Some).map_err(|error| undone(&error)),
    }
}

/// The measures of the fibres.
fn summary(
    arguments: &Arguments,
    given: &Given,
    template: Option<&str>,
    made: &Fibres,
    each: &[FibreMeasures],
    quality: Quality,
    decomposition_s: f64,
) -> Summary {
    let Given {
        muscle,
        attachment,
        lines,
        ..
    } = given;
    let volume = made.closed.mesh.volume().abs();
    let off = |area: &Area| max_or_nan(area.distances.iter().copied());
    let courses = made.courses();
    let middle = |numbers: Vec<f64>| median(numbers).unwrap_or(f64::NAN);
    let lengths = each.iter().map(|e| e.length_m);
    Summary {
        method: arguments.method.clone(),
        template: template.map(str::to_owned),
        decomposition_s,
        vertices: muscle.vertices.len(),
        volume_m3: volume,
        cross_section_m2: volume / quality.length_mean_m,
        aponeurosis: arguments.aponeurosis.clone(),
        tilt_at_ends_deg_median: median_tilt(&courses).to_degrees(),
        turns_back: courses.iter().filter(|course| turns_back(course)).count(),
        length_median_m: middle(lengths.clone().collect()),
        optimal_length_ratio: given
            .optimal_m
            .map(|optimal| middle(lengths.clone().collect()) / optimal),
        length_min_m: lengths.clone().fold(f64::INFINITY, f64::min),
        length_max_m: max_or_nan(lengths),
        origin_area_m2: size(muscle, &attachment.origin),
        insertion_area_m2: size(muscle, &attachment.insertion),
        origin_distance_max_m: off(&attachment.origin),
        insertion_distance_max_m: off(&attachment.insertion),
        lines: lines.lines.len(),
        lines_distance_max_m: lines.distance_max,
        smooth_steps: arguments.smooth_steps,
        smooth_factor: arguments.smooth_factor,
        quality,
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let all_begun = Instant::now();
    let unit = length_unit(&arguments.unit)?;
    let template = template(arguments)?;
    let areas = [
        Written::of("--origin", &arguments.origin)?,
        Written::of("--insertion", &arguments.insertion)?,
    ];
    let name = arguments.muscle.file_stem().map_or_else(
        || "muscle".into(),
        |stem| stem.to_string_lossy().into_owned(),
    );
    let out = arguments.output.folder(&name, "fibres");
    arguments.output.threads.start();
    Folder::check(&out, &FILES.map(str::to_owned))?;
    let given = read(arguments, &areas, unit)?;
    let Given {
        muscle,
        attachment,
        lines,
        notes,
        ..
    } = &given;
    let begun = Instant::now();
    let stop = stop_on_interrupt("stopping");
    let Some(made) = decomposed(arguments, &given, template, begun, &stop)? else {
        return Ok(nothing_written());
    };
    let decomposition_s = begun.elapsed().as_secs_f64();
    let quality = measure(
        muscle,
        &made.closed,
        attachment,
        &made.lines,
        made.jacobian(muscle, attachment),
    );
    if stop.load(Ordering::Relaxed) {
        return Ok(nothing_written());
    }
    let tendons = tendons_of(attachment, &made.lines);
    let each = measure_fibres(&made.lines, &tendons, attachment.action);
    let template = template.map(|(name, _)| name);
    let summary = summary(
        arguments,
        &given,
        template,
        &made,
        &each,
        quality,
        decomposition_s,
    );
    let (fibres, lines) = (&made.lines[..], &lines.lines[..]);
    let bundle = Bundle {
        name: &name,
        muscle,
        attachment,
        fibres,
        tendons: &tendons,
        lines,
        each: &each,
        summary: &summary,
        notes,
        time_s: all_begun.elapsed().as_secs_f64(),
    };
    let output = bundle.output().map_err(FolderError::from)?;
    arguments.output.finish(&Folder::open(&out)?, output)
}

/// Runs a computation that can be long. Shows its progress on standard error after a while, and
/// stops it on Ctrl-C.
fn followed<T>(begun: Instant, stop: &AtomicBool, work: impl FnOnce(&dyn Progress) -> T) -> T {
    let shown: OnceCell<Bar> = OnceCell::new();
    let made = work(&|stage: &str, done: usize, of: usize| {
        if begun.elapsed() >= SILENT {
            let rounds = shown.get_or_init(|| Bar::of_parts(of));
            rounds.part(&format!("{done} of {of} {stage}"));
            rounds.reach(done, of);
        }
        if_raised(stop)
    });
    if let Some(rounds) = shown.get() {
        rounds.end();
    }
    made
}

/// The template of the method; rejects a template for other methods.
fn template(arguments: &Arguments) -> Result<Option<(&'static str, Template)>, Failure> {
    if arguments.lines.is_some() && arguments.method != "superficial" {
        let hint = "add --method superficial";
        return Err(Failure::usage(
            "--lines are given, but the method does not follow them",
            hint,
        ));
    }
    let by_template = BY_TEMPLATE.contains(&arguments.method.as_str());
    if arguments.template.is_some() && !by_template {
        let message = format!(
            "--template is given, but method {} has none",
            arguments.method
        );
        return Err(Failure::usage(
            message,
            "add --method springs or --method slices, or leave it out",
        ));
    }
    if arguments.aponeurosis.is_some() && by_template {
        let message = format!(
            "--aponeurosis is given, but method {} knows no aponeuroses",
            arguments.method
        );
        return Err(Failure::usage(
            message,
            "leave out --method, or give a --template in its place",
        ));
    }
    let named = |name: &str| {
        Template::NAMED
            .into_iter()
            .find(|(known, _)| *known == name)
    };
    Ok(named(arguments.template.as_deref().unwrap_or("parallel")).filter(|_| by_template))
}

/// Reads all files and projects the areas.
fn read(arguments: &Arguments, areas: &[Written; 2], unit: f64) -> Result<Given, Failure> {
    let muscle = read_mesh(&arguments.muscle, unit)?;
    let mut notes = Vec::new();
    let length = muscle.length();
    if !(LENGTHS[0]..=LENGTHS[1]).contains(&length) {
        let doubt = format!("the muscle is {length:.3e} m long: is --unit right?");
        // The note can explain a later error.
        note(&format!("note: {doubt}"));
        notes.push(doubt);
    }
    let rest = arguments
        .rest
        .as_deref()
        .map(|path| rest(path, unit, &muscle))
        .transpose()?;
    let base = rest.as_ref().unwrap_or(&muscle);
    let origin = areas[0].load("--origin", unit)?;
    let insertion = areas[1].load("--insertion", unit)?;
    let mut attachment = Attachment::new(base, origin.source(), insertion.source())
        .map_err(|error| unusable(&error))?;
    let optimal_m = arguments
        .architecture
        .as_deref()
        .map(architecture::optimal_length)
        .transpose()?;
    if let Some(text) = &arguments.aponeurosis {
        attachment = architecture::plates(arguments, text, unit, &muscle, &attachment, &mut notes)?;
    }
    let mut lines = match &arguments.lines {
        Some(path) => registered(path, unit, base)?,
        None => RegisteredLines::default(),
    };
    if rest.is_some() {
        if attachment.origin.patch.is_some() || attachment.insertion.patch.is_some() {
            notes.push(
                "tendons are left out: where a bone is in this frame is not known".to_owned(),
            );
        }
        attachment = attachment.without_tendons();
        lines.lines = BoundLines::new(&Surface::new(base), &lines.lines).at(&muscle.vertices);
    }
    Ok(Given {
        attachment,
        lines,
        optimal_m,
        notes,
        muscle,
    })
}

/// The muscle in the shape of the areas and lines.
fn rest(path: &Path, unit: f64, muscle: &TriangleMesh) -> Result<TriangleMesh, Failure> {
    let rest = read_mesh(path, unit)?;
    if rest.triangles != muscle.triangles || rest.vertices.len() != muscle.vertices.len() {
        let message = format!(
            "--rest: {} has other triangles than the muscle ({} vertices and {} triangles, the muscle {} and {})",
            path.display(),
            rest.vertices.len(),
            rest.triangles.len(),
            muscle.vertices.len(),
            muscle.triangles.len()
        );
        return Err(Failure::usage(
            message,
            "name an earlier frame of the same run, such as its first",
        ));
    }
    Ok(rest)
}

fn registered(path: &Path, unit: f64, muscle: &TriangleMesh) -> Result<RegisteredLines, Failure> {
    let file = read_file(path, unit)?;
    let shown = path.display();
    if file.lines.is_empty() {
        let hint = "lines are read from Lines of a .vtp file, LINES of a legacy VTK file or `l` of an OBJ file";
        return Err(Failure::usage(
            format!("--lines: {shown} holds no lines"),
            hint,
        ));
    }
    let place = |&v: &u32| file.mesh.vertices[v as usize];
    let lines: Vec<Vec<Point3<f64>>> = file
        .lines
        .iter()
        .map(|line| line.iter().map(place).collect())
        .collect();
    register(muscle, &lines).map_err(|error| {
        Failure::usage(
            format!("--lines: {shown}: {error}"),
            "`pliant convert` moves a file to another unit",
        )
    })
}

/// One tendon per fibre at each end with a patch off the muscle.
fn tendons_of(attachment: &Attachment, fibres: &[Vec<Point3<f64>>]) -> [Vec<Tendon>; 2] {
    let first: Vec<Point3<f64>> = fibres.iter().filter_map(|f| f.first().copied()).collect();
    let last: Vec<Point3<f64>> = fibres.iter().filter_map(|f| f.last().copied()).collect();
    [
        tendons(&attachment.origin, &first),
        tendons(&attachment.insertion, &last),
    ]
}

fn unusable(error: &AttachmentError) -> Failure {
    Failure::usage(
        error.to_string(),
        "`pliant fibres --help` tells how areas are given",
    )
}

/// The error, with an alternative to this method.
fn undone(error: &MethodError) -> Failure {
    let hint = match error {
        MethodError::Flow(_) => "`pliant check` tells what is wrong with a mesh",
        MethodError::Springs(SpringsError::Surface(_) | SpringsError::InsideOut { .. }) => {
            "use --method harmonic, which takes any surface, or mend this one: `pliant check` tells what is wrong"
        }
        MethodError::Springs(SpringsError::WholeSurface { .. } | SpringsError::OnePlace { .. })
        | MethodError::Slices(SlicesError::NoAxis { .. }) => {
            "give other areas, or use --method harmonic"
        }
        MethodError::Springs(_) | MethodError::Slices(_) => "use --method harmonic",
    };
    Failure::usage(error.to_string(), hint)
}
