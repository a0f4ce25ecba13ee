//! Positions: the encoders' raw values, and the samples that are made of them.

use iceoryx2::prelude::ZeroCopySend;

use super::{Header, Message};
use crate::{MAX_AXES, layout::shared_struct};

shared_struct! {
    /// Raw value of one encoder.
    #[type_name("hydraxis.EncoderValue/1")]
    pub struct EncoderValue {
        /// Counts as the encoder gives them; position = counts * resolution.
        pub counts: i64,
        /// Error word of the encoder; 0 when the encoder reports no error.
        pub error: u32,
        /// Zero.
        pub reserved: u32,
    }
}

shared_struct! {
    /// Raw values of all encoders at one time, before any check: plant-sim (or a bus) to sensor-proc.
    #[type_name("hydraxis.EncoderReading/2")]
    pub struct EncoderReading {
        /// `sequence` counts readings; `acquired_ns` is the time of the reading.
        pub header: Header,
        /// One value per axis.
        pub encoders: [EncoderValue; MAX_AXES],
        /// 0 while the machine's emergency stop is released.
        pub emergency_stop: u32,
        /// Zero.
        pub reserved: u32,
    }
}
message!(EncoderReading, "encoder-reading", publishers 1, buffer 64);

shared_struct! {
    /// One axis of an [`EncoderSample`].
    #[type_name("hydraxis.AxisSample/1")]
    pub struct AxisSample {
        /// Piston position, m (or the recorded output, in its unit). While `faults` is set: the last plausible
        /// position.
        pub position: f64,
        /// Backward difference of the position, m/s.
        pub velocity: f64,
        /// Reasons not to use the value, [`sample_fault`] bits; 0 is healthy.
        pub faults: u32,
        /// Number of ticks for which the raw value has not changed.
        pub unchanged: u32,
    }
}

impl AxisSample {
    /// The position, m, or `None` when the faults make it unusable or it is not finite.
    pub fn usable(&self) -> Option<f64> {
        (self.position.is_finite() && self.faults & sample_fault::UNUSABLE == 0).then_some(self.position)
    }
}

/// Bits of [`AxisSample::faults`]; 0 is healthy.
pub mod sample_fault {
    /// The position is outside the stroke by more than the tolerance.
    pub const RANGE: u32 = 1;
    /// The position moved faster than the axis can.
    pub const SPEED: u32 = 2;
    /// The encoder reported an error.
    pub const ENCODER: u32 = 4;
    /// No new reading arrived for this tick.
    pub const STALE: u32 = 8;
    /// The raw value has not changed for longer than `stuck_after`: a fault only while the axis is commanded to move.
    pub const STUCK: u32 = 16;

    /// The bits that make the position itself unusable.
    pub const UNUSABLE: u32 = RANGE | SPEED | ENCODER | STALE;
    /// Names of the bits, lowest first.
    pub const NAMES: [&str; 5] = ["range", "speed", "encoder", "stale", "stuck"];
}

shared_struct! {
    /// The checked positions of one tick: sensor-proc to ident-proc and control-proc.
    #[type_name("hydraxis.EncoderSample/2")]
    pub struct EncoderSample {
        /// `sequence` is the index of the tick.
        pub header: Header,
        /// One entry per axis.
        pub axes: [AxisSample; MAX_AXES],
        /// 0 while the machine's emergency stop is released, according to the newest reading.
        pub emergency_stop: u32,
        /// Zero.
        pub reserved: u32,
    }
}
message!(EncoderSample, "encoder-sample", publishers 1, buffer 256);
