//! How two muscles hold each other: the sections `[[interface]]`.

use super::Muscle;
use super::error::{SceneError, SceneProblem};
use super::parse::unknown_name;
use super::reader::{Item, Limit, Section};
use super::units::Dimension;

/// How two muscles hold each other where they touch. A pair without an interface slides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interface {
    /// Indices of the two muscles.
    pub between: [usize; 2],
    /// Their bond; `None` if they slide on each other.
    pub bond: Option<Bonding>,
}

/// A bond of two muscles: springs from the vertices of each to their nearest places on the other one
/// at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bonding {
    /// Stiffness for each area of the bond [N/m^3]; `None` is E1 E2 / ((E1 + E2) l^2) with the
    /// in-plane stiffnesses E1 and E2 of the muscles [N/m] and the greater of their median edges l
    /// [m]: shear between them then decays over one edge.
    pub stiffness: Option<f64>,
    /// Greatest distance of a vertex from the other muscle at rest [m]; `None` is twice the contact
    /// thickness.
    pub within: Option<f64>,
}

/// The names of the kinds of interfaces.
const KINDS: [&str; 2] = ["sliding", "bonded"];

/// Reads the interfaces of a scene with these muscles.
pub(super) fn interfaces(
    root: &Section<'_>,
    muscles: &[Muscle],
) -> Result<Vec<Interface>, SceneError> {
    let mut all: Vec<Interface> = Vec::new();
    for section in root.sections("interface")? {
        let item = section.need("between", "[\"NAME\", \"NAME\"]")?;
        let between = pair(&item, muscles)?;
        let is_same = |known: &Interface| {
            let [a, b] = known.between;
            between == [a, b] || between == [b, a]
        };
        if let Some(first) = all.iter().position(is_same) {
            return item.fail(SceneProblem::Conflict {
                first: format!("interface.{first}"),
                second: format!("interface.{}", all.len()),
            });
        }
        let bond = bond(&section)?;
        all.push(Interface { between, bond });
    }
    Ok(all)
}

/// The indices of two different muscles.
fn pair(item: &Item<'_>, muscles: &[Muscle]) -> Result<[usize; 2], SceneError> {
    let names = muscles.iter().map(|muscle| muscle.name.as_str());
    let mut found = Vec::new();
    for item in item.list("a list of two names of muscles")? {
        let name = item.text("gluteus maximus")?;
        match muscles.iter().position(|muscle| muscle.name == name) {
            None => return item.fail(unknown_name("muscle", name, names)),
            Some(muscle) if found.contains(&muscle) => {
                return item.fail(SceneProblem::out_of_range(
                    &format!("{name} twice"),
                    "the names of two different muscles",
                ));
            }
            Some(muscle) => found.push(muscle),
        }
    }
    match found[..] {
        [a, b] => Ok([a, b]),
        _ => item.fail(SceneProblem::out_of_range(
            &format!("{} names", found.len()),
            "the names of two muscles",
        )),
    }
}

fn bond(section: &Section<'_>) -> Result<Option<Bonding>, SceneError> {
    let item = section.need("kind", "\"bonded\"")?;
    let kind = item.text("bonded")?;
    if !KINDS.contains(&kind) {
        return item.fail(unknown_name("kind", kind, KINDS.into_iter()));
    }
    if kind == "sliding" {
        let of_bonds = ["stiffness", "within"];
        return match of_bonds.iter().find_map(|key| section.get(key)) {
            Some(item) => item.fail(SceneProblem::Conflict {
                first: "kind = \"sliding\"".to_owned(),
                second: item.key.rsplit('.').next().unwrap_or_default().to_owned(),
            }),
            None => Ok(None),
        };
    }
    let quantity = |key: &str, dimension: Dimension| {
        let item = section.get(key);
        item.map(|item| item.quantity(dimension, Limit::Positive))
            .transpose()
    };
    Ok(Some(Bonding {
        stiffness: quantity("stiffness", Dimension::BondStiffness)?,
        within: quantity("within", Dimension::Length)?,
    }))
}
