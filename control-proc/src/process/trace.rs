//! What the commands are made of, noted for a recording: with it and the messages, every command can be made again.
//!
//! Runs in the loop: copies of a few numbers.

use pipeline::{
    MAX_AXES,
    channel::Stop,
    machine::Machine,
    message::{CoefficientSnapshot, CommandInputs, Header, Reference, command_event},
};

/// What has come and happened since the last command.
#[derive(Debug)]
pub struct Trace {
    inputs: CommandInputs,
    /// Bits of the axes of the machine.
    axes: u32,
}

impl Trace {
    /// Of a machine, before its first command.
    pub fn new(machine: &Machine) -> Self {
        Self { inputs: CommandInputs::default(), axes: (1 << machine.axes.len().min(MAX_AXES)) - 1 }
    }

    /// Notes a [`command_event`] bit.
    pub fn note(&mut self, event: u32) {
        self.inputs.events |= event;
    }

    /// Notes a stop.
    pub fn stop(&mut self, stop: Stop) {
        self.note(stop.axes & self.axes);
        if stop.emergency {
            self.note(command_event::EMERGENCY_STOP);
        }
    }

    /// Notes a request that was read.
    pub fn request(&mut self, request: &Header) {
        self.inputs.requests += 1;
        (self.inputs.request_session, self.inputs.request_number) = (request.session, request.number);
    }

    /// Notes the snapshot and the reference that the next command is made with.
    pub fn messages(&mut self, snapshot: Option<&CoefficientSnapshot>, reference: Option<&Reference>) {
        self.inputs.snapshot = snapshot.map_or(0, |snapshot| snapshot.header.number + 1);
        let (session, number) = reference.map_or((0, 0), |newest| (newest.header.session, newest.header.number));
        (self.inputs.reference_session, self.inputs.reference_number) = (session, number);
    }

    /// What the next command carries.
    pub fn take(&mut self) -> CommandInputs {
        let inputs = self.inputs;
        self.inputs.events = 0;
        inputs
    }
}
