//! The Markdown files of the project, and what they consist of.

use std::path::{Path, PathBuf};

/// The project's folder.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Whether pages are to be written instead of compared.
pub fn is_overwriting() -> bool {
    std::env::var("HYDRAXIS_BOOK").is_ok_and(|value| value == "overwrite")
}

/// One line of a page.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Line<'a> {
    /// Text outside of code blocks.
    Text(&'a str),
    /// The fence that begins or ends a code block; the language after a beginning.
    Fence(&'a str),
    /// A line of a code block.
    Code(&'a str),
}

/// A Markdown file.
pub struct Page {
    /// Its place below the project's folder.
    pub path: PathBuf,
    /// Its whole text.
    pub text: String,
}

impl Page {
    /// Reads the page at `path` below the project's folder.
    pub fn read(path: &Path) -> Self {
        let text = std::fs::read_to_string(root().join(path));
        Self { path: path.to_owned(), text: text.unwrap_or_else(|error| panic!("{}: {error}", path.display())) }
    }

    /// Every line with its number, from 1 on.
    pub fn lines(&self) -> impl Iterator<Item = (usize, Line<'_>)> {
        let mut in_code = false;
        self.text.lines().enumerate().map(move |(index, line)| {
            let kind = match line.strip_prefix("```") {
                Some(language) => {
                    in_code = !in_code;
                    Line::Fence(language)
                }
                None if in_code => Line::Code(line),
                None => Line::Text(line),
            };
            (index + 1, kind)
        })
    }

    /// Every line of text outside of code blocks, with its number.
    pub fn prose(&self) -> impl Iterator<Item = (usize, &str)> {
        self.lines().filter_map(|(number, line)| match line {
            Line::Text(text) => Some((number, text)),
            Line::Fence(_) | Line::Code(_) => None,
        })
    }

    /// The anchors of the headings, as GitHub and mdBook make them.
    pub fn anchors(&self) -> Vec<String> {
        let headings = self.prose().map(|(_, line)| line).filter(|line| line.starts_with('#'));
        let headings = headings.map(|line| line.trim_start_matches('#'));
        headings.map(anchor).collect()
    }
}

/// The anchor of a heading: lower case, hyphens for spaces, no punctuation.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.map(|c| if c == ' ' { '-' } else { c.to_ascii_lowercase() }).collect()
}

/// The files with this ending in a folder and below it.
pub fn files_below(folder: &Path, ending: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(root().join(folder)).unwrap().flatten() {
        let path = folder.join(entry.file_name());
        if entry.path().is_dir() {
            found.extend(files_below(&path, ending));
        } else if path.extension().is_some_and(|extension| extension == ending) {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// README, book, and the pages of single crates.
pub fn all() -> Vec<Page> {
    let mut paths = vec!["README.md".into(), "plant-sim/README.md".into(), "fuzz/README.md".into()];
    paths.extend(files_below(Path::new("docs/src"), "md"));
    paths.iter().map(|path: &PathBuf| Page::read(path)).collect()
}

/// Whether a page belongs to README or book, whose paths begin at the project's folder.
pub fn is_own(page: &Page) -> bool {
    page.path == Path::new("README.md") || page.path.starts_with("docs")
}
