//! What all frames of a message have in common: identifier, bytes, and whether they are of CAN FD.

use embedded_can::Frame as _;

use crate::{FD_LENGTHS, Format, Frame, MAX_DATA};

/// How a message is on the bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Its identifier.
    pub id: u32,
    /// Whether the identifier has 29 bits.
    pub is_extended: bool,
    /// Its bytes: 1 to 8, and those of [`FD_LENGTHS`] with CAN FD.
    pub length: u8,
    /// Whether it is sent as a frame of CAN FD. A received message may come as either.
    pub is_flexible: bool,
}

impl Layout {
    /// Whether a message can have so many bytes; above 8 it is one of CAN FD.
    pub fn has_length(length: u64) -> bool {
        (1..=MAX_DATA as u64).contains(&length) || FD_LENGTHS.iter().any(|known| *known as u64 == length)
    }

    /// Whether a frame is of this message.
    pub fn is_of(&self, frame: &Frame) -> bool {
        frame.raw_id() == self.id && frame.is_extended() == self.is_extended && !frame.is_remote_frame()
    }

    /// The frame with these bytes; `None` where identifier or bytes are none of a frame. The bus says whether the data
    /// of CAN FD have a bit rate of their own.
    pub fn frame(&self, data: &[u8]) -> Option<Frame> {
        let format = if self.is_flexible { Format::Flexible { is_fast: false } } else { Format::Classical };
        Frame::from_raw(self.id, self.is_extended, format, data)
    }
}
