//! The form of a value, for programs that check a machine file without this reader, such as editors.

/// ValueForm that the value of a key can have.
///
/// A range is that of the value alone. It is `None` where the range depends on other keys.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum ValueForm {
    /// A number, or a text with a unit.
    Number {
        /// Least and largest value, in the unit of the key.
        range: Option<(f64, f64)>,
        /// Unit of the key, from which the units of a text follow; `None` where it depends on other keys.
        unit: Option<String>,
    },
    /// A list of numbers, each as a [`ValueForm::Number`] has it.
    Numbers {
        /// Least and largest value of each number, in the unit of the key.
        range: Option<(f64, f64)>,
        /// Unit of the key.
        unit: Option<String>,
        /// Least and largest length of the list.
        length: (usize, Option<usize>),
    },
    /// A whole number.
    Integer {
        /// Least and largest value.
        range: Option<(usize, usize)>,
    },
    /// A text with a duration and its unit.
    Duration,
    /// Any text.
    Text,
    /// A list of texts.
    Texts,
    /// A list of lists of texts.
    TextTable,
    /// `true` or `false`.
    Flag,
    /// One of these texts.
    Choice {
        /// The texts.
        names: Vec<String>,
    },
}

impl ValueForm {
    /// This form without what depends on other keys.
    pub(super) fn loose(self) -> Self {
        match self {
            Self::Number { .. } => Self::Number { range: None, unit: None },
            Self::Numbers { length, .. } => Self::Numbers { range: None, unit: None, length },
            Self::Integer { .. } => Self::Integer { range: None },
            Self::Choice { .. } => Self::Text,
            other => other,
        }
    }
}
