//! The arguments of `hydraxis mechanism`.

use std::path::PathBuf;

use clap::Args;

use crate::arguments::BareMachine;

/// `mechanism`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis mechanism                                      reach, joints, masses and loads of the built-in machine
  hydraxis mechanism my.toml --set mechanism.payload.mass=1500
                                                          with 1.5 t in the bucket
  hydraxis mechanism my.toml --urdf excavator.urdf        for viewers and dynamics libraries
  hydraxis mechanism my.toml --states states.json --json -
                                                          mass matrix, gravity and accelerations at states of yours

The machine file has the tables [mechanism]; those of examples/mechanism.toml fit a machine with four such cylinders.

A file of states has {\"states\": [{\"cylinder_length\": [2.3, 2.8, 0.2, 2.3], \"cylinder_velocity\": [0, 0, 0, 0],
\"cylinder_force\": [2e5, 0, 0, 0], \"payload\": 0, \"tip_force\": [0, 0]}, ..]}, all in SI units, in the order boom,
arm, telescope, bucket; and may have \"parameters\" with pins and masses in the place of the machine's.")]
pub struct MechanismArguments {
    /// The machine
    #[command(flatten)]
    pub machine: BareMachine,
    /// Evaluate the states of a JSON file instead, or those of standard input with -
    #[arg(long, value_name = "FILE.json", conflicts_with = "urdf")]
    pub states: Option<PathBuf>,
    /// Write the figures as JSON to a file, or to standard output with - in the place of the tables
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Write the machine as URDF to a file, or to standard output with - in the place of the tables
    #[arg(long, value_name = "FILE.urdf")]
    pub urdf: Option<PathBuf>,
}
