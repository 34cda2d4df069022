//! The changeable values of a running scene as a list of controls; a window draws them.

use nalgebra::{Unit, Vector3};

use super::session::Command;
use super::snapshot::{Shot, Steering};
use pliant::constraints::SweepOrder;
use pliant::scene::{
    Accuracy, BoneSpec, EFFECTS, EffectSpec, KeySpec, KeyValue, Mass, Material, SOLVERS, Scene,
    Slider,
};

/// Division of a control's range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Linear.
    Linear,
    /// Logarithmic; both ends are positive.
    Logarithmic,
}

/// Kind of a control.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// A number in a range.
    Slider {
        /// Ends of the range, in the control's unit.
        range: (f64, f64),
        /// Division of the range.
        scale: Scale,
    },
    /// An integer in a range.
    Whole {
        /// Ends of the range.
        range: (u32, u32),
        /// Division of the range.
        scale: Scale,
    },
    /// A choice from names.
    Choice(Vec<&'static str>),
    /// On or off.
    Switch,
}

/// Value of a control.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    /// Value of a slider, in the control's unit.
    Number(f64),
    /// Value of an integer.
    Whole(u32),
    /// Index of the chosen name.
    Choice(usize),
    /// State of a switch.
    On(bool),
}

/// Target of a control.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Target {
    /// The value at a path of the scene.
    Path(String),
    /// The length of a vector at a path, in a given direction.
    Vector(String, Unit<Vector3<f64>>),
    /// A section at a path, present or absent.
    Section(String),
    /// The angle of a bone, set by hand.
    Angle(usize),
    /// Whether a bone follows its motion.
    Motion(usize),
}

/// A control.
#[derive(Clone, Debug, PartialEq)]
pub struct Control {
    /// Group of the control: an effect, the solver, a muscle, a bone.
    pub group: String,
    /// Label.
    pub label: String,
    /// Unit of the value; empty for none.
    pub unit: &'static str,
    /// Kind.
    pub kind: Kind,
    /// Present value.
    pub value: Value,
    target: Target,
}

/// Error of a value for a control.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoValue {
    /// The value is out of range.
    #[error("{label}: {value} is outside of {low} to {high} {unit}")]
    Outside {
        /// Label of the control.
        label: String,
        /// The value.
        value: f64,
        /// Lower end.
        low: f64,
        /// Upper end.
        high: f64,
        /// Unit of the control.
        unit: &'static str,
    },
    /// The value has another kind.
    #[error("{label} takes no such value as {value:?}")]
    Kind {
        /// Label of the control.
        label: String,
        /// The value.
        value: Value,
    },
}

impl Control {
    /// The path of the scene; `None` for a bone, which has no path.
    pub fn path(&self) -> Option<&str> {
        match &self.target {
            Target::Path(path) | Target::Vector(path, _) | Target::Section(path) => Some(path),
            Target::Angle(_) | Target::Motion(_) => None,
        }
    }

    /// The value at a moment: the angle of a bone changes without a command.
    pub fn now(&self, shot: &Shot) -> Value {
        match (&self.target, self.value) {
            (Target::Angle(bone), Value::Number(_)) => {
                let angle = shot
                    .bones
                    .get(*bone)
                    .and_then(|bone| bone.angle)
                    .unwrap_or(0.0)
                    .to_degrees();
                let Kind::Slider {
                    range: (low, high), ..
                } = self.kind
                else {
                    return self.value;
                };
                Value::Number(angle.clamp(low, high))
            }
            (Target::Motion(bone), _) => Value::On(
                shot.bones
                    .get(*bone)
                    .is_none_or(|bone| bone.steering != Steering::Hand),
            ),
            (_, value) => value,
        }
    }

    /// The command that sets a value.
    ///
    /// # Errors
    /// A value of another kind or out of range.
    pub fn command(&self, value: Value) -> Result<Command, NoValue> {
        let text = self.checked(value)?;
        Ok(match (&self.target, value) {
            (Target::Path(path), _) => Command::Set {
                path: path.clone(),
                value: text,
            },
            (Target::Vector(path, along), Value::Number(length)) => {
                let parts = (along.as_ref() * length).map(|c| format!("\"{c} {}\"", self.unit));
                Command::Set {
                    path: path.clone(),
                    value: format!("[{}]", parts.as_slice().join(", ")),
                }
            }
            (Target::Section(path), Value::On(true)) => Command::Restore { path: path.clone() },
            (Target::Section(path), _) => Command::Set {
                path: path.clone(),
                value: "off".to_owned(),
            },
            (Target::Angle(bone), Value::Number(angle)) => Command::Turn {
                bone: *bone,
                angle: angle.to_radians(),
            },
            (Target::Motion(bone), Value::On(true)) => Command::ByMotion { bone: *bone },
            // Holds the bone: the present angle becomes the target.
            (Target::Motion(bone), _) => Command::Hold { bone: *bone },
            (Target::Vector(..) | Target::Angle(_), _) => return Err(self.no_such(value)),
        })
    }

    /// The text of a valid value.
    fn checked(&self, value: Value) -> Result<String, NoValue> {
        let outside = |value: f64, low: f64, high: f64| NoValue::Outside {
            label: self.label.clone(),
            value,
            low,
            high,
            unit: self.unit,
        };
        match (&self.kind, value) {
            (
                Kind::Slider {
                    range: (low, high), ..
                },
                Value::Number(number),
            ) => {
                // Not `<`, which is false for NaN.
                if !(*low <= number && number <= *high) {
                    return Err(outside(number, *low, *high));
                }
                Ok(if self.unit.is_empty() {
                    number.to_string()
                } else {
                    format!("{number} {}", self.unit)
                })
            }
            (
                Kind::Whole {
                    range: (low, high), ..
                },
                Value::Whole(number),
            ) => {
                if !(low..=high).contains(&&number) {
                    return Err(outside(number.into(), (*low).into(), (*high).into()));
                }
                Ok(number.to_string())
            }
            (Kind::Choice(names), Value::Choice(chosen)) => names
                .get(chosen)
                .map(|name| (*name).to_owned())
                .ok_or_else(|| self.no_such(value)),
            (Kind::Switch, Value::On(on)) => Ok(if on { "on" } else { "off" }.to_owned()),
            _ => Err(self.no_such(value)),
        }
    }

    fn no_such(&self, value: Value) -> NoValue {
        NoValue::Kind {
            label: self.label.clone(),
            value,
        }
    }

    /// The value at the position `share` (0..1) of the range.
    pub fn at(&self, share: f64) -> Value {
        let share = share.clamp(0.0, 1.0);
        match &self.kind {
            Kind::Slider { range, scale } => Value::Number(between(*range, *scale, share)),
            Kind::Whole {
                range: (low, high),
                scale,
            } => {
                let value = between((f64::from(*low), f64::from(*high)), *scale, share);
                Value::Whole((value.round() as u32).clamp(*low, *high))
            }
            Kind::Choice(names) => {
                Value::Choice((share * names.len().saturating_sub(1) as f64).round() as usize)
            }
            Kind::Switch => Value::On(share >= 0.5),
        }
    }

    /// Position of the value in the range, 0 to 1: the inverse of [`Self::at`].
    pub fn share(&self) -> f64 {
        let of = |value: f64, (low, high): (f64, f64), scale: Scale| match scale {
            Scale::Linear => (value - low) / (high - low),
            Scale::Logarithmic => libm::log(value / low) / libm::log(high / low),
        };
        let share = match (&self.kind, self.value) {
            (Kind::Slider { range, scale }, Value::Number(value)) => of(value, *range, *scale),
            (
                Kind::Whole {
                    range: (low, high),
                    scale,
                },
                Value::Whole(value),
            ) => of(value.into(), ((*low).into(), (*high).into()), *scale),
            (Kind::Choice(names), Value::Choice(chosen)) => {
                chosen as f64 / names.len().saturating_sub(1).max(1) as f64
            }
            (_, Value::On(true)) => 1.0,
            _ => 0.0,
        };
        if share.is_finite() {
            share.clamp(0.0, 1.0)
        } else {
            0.0
        }
    }
}

/// Exact at both ends.
fn between((low, high): (f64, f64), scale: Scale, share: f64) -> f64 {
    match (share, scale) {
        (0.0, _) => low,
        (1.0, _) => high,
        (_, Scale::Linear) => low + (high - low) * share,
        (_, Scale::Logarithmic) => (low * libm::pow(high / low, share)).clamp(low, high),
    }
}

/// The controls of a scene with the ranges of `start` and the values of `now`, the same scene with
/// changes. Only existing effects, the solver in use, and bones with a joint have controls.
pub fn controls(start: &Scene, now: &Scene) -> Vec<Control> {
    let mut list = List::default();
    list.effects(start, now);
    for (m, muscle) in now.muscles.iter().enumerate() {
        list.muscle(
            m,
            &muscle.name,
            &muscle.material,
            &start.muscles[m].material,
            now,
        );
    }
    list.solver(now);
    now.bones
        .iter()
        .enumerate()
        .for_each(|(b, bone)| list.bone(b, bone));
    list.0
}

/// A list of controls under construction.
#[derive(Default)]
pub(super) struct List(pub(super) Vec<Control>);

/// Unit and range of a displayed number.
pub(super) struct Shown {
    pub(super) unit: &'static str,
    pub(super) range: (f64, f64),
    pub(super) scale: Scale,
}

impl Shown {
    pub(super) fn even(unit: &'static str, low: f64, high: f64) -> Self {
        Self {
            unit,
            range: (low, high),
            scale: Scale::Linear,
        }
    }

    /// From the start value divided by `span` to the start value times `span`; from 0 if it is not
    /// positive.
    pub(super) fn about(unit: &'static str, start: f64, span: f64, otherwise: f64) -> Self {
        match start > 0.0 {
            true => Self {
                unit,
                range: (start / span, start * span),
                scale: Scale::Logarithmic,
            },
            false => Self::even(unit, 0.0, otherwise),
        }
    }

    /// As a key is declared; `start` is its value at the start in the unit of the panel.
    fn declared(key: &KeySpec, start: f64) -> Self {
        let unit = key.unit.0;
        match key.slider {
            Slider::Even(low, high) => Self::even(unit, low, high),
            Slider::Factors(low, high) => Self {
                unit,
                range: (low, high),
                scale: Scale::Logarithmic,
            },
            Slider::About { span, otherwise } => Self::about(unit, start, span, otherwise),
            Slider::UpTo { span, least } => Self::even(unit, 0.0, (span * start).max(least)),
        }
    }

    /// Widens the range to contain a value that was set by other means.
    fn holding(mut self, value: f64) -> Self {
        self.range = (self.range.0.min(value), self.range.1.max(value));
        if self.range.0 <= 0.0 {
            self.scale = Scale::Linear;
        }
        self
    }
}

impl List {
    pub(super) fn slider(
        &mut self,
        group: &str,
        label: &str,
        target: Target,
        value: f64,
        shown: Shown,
    ) {
        let Shown { unit, range, scale } = shown.holding(value);
        let (group, label) = (group.to_owned(), label.to_owned());
        let kind = Kind::Slider { range, scale };
        self.0.push(Control {
            group,
            label,
            unit,
            kind,
            value: Value::Number(value),
            target,
        });
    }

    pub(super) fn other(
        &mut self,
        group: &str,
        label: &str,
        target: Target,
        kind: Kind,
        value: Value,
    ) {
        let (group, label) = (group.to_owned(), label.to_owned());
        self.0.push(Control {
            group,
            label,
            unit: "",
            kind,
            value,
            target,
        });
    }

    fn switch(&mut self, effect: &str, on: bool) {
        let target = Target::Section(format!("effects.{effect}"));
        self.other(effect, effect, target, Kind::Switch, Value::On(on));
    }

    fn effects(&mut self, start: &Scene, now: &Scene) {
        for spec in &EFFECTS {
            let (began, now) = (spec.values(&start.effects), spec.values(&now.effects));
            if began.is_some() {
                self.switch(spec.key, now.is_some());
            }
            let began = began.unwrap_or_default();
            for (k, (key, value)) in spec.keys.iter().zip(now.unwrap_or_default()).enumerate() {
                let path = format!("effects.{}.{}", spec.key, key.key);
                self.key(spec.key, key, path, value, began.get(k).copied());
            }
        }
    }

    /// The control of a declared key; `start` is its value at the start.
    fn key(
        &mut self,
        group: &str,
        key: &KeySpec,
        path: String,
        value: KeyValue,
        start: Option<KeyValue>,
    ) {
        match value {
            KeyValue::Number(value) => {
                let start = match start {
                    Some(KeyValue::Number(start)) => start,
                    _ => 0.0,
                };
                let per_si = key.unit.1;
                let shown = Shown::declared(key, per_si * start);
                self.slider(group, key.label, Target::Path(path), per_si * value, shown);
            }
            KeyValue::Vector(value) => {
                // Without a vector at the start there is no direction to move along.
                if let Some(KeyValue::Vector(start)) = start {
                    let along = Unit::try_new(start, 0.0).unwrap_or(-Vector3::y_axis());
                    let shown = Shown::declared(key, start.norm());
                    let target = Target::Vector(path, along);
                    self.slider(group, key.label, target, value.norm(), shown);
                }
            }
            KeyValue::Whole(value) => {
                let Shown { range, scale, .. } = Shown::declared(key, 0.0);
                let range = (range.0 as u32, (range.1 as u32).max(value));
                let kind = Kind::Whole { range, scale };
                let target = Target::Path(path);
                self.other(group, key.label, target, kind, Value::Whole(value));
            }
            // What meets is decided by the scene.
            KeyValue::Names(..) => {}
            KeyValue::Order(value) => {
                let names = SweepOrder::NAMES.map(|(name, _)| name).to_vec();
                let chosen = SweepOrder::NAMES
                    .iter()
                    .position(|(_, order)| *order == value)
                    .unwrap_or(0);
                let (target, kind) = (Target::Path(path), Kind::Choice(names));
                self.other(group, key.label, target, kind, Value::Choice(chosen));
            }
        }
    }

    fn muscle(&mut self, m: usize, name: &str, now: &Material, start: &Material, scene: &Scene) {
        let group = format!("muscle {name}");
        let path = |key: &str| format!("muscle.{m}.material.{key}");
        for effect in &EFFECTS {
            // A solver may have a stiffness of its own.
            let is_used = effect.is_on(&scene.effects) && scene.solver.share(effect.key).is_none();
            let Some(constant) = effect.material.as_ref().filter(|_| is_used) else {
                continue;
            };
            if let Some(value) = constant.value(now) {
                let began = constant.value(start).unwrap_or(value);
                let path = path(constant.key.key);
                let (value, began) = (KeyValue::Number(value), KeyValue::Number(began));
                self.key(&group, &constant.key, path, value, Some(began));
            }
        }
        match (now.mass, start.mass) {
            // In an equilibrium, mass matters only with weight.
            _ if !scene.solver.has_inertia() && scene.effects.gravity.is_none() => {}
            (Mass::Density(density), Mass::Density(began)) => {
                self.slider(
                    &group,
                    "density",
                    Target::Path(path("density")),
                    density,
                    Shown::about("kg/m3", began, 10.0, 1e4),
                );
            }
            (Mass::PerVertex(mass), Mass::PerVertex(began)) => {
                self.slider(
                    &group,
                    "mass of a vertex",
                    Target::Path(path("vertex_mass")),
                    mass,
                    Shown::about("kg", began, 10.0, 1.0),
                );
            }
            _ => {}
        }
    }

    fn solver(&mut self, scene: &Scene) {
        let spec = scene.solver.spec();
        // A solver without an energy has nothing that an error could be measured against.
        if spec.question.is_some() {
            let target = match scene.accuracy {
                Some(Accuracy::Share(share)) => 100.0 * share,
                // One per cent by default, or one in millimetres.
                _ => 1.0,
            };
            let shown = Shown {
                unit: "%",
                range: (0.01, 10.0),
                scale: Scale::Logarithmic,
            };
            self.slider(
                "solver",
                "target accuracy",
                Target::Path("accuracy".to_owned()),
                target,
                shown,
            );
        }
        let names: Vec<&str> = SOLVERS.iter().map(|solver| solver.key).collect();
        let chosen = names.iter().position(|name| *name == spec.key).unwrap_or(0);
        self.other(
            "solver",
            "solver",
            Target::Path("solver".to_owned()),
            Kind::Choice(names),
            Value::Choice(chosen),
        );
        for (key, value) in scene.solver.settings() {
            // The stiffness of an effect that is off changes nothing.
            if EffectSpec::named(key.key).is_none_or(|effect| effect.is_on(&scene.effects)) {
                let path = format!("solver.{}.{}", spec.key, key.key);
                self.key("solver", key, path, value, Some(value));
            }
        }
    }

    /// A bone that can be rotated; a window displays the angle of the last snapshot.
    fn bone(&mut self, b: usize, bone: &BoneSpec) {
        let Some(joint) = &bone.motion.joint else {
            return;
        };
        let [least, most] = joint
            .path_range()
            .map_or([-120.0, 120.0], |range| range.map(f64::to_degrees));
        let group = format!("bone {}", bone.name);
        self.other(
            &group,
            "by its motion",
            Target::Motion(b),
            Kind::Switch,
            Value::On(true),
        );
        self.slider(
            &group,
            "angle",
            Target::Angle(b),
            0.0,
            Shown::even("deg", least, most),
        );
    }
}
