//! From mode to mode of one axis, and its commands by hand.

use pipeline::message::{AxisMode, ControlMode, control_flag};

use super::{AxisController, AxisInput, State, requests::Asked};

/// Ticks over which the speed of an axis is taken.
const SPEED_TICKS: usize = 4;

impl AxisController {
    /// Takes in what is asked of the axis.
    pub(super) fn take_request(&mut self, input: &AxisInput<'_>) {
        if let Some(asked) = input.request.and_then(|request| self.requests.update(request, input.sequence)) {
            if asked.mode == Some(AxisMode::Off) && self.is_pressed {
                self.requests.refuse();
            } else {
                self.change(&asked);
            }
        }
        let runs = matches!(self.state, State::Settling(_) | State::Following);
        if runs && self.mode.is_by_hand() && self.requests.command(input.sequence, self.mode).is_none() {
            self.disarm();
            self.stopped = true;
        }
    }

    /// Changes to the mode that is asked for.
    fn change(&mut self, asked: &Asked) {
        let Some(mode) = asked.mode else { return };
        match self.state {
            State::Disarmed if mode != AxisMode::Off && asked.enabled => self.enable(mode, asked.target),
            State::Disarmed => {}
            _ if mode == AxisMode::Off => self.disarm(),
            State::Settling(_) => (self.mode, self.goal) = (mode, asked.target),
            State::Following => {
                let before = std::mem::replace(&mut self.mode, mode);
                if before.is_by_hand() && !mode.is_by_hand() {
                    self.take_over();
                }
                match mode {
                    AxisMode::Hold if before != mode => self.target.hold(None),
                    AxisMode::Track => self.target.follow(),
                    _ => {}
                }
                if let Some(goal) = asked.target.filter(|_| mode == AxisMode::Hold) {
                    self.target.aim(goal);
                }
            }
            State::Latched(_) => {}
        }
        if matches!(self.state, State::Settling(_) | State::Following) {
            self.last.operation = self.mode as u32;
        }
    }

    /// A controller takes over from a command by hand, on a motion that nobody has given a target so far.
    fn take_over(&mut self) {
        self.trusted = 0;
        self.rest.reset();
        self.trust.reset();
        self.following.reset();
        self.predictive.reset();
        if let Some(position) = self.history.as_ref().map(|history| history.outputs()[0]) {
            self.target.hold(Some((position, self.speed())));
        }
    }

    /// Speed of the axis, m/s.
    pub(super) fn speed(&self) -> f64 {
        self.history.as_ref().map_or(0.0, |history| {
            (history.outputs()[0] - history.outputs()[SPEED_TICKS]) / (SPEED_TICKS as f64 * self.period)
        })
    }

    /// Makes the command that is asked for, within all limits, at a position in m.
    pub(super) fn drive(&mut self, sequence: u64, position: f64) {
        let asked = self.requests.command(sequence, self.mode).unwrap_or(0.0);
        let (manual, last) = (self.mode == AxisMode::Manual, self.last.command);
        // A commissioning counts on neutral at once.
        let from = if manual || asked * last > 0.0 { last } else { 0.0 };
        let limited = self.limits.apply(asked, from);
        let command = self.end_stops.apply(limited, position, self.speed(), manual);
        self.send(command, if manual { ControlMode::Manual } else { ControlMode::Commission });
        (self.last.reference, self.last.error) = (position, 0.0);
        self.last.flags = if command == limited { 0 } else { control_flag::SOFT_LIMIT };
    }
}
