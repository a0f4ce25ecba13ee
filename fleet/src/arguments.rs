//! The command line.

use std::{net::SocketAddr, path::PathBuf, time::Duration};

use clap::{Args, Parser, Subcommand};
use hydraxis_fleet::{
    connection::{Connection, Tls},
    key::{Name, Place},
    record::Settings,
};
use pipeline::{
    channel::Prefix,
    machine::{Machine, MachineError},
};

/// Many machines of Hydraxis on one screen, and a simulated machine on another computer, over Zenoh.
#[derive(Debug, Parser)]
#[command(version, about)]
pub struct Arguments {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Publishes the group of this machine, read only, until SIGTERM
    Bridge {
        /// Settings: site, machine, router, rates
        settings: PathBuf,
    },
    /// Shows all machines, every second, until Ctrl-C
    Top(Top),
    /// Writes everything that the machines of a site publish to files, until Ctrl-C
    Record(Record),
    /// Shows all machines in a browser of this computer, until Ctrl-C
    Page(Page),
    /// Asks a machine for its state, events, or list of recordings, and prints the answer as JSON
    Ask(Ask),
    /// Simulates the machine on this computer for a group on another one, until SIGTERM
    Plant(Plant),
    /// Takes the place of plant-sim in a group: its machine is the plant on another computer
    #[command(after_help = "\
`hydraxis run` starts it by these words in the machine file, and adds the arguments behind the settings:
  [stage.plant-sim]
  command = [\"hydraxis-fleet\", \"stage\", \"fleet.toml\"]")]
    Stage(Stage),
    /// Runs a router of Zenoh out of its configuration file
    Router {
        /// Configuration of Zenoh, JSON5, with mode: "router"
        file: PathBuf,
    },
    /// Lets stations disarm this machine, until SIGTERM
    #[cfg(feature = "commands")]
    Listen {
        /// Settings of the bridge, with [commands]
        settings: PathBuf,
    },
    /// Lets one station at a time move axes of this machine for a time; Ctrl-C takes it back
    #[cfg(feature = "commands")]
    Consent {
        /// Settings of the bridge, with [commands]
        settings: PathBuf,
        /// For how long
        #[arg(long = "for", value_name = "TIME", value_parser = humantime::parse_duration)]
        time: Duration,
    },
    /// Disarms axes of a machine, all where none is named
    #[cfg(feature = "commands")]
    Disarm(Disarm),
    /// Moves axes of a machine with its consent, and keeps them there until Ctrl-C
    #[cfg(feature = "commands")]
    Operate(Operate),
    /// Measures many simulated machines on one router of this computer
    Bench(Bench),
    /// Publishes simulated machines, for bench
    #[command(hide = true)]
    BenchPublish {
        /// Router
        router: String,
        /// Number of machines
        machines: usize,
    },
}

/// `top`.
#[derive(Debug, Args)]
pub struct Top {
    /// How the router is reached.
    #[command(flatten)]
    pub router: Router,
    /// Only this site [default: all sites]
    #[arg(long)]
    pub site: Option<Name>,
    /// A line for each axis as well
    #[arg(long)]
    pub axes: bool,
    /// Age from which a sample counts as stale
    #[arg(long, value_name = "TIME", default_value = "1s", value_parser = stale_after)]
    pub stale_after: Duration,
    /// Listens for so long, prints once and ends
    #[arg(long, value_name = "TIME", value_parser = humantime::parse_duration)]
    pub once: Option<Duration>,
    /// Prints JSON in the place of the table: an array of machines in a line
    #[arg(long)]
    pub json: bool,
}

/// `record`.
#[derive(Debug, Args)]
pub struct Record {
    /// Folder for the files: one for each machine and hour, MCAP
    pub folder: PathBuf,
    /// How the router is reached.
    #[command(flatten)]
    pub router: Router,
    /// Only this site [default: all sites]
    #[arg(long)]
    pub site: Option<Name>,
    /// Most bytes of all files in the folder; the oldest ones make room for new ones
    #[arg(long, value_name = "SIZE", default_value = "10GB", value_parser = size)]
    pub limit: u64,
    /// Longest time of a file
    #[arg(long, value_name = "TIME", default_value = "1h", value_parser = humantime::parse_duration)]
    pub every: Duration,
    /// Age from which a message counts as late
    #[arg(long, value_name = "TIME", default_value = "1s", value_parser = stale_after)]
    pub stale_after: Duration,
}

impl Record {
    /// What is recorded, and where.
    pub fn settings(&self) -> Settings {
        let Self { limit, every, stale_after, .. } = *self;
        Settings { folder: self.folder.clone(), limit, every, stale_after, site: self.site.clone() }
    }
}

/// `page`.
#[derive(Debug, Args)]
pub struct Page {
    /// How the router is reached.
    #[command(flatten)]
    pub router: Router,
    /// Only this site [default: all sites]
    #[arg(long)]
    pub site: Option<Name>,
    /// Age from which a sample counts as stale
    #[arg(long, value_name = "TIME", default_value = "1s", value_parser = stale_after)]
    pub stale_after: Duration,
    /// Address of this computer, with port
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8090")]
    pub listen: SocketAddr,
}

/// `ask`.
#[derive(Debug, Args)]
pub struct Ask {
    /// How the router is reached.
    #[command(flatten)]
    pub router: Router,
    /// The machine: SITE/MACHINE
    #[arg(value_parser = place)]
    pub machine: Place,
    /// What to ask for
    #[arg(value_parser = ["status", "events", "recordings"])]
    pub what: String,
}

/// `disarm`.
#[cfg(feature = "commands")]
#[derive(Debug, Args)]
pub struct Disarm {
    /// Machine and station.
    #[command(flatten)]
    pub station: Station,
    /// Only this axis; may be given several times
    #[arg(long, value_name = "NAME")]
    pub axis: Vec<String>,
}

/// `operate`.
#[cfg(feature = "commands")]
#[derive(Debug, Args)]
pub struct Operate {
    /// Machine and station.
    #[command(flatten)]
    pub station: Station,
    /// Axis and its set point, m; may be given for several axes
    #[arg(long, value_name = "AXIS=METRES", required = true, value_parser = target)]
    pub to: Vec<(String, f64)>,
    /// Arms the axes; without it nothing moves
    #[arg(long)]
    pub enable: bool,
    /// Ends after so long
    #[arg(long, value_name = "TIME", value_parser = humantime::parse_duration)]
    pub duration: Option<Duration>,
}

/// A machine, and who asks it.
#[cfg(feature = "commands")]
#[derive(Debug, Args)]
pub struct Station {
    /// How the router is reached.
    #[command(flatten)]
    pub router: Router,
    /// The machine: SITE/MACHINE
    #[arg(value_parser = place)]
    pub machine: Place,
    /// What this station calls itself in the journal of the machine
    #[arg(long, value_name = "NAME")]
    pub station: Name,
}

/// `plant`.
#[derive(Debug, Args)]
pub struct Plant {
    /// Settings: site, machine, router
    pub settings: PathBuf,
    /// What is simulated.
    #[command(flatten)]
    pub machine: MachineFile,
    /// Seed of the simulated noise, that of the group
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}

/// `stage`.
#[derive(Debug, Args)]
pub struct Stage {
    /// Settings: site, machine, router, patience
    pub settings: PathBuf,
    /// What is controlled.
    #[command(flatten)]
    pub machine: MachineFile,
    /// Wait for the recorder of `hydraxis run --record`, so that the recording is whole
    #[arg(long)]
    pub recorded: bool,
    /// Name of the group
    #[arg(long)]
    pub prefix: Prefix,
    /// Lock-step: the only clock that a plant on another computer has
    #[arg(long)]
    pub lockstep: bool,
    /// End after this number of ticks [default: no end]
    #[arg(long)]
    pub ticks: Option<u64>,
    /// Seed of the simulated noise, that of the plant
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}

/// A machine file, and the values that replace those of the file.
#[derive(Debug, Args)]
pub struct MachineFile {
    /// Machine file [default: the built-in excavator with its model]
    #[arg(value_name = "MACHINE.toml")]
    machine: Option<PathBuf>,
    /// Replace the value of a key of the machine file; may be given several times
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = setting)]
    values: Vec<(String, String)>,
}

impl MachineFile {
    /// The machine.
    ///
    /// # Errors
    /// Everything that is wrong with the file or the values.
    pub fn load(&self) -> Result<Machine, MachineError> {
        Machine::load(self.machine.as_deref(), &self.values)
    }
}

/// How a router is reached.
#[derive(Debug, Args)]
pub struct Router {
    /// Router of the site, tls/HOST:PORT; several are tried in turn
    #[arg(long, required = true, value_name = "ENDPOINT")]
    router: Vec<String>,
    /// Certificate of the authority that has signed the router's, PEM
    #[arg(long, requires_all = ["certificate", "key"], value_name = "FILE")]
    ca: Option<PathBuf>,
    /// Own certificate, PEM
    #[arg(long, requires_all = ["ca", "key"], value_name = "FILE")]
    certificate: Option<PathBuf>,
    /// Key of the own certificate, PEM
    #[arg(long, requires_all = ["ca", "certificate"], value_name = "FILE")]
    key: Option<PathBuf>,
}

impl Router {
    /// As a connection.
    pub fn connection(&self) -> Connection {
        let files = self.ca.clone().zip(self.certificate.clone()).zip(self.key.clone());
        let tls = files.map(|((ca, certificate), key)| Tls { ca, certificate, key });
        Connection { router: self.router.clone(), tls }
    }
}

/// `bench`.
#[derive(Debug, Args)]
pub struct Bench {
    /// Numbers of machines
    #[arg(long, value_delimiter = ',', default_value = "1,20,100,200")]
    #[arg(value_parser = clap::value_parser!(u32).range(1..=500))]
    pub machines: Vec<u32>,
    /// Time of each measurement
    #[arg(long, value_name = "TIME", default_value = "10s", value_parser = humantime::parse_duration)]
    pub duration: Duration,
    /// Prints JSON in the place of the table
    #[arg(long)]
    pub json: bool,
}

fn setting(text: &str) -> Result<(String, String), String> {
    let (key, value) = text.split_once('=').ok_or_else(|| format!("found \"{text}\"; allowed: KEY=VALUE"))?;
    Ok((key.trim().to_owned(), value.trim().to_owned()))
}

/// A number of bytes with its unit.
fn size(text: &str) -> Result<u64, String> {
    let allowed = || "allowed: 100MB or more, such as 500MB or 10GB".to_owned();
    let units = [("MB", 1e6), ("GB", 1e9), ("TB", 1e12)];
    let (number, unit) =
        units.iter().find_map(|(unit, size)| Some((text.strip_suffix(unit)?, size))).ok_or_else(allowed)?;
    let bytes = number.trim().parse::<f64>().map_err(|_| allowed())? * unit;
    if (1e8..=1e18).contains(&bytes) { Ok(bytes as u64) } else { Err(allowed()) }
}

/// Time from which a message is old: beyond a minute nothing is of now.
fn stale_after(text: &str) -> Result<Duration, String> {
    let time = humantime::parse_duration(text).map_err(|error| error.to_string())?;
    let is_allowed = (Duration::from_millis(100)..=Duration::from_secs(60)).contains(&time);
    if is_allowed { Ok(time) } else { Err("allowed: 100ms to 60s".to_owned()) }
}

fn place(text: &str) -> Result<Place, String> {
    let (site, machine) = text.split_once('/').ok_or_else(|| format!("found \"{text}\"; allowed: SITE/MACHINE"))?;
    let name = |text: &str| text.parse::<Name>().map_err(|error| error.to_string());
    Ok(Place { site: name(site)?, machine: name(machine)? })
}

#[cfg(feature = "commands")]
fn target(text: &str) -> Result<(String, f64), String> {
    let wrong = || format!("found \"{text}\"; allowed: AXIS=METRES, as in boom=0.6");
    let (axis, metres) = text.split_once('=').ok_or_else(wrong)?;
    let metres = metres.trim().parse::<f64>().ok().filter(|metres| metres.is_finite()).ok_or_else(wrong)?;
    if axis.is_empty() { Err(wrong()) } else { Ok((axis.to_owned(), metres)) }
}
