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
//! An axis that is armed changes its mode without being armed again.

use pipeline::{
    machine::{Axis, Timing},
    message::AxisMode,
};

use super::requests::Requests;

/// How one axis is operated.
#[derive(Debug, Clone)]
pub struct Operation {
    /// The requests to the axis.
    pub requests: Requests,
    /// The mode of the axis while it is armed.
    pub mode: AxisMode,
    /// Where the axis holds when it begins to follow in hold, m.
    pub set_point: Option<f64>,
}

impl Operation {
    /// Of the axis with this number, before any request.
    pub fn new(index: usize, axis: &Axis, timing: &Timing) -> Self {
        Self { requests: Requests::new(index, axis, timing), mode: AxisMode::Track, set_point: None }
    }
}
