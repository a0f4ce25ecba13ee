//! `hydraxis status`: how a running group is doing.
//!
//! Read from the heartbeats of the stages and from control-proc's account of the axes, both in shared memory and both
//! sent between two ticks. Trap: whoever attaches to a channel makes its writer's next send take longer; so nothing is
//! attached to that a stage sends within a tick.

mod arguments;
mod figures;

use std::{
    thread::sleep,
    time::{Duration, Instant},
};

use pipeline::{
    channel::{Group, GroupState, Member, Prefix, Reader, groups},
    message::{MachineState, StageHealth, StageState},
    stage::{StageKind, monotonic_ns},
};
use rustix::process::{Pid, Signal, kill_process};

use crate::{
    failure::Failure,
    group::signals::stop_flag,
    report::output::{Output, show},
};
pub use arguments::StatusArguments;

use figures::Figures;

/// How long heartbeats are listened to: several of each stage, so that a rate can be told from the first and the last.
const LISTEN: Duration = Duration::from_millis(550);
/// How often.
const POLL: Duration = Duration::from_millis(20);
/// Time between two looks.
const WATCH_PERIOD: Duration = Duration::from_secs(1);
/// A stage without a heartbeat for so long, ns, is not well: ten of them.
const SILENT_NS: u64 = 1_000_000_000;

/// What was heard of a group.
struct Heard {
    prefix: Prefix,
    /// First and last heartbeat of each stage.
    stages: [Option<(StageHealth, StageHealth)>; 4],
    state: Option<MachineState>,
    /// Who is in the group.
    members: Vec<Member>,
    now_ns: u64,
}

/// Runs the command.
pub fn run(arguments: &StatusArguments) -> Result<(), Failure> {
    let output = Output::open(arguments.json.as_deref())?;
    let prefix = match &arguments.prefix {
        Some(prefix) => prefix.clone(),
        None => the_only_one()?,
    };
    let stop = stop_flag()?;
    let mut listener = Listener::join(&prefix)?;
    if arguments.watch {
        while !stop.load(std::sync::atomic::Ordering::Relaxed) {
            let heard = listener.listen()?;
            show(&format!("{}\n", Figures::new(&heard).tables()))?;
            sleep(WATCH_PERIOD.saturating_sub(LISTEN));
        }
        return Ok(());
    }
    let heard = listener.listen()?;
    let figures = Figures::new(&heard);
    output.write(|| figures.tables(), &figures)?;
    if arguments.reset {
        reset(&heard)?;
    }
    match figures.silent() {
        names if names.is_empty() => Ok(()),
        names => Err(Failure::Run(format!("group \"{prefix}\": silent for more than a second: {}", names.join(", ")))),
    }
}

/// The prefix of the group that runs, if there is one and no other.
fn the_only_one() -> Result<Prefix, Failure> {
    let living: Vec<Prefix> =
        groups().into_iter().filter(|group| group.state == GroupState::Alive).map(|group| group.prefix).collect();
    match living.as_slice() {
        [] => Err(Failure::Run("no group runs; start one with: hydraxis run".to_owned())),
        [one] => Ok(one.clone()),
        several => {
            let names: Vec<String> = several.iter().map(Prefix::to_string).collect();
            Err(Failure::Usage(format!("--prefix: found none; allowed: one of {}", names.join(", "))))
        }
    }
}

/// A place at the channels that tell how a group is doing.
struct Listener {
    prefix: Prefix,
    health: Reader<StageHealth>,
    states: Reader<MachineState>,
    group: Group,
}

impl Listener {
    fn join(prefix: &Prefix) -> Result<Self, Failure> {
        // Joining would make a group where there is none.
        if !groups().iter().any(|group| group.state == GroupState::Alive && group.prefix == *prefix) {
            return Err(Failure::Run(format!(
                "no group \"{prefix}\" runs; start one with: hydraxis run --prefix {prefix}"
            )));
        }
        let group = Group::join(prefix, "status").map_err(Failure::run)?;
        Ok(Self {
            prefix: prefix.clone(),
            health: group.reader().map_err(Failure::run)?,
            states: group.reader().map_err(Failure::run)?,
            group,
        })
    }

    /// Listens for a while.
    fn listen(&mut self) -> Result<Heard, Failure> {
        let mut stages: [Option<(StageHealth, StageHealth)>; 4] = [None; 4];
        let until = Instant::now() + LISTEN;
        while Instant::now() < until {
            while let Some(health) = self.health.read().map_err(Failure::run)?.if_new() {
                let Some(place) = stages.get_mut(health.stage as usize) else { continue };
                // What a stage has left that was started again since says nothing about the new one.
                let first = place.map(|(first, _)| first).filter(|first| first.pid == health.pid);
                let before = first.filter(|first| first.since_ns == health.since_ns);
                *place = Some((before.unwrap_or(*health), *health));
            }
            self.states.newest().map_err(Failure::run)?;
            sleep(POLL);
        }
        let now_ns = monotonic_ns();
        let state = self.states.last().copied();
        if stages.iter().flatten().next().is_none() {
            return Err(Failure::Run(format!(
                "group \"{}\": no stage has said anything within {LISTEN:?}: it has ended, or is just starting",
                self.prefix
            )));
        }
        let own = std::process::id();
        let members = self.group.members().into_iter().filter(|member| member.pid != own).collect();
        Ok(Heard { prefix: self.prefix.clone(), stages, state, members, now_ns })
    }
}

/// Asks every stage to count from zero again.
fn reset(heard: &Heard) -> Result<(), Failure> {
    for (_, health) in heard.stages.iter().flatten() {
        let name = StageKind::ALL.get(health.stage as usize).map_or("?", |kind| kind.name());
        let is_running = health.state == StageState::Running as u32 || health.state == StageState::Ready as u32;
        let is_heard = heard.now_ns.saturating_sub(health.header.sent_ns) < SILENT_NS;
        // The number of a process that has ended may be somebody else's by now.
        if !(is_running && is_heard) {
            eprintln!("{name}: not reset, it is not running");
            continue;
        }
        let pid = i32::try_from(health.pid).ok().and_then(Pid::from_raw);
        let sent = pid.map(|pid| kill_process(pid, Signal::USR1));
        match sent {
            Some(Ok(())) => eprintln!("{name}: counts and measures from zero again"),
            _ => {
                return Err(Failure::Run(format!("{name}: process {} cannot be asked; are you its user?", health.pid)));
            }
        }
    }
    Ok(())
}
