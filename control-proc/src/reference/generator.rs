//! Reference generators of all axes.
//!
//! ```text
//! sines        g(t) = center + sum amplitude sin(2 pi frequency t + phase)
//! ramps        g(t) = straight lines through the points, t taken modulo the last point's time
//! trajectory   g(t) = straight lines through the rows of a file, the last position is held
//! ```
//!
//! t time since the axis began to follow, s; g position, m. The settings are `[axis.NAME.reference]`. Trap: g does not
//! depend on where the axis stands; [`super::References`] leads from there to g.

use std::f64::consts::TAU;

use pipeline::machine::Sine;

use super::trajectory::Trajectory;

/// The reference generators of a machine, one per axis. Collected from [`Generator`]s in the order of the axes;
/// [`crate::trajectory_file::read_references`] makes them from a machine file.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferenceGenerator {
    axes: Vec<Generator>,
}

/// The generator of one axis.
#[derive(Debug, Clone, PartialEq)]
pub enum Generator {
    /// Generates nothing: the axis stays where it is, or its references come from the channel.
    None,
    /// A sum of sines.
    Sines {
        /// Mean position, m.
        center: f64,
        /// The sines that are added to it.
        sines: Vec<Sine>,
    },
    /// A trajectory that begins again at its end.
    Ramps(Trajectory),
    /// A trajectory whose last position is held.
    Trajectory(Trajectory),
}

impl ReferenceGenerator {
    /// Where axis number `axis` should be at `t` s, m; `None` for an axis whose generator generates nothing.
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

    /// The time in s after which axis number `axis` stays where it is, or begins its round again; `None` without such a
    /// time.
    pub fn end(&self, axis: usize) -> Option<f64> {
        match self.axes.get(axis)? {
            Generator::None | Generator::Sines { .. } => None,
            Generator::Ramps(trajectory) | Generator::Trajectory(trajectory) => Some(trajectory.end()),
        }
    }
}

impl FromIterator<Generator> for ReferenceGenerator {
    fn from_iter<I: IntoIterator<Item = Generator>>(axes: I) -> Self {
        Self { axes: axes.into_iter().collect() }
    }
}
