//! Files, folders and functions that README and book name in code spans exist: `folder/file.rs`, `folder/`, and
//! `folder/file.rs::function`, from the project's folder on.

use super::pages::{self, root};

/// Keywords before a name where it is declared.
const DECLARATIONS: [&str; 7] = ["fn", "struct", "enum", "trait", "const", "mod", "type"];

/// The code spans of a line of Markdown.
fn spans(line: &str) -> impl Iterator<Item = &str> {
    line.split('`').skip(1).step_by(2)
}

/// Whether a Rust source declares `name`.
fn declares(source: &str, name: &str) -> bool {
    let is_end = |rest: &str| !rest.starts_with(|c: char| c.is_alphanumeric() || c == '_');
    DECLARATIONS.iter().any(|keyword| {
        let declaration = format!("{keyword} {name}");
        source.match_indices(&declaration).any(|(begin, found)| is_end(&source[begin + found.len()..]))
    })
}

/// What is wrong with a code span that names a file or a folder, if anything is.
fn defect(span: &str) -> Option<String> {
    let (file, name) = span.split_once("::").unwrap_or((span, ""));
    let is_path = file.contains('/') && file.chars().all(|c| c.is_ascii_alphanumeric() || "/_-.".contains(c));
    let top = file.split('/').next().unwrap_or_default();
    if !is_path || !(file.ends_with(".rs") || file.ends_with('/')) || !root().join(top).is_dir() || top.is_empty() {
        return None;
    }
    let path = root().join(file);
    if !path.exists() {
        return Some(format!("{file} does not exist"));
    }
    // `module::function` is looked for by its last part.
    let name = name.rsplit("::").next().filter(|name| !name.is_empty())?;
    let source = std::fs::read_to_string(path).unwrap();
    (!declares(&source, name)).then(|| format!("{file} does not declare {name}"))
}

#[test]
fn every_file_and_function_that_is_named_exists() {
    let mut defects = Vec::new();
    for page in pages::all().iter().filter(|page| pages::is_own(page)) {
        for (number, line) in page.prose() {
            let found = spans(line).filter_map(defect);
            defects.extend(found.map(|defect| format!("{}:{number}: {defect}", page.path.display())));
        }
    }
    assert!(defects.is_empty(), "{}", defects.join("\n"));
}

#[test]
fn a_name_that_begins_like_a_declared_one_is_not_declared() {
    let source = "pub fn solve_all() {}\nstruct Plan;";
    assert!(declares(source, "solve_all") && declares(source, "Plan"));
    assert!(!declares(source, "solve") && !declares(source, "Pla") && !declares(source, "source"));
    assert_eq!(defect("tests/book/names.rs::declares"), None);
    assert!(defect("tests/book/names.rs::nobody").is_some() && defect("tests/nowhere.rs").is_some());
}
