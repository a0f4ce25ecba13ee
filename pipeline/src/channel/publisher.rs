//! The writing end of a channel.

use std::cell::Cell;

use iceoryx2::port::{publisher::Publisher as Port, update_connections::UpdateConnections};

use super::{error::SendError, service::Service};
use crate::{clock::monotonic_ns, message::Message};

/// Writes messages of one kind and numbers them. It never waits for a reader and allocates nothing.
pub struct Publisher<M: Message> {
    port: Port<Service, M, ()>,
    next: Cell<u64>,
    session: u64,
    machine: u32,
}

impl<M: Message> Publisher<M> {
    pub(super) fn new(port: Port<Service, M, ()>, machine: u32) -> Self {
        Self { port, next: Cell::new(0), session: monotonic_ns(), machine }
    }

    /// Sends a message, with its number, session and machine, to all readers. A reader whose buffer is full loses its
    /// oldest message.
    ///
    /// # Errors
    /// iceoryx2 cannot lend shared memory; this does not happen within the limits of the channel.
    pub fn send(&self, message: &M) -> Result<(), SendError> {
        let channel = M::CHANNEL;
        let sample = self.port.loan_uninit().map_err(|source| SendError::Loan { channel, source })?;
        let mut sample = sample.write_payload(*message);
        let number = self.next.get();
        let header = sample.payload_mut().header_mut();
        (header.number, header.session) = (number, self.session);
        // A program that was there before its group copies the number from the messages that it reads.
        if self.machine != 0 {
            header.machine = self.machine;
        }
        self.next.set(number + 1);
        sample.send().map_err(|source| SendError::Deliver { channel, source })?;
        Ok(())
    }

    /// Delivers the newest message to readers that have attached since it was sent.
    pub fn greet(&self) {
        // This fails while a reader is leaving, which needs no reaction.
        let _ = self.port.update_connections();
    }
}
