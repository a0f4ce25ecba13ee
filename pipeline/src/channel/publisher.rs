//! The writing end of a channel.

use iceoryx2::port::{publisher::Publisher as Port, update_connections::UpdateConnections};

use super::{ChannelError, service::Service};
use crate::message::Message;

/// Writes messages of one kind; never waits for a reader, allocates nothing.
pub struct Publisher<M: Message> {
    port: Port<Service, M, ()>,
}

impl<M: Message> Publisher<M> {
    pub(super) fn new(port: Port<Service, M, ()>) -> Self {
        Self { port }
    }

    /// Sends a message to all readers; one whose buffer is full loses its oldest.
    ///
    /// # Errors
    /// The library cannot hand out shared memory: not possible within the limits of the channel.
    pub fn send(&self, message: &M) -> Result<(), ChannelError> {
        let refuse = |reason: String| ChannelError::Send { channel: M::CHANNEL, reason };
        let sample = self.port.loan_uninit().map_err(|error| refuse(format!("{error:?}")))?;
        sample.write_payload(*message).send().map_err(|error| refuse(format!("{error:?}")))?;
        Ok(())
    }

    /// Hands the newest message to readers that have come since it was sent.
    pub fn greet(&self) {
        // A reader that is just leaving makes this fail; there is nothing to be done about it.
        let _ = self.port.update_connections();
    }
}
