//! Reads the sections `[effects]` and `[solver]`.

use super::Accuracy;
use super::effects::{EFFECTS, Effects};
use super::error::{Gathered, SceneError, SceneProblem};
use super::keys;
use super::parse_muscle;
use super::reader::{Item, Limit, Section};
use super::solvers::{SOLVERS, Solver, SolverSpec};
use super::tree::{Node, Value};
use super::units::Dimension;

/// Reads the effects; each is absent if its section is.
pub(super) fn effects(root: &Section<'_>) -> Result<Effects, SceneError> {
    let mut effects = Effects::default();
    let Some(section) = root.section("effects")? else {
        return Ok(effects);
    };
    let mut all = Gathered::default();
    for spec in &EFFECTS {
        let found = section.section(spec.key);
        let values = found.and_then(|found| found.map(|s| keys::read(spec.keys, &s)).transpose());
        if let Some(values) = all.keep(values).flatten() {
            spec.set(&mut effects, &values);
        }
    }
    all.end()?;
    Ok(effects)
}

/// Reads the solver; small-step XPBD by default.
pub(super) fn solver(root: &Section<'_>) -> Result<Solver, SceneError> {
    let Some(section) = root.section("solver")? else {
        return Ok(Solver::default());
    };
    for (k, first) in SOLVERS.iter().enumerate() {
        for second in &SOLVERS[k + 1..] {
            section.exclusive(first.key, second.key)?;
        }
    }
    for spec in &SOLVERS {
        if let Some(section) = section.section(spec.key)? {
            return settings(spec, &section);
        }
    }
    Ok(Solver::default())
}

/// True for XPBD without a number of steps.
pub(super) fn adapts_steps(root: &Section<'_>) -> Result<bool, SceneError> {
    let Some(section) = root.section("solver")? else {
        return Ok(true);
    };
    let xpbd = section.section(SOLVERS[0].key)?;
    let names_others = SOLVERS[1..]
        .iter()
        .any(|spec| section.get(spec.key).is_some());
    Ok(!names_others && xpbd.is_none_or(|xpbd| xpbd.get("substeps").is_none()))
}

fn settings(spec: &SolverSpec, section: &Section<'_>) -> Result<Solver, SceneError> {
    let mut values = Vec::new();
    for (key, default) in spec.default.settings() {
        values.push(key.read(section, Some(default))?);
    }
    Ok(spec.with(&values))
}

/// What follows a share that is one of the motion.
const OF_MOTION: &str = "of motion";

/// Reads a requested accuracy: a length, or a share of the muscle's length or of the motion.
pub(super) fn accuracy(item: &Item<'_>) -> Result<Accuracy, SceneError> {
    let number = item.text("1 %")?.trim().parse::<f64>().ok();
    if let Some(number) = number.filter(|n| n.is_finite()) {
        return item.fail(SceneProblem::UnitsRequired {
            found: format!("`{number}`"),
            example: format!(
                "\"{number} %\" of a muscle's length, \"{number} % of motion\", or \"{number} mm\""
            ),
            dimension: Dimension::Length,
        });
    }
    if item.text("1 %")?.trim_end().ends_with('%') {
        return Ok(Accuracy::Share(parse_muscle::share(item)?));
    }
    let share = item.text("1 %")?.trim_end().strip_suffix(OF_MOTION);
    if let Some(share) = share.filter(|share| share.trim_end().ends_with('%')) {
        let node = Node {
            value: Value::Text(share.trim_end().to_owned()),
            ..item.node.clone()
        };
        let share = Item {
            node: &node,
            ..item.clone()
        };
        return Ok(Accuracy::OfMotion(parse_muscle::share(&share)?));
    }
    Ok(Accuracy::Length(
        item.quantity(Dimension::Length, Limit::Positive)?,
    ))
}

/// Checks that an error of `solver` can be told, if an accuracy asks for it.
pub(super) fn has_an_energy(
    root: &Section<'_>,
    accuracy: Option<Accuracy>,
    solver: Option<&Solver>,
) -> Result<(), SceneError> {
    let (Some(item), Some(_)) = (root.get("accuracy"), accuracy) else {
        return Ok(());
    };
    if solver.is_none_or(|solver| !solver.has_classic_stiffness()) {
        return Ok(());
    }
    let message = "classic PBD has no energy: what it tends to depends on its steps and sweeps";
    let hint = "leave the accuracy out, or take `[solver.xpbd]`";
    item.fail(SceneProblem::Override {
        message: message.to_owned(),
        hint: hint.to_owned(),
    })
}
