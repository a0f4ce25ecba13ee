//! Whether the messages of a machine contradict each other.
//!
//! A drive that takes a set point for a state, or a state for a set point, moves an axis that nobody commands. All of
//! this can be seen in the machine file and its data base, before anything moves.

use std::collections::{BTreeMap, BTreeSet};

use can::{
    MAX_FD_DATA,
    device::Pattern,
    frames::{Message, Signal},
};
use pipeline::machine::Machine;

use crate::error::WiringError;

/// What a message is used for.
#[derive(Debug, Clone)]
struct Use {
    id: (u32, bool),
    is_sent: bool,
    /// Bits that have a meaning, with the key that gives it.
    parts: Vec<(String, Signal)>,
}

/// The messages of a machine, and what they are used for.
#[derive(Debug, Default)]
pub struct Uses(BTreeMap<String, Use>);

fn wrong(key: &str, found: impl std::fmt::Display, allowed: &str) -> WiringError {
    WiringError::Text(format!("{key}: found {found}; allowed: {allowed}"))
}

impl Uses {
    /// `key` gives a meaning to a signal of a message that is sent or received. Keys of one meaning may read one
    /// signal: the drives of several axes may have one state.
    ///
    /// # Errors
    /// The message is both sent and received, or some of these bits have another meaning.
    pub fn add(&mut self, key: &str, message: &Message, signal: Signal, is_sent: bool) -> Result<(), WiringError> {
        let id = (message.layout.id, message.layout.is_extended);
        let entry = self.0.entry(message.name.clone()).or_insert(Use { id, is_sent, parts: Vec::new() });
        if entry.is_sent != is_sent {
            let allowed = "a message that is either sent or received";
            return Err(wrong(key, format!("message {}, which is sent and received", message.name), allowed));
        }
        let is_shared = |(other, has): &&(String, Signal)| !is_sent && *has == signal && meaning(other) == meaning(key);
        expect_free(key, &signal, entry.parts.iter().filter(|part| !is_shared(part)))?;
        entry.parts.push((key.to_owned(), signal));
        Ok(())
    }

    /// Counter and checksum of a message, and the values that a state gives its signals.
    ///
    /// # Errors
    /// They overlap with each other or with what the message is used for.
    pub fn guarded(
        &self,
        message: &Message,
        own: &[(&str, Signal)],
        states: &[&Pattern; 3],
    ) -> Result<(), WiringError> {
        let key = |name: &str| format!("can.message \"{}\".{name}", message.name);
        let mut taken = self.0.get(&message.name).map_or_else(Vec::new, |used| used.parts.clone());
        for (name, signal) in own {
            expect_free(&key(name), signal, taken.iter())?;
            taken.push((key(name), *signal));
        }
        for (name, state) in ["active", "neutral", "off"].iter().zip(states) {
            for (i, (signal, _)) in state.iter().enumerate() {
                expect_free(&key(name), signal, taken.iter())?;
                if state[..i].iter().any(|(other, _)| other.overlaps(signal)) {
                    return Err(wrong(&key(name), "a bit with two values", "one value for each signal"));
                }
            }
        }
        let data = states.map(|state| {
            let mut data = [0; MAX_FD_DATA];
            state.iter().for_each(|(signal, value)| signal.put(*value, &mut data));
            data
        });
        let has_states = states.iter().any(|state| !state.is_empty());
        for (name, other) in [("neutral", data[1]), ("off", data[2])] {
            if has_states && data[0] == other {
                let allowed = "other values than active has: the drive would stay active";
                return Err(wrong(&key(name), "the values of active", allowed));
            }
        }
        Ok(())
    }

    /// # Errors
    /// Two messages have one identifier, or one has an identifier of CANopen that this machine uses.
    pub fn expect_identifiers(&self, machine: &Machine) -> Result<(), WiringError> {
        let wired = machine.axes.iter().filter_map(|axis| axis.can.as_ref());
        let nodes: BTreeSet<u32> =
            wired.flat_map(|wired| [wired.encoder, wired.valve]).flatten().map(u32::from).collect();
        let mut seen: BTreeMap<(u32, bool), &str> = BTreeMap::new();
        for (name, used) in &self.0 {
            let (id, is_extended) = used.id;
            let key = format!("can.message \"{name}\".id");
            if let Some(other) = seen.insert(used.id, name) {
                return Err(wrong(
                    &key,
                    format!("{id:X}h, which message {other} has"),
                    "one message of each identifier",
                ));
            }
            let of_a_node = nodes.contains(&(id & 0x7F)) || id & 0x7F == 0 && id <= 0x80;
            if !nodes.is_empty() && !is_extended && of_a_node {
                let allowed = "an identifier that is none of CANopen's: 0, 80h, nor one of a node";
                return Err(wrong(&key, format!("{id:X}h"), allowed));
            }
        }
        Ok(())
    }
}

/// What a key says a signal is: its last part. Where the pilot pressure is cut off, no drive follows.
fn meaning(key: &str) -> Option<&str> {
    key.rsplit('.').next().map(|name| if name == "pilot" { "active" } else { name })
}

/// Refuses a signal whose bits have a meaning already.
fn expect_free<'t>(
    key: &str,
    signal: &Signal,
    mut taken: impl Iterator<Item = &'t (String, Signal)>,
) -> Result<(), WiringError> {
    match taken.find(|(_, other)| other.overlaps(signal)) {
        Some((other, _)) => Err(wrong(key, format!("bits that {other} has"), "a signal with bits of its own")),
        None => Ok(()),
    }
}
