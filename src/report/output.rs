//! Where the figures of a command go: tables to standard output; JSON to a file, or to standard output instead of the
//! tables.

use std::{
    fs::{self, File},
    io::{self, Write},
    path::{Path, PathBuf},
};

use serde::Serialize;
use thiserror::Error;

/// Why an output cannot be opened or written.
#[derive(Debug, Error)]
pub enum OutputError {
    /// The file that an option names cannot be created.
    #[error("{option}: {} cannot be written: {source}; allowed: {}", .path.display(), writable(.path))]
    Create {
        /// The option.
        option: &'static str,
        /// Its file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The file that an option names has no ending of a picture.
    #[error(
        "{option}: found \"{}\"; allowed: a file that ends with .svg or .png, or - for SVG on standard output",
        .path.display()
    )]
    NoPicture {
        /// The option.
        option: &'static str,
        /// Its file.
        path: PathBuf,
    },
    /// The file was created and cannot be written.
    #[error("{option}: {} cannot be written", .path.display())]
    Write {
        /// The option.
        option: &'static str,
        /// Its file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// Two options write to standard output.
    #[error("{one}: found -, as for {other}; allowed: one of them on standard output, and a file for the other")]
    StandardOutputTwice {
        /// The one.
        one: &'static str,
        /// The other.
        other: &'static str,
    },
    /// Standard output cannot be written.
    #[error("standard output cannot be written")]
    StandardOutput(#[source] io::Error),
    /// The figures have no form in JSON.
    #[error("--json: the figures cannot be written as JSON")]
    Json(#[source] serde_json::Error),
}

/// What can be written in the place of this file.
fn writable(path: &Path) -> String {
    match path.parent().filter(|folder| !folder.as_os_str().is_empty() && !folder.is_dir()) {
        Some(folder) => format!("a file in a folder that exists, and {} does not", folder.display()),
        None => "a file that this user may write".to_owned(),
    }
}

/// The outputs that the user asked for. They are opened before the work begins.
pub struct Output {
    tables: bool,
    json: Option<(PathBuf, Box<dyn Write>)>,
}

impl Output {
    /// Opens the file of `--json`. `-` is standard output, which then shows no tables.
    ///
    /// # Errors
    /// The file cannot be created.
    pub fn open(json: Option<&Path>) -> Result<Self, OutputError> {
        let Some(path) = json else { return Ok(Self { tables: true, json: None }) };
        Ok(Self { tables: !is_stdout(path), json: Some((path.to_owned(), create("--json", path)?)) })
    }

    /// This output without tables, for a command that writes something else to standard output.
    pub fn without_tables(self) -> Self {
        Self { tables: false, ..self }
    }

    /// Writes tables and JSON as far as the user asked for them.
    ///
    /// # Errors
    /// One of them cannot be written.
    pub fn write(self, tables: impl FnOnce() -> String, figures: &impl Serialize) -> Result<(), OutputError> {
        self.write_or_keep(tables, figures, false)
    }

    /// Like [`Output::write`]. With `keep`, figures for standard output whose reader has ended go to standard error:
    /// Ctrl-C ends the reader of a pipe together with the run.
    ///
    /// # Errors
    /// One of them cannot be written.
    pub fn write_or_keep(
        self,
        tables: impl FnOnce() -> String,
        figures: &impl Serialize,
        keep: bool,
    ) -> Result<(), OutputError> {
        let show = |text: &str| {
            let is_read = show_to_reader(text)?;
            if keep && !is_read {
                // Nobody else is left to read them.
                let _ = io::stderr().write_all(text.as_bytes());
            }
            Ok(())
        };
        if self.tables {
            show(&tables())?;
        }
        let Some((path, mut file)) = self.json else { return Ok(()) };
        let mut text = serde_json::to_string_pretty(figures).map_err(OutputError::Json)?;
        text.push('\n');
        if is_stdout(&path) {
            return show(&text);
        }
        let written = file.write_all(text.as_bytes()).and_then(|()| file.flush());
        written.map_err(|source| OutputError::Write { option: "--json", path, source })
    }
}

/// Refuses two options that both write to standard output.
///
/// # Errors
/// More than one of the options, each with its file, is standard output.
pub fn expect_one_stdout(options: &[(&'static str, &Option<PathBuf>)]) -> Result<(), OutputError> {
    let mut there = options.iter().filter(|(_, path)| path.as_deref().is_some_and(is_stdout));
    match (there.next(), there.next()) {
        (Some((one, _)), Some((other, _))) => Err(OutputError::StandardOutputTwice { one, other }),
        _ => Ok(()),
    }
}

/// Whether the file of an option is standard output.
pub fn is_stdout(path: &Path) -> bool {
    path == Path::new("-")
}

/// Opens the file of `option`, or standard output, for writing. A file is emptied when the first byte is written.
///
/// # Errors
/// The file cannot be created.
pub fn create(option: &'static str, path: &Path) -> Result<Box<dyn Write>, OutputError> {
    if is_stdout(path) {
        return Ok(Box::new(io::stdout()));
    }
    match File::options().write(true).create(true).truncate(false).open(path) {
        Ok(file) => Ok(Box::new(Kept { file, is_kept: true })),
        Err(source) => Err(OutputError::Create { option, path: path.to_owned(), source }),
    }
}

/// An output that was written, of `option` to a file. A reader that has closed its end, such as `head`, is no error.
///
/// # Errors
/// It cannot be written for another reason.
pub fn written(option: &'static str, path: &Path, result: io::Result<()>) -> Result<(), OutputError> {
    match result {
        Err(source) if source.kind() != io::ErrorKind::BrokenPipe => {
            Err(OutputError::Write { option, path: path.to_owned(), source })
        }
        _ => Ok(()),
    }
}

/// A file that keeps what it had until something is written: work that fails takes no earlier result with it.
struct Kept {
    file: File,
    is_kept: bool,
}

impl Kept {
    /// Empties the file the first time. A device or a pipe has nothing to empty.
    fn begin(&mut self) -> io::Result<()> {
        if std::mem::take(&mut self.is_kept) && self.file.metadata()?.is_file() { self.file.set_len(0) } else { Ok(()) }
    }
}

impl Write for Kept {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.begin()?;
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        // Without `begin`: a CSV writer that is dropped flushes, though it has written nothing.
        self.file.flush()
    }
}

/// The file beside `path` that is written before it takes its place.
pub fn part_of(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(format!(".{}.part", std::process::id()));
    path.with_file_name(name)
}

/// Puts `part`, which was written with this result, in the place of `path`: a reader meets the old file or the new one,
/// never a part. After a failure the part is removed.
///
/// # Errors
/// The part could not be written, or the system refuses to move it.
pub fn take_place(part: &Path, path: &Path, written: io::Result<()>) -> io::Result<()> {
    written.and_then(|()| fs::rename(part, path)).inspect_err(|_| {
        let _ = fs::remove_file(part);
    })
}

/// `text` with escapes in the place of control characters other than line ends, tabs and colours: a text from a file
/// must not steer the terminal.
pub fn printable(text: &str) -> String {
    let mut shown = String::with_capacity(text.len());
    for (place, sign) in text.char_indices() {
        if sign.is_control() && !matches!(sign, '\n' | '\t') && !is_colour(&text[place..]) {
            shown.extend(sign.escape_default());
        } else {
            shown.push(sign);
        }
    }
    shown
}

/// Whether a text begins with a colour for the terminal.
fn is_colour(text: &str) -> bool {
    let numbers = |sign: char| sign.is_ascii_digit() || sign == ';';
    text.strip_prefix("\x1b[").is_some_and(|rest| rest.trim_start_matches(numbers).starts_with('m'))
}

/// Writes text to standard output as [`printable`] has it. A reader that has closed its end, such as `head`, is no
/// error.
///
/// # Errors
/// Standard output cannot be written for another reason.
pub fn show(text: &str) -> Result<(), OutputError> {
    show_to_reader(text).map(|_| ())
}

/// Writes text to standard output as [`printable`] has it, and says whether anybody still reads it.
///
/// # Errors
/// Standard output cannot be written for another reason than a closed end.
pub fn show_to_reader(text: &str) -> Result<bool, OutputError> {
    let mut stdout = io::stdout();
    match stdout.write_all(printable(text).as_bytes()).and_then(|()| stdout.flush()) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(false),
        Err(error) => Err(OutputError::StandardOutput(error)),
    }
}
