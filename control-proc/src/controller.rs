//! All axes of the machine, one call per sample.
//!
//! ```text
//! u(k) = controller(y(k), model learned from samples before k, y_r(k), y_r(k+1), ..)
//! ```
//!
//! y positions in m, u valve commands in [-1, 1], y_r references in m, k tick. u(k) is made from sample k and stays on
//! the valve until sample k+1. Trap: a sample that is not newer than the last one holds no new information. A source
//! that repeats itself is as blind as one that is silent, so the last command is repeated twice at most. A source that
//! has started again, with another session in its headers, latches every armed axis and is followed after a reset.
//!
//! Virtual walls look at the commands of all axes of a tick together ([`Walls`]).
//!
//! The emergency stop comes before everything else. All axes are neutral and latched with the sample that reports it.
//! The message asks to cut off the pilot pressure until the stop is released and every axis has been reset.

use mechanism::AXES;
use pipeline::{
    MAX_AXES,
    channel::Stop,
    machine::{Machine, samples_of},
    message::{
        AxisCommand, CoefficientSnapshot, EncoderSample, Header, Reference, Request, TipState, ValveCommand,
        control_flag,
    },
};

use crate::{
    axis::{AxisController, AxisInput, UNUSABLE_LIMIT, patience, requests::STREAM_TIMEOUT},
    load::Loads,
    operators::Operators,
    payload::Payload,
    protection::walls::{Walls, Wanted},
    reference::{generator::ReferenceGenerator, path::Path},
    tip::watch::TipWatch,
    trajectory_file::{ReferenceError, read_references},
};

/// Time for which the teeth wait for axes that come no closer to the begin of their way, s.
const PATIENCE_AT_BEGIN: f64 = 5.0;
/// Time for which the axes have to be there before the motion begins, s: one that swings through has not come to it,
/// and the machine is still to swing out.
const SETTLED: f64 = 1.5;

/// What the axes of a mechanism do together; nothing for a machine without one.
#[derive(Debug, Clone)]
struct Linkage {
    walls: Option<Walls>,
    loads: Option<Loads>,
    payload: Option<Payload>,
    teeth: Option<TipWatch>,
}

/// The controller of a machine. Disarmed until [`Controller::arm`] or a request arms its axes.
#[derive(Debug, Clone)]
pub struct Controller {
    generator: ReferenceGenerator,
    path: Path,
    /// T, s.
    period: f64,
    axes: Vec<AxisController>,
    linkage: Linkage,
    request: Option<Request>,
    operators: Operators,
    last_sequence: Option<u64>,
    /// Life of the source of the samples.
    session: u64,
    /// Samples in a row that were not newer than the last.
    repeated: u64,
    begin: Begin,
}

/// How far the axes of the teeth are with the begin of their way.
#[derive(Debug, Clone, Copy, Default)]
struct Begin {
    /// Whether all of them go there, or are there.
    are_together: bool,
    /// Ticks for which the references of all of them have been there.
    at_begin: u64,
    /// Ticks for which they have been there themselves.
    settled: u64,
}

impl Controller {
    /// Builds all axes and reads their trajectories. Nothing is allocated after this.
    ///
    /// # Errors
    /// The trajectory file of an axis is refused.
    pub fn new(machine: &Machine) -> Result<Self, ReferenceError> {
        let axes = machine.axes.iter().take(MAX_AXES).enumerate();
        let loads = Loads::of(machine);
        let ahead = loads.as_ref().map_or(0, Loads::ahead);
        let axes: Vec<_> = axes.map(|(i, axis)| AxisController::new(i, axis, &machine.timing, ahead)).collect();
        let period = machine.timing.period.as_secs_f64();
        Ok(Self {
            generator: read_references(machine)?,
            period,
            path: Path::new(axes.iter().map(AxisController::ahead).max().unwrap_or_default(), period, patience(period)),
            axes,
            linkage: Linkage {
                walls: Walls::of(machine),
                loads,
                payload: Payload::of(machine),
                teeth: TipWatch::of(machine),
            },
            request: None,
            operators: Operators::new(samples_of(STREAM_TIMEOUT, machine.timing.period).max(1) as u64),
            last_sequence: None,
            session: 0,
            repeated: 0,
            begin: Begin::default(),
        })
    }

    /// Requests may change the gains of the fallback within these ranges of the axes, [`crate::gains`].
    pub fn allow_gains(&mut self, ranges: impl IntoIterator<Item = [f64; 2]>) {
        self.axes.iter_mut().zip(ranges).for_each(|(axis, range)| axis.allow_gains(range));
    }

    /// Arms the axes: they settle and then follow. Without effect on axes that are armed already or latched.
    pub fn arm(&mut self) {
        self.axes.iter_mut().for_each(AxisController::arm);
    }

    /// Makes all axes neutral from now on and releases their latches. After the next [`Self::arm`] they may follow a
    /// source whose sequence numbers have started again.
    pub fn disarm(&mut self) {
        self.axes.iter_mut().for_each(AxisController::disarm);
        (self.last_sequence, self.repeated) = (None, 0);
        self.path.reset();
    }

    /// Disarms these axes, bit by bit, or latches all of them as an emergency stop does. A latched axis stays latched.
    /// Requests that were made before have no effect on a stopped axis.
    pub fn stop(&mut self, stop: Stop) {
        let last = self.last_sequence;
        for (i, axis) in self.axes.iter_mut().enumerate() {
            if stop.emergency {
                axis.latch(control_flag::EMERGENCY_STOP);
            }
            if stop.emergency || stop.axes & 1 << i != 0 {
                axis.stop(last);
            }
        }
    }

    /// Whether an emergency stop has latched any axis.
    pub fn is_emergency(&self) -> bool {
        self.is_latched_by(control_flag::EMERGENCY_STOP)
    }

    /// The message with the present commands of all axes.
    pub fn message(&self) -> ValveCommand {
        self.message_of(self.last_sequence.unwrap_or_default(), AxisController::message)
    }

    /// Takes in a request, which counts from the next sample on unless a newer one comes before. A request that was
    /// seen before has no effect, nor has one of another program than the one that operates.
    pub fn ask(&mut self, request: &Request) {
        if self.operators.admit(request, self.last_sequence.unwrap_or_default()) {
            self.request = Some(*request);
        } else {
            self.axes.iter_mut().for_each(AxisController::refuse_request);
        }
    }

    /// Latches every axis at neutral because the samples have stopped, until the axes are disarmed and armed again. An
    /// axis that still settles does so anew.
    pub fn feedback_lost(&mut self) {
        self.lose(control_flag::FEEDBACK);
    }

    /// Makes axes that follow neutral because no sample comes for now. They go on with the next one.
    pub fn fall_silent(&mut self) {
        self.axes.iter_mut().for_each(AxisController::fall_silent);
    }

    /// Latches every axis at neutral for this cause, something that comes too late, except for those that still settle.
    pub fn lose(&mut self, cause: u32) {
        self.axes.iter_mut().for_each(|axis| axis.lose(cause));
    }

    /// Latches every axis at neutral for this cause, a [`control_flag`] bit, until it is disarmed and armed again.
    pub fn latch(&mut self, cause: u32) {
        self.axes.iter_mut().for_each(|axis| axis.latch(cause));
    }

    /// The command for one sample, complete except for its times.
    ///
    /// `snapshot` and `reference` are the newest messages; messages that were seen before may be passed again. A sample
    /// that is not newer than the last one repeats the last command; the third one in a row latches every axis.
    pub fn update(
        &mut self,
        sample: &EncoderSample,
        snapshot: Option<&CoefficientSnapshot>,
        reference: Option<&Reference>,
    ) -> ValveCommand {
        let sequence = sample.header.sequence;
        let emergency_stop = sample.emergency_stop != 0;
        let is_new_source = std::mem::replace(&mut self.session, sample.header.session) != sample.header.session;
        let elapsed = match self.last_sequence {
            None => 1,
            // A source that has started again counts from anew. How long it was away is unknown.
            Some(last) if sequence <= last && is_new_source => {
                self.latch(control_flag::FEEDBACK);
                self.path.reset();
                1
            }
            Some(last) if sequence > last => sequence - last,
            Some(last) => {
                self.repeated += 1;
                // An emergency stop counts even in an old sample.
                if emergency_stop {
                    self.axes.iter_mut().for_each(|axis| axis.take_emergency_stop(true));
                }
                if self.repeated >= UNUSABLE_LIMIT {
                    self.feedback_lost();
                }
                return self.message_of(last, AxisController::message);
            }
        };
        (self.last_sequence, self.repeated) = (Some(sequence), 0);

        self.bear_loads(sample);
        self.advance_path(sequence);
        self.lead_teeth();

        let mut command = self.empty(sequence);
        for (i, (axis, entry)) in self.axes.iter_mut().zip(&mut command.axes).enumerate() {
            let within = |header: &Header| i < header.axis_count as usize;
            *entry = axis.update(&AxisInput {
                sequence,
                elapsed,
                sample: within(&sample.header).then_some(&sample.axes[i]),
                snapshot: (snapshot.filter(|snapshot| within(&snapshot.header)))
                    .map(|snapshot| (snapshot.header.sequence, &snapshot.axes[i])),
                reference,
                emergency_stop,
                request: self.request.as_ref(),
                generator: &self.generator,
                path: self.path.ticks(),
            });
        }
        self.keep_within_walls(&mut command);
        self.watch_teeth(&mut command);
        if self.cut_off() != 0 {
            self.stop_without_pressure(&mut command);
        }
        command
    }

    /// Goes on along the path of the generators, as far as axes and teeth follow.
    fn advance_path(&mut self, sequence: u64) {
        let (axes, generator) = (&self.axes, &self.generator);
        let waits = axes.iter().any(AxisController::waits);
        let ease = self.linkage.teeth.as_ref().map_or(1.0, TipWatch::pace);
        self.path.advance(sequence, (waits, ease), |tick| {
            axes.iter().map(|axis| axis.rate(tick, generator)).fold(1.0, f64::min)
        });
    }

    /// Positions, m, and speeds, m/s, of the axes of a mechanism; none while one of them is not known.
    fn motion(&self) -> Option<([f64; AXES], [f64; AXES])> {
        let (mut positions, mut speeds) = ([0.0; AXES], [0.0; AXES]);
        for (i, axis) in self.axes.iter().enumerate().take(AXES) {
            (positions[i], speeds[i]) = axis.wanted().motion?;
        }
        Some((positions, speeds))
    }

    /// Works out what the axes bear where they were last, with the payload by the pressures of `sample`. While a
    /// position is not known, that stays as it was.
    fn bear_loads(&mut self, sample: &EncoderSample) {
        let motion = self.motion();
        let Some((loads, (positions, speeds))) = self.linkage.loads.as_mut().zip(motion) else { return };
        let payload = self.linkage.payload.as_mut().map(|payload| {
            payload.update(sample, &positions, &speeds);
            payload.mass()
        });
        let mut references = [None; AXES];
        references.iter_mut().zip(&self.axes).for_each(|(of, axis)| *of = axis.coming());
        let mut all = loads.at(&positions, payload, &references);
        loads.hold_back(&mut all, &positions, sample, &references);
        for (axis, load) in self.axes.iter_mut().zip(all) {
            axis.bear(load);
        }
    }

    /// Works out where the teeth are, and what is in the bucket.
    fn watch_teeth(&mut self, command: &mut ValveCommand) {
        let positions = self.motion().map(|(positions, _)| positions);
        let Some(teeth) = &mut self.linkage.teeth else { return };
        let references = std::array::from_fn(|i| command.axes[i].reference);
        let now = self.path.ticks()[0];
        let since = self.generator.tip_start().map(|start| self.period * (now - start)).filter(|t| *t >= 0.0);
        let plan = self.generator.plan().zip(since).filter(|(plan, t)| *t <= plan.duration());
        command.teeth = teeth.update(positions, &references, plan);
        if let Some(payload) = self.linkage.payload.as_ref().filter(|_| command.teeth.state != TipState::Unknown as u32)
        {
            command.teeth.payload = payload.mass();
        }
    }

    /// Leaves of the commands what keeps boom, arm and bucket within the virtual walls.
    fn keep_within_walls(&mut self, command: &mut ValveCommand) {
        let Some(walls) = &mut self.linkage.walls else { return };
        let mut wanted = [Wanted::default(); AXES];
        for (wanted, axis) in wanted.iter_mut().zip(&self.axes) {
            *wanted = axis.wanted();
        }
        let allowed = walls.update(&wanted);
        for (i, (axis, entry)) in self.axes.iter_mut().zip(&mut command.axes).enumerate().take(AXES) {
            if allowed.commands[i] != wanted[i].command {
                axis.stop_before_wall(allowed.commands[i], allowed.stopped[i]);
                *entry = axis.message();
            }
        }
    }

    /// Begins the motion of the teeth when all of their axes have come to its begin; an axis that comes no closer for
    /// [`PATIENCE_AT_BEGIN`] begins with what is left of its error. A motion that was left begins anew.
    fn lead_teeth(&mut self) {
        let ticks = self.path.ticks();
        let (now, last) = (ticks[0], ticks[ticks.len() - 1]);
        let start = self.generator.tip_start();
        self.keep_together(last);
        let are_at_begin = start.is_none() && self.generator.tip_axes().all(|axis| self.axes[axis].tracks(last));
        self.begin.at_begin = if are_at_begin { self.begin.at_begin.saturating_add(1) } else { 0 };
        let is_late = self.begin.at_begin as f64 * self.period >= PATIENCE_AT_BEGIN;
        let are_there = self.generator.tip_axes().all(|axis| match start {
            Some(start) => self.axes[axis].tracks(start.max(now)),
            None => self.axes[axis].has_arrived(last, is_late),
        });
        self.begin.settled = if are_there { self.begin.settled.saturating_add(1) } else { 0 };
        let is_ready = are_there && (start.is_some() || self.begin.settled as f64 * self.period >= SETTLED);
        match (start.is_some(), is_ready) {
            // What a preview has shown so far stays as it is.
            (false, true) if self.generator.tip_axes().next().is_some() => self.generator.begin_tip(Some(last)),
            (true, false) => self.generator.begin_tip(None),
            _ => {}
        }
    }

    /// When an axis of the teeth stops on the way, or on the way to its begin, the others leave it as well: it cannot
    /// be traced without that one. Until all of them track, those that do stand, in a preview that ends at tick `last`.
    fn keep_together(&mut self, last: f64) {
        let are_together = self.generator.tip_axes().all(|axis| self.axes[axis].pursues());
        let were_together = std::mem::replace(&mut self.begin.are_together, are_together);
        if are_together {
            return;
        }
        for axis in self.generator.tip_axes() {
            if were_together {
                self.axes[axis].leave_way();
            } else {
                self.axes[axis].stay(last, &self.generator);
            }
        }
    }

    /// Tick along the path since which the teeth move along their way, and the present one; none before.
    pub fn on_the_way(&self) -> Option<(f64, f64)> {
        self.generator.tip_start().map(|start| (start, self.path.ticks()[0]))
    }

    /// Another controller has made the command that follows the last sample: what it commanded is on the valves in the
    /// place of the controller's own commands. For a controller that runs beside a recorded one.
    pub fn apply(&mut self, command: &ValveCommand) {
        let count = command.header.axis_count as usize;
        for (axis, applied) in self.axes.iter_mut().zip(&command.axes).take(count) {
            axis.apply(applied.command);
        }
    }

    /// Disarms the axes that another one has cut the pilot pressure off from. They cannot follow, and an axis that
    /// waits for its pressure with a large error would jump when the pressure is back.
    fn stop_without_pressure(&mut self, command: &mut ValveCommand) {
        command.cut_off = 1;
        for (axis, entry) in self.axes.iter_mut().zip(&mut command.axes).filter(|(axis, _)| axis.is_armed()) {
            axis.stop(self.last_sequence);
            *entry = axis.message();
        }
    }

    /// The message that makes all axes neutral at once. It is only copied, and does not change the controller: a caller
    /// that sends it because the samples have stopped calls [`Self::fall_silent`] or [`Self::feedback_lost`] first.
    pub fn neutral(&self, sequence: u64) -> ValveCommand {
        self.message_of(sequence, AxisController::neutral_message)
    }

    /// Whether a fault has latched any axis.
    pub fn is_latched(&self) -> bool {
        self.axes.iter().any(|axis| axis.cause() != 0)
    }

    /// 1 while an axis is latched by an emergency stop, so at least as long as the stop is pressed, or by motion that
    /// nobody commanded.
    fn cut_off(&self) -> u32 {
        u32::from(self.is_latched_by(control_flag::CUT_OFF))
    }

    fn is_latched_by(&self, causes: u32) -> bool {
        self.axes.iter().any(|axis| axis.cause() & causes != 0)
    }

    fn message_of(&self, sequence: u64, entry: impl Fn(&AxisController) -> AxisCommand) -> ValveCommand {
        let mut command = self.empty(sequence);
        for (axis, place) in self.axes.iter().zip(&mut command.axes) {
            *place = entry(axis);
        }
        command.cut_off = self.cut_off();
        command
    }

    fn empty(&self, sequence: u64) -> ValveCommand {
        let header = Header { sequence, axis_count: self.axes.len() as u32, ..Header::default() };
        ValveCommand { header, operator: self.operators.session(), ..ValveCommand::default() }
    }
}
