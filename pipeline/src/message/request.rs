//! Requests of a person or a program for modes of the axes.

use iceoryx2::prelude::ZeroCopySend;

use super::{Header, Message};
use crate::{MAX_AXES, layout::shared_struct};

shared_struct! {
    /// One axis of a [`Request`].
    #[type_name("hydraxis.AxisRequest/3")]
    pub struct AxisRequest {
        /// Mode that is asked for, an [`AxisMode`] as number.
        pub mode: u32,
        /// Arms an axis that is off when this number differs from the one in the message before of the same session.
        /// So neither the first message of a program nor a repeated one arms an axis.
        pub enable: u32,
        /// Valve command in [-1, 1], positive extends; only for the modes manual and commission.
        pub command: f64,
        /// Set point, m; only for the mode hold.
        pub target: f64,
        /// 1 when there is a set point; with 0 the axis holds the position at which it comes to a stand.
        pub has_target: u32,
        /// 1 to disarm the axis when the messages of this session stop, in every mode; 0 only in the modes manual and
        /// commission.
        pub hold_to_run: u32,
        /// Gains of the fallback from now on, as a part of those in the machine file; 0 leaves them as they are. Only
        /// for an axis that is not armed, within [`AxisState::gain_range`](super::AxisState::gain_range), and not in
        /// the first message of a session. With the mode off it is not looked at.
        pub gain: f64,
    }
}

/// Mode of an axis: what a person or a program asked it to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum AxisMode {
    /// Only in a request: the axis keeps its mode.
    Unchanged = 0,
    /// Neutral, until the axis is armed.
    Off = 1,
    /// A person gives the valve command, request by request.
    Manual = 2,
    /// The axis goes to a set point and stays there.
    Hold = 3,
    /// The axis follows its reference.
    Track = 4,
    /// A commissioning program gives the valve command, request by request.
    Commission = 5,
}

impl AxisMode {
    /// All modes, by their numbers.
    pub const ALL: [Self; 6] = [Self::Unchanged, Self::Off, Self::Manual, Self::Hold, Self::Track, Self::Commission];

    /// The mode with this number, or `None` for a number that is no mode.
    pub fn from_number(number: u32) -> Option<Self> {
        Self::ALL.get(number as usize).copied()
    }

    /// The name of the mode.
    pub const fn name(self) -> &'static str {
        ["unchanged", "off", "manual", "hold", "track", "commission"][self as usize]
    }

    /// Whether the requests carry the valve command, so that the axis stops when the requests stop.
    pub const fn is_direct(self) -> bool {
        matches!(self, Self::Manual | Self::Commission)
    }
}

shared_struct! {
    /// Asks for the modes of the axes, from any program to control-proc. A program that gives valve commands sends one
    /// request for every sample.
    #[type_name("hydraxis.Request/4")]
    pub struct Request {
        /// `sequence` is the newest sample that the program has read; it shows how old the request is.
        pub header: Header,
        /// Number that differs from those of all programs before, such as the time of the program's start, ns.
        pub session: u64,
        /// 1 to take the place of a program that operates now. That one's requests have no effect any more.
        pub takes_over: u32,
        /// 0.
        pub reserved: u32,
        /// One entry per axis; an entry of zeros asks for nothing.
        pub axes: [AxisRequest; MAX_AXES],
    }
}
// 128 messages: at 1 kHz longer than the 0.1 s after which a request is refused as too old.
message!(Request, "request", publishers 4, buffer 128, from clients true);
