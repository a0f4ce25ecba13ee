//! A simulated encoder (CiA 406) or inclinometer (CiA 410).

use super::{
    node::{Flaw, SimulatedNode},
    objects::Objects,
};
use crate::{
    Frame,
    canopen::{NodeId, function},
    device::{EncoderSettings, Outbox, PositionObject},
};

/// A simulated encoder. It sends its position with every SYNC.
#[derive(Debug, Clone)]
pub struct SimulatedEncoder {
    node: SimulatedNode,
    object: PositionObject,
}

impl SimulatedEncoder {
    /// An encoder with its position in `object`, whose count has the length `step`: 0.001 mm, or 0.001 degrees.
    pub fn new(id: NodeId, object: PositionObject, step: u32) -> Self {
        let mut objects = Objects::default();
        let (mapped, length) = (object.mapped(), object.step());
        objects.add_message(0x1800, id.id(function::TPDO1), &[mapped.entry()]);
        objects.add(mapped.object.index, 0, 0, usize::from(mapped.bits / 8), true);
        for (index, bytes, is_read_only) in [(0x6003, 4, false), (0x6503, 2, true), (0x6505, 2, true)] {
            objects.add(index, 0, 0, bytes, is_read_only);
        }
        let bytes = if object.profile() == 406 { 4 } else { 2 };
        objects.add(length.index, length.sub, step.into(), bytes, false);
        Self { node: SimulatedNode::new(id, object.profile(), objects), object }
    }

    /// With which a master reads an encoder that counts 0.05 mm: its position, which has a sign, and its alarms.
    pub fn settings(id: NodeId) -> EncoderSettings {
        EncoderSettings {
            node: id,
            object: PositionObject::Position,
            is_signed: true,
            is_reversed: false,
            zero: 0,
            has_alarms: true,
            is_fixed: false,
            step: Some(50),
            silent_after: 3,
        }
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

    /// Sends an emergency; code 0 says that it is over.
    pub fn emergency(&mut self, code: u16, out: &mut Outbox) {
        self.node.emergency(code, out);
    }

    /// Sets its alarms, 6503h.
    pub fn alarm(&mut self, alarms: u16) {
        self.node.objects.set(0x6503, 0, alarms.into());
    }

    /// Moves to a position, counts.
    pub fn set_counts(&mut self, counts: i64) {
        self.node.objects.set(self.object.mapped().object.index, 0, counts as u64);
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
