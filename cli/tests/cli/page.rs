//! `report.html` in a browser: Chromium without a window. Skipped where Chromium is missing.

use std::collections::HashSet;
use std::fs::{self, File};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::{Scratch, ball_and_box, run_into, shown, text};

/// Longest time of the browser for one page.
const PATIENCE: Duration = Duration::from_secs(120);

/// Budget of the browser's virtual time for a page [ms]. Virtual time runs fast while the page
/// is idle.
const BUDGET: &str = "--virtual-time-budget=10000";

fn browser() -> Option<PathBuf> {
    let folders: Vec<PathBuf> = std::env::split_paths(&std::env::var_os("PATH")?).collect();
    let names = ["chromium", "chromium-browser", "google-chrome"];
    names
        .iter()
        .flat_map(|name| folders.iter().map(move |folder| folder.join(name)))
        .find(|path| path.is_file())
}

/// Opens pages with a browser profile that the test removes.
struct Browser<'a> {
    program: PathBuf,
    scratch: &'a Scratch,
}

impl Browser<'_> {
    /// Output of the page and the browser when the page is opened.
    fn open(&self, page: &Path, more: &[&str]) -> (String, String) {
        let [said, log] = ["said", "log"].map(|name| self.scratch.join(name));
        let mut child = Command::new(&self.program)
            .args([
                "--headless=new",
                "--no-sandbox",
                "--disable-gpu",
                "--disable-dev-shm-usage",
                "--no-first-run",
            ])
            .args([
                "--enable-logging=stderr",
                "--v=0",
                "--hide-scrollbars",
                "--force-device-scale-factor=1",
                BUDGET,
            ])
            .arg(format!(
                "--user-data-dir={}",
                shown(&self.scratch.join("profile"))
            ))
            .args(more)
            .arg(format!("file://{}", shown(page)))
            .stdin(Stdio::null())
            .stdout(File::create(&said).unwrap())
            .stderr(File::create(&log).unwrap())
            // The child processes of the browser end with it.
            .process_group(0)
            .spawn()
            .unwrap();
        let begun = Instant::now();
        let status = loop {
            match child.try_wait().unwrap() {
                Some(status) => break status,
                None if begun.elapsed() > PATIENCE => {
                    let _ = Command::new("kill")
                        .args(["-KILL", "--", &format!("-{}", child.id())])
                        .status();
                    let _ = child.wait();
                    panic!(
                        "no end after {PATIENCE:?}: {}",
                        text(&fs::read(&log).unwrap())
                    );
                }
                None => std::thread::sleep(Duration::from_millis(20)),
            }
        };
        let [said, log] = [said, log].map(|path| text(&fs::read(path).unwrap()));
        assert!(status.success(), "{status}: {log}");
        (said, log)
    }

    /// Messages of a page on its console. Only an empty list means no error, because the log
    /// does not separate kinds.
    fn console(&self, page: &Path) -> Vec<String> {
        let (_, log) = self.open(page, &["--dump-dom"]);
        log.lines()
            .filter(|line| line.contains(":CONSOLE"))
            .map(str::to_owned)
            .collect()
    }

    /// Pixels of a page.
    fn screenshot(&self, page: &Path) -> Vec<[u8; 3]> {
        let path = self.scratch.join("shot.png");
        let _ = fs::remove_file(&path);
        self.open(
            page,
            &[
                &format!("--screenshot={}", shown(&path)),
                "--window-size=900,2400",
            ],
        );
        let mut decoder = png::Decoder::new(std::io::BufReader::new(File::open(&path).unwrap()));
        decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::STRIP_16);
        let mut reader = decoder.read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut bytes).unwrap();
        assert_eq!((info.width, info.height), (900, 2400));
        let size = info.color_type.samples();
        assert!(size >= 3, "{info:?}");
        bytes
            .chunks_exact(size)
            .map(|p| [p[0], p[1], p[2]])
            .collect()
    }

    /// Result of [`DRIVER`] on a copy of a page.
    fn driven(&self, html: &str) -> Value {
        let page = self.scratch.join("driven.html");
        fs::write(&page, with_script(html, DRIVER)).unwrap();
        let (dom, log) = self.open(&page, &["--dump-dom"]);
        let found = dom
            .split("<pre id=\"found\">")
            .nth(1)
            .unwrap_or_else(|| panic!("the driver did not run: {log}"));
        serde_json::from_str(found.split("</pre>").next().unwrap()).unwrap()
    }
}

/// A page with one more script, which its policy must permit.
fn with_script(html: &str, script: &str) -> String {
    let at = html
        .find("script-src 'sha256-")
        .expect("a policy with the script's hash")
        + "script-src ".len();
    let end = at + html[at..].find('"').unwrap();
    let html = format!("{}'unsafe-inline'{}", &html[..at], &html[end..]);
    html.replace("</body>", &format!("<script>{script}</script></body>"))
}

/// Moves the slider through all frames from all sides and back, then plays. Pictures are named
/// by a hash of their pixels.
const DRIVER: &str = "
const pause = ms => new Promise(done => setTimeout(done, ms));
const one = what => document.querySelector('.turntable ' + what);
const hash = () => {
  const canvas = one('canvas');
  const bytes = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
  return bytes.reduce((sum, byte) => (Math.imul(sum, 31) + byte) | 0, 7);
};
const state = () => ({output: one('output').textContent, label: one('canvas').getAttribute('aria-label'), picture: hash()});
const shown = element => element.getClientRects().length > 0;
(async () => {
  for (let k = 0; k < 100 && one('.controls').hidden; k++) await pause(20);
  const slider = one('input[type=range]');
  const sides = [...document.querySelectorAll('.turntable input[type=radio]')];
  const move = to => { slider.value = to; slider.dispatchEvent(new Event('input', {bubbles: true})); };
  const found = {canvas: shown(one('canvas')), still: shown(one('img')), controls: shown(slider), sides: []};
  for (const side of sides) {
    side.click();
    const states = [];
    for (let k = 0; k <= Number(slider.max); k++) { move(k); states.push(state()); }
    move(0);
    states.push(state());
    found.sides.push(states);
  }
  const played = [];
  one('button').click();
  for (let k = 0; k < 8; k++) { played.push(slider.value); await pause(100); }
  const called = one('button').textContent;
  one('button').click();
  const before = slider.value;
  await pause(1000);
  found.played = {values: new Set(played).size, called, after: one('button').textContent, stopped: slider.value === before};
  const pre = document.createElement('pre');
  pre.id = 'found';
  pre.textContent = JSON.stringify(found);
  document.body.append(pre);
})();
";

/// Moves the slider to the middle.
const HALF_WAY: &str = "
setTimeout(() => {
  const slider = document.querySelector('.turntable input[type=range]');
  slider.value = Math.floor(slider.max / 2);
  slider.dispatchEvent(new Event('input', {bubbles: true}));
}, 2000);
";

/// Faults of a turn-table of these frames; empty if it works.
fn faults(found: &Value, frames: &[usize]) -> Vec<String> {
    let mut faults = Vec::new();
    let mut check = |right: bool, what: String| {
        if !right {
            faults.push(what)
        }
    };
    check(
        found["canvas"] == true && found["controls"] == true && found["still"] == false,
        format!("shown: {found}"),
    );
    let sides = found["sides"].as_array().unwrap();
    check(sides.len() == 3, format!("{} sides", sides.len()));
    let mut pictures = HashSet::new();
    for states in sides.iter().map(|states| states.as_array().unwrap()) {
        let [all @ .., back] = states.as_slice() else {
            panic!("{states:?}")
        };
        let output: Vec<String> = frames
            .iter()
            .map(|frame| format!("frame {frame}"))
            .collect();
        check(
            all.iter()
                .map(|s| s["output"].as_str().unwrap())
                .eq(&output),
            format!("output: {all:?}"),
        );
        let own: HashSet<i64> = all.iter().map(|s| s["picture"].as_i64().unwrap()).collect();
        check(
            own.len() == frames.len(),
            format!("{} pictures of {} frames", own.len(), frames.len()),
        );
        check(
            *back == all[0],
            format!("back at the first: {back}, {}", all[0]),
        );
        pictures.extend(own);
    }
    check(
        pictures.len() == 3 * frames.len(),
        format!("{} pictures from all sides", pictures.len()),
    );
    let labels: HashSet<&str> = sides
        .iter()
        .filter_map(|states| states[0]["label"].as_str())
        .collect();
    check(labels.len() == 3, format!("{labels:?}"));
    let played = &found["played"];
    check(
        played["values"].as_u64().unwrap() >= 3,
        format!("play: {played}"),
    );
    check(
        played["called"] == "Pause" && played["after"] == "Play" && played["stopped"] == true,
        format!("{played}"),
    );
    faults
}

/// Colours of a picture.
fn colours(pixels: &[[u8; 3]]) -> usize {
    pixels.iter().collect::<HashSet<_>>().len()
}

/// A page with text and a few marks has fewer colours than this; a page with a picture has
/// more.
const MANY: usize = 400;

#[test]
fn the_report_works_in_a_browser() {
    let Some(program) = browser() else {
        println!("skipped: 1 test, because there is no chromium");
        return;
    };
    let scratch = Scratch::folder();
    let [ball, plate] = ball_and_box(&scratch);
    let out = scratch.join("out");
    let gravity = "effects.gravity.acceleration=['0 m/s2', '-9.81 m/s2', '0 m/s2']";
    run_into(
        &out,
        &[
            "--muscles",
            &ball,
            "--bones",
            &plate,
            "--unit",
            "cm",
            "--frames",
            "25",
            "--set",
            gravity,
        ],
    );
    let page = out.join("report.html");
    let html = fs::read_to_string(&page).unwrap();
    let browser = Browser {
        program,
        scratch: &scratch,
    };
    let console = browser.console(&page);
    assert!(console.is_empty(), "{console:?}");
    // Every second frame of 0 to 25, because there are too many, and the last.
    let frames: Vec<usize> = (0..25).step_by(2).chain([25]).collect();
    let wrong = faults(&browser.driven(&html), &frames);
    assert!(wrong.is_empty(), "{wrong:?}");
    // A scene without muscles.
    let cube = scratch.join("lattice");
    run_into(&cube, &["lattice", "--frames", "6"]);
    let console = browser.console(&cube.join("report.html"));
    assert!(console.is_empty(), "{console:?}");
    let of_cube = fs::read_to_string(cube.join("report.html")).unwrap();
    let wrong = faults(&browser.driven(&of_cube), &[0, 1, 2, 3, 4, 5, 6]);
    assert!(wrong.is_empty(), "{wrong:?}");
    let still = browser.screenshot(&page);
    assert!(colours(&still) > MANY, "{} colours", colours(&still));
    let other = |script: &str| {
        let page = scratch.join("other.html");
        fs::write(&page, with_script(&html, script)).unwrap();
        browser.screenshot(&page)
    };
    assert!(
        other(HALF_WAY) != still,
        "the slider moved, and nothing that is seen"
    );
    assert!(
        other("") == still,
        "control: two screenshots of one page differ"
    );

    // Controls: a script that fails, a script that the policy does not know, a dead slider, an
    // empty page.
    let altered = |from: &str, to: &str| {
        let changed = html.replace(from, to);
        assert!(changed != html, "`{from}` is not on the page");
        changed
    };
    let broken = scratch.join("broken.html");
    fs::write(&broken, with_script(&html, "nowhere();")).unwrap();
    assert!(
        browser
            .console(&broken)
            .iter()
            .any(|line| line.contains("nowhere")),
        "{:?}",
        browser.console(&broken)
    );
    fs::write(&broken, altered("'use strict';", "'use strict'; ")).unwrap();
    assert!(
        !browser.console(&broken).is_empty(),
        "a script that the policy does not know ran"
    );
    let wrong = faults(
        &browser.driven(&altered(
            "slider.addEventListener('input'",
            "slider.addEventListener('x'",
        )),
        &frames,
    );
    assert!(
        wrong.iter().any(|fault| fault.contains("1 pictures of")),
        "{wrong:?}"
    );
    fs::write(
        &broken,
        "<!doctype html><title>nothing</title><h1>Report</h1>",
    )
    .unwrap();
    assert!(colours(&browser.screenshot(&broken)) <= MANY);
}
