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
        if path == Path::new("-") {
            return Ok(Self { tables: false, json: Some((path.to_owned(), Box::new(io::stdout()))) });
        }
        let file = File::create(path);
        let file =
            file.map_err(|error| Failure::Usage(format!("--json: {} cannot be written: {error}", path.display())))?;
        Ok(Self { tables: true, json: Some((path.to_owned(), Box::new(file))) })
    }

    /// Writes what was asked for.
    pub fn write(self, tables: impl FnOnce() -> String, figures: &impl Serialize) -> Result<(), Failure> {
        if self.tables {
            show(&tables())?;
        }
        let Some((path, mut file)) = self.json else { return Ok(()) };
        let mut text = serde_json::to_string_pretty(figures).map_err(Failure::run)?;
        text.push('\n');
        let written = file.write_all(text.as_bytes()).and_then(|()| file.flush());
        written.map_err(|error| Failure::Run(format!("--json: {} cannot be written: {error}", path.display())))
    }
}

/// Writes to standard output. A reader that has gone, such as `head`, has seen what it wanted.
pub fn show(text: &str) -> Result<(), Failure> {
    let mut stdout = io::stdout();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(Failure::run(error)),
        _ => Ok(()),
    }
}
