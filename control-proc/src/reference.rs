//! Target generators of all axes.
//!
//! ```text
//! sines        g(t) = center + sum amplitude sin(2 pi frequency t + phase)
//! ramps        g(t) = straight lines through the points, t taken modulo the last point's time
//! trajectory   g(t) = straight lines through the rows of a file, the last held
//! ```
//!
//! t time since the axis began to follow, s; g position, m; the settings are `[axis.NAME.reference]`. Trap: g knows
//! nothing of where the axis stands; [`crate::target`] leads from there to g.

use std::f64::consts::TAU;

use pipeline::{
    columns::TableError,
    machine::{Axis, Machine, ReferenceSource, Sine},
};

use crate::trajectory::Trajectory;

/// Why the targets of an axis cannot be generated.
#[derive(Debug, thiserror::Error)]
pub enum ReferenceError {
    /// Its trajectory is refused.
    #[error("axis.{axis}.reference.file: {source}")]
    Trajectory {
        /// The axis.
        axis: String,
        /// Why.
        source: TableError,
    },
}

/// The target generators of a machine, built once.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferenceGenerator {
    axes: Vec<Generator>,
}

/// One axis.
#[derive(Debug, Clone, PartialEq)]
enum Generator {
    /// Nothing to generate: the axis stays, or the channel tells.
    None,
    Sines {
        center: f64,
        sines: Vec<Sine>,
    },
    Ramps(Trajectory),
    Trajectory(Trajectory),
}

impl ReferenceGenerator {
    /// Reads what the machine file names.
    ///
    /// # Errors
    /// A trajectory's file is refused, by row and column.
    pub fn new(machine: &Machine) -> Result<Self, ReferenceError> {
        let axes = machine.axes.iter().map(Generator::new).collect::<Result<_, _>>()?;
        Ok(Self { axes })
    }

    /// Where axis number `axis` should be at `t` s, m; `None` for an axis that stays where it is, or whose targets
    /// come from the channel.
    pub fn position(&self, axis: usize, t: f64) -> Option<f64> {
        match self.axes.get(axis)? {
            Generator::None => None,
            Generator::Sines { center, sines } => {
                let sum: f64 = sines.iter().map(|s| s.amplitude * (TAU * s.frequency * t + s.phase).sin()).sum();
                Some(center + sum)
            }
            Generator::Ramps(round) => Some(round.position(t.rem_euclid(round.end()))),
            Generator::Trajectory(trajectory) => Some(trajectory.position(t)),
        }
    }
}

impl Generator {
    fn new(axis: &Axis) -> Result<Self, ReferenceError> {
        Ok(match &axis.reference {
            ReferenceSource::Hold | ReferenceSource::Channel => Self::None,
            ReferenceSource::Sines { center, sines } => Self::Sines { center: *center, sines: sines.clone() },
            ReferenceSource::Ramps(points) => Self::Ramps(Trajectory::through(points.clone())),
            ReferenceSource::Trajectory { file, column } => Self::Trajectory(
                Trajectory::read(file, column, axis)
                    .map_err(|source| ReferenceError::Trajectory { axis: axis.name.clone(), source })?,
            ),
        })
    }
}
