//! Reads the sections `[[muscle]]`.

use super::effects::material_constants;
use super::error::{SceneError, SceneProblem};
use super::keys::KeyValue;
use super::parse::{KnownBones, file, file_at, repair, shape, surface};
use super::reader::{Item, Limit, Section};
use super::tree::Value;
use super::units::Dimension;
use super::{AreaSpec, AttachmentSpec, Displacement, Mass, Material, Muscle, ScaleForce, Source};
use crate::mesh::shapes;

/// Default share of the vertices that an attachment may contain.
const LIMIT: f64 = 0.1;

/// Reads one muscle with a checked name.
pub(super) fn muscle(
    section: &Section<'_>,
    name: String,
    bones: &KnownBones<'_>,
) -> Result<Muscle, SceneError> {
    let surface = surface(section)?;
    let repair = repair(section)?;
    let edge_length = section
        .get("edge_length")
        .map(|i| i.quantity(Dimension::Length, Limit::Positive))
        .transpose()?;
    let material = match section.section("material")? {
        Some(section) => material(&section)?,
        None => Material::default(),
    };
    let attachments = attachments(section, bones)?;
    let fibres = section
        .section("fibres")?
        .map(|s| fibres(&s, &surface))
        .transpose()?;
    let mut forces = Vec::new();
    for section in section.sections("force")? {
        let vertices = section.need("vertices", "[0]")?.vertices()?;
        let force = section
            .need("force", "[\"0 N\", \"-10 N\", \"0 N\"]")?
            .vector(Dimension::Force)?;
        forces.push(ScaleForce { vertices, force });
    }
    let mut displacements = Vec::new();
    for section in section.sections("displace")? {
        let vertices = section.need("vertices", "[0]")?.vertices()?;
        let by = section
            .need("by", "[\"1 mm\", \"0 mm\", \"0 mm\"]")?
            .vector(Dimension::Length)?;
        displacements.push(Displacement { vertices, by });
    }
    let by_index = attachments
        .iter()
        .any(|a| matches!(a.area, AreaSpec::Vertices(_)));
    if repair.is_some() && (by_index || !forces.is_empty() || !displacements.is_empty()) {
        // A repair can drop and add vertices, which would change the meaning of an index.
        let problem = SceneProblem::Conflict {
            first: "repair".to_owned(),
            second: "vertices".to_owned(),
        };
        return section.need("repair", "true")?.fail(problem);
    }
    Ok(Muscle {
        name,
        surface,
        repair,
        edge_length,
        material,
        attachments,
        fibres,
        forces,
        displacements,
    })
}

fn material(section: &Section<'_>) -> Result<Material, SceneError> {
    section.exclusive("density", "vertex_mass")?;
    let mut material = Material::default();
    if let Some(item) = section.get("vertex_mass") {
        material.mass = Mass::PerVertex(item.quantity(Dimension::Mass, Limit::Positive)?);
    }
    if let Some(item) = section.get("density") {
        material.mass = Mass::Density(item.quantity(Dimension::Density, Limit::Positive)?);
    }
    for constant in material_constants() {
        if let Some(item) = section.get(constant.key.key)
            && let KeyValue::Number(value) = constant.key.value(&item)?
        {
            constant.set(&mut material, value);
        }
    }
    Ok(material)
}

fn attachments(
    muscle: &Section<'_>,
    bones: &KnownBones<'_>,
) -> Result<Vec<AttachmentSpec>, SceneError> {
    let mut attachments = Vec::new();
    // Only lists can be checked here; areas need the mesh.
    let mut held = std::collections::HashMap::new();
    for section in muscle.sections("attachment")? {
        let bone = bones.named_by(&section)?;
        let area = area(&section)?;
        if let AreaSpec::Vertices(vertices) = &area {
            for &vertex in vertices {
                if let Some(other) = held.insert(vertex, bone) {
                    let bone = bones.name(other).to_owned();
                    return section
                        .need("vertices", "[0]")?
                        .fail(SceneProblem::HeldTwice { vertex, bone });
                }
            }
        }
        let limit = section.get("limit").map_or(Ok(LIMIT), |i| share(&i))?;
        attachments.push(AttachmentSpec { bone, area, limit });
    }
    Ok(attachments)
}

/// A share above zero, at most 1.
pub(super) fn share(item: &Item<'_>) -> Result<f64, SceneError> {
    let share = item.quantity(Dimension::Ratio, Limit::Positive)?;
    if share <= 1.0 {
        return Ok(share);
    }
    let found = match &item.node.value {
        Value::Text(text) => text.clone(),
        _ => share.to_string(),
    };
    item.fail(SceneProblem::out_of_range(
        &found,
        "a ratio greater than zero and at most 100 %",
    ))
}

fn area(section: &Section<'_>) -> Result<AreaSpec, SceneError> {
    for (first, second) in [
        ("near", "patch"),
        ("near", "vertices"),
        ("patch", "vertices"),
    ] {
        section.exclusive(first, second)?;
    }
    if let Some(item) = section.get("patch") {
        return patch(&item, section);
    }
    let area = match (section.get("near"), section.get("vertices")) {
        (Some(item), _) => AreaSpec::Near(item.quantity(Dimension::Length, Limit::NotNegative)?),
        (None, Some(item)) => AreaSpec::Vertices(item.vertices()?),
        (None, None) => {
            return section.fail(SceneProblem::Missing {
                what: "the area of the attachment".to_owned(),
                add: "`near = \"3 mm\"`, `patch = \"FILE\"` or `vertices = [0, 1]`".to_owned(),
            });
        }
    };
    // These two keys only apply to a patch.
    for key in ["unit", "within"] {
        section.exclusive(
            if section.get("near").is_some() {
                "near"
            } else {
                "vertices"
            },
            key,
        )?;
    }
    Ok(area)
}

/// `patch = "FILE#component"` with its `unit` and `within`.
fn patch(item: &Item<'_>, section: &Section<'_>) -> Result<AreaSpec, SceneError> {
    let text = item.text("FILE#0")?;
    let (path, component) = match text.rsplit_once('#') {
        None => (text, None),
        Some((path, number)) => match number.parse() {
            Ok(number) if number < u32::MAX as usize => (path, Some(number)),
            _ => {
                let allowed = "the number of a component behind the `#`, 0 for the largest";
                return item.fail(SceneProblem::out_of_range(&format!("#{number}"), allowed));
            }
        },
    };
    let source = file_at(path, item, section)?;
    let within = section.need_quantity("within", Dimension::Length, Limit::NotNegative)?;
    Ok(AreaSpec::Patch {
        source,
        component,
        within,
    })
}

/// `lines` with its `unit`, or `shape`: a name, or `true` for that of the muscle.
fn fibres(section: &Section<'_>, muscle: &Source) -> Result<Source, SceneError> {
    section.exclusive("lines", "shape")?;
    if let Some(item) = section.get("lines") {
        return file(&item, section);
    }
    let Some(item) = section.get("shape") else {
        return section.fail(SceneProblem::Missing {
            what: "the fibres' source".to_owned(),
            add: "`lines = \"FILE\"` with its `unit`, or `shape = true`".to_owned(),
        });
    };
    section.exclusive("shape", "unit")?;
    match (&item.node.value, muscle) {
        (Value::Boolean(true), Source::Shape(name))
            if shapes::FIBRE_NAMES.contains(&name.as_str()) =>
        {
            Ok(muscle.clone())
        }
        (Value::Boolean(_), _) => item.fail(SceneProblem::OutOfRange {
            found: "this".to_owned(),
            allowed: format!(
                "a text; only muscles of the shape {} have fibres of their own",
                shapes::FIBRE_NAMES.join(", ")
            ),
        }),
        _ => shape(&item, shapes::FIBRE_NAMES),
    }
}
