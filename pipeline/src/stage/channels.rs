//! What is done to every channel that a stage reads.

use super::Accounting;
use crate::{channel::Reader, message::Message};

/// Visits the channels of a stage, one after the other.
pub enum Channels<'a> {
    /// Takes in how they are doing.
    Account(&'a mut Accounting),
    /// Attaches to them anew.
    Reattach,
}

impl Channels<'_> {
    /// The next one.
    pub fn visit<M: Message>(&mut self, reader: &mut Reader<M>) {
        match self {
            Self::Account(accounting) => accounting.channel(reader),
            Self::Reattach => reader.reattach(),
        }
    }
}
