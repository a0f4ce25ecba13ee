//! Operation of an axis: its requests, its mode and its set point.
//!
//! ```text
//! off --enable, with a mode--> manual, hold, track, commission --off, fault, requests stopped--> off
//!
//! manual, commission     direct modes: the request's command, as long as requests come
//! hold                   goes to the request's set point, or comes to a stand without one, and stays
//!                        ([`crate::reference::profile`])
//! track                  follows its reference, from the beginning of the reference on
//! ```
//!
//! An axis that is armed changes its mode without being armed again. With `hold_to_run`, a key of the machine file or a
//! field of the request, hold and track end as the direct modes do when requests stop.

use pipeline::{
    machine::{Axis, Timing},
    message::AxisMode,
};

use super::requests::Requests;
use crate::gains::FIXED;

/// How one axis is operated.
#[derive(Debug, Clone)]
pub struct Operation {
    /// The requests to the axis.
    pub requests: Requests,
    /// The mode of the axis while it is armed.
    pub mode: AxisMode,
    /// The axis is disarmed when requests stop, whatever its mode.
    pub hold_to_run: bool,
    /// That is the rule of the machine file.
    is_rule: bool,
    /// Where the axis holds when it begins to follow in hold, m.
    pub set_point: Option<f64>,
    /// Gains of the fallback, as a part of those of the machine file.
    pub gain: f64,
    /// Least and largest of them that a request may ask for.
    pub gain_range: [f64; 2],
    /// A commissioning has taken over the command of the mode before it, so its own may change direction at once.
    pub turns_at_once: bool,
}

impl Operation {
    /// Whether the axis may go on only while requests come.
    pub fn needs_requests(&self) -> bool {
        self.mode.is_direct() || self.hold_to_run
    }

    /// Takes in whether the last accepted request asks for that.
    pub fn ask_hold_to_run(&mut self, is_asked: bool) {
        self.hold_to_run = self.is_rule || is_asked;
    }

    /// Of the axis with this number, before any request.
    pub fn new(index: usize, axis: &Axis, timing: &Timing) -> Self {
        let is_rule = axis.control.hold_to_run;
        let requests = Requests::new(index, axis, timing);
        Self {
            requests,
            mode: AxisMode::Track,
            hold_to_run: is_rule,
            is_rule,
            set_point: None,
            gain: 1.0,
            gain_range: FIXED,
            turns_at_once: false,
        }
    }
}
