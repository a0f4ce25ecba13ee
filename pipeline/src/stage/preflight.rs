//! Which of the rights that a machine file asks for this process could not give its stages, before any is started.
//!
//! Trap: this is a forecast by masks and limits. The kernel may still refuse a stage what they allow.

use rustix::process::{Resource, getrlimit};

use crate::machine::{Machine, Rights};

/// Bit of `CAP_IPC_LOCK` in a set of capabilities.
const IPC_LOCK: u64 = 1 << 14;
/// Bit of `CAP_SYS_NICE`.
const SYS_NICE: u64 = 1 << 23;

/// A right that the machine file asks for and that is not to be had.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Missing {
    /// Whether the machine file is strict about it: nothing may start without.
    pub strict: bool,
    /// Which, where, and what would help.
    pub text: String,
}

/// Everything that is missing, each once.
pub fn missing(machine: &Machine) -> Vec<Missing> {
    let realtime = &machine.realtime;
    let mut missing: Vec<Missing> = Vec::new();
    let mut add = |rights: Rights, text: String| {
        let found = Missing { strict: rights == Rights::Strict, text };
        if !missing.contains(&found) {
            missing.push(found);
        }
    };
    let cores: Vec<usize> = core_affinity::get_core_ids().unwrap_or_default().iter().map(|core| core.id).collect();
    for core in machine.stages.iter().filter_map(|stage| stage.core).filter(|core| !cores.contains(core)) {
        let present: Vec<String> = cores.iter().map(ToString::to_string).collect();
        add(realtime.affinity, format!("core {core}: not to be had; this process may use {}", present.join(", ")));
    }
    let capabilities = capabilities();
    let highest = machine.stages.iter().filter_map(|stage| stage.priority).max();
    if let Some(priority) = highest.filter(|priority| {
        capabilities & SYS_NICE == 0
            && getrlimit(Resource::Rtprio).current.is_some_and(|limit| limit < u64::from(*priority))
    }) {
        let help = "allow it with LimitRTPRIO= in the unit or rtprio in limits.conf";
        add(realtime.scheduling, format!("SCHED_FIFO {priority}: not permitted; {help}"));
    }
    let is_limited = getrlimit(Resource::Memlock).current.is_some();
    if realtime.lock_memory && is_limited && capabilities & IPC_LOCK == 0 {
        let help = "allow it with LimitMEMLOCK=infinity in the unit or memlock in limits.conf";
        add(realtime.memory, format!("locked memory: not permitted; {help}"));
    }
    missing
}

/// The effective capabilities of this process; none where they cannot be told.
fn capabilities() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
    line.and_then(|digits| u64::from_str_radix(digits.trim(), 16).ok()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_core_that_is_not_there_is_missing_once_and_as_strictly_as_it_was_asked_for() {
        for (rights, strict) in [("warn", false), ("strict", true)] {
            let settings =
                [("stage.ident-proc.core", "1000"), ("stage.control-proc.core", "1000"), ("realtime.affinity", rights)];
            let settings = settings.map(|(key, value)| (key.to_owned(), value.to_owned()));
            let missing = missing(&Machine::load(None, &settings).unwrap());
            assert_eq!(missing.len(), 1, "{missing:?}");
            assert!(missing[0].strict == strict && missing[0].text.contains("core 1000"), "{missing:?}");
        }
    }

    #[test]
    fn nothing_is_missing_where_nothing_was_asked_for() {
        assert_eq!(missing(&Machine::load(None, &[]).unwrap()), []);
    }
}
