//! The panel: state of the run, all controls, visible objects, the picked vertex.

use std::ops::RangeInclusive;

use kiss3d::egui::emath::Numeric;
use kiss3d::egui::{self, Color32, RichText, Slider, SliderClamping, Ui};

use super::plots;
use super::scene_nodes::ViewSettings;
use super::trace::Widgets;
use crate::colour::{Colouring, Field};
use crate::history::History;
use crate::panel::{Control, Kind, Scale, Value};
use crate::{Command, Snapshot, Speed, Tissue};

/// Least and greatest multiple of real time.
const SPEEDS: (f64, f64) = (0.05, 20.0);

/// State of the panel between pictures.
#[derive(Debug, Default)]
pub struct State {
    /// Unanswered changes: name of the control, number of the command, value.
    waiting: Vec<(String, u64, Value)>,
    /// Message of the last picture or recording.
    pub message: String,
    pub recording: bool,
    pub help: bool,
    /// Requests by keys.
    pub requests: Vec<PanelRequest>,
}

impl State {
    /// Number of moved controls whose commands are not answered yet.
    pub fn waiting(&self, answered: u64) -> usize {
        self.waiting
            .iter()
            .filter(|(_, number, _)| *number > answered)
            .count()
    }
}

/// Requests of the panel to the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PanelRequest {
    Picture,
    Record,
    FirstView,
    View([i8; 3]),
}

/// The data of the panel.
pub struct Panel<'a> {
    pub shot: &'a Snapshot,
    pub state: &'a mut State,
    pub settings: &'a mut ViewSettings,
    pub colouring: &'a mut Colouring,
    pub history: &'a History,
    /// Pictures per second.
    pub pictures: f64,
    /// The driver that draws: a graphics card, or a program on the processor.
    pub driver: &'a str,
    pub replayed: bool,
    pub widgets: &'a mut Widgets,
    /// Sends a command. Returns its number.
    pub send: &'a mut dyn FnMut(Command) -> u64,
    pub requests: &'a mut Vec<PanelRequest>,
}

/// The name of a control, as in tests and in unanswered changes.
fn name_of(control: &Control) -> String {
    format!("{}/{}", control.group, control.label)
}

impl Panel<'_> {
    pub fn show(&mut self, ui: &mut Ui) {
        self.head(ui);
        self.run(ui);
        self.save(ui);
        self.controls(ui);
        self.view(ui);
        self.times(ui);
        self.plots(ui);
    }

    /// Temporary information over the scene, so that the panel does not move: the selected vertex,
    /// notes and messages.
    pub fn overlay(&mut self, ui: &mut Ui) {
        self.picked(ui);
        self.messages(ui);
    }

    /// True if there is any such information.
    pub fn tells(&self) -> bool {
        let shot = self.shot;
        let stopped = shot.bodies.iter().any(|body| body.stopped.is_some());
        let requests =
            !self.state.message.is_empty() || shot.refused.is_some() || shot.failed.is_some();
        requests || stopped || shot.probe.is_some() || !shot.notes.is_empty()
    }

    fn button(&mut self, ui: &mut Ui, name: &'static str, hint: &str) -> bool {
        let response = ui.button(name).on_hover_text(hint);
        self.widgets.seen(name, &response);
        response.clicked()
    }

    fn check(&mut self, ui: &mut Ui, name: &'static str, on: &mut bool) {
        let response = ui.checkbox(on, name);
        self.widgets.seen(name, &response);
    }

    fn slide<T: Numeric>(
        &mut self,
        ui: &mut Ui,
        name: &'static str,
        value: &mut T,
        range: RangeInclusive<T>,
    ) {
        let response = ui.add(Slider::new(value, range).text(name));
        self.widgets.seen(name, &response);
    }

    fn head(&mut self, ui: &mut Ui) {
        let shot = self.shot;
        let state = match (&shot.failed, shot.running) {
            (Some(_), _) => RichText::new("failed").color(Color32::LIGHT_RED),
            (None, true) => RichText::new("running"),
            (None, false) => RichText::new("paused"),
        };
        ui.horizontal(|ui| {
            // A subject without an end continues after the last frame of its scene.
            let end = if shot.frame > shot.last_frame {
                String::new()
            } else {
                format!(" of {}", shot.last_frame)
            };
            ui.strong(format!("frame {}{end}", shot.frame));
            ui.label(state);
        });
        // A driver on the processor draws less than ten pictures a second.
        let digits = usize::from(self.pictures < 10.0);
        let rate = format!(
            "{:.digits$} pictures a second; simulation {:.1} frames a second, {:.1} ms a frame",
            self.pictures, shot.frames_per_second, shot.frame_ms
        );
        ui.label(rate);
        ui.weak(format!("drawn by {}", self.driver));
    }

    fn run(&mut self, ui: &mut Ui) {
        ui.horizontal(|ui| {
            let (name, command) = if self.shot.running {
                ("Pause", Command::Pause)
            } else {
                ("Run", Command::Run)
            };
            if self.button(ui, name, "Space") {
                (self.send)(command);
            }
            if self.button(ui, "Step", "one frame, then pause: .") {
                (self.send)(Command::Step);
            }
            if self.button(ui, "Reset", "back to the start: R") {
                (self.send)(Command::Reset);
            }
            if self.replayed && self.button(ui, "Backward", "frames follow backwards") {
                (self.send)(Command::Backwards(true));
                (self.send)(Command::Run);
            }
            if self.replayed && self.button(ui, "Forward", "frames follow forwards") {
                (self.send)(Command::Backwards(false));
                (self.send)(Command::Run);
            }
        });
        if self.replayed {
            let mut frame = self.shot.frame;
            let response = ui.add(Slider::new(&mut frame, 0..=self.shot.last_frame).text("frame"));
            self.widgets.seen("frame", &response);
            if response.changed() {
                (self.send)(Command::Seek { frame });
            }
        }
        ui.horizontal(|ui| {
            let mut free = self.shot.speed == Speed::Free;
            let mut share = match self.shot.speed {
                Speed::Share(share) => share,
                Speed::Free => 1.0,
            };
            let slider = Slider::new(&mut share, SPEEDS.0..=SPEEDS.1)
                .logarithmic(true)
                .text("of real time");
            let response = ui.add_enabled(!free, slider.clamping(SliderClamping::Never));
            self.widgets.seen("speed", &response);
            if response.changed() {
                (self.send)(Command::Speed(Speed::Share(share)));
            }
            let response = ui.checkbox(&mut free, "as fast as it can");
            self.widgets.seen("as fast as it can", &response);
            if response.changed() {
                (self.send)(Command::Speed(if free {
                    Speed::Free
                } else {
                    Speed::Share(1.0)
                }));
            }
        });
    }

    fn messages(&mut self, ui: &mut Ui) {
        let wrapped = |ui: &mut Ui, text: String, colour| {
            ui.add(egui::Label::new(RichText::new(text).color(colour)).wrap());
        };
        if let Some(why) = &self.shot.failed {
            wrapped(ui, format!("{why}; Reset starts again"), Color32::LIGHT_RED);
        }
        for (body, stage) in self.shot.bodies.iter().zip(&self.shot.stage.bodies) {
            if let Some((frame, why)) = &body.stopped {
                let text = format!(
                    "{}: stopped at frame {frame}, {why}; Reset starts again",
                    stage.name
                );
                wrapped(ui, text, Color32::LIGHT_RED);
            }
        }
        if let Some((_, why)) = &self.shot.refused {
            wrapped(ui, format!("not done: {why}"), Color32::YELLOW);
        }
        let shot = self.shot;
        if !shot.notes.is_empty() {
            egui::CollapsingHeader::new("Notes")
                .default_open(true)
                .show(ui, |ui| {
                    shot.notes
                        .iter()
                        .for_each(|note| wrapped(ui, note.clone(), Color32::GRAY));
                });
        }
        if !self.state.message.is_empty() {
            wrapped(ui, self.state.message.clone(), Color32::LIGHT_GREEN);
        }
    }

    fn times(&mut self, ui: &mut Ui) {
        if !self.shot.effects.is_empty() {
            let shot = self.shot;
            egui::CollapsingHeader::new("Time of each effect")
                .default_open(true)
                .show(ui, |ui| plots::bars(ui, &shot.effects));
        }
    }

    fn controls(&mut self, ui: &mut Ui) {
        let answered = self.shot.answered;
        self.state
            .waiting
            .retain(|(_, number, _)| *number > answered);
        let controls = self.shot.controls.clone();
        let mut groups: Vec<(&str, Vec<&Control>)> = Vec::new();
        for control in controls.iter() {
            match groups.iter_mut().find(|(name, _)| *name == control.group) {
                Some((_, members)) => members.push(control),
                None => groups.push((&control.group, vec![control])),
            }
        }
        for (name, members) in groups {
            // A single switch needs no heading.
            if let [control] = members[..] {
                self.control(ui, control);
                continue;
            }
            egui::CollapsingHeader::new(capital(name))
                .id_salt(("group", name))
                .default_open(true)
                .show(ui, |ui| {
                    members.iter().for_each(|control| self.control(ui, control));
                });
        }
    }

    fn control(&mut self, ui: &mut Ui, control: &Control) {
        let name = name_of(control);
        let waiting = self
            .state
            .waiting
            .iter()
            .rev()
            .find(|(known, ..)| *known == name)
            .map(|(.., value)| *value);
        let before = waiting.unwrap_or_else(|| control.now(self.shot));
        let (response, after) = widget(ui, control, before);
        self.widgets.control(&name, &response, control, before);
        if after == before {
            return;
        }
        match control.command(after) {
            Ok(command) => {
                let number = (self.send)(command);
                self.state.waiting.push((name, number, after));
            }
            Err(error) => self.state.message = error.to_string(),
        }
    }

    fn view(&mut self, ui: &mut Ui) {
        egui::CollapsingHeader::new("View")
            .default_open(true)
            .show(ui, |ui| {
                self.directions(ui);
                self.fields(ui);
                self.visible(ui);
                self.light(ui);
            });
    }

    /// The directions of view.
    fn directions(&mut self, ui: &mut Ui) {
        let views: [(&'static str, [i8; 3]); 4] = [
            ("Front", [0, 0, 1]),
            ("Side", [1, 0, 0]),
            ("Back", [0, 0, -1]),
            ("Top", [0, 1, 0]),
        ];
        ui.horizontal(|ui| {
            if self.button(ui, "First", "as at the start: H") {
                self.requests.push(PanelRequest::FirstView);
            }
            for (name, from) in views {
                if self.button(ui, name, "from there") {
                    self.requests.push(PanelRequest::View(from));
                }
            }
        });
    }

    /// The choice of the coloured field among those with values.
    fn fields(&mut self, ui: &mut Ui) {
        let bodies = &self.shot.bodies;
        let there: Vec<Field> = Field::ALL
            .into_iter()
            .filter(|field| bodies.iter().any(|body| !field.values(body).is_empty()))
            .collect();
        ui.horizontal(|ui| {
            if !there.is_empty() {
                ui.label("colours");
            }
            for field in there {
                let response = ui.selectable_label(self.colouring.field == field, field.name());
                self.widgets.seen(field.name(), &response);
                if response.clicked() {
                    *self.colouring = Colouring::new(field);
                }
            }
        });
    }

    /// The opacity of bones and skin, and what is displayed with the bodies.
    fn visible(&mut self, ui: &mut Ui) {
        let mut settings = self.settings.clone();
        let stage = self.shot.stage.clone();
        let has_bones =
            !stage.bones.is_empty() || stage.bodies.iter().any(|body| body.tissue == Tissue::Bone);
        if has_bones {
            self.slide(ui, "bones", &mut settings.bones, 0.0..=1.0);
        }
        if stage.bodies.iter().any(|body| body.tissue == Tissue::Skin) {
            self.slide(ui, "skin", &mut settings.skin, 0.0..=1.0);
        }
        ui.horizontal(|ui| {
            self.check(ui, "wire frame", &mut settings.wireframe);
            if stage.bodies.iter().any(|body| !body.fibres.is_empty()) {
                self.check(ui, "fibres", &mut settings.fibres);
            }
        });
        ui.horizontal(|ui| {
            if stage.bodies.iter().any(|body| !body.held.is_empty()) {
                self.check(ui, "attachments", &mut settings.attachments);
            }
            // Only scenes of muscles report contact.
            let scene = self.shot.scene.as_ref();
            if scene.is_some_and(|scene| scene.effects.contact.is_some()) {
                self.check(ui, "contacts", &mut settings.contacts);
            }
        });
        *self.settings = settings;
    }

    /// The direction of the light [rad].
    fn light(&mut self, ui: &mut Ui) {
        let pi = std::f64::consts::PI;
        let (mut right, mut above) = self.settings.light;
        self.slide(ui, "light from the right", &mut right, -pi..=pi);
        self.slide(ui, "light from above", &mut above, -0.5 * pi..=0.5 * pi);
        self.settings.light = (right, above);
    }

    fn picked(&mut self, ui: &mut Ui) {
        let Some(probe) = &self.shot.probe else {
            return;
        };
        let (Some(body), Some(stage)) = (
            self.shot.bodies.get(probe.body),
            self.shot.stage.bodies.get(probe.body),
        ) else {
            return;
        };
        let Some(place) = body.positions.get(probe.vertex) else {
            return;
        };
        let (b, vertex) = (probe.body, probe.vertex);
        ui.strong(format!("vertex {vertex} of {}", stage.name));
        ui.label(format!(
            "at {:.2}, {:.2}, {:.2} mm",
            1e3 * place.x,
            1e3 * place.y,
            1e3 * place.z
        ));
        for (name, value, unit) in &probe.values {
            ui.label(format!("{name}: {value:.4} {unit}"));
        }
        ui.horizontal(|ui| {
            if self.button(ui, "Fix", "holds it where it is") {
                (self.send)(Command::Fix { body: b, vertex });
            }
            if self.button(ui, "Free", "lets it go") {
                (self.send)(Command::Free { body: b, vertex });
            }
            if self.button(ui, "Forget", "Esc") {
                (self.send)(Command::Probe(None));
            }
        });
    }

    fn plots(&mut self, ui: &mut Ui) {
        let all = self.history.plots();
        if all.is_empty() {
            return;
        }
        egui::CollapsingHeader::new("Plots")
            .default_open(true)
            .show(ui, |ui| {
                all.iter()
                    .for_each(|(name, lines)| plots::plot(ui, name, lines));
            });
    }

    fn save(&mut self, ui: &mut Ui) {
        ui.horizontal(|ui| {
            if self.button(ui, "Picture", "the scene as a PNG: P") {
                self.requests.push(PanelRequest::Picture);
            }
            let name = if self.state.recording {
                "Stop recording"
            } else {
                "Record"
            };
            if self.button(ui, name, "an animated GIF: G") {
                self.requests.push(PanelRequest::Record);
            }
            let mut help = self.state.help;
            self.check(ui, "keys", &mut help);
            self.state.help = help;
        });
    }
}

/// The widget of a control, and its value afterwards.
fn widget(ui: &mut Ui, control: &Control, value: Value) -> (egui::Response, Value) {
    let label = match control.unit {
        "" => control.label.clone(),
        unit => format!("{} [{unit}]", control.label),
    };
    match (&control.kind, value) {
        (Kind::Slider { range, scale }, Value::Number(mut number)) => {
            let slider = Slider::new(&mut number, range.0..=range.1)
                .logarithmic(*scale == Scale::Logarithmic);
            let response = ui.add(slider.text(label));
            (response, Value::Number(number))
        }
        (Kind::Whole { range, scale }, Value::Whole(mut number)) => {
            let slider = Slider::new(&mut number, range.0..=range.1)
                .logarithmic(*scale == Scale::Logarithmic);
            let response = ui.add(slider.text(label));
            (response, Value::Whole(number))
        }
        (Kind::Choice(names), Value::Choice(mut chosen)) => {
            let shown = names.get(chosen).copied().unwrap_or("");
            let combo =
                egui::ComboBox::from_id_salt((&control.group, &control.label)).selected_text(shown);
            let response = ui.horizontal(|ui| {
                let inner = combo.show_ui(ui, |ui| {
                    names
                        .iter()
                        .enumerate()
                        .for_each(|(k, name)| drop(ui.selectable_value(&mut chosen, k, *name)));
                });
                ui.label(label);
                inner.response
            });
            (response.inner, Value::Choice(chosen))
        }
        (_, Value::On(mut on)) => (ui.checkbox(&mut on, label), Value::On(on)),
        // A control has a value of its kind.
        (_, other) => (ui.label(label), other),
    }
}

fn capital(name: &str) -> String {
    let mut letters = name.chars();
    letters
        .next()
        .map(|first| first.to_uppercase().chain(letters).collect())
        .unwrap_or_default()
}
