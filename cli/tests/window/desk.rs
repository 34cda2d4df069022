//! A virtual screen with the viewer on it, controlled by a virtual mouse and keyboard.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use pliant::testing::Scratch;
use serde_json::Value;

/// A guard against a hang, not a measured limit: drawing without a graphics card is slow.
const LONG: Duration = Duration::from_secs(180);

/// Screens of this process.
static USED: AtomicU32 = AtomicU32::new(0);

fn is_there(program: &str) -> bool {
    let found = Command::new("sh")
        .args(["-c", &format!("command -v {program}")])
        .stdout(Stdio::null())
        .status();
    found.is_ok_and(|status| status.success())
}

/// A screen; `None` where no program creates one, which is printed and counted.
pub struct Desk {
    server: Child,
    display: String,
}

impl Desk {
    pub fn new() -> Option<Self> {
        for program in ["Xvfb", "xdotool"] {
            if !is_there(program) {
                println!("skipped: 1 test, because there is no {program}");
                return None;
            }
        }
        let number = 1000 + (std::process::id() % 20_000) + USED.fetch_add(1, Ordering::Relaxed);
        let display = format!(":{number}");
        let mut server = Command::new("Xvfb")
            .args([&display, "-screen", "0", "900x1500x24", "-nolisten", "tcp"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb starts");
        let begun = Instant::now();
        let socket = format!("/tmp/.X11-unix/X{number}");
        while !Path::new(&socket).exists() {
            assert!(
                server.try_wait().expect("a child").is_none(),
                "Xvfb ended at once"
            );
            assert!(begun.elapsed() < LONG, "Xvfb does not come up");
            std::thread::sleep(Duration::from_millis(20));
        }
        Some(Self { server, display })
    }

    /// Opens the viewer.
    pub fn view(&self, arguments: &[&str]) -> Viewer<'_> {
        let folder = Scratch::folder();
        let log = fs::File::create(folder.join("errors")).expect("a file");
        let child = Command::new(env!("CARGO_BIN_EXE_pliant"))
            .arg("view")
            .args(arguments)
            .args(["--size", "800x1400", "--trace"])
            .arg(folder.join("trace"))
            .arg("--out")
            .arg(folder.join("pictures"))
            .env("DISPLAY", &self.display)
            .env_remove("WAYLAND_DISPLAY")
            .stdout(Stdio::null())
            .stderr(log)
            .spawn()
            .expect("the viewer starts");
        Viewer {
            desk: self,
            child,
            folder,
        }
    }

    fn hand(&self, arguments: &[&str]) -> Output {
        let done = Command::new("xdotool")
            .args(arguments)
            .env("DISPLAY", &self.display)
            .output();
        let done = done.expect("xdotool runs");
        assert!(
            done.status.success(),
            "xdotool {arguments:?}: {}",
            String::from_utf8_lossy(&done.stderr)
        );
        done
    }
}

impl Drop for Desk {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

/// A running viewer.
pub struct Viewer<'a> {
    desk: &'a Desk,
    child: Child,
    folder: Scratch,
}

impl Viewer<'_> {
    /// The last reported picture.
    pub fn last(&self) -> Option<Value> {
        let text = fs::read_to_string(self.folder.join("trace")).ok()?;
        let whole = &text[..=text.rfind('\n')?];
        serde_json::from_str(whole.lines().last()?).ok()
    }

    /// The standard error of the viewer.
    pub fn errors(&self) -> String {
        fs::read_to_string(self.folder.join("errors")).unwrap_or_default()
    }

    /// The first picture from now on that satisfies a condition.
    pub fn wait(&mut self, what: &str, holds: impl Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        loop {
            if let Some(seen) = self.last().filter(&holds) {
                return seen;
            }
            if let Some(status) = self.child.try_wait().expect("a child") {
                panic!(
                    "waiting for {what}: the viewer ended, {status}: {}",
                    self.errors()
                );
            }
            if begun.elapsed() > LONG {
                let mut seen = self.last().unwrap_or_default();
                let widget = find(&seen, what).cloned();
                seen["widgets"] = Value::from(widget);
                panic!("waiting for {what}: {seen}");
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// A picture that begins after this call.
    pub fn next(&mut self) -> Value {
        let now = self
            .last()
            .map_or(0, |seen| number(&seen["picture"]) as u64);
        self.wait("a picture", |seen| {
            number(&seen["picture"]) as u64 > now + 1
        })
    }

    /// Gives the keyboard focus to the viewer.
    pub fn focus(&mut self) {
        // In the first pictures the layout of the widgets still changes.
        self.wait("the first pictures", |seen| number(&seen["picture"]) >= 4.0);
        let found = self.desk.hand(&["search", "--sync", "--name", "Pliant"]);
        let text = String::from_utf8_lossy(&found.stdout).into_owned();
        let window = text.lines().last().expect("a window").to_owned();
        self.desk.hand(&["windowfocus", "--sync", &window]);
    }

    pub fn key(&mut self, key: &str) {
        self.desk.hand(&["key", key]);
        self.next();
    }

    /// As [`Self::key`], while a button is pressed.
    pub fn press_key(&mut self, key: &str) {
        self.desk.hand(&["key", key]);
    }

    /// Presses a button at one place, moves to another, and releases the button.
    pub fn drag(
        &mut self,
        button: &str,
        from: [f64; 2],
        to: [f64; 2],
        between: impl FnOnce(&mut Self),
    ) {
        self.go(from);
        self.desk.hand(&["mousedown", button]);
        self.next();
        self.go([0.5 * (from[0] + to[0]), 0.5 * (from[1] + to[1])]);
        self.go(to);
        between(self);
        self.desk.hand(&["mouseup", button]);
        self.next();
    }

    pub fn go(&mut self, [x, y]: [f64; 2]) {
        self.desk
            .hand(&["mousemove", &format!("{x:.0}"), &format!("{y:.0}")]);
        self.next();
    }

    pub fn click(&mut self, at: [f64; 2]) {
        self.go(at);
        self.desk.hand(&["click", "1"]);
        self.next();
    }

    /// Rotates the wheel at a place.
    pub fn scroll(&mut self, at: [f64; 2], notches: u32) {
        self.go(at);
        self.desk
            .hand(&["click", "--repeat", &notches.to_string(), "4"]);
        self.next();
    }

    /// Rectangle of a widget.
    pub fn widget(&mut self, name: &str) -> [f64; 4] {
        let seen = self.wait(name, |seen| find(seen, name).is_some());
        rect(find(&seen, name).expect("it was found"))
    }

    /// Clicks on a widget and waits for the answer, which moves the widgets below it in the
    /// panel.
    pub fn press(&mut self, name: &str) {
        let [left, top, _, bottom] = self.widget(name);
        self.click([left + 8.0, 0.5 * (top + bottom)]);
        self.settle();
    }

    /// Waits until all controls are answered.
    fn settle(&mut self) {
        self.wait("answers", |seen| number(&seen["waiting"]) == 0.0);
    }

    /// Moves a slider to a share of its range.
    pub fn slide(&mut self, name: &str, share: f64) {
        let [left, top, _, bottom] = self.widget(name);
        let y = 0.5 * (top + bottom);
        // The slider is 100 points wide, minus the handle.
        let at = |share: f64| [left + 8.0 + 84.0 * share, y];
        self.drag("1", at(0.5), at(share), |_| {});
        self.settle();
    }

    /// The saved pictures and recordings, in the order of their names.
    pub fn pictures(&self) -> Vec<PathBuf> {
        let entries = fs::read_dir(self.folder.join("pictures"))
            .into_iter()
            .flatten()
            .flatten();
        let mut all: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
        all.retain(|path| path.extension().is_some_and(|e| e == "png" || e == "gif"));
        all.sort();
        all
    }

    /// Saves a picture and reads it.
    pub fn picture(&mut self) -> Picture {
        let before = self.pictures().len();
        self.desk.hand(&["key", "p"]);
        self.wait_for_file("a picture", |viewer| viewer.pictures().len() > before);
        Picture::read(self.pictures().last().expect("a picture"))
    }

    /// Waits until a file is in the viewer's folder.
    pub fn wait_for_file(&mut self, what: &str, is_there: impl Fn(&Self) -> bool) {
        let begun = Instant::now();
        while !is_there(self) {
            assert!(
                begun.elapsed() < LONG,
                "waiting for {what}: {}",
                self.errors()
            );
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Presses Q and returns the exit code.
    pub fn close(self) -> Option<i32> {
        self.desk.hand(&["key", "q"]);
        self.ended()
    }

    /// Waits until the viewer ends and returns the exit code.
    pub fn ended(mut self) -> Option<i32> {
        let begun = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().expect("a child") {
                return status.code();
            }
            assert!(begun.elapsed() < LONG, "it does not close");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Viewer<'_> {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

pub fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}

/// A widget of a picture.
pub fn find<'a>(seen: &'a Value, name: &str) -> Option<&'a Value> {
    seen["widgets"]
        .as_array()?
        .iter()
        .find(|widget| widget["name"] == name)
}

fn rect(widget: &Value) -> [f64; 4] {
    std::array::from_fn(|k| number(&widget["rect"][k]))
}

/// The position of a control's slider as a share of its range.
pub fn share(seen: &Value, name: &str) -> f64 {
    find(seen, name).map_or(f64::NAN, |widget| number(&widget["value"]["share"]))
}

/// A saved picture.
pub struct Picture {
    pub size: (u32, u32),
    pub pixels: Vec<[u8; 3]>,
}

impl Picture {
    pub fn read(path: &Path) -> Self {
        let file = std::io::BufReader::new(fs::File::open(path).expect("a picture"));
        let mut reader = png::Decoder::new(file).read_info().expect("a PNG");
        let mut bytes = vec![0; reader.output_buffer_size().expect("a size")];
        let info = reader.next_frame(&mut bytes).expect("a frame");
        assert_eq!(
            (info.color_type, info.bit_depth),
            (png::ColorType::Rgb, png::BitDepth::Eight)
        );
        Self {
            size: (info.width, info.height),
            pixels: bytes.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect(),
        }
    }

    /// The share of pixels with a property.
    pub fn share(&self, is: impl Fn([u8; 3]) -> bool) -> f64 {
        self.pixels.iter().filter(|p| is(**p)).count() as f64 / self.pixels.len().max(1) as f64
    }

    /// The share of pixels in which two pictures differ by more than a step of rounding.
    pub fn differs(&self, other: &Self) -> f64 {
        assert_eq!(self.size, other.size);
        let apart = |(a, b): (&[u8; 3], &[u8; 3])| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > 3);
        self.pixels
            .iter()
            .zip(&other.pixels)
            .filter(|pair| apart(*pair))
            .count() as f64
            / self.pixels.len() as f64
    }

    /// The reason why the picture is empty; `None` where it is not.
    pub fn blank(&self) -> Option<String> {
        let mut colours = self.pixels.clone();
        colours.sort_unstable();
        colours.dedup();
        (colours.len() < 50).then(|| format!("{} colours only", colours.len()))
    }
}
