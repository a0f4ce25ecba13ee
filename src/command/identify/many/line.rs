//! One line: a file with its hash, the options, and the result or the error.

use std::{
    fs::File,
    io::{self, Read},
    panic::{AssertUnwindSafe, catch_unwind},
    path::Path,
};

use indicatif::ProgressBar;
use pipeline::columns::{TableError, TableProblem};
use serde::Serialize;
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::{
    super::{
        IdentifyArguments,
        compare::compare,
        record::Record,
        report::IdentifyReport,
        residuals::Residuals,
        run::identify,
        search,
        settings::{TypedStructure, check_estimator, settings},
    },
    done::Done,
};
use crate::failure::Failure;

/// Bytes of a file that are read at once.
const PIECE: usize = 1 << 16;

/// What became of a file.
pub(super) enum Line {
    /// It has a line already. `true`: it failed.
    Old(bool),
    /// The text of the line, and whether the file failed.
    New(String, bool),
}

/// A line as JSON.
#[derive(Serialize)]
struct Text<'a> {
    file: &'a str,
    /// None where the file cannot be read.
    sha256: Option<&'a str>,
    options: &'a [String],
    #[serde(skip_serializing_if = "Option::is_none")]
    result: Option<Value>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Problem>,
}

/// Why a file has no result.
#[derive(Serialize)]
struct Problem {
    /// `unreadable`: the system does not read the file. `recording`: it is no recording, or has a bad field.
    /// `settings`: options and recording do not fit. `identification`: no model could be found. `defect`: an error of
    /// this program.
    kind: &'static str,
    /// Where in the file; none where it is no single place.
    #[serde(skip_serializing_if = "Option::is_none")]
    place: Option<Place>,
    message: String,
}

/// A place in a recording.
#[derive(Serialize)]
struct Place {
    line: Option<usize>,
    row: Option<usize>,
    column: Option<String>,
}

impl Line {
    /// Identifies a model on one file, unless that was done before.
    pub(super) fn of(arguments: &IdentifyArguments, file: &Path, options: &[String], done: &Done) -> Self {
        let name = file.display().to_string();
        let hash = match hash(file) {
            Ok(hash) => hash,
            Err(error) => {
                let message = format!("{name}: cannot be read: {error}");
                let error = Problem { kind: "unreadable", place: None, message };
                return Self::new(&Text { file: &name, sha256: None, options, result: None, error: Some(error) });
            }
        };
        if let Some(failed) = done.failed(&name, &hash, options) {
            return Self::Old(failed);
        }
        let (result, error) = match catch_unwind(AssertUnwindSafe(|| one(arguments, file))) {
            Ok(Ok(result)) => (Some(result), None),
            Ok(Err(problem)) => (None, Some(problem)),
            Err(_) => {
                let message = format!("{name}: an error of this program; please report it with the file");
                (None, Some(Problem { kind: "defect", place: None, message }))
            }
        };
        Self::new(&Text { file: &name, sha256: Some(&hash), options, result, error })
    }

    fn new(text: &Text<'_>) -> Self {
        let failed = text.error.is_some();
        // A map of texts and numbers is always JSON.
        let line = serde_json::to_string(text).unwrap_or_default();
        Self::New(line + "\n", failed)
    }

    /// What is to be written.
    pub(super) fn text(&self) -> Option<&str> {
        if let Self::New(text, _) = self { Some(text) } else { None }
    }

    /// Whether the file has a line from before.
    pub(super) fn is_old(&self) -> bool {
        matches!(self, Self::Old(_))
    }

    /// Whether the file has no result.
    pub(super) fn has_failed(&self) -> bool {
        let (Self::Old(failed) | Self::New(_, failed)) = self;
        *failed
    }
}

/// The report on one file, as `--json` has it.
fn one(arguments: &IdentifyArguments, file: &Path) -> Result<Value, Problem> {
    let of = |kind| move |failure: Failure| Problem::new(kind, &failure);
    let typed = TypedStructure::new(arguments).map_err(of("settings"))?;
    let record = Record::read(&[file.to_owned()], &[], &arguments.columns).map_err(of("recording"))?;
    let mut settings = settings(arguments, &typed, &record).map_err(of("settings"))?;
    let hidden = ProgressBar::hidden();
    let selection = arguments.select.then(|| search(&settings, &typed, &record, &hidden)).transpose();
    let selection = selection.map_err(of("identification"))?;
    if let Some(selection) = &selection {
        settings.structure = selection.chosen.candidate.structure;
        check_estimator(&settings).map_err(of("settings"))?;
    }
    let mut residuals = Residuals::default();
    let (identifier, ns_per_update) = identify(&settings, &record, |_| (), &mut residuals);
    let comparison = arguments.compare.then(|| compare(&settings, &record));
    let mut report = IdentifyReport::new(&settings, &record, &identifier, &residuals, ns_per_update);
    (report.selection, report.comparison) = (selection, comparison);
    serde_json::to_value(&report).map_err(Failure::run).map_err(of("identification"))
}

impl Problem {
    fn new(kind: &'static str, failure: &Failure) -> Self {
        let first = failure.of_type::<TableError>().and_then(|error| error.problems.first());
        let place = first.and_then(|TableProblem { line, field, .. }| {
            let (row, column) = field.clone().unzip();
            (line.is_some() || row.is_some()).then_some(Place { line: *line, row, column })
        });
        Self { kind, place, message: failure.to_string() }
    }
}

/// SHA-256 of a file's content, as `sha256sum` prints it.
fn hash(file: &Path) -> io::Result<String> {
    let mut hasher = Sha256::new();
    let (mut file, mut piece) = (File::open(file)?, vec![0; PIECE]);
    loop {
        match file.read(&mut piece) {
            Ok(0) => break,
            Ok(length) => hasher.update(&piece[..length]),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(hasher.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}
