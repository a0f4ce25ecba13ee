//! The settings of a bridge, of a plant and of its stage, a TOML file.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    str::FromStr,
    time::Duration,
};

use humantime::format_duration;
use pipeline::channel::Prefix;
use serde::Deserialize;
use thiserror::Error;

use crate::{
    connection::{Connection, ConnectionError, Tls},
    key::{Name, Place},
};

/// Highest rate of a key, 1/s.
const HIGHEST_RATE: f64 = 1000.0;
/// Most messages that wait for the network.
const LARGEST_RING: usize = 4096;
/// Least and largest limit of memory, MB. A bridge with TLS needs 30 MB.
const MEMORY_MB: std::ops::RangeInclusive<u64> = 32..=4096;
/// Highest speed of an axis that is moved from elsewhere, m/s.
const HIGHEST_SPEED: f64 = 0.1;
/// Longest consent that the settings can allow.
const LONGEST_CONSENT: Duration = Duration::from_secs(8 * 3600);

/// Shortest and longest patience with a plant. `hydraxis run` ends a lock-step in which nothing has worked for 10 s.
const PATIENCE: std::ops::RangeInclusive<Duration> = Duration::from_secs(1)..=Duration::from_secs(9);

/// Settings of a bridge, of a plant and of its stage.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Site of the machine.
    pub site: Name,
    /// Name of the machine at its site.
    pub machine: Name,
    /// Group to read; without it the only one that runs.
    pub group: Option<String>,
    /// The router of the site: `tls/HOST:PORT`. Of several, the first one that answers.
    pub router: Vec<String>,
    /// Files of TLS; without them only a router on this computer can be reached.
    pub tls: Option<Tls>,
    /// Folder whose recordings are listed.
    pub recordings: Option<PathBuf>,
    /// How often the keys are published.
    #[serde(default)]
    pub rates: Rates,
    /// What the bridge may take of the computer.
    #[serde(default)]
    pub limits: Limits,
    /// What may be commanded over the network; without it nothing. The bridge does not look at it.
    pub commands: Option<Commands>,
    /// How the stage asks the plant.
    #[serde(default)]
    pub plant: Plant,
}

/// What may be commanded over the network.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Commands {
    /// File to which every command and its answer are added.
    pub journal: PathBuf,
    /// Longest time for which a person at the machine can give consent.
    #[serde(with = "humantime_serde", default = "half_an_hour")]
    pub longest_consent: Duration,
    /// The axes that may be moved with consent, by name.
    #[serde(default)]
    pub axes: BTreeMap<String, Window>,
}

/// How an axis may be moved from elsewhere.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Window {
    /// Lowest set point, m.
    pub from: f64,
    /// Highest set point, m.
    pub to: f64,
    /// Speed of the set point, m/s.
    pub speed: f64,
}

fn half_an_hour() -> Duration {
    Duration::from_secs(1800)
}

/// Messages a second by key; 0 for none.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct Rates {
    /// Positions, 1/s.
    pub encoder_sample: f64,
    /// Commands, 1/s.
    pub valve_command: f64,
    /// Names, modes and models of the axes, 1/s.
    pub machine_state: f64,
    /// Heartbeats of each stage, 1/s.
    pub stage_health: f64,
    /// State of the bridge and the group, 1/s.
    pub status: f64,
    /// Models beside those that have changed, 1/s: adaptive models change at every tick.
    pub model: f64,
}

impl Default for Rates {
    fn default() -> Self {
        Self {
            encoder_sample: 20.0,
            valve_command: 20.0,
            machine_state: 1.0,
            stage_health: 1.0,
            status: 1.0,
            model: 0.1,
        }
    }
}

/// What the bridge may take.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct Limits {
    /// Memory of the process, MB.
    pub memory_mb: u64,
    /// Messages that wait for the network; the oldest is overwritten.
    pub ring: usize,
    /// A put that takes longer ends the process.
    #[serde(with = "humantime_serde")]
    pub put: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Self { memory_mb: 128, ring: 64, put: Duration::from_secs(1) }
    }
}

/// How the stage asks the plant.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct Plant {
    /// A plant that does not answer for so long ends the stage.
    #[serde(with = "humantime_serde")]
    pub patience: Duration,
}

impl Default for Plant {
    fn default() -> Self {
        Self { patience: Duration::from_secs(8) }
    }
}

/// Why settings are refused.
#[derive(Debug, Error)]
pub enum SettingsError {
    /// The file cannot be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// It is no TOML, or has another key or type.
    #[error("{}: {source}", path.display())]
    Toml {
        /// The file.
        path: PathBuf,
        /// Line, key and what was expected.
        source: Box<toml::de::Error>,
    },
    /// A value is out of its range.
    #[error("{}: {key}: found {found}; allowed: {allowed}", path.display())]
    Range {
        /// The file.
        path: PathBuf,
        /// The key.
        key: String,
        /// Its value.
        found: String,
        /// What is allowed.
        allowed: String,
    },
    /// The router cannot be reached like this.
    #[error("{}: {source}", path.display())]
    Connection {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: ConnectionError,
    },
}

impl Commands {
    /// The first value that is out of its range: key, value, and what is allowed.
    fn out_of_range(&self) -> Option<(String, String, String)> {
        if !(Duration::from_secs(1)..=LONGEST_CONSENT).contains(&self.longest_consent) {
            let [found, longest] = [self.longest_consent, LONGEST_CONSENT].map(humantime::format_duration);
            return Some(("commands.longest-consent".to_owned(), found.to_string(), format!("1s to {longest}")));
        }
        self.axes.iter().find_map(|(name, Window { from, to, speed })| {
            let key = |of: &str| format!("commands.axes.{name}.{of}");
            if !from.is_finite() || !to.is_finite() || from >= to {
                return Some((key("from"), format!("{from}, with to = {to}"), "less than `to`, both in m".to_owned()));
            }
            let is_speed = *speed > 0.0 && *speed <= HIGHEST_SPEED;
            (!is_speed).then(|| (key("speed"), speed.to_string(), format!("above 0, to {HIGHEST_SPEED} m/s")))
        })
    }
}

impl Settings {
    /// Reads and checks a file. Paths in it are relative to its folder.
    ///
    /// # Errors
    /// It cannot be read, or something in it is not allowed.
    pub fn load(path: &Path) -> Result<Self, SettingsError> {
        let text =
            std::fs::read_to_string(path).map_err(|source| SettingsError::Read { path: path.to_owned(), source })?;
        Self::of(&text, path)
    }

    fn of(text: &str, path: &Path) -> Result<Self, SettingsError> {
        let toml = |source| SettingsError::Toml { path: path.to_owned(), source: Box::new(source) };
        let mut settings: Self = toml::from_str(text).map_err(toml)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        settings.tls = settings.tls.map(|tls| tls.below(folder));
        settings.recordings = settings.recordings.map(|recordings| folder.join(recordings));
        settings.commands.iter_mut().for_each(|commands| commands.journal = folder.join(&commands.journal));
        let connection = |source| SettingsError::Connection { path: path.to_owned(), source };
        settings.connection().check().map_err(connection)?;
        let range = |(key, found, allowed)| SettingsError::Range { path: path.to_owned(), key, found, allowed };
        settings.out_of_range().map_or(Ok(settings), |wrong| Err(range(wrong)))
    }

    /// The first value that is out of its range: key, value, and what is allowed.
    fn out_of_range(&self) -> Option<(String, String, String)> {
        let Rates { encoder_sample, valve_command, machine_state, stage_health, status, model } = self.rates;
        let rates = [
            ("rates.encoder-sample", encoder_sample),
            ("rates.valve-command", valve_command),
            ("rates.machine-state", machine_state),
            ("rates.stage-health", stage_health),
            ("rates.status", status),
            ("rates.model", model),
        ];
        let wrong = rates.into_iter().find(|(_, rate)| !(0.0..=HIGHEST_RATE).contains(rate));
        if let Some((key, rate)) = wrong {
            return Some((key.to_owned(), rate.to_string(), format!("0 to {HIGHEST_RATE} a second")));
        }
        if !MEMORY_MB.contains(&self.limits.memory_mb) {
            let allowed = format!("{} to {}", MEMORY_MB.start(), MEMORY_MB.end());
            return Some(("limits.memory-mb".to_owned(), self.limits.memory_mb.to_string(), allowed));
        }
        if !(1..=LARGEST_RING).contains(&self.limits.ring) {
            return Some(("limits.ring".to_owned(), self.limits.ring.to_string(), format!("1 to {LARGEST_RING}")));
        }
        if !PATIENCE.contains(&self.plant.patience) {
            let [found, low, high] = [self.plant.patience, *PATIENCE.start(), *PATIENCE.end()].map(format_duration);
            return Some(("plant.patience".to_owned(), found.to_string(), format!("{low} to {high}")));
        }
        if let Some(Err(error)) = self.group.as_ref().map(|group| Prefix::from_str(group)) {
            return Some(("group".to_owned(), format!("\"{}\"", error.found), "a prefix".to_owned()));
        }
        self.commands.as_ref().and_then(Commands::out_of_range)
    }

    /// How the router is reached.
    pub fn connection(&self) -> Connection {
        Connection { router: self.router.clone(), tls: self.tls.clone() }
    }

    /// The machine.
    pub fn place(&self) -> Place {
        Place { site: self.site.clone(), machine: self.machine.clone() }
    }

    /// The group that is named.
    pub fn prefix(&self) -> Option<Prefix> {
        self.group.as_ref()?.parse().ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEAST: &str = "site = \"quarry\"\nmachine = \"ex-07\"\nrouter = [\"tcp/127.0.0.1:7447\"]\n";

    fn of(text: &str) -> Result<Settings, String> {
        Settings::of(text, Path::new("/etc/hydraxis/fleet.toml")).map_err(|error| error.to_string())
    }

    #[test]
    fn the_least_settings_have_the_usual_rates() {
        let settings = of(LEAST).unwrap();
        assert_eq!(settings.place().key("status"), "hydraxis/v1/quarry/ex-07/status");
        assert_eq!((settings.rates.encoder_sample, settings.rates.stage_health), (20.0, 1.0));
        assert_eq!((settings.limits.ring, settings.limits.put), (64, Duration::from_secs(1)));
        assert!(settings.prefix().is_none());
        let slower = of(&format!("{LEAST}recordings = \"rec\"\n[rates]\nencoder-sample = 2.5\n")).unwrap();
        assert_eq!((slower.rates.encoder_sample, slower.rates.valve_command), (2.5, 20.0));
        assert_eq!(slower.recordings.unwrap(), Path::new("/etc/hydraxis/rec"));
    }

    #[test]
    fn wrong_settings_are_refused_with_their_place() {
        let remote = LEAST.replace("127.0.0.1", "10.0.0.1");
        for (text, part) in [
            (LEAST.replace("ex-07", "Ex 7"), "found \"Ex 7\"; allowed: 1 to 32 small letters"),
            (format!("{LEAST}rate = 1\n"), "unknown field `rate`"),
            (format!("{LEAST}[rates]\nencoder-sample = -1\n"), "rates.encoder-sample: found -1; allowed: 0 to 1000"),
            (format!("{LEAST}[rates]\nstatus = nan\n"), "rates.status: found NaN"),
            (format!("{LEAST}[limits]\nmemory-mb = 1\n"), "limits.memory-mb: found 1; allowed: 32 to 4096"),
            (format!("{LEAST}[limits]\nring = 0\n"), "limits.ring: found 0; allowed: 1 to 4096"),
            (format!("{LEAST}[plant]\npatience = \"10s\"\n"), "plant.patience: found 10s; allowed: 1s to 9s"),
            (format!("group = \"a/b\"\n{LEAST}"), "group: found \"a/b\""),
            (
                format!(
                    "{LEAST}[commands]\njournal = \"a\"\n[commands.axes.boom]\nfrom = 0.5\nto = 0.5\nspeed = 0.1\n"
                ),
                "commands.axes.boom.from: found 0.5, with to = 0.5; allowed: less than `to`",
            ),
            (
                format!("{LEAST}[commands]\njournal = \"a\"\n[commands.axes.boom]\nfrom = 0\nto = 0.5\nspeed = nan\n"),
                "commands.axes.boom.speed: found NaN; allowed: above 0, to 0.1 m/s",
            ),
            (
                format!("{LEAST}[commands]\njournal = \"a\"\nlongest-consent = \"9h\"\n"),
                "commands.longest-consent: found 9h; allowed: 1s to 8h",
            ),
            (remote, "found \"tcp/10.0.0.1:7447\"; allowed: tls/HOST:PORT"),
            ("machine = \"a\"\n".to_owned(), "missing field `site`"),
        ] {
            let error = of(&text).unwrap_err();
            assert!(error.contains(part) && error.starts_with("/etc/hydraxis/fleet.toml: "), "{part}: {error}");
        }
    }
}
