//! Reads a lattice.

use nalgebra::Vector3;

use super::SceneOrigin;
use super::content::{LatticeScene, PRECISIONS, RestCourse, SpringsDamping};
use super::error::{SceneError, SceneProblem};
use super::parse::unknown_name;
use super::reader::{Limit, Section};
use super::units::Dimension;
use crate::springs::Neighbours;
use crate::springs::integrators::INTEGRATORS;
use crate::springs::lattice::{DEVICES, GPU_METHODS, Stiffness};

type Read<T> = Result<T, SceneError>;

/// Greatest number of points of a lattice that is displaced and released, since its frames are
/// written; and of any lattice.
const MOST_POINTS: usize = 2_000_000;
const MOST_AT_REST: usize = 1 << 30;

/// Rate of the pictures of a run to rest [1/s].
const PICTURE_RATE: f64 = 60.0;

/// Default stiffness of a spring [N/m] and mass of a point [kg].
const STIFFNESS: f64 = 100.0;
const MASS: f64 = 1e-3;

/// The stiffness 1/L [N/m] of a spring of length L [m].
const RECIPROCAL: &str = "1/L";

/// Reads a scene of a lattice.
pub(super) fn scene(root: &Section<'_>, name: String) -> Read<LatticeScene> {
    let frames = root.need("frames", "120")?.whole(1, 10_000_000)? as usize;
    let Some(section) = root.section("lattice")? else {
        return root.fail(SceneProblem::missing("lattice", "a section [lattice]"));
    };
    let rest = section.section("rest")?;
    for key in ["drag", "release"] {
        section.exclusive("rest", key)?;
    }
    let frame_rate = match &rest {
        Some(_) => {
            root.quantity_or("frame_rate", Dimension::Rate, Limit::Positive, PICTURE_RATE)?
        }
        None => root.need_quantity("frame_rate", Dimension::Rate, Limit::Positive)?,
    };
    let item = section.need("points", "[12, 12, 12]")?;
    let counts = item.list("a list of three whole numbers such as [12, 12, 12]")?;
    let points: Vec<usize> = counts
        .iter()
        .map(|n| n.whole(2, 1 << 20).map(|n| n as usize))
        .collect::<Read<_>>()?;
    let Ok(points) = <[usize; 3]>::try_from(points) else {
        return item.fail(SceneProblem::out_of_range(
            "the list",
            "three whole numbers: the points along x, y, z",
        ));
    };
    // At most 2^60.
    let count: usize = points.iter().product();
    let most = if rest.is_some() {
        MOST_AT_REST
    } else {
        MOST_POINTS
    };
    if count > most {
        return item.fail(SceneProblem::out_of_range(
            &format!("{count} points"),
            &format!("at most {most} points in all"),
        ));
    }
    let neighbours = match section.get("neighbours") {
        None => Neighbours::TwentySix,
        Some(item) => {
            let count = item.whole(6, 26)?;
            let refused = || SceneProblem::out_of_range(&count.to_string(), "6, 18 or 26");
            Neighbours::of_count(count).ok_or_else(|| item.error(refused()))?
        }
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
        stiffness: stiffness(&section)?,
        mass: section.quantity_or("mass", Dimension::Mass, Limit::Positive, MASS)?,
        damping: damping(&section)?,
        drag: section
            .get("drag")
            .map_or(Ok(Vector3::zeros()), |item| item.vector(Dimension::Length))?,
        release: at,
        rest: rest.map(|section| course(&section)).transpose()?,
        origin: SceneOrigin::default(),
    })
}

/// The same for all springs, or the law 1/L.
fn stiffness(section: &Section<'_>) -> Read<Stiffness> {
    match section.get("stiffness") {
        None => Ok(Stiffness::Uniform(STIFFNESS)),
        Some(item) if item.is_text() && item.text(RECIPROCAL)?.trim() == RECIPROCAL => {
            Ok(Stiffness::Reciprocal)
        }
        Some(item) => item
            .quantity(Dimension::Stiffness, Limit::Positive)
            .map(Stiffness::Uniform),
    }
}

/// A number relative to the estimate, or a damping with its unit.
fn damping(section: &Section<'_>) -> Read<SpringsDamping> {
    match section.get("damping") {
        None => Ok(SpringsDamping::Share(1.0)),
        Some(item) if item.is_text() => item
            .quantity(Dimension::Damping, Limit::NotNegative)
            .map(SpringsDamping::Absolute),
        Some(item) => item
            .number(Limit::Within(0.0, 10.0))
            .map(SpringsDamping::Share),
    }
}

fn flag(section: &Section<'_>, key: &str, default: bool) -> Read<bool> {
    section.get(key).map_or(Ok(default), |item| item.flag())
}

/// The course of a run to rest.
fn course(section: &Section<'_>) -> Read<RestCourse> {
    let default = RestCourse::default();
    let below_one = |key: &str, limit, default| -> Read<f64> {
        let number = section.number_or(key, limit, default)?;
        if number < 1.0 {
            return Ok(number);
        }
        let problem = SceneProblem::out_of_range(&number.to_string(), "a number below 1");
        Err(section.error_at(key, problem))
    };
    let name_of =
        |key: &'static str, known: &[&'static str], default: &'static str| match section.get(key) {
            None => Ok(default),
            Some(item) => {
                let name = item.text(default)?;
                let found = known.iter().find(|known| **known == name);
                found
                    .copied()
                    .ok_or_else(|| item.error(unknown_name(key, name, known.iter().copied())))
            }
        };
    let device = name_of("device", &DEVICES, default.device)?;
    let is_on_gpu = device == DEVICES[1];
    let precision = PRECISIONS[usize::from(!is_on_gpu)];
    let precision = name_of("precision", &PRECISIONS, precision)?;
    if let (Some(item), true) = (
        section.get("precision"),
        is_on_gpu && precision != PRECISIONS[0],
    ) {
        return item.fail(SceneProblem::Override {
            message: "a graphics card computes in single precision".to_owned(),
            hint: "leave `precision` out, or take `device = \"cpu\"`".to_owned(),
        });
    }
    if let (Some(item), false) = (section.get("method"), is_on_gpu) {
        return item.fail(SceneProblem::Override {
            message: "the methods are those of a graphics card".to_owned(),
            hint: "leave `method` out, or take `device = \"gpu\"`".to_owned(),
        });
    }
    Ok(RestCourse {
        shrink: below_one("shrink", Limit::Within(-1.0, 1.0), default.shrink)?,
        held: flag(section, "held", default.held)?,
        integrator: name_of("integrator", &INTEGRATORS, default.integrator)?,
        time_step: section
            .get("time_step")
            .map(|item| item.quantity(Dimension::Time, Limit::Positive))
            .transpose()?,
        adaptive: flag(section, "adaptive", default.adaptive)?,
        tolerance: below_one("tolerance", Limit::Positive, default.tolerance)?,
        is_single: precision == PRECISIONS[0],
        device,
        method: name_of("method", &GPU_METHODS, default.method)?,
    })
}
