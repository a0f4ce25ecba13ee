//! Core affinity, scheduling class and locked memory, as the machine file asks for them.

use std::num::NonZeroU64;

use rustix::{
    mm::{MlockAllFlags, mlockall},
    thread::set_current_timer_slack,
};
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

use super::{StageError, StageKind};
use crate::machine::{Machine, Rights};

/// Sets the calling thread up; returns what could not be had, in words for the user.
///
/// # Errors
/// The same words, when the machine file is strict about that right.
pub(super) fn apply(machine: &Machine, kind: StageKind) -> Result<Vec<String>, StageError> {
    let (settings, realtime) = (machine.stage(kind), &machine.realtime);
    let mut warnings = Vec::new();
    let mut judge = |rights: Rights, result: Result<(), String>| match (result, rights) {
        (Ok(()), _) => Ok(()),
        (Err(missing), Rights::Warn) => {
            warnings.push(missing);
            Ok(())
        }
        (Err(missing), Rights::Strict) => Err(StageError::Rights(format!("{missing} (the machine file is strict)"))),
    };
    // Ordinary threads are woken up to 50 us late by default, to save power.
    judge(Rights::Warn, set_current_timer_slack(NonZeroU64::new(1)).map_err(|error| format!("timer slack: {error}")))?;
    if let Some(core) = settings.core {
        judge(realtime.affinity, pin(core))?;
    }
    if let Some(priority) = settings.priority {
        judge(realtime.scheduling, schedule(priority))?;
    }
    if realtime.lock_memory {
        judge(realtime.memory, lock_memory())?;
    }
    Ok(warnings)
}

/// Keeps the calling thread on a core.
///
/// # Errors
/// In words for the user.
pub fn pin(core: usize) -> Result<(), String> {
    let cores = core_affinity::get_core_ids().unwrap_or_default();
    if cores.iter().find(|id| id.id == core).is_some_and(|id| core_affinity::set_for_current(*id)) {
        return Ok(());
    }
    let present: Vec<String> = cores.iter().map(|id| id.id.to_string()).collect();
    Err(format!("core {core}: not to be had; this process may use {}", present.join(", ")))
}

/// Gives the calling thread a priority of SCHED_FIFO, 1 to 99.
///
/// # Errors
/// In words for the user.
pub fn schedule(priority: u8) -> Result<(), String> {
    let help = "allow it with LimitRTPRIO= in the unit or rtprio in limits.conf";
    let value = ThreadPriorityValue::try_from(priority).map_err(|error| format!("SCHED_FIFO {priority}: {error}"))?;
    let fifo = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(value), fifo)
        .map_err(|error| format!("SCHED_FIFO {priority}: {error:?}; {help}"))
}

/// Locks all memory of this process, now and from now on.
///
/// # Errors
/// In words for the user.
pub fn lock_memory() -> Result<(), String> {
    let help = "allow it with LimitMEMLOCK=infinity in the unit or memlock in limits.conf";
    mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE).map_err(|error| format!("locked memory: {error}; {help}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn machine(settings: &[(&str, &str)]) -> Machine {
        let settings: Vec<_> = settings.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
        Machine::load(None, &settings).unwrap()
    }

    #[test]
    fn a_core_that_is_not_there_is_warned_of_or_refused() {
        let warn = machine(&[("stage.ident-proc.core", "1000")]);
        let missing = apply(&warn, StageKind::IdentProc).unwrap();
        assert!(missing.len() == 1 && missing[0].starts_with("core 1000: not to be had"), "{missing:?}");
        assert_eq!(apply(&warn, StageKind::SensorProc).unwrap(), Vec::<String>::new());

        for strict in ["realtime.rights", "realtime.affinity"] {
            let machine = machine(&[("stage.ident-proc.core", "1000"), (strict, "strict")]);
            let error = apply(&machine, StageKind::IdentProc).unwrap_err().to_string();
            assert!(error.contains("core 1000") && error.contains("strict"), "{error}");
        }
        // Strict about the others only.
        let others = machine(&[
            ("stage.ident-proc.core", "1000"),
            ("realtime.scheduling", "strict"),
            ("realtime.memory", "strict"),
        ]);
        assert_eq!(apply(&others, StageKind::IdentProc).unwrap().len(), 1);
    }

    #[test]
    fn a_core_that_is_there_is_taken() {
        let core = core_affinity::get_core_ids().unwrap()[0].id;
        let machine = machine(&[("stage.plant-sim.core", &core.to_string()), ("realtime.rights", "strict")]);
        std::thread::spawn(move || {
            apply(&machine, StageKind::PlantSim).unwrap();
            assert_eq!(rustix::thread::sched_getcpu(), core);
        })
        .join()
        .unwrap();
    }
}
