//! The model file: one table `[axis.NAME.commissioned]` for each axis, and the settings that follow from it.

use std::{
    fmt::Write as _,
    fs::{self, File},
    io::{self, Write as _},
    path::{Path, PathBuf},
};

use pipeline::machine::{Axis, Commissioned, Control, DeadBand, Hardware, Law, SMITH_MEMORY, SmithSettings};
use thiserror::Error;

use crate::report::output::{part_of, take_place};

/// Why a model file cannot be written.
#[derive(Debug, Error)]
pub enum ModelFileError {
    /// The file exists.
    #[error("--out: found {}, which is there already; allowed: a new file, or --force", .0.display())]
    Exists(PathBuf),
    /// A folder has the name.
    #[error("--out: found {}, which is a folder; allowed: a file", .0.display())]
    Folder(PathBuf),
    /// The folder of the file does not exist.
    #[error(
        "--out: found {}; allowed: a file in a folder that exists, and {} does not",
        .path.display(), .folder.display()
    )]
    NoFolder {
        /// The file.
        path: PathBuf,
        /// Its folder.
        folder: PathBuf,
    },
    /// The system refuses.
    #[error("--out: {} cannot be written", .path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
}

/// The text of the file. Numbers are written so that they read back exactly. `found` has the axis, the model, and the
/// tuned settings; a poor model has no settings.
pub fn text<'a>(machine: &str, found: impl Iterator<Item = (&'a Axis, &'a Commissioned, Option<Control>)>) -> String {
    let mut text = format!(
        "# Found by `hydraxis commission` on \"{}\": static curve behind a dead time and a lag of first order.\n\
         # Speeds in m/s at openings of the valve beyond its dead band; times in s. The gains are \
         those with which this\n\
         # axis, a third faster and a third slower ones follow best and come to rest. The fallback has less,\n\
         # where its loop would swing with 1.7 times the speeds at the mean slope of the curve.\n",
        machine.escape_default()
    );
    for (axis, model, control) in found {
        let Axis { name, hardware, .. } = axis;
        if let Some(control) = control {
            let Control { kp, ki, feedforward, dead_band: DeadBand { extend, retract }, law, .. } = control;
            // A key that is not written would stay what it is in the machine file.
            let (more, chosen) = match law {
                Law::Smith(SmithSettings { kp, ki, observer_time }) => (
                    format!("memory = {SMITH_MEMORY:?}\nhysteresis = {:?}\n", model.hysteresis),
                    format!(
                        "model = \"adaptive\"\nlaw = \"smith\"\n\
                         smith_kp = {kp:?}\nsmith_ki = {ki:?}\nobserver_time = {observer_time:?}\n"
                    ),
                ),
                Law::Predictive => {
                    (String::new(), "model = \"none\"    # the fallback follows as well as a model would\n".to_owned())
                }
            };
            let damping = Some(control.pressure_damping).filter(|_| axis.measures_force());
            let damping = damping.map_or_else(String::new, |more| format!("pressure_damping = {more:?}\n"));
            // Writing to a string cannot fail.
            let _ = write!(
                text,
                "\n[axis.{name}.identification]\nestimator = \"grey-box\"    # its speeds and its lag are adapted\n\
                 {more}\n[axis.{name}.control]\nkp = {kp:?}\nki = {ki:?}\nfeedforward = {feedforward}\n{damping}\
                 dead_band_extend = {extend:?}\ndead_band_retract = {retract:?}\n{chosen}"
            );
        }
        text += &table(name, hardware, model);
    }
    text
}

/// The table `commissioned` of an axis.
fn table(name: &str, hardware: &Hardware, model: &Commissioned) -> String {
    let Commissioned {
        dead_time,
        time_constant,
        dead_band,
        hysteresis,
        natural_frequency,
        damping,
        noise,
        openings,
        speeds_extend,
        speeds_retract,
        fit_percent,
        ..
    } = model;
    format!(
        "\n[axis.{name}.commissioned]\nmeasured_on = \"{}\"\ndead_time = {dead_time:?}\n\
         time_constant = {time_constant:?}\n\
         dead_band_extend = {:?}\ndead_band_retract = {:?}\nhysteresis = {hysteresis:?}\n\
         natural_frequency = {natural_frequency:?}\ndamping = {damping:?}\nnoise = {noise:?}\n\
         openings = {openings:?}\n\
         speeds_extend = {speeds_extend:?}\nspeeds_retract = {speeds_retract:?}\n\
         {}fit_percent = {fit_percent:?}    # of the motion half a second ahead\n",
        hardware.text,
        dead_band.extend,
        dead_band.retract,
        known(model)
    )
}

/// What is known of the largest commands and of the load of an axis, as lines of its table.
fn known(model: &Commissioned) -> String {
    let Commissioned { largest_tested: [extend, retract], overrun, mass, .. } = *model;
    let numbers = [
        ("tested_extend", extend),
        ("tested_retract", retract),
        ("overrun_extend", overrun.extend),
        ("overrun_retract", overrun.retract),
        ("mass", mass),
    ];
    let known = numbers.into_iter().filter(|(_, value)| value.is_finite());
    known.map(|(key, value)| format!("{key} = {value:?}\n")).collect()
}

/// A model file that will be written. It is checked before the experiment begins.
pub struct ModelFile {
    path: PathBuf,
    force: bool,
}

impl ModelFile {
    /// Checks that the file can be written, before an experiment takes its minutes.
    ///
    /// # Errors
    /// The file exists and `force` is not set, it is a folder, its folder does not exist, or the system refuses to
    /// write there.
    pub fn new(path: &Path, force: bool) -> Result<Self, ModelFileError> {
        if path.is_dir() {
            return Err(ModelFileError::Folder(path.to_owned()));
        }
        if !force && path.symlink_metadata().is_ok() {
            return Err(ModelFileError::Exists(path.to_owned()));
        }
        match path.parent().filter(|folder| !folder.as_os_str().is_empty() && !folder.is_dir()) {
            Some(folder) => Err(ModelFileError::NoFolder { path: path.to_owned(), folder: folder.to_owned() }),
            None => {
                let file = Self { path: path.to_owned(), force };
                file.probe().map_err(|source| ModelFileError::Write { path: file.path.clone(), source })?;
                Ok(file)
            }
        }
    }

    /// Writes and removes the file beside the model file.
    fn probe(&self) -> io::Result<()> {
        let Some((_, part)) = self.replaced()? else { return Ok(()) };
        File::create(&part).and_then(|_| fs::remove_file(&part))
    }

    /// The file that is written, behind a link, and the one beside it; none for what is no file, as `/dev/stdout`.
    fn replaced(&self) -> io::Result<Option<(PathBuf, PathBuf)>> {
        let path = if self.path.exists() { self.path.canonicalize()? } else { self.path.clone() };
        if path.exists() && !path.is_file() {
            return Ok(None);
        }
        let part = part_of(&path);
        Ok(Some((path, part)))
    }

    /// Writes the text beside the file and puts it in its place: a model that was there is lost only to a whole one.
    fn replace(&self, text: &str) -> io::Result<()> {
        let Some((path, part)) = self.replaced()? else { return fs::write(&self.path, text) };
        let written = fs::write(&part, text).and_then(|()| match fs::metadata(&path) {
            Ok(before) => fs::set_permissions(&part, before.permissions()),
            Err(_) => Ok(()),
        });
        take_place(&part, &path, written)
    }

    /// Writes the text.
    ///
    /// # Errors
    /// The file cannot be written, or it exists by now and `force` is not set.
    pub fn write(&self, text: &str) -> Result<(), ModelFileError> {
        let path = &self.path;
        let written = if self.force {
            self.replace(text)
        } else {
            File::create_new(path).and_then(|mut file| file.write_all(text.as_bytes())).inspect_err(|error| {
                if error.kind() != io::ErrorKind::AlreadyExists {
                    let _ = fs::remove_file(path);
                }
            })
        };
        written.map_err(|source| match source.kind() {
            io::ErrorKind::AlreadyExists => ModelFileError::Exists(path.clone()),
            _ => ModelFileError::Write { path: path.clone(), source },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_that_is_there_is_replaced_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let (model, link) = (folder.path().join("model.toml"), folder.path().join("link.toml"));
        fs::write(&model, "old").unwrap();
        std::os::unix::fs::symlink("model.toml", &link).unwrap();
        let file = ModelFile::new(&link, true).unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2, "the probe leaves nothing");
        let (path, part) = file.replaced().unwrap().unwrap();
        assert_eq!(path, model.canonicalize().unwrap());
        // Nothing can be written beside it.
        fs::create_dir(&part).unwrap();
        assert!(matches!(file.write("new"), Err(ModelFileError::Write { .. })));
        assert_eq!(fs::read_to_string(&model).unwrap(), "old");
        fs::remove_dir(&part).unwrap();
        file.write("new").unwrap();
        assert!(link.is_symlink());
        assert_eq!(
            (fs::read_to_string(&model).unwrap(), fs::read_to_string(&link).unwrap()),
            ("new".into(), "new".into())
        );
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[test]
    fn a_place_where_nothing_can_be_written_is_refused_before_the_experiment() {
        assert!(matches!(ModelFile::new(Path::new("/proc/model.toml"), false), Err(ModelFileError::Write { .. })));
        assert!(ModelFile::new(Path::new("/dev/null"), true).unwrap().write("text").is_ok());
    }
}
