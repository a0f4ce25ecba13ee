//! The arguments of `hydraxis tip`.

use std::path::PathBuf;

use clap::Args;

use crate::arguments::{BareMachine, values::payload};

/// `tip`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis tip                                           the task of the built-in machine, piece by piece
  hydraxis tip my.toml --model model.toml --plot tip.svg with a picture of the machine on its way
  hydraxis tip my.toml --payload 1500                    with 1500 kg in the bucket, as --payload 1.5t
  hydraxis tip my.toml --set tip.boom=0.8                the boom stays at 0.8 m; --set tip.telescope=0.6: the telescope
  hydraxis tip my.toml --trajectory tip.csv              the cylinders and the teeth, period by period
  hydraxis tip my.toml --json - | jq '.pieces[].reversals'

Nothing moves, and no axis needs to follow the task. Place and pitch of the teeth leave one axis of the four free: the
plan chooses the boom's motion, and the last line says what was chosen. Keys tip.boom and tip.telescope fix it for the
whole task, boom and telescope in a [[tip.piece]] at the end of that piece.
Exit codes: 0 planned, 2 the machine cannot do the task; standard error says where and why.")]
pub struct TipArguments {
    /// The machine
    #[command(flatten)]
    pub machine: BareMachine,
    /// Mass in the bucket, in kg or with its unit, such as 1.5t [default: mechanism.payload.mass of the machine file]
    #[arg(long, value_name = "KG", value_parser = payload, allow_hyphen_values = true)]
    pub payload: Option<f64>,
    /// Write the figures as JSON to a file, or to standard output with - in the place of the tables
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Draw the machine on the way, and its cylinders over time, into an SVG file, or to standard output with -
    #[arg(long, value_name = "FILE.svg")]
    pub plot: Option<PathBuf>,
    /// Write teeth and cylinders at every period as CSV to a file, or to standard output with -
    #[arg(long, value_name = "FILE.csv")]
    pub trajectory: Option<PathBuf>,
}
