//! CAN buses and the devices on them.
//!
//! | module | what it holds |
//! |---|---|
//! | `frame` | one frame, and when it was received |
//! | `counters` | frames, losses, errors and load of a bus |
//! | [`bus`] | the trait of a bus; SocketCAN, slcan, candump logs, a bus in memory |
//! | [`canopen`] | the codec: NMT, SYNC, EMCY, heartbeat, PDO, SDO |
//!
//! Nothing here allocates, locks or waits after construction, but what its documentation says.

pub mod bus;
pub mod canopen;
mod counters;
mod frame;
mod frame_clock;

pub use counters::{Counters, Load};
pub use frame::{Frame, MAX_DATA, Received};
