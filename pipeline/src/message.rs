//! The messages: plain numbers in fixed arrays, one message per tick for all axes, so that a tick is atomic.
//!
//! Every message starts with a [`Header`] that names the sample which caused it. The `type_name` of each carries
//! a version; any change of a message raises it, and [`crate::layout`] catches a change that forgot to.

use iceoryx2::prelude::ZeroCopySend;

use crate::{
    MAX_AXES,
    hammerstein::Coefficients,
    layout::{Layout, shared_struct},
    statistics::ErrorStatistics,
};

/// Ticks that a [`Reference`] can carry, the present one included.
pub const MAX_PREVIEW: usize = 32;

/// Names of all channels, in the order of the data.
pub const CHANNELS: [&str; 8] = [
    "encoder-reading",
    "encoder-sample",
    "valve-command",
    "coefficient-snapshot",
    "reference",
    "request",
    "stage-health",
    "machine-state",
];

/// A message that has a channel.
pub trait Message: ZeroCopySend + Layout + Copy + Default + std::fmt::Debug + 'static {
    /// Name of the channel, the last part of the service name `hydraxis/<channel>`.
    const CHANNEL: &'static str;
    /// The most writers the channel takes at once.
    const MAX_PUBLISHERS: usize;
    /// Messages that a reader can fall behind before it loses the oldest.
    const BUFFER: usize;

    /// Where the message comes from and when.
    fn header(&self) -> &Header;
    /// The same, to be filled in.
    fn header_mut(&mut self) -> &mut Header;
}

macro_rules! message {
    ($name:ident, $channel:literal, publishers $publishers:literal, buffer $buffer:literal) => {
        impl Message for $name {
            const CHANNEL: &'static str = $channel;
            const MAX_PUBLISHERS: usize = $publishers;
            const BUFFER: usize = $buffer;
            fn header(&self) -> &Header {
                &self.header
            }
            fn header_mut(&mut self) -> &mut Header {
                &mut self.header
            }
        }
    };
}

mod health;
mod request;

pub use health::{AxisState, ChannelHealth, MachineState, MissCause, MissedDeadlines, StageHealth, StageState};
pub use request::{AxisMode, AxisRequest, Request};

shared_struct! {
    /// What every message starts with.
    #[type_name("hydraxis.Header/1")]
    pub struct Header {
        /// Number of the sample that caused the message: the index of its tick since the start of the source.
        /// An [`EncoderReading`] counts its own readings. A gap is a tick that nobody worked.
        pub sequence: u64,
        /// Number of this message on its channel, from 0 on, filled in by the publisher. A gap is a lost message.
        pub number: u64,
        /// When that sample was acquired, ns of `CLOCK_MONOTONIC`.
        pub acquired_ns: u64,
        /// When this message was sent, ns of `CLOCK_MONOTONIC`.
        pub sent_ns: u64,
        /// Axes that the arrays hold; entries beyond it are zero.
        pub axis_count: u32,
        /// Zero.
        pub reserved: u32,
    }
}

shared_struct! {
    /// One encoder's raw value.
    #[type_name("hydraxis.EncoderValue/1")]
    pub struct EncoderValue {
        /// Counts as the encoder gives them; position = counts * resolution.
        pub counts: i64,
        /// 0 when the encoder reports no error, else its error word.
        pub error: u32,
        /// Zero.
        pub reserved: u32,
    }
}

shared_struct! {
    /// What the encoders said, unjudged: plant-sim (or a bus) to sensor-proc.
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
        /// Piston position, m (or the recorded output, in its unit). The last plausible one while `faults` is set.
        pub position: f64,
        /// Backward difference of the position, m/s.
        pub velocity: f64,
        /// Why the value is not to be trusted, [`sample_fault`] bits; 0 is healthy.
        pub faults: u32,
        /// For how many ticks the raw value has not changed at all.
        pub unchanged: u32,
    }
}

impl AxisSample {
    /// The position, m, where it is one.
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
    /// The judged positions of one tick: sensor-proc to ident-proc and control-proc.
    #[type_name("hydraxis.EncoderSample/2")]
    pub struct EncoderSample {
        /// `sequence` is the index of the tick.
        pub header: Header,
        /// One entry per axis.
        pub axes: [AxisSample; MAX_AXES],
        /// 0 while the machine's emergency stop is released, as far as is known.
        pub emergency_stop: u32,
        /// Zero.
        pub reserved: u32,
    }
}
message!(EncoderSample, "encoder-sample", publishers 1, buffer 256);

shared_struct! {
    /// One axis of a [`ValveCommand`].
    #[type_name("hydraxis.AxisCommand/2")]
    pub struct AxisCommand {
        /// Valve command in [-1, 1], positive extends; made from sample `sequence` and held until the next.
        pub command: f64,
        /// Target of this tick, m.
        pub reference: f64,
        /// reference - position, m.
        pub error: f64,
        /// Who made the command, a [`ControlMode`] as number.
        pub mode: u32,
        /// Why the axis stands still or the model is not used, [`control_flag`] bits; 0 is healthy.
        pub flags: u32,
        /// What the axis is operated in, an [`AxisMode`] as number; 0 where nobody controls.
        pub operation: u32,
        /// [`Request`] messages that were judged and refused so far.
        pub refused_requests: u32,
        /// The same that were taken.
        pub taken_requests: u64,
        /// Snapshots that were judged and refused so far, by [`REFUSALS`].
        pub rejected_snapshots: [u64; REFUSALS.len()],
        /// Plans of the model-based controller that had to do without the solver so far.
        pub unsolved_plans: u64,
        /// Tracking error since the axis began to follow its reference, m.
        pub tracking: ErrorStatistics,
        /// The same over the ticks that the model-based controller made the command of.
        pub model_tracking: ErrorStatistics,
    }
}

/// Why a snapshot was refused, in the order of [`AxisCommand::rejected_snapshots`].
pub const REFUSALS: [&str; 7] = ["not-finite", "structure", "unstable", "direction", "unreachable", "speed", "worse"];

/// Who made a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum ControlMode {
    /// Neutral: not armed, settling, or a latched fault.
    Neutral = 0,
    /// The fallback controller, PI with dead-band compensation.
    Fallback = 1,
    /// The model-based controller.
    Model = 2,
    /// A recording plays; nobody controls.
    Replay = 3,
    /// A person, by [`Request`], within the limits.
    Manual = 4,
    /// A commissioning program, by [`Request`], within the limits.
    Commission = 5,
}

impl ControlMode {
    /// The mode's name, or `unknown` for a number that is none.
    pub fn name(mode: u32) -> &'static str {
        ["neutral", "fallback", "model", "replay", "manual", "commission"].get(mode as usize).unwrap_or(&"unknown")
    }
}

/// Bits of [`AxisCommand::flags`]; 0 is healthy.
pub mod control_flag {
    /// Nobody has armed the controller.
    pub const DISARMED: u32 = 1;
    /// The first samples after start are watched before anything moves.
    pub const SETTLING: u32 = 2;
    /// The feedback was stale, implausible or stuck; latched.
    pub const FEEDBACK: u32 = 4;
    /// The reference stopped, jumped, left the soft limits or is not finite; the axis holds.
    pub const REFERENCE: u32 = 8;
    /// The identifier has no model yet.
    pub const NO_MODEL: u32 = 16;
    /// The last snapshot that could be used is old; it is used on until its lifetime is over.
    pub const MODEL_STALE: u32 = 32;
    /// The newest snapshot was judged and refused.
    pub const MODEL_REFUSED: u32 = 64;
    /// The newest request was judged and refused; the axis does what it did.
    pub const REQUEST: u32 = 128;
    /// Requests stopped while an axis needed them; it is off since.
    pub const REQUEST_STOPPED: u32 = 256;
    /// A soft limit is near: the command that was asked for would not stop before it.
    pub const SOFT_LIMIT: u32 = 512;
    /// Commands came too late several times in a row; latched.
    pub const DEADLINE: u32 = 1024;
    /// The model-based controller found no plan several times in a row; latched.
    pub const SOLVER: u32 = 2048;
    /// The axis was driven and hardly moved; latched.
    pub const STALL: u32 = 4096;
    /// The axis was too far from its target for too long; latched.
    pub const FOLLOWING: u32 = 8192;
    /// The emergency stop is or was pressed; latched, with the pilot cut off.
    pub const EMERGENCY_STOP: u32 = 16384;
    /// No model has been usable for so long that the axis may move at half of its speed only.
    pub const HALF_SPEED: u32 = 32768;

    /// The bits of faults that keep the axis neutral until it is put off and enabled again.
    pub const LATCHED: u32 = FEEDBACK | DEADLINE | SOLVER | STALL | FOLLOWING | EMERGENCY_STOP;
    /// Names of the bits, lowest first.
    pub const NAMES: [&str; 16] = [
        "disarmed",
        "settling",
        "feedback",
        "reference",
        "no-model",
        "model-stale",
        "model-refused",
        "request",
        "request-stopped",
        "soft-limit",
        "deadline",
        "solver",
        "stall",
        "following",
        "emergency-stop",
        "half-speed",
    ];
}

shared_struct! {
    /// The valve commands of one tick: control-proc (or a recording) to plant-sim and ident-proc.
    #[type_name("hydraxis.ValveCommand/3")]
    pub struct ValveCommand {
        /// `sequence` names the sample that the command was made from.
        pub header: Header,
        /// One entry per axis.
        pub axes: [AxisCommand; MAX_AXES],
        /// 1 asks for the pilot pressure of all valves to be cut off, whatever the commands; else 0.
        pub cut_off: u32,
        /// Zero.
        pub reserved: u32,
    }
}
message!(ValveCommand, "valve-command", publishers 1, buffer 256);

shared_struct! {
    /// Errors of one model over the samples after training.
    #[type_name("hydraxis.ModelErrors/1")]
    pub struct ModelErrors {
        /// Output minus the prediction from the coefficients before it and the measured past.
        pub one_step: ErrorStatistics,
        /// Output minus the prediction made `horizon` samples before, coefficients held since.
        pub h_step: ErrorStatistics,
        /// Output minus the model fed by its own outputs since the end of training.
        pub free_run: ErrorStatistics,
    }
}

shared_struct! {
    /// One axis of a [`CoefficientSnapshot`]. Both models are of the position; errors are in the unit of the identified
    /// output, m, or m/s where that is the velocity.
    #[type_name("hydraxis.AxisSnapshot/3")]
    pub struct AxisSnapshot {
        /// The adaptive model.
        pub adaptive: Coefficients,
        /// The classical model: identified offline, held since.
        pub classical: Coefficients,
        /// Errors of the adaptive model.
        pub adaptive_errors: ModelErrors,
        /// Errors of the classical model.
        pub classical_errors: ModelErrors,
        /// h-step errors of `adaptive` itself: `adaptive_errors` are those of the coefficients before they are
        /// separated into b, f and g, where there are such.
        pub separated_h_step: ErrorStatistics,
        /// The output itself over the same samples, for the fit in percent.
        pub output: ErrorStatistics,
        /// Output minus the output `horizon` samples before: what doing nothing would reach.
        pub persistence: ErrorStatistics,
        /// 1 - forgetting factor over the updates: its `max` belongs to the smallest factor.
        pub forgetting: ErrorStatistics,
        /// Forgetting factor of the last update.
        pub forgetting_factor: f64,
        /// Innovation of the last update: output minus one-step prediction.
        pub innovation: f64,
        /// The same over its usual size: about 1 when all is well.
        pub innovation_ratio: f64,
        /// Largest magnitude of a pole of the adaptive model.
        pub pole_radius: f64,
        /// Travel over the horizon after a step to the mean positive (0) and negative (1) command so far, adaptive over
        /// classical model.
        pub gain_ratio: [f64; 2],
        /// Part of the recent samples in which a positive (0) or negative (1) command was in the regressor.
        pub excitation: [f64; 2],
        /// Trace of the covariance.
        pub covariance_trace: f64,
        /// Part of the driven half's weighted norm that the split into b, f, g does not explain; 0 for an exact split.
        pub split_residual: f64,
        /// Lowest command that N was learned from: below it N is extrapolated.
        pub command_low: f64,
        /// Highest command that N was learned from.
        pub command_high: f64,
        /// Recursive updates made.
        pub updates: u64,
        /// Samples that could not be used (gap, fault, missing command).
        pub skipped: u64,
        /// Samples that were too far from every prediction to be used.
        pub outliers: u64,
        /// Samples since the last one that the coefficients have learned from.
        pub since_update: u64,
        /// Samples of the horizon.
        pub horizon: u32,
        /// Why the model is not to be trusted, [`model_fault`] bits; 0 is healthy.
        pub faults: u32,
    }
}

/// Bits of [`AxisSnapshot::faults`]; 0 is healthy.
pub mod model_fault {
    /// Offline identification has not ended: there are no coefficients yet.
    pub const TRAINING: u32 = 1;
    /// The training data did not excite every coefficient; those it did not are held at zero.
    pub const RANK_DEFICIENT: u32 = 2;
    /// The covariance reached its bound in this update.
    pub const COVARIANCE_BOUND: u32 = 4;
    /// A coefficient or the covariance is not finite.
    pub const NOT_FINITE: u32 = 8;
    /// The last sample could not be used.
    pub const SAMPLE_SKIPPED: u32 = 16;
    /// The last sample was too far from every prediction to be used.
    pub const OUTLIER: u32 = 32;
    /// The axis rests: nothing is learned.
    pub const RESTING: u32 = 64;
    /// One sign of the command has not been used for long; what is known of it is from before.
    pub const ONE_SIDED: u32 = 128;
    /// A pole of the adaptive model makes a prediction grow more than e-fold over the horizon.
    pub const UNSTABLE: u32 = 256;
    /// The adaptive model's gain is less than a quarter or more than four times the classical one's, or turned round.
    pub const GAIN: u32 = 512;

    /// The bits that do not come and go with the samples.
    pub const LASTING: u32 = TRAINING | RANK_DEFICIENT | NOT_FINITE;
    /// Names of the bits, lowest first.
    pub const NAMES: [&str; 10] = [
        "training",
        "rank-deficient",
        "covariance-bound",
        "not-finite",
        "sample-skipped",
        "outlier",
        "resting",
        "one-sided",
        "unstable",
        "gain",
    ];
}

shared_struct! {
    /// The models after one sample: ident-proc to control-proc. The newest counts.
    #[type_name("hydraxis.CoefficientSnapshot/3")]
    pub struct CoefficientSnapshot {
        /// `sequence` names the last sample that the coefficients have learned from.
        pub header: Header,
        /// One entry per axis.
        pub axes: [AxisSnapshot; MAX_AXES],
    }
}
message!(CoefficientSnapshot, "coefficient-snapshot", publishers 1, buffer 16);

shared_struct! {
    /// Targets for this tick and the coming ones, from any program to control-proc.
    #[type_name("hydraxis.Reference/1")]
    pub struct Reference {
        /// `sequence` is the tick that the first target is meant for; it must not go back.
        pub header: Header,
        /// Targets per axis, m: entry i is for tick `sequence` + i.
        pub positions: [[f64; MAX_PREVIEW]; MAX_AXES],
        /// Targets given per axis, 1 to [`MAX_PREVIEW`].
        pub preview: u32,
        /// Zero.
        pub reserved: u32,
    }
}
message!(Reference, "reference", publishers 1, buffer 4);

/// Names of the set bits, for messages to people.
pub fn bit_names<'a>(bits: u32, names: &'a [&'a str]) -> impl Iterator<Item = &'a str> {
    names.iter().enumerate().filter(move |(i, _)| bits & (1 << i) != 0).map(|(_, name)| *name)
}
