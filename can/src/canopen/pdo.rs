//! Process data: up to 64 bits of objects, one after the other.
//!
//! ```text
//! entry of 1600h.., 1A00h..  =  index << 16 | subindex << 8 | bits
//! ```
//!
//! The first object has the lowest bits of the first byte. Objects need not begin at a byte.

use embedded_can::Frame as _;

use crate::{Frame, MAX_DATA};

use super::Object;

/// Most objects of one message here.
pub const MAX_ENTRIES: usize = 8;
/// Bits of a message.
const MAX_BITS: u32 = 64;

/// An object in a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mapped {
    /// Which object.
    pub object: Object,
    /// Its bits, 1 to 64.
    pub bits: u8,
}

impl Mapped {
    /// The value of the entry in 1600h.. or 1A00h...
    pub fn entry(self) -> u32 {
        u32::from(self.object.index) << 16 | u32::from(self.object.sub) << 8 | u32::from(self.bits)
    }
}

/// Which objects a message has, in their order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mapping {
    entries: [Mapped; MAX_ENTRIES],
    count: usize,
    bits: u32,
}

/// Objects that are no message.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("found {entries} objects with {bits} bits; allowed: 1 to 8 objects of 1 to 64 bits each, 64 bits together")]
pub struct MappingError {
    entries: usize,
    bits: u32,
}

impl Mapping {
    /// A message with these objects.
    ///
    /// # Errors
    /// There is none, more than [`MAX_ENTRIES`], one without bits, or more than 64 bits.
    pub fn new(objects: &[Mapped]) -> Result<Self, MappingError> {
        let bits = objects.iter().map(|mapped| u32::from(mapped.bits)).sum();
        let is_sound = (1..=MAX_ENTRIES).contains(&objects.len()) && objects.iter().all(|mapped| mapped.bits > 0);
        if !is_sound || bits > MAX_BITS {
            return Err(MappingError { entries: objects.len(), bits });
        }
        let mut entries = [objects[0]; MAX_ENTRIES];
        entries[..objects.len()].copy_from_slice(objects);
        Ok(Self { entries, count: objects.len(), bits })
    }

    /// The objects.
    pub fn objects(&self) -> &[Mapped] {
        &self.entries[..self.count]
    }

    /// Bytes of the message.
    pub fn length(&self) -> usize {
        self.bits.div_ceil(8) as usize
    }

    /// The values of all objects, without their signs; `None` where the message is too short. Entries beyond the
    /// objects are 0.
    pub fn unpack(&self, frame: &Frame) -> Option<[u64; MAX_ENTRIES]> {
        let mut bytes = [0; MAX_DATA];
        let data = frame.data().get(..self.length())?;
        bytes[..data.len()].copy_from_slice(data);
        let (mut rest, mut values) = (u64::from_le_bytes(bytes), [0; MAX_ENTRIES]);
        for (value, mapped) in values.iter_mut().zip(self.objects()) {
            *value = rest & mask(mapped.bits);
            rest = rest.checked_shr(u32::from(mapped.bits)).unwrap_or(0);
        }
        Some(values)
    }

    /// The message with these values, of which the lowest bits count. Objects without a value are 0.
    pub fn pack(&self, id: u16, values: &[u64]) -> Frame {
        let (mut all, mut place) = (0_u64, 0);
        for (mapped, value) in self.objects().iter().zip(values) {
            all |= (value & mask(mapped.bits)).checked_shl(place).unwrap_or(0);
            place += u32::from(mapped.bits);
        }
        Frame::standard_of(id, all.to_le_bytes(), self.length())
    }
}

fn mask(bits: u8) -> u64 {
    u64::MAX.checked_shr(MAX_BITS.saturating_sub(u32::from(bits))).unwrap_or(0)
}

/// A value of so many bits with its sign.
pub fn signed(value: u64, bits: u8) -> i64 {
    let unused = MAX_BITS.saturating_sub(u32::from(bits)).min(MAX_BITS - 1);
    (value << unused) as i64 >> unused
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn mapped(bits: u8) -> Mapped {
        Mapped { object: Object { index: 0x6004, sub: 0 }, bits }
    }

    #[test]
    fn the_entry_of_the_position_is_that_of_the_manuals() {
        assert_eq!(mapped(32).entry(), 0x6004_0020);
    }

    #[test]
    fn a_message_has_at_most_64_bits() {
        assert!(Mapping::new(&[]).is_err() && Mapping::new(&[mapped(0)]).is_err());
        assert!(Mapping::new(&[mapped(64), mapped(1)]).is_err() && Mapping::new(&[mapped(1); 9]).is_err());
        assert_eq!(Mapping::new(&[mapped(12), mapped(5)]).unwrap().length(), 3);
    }

    #[test]
    fn signs_are_those_of_the_bits() {
        assert_eq!((signed(0xFFFF, 16), signed(0x7FFF, 16), signed(u64::MAX, 64)), (-1, 0x7FFF, -1));
        assert_eq!((signed(0xFFFF_FFFF, 32), signed(2, 2), signed(1, 1)), (-1, -2, -1));
    }

    proptest! {
        #[test]
        fn values_are_read_as_they_were_written(sizes in prop::collection::vec(1_u8..=16, 1..=4), raw: [u64; 4]) {
            let objects: Vec<_> = sizes.iter().map(|bits| mapped(*bits)).collect();
            let mapping = Mapping::new(&objects).unwrap();
            let found = mapping.unpack(&mapping.pack(0x181, &raw[..objects.len()])).unwrap();
            for (i, bits) in sizes.iter().enumerate() {
                prop_assert_eq!(found[i], raw[i] & mask(*bits));
            }
        }
    }
}
