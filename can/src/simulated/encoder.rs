//! A simulated encoder (CiA 406).

use super::{
    node::{Flaw, SimulatedNode},
    objects::Objects,
};
use crate::{
    Frame,
    canopen::{NodeId, function},
    device::Outbox,
};

/// A simulated encoder. It sends its position with every SYNC.
#[derive(Debug, Clone)]
pub struct SimulatedEncoder {
    node: SimulatedNode,
}

impl SimulatedEncoder {
    /// An encoder whose count is `step_um` long, in 0.001 mm.
    pub fn new(id: NodeId, step_um: u32) -> Self {
        let mut objects = Objects::default();
        objects.add_message(0x1800, id.id(function::TPDO1), &[0x6004_0020]);
        for (index, bytes) in [(0x6003, 4), (0x6004, 4), (0x6008, 8), (0x6503, 2), (0x6505, 2)] {
            objects.add(index, 0, 0, bytes, index != 0x6003);
        }
        objects.add(0x6005, 1, step_um.into(), 4, false);
        Self { node: SimulatedNode::new(id, 406, objects) }
    }

    /// What is wrong with it from now on.
    pub fn spoil(&mut self, flaw: Option<Flaw>) {
        self.node.flaw = flaw;
    }

    /// It is switched off and on.
    pub fn restart(&mut self) {
        self.node.restart();
    }

    /// Sends an emergency; code 0 says that it is over.
    pub fn emergency(&self, code: u16, out: &mut Outbox) {
        self.node.emergency(code, out);
    }

    /// Sets its alarms, 6503h.
    pub fn alarm(&mut self, alarms: u16) {
        self.node.objects.set(0x6503, 0, alarms.into());
    }

    /// Moves to a position, counts.
    pub fn set_counts(&mut self, counts: i64) {
        self.node.objects.set(0x6004, 0, counts as u64);
        self.node.objects.set(0x6008, 0, counts as u64);
    }

    /// Sends what is due.
    pub fn step(&mut self, now_ns: u64, out: &mut Outbox) {
        self.node.step(now_ns, out);
    }

    /// Takes a frame from the bus.
    pub fn take(&mut self, frame: &Frame, out: &mut Outbox) {
        self.node.take(frame, out);
        if frame.standard_id() == Some(function::SYNC) {
            self.node.send_process_data(out);
        }
    }
}
