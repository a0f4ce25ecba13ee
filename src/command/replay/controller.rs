//! The controller, with the references and requests that its recorded commands name.
//!
//! References, requests and stops come at any time. Which of them a command was made with is in the command itself
//! ([`CommandInputs`]); so they come to the replayed controller before the same sample.

use control_proc::{Controller, process::at_rest};
use pipeline::{
    MAX_AXES,
    channel::Stop,
    machine::Machine,
    message::{
        CoefficientSnapshot, CommandInputs, EncoderSample, Header, Message, Reference, Request, ValveCommand,
        command_event, control_flag,
    },
};

use super::feed::Feed;
use crate::failure::Failure;

/// The controller of a replay.
pub struct ReplayedController {
    core: Controller,
    reference: Option<Reference>,
    inputs: CommandInputs,
    /// [`command_event`] bits that can be replayed.
    known: u32,
}

impl ReplayedController {
    /// Of a machine. `lock_step`: events that only real time has are none.
    ///
    /// # Errors
    /// A trajectory cannot be read.
    pub fn new(machine: &Machine, lock_step: bool) -> Result<Self, Failure> {
        let axes = (1 << machine.axes.len().min(MAX_AXES)) - 1;
        let any = axes | command_event::EMERGENCY_STOP | command_event::ARMED;
        let real_time = command_event::SILENT | command_event::LOST | command_event::CLOCK | command_event::DEADLINE;
        let mut core = Controller::new(machine).map_err(Failure::usage)?;
        core.allow_gains(at_rest(machine).axes.map(|axis| axis.gain_range));
        Ok(Self {
            core,
            reference: None,
            inputs: CommandInputs::default(),
            known: if lock_step { any } else { any | real_time },
        })
    }

    /// Whether a command was made without a new sample.
    pub fn is_extra(command: &ValveCommand) -> bool {
        command.inputs.events & (command_event::REPEATED | command_event::NEUTRAL) != 0
    }

    /// Arms all axes, for a recording that begins with armed ones.
    pub fn arm(&mut self) {
        self.core.arm();
    }

    /// The command for a sample, with the inputs that `recorded` names. The times, the number and the session of its
    /// header stay zero.
    pub fn update(
        &mut self,
        sample: &EncoderSample,
        snapshot: Option<&CoefficientSnapshot>,
        recorded: &ValveCommand,
        feed: &mut Feed,
    ) -> ValveCommand {
        let events = self.happen(recorded);
        self.take_reference(&recorded.inputs, feed);
        self.take_requests(&recorded.inputs, feed);
        self.inputs.snapshot = snapshot.map_or(0, |snapshot| snapshot.header.number + 1);
        let mut command = self.core.update(sample, snapshot, self.reference.as_ref());
        if events & command_event::DEADLINE != 0 {
            self.core.lose(control_flag::DEADLINE);
            command = self.core.neutral(sample.header.sequence);
        }
        command.header.acquired_ns = sample.header.acquired_ns;
        command.inputs = CommandInputs { events, ..self.inputs };
        command
    }

    /// The command for a sample, without any inputs but the newest ones: of a recording that does not name them.
    pub fn update_with_newest(
        &mut self,
        sample: &EncoderSample,
        snapshot: Option<&CoefficientSnapshot>,
    ) -> ValveCommand {
        self.core.update(sample, snapshot, self.reference.as_ref())
    }

    /// The message that was sent between two samples; `last` is the header of the sample that it names.
    pub fn extra(&mut self, last: &Header, recorded: &ValveCommand) -> ValveCommand {
        let kind = recorded.inputs.events & (command_event::REPEATED | command_event::NEUTRAL);
        let events = self.happen(recorded) | kind;
        let mut command = if kind == command_event::REPEATED {
            let mut command = self.core.message();
            command.header.sequence = last.sequence;
            command
        } else {
            self.core.neutral(last.sequence)
        };
        command.header.acquired_ns = last.acquired_ns;
        command.inputs = CommandInputs { events, ..self.inputs };
        command
    }

    /// What was commanded takes the place of what this controller would have commanded.
    pub fn apply(&mut self, recorded: &ValveCommand) {
        self.core.apply(recorded);
    }

    /// Does what happened before a command. Its events that could be replayed.
    fn happen(&mut self, recorded: &ValveCommand) -> u32 {
        let events = recorded.inputs.events & self.known;
        let has = |event| events & event != 0;
        if has(command_event::ARMED) {
            self.core.arm();
            // The controller begins armed once.
            self.known &= !command_event::ARMED;
        }
        let stop = Stop { axes: events & command_event::STOPPED, emergency: has(command_event::EMERGENCY_STOP) };
        if stop.is_any() {
            self.core.stop(stop);
        }
        if has(command_event::CLOCK) {
            self.core.latch(control_flag::CLOCK);
        }
        if has(command_event::SILENT) {
            self.core.fall_silent();
        }
        if has(command_event::LOST) {
            self.core.feedback_lost();
        }
        events
    }

    /// Takes in references up to the one that was used, if it comes.
    fn take_reference(&mut self, inputs: &CommandInputs, feed: &mut Feed) {
        let is_it =
            |header: &Header| (header.session, header.number) == (inputs.reference_session, inputs.reference_number);
        let has_it = self.reference.as_ref().is_some_and(|reference| is_it(&reference.header));
        let waiting = feed.references.waiting();
        if has_it || inputs.reference_session == 0 || !waiting.iter().any(|typed| is_it(&typed.message.header)) {
            return;
        }
        while let Some(reference) = feed.references.pop() {
            let found = is_it(&reference.message.header);
            (self.inputs.reference_session, self.inputs.reference_number) =
                (reference.message.header.session, reference.message.header.number);
            self.reference = Some(reference.message);
            if found {
                break;
            }
        }
    }

    /// Takes in as many requests as were read, the last one last: two programs may have sent at the same time. None
    /// where the last one is not among them.
    fn take_requests(&mut self, inputs: &CommandInputs, feed: &mut Feed) {
        let count = usize::try_from(inputs.requests.saturating_sub(self.inputs.requests)).unwrap_or(usize::MAX);
        let last = (inputs.request_session, inputs.request_number);
        let is_last = |header: &Header| (header.session, header.number) == last;
        let waiting = feed.requests.waiting();
        let place = waiting.iter().take(count).rposition(|request| is_last(request.message.header()));
        let Some(place) = place.filter(|_| count <= waiting.len()) else { return };
        let mut taken: Vec<Request> =
            (0..count).filter_map(|_| feed.requests.pop()).map(|typed| typed.message).collect();
        let last = taken.remove(place);
        taken.push(last);
        for request in taken {
            self.inputs.requests += 1;
            (self.inputs.request_session, self.inputs.request_number) = (request.header.session, request.header.number);
            self.core.ask(&request);
        }
    }
}
