//! The attachment of a request to the plant.
//!
//! ```text
//! byte  0  run      u64  run of the stage: the time of its start, ns since 1970
//! byte  8  reading  u64  number of the reading that is asked for, from 0 on; 2^64 - 1 ends the run
//! byte 16  seed     u64  seed of the simulated noise
//! byte 24  machine  u64  what is simulated, by `simulated`
//! ```
//!
//! All are little-endian. The payload is the `ValveCommand` that answers the reading before, as CDR; for reading 0 a
//! command that is all zero, and for the end of a run nothing.

/// Bytes of an attachment.
const LENGTH: usize = 32;
/// `reading` of the request that ends a run.
pub const END: u64 = u64::MAX;

/// What a stage asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Request {
    /// Run of the stage.
    pub run: u64,
    /// Number of the reading, or [`END`].
    pub reading: u64,
    /// Seed of the simulated noise.
    pub seed: u64,
    /// What is simulated, by [`simulated`](super::simulated).
    pub machine: u64,
}

impl Request {
    /// As an attachment.
    pub fn to_bytes(self) -> [u8; LENGTH] {
        let mut bytes = [0; LENGTH];
        let numbers = [self.run, self.reading, self.seed, self.machine];
        for (place, number) in bytes.chunks_exact_mut(8).zip(numbers) {
            place.copy_from_slice(&number.to_le_bytes());
        }
        bytes
    }

    /// Out of an attachment; none where it has another length.
    pub fn of(bytes: &[u8]) -> Option<Self> {
        let bytes: &[u8; LENGTH] = bytes.try_into().ok()?;
        let number = |i: usize| u64::from_le_bytes(std::array::from_fn(|byte| bytes[8 * i + byte]));
        Some(Self { run: number(0), reading: number(1), seed: number(2), machine: number(3) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_comes_back_and_another_length_is_refused() {
        let request = Request { run: 1, reading: END, seed: 7, machine: 1 << 40 };
        let bytes = request.to_bytes();
        assert_eq!((bytes[0], bytes[8], bytes[16], bytes[29]), (1, 0xff, 7, 1));
        assert_eq!(Request::of(&bytes), Some(request));
        assert_eq!(Request::of(&bytes[1..]), None);
    }
}
