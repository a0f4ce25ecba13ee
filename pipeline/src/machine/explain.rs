//! Effective values with their origin, and the table of all keys.
//!
//! Both come from the reader itself: whatever it asks a document for is noted with its value, origin, default and
//! meaning. So no list of keys has to be kept up to date.

use std::path::Path;

use super::{
    Machine, MachineFile,
    document::{DefaultValue, Document, EffectiveValue, Entry, Setting, ValueForm},
    error::MachineError,
    model_file,
};

/// One key that a machine file can have.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Key {
    /// Full dotted name with patterns: `axis.NAME.control.kp`, `axis.NAME.reference.sines[].amplitude`.
    pub path: String,
    /// What the key takes.
    pub allowed: String,
    /// Unit of the value; empty for a number without unit and for anything that is no number.
    pub unit: String,
    /// What an absent key means.
    pub default: DefaultValue,
    /// What the key means, in one sentence.
    pub meaning: &'static str,
    /// Forms that the value can have, for programs that check a file without this reader.
    pub forms: Vec<ValueForm>,
}

impl Key {
    /// Adds a form that the value can have under other settings. Choices of several settings become one.
    fn extend(&mut self, form: ValueForm) {
        if self.forms.contains(&form) {
            return;
        }
        if let [ValueForm::Choice { names: known }] = &mut self.forms[..]
            && let ValueForm::Choice { names } = form
        {
            known.extend(names.into_iter().filter(|name| !known.contains(name)).collect::<Vec<_>>());
            let quoted: Vec<String> = known.iter().map(|name| format!("\"{name}\"")).collect();
            self.allowed = quoted.join(" or ");
        } else {
            self.forms.push(form);
        }
    }
}

/// A file in which every table is given, so that the reader asks for all keys. Its values are of no interest.
const SPECIMEN: &str = r#"
    [scenarios.NAME]
    changes = [{ parameter = "mass" }, { parameter = "temperature" }]
    commands = [{}]
    [supply]
    [oil]
    [tip]
    piece = [{ to = [0.0, 0.0] }, { center = [0.0, 0.0] }]
    [walls]
    corner = [{}]
    [can]
    message = [{}]
    [axis.NAME.pressure]
    [axis.NAME.commissioned]
    [axis.NAME.reference]
    sines = [{}]
    [axis.NAME.plant]
"#;

/// Settings under which the reader asks for keys that it does not ask for otherwise.
const VARIANTS: [(&str, &str); 10] = [
    ("axis.NAME.reference.kind", "sines"),
    ("axis.NAME.reference.kind", "ramps"),
    ("axis.NAME.reference.kind", "trajectory"),
    ("axis.NAME.encoder.kind", "inclinometer"),
    ("source.kind", "replay"),
    ("source.kind", "external"),
    ("source.kind", "can"),
    ("supply.kind", "load-sensing"),
    ("mechanism.boom.length", "1"),
    ("soil.width", "1"),
];

/// All keys that a machine file can have, in the order in which they are read.
///
/// ```
/// let keys = pipeline::machine::keys();
/// let bound = keys.iter().find(|key| key.path == "axis.NAME.control.following_error").unwrap();
/// assert_eq!((bound.default.to_string().as_str(), bound.allowed.as_str()), ("0.03", "a number from 0.0001 to 100 m"));
/// ```
pub fn keys() -> Vec<Key> {
    let mut keys: Vec<Key> = Vec::new();
    for (path, text) in VARIANTS {
        let document = Document::parse(SPECIMEN, Setting::typed(&[(path.to_owned(), text.to_owned())]));
        // The specimen is no valid machine; only what the reader asks for is of interest.
        let _ = Machine::read(document.root(), Path::new("."));
        let mut place = 0;
        for Entry { value, allows, forms } in document.entries() {
            let EffectiveValue { key, unit, allowed, default, meaning, .. } = value;
            let path = pattern(&key);
            match keys.iter().position(|known| known.path == path) {
                Some(known) => {
                    forms.into_iter().for_each(|form| keys[known].extend(form));
                    place = known + 1;
                }
                None => {
                    let allowed = allows.unwrap_or(allowed);
                    keys.insert(place, Key { path, allowed, unit, default, meaning, forms });
                    place += 1;
                }
            }
        }
    }
    keys
}

/// The name of a key with its stage and its places in lists left open.
fn pattern(key: &str) -> String {
    let parts: Vec<&str> = key.split('.').collect();
    let open = |(place, part): (usize, &&str)| match (place, part.split_once('[')) {
        (1, _) if parts[0] == "stage" => "STAGE".to_owned(),
        (1, _) if ["axis", "scenarios"].contains(&parts[0]) => "NAME".to_owned(),
        (_, Some((list, _))) => format!("{list}[]"),
        (_, None) => (*part).to_owned(),
    };
    parts.iter().enumerate().map(open).collect::<Vec<_>>().join(".")
}

impl Machine {
    /// Reads a machine as [`Machine::load`] does, with a model file whose values rank between the machine file and
    /// `settings`, and says for every key which value it has and where the value comes from.
    ///
    /// # Errors
    /// All problems of the machine file at once, or that one of the files cannot be read.
    ///
    /// ```
    /// use pipeline::machine::{Machine, Origin};
    ///
    /// let setting = ("axis.boom.control.kp".to_owned(), "3".to_owned());
    /// let (_, values) = Machine::explain(None, None, &[setting])?;
    /// let of = |key: &str| values.iter().find(|value| value.key == key).unwrap();
    /// assert_eq!(of("axis.boom.control.kp").value.as_deref(), Some("3.0"));
    /// assert_eq!(of("axis.boom.control.kp").origin, Origin::CommandLine);
    /// assert_eq!(of("axis.boom.control.hold_to_run").origin, Origin::Default);
    /// assert_eq!(of("timing.feedback_timeout").origin.to_string(), "derived: 3 periods");
    /// # Ok::<(), pipeline::machine::MachineError>(())
    /// ```
    pub fn explain(
        file: Option<&Path>,
        model: Option<&Path>,
        settings: &[(String, String)],
    ) -> Result<(Self, Vec<EffectiveValue>), MachineError> {
        let MachineFile { text, model: built_in, name, folder } = MachineFile::open(file)?;
        let given = model.map_or(Ok(Vec::new()), model_file::read)?;
        let document = Document::parse(&text, Setting::typed(settings));
        if document.is_empty() {
            let allowed =
                "a machine file with name, [timing], [source] and [axis.NAME], such as `hydraxis init` writes";
            return Err(MachineError::of_file(name, "a file without a key", allowed));
        }
        if model_file::is_model(&document) {
            let found = "a model file, such as `hydraxis commission` writes, in the place of a machine file";
            return Err(MachineError::of_file(name, found, "a machine file, and this file with --model"));
        }
        if let Some(path) = model {
            document.prepend(model_file::expect_model(given, &path.display().to_string(), &document));
        }
        document.prepend(built_in);
        let machine = Self::read(document.root(), &folder);
        let values = document.values();
        document.into_result(&name, (machine, values))
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::machine::Origin;

    #[test]
    fn every_key_has_a_meaning_and_says_what_is_allowed() {
        let keys = keys();
        assert!(keys.len() > 100, "{}", keys.len());
        let paths: BTreeSet<&str> = keys.iter().map(|key| key.path.as_str()).collect();
        assert_eq!(paths.len(), keys.len(), "every key is listed once");
        for key in &keys {
            assert!(key.meaning.len() > 5 && !key.meaning.ends_with('.'), "{}: {}", key.path, key.meaning);
            assert!(!key.allowed.is_empty(), "{}", key.path);
            assert!(!key.forms.is_empty(), "{}", key.path);
        }
    }

    #[test]
    fn every_key_of_the_built_in_machine_is_in_the_table() {
        let keys = keys();
        let (_, values) = Machine::explain(None, None, &[]).unwrap();
        for value in values {
            let path = pattern(&value.key);
            let key = keys.iter().find(|key| key.path == path);
            assert_eq!(key.map(|key| key.meaning), Some(value.meaning), "{path}");
        }
    }

    #[test]
    fn a_value_comes_from_the_last_place_that_gives_it() {
        let folder = tempfile::tempdir().unwrap();
        let model = folder.path().join("model.toml");
        std::fs::write(&model, "[axis.boom.control]\nkp = 4.0\nki = 2.0\n[axis.boom.commissioned]\ndamping = 0.3\n")
            .unwrap();
        let set = [("axis.boom.control.ki".to_owned(), "1".to_owned())];
        let (machine, values) = Machine::explain(None, Some(&model), &set).unwrap();
        let of = |key: &str| values.iter().find(|value| value.key == key).unwrap();
        assert_eq!((machine.axes[0].control.kp, machine.axes[0].control.ki), (4.0, 1.0));
        assert_eq!(of("axis.boom.control.kp").origin, Origin::ModelFile { file: model.display().to_string(), line: 2 });
        assert_eq!(of("axis.boom.control.ki").origin, Origin::CommandLine);
        let text = super::super::BUILT_IN;
        let line = 1 + text[..text.find("stroke = 1.334").unwrap()].matches('\n').count();
        assert_eq!(of("axis.boom.stroke").origin, Origin::MachineFile { line });
        assert_eq!(of("axis.boom.encoder.tolerance").origin, Origin::Default);
        assert_eq!(of("axis.boom.reference.sines[0].amplitude").value.as_deref(), Some("0.08"));
    }
}
