//! What the reader has found out about each key: its value, where the value comes from, and what is allowed.

use std::fmt;

/// The effective value of one key of the machine file.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct EffectiveValue {
    /// Full dotted name of the key, such as `axis.boom.control.kp`.
    pub key: String,
    /// The value in the notation of TOML; `None` for a key that is absent and has no default.
    pub value: Option<String>,
    /// Unit of the value; empty for a number without unit and for anything that is no number.
    pub unit: String,
    /// Where the value comes from.
    pub origin: Origin,
    /// What the key takes.
    pub allowed: String,
    /// What an absent key means.
    pub default: DefaultValue,
    /// What the key means, in one sentence.
    pub meaning: &'static str,
}

/// Where an effective value comes from.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case", tag = "from")]
pub enum Origin {
    /// The machine file.
    MachineFile {
        /// Line of the value.
        line: usize,
    },
    /// The model file of `--model`.
    ModelFile {
        /// Name of the file.
        file: String,
        /// Line of the value.
        line: usize,
    },
    /// `--set` or another option of the command line.
    CommandLine,
    /// The default of the key.
    Default,
    /// Another key, from which the value follows.
    Derived {
        /// How the value follows, in words.
        rule: String,
    },
}

/// Where a problem is.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(in crate::machine) struct Place {
    /// Name of the file, where it is another one than the machine file.
    pub file: Option<String>,
    /// Line of the file.
    pub line: Option<usize>,
}

impl From<Option<usize>> for Place {
    fn from(line: Option<usize>) -> Self {
        Self { file: None, line }
    }
}

impl Origin {
    /// A value that was found, with the place that it comes from where that is no file.
    pub(super) fn of(&self, found: String) -> String {
        match self {
            Self::CommandLine => format!("{found} (from the {self})"),
            Self::ModelFile { .. } | Self::MachineFile { .. } | Self::Default | Self::Derived { .. } => found,
        }
    }

    /// Where a problem with the value is.
    pub(in crate::machine) fn place(&self) -> Place {
        match self {
            Self::MachineFile { line } => Place { file: None, line: Some(*line) },
            Self::ModelFile { file, line } => Place { file: Some(file.clone()), line: Some(*line) },
            Self::CommandLine | Self::Default | Self::Derived { .. } => Place::default(),
        }
    }
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::MachineFile { line } => write!(f, "machine file, line {line}"),
            Self::ModelFile { line, .. } => write!(f, "model file, line {line}"),
            Self::CommandLine => f.write_str("command line"),
            Self::Default => f.write_str("default"),
            Self::Derived { rule } => write!(f, "derived: {rule}"),
        }
    }
}

/// What an absent key means.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case", tag = "kind", content = "text")]
pub enum DefaultValue {
    /// The key must be given.
    Required,
    /// The key has no value.
    Nothing,
    /// A fixed value, in the notation of TOML.
    Value(String),
    /// A value that follows from other keys; the words say how.
    Rule(&'static str),
}

impl fmt::Display for DefaultValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Required => f.write_str("required"),
            Self::Nothing => f.write_str("none"),
            Self::Value(value) => f.write_str(value),
            Self::Rule(rule) => f.write_str(rule),
        }
    }
}
