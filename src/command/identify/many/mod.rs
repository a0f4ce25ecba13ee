//! `hydraxis identify --jsonl`: many recordings, each identified on its own, with a line of JSON for each.
//!
//! ```text
//! files and folders --those without a line yet--> jobs, one file at a time --line, when a file is done--> OUT.jsonl
//! ```
//!
//! A line is written whole, in one call, when its file is done. So a kill loses the files that were being worked on and
//! tears the last line at most; `--resume` removes a torn line and goes on with the files that have none.

mod done;
mod files;
mod line;

use std::{
    collections::BTreeSet,
    fs::{File, OpenOptions},
    io::{self, Write},
    path::{Path, PathBuf},
    sync::{
        atomic::{AtomicBool, AtomicUsize, Ordering},
        mpsc,
    },
    thread,
};

use super::IdentifyArguments;
use crate::{
    failure::Failure,
    report::{output::show, table::progress},
};
use done::Done;
use line::Line;

/// The options of `--jsonl`, which are none of the identification.
const OWN_OPTIONS: [(&str, bool); 3] = [("--jsonl", true), ("--jobs", true), ("--resume", false)];

/// Runs the command for each file on its own.
pub fn run(arguments: &IdentifyArguments, out: &Path) -> Result<(), Failure> {
    let files = files::list(&arguments.data)?;
    let options = typed_options(&arguments.data);
    let (mut sheet, done) = open(arguments, out)?;
    let left: Vec<&PathBuf> = files.iter().collect();
    let jobs = arguments.jobs.unwrap_or_else(|| thread::available_parallelism().map_or(1, usize::from));
    let progress = progress(left.len() as u64, "files");
    let (next, stops) = (AtomicUsize::new(0), AtomicBool::new(false));
    let mut counts = Counts::default();
    let written = thread::scope(|scope| {
        let (sender, lines) = mpsc::channel();
        for _ in 0..jobs.min(left.len()) {
            let (sender, next, left, stops, options, done) = (sender.clone(), &next, &left, &stops, &options, &done);
            scope.spawn(move || {
                while !stops.load(Ordering::Relaxed)
                    && let Some(file) = left.get(next.fetch_add(1, Ordering::Relaxed))
                    && sender.send(Line::of(arguments, file, options, done)).is_ok()
                {}
            });
        }
        drop(sender);
        for line in lines {
            progress.inc(1);
            counts.take(&line);
            let written = line.text().map_or(Ok(()), |text| sheet.write_all(text.as_bytes()));
            if written.is_err() {
                stops.store(true, Ordering::Relaxed);
                return written;
            }
        }
        Ok(())
    });
    progress.finish_and_clear();
    written.map_err(|error| refused(out, &error))?;
    let out = out.display();
    let Counts { identified, failed, before } = counts;
    show(&format!("{out}: {identified} files identified, {failed} failed, {before} done before\n"))?;
    if failed > 0 {
        return Err(Failure::run(format!("{failed} of {} files failed; {out} says why", files.len())));
    }
    Ok(())
}

/// Files by what became of them.
#[derive(Default)]
struct Counts {
    identified: usize,
    /// Now or before.
    failed: usize,
    /// Had a line already.
    before: usize,
}

impl Counts {
    fn take(&mut self, line: &Line) {
        self.before += usize::from(line.is_old());
        self.identified += usize::from(!line.is_old() && !line.has_failed());
        self.failed += usize::from(line.has_failed());
    }
}

/// The file of the lines, and what it holds already.
fn open(arguments: &IdentifyArguments, out: &Path) -> Result<(File, Done), Failure> {
    let mut options = OpenOptions::new();
    options.read(true).append(true).create(true);
    let mut file = options.open(out).map_err(|error| refused(out, &error))?;
    let length = file.metadata().map_err(|error| refused(out, &error))?.len();
    if length > 0 && !arguments.resume {
        let out = out.display();
        return Err(Failure::usage(format!("--jsonl: found {out} with lines in it; allowed: a new file, or --resume")));
    }
    let done = Done::read(&mut file, out)?;
    Ok((file, done))
}

fn refused(out: &Path, error: &io::Error) -> Failure {
    Failure::usage(format!("--jsonl: {} cannot be written: {error}", out.display()))
}

/// What the user typed, but for the recordings and the options of `--jsonl`: the settings of a line.
fn typed_options(data: &[PathBuf]) -> Vec<String> {
    let recordings: BTreeSet<&std::ffi::OsStr> = data.iter().map(|path| path.as_os_str()).collect();
    // The first two words are the program and `identify`.
    let mut words = std::env::args_os().skip(2).filter(|word| !recordings.contains(word.as_os_str()));
    let mut options = Vec::new();
    while let Some(word) = words.next() {
        let word = word.to_string_lossy().into_owned();
        let name = word.split_once('=').map_or(word.as_str(), |(name, _)| name);
        match OWN_OPTIONS.iter().find(|(own, _)| *own == name) {
            Some((_, true)) if name == word => drop(words.next()),
            Some(_) => {}
            None => options.push(word),
        }
    }
    options
}
