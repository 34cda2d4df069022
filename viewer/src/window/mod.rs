//! The window of the viewer: displays a session and passes the user's actions to it.

mod capture;
mod scene_nodes;
mod pointer;
mod lens;
mod panel;
mod plots;
mod start;
mod trace;

use std::path::PathBuf;
use std::time::Instant;

use kiss3d::egui;
use kiss3d::prelude::{NumSamples, Window};
use nalgebra::{Point3, Vector3};

use super::Session;
use super::camera::Camera;
use super::colour::{Colouring, Field};
use super::history::History;
use super::recipe::StartError;
use super::snapshot::{Shot, Snapshot};
use capture::Capture;
use lens::Lens;
use panel::{Panel, PanelRequest};
use pliant::mesh::measures::Aabb;
use pointer::{Pointer, Request};
use scene_nodes::{SceneNodes, ViewSettings};
pub use start::show;
use trace::{Trace, Widgets};

/// Least width of the panel [points].
const PANEL: f32 = 370.0;

/// Share of the vertices within the range of colours.
const COVERED: f64 = 0.98;

/// Number of pictures in the mean picture rate.
const RATED: usize = 30;

/// Options of a window.
#[derive(Clone, Debug)]
pub struct Options {
    /// Displayed name.
    pub name: String,
    /// Base name of saved pictures.
    pub stem: String,
    /// Width and height [px].
    pub size: (u32, u32),
    /// True if a finished run is played.
    pub replayed: bool,
    /// Folder of pictures and recordings.
    pub folder: PathBuf,
    /// A file with a line of JSON per picture, for tests.
    pub trace: Option<PathBuf>,
}

/// The reason why no window appears, or why it closed.
#[derive(Debug, thiserror::Error)]
pub enum WindowError {
    /// There is no display.
    #[error("no display to open a window on ({0})")]
    NoDisplay(String),
    /// There is no graphics card and no software driver.
    #[error("no graphics card or driver that can draw ({0})")]
    NoGraphics(String),
    /// The subject cannot be displayed.
    #[error("{0}")]
    Start(#[from] StartError),
    /// The trace cannot be written.
    #[error("{0}: {1}")]
    Trace(PathBuf, std::io::Error),
}

impl WindowError {
    /// Advice for the user.
    pub fn help(&self) -> &'static str {
        match self {
            Self::NoDisplay(_) => {
                "run it on a desktop, or under `xvfb-run`; without a display use `pliant run`, which writes pictures"
            }
            Self::NoGraphics(_) => {
                "install a Vulkan driver (Debian: mesa-vulkan-drivers, which also draws without a graphics card), or use \
                 `pliant run`, which writes pictures"
            }
            Self::Start(_) => "see the message",
            Self::Trace(..) => "name a file that can be written",
        }
    }
}

/// A camera that shows all bodies from outside.
fn fitted(shot: &Shot, aspect: f64) -> Camera {
    let boxes = shot
        .bodies
        .iter()
        .filter(|b| !b.positions.is_empty())
        .map(|b| Aabb::of_points(&b.positions));
    let bounds = boxes.reduce(|a, b| a.union(&b)).unwrap_or(Aabb {
        min: Point3::origin(),
        max: Point3::origin(),
    });
    Camera::fit(&bounds, outward(shot), up(shot)).in_window(aspect)
}

fn up(shot: &Shot) -> Vector3<f64> {
    shot.scene
        .as_ref()
        .map_or_else(Vector3::y, |scene| scene.up)
}

/// Direction from the bones to the bodies, slightly from above.
fn outward(shot: &Shot) -> Vector3<f64> {
    let mean = |points: &mut dyn Iterator<Item = Point3<f64>>| {
        let (sum, count) = points.fold((Vector3::zeros(), 0.0), |(sum, count), p| {
            (sum + p.coords, count + 1.0)
        });
        (count > 0.0).then(|| sum / count)
    };
    let bodies = mean(
        &mut shot
            .bodies
            .iter()
            .flat_map(|body| body.positions.iter().copied()),
    );
    let bones = shot.bones.iter().zip(&shot.stage.bones);
    let bones =
        mean(&mut bones.flat_map(|(bone, (_, mesh))| mesh.vertices.iter().map(|v| bone.pose * v)));
    let away = bodies
        .zip(bones)
        .map(|(a, b)| a - b)
        .and_then(|away| away.try_normalize(0.0));
    away.unwrap_or_else(|| Vector3::new(0.5, 0.0, 1.0).normalize()) + up(shot) * 0.15
}

/// The state of a window.
struct Viewer<'a> {
    options: &'a Options,
    session: Session,
    lens: Lens,
    nodes: SceneNodes,
    settings: ViewSettings,
    colouring: Colouring,
    history: History,
    pointer: Pointer,
    state: panel::State,
    has_panel: bool,
    /// Width required by the widgets [points].
    panel_width: f32,
    closes: bool,
    /// True without a graphics card.
    by_processor: bool,
    /// Frame of the last picture.
    frame: usize,
    fitted_to: usize,
    /// Name of the driver that draws.
    driver: String,
    pictures: std::collections::VecDeque<Instant>,
    trace: Option<Trace>,
    capture: Capture,
    /// Time of the last pointer motion or key.
    heard: Instant,
}

impl Viewer<'_> {
    /// Draws one picture. Returns false if the window is closed.
    async fn picture(&mut self, window: &mut Window) -> bool {
        let shot = self.session.latest();
        self.see(&shot);
        self.resize(window);
        self.hear(window, &shot);
        let before = self.colouring.clone();
        let mut widgets = Widgets::new(self.trace.is_some());
        let requests = self.interface(window, &shot, &mut widgets);
        let is_recoloured = before != self.colouring;
        self.set_scene(window, &shot, is_recoloured);
        let open = window.render_3d(self.nodes.root(), &mut self.lens).await;
        let seen = (self.lens.window.0 - self.lens.panel).max(1.0) as usize;
        if let Some(said) = self.capture.rendered(window, seen) {
            self.state.message = said;
        }
        requests
            .into_iter()
            .for_each(|request| self.answer(request));
        self.state.recording = self.capture.is_recording();
        if let Some(trace) = &mut self.trace {
            let waiting = self.state.waiting(shot.answered);
            let vertices = places(grips(&shot, &self.lens), &self.lens);
            trace.picture(&shot, widgets, waiting, &vertices);
        }
        self.pictures.push_back(Instant::now());
        if self.pictures.len() > RATED {
            self.pictures.pop_front();
        }
        open
    }

    /// Adds a snapshot to the history and to the range of colours. Shows all bodies if their number
    /// changed.
    fn see(&mut self, shot: &Shot) {
        self.history.see(shot);
        if shot.frame < self.frame && !self.options.replayed {
            // A restart has its own range.
            self.colouring = Colouring::new(self.colouring.field);
        }
        self.frame = shot.frame;
        if self.fitted_to != shot.stage.bodies.len() {
            self.fitted_to = shot.stage.bodies.len();
            let seen = self.lens.window.0 - self.lens.panel;
            self.lens.camera = fitted(shot, seen / self.lens.window.1.max(1.0));
        }
        for body in &shot.bodies {
            let mut values = self.colouring.field.values(body);
            values.sort_unstable_by(f64::total_cmp);
            // A few extreme vertices must not make the rest pale.
            let covered = (COVERED * values.len() as f64) as usize;
            self.colouring.see(&values[..covered]);
        }
    }

    /// Takes the sizes of the window and of the panel [px].
    fn resize(&mut self, window: &Window) {
        let scale = window.scale_factor();
        let size = window.size();
        self.lens.window = (f64::from(size.x), f64::from(size.y));
        self.lens.panel = if self.has_panel {
            f64::from(self.panel_width) * scale
        } else {
            0.0
        };
    }

    /// Updates the nodes of the scene.
    fn set_scene(&mut self, window: &mut Window, shot: &Snapshot, is_recoloured: bool) {
        // Antialiasing doubles the cost on a processor; a saved picture has it.
        let is_fine = !self.by_processor || self.capture.is_picture_requested();
        window.set_samples(if is_fine {
            NumSamples::Four
        } else {
            NumSamples::One
        });
        self.nodes
            .update(shot, shot.serial, &self.colouring, is_recoloured);
        self.nodes.style(
            &self.settings,
            shot,
            &self.colouring,
            &self.lens.camera.rotation,
        );
        self.nodes.overlay(window, shot, &self.settings);
    }

    /// Pictures per second.
    fn rate(&self) -> f64 {
        match (self.pictures.front(), self.pictures.back()) {
            (Some(first), Some(last)) if last > first => {
                (self.pictures.len() - 1) as f64 / (*last - *first).as_secs_f64()
            }
            _ => 0.0,
        }
    }

    /// Handles mouse and keyboard.
    fn hear(&mut self, window: &mut Window, shot: &Snapshot) {
        let typing = window.is_egui_capturing_keyboard();
        let (widgets, scale) = (window.egui_context().clone(), window.scale_factor());
        let is_covered = |x: f64, y: f64| {
            let layer = widgets.layer_id_at(egui::pos2((x / scale) as f32, (y / scale) as f32));
            layer.is_some_and(|layer| layer.order != egui::Order::Background)
        };
        let field = pointer::Field {
            width: self.lens.window.0 - self.lens.panel,
            height: self.lens.window.1,
        };
        let mut requests = Vec::new();
        for event in window.events().iter() {
            self.heard = Instant::now();
            if typing && event.value.is_keyboard_event() {
                continue;
            }
            let (command, request) =
                self.pointer
                    .take(&event.value, field, &mut self.lens.camera, shot, is_covered);
            if let Some(command) = command {
                self.session.send(command);
            }
            requests.extend(request);
        }
        if let Some(command) = self.pointer.moved() {
            self.session.send(command);
        }
        requests
            .into_iter()
            .for_each(|request| self.handle(request, shot));
    }

    fn handle(&mut self, request: Request, shot: &Shot) {
        let turn = |on: &mut bool| *on = !*on;
        match request {
            Request::NextField => {
                let there = |field: &Field| {
                    shot.bodies
                        .iter()
                        .any(|body| !field.values(body).is_empty())
                };
                let at = Field::ALL
                    .iter()
                    .position(|field| *field == self.colouring.field)
                    .unwrap_or(0);
                let next = Field::ALL
                    .iter()
                    .cycle()
                    .skip(at + 1)
                    .take(Field::ALL.len())
                    .find(|field| there(field));
                self.colouring = Colouring::new(next.copied().unwrap_or(self.colouring.field));
            }
            Request::Wireframe => turn(&mut self.settings.wireframe),
            Request::Fibres => turn(&mut self.settings.fibres),
            Request::Attachments => turn(&mut self.settings.attachments),
            Request::Contacts => turn(&mut self.settings.contacts),
            Request::Panel => turn(&mut self.has_panel),
            Request::Help => turn(&mut self.state.help),
            Request::Picture => self.state.requests.push(PanelRequest::Picture),
            Request::Record => self.state.requests.push(PanelRequest::Record),
            Request::Close => self.closes = true,
        }
    }

    /// The panel, the legend and the list of keys. Returns the requests.
    fn interface(
        &mut self,
        window: &mut Window,
        shot: &Snapshot,
        widgets: &mut Widgets,
    ) -> Vec<PanelRequest> {
        let mut requests = std::mem::take(&mut self.state.requests);
        let pictures = self.rate();
        let is_taking = self.capture.is_taking();
        let handles = places(
            shot.handles.iter().map(|handle| Some(handle.at)),
            &self.lens,
        );
        let session = &self.session;
        let mut send = |command| session.send(command);
        let (settings, colouring, history) =
            (&mut self.settings, &mut self.colouring, &self.history);
        let (state, has_panel, replayed) = (&mut self.state, self.has_panel, self.options.replayed);
        let (panel_width, driver) = (&mut self.panel_width, self.driver.as_str());
        window.draw_ui(|ctx| {
            let screen = ctx.content_rect();
            let (requests, send) = (&mut requests, &mut send);
            let mut panel = Panel {
                shot,
                state,
                settings,
                colouring,
                history,
                pictures,
                driver,
                replayed,
                widgets,
                send,
                requests,
            };
            if has_panel {
                *panel_width = beside(ctx, |ui| panel.show(ui));
            }
            if panel.tells() && !is_taking {
                over(ctx, 0.4 * screen.width(), |ui| panel.overlay(ui));
            }
            let (colouring, has_help) = (&*panel.colouring, panel.state.help);
            let painter = ctx.layer_painter(egui::LayerId::background());
            if shot
                .bodies
                .iter()
                .any(|body| !colouring.field.values(body).is_empty())
            {
                plots::legend(
                    &painter,
                    egui::pos2(screen.left() + 16.0, screen.bottom() - 16.0),
                    colouring,
                );
            }
            // In front of hiding objects: an implant is under skin.
            let points = handles
                .iter()
                .map(|[x, y]| egui::pos2(*x as f32, *y as f32) / ctx.pixels_per_point());
            plots::handles(&painter, points);
            if has_help {
                keys(ctx);
            }
        });
        requests
    }

    fn answer(&mut self, request: PanelRequest) {
        match request {
            PanelRequest::FirstView => self.lens.camera.reset(),
            PanelRequest::View(from) => {
                let from = Vector3::from(from.map(f64::from));
                let up = if from.y == 0.0 {
                    Vector3::y()
                } else {
                    -Vector3::z()
                };
                self.lens.camera = self.lens.camera.seen_from(from, up);
            }
            PanelRequest::Picture => self.capture.picture(),
            PanelRequest::Record => self.state.message = self.capture.record(),
        }
    }
}

/// A panel on the right of the window with its full height. Returns its width, which can exceed the
/// request.
fn beside(ctx: &egui::Context, contents: impl FnOnce(&mut egui::Ui)) -> f32 {
    let screen = ctx.content_rect();
    let shown = egui::Window::new("Panel")
        .title_bar(false)
        .resizable(false)
        .movable(false)
        .frame(egui::Frame::window(&ctx.global_style()).corner_radius(0.0))
        .fixed_pos(egui::pos2(screen.right() - PANEL, screen.top()))
        .fixed_size(egui::vec2(PANEL - 14.0, screen.height()))
        .show(ctx, |ui| {
            egui::ScrollArea::vertical()
                .auto_shrink(false)
                .show(ui, contents);
        });
    shown.map_or(PANEL, |shown| screen.right() - shown.response.rect.left())
}

/// A text box over the upper left of the scene.
fn over(ctx: &egui::Context, width: f32, contents: impl FnOnce(&mut egui::Ui)) {
    egui::Area::new(egui::Id::new("messages"))
        .fixed_pos(egui::pos2(12.0, 12.0))
        .show(ctx, |ui| {
            egui::Frame::popup(ui.style()).show(ui, |ui| {
                ui.set_max_width(width.min(PANEL));
                contents(ui);
            });
        });
}

/// The list of keys.
fn keys(ctx: &egui::Context) {
    egui::Area::new(egui::Id::new("keys"))
        .anchor(egui::Align2::CENTER_CENTER, egui::Vec2::ZERO)
        .show(ctx, |ui| {
            egui::Frame::popup(ui.style()).show(ui, |ui| {
                egui::Grid::new("keys").show(ui, |ui| {
                    for (keys, what) in pointer::HELP {
                        ui.strong(keys);
                        ui.label(what);
                        ui.end_row();
                    }
                });
            });
        });
}

/// Points that can be picked: handles, then for each body the vertex nearest to the eye.
fn grips(shot: &Shot, lens: &Lens) -> Vec<Option<Point3<f64>>> {
    let eye = lens.camera.eye();
    let nearest = |x: &Vec<Point3<f64>>| {
        x.iter()
            .copied()
            .min_by(|a, b| (a - eye).norm().total_cmp(&(b - eye).norm()))
    };
    let handles = shot.handles.iter().map(|handle| Some(handle.at));
    handles
        .chain(shot.bodies.iter().map(|body| nearest(&body.positions)))
        .collect()
}

/// Window positions [px] of points; (-1, -1) for none and for points behind the eye.
fn places(points: impl IntoIterator<Item = Option<Point3<f64>>>, lens: &Lens) -> Vec<[f64; 2]> {
    let (width, height) = (lens.window.0 - lens.panel, lens.window.1);
    let pixel = |p: Option<Point3<f64>>| {
        let seen = lens.camera.project(&p?)?;
        Some([
            0.5 * width + seen.x * height,
            0.5 * height - seen.y * height,
        ])
    };
    points
        .into_iter()
        .map(|p| pixel(p).unwrap_or([-1.0, -1.0]))
        .collect()
}
