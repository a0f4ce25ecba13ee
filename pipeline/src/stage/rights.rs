//! Core affinity, scheduling class, locked memory and wake-up latency, as the machine file asks for them.
//!
//! | asked for | needs |
//! |---|---|
//! | `core` | the core among those that this process may use |
//! | `priority` | `LimitRTPRIO=` or `rtprio` of that height, or `CAP_SYS_NICE` |
//! | `lock_memory` | `LimitMEMLOCK=infinity` or `memlock unlimited`, or `CAP_IPC_LOCK` |
//! | `wakeup_latency` | `/dev/cpu_dma_latency` to be writable |
//!
//! Trap: rights by file capabilities (`setcap`) make the kernel clear the death signal on exec, and a stage then
//! survives its killed supervisor; rights by limits do not.
//!
//! Two settings can be had and still do harm, so they count as missing: a stage that spins on a core that another stage
//! needs, and a SCHED_FIFO stage that spins where the kernel stops such threads for a part of every second.

use std::{
    fs::{File, OpenOptions},
    io::{self, Write},
    num::NonZeroU64,
    path::Path,
};

use rustix::{
    io::Errno,
    mm::{MlockAllFlags, mlockall},
    process::{Resource, getrlimit},
    thread::set_current_timer_slack,
};
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

use super::{Clock, StageError, StageKind};
use crate::machine::{Machine, Realtime, Rights, StageSettings, Wait};

/// Size of the stack that a stage touches before its loop, bytes: the deepest call takes a small part of it.
const STACK: usize = 256 * 1024;
/// File that takes the longest wake-up latency; it holds for as long as the file is open.
const WAKEUP_LATENCY: &str = "/dev/cpu_dma_latency";
/// Files with the time that SCHED_FIFO threads may run in every period, and with the period, us.
const THROTTLING: [&str; 2] = ["/proc/sys/kernel/sched_rt_runtime_us", "/proc/sys/kernel/sched_rt_period_us"];
/// Bit of `CAP_IPC_LOCK` in a set of capabilities.
const IPC_LOCK: u64 = 1 << 14;
/// How to allow a priority.
const ALLOW_PRIORITY: &str = "allow it with LimitRTPRIO= in the unit or rtprio in limits.conf";
/// How to allow locked memory.
const ALLOW_LOCKING: &str = "allow it with LimitMEMLOCK=infinity in the unit or memlock in limits.conf";

/// A right that cannot be had, or a setting that does harm.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RightError {
    /// This process may not use the core.
    #[error("core {core}: not to be had; this process may use {}", list(present))]
    NoCore {
        /// The core.
        core: usize,
        /// Cores that this process may use.
        present: Vec<usize>,
    },
    /// The kernel does not keep the thread on the core.
    #[error("core {core}: refused by the kernel")]
    Core {
        /// The core.
        core: usize,
    },
    /// The priority is none of SCHED_FIFO.
    #[error("SCHED_FIFO {priority}: {reason}")]
    PriorityRange {
        /// The priority.
        priority: u8,
        /// What the library said.
        reason: String,
    },
    /// The kernel does not give the priority.
    #[error("SCHED_FIFO {priority}: {source}; {ALLOW_PRIORITY}")]
    Priority {
        /// The priority.
        priority: u8,
        /// What the operating system said.
        source: thread_priority::Error,
    },
    /// The thread on which the priority was tried has panicked.
    #[error("SCHED_FIFO {priority}: cannot be tried")]
    PriorityUntried {
        /// The priority.
        priority: u8,
    },
    /// The memory cannot be locked.
    #[error("locked memory: {source}; {ALLOW_LOCKING}")]
    Memory {
        /// What the operating system said.
        source: Errno,
    },
    /// The limit of locked memory is too low.
    #[error("locked memory: found a limit of {} kB; {ALLOW_LOCKING}", limit / 1024)]
    MemoryLimit {
        /// The limit, bytes.
        limit: u64,
    },
    /// The file of the wake-up latency cannot be opened.
    #[error("{WAKEUP_LATENCY}: {source}; let the user of the stages write it, with a udev rule")]
    WakeupLatency {
        /// What the operating system said.
        source: io::Error,
    },
    /// The wake-up latency cannot be written.
    #[error("{WAKEUP_LATENCY}: {source}")]
    WakeupLatencyWrite {
        /// What the operating system said.
        source: io::Error,
    },
    /// The timer slack cannot be set.
    #[error("timer slack: {source}")]
    TimerSlack {
        /// What the operating system said.
        source: Errno,
    },
    /// A stage spins on a core that another stage needs.
    #[error(
        "wait = \"spin\" on core {core}, which stage.{} is on as well and will hardly get; give one of them another \
         core, or wait = \"event\"", other.name()
    )]
    SharedSpin {
        /// The core.
        core: usize,
        /// The other stage.
        other: StageKind,
    },
    /// As many stages spin as there are cores.
    #[error(
        "wait = \"spin\" without a core of its own, one of {spinning} that spin on {cores} cores: the others starve; \
         give it a core, or wait = \"event\""
    )]
    FreeSpin {
        /// Number of stages that spin.
        spinning: usize,
        /// Number of cores.
        cores: usize,
    },
    /// The kernel stops a SCHED_FIFO thread that never sleeps.
    #[error(
        "wait = \"spin\" with a priority: the kernel stops such threads for {} ms of every {} ms; allow them all \
         with: sysctl -w kernel.sched_rt_runtime_us=-1", (period_us - runtime_us) / 1000, period_us / 1000
    )]
    Throttled {
        /// Time per period that the kernel allows, us.
        runtime_us: i64,
        /// The period, us.
        period_us: i64,
    },
}

fn list(cores: &[usize]) -> String {
    cores.iter().map(usize::to_string).collect::<Vec<_>>().join(", ")
}

/// A right that a machine file asks for and that cannot be had.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Missing {
    /// Whether the machine file is strict about the right.
    pub strict: bool,
    /// What is missing, for which stage, and how to get it.
    pub text: String,
}

/// Rights that a stage holds for as long as it runs.
pub(super) struct Held {
    /// Rights that the stage could not have.
    pub missing: Vec<RightError>,
    _wakeup_latency: Option<File>,
}

/// Rights that the stages of a machine could not have on this computer, found without taking any.
pub fn missing(machine: &Machine, clock: Clock) -> Vec<Missing> {
    let realtime = &machine.realtime;
    let mut found = Vec::new();
    let mut note = |rights: Rights, result: Result<(), RightError>, of: &str| {
        if let Err(error) = result {
            found.push(Missing { strict: rights == Rights::Strict, text: format!("{of}{error}") });
        }
    };
    for kind in StageKind::ALL {
        let (settings, of) = (machine.stage(kind), format!("stage.{}: ", kind.name()));
        note(realtime.affinity, settings.core.map_or(Ok(()), |core| find(core).map(|_| ())), &of);
        note(realtime.scheduling, settings.priority.map_or(Ok(()), may_schedule), &of);
        for (rights, error) in harm(machine, kind, clock) {
            note(rights, Err(error), &of);
        }
    }
    note(realtime.memory, if realtime.lock_memory { may_lock() } else { Ok(()) }, "realtime.lock_memory: ");
    let opened = realtime.wakeup_latency.map_or(Ok(()), |_| open_wakeup_latency().map(|_| ()));
    note(realtime.scheduling, opened, "realtime.wakeup_latency: ");
    found
}

/// Gives the calling thread its rights.
///
/// # Errors
/// A right that the machine file is strict about cannot be had.
pub(super) fn apply(machine: &Machine, kind: StageKind, clock: Clock) -> Result<Held, StageError> {
    let (settings, realtime) = (machine.stage(kind), &machine.realtime);
    let mut missing = Vec::new();
    let mut judge = |rights: Rights, result: Result<(), RightError>| match (result, rights) {
        (Ok(()), _) => Ok(()),
        (Err(error), Rights::Warn) => {
            missing.push(error);
            Ok(())
        }
        (Err(error), Rights::Strict) => Err(StageError::Rights(error)),
    };
    // Ordinary threads are woken up to 50 us late by default, to save power.
    let slack = set_current_timer_slack(NonZeroU64::new(1));
    judge(Rights::Warn, slack.map_err(|source| RightError::TimerSlack { source }))?;
    if let Some(core) = settings.core {
        judge(realtime.affinity, pin(core))?;
    }
    if let Some(priority) = settings.priority {
        judge(realtime.scheduling, schedule(priority))?;
    }
    for (rights, error) in harm(machine, kind, clock) {
        judge(rights, Err(error))?;
    }
    let mut wakeup_latency = None;
    judge(realtime.scheduling, limit_wakeup_latency(realtime).map(|file| wakeup_latency = file))?;
    touch_stack();
    if realtime.lock_memory {
        judge(realtime.memory, lock_memory())?;
    }
    Ok(Held { missing, _wakeup_latency: wakeup_latency })
}

/// Harm that the spinning of a stage does, with the setting for the right that the harm belongs to.
fn harm(machine: &Machine, kind: StageKind, clock: Clock) -> Vec<(Rights, RightError)> {
    let settings = machine.stage(kind);
    if clock == Clock::LockStep || settings.wait != Wait::Spin {
        return Vec::new();
    }
    let mut found = Vec::new();
    if let Some(error) = shared_spin(&machine.stages, kind, core_affinity::get_core_ids().unwrap_or_default().len()) {
        found.push((machine.realtime.affinity, error));
    }
    let read = |file: &str| std::fs::read_to_string(file).ok().and_then(|text| text.trim().parse().ok());
    if settings.priority.is_some()
        && let [Some(runtime), Some(period)] = THROTTLING.map(read)
        && let Some(error) = throttled(runtime, period)
    {
        found.push((machine.realtime.scheduling, error));
    }
    found
}

/// Whether a stage spins on a core that another stage needs.
fn shared_spin(stages: &[StageSettings; 4], kind: StageKind, cores: usize) -> Option<RightError> {
    let own = &stages[kind as usize];
    let Some(core) = own.core else {
        let spinning = stages.iter().filter(|stage| stage.wait == Wait::Spin).count();
        return (spinning >= cores).then_some(RightError::FreeSpin { spinning, cores });
    };
    let other =
        StageKind::ALL.into_iter().find(|other| *other != kind && stages[*other as usize].core == Some(core))?;
    Some(RightError::SharedSpin { core, other })
}

/// Whether the kernel stops a SCHED_FIFO thread that never sleeps.
fn throttled(runtime_us: i64, period_us: i64) -> Option<RightError> {
    (runtime_us >= 0 && runtime_us < period_us).then_some(RightError::Throttled { runtime_us, period_us })
}

fn find(core: usize) -> Result<core_affinity::CoreId, RightError> {
    let cores = core_affinity::get_core_ids().unwrap_or_default();
    let found = cores.iter().copied().find(|id| id.id == core);
    found.ok_or_else(|| RightError::NoCore { core, present: cores.iter().map(|id| id.id).collect() })
}

/// Keeps the calling thread on a core.
///
/// # Errors
/// This process may not use the core, or the kernel refuses.
pub fn pin(core: usize) -> Result<(), RightError> {
    let id = find(core)?;
    if core_affinity::set_for_current(id) { Ok(()) } else { Err(RightError::Core { core }) }
}

/// Gives the calling thread a priority of SCHED_FIFO, 1 to 99.
///
/// # Errors
/// The priority is out of range, or the kernel does not give it.
pub fn schedule(priority: u8) -> Result<(), RightError> {
    let value = ThreadPriorityValue::try_from(priority);
    let value = value.map_err(|reason| RightError::PriorityRange { priority, reason })?;
    let fifo = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(value), fifo)
        .map_err(|source| RightError::Priority { priority, source })
}

/// Whether the priority could be had, tried on a thread that ends at once.
fn may_schedule(priority: u8) -> Result<(), RightError> {
    let tried = std::thread::spawn(move || schedule(priority)).join();
    tried.unwrap_or(Err(RightError::PriorityUntried { priority }))
}

/// Locks all memory of this process, present and future.
///
/// # Errors
/// The kernel refuses.
pub fn lock_memory() -> Result<(), RightError> {
    mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE).map_err(|source| RightError::Memory { source })
}

/// Whether the memory could be locked. The limit tells it without locking and unlocking the memory of this process.
fn may_lock() -> Result<(), RightError> {
    match getrlimit(Resource::Memlock).current {
        Some(limit) if !may_lock_all() => Err(RightError::MemoryLimit { limit }),
        _ => Ok(()),
    }
}

/// Whether this process has the capability to which no limit applies; false where this cannot be read.
fn may_lock_all() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
    let effective = line.and_then(|digits| u64::from_str_radix(digits.trim(), 16).ok()).unwrap_or_default();
    effective & IPC_LOCK != 0
}

fn open_wakeup_latency() -> Result<File, RightError> {
    let opened = OpenOptions::new().write(true).open(Path::new(WAKEUP_LATENCY));
    opened.map_err(|source| RightError::WakeupLatency { source })
}

fn limit_wakeup_latency(realtime: &Realtime) -> Result<Option<File>, RightError> {
    let Some(longest) = realtime.wakeup_latency else { return Ok(None) };
    let mut file = open_wakeup_latency()?;
    let microseconds = i32::try_from(longest.as_micros()).unwrap_or(i32::MAX);
    let written = file.write_all(&microseconds.to_ne_bytes());
    written.map_err(|source| RightError::WakeupLatencyWrite { source })?;
    Ok(Some(file))
}

/// Touches the pages of the stack now, so that no call of the loop is the first to touch one.
#[inline(never)]
fn touch_stack() {
    let stack = [0u8; STACK];
    std::hint::black_box(&stack);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn machine(settings: &[(&str, &str)]) -> Machine {
        let settings: Vec<_> = settings.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
        Machine::four_axes(&settings).unwrap()
    }

    fn applied(machine: &Machine, kind: StageKind) -> Result<Vec<String>, String> {
        let texts = |held: Held| held.missing.iter().map(RightError::to_string).collect();
        apply(machine, kind, Clock::RealTime).map(texts).map_err(|error| error.to_string())
    }

    #[test]
    fn a_core_that_is_not_there_is_warned_of_or_refused() {
        let warn = machine(&[("stage.ident-proc.core", "1000")]);
        let missing = applied(&warn, StageKind::IdentProc).unwrap();
        assert!(missing.len() == 1 && missing[0].starts_with("core 1000: not to be had"), "{missing:?}");
        assert_eq!(applied(&warn, StageKind::SensorProc).unwrap(), Vec::<String>::new());

        for strict in ["realtime.rights", "realtime.affinity"] {
            let machine = machine(&[("stage.ident-proc.core", "1000"), (strict, "strict")]);
            let error = applied(&machine, StageKind::IdentProc).unwrap_err();
            assert!(error.contains("core 1000") && error.contains("strict"), "{error}");
        }
        // A machine file that is strict about other rights only warns.
        let others = machine(&[
            ("stage.ident-proc.core", "1000"),
            ("realtime.scheduling", "strict"),
            ("realtime.memory", "strict"),
        ]);
        assert_eq!(applied(&others, StageKind::IdentProc).unwrap().len(), 1);
    }

    #[test]
    fn a_core_that_is_there_is_taken() {
        let core = core_affinity::get_core_ids().unwrap()[0].id;
        let machine = machine(&[("stage.plant-sim.core", &core.to_string()), ("realtime.rights", "strict")]);
        std::thread::spawn(move || {
            applied(&machine, StageKind::PlantSim).unwrap();
            assert_eq!(rustix::thread::sched_getcpu(), core);
        })
        .join()
        .unwrap();
    }

    #[test]
    fn all_that_is_missing_is_found_at_once_and_before_anything_starts() {
        assert_eq!(missing(&machine(&[]), Clock::RealTime), []);
        let machine = machine(&[
            ("stage.ident-proc.core", "1000"),
            ("stage.control-proc.core", "1001"),
            ("realtime.affinity", "strict"),
        ]);
        let found = missing(&machine, Clock::RealTime);
        assert_eq!(found.len(), 2);
        assert!(found.iter().all(|missing| missing.strict));
        assert!(found[0].text.starts_with("stage.ident-proc: core 1000: not to be had"), "{}", found[0].text);
    }

    #[test]
    fn a_spin_on_a_core_that_is_shared_is_found() {
        let spins = ("stage.control-proc.wait", "spin");
        let shared = machine(&[("stage.ident-proc.core", "1"), ("stage.control-proc.core", "1"), spins]);
        let text = shared_spin(&shared.stages, StageKind::ControlProc, 4).unwrap().to_string();
        assert!(text.contains("core 1, which stage.ident-proc is on as well"), "{text}");
        // Only in real time, and only of the one that spins.
        assert!(harm(&shared, StageKind::ControlProc, Clock::LockStep).is_empty());
        assert!(harm(&shared, StageKind::IdentProc, Clock::RealTime).is_empty());
        let apart = machine(&[("stage.ident-proc.core", "0"), ("stage.control-proc.core", "1"), spins]);
        assert!(shared_spin(&apart.stages, StageKind::ControlProc, 4).is_none());
        // Without cores of their own there must be one left.
        let free = machine(&[spins]);
        assert!(shared_spin(&free.stages, StageKind::ControlProc, 2).is_none());
        let text = shared_spin(&free.stages, StageKind::ControlProc, 1).unwrap().to_string();
        assert!(text.contains("one of 1 that spin on 1 cores"), "{text}");
    }

    #[test]
    fn a_throttle_is_found_where_it_is_on() {
        assert!(throttled(-1, 1_000_000).is_none());
        assert!(throttled(1_000_000, 1_000_000).is_none());
        let text = throttled(950_000, 1_000_000).unwrap().to_string();
        assert!(text.contains("50 ms of every 1000 ms") && text.contains("sched_rt_runtime_us=-1"), "{text}");
    }
}
