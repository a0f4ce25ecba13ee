//! Which columns of a recording are read, and how.

use std::time::Duration;

use clap::Args;
use sensor_proc::log::Wanted;

use super::values::{column_unit, seconds};

/// The columns of a recording.
#[derive(Debug, Args)]
pub struct ColumnArguments {
    /// Axis of a recording of `hydraxis record`, or of a table of `hydraxis export`: its columns AXIS.command and
    /// AXIS.position [default: the only axis of the recording]
    #[arg(long, value_name = "NAME", conflicts_with_all = ["input", "output"])]
    pub axis: Option<String>,
    /// Column of the input u, the valve command: its name, or its number from 1
    #[arg(long, default_value = "u")]
    pub input: String,
    /// Column of the output y, the position: its name, or its number from 1
    #[arg(long, default_value = "y")]
    pub output: String,
    /// Column of the time: its name, its number from 1, or none [default: a column `t`, `time` or `timestamp`]
    #[arg(long, value_name = "COLUMN")]
    pub time: Option<String>,
    /// Unit of a column, such as y=mm, t=ms or "Valve command=%"; may be given several times [default: from the header
    /// or the row below it; else s, and signals as they are]
    #[arg(long, value_name = "COLUMN=UNIT", value_parser = column_unit)]
    pub unit: Vec<(String, String)>,
    /// Sample period, in seconds or with a unit such as 10ms [default: from the column of the time, without its gaps]
    #[arg(long, value_parser = seconds, allow_hyphen_values = true)]
    pub period: Option<Duration>,
}

impl ColumnArguments {
    /// What is to be read.
    pub fn wanted(&self) -> Wanted {
        let column = |typed: &str, of_axis: &str| match &self.axis {
            Some(axis) => format!("{axis}.{of_axis}"),
            None => typed.to_owned(),
        };
        Wanted {
            input: column(&self.input, "command"),
            output: column(&self.output, "position"),
            time: self.time.clone(),
            units: self.unit.clone(),
            period: self.period.map(|period| period.as_secs_f64()),
        }
    }
}
