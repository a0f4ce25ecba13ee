//! The model file: one table `[axis.NAME.commissioned]` per axis.

use std::{
    fmt::Write as _,
    fs::{self, File},
    io::{self, Write as _},
    path::{Path, PathBuf},
};

use pipeline::machine::{Commissioned, Control, DeadBand};

use crate::failure::Failure;

/// The text of the file; numbers read back exactly. `found` has the settings that fit to a model where there are some.
pub fn text<'a>(machine: &str, found: impl Iterator<Item = (&'a str, &'a Commissioned, Option<Control>)>) -> String {
    let mut text = format!(
        "# Found by `hydraxis commission` on \"{}\": static curve behind a dead time and a lag of first order.\n\
         # Speeds in m/s at openings of the valve beyond its dead band; times in s. The gains are those with which this\n\
         # axis, a third faster and a third slower ones follow best and come to rest.\n",
        machine.escape_default()
    );
    for (name, model, control) in found {
        if let Some(Control { kp, ki, feedforward, dead_band: DeadBand { extend, retract }, .. }) = control {
            let _ = write!(
                text,
                "\n[axis.{name}.identification]\nestimator = \"grey-box\"    # its speeds and its lag are adapted\n\
                 \n[axis.{name}.control]\nkp = {kp:?}\nki = {ki:?}\nfeedforward = {feedforward}\n\
                 dead_band_extend = {extend:?}\ndead_band_retract = {retract:?}\n"
            );
        }
        let Commissioned { dead_time, time_constant, dead_band, openings, speeds_extend, speeds_retract, fit_percent } =
            model;
        // Writing to a text cannot fail.
        let _ = write!(
            text,
            "\n[axis.{name}.commissioned]\ndead_time = {dead_time:?}\ntime_constant = {time_constant:?}\n\
             dead_band_extend = {:?}\ndead_band_retract = {:?}\nopenings = {openings:?}\n\
             speeds_extend = {speeds_extend:?}\nspeeds_retract = {speeds_retract:?}\n\
             fit_percent = {fit_percent:?}    # of the motion half a second ahead\n",
            dead_band.extend, dead_band.retract
        );
    }
    text
}

/// A file that is to be written, checked before the work begins.
pub struct ModelFile {
    path: PathBuf,
    force: bool,
}

impl ModelFile {
    /// Refuses one that is there, without `force`.
    pub fn new(path: &Path, force: bool) -> Result<Self, Failure> {
        if !force && path.symlink_metadata().is_ok() {
            return Err(exists(path));
        }
        match path.parent().filter(|folder| !folder.as_os_str().is_empty() && !folder.is_dir()) {
            Some(folder) => Err(Failure::Usage(format!(
                "--out: found {}; allowed: a file in a folder that is there, and {} is not",
                path.display(),
                folder.display()
            ))),
            None => Ok(Self { path: path.to_owned(), force }),
        }
    }

    /// Writes it whole.
    pub fn write(&self, text: &str) -> Result<(), Failure> {
        let path = &self.path;
        let written = if self.force {
            fs::write(path, text)
        } else {
            File::create_new(path).and_then(|mut file| file.write_all(text.as_bytes()))
        };
        written.map_err(|error| match error.kind() {
            io::ErrorKind::AlreadyExists => exists(path),
            _ => Failure::Run(format!("--out: {} cannot be written: {error}", path.display())),
        })
    }
}

fn exists(path: &Path) -> Failure {
    Failure::Usage(format!("--out: found {}, which is there already; allowed: a new file, or --force", path.display()))
}
