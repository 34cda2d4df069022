//! `pliant data`: meshes to begin with, and where measured ones are.

use std::path::PathBuf;
use std::time::Instant;

use serde_json::json;

use super::failure::Failure;
use super::options::Printing;
use crate::report::Table;
use crate::report::output::RunOutput;
use pliant::io::{self, Encoding};
use pliant::mesh::shapes;

/// The meshes of the example: file name and shape. The names are those of the parts that the shapes
/// are like, by which `pliant init` knows them.
const EXAMPLE: [(&str, &str); 3] = [
    ("Femur.r.obj", "hip-femur"),
    ("Hip_bone.r.obj", "hip-socket"),
    ("Gluteus_medius.r.obj", "hip-gluteus"),
];

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

/// Write a muscle and its two bones as files to begin with, or show where measured meshes are
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant data
  pliant data first-muscle
  pliant init first-muscle --joint hip

The muscle and the bones are made by code and measure nobody: a femur, a socket and a muscle like gluteus medius, in
metres. They may be used for anything. Exit code 2: a file of that name is there already.")]
pub(super) struct Arguments {
    /// Folder for the three meshes; without it only the list is shown
    folder: Option<PathBuf>,
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
        output.written = write(folder)?;
        let shown = folder.display();
        output.name = shown.to_string();
        output.text = format!(
            "{}\nNext: pliant init {shown} --joint hip\n",
            output.written.join("\n")
        );
    } else {
        let mut table = Table::new("", ["set", "content", "address", "licence"]);
        SETS.iter().for_each(|set| table.row(*set));
        output.text = format!(
            "{}\n`pliant data FOLDER` writes a muscle and two bones that are made by code.\n",
            table.to_text()
        );
    }
    let set = |[name, content, address, licence]: &[&str; 4]| json!({"name": name, "content": content, "address": address, "licence": licence});
    output.measures = json!({"sets": SETS.iter().map(set).collect::<Vec<_>>()});
    output.time_s = begun.elapsed().as_secs_f64();
    Ok(arguments.printing.finish(output))
}

/// Writes the example. Returns the paths of its files.
fn write(folder: &std::path::Path) -> Result<Vec<String>, Failure> {
    let paths: Vec<PathBuf> = EXAMPLE.iter().map(|(name, _)| folder.join(name)).collect();
    if let Some(there) = paths.iter().find(|path| path.symlink_metadata().is_ok()) {
        let message = format!("`{}` is there already", there.display());
        return Err(Failure::usage(message, "name another folder"));
    }
    let unwritable = |error: &dyn std::fmt::Display| {
        let message = format!("`{}` cannot be written to: {error}", folder.display());
        Failure::usage(message, "name another folder")
    };
    std::fs::create_dir_all(folder).map_err(|error| unwritable(&error))?;
    for ((_, shape), path) in EXAMPLE.iter().zip(&paths) {
        let mesh = shapes::make(shape)
            .map(|shape| shape.mesh)
            .unwrap_or_default();
        io::write(path, &mesh, &[], Encoding::Text).map_err(|error| unwritable(&error))?;
    }
    Ok(paths
        .iter()
        .map(|path| path.display().to_string())
        .collect())
}
