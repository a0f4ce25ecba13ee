//! Service data: objects are read and written one by one.
//!
//! ```text
//! write   expedited   23h, 27h, 2Bh, 2Fh + object + 4, 3, 2, 1 bytes       answer 60h + object
//!         segmented   21h + object + length                               answer 60h + object
//!                     t << 4 | n << 1 | c + 7 bytes, n of them unused     answer 20h | t << 4
//! read    40h + object     answer 43h.. + object + bytes, or 41h + object + length, and then
//!                     60h | t << 4                                        answer t << 4 | n << 1 | c + 7 bytes
//! abort   80h + object + code
//! ```
//!
//! t toggles from segment to segment, beginning with 0; c is 1 in the last one. Block transfers are not used.
//! A device answers one request at a time, and the client asks one at a time.

mod client;
mod server;

pub use client::{SdoClient, SdoError, SdoEvent};
pub use server::{Dictionary, SdoServer};

use super::{NodeId, function};
use crate::MAX_DATA;

/// Most bytes of an object's value. Names of devices fit.
pub const MAX_VALUE: usize = 64;
/// Bytes of a segment.
const SEGMENT: usize = 7;

/// An entry of the object dictionary.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Object {
    /// Index.
    pub index: u16,
    /// Subindex.
    pub sub: u8,
}

impl Object {
    /// The entry `index` with subindex `sub`.
    pub const fn new(index: u16, sub: u8) -> Self {
        Self { index, sub }
    }
}

impl std::fmt::Display for Object {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "{:04X}h:{}", self.index, self.sub)
    }
}

/// Why a transfer was ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("abort {:08X}h ({})", .0, AbortCode(*.0).name())]
pub struct AbortCode(pub u32);

impl AbortCode {
    /// The toggle bit did not alternate.
    pub const TOGGLE: Self = Self(0x0503_0000);
    /// No answer came in time.
    pub const TIMEOUT: Self = Self(0x0504_0000);
    /// The first byte of the message is none of a command.
    pub const COMMAND: Self = Self(0x0504_0001);
    /// There is no room for the value.
    pub const MEMORY: Self = Self(0x0504_0005);
    /// The object cannot be read or written in this way.
    pub const ACCESS: Self = Self(0x0601_0000);
    /// The object can only be read.
    pub const READ_ONLY: Self = Self(0x0601_0002);
    /// There is no such object.
    pub const NO_OBJECT: Self = Self(0x0602_0000);
    /// The length of the value is wrong.
    pub const LENGTH: Self = Self(0x0607_0010);
    /// There is no such subindex.
    pub const NO_SUBINDEX: Self = Self(0x0609_0011);
    /// The value is out of range.
    pub const RANGE: Self = Self(0x0609_0030);
    /// The value cannot be stored in the present state of the device.
    pub const STATE: Self = Self(0x0800_0022);

    /// What it means.
    pub fn name(self) -> &'static str {
        match self {
            Self::TOGGLE => "toggle bit not alternated",
            Self::TIMEOUT => "no answer",
            Self::COMMAND => "unknown command",
            Self::MEMORY => "no room",
            Self::ACCESS => "no such access",
            Self::READ_ONLY => "read only",
            Self::NO_OBJECT => "no such object",
            Self::LENGTH => "wrong length",
            Self::NO_SUBINDEX => "no such subindex",
            Self::RANGE => "value out of range",
            Self::STATE => "not in this state of the device",
            _ => "see CiA 301",
        }
    }
}

/// Identifier of requests to a node.
pub fn sdo_request_id(node: NodeId) -> u16 {
    node.id(function::SDO_REQUEST)
}

/// Identifier of the answers of a node.
pub fn sdo_response_id(node: NodeId) -> u16 {
    node.id(function::SDO_RESPONSE)
}

/// A message with a command and an object.
fn message(command: u8, object: Object, value: [u8; 4]) -> [u8; MAX_DATA] {
    let ([low, high], [a, b, c, d]) = (object.index.to_le_bytes(), value);
    [command, low, high, object.sub, a, b, c, d]
}

fn abort(object: Object, code: AbortCode) -> [u8; MAX_DATA] {
    message(0x80, object, code.0.to_le_bytes())
}

/// Object and value of a message.
fn parts(data: &[u8; MAX_DATA]) -> (Object, [u8; 4]) {
    let [_, low, high, sub, a, b, c, d] = *data;
    (Object::new(u16::from_le_bytes([low, high]), sub), [a, b, c, d])
}

/// The message of a segment with the command of its direction; the rest of a short one is 0.
fn segment(toggle: bool, bytes: &[u8], is_last: bool) -> [u8; MAX_DATA] {
    let length = bytes.len().min(SEGMENT);
    let mut data = [0; MAX_DATA];
    data[0] = u8::from(toggle) << 4 | ((SEGMENT - length) as u8) << 1 | u8::from(is_last);
    data[1..=length].copy_from_slice(&bytes[..length]);
    data
}

/// A value that comes in segments.
#[derive(Debug, Clone)]
struct Buffer {
    bytes: [u8; MAX_VALUE],
    length: usize,
    /// Bytes that were sent.
    sent: usize,
    toggle: bool,
}

impl Buffer {
    const EMPTY: Self = Self { bytes: [0; MAX_VALUE], length: 0, sent: 0, toggle: false };

    fn value(&self) -> &[u8] {
        &self.bytes[..self.length]
    }

    /// Takes a whole value; false where there is no room.
    fn set(&mut self, value: &[u8]) -> bool {
        *self = Self::EMPTY;
        self.append(value)
    }

    fn append(&mut self, more: &[u8]) -> bool {
        let Some(room) = self.bytes.get_mut(self.length..self.length + more.len()) else { return false };
        room.copy_from_slice(more);
        self.length += more.len();
        true
    }

    /// Takes a segment whose first byte is `data[0]`: whether it was the last one.
    fn take_segment(&mut self, data: &[u8; MAX_DATA]) -> Result<bool, AbortCode> {
        if (data[0] & 0x10 != 0) != self.toggle {
            return Err(AbortCode::TOGGLE);
        }
        let length = SEGMENT - usize::from(data[0] >> 1 & 7);
        if !self.append(&data[1..=length]) {
            return Err(AbortCode::MEMORY);
        }
        self.toggle = !self.toggle;
        Ok(data[0] & 1 != 0)
    }

    /// The next segment to send, and whether it is the last one.
    fn next_segment(&mut self) -> ([u8; MAX_DATA], bool) {
        let rest = &self.bytes[self.sent..self.length];
        let length = rest.len().min(SEGMENT);
        let is_last = length == rest.len();
        let data = segment(self.toggle, &rest[..length], is_last);
        self.sent += length;
        self.toggle = !self.toggle;
        (data, is_last)
    }
}
