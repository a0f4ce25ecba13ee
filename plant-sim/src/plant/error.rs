//! Why a machine cannot be simulated.

use mechanism::{AXES, Flaw};
use pipeline::MAX_AXES;

use crate::integration::runge_kutta::LONGEST_STEP_NS;

/// Why [`PlantSim::new`](super::PlantSim::new) cannot build a machine.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlantError {
    /// An axis has no table with the parameters of its plant.
    #[error("axis.{axis}: found no simulated axis; give it a table [axis.{axis}.plant]")]
    NoPlant {
        /// Name of the axis.
        axis: String,
    },
    /// A sensor is at a joint of a machine without a mechanism.
    #[error("axis.{axis}.encoder.kind: found a sensor at a joint; allowed: \"cylinder\" without a table [mechanism]")]
    NoJoint {
        /// Name of the axis.
        axis: String,
    },
    /// The machine has simulated axes, but no supply and no oil.
    #[error("supply, oil: found nothing; give the simulated machine its tables [supply] and [oil]")]
    NoHydraulics,
    /// A millisecond is no whole number of steps.
    #[error("step: found {found_ns} ns; allowed: a divisor of {LONGEST_STEP_NS} ns")]
    Step {
        /// The step, ns.
        found_ns: u64,
    },
    /// An axis is too fast for the step.
    #[error(
        "axis.{axis}.plant: found a motion at {rate:.3e} 1/s, too fast for the simulator's step; \
         allowed: up to {limit:.3e} 1/s; more mass or dead volume, or less damping, stiffness, leakage or rated_flow"
    )]
    TooStiff {
        /// Name of the axis.
        axis: String,
        /// Its fastest rate, 1/s.
        rate: f64,
        /// The fastest rate that can be integrated, 1/s.
        limit: f64,
    },
    /// The mechanism has more axes than the machine.
    #[error("axis: found {found} axes; allowed: at least {AXES} where the machine has a table [mechanism]")]
    TooFewAxes {
        /// Number of axes.
        found: usize,
    },
    /// The linkage does not let an axis move over its stroke.
    #[error("mechanism: found {flaw} at axis {axis}; allowed: pins that let its cylinder move over its whole stroke")]
    Linkage {
        /// Name of the axis.
        axis: String,
        /// Why not.
        flaw: Flaw,
    },
    /// The axes of the mechanism together are too fast for the step.
    #[error(
        "{place}: found, with the axes that the mechanism couples, a motion at {rate:.3e} 1/s by {by}, too fast for \
         the simulator's step; allowed: up to {limit:.3e} 1/s; more mass or dead volume, or less damping, stiffness, \
         leakage or rated_flow, or a softer soil"
    )]
    TooStiffTogether {
        /// Table of the axis that makes the motion fast, or of the soil.
        place: String,
        /// What of the axis does.
        by: &'static str,
        /// Their fastest rate, 1/s.
        rate: f64,
        /// The fastest rate that can be integrated, 1/s.
        limit: f64,
    },
    /// Pump and load press a piston so deep into a soft end stop that the linkage does not close there.
    #[error(
        "axis.{axis}.plant.end_stop_stiffness: found stops into which pump and load press the piston by {depth:.3} m, \
         where its linkage does not close; allowed: from {least:.2e} N/m on"
    )]
    SoftStops {
        /// Name of the axis.
        axis: String,
        /// How deep the piston is pressed into the stop, m.
        depth: f64,
        /// A stiffness with which the linkage closes, N/m.
        least: f64,
    },
    /// The machine has more axes than a message holds.
    #[error("axis: found {found} axes; allowed: up to {MAX_AXES}")]
    TooManyAxes {
        /// Number of axes.
        found: usize,
    },
}
