//! What control-proc tells at its heartbeats, made of its last messages.

use control_proc::process::at_rest;
use pipeline::{
    machine::Machine,
    message::{CoefficientSnapshot, EncoderSample, MachineState, ValveCommand},
};

/// The states that may be told between two ticks.
pub struct States {
    /// As at the last heartbeat: a field that is not renewed stays.
    now: MachineState,
    sample: Option<EncoderSample>,
    snapshot: Option<CoefficientSnapshot>,
    /// The last command, and those that repeat it.
    commands: Vec<ValveCommand>,
}

impl States {
    /// Before the first sample.
    pub fn new(machine: &Machine) -> Self {
        Self { now: at_rest(machine), sample: None, snapshot: None, commands: Vec::new() }
    }

    /// A command was made of a sample and with a snapshot.
    pub fn renew(&mut self, sample: &EncoderSample, snapshot: Option<&CoefficientSnapshot>, command: &ValveCommand) {
        (self.sample, self.snapshot) = (Some(*sample), snapshot.copied());
        self.commands.clear();
        self.commands.push(*command);
    }

    /// A command was sent without a sample.
    pub fn repeat(&mut self, command: &ValveCommand) {
        self.commands.push(*command);
    }

    /// The states that could be told now: one for each command. Ages are times of a clock, and those of `recorded`.
    pub fn candidates(&mut self, recorded: &MachineState) -> Vec<MachineState> {
        let commands = if self.commands.is_empty() { vec![ValveCommand::default()] } else { self.commands.clone() };
        commands.iter().rev().map(|command| self.state(command, recorded)).collect()
    }

    fn state(&self, command: &ValveCommand, recorded: &MachineState) -> MachineState {
        let mut state = self.now;
        state.header = command.header;
        state.teeth = command.teeth;
        for (i, axis) in state.axes.iter_mut().enumerate() {
            axis.command = command.axes[i];
            if let Some(sample) = &self.sample {
                axis.sample = sample.axes[i];
            }
            if let Some(snapshot) = &self.snapshot {
                let model = &snapshot.axes[i];
                (axis.has_model, axis.model_faults) = (1, model.faults);
                axis.model_age_ns = recorded.axes[i].model_age_ns;
                axis.forgetting_factor = model.forgetting_factor;
                axis.h_step_sigma = model.adaptive_errors.h_step.sigma();
            }
        }
        state
    }
}
