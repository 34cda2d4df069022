//! Bodies of springs that collide with each other and with rigid ones.

use std::collections::HashSet;

use nalgebra::Vector3;

use super::super::error::{SceneError, SceneProblem};
use super::super::parse::{rigid_bodies, surface, unique_name};
use super::super::reader::{Limit, Section};
use super::super::schema::Kind::{self, List, Plain, Table, Text};
use super::super::schema::{self, Schema};
use super::super::units::Dimension;
use super::super::{BoneSpec, SceneOrigin, Source};
use super::{Content, Measure};
use crate::encode::{Encode, Encoder};
use crate::springs::Neighbours;

/// The keys of such a scene.
pub(super) const KEYS: &[(&str, Kind)] = &[
    ("spring_body", List(&SPRING_BODY)),
    ("rigid_body", List(&schema::BONE)),
    ("acceleration", Plain),
    ("collision", Table(&COLLISION)),
];

const SPRING_BODY: Schema = Schema::Listed(&[
    ("name", Text),
    ("mesh", Text),
    ("shape", Text),
    ("unit", Text),
    ("lattice", Plain),
    ("side", Text),
    ("neighbours", Plain),
    ("mass", Text),
    ("stiffness", Text),
    ("bulk_modulus", Text),
    ("damping", Text),
    ("at", Plain),
    ("velocity", Plain),
    ("held", Plain),
]);

const COLLISION: Schema = Schema::Listed(&[
    ("restitution", Plain),
    ("friction", Plain),
    ("thickness", Text),
]);

/// Measures of scenes of bodies of springs.
pub(super) const MEASURES: &[Measure] = &[
    ("time_s", "time [s]", 1.0),
    ("crossings", "triangles that cross, most in a frame", 1.0),
    ("volume_change", "change of a volume, greatest [%]", 100.0),
    ("contacts", "pairs that touched, summed over steps", 1.0),
    ("kinetic_energy_j", "kinetic energy [J]", 1.0),
    (
        "energy_j",
        "energy with springs, volumes and weight [J]",
        1.0,
    ),
    ("speed_m_s", "greatest speed [m/s]", 1.0),
];

/// Bodies of springs that collide with each other and with rigid ones.
#[derive(Clone, Debug, PartialEq)]
pub struct SpringBodiesScene {
    /// Name, also of the results folder.
    pub name: String,
    /// Number of frames after the start; frame 0 is the start.
    pub frames: usize,
    /// Frames a second [1/s].
    pub frame_rate: f64,
    /// The soft bodies.
    pub bodies: Vec<SpringBodySpec>,
    /// Rigid bodies that move as prescribed, or stand.
    pub rigid: Vec<BoneSpec>,
    /// Acceleration of every point that is not held [m/s^2].
    pub gravity: Vector3<f64>,
    /// Speed of separation over that of approach, 0 to 1.
    pub restitution: f64,
    /// Coefficient of Coulomb friction.
    pub friction: f64,
    /// Distance that surfaces keep [m]; `None` for a share of the edges.
    pub thickness: Option<f64>,
    /// Origin of the scene's text, for errors found in its meshes.
    pub origin: SceneOrigin,
}

/// A body of springs.
#[derive(Clone, Debug, PartialEq)]
pub struct SpringBodySpec {
    /// Name, unique among all bodies.
    pub name: String,
    /// Surface whose edges are springs; `None` for a lattice.
    pub surface: Option<Source>,
    /// Points along each side, longest side [m], neighbours of a point.
    pub lattice: Option<([usize; 3], f64, Neighbours)>,
    /// Mass of the whole body [kg].
    pub mass: f64,
    /// Stiffness of each spring [N/m].
    pub stiffness: f64,
    /// Bulk modulus of the enclosed volume [Pa]; `None` if nothing keeps it.
    pub bulk_modulus: Option<f64>,
    /// Damping of each point: force over velocity [N s/m].
    pub damping: f64,
    /// Where the origin of its points is at the start [m].
    pub at: Vector3<f64>,
    /// Velocity at the start [m/s].
    pub velocity: Vector3<f64>,
    /// Whether its lowest points along y are held.
    pub holds_lowest: bool,
    /// Points that are held.
    pub held: Vec<u32>,
}

type Read<T> = Result<T, SceneError>;

/// Default damping of each point: force over velocity [N s/m].
const DAMPING: f64 = 0.0;

/// Greatest number of points along a side of a lattice.
const MOST_A_SIDE: u32 = 100;

/// Reads such a scene.
pub(super) fn read(root: &Section<'_>, name: String) -> Result<Content, SceneError> {
    let frames = root.need("frames", "120")?.whole(1, 10_000_000)? as usize;
    let frame_rate = root.need_quantity("frame_rate", Dimension::Rate, Limit::Positive)?;
    let mut taken = HashSet::new();
    let mut bodies = Vec::new();
    for section in root.sections("spring_body")? {
        bodies.push(body(&section, &mut taken)?);
    }
    if bodies.is_empty() {
        return root.fail(SceneProblem::missing(
            "spring_body",
            "a section [[spring_body]]",
        ));
    }
    let rigid = rigid_bodies(root, &mut taken)?;
    let gravity = root
        .get("acceleration")
        .map(|item| item.vector(Dimension::Acceleration));
    let collision = root.section("collision")?;
    let collision = collision.as_ref();
    let share = |key: &str| {
        let limit = Limit::Within(0.0, 1.0);
        collision.map_or(Ok(0.0), |section| section.number_or(key, limit, 0.0))
    };
    Ok(Content::SpringBodies(Box::new(SpringBodiesScene {
        name,
        frames,
        frame_rate,
        bodies,
        rigid,
        gravity: gravity.transpose()?.unwrap_or_default(),
        restitution: share("restitution")?,
        friction: collision.map_or(Ok(0.0), |section| {
            section.number_or("friction", Limit::NotNegative, 0.0)
        })?,
        thickness: collision
            .and_then(|section| section.get("thickness"))
            .map(|item| item.quantity(Dimension::Length, Limit::Positive))
            .transpose()?,
        origin: SceneOrigin::default(),
    })))
}

fn body(section: &Section<'_>, taken: &mut HashSet<String>) -> Read<SpringBodySpec> {
    let name = unique_name(section, taken)?;
    for key in ["mesh", "shape"] {
        section.exclusive("lattice", key)?;
    }
    let lattice = lattice(section)?;
    let surface = match lattice {
        Some(_) => None,
        None => Some(surface(section)?),
    };
    let vector = |key: &str, dimension| {
        section
            .get(key)
            .map_or(Ok(Vector3::zeros()), |item| item.vector(dimension))
    };
    let held = section.get("held").map(|item| match item.is_text() {
        true => match item.text("lowest")? {
            "lowest" => Ok((true, Vec::new())),
            other => item.fail(SceneProblem::out_of_range(
                other,
                "\"lowest\", or a list of vertices",
            )),
        },
        false => Ok((false, item.vertices()?)),
    });
    let (holds_lowest, held) = held.transpose()?.unwrap_or_default();
    Ok(SpringBodySpec {
        name,
        surface,
        lattice,
        mass: section.need_quantity("mass", Dimension::Mass, Limit::Positive)?,
        stiffness: section.need_quantity("stiffness", Dimension::Stiffness, Limit::Positive)?,
        bulk_modulus: section
            .get("bulk_modulus")
            .map(|item| item.quantity(Dimension::Pressure, Limit::Positive))
            .transpose()?,
        damping: section.quantity_or("damping", Dimension::Damping, Limit::NotNegative, DAMPING)?,
        at: vector("at", Dimension::Length)?,
        velocity: vector("velocity", Dimension::Velocity)?,
        holds_lowest,
        held,
    })
}

/// Points along each side, the longest side [m], and the neighbours of a point.
fn lattice(section: &Section<'_>) -> Read<Option<([usize; 3], f64, Neighbours)>> {
    let Some(item) = section.get("lattice") else {
        for key in ["side", "neighbours"] {
            if let Some(item) = section.get(key) {
                return item.fail(SceneProblem::missing("lattice", "`lattice = [8, 8, 8]`"));
            }
        }
        return Ok(None);
    };
    let counts = item.list("a list of three whole numbers such as [8, 8, 8]")?;
    let counts: Vec<usize> = counts
        .iter()
        .map(|n| n.whole(2, MOST_A_SIDE).map(|n| n as usize))
        .collect::<Read<_>>()?;
    let Ok(points) = <[usize; 3]>::try_from(counts) else {
        let allowed = "three whole numbers: the points along x, y, z";
        return item.fail(SceneProblem::out_of_range("the list", allowed));
    };
    let side = section.need_quantity("side", Dimension::Length, Limit::Positive)?;
    let neighbours = match section.get("neighbours") {
        None => Neighbours::TwentySix,
        Some(item) => {
            let count = item.whole(6, 26)?;
            let refused = || SceneProblem::out_of_range(&count.to_string(), "6, 18 or 26");
            Neighbours::of_count(count).ok_or_else(|| item.error(refused()))?
        }
    };
    Ok(Some((points, side, neighbours)))
}

impl Encode for SpringBodiesScene {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self {
            name,
            frames,
            frame_rate,
            bodies,
            rigid,
            gravity,
            restitution,
            friction,
            thickness,
            origin: _,
        } = self;
        to.field("name", name);
        to.field("frames", frames);
        to.field("frame_rate", frame_rate);
        to.field("spring_body", bodies);
        to.field("rigid_body", rigid);
        to.field("gravity", gravity);
        to.field("restitution", restitution);
        to.field("friction", friction);
        to.field("thickness", thickness);
    }
}

impl Encode for SpringBodySpec {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self {
            name,
            surface,
            lattice,
            mass,
            stiffness,
            bulk_modulus,
            damping,
            at,
            velocity,
            holds_lowest,
            held,
        } = self;
        to.field("name", name);
        to.field("surface", surface);
        if let Some((points, side, neighbours)) = lattice {
            to.field("lattice", points);
            to.field("side", side);
            to.field("neighbours", &neighbours.count());
        }
        to.field("mass", mass);
        to.field("stiffness", stiffness);
        to.field("bulk_modulus", bulk_modulus);
        to.field("damping", damping);
        to.field("at", at);
        to.field("velocity", velocity);
        to.field("holds_lowest", holds_lowest);
        to.field("held", held);
    }
}
