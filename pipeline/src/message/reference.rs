//! References from another program.

use iceoryx2::prelude::ZeroCopySend;

use super::{Header, Message};
use crate::{MAX_AXES, layout::shared_struct};

/// Number of ticks that a [`Reference`] can carry, the present one included.
pub const MAX_PREVIEW: usize = 32;

shared_struct! {
    /// References for this tick and the coming ones (the preview), from any program to control-proc.
    #[type_name("hydraxis.Reference/2")]
    pub struct Reference {
        /// `sequence` is the tick that the first reference is meant for; it must not go back.
        pub header: Header,
        /// References per axis, m: entry i is for tick `sequence` + i.
        pub positions: [[f64; MAX_PREVIEW]; MAX_AXES],
        /// Number of references per axis, 1 to [`MAX_PREVIEW`].
        pub preview: u32,
        /// Zero.
        pub reserved: u32,
    }
}
// 128 messages: 1.28 s of a program that writes 100 times a second, 0.128 s at 1 kHz.
message!(Reference, "reference", publishers 1, buffer 128, from clients true);
