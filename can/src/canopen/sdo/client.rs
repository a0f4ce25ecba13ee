//! The client: the master's end of a transfer.

use embedded_can::Frame as _;

use super::{AbortCode, Buffer, MAX_VALUE, NodeId, Object, abort, message, parts, sdo_request_id, sdo_response_id};
use crate::{Frame, MAX_DATA};

/// Why a transfer failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum SdoError {
    /// The device has ended it.
    #[error("{object}: {code}")]
    Refused {
        /// Which object.
        object: Object,
        /// The reason of the device.
        code: AbortCode,
    },
    /// No answer came in time.
    #[error("{0}: no answer")]
    Silent(Object),
    /// The answer was none of the protocol, or about another object; the transfer was ended.
    #[error("{object}: an answer that is wrong: {code}")]
    Wrong {
        /// Which object.
        object: Object,
        /// What was wrong.
        code: AbortCode,
    },
}

/// What a frame has meant for the transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SdoEvent {
    /// Nothing: it was none of this transfer.
    Ignored,
    /// The next frame is to be sent.
    Send(Frame),
    /// The object was read; [`SdoClient::value`] is its value.
    Read,
    /// The object was written.
    Written,
    /// It has failed; the frame is to be sent, if there is one.
    Failed(SdoError, Option<Frame>),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Idle,
    /// Waits for the answer to the request to write.
    Write,
    WriteSegments {
        is_last: bool,
    },
    /// Waits for the answer to the request to read.
    Read,
    ReadSegments,
}

/// One transfer at a time with one node.
#[derive(Debug, Clone)]
pub struct SdoClient {
    node: NodeId,
    timeout_ns: u64,
    state: State,
    object: Object,
    buffer: Buffer,
    deadline_ns: u64,
}

impl SdoClient {
    /// Of a node that answers within `timeout_ns`.
    pub fn new(node: NodeId, timeout_ns: u64) -> Self {
        let object = Object::new(0, 0);
        Self { node, timeout_ns, state: State::Idle, object, buffer: Buffer::EMPTY, deadline_ns: 0 }
    }

    /// Whether no transfer is under way.
    pub fn is_idle(&self) -> bool {
        self.state == State::Idle
    }

    /// The value that was read last.
    pub fn value(&self) -> &[u8] {
        self.buffer.value()
    }

    /// The value that was read last as a number; `None` of more than 8 bytes or none.
    pub fn number(&self) -> Option<u64> {
        let value = self.value();
        let mut bytes = [0; 8];
        bytes.get_mut(..value.len())?.copy_from_slice(value);
        (!value.is_empty()).then(|| u64::from_le_bytes(bytes))
    }

    /// Begins to read; the frame is to be sent. A transfer under way is forgotten.
    pub fn read(&mut self, object: Object, now_ns: u64) -> Frame {
        self.begin(State::Read, object, now_ns);
        self.frame(message(0x40, object, [0; 4]))
    }

    /// Begins to write; the frame is to be sent. A transfer under way is forgotten. `None` of a value without bytes or
    /// with more than [`MAX_VALUE`].
    pub fn write(&mut self, object: Object, value: &[u8], now_ns: u64) -> Option<Frame> {
        if !(1..=MAX_VALUE).contains(&value.len()) {
            return None;
        }
        self.begin(State::Write, object, now_ns);
        self.buffer.set(value);
        let mut four = [0; 4];
        let data = match four.get_mut(..value.len()) {
            Some(room) => {
                room.copy_from_slice(value);
                message(0x23 | ((4 - value.len()) as u8) << 2, object, four)
            }
            None => message(0x21, object, (value.len() as u32).to_le_bytes()),
        };
        Some(self.frame(data))
    }

    fn begin(&mut self, state: State, object: Object, now_ns: u64) {
        (self.state, self.object, self.buffer) = (state, object, Buffer::EMPTY);
        self.deadline_ns = now_ns + self.timeout_ns;
    }

    fn frame(&self, data: [u8; MAX_DATA]) -> Frame {
        Frame::standard(sdo_request_id(self.node), data)
    }

    /// Ends a transfer whose answer is late.
    pub fn check(&mut self, now_ns: u64) -> SdoEvent {
        if self.is_idle() || now_ns < self.deadline_ns {
            return SdoEvent::Ignored;
        }
        self.state = State::Idle;
        SdoEvent::Failed(SdoError::Silent(self.object), Some(self.frame(abort(self.object, AbortCode::TIMEOUT))))
    }

    /// Takes a frame from the bus.
    pub fn take(&mut self, frame: &Frame, now_ns: u64) -> SdoEvent {
        if self.is_idle() || frame.standard_id() != Some(sdo_response_id(self.node)) {
            return SdoEvent::Ignored;
        }
        let Ok(data) = <[u8; MAX_DATA]>::try_from(frame.data()) else { return self.wrong(AbortCode::COMMAND) };
        let (object, value) = parts(&data);
        if data[0] == 0x80 {
            // A late abort of another transfer is not about this one.
            if object != self.object {
                return SdoEvent::Ignored;
            }
            self.state = State::Idle;
            let code = AbortCode(u32::from_le_bytes(value));
            return SdoEvent::Failed(SdoError::Refused { object, code }, None);
        }
        let is_initiate = matches!(self.state, State::Read | State::Write);
        if is_initiate && object != self.object {
            return SdoEvent::Ignored;
        }
        self.deadline_ns = now_ns + self.timeout_ns;
        match self.state {
            State::Idle => SdoEvent::Ignored,
            State::Write => self.take_write(data[0]),
            State::WriteSegments { is_last } => self.take_written_segment(data[0], is_last),
            State::Read => self.take_read(data[0], value),
            State::ReadSegments => self.take_read_segment(&data),
        }
    }

    fn take_write(&mut self, command: u8) -> SdoEvent {
        if command != 0x60 {
            return self.wrong(AbortCode::COMMAND);
        }
        if self.buffer.length <= 4 {
            self.state = State::Idle;
            return SdoEvent::Written;
        }
        self.send_segment()
    }

    fn send_segment(&mut self) -> SdoEvent {
        let (data, is_last) = self.buffer.next_segment();
        self.state = State::WriteSegments { is_last };
        SdoEvent::Send(self.frame(data))
    }

    fn take_written_segment(&mut self, command: u8, is_last: bool) -> SdoEvent {
        // The buffer has toggled already.
        let expected = 0x20 | u8::from(!self.buffer.toggle) << 4;
        if command != expected {
            let is_toggle = command & !0x10 == 0x20;
            return self.wrong(if is_toggle { AbortCode::TOGGLE } else { AbortCode::COMMAND });
        }
        if is_last {
            self.state = State::Idle;
            return SdoEvent::Written;
        }
        self.send_segment()
    }

    fn take_read(&mut self, command: u8, value: [u8; 4]) -> SdoEvent {
        match command {
            // Expedited: bit 0 says that the length is there, else all four bytes count.
            _ if command & 0xE2 == 0x42 => {
                let unused = if command & 1 != 0 { usize::from(command >> 2 & 3) } else { 0 };
                self.buffer.set(&value[..4 - unused]);
                self.state = State::Idle;
                SdoEvent::Read
            }
            0x41 if u32::from_le_bytes(value) as usize > MAX_VALUE => self.wrong(AbortCode::MEMORY),
            0x40 | 0x41 => {
                self.state = State::ReadSegments;
                SdoEvent::Send(self.frame([0x60, 0, 0, 0, 0, 0, 0, 0]))
            }
            _ => self.wrong(AbortCode::COMMAND),
        }
    }

    fn take_read_segment(&mut self, data: &[u8; MAX_DATA]) -> SdoEvent {
        if data[0] & 0xE0 != 0 {
            return self.wrong(AbortCode::COMMAND);
        }
        match self.buffer.take_segment(data) {
            Err(code) => self.wrong(code),
            Ok(true) => {
                self.state = State::Idle;
                SdoEvent::Read
            }
            Ok(false) => SdoEvent::Send(self.frame([0x60 | u8::from(self.buffer.toggle) << 4, 0, 0, 0, 0, 0, 0, 0])),
        }
    }

    fn wrong(&mut self, code: AbortCode) -> SdoEvent {
        self.state = State::Idle;
        let object = self.object;
        SdoEvent::Failed(SdoError::Wrong { object, code }, Some(self.frame(abort(object, code))))
    }
}
