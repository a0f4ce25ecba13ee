//! The messages that stages exchange, by message.
//!
//! | file | messages | from | to |
//! |---|---|---|---|
//! | `encoder` | [`EncoderReading`] | plant-sim or a bus | sensor-proc |
//! | `encoder` | [`EncoderSample`] | sensor-proc | ident-proc, control-proc |
//! | `command` | [`ValveCommand`] | control-proc or a replay | plant-sim, ident-proc |
//! | `snapshot` | [`CoefficientSnapshot`] | ident-proc | control-proc |
//! | `reference` | [`Reference`] | any program | control-proc |
//! | `request` | [`Request`] | any program | control-proc |
//! | `health` | [`StageHealth`] | every stage | supervisor, clients |
//! | `machine_state` | [`MachineState`] | control-proc | clients |
//!
//! A message is a struct of plain numbers in fixed arrays. One message holds all axes, so that a tick is atomic. Every
//! message starts with a [`Header`], which names the sample that caused the message. The `type_name` of a message
//! carries a version. Any change of a message raises its version; the fingerprint of [`crate::layout`] detects a change
//! whose version was not raised.

use iceoryx2::prelude::ZeroCopySend;

use crate::layout::{Layout, shared_struct};

/// Names of all channels, in the order of the data.
pub const CHANNELS: [&str; 8] = [
    "encoder-reading",
    "encoder-sample",
    "valve-command",
    "coefficient-snapshot",
    "reference",
    "request",
    "stage-health",
    "machine-state",
];

/// A message that has a channel.
pub trait Message: ZeroCopySend + Layout + Copy + Default + std::fmt::Debug + 'static {
    /// Name of the channel: the last part of the service name `hydraxis/<channel>`.
    const CHANNEL: &'static str;
    /// Largest number of publishers that the channel takes at the same time.
    const MAX_PUBLISHERS: usize;
    /// Number of messages that a reader can fall behind before it loses the oldest one.
    const BUFFER: usize;
    /// Whether programs that the supervisor has not started send it. It is refused when it does not say for which
    /// machine it is.
    const IS_FROM_CLIENTS: bool;

    /// The header: which sample caused the message, and when.
    fn header(&self) -> &Header;
    /// The header, to be filled in.
    fn header_mut(&mut self) -> &mut Header;
}

macro_rules! message {
    ($name:ident, $channel:literal, publishers $publishers:literal, buffer $buffer:literal) => {
        message!($name, $channel, publishers $publishers, buffer $buffer, from clients false);
    };
    (
        $name:ident, $channel:literal, publishers $publishers:literal, buffer $buffer:literal,
        from clients $is_from_clients:literal
    ) => {
        impl Message for $name {
            const CHANNEL: &'static str = $channel;
            const MAX_PUBLISHERS: usize = $publishers;
            const BUFFER: usize = $buffer;
            const IS_FROM_CLIENTS: bool = $is_from_clients;
            fn header(&self) -> &Header {
                &self.header
            }
            fn header_mut(&mut self) -> &mut Header {
                &mut self.header
            }
        }
    };
}

mod command;
mod encoder;
mod health;
mod machine_state;
mod reference;
mod request;
mod snapshot;

pub use command::{
    AxisCommand, CommandInputs, ControlMode, REFUSALS, TeethState, TipState, ValveCommand, command_event, control_flag,
};
pub use encoder::{AxisSample, EncoderReading, EncoderSample, EncoderValue, sample_fault};
pub use health::{ChannelHealth, MissCause, MissedDeadlines, StageHealth, StageState};
pub use machine_state::{AxisState, MachineState};
pub use reference::{MAX_PREVIEW, Reference};
pub use request::{AxisMode, AxisRequest, Request};
pub use snapshot::{AxisSnapshot, CoefficientSnapshot, MEMBERS, ModelErrors, model_fault};

shared_struct! {
    /// The first field of every message.
    #[type_name("hydraxis.Header/2")]
    pub struct Header {
        /// Number of the sample that caused the message: the index of its tick since the start of the source.
        /// An [`EncoderReading`] counts its own readings. A gap in the numbers is a tick that no stage worked.
        pub sequence: u64,
        /// Number of this message on its channel, from 0 on; the publisher fills it in. A gap is a lost message.
        pub number: u64,
        /// Time of the acquisition of that sample, ns of `CLOCK_MONOTONIC`.
        pub acquired_ns: u64,
        /// Time of sending this message, ns of `CLOCK_MONOTONIC`.
        pub sent_ns: u64,
        /// Number of the life of the publisher, which no publisher before had; the publisher fills it in. Another one
        /// tells a start from a repetition.
        pub session: u64,
        /// Number of axes in the arrays; the entries beyond it are zero.
        pub axis_count: u32,
        /// The machine that the message is about: the lower half of its fingerprint, which is never 0. 0 does not say
        /// which. The publisher fills it in.
        pub machine: u32,
    }
}

/// Names of the set bits, for messages to people.
pub fn bit_names<'a>(bits: u32, names: &'a [&'a str]) -> impl Iterator<Item = &'a str> {
    names.iter().enumerate().filter(move |(i, _)| bits & (1 << i) != 0).map(|(_, name)| *name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_channel_has_its_name_in_the_list() {
        let channels = [
            EncoderReading::CHANNEL,
            EncoderSample::CHANNEL,
            ValveCommand::CHANNEL,
            CoefficientSnapshot::CHANNEL,
            Reference::CHANNEL,
            Request::CHANNEL,
            StageHealth::CHANNEL,
            MachineState::CHANNEL,
        ];
        assert_eq!(channels, CHANNELS);
    }
}
