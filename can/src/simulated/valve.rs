//! A simulated valve (CiA 408) with the states of the profile and its own time-out.
//!
//! ```text
//! INIT 8h -> DISABLED 9h -> HOLD Bh -> ACTIVE Fh      one step for each control word, by its bits D, H and M
//! FAULT 3h: by the time-out or an injected fault; a rising edge of R leads to HOLD
//! ```

use super::{
    node::{Flaw, SimulatedNode},
    objects::Objects,
};
use crate::{
    Frame,
    canopen::{NodeId, emergency_code, function},
    device::{Outbox, ValveSettings},
};
use embedded_can::Frame as _;

/// States, as the status word has them.
const INIT: u64 = 0x8;
const DISABLED: u64 = 0x9;
const HOLD: u64 = 0xB;
const ACTIVE: u64 = 0xF;
const FAULT: u64 = 0x3;
/// Bit of the reset in the control word.
const RESET: u64 = 8;

/// A simulated valve. It sends status and spool position with every SYNC.
#[derive(Debug, Clone)]
pub struct SimulatedValve {
    node: SimulatedNode,
    full_scale: f64,
    heard_ns: u64,
    last_word: u64,
    /// Where the spool is stuck, as a part of full scale.
    stuck: Option<f64>,
}

impl SimulatedValve {
    /// A valve that is fully open at the set point `full_scale`.
    pub fn new(id: NodeId, full_scale: i16) -> Self {
        let mut objects = Objects::default();
        objects.add_message(0x1400, id.id(function::RPDO1), &[]);
        objects.add_message(0x1800, id.id(function::TPDO1), &[]);
        objects.add(0x6040, 0, 0, 2, false);
        objects.add(0x6041, 0, INIT, 2, true);
        objects.add(0x6042, 0, 0, 1, false);
        objects.add(0x6043, 0, 0, 1, false);
        for index in [0x6300, 0x6301, 0x6314] {
            objects.add(index, 1, 0, 2, index == 0x6301);
        }
        let node = SimulatedNode::new(id, 408, objects);
        Self { node, full_scale: full_scale.into(), heard_ns: 0, last_word: 0, stuck: None }
    }

    /// With which a master drives a valve that is fully open at `full_scale`: a time-out of 50 ms.
    pub fn settings(id: NodeId, full_scale: i16) -> ValveSettings {
        ValveSettings { node: id, full_scale, timeout_ms: 50, spool_tolerance: Some(0.12), is_fixed: false }
    }

    /// Its number.
    pub fn id(&self) -> NodeId {
        self.node.id
    }

    /// What is wrong with it from now on.
    pub fn spoil(&mut self, flaw: Option<Flaw>) {
        self.node.flaw = flaw;
    }

    /// It is switched off and on.
    pub fn restart(&mut self) {
        self.node.restart();
    }

    /// A fault: it goes to hold and sends an emergency.
    pub fn fail(&mut self, code: u16, out: &mut Outbox) {
        self.set_state(FAULT);
        self.node.emergency(code, out);
    }

    /// Sends an emergency; code 0 says that it is over.
    pub fn emergency(&mut self, code: u16, out: &mut Outbox) {
        self.node.emergency(code, out);
    }

    /// Its spool is stuck at this part of full scale.
    pub fn stick(&mut self, spool: Option<f64>) {
        self.stuck = spool;
    }

    fn state(&self) -> u64 {
        self.node.objects.number(0x6041, 0)
    }

    fn set_state(&mut self, state: u64) {
        self.node.objects.set(0x6041, 0, state);
    }

    /// How far the spool is open, -1 to 1.
    pub fn opening(&self) -> f64 {
        let set_point = self.node.objects.number(0x6300, 1) as u16 as i16;
        let is_active = self.state() == ACTIVE && self.node.is_operational();
        let commanded = if is_active { f64::from(set_point) / self.full_scale } else { 0.0 };
        self.stuck.unwrap_or(commanded)
    }

    /// Sends what is due, and stops where set points have stopped.
    pub fn step(&mut self, now_ns: u64, out: &mut Outbox) {
        self.node.step(now_ns, out);
        let timeout_ns = self.node.objects.number(0x1400, 5) * 1_000_000;
        let is_late = timeout_ns > 0 && now_ns.saturating_sub(self.heard_ns) > timeout_ns;
        if self.state() == ACTIVE && is_late && self.node.flaw != Some(Flaw::NoTimeout) {
            self.fail(emergency_code::RPDO_TIMEOUT, out);
        }
    }

    /// Takes a frame from the bus.
    pub fn take(&mut self, frame: &Frame, now_ns: u64, out: &mut Outbox) {
        if self.node.take(frame, out) && !self.node.is_operational() {
            self.set_state(INIT);
        }
        let commands = self.node.objects.number(0x1400, 1) as u32;
        let is_for_it = commands >> 31 == 0 && frame.standard_id() == Some(commands as u16);
        if is_for_it && self.node.is_operational() {
            self.take_command(frame, now_ns, out);
        }
        if frame.standard_id() == Some(function::SYNC) {
            let spool = (self.opening() * self.full_scale).round() as i16;
            self.node.objects.set(0x6301, 1, spool as u64);
            self.node.send_process_data(out);
        }
    }

    fn take_command(&mut self, frame: &Frame, now_ns: u64, out: &mut Outbox) {
        let &[low, high, a, b] = frame.data() else { return };
        let word = u64::from(u16::from_le_bytes([low, high]));
        self.node.objects.set(0x6300, 1, u16::from_le_bytes([a, b]).into());
        self.heard_ns = now_ns;
        let is_reset = word & RESET != 0 && self.last_word & RESET == 0;
        let next = match (self.state(), word & 7) {
            (FAULT, _) if is_reset => {
                self.node.emergency(emergency_code::NONE, out);
                HOLD
            }
            (FAULT, _) => FAULT,
            (_, 0) => INIT,
            (INIT, _) | (_, 1) => DISABLED,
            (DISABLED, _) | (_, 3) => HOLD,
            (HOLD | ACTIVE, 7) => ACTIVE,
            (state, _) => state,
        };
        self.last_word = word;
        self.set_state(next);
    }
}
