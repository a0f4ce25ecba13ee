//! Any bytes as a recording: read as far as it goes, or refused, within bounded memory.
//!
//! The command is a program and no library, so its modules are taken by their files.
#![allow(dead_code, reason = "a target uses a part of what the command needs")]

#[path = "../../src/recording/reading.rs"]
mod reading;
#[path = "../../src/recording/schema.rs"]
mod schema;

use std::{collections::BTreeMap, io::Cursor, path::Path};

#[cfg(test)]
use pipeline::cdr;
use reading::Reading;

type Facts = BTreeMap<String, String>;

const FACTS: &str = "hydraxis";
fn axes_in(facts: &Facts) -> Vec<String> {
    facts.get("axes").into_iter().cloned().collect()
}

const END_FACTS: &str = "hydraxis.end";

/// Reads a recording with all values of all messages.
pub fn recording(data: &[u8]) {
    let mut reading = Reading::of(Path::new("recording"), Cursor::new(data.to_vec()));
    while let Ok(Some(message)) = reading.next() {
        let values = message.channel.columns.iter().filter(|column| column.value(&message.bytes).is_some());
        assert!(values.count() <= message.bytes.len());
    }
    assert!(reading.damage().is_none_or(|damage| damage.byte <= data.len() as u64));
}
