//! `pliant fibres`: files, numbers, smoothing, lines on the surface, frames, refusals.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use nalgebra::{Point3, Vector3};
use pliant::io::{Encoding, write};
use pliant::mesh::TriangleMesh;
use pliant::mesh::measures::max_or_nan;
use pliant::mesh::shapes::{box_surface, tube};
use serde_json::Value;

use super::{Scratch, json, measures, names_in, pliant, run, shown, text};

/// Radius and length of the muscle [m].
const RADIUS: f64 = 0.02;
const LENGTH: f64 = 0.2;

fn put(path: &Path, mesh: &TriangleMesh, lines: &[Vec<u32>]) {
    write(path, mesh, lines, Encoding::Text).expect("written");
}

fn list(vertices: &[u32]) -> String {
    format!(
        "[{}]",
        vertices
            .iter()
            .map(u32::to_string)
            .collect::<Vec<_>>()
            .join(",")
    )
}

/// Vertices of the flat end of a tube at x.
fn end(mesh: &TriangleMesh, x: f64) -> Vec<u32> {
    let at = |v: &u32| (mesh.vertices[*v as usize].x - x).abs() <= 1e-9;
    (0..mesh.vertices.len() as u32).filter(at).collect()
}

/// A cylinder along x in a file, its ends as lists.
struct Cylinder {
    scratch: Scratch,
    file: PathBuf,
    mesh: TriangleMesh,
    ends: [String; 2],
}

impl Cylinder {
    fn new() -> Self {
        let scratch = Scratch::folder();
        let mesh = tube(RADIUS, LENGTH, 24);
        let file = scratch.join("cylinder.obj");
        put(&file, &mesh, &[]);
        let ends = [-0.5, 0.5].map(|x| list(&end(&mesh, x * LENGTH)));
        Self {
            scratch,
            file,
            mesh,
            ends,
        }
    }

    /// Runs with both ends as areas and `more`, into a folder of a name.
    fn run(&self, into: &str, more: &[&str]) -> (std::process::Output, PathBuf) {
        let out = self.scratch.join(into);
        let [origin, insertion] = &self.ends;
        let areas = [
            "fibres",
            shown(&self.file),
            "--unit",
            "m",
            "--origin",
            origin,
            "--insertion",
            insertion,
        ];
        (
            run(&[&areas[..], &["--out", shown(&out)], more].concat()),
            out,
        )
    }
}

fn of(value: &Value, key: &str) -> f64 {
    value[key]
        .as_f64()
        .unwrap_or_else(|| panic!("{key} is no number in {value}"))
}

/// Points of each fibre, from points.csv.
fn points(out: &Path) -> Vec<Vec<Point3<f64>>> {
    let mut fibres: Vec<Vec<Point3<f64>>> = Vec::new();
    for line in fs::read_to_string(out.join("points.csv"))
        .expect("points")
        .lines()
        .skip(1)
    {
        let cells: Vec<&str> = line.split(',').collect();
        let fibre: usize = cells[0].parse().expect("a number");
        fibres.resize(fibres.len().max(fibre + 1), Vec::new());
        let [x, y, z] = [2, 3, 4].map(|k| cells[k].parse().expect("a coordinate"));
        fibres[fibre].push(Point3::new(x, y, z));
    }
    fibres
}

#[test]
fn a_cylinder_is_filled() {
    let muscle = Cylinder::new();
    let (done, out) = muscle.run("out", &["--json"]);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let reported: Value = serde_json::from_slice(&done.stdout).expect("JSON");
    assert_eq!(reported, json(&out.join("summary.json")));
    let reported = measures(&reported);
    for key in [
        "fibres",
        "points",
        "outside",
        "outside_max_m",
        "end_distance_max_m",
        "tendon_length_max_m",
        "jacobian_min",
        "spacing_min_m",
        "coverage",
        "length_mean_m",
        "pennation_mean_deg",
        "decomposition_s",
    ] {
        assert!(reported[key].is_number(), "{key} in {reported}");
    }
    assert_eq!(
        (
            of(&reported, "fibres"),
            of(&reported, "points"),
            of(&reported, "outside")
        ),
        (100.0, 1500.0, 0.0)
    );
    assert!(
        (of(&reported, "length_mean_m") / LENGTH - 1.0).abs() <= 0.02,
        "{reported}"
    );
    assert!(
        of(&reported, "coverage") >= 0.95 && of(&reported, "jacobian_min") > 0.0,
        "{reported}"
    );
    let volume = muscle.mesh.volume();
    assert!(
        (of(&reported, "volume_m3") / volume - 1.0).abs() <= 1e-9,
        "{reported}"
    );
    let section = of(&reported, "volume_m3") / of(&reported, "length_mean_m");
    assert!(
        (of(&reported, "cross_section_m2") / section - 1.0).abs() <= 1e-12,
        "{reported}"
    );
    let names: BTreeSet<String> = names_in(&out).into_iter().collect();
    for name in [
        "fibres.vtp",
        "muscle.vtp",
        "fibres.csv",
        "points.csv",
        "summary.json",
        "broad.png",
        "narrow.png",
        "sections.png",
        "report.html",
    ] {
        assert!(names.contains(name), "{name} is not in {names:?}");
    }
    let fibres = pliant::io::read(&out.join("fibres.vtp")).expect("fibres");
    assert_eq!(
        (fibres.lines.len(), fibres.mesh.vertices.len()),
        (100, 1500)
    );
    assert_eq!(
        fs::read_to_string(out.join("fibres.csv"))
            .expect("a table")
            .lines()
            .count(),
        101
    );
    assert_eq!(points(&out).iter().map(Vec::len).sum::<usize>(), 1500);
    // The same in millimetres, and with other numbers of fibres.
    let (done, out) = muscle.run("few", &["--count", "7", "--points", "4"]);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    assert!(
        text(&done.stdout).contains("physiological cross-section"),
        "{}",
        text(&done.stdout)
    );
    assert_eq!(
        points(&out).iter().map(Vec::len).collect::<Vec<_>>(),
        [4; 7]
    );
}

#[test]
fn areas_in_all_their_forms() {
    let muscle = Cylinder::new();
    let join = |name: &str| muscle.scratch.join(name);
    // Two squares, the larger at the insertion; a bone off the origin; a list in a file.
    let mut patches = box_surface([0.0002, 0.03, 0.03], 0.01);
    patches
        .vertices
        .iter_mut()
        .for_each(|v| v.x += 0.5 * LENGTH);
    let mut small = box_surface([0.0002, 0.02, 0.02], 0.01);
    small
        .vertices
        .iter_mut()
        .for_each(|v| v.x -= 0.5 * LENGTH + 0.03);
    let first = patches.vertices.len() as u32;
    patches
        .triangles
        .extend(small.triangles.iter().map(|t| t.map(|v| v + first)));
    patches.vertices.extend(small.vertices);
    put(&join("patches.obj"), &patches, &[]);
    let mut bone = box_surface([0.02, 0.1, 0.1], 0.02);
    bone.vertices
        .iter_mut()
        .for_each(|v| v.x -= 0.5 * LENGTH + 0.013);
    put(&join("bone.obj"), &bone, &[]);
    let listed = end(&muscle.mesh, -0.5 * LENGTH)
        .iter()
        .map(u32::to_string)
        .collect::<Vec<_>>()
        .join("\n");
    fs::write(join("list.txt"), format!("# the origin\n{listed}\n")).expect("written");
    let (patches, bone, listed) = (join("patches.obj"), join("bone.obj"), join("list.txt"));
    let large = format!("{}#0", shown(&patches));
    let out = join("out");
    let reported = |origin: String| {
        let arguments = [
            "fibres",
            shown(&muscle.file),
            "--unit",
            "m",
            "--origin",
            &origin,
            "--insertion",
            &large,
        ];
        let done = run(&[
            &arguments[..],
            &["--json", "--count", "20", "--out", shown(&out)],
        ]
        .concat());
        assert_eq!(
            done.status.code(),
            Some(0),
            "{origin}: {}",
            text(&done.stderr)
        );
        measures(&serde_json::from_slice::<Value>(&done.stdout).expect("JSON"))
    };
    for origin in [
        format!("vertices:{}", shown(&listed)),
        format!("near:{},4mm", shown(&bone)),
    ] {
        let reported = reported(origin);
        assert_eq!(of(&reported, "tendon_length_max_m"), 0.0, "{reported}");
        assert!(
            (of(&reported, "length_mean_m") / LENGTH - 1.0).abs() <= 0.05,
            "{reported}"
        );
    }
    // The smaller square is 30 mm away from the muscle, so there are tendons.
    let reported = reported(format!("{}#1", shown(&patches)));
    assert!(
        of(&reported, "tendon_length_max_m") >= 0.029
            && of(&reported, "tendon_length_max_m") <= 0.05,
        "{reported}"
    );
    let lines = pliant::io::read(&out.join("fibres.vtp"))
        .expect("fibres")
        .lines;
    assert_eq!(lines.iter().filter(|line| line.len() == 2).count(), 20);
    assert_eq!(points(&out)[0].len(), 16);
    let page = fs::read_to_string(out.join("report.html")).expect("a page");
    assert!(
        page.contains("straight tendons"),
        "the page does not tell of tendons"
    );
}

#[test]
fn smoothing_shortens_and_keeps_ends() {
    let muscle = Cylinder::new();
    let (_, rough) = muscle.run("rough", &["--count", "20"]);
    let (done, smooth) = muscle.run(
        "smooth",
        &[
            "--count",
            "20",
            "--smooth-steps",
            "200",
            "--smooth-factor",
            "1",
        ],
    );
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let length = |out: &Path| of(&measures(&json(&out.join("summary.json"))), "length_mean_m");
    assert!(length(&smooth) < length(&rough));
    for (a, b) in points(&rough).iter().zip(&points(&smooth)) {
        assert_eq!((a[0], a[14]), (b[0], b[14]));
    }
    assert_eq!(
        of(&measures(&json(&smooth.join("summary.json"))), "outside"),
        0.0
    );
}

#[test]
fn springs_and_slices_fill_a_cylinder_by_a_template() {
    let muscle = Cylinder::new();
    let reported = |name: &str, more: &[&str]| {
        let (done, out) = muscle.run(name, &[more, &["--json"]].concat());
        let reported: Value = serde_json::from_slice(&done.stdout).expect("JSON");
        assert_eq!(reported, json(&out.join("summary.json")));
        assert_eq!(
            points(&out).iter().map(Vec::len).collect::<Vec<_>>(),
            [15; 100]
        );
        (done.status.code(), text(&done.stderr), measures(&reported))
    };
    // The first and the last slice lie a millionth of the length before the ends, so the check
    // succeeds.
    let (code, error, slices) = reported("slices", &["--method", "slices"]);
    assert_eq!(
        (code, &slices["method"], &slices["template"]),
        (Some(0), &"slices".into(), &"parallel".into()),
        "{error}"
    );
    assert!(
        (of(&slices, "length_mean_m") / LENGTH - 1.0).abs() <= 1e-5
            && of(&slices, "jacobian_min") > 0.0,
        "{slices}"
    );
    // Springs reach the areas, but cells fold near the middle, and the command reports this.
    let (code, error, springs) = reported(
        "springs",
        &["--method", "springs", "--template", "parallel"],
    );
    assert_eq!(
        (
            of(&springs, "outside"),
            of(&springs, "end_distance_max_m") <= 1e-9
        ),
        (0.0, true),
        "{springs}"
    );
    assert!(
        of(&springs, "jacobian_min") < 0.0 && code == Some(1),
        "{springs}"
    );
    assert!(
        error
            .contains("FAIL  fibres side by side stay so: least Jacobian of their map, above 0: -"),
        "{error}"
    );
    // Arches end on one side of a body, the areas are at both ends.
    let (code, error, curved) = reported("curved", &["--method", "slices", "--template", "curved"]);
    assert!(
        curved["template"] == "curved" && curved["length_mean_m"] != slices["length_mean_m"],
        "{curved}"
    );
    assert!(
        code == Some(1) && error.contains("FAIL  "),
        "{code:?} {error}"
    );
    // A surface with a hole is no sphere; slices and the harmonic method accept it.
    let mut open = muscle.mesh.clone();
    open.triangles.remove(open.triangles.len() / 2);
    put(&muscle.file, &open, &[]);
    let (done, out) = muscle.run("open", &["--method", "springs"]);
    let error = text(&done.stderr);
    assert_eq!(done.status.code(), Some(2), "{error}");
    for part in [
        "the muscle's surface has no map to the sphere: ",
        "use --method harmonic, which takes any surface",
    ] {
        assert!(error.contains(part), "{part} is not in {error}");
    }
    assert!(!out.exists());
    for method in ["slices", "harmonic"] {
        let (done, _) = muscle.run(method, &["--method", method]);
        assert_eq!(
            done.status.code(),
            Some(0),
            "{method}: {}",
            text(&done.stderr)
        );
    }
}

/// Points along a helix on the cylinder, `turn` [rad] from end to end, `reach` radii away from
/// its axis.
fn helix(start: f64, turn: f64, reach: f64) -> Vec<Point3<f64>> {
    let at = |s: f64| {
        let angle = start + turn * s;
        Point3::new(
            LENGTH * (s - 0.5),
            reach * RADIUS * angle.cos(),
            reach * RADIUS * angle.sin(),
        )
    };
    (0..=40).map(|k| at(f64::from(k) / 40.0)).collect()
}

fn put_lines(path: &Path, lines: &[Vec<Point3<f64>>]) {
    let vertices: Vec<Point3<f64>> = lines.concat();
    let numbers = |k: usize| (41 * k as u32..41 * (k as u32 + 1)).collect();
    put(
        path,
        &TriangleMesh {
            vertices,
            triangles: Vec::new(),
        },
        &(0..lines.len()).map(numbers).collect::<Vec<_>>(),
    );
}

/// Mean angle about x between two points of a fibre [rad].
fn mean_turn(fibres: &[Vec<Point3<f64>>]) -> f64 {
    let angle = |p: &Point3<f64>| p.z.atan2(p.y);
    let turned = |f: &Vec<Point3<f64>>| {
        f[2..=12]
            .windows(2)
            .map(|s| (angle(&s[1]) - angle(&s[0])).sin().asin())
            .sum::<f64>()
    };
    // Near the axis the angle is inaccurate.
    let far: Vec<&Vec<Point3<f64>>> = fibres
        .iter()
        .filter(|f| f[7].yz().coords.norm() >= 0.5 * RADIUS)
        .collect();
    far.iter().map(|f| turned(f)).sum::<f64>() / far.len() as f64
}

#[test]
fn lines_on_the_surface_are_followed_at_any_frame() {
    let muscle = Cylinder::new();
    let file = muscle.scratch.join("lines.vtp");
    // Every second line runs from the insertion to the origin, and all lie slightly off the
    // surface.
    let lines: Vec<Vec<Point3<f64>>> = (0..12)
        .map(|k| {
            let mut line = helix(std::f64::consts::TAU * f64::from(k) / 12.0, 1.0, 1.05);
            if k % 2 == 1 {
                line.reverse();
            }
            line
        })
        .collect();
    put_lines(&file, &lines);
    let follow = ["--method", "superficial", "--lines", shown(&file)];
    let (done, out) = muscle.run("out", &follow);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let summary = measures(&json(&out.join("summary.json")));
    assert_eq!(
        (of(&summary, "lines"), of(&summary, "outside")),
        (12.0, 0.0)
    );
    assert!(
        of(&summary, "lines_distance_max_m") >= 0.05 * RADIUS && of(&summary, "coverage") >= 0.95,
        "{summary}"
    );
    // Between the third and the thirteenth of fifteen points: ten fourteenths of the turn.
    let turn = mean_turn(&points(&out));
    assert!((turn / (10.0 / 14.0) - 1.0).abs() <= 0.2, "{turn}");
    let (_, straight) = muscle.run("straight", &[]);
    assert!(
        mean_turn(&points(&straight)).abs() <= 0.05,
        "control: without lines nothing turns"
    );
    // A frame in which the muscle is bent. The lines must follow it.
    let mut frame = muscle.mesh.clone();
    frame
        .vertices
        .iter_mut()
        .for_each(|v| v.y += 3.0 * v.x * v.x);
    let moved = muscle.scratch.join("frame.obj");
    put(&moved, &frame, &[]);
    let [origin, insertion] = &muscle.ends;
    let arguments = [
        "fibres",
        shown(&moved),
        "--unit",
        "m",
        "--origin",
        origin,
        "--insertion",
        insertion,
    ];
    let out = muscle.scratch.join("bent");
    let more = [
        "--rest",
        shown(&muscle.file),
        "--json",
        "--out",
        shown(&out),
    ];
    let done = run(&[&arguments[..], &follow, &more].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let mut fibres = points(&out);
    fibres
        .iter_mut()
        .flatten()
        .for_each(|p| p.y -= 3.0 * p.x * p.x);
    let turn = mean_turn(&fibres);
    assert!((turn / (10.0 / 14.0) - 1.0).abs() <= 0.3, "{turn}");
    // At rest the lines are 30 mm away from a bent muscle; without --rest the command notices
    // this.
    let done = run(&[&arguments[..], &follow, &["--out", shown(&out)]].concat());
    assert!(max_or_nan(frame.vertices.iter().map(|v| v.y)) > 0.03);
    assert!(
        matches!(done.status.code(), Some(0 | 2)),
        "{}",
        text(&done.stderr)
    );
}

#[test]
fn what_cannot_be_is_refused() {
    let muscle = Cylinder::new();
    let join = |name: &str| muscle.scratch.join(name);
    let (file, out) = (shown(&muscle.file), join("out"));
    let mut away = box_surface([0.01, 0.01, 0.01], 0.005);
    away.vertices
        .iter_mut()
        .for_each(|v| *v += Vector3::new(3.0, 0.0, 0.0));
    let (away_file, lines, bad) = (join("away.obj"), join("lines.vtp"), join("bad.txt"));
    put(&away_file, &away, &[]);
    put_lines(&lines, &[helix(0.0, 0.0, 3.0)]);
    fs::write(&bad, "0 1\n2 x\n").expect("written");
    let (away, lines, bad) = (shown(&away_file), shown(&lines), shown(&bad));
    let [origin, insertion] = muscle.ends.each_ref().map(String::as_str);
    let (second, near, listed) = (
        format!("{away}#1"),
        format!("near:{away},5mm"),
        format!("vertices:{bad}"),
    );
    let cases: &[(&[&str], &str)] = &[
        (
            &["--origin", &second],
            "away.obj has no component 1; it has 1, counted from 0 by falling area",
        ),
        (
            &["--origin", "[]"],
            "the area of the origin is empty; give a patch with triangles, or at least one vertex",
        ),
        (
            &["--origin", insertion],
            "origin and insertion overlap in 25 vertices of the muscle, the first is vertex",
        ),
        (
            &["--origin", away],
            "the area of the origin lies off the muscle: its nearest point is 2.895000 m away",
        ),
        (
            &["--origin", "near:femur.obj"],
            "--origin: `near:femur.obj` has no distance behind a comma, as near:BONE.obj,5mm",
        ),
        (
            &["--origin", "near:femur.obj,5"],
            "--origin: the distance in `near:femur.obj,5`: `5` has no unit; write \"5 mm\"",
        ),
        (&["--origin", "near:femur.obj,5mm"], "femur.obj"),
        (
            &["--origin", &near],
            "no vertex of the muscle is within 0.005 m of the bone given for the origin",
        ),
        (
            &["--origin", "[0,99999]"],
            "the origin names vertex 99999, but the muscle has",
        ),
        (
            &["--origin", &listed],
            "bad.txt: `x` in line 2 is no vertex: vertices are whole numbers, counted from 0",
        ),
        (&["--origin", "nothing.obj"], "nothing.obj"),
        (&["--points", "1"], "1 is not in 2..=10000"),
        (&["--count", "0"], "0 is not in 1..=100000"),
        (&["--smooth-factor", "1.5"], "expected a share from 0 to 1"),
        (
            &["--method", "magic"],
            "[possible values: harmonic, springs, slices, superficial]",
        ),
        (&["--method", "superficial"], "--lines <FILE>"),
        (
            &["--lines", lines],
            "--lines are given, but the method does not follow them; add --method superficial",
        ),
        (&["--method", "superficial", "--lines", file], "--lines: "),
        (
            &["--method", "superficial", "--lines", lines],
            "line 0, counted from 0, lies off the surface: half of its points",
        ),
        (
            &["--template", "pennate"],
            "--template is given, but method harmonic has none; add --method springs or --method slices",
        ),
        (
            &["--template", "round", "--method", "slices"],
            "[possible values: parallel, pennate, curved, rectus]",
        ),
        (
            &["--lines", lines, "--method", "springs"],
            "--lines are given, but the method does not follow them",
        ),
        (
            &["--rest", away],
            "away.obj has other triangles than the muscle",
        ),
        (
            &["--unit", "lightyears"],
            "`lightyears` is no unit of length",
        ),
    ];
    for (wrong, reported) in cases {
        let mut arguments = vec!["fibres", file, "--out", shown(&out)];
        for pair in [
            ["--unit", "m"],
            ["--origin", origin],
            ["--insertion", insertion],
        ] {
            if !wrong.contains(&pair[0]) {
                arguments.extend(pair);
            }
        }
        let done = run(&[&arguments[..], wrong].concat());
        assert_eq!(
            done.status.code(),
            Some(2),
            "{wrong:?}: {}",
            text(&done.stderr)
        );
        assert!(
            text(&done.stderr).contains(reported),
            "{wrong:?}: {}",
            text(&done.stderr)
        );
        assert!(!out.exists(), "{wrong:?} leaves files");
    }
    let (done, _) = muscle.run("out", &[]);
    assert_eq!(
        done.status.code(),
        Some(0),
        "control: what is right is refused, too"
    );
}

#[cfg(unix)]
#[test]
fn ctrl_c_ends_with_its_code_and_writes_nothing() {
    use std::io::BufRead;
    use std::process::{Command, Stdio};
    let muscle = Cylinder::new();
    let out = muscle.scratch.join("out");
    let [origin, insertion] = &muscle.ends;
    let mut child = pliant()
        .args([
            "fibres",
            shown(&muscle.file),
            "--unit",
            "m",
            "--origin",
            origin,
            "--insertion",
            insertion,
        ])
        // Minutes of smoothing.
        .args([
            "--count",
            "500",
            "--smooth-steps",
            "100000",
            "--out",
            shown(&out),
        ])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("a process");
    let mut said = std::io::BufReader::new(child.stderr.take().expect("a pipe"))
        .lines()
        .map_while(Result::ok);
    // Longer work reports its progress on a pipe every few seconds.
    let reported = said.find(|line| line.contains(" of 100000 passes of smoothing"));
    assert!(reported.is_some());
    assert!(
        Command::new("kill")
            .args(["-INT", &child.id().to_string()])
            .status()
            .expect("kill")
            .success()
    );
    let rest = said.collect::<Vec<_>>().join("\n");
    assert_eq!(child.wait().expect("an end").code(), Some(130), "{rest}");
    assert!(
        rest.contains("stopping; press Ctrl-C again to stop at once"),
        "{rest}"
    );
    assert!(
        rest.contains("interrupted: nothing is written") && !out.exists(),
        "{rest}"
    );
}

#[test]
fn aponeuroses_make_short_fibres_and_a_table_tells_how_short() {
    let muscle = Cylinder::new();
    let table = muscle.scratch.join("table.csv");
    let rows = "muscle,optimal_fiber_length_m\nshort,0.05\nlong,0.15\nwrong,-1\n";
    fs::write(&table, rows).expect("a table");
    let row = |name: &str| format!("{}#{name}", shown(&table));
    let (done, out) = muscle.run(
        "plates",
        &[
            "--aponeurosis",
            "0.75",
            "--architecture",
            &row("short,long"),
        ],
    );
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let found = measures(&json(&out.join("summary.json")));
    let ratio = of(&found, "length_median_m") / 0.1;
    assert!((of(&found, "optimal_length_ratio") / ratio - 1.0).abs() <= 1e-9);
    assert!(of(&found, "length_median_m") < 0.5 * LENGTH);
    assert_eq!(
        (&found["aponeurosis"], &found["turns_back"]),
        (&"0.75".into(), &0.into())
    );
    for (more, expected) in [
        (&["--aponeurosis", "1.5"][..], "a share from 0 to 0.95"),
        (&["--aponeurosis", "80deg"], "an angle from 1 to 60 degrees"),
        (
            &["--aponeurosis", "bipenate"],
            "no file, no share, no angle and no kind",
        ),
        (
            &["--aponeurosis", "auto", "--method", "slices"],
            "knows no aponeuroses",
        ),
        (&["--architecture", "table.csv"], "names no row"),
        (&["--architecture", "none.csv#a"], "cannot read"),
        (&["--architecture", &row("absent")], "has no row absent"),
        (
            &["--architecture", &row("wrong")],
            "line 4: `-1` is no length",
        ),
    ] {
        let (refused, _) = muscle.run("refused", more);
        assert_eq!(refused.status.code(), Some(2), "{more:?}");
        assert!(
            text(&refused.stderr).contains(expected),
            "{}",
            text(&refused.stderr)
        );
    }
}
