//! Wrong models: what commissioning found of a drawn machine, with one thing wrong.
//!
//! | kind | what is wrong |
//! |---|---|
//! | gain | all speeds, by a factor |
//! | dead time | dead time, by a factor |
//! | lag | time constant, by a factor; one below a period counts as a period |
//! | curve | v_n (v / v_n)^p with a power p; or an S; or a straight line where the valve has an S |
//! | dead bands | each, by a sum |
//! | hysteresis | none, or twice as much; where none was found, 0.02 |
//!
//! v speeds at the openings, v_n that at the largest opening m/s. The S is 3 r^2 - 2 r^3 of the part r of the largest
//! opening. Machines 0 and 1 have the first kind of the list or, with another seed, another one; machines 2 and 3 have
//! the next kind, and so on. Every half of a set has thus every kind equally often.
//!
//! The spring of the oil is not among them: the loop does not know it, only the tuning does, and the gains stay. The
//! sign is not either: a model file has no negative speeds.
//!
//! Trap: what a model file may not have is no wrong model. A factor that would make the delay too long is inverted. A
//! dead band holds half of the hysteresis at least.

use std::ops::RangeInclusive;

use pipeline::{hammerstein::MAX_DELAY, machine::Commissioned};

use super::{
    drive::{Outcome, Ready, Run, run},
    rig::{Draw, Rig},
    task::Task,
};
use crate::failure::Failure;

/// Factor of the speeds.
pub const GAIN: RangeInclusive<f64> = 0.3..=3.0;
/// Factor of the dead time.
pub const DEAD_TIME: RangeInclusive<f64> = 0.5..=2.0;
/// Factor of the time constant.
pub const LAG: RangeInclusive<f64> = 0.3..=3.0;
/// Power of the curve.
pub const POWER: RangeInclusive<f64> = 0.6..=1.6;
/// Sum with a dead band.
pub const DEAD_BAND: RangeInclusive<f64> = -0.1..=0.1;
/// Hysteresis in place of none.
const INVENTED: f64 = 0.02;
/// Widest dead band of a model file.
const WIDEST: f64 = 0.9;
/// The first of the streams of random numbers that are for wrong models. Those before are for the machines.
const STREAM: u64 = 1 << 32;

/// What is wrong with a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// The speeds.
    Gain,
    /// The dead time.
    DeadTime,
    /// The time constant.
    Lag,
    /// The shape of the curve.
    Curve,
    /// The dead bands.
    DeadBands,
    /// The hysteresis.
    Hysteresis,
}

impl Kind {
    /// All kinds, in the order of the report.
    pub const ALL: [Self; 6] = [Self::Gain, Self::DeadTime, Self::Lag, Self::Curve, Self::DeadBands, Self::Hysteresis];

    /// The kind of a machine.
    pub fn of(seed: u64, number: u64) -> Self {
        let count = Self::ALL.len() as u64;
        Self::ALL[((seed % count + number / 2) % count) as usize]
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Gain => "gain",
            Self::DeadTime => "dead time",
            Self::Lag => "lag",
            Self::Curve => "curve",
            Self::DeadBands => "dead bands",
            Self::Hysteresis => "hysteresis",
        }
    }
}

/// A wrong model.
#[derive(Debug, Clone, PartialEq)]
pub struct WrongModel {
    /// What is wrong.
    pub kind: Kind,
    /// How wrong it is, as a person reads it.
    pub amount: String,
    /// The model.
    pub model: Commissioned,
}

impl WrongModel {
    /// The wrong model of a machine whose model is `right`, in the set with this seed.
    pub fn draw(seed: u64, rig: &Rig, right: &Commissioned) -> Self {
        let kind = Kind::of(seed, rig.number);
        let mut draw = Draw::new(seed, STREAM + rig.number);
        let mut model = right.clone();
        let amount = match kind {
            Kind::Gain => scale_speeds(&mut model, draw.log(GAIN)),
            Kind::DeadTime => {
                let longest = longest(rig) - right.time_constant;
                scale(&mut model.dead_time, draw.log(DEAD_TIME), longest)
            }
            Kind::Lag => {
                model.time_constant = right.time_constant.max(rig.period());
                scale(&mut model.time_constant, draw.log(LAG), longest(rig) - right.dead_time)
            }
            Kind::Curve if draw.unit() < 0.5 => {
                let power = draw.log(POWER);
                bend(&mut model, |_, speed| speed.powf(power));
                format!("power {power:.2}")
            }
            Kind::Curve if rig.is_s_shaped => {
                bend(&mut model, |opening, _| opening);
                "straight".to_owned()
            }
            Kind::Curve => {
                bend(&mut model, |opening, _| opening * opening * (3.0 - 2.0 * opening));
                "an S".to_owned()
            }
            Kind::DeadBands => move_dead_bands(&mut model, [draw.even(DEAD_BAND), draw.even(DEAD_BAND)]),
            Kind::Hysteresis => change_hysteresis(&mut model, draw.unit() < 0.5),
        };
        Self { kind, amount, model }
    }
}

/// Longest dead time and lag that a model file may have, s.
fn longest(rig: &Rig) -> f64 {
    (MAX_DELAY - 1) as f64 * rig.period()
}

/// Multiplies `value` with `factor`, or divides it where that would be more than `most`.
fn scale(value: &mut f64, factor: f64, most: f64) -> String {
    let factor = if *value * factor > most { 1.0 / factor } else { factor };
    *value *= factor;
    format!("x {factor:.2}")
}

fn scale_speeds(model: &mut Commissioned, factor: f64) -> String {
    model.speeds_extend.iter_mut().chain(&mut model.speeds_retract).for_each(|speed| *speed *= factor);
    format!("x {factor:.2}")
}

/// Gives the curve another shape, with parts of the largest opening and parts of its speed. The largest speed stays.
fn bend(model: &mut Commissioned, shape: impl Fn(f64, f64) -> f64) {
    let last = model.openings.last().copied().unwrap_or(1.0);
    for speeds in [&mut model.speeds_extend, &mut model.speeds_retract] {
        let most = speeds.last().copied().unwrap_or(1.0);
        let bent = model.openings.iter().zip(speeds.iter()).map(|(x, v)| most * shape(x / last, v / most));
        *speeds = bent.collect();
    }
}

fn move_dead_bands(model: &mut Commissioned, by: [f64; 2]) -> String {
    let held = 0.5 * model.hysteresis;
    let before = model.dead_band;
    let band = &mut model.dead_band;
    for (side, by) in [&mut band.extend, &mut band.retract].into_iter().zip(by) {
        *side = (*side + by).clamp(held, WIDEST);
    }
    format!("{:+.3} {:+.3}", band.extend - before.extend, band.retract - before.retract)
}

/// Doubles the hysteresis, as far as the dead bands hold it, or takes it away. One that was not found is invented.
fn change_hysteresis(model: &mut Commissioned, is_doubled: bool) -> String {
    let held = 2.0 * model.dead_band.extend.min(model.dead_band.retract);
    let before = model.hysteresis;
    let more = if before > 0.0 { 2.0 * before } else { INVENTED }.min(held);
    let grows = before == 0.0 || (is_doubled && more > before);
    model.hysteresis = if grows { more } else { 0.0 };
    format!("{before:.3} -> {:.3}", model.hysteresis)
}

/// A machine that was driven with a wrong model.
#[derive(Debug, Clone)]
pub struct Misled {
    /// What is wrong.
    pub wrong: WrongModel,
    /// The tasks, in the order of [`Task::ALL`].
    pub tasks: Vec<Triple>,
}

/// The runs of one task.
#[derive(Debug, Clone)]
pub struct Triple {
    /// The task.
    pub task: Task,
    /// The fallback with the right model.
    pub right: Run,
    /// The fallback with the wrong model.
    pub fallback: Run,
    /// The Smith predictor with the wrong model.
    pub smith: Run,
}

/// Commissions a machine and drives it with a wrong model. Nothing is driven where commissioning leaves control to the
/// fallback.
///
/// # Errors
/// The machine cannot be simulated or controlled: an error of this program.
pub fn mislead(rig: &Rig, seed: u64) -> Result<Outcome<Option<Misled>>, Failure> {
    let (tries, ready) = Ready::new(rig)?;
    let result = match ready {
        Ok(ready) if ready.is_chosen => Ok(Some(misled(&ready, seed)?)),
        Ok(_) => Ok(None),
        Err(refusal) => Err(refusal),
    };
    Ok(Outcome { rig: rig.clone(), tries, result })
}

fn misled(ready: &Ready<'_>, seed: u64) -> Result<Misled, Failure> {
    let wrong = WrongModel::draw(seed, ready.rig, &ready.model);
    let settings = ready.settings_with(&wrong.model)?;
    let triple = |task: &Task| {
        Ok(Triple {
            task: *task,
            right: run(ready.rig, *task, &ready.settings, "none")?,
            fallback: run(ready.rig, *task, &settings, "none")?,
            smith: run(ready.rig, *task, &settings, "adaptive")?,
        })
    };
    let tasks = Task::ALL.iter().map(triple).collect::<Result<_, Failure>>()?;
    Ok(Misled { wrong, tasks })
}
