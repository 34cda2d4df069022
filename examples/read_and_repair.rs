//! Reads a broken mesh file, examines it and repairs it.

use std::error::Error;
use std::path::Path;
use std::{env, fs, process};

use pliant::mesh::{FindingKind, RepairOptions, RepairStep, repair};
use pliant::{Health, io};

/// A cube of side 1 with four defects.
const BROKEN: &str = "\
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0 0 1
v 1 0 1
v 1 1 1
v 0 1 1
# No face uses this vertex.
v 5 5 5
f 1 4 3 2
f 1 2 6 5
f 3 4 8 7
f 4 1 5 8
# Both triangles of this face are turned inward.
f 6 7 3 2
# A triangle that the first face already has.
f 1 4 3
# The face at the top, 5 6 7 8, is missing.
";

/// Runs the example.
pub fn main() -> Result<(), Box<dyn Error>> {
    let folder = env::temp_dir().join(format!("pliant-read-and-repair-{}", process::id()));
    fs::create_dir_all(&folder)?;
    let result = read_and_repair(&folder);
    fs::remove_dir_all(&folder)?;
    result
}

fn read_and_repair(folder: &Path) -> Result<(), Box<dyn Error>> {
    // The content decides on the format. An error names the file and the line.
    let path = folder.join("broken.obj");
    fs::write(&path, BROKEN)?;
    let file = io::read(&path)?;

    // Every defect has a code, a place and a repair. A defect with a code that begins with E rejects a simulation.
    let health = Health::of(&file.mesh);
    assert!(!health.is_fit());
    let found = |kind: FindingKind| health.findings.iter().any(|finding| finding.kind == kind);
    assert!(found(FindingKind::OpenBoundary));
    assert!(found(FindingKind::InconsistentOrientation));
    assert!(found(FindingKind::DuplicateTriangles));
    assert!(found(FindingKind::UnusedVertices));

    // Holes with at most 4 edges are closed only because the options ask for it.
    let options = RepairOptions {
        close_holes: 4,
        ..RepairOptions::default()
    };
    let repaired = repair(&file.mesh, &file.lines, &options);

    // The repair reports its changes, in order, and moves no vertex.
    let steps: Vec<RepairStep> = repaired.changes.iter().map(|change| change.step).collect();
    assert_eq!(
        steps,
        [
            RepairStep::DroppedDuplicateTriangles,
            RepairStep::ClosedHoles,
            RepairStep::TurnedTriangles,
            RepairStep::DroppedVertices
        ]
    );
    assert_eq!(repaired.moved, 0.0);

    // The result is a cube: closed, with 12 triangles and a volume of 1. Written and read again, it is the same.
    let health = Health::of(&repaired.mesh);
    assert!(health.is_fit() && health.findings.is_empty());
    assert_eq!((health.vertices, health.triangles), (8, 12));
    assert!((health.volume - 1.0).abs() <= 1e-15);
    let path = folder.join("repaired.ply");
    io::write(&path, &repaired.mesh, &repaired.lines, io::Encoding::Binary)?;
    assert_eq!(io::read(&path)?.mesh, repaired.mesh);
    Ok(())
}
