//! Stops of the axes in the midst of all other faults. After a stop nothing moves until axes are armed again.

use std::{
    process::Stdio,
    time::{Duration, Instant},
};

use pipeline::{
    message::{AxisCommand, ValveCommand, control_flag},
    stage::{StageKind, monotonic_ns},
};
use rustix::process::{Pid, Signal, kill_process};

use crate::{
    group::{Chaos, FOREIGN, Tally, client},
    harness::{Dice, FOUR_AXES, PATIENCE, hydraxis, is_running, place::FullMemory},
    watch::AXES,
};

/// Time after a neutral command in which an axis comes to rest: many times the lag of its valve.
const COMES_TO_REST: Duration = Duration::from_millis(700);
/// Largest travel of an axis at rest, counts of 0.1 mm, and in every second. The valves of the simulated machine have
/// no leakage that moves more.
const DRIFT: f64 = 10.0;
const DRIFT_PER_SECOND: f64 = 10.0;

/// A stop that was asked for, and what has to hold since.
pub struct Stopped {
    asked_ns: u64,
    is_emergency: bool,
    /// When the first neutral command was sent.
    pub neutral_ns: Option<u64>,
    /// Where the axes came to rest, and when.
    rest: Option<(u64, [i64; AXES])>,
}

impl Stopped {
    /// Checks a command.
    pub fn take(&mut self, command: &ValveCommand) {
        let is_off = |axis: &AxisCommand| {
            let off = if self.is_emergency {
                control_flag::EMERGENCY_STOP
            } else {
                control_flag::DISARMED | control_flag::LATCHED
            };
            axis.command == 0.0 && axis.flags & off != 0
        };
        let axes = &command.axes[..AXES];
        let is_stopped = axes.iter().all(is_off) && (!self.is_emergency || command.cut_off == 1);
        if self.neutral_ns.is_some() {
            assert!(is_stopped, "after a stop: cut off {}, {axes:?}", command.cut_off);
        } else if is_stopped && command.header.sent_ns > self.asked_ns {
            self.neutral_ns = Some(command.header.sent_ns);
        }
    }
}

/// Stops all axes from the shell, by a signal or by the counter on the board.
pub fn stop(chaos: &mut Chaos, dice: &mut Dice, tally: &mut Tally) {
    let prefix = chaos.prefix().to_string();
    let control = chaos.watch().pids[StageKind::ControlProc as usize];
    let way = dice.below(3);
    let is_emergency = way == 1;
    let name = ["disarm", "disarm --emergency", "SIGUSR2"][way as usize];
    // A signal that comes between two lives is lost, and the next life begins disarmed.
    if way == 2 && !is_running(control) {
        return;
    }
    dice.note(name);
    tally.axis_stops += 1;
    chaos.watch().poll();
    allow_motion(chaos, tally);
    let asked_ns = monotonic_ns();
    chaos.watch().stopped = Some(Stopped { asked_ns, is_emergency, neutral_ns: None, rest: None });
    let child = match way {
        0 => Some(client(&["disarm", "--prefix", &prefix])),
        1 => Some(client(&["disarm", "--emergency", "--prefix", &prefix])),
        _ => {
            let _ = kill_process(Pid::from_raw(control as i32).unwrap(), Signal::USR2);
            None
        }
    };
    let neutral = chaos.look_until(name, |chaos| chaos.watch().stopped.as_ref().and_then(|stopped| stopped.neutral_ns));
    if let Some(child) = child {
        chaos.finish(child);
    }
    let Some(neutral_ns) = neutral else { return };
    tally.react(&format!("neutral command after {name}"), asked_ns, neutral_ns);
    chaos.look_for(COMES_TO_REST);
    let rest = chaos.watch().positions();
    if let Some(stopped) = &mut chaos.watch().stopped {
        stopped.rest = rest;
    }
    chaos.look_for(Duration::from_millis(dice.below(1000)));
}

/// Ends the rule that nothing moves, after a look at how far the axes have moved since they came to rest.
pub fn allow_motion(chaos: &mut Chaos, tally: &mut Tally) {
    let Some(watch) = &mut chaos.watch else { return };
    let Some(Stopped { rest: Some((since, from)), .. }) = watch.stopped.take() else { return };
    let Some((at, now)) = watch.positions() else { return };
    let seconds = at.saturating_sub(since) as f64 * 1e-9;
    for (axis, (now, from)) in now.iter().zip(from).enumerate() {
        let counts = now.abs_diff(from) as f64;
        assert!(counts <= DRIFT + DRIFT_PER_SECOND * seconds, "axis {axis}: {counts} counts in {seconds:.2} s");
        tally.drift.0 = tally.drift.0.max(0.1 * counts);
        if seconds > 0.5 {
            tally.drift.1 = tally.drift.1.max(0.1 * counts / seconds);
        }
    }
}

/// A stop while an operator that has the place on the channel of requests is suspended. It goes on afterwards, or is
/// killed.
pub fn stop_with_hung_operator(chaos: &mut Chaos, dice: &mut Dice, tally: &mut Tally) {
    dice.note("operator, suspended");
    tally.clients += 1;
    let prefix = chaos.prefix().to_string();
    let mut operator = client(&["operate", "--mode", "hold", "--prefix", &prefix]);
    chaos.look_for(Duration::from_millis(dice.below(150)));
    let pid = Pid::from_raw(operator.id() as i32).unwrap();
    let _ = kill_process(pid, Signal::STOP);
    stop(chaos, dice, tally);
    if dice.once_in(2) {
        let _ = kill_process(pid, Signal::CONT);
    } else {
        let _ = operator.kill();
    }
    chaos.finish(operator);
}

/// Other starts of the name that runs, all at once. Each is refused.
pub fn start_again(chaos: &mut Chaos, dice: &mut Dice, tally: &mut Tally) {
    let count = 2 + dice.below(3);
    dice.note(&format!("{count} other starts of this name"));
    let prefix = chaos.prefix().to_string();
    let start = |_| {
        let mut run = hydraxis();
        run.args(["run", FOUR_AXES, "--duration", "1s", "--prefix", &prefix]);
        run.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
    };
    let starts: Vec<_> = (0..count).map(start).collect();
    for start in starts {
        tally.other_starts += 1;
        let code = chaos.finish(start);
        assert!(code == Some(1) || chaos.has_ended(), "{code:?}");
    }
}

/// Foreign files with names that begin like those of the group. They are there until the group has ended, and as they
/// were.
pub fn plant_foreign_files(chaos: &mut Chaos, dice: &mut Dice, tally: &mut Tally) {
    if !chaos.foreign.is_empty() {
        return;
    }
    dice.note("foreign files");
    let prefix = chaos.prefix().to_string();
    let paths = [
        format!("/dev/shm/{prefix}.txt"),
        format!("/dev/shm/{prefix}.{}_1.data", "0".repeat(39)),
        format!("/dev/shm/{prefix}-other.{}_1.data", "0".repeat(40)),
    ];
    for path in paths {
        std::fs::write(&path, FOREIGN).unwrap();
        chaos.foreign.push(path.into());
        tally.foreign_files += 1;
    }
}

/// Fills up shared memory for a while, and mostly kills a stage meanwhile, which cannot start again before there is
/// room.
pub fn fill_memory(chaos: &mut Chaos, dice: &mut Dice, tally: &mut Tally) {
    dice.note("full memory");
    tally.full_memory += 1;
    let memory = FullMemory::take();
    if dice.below(4) > 0 {
        let kind = dice.one_of(&[StageKind::IdentProc, StageKind::ControlProc, StageKind::SensorProc]);
        dice.note(&format!("SIGKILL {} with full memory", kind.name()));
        tally.kills += u64::from(chaos.signal(kind, Signal::KILL));
    }
    stop(chaos, dice, tally);
    chaos.look_for(Duration::from_millis(dice.below(600)));
    drop(memory);
    // The stage has room again.
    let until = Instant::now() + PATIENCE;
    while !chaos.has_ended() && !chaos.watch().pids.iter().all(|pid| is_running(*pid)) {
        assert!(Instant::now() < until, "a stage was not started again with room");
        chaos.look_for(Duration::from_millis(20));
    }
}
