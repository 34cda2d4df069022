//! Surfaces of a scene of skin, as read, and notes about their size.

use super::SkinPart;
use crate::mesh::measures::max_or_nan;
use crate::mesh::{TriangleMesh, shapes};
use crate::scene::Source;
use crate::scene::content::{ImplantFill, SkinScene, SkinSurface, Support};
use crate::simulation::assets::{mended, name_of, named_at, read_scaled};
use crate::simulation::fault::{Fault, LoadError};

/// Greatest size of a small implant relative to the skin, and number of triangles per original one
/// after much refinement: both together suggest a wrong unit.
const SMALL: f64 = 0.01;
const REFINED: usize = 10;

/// The key of a mesh of a scene, with its name.
fn mesh(
    scene: &SkinScene,
    source: &Source,
    key: &str,
    part: &str,
) -> Result<(TriangleMesh, Vec<String>), LoadError> {
    let read = read_scaled(source)?;
    if read.mesh.triangles.is_empty() {
        let fault = Fault::NoTriangles {
            file: name_of(source),
        };
        return Err(LoadError::at(
            &scene.origin,
            &named_at(source, key, "mesh"),
            part.to_owned(),
            fault,
        ));
    }
    Ok((
        read.mesh,
        read.warnings
            .iter()
            .map(|warned| format!("{part}: {warned}"))
            .collect(),
    ))
}

/// The size of a skin from a file and of its implants, which reveals a wrong unit.
pub(super) fn size_of(scene: &SkinScene, skin: &TriangleMesh) -> Option<String> {
    let (SkinSurface::Source(Source::File { .. }), Support::Implants(all)) =
        (&scene.skin.surface, &scene.under)
    else {
        return None;
    };
    let extent = extent(skin);
    let (size, unit) = if extent >= 1.0 {
        (extent, "m")
    } else {
        (extent * 1e2, "cm")
    };
    let base = |filled: &ImplantFill| format!("{:.1} cm", filled.order.implant.base * 1e2);
    let bases: Vec<String> = all.iter().map(base).collect();
    Some(format!(
        "skin {size:.1} {unit} across, base {}",
        bases.join(", ")
    ))
}

/// The longest side of the box around a surface [m].
fn extent(mesh: &TriangleMesh) -> f64 {
    max_or_nan(mesh.bounding_box().extents().iter().copied())
}

/// A note if an implant is small relative to the skin and needed much refinement.
pub(super) fn small(part: &SkinPart, skin: &TriangleMesh) -> Option<String> {
    let ready = &part.ready;
    let share = ready.order.implant.base / extent(skin);
    let (taken, became) = (
        skin.triangles.len() - ready.outside.len(),
        ready.patch.triangles.len(),
    );
    (share < SMALL && became > REFINED * taken).then(|| {
        format!(
            "the base of `{}` is {:.2} % of the skin's extent, and {taken} triangles of the skin became {became}: check \
             `unit` and `base`",
            part.name,
            share * 1e2
        )
    })
}

pub(super) fn read_skin(
    scene: &SkinScene,
    notes: &mut Vec<String>,
) -> Result<TriangleMesh, LoadError> {
    let skin = &scene.skin;
    let read = match &skin.surface {
        SkinSurface::Sheet { side, cells } => shapes::sheet(*side, *cells),
        SkinSurface::Source(Source::Shape(_)) => shapes::scalp(),
        SkinSurface::Source(file) => {
            let (read, found) = mesh(scene, file, "skin.0", &format!("skin `{}`", skin.name))?;
            notes.extend(found);
            read
        }
    };
    let mut own = Vec::new();
    let read = mended(read, skin.repair.as_ref(), &mut own);
    notes.extend(own.iter().map(|n| format!("{}: {n}", skin.name)));
    Ok(read)
}

pub(super) fn read_obstacle(
    scene: &SkinScene,
    o: usize,
    notes: &mut Vec<String>,
) -> Result<TriangleMesh, LoadError> {
    let obstacle = &scene.obstacles[o];
    let part = format!("obstacle `{}`", obstacle.name);
    let (read, found) = mesh(scene, &obstacle.surface, &format!("obstacle.{o}"), &part)?;
    notes.extend(found);
    let mut own = Vec::new();
    let read = mended(read, obstacle.repair.as_ref(), &mut own);
    notes.extend(own.iter().map(|n| format!("{}: {n}", obstacle.name)));
    Ok(read)
}
