//! The visible state of skin over implants.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Translation3, Vector3};

use super::{Skin, direction, implants};
use crate::snapshot::{
    BodyShot, BoneShot, Handle, Probe, Reading, Shot, Stage, StageBody, Steering, Tissue,
};
use pliant::constraints::Distance;
use pliant::fibres::BoundLines;
use pliant::mesh::{Topology, TriangleMesh, shapes};
use pliant::scene::Support;
use pliant::simulation::{SkinMeasures, SkinPart, SkinRun, strain_at_vertices};
use pliant::skin::{Areas, CAVEATS, frame};

/// Subdivisions of the icosahedron that displays a ball.
const BALL: u32 = 3;

/// A point on a triangle of the skin, and the frame of an implant there.
#[derive(Clone, Copy, Debug)]
pub(super) struct PickedPoint {
    corners: [u32; 3],
    weights: [f64; 3],
    /// Frame with z out of the body.
    pub frame: Isometry3<f64>,
}

impl PickedPoint {
    /// Creates a point on a triangle.
    pub fn new(x: &[Point3<f64>], triangles: &[[u32; 3]], triangle: u32, p: &Point3<f64>) -> Self {
        let corners = triangles[triangle as usize];
        let [a, b, c] = corners.map(|v| x[v as usize]);
        let across = (b - a).cross(&(c - a));
        let share = |q: &Point3<f64>, r: &Point3<f64>| {
            (q - p).cross(&(r - p)).dot(&across) / across.norm_squared()
        };
        let weights = [share(&b, &c), share(&c, &a), share(&a, &b)];
        // A triangle without area is represented by any of its points.
        let weights = if weights.iter().all(|w| w.is_finite()) {
            weights
        } else {
            [1.0, 0.0, 0.0]
        };
        Self {
            corners,
            weights,
            frame: Isometry3::identity(),
        }
    }

    /// The point for other positions.
    pub fn at(&self, x: &[Point3<f64>]) -> Point3<f64> {
        let each = self.corners.iter().zip(&self.weights);
        Point3::from(
            each.map(|(v, w)| x[*v as usize].coords * *w)
                .sum::<Vector3<f64>>(),
        )
    }

    /// The normal of its triangle.
    pub fn normal(&self, x: &[Point3<f64>]) -> Vector3<f64> {
        let [a, b, c] = self.corners.map(|v| x[v as usize]);
        (b - a).cross(&(c - a))
    }

    /// The direction along the skin at an angle from the default direction.
    pub fn along(&self, angle: f64) -> Vector3<f64> {
        direction(&self.plain(), angle)
    }

    /// The angle of an implant's direction along the skin.
    pub fn angle(&self) -> f64 {
        let x = self.plain().inverse() * (self.frame * Vector3::x());
        libm::atan2(x.y, x.x)
    }

    fn plain(&self) -> Isometry3<f64> {
        frame(&Point3::origin(), &(self.frame * Vector3::z()), None)
    }
}

/// Part and shell of each implant, in the order of the scene.
fn places(run: &SkinRun) -> Vec<(&SkinPart, usize)> {
    let each = run.parts.iter().flat_map(|part| {
        part.members
            .iter()
            .enumerate()
            .map(move |(s, k)| (*k, part, s))
    });
    let mut all: Vec<(usize, &SkinPart, usize)> = each.collect();
    all.sort_by_key(|(k, ..)| *k);
    all.into_iter().map(|(_, part, s)| (part, s)).collect()
}

/// The point of each implant on the whole skin.
pub(super) fn points(run: &SkinRun) -> Vec<PickedPoint> {
    let skin = &run.whole;
    let tree = pliant::mesh::SurfaceTree::new(&skin.vertices, &skin.triangles);
    let point = |(part, s): (&SkinPart, usize)| {
        let (_, frame) = part.ready.sites().nth(s)?;
        let middle = Point3::from(frame.translation.vector);
        let found = tree.closest(&middle, f64::INFINITY)?;
        Some(PickedPoint {
            frame: *frame,
            ..PickedPoint::new(
                &skin.vertices,
                &skin.triangles,
                found.triangle,
                &found.point,
            )
        })
    };
    places(run).into_iter().filter_map(point).collect()
}

/// The undeformed shell of each implant with the volume of a frame; in frame 0 the initial one.
pub(super) fn domes(run: &SkinRun, at: usize) -> Vec<TriangleMesh> {
    let of_part = |part: &SkinPart| {
        let volumes = run.volumes_at(part, at);
        // Volumes without a shell were rejected.
        part.ready
            .domes(&volumes)
            .unwrap_or_else(|_| part.shells.clone())
    };
    let mut made: Vec<(usize, TriangleMesh)> = Vec::new();
    for part in run.parts.iter().filter(|part| !part.members.is_empty()) {
        let shells = if at == 0 {
            part.shells.clone()
        } else {
            of_part(part)
        };
        made.extend(part.members.iter().copied().zip(shells));
    }
    made.sort_by_key(|(k, _)| *k);
    made.into_iter().map(|(_, dome)| dome).collect()
}

/// The constant data of a run, and the edges of its skin with their rest lengths.
pub(super) fn stage(run: &SkinRun) -> (Arc<Stage>, Vec<Distance>) {
    let topology = Topology::new(&run.whole);
    let lengths = topology.edge_lengths(&run.whole);
    let edges = topology
        .edges
        .iter()
        .zip(lengths)
        .filter(|(_, rest)| *rest > 0.0);
    let springs: Vec<Distance> = edges
        .map(|(&points, rest)| Distance { points, rest })
        .collect();
    let mut held = vec![true; run.whole.vertices.len()];
    for part in &run.parts {
        part.vertices()
            .for_each(|(region, vertex)| held[vertex] = part.ready.layers.held[region]);
    }
    let body = |name: &str, tissue, triangles: &[[u32; 3]], edges, held| StageBody {
        name: name.to_owned(),
        tissue,
        triangles: triangles.to_vec(),
        edges,
        held,
        fibres: BoundLines::default(),
    };
    let held = (0..held.len() as u32)
        .filter(|v| held[*v as usize])
        .collect();
    let mut bodies = vec![body(
        &run.scene.skin.name,
        Tissue::Skin,
        &run.whole.triangles,
        topology.edges,
        held,
    )];
    for (k, (part, s)) in places(run).into_iter().enumerate() {
        let shell = &part.shells[s];
        let edges = Topology::new(shell).edges;
        bodies.push(body(
            run.name_of(k),
            Tissue::Implant,
            &shell.triangles,
            edges,
            Vec::new(),
        ));
    }
    let obstacles = run.scene.obstacles.iter().zip(&run.obstacles);
    let mut bones: Vec<(String, TriangleMesh)> = obstacles
        .map(|(o, mesh)| (o.name.clone(), mesh.clone()))
        .collect();
    if let Support::Ball(ball) = &run.scene.under {
        bones.push(("ball".to_owned(), shapes::icosphere(ball.radius, BALL)));
    }
    (Arc::new(Stage { bodies, bones }), springs)
}

impl Skin {
    /// Positions of the skin and of each shell, with their frame.
    pub(super) fn seen(&self) -> (Vec<Vec<Point3<f64>>>, usize) {
        let run = &self.run;
        let mut all = Vec::new();
        if let Some(moving) = &self.moving {
            all.push(run.whole.vertices.clone());
            all.extend(self.domes.iter().map(|dome| dome.vertices.clone()));
            all[1 + moving.implant].clone_from(&moving.shell);
            return (all, 0);
        }
        all.push(run.skin_at());
        if run.frame() == 0 && self.reached > 0 {
            all.extend(self.domes.iter().map(|dome| dome.vertices.clone()));
        } else {
            all.extend(
                places(run)
                    .into_iter()
                    .filter_map(|(part, s)| Some(part.shells_at().nth(s)?.to_vec())),
            );
        }
        (all, run.frame())
    }

    pub(super) fn shown(&self) -> Shot {
        let (run, (seen, frame)) = (&self.run, self.seen());
        let mut bodies: Vec<BodyShot> = seen
            .into_iter()
            .map(|positions| BodyShot {
                positions,
                ..BodyShot::default()
            })
            .collect();
        bodies[0].stretch = strain_at_vertices(&self.springs, &bodies[0].positions);
        let handle = |(k, point): (usize, &PickedPoint)| Handle {
            name: run.name_of(k).to_owned(),
            at: match &self.moving {
                Some(moving) if moving.implant == k => moving.at,
                _ => point.at(&bodies[0].positions),
            },
        };
        let mut bones = vec![still(Isometry3::identity()); run.obstacles.len()];
        if let (Support::Ball(ball), [part]) = (&run.scene.under, run.parts.as_slice()) {
            bones.push(still(
                Translation3::from(run.ball_at(ball, part, frame).centre.coords).into(),
            ));
        }
        let time = |part: &SkinPart| measures_in(part, frame).map_or(0.0, |f| 1e3 * f.time_s);
        let own = if implants(&run.scene).is_empty() {
            Vec::new()
        } else {
            CAVEATS.map(str::to_owned).to_vec()
        };
        Shot {
            frame,
            last_frame: run.scene.frames,
            stage: self.stage.clone(),
            scene: None,
            controls: self.controls.clone(),
            bones,
            handles: self.points.iter().enumerate().map(handle).collect(),
            readings: self.readings(frame),
            probe: self
                .probe
                .map(|(body, vertex)| self.probed(body, vertex, &bodies)),
            effects: if frame > 0 {
                vec![("equilibrium", run.parts.iter().map(time).sum())]
            } else {
                Vec::new()
            },
            notes: run.notes.iter().cloned().chain(own).collect(),
            bodies,
        }
    }

    /// Areas of all skin over implants, volume and pressure of each implant.
    fn readings(&self, frame: usize) -> Vec<Reading> {
        let run = &self.run;
        let areas: Areas = run
            .parts
            .iter()
            .map(|part| {
                let layers = &part.ready.layers;
                measures_in(part, frame)
                    .map_or_else(|| Areas::of(layers, &layers.rest), |f| f.areas)
            })
            .sum();
        let places = places(run);
        let shells: Vec<(f64, f64)> = places
            .iter()
            .map(|(part, s)| {
                let shell = measures_in(part, frame).and_then(|f| f.shells.get(*s).copied());
                shell.unwrap_or((0.0, 0.0))
            })
            .collect();
        // A single implant needs no name.
        let of = |k: usize| {
            if shells.len() > 1 { run.name_of(k) } else { "" }
        };
        let mut all = vec![
            reading("Area gained", "", "cm2", 1e4 * areas.gain()),
            reading("Area", "", "cm2", 1e4 * areas.deformed),
        ];
        for (k, (volume, _)) in shells.iter().enumerate() {
            all.push(reading("Volume", of(k), "cc", 1e6 * volume));
        }
        for (k, (_, pressure)) in shells.iter().enumerate() {
            all.push(reading("Pressure", of(k), "kPa", 1e-3 * pressure));
        }
        let stretch = 100.0 * (areas.stretch_max - 1.0);
        all.push(reading("Greatest stretch", "", "%", stretch));
        all
    }

    fn probed(&self, body: usize, vertex: usize, bodies: &[BodyShot]) -> Probe {
        let mut values = Vec::new();
        if body == 0 {
            let from = self.run.whole.vertices[vertex];
            values.push(("stretch", 100.0 * bodies[0].stretch[vertex], "%"));
            values.push((
                "lifted by",
                1e3 * (bodies[0].positions[vertex] - from).norm(),
                "mm",
            ));
        }
        Probe {
            body,
            vertex,
            values,
        }
    }
}

/// A bone that moves with nothing.
fn still(pose: Isometry3<f64>) -> BoneShot {
    BoneShot {
        pose,
        angle: None,
        steering: Steering::Motion,
    }
}

/// The measures of a part in exactly this frame.
fn measures_in(part: &SkinPart, frame: usize) -> Option<&SkinMeasures> {
    part.frames.iter().find(|f| f.frame == frame)
}

fn reading(name: &'static str, of: &str, unit: &'static str, value: f64) -> Reading {
    Reading {
        name,
        of: of.to_owned(),
        unit,
        value,
    }
}
