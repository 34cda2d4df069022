//! Reads skin, implants, balls and obstacles.

use std::collections::HashSet;

use nalgebra::Point3;

use super::content::{
    BallSpec, FillCourse, ImplantFill, ObstacleSpec, SkinScene, SkinSpec, SkinSurface, Support,
};
use super::error::{SceneError, SceneProblem};
use super::parse::{
    checked_name, edge_length, repair, surface, surface_of, unique_name, unknown_name,
};
use super::reader::{Item, Limit, Section};
use super::units::Dimension;
use super::{SceneOrigin, Source};
use crate::mesh::shapes;
use crate::skin::fill::{Filling, Schedule};
use crate::skin::implant::{Implant, SILICONE};
use crate::skin::layers::Tissue;
use crate::skin::plan::ImplantPlace;
use crate::skin::settle::SettleMethod;
use crate::skin::{BaseShape, ImplantSpec};

type Read<T> = Result<T, SceneError>;

/// Default stretch above which skin counts as stretched too far.
const STRETCH_LIMIT: f64 = 1.5;

/// Greatest number of squares along a sheet.
const MOST_CELLS: u32 = 1024;

/// Greatest number of frames.
const MOST_FRAMES: u32 = 10_000_000;

/// Frames and volumes.
type Fill = Vec<(usize, f64)>;

/// Reads a scene of skin.
pub(super) fn scene(root: &Section<'_>, name: String) -> Read<SkinScene> {
    let sections = root.sections("skin")?;
    let Some(section) = sections.first() else {
        return root.fail(SceneProblem::missing("skin", "a section [[skin]]"));
    };
    if let Some(second) = sections.get(1) {
        return second.fail(SceneProblem::out_of_range(
            "a second [[skin]]",
            "one skin a scene",
        ));
    }
    let skin = skin(section, root)?;
    let tissue = tissue(section)?;
    let edge = edge_length(section)?;
    let frames = root
        .get("frames")
        .map(|item| item.whole(1, MOST_FRAMES))
        .transpose()?
        .map(|n| n as usize);
    root.exclusive("ball", "implant")?;
    let (under, frames, days) = match root.section("ball")? {
        Some(section) => {
            root.exclusive("ball", "obstacle")?;
            (
                Support::Ball(ball(&section, tissue, edge)?),
                frames.unwrap_or(1),
                Vec::new(),
            )
        }
        None => implants(root, tissue, edge, frames)?,
    };
    let mut taken = HashSet::new();
    let mut obstacles = Vec::new();
    for section in root.sections("obstacle")? {
        let name = unique_name(&section, &mut taken)?;
        obstacles.push(ObstacleSpec {
            name,
            surface: surface(&section)?,
            repair: repair(&section)?,
        });
    }
    Ok(SkinScene {
        name,
        frames,
        days,
        skin,
        under,
        obstacles,
        origin: SceneOrigin::default(),
    })
}

fn skin(section: &Section<'_>, root: &Section<'_>) -> Read<SkinSpec> {
    let sheet = root.get("sheet");
    let found = surface_of(section, shapes::SKIN_NAMES)?;
    let surface = match (found, sheet, root.section("sheet")?) {
        (Source::Shape(name), _, Some(sheet)) if name == "sheet" => SkinSurface::Sheet {
            side: sheet.need_quantity("side", Dimension::Length, Limit::Positive)?,
            cells: sheet.need("cells", "64")?.whole(4, MOST_CELLS)?,
        },
        (Source::Shape(name), ..) if name == "sheet" => {
            return section.fail(SceneProblem::missing(
                "sheet",
                "a section [sheet] with `side` and `cells`",
            ));
        }
        (_, Some(sheet), _) => {
            let (first, second) = ("sheet".to_owned(), "a skin of another shape".to_owned());
            return sheet.fail(SceneProblem::Conflict { first, second });
        }
        (source, None, _) => SkinSurface::Source(source),
    };
    Ok(SkinSpec {
        name: section
            .get("name")
            .map_or(Ok("skin".to_owned()), |item| checked_name(&item))?,
        surface,
        repair: repair(section)?,
        stretch_limit: section.number_or(
            "stretch_limit",
            Limit::Within(1.0, 100.0),
            STRETCH_LIMIT,
        )?,
        up: section
            .get("up")
            .map(|item| item.direction())
            .transpose()?
            .map(|unit| unit.into_inner()),
        method: section
            .get("method")
            .map(|item| method(&item))
            .transpose()?,
    })
}

fn method(item: &Item<'_>) -> Read<SettleMethod> {
    const METHODS: [(&str, SettleMethod); 2] = [
        ("newton", SettleMethod::Newton),
        ("quasi_static", SettleMethod::QuasiStatic),
    ];
    named(item, "method", &METHODS)
}

/// A value from a list of names.
fn named<T: Copy>(item: &Item<'_>, what: &'static str, known: &[(&'static str, T)]) -> Read<T> {
    let name = item.text(known.first().map_or("", |(name, _)| *name))?;
    match known.iter().find(|(known, _)| *known == name) {
        Some((_, thing)) => Ok(*thing),
        None => item.fail(unknown_name(
            what,
            name,
            known.iter().map(|(name, _)| *name),
        )),
    }
}

fn tissue(section: &Section<'_>) -> Read<Tissue> {
    let default = Tissue::default();
    Ok(Tissue {
        modulus: section.quantity_or(
            "modulus",
            Dimension::Pressure,
            Limit::Positive,
            default.modulus,
        )?,
        thickness: section.quantity_or(
            "thickness",
            Dimension::Length,
            Limit::Positive,
            default.thickness,
        )?,
        bond: section.quantity_or(
            "bond",
            Dimension::BondStiffness,
            Limit::NotNegative,
            default.bond,
        )?,
        pocket: section.quantity_or(
            "pocket",
            Dimension::Ratio,
            Limit::Within(0.0, 1.5),
            default.pocket,
        )?,
        ..default
    })
}

/// The volume of an implant over time, as read.
enum Amount {
    Volume(f64),
    Frames(Fill),
    Days(Schedule),
    Target(f64),
}

/// The implants, the number of frames, and the day of each frame.
fn implants(
    root: &Section<'_>,
    tissue: Tissue,
    edge: Option<f64>,
    frames: Option<usize>,
) -> Read<(Support, usize, Vec<f64>)> {
    let sections = root.sections("implant")?;
    if sections.is_empty() {
        return root.fail(SceneProblem::missing(
            "implant",
            "a section [[implant]], or a section [ball]",
        ));
    }
    let amounts: Vec<Amount> = sections.iter().map(amount).collect::<Read<_>>()?;
    let days = days(root, &sections, &amounts)?;
    let frames = frames.or(last_frame(&amounts)).unwrap_or(days.len().max(1));
    let mut taken = HashSet::new();
    let mut all = Vec::new();
    for (section, amount) in sections.iter().zip(amounts) {
        let name = match (sections.len(), section.get("name")) {
            (1, None) => "implant".to_owned(),
            _ => unique_name(section, &mut taken)?,
        };
        let (fill, course) = match amount {
            // With days, the one volume holds from the first day.
            Amount::Volume(volume) if !days.is_empty() => (vec![(1, volume)], FillCourse::Evenly),
            Amount::Volume(volume) => (vec![(frames, volume)], FillCourse::Evenly),
            Amount::Frames(fill) => (fill, FillCourse::Frames),
            Amount::Days(schedule) => (by_frame(&schedule, &days), FillCourse::Days),
            Amount::Target(area) => {
                check_alone(root, section, sections.len(), frames)?;
                (Vec::new(), FillCourse::Target(area))
            }
        };
        let mut order = order(section, tissue, edge)?;
        order.implant.volume = match fill.last() {
            Some((_, volume)) => *volume,
            None => order.implant.least(order.edge()),
        };
        all.push(ImplantFill {
            name,
            order,
            fill,
            course,
        });
    }
    Ok((Support::Implants(all), frames, days))
}

/// The greatest frame of all lists of frames.
fn last_frame(amounts: &[Amount]) -> Option<usize> {
    let last = |amount: &Amount| match amount {
        Amount::Frames(fill) => fill.last().map(|(frame, _)| *frame),
        _ => None,
    };
    amounts.iter().filter_map(last).max()
}

/// The days of all fillings in order, each once. Rejects lists of frames beside them.
fn days(root: &Section<'_>, sections: &[Section<'_>], amounts: &[Amount]) -> Read<Vec<f64>> {
    let mut days = Vec::new();
    for amount in amounts {
        if let Amount::Days(schedule) = amount {
            days.extend(schedule.fillings().iter().map(|filling| filling.day));
        }
    }
    days.sort_by(f64::total_cmp);
    days.dedup();
    if days.is_empty() {
        return Ok(days);
    }
    let conflict = |first: &str| SceneProblem::Conflict {
        first: first.to_owned(),
        second: "fill.day".to_owned(),
    };
    if let Some(item) = root.get("frames") {
        return item.fail(conflict("frames"));
    }
    let by_frames = |amount: &Amount| matches!(amount, Amount::Frames(_));
    match amounts.iter().position(by_frames) {
        Some(k) => sections[k].fail(conflict("fill.frame")),
        None => Ok(days),
    }
}

/// Frames and volumes of a schedule among the days of all implants.
fn by_frame(schedule: &Schedule, days: &[f64]) -> Fill {
    let fillings = schedule.fillings().iter();
    fillings
        .map(|filling| {
            (
                1 + days.partition_point(|d| *d < filling.day),
                filling.volume,
            )
        })
        .collect()
}

/// Rejects a target area beside other implants, or over several frames.
fn check_alone(root: &Section<'_>, section: &Section<'_>, count: usize, frames: usize) -> Read<()> {
    let item = section.need("target_area", "\"30 cm2\"")?;
    if count > 1 {
        return item.fail(SceneProblem::out_of_range(
            "a target area of several implants",
            "one [[implant]], or a volume for each",
        ));
    }
    match root.get("frames") {
        Some(item) if frames > 1 => item.fail(SceneProblem::Conflict {
            first: "frames".to_owned(),
            second: "target_area".to_owned(),
        }),
        _ => Ok(()),
    }
}

/// The volume of an implant, its list of volumes, or its target area.
fn amount(section: &Section<'_>) -> Read<Amount> {
    for (first, second) in [
        ("volume", "fill"),
        ("volume", "target_area"),
        ("fill", "target_area"),
    ] {
        section.exclusive(first, second)?;
    }
    if let Some(item) = section.get("target_area") {
        return Ok(Amount::Target(
            item.quantity(Dimension::Area, Limit::Positive)?,
        ));
    }
    let Some(item) = section.get("fill") else {
        return Ok(Amount::Volume(section.need_quantity(
            "volume",
            Dimension::Volume,
            Limit::Positive,
        )?));
    };
    let list = section.sections("fill")?;
    match list.first() {
        None => item.fail(SceneProblem::EmptyList {
            expected: "at least one `{ frame = 1, volume = \"100 cc\" }`".to_owned(),
        }),
        Some(first) if first.get("day").is_some() => by_days(section, &list),
        Some(_) => by_frames(&list),
    }
}

/// A list of frames and volumes.
fn by_frames(list: &[Section<'_>]) -> Read<Amount> {
    let mut fill: Fill = Vec::new();
    for key in list {
        key.exclusive("frame", "day")?;
        let at = key.need("frame", "1")?;
        let frame = at.whole(1, MOST_FRAMES)? as usize;
        if let Some((before, _)) = fill.last().filter(|(before, _)| *before >= frame) {
            return at.fail(SceneProblem::KeysOutOfOrder {
                what: "frame",
                frame: frame as f64,
                before: *before as f64,
            });
        }
        fill.push((
            frame,
            key.need_quantity("volume", Dimension::Volume, Limit::Positive)?,
        ));
    }
    Ok(Amount::Frames(fill))
}

/// A list of days and volumes.
fn by_days(section: &Section<'_>, list: &[Section<'_>]) -> Read<Amount> {
    let mut fillings = Vec::new();
    for key in list {
        key.exclusive("frame", "day")?;
        fillings.push(Filling {
            day: key.need("day", "7")?.number(Limit::Any)?,
            volume: key.need_quantity("volume", Dimension::Volume, Limit::Positive)?,
        });
    }
    match Schedule::new(fillings) {
        Ok(schedule) => Ok(Amount::Days(schedule)),
        Err(error) => section.need("fill", "[]")?.fail(SceneProblem::Unfit {
            code: "E076",
            message: error.to_string(),
            help: error.help().to_owned(),
        }),
    }
}

/// An implant without its volume.
fn order(section: &Section<'_>, tissue: Tissue, edge: Option<f64>) -> Read<ImplantSpec> {
    section.exclusive("at", "near_vertex")?;
    let place = match (section.get("at"), section.get("near_vertex")) {
        (Some(item), _) => ImplantPlace::Point(Point3::from(item.vector(Dimension::Length)?)),
        (None, Some(item)) => ImplantPlace::Vertex(item.whole(0, u32::MAX)? as usize),
        (None, None) => {
            return section.fail(SceneProblem::Missing {
                what: "the place of the implant".to_owned(),
                add: "`at = [\"0 mm\", \"0 mm\", \"0 mm\"]`, or `near_vertex = N`".to_owned(),
            });
        }
    };
    let shape = section.get("shape").map_or(Ok(BaseShape::Round), |item| {
        named(&item, "shape", &BaseShape::ALL)
    })?;
    let long = section
        .get("long")
        .map(|item| item.direction())
        .transpose()?
        .map(|unit| unit.into_inner());
    let depth = section.quantity_or("depth", Dimension::Length, Limit::Positive, tissue.depth)?;
    let implant = Implant {
        shape,
        base: section.need_quantity("base", Dimension::Length, Limit::Positive)?,
        volume: 0.0,
        membrane: section.quantity_or("shell", Dimension::Stiffness, Limit::Positive, SILICONE)?,
    };
    Ok(ImplantSpec {
        place,
        implant,
        long,
        tissue: Tissue { depth, ..tissue },
        edge,
    })
}

fn ball(section: &Section<'_>, tissue: Tissue, edge: Option<f64>) -> Read<BallSpec> {
    let radius = section.need_quantity("radius", Dimension::Length, Limit::Positive)?;
    let point = |item: Item<'_>| item.vector(Dimension::Length).map(Point3::from);
    let to = section
        .get("to")
        .map(point)
        .transpose()?
        .unwrap_or_else(Point3::origin);
    let from = section.get("from").map(point).transpose()?;
    let depth = section.quantity_or("depth", Dimension::Length, Limit::Positive, tissue.depth)?;
    // The region is that of an implant as wide as the ball; its volume is not used.
    let order = ImplantSpec {
        edge,
        ..ImplantSpec::round(ImplantPlace::Point(to), 2.0 * radius, radius.powi(3))
    };
    Ok(BallSpec {
        radius,
        from,
        to,
        order: ImplantSpec {
            tissue: Tissue { depth, ..tissue },
            ..order
        },
    })
}
