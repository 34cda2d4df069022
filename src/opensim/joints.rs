//! Transforms of joints.

use nalgebra::{Isometry3, Translation3, Unit, UnitQuaternion, Vector3};

use super::document::{Element, MALFORMED, ModelError, UNKNOWN_KIND};
use super::functions::Function;
use crate::rigid::turn;

/// A rotation or a translation of a custom joint.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Axis {
    axis: Vector3<f64>,
    function: Function,
    /// Indices of the arguments among the coordinates of the model.
    arguments: Vec<usize>,
}

/// Kind of a joint.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum JointKind {
    /// Three rotations about axes of the parent's frame, one after the other, and three
    /// translations.
    Custom(Box<[Axis; 6]>),
    Pin,
    Slider,
    Universal,
    Weld,
    /// Three rotations about body-fixed x, y and z: ball and gimbal.
    Ball,
    /// Those of a ball, then translations along the axes of the parent's frame.
    Free,
    /// A rotation about z, and translations along x and y.
    Planar,
}

impl JointKind {
    /// Number of coordinates; `None` for a custom joint.
    pub(super) fn coordinates(&self) -> Option<usize> {
        match self {
            Self::Custom(_) => None,
            Self::Weld => Some(0),
            Self::Pin | Self::Slider => Some(1),
            Self::Universal => Some(2),
            Self::Ball | Self::Planar => Some(3),
            Self::Free => Some(6),
        }
    }

    /// Whether a coordinate is an angle, and whether tables in degrees have it in degrees. OpenSim
    /// converts those that turn by themselves: with a slope of 1 or -1.
    pub(super) fn turns(&self, coordinate: usize, index: usize) -> [bool; 2] {
        let alone = |axis: &Axis| {
            let one = matches!(&axis.function, Function::Linear(all) if all.len() == 2 && all[0].abs() == 1.0);
            one && axis.arguments == [index]
        };
        match self {
            Self::Slider => [false; 2],
            Self::Free => [coordinate < 3; 2],
            Self::Planar => [coordinate == 0; 2],
            Self::Custom(axes) => {
                let converts = axes[..3].iter().any(alone);
                let slides = axes[3..].iter().any(alone);
                let turns = axes[..3].iter().any(|a| a.arguments.contains(&index));
                [converts || turns && !slides, converts]
            }
            _ => [true; 2],
        }
    }

    /// The kind of an element, given the indices of its coordinates in the model by name.
    pub(super) fn read(
        element: Element<'_>,
        index: &dyn Fn(&str) -> Option<usize>,
    ) -> Result<Option<Self>, ModelError> {
        Ok(Some(match element.tag() {
            "CustomJoint" => Self::Custom(Box::new(axes(element, index)?)),
            "PinJoint" => Self::Pin,
            "SliderJoint" => Self::Slider,
            "UniversalJoint" => Self::Universal,
            "WeldJoint" => Self::Weld,
            "BallJoint" | "GimbalJoint" => Self::Ball,
            "FreeJoint" => Self::Free,
            "PlanarJoint" => Self::Planar,
            tag if tag.ends_with("Joint") => {
                let message = format!("the joint <{tag}>{} is not read", element.named());
                return Err(element.error(UNKNOWN_KIND, message));
            }
            _ => return Ok(None),
        }))
    }

    /// The transform from the child's frame of the joint to the parent's; `own` are the values of
    /// the joint's coordinates and `all` those of the model.
    pub(super) fn transform(&self, own: &[f64], all: &[f64]) -> Isometry3<f64> {
        let value = |k: usize| own.get(k).copied().unwrap_or(0.0);
        let rotation = match self {
            Self::Custom(axes) => return custom(axes, all),
            Self::Weld => UnitQuaternion::identity(),
            Self::Pin => turn(&Vector3::z_axis(), value(0)),
            Self::Slider => {
                return Isometry3::translation(value(0), 0.0, 0.0);
            }
            Self::Universal => {
                turn(&Vector3::x_axis(), value(0)) * turn(&Vector3::y_axis(), value(1))
            }
            Self::Ball | Self::Free => turned_xyz([value(0), value(1), value(2)]),
            Self::Planar => turn(&Vector3::z_axis(), value(0)),
        };
        let translation = match self {
            Self::Free => Vector3::new(value(3), value(4), value(5)),
            Self::Planar => Vector3::new(value(1), value(2), 0.0),
            _ => Vector3::zeros(),
        };
        Isometry3::from_parts(Translation3::from(translation), rotation)
    }
}

/// Rotation by three angles \[rad\] about body-fixed x, y and z.
pub(super) fn turned_xyz([x, y, z]: [f64; 3]) -> UnitQuaternion<f64> {
    turn(&Vector3::x_axis(), x) * turn(&Vector3::y_axis(), y) * turn(&Vector3::z_axis(), z)
}

fn custom(axes: &[Axis; 6], all: &[f64]) -> Isometry3<f64> {
    let value = |axis: &Axis| {
        let arguments: Vec<f64> = axis.arguments.iter().map(|&k| all[k]).collect();
        axis.function.at(&arguments)
    };
    let rotation = axes[..3]
        .iter()
        .fold(UnitQuaternion::identity(), |r, axis| {
            r * turn(&Unit::new_unchecked(axis.axis), value(axis))
        });
    let translation: Vector3<f64> = axes[3..].iter().map(|axis| axis.axis * value(axis)).sum();
    Isometry3::from_parts(Translation3::from(translation), rotation)
}

/// The six axes of a custom joint; an axis that is absent does nothing.
fn axes(
    element: Element<'_>,
    index: &dyn Fn(&str) -> Option<usize>,
) -> Result<[Axis; 6], ModelError> {
    let transform = element.need("SpatialTransform")?;
    let directions = [Vector3::x(), Vector3::y(), Vector3::z()];
    let mut axes: [Axis; 6] = std::array::from_fn(|k| Axis {
        axis: directions[k % 3],
        function: Function::Constant(0.0),
        arguments: Vec::new(),
    });
    for given in transform.children().filter(|e| e.tag() == "TransformAxis") {
        let slots = [
            "rotation1",
            "rotation2",
            "rotation3",
            "translation1",
            "translation2",
            "translation3",
        ];
        let Some(slot) = slots.iter().position(|slot| *slot == given.name()) else {
            let message = format!(
                "an axis named{}; the names are {}",
                given.named(),
                slots.join(", ")
            );
            return Err(given.error(MALFORMED, message));
        };
        let axis = Vector3::from(given.need("axis")?.exactly()?);
        let length = axis.norm();
        if !(length > 1e-6) || !length.is_finite() {
            return Err(given.error(MALFORMED, "an axis of length 0"));
        }
        let names = given.text_of("coordinates").split_ascii_whitespace();
        let arguments = names.map(|name| {
            index(name).ok_or_else(|| {
                let message = format!("no coordinate {name} of {}", element.name());
                given.error(super::document::UNKNOWN_NAME, message)
            })
        });
        let arguments = arguments.collect::<Result<Vec<usize>, _>>()?;
        let function = given
            .children()
            .find(|e| !matches!(e.tag(), "coordinates" | "axis"))
            .map_or(Ok(Function::Constant(0.0)), Function::read)?;
        if function.arguments().is_some_and(|n| n != arguments.len()) {
            let message = format!(
                "the function of {} needs {} coordinates, and {} are named",
                given.name(),
                function.arguments().unwrap_or(0),
                arguments.len()
            );
            return Err(given.error(MALFORMED, message));
        }
        axes[slot] = Axis {
            // Simbody's axes of rotation and translation have length 1.
            axis: axis / length,
            function,
            arguments,
        };
    }
    Ok(axes)
}
