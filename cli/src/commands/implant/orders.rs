//! The user's orders of implants, parsed from the command line.

use nalgebra::{Point3, Vector3};

use super::super::failure::Failure;
use super::Arguments;
use pliant::scene::units::{Dimension, parse};
use pliant::skin::{
    BaseShape, Filling, Implant, ImplantPlace, ImplantSpec, SILICONE, Schedule, SkinError, Tissue,
};

/// Units of areas and volumes [m^2, m^3].
const AREAS: &[(&str, f64)] = &[("cm2", 1e-4), ("mm2", 1e-6), ("dm2", 1e-2), ("m2", 1.0)];
const VOLUMES: &[(&str, f64)] = &[
    ("cc", 1e-6),
    ("cm3", 1e-6),
    ("ml", 1e-6),
    ("mm3", 1e-9),
    ("dm3", 1e-3),
    ("l", 1e-3),
    ("m3", 1.0),
];

pub(super) fn refused(error: &SkinError) -> Failure {
    Failure::usage(error.to_string(), hint(error))
}

/// What to change, in words of the command line.
pub(super) fn hint(error: &SkinError) -> &'static str {
    match error {
        SkinError::Mesh(_) | SkinError::NotManifold { .. } | SkinError::OneSided => {
            "see `pliant check`, and repair the mesh with --repair"
        }
        SkinError::NoVertex { .. } => "count vertices from 0, or give a place with --at",
        SkinError::FarAway { .. } => "check --at and --unit: both are in the unit of the file",
        SkinError::TooLargePatch { .. } => {
            "make --edge larger or the base larger, or refine the mesh near the implant"
        }
        SkinError::TooCoarse { .. } => "make --edge smaller or the base larger",
        SkinError::TooCurved { .. } => {
            "make the base smaller, or choose a flatter place or another direction with --long"
        }
        SkinError::TooFine { .. } => "make --edge larger or the base smaller",
        SkinError::Refine(_) => "see `pliant check`, or give another --edge",
        SkinError::Solver(_) => "make the volume smaller, or --edge larger",
        other => other.help(),
    }
}

/// Parses a number with one of several units; `bare` is the unit of a number without one.
fn quantity(
    what: &str,
    text: &str,
    units: &[(&str, f64)],
    bare: Option<f64>,
) -> Result<f64, Failure> {
    let text = text.trim();
    let known: Vec<&str> = units.iter().map(|(name, _)| *name).collect();
    let hint = format!("write a number and a unit of {}", known.join(", "));
    // The unit is removed first: the rest can be `nan`, a number that later checks reject.
    let of = |(name, unit): (&str, f64)| {
        Some(text.strip_suffix(name)?.trim_end().parse::<f64>().ok()? * unit)
    };
    let with_unit = units.iter().copied().find_map(of);
    let found = with_unit.or_else(|| bare.and_then(|unit| of(("", unit))));
    found.ok_or_else(|| Failure::usage(format!("{what}: cannot read `{text}`"), hint))
}

/// Rejects a number that is not positive, with its text.
fn positive(flag: &str, what: &str, text: &str, value: f64) -> Result<f64, Failure> {
    if value > 0.0 && value.is_finite() {
        return Ok(value);
    }
    let message = format!(
        "{flag}: {what} must be more than 0 and finite, not `{}`",
        text.trim()
    );
    Err(Failure::usage(
        message,
        "give a positive number with its unit",
    ))
}

fn length(flag: &str, what: &str, text: &str) -> Result<f64, Failure> {
    let value = parse(text, Dimension::Length)
        .map_err(|e| Failure::usage(format!("{flag}: {e}"), e.help()))?;
    positive(flag, what, text, value)
}

fn volume(flag: &str, text: &str, bare: Option<f64>) -> Result<f64, Failure> {
    positive(
        flag,
        "the volume",
        text,
        quantity(flag, text, VOLUMES, bare)?,
    )
}

fn triple(what: &str, text: &str) -> Result<[f64; 3], Failure> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|n| n.trim().parse::<f64>()).collect();
    let numbers = numbers
        .ok()
        .and_then(|n| <[f64; 3]>::try_from(n).ok())
        .filter(|n| n.iter().all(|c| c.is_finite()));
    numbers.ok_or_else(|| {
        Failure::usage(
            format!("{what}: cannot read `{text}`"),
            "write three numbers, as in 0.1,0.2,0.3",
        )
    })
}

/// The user's text for one implant; missing parts come from the other options.
#[derive(Clone, Default)]
pub(super) struct Said {
    near_vertex: Option<usize>,
    at: Option<String>,
    shape: Option<String>,
    base: Option<String>,
    volume: Option<String>,
    fill: Option<String>,
    long: Option<String>,
}

impl Said {
    pub(super) fn of(text: &str) -> Result<Self, Failure> {
        let mut said = Self::default();
        for word in text.split_whitespace() {
            let (key, value) = word.split_once('=').unwrap_or((word, ""));
            let value = value.to_owned();
            match key {
                "near-vertex" => {
                    let number = value.parse().map_err(|_| {
                        Failure::usage(
                            format!("--implant: `{value}` is no vertex"),
                            "count vertices from 0",
                        )
                    })?;
                    said.near_vertex = Some(number);
                }
                "at" => said.at = Some(value),
                "shape" => said.shape = Some(value),
                "base" => said.base = Some(value),
                "volume" => said.volume = Some(value),
                "fill" => said.fill = Some(value),
                "long" => said.long = Some(value),
                _ => {
                    let hint = "known keys: near-vertex, at, shape, base, volume, fill, long";
                    return Err(Failure::usage(
                        format!("--implant: unknown key `{key}`"),
                        hint,
                    ));
                }
            }
        }
        let twice = [
            (
                said.near_vertex.is_some() && said.at.is_some(),
                "near-vertex and at",
            ),
            (
                said.volume.is_some() && said.fill.is_some(),
                "volume and fill",
            ),
        ];
        if let Some((_, both)) = twice.iter().find(|(both, _)| *both) {
            return Err(Failure::usage(
                format!("--implant: {both} exclude each other"),
                "give one of the two",
            ));
        }
        Ok(said)
    }
}

/// Parses days and volumes.
fn schedule(text: &str) -> Result<Schedule, Failure> {
    let filling = |pair: &str| {
        let hint = "write a day and a volume each, as in 0:30cc,7:60cc";
        let wrong = || Failure::usage(format!("--fill: cannot read `{pair}`"), hint);
        let (day, volume) = pair.split_once(':').ok_or_else(wrong)?;
        let day = day.trim().parse().map_err(|_| wrong())?;
        Ok(Filling {
            day,
            volume: self::volume("--fill", volume, None)?,
        })
    };
    let fillings: Result<Vec<Filling>, Failure> = text.split(',').map(filling).collect();
    Schedule::new(fillings?).map_err(|e| refused(&e))
}

/// The order of one implant.
pub(super) fn order(arguments: &Arguments, said: &Said, unit: f64) -> Result<ImplantSpec, Failure> {
    let (at, vertex) = match (said.near_vertex, &said.at) {
        (None, None) => (arguments.at.as_ref(), arguments.near_vertex),
        (vertex, at) => (at.as_ref(), vertex),
    };
    let place = match (vertex, at) {
        (Some(vertex), _) => ImplantPlace::Vertex(vertex),
        (None, Some(at)) => ImplantPlace::Point(Point3::from(triple("--at", at)?) * unit),
        (None, None) => {
            return Err(Failure::usage(
                "no place for the implant",
                "name a vertex with --near-vertex or a point with --at",
            ));
        }
    };
    let name = said.shape.as_ref().unwrap_or(&arguments.shape);
    let shape = BaseShape::ALL
        .iter()
        .find(|(known, _)| known == name)
        .map(|(_, shape)| *shape)
        .ok_or_else(|| {
            Failure::usage(
                format!("no shape `{name}`"),
                "known: round, oval, crescent, rectangular",
            )
        })?;
    let long = said.long.as_ref().or(arguments.long.as_ref());
    let long = long
        .map(|text| triple("--long", text))
        .transpose()?
        .map(Vector3::from);
    if long.is_some_and(|v| !(v.norm() > 0.0)) {
        return Err(Failure::usage(
            format!("--long: {}", SkinError::NoDirection),
            hint(&SkinError::NoDirection),
        ));
    }
    let modulus = parse(&arguments.modulus, Dimension::Pressure)
        .map_err(|e| Failure::usage(format!("--modulus: {e}"), e.help()))?;
    let [base, filled] =
        [("base", &said.base), ("volume", &said.volume)].map(|(key, own)| match own {
            Some(_) => format!("--implant: {key}"),
            None => format!("--{key}"),
        });
    let order = ImplantSpec {
        place,
        implant: Implant {
            shape,
            base: length(
                &base,
                "the base",
                said.base.as_ref().unwrap_or(&arguments.base),
            )?,
            volume: volume(
                &filled,
                said.volume.as_ref().unwrap_or(&arguments.volume),
                None,
            )?,
            membrane: SILICONE,
        },
        long,
        tissue: Tissue {
            modulus: positive(
                "--modulus",
                "the stiffness of the skin",
                &arguments.modulus,
                modulus,
            )?,
            thickness: length(
                "--thickness",
                "the thickness of the skin",
                &arguments.thickness,
            )?,
            depth: length("--depth", "the depth", &arguments.depth)?,
        },
        edge: arguments
            .edge
            .as_ref()
            .map(|text| length("--edge", "the edge length", text))
            .transpose()?,
    };
    order.check_edge().map_err(|error| match &error {
        SkinError::TooThick { what: "depth", .. } => {
            flagged("--depth", &arguments.depth, " (5mm unless given)", &error)
        }
        SkinError::TooThick { .. } => flagged(
            "--thickness",
            &arguments.thickness,
            " (2mm unless given)",
            &error,
        ),
        SkinError::TooLong { .. } => flagged(
            "--edge",
            arguments.edge.as_deref().unwrap_or_default(),
            "",
            &error,
        ),
        _ => refused(&error),
    })?;
    Ok(order)
}

/// The rejection of a value, given or default.
fn flagged(flag: &str, text: &str, more: &str, error: &SkinError) -> Failure {
    Failure::usage(format!("{flag} {text}{more}: {error}"), hint(error))
}

/// The question about an implant.
pub(super) enum Question {
    /// The result for its volume.
    Volume,
    /// The volume with this gain [m^2].
    Area(f64),
    /// The results for each of these volumes [m^3].
    Volumes(Vec<f64>),
    /// The results during its filling.
    Fill(Schedule),
}

impl Question {
    /// Volumes that are known in advance [m^3], in order, with the day of each.
    pub(super) fn volumes(&self, order: &ImplantSpec) -> Vec<(f64, Option<f64>)> {
        match self {
            Self::Volume => vec![(order.implant.volume, None)],
            Self::Area(_) => Vec::new(),
            Self::Volumes(volumes) => volumes.iter().map(|volume| (*volume, None)).collect(),
            Self::Fill(schedule) => schedule
                .fillings()
                .iter()
                .map(|f| (f.volume, Some(f.day)))
                .collect(),
        }
    }

    /// True for a question with several volumes.
    pub(super) fn is_curve(&self) -> bool {
        matches!(self, Self::Volumes(_) | Self::Fill(_))
    }

    /// Rejects volumes that are no implant: so flat that contact decides on the shape, or too large
    /// for the base.
    pub(super) fn check(&self, order: &ImplantSpec) -> Result<(), SkinError> {
        let edge = order.edge();
        for (volume, _) in self.volumes(order) {
            let implant = Implant {
                volume,
                ..order.implant
            };
            let least = implant.least(edge);
            if volume < least {
                let (volume_cc, least_cc, base_cm) =
                    (volume * 1e6, least * 1e6, implant.base * 1e2);
                return Err(SkinError::TooFlat {
                    volume_cc,
                    least_cc,
                    base_cm,
                });
            }
            if volume > implant.largest(edge) {
                return Err(implant.too_large(edge));
            }
        }
        Ok(())
    }
}

pub(super) fn question(arguments: &Arguments, said: &Said) -> Result<Question, Failure> {
    if let Some(text) = &arguments.wanted_area {
        return Ok(Question::Area(positive(
            "--wanted-area",
            "the wanted area",
            text,
            quantity("--wanted-area", text, AREAS, None)?,
        )?));
    }
    if let Some(list) = &arguments.volumes {
        let volumes: Result<Vec<f64>, Failure> = list
            .split(',')
            .map(|v| volume("--volumes", v, Some(1e-6)))
            .collect();
        return Ok(Question::Volumes(volumes?));
    }
    // An implant with its own volume ignores the common schedule.
    let fill = said
        .fill
        .as_ref()
        .or(arguments.fill.as_ref().filter(|_| said.volume.is_none()));
    fill.map_or(Ok(Question::Volume), |text| {
        Ok(Question::Fill(schedule(text)?))
    })
}

pub(super) fn limit(ratio: f64) -> Result<(), Failure> {
    if ratio > 1.0 && ratio.is_finite() {
        return Ok(());
    }
    Err(Failure::usage(
        format!("--stretch-limit: {ratio} is no stretch"),
        "give a ratio above 1, as in 1.5",
    ))
}
