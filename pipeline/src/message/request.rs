//! What a person or a program asks of the axes: any program to control-proc.

use iceoryx2::prelude::ZeroCopySend;

use super::{Header, Message};
use crate::{MAX_AXES, layout::shared_struct};

shared_struct! {
    /// One axis of a [`Request`].
    #[type_name("hydraxis.AxisRequest/1")]
    pub struct AxisRequest {
        /// What the axis is to do, an [`AxisMode`] as number.
        pub mode: u32,
        /// Lets an axis that is off leave it, by being another number than in the message before of the same session.
        /// So neither the first message of a program nor an old one ever enables.
        pub enable: u32,
        /// Valve command in [-1, 1], positive extends: of the modes manual and commission.
        pub command: f64,
        /// Where to hold, m: of the mode hold.
        pub target: f64,
        /// 1 when there is a target; without it the axis holds where it comes to a stand.
        pub has_target: u32,
        /// Zero.
        pub reserved: u32,
    }
}

/// What an axis is operated in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum AxisMode {
    /// In a request: what it was in before.
    Unchanged = 0,
    /// Neutral, until it is enabled.
    Off = 1,
    /// Commanded by a person, message by message.
    Manual = 2,
    /// Goes to a target and stays there.
    Hold = 3,
    /// Follows its reference.
    Track = 4,
    /// Commanded by a commissioning program, message by message.
    Commission = 5,
}

impl AxisMode {
    /// All modes, by their numbers.
    pub const ALL: [Self; 6] = [Self::Unchanged, Self::Off, Self::Manual, Self::Hold, Self::Track, Self::Commission];

    /// The mode of this number, if it is one.
    pub fn from_number(number: u32) -> Option<Self> {
        Self::ALL.get(number as usize).copied()
    }

    /// Its name.
    pub const fn name(self) -> &'static str {
        ["unchanged", "off", "manual", "hold", "track", "commission"][self as usize]
    }

    /// Whether the command comes message by message, so that the axis stops when they do.
    pub const fn is_by_hand(self) -> bool {
        matches!(self, Self::Manual | Self::Commission)
    }
}

shared_struct! {
    /// What the axes are to do, from any program to control-proc. A program that commands sends one for every sample.
    #[type_name("hydraxis.Request/1")]
    pub struct Request {
        /// `sequence` is the newest sample that the program has seen: it shows how old the request is.
        pub header: Header,
        /// A number that no program before this one had, such as the time of its start, ns.
        pub session: u64,
        /// One entry per axis; one of zeros asks for nothing.
        pub axes: [AxisRequest; MAX_AXES],
    }
}
message!(Request, "request", publishers 1, buffer 64);
