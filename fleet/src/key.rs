//! Keys: where on the network a machine has what.
//!
//! ```text
//! hydraxis/v1/SITE/MACHINE/alive                 liveliness token of the bridge
//! hydraxis/v1/SITE/MACHINE/telemetry/CHANNEL     messages of a channel of the group
//! hydraxis/v1/SITE/MACHINE/model                 models when they change; the current ones when asked
//! hydraxis/v1/SITE/MACHINE/model/NUMBER          earlier ones, when asked
//! hydraxis/v1/SITE/MACHINE/status                state of the bridge and of the group
//! hydraxis/v1/SITE/MACHINE/events                what has happened
//! hydraxis/v1/SITE/MACHINE/recordings            list of the recordings, when asked
//! hydraxis/v1/SITE/MACHINE/@command/WHAT         commands, as questions
//! hydraxis/v1/SITE/MACHINE/@plant                its simulated machine on another computer, for the stage alone
//! ```
//!
//! Zenoh lets neither `*` nor `**` stand for a part that begins with `@`. So rules and questions about all of a machine
//! do not reach its plant, and command nothing.
//!
//! `v1` is the major version: a change that an older reader would misunderstand raises it.

use std::{fmt, str::FromStr};

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// First part of every key.
const ROOT: &str = "hydraxis/v1";
/// Longest name of a site or a machine, bytes.
const LONGEST: usize = 32;

/// Liveliness token of a bridge.
pub const ALIVE: &str = "alive";
/// Models.
pub const MODEL: &str = "model";
/// State of the bridge and of the group.
pub const STATUS: &str = "status";
/// What has happened.
pub const EVENTS: &str = "events";
/// List of the recordings.
pub const RECORDINGS: &str = "recordings";
/// The simulated machine on another computer.
pub const PLANT: &str = "@plant";

/// The name of a site or of a machine; it is a part of a key, and of a rule of access.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Deserialize, Serialize)]
#[serde(try_from = "String", into = "String")]
pub struct Name(String);

/// A text that is no name.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("found \"{found}\"; allowed: 1 to {LONGEST} small letters a to z, digits and -")]
pub struct NameError {
    /// The text.
    pub found: String,
}

impl FromStr for Name {
    type Err = NameError;

    fn from_str(text: &str) -> Result<Self, NameError> {
        let is_allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
        let is_name = (1..=LONGEST).contains(&text.len()) && text.chars().all(is_allowed);
        if is_name { Ok(Self(text.to_owned())) } else { Err(NameError { found: text.to_owned() }) }
    }
}

impl TryFrom<String> for Name {
    type Error = NameError;

    fn try_from(text: String) -> Result<Self, NameError> {
        text.parse()
    }
}

impl From<Name> for String {
    fn from(name: Name) -> Self {
        name.0
    }
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&self.0)
    }
}

/// A machine of a site.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    /// The site.
    pub site: Name,
    /// The machine.
    pub machine: Name,
}

impl Place {
    /// Key of something of this machine.
    pub fn key(&self, of: &str) -> String {
        format!("{ROOT}/{}/{}/{of}", self.site, self.machine)
    }

    /// The machine that a key belongs to, and what it is of the machine; none for a key of something else.
    pub fn of(key: &str) -> Option<(Self, &str)> {
        let mut parts = key.strip_prefix(ROOT)?.strip_prefix('/')?.splitn(3, '/');
        let (site, machine) = (parts.next()?.parse().ok()?, parts.next()?.parse().ok()?);
        Some((Self { site, machine }, parts.next()?))
    }
}

/// Key expression of something of all machines of a site, or of all sites.
pub fn of_all(site: Option<&Name>, of: &str) -> String {
    let site = site.map_or("*".to_owned(), Name::to_string);
    format!("{ROOT}/{site}/*/{of}")
}

/// What a channel of the group is called below a machine.
pub fn telemetry(channel: &str) -> String {
    format!("telemetry/{channel}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_leads_back_to_its_machine() {
        let place = Place { site: "quarry".parse().unwrap(), machine: "ex-07".parse().unwrap() };
        let key = place.key(&telemetry("encoder-sample"));
        assert_eq!(key, "hydraxis/v1/quarry/ex-07/telemetry/encoder-sample");
        assert_eq!(Place::of(&key), Some((place, "telemetry/encoder-sample")));
        assert_eq!(of_all(None, STATUS), "hydraxis/v1/*/*/status");
        for other in ["hydraxis/v2/quarry/ex-07/status", "hydraxis/v1/quarry/ex-07", "hydraxis/v1/Quarry/ex-07/status"]
        {
            assert_eq!(Place::of(other), None, "{other}");
        }
    }

    #[test]
    fn names_that_could_reach_other_keys_are_refused() {
        for text in ["", "*", "a/b", "A", "a b", "a$*", "\u{e4}", &"a".repeat(33)] {
            let error = text.parse::<Name>().unwrap_err().to_string();
            assert!(error.starts_with(&format!("found \"{text}\"; allowed: 1 to 32")), "{error}");
        }
    }
}
