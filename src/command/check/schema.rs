//! `hydraxis check --schema`: the JSON schema of machine files, by which editors complete, explain and check keys.
//!
//! The schema comes from the table of all keys, as the list of keys in the book does. It knows tables, keys, types,
//! ranges, choices and units. It does not know what depends on other keys: which keys are required, which exclude one
//! another, and ranges that follow from other values. `hydraxis check` knows all of it. So a file that the schema
//! refuses is wrong, and one that it accepts may still be wrong.

use pipeline::machine::{DefaultValue, Key, StageKind, ValueForm, allowed_units, keys};
use serde_json::{Map, Value, json};

use crate::{failure::Failure, report::output::show};

/// A number as the reader takes it in front of a unit.
const NUMBER: &str = r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?";
/// A duration such as `1m 30s`.
const DURATION: &str = r"^(0|([0-9][0-9.]*\s*[A-Za-zµ]+\s*)+)$";
/// Names of axes.
const AXIS: &str = "^[A-Za-z0-9_-]{1,32}$";
/// Names of scenarios.
const ANY: &str = "^.+$";

/// Writes the schema to standard output.
pub fn run() -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(&schema()).map_err(Failure::run)?;
    Ok(show(&format!("{text}\n"))?)
}

/// The schema.
fn schema() -> Value {
    let mut root = table();
    root.insert("$schema".into(), "http://json-schema.org/draft-07/schema#".into());
    root.insert("title".into(), "Machine file of Hydraxis".into());
    for key in keys() {
        let (tables, name) = key.path.rsplit_once('.').unwrap_or(("", &key.path));
        let inside = tables.split('.').filter(|part| !part.is_empty()).fold(&mut root, inner);
        part(inside, "properties").insert(name.to_owned(), described(&key));
    }
    Value::Object(root)
}

/// A table without keys.
fn table() -> Map<String, Value> {
    let mut table = Map::new();
    table.insert("type".into(), "object".into());
    table.insert("additionalProperties".into(), false.into());
    table
}

/// A member of a schema that is an object; it is made where it is missing.
fn part<'a>(schema: &'a mut Map<String, Value>, name: &str) -> &'a mut Map<String, Value> {
    object(schema.entry(name).or_insert_with(|| Map::new().into()))
}

fn object(value: &mut Value) -> &mut Map<String, Value> {
    match value {
        Value::Object(object) => object,
        // All members that are looked into are made as objects here.
        other => unreachable!("{other} is no object"),
    }
}

/// The schema of a table inside a table. `STAGE` and `NAME` stand for any such name, `list[]` for each table of a list.
fn inner<'a>(schema: &'a mut Map<String, Value>, name: &str) -> &'a mut Map<String, Value> {
    let stages = || format!("^({})$", StageKind::ALL.map(StageKind::name).join("|"));
    let is_axis = || schema.get("title").is_some_and(|title| title == "[axis]");
    let (members, member) = match name {
        "STAGE" => ("patternProperties", stages()),
        "NAME" if is_axis() => ("patternProperties", AXIS.to_owned()),
        "NAME" => ("patternProperties", ANY.to_owned()),
        _ => ("properties", name.trim_end_matches("[]").to_owned()),
    };
    let title = match schema.get("title").and_then(Value::as_str).and_then(|title| title.strip_suffix(']')) {
        Some(outer) => format!("{outer}.{name}]"),
        None => format!("[{name}]"),
    };
    let made = || {
        let mut table = table();
        table.insert("title".into(), title.into());
        if name.ends_with("[]") { json!({ "type": "array", "items": table }) } else { table.into() }
    };
    let found = object(part(schema, members).entry(member).or_insert_with(made));
    if name.ends_with("[]") { part(found, "items") } else { found }
}

/// The schema of a key: its forms, what it means, its unit and its default.
fn described(key: &Key) -> Value {
    let mut forms: Vec<Value> = key.forms.iter().flat_map(of_form).collect();
    let mut schema = match forms.len() {
        1 => forms.remove(0),
        _ => json!({ "anyOf": forms }),
    };
    let without = match &key.default {
        DefaultValue::Required => "Required where it applies".to_owned(),
        default => format!("Without it: {default}"),
    };
    let text = format!("{}. Allowed: {}. {without}.", key.meaning, key.allowed);
    object(&mut schema).insert("description".into(), text.into());
    // Numbers, texts and lists have the same notation in TOML and in JSON.
    if let DefaultValue::Value(text) = &key.default
        && let Ok(default) = serde_json::from_str(text)
    {
        object(&mut schema).insert("default".into(), default);
    }
    schema
}

/// The schemas of a form; any of them may hold.
fn of_form(form: &ValueForm) -> Vec<Value> {
    match form {
        ValueForm::Number { range, unit } => quantity(*range, unit.as_deref()),
        ValueForm::Numbers { range, unit, length: (shortest, longest) } => {
            let item = json!({ "anyOf": quantity(*range, unit.as_deref()) });
            let mut list = json!({ "type": "array", "items": item, "minItems": shortest });
            if let Some(longest) = longest {
                object(&mut list).insert("maxItems".into(), (*longest).into());
            }
            vec![list]
        }
        ValueForm::Integer { range: Some((least, most)) } => {
            vec![json!({ "type": "integer", "minimum": least, "maximum": most })]
        }
        ValueForm::Integer { range: None } => vec![json!({ "type": "integer", "minimum": 0 })],
        ValueForm::Duration => vec![json!({ "type": "string", "pattern": DURATION })],
        ValueForm::Text => vec![json!({ "type": "string" })],
        ValueForm::Texts => vec![json!({ "type": "array", "items": { "type": "string" } })],
        ValueForm::TextTable => {
            vec![json!({ "type": "array", "items": { "type": "array", "items": { "type": "string" } } })]
        }
        ValueForm::Flag => vec![json!({ "type": "boolean" })],
        ValueForm::Choice { names } => vec![json!({ "type": "string", "enum": names })],
    }
}

/// A number in its range, or a text with a unit. Whether the value of a text is in the range, the schema cannot say.
fn quantity(range: Option<(f64, f64)>, unit: Option<&str>) -> Vec<Value> {
    let number = match range {
        Some((least, most)) => json!({ "type": "number", "minimum": least, "maximum": most }),
        None => json!({ "type": "number" }),
    };
    let text = match unit.map(units) {
        // Any unit: it depends on other keys.
        None => Some(format!(r"^\s*{NUMBER}\s*\S")),
        Some(units) if units.is_empty() => None,
        Some(units) => Some(format!(r"^\s*{NUMBER}\s*({units})\s*$")),
    };
    let text = text.map(|pattern| json!({ "type": "string", "pattern": pattern }));
    [number].into_iter().chain(text).collect()
}

/// The units of a text, as the alternatives of a regular expression, in all the ways in which they can be typed.
fn units(unit: &str) -> String {
    let allowed = allowed_units(unit);
    let typed = |unit: &str| {
        let typed = |letter: char| match letter {
            '2' => r"\^?[2²]".to_owned(),
            '3' => r"\^?[3³]".to_owned(),
            'u' => "[uµ]".to_owned(),
            ' ' => r"\s+".to_owned(),
            '(' | ')' => format!(r"\{letter}"),
            letter => letter.to_string(),
        };
        unit.chars().map(typed).collect::<String>().replace("deg", "(deg|°)")
    };
    let all: Vec<String> = allowed.split(", ").filter(|unit| !unit.is_empty()).map(typed).collect();
    all.join("|")
}
