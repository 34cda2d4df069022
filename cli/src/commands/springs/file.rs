//! The spring system of a file.

use std::path::Path;

use nalgebra::Point3;

use super::super::failure::Failure;
use pliant::mesh::measures::Aabb;
use pliant::simulation::{LoadError, SpringsModel};
use pliant::springs::damping::DampedBody;
use pliant::springs::format::{self, SpringFile};
use pliant::springs::{Neighbours, Springs};

/// The system of a file, each point of `mass` [kg], with notes for the user, and the file.
pub(super) fn read(
    path: &Path,
    mass: f64,
) -> Result<(SpringsModel, Vec<String>, SpringFile), Failure> {
    let file = format::read(path).map_err(|e| LoadError::from(Box::new(e)))?;
    let unfit = |e: &dyn std::fmt::Display| {
        Failure::usage(format!("{}: {e}", path.display()), "correct the file")
    };
    let springs = file.springs().map_err(|e| unfit(&e))?;
    let name = path
        .file_stem()
        .map_or("springs".to_owned(), |n| n.to_string_lossy().into_owned());
    let damped = Some(body(&file.position, &springs, mass));
    // An inner point of a lattice has three springs of its own for 6 neighbours, thirteen for 26.
    let dense = springs.springs().len() > 6 * file.position.len();
    let position = file.position.clone();
    let model = SpringsModel::new(name, position, mass, springs).map_err(|e| unfit(&e))?;
    let surface = (0u32..).zip(&file.surface).filter(|(_, s)| **s);
    let model = SpringsModel {
        triangles: file.triangles.clone(),
        surface: surface.map(|(p, _)| p).collect(),
        neighbours: if dense {
            Neighbours::TwentySix
        } else {
            Neighbours::Six
        },
        damped,
        ..model
    };
    let mut notes = file.notes.clone();
    notes.push("numbers of the file have no units: read as m, kg, s".to_owned());
    if model.surface.is_empty() {
        notes.push(
            "no point is one of the surface: nothing is disturbed and nothing held".to_owned(),
        );
    }
    Ok((model, notes, file))
}

/// Input of the damping estimate: means over the springs, and the longest side of all points.
fn body(x: &[Point3<f64>], springs: &Springs, mass: f64) -> DampedBody {
    let count = springs.springs().len() as f64;
    let mean = |value: &dyn Fn(f64, f64) -> f64| {
        springs
            .springs()
            .iter()
            .map(|(_, law)| value(law.rest, law.stiffness))
            .sum::<f64>()
            / count
    };
    let tension = mean(&|rest, stiffness| rest * stiffness);
    let spacing = mean(&|rest, _| rest);
    DampedBody {
        mass,
        tension,
        side: Aabb::of_points(x).extents().max(),
        spacing,
    }
}
