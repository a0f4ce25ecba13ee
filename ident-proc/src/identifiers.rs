//! Identification of all axes of a machine: the messages of a tick in, a snapshot out.

use pipeline::{
    machine::{Axis, Machine},
    message::{CoefficientSnapshot, EncoderSample, ValveCommand},
};

use crate::Identifier;

/// Identifies all axes of a machine, tick by tick: the core of the stage.
#[derive(Debug, Clone)]
pub struct Identifiers {
    axes: Vec<Identifier>,
    /// The tick of the last sample.
    last: Option<u64>,
}

impl Identifiers {
    /// Allocates all memory that it will ever use.
    pub fn new(machine: &Machine) -> Self {
        let axes = machine.axes.iter();
        let identifier = |axis: &Axis| {
            Identifier::commissioned(&axis.identification, axis.commissioned.as_ref()).waiting_for_motion()
        };
        Self { axes: axes.map(identifier).collect(), last: None }
    }

    /// Takes in the sample of a tick and the command of the tick before, if that is known, and writes the snapshot. The
    /// caller writes the times of the header.
    ///
    /// A sample or command of any other tick than the next is a gap. A sample or command with another number of axes is
    /// not used.
    pub fn update(
        &mut self,
        sample: &EncoderSample,
        command: Option<&ValveCommand>,
        snapshot: &mut CoefficientSnapshot,
    ) {
        let count = self.axes.len() as u32;
        let tick = sample.header.sequence;
        let follows = self.last.is_some_and(|last| last.checked_add(1) == Some(tick));
        self.last = Some(tick);
        let command = command.filter(|command| {
            follows && command.header.sequence.checked_add(1) == Some(tick) && command.header.axis_count == count
        });
        let is_complete = sample.header.axis_count == count;
        for (i, axis) in self.axes.iter_mut().enumerate() {
            let position = sample.axes[i].usable().filter(|_| is_complete);
            axis.update(position, command.map(|command| command.axes[i].command));
            snapshot.axes[i] = axis.snapshot();
        }
        snapshot.header.sequence = tick;
        snapshot.header.axis_count = count;
    }
}
