//! Reads a lattice.

use nalgebra::Vector3;

use super::SceneOrigin;
use super::content::LatticeScene;
use super::error::{SceneError, SceneProblem};
use super::reader::{Limit, Section};
use super::units::Dimension;
use crate::springs::Neighbours;

type Read<T> = Result<T, SceneError>;

/// Greatest number of points of a scene's lattice, since its frames are written.
const MOST_POINTS: usize = 2_000_000;

/// Default stiffness of a spring [N/m] and mass of a point [kg].
const STIFFNESS: f64 = 100.0;
const MASS: f64 = 1e-3;

/// Reads a scene of a lattice.
pub(super) fn scene(root: &Section<'_>, name: String) -> Read<LatticeScene> {
    let frames = root.need("frames", "120")?.whole(1, 10_000_000)? as usize;
    let frame_rate = root.need_quantity("frame_rate", Dimension::Rate, Limit::Positive)?;
    let Some(section) = root.section("lattice")? else {
        return root.fail(SceneProblem::missing("lattice", "a section [lattice]"));
    };
    let item = section.need("points", "[12, 12, 12]")?;
    let counts = item.list("a list of three whole numbers such as [12, 12, 12]")?;
    let points: Vec<usize> = counts
        .iter()
        .map(|n| n.whole(2, 1024).map(|n| n as usize))
        .collect::<Read<_>>()?;
    let Ok(points) = <[usize; 3]>::try_from(points) else {
        return item.fail(SceneProblem::out_of_range(
            "the list",
            "three whole numbers: the points along x, y, z",
        ));
    };
    let count: usize = points.iter().product();
    if count > MOST_POINTS {
        return item.fail(SceneProblem::out_of_range(
            &format!("{count} points"),
            "at most 2000000 points in all",
        ));
    }
    let neighbours = match section.get("neighbours") {
        None => Neighbours::TwentySix,
        Some(item) => match item.whole(6, 26)? {
            6 => Neighbours::Six,
            26 => Neighbours::TwentySix,
            other => return item.fail(SceneProblem::out_of_range(&other.to_string(), "6 or 26")),
        },
    };
    let release = section.get("release");
    let at = release.as_ref().map_or(Ok(frames.div_ceil(2)), |item| {
        item.whole(1, 10_000_000).map(|n| n as usize)
    })?;
    Ok(LatticeScene {
        name,
        frames,
        frame_rate,
        points,
        side: section.need_quantity("side", Dimension::Length, Limit::Positive)?,
        neighbours,
        stiffness: section.quantity_or(
            "stiffness",
            Dimension::Stiffness,
            Limit::Positive,
            STIFFNESS,
        )?,
        mass: section.quantity_or("mass", Dimension::Mass, Limit::Positive, MASS)?,
        damping: section.number_or("damping", Limit::Within(0.0, 10.0), 1.0)?,
        drag: section
            .get("drag")
            .map_or(Ok(Vector3::zeros()), |item| item.vector(Dimension::Length))?,
        release: at,
        origin: SceneOrigin::default(),
    })
}
