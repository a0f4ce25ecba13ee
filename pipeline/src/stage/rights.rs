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
/// The same words, when the machine file says `rights = "strict"`.
pub(super) fn apply(machine: &Machine, kind: StageKind) -> Result<Vec<String>, StageError> {
    let settings = machine.stage(kind);
    let mut missing = Vec::new();
    // Ordinary threads are woken up to 50 us late by default, to save power.
    if let Err(error) = set_current_timer_slack(NonZeroU64::new(1)) {
        missing.push(format!("timer slack: {error}"));
    }
    if let Some(core) = settings.core {
        let cores = core_affinity::get_core_ids().unwrap_or_default();
        let pinned = cores.iter().find(|id| id.id == core).is_some_and(|id| core_affinity::set_for_current(*id));
        if !pinned {
            let present: Vec<String> = cores.iter().map(|id| id.id.to_string()).collect();
            missing.push(format!("core {core}: not to be had; this process may use {}", present.join(", ")));
        }
    }
    if let Some(priority) = settings.priority {
        let fifo = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
        let set = priority
            .try_into()
            .map_err(|error: <ThreadPriorityValue as TryFrom<u8>>::Error| error.to_string())
            .and_then(|value| {
                set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(value), fifo)
                    .map_err(|error| format!("{error:?}"))
            });
        if let Err(error) = set {
            missing.push(format!(
                "SCHED_FIFO {priority}: {error}; allow it with LimitRTPRIO= in the unit or rtprio in limits.conf"
            ));
        }
    }
    if machine.realtime.lock_memory
        && let Err(error) = mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE)
    {
        missing.push(format!(
            "locked memory: {error}; allow it with LimitMEMLOCK=infinity in the unit or memlock in limits.conf"
        ));
    }
    if machine.realtime.rights == Rights::Strict && !missing.is_empty() {
        return Err(StageError::Rights(format!("{} (rights = \"strict\")", missing.join("; "))));
    }
    Ok(missing)
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

        let strict = machine(&[("stage.ident-proc.core", "1000"), ("realtime.rights", "strict")]);
        let error = apply(&strict, StageKind::IdentProc).unwrap_err().to_string();
        assert!(error.contains("core 1000") && error.contains("strict"), "{error}");
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
