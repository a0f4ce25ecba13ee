//! The identified models and how good they are.

use iceoryx2::prelude::ZeroCopySend;

use super::{Header, Message};
use crate::{MAX_AXES, hammerstein::Coefficients, layout::shared_struct, statistics::ErrorStatistics};

shared_struct! {
    /// Errors of one model over the samples after training.
    #[type_name("hydraxis.ModelErrors/1")]
    pub struct ModelErrors {
        /// Output minus the prediction from the coefficients before it and the measured past.
        pub one_step: ErrorStatistics,
        /// Output minus the prediction made `horizon` samples before, with the coefficients held since then.
        pub h_step: ErrorStatistics,
        /// Output minus the output of the model when its own outputs have been fed back since the end of training.
        pub free_run: ErrorStatistics,
    }
}

shared_struct! {
    /// One axis of a [`CoefficientSnapshot`]. Both models are models of the position. Errors are in the unit of the
    /// identified output: m, or m/s where the identified output is the velocity.
    #[type_name("hydraxis.AxisSnapshot/4")]
    pub struct AxisSnapshot {
        /// The adaptive model, updated online.
        pub adaptive: Coefficients,
        /// The classical model, identified offline and held.
        pub classical: Coefficients,
        /// Errors of `adaptive`.
        pub adaptive_errors: ModelErrors,
        /// Errors of `classical`.
        pub classical_errors: ModelErrors,
        /// h-step errors of the adaptive model's coefficients before they are separated into b, f and g: what the
        /// separation costs. No program is given these coefficients.
        pub unseparated_h_step: ErrorStatistics,
        /// The output over these samples; the fit in percent needs its spread.
        pub output: ErrorStatistics,
        /// Output minus the output `horizon` samples before: the error of predicting no change.
        pub persistence: ErrorStatistics,
        /// 1 - forgetting factor over the updates: its `max` belongs to the smallest factor.
        pub forgetting: ErrorStatistics,
        /// Forgetting factor of the last update.
        pub forgetting_factor: f64,
        /// Innovation of the last update: output minus one-step prediction.
        pub innovation: f64,
        /// Innovation of the last update, divided by its usual size: about 1 for a healthy model.
        pub innovation_ratio: f64,
        /// Largest magnitude of a pole of the adaptive model.
        pub pole_radius: f64,
        /// Travel over the horizon after a step to the mean positive (0) and negative (1) command so far: travel of the
        /// adaptive model divided by travel of the classical model.
        pub gain_ratio: [f64; 2],
        /// Part of the recent samples in which a positive (0) or negative (1) command was in the regressor.
        pub excitation: [f64; 2],
        /// Trace of the covariance.
        pub covariance_trace: f64,
        /// Part of the weighted norm of the products f_i b_j that the separation into b, f, g does not explain; 0 for
        /// an exact separation.
        pub split_residual: f64,
        /// Lowest command that N was identified from: below it N is extrapolated.
        pub command_low: f64,
        /// Highest command that N was identified from: above it N is extrapolated.
        pub command_high: f64,
        /// Number of recursive updates.
        pub updates: u64,
        /// Number of samples that could not be used (gap, fault, missing command).
        pub skipped: u64,
        /// Number of outliers: samples too far from all predictions to be used.
        pub outliers: u64,
        /// Number of samples since the last sample that updated the coefficients.
        pub since_update: u64,
        /// Weights of the estimators that the estimator `auto` runs side by side, in the order of [`MEMBERS`]; their
        /// sum is 1. All are 0 with another estimator, and before training has found a first model.
        pub weights: [f64; MEMBERS.len()],
        /// Length of the horizon, samples.
        pub horizon: u32,
        /// Reasons to distrust the model, [`model_fault`] bits; 0 is healthy.
        pub faults: u32,
    }
}

/// The estimators that the estimator `auto` runs side by side, in the order of [`AxisSnapshot::weights`]: what they
/// learn, and their memory in horizons.
pub const MEMBERS: [&str; 11] = [
    "held",
    "still",
    "linear 4",
    "increments 4",
    "increments 8",
    "directional 8",
    "full 8",
    "full 20",
    "full 200",
    "smoothed 13",
    "smoothed 200",
];

/// Bits of [`AxisSnapshot::faults`]; 0 is healthy.
pub mod model_fault {
    /// Offline identification has not ended: there are no coefficients yet.
    pub const TRAINING: u32 = 1;
    /// The training data did not excite every coefficient; the coefficients without excitation are held at zero.
    pub const RANK_DEFICIENT: u32 = 2;
    /// The covariance reached its bound in this update.
    pub const COVARIANCE_BOUND: u32 = 4;
    /// A coefficient or the covariance is not finite.
    pub const NOT_FINITE: u32 = 8;
    /// The last sample could not be used.
    pub const SAMPLE_SKIPPED: u32 = 16;
    /// The last sample was an outlier.
    pub const OUTLIER: u32 = 32;
    /// The axis rests, so the coefficients are not updated.
    pub const RESTING: u32 = 64;
    /// One sign of the command has not been used for long: the coefficients of that branch are old.
    pub const ONE_SIDED: u32 = 128;
    /// A pole of the adaptive model makes a prediction grow more than e-fold over the horizon.
    pub const UNSTABLE: u32 = 256;
    /// The adaptive model's gain is less than a quarter or more than four times the classical model's gain, or has the
    /// other sign.
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
    /// The models after one sample: ident-proc to control-proc. Only the newest snapshot counts.
    #[type_name("hydraxis.CoefficientSnapshot/5")]
    pub struct CoefficientSnapshot {
        /// `sequence` names the last sample that updated the coefficients.
        pub header: Header,
        /// One entry per axis.
        pub axes: [AxisSnapshot; MAX_AXES],
    }
}
// 64 messages: 64 ms at 1 kHz, longer than a program in Python usually waits for a core. Each has 8 kB for each reader.
message!(CoefficientSnapshot, "coefficient-snapshot", publishers 1, buffer 64);
