//! What a payload holds, as its encoding says.
//!
//! | payload | encoding |
//! |---|---|
//! | a message of a channel, CDR as in recordings | `application/cdr;hydraxis/msg/TYPE:LAYOUT` |
//! | a state, an event, a list | `application/json;hydraxis/WHAT/VERSION` |
//!
//! LAYOUT is the fingerprint of the message's fields ([`pipeline::layout`]), as the channels of a group carry it. A
//! reader that does not know it refuses the message: the bytes could mean something else.

use pipeline::{
    cdr,
    layout::Layout,
    message::{CoefficientSnapshot, EncoderSample, MachineState, Message, StageHealth, ValveCommand},
};
use serde_json::Value;
use thiserror::Error;

/// State of a bridge and its group, as JSON.
pub const STATUS: &str = "hydraxis/status/1";
/// An event, or a list of events, as JSON.
pub const EVENT: &str = "hydraxis/event/1";
/// A list of recordings, as JSON.
pub const RECORDINGS: &str = "hydraxis/recordings/1";

/// Why a payload is not read.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum ContentError {
    /// It was written by another version, or is of another program.
    #[error("found the encoding \"{found}\"; allowed: {allowed}")]
    Unknown {
        /// Its encoding.
        found: String,
        /// That of the only message of this key.
        allowed: String,
    },
    /// It does not hold what its encoding says.
    #[error("found {bytes} bytes that are no {encoding}")]
    Malformed {
        /// Its length.
        bytes: usize,
        /// Its encoding.
        encoding: String,
    },
}

/// The encoding of a message, as text.
pub fn name_of<M: Message>() -> String {
    format!("application/cdr;{}:{:016x}", cdr::type_name::<M>(), <M as Layout>::LAYOUT)
}

/// The encoding of JSON with this schema, as text.
pub fn name_of_json(schema: &str) -> String {
    format!("application/json;{schema}")
}

/// Reads a message.
///
/// # Errors
/// Its encoding is that of another message or version, or the bytes are not one message.
pub fn message<M: Message>(encoding: &str, bytes: &[u8]) -> Result<M, ContentError> {
    expect(encoding, name_of::<M>())?;
    let malformed = || ContentError::Malformed { bytes: bytes.len(), encoding: encoding.to_owned() };
    cdr::decode(bytes).filter(|_| bytes.len() == cdr::ENCAPSULATION.len() + size_of::<M>()).ok_or_else(malformed)
}

/// Reads JSON.
///
/// # Errors
/// Its encoding is another one, or it is no JSON.
pub fn json(schema: &str, encoding: &str, bytes: &[u8]) -> Result<Value, ContentError> {
    expect(encoding, name_of_json(schema))?;
    let malformed = |_| ContentError::Malformed { bytes: bytes.len(), encoding: encoding.to_owned() };
    serde_json::from_slice(bytes).map_err(malformed)
}

fn expect(found: &str, allowed: String) -> Result<(), ContentError> {
    if found == allowed { Ok(()) } else { Err(ContentError::Unknown { found: found.to_owned(), allowed }) }
}

/// What a receiver keeps of a machine: the newest of each kind.
#[derive(Debug, Clone)]
pub enum Content {
    /// Positions.
    Sample(Box<EncoderSample>),
    /// Valve commands.
    Command(Box<ValveCommand>),
    /// Names, modes and models of the axes.
    State(Box<MachineState>),
    /// Heartbeat of a stage.
    Health(Box<StageHealth>),
    /// Models.
    Model(Box<CoefficientSnapshot>),
    /// State of the bridge.
    Status(Value),
    /// An event.
    Event(Value),
}

impl Content {
    /// Reads what stands under a key of a machine; none for a key that is not published.
    ///
    /// # Errors
    /// As [`message`] and [`json`].
    pub fn of(key: &str, encoding: &str, bytes: &[u8]) -> Option<Result<Self, ContentError>> {
        fn boxed<M: Message>(
            into: impl Fn(Box<M>) -> Content,
            encoding: &str,
            bytes: &[u8],
        ) -> Result<Content, ContentError> {
            message(encoding, bytes).map(Box::new).map(into)
        }
        Some(match key.strip_prefix("telemetry/").unwrap_or(key) {
            EncoderSample::CHANNEL => boxed(Self::Sample, encoding, bytes),
            ValveCommand::CHANNEL => boxed(Self::Command, encoding, bytes),
            MachineState::CHANNEL => boxed(Self::State, encoding, bytes),
            StageHealth::CHANNEL => boxed(Self::Health, encoding, bytes),
            crate::key::MODEL => boxed(Self::Model, encoding, bytes),
            crate::key::STATUS => json(STATUS, encoding, bytes).map(Self::Status),
            crate::key::EVENTS => json(EVENT, encoding, bytes).map(Self::Event),
            _ => return None,
        })
    }
}

/// How the messages of a key stand in a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Schema {
    /// Name of the type.
    pub name: String,
    /// Form of the text below.
    pub encoding: &'static str,
    /// The schema.
    pub text: String,
    /// Form of a message.
    pub message_encoding: &'static str,
}

impl Schema {
    /// Of JSON objects.
    pub fn of_json(name: &str) -> Self {
        let text = r#"{"type":"object"}"#.to_owned();
        Self { name: name.to_owned(), encoding: "jsonschema", text, message_encoding: "json" }
    }

    fn of_cdr<M: Message>() -> Self {
        let (name, text) = (cdr::type_name::<M>(), cdr::schema::<M>());
        Self { name, encoding: "ros2msg", text, message_encoding: "cdr" }
    }

    /// Of what stands under a key of a machine; none for a key that is not published.
    pub fn of(key: &str) -> Option<Self> {
        Some(match key.strip_prefix("telemetry/").unwrap_or(key) {
            EncoderSample::CHANNEL => Self::of_cdr::<EncoderSample>(),
            ValveCommand::CHANNEL => Self::of_cdr::<ValveCommand>(),
            MachineState::CHANNEL => Self::of_cdr::<MachineState>(),
            StageHealth::CHANNEL => Self::of_cdr::<StageHealth>(),
            crate::key::MODEL => Self::of_cdr::<CoefficientSnapshot>(),
            crate::key::STATUS => Self::of_json(STATUS),
            crate::key::EVENTS => Self::of_json(EVENT),
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_comes_back_by_its_encoding_only() {
        let mut sample = EncoderSample::default();
        (sample.header.sequence, sample.axes[3].position) = (9, 0.25);
        let mut bytes = Vec::new();
        cdr::encode(&sample, &mut bytes);
        let name = name_of::<EncoderSample>();
        assert!(name.starts_with("application/cdr;hydraxis/msg/EncoderSample:"), "{name}");
        // Zenoh sends a known beginning as a number; the text has to come back.
        assert_eq!(zenoh::bytes::Encoding::from(name.as_str()).to_string(), name);
        assert_eq!(message::<EncoderSample>(&name, &bytes), Ok(sample));

        let mut other = name.clone();
        let last = if other.pop() == Some('0') { '1' } else { '0' };
        other.push(last);
        let error = message::<EncoderSample>(&other, &bytes).unwrap_err();
        assert_eq!(error, ContentError::Unknown { found: other, allowed: name.clone() });
        assert!(message::<ValveCommand>(&name, &bytes).is_err());
        for wrong in [&bytes[..bytes.len() - 1], &[&bytes[..], &[0]].concat(), &[]] {
            let error = message::<EncoderSample>(&name, wrong).unwrap_err();
            assert!(matches!(error, ContentError::Malformed { .. }), "{error}");
        }
    }

    #[test]
    fn a_key_that_nobody_publishes_has_no_content() {
        assert!(Content::of("telemetry/request", "application/cdr", &[]).is_none());
        let json = name_of_json(STATUS);
        assert!(matches!(Content::of("status", &json, b"{}"), Some(Ok(Content::Status(_)))));
        assert!(matches!(Content::of("status", &json, b"{"), Some(Err(ContentError::Malformed { .. }))));
        assert!(matches!(Content::of("status", "application/json", b"{}"), Some(Err(ContentError::Unknown { .. }))));
    }
}
