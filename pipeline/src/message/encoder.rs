//! Positions and chamber pressures: the raw values of the sensors, and the samples that are made of them.
//!
//! A machine without pressure transducers says so by `has_pressures`: 0 is none, so a program that does not know of
//! pressures and leaves its messages zero says so as well. The pressures of a sample are then NaN, so that a program
//! which does not look at the field cannot take the absence of a value for a chamber without pressure.

use iceoryx2::prelude::ZeroCopySend;

use super::{Header, Message};
use crate::{MAX_AXES, layout::shared_struct};

shared_struct! {
    /// Raw values of the sensors of one axis.
    #[type_name("hydraxis.EncoderValue/2")]
    pub struct EncoderValue {
        /// Counts as the sensor gives them; at the cylinder position = counts * resolution, at a joint
        /// angle = zero + counts * resolution.
        pub counts: i64,
        /// Pressure of the piston side, Pa above the atmosphere.
        pub piston_pressure: f64,
        /// Pressure of the rod side, Pa above the atmosphere.
        pub rod_pressure: f64,
        /// Error word of the encoder; 0 when it reports no error, and all bits where it was not read this time.
        pub error: u32,
        /// 1 where both pressures are measured; 0 without transducers.
        pub has_pressures: u32,
    }
}

shared_struct! {
    /// Raw values of all sensors at one time, before any check: plant-sim (or a bus) to sensor-proc.
    #[type_name("hydraxis.EncoderReading/4")]
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
impl EncoderValue {
    /// Error word of a sensor that was not read this time: a missing position, which may be bridged, and no error.
    pub const NOT_READ: u32 = u32::MAX;
}

// Readings of 256 ms, so that no reading of a short emergency stop is lost while sensor-proc is late.
message!(EncoderReading, "encoder-reading", publishers 1, buffer 256);

shared_struct! {
    /// One axis of an [`EncoderSample`].
    #[type_name("hydraxis.AxisSample/2")]
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
        /// Pressure of the piston side, Pa above the atmosphere; NaN while `has_pressures` is 0.
        pub piston_pressure: f64,
        /// Pressure of the rod side, Pa above the atmosphere; NaN while `has_pressures` is 0.
        pub rod_pressure: f64,
        /// 1 while both pressures are usable; 0 without transducers, without a new reading, and with the fault
        /// [`sample_fault::PRESSURE`].
        pub has_pressures: u32,
        /// Zero.
        pub reserved: u32,
    }
}

impl AxisSample {
    /// The position, m, or `None` when the faults make it unusable or it is not finite.
    pub fn usable(&self) -> Option<f64> {
        (self.position.is_finite() && self.faults & sample_fault::UNUSABLE == 0).then_some(self.position)
    }

    /// The last plausible position, m, or `None` before the first one: a sample without any has position and velocity
    /// zero and a fault.
    pub fn last_plausible(&self) -> Option<f64> {
        let is_untouched = self.position == 0.0 && self.velocity == 0.0 && self.faults & sample_fault::UNUSABLE != 0;
        (self.position.is_finite() && !is_untouched).then_some(self.position)
    }

    /// Whether nothing was read: the position is missing, not implausible.
    pub fn is_stale(&self) -> bool {
        self.faults & sample_fault::UNUSABLE == sample_fault::STALE
    }

    /// Pressures of piston side and rod side, Pa, or `None` when they are unknown.
    pub fn pressures(&self) -> Option<(f64, f64)> {
        (self.has_pressures != 0).then_some((self.piston_pressure, self.rod_pressure))
    }
}

/// Bits of [`AxisSample::faults`]; 0 is healthy.
pub mod sample_fault {
    /// The position is outside the stroke by more than the tolerance.
    pub const RANGE: u32 = 1;
    /// The position moved faster than the axis can.
    pub const SPEED: u32 = 2;
    /// The encoder reported an error, or the position is computed from the sensor of another axis whose position is
    /// unusable.
    pub const ENCODER: u32 = 4;
    /// No new reading arrived for this tick, or none of this sensor or of one that the position is computed from.
    pub const STALE: u32 = 8;
    /// The raw value has not changed for longer than `stuck_after`: a fault only while the axis is commanded to move.
    pub const STUCK: u32 = 16;
    /// A chamber pressure is missing or outside the range of its transducer. The position is not affected.
    pub const PRESSURE: u32 = 32;
    /// Positions that are too fast follow each other evenly in one direction: the axis falls or is pushed. Comes with
    /// [`SPEED`].
    pub const RUNAWAY: u32 = 64;

    /// The bits that make the position itself unusable.
    pub const UNUSABLE: u32 = RANGE | SPEED | ENCODER | STALE;
    /// Names of the bits, lowest first.
    pub const NAMES: [&str; 7] = ["range", "speed", "encoder", "stale", "stuck", "pressure", "runaway"];
}

shared_struct! {
    /// The checked positions and pressures of one tick: sensor-proc to ident-proc and control-proc.
    #[type_name("hydraxis.EncoderSample/4")]
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
