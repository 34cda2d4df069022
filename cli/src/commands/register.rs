//! `pliant register`: registration of one surface to another.

use std::path::{Path, PathBuf};
use std::time::Instant;

use super::failure::Failure;
use super::morph::{name_of, nothing_written, read};
use super::options::Output;
use super::progress::if_raised;
use super::run::stop_on_interrupt;
use super::{FAILED, length_unit, warn};
use crate::report::folder::{Folder, FolderError};
use crate::report::register::Registration;
use pliant::format::number;
use pliant::morph::register::{
    FitMotion, Icp, NonRigid, Ransac, RegisterError, RegistrationSettings, RegistrationSurface,
    Select, register_surfaces,
};

/// Greatest number of vertices of each surface in the search for a start; more do not improve it.
const MOST: usize = 20_000;

/// Two surfaces of which one is more than this many times as long as the other have different units:
/// a scar of 4 cm on a body of 1.8 m is 45 times as short.
const MOST_LONGER: f64 = 50.0;

/// Register one surface to another: rigid, with scaling, or bent
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant register scan.obj bone.obj
  pliant register part.ply whole.ply --with similarity --overlap 0.4 --seed 7
  pliant register before.obj after.obj --unit mm --non-rigid --clusters 150 --json

A is moved onto B. A start is found by RANSAC over pairs of vertices with normals, beside A as it is placed and by its principal
axes; then closest points are iterated: all vertices, the nearest place of the surface, equal weights, pairs that are far, that face
apart or that lie at an open rim dropped, distances from tangent planes, least squares. With --non-rigid A then bends: clusters of
its surface each turn and move as one, blended between them. Surfaces may be open.

Results in pliant-out/A-B-register: moved.vtp (A on B with `distance` from it and `inlier`; with --non-rigid also `cluster`; point data
of a .vtp are kept), moved.obj, before.png, after.png, summary.json (`matrix`: 4 rows of 4, for columns of positions), report.html.

Exit codes: 0 done; 1 fewer vertices than --overlap asks for lie on B, or files could not be written; 2 bad usage or input; 130
after Ctrl-C, with nothing written.")]
pub(super) struct Arguments {
    /// The surface that moves
    a: PathBuf,
    /// The surface that does not move
    b: PathBuf,
    /// Length unit of both files, such as mm; results are then in metres [default: results in the
    /// unit of the files]
    #[arg(long, value_name = "UNIT")]
    unit: Option<String>,
    /// Kind of motion: rigid, or with scaling
    #[arg(long, value_name = "MOTION", default_value = "rigid", value_parser = ["rigid", "similarity"])]
    with: String,
    /// Also bend A by clusters
    #[arg(long)]
    non_rigid: bool,
    /// Number of clusters
    #[arg(long, value_name = "N", default_value = "100", requires = "non_rigid", value_parser = clap::value_parser!(u32).range(2..=5000))]
    clusters: u32,
    /// Least share of A that has a counterpart on B
    #[arg(long, value_name = "SHARE", default_value = "0.4", allow_negative_numbers = true, value_parser = share)]
    overlap: f64,
    /// Seed of the random draws
    #[arg(long, value_name = "N", default_value = "1")]
    seed: u64,
    #[command(flatten)]
    output: Output,
}

fn share(text: &str) -> Result<f64, String> {
    let number: Option<f64> = text.parse().ok().filter(|s: &f64| *s >= 0.05 && *s <= 1.0);
    number.ok_or_else(|| "expected a share from 0.05 to 1".to_owned())
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let begun = Instant::now();
    let stop = stop_on_interrupt("stopping; nothing will be written");
    let scale = arguments.unit.as_deref().map_or(Ok(1.0), length_unit)?;
    let paths = [arguments.a.as_path(), &arguments.b];
    let name = name_of(paths);
    let out = arguments.output.folder(&name, "register");
    arguments.output.threads.start();
    Folder::check(&out, &Registration::files())?;
    let [a, b] = [read(paths[0], scale)?, read(paths[1], scale)?];
    let wrong = |side: usize| move |error: RegisterError| refused(&error, paths[side]);
    let surfaces = [
        RegistrationSurface::new(&a.mesh).map_err(wrong(0))?,
        RegistrationSurface::new(&b.mesh).map_err(wrong(1))?,
    ];
    let sizes = surfaces.each_ref().map(RegistrationSurface::size);
    of_one_unit(sizes, paths)?;
    let read_s = begun.elapsed().as_secs_f64();
    let settings = settings(arguments);
    let registration = match register_surfaces(
        &surfaces[0],
        &surfaces[1],
        &settings,
        &|_: &str, _: usize, _: usize| if_raised(&stop),
    ) {
        Err(RegisterError::Stopped) => return Ok(nothing_written()),
        Err(error) => {
            warn(&format!(
                "error: {error} (A is {} long, B {}); lower --overlap{}",
                number(sizes[0]),
                number(sizes[1]),
                match settings.motion {
                    FitMotion::Rigid => ", or take --with similarity where sizes differ",
                    FitMotion::Similarity => "; scales from a fifth to five are searched",
                }
            ));
            return Ok(FAILED);
        }
        Ok(registration) => registration,
    };
    let registration = Registration {
        name,
        files: paths.map(|p| p.display().to_string()),
        meshes: [&a.mesh, &b.mesh],
        data: &a.data,
        registration: &registration,
        motion: settings.motion,
        overlap: arguments.overlap,
        seed: arguments.seed,
        unit: arguments.unit.as_ref().map(|_| "m"),
        read_s,
        time_s: begun.elapsed().as_secs_f64(),
    };
    let output = registration.output().map_err(FolderError::from)?;
    arguments.output.finish(&Folder::open(&out)?, output)
}

fn settings(arguments: &Arguments) -> RegistrationSettings {
    RegistrationSettings {
        motion: if arguments.with == "rigid" {
            FitMotion::Rigid
        } else {
            FitMotion::Similarity
        },
        ransac: Ransac {
            good: arguments.overlap,
            seed: arguments.seed,
            ..Ransac::default()
        },
        icp: Icp {
            rounds: 200,
            select: Select::About(MOST),
            ..Icp::default()
        },
        bending: arguments.non_rigid.then(|| NonRigid {
            clusters: arguments.clusters as usize,
            ..NonRigid::default()
        }),
    }
}

/// Refuses surfaces whose sizes [m or the unit of the files] differ as those of two units.
fn of_one_unit(sizes: [f64; 2], paths: [&Path; 2]) -> Result<(), Failure> {
    let [a, b] = sizes;
    if a <= MOST_LONGER * b && b <= MOST_LONGER * a {
        return Ok(());
    }
    let [of_a, of_b] = paths.map(Path::display);
    let text = format!(
        "{of_a} is {} long and {of_b} {}: their units differ",
        number(a),
        number(b)
    );
    let hint = "write one in the unit of the other with `pliant convert IN OUT --unit UNIT --to-unit UNIT`";
    Err(Failure::usage(text, hint))
}

fn refused(error: &RegisterError, path: &Path) -> Failure {
    let hint = match error {
        RegisterError::Mesh(_) => {
            format!("`pliant check {} --repair DIR` mends it", path.display())
        }
        _ => "give a surface of some triangles".to_owned(),
    };
    Failure::usage(format!("{}: {error}", path.display()), hint)
}
