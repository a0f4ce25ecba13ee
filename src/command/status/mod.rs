//! `hydraxis status`: the state of a running group.
//!
//! The figures come from the heartbeats of the stages and from the axis states that control-proc sends; both are sent
//! between two ticks. Runs in a process of its own, beside the loop.
//!
//! Trap: a reader that attaches to a channel makes the next send of its publisher take longer. So this command attaches
//! to no channel that a stage sends on within a tick.

mod arguments;
mod watch;

use std::{
    io::{IsTerminal, stdin, stdout},
    sync::atomic::{AtomicBool, Ordering},
    thread::sleep,
    time::{Duration, Instant},
};

use pipeline::{
    channel::{ChannelError, Group, GroupState, Prefix, Reader, groups, rooms},
    message::{MachineState, StageHealth, StageState},
    stage::{StageKind, monotonic_ns},
};
use rustix::process::{Pid, Signal, kill_process};

use crate::{
    failure::Failure,
    group::{operator::OperatorError, running::meant, signals::stop_flag},
    report::{
        block::can_move,
        output::{Output, show_to_reader},
        status::{Collected, SILENT_NS, StatusReport},
    },
};
pub use arguments::StatusArguments;

/// Time for which heartbeats are collected: several of each stage, so that the first and the last give a rate.
const LISTEN: Duration = Duration::from_millis(550);
/// Time between two reads of the channels.
const POLL: Duration = Duration::from_millis(20);
/// Time between two outputs of `--watch`.
const WATCH_PERIOD: Duration = Duration::from_secs(1);
/// Runs the command.
pub fn run(arguments: &StatusArguments) -> Result<(), Failure> {
    let output = Output::open(arguments.json.as_deref())?;
    let prefix = meant(arguments.prefix.as_ref())?;
    let stop = stop_flag()?;
    expect_alive(&prefix)?;
    let has_screen = arguments.watch && stdin().is_terminal() && stdout().is_terminal() && can_move();
    if has_screen && watch::watch(&prefix, &stop)? {
        return Ok(());
    }
    let mut reader = StatusReader::join(&prefix)?;
    if arguments.watch {
        return print(&mut reader, &stop);
    }
    let collected = reader.collect()?;
    let report = StatusReport::new(&collected);
    output.write(|| report.tables(), &report)?;
    if arguments.reset {
        reset(&collected)?;
    }
    match report.silent() {
        names if names.is_empty() => Ok(()),
        names => Err(Failure::run(format!("group \"{prefix}\": silent for more than a second: {}", names.join(", ")))),
    }
}

/// Refuses a group that does not run: to join it would create it.
fn expect_alive(prefix: &Prefix) -> Result<(), Failure> {
    let is_alive = groups().iter().any(|group| group.state == GroupState::Alive && group.prefix == *prefix);
    if is_alive { Ok(()) } else { Err(OperatorError::NoGroup(prefix.clone()).into()) }
}

/// Prints the state every second until a signal, or until nobody reads it any more.
fn print(reader: &mut StatusReader, stop: &AtomicBool) -> Result<(), Failure> {
    while !stop.load(Ordering::Relaxed) {
        let report = StatusReport::new(&reader.collect()?);
        if !show_to_reader(&format!("{}\n", report.tables()))? {
            break;
        }
        sleep(WATCH_PERIOD.saturating_sub(LISTEN));
    }
    Ok(())
}

/// Reads the channels about the state of a group.
struct StatusReader {
    prefix: Prefix,
    health: Reader<StageHealth>,
    states: Reader<MachineState>,
    group: Group,
}

impl StatusReader {
    fn join(prefix: &Prefix) -> Result<Self, Failure> {
        let group = Group::join(prefix, "status").map_err(ChannelError::from)?;
        Ok(Self {
            prefix: prefix.clone(),
            health: group.reader().map_err(ChannelError::from)?,
            states: group.reader().map_err(ChannelError::from)?,
            group,
        })
    }

    /// Collects messages for [`LISTEN`].
    fn collect(&mut self) -> Result<Collected, Failure> {
        let mut stages: [Option<(StageHealth, StageHealth)>; 4] = [None; 4];
        let until = Instant::now() + LISTEN;
        while Instant::now() < until {
            while let Some(health) = self.health.read().map_err(ChannelError::from)?.if_new() {
                let Some(place) = stages.get_mut(health.stage as usize) else { continue };
                // A heartbeat of the process before a restart says nothing about the new process.
                let first = place.map(|(first, _)| first).filter(|first| first.pid == health.pid);
                let before = first.filter(|first| first.since_ns == health.since_ns);
                *place = Some((before.unwrap_or(*health), *health));
            }
            self.states.newest().map_err(ChannelError::from)?;
            sleep(POLL);
        }
        let now_ns = monotonic_ns();
        let state = self.states.last().copied();
        if stages.iter().flatten().next().is_none() {
            return Err(Failure::run(format!(
                "group \"{}\": no heartbeat within {}: it has ended, or is just starting",
                self.prefix,
                humantime::format_duration(LISTEN)
            )));
        }
        let own = std::process::id();
        let members = self.group.members().into_iter().filter(|member| member.pid != own).collect();
        let rooms = rooms(&self.prefix);
        Ok(Collected { prefix: self.prefix.clone(), stages, state, members, rooms, now_ns })
    }
}

/// Asks every running stage to count and to measure from zero.
fn reset(collected: &Collected) -> Result<(), Failure> {
    for (_, health) in collected.stages.iter().flatten() {
        let name = StageKind::ALL.get(health.stage as usize).map_or("?", |kind| kind.name());
        let is_running = health.state == StageState::Running as u32 || health.state == StageState::Ready as u32;
        let is_heard = collected.now_ns.saturating_sub(health.header.sent_ns) < SILENT_NS;
        // The number of a process that has ended may belong to another process by now.
        if !(is_running && is_heard) {
            eprintln!("{name}: not reset, it is not running");
            continue;
        }
        let pid = i32::try_from(health.pid).ok().and_then(Pid::from_raw);
        let sent = pid.map(|pid| kill_process(pid, Signal::USR1));
        match sent {
            Some(Ok(())) => eprintln!("{name}: counts and measures from zero again"),
            _ => {
                return Err(Failure::run(format!("{name}: process {} cannot be asked; are you its user?", health.pid)));
            }
        }
    }
    Ok(())
}
