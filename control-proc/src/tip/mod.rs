//! References of the teeth: the cylinders' motions under which the bucket's teeth follow the task `[tip]`.
//!
//! | module | what it holds |
//! |---|---|
//! | [`way`] | straight lines and arcs of the teeth |
//! | `piece` | one line or arc |
//! | `rounding` | a way without corners |
//! | [`posture`] | the cylinders along the way; the boom moves as little as possible |
//! | [`timing`] | how fast the teeth go: speeds, pump, accelerations, jerk |
//! | [`watch`] | in the loop: where the teeth are, and their distance from the way |
//!
//! A task is planned once, when a controller is made, and refused if the machine cannot do it. In the loop the four
//! axes only look up where they should be. What they trace together is the way, however slowly time goes on along it
//! ([`crate::reference::path`]).

mod piece;
pub mod posture;
mod rounding;
pub mod timing;
pub mod watch;
pub mod way;

use mechanism::{AXES, Dynamics, Mechanism, Pose, Vector};
use pipeline::machine::{Axis, Machine, ReferenceSource, TipTask};
use posture::{Cylinders, Freedom, NoPosture, Short};
use timing::Timing;
use way::{TipPlace, Way};

use crate::protection::walls::Walls;

/// Part of a cylinder's largest force that may hold bodies and payload; the rest moves them.
const HOLDING: f64 = 0.9;
/// Least distance of a task from a virtual wall, m: what a controller is off its way must not stop the task.
pub const WALL_MARGIN: f64 = 0.03;
/// Length between two places at which forces and walls are looked at, m.
const FORCE_STEP: f64 = 0.05;

/// Why a machine cannot do its task.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TipError {
    /// A piece has no length.
    #[error("{0}: found a piece that neither moves the teeth nor turns the bucket; allowed: another end")]
    NoWay(String),
    /// The teeth cannot be at a place.
    #[error("{piece}: found {place}, {what}")]
    Place {
        /// The piece, in words.
        piece: String,
        /// Place and pitch, in words.
        place: String,
        /// What is in the way there.
        what: String,
    },
    /// No smooth motion of the boom leads along the runs.
    #[error(
        "{piece}: found a way from {from} to {to} along which the boom would have to jump; allowed: a \
         shorter way, another pitch, or a position tip.telescope"
    )]
    Run {
        /// The piece with which the run begins, in words.
        piece: String,
        /// Its begin, in words.
        from: String,
        /// Its end, in words.
        to: String,
    },
}

/// The motion of the cylinders of one task.
#[derive(Debug, Clone, PartialEq)]
pub struct TipPlan {
    way: Way,
    /// T, s.
    period: f64,
    /// s at every period, m.
    lengths: Vec<f64>,
    /// Positions of the cylinders at every period, m.
    positions: Vec<[f64; AXES]>,
}

impl TipPlan {
    /// Plans the task of a machine; `None` for a machine whose axes follow none.
    ///
    /// # Errors
    /// The machine cannot do it: a place is out of reach, needs a position outside the soft limits or more force than a
    /// cylinder has.
    pub fn of(machine: &Machine) -> Result<Option<Self>, TipError> {
        let follows = |axis: &Axis| axis.reference == ReferenceSource::Tip;
        if machine.axes.iter().take(AXES).all(follows) { Self::of_task(machine) } else { Ok(None) }
    }

    /// Plans the task of a machine, whether its axes follow it or not; `None` for a machine without a task, or without
    /// teeth.
    ///
    /// # Errors
    /// As [`Self::of`].
    pub fn of_task(machine: &Machine) -> Result<Option<Self>, TipError> {
        match (&machine.tip, &machine.mechanism) {
            (Some(task), Some(mechanism)) if machine.axes.len() >= AXES => {
                Self::new(machine, mechanism, task).map(Some)
            }
            _ => Ok(None),
        }
    }

    fn new(machine: &Machine, mechanism: &Mechanism, task: &TipTask) -> Result<Self, TipError> {
        let way = Way::new(task, mechanism.geometry.bucket_length)
            .map_err(|number| TipError::NoWay(named(machine, number)))?;
        let cylinders = Cylinders::new(machine, mechanism);
        let freedom = Freedom::choose(&cylinders, &way, task.telescope).map_err(|why| refused(machine, &way, why))?;
        let at = |s: f64| cylinders.positions(&way.place(s), freedom.at(s));
        // All places between those that were tried are within reach as well: the way is smooth.
        let positions = |s: f64| at(s).unwrap_or([f64::NAN; AXES]);
        expect_forces(machine, mechanism, &way, positions)?;
        expect_within_walls(machine, &way, positions)?;
        let timing = Timing::new(machine, task.speed);
        let runs = way.runs();
        let mut lengths = vec![0.0];
        for run in &runs {
            // The end of a run is the begin of the next one.
            let inside = |s: f64| {
                let s = s.clamp(run.0, run.1 - 1e-9 * (run.1 - run.0));
                positions(s)
            };
            lengths.extend(timing.run(*run, inside));
        }
        let mut plan = Self { period: machine.timing.period.as_secs_f64(), lengths, positions: Vec::new(), way };
        plan.positions = plan
            .lengths
            .iter()
            .map(|s| cylinders.positions(&plan.way.place(*s), freedom.at(*s)).unwrap_or([f64::NAN; AXES]))
            .collect();
        Ok(plan)
    }

    /// Time of the whole motion, s.
    pub fn duration(&self) -> f64 {
        self.period * (self.lengths.len() - 1) as f64
    }

    /// Points (s, m) of the motion of one axis.
    pub fn points(&self, axis: usize) -> Vec<(f64, f64)> {
        self.positions.iter().enumerate().map(|(k, all)| (k as f64 * self.period, all[axis])).collect()
    }

    /// The way of the teeth.
    pub fn way(&self) -> &Way {
        &self.way
    }

    /// Where the teeth should be at `t` s.
    pub fn place(&self, t: f64) -> TipPlace {
        self.way.place(self.length(t))
    }

    /// s at `t` s, m.
    pub fn length(&self, t: f64) -> f64 {
        let place = (t / self.period).clamp(0.0, (self.lengths.len() - 1) as f64);
        let (k, rest) = (place.floor() as usize, place.fract());
        let next = self.lengths[(k + 1).min(self.lengths.len() - 1)];
        self.lengths[k] + rest * (next - self.lengths[k])
    }
}

fn refused(machine: &Machine, way: &Way, why: NoPosture) -> TipError {
    match why {
        NoPosture::Place(s, short) => {
            let what = match short {
                Short::Reach => {
                    "where the teeth cannot be; allowed: places in reach of boom, arm and bucket".to_owned()
                }
                Short::Axis(i, position) => {
                    let axis = &machine.axes[i];
                    let (low, high) = axis.soft_limits;
                    format!(
                        "where axis.{} would have to be at {position:.3} m; allowed: {low} to {high} m, its soft \
                         limits",
                        axis.name
                    )
                }
            };
            TipError::Place { piece: named(machine, way.number(s)), place: told(&way.place(s)), what }
        }
        NoPosture::Run(from, to) => TipError::Run {
            piece: named(machine, way.number(from)),
            from: told(&way.place(from)),
            to: told(&way.place(to)),
        },
    }
}

/// A piece of a task in words: where it is in the machine file, or the rows of its file.
fn named(machine: &Machine, number: usize) -> String {
    match machine.tip.as_ref().and_then(|task| task.file.as_ref()) {
        Some(file) => format!("tip.file: {}: rows {} to {}", file.display(), number + 1, number + 2),
        None => format!("tip.piece[{number}]"),
    }
}

fn told(place: &TipPlace) -> String {
    format!("[{:.3}, {:.3}] m at a pitch of {:.1} degrees", place.at.x, place.at.z, place.pitch.to_degrees())
}

/// Refuses places at which boom, arm or bucket would be beyond a virtual wall, or so close to it that no speed is safe.
fn expect_within_walls(machine: &Machine, way: &Way, positions: impl Fn(f64) -> [f64; AXES]) -> Result<(), TipError> {
    let Some(walls) = Walls::of(machine) else { return Ok(()) };
    let parts = (way.length() / FORCE_STEP).ceil().max(1.0);
    for s in (0..=parts as usize).map(|k| way.length() * k as f64 / parts) {
        if let Some((wall, margin)) = walls.least_distance(&positions(s)).filter(|(_, d)| *d < WALL_MARGIN) {
            let what = if margin < 0.0 {
                format!("where boom, arm or bucket would be {:.3} m beyond walls.{wall}", -margin)
            } else {
                format!("where boom, arm or bucket would be {margin:.3} m before walls.{wall}")
            };
            let what = format!("{what}; allowed: at least {WALL_MARGIN} m before it");
            return Err(TipError::Place { piece: named(machine, way.number(s)), place: told(&way.place(s)), what });
        }
    }
    Ok(())
}

/// Refuses places at which bodies and payload are too heavy for a cylinder.
fn expect_forces(
    machine: &Machine,
    mechanism: &Mechanism,
    way: &Way,
    positions: impl Fn(f64) -> [f64; AXES],
) -> Result<(), TipError> {
    let Some(supply) = machine.hydraulics.map(|hydraulics| hydraulics.supply) else { return Ok(()) };
    let parts = (way.length() / FORCE_STEP).ceil().max(1.0);
    for s in (0..=parts as usize).map(|k| way.length() * k as f64 / parts) {
        let pose = Pose::new(&mechanism.geometry, &mechanism.lengths(&positions(s)));
        let holding = Dynamics::new(&mechanism.masses, &pose, &[0.0; AXES]).holding_force(&pose, Vector::default());
        for (axis, force) in machine.axes.iter().zip(holding) {
            let Some(plant) = &axis.plant else { continue };
            let of =
                |filled: f64, drained: f64| HOLDING * (supply.pressure * filled - supply.return_pressure * drained);
            let (push, pull) = (of(plant.piston_area, plant.rod_area), of(plant.rod_area, plant.piston_area));
            if force > push || force < -pull {
                let what = format!(
                    "where the cylinder of axis.{} would have to hold {:.0} kN; allowed: {:.0} to {:.0} kN",
                    axis.name,
                    1e-3 * force,
                    -1e-3 * pull,
                    1e-3 * push
                );
                return Err(TipError::Place { piece: named(machine, way.number(s)), place: told(&way.place(s)), what });
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
