//! The scene of the options of `pliant implant`.

use std::collections::HashSet;

use super::super::failure::Failure;
use super::super::scene_text::{SceneText, name_after, number, path, quoted};
use super::Arguments;

/// Words of scenes in advice, and those of this command.
const WORDS: &[(&str, &str)] = &[
    ("`repair = true` below it in a scene", "--repair"),
    ("`edge_length`", "--edge"),
    ("`unit`", "--unit"),
    ("`base`", "--base"),
    ("`at`", "--at"),
];

/// The user's text for one implant, key by key; missing keys come from the other options.
#[derive(Clone, Default)]
struct Own<'a>(Vec<(&'a str, &'a str)>);

/// The keys of an implant.
const KEYS: [&str; 7] = [
    "near-vertex",
    "at",
    "shape",
    "base",
    "volume",
    "fill",
    "long",
];

impl<'a> Own<'a> {
    fn of(text: &'a str) -> Result<Self, Failure> {
        let mut own = Self::default();
        for word in text.split_whitespace() {
            let (key, value) = word.split_once('=').unwrap_or((word, ""));
            if !KEYS.contains(&key) {
                let hint = format!("known keys: {}", KEYS.join(", "));
                return Err(Failure::usage(
                    format!("--implant: unknown key `{key}`"),
                    hint,
                ));
            }
            own.0.push((key, value));
        }
        for (first, second) in [("near-vertex", "at"), ("volume", "fill")] {
            if own.get(first).is_some() && own.get(second).is_some() {
                return Err(Failure::usage(
                    format!("--implant: {first} and {second} exclude each other"),
                    "give one of the two",
                ));
            }
        }
        Ok(own)
    }

    fn get(&self, key: &str) -> Option<&'a str> {
        let last = self.0.iter().rev().find(|(own, _)| *own == key);
        last.map(|(_, value)| *value)
    }
}

/// The name and the text of the scene.
pub(super) fn scene(arguments: &Arguments) -> Result<(String, SceneText), Failure> {
    let name = name_after(&arguments.skin, &mut HashSet::new())?;
    let mut made = SceneText::new(&name, WORDS);
    let file = path(&arguments.skin)?;
    made.begin("[[skin]]", "skin.0", "");
    made.put("name", quoted(&name), "");
    made.put("mesh", quoted(&file), &file);
    made.put_text("unit", "--unit", &arguments.unit);
    if arguments.repair {
        made.put("repair", "true", "--repair");
    }
    if let Some(edge) = &arguments.edge {
        made.put_text("edge_length", "--edge", edge);
    }
    made.put_text("thickness", "--thickness", &arguments.thickness);
    made.put_text("modulus", "--modulus", &arguments.modulus);
    made.put_text("bond", "--bond", &arguments.bond);
    let pocket = number(arguments.pocket);
    made.put("pocket", &pocket, &format!("--pocket {pocket}"));
    let limit = number(arguments.stretch_limit);
    made.put("stretch_limit", &limit, &format!("--stretch-limit {limit}"));
    if let Some(up) = &arguments.up {
        let numbers = triple("--up", up)?.map(number);
        let option = format!("--up {up}");
        made.put("up", format!("[{}]", numbers.join(", ")), &option);
    }
    if let Some(method) = &arguments.method {
        made.put_text("method", "--method", method);
    }
    let own: Vec<Own<'_>> = arguments
        .implant
        .iter()
        .map(|text| Own::of(text))
        .collect::<Result<_, _>>()?;
    let one = [Own::default()];
    let own = if own.is_empty() { &one[..] } else { &own };
    for (k, implant) in own.iter().enumerate() {
        let mut writer = Writer {
            made: &mut made,
            own: implant,
            prefix: if own.len() > 1 {
                format!("implant {}: ", k + 1)
            } else {
                String::new()
            },
        };
        writer.implant(arguments, k)?;
    }
    let mut used = HashSet::new();
    for (k, obstacle) in arguments.obstacle.iter().enumerate() {
        let (name, file) = (name_after(obstacle, &mut used)?, path(obstacle)?);
        made.begin("[[obstacle]]", &format!("obstacle.{k}"), "--obstacle");
        made.put("name", quoted(&name), "");
        made.put("mesh", quoted(&file), &format!("--obstacle {file}"));
        made.put_text("unit", "--unit", &arguments.unit);
    }
    Ok((name, made))
}

/// Writes one implant.
struct Writer<'a> {
    made: &'a mut SceneText,
    own: &'a Own<'a>,
    /// The number of the implant, if there are several.
    prefix: String,
}

impl<'a> Writer<'a> {
    fn implant(&mut self, arguments: &Arguments, k: usize) -> Result<(), Failure> {
        let option = self.prefix.trim_end_matches(": ").to_owned();
        self.made
            .begin("[[implant]]", &format!("implant.{k}"), &option);
        if !self.prefix.is_empty() {
            self.made.put("name", quoted(&option), "");
        }
        self.place(arguments)?;
        for (key, common) in [("shape", &arguments.shape), ("base", &arguments.base)] {
            let (option, text) = self.given(key, common);
            self.made.put_text(key, &option, text);
        }
        if let Some(text) = self.own.get("long").or(arguments.long.as_deref()) {
            let numbers = triple("--long", text)?.map(number);
            let option = format!("{}--long {text}", self.prefix);
            self.made
                .put("long", format!("[{}]", numbers.join(", ")), &option);
        }
        self.made.put_text(
            "depth",
            &format!("{}--depth", self.prefix),
            &arguments.depth,
        );
        self.volume(arguments)
    }

    /// The own text of a key or the common one, with its option.
    fn given<'b>(&self, key: &str, common: &'b str) -> (String, &'b str)
    where
        'a: 'b,
    {
        match self.own.get(key) {
            Some(text) if self.prefix.is_empty() => (format!("--implant: {key}"), text),
            Some(text) => (format!("{}{key}", self.prefix), text),
            None => (format!("{}--{key}", self.prefix), common),
        }
    }

    fn place(&mut self, arguments: &Arguments) -> Result<(), Failure> {
        let common = arguments.near_vertex.map(|n| n.to_string());
        let (vertex, at) = match (self.own.get("near-vertex"), self.own.get("at")) {
            (None, None) => (common.as_deref(), arguments.at.as_deref()),
            own => own,
        };
        match (vertex, at) {
            (Some(vertex), _) => {
                super::vertex(vertex).map_err(|help| {
                    Failure::usage(format!("--implant: `{vertex}` is no vertex"), help)
                })?;
                let option = format!("{}--near-vertex {vertex}", self.prefix);
                self.made.put("near_vertex", vertex, &option);
            }
            (None, Some(at)) => {
                triple("--at", at)?;
                let unit = &arguments.unit;
                let coordinates: Vec<String> = at
                    .split(',')
                    .map(|c| quoted(&format!("{} {unit}", c.trim())))
                    .collect();
                let option = format!("{}--at {at}", self.prefix);
                self.made
                    .put("at", format!("[{}]", coordinates.join(", ")), &option);
            }
            (None, None) => {
                return Err(Failure::usage(
                    "no place for the implant",
                    "name a vertex with --near-vertex or a point with --at",
                ));
            }
        }
        Ok(())
    }

    /// The volume, the list of volumes, or the target area.
    fn volume(&mut self, arguments: &Arguments) -> Result<(), Failure> {
        if let Some(area) = &arguments.target_area {
            self.made.put_text("target_area", "--target-area", area);
            return Ok(());
        }
        if let Some(list) = &arguments.volumes {
            let volumes: Vec<String> = (1..)
                .zip(list.split(','))
                .map(|(frame, text)| {
                    format!("{{ frame = {frame}, volume = {} }}", quoted(&in_cc(text)))
                })
                .collect();
            self.list(&volumes, &format!("--volumes {list}"));
            return Ok(());
        }
        // An implant with its own volume ignores the common days.
        let common = arguments.fill.as_deref();
        let common = common.filter(|_| self.own.get("volume").is_none());
        if let Some(text) = self.own.get("fill").or(common) {
            let fillings: Vec<String> = text.split(',').map(filling).collect::<Result<_, _>>()?;
            self.list(&fillings, &format!("{}--fill {text}", self.prefix));
            return Ok(());
        }
        let (option, text) = self.given("volume", &arguments.volume);
        self.made.put_text("volume", &option, text);
        Ok(())
    }

    fn list(&mut self, entries: &[String], option: &str) {
        let lines: Vec<String> = entries.iter().map(|e| format!("    {e},\n")).collect();
        self.made
            .put("fill", format!("[\n{}]", lines.concat()), option);
    }
}

/// A volume in cc if it has no unit.
fn in_cc(text: &str) -> String {
    let text = text.trim();
    match text.parse::<f64>() {
        Ok(_) => format!("{text} cc"),
        Err(_) => text.to_owned(),
    }
}

/// The entry of a day and a volume such as `7:60cc`.
fn filling(pair: &str) -> Result<String, Failure> {
    let refused = || {
        let hint = "write a day and a volume each, as in 0:30cc,7:60cc";
        Failure::usage(format!("--fill: cannot read `{pair}`"), hint)
    };
    let (day, volume) = pair.split_once(':').ok_or_else(refused)?;
    let day = day.trim();
    let number = match (day.parse::<i32>(), day.parse::<f64>()) {
        (Ok(whole), _) => whole.to_string(),
        (_, Ok(day)) => number(day),
        _ => return Err(refused()),
    };
    Ok(format!(
        "{{ day = {number}, volume = {} }}",
        quoted(volume.trim())
    ))
}

/// Three numbers between commas.
fn triple(what: &str, text: &str) -> Result<[f64; 3], Failure> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|n| n.trim().parse::<f64>()).collect();
    let numbers = numbers
        .ok()
        .and_then(|n| <[f64; 3]>::try_from(n).ok())
        .filter(|n| n.iter().all(|c| c.is_finite()));
    numbers.ok_or_else(|| {
        Failure::usage(
            format!("{what}: cannot read `{text}`"),
            "write three numbers, as in 0.1,0.2,0.3",
        )
    })
}
