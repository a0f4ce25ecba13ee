//! The bucket's teeth go to a place in a straight line, as a person asks at a terminal or holds a button of the page.
//!
//! The way is planned as the task `[tip]` of a machine file is, from where the teeth are, with the telescope where it
//! is. The axes get it through the reference channel ([`mod@sender`]).
//!
//! Runs in the operator's process, beside the loop. When it dies or is suspended, the axes are off 0.1 s later: axes
//! that only came to a stand at their last reference would first make up for their lag, some decimetres of the teeth.

mod sender;

use std::{
    ops::RangeInclusive,
    time::{Duration, Instant},
};

use control_proc::tip::{TipPlan, watch::TipWatch};
use mechanism::{AXES, Mechanism};
use pipeline::{
    channel::Prefix,
    machine::{Axis, Machine, ReferenceSource, TipFree, TipPiece, TipShape, TipTask, TipWithout},
    message::{AxisMode, EncoderSample, TeethState, control_flag},
};
use sender::{Sender, way_of};

use crate::{
    arguments::load_bare,
    failure::Failure,
    group::{
        operator::{Operator, OperatorError, board},
        running::machine_of,
    },
};

/// The four axes.
pub const ALL: [usize; AXES] = [0, 1, 2, 3];
/// Pitches that a person may ask for, degrees.
pub const PITCHES: RangeInclusive<f64> = -360.0..=360.0;
/// Speed of the teeth where none is asked for, m/s.
pub const SPEED: f64 = 0.1;
/// Distance of an axis from its end at which it has arrived, m and counts of its encoder, of which the longer one
/// counts.
const NEAR: f64 = 0.002;
const NEAR_COUNTS: f64 = 3.0;
/// Time after the end of the way, after which they need not come any nearer.
const PATIENCE: Duration = Duration::from_secs(5);
/// Distance of the teeth by the machine file from those by the group, m, that a motion between the two explains.
const SAME: f64 = 0.05;
/// What an axis shows that does not follow at the moment.
const WAITING: u32 = control_flag::REFERENCE | control_flag::SLOWED | control_flag::WALL | control_flag::SETTLING;

/// Where the teeth are to go.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TeethPlace {
    /// x and z, m.
    pub to: [f64; 2],
    /// Degrees; none where the pitch is to stay.
    pub pitch: Option<f64>,
    /// m/s.
    pub speed: f64,
}

impl TeethPlace {
    /// Its distance from teeth at `[x, z]`, m.
    pub fn away(&self, [x, z]: [f64; 2]) -> f64 {
        (x - self.to[0]).hypot(z - self.to[1])
    }
}

/// The teeth of the machine of one group.
pub struct MovableTeeth {
    machine: Machine,
    mechanism: Mechanism,
}

impl MovableTeeth {
    /// Of the machine that the group runs.
    ///
    /// # Errors
    /// The machine has no teeth, or its axes follow no program.
    pub fn new(prefix: &Prefix) -> Result<Self, Failure> {
        let refuse = |text: String| Err(Failure::usage(text));
        let machine = load_bare(&machine_of(prefix, &[])?, None)?;
        board(prefix)?.expect_machine(&machine).map_err(OperatorError::from)?;
        let Some(mechanism) = machine.mechanism else {
            return refuse("found a machine without [mechanism]; allowed: one that has teeth".into());
        };
        if let Some(axis) = follows_no_program(&machine) {
            let settings =
                machine.axes[..AXES].iter().map(|axis| format!(" --set axis.{}.reference.kind=channel", axis.name));
            return refuse(format!(
                "found axis.{}, whose reference.kind is another one; allowed: \"channel\" for all four axes: start the \
                 group with{}",
                axis.name,
                settings.collect::<String>()
            ));
        }
        Ok(Self { machine, mechanism })
    }

    /// The axes' way to a place from where they are; none when the operator is to stop.
    ///
    /// # Errors
    /// A position is not known, or the machine cannot do it.
    pub fn plan(&self, place: TeethPlace, operator: &mut Operator) -> Result<Option<TipPlan>, Failure> {
        let Some(sample) = operator.sample()? else { return Ok(None) };
        while operator.command()?.is_some() {}
        let mut positions = [0.0; AXES];
        for (axis, position) in ALL.iter().zip(&mut positions) {
            let found = sample.axes[*axis].usable();
            let unknown =
                || Failure::run(format!("the position of axis.{} is not known", operator.machine().name(*axis)));
            *position = found.ok_or_else(unknown)?;
        }
        let pose = self.mechanism.prepared().pose(&positions);
        let (start, pitch) = ([pose.tip.x, pose.tip.z], pose.bucket.angle().to_degrees());
        self.expect_same_teeth(start, operator.teeth())?;
        let TeethPlace { to, pitch: turned, speed } = place;
        let pieces = vec![TipPiece {
            shape: TipShape::Line(to),
            pitch: turned.map(|turned| pitch + nearest_turn(turned - pitch)),
            free: None,
        }];
        let free = Some(TipFree::Telescope(positions[2]));
        let task =
            TipTask { start, pitch, speed, free, rounding: 0.0, file: None, pieces, without: TipWithout::default() };
        let machine = Machine { tip: Some(task), ..self.machine.clone() };
        let refused = |text: String| Failure::usage(text.trim_start_matches("tip.piece[0]: ").to_owned());
        let plan = TipPlan::of_task(&machine).map_err(|error| refused(error.to_string()))?;
        Ok(Some(plan.expect("this machine has teeth and a task")))
    }

    /// The teeth by this machine file are where the group has them.
    fn expect_same_teeth(&self, [x, z]: [f64; 2], found: Option<TeethState>) -> Result<(), Failure> {
        match found {
            Some(teeth) if (teeth.x - x).hypot(teeth.z - z) > SAME => Err(Failure::run(format!(
                "found the teeth at [{:.3}, {:.3}] m by the group, at [{x:.3}, {z:.3}] m by its machine file; \
                 allowed: the machine file with which it was started",
                teeth.x, teeth.z
            ))),
            _ => Ok(()),
        }
    }

    /// Arms the axes, and plans the motion to a place from where they are then; none when the operator is to stop.
    ///
    /// # Errors
    /// The axes cannot be armed, or the machine cannot do it.
    pub fn begin(&self, place: TeethPlace, operator: &mut Operator) -> Result<Option<Moving<'_>>, Failure> {
        // Nothing of this motion goes on without the person who asked for it.
        ALL.into_iter().for_each(|axis| operator.axis(axis).hold_to_run = 1);
        let sender = Sender::new(operator, &self.machine)?;
        if !operator.change(&ALL, AxisMode::Track)? {
            return Ok(None);
        }
        // An axis may have sunk, or moved on, since the motion was judged.
        let Some(plan) = self.plan(place, operator)? else { return Ok(None) };
        let watch = TipWatch::new(&self.mechanism);
        Ok(Some(Moving {
            of: self,
            place,
            way: way_of(&plan),
            plan,
            sender,
            watch,
            ended: None,
            has_arrived: false,
            has_met_wall: false,
        }))
    }
}

/// A motion that has begun.
pub struct Moving<'m> {
    of: &'m MovableTeeth,
    place: TeethPlace,
    plan: TipPlan,
    /// Positions of the axes at every period of the plan, m.
    way: Vec<[f64; AXES]>,
    sender: Sender,
    watch: TipWatch,
    /// When the references came to the end of the way.
    ended: Option<Instant>,
    has_arrived: bool,
    /// A virtual wall has acted on an axis.
    has_met_wall: bool,
}

impl Moving<'_> {
    /// Where the way begins, m.
    pub fn start(&self) -> [f64; 2] {
        let start = self.plan.way().place(0.0).at;
        [start.x, start.z]
    }

    /// Whether the teeth have come to their place.
    pub fn has_arrived(&self) -> bool {
        self.has_arrived
    }

    /// Teeth on their way, in words.
    pub fn told(&self, teeth: &TeethState) -> String {
        let TeethState { x, z, pitch, error, .. } = teeth;
        let (pitch, away, off) = (pitch.to_degrees(), self.place.away([*x, *z]), 1e3 * error);
        format!("teeth at [{x:.3}, {z:.3}] m, pitch {pitch:.1} degrees: {away:.3} m to go, {off:.1} mm off the line")
    }

    /// Goes on by a sample: one request, and the references that belong to it. Where the teeth are, and whether they
    /// have just arrived.
    ///
    /// # Errors
    /// An axis does not follow any more, or the group cannot be operated.
    pub fn step(&mut self, operator: &mut Operator, sample: &EncoderSample) -> Result<(TeethState, bool), Failure> {
        operator.ask(sample)?;
        while operator.command()?.is_some() {}
        let last = |axis: usize| operator.last(axis).unwrap_or_default();
        self.has_met_wall |= ALL.iter().any(|axis| last(*axis).flags & control_flag::WALL != 0);
        if let Some(axis) = ALL.into_iter().find(|axis| last(*axis).operation != AxisMode::Track as u32) {
            let wall = if self.has_met_wall {
                ", after a virtual wall had stopped an axis: a place further from it"
            } else {
                ""
            };
            return Err(Failure::run(format!("{}; allowed: track{wall}", operator.state(axis))));
        }
        let (positions, references) = (ALL.map(|i| sample.axes[i].position), ALL.map(|i| last(i).reference));
        let teeth = self.watch.update(Some(positions), &references, Some((&self.plan, self.sender.seconds())));
        let follow = ALL.iter().all(|axis| last(*axis).flags & WAITING == 0);
        self.sender.send(sample, &self.way, if follow { self.watch.pace() } else { 0.0 })?;
        if self.sender.has_ended(&self.way) {
            self.ended.get_or_insert_with(Instant::now);
        }
        let is_there = self.ended.is_some_and(|at| self.is_near(sample) || at.elapsed() > PATIENCE);
        let arrives = is_there && !self.has_arrived;
        self.has_arrived |= is_there;
        Ok((teeth, arrives))
    }

    fn is_near(&self, sample: &EncoderSample) -> bool {
        let end = self.way[self.way.len() - 1];
        ALL.iter().all(|axis| {
            let near = NEAR.max(NEAR_COUNTS * self.of.machine.axes[*axis].encoder.resolution);
            (sample.axes[*axis].position - end[*axis]).abs() <= near
        })
    }
}

/// Whether a person can move the teeth of this machine: it has some, and its axes follow programs.
pub fn can_move(machine: &Machine) -> bool {
    machine.mechanism.is_some() && follows_no_program(machine).is_none()
}

/// The first of the axes that move the teeth whose reference is another one than that of a program.
fn follows_no_program(machine: &Machine) -> Option<&Axis> {
    machine.axes.iter().take(AXES).find(|axis| axis.reference != ReferenceSource::Channel)
}

/// The shorter turn, degrees.
fn nearest_turn(degrees: f64) -> f64 {
    degrees - 360.0 * (degrees / 360.0).round()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bucket_turns_the_shorter_way() {
        for (turn, shorter) in [(10.0, 10.0), (-190.0, 170.0), (350.0, -10.0), (-350.0, 10.0), (0.0, 0.0)] {
            assert_eq!(nearest_turn(turn), shorter);
        }
    }
}
