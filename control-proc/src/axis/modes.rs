//! Changes of mode by requests, and the commands of the direct modes.

use pipeline::message::{AxisMode, ControlMode, control_flag};

use super::{AxisController, AxisInput, decision::Decision, operation::Operation, requests::Accepted, state::State};

impl AxisController {
    /// Takes in the newest request. Disarms an axis that needs requests, and whose requests have stopped.
    pub(super) fn take_request(&mut self, input: &AxisInput<'_>) {
        let Operation { requests, gain, gain_range, .. } = &mut self.operation;
        let gains = if self.state.is_armed() { [*gain; 2] } else { *gain_range };
        if let Some(accepted) = input.request.and_then(|request| requests.update(request, input.sequence, gains)) {
            let is_kept = self.state.is_pressed() || (self.state.cause() != 0 && !accepted.can_release);
            if accepted.mode == Some(AxisMode::Off) && is_kept {
                requests.refuse();
            } else {
                accepted.gain.into_iter().for_each(|gain| self.scale(gain));
                // A program that asks nothing of this axis, as one that took over to move another, leaves its rule.
                if accepted.mode.is_some() {
                    self.operation.ask_hold_to_run(accepted.hold_to_run);
                }
                self.change_mode(&accepted);
            }
        }
        let mode = self.operation.mode;
        let needs_requests = self.state.is_armed() && self.operation.needs_requests();
        if needs_requests && self.operation.requests.command(input.sequence, mode).is_none() {
            self.disarm();
            self.state.note_stopped_requests();
        }
    }

    /// The fallback uses this part of its gains from now on.
    fn scale(&mut self, gain: f64) {
        self.operation.gain = gain;
        self.fallback.scale(gain);
        self.law.scale(gain);
    }

    /// Arms a disarmed axis in this mode, with the set point of hold in m.
    pub(super) fn arm_in(&mut self, mode: AxisMode, set_point: Option<f64>) {
        if self.state.arm() {
            (self.operation.mode, self.operation.set_point) = (mode, set_point);
            // A fault of before is none of an axis that settles; one that stands latches it after its time.
            self.feedback.reset();
            self.tracking.slowed = 0;
            self.decision.flags = control_flag::SETTLING;
        }
    }

    /// Changes to the mode of an accepted request.
    fn change_mode(&mut self, accepted: &Accepted) {
        let Some(mode) = accepted.mode else { return };
        match self.state.current() {
            State::Disarmed if mode != AxisMode::Off && accepted.is_enabled => self.arm_in(mode, accepted.set_point),
            State::Disarmed => {}
            _ if mode == AxisMode::Off => self.disarm(),
            State::Settling(_) => (self.operation.mode, self.operation.set_point) = (mode, accepted.set_point),
            State::Following => {
                let before = std::mem::replace(&mut self.operation.mode, mode);
                if before != mode {
                    self.operation.turns_at_once = false;
                }
                if before.is_direct() && !mode.is_direct() {
                    self.take_over();
                }
                match mode {
                    AxisMode::Hold if before == AxisMode::Track => self.stop_to_hold(),
                    AxisMode::Track => self.references.track(),
                    _ => {}
                }
                if let Some(set_point) = accepted.set_point.filter(|_| mode == AxisMode::Hold) {
                    self.references.aim(set_point);
                }
            }
            State::Latched(_) => {}
        }
    }

    /// A controller takes over from a direct mode: the reference begins with the motion of the axis.
    fn take_over(&mut self) {
        self.gate.begin();
        self.standstill.reset();
        self.protection.reset();
        self.law.interrupt();
        if let Some(position) = self.feedback.position() {
            self.references.hold(Some((position, self.feedback.speed())));
        }
    }

    /// The decision in a direct mode: the command of the request within all limits, at a position in m.
    pub(super) fn command_directly(&mut self, sequence: u64, position: f64) -> Decision {
        let mode = self.operation.mode;
        let requested = self.operation.requests.command(sequence, mode).unwrap_or(0.0);
        let (is_manual, last) = (mode == AxisMode::Manual, self.decision.command);
        // A commissioning relies on a change of direction that passes neutral at once, and on a command that is neutral
        // at once when requests stop. What the mode before it has commanded goes through neutral at its rate.
        let turns = requested * last < 0.0;
        self.operation.turns_at_once |= !is_manual && !turns;
        let is_neutral_first = requested == 0.0 || (turns && self.operation.turns_at_once);
        let from = if !is_manual && is_neutral_first { 0.0 } else { last };
        let limited = self.protection.limits().apply(requested, from);
        let command = self.protection.end_stops().apply(limited, position, self.feedback.speed(), is_manual);
        Decision {
            command,
            by: if is_manual { ControlMode::Manual } else { ControlMode::Commission },
            reference: position,
            error: 0.0,
            flags: if command == limited { 0 } else { control_flag::SOFT_LIMIT },
        }
    }
}
