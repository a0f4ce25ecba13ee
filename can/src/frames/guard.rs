//! Alive counter and checksum of a frame.
//!
//! ```text
//! counter    grows by 1 from frame to frame, and begins anew after its last number
//! xor, sum   of all other bytes of the frame, modulo 256
//! crc8       of all other bytes, polynomial 1Dh, begin and end FFh (SAE J1850)
//! ```
//!
//! A frame whose counter stands still comes from a sender that has hung, and is not used.

use super::Signal;

/// How a checksum is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Checksum {
    /// Exclusive or of all other bytes.
    Xor,
    /// Sum of all other bytes, modulo 256.
    Sum,
    /// CRC of 8 bits of SAE J1850.
    Crc8J1850,
}

impl Checksum {
    /// Of bytes in which the checksum itself is left out, by its place.
    fn of(self, data: &[u8], own: usize) -> u8 {
        let others = data.iter().enumerate().filter(|(i, _)| *i != own).map(|(_, byte)| *byte);
        match self {
            Self::Xor => others.fold(0, |sum, byte| sum ^ byte),
            Self::Sum => others.fold(0, u8::wrapping_add),
            Self::Crc8J1850 => !others.fold(0xFF_u8, |crc, byte| {
                (0..8).fold(crc ^ byte, |crc, _| if crc & 0x80 != 0 { crc << 1 ^ 0x1D } else { crc << 1 })
            }),
        }
    }
}

/// What a received frame is worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// It can be used; so many frames before it were lost, by its counter.
    Good(u64),
    /// Its checksum is wrong.
    Checksum,
    /// Its counter is that of the frame before.
    Counter,
}

/// Alive counter and checksum, where a message has them.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Guard {
    /// The counter.
    pub counter: Option<Signal>,
    /// The checksum, which is a whole byte, its place, and how it is made.
    pub checksum: Option<(u8, Checksum)>,
}

impl Guard {
    /// Judges a received frame; `last` is the counter of the frame before, and becomes that of this one.
    pub fn judge(&self, data: &[u8], last: &mut Option<i64>) -> Verdict {
        if let Some((place, kind)) = self.checksum
            && data.get(usize::from(place)) != Some(&kind.of(data, usize::from(place)))
        {
            return Verdict::Checksum;
        }
        let Some((signal, count)) = self.counter.and_then(|signal| Some((signal, signal.raw(data)?))) else {
            return Verdict::Good(0);
        };
        match last.replace(count) {
            Some(before) if before == count => Verdict::Counter,
            Some(before) => Verdict::Good((count.wrapping_sub(before) - 1).rem_euclid(signal.modulus()) as u64),
            None => Verdict::Good(0),
        }
    }

    /// Puts counter and checksum into the bytes of a frame that is sent.
    pub fn seal(&self, count: i64, data: &mut [u8]) {
        if let Some(signal) = self.counter {
            signal.put_raw(count, data);
        }
        if let Some((place, kind)) = self.checksum
            && usize::from(place) < data.len()
        {
            data[usize::from(place)] = kind.of(data, usize::from(place));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checksums_are_those_of_their_literature() {
        // Check value of CRC-8/SAE-J1850 over the digits 1 to 9; the checksum's own place is beyond them.
        assert_eq!(Checksum::Crc8J1850.of(b"123456789", 99), 0x4B);
        assert_eq!(Checksum::Xor.of(&[1, 2, 4, 99], 3), 7);
        assert_eq!(Checksum::Sum.of(&[200, 100, 99], 2), 44);
    }

    #[test]
    fn frames_that_are_wrong_or_repeated_are_not_used() {
        let counter = Signal::parse("0|4@1+", 8).unwrap();
        let guard = Guard { counter: Some(counter), checksum: Some((7, Checksum::Xor)) };
        let frame = |count| {
            let mut data = [0, 1, 2, 3, 4, 5, 6, 0];
            guard.seal(count, &mut data);
            data
        };
        let mut last = None;
        assert_eq!(guard.judge(&frame(14), &mut last), Verdict::Good(0));
        assert_eq!(guard.judge(&frame(15), &mut last), Verdict::Good(0));
        assert_eq!(guard.judge(&frame(16), &mut last), Verdict::Good(0));
        assert_eq!(guard.judge(&frame(16), &mut last), Verdict::Counter);
        assert_eq!(guard.judge(&frame(19), &mut last), Verdict::Good(2));
        let mut wrong = frame(20);
        wrong[3] ^= 0x10;
        assert_eq!(guard.judge(&wrong, &mut last), Verdict::Checksum);
        assert_eq!(guard.judge(&[0; 3], &mut last), Verdict::Checksum);
    }
}
