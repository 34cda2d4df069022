//! The numbers of a run of muscles, computed anew from the frames that it wrote: by a reader, distances,
//! winding numbers and crossings of this file, in sums over all pairs, with nothing of the library.
//!
//! Residuals, vertices that touch or are pinched, cut speeds and the error estimate are not in frames.

use std::collections::BTreeMap;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};

use pliant::io::{self, Encoding};
use pliant::mesh::TriangleMesh;
use pliant::mesh::shapes::{box_surface, icosphere};
use serde_json::Value;

use super::{Scratch, json, run, shown, text};
use shape::{Shape, Vector, along, cross, dot, hit, norm, sub};

mod shape;

const FRAMES: usize = 24;
const MUSCLES: [&str; 2] = ["first", "second"];
const BONES: [&str; 3] = ["floor", "arm", "post"];
const DENSITY: f64 = 1060.0;
/// Relative errors of sums in another order.
const ROUNDING: f64 = 1e-9;
/// Deeper than this a vertex is inside [m]: docs/summary.md.
const INSIDE: f64 = 1e-5;

/// A box on a bone and a ball under another one, which turns: the ball runs into the box, and the bone
/// into both, where nothing keeps them apart. It also runs into a third bone.
fn scene(scratch: &Scratch, effects: &str) -> String {
    let write = |name: &str, mut mesh: TriangleMesh, by: Vector| {
        let move_one = |p: &mut nalgebra::Point3<f64>| *p += nalgebra::Vector3::from(by);
        mesh.vertices.iter_mut().for_each(move_one);
        let path = scratch.join(format!("{name}.ply"));
        io::write(&path, &mesh, &[], Encoding::Binary).unwrap();
    };
    write(
        "floor",
        box_surface([0.12, 0.12, 0.02], 0.03),
        [0.0, 0.0, -0.0605],
    );
    write(
        "arm",
        box_surface([0.12, 0.12, 0.02], 0.03),
        [0.11, 0.0, 0.0605],
    );
    write(
        "post",
        box_surface([0.03, 0.08, 0.06], 0.03),
        [0.02, 0.003, 0.086],
    );
    write("first", box_surface([0.1; 3], 0.02), [0.0; 3]);
    write("second", icosphere(0.05, 2), [0.11, 0.003, 0.0]);
    let bone =
        |name: &str| format!("[[bone]]\nname = \"{name}\"\nmesh = \"{name}.ply\"\nunit = \"m\"\n");
    let muscle = |name: &str, bone: &str| {
        format!(
            "[[muscle]]\nname = \"{name}\"\nmesh = \"{name}.ply\"\nunit = \"m\"\n\
             [muscle.material]\ndensity = \"{DENSITY} kg/m3\"\nstretch = \"300 N/m\"\nbulk = \"20 kPa\"\n\
             [[muscle.attachment]]\nbone = \"{bone}\"\nnear = \"4 mm\"\n"
        )
    };
    let text = format!(
        "frames = {FRAMES}\nframe_rate = \"60 Hz\"\n{}{}\
         [bone.motion]\ncentre = [\"110 mm\", \"0 mm\", \"300 mm\"]\n\
         axis = [0, 1, 0]\ninterpolation = \"linear\"\n\
         keys = [{{ frame = 0 }}, {{ frame = {FRAMES}, angle = \"0.15 rad\" }}]\n{}{}{}\
         [solver.xpbd]\nsubsteps = 40\n[effects.stretch]\n{effects}",
        bone(BONES[0]),
        bone(BONES[1]),
        bone(BONES[2]),
        muscle(MUSCLES[0], BONES[0]),
        muscle(MUSCLES[1], BONES[1]),
    );
    let path = scratch.join("scene.toml");
    fs::write(&path, text).unwrap();
    shown(&path).to_owned()
}

fn greatest(all: impl IntoIterator<Item = f64>) -> f64 {
    let each = all.into_iter();
    each.fold(0.0, |a, b| if b <= a { a } else { b })
}

/// The number that a share of all does not exceed.
fn quantile(mut all: Vec<f64>, share: f64) -> f64 {
    all.sort_by(f64::total_cmp);
    all[(share * (all.len() - 1) as f64).round() as usize]
}

fn assert_near(what: &str, found: f64, wanted: f64, tolerance: f64) {
    let size = wanted.abs().max(f64::MIN_POSITIVE);
    assert!(
        (found - wanted).abs() <= tolerance * size.max(tolerance),
        "{what}: {found:?} in the result, {wanted:?} anew"
    );
}

/// All frames of a run: of each frame the muscles and the bones.
struct Run {
    summary: Value,
    rows: Vec<BTreeMap<String, String>>,
    frames: Vec<[Vec<Shape>; 2]>,
}

impl Run {
    fn of(effects: &str, scratch: &Scratch) -> Self {
        let out = scratch.join("out");
        let done = run(&[
            "run",
            &scene(scratch, effects),
            "--out",
            shown(&out),
            "--exact",
            "--quiet",
        ]);
        assert!(
            matches!(done.status.code(), Some(0 | 1)),
            "{}",
            text(&done.stderr)
        );
        let summary = json(&out.join("summary.json"));
        // The exit code tells whether all checks passed.
        let passed = summary["passed"].as_bool().unwrap();
        assert_eq!(done.status.code(), Some(i32::from(!passed)));
        let table = fs::read_to_string(out.join("measures.csv")).unwrap();
        let mut lines = table.lines();
        let names: Vec<&str> = lines.next().unwrap().split(',').collect();
        let row = |line: &str| {
            let cells = line.split(',').map(str::to_owned);
            names.iter().map(|n| (*n).to_owned()).zip(cells).collect()
        };
        let read = |name: &str, frame: usize| {
            let path = |frame: usize| out.join(format!("frames/{name}_{frame:04}.vtp"));
            // A bone that rests has one file.
            let frame = if path(frame).exists() { frame } else { 0 };
            Shape::read(&path(frame))
        };
        let bone = BONES.map(|name| format!("bone_{name}"));
        Self {
            rows: lines.map(row).collect(),
            frames: (0..=FRAMES)
                .map(|f| {
                    [
                        MUSCLES.iter().map(|name| read(name, f)).collect(),
                        bone.iter().map(|name| read(name, f)).collect(),
                    ]
                })
                .collect(),
            summary,
        }
    }

    /// A cell of the table of measures.
    fn cell(&self, frame: usize, muscle: usize, column: &str) -> f64 {
        let row = &self.rows[frame * MUSCLES.len() + muscle];
        assert_eq!(row["muscle"], MUSCLES[muscle]);
        assert_eq!(row["frame"], frame.to_string());
        row[column].parse().unwrap()
    }

    fn of_muscle(&self, muscle: usize, key: &str) -> f64 {
        let path = format!("/muscles/muscles/{muscle}/{key}");
        let value = self.summary.pointer(&path).and_then(Value::as_f64);
        value.unwrap_or_else(|| panic!("{path}"))
    }

    /// The turn of the arm about its centre.
    fn compare_poses(&self) {
        let [rest, end] = [0, FRAMES].map(|f| &self.frames[f][1][1]);
        let (sin, cos) = 0.15_f64.sin_cos();
        for (p, q) in rest.x.iter().zip(&end.x) {
            let [x, y, z] = sub(*p, [0.11, 0.0, 0.3]);
            let turned = [cos * x + sin * z + 0.11, y, cos * z - sin * x + 0.3];
            assert!(norm(sub(*q, turned)) <= ROUNDING, "{q:?}, not {turned:?}");
        }
    }

    /// Each measure of a frame, and their extremes in the summary.
    fn compare_measures(&self, muscle: usize, pressure: Option<f64>) {
        let rest = &self.frames[0][0][muscle];
        let edges = rest.edges();
        let length = |x: &[Vector], [a, b]: [usize; 2]| norm(sub(x[a], x[b]));
        let masses = masses(rest);
        let mut columns: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
        for (frame, [muscles, bones]) in self.frames.iter().enumerate() {
            let now = &muscles[muscle];
            let strain = |e: &[usize; 2]| (length(&now.x, *e) / length(&rest.x, *e) - 1.0).abs();
            let strains: Vec<f64> = edges.iter().map(strain).collect();
            let squares = strains.iter().map(|s| s * s).sum::<f64>();
            let ratio = now.volume() / rest.volume();
            let free = (0..now.x.len()).filter(|v| !now.is_held(*v));
            let depths = free.flat_map(|v| {
                let inside = bones.iter().filter(move |bone| bone.contains(now.x[v]));
                inside.map(move |bone| bone.distance(now.x[v]))
            });
            let depths: Vec<f64> = depths.collect();
            let inner = bones.iter().flat_map(|bone| &bone.x);
            let ways = now
                .x
                .iter()
                .zip(&rest.x)
                .map(|(a, b)| norm(sub(*a, *b)).powi(2));
            let speeds = now.fields["speed_m_s"].iter().zip(&masses);
            let measured = [
                ("volume_ratio", ratio),
                ("volume_error", pressure.map_or(0.0, |p| ratio / p - 1.0)),
                ("edge_stretch_rms", (squares / edges.len() as f64).sqrt()),
                ("edge_stretch_max", greatest(strains)),
                ("penetration_m", greatest(depths.iter().copied())),
                (
                    "vertices_inside_bones",
                    depths.iter().filter(|d| **d > INSIDE).count() as f64,
                ),
                (
                    "bone_vertices_inside",
                    inner.filter(|p| now.contains(**p)).count() as f64,
                ),
                (
                    "distance_from_start_rms_m",
                    (ways.sum::<f64>() / now.x.len() as f64).sqrt(),
                ),
                (
                    "kinetic_energy_j",
                    speeds.map(|(v, m)| 0.5 * m * v * v).sum(),
                ),
                ("time_s", frame as f64 / 60.0),
            ];
            for (column, wanted) in measured {
                let found = self.cell(frame, muscle, column);
                assert_near(
                    &format!("{column} in frame {frame}"),
                    found,
                    wanted,
                    ROUNDING,
                );
                columns.entry(column).or_default().push(wanted);
            }
        }
        let size = |k: usize| {
            let each = || rest.x.iter().map(|p| p[k]);
            each().fold(f64::NEG_INFINITY, f64::max) - each().fold(f64::INFINITY, f64::min)
        };
        // Frame 0 is the start, of which nothing has been computed.
        let of = |column: &str| columns[column][1..].iter().map(|c| c.abs());
        let end = |column: &str| columns[column][FRAMES];
        let held = (0..rest.x.len()).filter(|v| rest.is_held(*v)).count();
        for (key, wanted) in [
            ("length_m", greatest((0..3).map(size))),
            ("vertices", rest.x.len() as f64),
            ("triangles", rest.triangles.len() as f64),
            ("vertices_attached", held as f64),
            ("edge_stretch_max", greatest(of("edge_stretch_max"))),
            ("edge_stretch_rms_worst", greatest(of("edge_stretch_rms"))),
            ("edge_stretch_rms_end", end("edge_stretch_rms")),
            ("volume_error_max", greatest(of("volume_error"))),
            ("volume_error_end", end("volume_error")),
            ("penetration_max_m", greatest(of("penetration_m"))),
            (
                "vertices_inside_bones_max",
                greatest(of("vertices_inside_bones")),
            ),
            (
                "bone_vertices_inside_max",
                greatest(of("bone_vertices_inside")),
            ),
            (
                "distance_from_start_rms_m",
                end("distance_from_start_rms_m"),
            ),
        ] {
            assert_near(key, self.of_muscle(muscle, key), wanted, ROUNDING);
        }
    }

    /// The motion as an anatomist judges it: docs/summary.md, Quality.
    fn compare_quality(&self, muscle: usize) {
        let of = |frame: usize| &self.frames[frame][0][muscle];
        let rest = of(0);
        let [held, free]: [Vec<usize>; 2] = [true, false].map(|held| {
            let all = 0..rest.x.len();
            all.filter(|v| rest.is_held(*v) == held).collect()
        });
        let frames: Vec<&[Vector]> = (0..=FRAMES).map(|f| &of(f).x[..]).collect();
        let speed = |of: &[usize]| {
            let ways = frames
                .windows(2)
                .flat_map(|w| of.iter().map(|&v| norm(sub(w[1][v], w[0][v]))));
            greatest(ways)
        };
        if speed(&held) > 0.0 {
            let found = self.of_muscle(muscle, "quality/snap_ratio");
            assert_near("snap", found, speed(&free) / speed(&held), ROUNDING);
        }
        let jitter = frames.windows(7).filter_map(|window| {
            let away = |of: &[usize]| {
                greatest(of.iter().map(|&v| {
                    let off = |k: usize| {
                        window
                            .iter()
                            .map(|x| x[v][k] - window[3][v][k])
                            .sum::<f64>()
                    };
                    norm([0, 1, 2].map(off)) / 7.0
                }))
            };
            let way = greatest(held.iter().map(|&v| norm(sub(window[6][v], window[0][v]))));
            (way > 0.0 && away(&held) <= 0.01 * way).then(|| (away(&free) - away(&held)).max(0.0))
        });
        let jitter: Vec<f64> = jitter.collect();
        // What a bone at rest holds has none.
        assert_eq!(jitter.is_empty(), muscle == 0);
        if !jitter.is_empty() {
            let found = self.of_muscle(muscle, "quality/jitter_m");
            assert_near("jitter", found, greatest(jitter), ROUNDING);
        } else {
            let path = format!("/muscles/muscles/{muscle}/quality/jitter_m");
            assert_eq!(self.summary.pointer(&path), Some(&Value::Null));
        }
        let folds = |shape: &Shape| -> Vec<f64> {
            let mut sides: BTreeMap<[usize; 2], [usize; 3]> = BTreeMap::new();
            let all = shape.triangles.iter();
            all.for_each(|t| {
                (0..3).for_each(|k| {
                    sides.insert([t[k], t[(k + 1) % 3]], *t);
                })
            });
            let normal = |t: &[usize; 3]| {
                let [a, b, c] = shape.corners(t);
                let n = cross(sub(b, a), sub(c, a));
                n.map(|c| c / norm(n))
            };
            let both = sides.iter().filter(|([a, b], _)| a < b);
            both.map(|([a, b], t)| {
                let other = &sides[&[*b, *a]];
                let corners = t.iter().chain(other);
                match corners.into_iter().all(|v| shape.is_held(*v)) {
                    true => f64::NEG_INFINITY,
                    false => {
                        let (n, m) = (normal(t), normal(other));
                        norm(cross(n, m)).atan2(dot(n, m)).to_degrees()
                    }
                }
            })
            .collect()
        };
        let at_rest = folds(rest);
        let grown = (0..=FRAMES).flat_map(|f| {
            let now = folds(of(f));
            let each = now.into_iter().zip(&at_rest);
            each.map(|(now, rest)| now - (rest - 50.0).max(0.0))
                .collect::<Vec<f64>>()
        });
        let found = self.of_muscle(muscle, "quality/hinge_max_deg");
        assert_near("fold", found, greatest(grown), 1e-6);
        let looked_at = [0, 10, 20, FRAMES];
        let thin = looked_at.map(|f| thickness(of(f), &free));
        let least = thin.into_iter().min_by(f64::total_cmp).unwrap();
        let found = self.of_muscle(muscle, "quality/thickness_ratio_min");
        // Rays begin a little below the surface.
        assert_near("thickness", found, least / thickness(rest, &free), 1e-4);
        self.compare_lift_off(muscle, &free, &looked_at);
    }

    fn compare_lift_off(&self, muscle: usize, free: &[usize], frames: &[usize]) {
        let length = self.of_muscle(muscle, "length_m");
        let nearest = |frame: usize, v: usize| {
            let [muscles, bones] = &self.frames[frame];
            let distances = bones.iter().map(|bone| bone.distance(muscles[muscle].x[v]));
            distances.min_by(f64::total_cmp).unwrap()
        };
        let on_bone: Vec<usize> = free
            .iter()
            .copied()
            .filter(|v| nearest(0, *v) <= 0.015 * length)
            .collect();
        let lifted = frames.iter().map(|&f| {
            quantile(
                on_bone
                    .iter()
                    .map(|v| nearest(f, *v) - nearest(0, *v))
                    .collect(),
                0.95,
            )
        });
        let path = format!("/muscles/muscles/{muscle}/quality/lift_off_m");
        match self.summary.pointer(&path).and_then(Value::as_f64) {
            Some(found) => assert_near("lift-off", found, greatest(lifted), 1e-6),
            None => assert!(on_bone.is_empty() || !self.touches(), "{path}"),
        }
    }

    fn touches(&self) -> bool {
        let run = self.summary["effects"]["run"].to_string();
        run.contains("contact")
    }

    /// The crossings and shared volumes of every tenth frame and the last.
    fn compare_audit(&self) {
        let mut worst: BTreeMap<&str, f64> = BTreeMap::new();
        let mut most = |key: &'static str, value: f64| {
            let entry = worst.entry(key).or_default();
            *entry = greatest([*entry, value]);
        };
        for frame in [0, 10, 20, FRAMES] {
            let [muscles, bones] = &self.frames[frame];
            let soft = muscles[0].crossings(&muscles[1]);
            let pairs = || {
                muscles
                    .iter()
                    .flat_map(|m| bones.iter().map(move |b| (m, b)))
            };
            let rigid = pairs().map(|(m, b)| m.crossings(b)).sum::<usize>();
            most("crossings_max/soft_soft", soft as f64);
            most("crossings_max/soft_rigid", rigid as f64);
            most("crossings_max/all", (soft + rigid) as f64);
            let deep = |x: &[Vector], of: &Shape| {
                let deep = x
                    .iter()
                    .filter(|p| of.contains(**p) && of.distance(**p) > INSIDE);
                deep.count()
            };
            let inside = |x: &[Vector], of: &Shape| x.iter().filter(|p| of.contains(**p)).count();
            let in_bones = pairs().map(|(m, b)| deep(&m.x, b)).sum::<usize>();
            most("vertices_inside_bones_max", in_bones as f64);
            let of_bones = pairs().map(|(m, b)| inside(&b.x, m)).sum::<usize>();
            most("bone_vertices_inside_max", of_bones as f64);
            let between = inside(&muscles[0].x, &muscles[1]) + inside(&muscles[1].x, &muscles[0]);
            most("vertices_inside_muscles_max", between as f64);
            most("shared_volume_max_m3", shared(&muscles[0], &muscles[1]));
            most("rigid_depth_max", self.growth(frame));
        }
        for (key, wanted) in worst {
            let path = format!("/audit/{key}");
            let found = self.summary.pointer(&path).and_then(Value::as_f64);
            // Both integrals over lines have an error of a hundredth.
            let tolerance = if key.starts_with("shared") {
                0.02
            } else {
                ROUNDING
            };
            assert_near(
                key,
                found.unwrap_or_else(|| panic!("{path}")),
                wanted,
                tolerance,
            );
        }
    }

    /// How much deeper than in the first frame two bones are in each other, relative to the smaller one.
    fn growth(&self, frame: usize) -> f64 {
        let deepest = |x: &Shape, of: &Shape| {
            let inside = x.x.iter().filter(|p| of.contains(**p));
            greatest(inside.map(|p| of.distance(*p)))
        };
        let side = |bone: &Shape| {
            let along = |k: usize| {
                let all = || bone.x.iter().map(|p| p[k]);
                all().fold(f64::MIN, f64::max) - all().fold(f64::MAX, f64::min)
            };
            greatest((0..3).map(along))
        };
        let [rest, now] = [0, frame].map(|f| &self.frames[f][1]);
        let pairs = (0..now.len()).flat_map(|j| (0..j).map(move |i| (i, j)));
        greatest(pairs.map(|(i, j)| {
            let depth = |all: &[Shape]| deepest(&all[i], &all[j]).max(deepest(&all[j], &all[i]));
            (depth(now) - depth(rest)) / side(&rest[i]).min(side(&rest[j]))
        }))
    }

    /// Each verdict with a number and a limit says which is greater.
    fn compare_verdicts(&self) {
        let verdicts = self.summary["verdicts"].as_array().unwrap();
        let passed = |verdict: &Value| verdict["passed"].as_bool().unwrap();
        for verdict in verdicts {
            let number = |key: &str| verdict[key].as_f64();
            if let (Some(value), Some(limit)) = (number("value"), number("limit")) {
                let is_least = verdict["name"].as_str().unwrap().starts_with("least");
                let wanted = if is_least {
                    value >= limit
                } else {
                    value <= limit
                };
                assert_eq!(passed(verdict), wanted, "{verdict}");
            }
        }
        let converged = self.summary["converged"].as_bool().unwrap();
        let all = verdicts.iter().all(passed);
        assert!(!self.summary["passed"].as_bool().unwrap() || (all && converged));
        assert_eq!(self.summary["passed"].as_bool().unwrap(), all);
    }
}

/// The masses of vertices: by area.
fn masses(rest: &Shape) -> Vec<f64> {
    let area = |t: &[usize; 3]| {
        let [a, b, c] = rest.corners(t);
        0.5 * norm(cross(sub(b, a), sub(c, a)))
    };
    let total: f64 = rest.triangles.iter().map(area).sum();
    let mut masses = vec![0.0; rest.x.len()];
    for t in &rest.triangles {
        let share = DENSITY * rest.volume() * area(t) / (3.0 * total);
        t.iter().for_each(|&v| masses[v] += share);
    }
    // What a bone holds has no mass of its own.
    let each = masses.iter_mut().enumerate();
    each.filter(|(v, _)| rest.is_held(*v))
        .for_each(|(_, m)| *m = 0.0);
    masses
}

/// The thickness that a hundredth of the free vertices has at most: along the mean normal, weighted by
/// areas, to the other side.
fn thickness(shape: &Shape, free: &[usize]) -> f64 {
    let mut normals = vec![[0.0; 3]; shape.x.len()];
    for t in &shape.triangles {
        let corners = shape.corners(t);
        let n = cross(sub(corners[1], corners[0]), sub(corners[2], corners[0]));
        t.iter()
            .for_each(|&v| normals[v] = along(normals[v], 1.0, n));
    }
    let ways = free.iter().filter_map(|&v| {
        let inwards = normals[v].map(|c| -c / norm(normals[v]));
        let from = along(shape.x[v], 1e-8, inwards);
        shape.first_hit(from, inwards)
    });
    quantile(ways.collect(), 0.01)
}

/// The volume that two surfaces share [m^3]: an integral over lines along z.
fn shared(a: &Shape, b: &Shape) -> f64 {
    let ends = |k: usize, pick: fn(f64, f64) -> f64| {
        let of = |s: &Shape| s.x.iter().map(|p| p[k]).reduce(pick).unwrap();
        [of(a), of(b)]
    };
    let range = |k: usize| {
        let [low, high] = [ends(k, f64::min), ends(k, f64::max)];
        [low[0].max(low[1]), high[0].min(high[1])]
    };
    let [x, y] = [range(0), range(1)];
    if !(x[0] < x[1] && y[0] < y[1]) {
        return 0.0;
    }
    const LINES: usize = 150;
    let step = |[low, high]: [f64; 2]| (high - low) / LINES as f64;
    let intervals = |shape: &Shape, at: Vector| {
        let each = shape.triangles.iter();
        let hits = each.filter_map(|t| hit(at, [0.0, 0.0, 1.0], shape.corners(t)));
        let mut hits: Vec<f64> = hits.collect();
        hits.sort_by(f64::total_cmp);
        hits.chunks_exact(2)
            .map(|c| [c[0], c[1]])
            .collect::<Vec<_>>()
    };
    let mut sum = 0.0;
    for i in 0..LINES {
        for j in 0..LINES {
            let at = [
                x[0] + (i as f64 + 0.5) * step(x),
                y[0] + (j as f64 + 0.5) * step(y),
                0.0,
            ];
            let (first, second) = (intervals(a, at), intervals(b, at));
            let both = first
                .iter()
                .flat_map(|p| second.iter().map(move |q| p[1].min(q[1]) - p[0].max(q[0])));
            sum += both.map(|length| length.max(0.0)).sum::<f64>();
        }
    }
    sum * step(x) * step(y)
}

#[test]
fn what_a_run_reports_is_in_its_frames() {
    let contact =
        |between: &str| format!("[effects.contact]\nthickness = \"0.5 mm\"\nbetween = {between}\n");
    let pressed = "[effects.volume]\npressure = 1.05\n[effects.bending]\n\
                   [effects.damping]\nrate = \"5 1/s\"\n";
    let among = |between: &str| (format!("{pressed}{}", contact(between)), Some(1.05));
    for (effects, pressure) in [
        // Nothing keeps surfaces apart: the measures of what is wrong are not zero.
        (String::new(), None),
        among("[\"bones\"]"),
        among("[\"bones\", \"muscles\"]"),
    ] {
        let scratch = Scratch::folder();
        let mut run = Run::of(&effects, &scratch);
        run.compare_poses();
        for muscle in 0..MUSCLES.len() {
            run.compare_measures(muscle, pressure);
            run.compare_quality(muscle);
        }
        run.compare_audit();
        run.compare_verdicts();
        let inside = |run: &Run| {
            (0..2)
                .map(|m| run.of_muscle(m, "vertices_inside_bones_max"))
                .sum::<f64>()
        };
        let depth = run.summary.pointer("/audit/rigid_depth_max");
        assert!(depth.and_then(Value::as_f64) > Some(0.005), "bones meet");
        assert_eq!(
            inside(&run) > 0.0,
            pressure.is_none(),
            "the scene shows both"
        );
        let lift = run.summary.pointer("/muscles/muscles/0/quality/lift_off_m");
        assert_eq!(lift.is_some_and(Value::is_f64), pressure.is_some());
        // Control: a vertex of one frame elsewhere by a micrometre.
        let free = (0..).find(|v| !run.frames[7][0][0].is_held(*v)).unwrap();
        run.frames[7][0][0].x[free][0] += 1e-6;
        let compared = catch_unwind(AssertUnwindSafe(|| run.compare_measures(0, pressure)));
        assert!(compared.is_err());
    }
}
