//! All axes of the machine, one call per sample.
//!
//! ```text
//! u(k) = controller(y(k), model learned from samples before k, y_r(k), y_r(k+1), ..)
//! ```
//!
//! y positions in m, u valve commands in [-1, 1], y_r targets in m, k tick. u(k) is made from sample k and stays on
//! the valve until sample k+1. Trap: a sample that is not newer than the last says nothing new, and a source that
//! repeats itself is as blind as one that is silent: the last command stays twice, not longer.
//!
//! An emergency stop comes before everything: all axes are neutral and latched with the sample that says it, and the
//! message asks for the pilot to be cut off until it is released and every axis has been reset.

use pipeline::{
    MAX_AXES,
    machine::Machine,
    message::{
        AxisCommand, CoefficientSnapshot, ControlMode, EncoderSample, Header, Reference, Request, ValveCommand,
        control_flag,
    },
};

use crate::{
    axis::{AxisController, AxisInput, UNUSABLE_LIMIT},
    target::generator::ReferenceGenerator,
    trajectory_file::{ReferenceError, read_references},
};

/// The controller of a machine. Disarmed until [`Controller::arm`].
#[derive(Debug, Clone)]
pub struct Controller {
    generator: ReferenceGenerator,
    axes: Vec<AxisController>,
    request: Option<Request>,
    last_sequence: Option<u64>,
    /// Samples in a row that were not newer than the last.
    repeated: u64,
}

impl Controller {
    /// Builds all axes and reads their trajectories; nothing is allocated after this.
    ///
    /// # Errors
    /// A trajectory's file is refused.
    pub fn new(machine: &Machine) -> Result<Self, ReferenceError> {
        let axes = machine.axes.iter().take(MAX_AXES).enumerate();
        Ok(Self {
            generator: read_references(machine)?,
            axes: axes.map(|(i, axis)| AxisController::new(i, axis, &machine.timing)).collect(),
            request: None,
            last_sequence: None,
            repeated: 0,
        })
    }

    /// Lets the axes settle and then follow. Without effect on axes that are armed already or latched.
    pub fn arm(&mut self) {
        self.axes.iter_mut().for_each(AxisController::arm);
    }

    /// Neutral from now on. Releases latches, so that the next [`Self::arm`] starts afresh; also from a source whose
    /// sequence numbers have started again.
    pub fn disarm(&mut self) {
        self.axes.iter_mut().for_each(AxisController::disarm);
        (self.last_sequence, self.repeated) = (None, 0);
    }

    /// What the axes are to do from the next sample on, the newest request there is; the same again does nothing.
    pub fn ask(&mut self, request: &Request) {
        self.request = Some(*request);
    }

    /// The samples have stopped: latches every axis at neutral until disarmed and armed again.
    pub fn feedback_lost(&mut self) {
        self.latch(control_flag::FEEDBACK);
    }

    /// Latches every axis at neutral for this cause, a [`control_flag`] bit, until disarmed and armed again.
    pub fn latch(&mut self, cause: u32) {
        self.axes.iter_mut().for_each(|axis| axis.latch(cause));
    }

    /// The command for one sample, to be sent as it is but for its times.
    ///
    /// `snapshot` and `reference` are the newest ones there are, the same ones again if nothing new has come. A
    /// sample that is not newer than the last repeats the last command; the third one in a row latches every axis.
    pub fn update(
        &mut self,
        sample: &EncoderSample,
        snapshot: Option<&CoefficientSnapshot>,
        reference: Option<&Reference>,
    ) -> ValveCommand {
        let sequence = sample.header.sequence;
        let emergency_stop = sample.emergency_stop != 0;
        let elapsed = match self.last_sequence {
            None => 1,
            Some(last) if sequence > last => sequence - last,
            Some(last) => {
                self.repeated += 1;
                // It may be old, but a stop is a stop.
                if emergency_stop {
                    self.axes.iter_mut().for_each(|axis| axis.take_emergency_stop(true));
                }
                if self.repeated >= UNUSABLE_LIMIT {
                    self.feedback_lost();
                }
                return self.message(last, AxisController::last);
            }
        };
        (self.last_sequence, self.repeated) = (Some(sequence), 0);

        let mut command = self.empty(sequence);
        for (i, (axis, entry)) in self.axes.iter_mut().zip(&mut command.axes).enumerate() {
            let within = |header: &Header| i < header.axis_count as usize;
            *entry = axis.update(&AxisInput {
                sequence,
                elapsed,
                sample: within(&sample.header).then_some(&sample.axes[i]),
                snapshot: (snapshot.filter(|snapshot| within(&snapshot.header)))
                    .map(|snapshot| (snapshot.header.sequence, &snapshot.axes[i])),
                reference,
                emergency_stop,
                request: self.request.as_ref(),
                generator: &self.generator,
            });
        }
        command.cut_off = self.cut_off();
        command
    }

    /// Neutral for all axes, at once and without solving anything. It does not change the controller: whoever sends
    /// it because the samples have stopped calls [`Self::feedback_lost`] first.
    pub fn neutral(&self, sequence: u64) -> ValveCommand {
        self.message(sequence, |axis| AxisCommand {
            command: 0.0,
            error: 0.0,
            mode: ControlMode::Neutral as u32,
            ..axis.last()
        })
    }

    /// Whether a fault has latched any axis.
    pub fn is_latched(&self) -> bool {
        self.axes.iter().any(|axis| axis.cause() != 0)
    }

    /// 1 while an axis is latched by an emergency stop, which it is as long as that is pressed.
    fn cut_off(&self) -> u32 {
        u32::from(self.axes.iter().any(|axis| axis.cause() & control_flag::EMERGENCY_STOP != 0))
    }

    fn message(&self, sequence: u64, entry: impl Fn(&AxisController) -> AxisCommand) -> ValveCommand {
        let mut command = self.empty(sequence);
        for (axis, place) in self.axes.iter().zip(&mut command.axes) {
            *place = entry(axis);
        }
        command.cut_off = self.cut_off();
        command
    }

    fn empty(&self, sequence: u64) -> ValveCommand {
        let header = Header { sequence, axis_count: self.axes.len() as u32, ..Header::default() };
        ValveCommand { header, ..ValveCommand::default() }
    }
}
