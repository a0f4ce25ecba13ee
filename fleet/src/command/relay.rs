//! The group's end of a seat: one request for every sample, for as long as the seat lasts.
//!
//! ```text
//! s(k+1) = s(k) + clamp(target - s(k), -v T, v T)        s(0) = position when the axis has settled
//! ```
//!
//! s set point of the mode hold m, v speed of the settings m/s, T time between two samples s. The profile of the mode
//! hold bounds speed, acceleration and jerk once more.
//!
//! A relay is made for a seat and ends with it. It never arms an axis twice: one that is off again, for whatever
//! reason, ends the seat.

use std::{
    collections::BTreeMap,
    sync::atomic::{AtomicBool, Ordering},
    thread::sleep,
    time::{Duration, Instant},
};

use pipeline::{
    MAX_AXES,
    channel::{Board, ChannelError, Group, GroupMachine, Listener, Prefix, Publisher, Reader, is_joined},
    message::{AxisCommand, AxisMode, EncoderSample, Header, Request, ValveCommand, control_flag},
    stage::monotonic_ns,
};

use super::{
    desk::Stops,
    protocol::{AxisView, Disarmed},
    shared::Shared,
};
use crate::{events::in_words, settings::Window};

/// Name under which a relay joins a group.
const NAME: &str = "remote";
/// Longest sleep before the next look for a sample.
const SLICE: Duration = Duration::from_millis(5);
/// Time in which a sample and a command must come, or this many periods where they are longer.
const PATIENCE: Duration = Duration::from_millis(200);
const PERIODS: u32 = 3;
/// How far beside its window an axis may stand, m: one that comes to the end of its window goes a little too far.
const OUTSIDE: f64 = 0.01;
/// Time in which all axes must be armed.
const ARM_PATIENCE: Duration = Duration::from_secs(5);
/// Time in which control-proc must act on a stop.
const STOP_PATIENCE: Duration = Duration::from_secs(1);

/// Why a relay has ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum End {
    /// The seat is over, or the group does not let it go on.
    Seat(String),
    /// A person at the machine has taken over, or the group has ended: the consent is over.
    AtMachine(String),
}

impl From<ChannelError> for End {
    fn from(error: ChannelError) -> Self {
        Self::Seat(error.to_string())
    }
}

/// An axis of the seat.
struct Drive {
    name: String,
    axis: usize,
    window: Window,
    /// Requests that the controller had taken at its last command.
    taken: Option<u64>,
    is_armed: bool,
    set_point: Option<f64>,
}

/// A seat in a group.
pub struct Relay {
    machine: GroupMachine,
    board: Board,
    /// Stops that were asked for before the seat.
    stops: Stops,
    samples: Reader<EncoderSample>,
    commands: Reader<ValveCommand>,
    requests: Publisher<Request>,
    listener: Listener,
    request: Request,
    /// The controller has taken a message of this relay, and waits for edges.
    is_current: bool,
    drives: Vec<Drive>,
    began: Instant,
    /// When the controller was heard last.
    heard: Instant,
    _group: Group,
}

impl Relay {
    /// Joins a group to move these axes of it.
    ///
    /// # Errors
    /// No such group runs, it has no such axis, a program of the machine operates it, or a window reaches beyond the
    /// soft limits.
    pub fn open(prefix: &Prefix, windows: &BTreeMap<String, Window>, stops: Stops) -> Result<Self, End> {
        let board = board(prefix).map_err(End::AtMachine)?;
        let machine = *board.machine();
        let drives = windows.iter().map(|(name, window)| Drive::new(&machine, name, *window));
        let drives = drives.collect::<Result<_, _>>().map_err(End::Seat)?;
        let group = Group::join(prefix, NAME).map_err(ChannelError::from)?;
        group.bury_the_dead();
        let requests = group.publisher::<Request>().map_err(ChannelError::from)?;
        if group.publishers::<Request>().map_err(ChannelError::from)? > 1 {
            return Err(End::Seat("a program at the machine operates it".to_owned()));
        }
        let mut request = Request { session: monotonic_ns(), ..Request::default() };
        request.header = Header { axis_count: machine.axis_count as u32, ..Header::default() };
        Ok(Self {
            machine,
            board,
            stops,
            samples: group.reader().map_err(ChannelError::from)?,
            commands: group.reader().map_err(ChannelError::from)?,
            listener: group.listener::<EncoderSample>().map_err(ChannelError::from)?,
            requests,
            request,
            is_current: false,
            drives,
            began: Instant::now(),
            heard: Instant::now(),
            _group: group,
        })
    }

    /// Operates the axes until the seat is over or `stop` is set; then they are off.
    pub fn serve(mut self, shared: &Shared, stop: &AtomicBool) -> End {
        let Err(end) = self.operate(shared, stop);
        // Also where a person has taken over: that session's messages would keep these axes armed. An axis that was not
        // armed from here is left alone.
        let armed = self.drives.iter().map(|drive| drive.axis).filter(|axis| self.request.axes[*axis].enable > 0);
        let _ = stop_axes(&self.board, armed);
        end
    }

    fn operate(&mut self, shared: &Shared, stop: &AtomicBool) -> Result<std::convert::Infallible, End> {
        let mut before = None;
        loop {
            let sample = self.sample()?;
            let wanted = {
                let mut desk = shared.desk();
                desk.wanted(Instant::now()).ok_or_else(|| End::Seat(desk.ended().to_owned()))?
            };
            if stop.load(Ordering::Relaxed) {
                return Err(End::AtMachine("the consent was taken back at the machine".to_owned()));
            }
            self.expect_no_stop(&sample)?;
            while let Some(command) = self.commands.read().map_err(ChannelError::from)?.if_new().copied() {
                self.heard = Instant::now();
                self.look(&command)?;
            }
            if self.heard.elapsed() > self.patience() {
                return Err(End::Seat("control-proc sends no commands".to_owned()));
            }
            let ticks = sample.header.sequence.saturating_sub(before.unwrap_or(sample.header.sequence));
            before = Some(sample.header.sequence);
            let elapsed = 1e-9 * (ticks * self.machine.period_ns) as f64;
            for drive in &mut self.drives {
                let target = wanted.targets.get(&drive.name).copied();
                drive.approach(target, elapsed);
                if self.is_current {
                    drive.ask(&sample, &mut self.request)?;
                }
            }
            self.request.header.sequence = sample.header.sequence;
            self.request.header.acquired_ns = sample.header.acquired_ns;
            self.request.header.sent_ns = monotonic_ns();
            self.requests.send(&self.request).map_err(ChannelError::from)?;
            shared.show(self.view(&sample));
        }
    }

    fn sample(&mut self) -> Result<EncoderSample, End> {
        let until = Instant::now() + self.patience();
        loop {
            if let Some(sample) = self.samples.read().map_err(ChannelError::from)?.if_new() {
                return Ok(*sample);
            }
            if Instant::now() > until {
                return Err(End::AtMachine("the group sends no samples".to_owned()));
            }
            self.listener.wait(SLICE).map_err(ChannelError::from)?;
        }
    }

    /// Time in which a sample and a command must come.
    fn patience(&self) -> Duration {
        PATIENCE.max(PERIODS * Duration::from_nanos(self.machine.period_ns))
    }

    fn expect_no_stop(&self, sample: &EncoderSample) -> Result<(), End> {
        if sample.emergency_stop != 0 {
            return Err(End::AtMachine("the emergency stop is pressed".to_owned()));
        }
        let asked = self.board.asked();
        let is_stopped = |axis: usize| asked[axis] != self.stops[axis];
        if is_stopped(MAX_AXES) {
            return Err(End::AtMachine("an emergency stop was asked for".to_owned()));
        }
        if self.drives.iter().any(|drive| is_stopped(drive.axis)) {
            return Err(End::Seat("a stop was asked for".to_owned()));
        }
        Ok(())
    }

    /// Looks at what the controller does with the requests.
    fn look(&mut self, command: &ValveCommand) -> Result<(), End> {
        let is_own = command.operator == self.request.session;
        if self.is_current && command.operator != 0 && !is_own {
            return Err(End::AtMachine("a program at the machine has taken over".to_owned()));
        }
        if is_own && !self.is_current {
            // The controller counts the edges of `enable` from the first message that it has taken.
            let taken = command.axes[0].taken_requests;
            let first = self.drives.first().and_then(|drive| drive.taken);
            self.is_current = first.is_some_and(|first| taken > first);
            self.drives.iter_mut().for_each(|drive| drive.taken = drive.taken.or(Some(taken)));
            return Ok(());
        }
        for drive in &mut self.drives {
            drive.look(&command.axes[drive.axis], &mut self.request)?;
        }
        if self.began.elapsed() > ARM_PATIENCE && self.drives.iter().any(|drive| !drive.is_armed) {
            return Err(End::Seat(format!("not armed within {}", humantime::format_duration(ARM_PATIENCE))));
        }
        Ok(())
    }

    fn view(&self, sample: &EncoderSample) -> BTreeMap<String, AxisView> {
        let view = |drive: &Drive| {
            let last = self.commands.last().map(|command| command.axes[drive.axis]);
            let state = last.map_or_else(String::new, |axis| in_words(axis.flags, axis.operation));
            let position = sample.axes[drive.axis].usable();
            (drive.name.clone(), AxisView { state, position, set_point: drive.set_point })
        };
        self.drives.iter().map(view).collect()
    }
}

impl Drive {
    fn new(machine: &GroupMachine, name: &str, window: Window) -> Result<Self, String> {
        let axis = machine.names().position(|found| found == name);
        let axis = axis.ok_or_else(|| {
            let names = machine.names().collect::<Vec<_>>().join(", ");
            format!("axis \"{name}\"; allowed: {names}, as the group has them")
        })?;
        let [low, high] = machine.soft_limits[axis];
        if window.from < low || window.to > high {
            let Window { from, to, .. } = window;
            return Err(format!("axis \"{name}\": window {from} to {to} m; allowed: soft limits {low} to {high} m"));
        }
        Ok(Self { name: name.to_owned(), axis, window, taken: None, is_armed: false, set_point: None })
    }

    /// Moves the set point towards the target.
    fn approach(&mut self, target: Option<f64>, elapsed: f64) {
        let step = self.window.speed * elapsed;
        if let (Some(set_point), Some(target)) = (&mut self.set_point, target) {
            *set_point += (target - *set_point).clamp(-step, step);
        }
    }

    /// Writes what is asked of this axis into the request: to stand where it is, and then the set point.
    fn ask(&mut self, sample: &EncoderSample, request: &mut Request) -> Result<(), End> {
        let asked = &mut request.axes[self.axis];
        let position = sample.axes[self.axis].usable();
        let Window { from, to, .. } = self.window;
        if let Some(position) = position.filter(|position| !(from - OUTSIDE..=to + OUTSIDE).contains(position)) {
            let name = &self.name;
            return Err(End::Seat(format!("axis \"{name}\" is at {position:.4} m; allowed: {from} to {to} m")));
        }
        match (self.set_point, position) {
            (Some(set_point), _) => asked.target = set_point,
            (None, Some(position)) => {
                asked.target = position;
                (asked.mode, asked.has_target, asked.hold_to_run) = (AxisMode::Hold as u32, 1, 1);
                asked.enable = asked.enable.max(1);
            }
            (None, None) => {}
        }
        Ok(())
    }

    fn look(&mut self, found: &AxisCommand, request: &mut Request) -> Result<(), End> {
        let state = || format!("axis.{}: {}", self.name, in_words(found.flags, found.operation));
        if found.flags & control_flag::LATCHED != 0 {
            return Err(End::Seat(format!("a fault has latched it: {}", state())));
        }
        let is_off = found.flags & control_flag::DISARMED != 0;
        let asked = &mut request.axes[self.axis];
        if asked.enable == 0 && !is_off {
            return Err(End::Seat(format!("it is armed at the machine: {}", state())));
        }
        if self.is_armed && is_off {
            return Err(End::Seat(format!("it was armed and is not any more: {}", state())));
        }
        self.is_armed |= !is_off;
        // A message with the edge was taken, and has not armed the axis: it came too late.
        if asked.enable > 0 && !self.is_armed && self.taken.is_some_and(|taken| found.taken_requests > taken) {
            asked.enable += 1;
        }
        self.taken = Some(found.taken_requests);
        let is_settled = found.operation == AxisMode::Hold as u32 && found.flags & control_flag::SETTLING == 0;
        if self.is_armed && is_settled && self.set_point.is_none() {
            self.set_point = Some(asked.target);
        }
        Ok(())
    }
}

/// The board of a group that runs.
///
/// # Errors
/// No such group runs, or its board cannot be read.
pub fn board(prefix: &Prefix) -> Result<Board, String> {
    let board = Board::find(prefix).map_err(|error| error.to_string())?;
    board.filter(|_| is_joined(prefix)).ok_or_else(|| format!("no group \"{prefix}\" runs"))
}

/// Whether these axes can be moved in their windows.
///
/// # Errors
/// The group has no such axis, or a window reaches beyond its soft limits.
pub fn expect_axes(board: &Board, windows: &BTreeMap<String, Window>) -> Result<(), String> {
    windows.iter().try_for_each(|(name, window)| Drive::new(board.machine(), name, *window).map(|_| ()))
}

/// Whether these axes are off and not latched, so that they can be armed.
///
/// # Errors
/// The first one that is not.
pub fn expect_off<'a>(board: &Board, axes: impl IntoIterator<Item = &'a String>) -> Result<(), String> {
    axes.into_iter().try_for_each(|name| {
        let axis = board.machine().names().position(|found| found == name);
        let (flags, operation) = axis.map_or((0, 0), |axis| board.state(axis));
        let is_ready = flags & control_flag::DISARMED != 0 && flags & control_flag::LATCHED == 0;
        let words = || format!("axis.{name}: {}; allowed: off and not latched", in_words(flags, operation));
        if is_ready { Ok(()) } else { Err(words()) }
    })
}

/// Stops axes of a group, and waits until control-proc has acted on it.
///
/// # Errors
/// It does not act in time; then it does not run or hangs, and drives go neutral by themselves.
pub fn stop_axes(board: &Board, axes: impl IntoIterator<Item = usize>) -> Result<(), String> {
    let ticket = board.stop(axes);
    let until = Instant::now() + STOP_PATIENCE;
    while !board.is_done(&ticket) {
        if Instant::now() > until {
            let patience = humantime::format_duration(STOP_PATIENCE);
            return Err(format!(
                "asked to stop, and control-proc has not answered within {patience}: drives go neutral by themselves"
            ));
        }
        sleep(Duration::from_millis(1));
    }
    Ok(())
}

/// Mode and flags of all axes of a group.
pub fn states(board: &Board) -> Disarmed {
    let machine = board.machine();
    let state = |axis: usize| {
        let (flags, operation) = board.state(axis);
        (machine.name(axis).to_owned(), in_words(flags, operation))
    };
    Disarmed { axes: (0..machine.axis_count as usize).map(state).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WINDOW: Window = Window { from: 0.5, to: 0.7, speed: 0.02 };

    fn drive(set_point: Option<f64>) -> Drive {
        Drive { name: "boom".to_owned(), axis: 0, window: WINDOW, taken: None, is_armed: false, set_point }
    }

    #[test]
    fn the_set_point_goes_to_the_target_at_the_speed_of_the_settings() {
        let mut drive = drive(Some(0.6));
        (0..100).for_each(|_| drive.approach(Some(0.61), 0.01));
        assert!((drive.set_point.unwrap() - 0.61).abs() < 1e-12);
        (0..100).for_each(|_| drive.approach(Some(0.5), 0.01));
        assert!((drive.set_point.unwrap() - 0.59).abs() < 1e-12);
        drive.approach(None, 0.01);
        assert!((drive.set_point.unwrap() - 0.59).abs() < 1e-12);
    }

    #[test]
    fn an_axis_that_is_off_again_is_not_armed_again() {
        let (mut drive, mut request) = (drive(None), Request::default());
        let mut sample = EncoderSample::default();
        sample.axes[0].position = 0.65;
        let mut found = AxisCommand { flags: control_flag::DISARMED, taken_requests: 7, ..AxisCommand::default() };
        drive.look(&found, &mut request).unwrap();
        assert_eq!(request.axes[0].enable, 0, "nothing is asked before a sample");
        drive.ask(&sample, &mut request).unwrap();
        assert_eq!((request.axes[0].enable, request.axes[0].hold_to_run, request.axes[0].target), (1, 1, 0.65));
        drive.look(&found, &mut request).unwrap();
        found.taken_requests = 8;
        drive.look(&found, &mut request).unwrap();
        assert_eq!(request.axes[0].enable, 2, "the first edge was taken and has not armed it");
        (found.flags, found.operation) = (control_flag::SETTLING, AxisMode::Hold as u32);
        drive.look(&found, &mut request).unwrap();
        assert_eq!(drive.set_point, None);
        found.flags = 0;
        drive.look(&found, &mut request).unwrap();
        assert_eq!((drive.set_point, request.axes[0].enable), (Some(0.65), 2));
        found.flags = control_flag::DISARMED;
        let Err(End::Seat(why)) = drive.look(&found, &mut request) else { panic!("it goes on") };
        assert!(why.contains("was armed and is not any more: axis.boom: hold"), "{why}");
        found.flags = control_flag::STALL;
        assert!(drive.look(&found, &mut request).is_err());
    }

    #[test]
    fn an_axis_that_is_armed_at_the_machine_is_left_alone() {
        let (mut drive, mut request) = (drive(None), Request::default());
        let found = AxisCommand { operation: AxisMode::Hold as u32, taken_requests: 7, ..AxisCommand::default() };
        let Err(End::Seat(why)) = drive.look(&found, &mut request) else { panic!("it is taken") };
        assert!(why.contains("it is armed at the machine: axis.boom: hold"), "{why}");
        assert_eq!(drive.set_point, None);
    }

    #[test]
    fn an_axis_outside_of_its_window_is_not_armed() {
        let (mut drive, mut request) = (drive(None), Request::default());
        let mut sample = EncoderSample::default();
        sample.axes[0].position = 0.709;
        drive.ask(&sample, &mut request).unwrap();
        assert_eq!(request.axes[0].target, 0.709, "it begins where it stands");
        (drive, request) = (self::drive(None), Request::default());
        sample.axes[0].position = 0.711;
        let Err(End::Seat(why)) = drive.ask(&sample, &mut request) else { panic!("it is armed") };
        assert!(why.contains("is at 0.7110 m; allowed: 0.5 to 0.7 m"), "{why}");
        assert_eq!(request.axes[0].mode, 0);
    }
}
