//! A recording in place of encoders and controller: row by row it gives the sample and the command of a tick.

use pipeline::{
    machine::Machine,
    message::{AxisCommand, ControlMode, EncoderSample, ValveCommand},
};

use crate::{
    plausibility::{Plausibility, pressure::PressureCheck},
    recording::Recording,
};

/// The recordings of all axes and the checks of their positions.
#[derive(Debug, Clone)]
pub struct Replay {
    checks: Vec<Plausibility>,
    recordings: Vec<Recording>,
}

impl Replay {
    /// Replays `recordings`, one for each axis of the machine ([`Recording::read_all`]).
    pub fn new(machine: &Machine, recordings: Vec<Recording>) -> Self {
        let period = machine.timing.period;
        Self { checks: machine.axes.iter().map(|axis| Plausibility::new(axis, period)).collect(), recordings }
    }

    /// Number of rows.
    pub fn len(&self) -> u64 {
        self.recordings.first().map_or(0, |recording| recording.outputs.len() as u64)
    }

    /// Whether there are no rows. A recording that was read has at least two.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Sample and command of row `sequence`, or `None` after the last row.
    pub fn update(&mut self, sequence: u64) -> Option<(EncoderSample, ValveCommand)> {
        let row = usize::try_from(sequence).ok().filter(|_| sequence < self.len())?;
        let (mut sample, mut command) = (EncoderSample::default(), ValveCommand::default());
        for header in [&mut sample.header, &mut command.header] {
            header.sequence = sequence;
            header.axis_count = self.recordings.len() as u32;
        }
        for (i, (check, recording)) in self.checks.iter_mut().zip(&self.recordings).enumerate() {
            sample.axes[i] = check.judge(1, Some(recording.outputs[row]), false);
            // A recording has no pressures.
            PressureCheck::new(None).judge(None, &mut sample.axes[i]);
            command.axes[i] = AxisCommand {
                command: recording.inputs[row],
                mode: ControlMode::Replay as u32,
                ..AxisCommand::default()
            };
        }
        Some((sample, command))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_replays_row_by_row() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("r.csv");
        std::fs::write(&file, "t,u,y\n0,0.25,0.5\n0.01,-0.5,0.501\n0.02,0,0.502\n").unwrap();
        let machine = Machine::four_axes(&[]).unwrap();
        let mut replay = Replay::new(&machine, Recording::read_all(&machine, &file).unwrap());
        assert_eq!(replay.len(), 3);
        let (sample, command) = replay.update(1).unwrap();
        assert_eq!((sample.axes[2].position, command.axes[2].command), (0.501, -0.5));
        assert_eq!(command.axes[2].mode, ControlMode::Replay as u32);
        assert!(replay.update(3).is_none());

        std::fs::write(&file, "t,u,y\n0,0.25,0.5\n0.02,-0.5,0.501\n").unwrap();
        let error = Recording::read_all(&machine, &file).unwrap_err().to_string();
        assert!(error.contains("found a period of 0.020000 s"), "{error}");
    }
}
