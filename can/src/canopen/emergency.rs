//! Emergency messages: what is wrong with a node.
//!
//! ```text
//! 080h+node   code (2 bytes), error register 1001h (1), 5 bytes of the maker
//! ```
//!
//! Code 0 says that an error is over, or that all are.

use embedded_can::Frame as _;

use super::{NodeId, function};
use crate::Frame;

/// Codes that every device has.
pub mod code {
    /// No error, or an error is over.
    pub const NONE: u16 = 0x0000;
    /// An error of which no more is known.
    pub const GENERIC: u16 = 0x1000;
    /// The heartbeat of another node, or node guarding, has stopped.
    pub const HEARTBEAT: u16 = 0x8130;
    /// An RPDO has not come within its event timer.
    pub const RPDO_TIMEOUT: u16 = 0x8250;
}

/// An emergency message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Emergency {
    /// Which error, by CiA 301 and the profile of the device.
    pub code: u16,
    /// The error register 1001h; 0 without an error.
    pub register: u8,
    /// Bytes of the maker.
    pub maker: [u8; 5],
}

impl Emergency {
    /// The message of a node.
    pub fn frame(&self, node: NodeId) -> Frame {
        let [low, high] = self.code.to_le_bytes();
        let [a, b, c, d, e] = self.maker;
        Frame::standard(node.id(function::EMERGENCY), [low, high, self.register, a, b, c, d, e])
    }

    /// Node and message of a frame.
    pub fn of(frame: &Frame) -> Option<(NodeId, Self)> {
        let id = frame.standard_id()?.checked_sub(function::EMERGENCY)?;
        let node = NodeId::new(u8::try_from(id).ok()?)?;
        let &[low, high, register, ref maker @ ..] = frame.data() else { return None };
        let maker = maker.try_into().ok()?;
        Some((node, Self { code: u16::from_le_bytes([low, high]), register, maker }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_emergency_is_read_as_it_was_made() {
        let node = NodeId::new(127).unwrap();
        let emergency = Emergency { code: code::RPDO_TIMEOUT, register: 0x11, maker: [1, 2, 3, 4, 5] };
        assert_eq!(Emergency::of(&emergency.frame(node)), Some((node, emergency)));
        assert_eq!(Emergency::of(&Frame::standard(0x080, [0; 8])), None, "SYNC is no emergency");
        assert_eq!(Emergency::of(&Frame::standard(0x081, [0; 7])), None);
    }
}
