//! What happens to a group: every latch, change of mode, change of the controller, refusal, loss and restart, with its
//! time, its cause, and what to do.
//!
//! Events are found in the commands and heartbeats that the monitor reads. Each is told on standard error and in the
//! log when it happens, and listed in the report. An event that comes again within [`APART_S`] is counted and told
//! with the next one.
//!
//! Runs in the supervisor, beside the loop.

use std::collections::BTreeMap;

use control_proc::{protection::hunting::LARGEST_SWING, reference::channel::ENGAGE_DISTANCE};
use pipeline::{
    channel::Prefix,
    machine::{Axis, Machine},
    message::{
        AxisCommand, AxisMode, ControlMode, EncoderSample, REFUSALS, StageHealth, ValveCommand, bit_names,
        command_event, control_flag, sample_fault,
    },
    stage::StageKind,
};
use serde::Serialize;

/// Least time between two events of one kind and axis that are told, s of the machine.
const APART_S: f64 = 1.0;
/// Kind of a latch.
pub const LATCH: &str = "latch";
/// Kind of a death, which the supervisor tells itself.
pub const RESTART: &str = "restart";
/// Events that are listed. Later ones are counted.
const MOST: usize = 1000;
/// Flags that are events when they come, but latch nothing.
const WARNINGS: [u32; 9] = [
    control_flag::REFERENCE,
    control_flag::REQUEST,
    control_flag::REQUEST_STOPPED,
    control_flag::MODEL_STALE,
    control_flag::MODEL_REFUSED,
    control_flag::MODEL_TRIAL,
    control_flag::MODEL_WORSE,
    control_flag::CAUTION,
    control_flag::HALF_SPEED,
];

/// One event.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Event {
    /// Time of the machine, s.
    pub time_s: f64,
    /// The axis that it happened to; none for the whole group.
    pub axis: Option<String>,
    /// What happened: `latch`, `release`, `wait`, `mode`, `controller`, `loss`, `restart`, `operator`, or the name of a
    /// flag.
    pub kind: &'static str,
    /// Cause, value and limit.
    pub text: String,
    /// What to do; empty for nothing.
    pub next: String,
    /// Whether something is wrong.
    pub is_fault: bool,
    /// How many more of its kind came since the one before.
    pub more: u64,
}

impl Event {
    /// As a line for people.
    pub fn line(&self) -> String {
        let axis = self.axis.as_ref().map(|axis| format!("axis.{axis}: ")).unwrap_or_default();
        let more = if self.more > 0 { format!(" (and {} more times before)", self.more) } else { String::new() };
        let next = if self.next.is_empty() { String::new() } else { format!("; {}", self.next) };
        format!("{:.3} s {axis}{}: {}{more}{next}", self.time_s, self.kind, self.text)
    }
}

/// What was last seen of an axis.
#[derive(Debug, Clone, Copy, Default)]
struct Seen {
    latches: u64,
    flags: u32,
    operation: u32,
    mode: u32,
    rejected: [u64; REFUSALS.len()],
    error: f64,
    waits: bool,
    /// Session and number of the newest reference when the axis began to track. None once the axis has followed one, or
    /// another has come: from then on a reference that is refused is an event.
    unfed: Option<(u64, u64)>,
}

impl Seen {
    /// What a command says of an axis, after `before`. `newest`: session and number of the newest reference.
    fn of(now: &AxisCommand, waits: bool, newest: (u64, u64), before: Option<&Self>) -> Self {
        let is_refused = now.flags & control_flag::REFERENCE != 0;
        let has_followed = now.mode != ControlMode::Neutral as u32 && !is_refused;
        let tracks = now.operation == AxisMode::Track as u32;
        let unfed = match before {
            Some(before) if before.operation == now.operation => before.unfed,
            _ => tracks.then_some(newest),
        };
        let unfed = unfed.filter(|first| !(has_followed || is_refused && *first != newest));
        Self {
            latches: now.latches,
            flags: if unfed.is_some() { now.flags & !control_flag::REFERENCE } else { now.flags },
            operation: now.operation,
            mode: now.mode,
            rejected: now.rejected_snapshots,
            error: now.error,
            waits,
            unfed,
        }
    }
}

/// The events of a group.
pub struct Events {
    machine: Machine,
    prefix: Prefix,
    seen: Vec<Option<Seen>>,
    operator: u64,
    /// Process and lost messages of each stage.
    stages: [(u32, u64); 4],
    time_s: f64,
    /// When an event of a kind and axis was last told, and how many have come since.
    told: BTreeMap<(&'static str, Option<usize>), (f64, u64)>,
    list: Vec<Event>,
    /// Events of the list that were taken.
    taken: usize,
    left_out: u64,
}

impl Events {
    /// Of a group that runs `machine`.
    pub fn new(machine: &Machine, prefix: &Prefix) -> Self {
        Self {
            machine: machine.clone(),
            prefix: prefix.clone(),
            seen: vec![None; machine.axes.len()],
            operator: 0,
            stages: [(0, 0); 4],
            time_s: 0.0,
            told: BTreeMap::new(),
            list: Vec::new(),
            taken: 0,
            left_out: 0,
        }
    }

    /// Looks at a command; `sample` is the newest one.
    pub fn command(&mut self, command: &ValveCommand, sample: Option<&EncoderSample>) {
        self.time_s = command.header.sequence as f64 * self.machine.timing.period.as_secs_f64();
        if command.operator != self.operator && command.operator != 0 {
            let text = match self.operator {
                0 => "a program operates the group",
                _ => "another program operates the group; the one before has no effect any more",
            };
            self.add("operator", None, text, "", false);
        }
        self.operator = command.operator;
        // The last command of a controller is neutral as well.
        let ends =
            command.inputs.events & command_event::NEUTRAL != 0 && command.inputs.events & command_event::SILENT == 0;
        let newest = (command.inputs.reference_session, command.inputs.reference_number);
        for i in 0..self.seen.len() {
            let (now, faults) = (&command.axes[i], sample.map_or(0, |sample| sample.axes[i].faults));
            let after = Seen::of(now, waits(now) && !ends, newest, self.seen[i].as_ref());
            let before = self.seen[i].replace(after);
            let first = Seen { operation: now.operation, mode: now.mode, ..Seen::default() };
            if after.waits && !before.is_some_and(|before| before.waits) {
                let timeout = humantime::format_duration(self.machine.timing.feedback_timeout);
                let text = format!(
                    "no usable reading for a moment: the axis waits at neutral, and latches after \
                     timing.feedback_timeout, {timeout}"
                );
                self.add("wait", Some(i), &text, "it goes on slowly when readings are back", true);
            }
            let before = before.unwrap_or(first);
            self.axis(i, before, now, after.flags & !before.flags, faults);
        }
    }

    /// `came`: the flags that are events if they are among [`WARNINGS`].
    fn axis(&mut self, index: usize, before: Seen, now: &AxisCommand, came: u32, faults: u32) {
        let name = self.machine.axes[index].name.clone();
        let is_latched = now.flags & control_flag::LATCHED != 0;
        // A controller that is started again counts from 0.
        if now.latches > before.latches || (now.latches > 0 && now.latches < before.latches) {
            let text = latch(&self.machine, &self.machine.axes[index], now.latched_by, before.error, faults);
            let next = format!("look at why, then type: hydraxis reset --prefix {} --axis {name}", self.prefix);
            self.add(LATCH, Some(index), &text, &next, true);
        } else if before.flags & control_flag::LATCHED != 0 && !is_latched {
            self.add("release", Some(index), "the latch was released", "", false);
        }
        if now.operation != before.operation && now.mode != ControlMode::Replay as u32 {
            let of = |mode| AxisMode::from_number(mode).map_or("unknown", AxisMode::name);
            self.add("mode", Some(index), &format!("{}, after {}", of(now.operation), of(before.operation)), "", false);
        }
        let [model, fallback] = [ControlMode::Model as u32, ControlMode::Fallback as u32];
        if now.mode != before.mode && now.mode == model {
            self.add("controller", Some(index), "the model controls", "", false);
        } else if now.mode == fallback && before.mode == model {
            self.add("controller", Some(index), "the fallback controls", "", false);
        }
        for flag in WARNINGS.into_iter().filter(|flag| came & flag != 0) {
            let kind = bit_names(flag, &control_flag::NAMES).next().unwrap_or("unknown");
            let (text, next) = warning(flag, &self.machine, &self.machine.axes[index], &before, now);
            // A trial finds out whether something is wrong.
            self.add(kind, Some(index), &text, &next, flag != control_flag::MODEL_TRIAL);
        }
    }

    /// Looks at a heartbeat.
    pub fn health(&mut self, health: &StageHealth) {
        let Some(seen) = self.stages.get_mut(health.stage as usize) else { return };
        let lost = health.lost();
        let (pid, before) = std::mem::replace(seen, (health.pid, lost));
        if pid == health.pid && lost > before {
            let name = StageKind::ALL[health.stage as usize].name();
            let channels: Vec<&str> = health.channels().iter().filter(|c| c.lost > 0).map(|c| c.name()).collect();
            let text = format!("{name} has not read {} messages of {}", lost - before, channels.join(", "));
            self.add("loss", None, &text, "hydraxis doctor shows what keeps a stage from its core", true);
        }
    }

    /// Notes a death, which the supervisor has told.
    pub fn restart(&mut self, text: String) {
        let (time_s, kind) = (self.time_s, RESTART);
        self.keep(Event { time_s, axis: None, kind, text, next: String::new(), is_fault: true, more: 0 });
    }

    fn add(&mut self, kind: &'static str, axis: Option<usize>, text: &str, next: &str, is_fault: bool) {
        let key = (kind, axis);
        let time_s = self.time_s;
        let more = match self.told.get_mut(&key) {
            Some((last, more)) if (0.0..APART_S).contains(&(time_s - *last)) => {
                *more += 1;
                return;
            }
            Some((_, more)) => *more,
            None => 0,
        };
        self.told.insert(key, (time_s, 0));
        let axis = axis.map(|index| self.machine.axes[index].name.clone());
        self.keep(Event { time_s, axis, kind, text: text.to_owned(), next: next.to_owned(), is_fault, more });
    }

    fn keep(&mut self, event: Event) {
        if self.list.len() < MOST {
            self.list.push(event);
        } else {
            self.left_out += 1;
        }
    }

    /// What has happened since the last call.
    pub fn news(&mut self) -> &[Event] {
        let taken = std::mem::replace(&mut self.taken, self.list.len());
        &self.list[taken..]
    }

    /// The lines about what has happened since the last call, without deaths.
    pub fn lines(&mut self) -> Vec<String> {
        self.news().iter().filter(|event| event.kind != RESTART).map(Event::line).collect()
    }

    /// Takes all events out of the list, so that there is room for new ones.
    pub fn drain(&mut self) -> Vec<Event> {
        self.taken = 0;
        std::mem::take(&mut self.list)
    }

    /// Number of events that were too many for the list.
    pub fn left_out(&self) -> u64 {
        self.left_out
    }

    /// All events, and the number of those that were too many for the list.
    pub fn into_list(self) -> (Vec<Event>, u64) {
        (self.list, self.left_out)
    }
}

/// Whether the axis is armed in hold or track, and nobody commands it. An axis that rests has a controller.
fn waits(axis: &AxisCommand) -> bool {
    const NOT_ARMED: u32 = control_flag::DISARMED | control_flag::SETTLING | control_flag::LATCHED;
    let follows = [AxisMode::Hold, AxisMode::Track].map(|mode| mode as u32).contains(&axis.operation);
    follows && axis.mode == ControlMode::Neutral as u32 && axis.flags & NOT_ARMED == 0
}

/// Why a fault has latched the axis, with value and limit. `error` is the following error of the tick before, m: a
/// latched axis has none.
fn latch(machine: &Machine, axis: &Axis, latched_by: u32, error: f64, faults: u32) -> String {
    let timeout = humantime::format_duration(machine.timing.feedback_timeout);
    let one = |flag: u32| match flag {
        control_flag::FEEDBACK => {
            // The counts of an axis at rest do not change either, so a sample is often marked as stuck as well.
            let implausible = faults & sample_fault::UNUSABLE & !sample_fault::STALE;
            let found: Vec<String> =
                bit_names(implausible, &sample_fault::NAMES).map(|name| limited(name, axis)).collect();
            if found.is_empty() {
                format!(
                    "found samples that are stale, or stand while the axis is driven; allowed: none missing for \
                     timing.feedback_timeout, {timeout} (`hydraxis doctor` shows whether the computer is to blame)"
                )
            } else {
                format!(
                    "found samples marked {}; allowed: fewer than 3 in a row, and none out of range",
                    found.join(", ")
                )
            }
        }
        control_flag::DEADLINE => format!(
            "commands came late for timing.feedback_timeout, {timeout}: the computer is busy (`hydraxis doctor`), or \
             readings are old when they are written"
        ),
        control_flag::SOLVER => "the predictive controller found no plan several times in a row".to_owned(),
        control_flag::STALL => {
            "the axis was driven and hardly moved: look at pump, pilot pressure, valve and sensor".to_owned()
        }
        control_flag::FOLLOWING => format!(
            "found a following error of {:.1} mm; allowed: {:.1} mm and 0.2 s of the reference's speed \
             (axis.{}.control.following_error)",
            1e3 * error,
            1e3 * axis.control.following_error,
            axis.name
        ),
        control_flag::SWING => format!(
            "the axis swung on, though its reference did not ask for it, with a quarter of the gains; allowed: a speed \
             of {} m/s to and fro ({:.0} % of axis.{}.max_speed)",
            LARGEST_SWING * axis.max_speed,
            100.0 * LARGEST_SWING,
            axis.name
        ),
        control_flag::EMERGENCY_STOP => {
            "the emergency stop was pressed, or asked for; the pilot pressure is cut off".to_owned()
        }
        control_flag::MOTION => format!(
            "the axis moved though nobody had commanded it, against its command (are valve and encoder of the same \
             sign?), or faster than its max_speed of {} m/s. The pilot pressure is cut off",
            axis.max_speed
        ),
        _ => "a sample had a time of CLOCK_MONOTONIC that is still to come, or the computer was suspended".to_owned(),
    };
    let flags = (0..u32::BITS).map(|bit| 1 << bit).filter(|flag| latched_by & control_flag::LATCHED & flag != 0);
    let texts: Vec<String> = flags
        .map(|flag| format!("{}: {}", bit_names(flag, &control_flag::NAMES).next().unwrap_or("unknown"), one(flag)))
        .collect();
    texts.join("; ")
}

/// The name of a fault of samples, with the limit that they are beyond.
fn limited(name: &str, axis: &Axis) -> String {
    match name {
        "range" => format!("range (0 to {} m and axis.{}.encoder.tolerance)", axis.stroke, axis.name),
        "speed" => format!("speed (a jump, or faster than axis.{}.max_speed, {} m/s)", axis.name, axis.max_speed),
        _ => name.to_owned(),
    }
}

/// What a flag that latches nothing says, and what to do.
fn warning(flag: u32, machine: &Machine, axis: &Axis, before: &Seen, now: &AxisCommand) -> (String, String) {
    let name = &axis.name;
    let (low, high) = axis.soft_limits;
    let time = humantime::format_duration;
    match flag {
        control_flag::REFERENCE => (
            format!(
                "the reference stopped, went back in time, jumped, is not finite, left the soft limits ({low} to \
                 {high} m), or began more than {} mm from the axis: the axis holds",
                1e3 * ENGAGE_DISTANCE
            ),
            "it goes on with the next good reference".to_owned(),
        ),
        control_flag::REQUEST => (
            format!(
                "a request was refused, {} so far: too old, of another session or machine, with a value outside of \
                 its limits (commands -1 to 1, set points {low} to {high} m), or off while the emergency stop is \
                 pressed",
                now.refused_requests
            ),
            "the axis does what it did before".to_owned(),
        ),
        control_flag::REQUEST_STOPPED => {
            ("requests stopped while the axis needed them: it is off".to_owned(), "operate it again".to_owned())
        }
        control_flag::MODEL_STALE => (
            format!("no new model for timing.model_timeout, {}", time(machine.timing.model_timeout)),
            "is ident-proc there? hydraxis status shows it".to_owned(),
        ),
        control_flag::MODEL_REFUSED => {
            let new = now.rejected_snapshots.iter().zip(before.rejected).zip(REFUSALS);
            let reasons: Vec<&str> = new.filter(|((now, before), _)| *now > before).map(|(_, name)| name).collect();
            let why = if reasons.is_empty() { "following error under it".to_owned() } else { reasons.join(", ") };
            (format!("the model may not control: {why}"), String::new())
        }
        control_flag::MODEL_TRIAL => (
            "the model may be worse than the fallback, or swings: the fallback controls for some seconds to compare"
                .to_owned(),
            "the model controls again if it was no worse".to_owned(),
        ),
        control_flag::CAUTION => (
            "the axis swung though its reference did not ask for it: the fallback controls, with half or a quarter of \
             its gains where it swung as well"
                .to_owned(),
            format!(
                "more is tried after 30 s without a swing; look for air in the oil and for gains that are too high \
                 (hydraxis check, hydraxis commission --enable --axis {name})"
            ),
        ),
        control_flag::MODEL_WORSE => (
            "the model followed worse than the fallback, as a trial has shown: the fallback controls".to_owned(),
            format!("it is tried again later; if it comes again, type: hydraxis commission --enable --axis {name}"),
        ),
        _ => (
            format!("no usable model for timing.model_lifetime, {}: half speed", time(machine.timing.model_lifetime)),
            "is ident-proc there? hydraxis status shows it".to_owned(),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn events() -> Events {
        Events::new(&Machine::load(None, &[]).unwrap(), &"t-events".parse().unwrap())
    }

    fn at(sequence: u64) -> ValveCommand {
        let mut command = ValveCommand::default();
        command.header.sequence = sequence;
        command
    }

    #[test]
    fn a_latch_is_told_once_with_value_limit_and_next_step() {
        let mut events = events();
        let mut command = at(100);
        command.axes[1].error = -0.0625;
        events.command(&command, None);
        assert!(events.lines().is_empty());
        command.axes[1] = AxisCommand {
            flags: control_flag::FOLLOWING,
            latched_by: control_flag::FOLLOWING,
            latches: 1,
            ..AxisCommand::default()
        };
        events.command(&command, None);
        events.command(&command, None);
        let lines = events.lines();
        assert_eq!(lines.len(), 1, "{lines:?}");
        for part in ["1.000 s axis.arm: latch: following: found a following error of -62.5 mm; allowed: ", "reset"] {
            assert!(lines[0].contains(part), "{part}: {lines:?}");
        }
        command.axes[1].flags = control_flag::DISARMED;
        events.command(&command, None);
        assert_eq!(events.lines(), ["1.000 s axis.arm: release: the latch was released"]);
    }

    #[test]
    fn every_latching_fault_has_a_text_of_its_own() {
        let machine = Machine::load(None, &[]).unwrap();
        let bits = (0..u32::BITS).map(|bit| 1 << bit).filter(|bit| control_flag::LATCHED & bit != 0);
        let texts: std::collections::BTreeSet<String> =
            bits.map(|latched_by| latch(&machine, &machine.axes[0], latched_by, 0.0, 0)).collect();
        assert_eq!(texts.len(), control_flag::LATCHED.count_ones() as usize);
        assert!(texts.iter().all(|text| text.contains(": ")));
    }

    #[test]
    fn a_sample_that_is_marked_as_stuck_may_be_stale() {
        let machine = Machine::load(None, &[]).unwrap();
        let told = |faults| latch(&machine, &machine.axes[0], control_flag::FEEDBACK, 0.0, faults);
        for faults in [sample_fault::STALE | sample_fault::STUCK, sample_fault::STUCK, 0] {
            assert!(told(faults).contains("samples that are stale, or stand while the axis is driven"), "{faults}");
        }
        let jumped = told(sample_fault::SPEED | sample_fault::STUCK);
        assert!(
            jumped.contains("marked speed (a jump, or faster than axis.boom.max_speed, 1 m/s); allowed"),
            "{jumped}"
        );
    }

    #[test]
    fn what_comes_again_within_a_second_is_counted_and_told_with_the_next() {
        let mut events = events();
        for sequence in 0..=100 {
            let mut command = at(sequence);
            command.axes[0].flags = if sequence % 2 == 0 { control_flag::REFERENCE } else { 0 };
            events.command(&command, None);
        }
        let lines = events.lines();
        assert_eq!(lines.len(), 2, "{lines:?}");
        assert!(lines[1].contains("(and 49 more times before)"), "{lines:?}");
    }

    #[test]
    fn a_reference_stops_only_after_it_ran_or_is_refused_when_it_comes() {
        let (refused, tracks) = (control_flag::REFERENCE, AxisMode::Track as u32);
        let told = |ticks: &[(u32, u32, u64)]| {
            let mut events = events();
            for (tick, (operation, flags, number)) in ticks.iter().enumerate() {
                let mut command = at(tick as u64);
                (command.axes[0].operation, command.axes[0].flags) = (*operation, *flags);
                command.axes[0].mode = ControlMode::Fallback as u32;
                command.inputs.reference_number = *number;
                events.command(&command, None);
            }
            events.lines().iter().filter(|line| line.contains("the reference stopped")).count()
        };
        let starts = [(0, 0, 7), (tracks, refused, 7), (tracks, refused, 7), (tracks, 0, 8), (tracks, 0, 9)];
        assert_eq!(told(&starts), 0, "an axis that tracks before its program sends anything");
        assert_eq!(told(&[&starts[..], &[(tracks, refused, 9)]].concat()), 1, "a reference that stops");
        assert_eq!(told(&[(tracks, refused, 7), (tracks, refused, 8)]), 1, "a reference that is refused as it comes");
    }

    #[test]
    fn changes_of_mode_and_controller_are_told() {
        let mut events = events();
        let mut command = at(0);
        command.axes[0].operation = AxisMode::Off as u32;
        events.command(&command, None);
        (command.axes[0].operation, command.axes[0].mode) = (AxisMode::Track as u32, ControlMode::Model as u32);
        events.command(&command, None);
        command.header.sequence = 500;
        command.axes[0].mode = ControlMode::Fallback as u32;
        command.axes[0].flags = control_flag::MODEL_WORSE;
        events.command(&command, None);
        let lines = events.lines().join("\n");
        for part in
            ["axis.boom: mode: track, after off", "controller: the model controls", "5.000 s axis.boom: model-worse"]
        {
            assert!(lines.contains(part), "{part}: {lines}");
        }
    }

    #[test]
    fn an_axis_that_waits_for_readings_is_told_and_the_end_of_a_controller_is_not() {
        let mut events = events();
        let mut command = at(100);
        command.axes[2].operation = AxisMode::Track as u32;
        command.axes[2].mode = ControlMode::Fallback as u32;
        events.command(&command, None);
        command.axes[2].mode = ControlMode::Neutral as u32;
        command.inputs.events = command_event::NEUTRAL;
        events.command(&command, None);
        assert_eq!(events.lines(), Vec::<String>::new());
        command.inputs.events |= command_event::SILENT;
        events.command(&command, None);
        events.command(&command, None);
        let lines = events.lines();
        assert_eq!(lines.len(), 1, "{lines:?}");
        assert!(lines[0].contains("axis.telescope: wait: no usable reading for a moment"), "{lines:?}");
        command.axes[2].mode = ControlMode::Fallback as u32;
        events.command(&command, None);
        command.header.sequence = 300;
        (command.axes[2].mode, command.inputs.events) = (ControlMode::Neutral as u32, 0);
        command.axes[2].flags = control_flag::SETTLING;
        events.command(&command, None);
        assert_eq!(events.lines(), Vec::<String>::new());
        command.axes[2].flags = 0;
        events.command(&command, None);
        assert_eq!(events.lines().len(), 1);
    }

    #[test]
    fn lost_messages_are_told_and_a_new_process_begins_anew() {
        let mut events = events();
        let mut health = StageHealth { stage: 2, pid: 7, channel_count: 1, ..StageHealth::default() };
        events.health(&health);
        health.channels[0].lost = 3;
        events.health(&health);
        assert!(events.lines()[0].contains("ident-proc has not read 3 messages of "));
        (health.pid, health.channels[0].lost) = (8, 2);
        events.health(&health);
        assert!(events.lines().is_empty());
    }

    #[test]
    fn a_death_hides_no_event_before_it() {
        let mut events = events();
        let mut command = at(100);
        command.axes[0].flags = control_flag::REFERENCE;
        events.command(&command, None);
        events.restart("ident-proc killed by SIGKILL".to_owned());
        let lines = events.lines();
        assert!(lines.len() == 1 && lines[0].contains("axis.boom: reference"), "{lines:?}");
        assert_eq!(events.into_list().0.len(), 2);
    }

    #[test]
    fn the_list_is_bounded_and_what_is_left_out_is_counted() {
        let mut events = events();
        (0..MOST + 5).for_each(|i| events.restart(i.to_string()));
        let (list, left_out) = events.into_list();
        assert_eq!((list.len(), left_out), (MOST, 5));
    }
}
