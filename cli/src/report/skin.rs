//! Measures and report of a skin simulation, per frame.

use nalgebra::Isometry3;
use serde_json::{Value, json};

use super::implant::{Insertion, Point, joined, json_of};
use super::output::{DataFile, Plot, RunOutput, Spot, Verdict};
use super::sensitivities::left_out;
use super::{LinePlot, Table};
use pliant::mesh::measures::max_or_nan;
use pliant::mesh::{TriangleMesh, shapes};
use pliant::scene::{FillCourse, ImplantFill, SkinScene, Support};
use pliant::simulation::{SkinMeasures, SkinPart, SkinRun};
use pliant::skin::{
    Areas, CAVEATS, Defects, GROWN_SOURCE, ImplantSpec, Inserted, RETRACTED_SOURCE, STEEPEST_FOLD,
    Soundness, deepest,
};
use pliant_render::PictureError;

/// Greatest relative volume error of an implant.
const VOLUME_HELD: f64 = 1e-6;

/// The parts of a run that have an equilibrium, over these surfaces.
fn insertion<'a>(run: &'a SkinRun, obstacles: &'a [TriangleMesh]) -> Insertion<'a> {
    let (mut implants, mut numbers) = (Vec::new(), Vec::new());
    for part in &run.parts {
        if let Some(now) = &part.now {
            implants.push((part.ready.clone(), now.clone()));
            // A ball counts as the first implant.
            numbers.push(if part.members.is_empty() {
                vec![0]
            } else {
                part.members.clone()
            });
        }
    }
    Insertion {
        skin: &run.skin,
        implants,
        numbers,
        obstacles,
        curve: curve(run),
        limit: run.scene.skin.stretch_limit,
        up: run.scene.skin.up,
        under: match run.scene.under {
            Support::Implants(_) => "implant",
            Support::Ball(_) => "ball",
        },
    }
}

/// The frames or days of each list of fillings, part by part.
fn curve(run: &SkinRun) -> Vec<Point> {
    let Support::Implants(all) = &run.scene.under else {
        return Vec::new();
    };
    let mut points = Vec::new();
    for part in &run.parts {
        let lists: Vec<&ImplantFill> = part
            .members
            .iter()
            .map(|k| &all[*k])
            .filter(|filled| is_listed(filled))
            .collect();
        let is_of_list = |frame: usize| {
            let mut fills = lists.iter().map(|filled| &filled.fill);
            fills.any(|fill| fill.iter().any(|(at, _)| *at == frame))
        };
        let first = part.members.first().map_or(1, |k| k + 1);
        let frames = part.frames.iter().filter(|f| is_of_list(f.frame));
        points.extend(frames.map(|f| Point {
            implant: first,
            day: run.scene.days.get(f.frame - 1).copied(),
            volume: f.volume(),
            areas: f.areas,
            progress: f.progress,
        }));
    }
    points
}

/// True for an implant with a list of fillings.
fn is_listed(filled: &ImplantFill) -> bool {
    matches!(filled.course, FillCourse::Frames | FillCourse::Days)
}

/// The files of surfaces, pictures and curves of a scene, without those that all runs have.
pub(super) fn files(scene: &SkinScene) -> Vec<String> {
    match &scene.under {
        Support::Implants(all) => Insertion::files(all.len(), all.iter().any(is_listed)),
        Support::Ball(_) => Vec::new(),
    }
}

fn verdicts(run: &SkinRun) -> Vec<Verdict> {
    let mut all = Vec::new();
    for part in &run.parts {
        let mut say = |verdict: Verdict| all.push(verdict.at(part.name.as_str()));
        let unrest = part.frames.iter().filter(|f| !f.progress.converged).count();
        say(Verdict::none("frames that are not at rest", unrest));
        let base = part
            .ready
            .sites()
            .map(|(order, _)| order.implant.base)
            .fold(f64::INFINITY, f64::min);
        let deep = max_or_nan(part.frames.iter().map(|f| f.progress.depth));
        let name = "depth of bodies in each other";
        say(Verdict::at_most(name, deep, deepest(base)).in_unit("m"));
        if matches!(run.scene.under, Support::Implants(_)) {
            for verdict in sound(part) {
                all.push(verdict);
            }
        }
        let mut say = |verdict: Verdict| all.push(verdict.at(part.name.as_str()));
        if let Some(off) = volume_error(run, part) {
            let name = "relative error of the implant's volume";
            say(Verdict::at_most(name, off, VOLUME_HELD));
        }
    }
    all
}

/// Verdicts on crossings and folds in all frames of a part, each with the place of the first.
fn sound(part: &SkinPart) -> Vec<Verdict> {
    type Of = fn(&Soundness) -> &Defects;
    let room = "make the volume smaller or the base larger, or choose a place with more room";
    let kinds: [(&str, Of); 3] = [
        ("crossings of the skin with itself", |s| &s.itself),
        ("crossings of skin and implants", |s| &s.implants),
        ("crossings with obstacles", |s| &s.obstacles),
    ];
    let at = |verdict: Verdict, frame: usize, defects: &Defects| match defects.place {
        Some(p) if !verdict.passed => {
            let [x, y, z] = [p.x, p.y, p.z].map(|c| pliant::format::number(c * 1e3));
            let place = format!("{}, frame {frame}, at ({x}, {y}, {z}) mm", part.name);
            let point_m = p.into();
            verdict.at(place).seen(Some(Spot { frame, point_m }))
        }
        _ => verdict.at(part.name.as_str()),
    };
    let mut all = Vec::new();
    for (name, of) in kinds {
        let counts = part.frames.iter().map(|f| {
            let count = of(&f.soundness).count as f64;
            // Pairs that were not tested are no pairs without a crossing.
            (
                f,
                if f.soundness.complete {
                    count
                } else {
                    f64::NAN
                },
            )
        });
        let first = counts.clone().find(|(_, count)| !(*count <= 0.0));
        let most = max_or_nan(counts.map(|(_, count)| count));
        let verdict = Verdict::at_most(name, most, 0.0).else_do(room);
        all.push(match first {
            Some((f, _)) => at(verdict, f.frame, of(&f.soundness)),
            None => verdict.at(part.name.as_str()),
        });
    }
    let steepest = part.frames.iter().max_by(|a, b| {
        let [a, b] = [a, b].map(|f| f.soundness.greatest_fold);
        a.total_cmp(&b)
    });
    if let Some(f) = steepest {
        let (angle, limit) = (f.soundness.greatest_fold, STEEPEST_FOLD);
        let verdict = Verdict::at_most(
            "greatest fold of the skin",
            angle.to_degrees(),
            limit.to_degrees(),
        );
        let verdict = verdict.in_unit("degrees").else_do(room);
        all.push(at(verdict, f.frame, &f.soundness.folds));
    }
    all
}

/// Greatest relative departure of the implants' volumes from their fillings; `None` for a ball and
/// for a target area.
fn volume_error(run: &SkinRun, part: &SkinPart) -> Option<f64> {
    let Support::Implants(all) = &run.scene.under else {
        return None;
    };
    let is_target = |k: &usize| matches!(all[*k].course, FillCourse::Target(_));
    if part.members.iter().any(is_target) {
        return None;
    }
    let of_frame = |f: &SkinMeasures| {
        let target = run.volumes_at(part, f.frame);
        let each = target.iter().zip(&f.shells);
        max_or_nan(each.map(|(target, (volume, _))| (volume / target - 1.0).abs()))
    };
    Some(max_or_nan(part.frames.iter().map(of_frame)))
}

fn measures(run: &SkinRun, insertion: &Insertion<'_>) -> Value {
    let implants: Vec<Value> = match &run.scene.under {
        Support::Implants(all) => {
            let mut each: Vec<(usize, Value)> = run.parts.iter().flat_map(json_of_part).collect();
            each.sort_by_key(|(number, _)| *number);
            each.into_iter()
                .map(|(k, entry)| joined(entry, json!({"name": all[k].name})))
                .collect()
        }
        Support::Ball(_) => Vec::new(),
    };
    let own = json!({
        "name": run.scene.skin.name,
        "stretch_limit": run.scene.skin.stretch_limit,
        "sources": {"retracted": RETRACTED_SOURCE, "grown": GROWN_SOURCE},
        "implants": implants,
        "target_area_m2": target_area(run),
        "steps": run.parts.iter().map(SkinPart::steps).sum::<u32>(),
    });
    let areas = joined(json_of(&run.areas_at(run.frame())), insertion.to_json());
    let mut all = joined(areas, own);
    if let (Support::Ball(ball), [part]) = (&run.scene.under, run.parts.as_slice()) {
        let at = run.ball_at(ball, part, run.frame());
        let ball = json!({"radius_m": ball.radius, "centre_m": at.centre.coords.as_slice()});
        let part = json_of_part(part).swap_remove(0).1;
        all = joined(all, json!({"ball": joined(part, ball)}));
    }
    all
}

/// The target area of the scene [m^2].
fn target_area(run: &SkinRun) -> Option<f64> {
    let Support::Implants(all) = &run.scene.under else {
        return None;
    };
    all.iter().find_map(|filled| match filled.course {
        FillCourse::Target(area) => Some(area),
        _ => None,
    })
}

fn data(run: &SkinRun) -> DataFile<'_> {
    let columns = [
        "frame",
        "part",
        "implant_volume_m3",
        "area_before_m2",
        "area_deformed_m2",
        "area_retracted_low_m2",
        "area_retracted_high_m2",
        "area_grown_low_m2",
        "area_grown_high_m2",
        "volume_difference_m3",
        "stretch_max",
        "pressure_pa",
        "penetration_m",
        "steps",
        "converged",
        "wall_s",
    ];
    let parts = move |frame| run.parts.iter().map(move |part| cells(part, frame));
    DataFile::new("measures.csv", columns, (0..=run.frame()).flat_map(parts))
}

/// The row of a part in a frame.
fn cells(part: &SkinPart, frame: usize) -> Vec<String> {
    let (a, row) = (part.areas_at(frame), part.measures_at(frame));
    // An equilibrium that is kept costs nothing.
    let own = row.filter(|f| f.frame == frame);
    let progress = row.map(|f| f.progress).unwrap_or_default();
    let numbers = [
        row.map_or(0.0, SkinMeasures::volume),
        a.before,
        a.deformed,
        a.retracted.low,
        a.retracted.high,
        a.grown.low,
        a.grown.high,
        a.volume_difference,
        a.stretch_max,
        progress.pressure,
        progress.depth,
    ];
    let mut cells = vec![frame.to_string(), part.name.clone()];
    cells.extend(numbers.iter().map(f64::to_string));
    cells.extend([
        own.map_or(0, |f| f.progress.iterations).to_string(),
        row.is_none_or(|f| f.progress.converged).to_string(),
        own.map_or(0.0, |f| f.time_s).to_string(),
    ]);
    cells
}

/// The plots; `curve` replaces that of the areas over the frames.
fn plots(run: &SkinRun, curve: Option<Plot>) -> Vec<Plot> {
    let frames = 0..=run.frame();
    let line = |of: &dyn Fn(&Areas) -> f64| -> Vec<(f64, f64)> {
        frames
            .clone()
            .map(|f| (f as f64, of(&run.areas_at(f))))
            .collect()
    };
    let cm2 = |of: fn(&Areas) -> f64| line(&move |a: &Areas| (of(a) - a.before) * 1e4);
    let mut gained =
        LinePlot::new("Area gained [cm2]", "frame").with("deformed", cm2(|a| a.deformed));
    if matches!(run.scene.under, Support::Implants(_)) {
        gained = gained
            .with("retracted, least", cm2(|a| a.retracted.low))
            .with("retracted, most", cm2(|a| a.retracted.high))
            .with("grown, least", cm2(|a| a.grown.low))
            .with("grown, most", cm2(|a| a.grown.high));
    }
    let stretch = LinePlot::new("Greatest stretch", "frame")
        .with("", line(&|a| a.stretch_max))
        .with_limit("limit", run.scene.skin.stretch_limit);
    let [gained, stretch] = [gained, stretch].map(|plot| Plot { file: None, plot });
    vec![curve.unwrap_or(gained), stretch]
}

/// The entries of a part's implants, one for a ball, each with its index among all implants.
fn json_of_part(part: &SkinPart) -> Vec<(usize, Value)> {
    let ready = &part.ready;
    let sites: Vec<(&ImplantSpec, &Isometry3<f64>)> = ready.sites().collect();
    let numbers = |k: usize| part.members.get(k).copied().unwrap_or(k);
    let shares = |k: usize| {
        (0..sites.len())
            .filter(|o| *o != k)
            .map(|o| numbers(o) + 1)
            .collect::<Vec<usize>>()
    };
    let each = sites.iter().enumerate().map(|(k, (order, frame))| {
        let own = json!({
            "implant": numbers(k) + 1,
            "shares_skin_with": shares(k),
            "shape": order.implant.shape.name(),
            "base_m": order.implant.base,
            "depth_m": order.tissue.depth,
            "centre_m": frame.translation.vector.as_slice(),
        });
        (
            numbers(k),
            joined(joined(own, json_of_frames(part, k)), json_of_region(part)),
        )
    });
    each.collect()
}

/// The entries of the frames of an implant.
fn json_of_frames(part: &SkinPart, shell: usize) -> Value {
    let of = |f: &SkinMeasures| {
        f.shells
            .get(shell)
            .copied()
            .unwrap_or((0.0, f.progress.pressure))
    };
    let each = part.frames.iter().map(|f| {
        let (volume, pressure) = of(f);
        let own = json!({
            "frame": f.frame,
            "implant_volume_m3": volume,
            "pressure_pa": pressure,
            "steps": f.progress.iterations,
            "converged": f.progress.converged,
        });
        joined(own, json_of(&f.areas))
    });
    let last = part.frames.last().map_or((0.0, 0.0), of);
    json!({"implant_volume_m3": last.0, "pressure_pa": last.1, "frames": each.collect::<Vec<_>>()})
}

/// The common entries of implants that share skin.
fn json_of_region(part: &SkinPart) -> Value {
    let (ready, last) = (&part.ready, part.frames.last());
    let areas = part.areas_at(last.map_or(0, |f| f.frame));
    let progress = last.map(|f| f.progress).unwrap_or_default();
    let sound = last.map(|f| f.soundness).unwrap_or_default();
    let own = json!({
        "name": part.name,
        "edge_m": ready.layers.edge,
        "residual": progress.residual,
        "rest_by": progress.rest_by(),
        "area_gain_uncertainty_m2": part.now.as_ref().and_then(Inserted::gain_uncertainty),
        "penetration_m": progress.depth,
        "crossings": {
            "skin": sound.itself.count,
            "implants": sound.implants.count,
            "obstacles": sound.obstacles.count,
            "complete": sound.complete,
        },
        "fold_max_deg": sound.greatest_fold.to_degrees(),
        "folds_over_limit": sound.folds.count,
        "rounds": progress.rounds,
        "region": {
            "vertices": 2 * ready.layers.count(),
            "triangles": 2 * ready.layers.triangles.len(),
            "springs": ready.layers.springs.len(),
        },
        "steps": part.steps(),
        "converged": part.converged(),
        "time_s": part.time_s(),
    });
    joined(own, json_of(&areas))
}

/// The result of a run, without the parts that all scenes have in common.
///
/// # Errors
/// A picture that cannot be encoded.
pub(super) fn output(run: &SkinRun) -> Result<RunOutput<'_>, PictureError> {
    let below = below(run);
    let insertion = insertion(run, &below);
    let shown = insertion.shown();
    let implants = matches!(run.scene.under, Support::Implants(_));
    let tables = if implants && !insertion.implants.is_empty() {
        insertion.tables()
    } else {
        vec![ball_table(run)]
    };
    let mut data = vec![data(run)];
    data.extend((!insertion.curve.is_empty()).then(|| insertion.csv()));
    let caveats = implants.then_some(CAVEATS).into_iter().flatten();
    Ok(RunOutput {
        kind: "skin",
        measures: measures(run, &insertion),
        verdicts: verdicts(run),
        findings: insertion.findings(),
        tables_of_text: tables.len(),
        tables,
        plots: plots(run, insertion.curve_plot()),
        pictures: insertion.pictures(&shown)?,
        files: insertion.surfaces(shown, implants),
        data,
        notes: (run.notes.iter().cloned())
            .chain(left_out(run.scene.origin.uncertain()))
            .collect(),
        explanations: caveats.map(str::to_owned).collect(),
        ..RunOutput::default()
    })
}

/// The surfaces below the skin. A ball supports the skin like an obstacle.
fn below(run: &SkinRun) -> Vec<TriangleMesh> {
    let mut below = run.obstacles.clone();
    if let (Support::Ball(ball), [part]) = (&run.scene.under, run.parts.as_slice()) {
        let at = run.ball_at(ball, part, run.frame());
        let mut round = shapes::icosphere(at.radius, 4);
        round
            .vertices
            .iter_mut()
            .for_each(|p| *p += at.centre.coords);
        below.push(round);
    }
    below
}

/// Areas of the skin over a ball, as a table.
fn ball_table(run: &SkinRun) -> Table {
    let areas = run.areas_at(run.frame());
    let mut table = Table::new("Areas and volumes", ["what", "value"]);
    table.row([
        "area before [cm2]".to_owned(),
        format!("{:.4}", areas.before * 1e4),
    ]);
    table.row([
        "area deformed [cm2]".to_owned(),
        format!("{:.4}", areas.deformed * 1e4),
    ]);
    table.row([
        "volume difference [cc]".to_owned(),
        format!("{:.4}", areas.volume_difference * 1e6),
    ]);
    table.row([
        "greatest stretch".to_owned(),
        format!("{:.3}", areas.stretch_max),
    ]);
    for part in &run.parts {
        let layers = &part.ready.layers;
        table.row([
            "vertices of both layers".to_owned(),
            (2 * layers.count()).to_string(),
        ]);
        table.row([
            "triangles of both layers".to_owned(),
            (2 * layers.triangles.len()).to_string(),
        ]);
        table.row(["springs".to_owned(), layers.springs.len().to_string()]);
        table.row(["steps".to_owned(), part.steps().to_string()]);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use pliant::progress::Silent;
    use pliant::scene::Content;
    use pliant::scene::builtin::load_content;
    use pliant::simulation::Stepped;

    fn defect() -> Defects {
        Defects {
            count: 1,
            place: Some(nalgebra::Point3::new(0.001, 0.002, 0.003)),
        }
    }

    #[test]
    fn a_filling_that_is_not_at_rest_fails_and_far_stretched_skin_does_not() {
        let list = "[{ frame = 1, volume = \"40 cc\" }, { frame = 2, volume = \"60 cc\" }]";
        let changes = [
            "sheet.cells=24".to_owned(),
            "skin.edge_length=8.4 mm".to_owned(),
            "skin.stretch_limit=1.01".to_owned(),
            "implant.volume=off".to_owned(),
            format!("implant.fill={list}"),
        ];
        let Ok(Content::Skin(scene)) = load_content("flat-implant", &changes) else {
            panic!("no skin")
        };
        let mut run = SkinRun::new(*scene).expect("a scene that runs");
        for _ in 0..2 {
            assert_eq!(run.step(&Silent), Stepped::Done);
        }
        let of = |run: &SkinRun| {
            let output = output(run).expect("pictures");
            (output.passed(), output.findings.concat(), output.measures)
        };
        let (passed, found, measures) = of(&run);
        assert!(passed && found.contains("stretched beyond 1.01"), "{found}");
        assert!(measures["area_over_limit_m2"].as_f64() > Some(1e-4));
        assert_eq!(measures["curve"].as_array().map(Vec::len), Some(2));
        assert!(run.parts[0].frames.iter().all(|f| f.soundness.is_sound()));
        assert_eq!(measures["implants"][0]["crossings"]["implants"], 0);
        // Every defect of any frame fails, with its place.
        type Spoil = fn(&mut Soundness);
        let bad: [(&str, Spoil); 5] = [
            ("crossings of the skin with itself", |s| s.itself = defect()),
            ("crossings of skin and implants", |s| s.implants = defect()),
            ("crossings with obstacles", |s| s.obstacles = defect()),
            ("greatest fold of the skin", |s| {
                (s.folds, s.greatest_fold) = (defect(), 1.01 * STEEPEST_FOLD);
            }),
            ("greatest fold of the skin", |s| s.greatest_fold = f64::NAN),
        ];
        for (name, spoil) in bad {
            let kept = run.parts[0].frames[0].soundness;
            spoil(&mut run.parts[0].frames[0].soundness);
            let failed: Vec<Verdict> = verdicts(&run).into_iter().filter(|v| !v.passed).collect();
            let [verdict] = &failed[..] else {
                panic!("{name}: {failed:?}")
            };
            assert_eq!(verdict.name, name);
            let place = verdict.place.as_deref().unwrap_or_default();
            assert!(place.contains("frame 1"), "{place}");
            assert!(verdict.value.is_some_and(f64::is_nan) || place.contains("(1, 2, 3) mm"));
            assert!(verdict.what_to_do.is_some());
            run.parts[0].frames[0].soundness = kept;
        }
        run.parts[0].frames[0].soundness.complete = false;
        assert!(
            verdicts(&run).iter().any(|v| !v.passed),
            "not all pairs were tested"
        );
        run.parts[0].frames[0].soundness.complete = true;
        run.parts[0].frames[0].progress.converged = false;
        run.scene.skin.stretch_limit = 9.0;
        let (passed, found, measures) = of(&run);
        assert!(!passed && found.contains("nothing is stretched"), "{found}");
        assert_eq!(measures["area_over_limit_m2"].as_f64(), Some(0.0));
        assert_eq!(measures["curve"][0]["converged"], false);
    }
}
