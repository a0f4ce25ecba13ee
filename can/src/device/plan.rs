//! What is written to a device, and read back, before it is used.
//!
//! A setting counts as made when the device gives it back. So a device that takes a value and keeps another one is
//! refused.

use super::{Cause, Fault};
use crate::canopen::{AbortCode, Mapping, Object};

/// Bit of a COB-ID that switches the message off.
pub(super) const OFF: u32 = 1 << 31;

/// A value of up to 8 bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Value {
    number: u64,
    length: u8,
}

impl Value {
    /// Of 8 bits.
    pub fn u8(number: u8) -> Self {
        Self { number: number.into(), length: 1 }
    }

    /// Of 16 bits.
    pub fn u16(number: u16) -> Self {
        Self { number: number.into(), length: 2 }
    }

    /// Of 32 bits.
    pub fn u32(number: u32) -> Self {
        Self { number: number.into(), length: 4 }
    }

    pub(super) fn bytes(&self, room: &mut [u8; 8]) -> usize {
        *room = self.number.to_le_bytes();
        usize::from(self.length)
    }
}

/// What is done with an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Action {
    Write(Value),
    /// Reads the error register: whether an emergency stands.
    Register,
    /// Reads it; only the bits of the mask count.
    Expect {
        number: u64,
        mask: u64,
    },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Step {
    pub object: Object,
    pub action: Action,
    /// A device without the object is all right.
    pub is_optional: bool,
    cause: Cause,
}

impl Step {
    /// Whether the device may go without: it says that there is no such object.
    pub fn forgives(&self, code: AbortCode) -> bool {
        self.is_optional && [AbortCode::NO_OBJECT, AbortCode::NO_SUBINDEX].contains(&code)
    }

    /// The fault where the step has failed with `found`.
    pub fn fault(&self, node: u8, found: Option<u64>) -> Fault {
        let found = found.unwrap_or_default().min(u64::from(u16::MAX)) as u16;
        let detail = if self.cause == Cause::Setting { self.object.index } else { found };
        Fault { cause: self.cause, node, detail }
    }
}

/// Steps in their order.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Plan {
    steps: Vec<Step>,
}

/// Of a message of process data: its parameters, its mapping, and when it is sent or taken.
#[derive(Debug, Clone, Copy)]
pub(super) struct Message<'m> {
    /// Index of the parameters: 1400h.. or 1800h...
    pub parameters: u16,
    pub id: u16,
    pub mapping: &'m Mapping,
    /// Transmission type: 1 with every SYNC, 255 when it comes.
    pub kind: u8,
    /// Time-out of a message to the device, ms.
    pub timeout_ms: Option<u16>,
}

/// Entries of the mapping are at the index of the parameters and this.
const TO_MAPPING: u16 = 0x200;

impl Plan {
    pub(super) fn step(&self, place: usize) -> Option<Step> {
        self.steps.get(place).copied()
    }

    fn push(&mut self, object: Object, action: Action, is_optional: bool, cause: Cause) {
        self.steps.push(Step { object, action, is_optional, cause });
    }

    /// Expects a device of this profile: the lower half of 1000h.
    pub(super) fn profile(&mut self, profile: u16) {
        let action = Action::Expect { number: profile.into(), mask: 0xFFFF };
        self.push(Object::new(0x1000, 0), action, false, Cause::Profile);
    }

    /// Asks whether an emergency stands, by the error register 1001h. A device without it says so by emergencies alone.
    pub(super) fn error_register(&mut self) {
        self.push(Object::new(0x1001, 0), Action::Register, true, Cause::Setting);
    }

    /// Expects a number, where the device has the object.
    pub(super) fn expect_if_any(&mut self, object: Object, number: u64, cause: Cause) {
        self.push(object, Action::Expect { number, mask: u64::MAX }, true, cause);
    }

    pub(super) fn write(&mut self, object: Object, value: Value) {
        self.push(object, Action::Write(value), false, Cause::Setting);
    }

    /// Writes, and reads back.
    pub(super) fn ensure(&mut self, object: Object, value: Value) {
        self.write(object, value);
        self.push(object, Action::Expect { number: value.number, mask: u64::MAX }, false, Cause::Setting);
    }

    /// Writes and reads back, where the device has the object.
    pub(super) fn ensure_if_any(&mut self, object: Object, value: Value) {
        self.push(object, Action::Write(value), true, Cause::Setting);
        self.push(object, Action::Expect { number: value.number, mask: u64::MAX }, true, Cause::Setting);
    }

    /// Sets up a message: switched off, mapped, switched on. With `is_fixed` nothing but identifier, type and time-out
    /// is written, and the mapping is compared.
    pub(super) fn message(&mut self, message: &Message<'_>, is_fixed: bool) {
        let parameter = |sub| Object::new(message.parameters, sub);
        let entry = |sub| Object::new(message.parameters + TO_MAPPING, sub);
        let id = u32::from(message.id);
        let count = message.mapping.objects().len() as u8;
        self.write(parameter(1), Value::u32(OFF | id));
        if !is_fixed {
            self.write(entry(0), Value::u8(0));
            for (sub, mapped) in (1..).zip(message.mapping.objects()) {
                self.write(entry(sub), Value::u32(mapped.entry()));
            }
            self.write(entry(0), Value::u8(count));
        }
        self.expect(entry(0), u64::from(count));
        for (sub, mapped) in (1..).zip(message.mapping.objects()) {
            self.expect(entry(sub), u64::from(mapped.entry()));
        }
        self.ensure(parameter(2), Value::u8(message.kind));
        if let Some(timeout_ms) = message.timeout_ms {
            self.ensure(parameter(5), Value::u16(timeout_ms));
        }
        self.write(parameter(1), Value::u32(id));
        // Devices may set bit 30, no remote frames, on their own.
        let action = Action::Expect { number: id.into(), mask: 0xBFFF_FFFF };
        self.push(parameter(1), action, false, Cause::Setting);
    }

    fn expect(&mut self, object: Object, number: u64) {
        self.push(object, Action::Expect { number, mask: u64::MAX }, false, Cause::Setting);
    }
}
