//! Where the figures of a command go: tables to standard output, JSON to a file or in place of the tables.

use std::{
    fs::File,
    io::{self, Write},
    path::{Path, PathBuf},
};

use serde::Serialize;

use crate::failure::Failure;

/// The outputs that were asked for, opened before the work begins.
pub struct Output {
    tables: bool,
    json: Option<(PathBuf, Box<dyn Write>)>,
}

impl Output {
    /// Opens `json`; `-` is standard output, which then shows nothing else.
    pub fn open(json: Option<&Path>) -> Result<Self, Failure> {
        let Some(path) = json else { return Ok(Self { tables: true, json: None }) };
        Ok(Self { tables: !is_stdout(path), json: Some((path.to_owned(), create("--json", path)?)) })
    }

    /// The same without tables, where standard output is for something else.
    pub fn without_tables(self) -> Self {
        Self { tables: false, ..self }
    }

    /// Writes what was asked for.
    pub fn write(self, tables: impl FnOnce() -> String, figures: &impl Serialize) -> Result<(), Failure> {
        if self.tables {
            show(&tables())?;
        }
        let Some((path, mut file)) = self.json else { return Ok(()) };
        let mut text = serde_json::to_string_pretty(figures).map_err(Failure::run)?;
        text.push('\n');
        file.write_all(text.as_bytes()).and_then(|()| file.flush()).map_err(|error| unwritable("--json", &path, &error))
    }
}

/// Whether an option's file is standard output.
pub fn is_stdout(path: &Path) -> bool {
    path == Path::new("-")
}

/// Opens what `option` names for writing, a file or standard output.
pub fn create(option: &str, path: &Path) -> Result<Box<dyn Write>, Failure> {
    if is_stdout(path) {
        return Ok(Box::new(io::stdout()));
    }
    match File::create(path) {
        Ok(file) => Ok(Box::new(file)),
        Err(error) => Err(Failure::Usage(format!("{option}: {} cannot be written: {error}", path.display()))),
    }
}

/// The failure to write what was opened.
pub fn unwritable(option: &str, path: &Path, error: &io::Error) -> Failure {
    Failure::Run(format!("{option}: {} cannot be written: {error}", path.display()))
}

/// Writes to standard output. A reader that has gone, such as `head`, has seen what it wanted.
pub fn show(text: &str) -> Result<(), Failure> {
    let mut stdout = io::stdout();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(Failure::run(error)),
        _ => Ok(()),
    }
}
