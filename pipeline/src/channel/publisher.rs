//! The writing end of a channel.

use std::cell::Cell;

use iceoryx2::port::{publisher::Publisher as Port, update_connections::UpdateConnections};

use super::{ChannelError, service::Service};
use crate::message::Message;

/// Writes messages of one kind and numbers them; never waits for a reader, allocates nothing.
pub struct Publisher<M: Message> {
    port: Port<Service, M, ()>,
    next: Cell<u64>,
}

impl<M: Message> Publisher<M> {
    pub(super) fn new(port: Port<Service, M, ()>) -> Self {
        Self { port, next: Cell::new(0) }
    }

    /// Sends a message, with its number, to all readers; one whose buffer is full loses its oldest.
    ///
    /// # Errors
    /// The library cannot hand out shared memory: not possible within the limits of the channel.
    pub fn send(&self, message: &M) -> Result<(), ChannelError> {
        let refuse = |reason: String| ChannelError::Send { channel: M::CHANNEL, reason };
        let sample = self.port.loan_uninit().map_err(|error| refuse(format!("{error:?}")))?;
        let mut sample = sample.write_payload(*message);
        let number = self.next.get();
        sample.payload_mut().header_mut().number = number;
        self.next.set(number + 1);
        sample.send().map_err(|error| refuse(format!("{error:?}")))?;
        Ok(())
    }

    /// Hands the newest message to readers that have come since it was sent.
    pub fn greet(&self) {
        // A reader that is just leaving makes this fail; there is nothing to be done about it.
        let _ = self.port.update_connections();
    }
}
