//! The arguments of `hydraxis init`.

use std::path::PathBuf;

use clap::Args;

/// `init`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis init                         asks for what it needs, on a terminal
  hydraxis init --axes cylinder --stroke 0.5 --bore 50mm --rod 30mm --valve-hz 8 --dead-time 40ms --output rig.toml
  hydraxis init --axes boom,arm --stroke boom=0.5,arm=0.4 --bore 80mm --rod 45mm --valve-hz 5 --dead-time 100ms

A value is a number in SI units or has its unit: 50mm, 2in, 210bar, 21MPa, 40ms, 8Hz, 1.5t, 300mm/s, 10%. It is for all
axes, or there is one for each: boom=0.5,arm=0.4.

The file describes a twin of the rig: it can be simulated and commissioned at once. What is not asked for follows from
the answers, and the file says how. Exit codes: 0 written, 2 bad usage, or a file that is there already.")]
pub struct InitArguments {
    /// Names of the axes, with commas between them
    #[arg(long, value_name = "NAME,..")]
    pub axes: Option<String>,
    /// Travel of the piston
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    pub stroke: Option<String>,
    /// Bore of the cylinder
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    pub bore: Option<String>,
    /// Diameter of the rod
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    pub rod: Option<String>,
    /// Bandwidth of the valve, at which its spool lags by 45 degrees
    #[arg(long, value_name = "FREQUENCY", allow_hyphen_values = true)]
    pub valve_hz: Option<String>,
    /// Time from a command to the first reaction of the valve
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    pub dead_time: Option<String>,
    /// Largest speed of the axis [default: the stroke in 3 s]
    #[arg(long, value_name = "SPEED", allow_hyphen_values = true)]
    pub speed: Option<String>,
    /// Moved mass [default: one whose weight is a fifth of the cylinder's force]
    #[arg(long, value_name = "MASS", allow_hyphen_values = true)]
    pub mass: Option<String>,
    /// Force of the load against extension, 0 for a level cylinder [default: 0]
    #[arg(long, value_name = "FORCE", allow_hyphen_values = true)]
    pub load: Option<String>,
    /// Part of the command up to which the valve stays shut [default: 10%]
    #[arg(long, value_name = "PART", allow_hyphen_values = true)]
    pub dead_band: Option<String>,
    /// Length of one count of the position sensor [default: about a 10000th of the stroke]
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    pub resolution: Option<String>,
    /// Pressure of the pump, one for all axes [default: 210bar]
    #[arg(long, value_name = "PRESSURE", allow_hyphen_values = true)]
    pub pressure: Option<String>,
    /// Sample and control period, one for all axes [default: 10ms, or less for fast valves]
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    pub period: Option<String>,
    /// Where encoder readings come from and valve commands go to: the simulated twin, CANopen devices, or a program of
    /// yours
    #[arg(long, value_name = "KIND", value_parser = ["sim", "can", "external"], default_value = "sim")]
    pub source: String,
    /// Name of the machine in reports [default: the names of the axes]
    #[arg(long)]
    pub name: Option<String>,
    /// Machine file to write
    #[arg(long, value_name = "FILE", default_value = "machine.toml")]
    pub output: PathBuf,
    /// Overwrite the file if it exists
    #[arg(long)]
    pub force: bool,
}
