//! Summaries against `docs/summary.schema.json`, by a validator of the part of JSON Schema that the file uses.

use std::fs;

use super::{Scratch, run, shown, text};
use serde_json::{Value, json as value};

const SCHEMA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/summary.schema.json");

/// Keywords that the validator knows: another one in the schema is an error, not a check that never fails.
const KNOWN: [&str; 21] = [
    "$schema",
    "$id",
    "$defs",
    "$ref",
    "title",
    "description",
    "type",
    "const",
    "enum",
    "required",
    "properties",
    "patternProperties",
    "additionalProperties",
    "propertyNames",
    "items",
    "minimum",
    "minItems",
    "maxItems",
    "allOf",
    "if",
    "then",
];

/// What is wrong with a value, each with its place.
fn faults(schema: &Value, value: &Value) -> Vec<String> {
    let mut all = Vec::new();
    check(schema, schema, value, "", &mut all);
    all
}

fn type_of(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "boolean",
        Value::Number(n) if n.is_i64() || n.is_u64() => "integer",
        Value::Number(_) => "number",
        Value::String(_) => "string",
        Value::Array(_) => "array",
        Value::Object(_) => "object",
    }
}

fn has_type(value: &Value, name: &str) -> bool {
    let own = type_of(value);
    own == name || (own == "integer" && name == "number")
}

/// A pattern of the schema: `_x$` is an ending, `.` anything.
fn fits(pattern: &str, key: &str) -> bool {
    match pattern.strip_suffix('$') {
        Some(end) => key.ends_with(end),
        None => pattern == ".",
    }
}

fn check(root: &Value, schema: &Value, value: &Value, at: &str, all: &mut Vec<String>) {
    if schema == &Value::Bool(false) {
        return all.push(format!("{at}: is not allowed"));
    }
    let Some(schema) = schema.as_object() else {
        return;
    };
    for (word, rule) in schema {
        if !KNOWN.contains(&word.as_str()) {
            all.push(format!("the validator does not know `{word}`"));
        }
        let list = || rule.as_array().into_iter().flatten();
        let wrong = match word.as_str() {
            "$ref" => {
                let path = rule.as_str().unwrap_or_default().trim_start_matches('#');
                match root.pointer(path) {
                    Some(schema) => check(root, schema, value, at, all),
                    None => all.push(format!("there is no {path} in the schema")),
                }
                false
            }
            "type" => match rule {
                Value::String(name) => !has_type(value, name),
                _ => !list().any(|name| has_type(value, name.as_str().unwrap_or_default())),
            },
            "const" => value != rule,
            "enum" => !list().any(|known| known == value),
            // What is no object, as a null, has no keys.
            "required" => {
                let absent = |key: &str| value.is_object() && value.get(key).is_none();
                let missing = list().filter(|key| absent(key.as_str().unwrap_or_default()));
                all.extend(missing.map(|key| format!("{at}: {key} is missing")));
                false
            }
            "items" => {
                for (k, item) in value.as_array().into_iter().flatten().enumerate() {
                    check(root, rule, item, &format!("{at}/{k}"), all);
                }
                false
            }
            "minimum" => match (value.as_f64(), rule.as_f64()) {
                (Some(value), Some(least)) => !(value >= least),
                _ => false,
            },
            "minItems" | "maxItems" => {
                let count = value.as_array().map(|all| all.len() as u64);
                match (count, rule.as_u64(), word.as_str()) {
                    (Some(count), Some(least), "minItems") => count < least,
                    (Some(count), Some(most), _) => count > most,
                    _ => false,
                }
            }
            "allOf" => {
                list().for_each(|rule| check(root, rule, value, at, all));
                false
            }
            "if" => {
                let mut against = Vec::new();
                check(root, rule, value, at, &mut against);
                if let Some(then) = schema.get("then").filter(|_| against.is_empty()) {
                    check(root, then, value, at, all);
                }
                false
            }
            _ => false,
        };
        if wrong {
            all.push(format!("{at}: {value} against {word} {rule}"));
        }
    }
    check_keys(root, schema, value, at, all);
}

fn check_keys(
    root: &Value,
    schema: &serde_json::Map<String, Value>,
    value: &Value,
    at: &str,
    all: &mut Vec<String>,
) {
    let empty = serde_json::Map::new();
    let of = |word: &str| {
        schema
            .get(word)
            .and_then(Value::as_object)
            .unwrap_or(&empty)
    };
    for (key, entry) in value.as_object().unwrap_or(&empty) {
        let at = format!("{at}/{key}");
        let patterns = of("patternProperties").iter();
        let own = of("properties").get(key);
        let rules: Vec<&Value> = own
            .into_iter()
            .chain(patterns.filter(|(p, _)| fits(p, key)).map(|(_, rule)| rule))
            .collect();
        for rule in &rules {
            check(root, rule, entry, &at, all);
        }
        if let Some(rule) = schema
            .get("additionalProperties")
            .filter(|_| rules.is_empty())
        {
            check(root, rule, entry, &at, all);
        }
        if let Some(rule) = schema.get("propertyNames") {
            check(root, rule, &Value::String(key.clone()), &at, all);
        }
    }
}

fn schema() -> Value {
    serde_json::from_str(&fs::read_to_string(SCHEMA).expect("the schema")).expect("JSON")
}

/// Asserts that a summary has the form of the schema.
pub(super) fn assert_valid(summary: &Value) {
    let faults = faults(&schema(), summary);
    assert!(faults.is_empty(), "{}\n{summary:#}", faults.join("\n"));
}

/// Summaries that fit, for the controls: of a job, of a run of a scene, and of a command without a folder.
fn samples() -> [Value; 3] {
    let scratch = Scratch::folder();
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/biceps.toml");
    let (job, scene) = (scratch.join("job"), scratch.join("scene"));
    let commands: [&[&str]; 3] = [
        &["biceps", file, "--out", shown(&job), "--json"],
        &[
            "run",
            "distance",
            "--frames",
            "2",
            "--out",
            shown(&scene),
            "--json",
        ],
        &["plan", "distance", "--json"],
    ];
    commands.map(|command| {
        let done = run(command);
        assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
        serde_json::from_slice(&done.stdout).expect("nothing but JSON on standard output")
    })
}

/// A change that makes a summary invalid.
type Change<'a> = &'a dyn Fn(&mut Value);

#[test]
fn what_departs_from_the_schema_is_found() {
    let (schema, samples) = (schema(), samples());
    for good in &samples {
        assert_eq!(faults(&schema, good), [""; 0]);
    }
    let [job, scene, plan] = &samples;
    let cases: [(&Value, &str, Change); 22] = [
        (job, "another format", &|s| s["format"] = 1.into()),
        (job, "a text as time", &|s| s["time_s"] = "1 s".into()),
        (job, "no verdicts", &|s| remove(s, "verdicts")),
        (job, "a verdict with a key too many", &|s| {
            s["verdicts"][0]["kept"] = true.into()
        }),
        (job, "a verdict without `where`", &|s| {
            remove(&mut s["verdicts"][0], "where")
        }),
        (job, "no measures", &|s| remove(s, "biceps")),
        (job, "measures of another kind", &|s| {
            s["kind"] = "fibres".into()
        }),
        (job, "an unknown kind", &|s| s["kind"] = "muscle".into()),
        (job, "frames of a scene", &|s| s["frames"] = 3.into()),
        (job, "a length as text", &|s| {
            s["biceps"]["length_m"] = "long".into()
        }),
        (job, "a length without a unit", &|s| {
            s["biceps"]["length"] = value!(0.3)
        }),
        (job, "a time in milliseconds", &|s| {
            s["biceps"]["wall_ms"] = value!(3.0)
        }),
        (job, "a measure that is gone", &|s| {
            remove(&mut s["biceps"], "volume_m3")
        }),
        (job, "an angle in radians", &|s| {
            s["biceps"]["joint_angle_rad"] = value!(1.0)
        }),
        (job, "a key that nobody declared", &|s| {
            s["unknown"] = value!(1)
        }),
        (scene, "no times", &|s| remove(s, "times")),
        (scene, "an unknown time", &|s| {
            s["times"]["total_s"] = value!(1.0)
        }),
        (scene, "a half frame", &|s| s["frames"] = value!(1.5)),
        (scene, "an unknown measure of a muscle", &|s| {
            s["muscles"]["muscles"][0]["bends"] = value!(1)
        }),
        (scene, "the old name of a scene", &|s| {
            s["scene"] = "distance".into()
        }),
        (plan, "an effect without a reason", &|s| {
            remove(&mut s["plan"]["effects"]["left_out"][0], "why")
        }),
        (plan, "no files", &|s| remove(s, "files")),
    ];
    for (good, what, change) in cases {
        let mut bad = good.clone();
        change(&mut bad);
        assert!(!faults(&schema, &bad).is_empty(), "{what} was not found");
    }
}

/// The place of a failed check: a summary of a red run fits, and one with another place does not.
#[test]
fn the_place_of_a_failed_check_has_its_form() {
    let scratch = Scratch::folder();
    let out = scratch.join("red");
    let done = run(&[
        "run",
        "cube",
        "--frames",
        "2",
        "--set",
        "limits.hinge='1 deg'",
        "--out",
        shown(&out),
        "--json",
    ]);
    assert_eq!(done.status.code(), Some(1), "{}", text(&done.stderr));
    assert!(out.join("place-1.png").is_file());
    let red: Value = serde_json::from_slice(&done.stdout).expect("JSON");
    assert_valid(&red);
    let verdicts = red["verdicts"].as_array().expect("verdicts");
    let failed = verdicts.iter().position(|v| v["at"].is_object());
    let failed = failed.expect("a place");
    assert_eq!(verdicts[failed]["passed"], Value::Bool(false));
    let changes: [(&str, Value); 4] = [
        ("no frame", value!({"point_m": [0.0, 0.0, 0.0]})),
        (
            "two coordinates",
            value!({"frame": 1, "point_m": [0.0, 0.0]}),
        ),
        (
            "a frame below zero",
            value!({"frame": -1, "point_m": [0.0, 0.0, 0.0]}),
        ),
        (
            "a key too many",
            value!({"frame": 1, "point_m": [0.0, 0.0, 0.0], "vertex": 3}),
        ),
    ];
    for (what, place) in changes {
        let mut bad = red.clone();
        bad["verdicts"][failed]["at"] = place;
        assert!(!faults(&schema(), &bad).is_empty(), "{what} was not found");
    }
}

fn remove(from: &mut Value, key: &str) {
    let gone = from.as_object_mut().and_then(|object| object.remove(key));
    assert!(gone.is_some(), "there was no {key}");
}

#[test]
fn a_keyword_that_the_validator_does_not_know_is_an_error() {
    let schema = value!({"type": "object", "minProperties": 3});
    assert!(!faults(&schema, &value!({})).is_empty());
    let schema = value!({"$ref": "#/$defs/nowhere"});
    assert!(!faults(&schema, &value!({})).is_empty());
}
