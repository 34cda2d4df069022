//! Reads the sections `[[muscle]]`.

use super::effects::material_constants;
use super::error::{SceneError, SceneProblem};
use super::keys::KeyValue;
use super::parse::{KnownBones, edge_length, file, file_at, repair, shape, surface};
use super::reader::{Item, Limit, Section};
use super::tree::Value;
use super::units::Dimension;
use super::{AreaSpec, AtVertices, AttachmentSpec, Mass, Material, Muscle, Source};
use crate::mesh::shapes;

/// Default share of the vertices that an attachment may contain.
const LIMIT: f64 = 0.1;

/// Default and greatest number of computed fibres.
const FIBRES: u32 = 100;
const MOST_FIBRES: u32 = 10_000;

/// Greatest shortening by activation, relative to the length at rest.
const MOST_SHORTENED: f64 = 0.5;

/// Reads one muscle with a checked name.
pub(super) fn muscle(
    section: &Section<'_>,
    name: String,
    bones: &KnownBones<'_>,
) -> Result<Muscle, SceneError> {
    let surface = surface(section)?;
    let repair = repair(section)?;
    let edge_length = edge_length(section)?;
    let material = match section.section("material")? {
        Some(section) => material(&section)?,
        None => Material::default(),
    };
    let attachments = attachments(section, bones)?;
    let (fibres, fibre_count) = match section.section("fibres")? {
        Some(section) => fibres(&section, &surface)?,
        None => (None, None),
    };
    let mut bones = attachments.iter().map(|a| a.bone);
    let first = bones.next();
    if fibre_count.is_some() && bones.all(|bone| Some(bone) == first) {
        return section.fail(SceneProblem::Missing {
            what: "a second bone, to which the computed fibres lead,".to_owned(),
            add: "`[[muscle.attachment]]` for the other bone".to_owned(),
        });
    }
    let activation = match section.section("activation")? {
        Some(activated) if fibres.is_none() && fibre_count.is_none() => {
            return activated.fail(SceneProblem::Missing {
                what: "a source of fibres".to_owned(),
                add: "`[muscle.fibres]` with `method = \"harmonic\"`".to_owned(),
            });
        }
        Some(section) => activation(&section)?,
        None => Vec::new(),
    };
    let mut forces = Vec::new();
    for section in section.sections("force")? {
        let vertices = section.need("vertices", "[0]")?.vertices()?;
        let vector = section
            .need("force", "[\"0 N\", \"-10 N\", \"0 N\"]")?
            .vector(Dimension::Force)?;
        forces.push(AtVertices { vertices, vector });
    }
    let mut displacements = Vec::new();
    for section in section.sections("displace")? {
        let vertices = section.need("vertices", "[0]")?.vertices()?;
        let vector = section
            .need("by", "[\"1 mm\", \"0 mm\", \"0 mm\"]")?
            .vector(Dimension::Length)?;
        displacements.push(AtVertices { vertices, vector });
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
        fibre_count,
        activation,
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

/// The shortening by frame, with rising frames.
fn activation(section: &Section<'_>) -> Result<Vec<(f64, f64)>, SceneError> {
    let keys = section.need(
        "keys",
        "[{ frame = 0, shortening = \"0 %\" }, { frame = 100, shortening = \"15 %\" }]",
    )?;
    let mut all: Vec<(f64, f64)> = Vec::new();
    for key in section.sections("keys")? {
        let frame = key.need("frame", "0")?.number(Limit::Within(0.0, 1e9))?;
        let limit = Limit::Within(0.0, MOST_SHORTENED);
        let shortening = key.need_quantity("shortening", Dimension::Ratio, limit)?;
        if all.last().is_some_and(|(before, _)| frame <= *before) {
            return key.need("frame", "0")?.fail(SceneProblem::OutOfRange {
                found: format!("{frame}"),
                allowed: "a later frame than that of the key before".to_owned(),
            });
        }
        all.push((frame, shortening));
    }
    if all.is_empty() {
        return keys.fail(SceneProblem::EmptyList {
            expected: "at least one key".to_owned(),
        });
    }
    Ok(all)
}

/// The source of fibres, or the number of fibres to compute: `lines` with its `unit`; `shape`, a name
/// or `true` for that of the muscle; or `method` with a `count`.
fn fibres(
    section: &Section<'_>,
    muscle: &Source,
) -> Result<(Option<Source>, Option<u32>), SceneError> {
    section.exclusive("lines", "shape")?;
    section.exclusive("lines", "method")?;
    section.exclusive("shape", "method")?;
    if let Some(item) = section.get("method") {
        section.exclusive("method", "unit")?;
        let name = item.text("harmonic")?;
        if name != "harmonic" {
            return item.fail(super::parse::unknown_name(
                "method",
                name,
                ["harmonic"].into_iter(),
            ));
        }
        let count = section
            .get("count")
            .map_or(Ok(FIBRES), |i| i.whole(1, MOST_FIBRES))?;
        return Ok((None, Some(count)));
    }
    if let (Some(item), None) = (section.get("count"), section.get("method")) {
        return item.fail(SceneProblem::missing("method", "`method = \"harmonic\"`"));
    }
    if let Some(item) = section.get("lines") {
        return Ok((Some(file(&item, section)?), None));
    }
    let Some(item) = section.get("shape") else {
        return section.fail(SceneProblem::Missing {
            what: "the fibres' source".to_owned(),
            add: "`method = \"harmonic\"`, `lines = \"FILE\"` with its `unit`, or `shape = true`"
                .to_owned(),
        });
    };
    fibres_of_shape(&item, section, muscle).map(|source| (Some(source), None))
}

/// `shape`: a name, or `true` for that of the muscle.
fn fibres_of_shape(
    item: &Item<'_>,
    section: &Section<'_>,
    muscle: &Source,
) -> Result<Source, SceneError> {
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
        _ => shape(item, shapes::FIBRE_NAMES),
    }
}
