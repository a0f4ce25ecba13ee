//! The decision of a tick: the command, who makes it, and why.

use pipeline::message::ControlMode;

use crate::standstill::Stand;

/// The decision of one tick. The next tick reads from it which command is on the valve and who made it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Decision {
    /// Valve command in [-1, 1].
    pub command: f64,
    /// Who made it.
    pub by: ControlMode,
    /// Reference of this tick, m.
    pub reference: f64,
    /// Reference minus position, m.
    pub error: f64,
    /// Why the axis stands still or the model does not control, [`pipeline::message::control_flag`] bits.
    pub flags: u32,
}

impl Decision {
    /// Neutral, with the reference where the axis is.
    pub fn neutral(reference: f64, flags: u32) -> Self {
        Self { command: 0.0, by: ControlMode::Neutral, reference, error: 0.0, flags }
    }

    /// Whether the fallback has to go on from this command: another controller or a request made it.
    pub fn is_handed_over(&self) -> bool {
        matches!(self.by, ControlMode::Model | ControlMode::Manual | ControlMode::Commission)
    }

    /// Sets or clears a flag.
    pub fn set_flag(&mut self, flag: u32, is_set: bool) {
        self.flags = if is_set { self.flags | flag } else { self.flags & !flag };
    }
}

/// Who commands an axis in closed loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Commander {
    /// Nobody: the axis has arrived and rests at neutral, under this controller.
    Rest(ControlMode),
    /// Nobody: the axis creeps to its set point with this command, under this controller.
    Creep(f64, ControlMode),
    /// The controller by the model, with this command.
    Model(f64),
    /// The fallback, at a following error that is greater by this, m.
    Fallback(f64),
}

impl Commander {
    /// Chooses by the command of the model, if the model may control, and by whether the axis rests or creeps.
    pub fn choose(admitted: Option<f64>, stand: Stand) -> Self {
        let by = if admitted.is_some() { ControlMode::Model } else { ControlMode::Fallback };
        match (stand, admitted) {
            (Stand::Rest, _) => Self::Rest(by),
            (Stand::Creep(command), _) => Self::Creep(command, by),
            (Stand::Follow, Some(command)) => Self::Model(command),
            (Stand::Follow, None) => Self::Fallback(0.0),
            (Stand::Regulate(push), _) => Self::Fallback(push),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_that_rests_is_neutral_under_the_controller_that_would_command_it() {
        assert_eq!(Commander::choose(Some(0.3), Stand::Rest), Commander::Rest(ControlMode::Model));
        assert_eq!(Commander::choose(None, Stand::Rest), Commander::Rest(ControlMode::Fallback));
        assert_eq!(Commander::choose(None, Stand::Creep(0.1)), Commander::Creep(0.1, ControlMode::Fallback));
    }

    #[test]
    fn the_model_commands_where_it_is_admitted_and_the_fallback_elsewhere() {
        assert_eq!(Commander::choose(Some(0.3), Stand::Follow), Commander::Model(0.3));
        assert_eq!(Commander::choose(None, Stand::Follow), Commander::Fallback(0.0));
        assert_eq!(Commander::choose(Some(0.3), Stand::Regulate(2e-3)), Commander::Fallback(2e-3));
    }

    #[test]
    fn the_fallback_goes_on_from_the_command_of_everybody_but_itself_and_neutral() {
        let by = |by| Decision { by, ..Decision::neutral(0.0, 0) }.is_handed_over();
        assert!(by(ControlMode::Model) && by(ControlMode::Manual) && by(ControlMode::Commission));
        assert!(!by(ControlMode::Neutral) && !by(ControlMode::Fallback));
    }

    #[test]
    fn a_flag_is_set_and_cleared_beside_the_others() {
        let mut decision = Decision::neutral(0.0, 5);
        decision.set_flag(2, true);
        assert_eq!(decision.flags, 7);
        decision.set_flag(4, false);
        assert_eq!(decision.flags, 3);
    }
}
