//! `hydraxis operate --tip`: the bucket's teeth go to a place in a straight line.
//!
//! The way is planned as the task `[tip]` of a machine file is, from where the teeth are, with the telescope where it
//! is. The axes get it through the reference channel:
//!
//! ```text
//! c(k + i) = plan(t + i p T)       t(k+1) = t(k) + p T
//! p        rises by T / 1 s and falls by T / 0.2 s to p_0: that of [`TipWatch`], or 0 while an axis does not follow
//! ```
//!
//! c positions of the cylinders m, t time of the plan s, p its pace, T period s. So the teeth wait on their way for an
//! axis that waits. They begin after a second: references that are taken up are followed from a stand.
//!
//! Runs in the operator's process, beside the loop. When it dies or is suspended, the axes are off 0.1 s later: axes
//! that only came to a stand at their last reference would first make up for their lag, some decimetres of the teeth.

use std::time::{Duration, Instant};

use control_proc::tip::{TipPlan, watch::TipWatch};
use mechanism::{AXES, Mechanism};
use pipeline::{
    channel::{ChannelError, Prefix, Publisher},
    machine::{Axis, Machine, ReferenceSource, TipPiece, TipShape, TipTask},
    message::{AxisMode, EncoderSample, Header, MAX_PREVIEW, Reference, TeethState, control_flag},
    stage::monotonic_ns,
};

use super::{LINE_PERIOD, OperateArguments};
use crate::{
    arguments::load_bare,
    failure::Failure,
    group::{
        operator::{Operator, OperatorError, board},
        running::machine_of,
    },
    report::output::show,
};

/// The four axes.
pub(super) const ALL: [usize; AXES] = [0, 1, 2, 3];
/// Speed of the teeth without --speed, m/s.
const SPEED: f64 = 0.1;
/// Time for which the references stand before they move, s: that in which a reference that is taken up gets its pace.
const STANDING: f64 = 1.2;
/// Times in which the pace rises from 0 to 1, and falls, s.
const RISE_TIME: f64 = 1.0;
const FALL_TIME: f64 = 0.2;
/// How far ahead references are sent, s, and the least number of them.
const AHEAD: f64 = 0.1;
const LEAST_AHEAD: usize = 3;
/// Distance from its end at which an axis has arrived, m and counts of its encoder, of which the longer one counts.
const NEAR: f64 = 0.002;
const NEAR_COUNTS: f64 = 3.0;
/// Time after the end of the way, after which they need not come any nearer.
const PATIENCE: Duration = Duration::from_secs(5);
/// Distance of the teeth from their place beyond which they have not come to it, m.
const ARRIVED: f64 = 0.03;
/// Distance of the teeth by the machine file from those by the group, m, that a motion between the two explains.
const SAME: f64 = 0.05;
/// What an axis shows that does not follow at the moment.
const WAITING: u32 = control_flag::REFERENCE | control_flag::SLOWED | control_flag::WALL | control_flag::SETTLING;

/// A motion of the teeth that a person has asked for.
pub(super) struct TipMove {
    machine: Machine,
    mechanism: Mechanism,
    to: [f64; 2],
    /// Degrees.
    pitch: Option<f64>,
    /// m/s.
    speed: f64,
}

impl TipMove {
    /// What the arguments ask of this group; none without `--tip`.
    ///
    /// # Errors
    /// The machine of the group has no teeth, its axes follow no program, or only some of them are meant.
    pub fn of(arguments: &OperateArguments, prefix: &Prefix) -> Result<Option<Self>, Failure> {
        let Some(to) = arguments.tip else { return Ok(None) };
        let refuse = |text: String| Err(Failure::usage(format!("--tip: {text}")));
        if !arguments.group.axes.is_empty() {
            return refuse("found together with --axis; allowed: without, since all four axes move the teeth".into());
        }
        let machine = load_bare(&machine_of(prefix, &[])?, None)?;
        board(prefix)?.expect_machine(&machine).map_err(OperatorError::from)?;
        let Some(mechanism) = machine.mechanism else {
            return refuse("found a machine without [mechanism]; allowed: one that has teeth".into());
        };
        let other = |axis: &&Axis| axis.reference != ReferenceSource::Channel;
        if let Some(axis) = machine.axes[..AXES].iter().find(other) {
            let settings =
                machine.axes[..AXES].iter().map(|axis| format!(" --set axis.{}.reference.kind=channel", axis.name));
            return refuse(format!(
                "found axis.{}, whose reference.kind is another one; allowed: \"channel\" for all four axes: start the \
                 group with{}",
                axis.name,
                settings.collect::<String>()
            ));
        }
        Ok(Some(Self { machine, mechanism, to, pitch: arguments.pitch, speed: arguments.speed.unwrap_or(SPEED) }))
    }

    /// The axes' way from where they are.
    ///
    /// # Errors
    /// A position is not known, or the machine cannot do it.
    pub fn plan(&self, operator: &mut Operator) -> Result<Option<TipPlan>, Failure> {
        let Some(sample) = operator.sample()? else { return Ok(None) };
        while operator.command()?.is_some() {}
        let mut positions = [0.0; AXES];
        for (axis, position) in ALL.iter().zip(&mut positions) {
            let found = sample.axes[*axis].usable();
            let unknown =
                || Failure::run(format!("--tip: the position of axis.{} is not known", operator.machine().name(*axis)));
            *position = found.ok_or_else(unknown)?;
        }
        let pose = self.mechanism.prepared().pose(&positions);
        let (start, pitch) = ([pose.tip.x, pose.tip.z], pose.bucket.angle().to_degrees());
        self.expect_same_teeth(start, operator.teeth())?;
        let shape = TipShape::Line(self.to);
        let piece = TipPiece { shape, pitch: self.pitch.map(|to| pitch + nearest_turn(to - pitch)) };
        let (speed, telescope, pieces) = (self.speed, Some(positions[2]), vec![piece]);
        let task = TipTask { start, pitch, speed, telescope, rounding: 0.0, file: None, pieces };
        let machine = Machine { tip: Some(task), ..self.machine.clone() };
        let refused = |text: String| Failure::usage(format!("--tip: {}", text.trim_start_matches("tip.piece[0]: ")));
        let plan = TipPlan::of_task(&machine).map_err(|error| refused(error.to_string()))?;
        Ok(Some(plan.expect("this machine has teeth and a task")))
    }

    /// The teeth by this machine file are where the group has them.
    fn expect_same_teeth(&self, [x, z]: [f64; 2], found: Option<TeethState>) -> Result<(), Failure> {
        match found {
            Some(teeth) if (teeth.x - x).hypot(teeth.z - z) > SAME => Err(Failure::run(format!(
                "--tip: found the teeth at [{:.3}, {:.3}] m by the group, at [{x:.3}, {z:.3}] m by its machine file; \
                 allowed: the machine file with which it was started",
                teeth.x, teeth.z
            ))),
            _ => Ok(()),
        }
    }

    /// Arms the axes, moves the teeth, and holds them there until the end.
    ///
    /// # Errors
    /// An axis does not follow any more, or the group cannot be operated.
    pub fn run(&self, arguments: &OperateArguments, operator: &mut Operator) -> Result<(), Failure> {
        // Nothing of this motion goes on without the person who asked for it.
        ALL.into_iter().for_each(|axis| operator.axis(axis).hold_to_run = 1);
        let mut sender = Sender::new(operator, &self.machine)?;
        if !operator.change(&ALL, AxisMode::Track)? {
            return Ok(());
        }
        // An axis may have sunk, or moved on, since the motion was judged.
        let Some(plan) = self.plan(operator)? else { return Ok(()) };
        let (way, mut watch) = (way_of(&plan), TipWatch::new(&self.mechanism));
        let begin = Instant::now();
        let start = plan.way().place(0.0).at;
        let (mut next_line, mut ended, mut has_arrived, mut away) = (begin, None, false, self.away([start.x, start.z]));
        while arguments.duration.is_none_or(|duration| begin.elapsed() < duration) {
            let Some(sample) = operator.sample()? else { break };
            operator.ask(&sample)?;
            while operator.command()?.is_some() {}
            let last = |axis: usize| operator.last(axis).unwrap_or_default();
            if let Some(axis) = ALL.into_iter().find(|axis| last(*axis).operation != AxisMode::Track as u32) {
                return Err(Failure::run(format!("{}; allowed: track", operator.state(axis))));
            }
            let (positions, references) = (ALL.map(|i| sample.axes[i].position), ALL.map(|i| last(i).reference));
            let teeth = watch.update(Some(positions), &references, Some((&plan, sender.seconds())));
            away = self.away([teeth.x, teeth.z]);
            let follow = ALL.iter().all(|axis| last(*axis).flags & WAITING == 0);
            sender.send(&sample, &way, if follow { watch.pace() } else { 0.0 })?;
            if Instant::now() >= next_line {
                next_line += LINE_PERIOD;
                let seconds = sample.header.sequence as f64 * self.machine.timing.period.as_secs_f64();
                show(&format!("{seconds:8.2} s  {}", self.told(&teeth)))?;
            }
            if sender.has_ended(&way) {
                ended.get_or_insert_with(Instant::now);
            }
            let is_there = ended.is_some_and(|at| self.is_near(&sample, &way) || at.elapsed() > PATIENCE);
            if is_there && !has_arrived {
                has_arrived = true;
                show(&format!("at the end: {}", self.told(&teeth)))?;
                if arguments.leave {
                    ALL.into_iter().for_each(|axis| operator.axis(axis).hold_to_run = 0);
                    operator.change(&ALL, AxisMode::Hold)?;
                    break;
                }
            }
        }
        if operator.stopping() || away <= ARRIVED {
            return Ok(());
        }
        let ([x, z], away, allowed) = (self.to, 1e3 * away, 1e3 * ARRIVED);
        Err(Failure::run(format!(
            "--tip: found the teeth {away:.0} mm from [{x}, {z}] m at the end; allowed: {allowed:.0} mm: more time, or \
             a lower --speed"
        )))
    }

    /// Distance of teeth at `[x, z]` from the place to which they go, m.
    fn away(&self, [x, z]: [f64; 2]) -> f64 {
        (x - self.to[0]).hypot(z - self.to[1])
    }

    /// A line about the teeth.
    fn told(&self, teeth: &TeethState) -> String {
        let TeethState { x, z, pitch, error, .. } = teeth;
        let (pitch, away, off) = (pitch.to_degrees(), self.away([*x, *z]), 1e3 * error);
        format!("teeth at [{x:.3}, {z:.3}] m, pitch {pitch:.1} degrees: {away:.3} m to go, {off:.1} mm off the line\n")
    }

    fn is_near(&self, sample: &EncoderSample, way: &[[f64; AXES]]) -> bool {
        let end = way[way.len() - 1];
        ALL.iter().all(|axis| {
            let near = NEAR.max(NEAR_COUNTS * self.machine.axes[*axis].encoder.resolution);
            (sample.axes[*axis].position - end[*axis]).abs() <= near
        })
    }
}

/// The shorter turn, degrees.
fn nearest_turn(degrees: f64) -> f64 {
    degrees - 360.0 * (degrees / 360.0).round()
}

/// Sends the references of a way.
struct Sender {
    publisher: Publisher<Reference>,
    reference: Reference,
    /// s.
    period: f64,
    /// Time of the plan, periods; below 0 the teeth still stand.
    time: f64,
    pace: f64,
    last: Option<u64>,
}

impl Sender {
    fn new(operator: &Operator, machine: &Machine) -> Result<Self, Failure> {
        let period = machine.timing.period.as_secs_f64();
        let preview = ((AHEAD / period).ceil() as usize).clamp(LEAST_AHEAD, MAX_PREVIEW) as u32;
        let header = Header { axis_count: machine.axes.len() as u32, ..Header::default() };
        let reference = Reference { header, preview, ..Reference::default() };
        let publisher = operator.publisher()?;
        Ok(Self { publisher, reference, period, time: -STANDING / period, pace: 0.0, last: None })
    }

    /// Sends the references that belong to a sample; the teeth go on at `pace` at most.
    fn send(&mut self, sample: &EncoderSample, way: &[[f64; AXES]], pace: f64) -> Result<(), Failure> {
        let elapsed = sample.header.sequence.saturating_sub(self.last.unwrap_or(sample.header.sequence)) as f64;
        // While the references stand they are taken up, which shows as waiting.
        let pace = if self.time < 0.0 { 1.0 } else { pace };
        let time = elapsed * self.period;
        self.pace = pace.clamp(self.pace - time / FALL_TIME, self.pace + time / RISE_TIME).max(0.0);
        self.time = (self.time + elapsed * self.pace).min((way.len() - 1) as f64);
        self.last = Some(sample.header.sequence);
        for i in 0..self.reference.preview as usize {
            let at = at(way, self.time + i as f64 * self.pace);
            for axis in ALL {
                self.reference.positions[axis][i] = at[axis];
            }
        }
        self.reference.header.sequence = sample.header.sequence;
        self.reference.header.acquired_ns = sample.header.acquired_ns;
        self.reference.header.sent_ns = monotonic_ns();
        Ok(self.publisher.send(&self.reference).map_err(ChannelError::from)?)
    }

    /// Time of the plan, s.
    fn seconds(&self) -> f64 {
        self.time.max(0.0) * self.period
    }

    fn has_ended(&self, way: &[[f64; AXES]]) -> bool {
        self.time >= (way.len() - 1) as f64
    }
}

/// Positions of the axes at every period of a plan, m.
fn way_of(plan: &TipPlan) -> Vec<[f64; AXES]> {
    let points = ALL.map(|axis| plan.points(axis));
    (0..points[0].len()).map(|k| ALL.map(|axis| points[axis][k].1)).collect()
}

/// A way at a time in periods, in straight lines between its points.
fn at(way: &[[f64; AXES]], time: f64) -> [f64; AXES] {
    let time = time.clamp(0.0, (way.len() - 1) as f64);
    let (k, rest) = (time.floor() as usize, time.fract());
    let next = way[(k + 1).min(way.len() - 1)];
    std::array::from_fn(|axis| way[k][axis] + rest * (next[axis] - way[k][axis]))
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

    #[test]
    fn a_way_is_straight_between_its_points_and_stands_beyond_its_ends() {
        let way = [[0.0; AXES], [1.0, 2.0, 0.0, -1.0]];
        for (time, expected) in [(-3.0, [0.0; AXES]), (0.5, [0.5, 1.0, 0.0, -0.5]), (7.0, way[1])] {
            assert_eq!(at(&way, time), expected);
        }
    }
}
