//! Promise of a repair for any mesh: a valid mesh without the repaired defects, and a matching list
//! of changes.

use super::loaders::{Breach, LoadOutcome};
use super::round_trip::drawing;
use crate::mesh::TriangleMesh;
use crate::mesh::health::Health;
use crate::mesh::repair::{RepairOptions, RepairStep, Repaired, deviation, repair};

/// Examines and repairs a mesh made from bytes, with options from the first two bytes.
///
/// # Errors
/// The first broken promise.
pub fn check_repair(bytes: &[u8]) -> Result<LoadOutcome, Breach> {
    let (&[choice, holes], rest) = bytes.split_first_chunk().unwrap_or((&[0, 0], bytes));
    let (mut mesh, lines) = drawing(rest);
    // Readers leave these out.
    mesh.triangles
        .retain(|[a, b, c]| a != b && b != c && c != a);
    let Ok(mesh) = TriangleMesh::new(mesh.vertices, mesh.triangles) else {
        return Ok(LoadOutcome::Refused);
    };
    if lines
        .iter()
        .flatten()
        .any(|v| *v as usize >= mesh.vertices.len())
    {
        return Ok(LoadOutcome::Refused);
    }
    let options = RepairOptions {
        merge_within: if choice & 1 == 1 {
            mesh.length() * f64::from(choice) / 512.0
        } else {
            0.0
        },
        close_holes: usize::from(holes % 16),
        cut_handles: if choice & 4 == 4 {
            mesh.length() * f64::from(choice) / 256.0
        } else {
            0.0
        },
        keep_largest: choice & 2 == 2,
    };
    let repaired = repair(&mesh, &lines, &options);
    check_repaired(&mesh, &lines, &repaired)?;
    // Distances overflow for extremely large coordinates; the function must still run.
    let _ = deviation(&mesh, &repaired.mesh);
    Ok(LoadOutcome::Accepted)
}

/// Checks the repair of a mesh with valid indices and finite coordinates.
///
/// # Errors
/// The first promise that is broken.
pub fn check_repaired(
    mesh: &TriangleMesh,
    lines: &[Vec<u32>],
    repaired: &Repaired,
) -> Result<(), Breach> {
    let broken = |detail: String| Err(Breach::Invalid { detail });
    let Repaired { mesh: after, .. } = repaired;
    if let Err(error) = TriangleMesh::new(after.vertices.clone(), after.triangles.clone()) {
        return broken(error.to_string());
    }
    let count = after.vertices.len();
    if repaired.lines.len() != lines.len()
        || repaired
            .lines
            .iter()
            .flatten()
            .any(|v| *v as usize >= count)
    {
        return broken("a line was lost or names no vertex".into());
    }
    let health = Health::with_lines(after, &repaired.lines);
    let left = [
        (
            "edges with more than two triangles",
            health.non_manifold_edges,
        ),
        (
            "vertices in which surfaces touch",
            health.non_manifold_vertices,
        ),
        ("unused vertices", health.unused_vertices),
        (
            "edges that disagree",
            if health.orientable {
                health.inconsistent_edges
            } else {
                0
            },
        ),
    ];
    if let Some((what, count)) = left.iter().find(|(_, count)| *count > 0) {
        return broken(format!("{count} {what} are left"));
    }
    let unchanged = after == mesh && repaired.lines == lines;
    if unchanged != repaired.changes.is_empty() && repaired.changes.is_empty() {
        return broken("a change was not reported".into());
    }
    for change in &repaired.changes {
        let of_vertices = [
            RepairStep::MergedVertices,
            RepairStep::SplitVertices,
            RepairStep::ClosedHoles,
            RepairStep::DroppedVertices,
        ]
        .contains(&change.step);
        let most = if of_vertices {
            mesh.vertices.len()
        } else {
            mesh.triangles.len()
        };
        if change.count == 0 || change.elements.iter().any(|e| *e as usize >= most) {
            return broken(format!("a change that cannot be: {change:?}"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::icosphere;

    /// Each promise, broken deliberately, must be detected.
    #[test]
    fn control_broken_promises_are_noticed() {
        let mesh = icosphere(1.0, 1);
        let right = repair(&mesh, &[vec![0, 1]], &RepairOptions::default());
        assert_eq!(check_repaired(&mesh, &[vec![0, 1]], &right), Ok(()));
        let with = |change: &dyn Fn(&mut Repaired)| {
            let mut wrong = right.clone();
            change(&mut wrong);
            check_repaired(&mesh, &[vec![0, 1]], &wrong).is_err()
        };
        assert!(with(&|r| r.lines.clear()));
        assert!(with(&|r| r.lines[0][0] = 99));
        assert!(with(&|r| r.mesh.triangles[0] = [0, 0, 1]));
        assert!(with(&|r| r.mesh.vertices[0].x = f64::NAN));
        assert!(with(&|r| r.mesh.triangles[0].swap(0, 1)));
        assert!(with(&|r| r.mesh.triangles.push(r.mesh.triangles[0])));
        assert!(with(&|r| r.mesh.vertices.push(r.mesh.vertices[0])));
        assert!(with(&|r| r.mesh.vertices[0] *= 2.0));
    }
}
