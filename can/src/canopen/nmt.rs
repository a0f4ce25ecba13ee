//! Network management, SYNC, boot-up and heartbeat.
//!
//! ```text
//! NMT        000h       command, node (0: all)
//! SYNC       080h       nothing, or a counter
//! heartbeat  700h+node  state; 0 is boot-up, bit 7 is the toggle bit of node guarding and passed over
//! ```

use embedded_can::Frame as _;

use super::{NodeId, function};
use crate::Frame;

/// What a node is told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Command {
    /// Become operational: process data are exchanged.
    Start = 0x01,
    /// Stop: nothing but NMT and heartbeat.
    Stop = 0x02,
    /// Become pre-operational: no process data.
    PreOperational = 0x80,
    /// Restart the application.
    ResetNode = 0x81,
    /// Restart the communication.
    ResetCommunication = 0x82,
}

/// What a node says of itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NodeState {
    /// The node has just started.
    BootUp,
    /// The node is stopped.
    Stopped,
    /// Process data are exchanged.
    Operational,
    /// Only service data are exchanged.
    PreOperational,
}

impl NodeState {
    /// The state with this number.
    pub fn of(number: u8) -> Option<Self> {
        Some(match number & 0x7F {
            0x00 => Self::BootUp,
            0x04 => Self::Stopped,
            0x05 => Self::Operational,
            0x7F => Self::PreOperational,
            _ => return None,
        })
    }

    /// Its number.
    pub fn number(self) -> u8 {
        match self {
            Self::BootUp => 0x00,
            Self::Stopped => 0x04,
            Self::Operational => 0x05,
            Self::PreOperational => 0x7F,
        }
    }
}

/// The frame that tells one node, or all of them with `None`.
pub fn nmt(command: Command, node: Option<NodeId>) -> Frame {
    Frame::standard(function::NMT, [command as u8, node.map_or(0, NodeId::number)])
}

/// The command in a frame that is for `node`.
pub fn nmt_of(frame: &Frame, node: NodeId) -> Option<Command> {
    let (Some(function::NMT), &[command, to]) = (frame.standard_id(), frame.data()) else { return None };
    let all = [Command::Start, Command::Stop, Command::PreOperational, Command::ResetNode, Command::ResetCommunication];
    let is_for_node = to == 0 || to == node.number();
    all.into_iter().find(|known| *known as u8 == command).filter(|_| is_for_node)
}

/// SYNC without a counter.
pub fn sync() -> Frame {
    Frame::standard(function::SYNC, [])
}

/// The heartbeat, or boot-up, of a node.
pub fn heartbeat(node: NodeId, state: NodeState) -> Frame {
    Frame::standard(node.id(function::HEARTBEAT), [state.number()])
}

/// Node and state of a heartbeat.
pub fn heartbeat_of(frame: &Frame) -> Option<(NodeId, NodeState)> {
    let (id, &[state]) = (frame.standard_id()?, frame.data()) else { return None };
    let node = NodeId::new(u8::try_from(id.checked_sub(function::HEARTBEAT)?).ok()?)?;
    Some((node, NodeState::of(state)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heartbeats_name_node_and_state() {
        let node = NodeId::new(5).unwrap();
        for state in [NodeState::BootUp, NodeState::Stopped, NodeState::Operational, NodeState::PreOperational] {
            assert_eq!(heartbeat_of(&heartbeat(node, state)), Some((node, state)));
        }
        assert_eq!(heartbeat_of(&Frame::standard(0x700, [5])), None);
        assert_eq!(heartbeat_of(&Frame::standard(0x705, [5, 0])), None);
        assert_eq!(heartbeat_of(&Frame::standard(0x705, [0x42])), None);
    }

    #[test]
    fn a_command_is_for_one_node_or_for_all() {
        let [one, other] = [1, 2].map(|number| NodeId::new(number).unwrap());
        let frame = nmt(Command::Start, Some(one));
        assert_eq!((nmt_of(&frame, one), nmt_of(&frame, other)), (Some(Command::Start), None));
        assert_eq!(nmt_of(&nmt(Command::Stop, None), other), Some(Command::Stop));
    }
}
