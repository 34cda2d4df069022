//! Window data for tests: positions and values of the widgets, a line of JSON per picture.

use std::fs::File;
use std::io::Write;
use std::path::Path;

use kiss3d::egui::Response;
use serde_json::{Value as Json, json};

use crate::Snapshot;
use crate::panel::{Control, Value};

/// The widgets of one picture.
#[derive(Debug, Default)]
pub struct Widgets {
    is_enabled: bool,
    all: Vec<Json>,
}

impl Widgets {
    pub fn new(is_enabled: bool) -> Self {
        Self {
            is_enabled,
            all: Vec::new(),
        }
    }

    pub fn seen(&mut self, name: &str, response: &Response) {
        self.add(name, response, Json::Null);
    }

    pub fn control(&mut self, name: &str, response: &Response, control: &Control, value: Value) {
        if !self.is_enabled {
            return;
        }
        let mut shown = control.clone();
        shown.value = value;
        self.add(name, response, json!({ "share": shown.share() }));
    }

    fn add(&mut self, name: &str, response: &Response, value: Json) {
        if self.is_enabled {
            let rect = response.rect;
            self.all.push(json!({
                "name": name,
                "rect": [rect.left(), rect.top(), rect.right(), rect.bottom()],
                "value": value,
            }));
        }
    }
}

/// The output of the trace.
#[derive(Debug)]
pub struct Trace {
    file: File,
    pictures: u64,
}

impl Trace {
    pub fn create(path: &Path) -> std::io::Result<Self> {
        Ok(Self {
            file: File::create(path)?,
            pictures: 0,
        })
    }

    /// Writes a line for a complete picture; after an error nothing more is written.
    pub fn picture(
        &mut self,
        shot: &Snapshot,
        widgets: Widgets,
        waiting: usize,
        vertices: &[[f64; 2]],
    ) {
        self.pictures += 1;
        let handles: Vec<&str> = shot
            .handles
            .iter()
            .map(|handle| handle.name.as_str())
            .collect();
        let line = json!({
            "picture": self.pictures,
            "frame": shot.frame,
            "running": shot.running,
            "answered": shot.answered,
            "waiting": waiting,
            "refused": shot.refused.as_ref().map(|(_, why)| why),
            "failed": shot.failed,
            "frame_ms": shot.frame_ms,
            "dragged": shot.bodies.iter().map(|body| body.dragged.map(|(v, _)| v)).collect::<Vec<_>>(),
            "fixed": shot.bodies.iter().map(|body| body.fixed.clone()).collect::<Vec<_>>(),
            "probe": shot.probe.as_ref().map(|probe| [probe.body, probe.vertex]),
            "readings": shot.readings.iter().map(|r| json!([r.name, r.value])).collect::<Vec<_>>(),
            "handles": handles,
            "places": vertices,
            "widgets": widgets.all,
        });
        let _ = writeln!(self.file, "{line}").and_then(|()| self.file.flush());
    }
}
