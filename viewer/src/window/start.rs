//! Opening a window and displaying its session until it is closed.

use std::collections::VecDeque;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use kiss3d::egui;
use kiss3d::post_processing::Tonemap;
use kiss3d::prelude::{Context, NumSamples, Window};
use nalgebra::{Point3, Vector3};

use super::capture::Capture;
use super::lens::Lens;
use super::pointer::Pointer;
use super::scene_nodes::{self, SceneNodes, ViewSettings};
use super::trace::Trace;
use super::{Options, PANEL, Viewer, WindowError, fitted, panel};
use crate::Session;
use crate::camera::Camera;
use crate::colour::{Colouring, Field};
use crate::history::History;
use crate::recipe::{StartError, words};
use crate::snapshot::Shot;
use pliant::mesh::measures::Aabb;

/// Time between two pictures during the reading of meshes.
const READING: Duration = Duration::from_millis(50);

/// Time of a slow picture, drawn by the processor or by a busy card: half of the time is then left
/// to the simulation.
const SLOW: Duration = Duration::from_millis(25);

/// Full picture rate for this time after the last action.
const LATELY: Duration = Duration::from_millis(500);

/// Background colour.
const BACKGROUND: pliant_render::colour::Rgb = [0.16, 0.17, 0.2];

/// Opens a window while `start` starts a session in parallel. Returns a final message, if any, when
/// the window is closed.
///
/// The window library panics if it cannot open a window; this function catches the panic and
/// returns an error. `quietly` runs a closure; a command that prints panics can use it to print
/// none meanwhile.
///
/// # Errors
/// No display, no graphics card, or nothing to display.
pub fn show(
    start: impl FnOnce() -> Result<Session, StartError> + Send + 'static,
    options: &Options,
    quietly: impl FnOnce(&mut dyn FnMut()),
) -> Result<Option<String>, WindowError> {
    let starting = std::thread::Builder::new()
        .name("start".to_owned())
        .spawn(start)
        .map_err(|error| WindowError::Start(StartError::Thread(error)))?;
    let trace = match &options.trace {
        Some(path) => {
            Some(Trace::create(path).map_err(|error| WindowError::Trace(path.clone(), error))?)
        }
        None => None,
    };
    let mut opened = None;
    quietly(&mut || opened = Some(open(options)));
    let window = match opened.unwrap_or_else(|| open(options)) {
        Ok(window) => window,
        // The error of a scene precedes that of a missing display.
        Err(error) => {
            begun(starting)?;
            return Err(error);
        }
    };
    kiss3d::pollster::block_on(shown(window, starting, options, trace))
}

/// The session from the thread that started it.
fn begun(starting: JoinHandle<Result<Session, StartError>>) -> Result<Session, WindowError> {
    match starting.join() {
        Ok(session) => Ok(session?),
        Err(panic) => std::panic::resume_unwind(panic),
    }
}

/// A window, or the reason why there is none: the library panics.
fn open(options: &Options) -> Result<Window, WindowError> {
    // The library that makes the window reads the same variables.
    if cfg!(target_os = "linux") {
        let is_set = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
        if !is_set("DISPLAY") && !is_set("WAYLAND_DISPLAY") && !is_set("WAYLAND_SOCKET") {
            return Err(WindowError::NoDisplay(
                "neither DISPLAY nor WAYLAND_DISPLAY is set".to_owned(),
            ));
        }
    }
    let title = format!("Pliant: {}", options.name);
    let (width, height) = options.size;
    let made = std::panic::catch_unwind(|| {
        kiss3d::pollster::block_on(Window::new_with_size(&title, width, height))
    });
    made.map_err(|panic| {
        let why = words(&*panic);
        let first = why.lines().next().unwrap_or_default().to_owned();
        let of_screen = ["event loop", "create window"]
            .iter()
            .any(|words| why.contains(words));
        if of_screen {
            WindowError::NoDisplay(first)
        } else {
            WindowError::NoGraphics(first)
        }
    })
}

/// Displays an empty window until the session is ready, then the session, until the window is
/// closed.
async fn shown(
    mut window: Window,
    starting: JoinHandle<Result<Session, StartError>>,
    options: &Options,
    trace: Option<Trace>,
) -> Result<Option<String>, WindowError> {
    prepare(&mut window);
    let mut lens = empty_lens(&window);
    let mut nodes = SceneNodes::new();
    nodes.rehearse();
    while !starting.is_finished() {
        SceneNodes::rehearse_lines(&mut window);
        window.draw_ui(|ctx| reading(ctx, &options.name));
        if !window.render_3d(nodes.root(), &mut lens).await {
            // Closed before the first picture: the thread ends with the process.
            return Ok(None);
        }
        // A text does not need sixty pictures per second, and the reading needs the processor.
        std::thread::sleep(READING);
    }
    let session = match begun(starting) {
        Ok(session) => session,
        Err(error) => {
            // The library panics if a window closes before its first picture.
            window.render_3d(nodes.root(), &mut lens).await;
            return Err(error);
        }
    };
    let first = session.latest();
    let panel = f64::from(PANEL) * window.scale_factor();
    let aspect = (lens.window.0 - panel) / lens.window.1.max(1.0);
    lens.camera = fitted(&first, aspect);
    let mut viewer = Viewer::new(options, session, &first, lens, nodes, trace);
    loop {
        let begun = Instant::now();
        if !viewer.picture(&mut window).await || viewer.closes {
            // An unfinished film is written.
            return Ok(viewer.capture.close());
        }
        let took = begun.elapsed();
        if took > SLOW && viewer.heard.elapsed() > LATELY {
            std::thread::sleep(took.min(4 * SLOW));
        }
    }
}

/// Sets background, light and antialiasing.
fn prepare(window: &mut Window) {
    window.set_background_color(scene_nodes::ink(BACKGROUND, 1.0));
    window.set_ambient(0.45);
    // Colours represent numbers: only the shading may change them.
    window.set_tonemap(Tonemap::None);
    window.set_shadows_enabled(false);
    // With slow pictures a click takes longer than the library expects.
    window
        .egui_context()
        .options_mut(|options| options.input_options.max_click_duration = f64::INFINITY);
    window.set_samples(if is_drawn_by_processor() {
        NumSamples::One
    } else {
        NumSamples::Four
    });
}

/// A lens for a window without bodies.
fn empty_lens(window: &Window) -> Lens {
    let nothing = Aabb {
        min: Point3::origin(),
        max: Point3::origin(),
    };
    let size = window.size();
    Lens {
        camera: Camera::fit(&nothing, Vector3::z(), Vector3::y()),
        window: (f64::from(size.x), f64::from(size.y)),
        panel: 0.0,
    }
}

impl<'a> Viewer<'a> {
    fn new(
        options: &'a Options,
        session: Session,
        first: &Shot,
        lens: Lens,
        nodes: SceneNodes,
        trace: Option<Trace>,
    ) -> Self {
        Self {
            options,
            session,
            lens,
            nodes,
            settings: ViewSettings::default(),
            colouring: Colouring::new(Field::Stretch),
            history: if options.replayed {
                History::of_finished_run()
            } else {
                History::default()
            },
            pointer: Pointer::default(),
            state: panel::State::default(),
            has_panel: true,
            panel_width: PANEL,
            closes: false,
            by_processor: is_drawn_by_processor(),
            frame: first.frame,
            fitted_to: first.stage.bodies.len(),
            driver: Context::get().adapter.get_info().name,
            pictures: VecDeque::new(),
            trace,
            capture: Capture::new(&options.folder, &options.stem),
            heard: Instant::now(),
        }
    }
}

/// True if a software driver replaces a graphics card. Only the name of the adapter type is
/// available here.
fn is_drawn_by_processor() -> bool {
    format!("{:?}", Context::get().adapter.get_info().device_type) == "Cpu"
}

/// Displays a text during the reading of meshes.
fn reading(ctx: &egui::Context, name: &str) {
    egui::Area::new(egui::Id::new("reading"))
        .anchor(egui::Align2::CENTER_CENTER, egui::Vec2::ZERO)
        .show(ctx, |ui| {
            ui.label(format!("reading {name} …"));
        });
}
