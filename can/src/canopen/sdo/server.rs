//! The server: the device's end of a transfer, for simulated nodes.

use embedded_can::Frame as _;

use super::{AbortCode, Buffer, MAX_VALUE, NodeId, Object, abort, message, parts, sdo_request_id, sdo_response_id};
use crate::{Frame, MAX_DATA};

/// The objects of a device.
pub trait Dictionary {
    /// Writes the value of an object to `value`; returns its number of bytes.
    ///
    /// # Errors
    /// Why it cannot be read.
    fn read(&self, object: Object, value: &mut [u8; MAX_VALUE]) -> Result<usize, AbortCode>;

    /// Sets an object.
    ///
    /// # Errors
    /// Why it cannot be written.
    fn write(&mut self, object: Object, value: &[u8]) -> Result<(), AbortCode>;
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Idle,
    /// The client writes in segments.
    Written,
    /// The client reads in segments.
    Read,
}

/// One transfer at a time.
#[derive(Debug, Clone)]
pub struct SdoServer {
    node: NodeId,
    state: State,
    object: Object,
    buffer: Buffer,
}

impl SdoServer {
    /// Of a node.
    pub fn new(node: NodeId) -> Self {
        Self { node, state: State::Idle, object: Object::new(0, 0), buffer: Buffer::EMPTY }
    }

    /// Takes a frame from the bus; returns the answer, if there is one.
    pub fn take(&mut self, frame: &Frame, dictionary: &mut impl Dictionary) -> Option<Frame> {
        if frame.standard_id() != Some(sdo_request_id(self.node)) {
            return None;
        }
        let data = <[u8; MAX_DATA]>::try_from(frame.data()).ok()?;
        let (object, value) = parts(&data);
        let answer = match (data[0] >> 5, self.state) {
            (0, State::Written) => self.take_segment(&data, dictionary),
            (1, _) => self.write(data[0], object, value, dictionary),
            (2, _) => self.read(object, dictionary),
            (3, State::Read) => self.next_segment(data[0]),
            (4, _) => {
                self.state = State::Idle;
                return None;
            }
            _ => Err(AbortCode::COMMAND),
        };
        Some(Frame::standard(
            sdo_response_id(self.node),
            answer.unwrap_or_else(|code| {
                let object = if self.state == State::Idle { object } else { self.object };
                self.state = State::Idle;
                abort(object, code)
            }),
        ))
    }

    fn write(
        &mut self,
        command: u8,
        object: Object,
        value: [u8; 4],
        dictionary: &mut impl Dictionary,
    ) -> Result<[u8; MAX_DATA], AbortCode> {
        (self.state, self.object, self.buffer) = (State::Idle, object, Buffer::EMPTY);
        if command & 2 != 0 {
            let unused = if command & 1 != 0 { usize::from(command >> 2 & 3) } else { 0 };
            dictionary.write(object, &value[..4 - unused])?;
        } else if command & 1 != 0 && u32::from_le_bytes(value) as usize > MAX_VALUE {
            return Err(AbortCode::MEMORY);
        } else {
            self.state = State::Written;
        }
        Ok(message(0x60, object, [0; 4]))
    }

    fn take_segment(
        &mut self,
        data: &[u8; MAX_DATA],
        dictionary: &mut impl Dictionary,
    ) -> Result<[u8; MAX_DATA], AbortCode> {
        let toggle = data[0] & 0x10;
        if self.buffer.take_segment(data)? {
            dictionary.write(self.object, self.buffer.value())?;
            self.state = State::Idle;
        }
        Ok([0x20 | toggle, 0, 0, 0, 0, 0, 0, 0])
    }

    fn read(&mut self, object: Object, dictionary: &impl Dictionary) -> Result<[u8; MAX_DATA], AbortCode> {
        (self.state, self.object, self.buffer) = (State::Idle, object, Buffer::EMPTY);
        let length = dictionary.read(object, &mut self.buffer.bytes)?.min(MAX_VALUE);
        self.buffer.length = length;
        if (1..=4).contains(&length) {
            let [a, b, c, d, ..] = self.buffer.bytes;
            return Ok(message(0x43 | ((4 - length) as u8) << 2, object, [a, b, c, d]));
        }
        self.state = State::Read;
        Ok(message(0x41, object, (length as u32).to_le_bytes()))
    }

    fn next_segment(&mut self, command: u8) -> Result<[u8; MAX_DATA], AbortCode> {
        if (command & 0x10 != 0) != self.buffer.toggle {
            return Err(AbortCode::TOGGLE);
        }
        let (data, is_last) = self.buffer.next_segment();
        if is_last {
            self.state = State::Idle;
        }
        Ok(data)
    }
}
