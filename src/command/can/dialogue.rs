//! Objects of a device, read and written one by one.

use std::time::Duration;

use can::{
    Frame, Received,
    bus::{Bus, BusError},
    canopen::{NodeId, Object, SdoClient, SdoError, SdoEvent},
};
use pipeline::stage::monotonic_ns;
use thiserror::Error;

/// Why an object was not read or written.
#[derive(Debug, Error)]
pub enum DialogueError {
    /// The device refuses, is silent, or answers wrongly.
    #[error("node {}: {source}{}", .node.number(), advice(.source))]
    Device {
        /// The device.
        node: NodeId,
        /// What it says.
        source: SdoError,
    },
    /// The bus is gone.
    #[error("the bus: {0}")]
    Bus(#[from] BusError),
}

fn advice(error: &SdoError) -> &'static str {
    match error {
        SdoError::Silent(_) => {
            "; check power, wiring, bit rate and number of the node: `hydraxis can scan` shows the nodes that answer"
        }
        _ => "",
    }
}

/// Dialogues on a bus with one device at a time.
pub struct Dialogue<'b> {
    /// The bus.
    pub bus: &'b mut dyn Bus,
    /// Longest time of an answer.
    pub patience: Duration,
}

impl Dialogue<'_> {
    /// The value of an object.
    ///
    /// # Errors
    /// The device refuses, is silent, or the bus is gone.
    pub fn read(&mut self, node: NodeId, object: Object) -> Result<Vec<u8>, DialogueError> {
        let mut client = SdoClient::new(node, self.patience.as_nanos() as u64);
        let first = client.read(object, monotonic_ns());
        self.talk(node, &mut client, first)?;
        Ok(client.value().to_vec())
    }

    /// The value of an object as a number.
    ///
    /// # Errors
    /// Those of [`Self::read`]; a value of no bytes, or of more than 8, is `None`.
    pub fn number(&mut self, node: NodeId, object: Object) -> Result<Option<u64>, DialogueError> {
        Ok(number(&self.read(node, object)?))
    }

    /// Sets an object. The value has 1 to [`can::canopen::MAX_VALUE`] bytes.
    ///
    /// # Errors
    /// The device refuses, is silent, or the bus is gone.
    pub fn write(&mut self, node: NodeId, object: Object, value: &[u8]) -> Result<(), DialogueError> {
        let mut client = SdoClient::new(node, self.patience.as_nanos() as u64);
        match client.write(object, value, monotonic_ns()) {
            Some(first) => self.talk(node, &mut client, first),
            None => Ok(()),
        }
    }

    fn talk(&mut self, node: NodeId, client: &mut SdoClient, first: Frame) -> Result<(), DialogueError> {
        self.send(&first)?;
        loop {
            let event = match self.bus.receive()? {
                Some(Received { frame, .. }) => client.take(&frame, monotonic_ns()),
                None => {
                    self.bus.wait(Duration::from_millis(5))?;
                    client.check(monotonic_ns())
                }
            };
            match event {
                SdoEvent::Ignored => {}
                SdoEvent::Send(next) => self.send(&next)?,
                SdoEvent::Read | SdoEvent::Written => return Ok(()),
                SdoEvent::Failed(source, last) => {
                    last.iter().try_for_each(|frame| self.send(frame))?;
                    return Err(DialogueError::Device { node, source });
                }
            }
        }
    }

    fn send(&mut self, frame: &Frame) -> Result<(), BusError> {
        self.bus.send(frame)?;
        self.bus.flush()
    }
}

/// A little-endian number; `None` of no bytes, or more than 8.
pub fn number(value: &[u8]) -> Option<u64> {
    let mut bytes = [0; 8];
    bytes.get_mut(..value.len())?.copy_from_slice(value);
    (!value.is_empty()).then(|| u64::from_le_bytes(bytes))
}
