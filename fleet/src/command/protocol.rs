//! Questions to a machine and its answers, as JSON.
//!
//! | key below the machine | asks | is answered |
//! |---|---|---|
//! | `@command/disarm` | [`Disarm`] | [`Disarmed`] |
//! | `@command/challenge` | [`Ask`] | [`Challenge`] |
//! | `@command/arm` | [`Arm`] | [`Challenge`], for the first beat |
//! | `@command/beat` | [`Beat`] | [`Answer`] |
//!
//! A refusal is an error of Zenoh with the reason as text.

use std::{collections::BTreeMap, fmt, str::FromStr};

use serde::{Deserialize, Serialize};

use crate::key::Name;

/// Stops axes.
pub const DISARM: &str = "@command/disarm";
/// Gives a challenge.
pub const CHALLENGE: &str = "@command/challenge";
/// Arms axes.
pub const ARM: &str = "@command/arm";
/// Keeps them armed.
pub const BEAT: &str = "@command/beat";
/// Most bytes of a question.
pub const LONGEST: usize = 4096;

/// A random number that is good for one use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(try_from = "String", into = "String")]
pub struct Token(pub u128);

impl fmt::Display for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:032x}", self.0)
    }
}

impl FromStr for Token {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let is_token = text.len() == 32 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
        let token = u128::from_str_radix(text, 16).ok().filter(|_| is_token);
        token.map(Self).ok_or_else(|| "a challenge has 32 hexadecimal digits".to_owned())
    }
}

impl TryFrom<String> for Token {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<Token> for String {
    fn from(token: Token) -> Self {
        token.to_string()
    }
}

/// Stops axes. A question that is none of these stops all of them.
#[derive(Debug, Clone, Deserialize, Serialize)]
pub struct Disarm {
    /// Who asks.
    pub station: Name,
    /// The axes; empty for all.
    #[serde(default)]
    pub axes: Vec<String>,
}

/// What has become of a stop: mode and flags of each axis.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, Serialize)]
pub struct Disarmed {
    /// By name.
    pub axes: BTreeMap<String, String>,
}

/// Asks for a challenge.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Ask {
    /// Who asks.
    pub station: Name,
}

/// What the next question has to carry.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, Serialize)]
pub struct Challenge {
    /// For one use.
    pub challenge: Token,
}

/// Arms axes.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Arm {
    /// Who asks.
    pub station: Name,
    /// Of the answer before.
    pub challenge: Token,
    /// Set points by axis, m.
    pub targets: BTreeMap<String, f64>,
}

/// Keeps axes armed, and moves their set points.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Beat {
    /// Of the answer before.
    pub challenge: Token,
    /// Set points by axis, m: those of the axes that were armed.
    pub targets: BTreeMap<String, f64>,
}

/// The answer to a beat.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Answer {
    /// For the next beat.
    pub challenge: Token,
    /// The axes of the seat by name.
    pub axes: BTreeMap<String, AxisView>,
}

/// An axis as the machine sees it.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize)]
pub struct AxisView {
    /// Mode and flags, in words.
    pub state: String,
    /// Position, m; none while it is not usable.
    pub position: Option<f64>,
    /// Set point on its way to the target, m; none until the axis follows.
    pub set_point: Option<f64>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_comes_back_and_other_texts_are_refused() {
        let token = Token(0xab << 64);
        assert_eq!(token.to_string().parse(), Ok(token));
        for text in ["", "ab", &"g".repeat(32), &"+".repeat(32), &"0".repeat(33)] {
            assert!(text.parse::<Token>().is_err(), "{text}");
        }
    }
}
