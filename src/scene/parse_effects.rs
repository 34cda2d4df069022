//! Reads the sections `[effects]` and `[solver]`.

use super::error::SceneError;
use super::parse::unknown_name;
use super::parse_muscle;
use super::reader::{Item, Limit, Section};
use super::units::Dimension;
use super::{
    Accuracy, Anisotropy, ContactEffect, Effects, Minimisation, Order, Pbd, Solver, Volume, Xpbd,
};

/// Greatest number of steps per frame and of sweeps per step.
const MOST: u32 = 1_000_000;
/// Greatest relative residual of a converged frame.
const TOLERANCE: f64 = 0.01;

/// Residual force of an equilibrium, relative to the force of unit strain: the error of a pose is
/// then about a thousandth of a muscle's length.
const FORCE_TOLERANCE: f64 = 2e-4;
/// Sections that exclude each other in a scene.
const SOLVERS: [&str; 4] = ["xpbd", "pbd", "quasi_static", "implicit_euler"];

/// A plain number from 0 to 1.
const SHARE: Limit = Limit::Within(0.0, 1.0);

/// Reads the effects; each is absent if its section is.
pub(super) fn effects(root: &Section<'_>) -> Result<Effects, SceneError> {
    let Some(section) = root.section("effects")? else {
        return Ok(Effects::default());
    };
    let volume = section
        .section("volume")?
        .map(|s| -> Result<_, SceneError> {
            Ok(Volume {
                pressure: s.number_or("pressure", Limit::Within(0.5, 2.0), 1.0)?,
            })
        });
    let anisotropy = section
        .section("anisotropy")?
        .map(|s| -> Result<_, SceneError> {
            let strength = s.need("strength", "0.5")?.number(SHARE)?;
            Ok(Anisotropy {
                strength,
                power: s.number_or("power", Limit::Within(1.0, 1000.0), 1.0)?,
            })
        });
    let contact = section
        .section("contact")?
        .map(|s| -> Result<_, SceneError> {
            let thickness = s.need_quantity("thickness", Dimension::Length, Limit::NotNegative)?;
            Ok(ContactEffect {
                thickness,
                friction: s.number_or("friction", Limit::NotNegative, 0.0)?,
            })
        });
    let gravity = section.section("gravity")?.map(|s| {
        s.need("acceleration", "[\"0 m/s2\", \"-9.81 m/s2\", \"0 m/s2\"]")?
            .vector(Dimension::Acceleration)
    });
    let damping = section
        .section("damping")?
        .map(|s| s.need_quantity("rate", Dimension::Rate, Limit::NotNegative));
    Ok(Effects {
        stretch: section.section("stretch")?.is_some(),
        bending: section.section("bending")?.is_some(),
        volume: volume.transpose()?,
        anisotropy: anisotropy.transpose()?,
        contact: contact.transpose()?,
        gravity: gravity.transpose()?,
        damping: damping.transpose()?,
    })
}

/// Reads the solver; small-step XPBD by default.
pub(super) fn solver(root: &Section<'_>) -> Result<Solver, SceneError> {
    let Some(section) = root.section("solver")? else {
        return Ok(Solver::Xpbd(xpbd(None)?));
    };
    for (k, first) in SOLVERS.iter().enumerate() {
        SOLVERS[k + 1..]
            .iter()
            .try_for_each(|second| section.exclusive(first, second))?;
    }
    if let Some(section) = section.section("quasi_static")? {
        return Ok(Solver::QuasiStatic(minimisation(&section)?));
    }
    if let Some(section) = section.section("implicit_euler")? {
        return Ok(Solver::ImplicitEuler(minimisation(&section)?));
    }
    match section.section("pbd")? {
        Some(section) => Ok(Solver::Pbd(pbd(&section)?)),
        None => Ok(Solver::Xpbd(xpbd(section.section("xpbd")?.as_ref())?)),
    }
}

/// Reads a requested accuracy: a length, or a share of the muscle's length.
pub(super) fn accuracy(item: &Item<'_>) -> Result<Accuracy, SceneError> {
    if item.text("1 %")?.trim_end().ends_with('%') {
        return Ok(Accuracy::Share(parse_muscle::share(item)?));
    }
    Ok(Accuracy::Length(
        item.quantity(Dimension::Length, Limit::Positive)?,
    ))
}

fn minimisation(section: &Section<'_>) -> Result<Minimisation, SceneError> {
    Ok(Minimisation {
        substeps: count(Some(section), "substeps", 1)?,
        iterations: count(Some(section), "iterations", 500)?,
        tolerance: section.number_or("tolerance", Limit::Positive, FORCE_TOLERANCE)?,
    })
}

fn xpbd(section: Option<&Section<'_>>) -> Result<Xpbd, SceneError> {
    let whole = |key, default| count(section, key, default);
    Ok(Xpbd {
        substeps: whole("substeps", 20)?,
        iterations: whole("iterations", 1)?,
        order: section.map_or(Ok(Order::default()), order)?,
        tolerance: section.map_or(Ok(TOLERANCE), tolerance)?,
    })
}

fn pbd(section: &Section<'_>) -> Result<Pbd, SceneError> {
    Ok(Pbd {
        substeps: count(Some(section), "substeps", 1)?,
        iterations: count(Some(section), "iterations", 3)?,
        stretch: section.number_or("stretch", SHARE, 1.0)?,
        bending: section.number_or("bending", SHARE, 0.9)?,
        volume: section.number_or("volume", SHARE, 1.0)?,
        velocity_damping: section.number_or("velocity_damping", SHARE, 0.99)?,
        order: order(section)?,
        tolerance: tolerance(section)?,
    })
}

fn tolerance(section: &Section<'_>) -> Result<f64, SceneError> {
    section.number_or("tolerance", Limit::Positive, TOLERANCE)
}

fn count(section: Option<&Section<'_>>, key: &str, default: u32) -> Result<u32, SceneError> {
    section
        .and_then(|s| s.get(key))
        .map_or(Ok(default), |item| item.whole(1, MOST))
}

fn order(section: &Section<'_>) -> Result<Order, SceneError> {
    let Some(item) = section.get("order") else {
        return Ok(Order::default());
    };
    let name = item.text("coloured")?;
    match Order::NAMES.iter().find(|(known, _)| *known == name) {
        Some(&(_, order)) => Ok(order),
        None => item.fail(unknown_name(
            "order",
            name,
            Order::NAMES.iter().map(|(known, _)| *known),
        )),
    }
}
