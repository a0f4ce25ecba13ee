//! Operations on every channel that a stage reads.

use super::Accounting;
use crate::{channel::Reader, message::Message};

/// Visits the channels of a stage, one after the other.
pub enum Channels<'a> {
    /// Adds the state of each channel to the heartbeat.
    Account(&'a mut Accounting),
    /// Attaches to each channel anew.
    Reattach,
}

impl Channels<'_> {
    /// Visits the next channel.
    pub fn visit<M: Message>(&mut self, reader: &mut Reader<M>) {
        match self {
            Self::Account(accounting) => accounting.channel(reader),
            Self::Reattach => reader.reattach(),
        }
    }
}
