//! `hydraxis plot`: a picture of a trajectory that `hydraxis simulate --trajectory` or `hydraxis export` has written.

use std::{io::Write, path::PathBuf};

use clap::Args;
use pipeline::{columns::Table, message::ControlMode, nearest::did_you_mean};

use crate::{
    failure::Failure,
    report::{
        motion::{AxisPoint, Format, Plot},
        output::{create, written},
    },
};

/// Name of the column with the time, s.
const TIME: &str = "t";
/// Columns that every axis has.
const NEEDED: [&str; 2] = ["command", "position"];
/// Columns that every axis of a closed loop has as well.
const CONTROL: [&str; 3] = ["reference", "error", "mode"];

/// End of the name of a column with who commands.
const MODE: &str = ".mode";

/// `plot`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis simulate --trajectory motion.csv
  hydraxis plot motion.csv --output motion.svg
  hydraxis plot motion.csv --axis arm --output arm.png

Columns are found by their names: t, and for each axis AXIS.command and AXIS.position. Where every axis has
AXIS.reference, AXIS.error and AXIS.mode as well, errors and who commands are drawn. An empty field, as a late tick
leaves it in an exported recording, is a gap.")]
pub struct PlotArguments {
    /// The trajectory
    #[arg(value_name = "FILE.csv")]
    pub trajectory: PathBuf,
    /// The picture, a file that ends with .svg or .png, or - for SVG on standard output
    #[arg(long, value_name = "FILE")]
    pub output: PathBuf,
    /// Only this axis; may be given several times [default: all axes]
    #[arg(long = "axis", value_name = "NAME")]
    pub axes: Vec<String>,
}

/// Runs the command.
pub fn run(arguments: &PlotArguments) -> Result<(), Failure> {
    let format = Format::of("--output", &arguments.output)?;
    let plot = read(arguments)?;
    let mut file = create("--output", &arguments.output)?;
    let bytes = plot.file(format).map_err(|error| Failure::run(error).about("--output"))?;
    let result = file.write_all(&bytes).and_then(|()| file.flush());
    Ok(written("--output", &arguments.output, result)?)
}

/// Gives the rows without a mode the one of the row before.
fn hold(modes: &mut [f64]) {
    let mut last = f64::from(ControlMode::Neutral as u32);
    for mode in modes {
        last = if mode.is_nan() { last } else { *mode };
        *mode = last;
    }
}

/// The picture of all rows of the file.
fn read(arguments: &PlotArguments) -> Result<Plot, Failure> {
    let table = Table::read(&arguments.trajectory).map_err(Failure::usage)?;
    let place = arguments.trajectory.display();
    let all: Vec<&str> = table.names().filter_map(|name| name.strip_suffix(".position")).collect();
    if all.is_empty() {
        return Err(Failure::usage(format!(
            "{place}: found no column AXIS.position; allowed: a file that `hydraxis simulate --trajectory` has written"
        )));
    }
    if let Some(unknown) = arguments.axes.iter().find(|axis| !all.contains(&axis.as_str())) {
        let allowed = format!("{}{}", all.join(", "), did_you_mean(unknown, all.iter().copied()));
        return Err(Failure::usage(format!("--axis: found \"{unknown}\"; allowed: one of {allowed}")));
    }
    let is_asked =
        |(_, name): &(usize, &str)| arguments.axes.is_empty() || arguments.axes.iter().any(|axis| axis == name);
    // The index gives the colour, which is then the same with and without the other axes.
    let axes: Vec<(usize, &str)> = all.iter().copied().enumerate().filter(is_asked).collect();
    let is_controlled =
        axes.iter().all(|(_, axis)| CONTROL.iter().all(|column| table.has(&format!("{axis}.{column}"))));
    let columns: Vec<&str> = NEEDED.iter().chain(CONTROL.iter().filter(|_| is_controlled)).copied().collect();
    let names: Vec<String> = [TIME.to_owned()]
        .into_iter()
        .chain(axes.iter().flat_map(|(_, axis)| columns.iter().map(move |column| format!("{axis}.{column}"))))
        .collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let mut values = table.numbers_with_gaps(&names, TIME).map_err(Failure::usage)?.values;
    let modes = names.iter().zip(&mut values).filter(|(name, _)| name.ends_with(MODE));
    modes.for_each(|(_, modes)| hold(modes));
    let [Some(begin), Some(end)] = [values[0].first(), values[0].last()] else {
        return Err(Failure::usage(format!("{place}: found no row; allowed: one row or more")));
    };
    let drawn = axes.iter().map(|(index, name)| (*index, (*name).to_owned())).collect();
    let title = arguments.trajectory.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let mut plot = Plot::new(title, drawn, is_controlled, end - begin, None);
    for (row, t) in values[0].iter().enumerate() {
        plot.row(*t, |index| {
            let axis = axes.iter().position(|(drawn, _)| *drawn == index).unwrap_or(0);
            let value = |column: usize| values.get(1 + axis * columns.len() + column).map_or(f64::NAN, |all| all[row]);
            let [reference, error, mode] = if is_controlled {
                [2, 3, 4].map(value)
            } else {
                [f64::NAN, f64::NAN, f64::from(ControlMode::Neutral as u32)]
            };
            AxisPoint { command: value(0), position: value(1), reference, error, mode: mode as u32 }
        });
    }
    Ok(plot)
}
