//! The attachment of every message: which life of the bridge has sent it, its number, and how old it is.
//!
//! ```text
//! byte  0  run             u64  life of the bridge: the time of its start, ns since 1970
//! byte  8  number          u64  number of the message on its key in this run, from 0 on; a gap is a lost message
//! byte 16  utc_ns          i64  when the sample in it was acquired, ns since 1970 by the clock of the machine
//! byte 24  clock_error_ns  u64  largest error of that clock by its kernel, ns; 2^64 - 1: not synchronised
//! ```
//!
//! All are little-endian. Zenoh delivers messages that were queued for tens of seconds as it does new ones, so a reader
//! has to judge by `utc_ns`.

/// Bytes of an attachment.
pub const LENGTH: usize = 32;
/// `clock_error_ns` of a clock that nothing synchronises.
pub const NOT_SYNCHRONISED: u64 = u64::MAX;

/// What travels beside a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamp {
    /// Life of the bridge.
    pub run: u64,
    /// Number of the message on its key.
    pub number: u64,
    /// When the sample was acquired, ns since 1970.
    pub utc_ns: i64,
    /// Largest error of the machine's clock, ns.
    pub clock_error_ns: u64,
}

impl Stamp {
    /// As an attachment.
    pub fn to_bytes(self) -> [u8; LENGTH] {
        let mut bytes = [0; LENGTH];
        let numbers = [self.run, self.number, self.utc_ns as u64, self.clock_error_ns];
        for (place, number) in bytes.chunks_exact_mut(8).zip(numbers) {
            place.copy_from_slice(&number.to_le_bytes());
        }
        bytes
    }

    /// Age at `now_ns`, ns; negative where its time is still to come. Ages beyond the range become its ends.
    pub fn age_ns(self, now_ns: i64) -> i64 {
        now_ns.saturating_sub(self.utc_ns)
    }

    /// Out of an attachment; none where it has another length.
    pub fn of(bytes: &[u8]) -> Option<Self> {
        let bytes: &[u8; LENGTH] = bytes.try_into().ok()?;
        let number = |i: usize| u64::from_le_bytes(std::array::from_fn(|byte| bytes[8 * i + byte]));
        Some(Self { run: number(0), number: number(1), utc_ns: number(2) as i64, clock_error_ns: number(3) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stamp_comes_back_and_another_length_is_refused() {
        let stamp = Stamp { run: 1, number: 1 << 40, utc_ns: -5, clock_error_ns: NOT_SYNCHRONISED };
        let bytes = stamp.to_bytes();
        assert_eq!((bytes[0], bytes[16], bytes[24]), (1, 0xfb, 0xff));
        assert_eq!(Stamp::of(&bytes), Some(stamp));
        assert_eq!(Stamp::of(&bytes[1..]), None);
        assert_eq!(Stamp::of(&[&bytes[..], &[0]].concat()), None);
    }
}
