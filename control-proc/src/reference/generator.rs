//! Reference generators of all axes.
//!
//! ```text
//! sines        g(t) = center + sum amplitude sin(2 pi frequency t + phase)
//! ramps        g(t) = straight lines through the points, t taken modulo the last point's time
//! trajectory   g(t) = straight lines through the rows of a file, the last position is held
//! tip          g(t) = straight lines through the motion that was planned for the teeth, the last position is held
//! ```
//!
//! t time since the axis began to follow, s; g position, m. The settings are `[axis.NAME.reference]`. Trap: g does not
//! depend on where the axis stands; [`super::References`] leads from there to g.
//!
//! The axes of the teeth have a time t of their own, which begins for all of them at once: when the last of them has
//! come to its g(0).

use std::f64::consts::TAU;

use pipeline::machine::Sine;

use super::trajectory::Trajectory;
use crate::tip::TipPlan;

/// The reference generators of a machine, one per axis. Collected from [`Generator`]s in the order of the axes;
/// [`crate::trajectory_file::read_references`] makes them from a machine file.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferenceGenerator {
    axes: Vec<Generator>,
    /// Tick along the path at which the motion of the teeth begins.
    tip_start: Option<f64>,
    /// The motion of the teeth, where axes follow one.
    plan: Option<TipPlan>,
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
    /// The axis' part of the motion of the teeth.
    Tip(Trajectory),
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
            Generator::Trajectory(trajectory) | Generator::Tip(trajectory) => Some(trajectory.position(t)),
        }
    }

    /// As [`Self::position`], at `tick` along the path, with periods of `period` s: an axis of the teeth is where their
    /// common time has led to.
    pub fn along(&self, axis: usize, t: f64, tick: f64, period: f64) -> Option<f64> {
        let is_tip = matches!(self.axes.get(axis), Some(Generator::Tip(_)));
        let since = || self.tip_start.map_or(0.0, |start| period * (tick - start).max(0.0));
        self.position(axis, if is_tip { since() } else { t })
    }

    /// Numbers of the axes that move the teeth.
    pub fn tip_axes(&self) -> impl Iterator<Item = usize> {
        (0..self.axes.len()).filter(|axis| matches!(self.axes[*axis], Generator::Tip(_)))
    }

    /// Tick along the path at which the motion of the teeth begins; none while their axes are not there yet.
    pub fn tip_start(&self) -> Option<f64> {
        self.tip_start
    }

    /// Gives the generators of the teeth the plan that they are parts of.
    #[must_use]
    pub fn with_plan(self, plan: Option<TipPlan>) -> Self {
        Self { plan, ..self }
    }

    /// The motion of the teeth, where axes follow one.
    pub fn plan(&self) -> Option<&TipPlan> {
        self.plan.as_ref()
    }

    /// Begins the motion of the teeth at this tick along the path; none ends it.
    pub fn begin_tip(&mut self, tick: Option<f64>) {
        self.tip_start = tick;
    }

    /// The time in s after which axis number `axis` stays where it is, or begins its round again; `None` without such a
    /// time.
    pub fn end(&self, axis: usize) -> Option<f64> {
        match self.axes.get(axis)? {
            Generator::None | Generator::Sines { .. } => None,
            Generator::Ramps(trajectory) | Generator::Trajectory(trajectory) | Generator::Tip(trajectory) => {
                Some(trajectory.end())
            }
        }
    }
}

impl FromIterator<Generator> for ReferenceGenerator {
    fn from_iter<I: IntoIterator<Item = Generator>>(axes: I) -> Self {
        Self { axes: axes.into_iter().collect(), tip_start: None, plan: None }
    }
}
