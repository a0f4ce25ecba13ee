//! Tables of the book that come from the code: what stands between `<!-- begin: NAME -->` and `<!-- end: NAME -->`.
//!
//! `HYDRAXIS_BOOK=overwrite` writes them anew.

use std::path::Path;

use pipeline::machine::Scenario;

use super::pages::{Page, is_overwriting, root};

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

#[test]
fn the_book_lists_every_scenario() {
    let mut table = "| scenario | what changes |\n|---|---|\n".to_owned();
    for scenario in Scenario::built_in() {
        table += &format!("| `{}` | {} |\n", scenario.name, scenario.summary);
    }
    check("docs/src/scenarios.md", "scenarios", &table);
}
