//! The spring system of a command.

use std::path::Path;

use nalgebra::{Point3, center};

use super::super::failure::Failure;
use pliant::mesh::measures::Aabb;
use pliant::simulation::LoadError;
use pliant::springs::damping::{self, DampedBody};
use pliant::springs::lattice::{LatticeSettings, LatticeShape};
use pliant::springs::patterns::{self, at_rest};
use pliant::springs::{Neighbours, SpringSystem, Springs, format};

/// Assumed memory if the operating system does not report it [bytes].
const MEMORY: u64 = 8 << 30;

/// Memory of a point and of a spring during construction and run, including the results [bytes].
const POINT_BYTES: u64 = 640;
const SPRING_BYTES: u64 = 200;

/// A system, ready to run.
pub(super) struct Built {
    /// Name of the system, for the folder.
    pub(super) name: String,
    /// The system, at rest.
    pub(super) system: SpringSystem,
    /// Ends of each spring.
    pub(super) lines: Vec<[u32; 2]>,
    /// Rest length of each spring [m].
    pub(super) rest: Vec<f64>,
    /// Triangles of its surface.
    pub(super) triangles: Vec<[u32; 3]>,
    /// Neighbours in a lattice; for a file the most similar kind.
    pub(super) neighbours: Neighbours,
    /// Notes for the user.
    pub(super) notes: Vec<String>,
    surface: Vec<u32>,
    body: Option<DampedBody>,
}

/// Reads "50x50x50".
pub(super) fn sides(text: &str) -> Result<[usize; 3], String> {
    let wrong = || "expected three numbers of points, such as 50x50x50".to_owned();
    let sides: Vec<usize> = text
        .split('x')
        .map(str::parse)
        .collect::<Result<_, _>>()
        .map_err(|_| wrong())?;
    sides.try_into().map_err(|_| wrong())
}

/// Available memory [bytes].
fn memory() -> u64 {
    let text = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let line = text
        .lines()
        .find_map(|line| line.strip_prefix("MemAvailable:"));
    let kilobytes = line.and_then(|rest| rest.split_whitespace().next()?.parse::<u64>().ok());
    kilobytes
        .and_then(|k| k.checked_mul(1024))
        .unwrap_or(MEMORY)
}

impl Built {
    /// The system of a file, each point of `mass` [kg].
    pub(super) fn of_file(path: &Path, mass: f64) -> Result<Self, Failure> {
        let file = format::read(path).map_err(|e| LoadError::from(Box::new(e)))?;
        let unfit = |e: &dyn std::fmt::Display| {
            Failure::usage(format!("{}: {e}", path.display()), "correct the file")
        };
        let springs = file.springs().map_err(|e| unfit(&e))?;
        let mut system = SpringSystem::new(file.position.clone(), vec![mass; file.position.len()])
            .map_err(|e| unfit(&e))?;
        let body = Some(body(&system, &springs, mass));
        let (lines, rest) = parts(&springs);
        // An inner point of a lattice has three springs of its own for 6 neighbours, thirteen for
        // 26.
        let dense = lines.len() > 6 * system.len();
        system.add(springs).map_err(|e| unfit(&e))?;
        let surface = (0u32..)
            .zip(&file.surface)
            .filter(|(_, s)| **s)
            .map(|(p, _)| p)
            .collect();
        let mut notes = file.notes;
        notes.push("numbers of the file have no units: read as m, kg, s".to_owned());
        let name = path
            .file_stem()
            .map_or("springs".to_owned(), |n| n.to_string_lossy().into_owned());
        let neighbours = if dense {
            Neighbours::TwentySix
        } else {
            Neighbours::Six
        };
        Ok(Self {
            name,
            system,
            lines,
            rest,
            triangles: file.triangles,
            neighbours,
            notes,
            surface,
            body,
        })
    }

    /// A lattice of stiffness 1/L.
    pub(super) fn of_lattice(
        points: [usize; 3],
        neighbours: Neighbours,
        side: f64,
        mass: f64,
    ) -> Result<Self, Failure> {
        let usage = |e: &dyn std::fmt::Display| {
            Failure::usage(
                e.to_string(),
                "give another --lattice, such as 50x50x50, or --side",
            )
        };
        if let Some(few) = points.iter().find(|n| **n < 2) {
            return Err(usage(&format!(
                "a lattice needs at least 2 points along each side, not {few}"
            )));
        }
        let shape = LatticeShape::with_longest_side(points, side).map_err(|e| usage(&e))?;
        let settings = LatticeSettings {
            mass,
            ..LatticeSettings::new(neighbours)
        };
        // A lattice has at most 2^30 points and 13 springs each: neither product overflows.
        let needed =
            shape.count() as u64 * POINT_BYTES + neighbours.springs(points) as u64 * SPRING_BYTES;
        let memory = memory();
        if needed > memory {
            let gib = |bytes: u64| bytes as f64 / f64::from(1 << 30);
            let message = format!(
                "such a lattice needs {:.1} GiB of memory, {:.1} are free",
                gib(needed),
                gib(memory)
            );
            return Err(usage(&message));
        }
        let x = shape.positions();
        let edges = patterns::lattice(&shape, neighbours);
        let springs = Springs::new(
            x.len(),
            at_rest(&x, edges, |length| settings.stiffness.of(length)),
        );
        let springs = springs.map_err(|e| usage(&e))?;
        let mut system = SpringSystem::new(x, vec![mass; shape.count()]).map_err(|e| usage(&e))?;
        let (lines, rest) = parts(&springs);
        system.add(springs).map_err(|e| usage(&e))?;
        let [a, b, c] = points;
        Ok(Self {
            name: format!("lattice-{a}x{b}x{c}-{}", neighbours.count()),
            system,
            lines,
            rest,
            triangles: Vec::new(),
            neighbours,
            notes: Vec::new(),
            surface: shape.surface(),
            body: settings.body(&shape),
        })
    }

    /// The damping (7.2) [N s/m]; `None` if the springs have no length.
    pub(super) fn estimate(&self) -> Option<f64> {
        let estimate = damping::estimate(self.neighbours, self.body?);
        Some(estimate).filter(|c| c.is_finite() && *c > 0.0)
    }

    /// Moves the surface towards the centre by a share, and fixes it if `hold` is true.
    pub(super) fn disturb(&mut self, share: f64, hold: bool) {
        let bounds = Aabb::of_points(&self.system.position);
        let centre = center(&bounds.min, &bounds.max);
        for &p in &self.surface {
            let x = &mut self.system.position[p as usize];
            *x = centre + (*x - centre) * (1.0 - share);
        }
        if hold {
            self.system.pin(self.surface.iter().copied());
        }
        if self.surface.is_empty() {
            self.notes.push(
                "no point is one of the surface: nothing is disturbed and nothing held".to_owned(),
            );
        }
    }

    /// Positions of the springs at rest.
    pub(super) fn positions(&self) -> &[Point3<f64>] {
        &self.system.position
    }
}

/// Ends and rest length of each spring.
fn parts(springs: &Springs) -> (Vec<[u32; 2]>, Vec<f64>) {
    springs
        .springs()
        .iter()
        .map(|(ends, law)| (*ends, law.rest))
        .unzip()
}

/// Input of the damping estimate: means over the springs, and the longest side of all points.
fn body(system: &SpringSystem, springs: &Springs, mass: f64) -> DampedBody {
    let count = springs.springs().len() as f64;
    let mean = |value: &dyn Fn(f64, f64) -> f64| {
        springs
            .springs()
            .iter()
            .map(|(_, law)| value(law.rest, law.stiffness))
            .sum::<f64>()
            / count
    };
    let tension = mean(&|rest, stiffness| rest * stiffness);
    let spacing = mean(&|rest, _| rest);
    DampedBody {
        mass,
        tension,
        side: Aabb::of_points(&system.position).extents().max(),
        spacing,
    }
}
