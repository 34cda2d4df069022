//! `pliant data`: meshes to begin with, and where measured ones are.

use std::path::PathBuf;
use std::time::Instant;

use clap::ValueEnum;
use nalgebra::{Point3, Rotation3, Vector3};
use serde_json::json;

use super::failure::Failure;
use super::options::Printing;
use crate::report::Table;
use crate::report::output::RunOutput;
use crate::report::provenance::quoted;
use pliant::TriangleMesh;
use pliant::io::{self, Encoding};
use pliant::mesh::shapes;

/// A folder of files to begin with, made by code.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum Example {
    /// A femur, a socket and a muscle like gluteus medius
    #[default]
    FirstMuscle,
    /// The same with a model of OpenSim, a motion, and a scene that the model moves
    Opensim,
    /// A flat skin in centimetres, a scalp and a skull in metres
    Skin,
    /// Two closed bodies to blend, and a part of one to register
    Bodies,
}

/// What a file of an example contains.
enum Content {
    /// A shape of the library.
    Shape(&'static str),
    /// A text.
    Text(&'static str),
    /// A mesh.
    Mesh(fn() -> TriangleMesh),
}

/// The meshes of a first muscle. `pliant init` knows the parts by these names.
const MUSCLE: [(&str, Content); 3] = [
    ("Femur.r.obj", Content::Shape("hip-femur")),
    ("Hip_bone.r.obj", Content::Shape("hip-socket")),
    ("Gluteus_medius.r.obj", Content::Shape("hip-gluteus")),
];
const OPENSIM: [(&str, Content); 3] = [
    ("hip.osim", Content::Text(include_str!("data/hip.osim"))),
    ("walk.mot", Content::Text(include_str!("data/walk.mot"))),
    ("leg.toml", Content::Text(include_str!("data/leg.toml"))),
];
const SKIN: [(&str, Content); 3] = [
    ("sheet.obj", Content::Mesh(sheet)),
    ("scalp.obj", Content::Mesh(shapes::scalp)),
    ("skull.obj", Content::Shape("skull")),
];
const BODIES: [(&str, Content); 3] = [
    ("ball.obj", Content::Shape("icosphere")),
    ("pear.obj", Content::Mesh(pear)),
    ("half.obj", Content::Mesh(half_of_pear)),
];

impl Example {
    fn files(self) -> Vec<&'static (&'static str, Content)> {
        match self {
            Self::FirstMuscle => MUSCLE.iter().collect(),
            Self::Opensim => MUSCLE.iter().chain(&OPENSIM).collect(),
            Self::Skin => SKIN.iter().collect(),
            Self::Bodies => BODIES.iter().collect(),
        }
    }

    /// A command to continue with.
    fn next(self, folder: &str) -> String {
        match self {
            Self::FirstMuscle => format!("pliant init {folder} --joint hip"),
            Self::Opensim => format!("pliant run {folder}/leg.toml"),
            Self::Skin => format!(
                "pliant implant {folder}/scalp.obj --unit m --at 0,0,0.09 --base 6cm --volume 30cc \
                 --obstacle {folder}/skull.obj"
            ),
            Self::Bodies => format!("pliant morph {folder}/ball.obj {folder}/pear.obj --unit cm"),
        }
    }
}

/// The flat skin of the built-in implant [cm].
fn sheet() -> TriangleMesh {
    shapes::sheet(20.0, 64)
}

/// A ball that is longer and thinner above.
fn pear() -> TriangleMesh {
    let mut mesh = shapes::make("icosphere")
        .map(|shape| shape.mesh)
        .unwrap_or_default();
    for p in &mut mesh.vertices {
        let width = 0.75 - 0.3 * p.y;
        *p = Point3::new(p.x * width, 1.4 * p.y, p.z * width * (1.0 + 0.2 * p.x));
    }
    mesh
}

/// The upper part of the pear, turned and moved.
fn half_of_pear() -> TriangleMesh {
    let whole = pear();
    let mut triangles = whole.triangles.clone();
    triangles.retain(|t| t.iter().all(|&v| whole.vertices[v as usize].y > -0.2));
    let turn = Rotation3::from_euler_angles(0.2, 0.3, -0.1);
    let moved = |p: &Point3<f64>| turn * p + Vector3::new(0.3, -0.2, 0.1);
    let mut kept: Vec<u32> = triangles.concat();
    kept.sort_unstable();
    kept.dedup();
    let place = |v: u32| kept.partition_point(|k| *k < v) as u32;
    TriangleMesh {
        vertices: kept
            .iter()
            .map(|&v| moved(&whole.vertices[v as usize]))
            .collect(),
        triangles: triangles.iter().map(|t| t.map(place)).collect(),
    }
}

/// Sets of measured meshes: name, content, address, licence.
const SETS: [[&str; 4]; 4] = [
    [
        "BodyParts3D",
        "surfaces of an adult man: bones and many muscles (OBJ, mm)",
        "https://dbarchive.biosciencedbc.jp/en/bodyparts3d/download.html",
        "CC BY 4.0: name the source (its files still say CC BY-SA 2.1 JP)",
    ],
    [
        "Open3DModel of AnatomyTOOL",
        "BodyParts3D sorted by region and smoothed (glTF: export each part as OBJ)",
        "https://anatomytool.org/open3dmodel",
        "CC BY-SA 4.0: name the source, share what is derived under the same terms",
    ],
    [
        "VSDFullBodyBoneModels",
        "bones of the lower body of 30 subjects, from CT",
        "https://github.com/MCM-Fischer/VSDFullBodyBoneModels",
        "see its page",
    ],
    [
        "TotalSegmentator",
        "labels of bones and ten muscles in 1,200 CT scans (make surfaces of them first)",
        "https://doi.org/10.5281/zenodo.6802613",
        "see its page",
    ],
];

/// Write files to begin with, or show where measured meshes are
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant data
  pliant data first-muscle
  pliant init first-muscle --joint hip
  pliant data leg --example opensim

All files are made by code and measure nobody. Lengths are in metres; sheet.obj and the bodies are in centimetres.
They may be used for anything. Exit code 2: a file of that name is there already.")]
pub(super) struct Arguments {
    /// Folder for the files; without it only the list is shown
    folder: Option<PathBuf>,
    /// The files to write
    #[arg(long, value_enum, default_value_t, requires = "folder")]
    example: Example,
    #[command(flatten)]
    printing: Printing,
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let begun = Instant::now();
    let mut output = RunOutput {
        kind: "data",
        name: "measured meshes".to_owned(),
        ..RunOutput::default()
    };
    if let Some(folder) = &arguments.folder {
        output.written = write(folder, arguments.example)?;
        let shown = folder.display();
        output.name = shown.to_string();
        output.text = format!(
            "{}\nNext: {}\n",
            output.written.join("\n"),
            arguments.example.next(&quoted(&shown.to_string()))
        );
    } else {
        let mut table = Table::new("", ["set", "content", "address", "licence"]);
        SETS.iter().for_each(|set| table.row(*set));
        output.text = format!(
            "{}\n`pliant data FOLDER` writes a muscle and two bones made by code; --example has more.\n",
            table.to_text()
        );
    }
    let set = |[name, content, address, licence]: &[&str; 4]| json!({"name": name, "content": content, "address": address, "licence": licence});
    output.measures = json!({"sets": SETS.iter().map(set).collect::<Vec<_>>()});
    output.time_s = begun.elapsed().as_secs_f64();
    Ok(arguments.printing.finish(output))
}

/// Writes an example. Returns the paths of its files.
fn write(folder: &std::path::Path, example: Example) -> Result<Vec<String>, Failure> {
    let files = example.files();
    let paths: Vec<PathBuf> = files.iter().map(|(name, _)| folder.join(name)).collect();
    if let Some(there) = paths.iter().find(|path| path.symlink_metadata().is_ok()) {
        let message = format!("`{}` is there already", there.display());
        return Err(Failure::usage(message, "name another folder"));
    }
    let unwritable = |error: &dyn std::fmt::Display| {
        let message = format!("`{}` cannot be written to: {error}", folder.display());
        Failure::usage(message, "name another folder")
    };
    std::fs::create_dir_all(folder).map_err(|error| unwritable(&error))?;
    for ((_, content), path) in files.into_iter().zip(&paths) {
        let mesh = match content {
            Content::Text(text) => {
                std::fs::write(path, text).map_err(|error| unwritable(&error))?;
                continue;
            }
            Content::Shape(name) => shapes::make(name)
                .map(|shape| shape.mesh)
                .unwrap_or_default(),
            Content::Mesh(make) => make(),
        };
        io::write(path, &mesh, &[], Encoding::Text).map_err(|error| unwritable(&error))?;
    }
    Ok(paths
        .iter()
        .map(|path| path.display().to_string())
        .collect())
}
