//! Tables of the book that come from the code: what stands between `<!-- begin: NAME -->` and `<!-- end: NAME -->`.
//!
//! `HYDRAXIS_BOOK=overwrite` writes them anew.

use std::path::Path;

use pipeline::machine::{Change, Key, Parameter, Scenario, Target, keys, units};

use super::{
    harness::hydraxis,
    languages,
    pages::{Page, is_overwriting, root},
};

/// The page's text with another content of a generated part.
fn with_part(text: &str, name: &str, content: &str) -> String {
    let (begin, end) = (format!("<!-- begin: {name} -->\n"), format!("<!-- end: {name} -->"));
    let (before, rest) = text.split_once(&begin).unwrap_or_else(|| panic!("no {begin}"));
    let (_, after) = rest.split_once(&end).unwrap_or_else(|| panic!("no {end}"));
    format!("{before}{begin}\n{}\n\n{end}{after}", content.trim_end())
}

/// Compares a generated part of a page, or writes it.
fn check(path: &str, name: &str, content: &str) {
    let page = Page::read(Path::new(path));
    let generated = with_part(&page.text, name, content);
    if is_overwriting() {
        std::fs::write(root().join(path), generated).unwrap();
    } else {
        assert_eq!(page.text, generated, "HYDRAXIS_BOOK=overwrite cargo test --test book writes {path} anew");
    }
}

/// What a change does, as `parameter` x factor or to value, and when.
fn told(change: &Change) -> String {
    let Change { parameter, start, end, to, .. } = change;
    let to = (1e3 * to).round() / 1e3;
    let goal = match parameter.target() {
        Target::Factor(_) => format!("x {to}"),
        Target::Value(..) => format!("to {to}"),
    };
    let when = if start == end { format!("at {start} s") } else { format!("{start} to {end} s") };
    format!("`{}` {goal}, {when}", parameter.name())
}

#[test]
fn the_book_lists_the_units_of_a_text() {
    let mut table = "| unit of the key | units of a text |\n|---|---|\n".to_owned();
    for (unit, allowed) in units() {
        table += &format!("| {} | {allowed} |\n", if unit.is_empty() { "none" } else { unit });
    }
    check("docs/src/machine.md", "units", &table);
}

#[test]
fn the_book_lists_every_scenario_with_its_changes() {
    let mut table = "| scenario | what changes | by how much |\n|---|---|---|\n".to_owned();
    for scenario in Scenario::built_in() {
        let changes: Vec<String> = scenario.changes.iter().map(told).collect();
        table += &format!("| `{}` | {} | {} |\n", scenario.name, scenario.summary, changes.join("; "));
    }
    check("docs/src/scenarios.md", "scenarios", &table);
}

#[test]
fn the_book_lists_every_parameter_of_a_scenario() {
    let mut table = "| parameter | of | takes | changes |\n|---|---|---|---|\n".to_owned();
    for parameter in Parameter::all() {
        let of = if parameter.is_shared() { "machine" } else { "axis" };
        let takes = match parameter.target() {
            Target::Factor(range) => format!("factor, {} to {}", range.start(), range.end()),
            Target::Value(range, unit) => format!("value, {} to {} {unit}", range.start(), range.end()),
        };
        table += &format!("| `{}` | {of} | {takes} | {} |\n", parameter.name(), parameter.meaning());
    }
    check("docs/src/scenarios.md", "parameters", &table);
}

/// The table of a key, and its name within the table.
fn place(key: &Key) -> (&str, &str) {
    let tables = key.path.split("[]").next().unwrap_or_default();
    tables.rfind('.').map_or(("", key.path.as_str()), |dot| (&key.path[..dot], &key.path[dot + 1..]))
}

/// A text as the cell of a table.
fn cell(text: &str) -> String {
    text.replace('|', "\\|")
}

#[test]
fn the_book_lists_every_key_of_the_machine_file() {
    let keys = keys();
    let mut names: Vec<&str> = Vec::new();
    for key in &keys {
        let table = place(key).0;
        if !names.contains(&table) {
            names.push(table);
        }
    }
    let mut tables = String::new();
    for table in names {
        let heading = if table.is_empty() { "Outside of all tables".to_owned() } else { format!("[{table}]") };
        tables += &format!("\n### {heading}\n\n| key | allowed | without it | meaning |\n|---|---|---|---|\n");
        for key in keys.iter().filter(|key| place(key).0 == table) {
            let (allowed, default) = (cell(&key.allowed), cell(&key.default.to_string()));
            tables += &format!("| `{}` | {allowed} | {default} | {} |\n", place(key).1, cell(key.meaning));
        }
    }
    check("docs/src/machine.md", "keys", tables.trim_start());
}

#[test]
fn the_json_schema_of_the_project_is_that_of_the_program() {
    let output = hydraxis().args(["check", "--schema"]).output().unwrap();
    let (path, schema) = (root().join("docs/machine.schema.json"), String::from_utf8(output.stdout).unwrap());
    if is_overwriting() {
        std::fs::write(path, schema).unwrap();
    } else {
        let kept = std::fs::read_to_string(path).unwrap();
        assert_eq!(kept, schema, "HYDRAXIS_BOOK=overwrite cargo test --test book writes docs/machine.schema.json anew");
    }
}

#[test]
fn the_book_lists_every_channel_with_its_type() {
    check("docs/src/messages.md", "channels", &languages::table());
}
