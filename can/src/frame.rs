//! One CAN frame: an identifier of 11 or 29 bits and up to 8 bytes, or up to 64 bytes with flexible data rate (CAN FD).
//!
//! ```text
//! classical  47 bits and the data with an identifier of 11 bits, 67 with one of 29 bits
//! CAN FD     30 or 49 bits at the rate of the bus, and 32 bits and the data at that of the data; above 16 bytes 37
//! ```
//!
//! These are the bits on the wire with the pause after the frame and the stuff bits that every frame of CAN FD has in
//! its checksum (ISO 11898-1), without those that depend on the data.

use embedded_can::{ExtendedId, Id, StandardId};

/// Most data bytes of a classical frame.
pub const MAX_DATA: usize = 8;
/// Most data bytes of a frame of CAN FD.
pub const MAX_FD_DATA: usize = 64;
/// Numbers of data bytes above 8 that a frame of CAN FD can have.
pub const FD_LENGTHS: [usize; 7] = [12, 16, 20, 24, 32, 48, MAX_FD_DATA];
/// From this number of bytes on CAN FD has its longer checksum.
const LONG_CHECKSUM: usize = 20;

/// What kind of frame it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Data, up to 8 bytes.
    Classical,
    /// A request for data, without data.
    Remote,
    /// Data of CAN FD, up to 64 bytes; with `is_fast` they have a bit rate of their own.
    Flexible {
        /// Whether the data have a bit rate of their own.
        is_fast: bool,
    },
}

/// A frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    id: Id,
    format: Format,
    length: u8,
    /// Bytes beyond `length` are zero.
    data: [u8; MAX_FD_DATA],
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
        let mut data = [0; MAX_FD_DATA];
        data[..N].copy_from_slice(&bytes);
        Self { id: Id::Standard(id), format: Format::Classical, length: N as u8, data }
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

    /// The identifier of a classical data frame with 11 bits; `None` of any other frame. Those are the frames of
    /// CANopen.
    pub fn standard_id(&self) -> Option<u16> {
        match self.id {
            Id::Standard(id) if self.format == Format::Classical => Some(id.as_raw()),
            _ => None,
        }
    }

    /// What kind of frame it is.
    pub fn format(&self) -> Format {
        self.format
    }

    /// Whether it is one of CAN FD.
    pub fn is_flexible(&self) -> bool {
        matches!(self.format, Format::Flexible { .. })
    }

    /// Bits on the wire: those at the rate of the bus, and those at the rate of the data.
    pub fn wire_bits(&self) -> (u32, u32) {
        let (bits, is_standard) = (8 * u32::from(self.length), matches!(self.id, Id::Standard(_)));
        let classical = if is_standard { 47 } else { 67 };
        match self.format {
            Format::Classical => (classical + bits, 0),
            Format::Remote => (classical, 0),
            Format::Flexible { is_fast } => {
                let slow = if is_standard { 30 } else { 49 };
                let data = bits + if usize::from(self.length) < LONG_CHECKSUM { 32 } else { 37 };
                if is_fast { (slow, data) } else { (slow + data, 0) }
            }
        }
    }

    /// The frame with its data at a bit rate of their own, or not; only that of CAN FD is changed.
    pub(crate) fn with_speed(self, is_fast: bool) -> Self {
        Self { format: if self.is_flexible() { Format::Flexible { is_fast } } else { self.format }, ..self }
    }

    /// A frame of CAN FD; `None` where it cannot have so many bytes. With `is_fast` its data have a bit rate of their
    /// own.
    pub fn flexible(id: impl Into<Id>, is_fast: bool, bytes: &[u8]) -> Option<Self> {
        Self::of(id.into(), Format::Flexible { is_fast }, bytes)
    }

    /// A data frame whose identifier is `raw`; `None` where it has more bits than its kind allows, or the format does
    /// not have so many bytes.
    pub(crate) fn from_raw(raw: u32, is_extended: bool, format: Format, bytes: &[u8]) -> Option<Self> {
        Self::of(id_of(raw, is_extended)?, format, bytes)
    }

    fn of(id: Id, format: Format, bytes: &[u8]) -> Option<Self> {
        let length = bytes.len();
        let is_sound = match format {
            Format::Remote => length == 0,
            Format::Classical => length <= MAX_DATA,
            Format::Flexible { .. } => length <= MAX_DATA || FD_LENGTHS.contains(&length),
        };
        let mut data = [0; MAX_FD_DATA];
        data.get_mut(..length).filter(|_| is_sound)?.copy_from_slice(bytes);
        Some(Self { id, format, length: length as u8, data })
    }

    /// A remote frame; `None` as with [`Self::from_raw`].
    pub(crate) fn remote(raw: u32, is_extended: bool, length: usize) -> Option<Self> {
        embedded_can::Frame::new_remote(id_of(raw, is_extended)?, length)
    }
}

impl embedded_can::Frame for Frame {
    fn new(id: impl Into<Id>, data: &[u8]) -> Option<Self> {
        let mut bytes = [0; MAX_FD_DATA];
        bytes[..MAX_DATA].get_mut(..data.len())?.copy_from_slice(data);
        Some(Self { id: id.into(), format: Format::Classical, length: data.len() as u8, data: bytes })
    }

    fn new_remote(id: impl Into<Id>, dlc: usize) -> Option<Self> {
        let frame = Self { id: id.into(), format: Format::Remote, length: dlc as u8, data: [0; MAX_FD_DATA] };
        (dlc <= MAX_DATA).then_some(frame)
    }

    fn is_extended(&self) -> bool {
        matches!(self.id, Id::Extended(_))
    }

    fn is_remote_frame(&self) -> bool {
        self.format == Format::Remote
    }

    fn id(&self) -> Id {
        self.id
    }

    fn dlc(&self) -> usize {
        self.length as usize
    }

    fn data(&self) -> &[u8] {
        if self.format == Format::Remote { &[] } else { &self.data[..self.length as usize] }
    }
}

fn id_of(raw: u32, is_extended: bool) -> Option<Id> {
    Some(if is_extended {
        Id::Extended(ExtendedId::new(raw)?)
    } else {
        Id::Standard(StandardId::new(u16::try_from(raw).ok()?)?)
    })
}

#[cfg(test)]
mod tests {
    use embedded_can::Frame as _;

    use super::*;

    #[test]
    fn classical_frames_have_no_more_than_eight_bytes() {
        assert!(Frame::new(StandardId::MAX, &[0; 9]).is_none() && Frame::new_remote(StandardId::MAX, 9).is_none());
        assert!(Frame::remote(1, false, 9).is_none() && Frame::from_raw(1, false, Format::Remote, &[0]).is_none());
        assert!(Frame::from_raw(1, false, Format::Classical, &[0; 12]).is_none());
        assert!(Frame::from_raw(0x800, false, Format::Classical, &[]).is_none());
        assert!(Frame::from_raw(0x2000_0000, true, Format::Classical, &[]).is_none());
        let frame = Frame::new(ExtendedId::MAX, &[1, 2, 3]).unwrap();
        assert_eq!((frame.raw_id(), frame.data(), frame.wire_bits()), (0x1FFF_FFFF, &[1, 2, 3][..], (91, 0)));
        assert_eq!(frame.standard_id(), None);
    }

    #[test]
    fn frames_of_can_fd_have_the_lengths_of_their_codes() {
        let of = |length: usize| Frame::from_raw(1, false, Format::Flexible { is_fast: true }, &[7; 65][..length]);
        let lengths: Vec<usize> = (0..=65).filter(|length| of(*length).is_some()).collect();
        assert_eq!(lengths, [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64]);
        let frame = of(64).unwrap();
        assert_eq!((frame.data(), frame.standard_id()), (&[7; 64][..], None));
        // SOF, identifier, control, BRS, and the end; ESI, DLC, data, stuff count, CRC with its stuff bits.
        assert_eq!(frame.wire_bits(), (1 + 11 + 4 + 1 + 13, 1 + 4 + 512 + 4 + 21 + 7));
        assert_eq!(frame.with_speed(false).wire_bits(), (579, 0));
        assert_eq!(of(16).unwrap().wire_bits(), (30, 1 + 4 + 128 + 4 + 17 + 6));
        let extended = Frame::from_raw(1, true, Format::Flexible { is_fast: true }, &[]).unwrap();
        assert_eq!(extended.wire_bits(), (49, 32));
        assert_eq!(Frame::standard(1, []).with_speed(true), Frame::standard(1, []));
    }

    #[test]
    fn bytes_beyond_the_length_are_zero() {
        let frame = Frame::standard_of(0x181, [0xFF; 8], 2);
        assert_eq!(frame.data(), [0xFF, 0xFF]);
        assert_eq!(frame, Frame::standard(0x181, [0xFF, 0xFF]));
    }
}
