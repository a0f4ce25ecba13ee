//! References of the teeth: the cylinders' motions under which the bucket's teeth follow the task `[tip]`.
//!
//! | module | what it holds |
//! |---|---|
//! | [`way`] | straight lines and arcs of the teeth |
//! | `piece` | one line or arc |
//! | `rounding` | a way without corners |
//! | [`freedom`] | the free axis along the way, by a person or by the least cost |
//! | `choice` | the motion of the boom with the least cost |
//! | [`posture`] | the cylinders in one place: positions, forces, walls |
//! | [`timing`] | how fast the teeth go: speeds, pump, accelerations, jerk |
//! | [`account`] | what a plan asks of the machine, piece by piece |
//! | [`watch`] | in the loop: where the teeth are, and their distance from the way |
//!
//! A task is planned once, when a controller is made, and refused if the machine cannot do it. In the loop the four
//! axes only look up where they should be. What they trace together is the way, however slowly time goes on along it
//! ([`crate::reference::path`]).

pub mod account;
mod choice;
pub mod freedom;
mod piece;
pub mod posture;
mod rounding;
pub mod timing;
pub mod watch;
pub mod way;

use freedom::{Freedom, NoPosture};
use mechanism::{AXES, Mechanism};
use pipeline::machine::{Axis, Machine, ReferenceSource, TipTask};
use posture::{Cylinders, Short};
use timing::Timing;
use way::{TipPlace, Way};

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
         shorter way, another pitch, or a position tip.telescope or tip.boom"
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
    freedom: Freedom,
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
        let freedom = Freedom::choose(&cylinders, &way, task).map_err(|why| refused(machine, &cylinders, &way, why))?;
        let at = |s: f64| cylinders.positions(&way.place(s), freedom.at(s));
        // All places between those that were tried are within reach as well: the way is smooth.
        let positions = |s: f64| at(s).unwrap_or([f64::NAN; AXES]);
        let timing = Timing::new(machine, task);
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
        let mut plan =
            Self { period: machine.timing.period.as_secs_f64(), lengths, positions: Vec::new(), way, freedom };
        plan.positions = plan
            .lengths
            .iter()
            .map(|s| cylinders.positions(&plan.way.place(*s), plan.freedom.at(*s)).unwrap_or([f64::NAN; AXES]))
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

    /// Positions of the cylinders at every period, m.
    pub fn positions(&self) -> &[[f64; AXES]] {
        &self.positions
    }

    /// Time between two positions, s.
    pub fn period(&self) -> f64 {
        self.period
    }

    /// The free axis along the way.
    pub fn freedom(&self) -> &Freedom {
        &self.freedom
    }

    /// The way of the teeth.
    pub fn way(&self) -> &Way {
        &self.way
    }

    /// Way of the teeth, m: turns in place are no part of it.
    pub fn travel(&self) -> f64 {
        self.way.travel(self.way.length())
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

fn refused(machine: &Machine, cylinders: &Cylinders, way: &Way, why: NoPosture) -> TipError {
    match why {
        NoPosture::Place(s, short) => TipError::Place {
            piece: named(machine, way.number(s)),
            place: told(&way.place(s)),
            what: missing(machine, cylinders, short),
        },
        NoPosture::Run(from, to) => TipError::Run {
            piece: named(machine, way.number(from)),
            from: told(&way.place(from)),
            to: told(&way.place(to)),
        },
    }
}

/// What is in the way, in words.
fn missing(machine: &Machine, cylinders: &Cylinders, short: Short) -> String {
    match short {
        Short::Reach => "where the teeth cannot be; allowed: places in reach of boom, arm and bucket".to_owned(),
        Short::Axis(i, position) => {
            let axis = &machine.axes[i];
            let (low, high) = axis.soft_limits;
            format!(
                "where axis.{} would have to be at {position:.3} m; allowed: {low} to {high} m, its soft limits",
                axis.name
            )
        }
        Short::Force(i, force) => {
            let (low, high) = cylinders.allowed_forces(i);
            format!(
                "where the cylinder of axis.{} would have to hold {:.0} kN; allowed: {:.0} to {:.0} kN",
                machine.axes[i].name,
                1e-3 * force,
                1e-3 * low,
                1e-3 * high
            )
        }
        Short::Wall(wall, distance) => {
            let side = if distance < 0.0 { "beyond" } else { "before" };
            format!(
                "where boom, arm or bucket would be {:.3} m {side} walls.{wall}; allowed: at least {:.3} m before it",
                distance.abs(),
                cylinders.wall_margin()
            )
        }
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

#[cfg(test)]
mod tests;
