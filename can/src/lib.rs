//! CAN buses and the devices on them.
//!
//! | module | what it holds |
//! |---|---|
//! | `frame` | one frame, and when it was received |
//! | `counters` | frames, losses, errors and load of a bus |
//! | [`bus`] | the trait of a bus; SocketCAN, slcan, candump logs, a bus in memory |
//! | [`canopen`] | the codec: NMT, SYNC, EMCY, heartbeat, PDO, SDO |
//! | [`device`] | encoders (CiA 406) and valves (CiA 408) as their master sees them |
//! | [`frames`] | signals in frames of other protocols; DBC files |
//! | [`simulated`] | the devices themselves, simulated |
//!
//! Nothing here allocates, locks or waits after construction, but what its documentation says.

pub mod bus;
pub mod canopen;
mod counters;
pub mod device;
mod frame;
mod frame_clock;
pub mod frames;
pub mod simulated;

pub use counters::{BitRates, Counters, Load};
pub use frame::{FD_LENGTHS, Format, Frame, MAX_DATA, MAX_FD_DATA, Received};
