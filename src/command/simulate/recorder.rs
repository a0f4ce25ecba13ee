//! Records of a simulated motion: a trajectory as CSV, written row by row, and a picture.

use std::{
    io::{self, Write},
    path::{Path, PathBuf},
};

use pipeline::{machine::Machine, message::ValveCommand, nearest::did_you_mean};
use plant_sim::PlantSim;

use super::{arguments::RecordingArguments, commands::Commands};
use crate::{
    failure::Failure,
    report::{
        motion::{AxisPoint, Format, Plot},
        output::{OutputError, create, written},
    },
};

/// Columns of every axis: its command, then the true state of the plant; SI units.
const STATE: [&str; 8] =
    ["command", "position", "velocity", "piston_pressure", "rod_pressure", "spool_position", "piston_flow", "rod_flow"];
/// Columns of every axis under control: reference, following error, and the `ControlMode` as a number.
const CONTROL: [&str; 3] = ["reference", "error", "mode"];

/// Trajectory and picture, as far as the user asked for them.
pub struct Recorder {
    is_controlled: bool,
    /// Indices of the axes in the trajectory.
    axes: Vec<usize>,
    trajectory: Option<TrajectoryFile>,
    plot: Option<Picture>,
    row: Vec<f64>,
}

/// The file of the picture.
struct Picture {
    path: PathBuf,
    file: Box<dyn Write>,
    format: Format,
    plot: Plot,
}

/// The CSV file of the trajectory.
struct TrajectoryFile {
    path: PathBuf,
    writer: csv::Writer<Box<dyn Write>>,
}

impl Recorder {
    /// A recorder for a closed loop of `duration` s; none when the user asked for no record.
    pub fn for_closed_loop(
        machine: &Machine,
        asked: &RecordingArguments,
        duration: f64,
    ) -> Result<Option<Self>, Failure> {
        if asked.trajectory.is_none() && asked.plot.is_none() {
            return Ok(None);
        }
        Self::open(machine, asked, asked.trajectory.as_deref(), true, |_| true, duration).map(Some)
    }

    /// A recorder for an open loop. Without an option the trajectory goes to standard output.
    pub fn for_open_loop(machine: &Machine, asked: &RecordingArguments, commands: &Commands) -> Result<Self, Failure> {
        let default = asked.plot.is_none().then_some(Path::new("-"));
        let trajectory = asked.trajectory.as_deref().or(default);
        Self::open(machine, asked, trajectory, false, |axis| commands.has(axis), commands.duration())
    }

    /// Opens the files. Without `--axis` only the axes that are `commanded` are drawn.
    fn open(
        machine: &Machine,
        asked: &RecordingArguments,
        trajectory: Option<&Path>,
        is_controlled: bool,
        commanded: impl Fn(usize) -> bool,
        duration: f64,
    ) -> Result<Self, Failure> {
        let names: Vec<&str> = machine.axes.iter().map(|axis| axis.name.as_str()).collect();
        if let Some(unknown) = asked.axes.iter().find(|axis| !names.contains(&axis.as_str())) {
            let allowed = format!("{}{}", names.join(", "), did_you_mean(unknown, names.iter().copied()));
            return Err(Failure::usage(format!("--axis: found \"{unknown}\"; allowed: one of {allowed}")));
        }
        let is_asked = |index: &usize| asked.axes.is_empty() || asked.axes.iter().any(|name| name == names[*index]);
        let axes: Vec<usize> = (0..names.len()).filter(is_asked).collect();
        let drawn = axes.iter().copied().filter(|index| !asked.axes.is_empty() || commanded(*index));
        let drawn = drawn.map(|index| (index, names[index].to_owned())).collect();
        let mut recorder = Self { is_controlled, axes, trajectory: None, plot: None, row: Vec::new() };
        if let Some(path) = asked.plot.as_deref() {
            let title = format!("{}, scenario {}", machine.name, machine.scenario.name);
            let plot = Plot::new(title, drawn, is_controlled, duration, machine.mechanism.as_ref());
            let format = Format::of("--plot", path)?;
            recorder.plot = Some(Picture { path: path.to_owned(), file: create("--plot", path)?, format, plot });
        }
        if let Some(path) = trajectory {
            let writer = csv::WriterBuilder::new().has_headers(false).from_writer(create("--trajectory", path)?);
            recorder.trajectory = Some(TrajectoryFile { path: path.to_owned(), writer });
            let header = recorder.header(&names);
            recorder.write(|writer| writer.write_record(&header))?;
        }
        Ok(recorder)
    }

    fn header(&self, names: &[&str]) -> Vec<String> {
        let control: &[&str] = if self.is_controlled { &CONTROL } else { &[] };
        let mut header = vec!["t".to_owned(), "supply_pressure".to_owned()];
        for axis in &self.axes {
            header.extend(STATE.iter().chain(control).map(|column| format!("{}.{column}", names[*axis])));
        }
        header
    }

    /// Records the state of `plant` at `t` s, and the command that is held from then on.
    pub fn row(&mut self, t: f64, plant: &PlantSim, command: &ValveCommand) -> Result<(), Failure> {
        self.draw(t, plant, command);
        let mut row = std::mem::take(&mut self.row);
        row.clear();
        row.extend([t, plant.supply_pressure()]);
        for axis in &self.axes {
            let (state, control) = (&plant.axes()[*axis], &command.axes[*axis]);
            row.extend([
                control.command,
                state.position,
                state.velocity,
                state.piston_pressure,
                state.rod_pressure,
                state.spool_position,
                state.piston_flow,
                state.rod_flow,
            ]);
            if self.is_controlled {
                row.extend([control.reference, control.error, f64::from(control.mode)]);
            }
        }
        let written = self.write(|writer| writer.serialize(&row));
        self.row = row;
        written
    }

    /// Records the state and the command for the picture only.
    pub fn draw(&mut self, t: f64, plant: &PlantSim, command: &ValveCommand) {
        let Some(Picture { plot, .. }) = &mut self.plot else { return };
        plot.row(t, |axis| {
            let (state, control) = (&plant.axes()[axis], &command.axes[axis]);
            AxisPoint {
                command: control.command,
                position: state.position,
                reference: control.reference,
                error: control.error,
                mode: control.mode,
            }
        });
    }

    /// Whether a reader of the records is left.
    pub fn is_wanted(&self) -> bool {
        self.trajectory.is_some() || self.plot.is_some()
    }

    /// Writes everything that is not written yet.
    pub fn finish(mut self) -> Result<(), Failure> {
        self.write(|writer| Ok(writer.flush()?))?;
        let Some(Picture { path, mut file, format, plot }) = self.plot else { return Ok(()) };
        let bytes = plot.file(format).map_err(|error| Failure::run(error).about("--plot"))?;
        let result = file.write_all(&bytes).and_then(|()| file.flush());
        Ok(written("--plot", &path, result)?)
    }

    /// Writes to the trajectory, if there is one. A reader that has closed its end, such as `head`, is no error.
    fn write(
        &mut self,
        write: impl FnOnce(&mut csv::Writer<Box<dyn Write>>) -> Result<(), csv::Error>,
    ) -> Result<(), Failure> {
        let Some(TrajectoryFile { path, writer }) = &mut self.trajectory else { return Ok(()) };
        let Err(error) = write(writer) else { return Ok(()) };
        let is_closed = matches!(error.kind(), csv::ErrorKind::Io(error) if error.kind() == io::ErrorKind::BrokenPipe);
        if !is_closed {
            let (path, source) = (path.clone(), io::Error::from(error));
            return Err(OutputError::Write { option: "--trajectory", path, source }.into());
        }
        self.trajectory = None;
        Ok(())
    }
}
