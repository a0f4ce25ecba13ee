//! Valve commands, with the reason for each.

use iceoryx2::prelude::ZeroCopySend;

use super::{Header, Message};
use crate::{MAX_AXES, layout::shared_struct, statistics::ErrorStatistics};

shared_struct! {
    /// One axis of a [`ValveCommand`].
    #[type_name("hydraxis.AxisCommand/5")]
    pub struct AxisCommand {
        /// Valve command in [-1, 1], positive extends; made from sample `sequence` and held until the next.
        pub command: f64,
        /// Reference of this tick, m.
        pub reference: f64,
        /// Following error, reference - position, m.
        pub error: f64,
        /// Which controller made the command, a [`ControlMode`] as number.
        pub mode: u32,
        /// Why the axis stands still or the model is not used, [`control_flag`] bits; 0 is healthy.
        pub flags: u32,
        /// Mode that the axis is operated in, an [`AxisMode`](super::AxisMode) as number; 0 in a replay.
        pub operation: u32,
        /// Number of [`Request`](super::Request) messages that were refused so far.
        pub refused_requests: u32,
        /// Number of [`Request`](super::Request) messages that were accepted so far.
        pub taken_requests: u64,
        /// Numbers of snapshots that were refused so far, by [`REFUSALS`].
        pub rejected_snapshots: [u64; REFUSALS.len()],
        /// Number of plans of the predictive controller that its solver did not solve so far.
        pub unsolved_plans: u64,
        /// Following error over all ticks in which a controller followed the reference, approaches left out, m.
        pub tracking: ErrorStatistics,
        /// Following error over the ticks whose command the predictive controller made, m.
        pub model_tracking: ErrorStatistics,
        /// Number of times that a fault latched the axis so far.
        pub latches: u64,
        /// Tick of the last sample before the axis was latched for the last time; 0 before the first time.
        pub latched_at: u64,
        /// Why the axis was latched for the last time, [`control_flag`] bits; they stay when the axis is released.
        pub latched_by: u32,
        /// Number of ticks with a slowed reference since the axis was armed.
        pub slowed_ticks: u32,
        /// Gains of the fallback, as a part of those in the machine file: 1 until a [`Request`](super::Request) has
        /// changed them, 0 in a replay.
        pub gain: f64,
    }
}

/// Why a snapshot was refused, in the order of [`AxisCommand::rejected_snapshots`].
pub const REFUSALS: [&str; 7] = ["not-finite", "structure", "unstable", "direction", "unreachable", "speed", "worse"];

/// Which controller made a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum ControlMode {
    /// Neutral: the axis is not armed, is settling, or has a latched fault.
    Neutral = 0,
    /// The fallback, a PI controller with dead-band compensation.
    Fallback = 1,
    /// The predictive controller.
    Model = 2,
    /// A recording plays; no controller runs.
    Replay = 3,
    /// A person, by [`Request`](super::Request), within the limits.
    Manual = 4,
    /// A commissioning program, by [`Request`](super::Request), within the limits.
    Commission = 5,
}

impl ControlMode {
    /// The mode's name, or `unknown` for a number that is no mode.
    pub fn name(mode: u32) -> &'static str {
        ["neutral", "fallback", "model", "replay", "manual", "commission"].get(mode as usize).unwrap_or(&"unknown")
    }
}

/// Bits of [`AxisCommand::flags`]; 0 is healthy.
pub mod control_flag {
    /// The axis is not armed.
    pub const DISARMED: u32 = 1;
    /// The axis is settling: it waits for healthy samples before it moves.
    pub const SETTLING: u32 = 2;
    /// The feedback was stale, implausible or stuck; latched.
    pub const FEEDBACK: u32 = 4;
    /// The reference stopped, jumped, left the soft limits or is not finite; the axis holds.
    pub const REFERENCE: u32 = 8;
    /// The identifier has no model yet.
    pub const NO_MODEL: u32 = 16;
    /// The last approved snapshot is old; it is used until its lifetime is over.
    pub const MODEL_STALE: u32 = 32;
    /// The newest snapshot was refused.
    pub const MODEL_REFUSED: u32 = 64;
    /// The newest request was refused; the axis goes on in its mode.
    pub const REQUEST: u32 = 128;
    /// Requests stopped while the axis needed them; the axis has been off since.
    pub const REQUEST_STOPPED: u32 = 256;
    /// A soft limit is near: the command that was asked for would not stop the axis before it.
    pub const SOFT_LIMIT: u32 = 512;
    /// Commands came too late several times in a row; latched.
    pub const DEADLINE: u32 = 1024;
    /// The predictive controller found no plan several times in a row; latched.
    pub const SOLVER: u32 = 2048;
    /// The axis was driven and hardly moved; latched.
    pub const STALL: u32 = 4096;
    /// The following error was too large for too long; latched.
    pub const FOLLOWING: u32 = 8192;
    /// The emergency stop is or was pressed; latched, with the pilot pressure cut off.
    pub const EMERGENCY_STOP: u32 = 16384;
    /// No model has been usable for so long that the axis is limited to half of its speed.
    pub const HALF_SPEED: u32 = 32768;
    /// The model followed worse than the fallback, which a trial has shown: the fallback controls.
    pub const MODEL_WORSE: u32 = 65536;

    /// The reference goes on more slowly: it asks for more than an axis can give, or an axis waits for readings, or has
    /// only just been taken up.
    pub const SLOWED: u32 = 131_072;
    /// The axis moved though nobody had commanded it; latched, with the pilot pressure cut off.
    pub const MOTION: u32 = 262_144;
    /// The computer has been suspended, or a sample has a time that is still to come, so that nobody knows how old it
    /// is.
    pub const CLOCK: u32 = 524_288;
    /// A virtual wall is near: the command that was asked for would not stop boom, arm and bucket before it.
    pub const WALL: u32 = 1_048_576;
    /// The fallback controls for a few seconds, so that the model can be compared with it.
    pub const MODEL_TRIAL: u32 = 2_097_152;
    /// The axis swung though its reference did not ask for it: the fallback controls, with lower gains where it swung
    /// as well.
    pub const CAUTION: u32 = 4_194_304;
    /// The axis swung on under the lowest gains; latched.
    pub const SWING: u32 = 8_388_608;

    /// The bits of faults that keep the axis neutral until it is disarmed and armed again.
    pub const LATCHED: u32 = FEEDBACK | DEADLINE | SOLVER | STALL | FOLLOWING | CLOCK | SWING | CUT_OFF;
    /// Those of them that ask for the pilot pressure to be cut off.
    pub const CUT_OFF: u32 = EMERGENCY_STOP | MOTION;
    /// Names of the bits, lowest first.
    pub const NAMES: [&str; 24] = [
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
        "model-worse",
        "slowed",
        "motion",
        "clock",
        "wall",
        "model-trial",
        "caution",
        "swing",
    ];
}

/// Bits of [`CommandInputs::events`].
pub mod command_event {
    /// The lowest bits: these axes were disarmed by a stop, the first axis lowest.
    pub const STOPPED: u32 = 255;
    /// An emergency stop was asked for on the board, or came with a sample that was not worked.
    pub const EMERGENCY_STOP: u32 = 256;
    /// The controller began armed; in its first command only.
    pub const ARMED: u32 = 512;
    /// No sample came, so the axes were made neutral for now.
    pub const SILENT: u32 = 1024;
    /// No sample came for too long, so the axes were latched.
    pub const LOST: u32 = 2048;
    /// The clocks said nothing of the age of a sample, so the axes were latched.
    pub const CLOCK: u32 = 4096;
    /// Too many commands in a row were late, so the axes were latched and this command is neutral.
    pub const DEADLINE: u32 = 8192;
    /// The message repeats the command of its sample after a stop; no new sample had come.
    pub const REPEATED: u32 = 16384;
    /// The message is neutral without a decision: no new sample had come, or the controller ends.
    pub const NEUTRAL: u32 = 32768;
}

shared_struct! {
    /// What a [`ValveCommand`] was made of, beside its sample: enough to make it again from a recording.
    #[type_name("hydraxis.CommandInputs/1")]
    pub struct CommandInputs {
        /// Number of the snapshot that was used, plus 1; 0 without a snapshot.
        pub snapshot: u64,
        /// Session of the program that has sent the newest [`Reference`](super::Reference); 0 without a reference.
        pub reference_session: u64,
        /// Number of the newest reference.
        pub reference_number: u64,
        /// Count of the [`Request`](super::Request) messages that control-proc has read so far.
        pub requests: u64,
        /// Session of the publisher of the last request that was read; 0 before the first one.
        pub request_session: u64,
        /// Number of the last request that was read.
        pub request_number: u64,
        /// What happened between the command before and this one, [`command_event`] bits.
        pub events: u32,
        /// Zero.
        pub reserved: u32,
    }
}

/// What is known of the bucket's teeth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum TipState {
    /// Nothing: the machine has no mechanism, or the position of one of its axes is not known.
    Unknown = 0,
    /// Where they are.
    Known = 1,
    /// They follow their way.
    OnTheWay = 2,
}

shared_struct! {
    /// Where the bucket's teeth are, by the positions of the sample, and what the bucket carries.
    #[type_name("hydraxis.TeethState/2")]
    pub struct TeethState {
        /// Forward of the centre of swing, m.
        pub x: f64,
        /// Above ground, m.
        pub z: f64,
        /// Pitch of the bucket, from the x axis to the teeth, rad.
        pub pitch: f64,
        /// Distance of the teeth from the nearest place of their way, its ends included, m; 0 unless they follow it.
        pub error: f64,
        /// Pitch minus the planned one, rad; 0 unless the teeth follow their way.
        pub pitch_error: f64,
        /// Length of the way up to where the teeth should be, m; 0 unless they follow it.
        pub way: f64,
        /// What the bucket carries, kg: that of the machine file, or as estimated by the chamber pressures.
        pub payload: f64,
        /// A [`TipState`] as number.
        pub state: u32,
        /// Zero.
        pub reserved: u32,
    }
}

shared_struct! {
    /// The valve commands of one tick: control-proc (or a recording) to plant-sim and ident-proc.
    #[type_name("hydraxis.ValveCommand/11")]
    pub struct ValveCommand {
        /// `sequence` names the sample that the command was made from.
        pub header: Header,
        /// One entry per axis.
        pub axes: [AxisCommand; MAX_AXES],
        /// 1 asks for the pilot pressure of all valves to be cut off, whatever the commands are; else 0.
        pub cut_off: u32,
        /// Zero.
        pub reserved: u32,
        /// Session of the [`Request`](super::Request)s that count, or counted last; 0 before the first.
        pub operator: u64,
        /// Where the bucket's teeth are; without a [mechanism] and in a replay nothing is known of them.
        pub teeth: TeethState,
        /// What the command was made of; zero in a replay.
        pub inputs: CommandInputs,
    }
}
message!(ValveCommand, "valve-command", publishers 1, buffer 256);
