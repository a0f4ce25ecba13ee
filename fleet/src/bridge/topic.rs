//! The keys that a bridge publishes.

use pipeline::message::{CoefficientSnapshot, EncoderSample, MachineState, Message, StageHealth, ValveCommand};
use zenoh::qos::Priority;

use crate::{content, key, stamp::Stamp};

/// One key of a bridge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Topic {
    /// Positions.
    Sample,
    /// Valve commands.
    Command,
    /// Names, modes and models of the axes.
    State,
    /// Heartbeats.
    Health,
    /// Models.
    Model,
    /// State of bridge and group.
    Status,
    /// Events.
    Event,
}

impl Topic {
    /// All of them, in the order of their numbers.
    pub const ALL: [Self; 7] =
        [Self::Sample, Self::Command, Self::State, Self::Health, Self::Model, Self::Status, Self::Event];

    /// What is behind the machine in its key.
    pub fn key(self) -> String {
        match self {
            Self::Sample => key::telemetry(EncoderSample::CHANNEL),
            Self::Command => key::telemetry(ValveCommand::CHANNEL),
            Self::State => key::telemetry(MachineState::CHANNEL),
            Self::Health => key::telemetry(StageHealth::CHANNEL),
            Self::Model => key::MODEL.to_owned(),
            Self::Status => key::STATUS.to_owned(),
            Self::Event => key::EVENTS.to_owned(),
        }
    }

    /// Name of the encoding of its payload.
    pub fn encoding(self) -> String {
        match self {
            Self::Sample => content::name_of::<EncoderSample>(),
            Self::Command => content::name_of::<ValveCommand>(),
            Self::State => content::name_of::<MachineState>(),
            Self::Health => content::name_of::<StageHealth>(),
            Self::Model => content::name_of::<CoefficientSnapshot>(),
            Self::Status => content::name_of_json(content::STATUS),
            Self::Event => content::name_of_json(content::EVENT),
        }
    }

    /// What goes first where a link is thin: each priority has a queue of its own.
    pub fn priority(self) -> Priority {
        match self {
            Self::Status | Self::Event => Priority::DataHigh,
            Self::Sample | Self::Command | Self::State | Self::Health => Priority::Data,
            Self::Model => Priority::DataLow,
        }
    }
}

/// A message on its way to the network.
#[derive(Debug, Clone)]
pub struct Outgoing {
    /// Its key.
    pub topic: Topic,
    /// Its attachment.
    pub stamp: Stamp,
    /// Its bytes.
    pub payload: Vec<u8>,
}
