//! Neutral: an axis that is off, settles, or has been latched by a fault.

use pipeline::message::{AxisMode, ControlMode, control_flag};

use super::{AxisController, State};

impl AxisController {
    /// Neutral from the next command on; releases the latch and forgets the past. Not while the emergency stop is pressed.
    pub fn disarm(&mut self) {
        if self.is_pressed {
            return;
        }
        self.stand_still(State::Disarmed);
        self.stopped = false;
        self.last.flags = control_flag::DISARMED;
        self.history = None;
        (self.blind, self.bridged) = (0, 0);
        // The ticks may begin anew; the newest snapshot is judged once more.
        self.seen = None;
        self.kept.reset();
    }

    /// Latches the axis at neutral for this cause, a [`control_flag`] bit. The first cause stays, and an emergency stop
    /// comes on top.
    pub fn latch(&mut self, cause: u32) {
        let cause = match self.state {
            State::Latched(first) => first | cause & control_flag::EMERGENCY_STOP,
            _ => cause,
        };
        self.stand_still(State::Latched(cause));
        self.last.flags = cause;
    }

    /// Why the axis is latched, [`control_flag`] bits; 0 while it is not.
    pub fn cause(&self) -> u32 {
        if let State::Latched(cause) = self.state { cause } else { 0 }
    }

    /// Takes in the emergency stop, which comes before everything else.
    pub fn take_emergency_stop(&mut self, is_pressed: bool) {
        self.is_pressed = is_pressed;
        if is_pressed {
            self.latch(control_flag::EMERGENCY_STOP);
        }
    }

    /// Makes the command of an axis that does not follow.
    pub(super) fn stand(&mut self, state: State, model_flags: u32) {
        self.stand_still(state);
        self.last.flags = model_flags
            | match state {
                State::Disarmed if self.stopped => control_flag::DISARMED | control_flag::REQUEST_STOPPED,
                State::Disarmed => control_flag::DISARMED,
                State::Settling(_) => control_flag::SETTLING,
                State::Latched(cause) => cause,
                State::Following => 0,
            };
    }

    /// Neutral, with the target where the axis is.
    fn stand_still(&mut self, state: State) {
        self.state = state;
        self.trusted = 0;
        if !matches!(state, State::Settling(_)) {
            self.last.operation = AxisMode::Off as u32;
        }
        self.send(0.0, ControlMode::Neutral);
        if let Some(history) = &self.history {
            self.last.reference = history.outputs()[0];
        }
        self.last.error = 0.0;
    }
}
