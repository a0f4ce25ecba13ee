//! Links lead to files and headings that are there, and lines are no wider than a screen.

use std::path::{Component, Path, PathBuf};

use super::pages::{self, Page, files_below, root};

/// Columns of the widest line outside of tables and code blocks.
const COLUMNS: usize = 120;

/// Targets of the links and pictures in a line of Markdown.
fn targets(line: &str) -> impl Iterator<Item = &str> {
    line.split("](").skip(1).filter_map(|rest| rest.split_once(')').map(|(target, _)| target))
}

/// `path` without `.` and `..`.
fn normalized(path: &Path) -> PathBuf {
    let mut parts = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => assert!(parts.pop(), "{} leaves the project", path.display()),
            Component::CurDir => {}
            other => parts.push(other),
        }
    }
    parts
}

/// What is wrong with a link from `page`, if anything is.
fn defect(page: &Page, target: &str) -> Option<String> {
    if target.starts_with("https://") || target.starts_with("http://") {
        return None;
    }
    let (file, anchor) = target.split_once('#').unwrap_or((target, ""));
    let path = if file.is_empty() {
        page.path.clone()
    } else {
        normalized(&page.path.parent().unwrap_or(Path::new("")).join(file))
    };
    if !root().join(&path).exists() {
        return Some(format!("{} does not exist", path.display()));
    }
    if page.path.starts_with("docs/src") && !path.starts_with("docs/src") {
        return Some(format!("{} is outside of the book", path.display()));
    }
    let is_known = anchor.is_empty() || Page::read(&path).anchors().iter().any(|known| known == anchor);
    (!is_known).then(|| format!("{} has no heading #{anchor}", path.display()))
}

#[test]
fn every_link_leads_to_a_file_and_a_heading() {
    let mut defects = Vec::new();
    for page in pages::all() {
        for (number, line) in page.prose() {
            let found = targets(line).filter_map(|target| defect(&page, target));
            defects.extend(found.map(|defect| format!("{}:{number}: {defect}", page.path.display())));
        }
    }
    assert!(defects.is_empty(), "{}", defects.join("\n"));
}

#[test]
fn every_page_is_in_the_summary_of_the_book() {
    let summary = Page::read(Path::new("docs/src/SUMMARY.md"));
    let linked: Vec<&str> = summary.prose().flat_map(|(_, line)| targets(line)).collect();
    for page in files_below(Path::new("docs/src"), "md") {
        let name = page.strip_prefix("docs/src").unwrap().to_str().unwrap();
        assert!(name == "SUMMARY.md" || linked.contains(&name), "SUMMARY.md does not name {name}");
    }
}

#[test]
fn no_line_of_text_is_wider_than_120_columns() {
    let mut wide = Vec::new();
    for page in pages::all().iter().filter(|page| pages::is_own(page)) {
        let is_free = |line: &str| line.starts_with('|') || line.starts_with("<!--");
        let lines = page.prose().filter(|(_, line)| !is_free(line) && line.chars().count() > COLUMNS);
        wide.extend(lines.map(|(number, _)| format!("{}:{number}", page.path.display())));
    }
    assert!(wide.is_empty(), "{}", wide.join("\n"));
}
