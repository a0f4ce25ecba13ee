//! An encoder (CiA 406), or an inclinometer (CiA 410).
//!
//! ```text
//! TPDO 1 with every SYNC:   6004h position (32 bits), 6503h alarms (16), 6505h warnings (16)
//!                      or   6008h position of high precision (64 bits)
//!                      or   6010h, 6020h slope, longitudinal or lateral (16 bits); 6110h, 6120h (32 bits)
//! counts = position - zero, or zero - position where the encoder is mounted the other way round
//! ```
//!
//! The alarms travel with the position where the machine file says so: a position whose encoder does not trust it is
//! known as such with the same SYNC. Nothing here writes the preset 6003h: the zero of an axis is not moved from here.
//!
//! Trap: 6004h is a number with or without a sign, by maker. An encoder that goes below its zero without one jumps to
//! the other end of its range.

use super::{Cause, Fault, Node, NodeTiming, Outbox, Plan, Value, plan::Message};
use crate::{
    Received,
    canopen::{Mapped, Mapping, MappingError, NodeId, Object, function, signed},
};

/// Positions beyond one for each SYNC after which two devices have one number.
const DOUBLE_AFTER: i32 = 3;
/// Most positions that may be late at once: they come together when the bus, or this computer, was busy.
const MOST_LATE: i32 = 1000;
/// SYNC in a row with one position each after which nothing is late any more, and a second device is gone.
const SINGLE_AGAIN: u32 = 100;

/// Which object has the position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PositionObject {
    /// 6004h of an encoder, 32 bits.
    Position,
    /// 6008h of an encoder, 64 bits.
    HighPrecision,
    /// 6010h of an inclinometer, 16 bits.
    SlopeLong16,
    /// 6020h of an inclinometer, 16 bits.
    SlopeLateral16,
    /// 6110h of an inclinometer, 32 bits.
    SlopeLong32,
    /// 6120h of an inclinometer, 32 bits.
    SlopeLateral32,
}

impl PositionObject {
    /// The object and its bits.
    pub fn mapped(self) -> Mapped {
        let (index, bits) = match self {
            Self::Position => (0x6004, 32),
            Self::HighPrecision => (0x6008, 64),
            Self::SlopeLong16 => (0x6010, 16),
            Self::SlopeLateral16 => (0x6020, 16),
            Self::SlopeLong32 => (0x6110, 32),
            Self::SlopeLateral32 => (0x6120, 32),
        };
        Mapped { object: Object::new(index, 0), bits }
    }

    /// Number of the profile of its devices.
    pub fn profile(self) -> u16 {
        if matches!(self, Self::Position | Self::HighPrecision) { 406 } else { 410 }
    }

    /// The object that has the length of a count: 6005h:1 in 0.001 mm, or 6000h in 0.001 degrees.
    pub fn step(self) -> Object {
        if self.profile() == 406 { Object::new(0x6005, 1) } else { Object::new(0x6000, 0) }
    }
}

/// What an encoder is set up to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EncoderSettings {
    /// Its number.
    pub node: NodeId,
    /// What has the position.
    pub object: PositionObject,
    /// Whether the position has a sign.
    pub is_signed: bool,
    /// Whether the position grows while the axis retracts.
    pub is_reversed: bool,
    /// Position of the encoder at count 0.
    pub zero: i64,
    /// Whether alarms and warnings travel with the position.
    pub has_alarms: bool,
    /// Whether the mapping cannot be written, and is compared only.
    pub is_fixed: bool,
    /// Length of a count, which [`PositionObject::step`] has to have where the encoder has it.
    pub step: Option<u32>,
    /// Number of SYNC in a row without a position after which the encoder is silent.
    pub silent_after: u32,
}

impl EncoderSettings {
    /// The counts of a position as the encoder gives it.
    pub fn counts(&self, position: u64) -> i64 {
        let raw = if self.is_signed { signed(position, self.object.mapped().bits) } else { position as i64 };
        let counts = raw.wrapping_sub(self.zero);
        if self.is_reversed { counts.wrapping_neg() } else { counts }
    }
}

/// An encoder.
#[derive(Debug, Clone)]
pub struct Encoder {
    node: Node,
    settings: EncoderSettings,
    mapping: Mapping,
    id: u16,
    counts: i64,
    /// Positions since the last SYNC.
    fresh: u32,
    /// SYNC in a row without a position.
    missed: u32,
    /// 6503h and 6505h of the last position.
    alarms: u16,
    warnings: u16,
    /// Positions beyond one for each SYNC; below 0 those that have not come yet.
    surplus: i32,
    /// SYNC in a row with one position.
    single: u32,
}

impl Encoder {
    /// An encoder that has not been heard yet.
    ///
    /// # Errors
    /// Alarms and a position of 64 bits do not fit into one message.
    pub fn new(settings: EncoderSettings, timing: NodeTiming) -> Result<Self, MappingError> {
        let mapped = |index, bits| Mapped { object: Object::new(index, 0), bits };
        let objects = [settings.object.mapped(), mapped(0x6503, 16), mapped(0x6505, 16)];
        let mapping = Mapping::new(if settings.has_alarms { &objects } else { &objects[..1] })?;
        let id = settings.node.id(function::TPDO1);
        let mut plan = Plan::default();
        plan.profile(settings.object.profile());
        plan.error_register();
        plan.ensure(Object::new(0x1017, 0), Value::u16((timing.heartbeat_ns / 1_000_000) as u16));
        if let Some(step) = settings.step {
            plan.expect_if_any(settings.object.step(), step.into(), Cause::Scale);
        }
        let message = Message { parameters: 0x1800, id, mapping: &mapping, kind: 1, timeout_ms: None };
        plan.message(&message, settings.is_fixed);
        let node = Node::new(settings.node, plan, timing);
        Ok(Self {
            node,
            settings,
            mapping,
            id,
            counts: 0,
            fresh: 0,
            missed: 0,
            alarms: 0,
            warnings: 0,
            surplus: 0,
            single: 0,
        })
    }

    /// A SYNC is sent: a new sample begins.
    pub fn begin(&mut self, now_ns: u64, out: &mut Outbox) {
        let fresh = self.fresh.min(MOST_LATE as u32) as i32;
        self.surplus = (self.surplus + fresh - 1).clamp(-MOST_LATE, DOUBLE_AFTER);
        self.single = if self.fresh == 1 { self.single.saturating_add(1) } else { 0 };
        if self.single >= SINGLE_AGAIN {
            self.surplus = 0;
        }
        self.missed = if self.fresh > 0 || !self.node.is_operational() { 0 } else { self.missed.saturating_add(1) };
        self.fresh = 0;
        self.node.check(now_ns, out);
    }

    /// The bus is gone.
    pub fn lose_bus(&mut self, now_ns: u64) {
        self.node.lose_bus(now_ns);
    }

    /// A person has acknowledged the fault: an emergency is asked for anew.
    pub fn acknowledge(&mut self, now_ns: u64) {
        self.node.ask_again(now_ns);
    }

    /// Takes a frame from the bus: whether it was one of this encoder.
    pub fn take(&mut self, received: &Received, now_ns: u64, out: &mut Outbox) -> bool {
        if received.frame.standard_id() != Some(self.id) {
            return self.node.take(received, now_ns, out);
        }
        // A message that is too short is none, and the sample stays without a position.
        if let Some([position, alarms, warnings, ..]) = self.mapping.unpack(&received.frame)
            && self.node.is_operational()
        {
            self.counts = self.settings.counts(position);
            (self.alarms, self.warnings) = (alarms as u16, warnings as u16);
            self.fresh += 1;
        }
        true
    }

    /// Whether the position of this SYNC has come, or none is expected of a device at fault.
    pub fn is_complete(&self) -> bool {
        self.fresh > 0 || self.fault().is_some()
    }

    /// The position that came last, counts.
    pub fn counts(&self) -> i64 {
        self.counts
    }

    /// The warnings that came last, 6505h.
    pub fn warnings(&self) -> u16 {
        self.warnings
    }

    /// What is wrong with the encoder.
    pub fn fault(&self) -> Option<Fault> {
        if let Some(fault) = self.node.fault() {
            return Some(fault);
        }
        match self {
            _ if self.surplus >= DOUBLE_AFTER => Some(self.node.because(Cause::Double, 0)),
            _ if self.alarms != 0 => Some(self.node.because(Cause::Alarm, self.alarms)),
            _ if self.missed >= self.settings.silent_after => Some(self.node.because(Cause::Silent, 0)),
            _ => None,
        }
    }
}
