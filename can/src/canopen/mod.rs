//! CANopen (CiA 301): identifiers, network management, and what devices send on their own.
//!
//! ```text
//! identifier = function code << 7 | node         node 1 to 127
//! ```
//!
//! | function | identifier | file |
//! |---|---|---|
//! | NMT | 000h | `nmt` |
//! | SYNC | 080h | `nmt` |
//! | EMCY | 080h + node | `emergency` |
//! | TPDO 1 to 4, RPDO 1 to 4 | 180h, 280h, .. and 200h, 300h, .. + node | `pdo` |
//! | SDO from and to the device | 580h + node, 600h + node | `sdo/` |
//! | boot-up and heartbeat | 700h + node | `nmt` |
//!
//! Numbers are little-endian. Nothing here allocates.

mod emergency;
mod nmt;
mod pdo;
mod sdo;

pub use emergency::{Emergency, code as emergency_code};
pub use nmt::{Command, NodeState, heartbeat, heartbeat_of, nmt, nmt_of, sync};
pub use pdo::{MAX_ENTRIES, Mapped, Mapping, MappingError, signed};
pub use sdo::{
    AbortCode, Dictionary, MAX_VALUE, Object, SdoClient, SdoError, SdoEvent, SdoServer, sdo_request_id, sdo_response_id,
};

/// Number of a node, 1 to 127.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct NodeId(u8);

impl NodeId {
    /// Largest number of a node.
    pub const MAX: u8 = 127;

    /// `None` of 0 and of numbers above 127.
    pub fn new(number: u8) -> Option<Self> {
        (1..=Self::MAX).contains(&number).then_some(Self(number))
    }

    /// All numbers, 1 to 127.
    pub fn all() -> impl Iterator<Item = Self> {
        (1..=Self::MAX).map(Self)
    }

    /// The number.
    pub fn number(self) -> u8 {
        self.0
    }

    /// The identifier of a function of this node, such as 180h for the first TPDO.
    pub fn id(self, function: u16) -> u16 {
        function + u16::from(self.0)
    }
}

/// Identifiers of functions; that of a node is added.
pub mod function {
    /// Network management, from the master.
    pub const NMT: u16 = 0x000;
    /// SYNC.
    pub const SYNC: u16 = 0x080;
    /// Emergency of a node.
    pub const EMERGENCY: u16 = 0x080;
    /// First process data from a node; the second to fourth are 100h apart.
    pub const TPDO1: u16 = 0x180;
    /// First process data to a node; the second to fourth are 100h apart.
    pub const RPDO1: u16 = 0x200;
    /// Answers of a node to service data requests.
    pub const SDO_RESPONSE: u16 = 0x580;
    /// Service data requests to a node.
    pub const SDO_REQUEST: u16 = 0x600;
    /// Boot-up and heartbeat of a node.
    pub const HEARTBEAT: u16 = 0x700;
}
