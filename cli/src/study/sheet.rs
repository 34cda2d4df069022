//! The sheet of pictures: a row per run, a column per compared frame, errors below the pictures.

use std::path::Path;

use rayon::prelude::*;

use super::combinations::{Combination, Combinations, Role};
use super::findings::Row;
use super::outcome::{Outcome, Positions};
use crate::report::pictures::{Painter, Stage};
use pliant::format::number;
use pliant::mesh::measures::Aabb;
use pliant::simulation::FrameState;
use pliant_render::{Canvas, Frame, Rgb, TextStyle};

/// Width of a picture [px].
const WIDTH: u32 = 240;
/// Least and greatest height of a picture [px]; in between the aspect ratio of the visible region
/// decides.
const HEIGHT: (f64, f64) = (100.0, 240.0);
/// Width of the labels [px].
const LABEL: usize = 240;
/// Gap between pictures [px].
const GAP: usize = 8;
/// Height of the frame names [px].
const HEAD: usize = 36;
/// Height of a line of text [px].
const LINE: usize = 22;
/// Number of rows of one page: it stays readable and small in memory.
const ROWS: usize = 16;
/// A run with a greater extent, relative to the median of all, does not affect the camera.
const WILD: f64 = 3.0;

const INK: Rgb = [0.16, 0.17, 0.19];
const SOFT: Rgb = [0.42, 0.44, 0.48];
const BAD: Rgb = [0.75, 0.2, 0.11];
const PAPER: Rgb = [1.0; 3];
const BLANK: Rgb = [0.955, 0.958, 0.965];

/// Indices of the runs of each page: every reference precedes the first run that is compared with
/// it.
pub fn pages(study: &Combinations, rows: &[Row]) -> Vec<Vec<usize>> {
    let mut order: Vec<usize> = Vec::new();
    for (k, combination) in study.all.iter().enumerate() {
        for index in combination.reference.into_iter().chain([k]) {
            if !order.contains(&index) && (combination.role == Role::Combination) {
                order.push(index);
            }
        }
    }
    order.retain(|&k| rows[k].outcome.is_some());
    order.chunks(ROWS).map(<[usize]>::to_vec).collect()
}

/// Draws one page; `None` if no run of the study has a picture.
pub fn draw(study: &Combinations, rows: &[Row], page: &[usize], folder: &Path) -> Option<Frame> {
    let stage = stage(study, rows)?;
    let legend = stage.legend().large();
    let tall = (f64::from(WIDTH) * stage.aspect() * 1.1).clamp(HEIGHT.0, HEIGHT.1) as u32;
    let (cell, count) = ((WIDTH as usize, tall as usize), study.frames.len());
    let captions = if study.all.iter().any(|c| c.reference.is_some()) {
        2
    } else {
        0
    };
    let pitch = (cell.0 + GAP, cell.1 + captions * LINE + GAP);
    let width = LABEL + count * pitch.0 + legend.width() as usize + 2 * GAP;
    let height = HEAD + page.len() * pitch.1 + GAP;
    let mut sheet = Frame::plain(width as u32, height.max(300) as u32, PAPER);
    for (c, frame) in study.frames.iter().enumerate() {
        sheet.text(
            (LABEL + c * pitch.0 + 4) as i64,
            8,
            &format!("frame {frame}"),
            TextStyle::Title,
            INK,
        );
    }
    for (r, &index) in page.iter().enumerate() {
        let top = HEAD + r * pitch.1;
        let row = &rows[index];
        write_label(&mut sheet, top, row, pitch.1 - GAP);
        let pictures = pictures(study, &study.all[index], &stage, tall, folder);
        for (c, picture) in pictures.iter().enumerate() {
            let left = LABEL + c * pitch.0;
            match picture {
                Some(picture) => sheet.paste(left, top, picture),
                None => draw_blank(&mut sheet, (left, top), tall, row),
            }
            for (l, (text, colour)) in caption(row, c, picture.is_some())
                .iter()
                .take(captions)
                .enumerate()
            {
                let (x, y) = (left + 4, top + cell.1 + l * LINE);
                sheet.text(x as i64, y as i64, text, TextStyle::Large, *colour);
            }
        }
    }
    let mut key = Frame::plain(
        legend.width() as u32 + 8,
        sheet.height().min(640) as u32,
        PAPER,
    );
    legend.draw(&mut key);
    sheet.paste(LABEL + count * pitch.0 + GAP, 0, &key);
    Some(sheet)
}

/// A blank in place of a picture, with the reason.
fn draw_blank(sheet: &mut Frame, (left, top): (usize, usize), tall: u32, row: &Row) {
    sheet.paste(left, top, &Frame::plain(WIDTH, tall, BLANK));
    let text = match row.status() {
        "stopped" | "diverged" => "ended before",
        _ => "no picture",
    };
    let (x, y) = (left + 40, top + tall as usize / 2 - 8);
    sheet.text(x as i64, y as i64, text, TextStyle::Small, SOFT);
}

/// The text below a picture.
fn caption(row: &Row, column: usize, shown: bool) -> Vec<(String, Rgb)> {
    let mm = |length: f64| number((length * 1e5).round() / 1e2);
    match row.errors.get(column).copied().flatten() {
        Some(e) => vec![
            (format!("rms {} mm", mm(e.rms)), INK),
            (format!("max {} mm", mm(e.max)), SOFT),
        ],
        None if row.role == Role::Reference && shown => vec![("reference".to_owned(), SOFT)],
        None => Vec::new(),
    }
}

/// Writes the label in lines, and the result of the run.
fn write_label(sheet: &mut Frame, top: usize, row: &Row, height: usize) {
    let style = TextStyle::Large;
    let fits = (LABEL - 2 * GAP) / style.width("m").max(1) as usize;
    let most = (height / LINE).saturating_sub(1).max(1);
    let mut lines = wrapped(&row.label, fits);
    if lines.len() > most {
        lines.truncate(most);
        if let Some(last) = lines.last_mut() {
            *last = last
                .chars()
                .take(fits.saturating_sub(3))
                .chain("...".chars())
                .collect();
        }
    }
    let colour = match row.status() {
        "converged" => SOFT,
        _ => BAD,
    };
    let lines = lines
        .iter()
        .map(|l| (l.as_str(), INK))
        .chain([(row.status(), colour)]);
    for (l, (text, colour)) in lines.enumerate() {
        sheet.text(GAP as i64, (top + l * LINE) as i64, text, style, colour);
    }
}

/// A text in lines of at most `fits` characters, broken at spaces if possible.
fn wrapped(text: &str, fits: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let mut rest: Vec<char> = word.chars().collect();
        loop {
            let line = lines.last_mut().map_or(0, |l| l.chars().count());
            let space = usize::from(line > 0);
            if line + space + rest.len() <= fits {
                if let Some(last) = lines.last_mut() {
                    last.extend(std::iter::repeat_n(' ', space).chain(rest));
                }
                break;
            }
            if line > 0 {
                lines.push(String::new());
            } else {
                let head = rest.drain(..fits.clamp(1, rest.len())).collect();
                if let Some(last) = lines.last_mut() {
                    *last = head;
                }
                lines.push(String::new());
            }
        }
    }
    lines
}

/// The camera and the colours of all pictures.
fn stage(study: &Combinations, rows: &[Row]) -> Option<Stage> {
    // A diverged run is extreme before its end; it only decides if there is no other.
    let ended = rows
        .iter()
        .filter_map(|r| r.outcome.as_ref())
        .all(|o| o.stopped.is_some());
    let ran = || {
        rows.iter()
            .filter_map(|r| r.outcome.as_ref())
            .filter(|o| ended || o.stopped.is_none())
    };
    let boxes: Vec<(Aabb, f64)> = ran()
        .filter_map(|o| o.bounds.map(|[min, max]| (Aabb { min, max }, o.stretch)))
        .collect();
    let mut sizes: Vec<f64> = boxes.iter().map(|(b, _)| b.extents().amax()).collect();
    sizes.sort_unstable_by(f64::total_cmp);
    let median = *sizes.get(sizes.len() / 2)?;
    let tame = || {
        boxes
            .iter()
            .filter(|(b, _)| b.extents().amax() <= WILD * median)
    };
    let bounds = tame().map(|(b, _)| *b).reduce(|a, b| a.union(&b))?;
    let stretch = pliant::mesh::measures::max_or_nan(tame().map(|(_, s)| *s));
    let start = study.all.first()?.subject.scenario().ok()?;
    let (scene, first) = (start.description(), start.state());
    Some(Stage::new(&scene, &first, &bounds, stretch))
}

/// The pictures of one run, one per frame; `None` for a frame that it did not reach.
fn pictures(
    study: &Combinations,
    combination: &Combination,
    stage: &Stage,
    tall: u32,
    folder: &Path,
) -> Vec<Option<Frame>> {
    let none = || vec![None; study.frames.len()];
    let Some(outcome) = Outcome::read(&folder.join(combination.file()), &combination.key) else {
        return none();
    };
    let Ok(scenario) = combination.subject.scenario() else {
        return none();
    };
    let scene = scenario.description();
    let painter = Painter::on(&scene, stage);
    let shot = |frame: usize, x: &Positions| FrameState {
        frame,
        // The pictures do not show the time.
        time: 0.0,
        bodies: x.iter().map(|x| (x.clone(), Vec::new())).collect(),
        bones: scenario.poses(frame),
    };
    let shots: Vec<Option<FrameState>> = study
        .frames
        .iter()
        .map(|&f| Some(shot(f, outcome.at(f)?)))
        .collect();
    let canvas = Canvas::new(WIDTH, tall);
    shots
        .par_iter()
        .map(|shot| shot.as_ref().map(|s| painter.paint(s, canvas)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_broken_at_spaces_and_long_words_anywhere() {
        assert_eq!(
            wrapped("iterations = 10, bending = 0.5", 16),
            ["iterations = 10,", "bending = 0.5"]
        );
        assert_eq!(wrapped("abcdefghij k", 4), ["abcd", "efgh", "ij k"]);
        assert_eq!(wrapped("", 4), [""]);
        for fits in 1..6 {
            let lines = wrapped("a bb ccc dddd eeeee", fits);
            assert!(lines.iter().all(|l| l.chars().count() <= fits), "{lines:?}");
            assert_eq!(lines.concat().replace(' ', ""), "abbcccddddeeeee");
        }
    }
}
