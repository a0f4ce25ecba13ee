//! `--model-out`: a model as a file for `hydraxis predict`, or as source code.

use std::{io::Write, path::PathBuf};

use crate::{
    failure::Failure,
    model::{IdentifiedModel, source::Language},
    report::output::{OutputError, create},
};

/// The option.
const OPTION: &str = "--model-out";

/// The file of the option, whose ending is known.
#[derive(Debug, Clone)]
pub struct ModelOut {
    path: PathBuf,
    /// The language, and the name of the function or the prefix of the names; none for a model file.
    code: Option<(Language, String)>,
}

/// A file that has been opened for writing.
pub struct OpenModelOut<'a> {
    out: &'a ModelOut,
    file: Box<dyn Write>,
}

impl ModelOut {
    /// The file from what was typed.
    ///
    /// # Errors
    /// The ending is none of those that are known, or the name cannot be that of a function.
    pub fn parse(text: &str) -> Result<Self, String> {
        let path = PathBuf::from(text);
        let language = match path.extension().and_then(|ending| ending.to_str()) {
            Some("toml") => None,
            Some("h") => Some(Language::C),
            Some("py") => Some(Language::Python),
            Some("m") => Some(Language::Matlab),
            _ => return Err("allowed: a file that ends with .toml, .h, .py or .m".to_owned()),
        };
        let Some(language) = language else { return Ok(Self { path, code: None }) };
        let name = path.file_stem().and_then(|stem| stem.to_str()).unwrap_or_default().to_owned();
        let is_name = name.starts_with(|first: char| first.is_ascii_alphabetic())
            && name.chars().all(|sign| sign.is_ascii_alphanumeric() || sign == '_');
        if !is_name {
            return Err("allowed: before .h, .py or .m a name of letters, digits and underscores that begins with a \
                        letter, because functions get this name"
                .to_owned());
        }
        Ok(Self { path, code: Some((language, name)) })
    }

    /// Opens the file.
    ///
    /// # Errors
    /// The file cannot be created.
    pub fn open(&self) -> Result<OpenModelOut<'_>, OutputError> {
        Ok(OpenModelOut { out: self, file: create(OPTION, &self.path)? })
    }
}

impl OpenModelOut<'_> {
    /// Writes the model.
    ///
    /// # Errors
    /// The model has a coefficient that is not finite, or the file cannot be written.
    pub fn write(mut self, model: &IdentifiedModel) -> Result<(), Failure> {
        if !model.coefficients.is_finite() {
            let found = "found a coefficient that is not finite; allowed: a model that has not diverged";
            return Err(Failure::run(format!("{OPTION}: {found}")));
        }
        let text = match &self.out.code {
            None => model.text(),
            Some((language, name)) => language.code(model, name),
        };
        let written = self.file.write_all(text.as_bytes()).and_then(|()| self.file.flush());
        let refused = |source| OutputError::Write { option: OPTION, path: self.out.path.clone(), source };
        Ok(written.map_err(refused)?)
    }
}
