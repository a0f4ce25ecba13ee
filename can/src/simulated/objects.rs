//! An object dictionary: objects with their values.

use crate::canopen::{AbortCode, Dictionary, MAX_VALUE, Object};

#[derive(Debug, Clone)]
struct Entry {
    object: Object,
    value: Vec<u8>,
    is_read_only: bool,
}

/// Objects of a device.
#[derive(Debug, Clone, Default)]
pub(super) struct Objects {
    entries: Vec<Entry>,
}

impl Objects {
    /// Adds an object whose value has so many bytes.
    pub fn add(&mut self, index: u16, sub: u8, number: u64, bytes: usize, is_read_only: bool) {
        let value = number.to_le_bytes()[..bytes.min(8)].to_vec();
        self.entries.push(Entry { object: Object::new(index, sub), value, is_read_only });
    }

    /// Adds an object with a text, which can only be read.
    pub fn add_text(&mut self, index: u16, text: &str) {
        let value = text.as_bytes()[..text.len().min(MAX_VALUE)].to_vec();
        self.entries.push(Entry { object: Object::new(index, 0), value, is_read_only: true });
    }

    /// Adds the parameters and the mapping of a message. `parameters` is 1400h.. or 1800h...
    pub fn add_message(&mut self, parameters: u16, id: u16, entries: &[u32]) {
        self.add(parameters, 1, u64::from(id), 4, false);
        self.add(parameters, 2, 255, 1, false);
        self.add(parameters, 5, 0, 2, false);
        self.add(parameters + 0x200, 0, entries.len() as u64, 1, false);
        for sub in 1..=4_u8 {
            let entry = entries.get(usize::from(sub) - 1).copied().unwrap_or_default();
            self.add(parameters + 0x200, sub, entry.into(), 4, false);
        }
    }

    fn find(&self, object: Object) -> Option<&Entry> {
        self.entries.iter().find(|entry| entry.object == object)
    }

    /// The value as a number; 0 of an object that is not there.
    pub fn number(&self, index: u16, sub: u8) -> u64 {
        let mut bytes = [0; 8];
        if let Some(entry) = self.find(Object::new(index, sub)) {
            let length = entry.value.len().min(bytes.len());
            bytes[..length].copy_from_slice(&entry.value[..length]);
        }
        u64::from_le_bytes(bytes)
    }

    /// Sets the value of an object that is there.
    pub fn set(&mut self, index: u16, sub: u8, number: u64) {
        if let Some(entry) = self.entries.iter_mut().find(|entry| entry.object == Object::new(index, sub)) {
            let length = entry.value.len();
            entry.value.copy_from_slice(&number.to_le_bytes()[..length]);
        }
    }

    /// Values that are mapped into a message, as one number, and its bits.
    pub fn mapped(&self, mapping: u16) -> (u64, u32) {
        let (mut all, mut place) = (0, 0);
        for sub in 1..=self.number(mapping, 0) as u8 {
            let entry = self.number(mapping, sub) as u32;
            let bits = entry & 0xFF;
            let value = self.number((entry >> 16) as u16, (entry >> 8) as u8);
            let mask = u64::MAX.checked_shr(64_u32.saturating_sub(bits)).unwrap_or(0);
            all |= (value & mask).checked_shl(place).unwrap_or(0);
            place += bits;
        }
        (all, place)
    }
}

impl Dictionary for Objects {
    fn read(&self, object: Object, value: &mut [u8; MAX_VALUE]) -> Result<usize, AbortCode> {
        let entry = self.find(object).ok_or(AbortCode::NO_OBJECT)?;
        value[..entry.value.len()].copy_from_slice(&entry.value);
        Ok(entry.value.len())
    }

    fn write(&mut self, object: Object, value: &[u8]) -> Result<(), AbortCode> {
        let is_there = |entry: &&mut Entry| entry.object == object;
        let entry = self.entries.iter_mut().find(is_there).ok_or(AbortCode::NO_OBJECT)?;
        if entry.is_read_only {
            return Err(AbortCode::READ_ONLY);
        }
        if entry.value.len() != value.len() {
            return Err(AbortCode::LENGTH);
        }
        entry.value.copy_from_slice(value);
        Ok(())
    }
}
