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
//! Two settings are had and still do harm, so they count as missing: a stage that spins on a core that another stage
//! needs, and a SCHED_FIFO stage that spins where the kernel stops such threads for a part of every second.

use std::{
    fs::{File, OpenOptions},
    io::Write,
    num::NonZeroU64,
    path::Path,
};

use rustix::{
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

/// Stack that a stage touches before its loop: its deepest call takes a small part of it.
const STACK: usize = 256 * 1024;
/// Where the longest wake-up is asked for; it holds for as long as the file is open.
const WAKEUP_LATENCY: &str = "/dev/cpu_dma_latency";
/// What the kernel lets SCHED_FIFO threads use of every period, both in microseconds.
const THROTTLING: [&str; 2] = ["/proc/sys/kernel/sched_rt_runtime_us", "/proc/sys/kernel/sched_rt_period_us"];
/// Bit of `CAP_IPC_LOCK` in a set of capabilities.
const IPC_LOCK: u64 = 1 << 14;
/// How to be given a priority.
const ALLOW_PRIORITY: &str = "allow it with LimitRTPRIO= in the unit or rtprio in limits.conf";
/// How to be given locked memory.
const ALLOW_LOCKING: &str = "allow it with LimitMEMLOCK=infinity in the unit or memlock in limits.conf";

/// A right that a machine file asks for and that is not to be had.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Missing {
    /// Whether the machine file will not do without it.
    pub strict: bool,
    /// What is missing, for whom, and how to get it.
    pub text: String,
}

/// What a stage has been given for as long as it runs.
pub(super) struct Held {
    /// What it has not, in words for the user.
    pub missing: Vec<String>,
    _wakeup_latency: Option<File>,
}

/// Whatever the stages of a machine would not get on this machine, found without taking anything.
pub fn missing(machine: &Machine, clock: Clock) -> Vec<Missing> {
    let realtime = &machine.realtime;
    let mut found = Vec::new();
    let mut note = |rights: Rights, result: Result<(), String>, of: &str| {
        if let Err(text) = result {
            found.push(Missing { strict: rights == Rights::Strict, text: format!("{of}{text}") });
        }
    };
    for kind in StageKind::ALL {
        let (settings, of) = (machine.stage(kind), format!("stage.{}: ", kind.name()));
        note(realtime.affinity, settings.core.map_or(Ok(()), |core| find(core).map(|_| ())), &of);
        note(realtime.scheduling, settings.priority.map_or(Ok(()), may_schedule), &of);
        for (rights, text) in harm(machine, kind, clock) {
            note(rights, Err(text), &of);
        }
    }
    note(realtime.memory, if realtime.lock_memory { may_lock() } else { Ok(()) }, "realtime.lock_memory: ");
    let opened = realtime.wakeup_latency.map_or(Ok(()), |_| open_wakeup_latency().map(|_| ()));
    note(realtime.scheduling, opened, "realtime.wakeup_latency: ");
    found
}

/// Sets the calling thread up.
///
/// # Errors
/// What could not be had, when the machine file is strict about it.
pub(super) fn apply(machine: &Machine, kind: StageKind, clock: Clock) -> Result<Held, StageError> {
    let (settings, realtime) = (machine.stage(kind), &machine.realtime);
    let mut missing = Vec::new();
    let mut judge = |rights: Rights, result: Result<(), String>| match (result, rights) {
        (Ok(()), _) => Ok(()),
        (Err(text), Rights::Warn) => {
            missing.push(text);
            Ok(())
        }
        (Err(text), Rights::Strict) => Err(StageError::Rights(format!("{text} (the machine file is strict)"))),
    };
    // Ordinary threads are woken up to 50 us late by default, to save power.
    judge(Rights::Warn, set_current_timer_slack(NonZeroU64::new(1)).map_err(|error| format!("timer slack: {error}")))?;
    if let Some(core) = settings.core {
        judge(realtime.affinity, pin(core))?;
    }
    if let Some(priority) = settings.priority {
        judge(realtime.scheduling, schedule(priority))?;
    }
    for (rights, text) in harm(machine, kind, clock) {
        judge(rights, Err(text))?;
    }
    let mut wakeup_latency = None;
    judge(realtime.scheduling, limit_wakeup_latency(realtime).map(|file| wakeup_latency = file))?;
    touch_stack();
    if realtime.lock_memory {
        judge(realtime.memory, lock_memory())?;
    }
    Ok(Held { missing, _wakeup_latency: wakeup_latency })
}

/// What is wrong with how a stage spins, and the right that it belongs to.
fn harm(machine: &Machine, kind: StageKind, clock: Clock) -> Vec<(Rights, String)> {
    let settings = machine.stage(kind);
    if clock == Clock::LockStep || settings.wait != Wait::Spin {
        return Vec::new();
    }
    let mut found = Vec::new();
    if let Some(text) = shared_spin(&machine.stages, kind, core_affinity::get_core_ids().unwrap_or_default().len()) {
        found.push((machine.realtime.affinity, text));
    }
    let read = |file: &str| std::fs::read_to_string(file).ok().and_then(|text| text.trim().parse().ok());
    if settings.priority.is_some()
        && let [Some(runtime), Some(period)] = THROTTLING.map(read)
        && let Some(text) = throttled(runtime, period)
    {
        found.push((machine.realtime.scheduling, text));
    }
    found
}

/// Who else needs the core that a stage spins on, if anybody does.
fn shared_spin(stages: &[StageSettings; 4], kind: StageKind, cores: usize) -> Option<String> {
    let own = &stages[kind as usize];
    let Some(core) = own.core else {
        let spinning = stages.iter().filter(|stage| stage.wait == Wait::Spin).count();
        return (spinning >= cores).then(|| {
            format!(
                "wait = \"spin\" without a core of its own, one of {spinning} that spin on {cores} cores: the others \
                 starve; give it a core, or wait = \"event\""
            )
        });
    };
    let other =
        StageKind::ALL.into_iter().find(|other| *other != kind && stages[*other as usize].core == Some(core))?;
    Some(format!(
        "wait = \"spin\" on core {core}, which stage.{} is on as well and will hardly get; give one of them another \
         core, or wait = \"event\"",
        other.name()
    ))
}

/// What the kernel's throttle does to a SCHED_FIFO thread that never sleeps, if it is on.
fn throttled(runtime_us: i64, period_us: i64) -> Option<String> {
    (runtime_us >= 0 && runtime_us < period_us).then(|| {
        format!(
            "wait = \"spin\" with a priority: the kernel stops such threads for {} ms of every {} ms; allow them all \
             with: sysctl -w kernel.sched_rt_runtime_us=-1",
            (period_us - runtime_us) / 1000,
            period_us / 1000
        )
    })
}

fn find(core: usize) -> Result<core_affinity::CoreId, String> {
    let cores = core_affinity::get_core_ids().unwrap_or_default();
    cores.iter().copied().find(|id| id.id == core).ok_or_else(|| {
        let present: Vec<String> = cores.iter().map(|id| id.id.to_string()).collect();
        format!("core {core}: not to be had; this process may use {}", present.join(", "))
    })
}

/// Keeps the calling thread on a core.
///
/// # Errors
/// In words for the user.
pub fn pin(core: usize) -> Result<(), String> {
    let id = find(core)?;
    if core_affinity::set_for_current(id) { Ok(()) } else { Err(format!("core {core}: refused by the kernel")) }
}

/// Gives the calling thread a priority of SCHED_FIFO, 1 to 99.
///
/// # Errors
/// In words for the user.
pub fn schedule(priority: u8) -> Result<(), String> {
    let value = ThreadPriorityValue::try_from(priority).map_err(|error| format!("SCHED_FIFO {priority}: {error}"))?;
    let fifo = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(value), fifo)
        .map_err(|error| format!("SCHED_FIFO {priority}: {error:?}; {ALLOW_PRIORITY}"))
}

/// Tries it on a thread that ends at once.
fn may_schedule(priority: u8) -> Result<(), String> {
    std::thread::spawn(move || schedule(priority))
        .join()
        .unwrap_or_else(|_| Err(format!("SCHED_FIFO {priority}: cannot be tried")))
}

/// Locks all memory of this process, now and from now on.
///
/// # Errors
/// In words for the user.
pub fn lock_memory() -> Result<(), String> {
    mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE)
        .map_err(|error| format!("locked memory: {error}; {ALLOW_LOCKING}"))
}

/// By the limit, since locking and unlocking the memory of this process is no mere look.
fn may_lock() -> Result<(), String> {
    match getrlimit(Resource::Memlock).current {
        Some(limit) if !may_lock_all() => {
            Err(format!("locked memory: found a limit of {} kB; {ALLOW_LOCKING}", limit / 1024))
        }
        _ => Ok(()),
    }
}

/// Whether this process has the capability that no limit holds for; not where that cannot be told.
fn may_lock_all() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
    let effective = line.and_then(|digits| u64::from_str_radix(digits.trim(), 16).ok()).unwrap_or_default();
    effective & IPC_LOCK != 0
}

fn open_wakeup_latency() -> Result<File, String> {
    OpenOptions::new()
        .write(true)
        .open(Path::new(WAKEUP_LATENCY))
        .map_err(|error| format!("{WAKEUP_LATENCY}: {error}; let the user of the stages write it, with a udev rule"))
}

fn limit_wakeup_latency(realtime: &Realtime) -> Result<Option<File>, String> {
    let Some(longest) = realtime.wakeup_latency else { return Ok(None) };
    let mut file = open_wakeup_latency()?;
    let microseconds = i32::try_from(longest.as_micros()).unwrap_or(i32::MAX);
    file.write_all(&microseconds.to_ne_bytes()).map_err(|error| format!("{WAKEUP_LATENCY}: {error}"))?;
    Ok(Some(file))
}

/// Takes the stack's pages now, so that no call of the loop is the first to reach one.
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
        Machine::load(None, &settings).unwrap()
    }

    fn applied(machine: &Machine, kind: StageKind) -> Result<Vec<String>, String> {
        apply(machine, kind, Clock::RealTime).map(|held| held.missing).map_err(|error| error.to_string())
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
        // Strict about the others only.
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
        let text = shared_spin(&shared.stages, StageKind::ControlProc, 4).unwrap();
        assert!(text.contains("core 1, which stage.ident-proc is on as well"), "{text}");
        // Only in real time, and only of the one that spins.
        assert!(harm(&shared, StageKind::ControlProc, Clock::LockStep).is_empty());
        assert!(harm(&shared, StageKind::IdentProc, Clock::RealTime).is_empty());
        let apart = machine(&[("stage.ident-proc.core", "0"), ("stage.control-proc.core", "1"), spins]);
        assert_eq!(shared_spin(&apart.stages, StageKind::ControlProc, 4), None);
        // Without cores of their own there must be one left.
        let free = machine(&[spins]);
        assert_eq!(shared_spin(&free.stages, StageKind::ControlProc, 2), None);
        let text = shared_spin(&free.stages, StageKind::ControlProc, 1).unwrap();
        assert!(text.contains("one of 1 that spin on 1 cores"), "{text}");
    }

    #[test]
    fn a_throttle_is_found_where_it_is_on() {
        assert_eq!(throttled(-1, 1_000_000), None);
        assert_eq!(throttled(1_000_000, 1_000_000), None);
        let text = throttled(950_000, 1_000_000).unwrap();
        assert!(text.contains("50 ms of every 1000 ms") && text.contains("sched_rt_runtime_us=-1"), "{text}");
    }
}
