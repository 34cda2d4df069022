//! The effects. [`EFFECTS`] declares each one once. Scene files, overrides, the panel and scenes
//! from meshes alone read the table. `crate::simulation::effects` declares the plan, the cost and
//! the constraints of an effect.

use nalgebra::Vector3;

use super::keys::{KeyKind, KeySpec, KeyValue, Limit, Slider};
use super::schema::Schema;
use super::units::Dimension;

/// The effects of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Effects {
    /// Edges resist a change of length (material constant `stretch`).
    pub stretch: bool,
    /// Neighbouring triangles resist a change of their angle (material constant `bending`), and more so
    /// beyond this angle \[rad\].
    pub bending: Option<f64>,
    /// The enclosed volume is kept (material constant `bulk`).
    pub volume: Option<Volume>,
    /// Stretching along fibres is easier.
    pub anisotropy: Option<Anisotropy>,
    /// Fibres keep a stress while their muscle shortens \[Pa\].
    pub tone: Option<f64>,
    /// Surfaces are kept from passing through each other.
    pub contact: Option<ContactEffect>,
    /// Stiffness with which fascia holds muscles to the bones on which they lie [N/m^3].
    pub fascia: Option<f64>,
    /// Acceleration [m/s^2].
    pub gravity: Option<Vector3<f64>>,
    /// Rate at which velocities relative to the bones decay [1/s].
    pub damping: Option<f64>,
    /// Retardation time of the dampers beside the springs of the edges \[s\]; only with a `damping`.
    pub retardation: f64,
}

impl Effects {
    /// True if velocities change by damping.
    pub(crate) fn damps(&self) -> bool {
        self.damping.unwrap_or(0.0) > 0.0 || self.retardation > 0.0
    }
}

/// The enclosed volume is kept at `pressure` times its start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Volume {
    /// Pressure factor, 0.5 to 2.
    pub pressure: f64,
}

/// Stiffness of an edge is scaled by `1 - strength |u.v|^power`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Anisotropy {
    /// A in 0..1.
    pub strength: f64,
    /// Exponent, at least 1.
    pub power: f64,
}

/// Contact of muscles with bones, with each other and with themselves, with Coulomb friction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactEffect {
    /// Distance kept between surfaces \[m\].
    pub thickness: f64,
    /// Coefficient of Coulomb friction.
    pub friction: f64,
    /// The surfaces that a muscle meets.
    pub between: ContactPartners,
}

/// The surfaces that a muscle meets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ContactPartners {
    /// Other muscles.
    pub muscles: bool,
    /// Bones.
    pub bones: bool,
    /// The muscle itself.
    pub itself: bool,
}

impl ContactPartners {
    /// The names in a scene file, in the order of the bits of a key.
    const NAMES: &'static [&'static str] = &["muscles", "bones", "self"];

    fn bits(self) -> u32 {
        let Self {
            muscles,
            bones,
            itself,
        } = self;
        u32::from(muscles) | u32::from(bones) << 1 | u32::from(itself) << 2
    }

    fn of_bits(bits: u32) -> Self {
        let [muscles, bones, itself] = [0, 1, 2].map(|k| bits >> k & 1 == 1);
        Self {
            muscles,
            bones,
            itself,
        }
    }
}

/// Material constants of a surface muscle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Source of the mass.
    pub mass: Mass,
    /// In-plane stiffness of the surface [N/m]; zero leaves the effect out.
    pub stretch: f64,
    /// Bending stiffness of the surface [N m]; zero leaves the effect out.
    pub bending: f64,
    /// Bulk modulus \[Pa\]; `None` is incompressible.
    pub bulk: Option<f64>,
}

impl Default for Material {
    /// An incompressible muscle of 1060 kg/m^3.
    fn default() -> Self {
        Self {
            mass: Mass::Density(1060.0),
            stretch: 300.0,
            bending: 2e-4,
            bulk: None,
        }
    }
}

/// Source of the mass of a vertex.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mass {
    /// Density of the enclosed volume [kg/m^3], shared among vertices by area.
    Density(f64),
    /// The same mass for each vertex \[kg\].
    PerVertex(f64),
}

/// The declaration of an effect.
#[derive(Debug)]
pub struct EffectSpec {
    /// The key of its section below `[effects]`.
    pub key: &'static str,
    /// Description in one sentence.
    pub help: &'static str,
    /// The keys of its section.
    pub keys: &'static [KeySpec],
    /// The constant of a muscle's material that gives its stiffness.
    pub material: Option<MaterialSpec>,
    /// The text of its section in a scene from meshes alone; `None` leaves the effect out.
    pub usual: Option<&'static str>,
    pub(super) schema: Schema,
    values: fn(&Effects) -> Option<Vec<KeyValue>>,
    set: fn(&mut Effects, &[KeyValue]),
}

/// The declaration of a material constant.
#[derive(Debug)]
pub struct MaterialSpec {
    /// The key below `[muscle.material]`.
    pub key: KeySpec,
    value: fn(&Material) -> Option<f64>,
    set: fn(&mut Material, f64),
}

/// Every effect.
pub static EFFECTS: [EffectSpec; 9] = [
    EffectSpec {
        key: "stretch",
        help: "Edges resist a change of length.",
        keys: &[],
        material: Some(MaterialSpec {
            key: stiffness("stretch", Dimension::Stiffness, "In-plane stiffness.")
                .shown_in("N/m", 1.0)
                .over(about(100.0, 300.0)),
            value: |material| Some(material.stretch),
            set: |material, value| material.stretch = value,
        }),
        usual: Some(""),
        schema: Schema::Keys(&[]),
        values: |effects| effects.stretch.then(Vec::new),
        set: |effects, _| effects.stretch = true,
    },
    EffectSpec {
        key: "bending",
        help: "Neighbouring triangles resist a change of their angle.",
        keys: BENDING,
        material: Some(MaterialSpec {
            key: stiffness("bending", Dimension::Moment, "Bending stiffness.")
                .shown_in("N m", 1.0)
                .over(about(100.0, 2e-4)),
            value: |material| Some(material.bending),
            set: |material, value| material.bending = value,
        }),
        usual: Some("limit = \"50 deg\"\n"),
        schema: Schema::Keys(BENDING),
        values: |effects| Some(vec![KeyValue::Number(effects.bending?)]),
        set: |effects, values| {
            if let &[KeyValue::Number(limit)] = values {
                effects.bending = Some(limit);
            }
        },
    },
    EffectSpec {
        key: "volume",
        help: "The enclosed volume is kept.",
        keys: VOLUME,
        material: Some(MaterialSpec {
            key: KeySpec::new(
                "bulk",
                KeyKind::Quantity(Dimension::Pressure, Limit::Positive),
                "Bulk modulus; a muscle without one is incompressible.",
            )
            .labelled("bulk modulus")
            .shown_in("Pa", 1.0)
            .over(about(100.0, 1e5)),
            value: |material| material.bulk,
            set: |material, value| material.bulk = Some(value),
        }),
        usual: Some(""),
        schema: Schema::Keys(VOLUME),
        values: |effects| Some(vec![KeyValue::Number(effects.volume?.pressure)]),
        set: |effects, values| {
            if let &[KeyValue::Number(pressure)] = values {
                effects.volume = Some(Volume { pressure });
            }
        },
    },
    EffectSpec {
        key: "anisotropy",
        help: "Stretching along fibres is easier.",
        keys: ANISOTROPY,
        material: None,
        usual: Some("strength = 0.3\n"),
        schema: Schema::Keys(ANISOTROPY),
        values: |effects| {
            let Anisotropy { strength, power } = effects.anisotropy?;
            Some(vec![KeyValue::Number(strength), KeyValue::Number(power)])
        },
        set: |effects, values| {
            if let &[KeyValue::Number(strength), KeyValue::Number(power)] = values {
                effects.anisotropy = Some(Anisotropy { strength, power });
            }
        },
    },
    EffectSpec {
        key: "tone",
        help: "Fibres keep a stress while their muscle shortens.",
        keys: TONE,
        material: None,
        usual: None,
        schema: Schema::Keys(TONE),
        values: |effects| Some(vec![KeyValue::Number(effects.tone?)]),
        set: |effects, values| {
            if let &[KeyValue::Number(stress)] = values {
                effects.tone = Some(stress);
            }
        },
    },
    EffectSpec {
        key: "contact",
        help: "Muscles are kept from passing through bones, each other and themselves.",
        keys: CONTACT,
        material: None,
        usual: Some("thickness = \"0.5 mm\"\n"),
        schema: Schema::Keys(CONTACT),
        values: |effects| {
            let ContactEffect {
                thickness,
                friction,
                between,
            } = effects.contact?;
            Some(vec![
                KeyValue::Number(thickness),
                KeyValue::Number(friction),
                KeyValue::Names(ContactPartners::NAMES, between.bits()),
            ])
        },
        set: |effects, values| {
            if let &[
                KeyValue::Number(thickness),
                KeyValue::Number(friction),
                KeyValue::Names(_, between),
            ] = values
            {
                effects.contact = Some(ContactEffect {
                    thickness,
                    friction,
                    between: ContactPartners::of_bits(between),
                });
            }
        },
    },
    EffectSpec {
        key: "fascia",
        help: "Muscles slide on bones on which they lie at rest, and do not lift off from them.",
        keys: FASCIA,
        material: None,
        usual: Some(""),
        schema: Schema::Keys(FASCIA),
        values: |effects| Some(vec![KeyValue::Number(effects.fascia?)]),
        set: |effects, values| {
            if let &[KeyValue::Number(stiffness)] = values {
                effects.fascia = Some(stiffness);
            }
        },
    },
    EffectSpec {
        key: "gravity",
        help: "Every vertex that is not held is accelerated.",
        keys: GRAVITY,
        material: None,
        usual: None,
        schema: Schema::Keys(GRAVITY),
        values: |effects| Some(vec![KeyValue::Vector(effects.gravity?)]),
        set: |effects, values| {
            if let &[KeyValue::Vector(acceleration)] = values {
                effects.gravity = Some(acceleration);
            }
        },
    },
    EffectSpec {
        key: "damping",
        help: "Velocities relative to the bones decay and even out.",
        keys: DAMPING,
        material: None,
        usual: Some("rate = \"5 1/s\"\nretardation = \"10 ms\"\n"),
        schema: Schema::Keys(DAMPING),
        values: |effects| {
            let both = [effects.damping?, effects.retardation];
            Some(both.map(KeyValue::Number).to_vec())
        },
        set: |effects, values| {
            if let &[KeyValue::Number(rate), KeyValue::Number(retardation)] = values {
                (effects.damping, effects.retardation) = (Some(rate), retardation);
            }
        },
    },
];

/// Smooth tissue has no sharp folds. No hinge exceeds half a turn, so that this is none.
const BENDING: &[KeySpec] = &[KeySpec::new(
    "limit",
    KeyKind::Quantity(Dimension::Angle, Limit::Positive),
    "Angle of two triangles beyond which they resist more; none under classic PBD.",
)
.or(std::f64::consts::PI)
.shown_in("deg", 180.0 / std::f64::consts::PI)
.over(Slider::Even(0.1, std::f64::consts::PI))];

const VOLUME: &[KeySpec] = &[KeySpec::new(
    "pressure",
    KeyKind::Number(Limit::Within(0.5, 2.0)),
    "Factor on the volume at the start.",
)
.or(1.0)
.over(Slider::Factors(0.5, 2.0))];

const ANISOTROPY: &[KeySpec] = &[
    KeySpec::new(
        "strength",
        KeyKind::Number(Limit::Within(0.0, 1.0)),
        "Share of the stiffness that an edge along the fibres loses.",
    )
    .such_as("0.5"),
    KeySpec::new(
        "power",
        KeyKind::Number(Limit::Within(1.0, 1000.0)),
        "Exponent of the cosine between edge and fibres.",
    )
    .or(1.0)
    .over(Slider::Factors(1.0, 100.0)),
];

/// A relaxed muscle in its place has a small tension (Masi and Hannon 2008). 1 kPa is 0.4 % of the
/// 250 kPa that an active muscle has at most; it changes the shape at rest little.
const TONE: &[KeySpec] = &[KeySpec::new(
    "stress",
    KeyKind::Quantity(Dimension::Pressure, Limit::NotNegative),
    "Stress along the fibres.",
)
.or(1000.0)
.shown_in("kPa", 1e-3)
.over(about(10.0, 1000.0))];

const CONTACT: &[KeySpec] = &[
    KeySpec::new(
        "thickness",
        KeyKind::Quantity(Dimension::Length, Limit::NotNegative),
        "Distance kept between surfaces.",
    )
    .shown_in("mm", 1e3)
    .over(about(4.0, 1.0)),
    KeySpec::new(
        "friction",
        KeyKind::Number(Limit::NotNegative),
        "Coefficient of Coulomb friction.",
    )
    .or(0.0),
    KeySpec::new(
        "between",
        KeyKind::Names(ContactPartners::NAMES),
        "The surfaces that a muscle meets.",
    )
    .such_as("[\"muscles\", \"bones\", \"self\"]")
    .or_all(),
];

/// A muscle that lifts off by a millimetre is pulled back with 1 kPa.
const FASCIA: &[KeySpec] = &[KeySpec::new(
    "stiffness",
    KeyKind::Quantity(Dimension::BondStiffness, Limit::NotNegative),
    "Pressure that pulls a muscle back, over the height to which it lifted off.",
)
.or(1e6)
.shown_in("N/m3", 1.0)
.over(about(100.0, 1e6))];

const GRAVITY: &[KeySpec] = &[KeySpec::new(
    "acceleration",
    KeyKind::Vector(Dimension::Acceleration),
    "Acceleration of every vertex.",
)
.such_as("[\"0 m/s2\", \"-9.81 m/s2\", \"0 m/s2\"]")
.shown_in("m/s2", 1.0)
.over(Slider::Even(0.0, 20.0))];

const DAMPING: &[KeySpec] = &[
    KeySpec::new(
        "rate",
        KeyKind::Quantity(Dimension::Rate, Limit::NotNegative),
        "Rate at which velocities relative to the bones decay.",
    )
    .shown_in("1/s", 1.0)
    .over(Slider::UpTo {
        span: 4.0,
        least: 20.0,
    }),
    KeySpec::new(
        "retardation",
        KeyKind::Quantity(Dimension::Time, Limit::NotNegative),
        "Retardation time of dampers beside the springs of edges; none under classic PBD.",
    )
    .or(0.0)
    .shown_in("ms", 1e3)
    .over(Slider::UpTo {
        span: 4.0,
        least: 0.02,
    }),
];

const fn stiffness(key: &'static str, dimension: Dimension, help: &'static str) -> KeySpec {
    KeySpec::new(key, KeyKind::Quantity(dimension, Limit::NotNegative), help)
}

const fn about(span: f64, otherwise: f64) -> Slider {
    Slider::About { span, otherwise }
}

impl EffectSpec {
    /// The values of [`EffectSpec::keys`]; `None` if the effect is absent.
    #[must_use]
    pub fn values(&self, effects: &Effects) -> Option<Vec<KeyValue>> {
        (self.values)(effects)
    }

    /// Whether a scene has the effect.
    #[must_use]
    pub fn is_on(&self, effects: &Effects) -> bool {
        self.values(effects).is_some()
    }

    /// Switches the effect on with the values of [`EffectSpec::keys`].
    pub(super) fn set(&self, effects: &mut Effects, values: &[KeyValue]) {
        (self.set)(effects, values);
    }

    /// The declaration of the effect with a key.
    #[must_use]
    pub fn named(key: &str) -> Option<&'static Self> {
        EFFECTS.iter().find(|spec| spec.key == key)
    }
}

impl MaterialSpec {
    /// The value in SI units; `None` if the material has none.
    #[must_use]
    pub fn value(&self, material: &Material) -> Option<f64> {
        (self.value)(material)
    }

    pub(super) fn set(&self, material: &mut Material, value: f64) {
        (self.set)(material, value);
    }
}

/// The material constants of all effects.
pub fn material_constants() -> impl Iterator<Item = &'static MaterialSpec> {
    EFFECTS.iter().filter_map(|spec| spec.material.as_ref())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_effect_gives_back_the_values_it_takes_and_touches_no_other() {
        for spec in &EFFECTS {
            let mut values: Vec<KeyValue> = Vec::new();
            for (k, key) in spec.keys.iter().enumerate() {
                let number = 0.5 + k as f64;
                values.push(match key.kind {
                    KeyKind::Vector(_) => KeyValue::Vector(Vector3::new(number, 0.0, 1.0)),
                    KeyKind::Names(names) => KeyValue::Names(names, 1),
                    _ => KeyValue::Number(number),
                });
            }
            let mut effects = Effects::default();
            spec.set(&mut effects, &values);
            let on: Vec<&str> = EFFECTS
                .iter()
                .filter(|other| other.is_on(&effects))
                .map(|other| other.key)
                .collect();
            assert_eq!(on, [spec.key]);
            assert_eq!(spec.values(&effects), Some(values));
            // Control: one value too many is ignored.
            if !spec.keys.is_empty() {
                let mut none = Effects::default();
                spec.set(&mut none, &[KeyValue::Whole(1)]);
                assert!(!spec.is_on(&none), "{}", spec.key);
            }
        }
    }

    #[test]
    fn every_material_constant_gives_back_the_value_it_takes() {
        let mut material = Material::default();
        for (k, constant) in material_constants().enumerate() {
            let value = 7.0 + k as f64;
            assert_ne!(constant.value(&material), Some(value));
            constant.set(&mut material, value);
            assert_eq!(constant.value(&material), Some(value));
        }
    }
}
