//! Mouse and keyboard: their effects on the camera, and their commands to the session.

use kiss3d::prelude::{Action, Key, Modifiers, MouseButton, WindowEvent};
use nalgebra::{Point2, Point3, Vector2};

use crate::camera::Camera;
use crate::pick::{Picked, pick};
use crate::snapshot::Shot;
use crate::{Command, Snapshot};

/// Greatest motion between press and release of a click, relative to the window's height.
const CLICK: f64 = 0.006;

/// Drag distance equivalent to an arrow key, relative to the window's height.
const KEY: f64 = 0.02;

/// Zoom factor of a wheel notch.
const NOTCH: f64 = 0.9;

/// Scroll distance that the library reports for a wheel notch, and in pixels for a touch pad.
const SCROLL_PER_NOTCH: f64 = 10.0;

/// Present action of the pointer.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Grip {
    Orbit,
    Pan,
    Roll,
    /// A moved vertex or handle, its start position [m], and the start of the pointer.
    Moves(Picked, Point3<f64>, Point2<f64>),
}

/// Other requests by a key or a click.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// Selects the next field for the colours.
    NextField,
    Wireframe,
    Fibres,
    Attachments,
    Contacts,
    Picture,
    Record,
    Panel,
    Help,
    Close,
}

/// The part of the window with the scene [px].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Field {
    pub width: f64,
    pub height: f64,
}

impl Field {
    /// A window position [px] as a screen position of the camera.
    fn place(&self, x: f64, y: f64) -> Point2<f64> {
        Point2::new(
            (x - 0.5 * self.width) / self.height,
            (0.5 * self.height - y) / self.height,
        )
    }
}

/// Mouse and keyboard state between two pictures.
#[derive(Clone, Debug, Default)]
pub struct Pointer {
    at: Point2<f64>,
    /// The same in window coordinates [px].
    pixel: Option<[f64; 2]>,
    pressed: Option<(MouseButton, Point2<f64>)>,
    grip: Option<Grip>,
    /// The command of a pointer motion: only the last one per picture.
    moved: Option<Command>,
}

impl Pointer {
    /// Handles an event. Returns its command to the session, and its request to the window.
    /// `is_covered` is true for a window position [px] with a widget.
    pub fn take(
        &mut self,
        event: &WindowEvent,
        field: Field,
        camera: &mut Camera,
        shot: &Snapshot,
        is_covered: impl Fn(f64, f64) -> bool,
    ) -> (Option<Command>, Option<Request>) {
        // Not the last pointer position known to the widgets: between two slow pictures the pointer
        // can move and click.
        let is_over_scene = self.pixel.is_some_and(|[x, y]| !is_covered(x, y));
        match *event {
            WindowEvent::CursorPos(x, y, _) => {
                self.pixel = Some([x, y]);
                self.moves(field.place(x, y), camera);
            }
            WindowEvent::MouseButton(button, Action::Press, modifiers) if is_over_scene => {
                self.presses(button, modifiers, camera, shot);
            }
            WindowEvent::MouseButton(button, Action::Release, _) => {
                return self.lets_go(button, camera, shot);
            }
            WindowEvent::Scroll(_, notches, modifiers) if is_over_scene => {
                scroll(notches, modifiers, camera)
            }
            WindowEvent::Key(key, Action::Press, modifiers) => {
                return keyed(key, modifiers, camera, shot);
            }
            _ => {}
        }
        (None, None)
    }

    /// The command of the pointer motions since the last picture.
    pub fn moved(&mut self) -> Option<Command> {
        self.moved.take()
    }

    fn moves(&mut self, at: Point2<f64>, camera: &mut Camera) {
        let by = at - self.at;
        match self.grip {
            Some(Grip::Orbit) => camera.orbit(by),
            Some(Grip::Pan) => camera.pan(by),
            Some(Grip::Roll) => camera.roll(angle(&self.at, &at)),
            Some(Grip::Moves(picked, from, began)) => {
                let to = from + camera.in_plane_at(&from, at - began);
                self.moved = Some(match picked {
                    Picked::Vertex(body, vertex) => Command::Drag {
                        body,
                        vertex,
                        to,
                        stiffness: None,
                    },
                    Picked::Handle(handle) => Command::Move { handle, to },
                });
            }
            None => {}
        }
        self.at = at;
    }

    fn presses(&mut self, button: MouseButton, modifiers: Modifiers, camera: &Camera, shot: &Shot) {
        let plain = !modifiers.intersects(Modifiers::Shift | Modifiers::Control);
        let picked = if plain {
            pick(shot, camera, self.at, |_| true)
        } else {
            None
        };
        let grip = match (button, picked) {
            (MouseButton::Button1, Some(handle @ Picked::Handle(_))) => {
                place_of(&handle, shot).map(|p| (handle, p))
            }
            (MouseButton::Button2, Some(picked)) => place_of(&picked, shot).map(|p| (picked, p)),
            _ => None,
        };
        self.grip = match (grip, button) {
            (Some((picked, place)), _) => Some(Grip::Moves(picked, place, self.at)),
            (None, MouseButton::Button1) if modifiers.contains(Modifiers::Shift) => Some(Grip::Pan),
            (None, MouseButton::Button1) if modifiers.contains(Modifiers::Control) => {
                Some(Grip::Roll)
            }
            (None, MouseButton::Button1 | MouseButton::Button3) => Some(Grip::Orbit),
            _ => None,
        };
        self.pressed = Some((button, self.at));
    }

    fn lets_go(
        &mut self,
        button: MouseButton,
        camera: &Camera,
        shot: &Shot,
    ) -> (Option<Command>, Option<Request>) {
        let Some((_, began)) = self.pressed.filter(|(pressed, _)| *pressed == button) else {
            return (None, None);
        };
        self.pressed = None;
        let clicked = (self.at - began).norm() <= CLICK;
        match self.grip.take() {
            Some(Grip::Moves(Picked::Vertex(body, _), ..)) => {
                self.moved = None;
                (Some(Command::LetGo { body }), None)
            }
            Some(Grip::Orbit) if clicked && button == MouseButton::Button1 => {
                let picked = match pick(shot, camera, self.at, |_| true) {
                    Some(Picked::Vertex(body, vertex)) => Some((body, vertex)),
                    _ => None,
                };
                (Some(Command::Probe(picked)), None)
            }
            _ => (self.moved.take(), None),
        }
    }
}

fn place_of(picked: &Picked, shot: &Shot) -> Option<Point3<f64>> {
    match *picked {
        Picked::Vertex(body, vertex) => shot.bodies.get(body)?.positions.get(vertex).copied(),
        Picked::Handle(handle) => Some(shot.handles.get(handle)?.at),
    }
}

/// Angle of a pointer motion about the centre of the window, counter-clockwise [rad].
fn angle(from: &Point2<f64>, to: &Point2<f64>) -> f64 {
    let turn = libm::atan2(to.y, to.x) - libm::atan2(from.y, from.x);
    turn - 2.0 * std::f64::consts::PI * (turn / (2.0 * std::f64::consts::PI)).round()
}

fn scroll(distance: f64, modifiers: Modifiers, camera: &mut Camera) {
    let notches = distance / SCROLL_PER_NOTCH;
    if modifiers.contains(Modifiers::Control) {
        camera.pan(Vector2::new(KEY * notches, 0.0));
    } else if modifiers.contains(Modifiers::Shift) {
        camera.pan(Vector2::new(0.0, KEY * notches));
    } else {
        camera.zoom(libm::pow(NOTCH, notches));
    }
}

fn keyed(
    key: Key,
    modifiers: Modifiers,
    camera: &mut Camera,
    shot: &Snapshot,
) -> (Option<Command>, Option<Request>) {
    let arrow = match key {
        Key::Left => Some(Vector2::new(-KEY, 0.0)),
        Key::Right => Some(Vector2::new(KEY, 0.0)),
        Key::Up => Some(Vector2::new(0.0, KEY)),
        Key::Down => Some(Vector2::new(0.0, -KEY)),
        _ => None,
    };
    if let Some(by) = arrow {
        match (
            modifiers.contains(Modifiers::Shift),
            modifiers.contains(Modifiers::Control),
        ) {
            (true, _) => camera.pan(by),
            (_, true) => camera.roll(-by.x * std::f64::consts::PI),
            _ => camera.orbit(by),
        }
        return (None, None);
    }
    let tells = |command| (Some(command), None);
    let requests = |request| (None, Some(request));
    match key {
        Key::Space => tells(if shot.running {
            Command::Pause
        } else {
            Command::Run
        }),
        Key::Period => tells(Command::Step),
        Key::Comma => tells(Command::Seek {
            frame: shot.frame.saturating_sub(1),
        }),
        Key::R => tells(Command::Reset),
        Key::Home | Key::H => {
            camera.reset();
            (None, None)
        }
        Key::PageUp | Key::Equals => {
            camera.zoom(NOTCH);
            (None, None)
        }
        Key::PageDown | Key::Minus => {
            camera.zoom(1.0 / NOTCH);
            (None, None)
        }
        Key::C => requests(Request::NextField),
        Key::W => requests(Request::Wireframe),
        Key::F => requests(Request::Fibres),
        Key::A => requests(Request::Attachments),
        Key::T => requests(Request::Contacts),
        Key::P => requests(Request::Picture),
        Key::G => requests(Request::Record),
        Key::Tab => requests(Request::Panel),
        Key::F1 => requests(Request::Help),
        Key::Q => requests(Request::Close),
        Key::Escape => tells(Command::Probe(None)),
        _ => (None, None),
    }
}

/// The list of mouse and keyboard actions.
pub const HELP: [(&str, &str); 17] = [
    ("left drag", "turn"),
    ("Shift + left drag", "move"),
    ("Ctrl + left drag", "roll"),
    ("wheel", "nearer, further (Ctrl, Shift: move)"),
    ("arrow keys", "turn finely (Shift: move, Ctrl: roll)"),
    ("click", "select a vertex"),
    ("right drag", "pull a vertex, move a handle"),
    ("Space", "run, pause"),
    (". ,", "one frame on; back (finished runs)"),
    ("R", "reset"),
    ("H", "the first view again"),
    ("C", "next colouring"),
    ("W F A T", "wire frame, fibres, attachments, contacts"),
    ("P G", "picture, recording"),
    ("Tab", "hide the panel"),
    ("F1", "this list"),
    ("Q", "close"),
];
