//! One classical CAN frame: an identifier of 11 or 29 bits and up to 8 bytes.

use embedded_can::{ExtendedId, Id, StandardId};

/// Most data bytes of a classical frame.
pub const MAX_DATA: usize = 8;

/// A data frame or a remote frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    id: Id,
    is_remote: bool,
    length: u8,
    /// Bytes beyond `length` are zero.
    data: [u8; MAX_DATA],
}

/// A frame that was received.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Received {
    /// The frame.
    pub frame: Frame,
    /// When it was received, ns of `CLOCK_MONOTONIC`: by the kernel where the bus has its time stamps, else when the
    /// program has read it.
    pub time_ns: u64,
}

impl Frame {
    /// A data frame with an identifier of 11 bits; only the lowest 11 bits of `id` count.
    ///
    /// ```
    /// use can::Frame;
    /// use embedded_can::Frame as _;
    ///
    /// let sync = Frame::standard(0x80, []);
    /// assert_eq!((sync.raw_id(), sync.data()), (0x80, &[][..]));
    /// ```
    pub fn standard<const N: usize>(id: u16, bytes: [u8; N]) -> Self {
        const { assert!(N <= MAX_DATA) };
        let id = StandardId::new(id & StandardId::MAX.as_raw()).unwrap_or(StandardId::ZERO);
        let mut data = [0; MAX_DATA];
        data[..N].copy_from_slice(&bytes);
        Self { id: Id::Standard(id), is_remote: false, length: N as u8, data }
    }

    /// A data frame with an identifier of 11 bits and `length` bytes of `data`, 8 at most.
    pub fn standard_of(id: u16, data: [u8; MAX_DATA], length: usize) -> Self {
        let mut frame = Self::standard(id, data);
        frame.length = length.min(MAX_DATA) as u8;
        frame.data[frame.length as usize..].fill(0);
        frame
    }

    /// The identifier as a number, of 11 or 29 bits.
    pub fn raw_id(&self) -> u32 {
        match self.id {
            Id::Standard(id) => u32::from(id.as_raw()),
            Id::Extended(id) => id.as_raw(),
        }
    }

    /// The identifier of a data frame with 11 bits; `None` of any other frame.
    pub fn standard_id(&self) -> Option<u16> {
        match self.id {
            Id::Standard(id) if !self.is_remote => Some(id.as_raw()),
            _ => None,
        }
    }

    /// Bits of the frame on the wire without stuff bits, with the pause after it: 47 and the data with an identifier of
    /// 11 bits, 67 and the data with one of 29 bits.
    pub fn wire_bits(&self) -> u32 {
        let bytes = if self.is_remote { 0 } else { u32::from(self.length) };
        8 * bytes + if matches!(self.id, Id::Standard(_)) { 47 } else { 67 }
    }

    /// A frame whose identifier is `raw`; `None` where it has more bits than its kind allows.
    pub(crate) fn from_raw(raw: u32, is_extended: bool, is_remote: bool, length: usize, bytes: &[u8]) -> Option<Self> {
        let id = if is_extended {
            Id::Extended(ExtendedId::new(raw)?)
        } else {
            Id::Standard(StandardId::new(u16::try_from(raw).ok()?)?)
        };
        let mut data = [0; MAX_DATA];
        data.get_mut(..bytes.len())?.copy_from_slice(bytes);
        (length <= MAX_DATA).then_some(Self { id, is_remote, length: length as u8, data })
    }
}

impl embedded_can::Frame for Frame {
    fn new(id: impl Into<Id>, data: &[u8]) -> Option<Self> {
        let mut bytes = [0; MAX_DATA];
        bytes.get_mut(..data.len())?.copy_from_slice(data);
        Some(Self { id: id.into(), is_remote: false, length: data.len() as u8, data: bytes })
    }

    fn new_remote(id: impl Into<Id>, dlc: usize) -> Option<Self> {
        let frame = Self { id: id.into(), is_remote: true, length: dlc as u8, data: [0; MAX_DATA] };
        (dlc <= MAX_DATA).then_some(frame)
    }

    fn is_extended(&self) -> bool {
        matches!(self.id, Id::Extended(_))
    }

    fn is_remote_frame(&self) -> bool {
        self.is_remote
    }

    fn id(&self) -> Id {
        self.id
    }

    fn dlc(&self) -> usize {
        self.length as usize
    }

    fn data(&self) -> &[u8] {
        if self.is_remote { &[] } else { &self.data[..self.length as usize] }
    }
}

#[cfg(test)]
mod tests {
    use embedded_can::Frame as _;

    use super::*;

    #[test]
    fn frames_have_no_more_than_eight_bytes() {
        assert!(Frame::new(StandardId::MAX, &[0; 9]).is_none() && Frame::new_remote(StandardId::MAX, 9).is_none());
        assert!(Frame::from_raw(1, false, false, 9, &[]).is_none());
        assert!(Frame::from_raw(0x800, false, false, 0, &[]).is_none());
        assert!(Frame::from_raw(0x2000_0000, true, false, 0, &[]).is_none());
        let frame = Frame::new(ExtendedId::MAX, &[1, 2, 3]).unwrap();
        assert_eq!((frame.raw_id(), frame.data(), frame.wire_bits()), (0x1FFF_FFFF, &[1, 2, 3][..], 91));
        assert_eq!(frame.standard_id(), None);
    }

    #[test]
    fn bytes_beyond_the_length_are_zero() {
        let frame = Frame::standard_of(0x181, [0xFF; 8], 2);
        assert_eq!(frame.data(), [0xFF, 0xFF]);
        assert_eq!(frame, Frame::standard(0x181, [0xFF, 0xFF]));
    }
}
