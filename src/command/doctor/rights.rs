//! Rights and memory: what this process may do, and whether the memory of the stages is safe.

use pipeline::channel::{Exposed, FoundGroup, GroupState};
use rustix::fs::statvfs;

use crate::group::preflight::SHARED_MEMORY;

use super::{
    finding::{Finding, Needs, bad, good, unknown},
    system::System,
};

/// Number of the capability to raise priorities.
const CAP_SYS_NICE: u32 = 23;
/// Number of the capability to lock memory.
const CAP_IPC_LOCK: u32 = 14;
/// Users below this number belong to the system; logind does not remove their shared memory.
const FIRST_ORDINARY_USER: u32 = 1000;
/// Where limits are set.
const LIMITS: &str = "in /etc/security/limits.d/hydraxis.conf and log in anew";

/// The highest SCHED_FIFO priority that this process may ask for.
pub fn priority_limit(system: &System, needs: &Needs) -> Finding {
    const CHECK: &str = "priority limit";
    let wanted = u64::from(needs.priority.unwrap_or(1));
    match system.limit("Max realtime priority") {
        None => unknown(CHECK, "/proc/self/limits cannot be read", ""),
        Some(limit) if limit.is_none_or(|limit| limit >= wanted) => {
            good(CHECK, limit.map_or_else(|| "unlimited".to_owned(), |limit| limit.to_string()))
        }
        Some(_) if system.is_capable(CAP_SYS_NICE) => good(CHECK, "none needed: this process has CAP_SYS_NICE"),
        Some(limit) => bad(
            CHECK,
            format!("{}; {wanted} is needed", limit.unwrap_or_default()),
            format!(
                "put the line `@realtime - rtprio 95` {LIMITS} as a member of that group; LimitRTPRIO=95 in a unit"
            ),
        ),
    }
}

/// The memory that this process may lock.
pub fn memory_limit(system: &System) -> Finding {
    const CHECK: &str = "memory limit";
    match system.limit("Max locked memory") {
        None => unknown(CHECK, "/proc/self/limits cannot be read", ""),
        Some(None) => good(CHECK, "unlimited"),
        Some(Some(_)) if system.is_capable(CAP_IPC_LOCK) => good(CHECK, "none: this process has CAP_IPC_LOCK"),
        Some(Some(limit)) => bad(
            CHECK,
            format!("{} kB may be locked", limit / 1024),
            format!(
                "put the line `@realtime - memlock unlimited` {LIMITS} as a member of that group; \
                     LimitMEMLOCK=infinity in a unit"
            ),
        ),
    }
}

/// Whether the kernel really gives SCHED_FIFO.
pub fn scheduling(system: &System, tried: &Result<(), String>) -> Finding {
    const CHECK: &str = "SCHED_FIFO";
    match tried {
        Ok(()) => good(CHECK, "a thread of this process got it"),
        Err(error) if system.is_capable(CAP_SYS_NICE) => bad(
            CHECK,
            format!("refused in spite of CAP_SYS_NICE: {error}"),
            "the reason may be RT group scheduling (CONFIG_RT_GROUP_SCHED): boot with the kernel parameter \
             rt_group_sched=0 where the kernel knows it, or give this control group a share in its cpu.rt_runtime_us; \
             in a container: --cap-add=sys_nice --ulimit rtprio=99",
        ),
        Err(error) => bad(CHECK, format!("refused: {error}"), "see the priority limit above"),
    }
}

/// Whether the kernel stops real-time threads that never sleep.
pub fn throttling(system: &System, needs: &Needs) -> Finding {
    const CHECK: &str = "FIFO throttling";
    let (Some(runtime), Some(period)) = (
        system.number("/proc/sys/kernel/sched_rt_runtime_us"),
        system.number("/proc/sys/kernel/sched_rt_period_us").filter(|period| *period > 0),
    ) else {
        return unknown(CHECK, "/proc/sys/kernel/sched_rt_runtime_us cannot be read", "");
    };
    if runtime < 0 || runtime >= period {
        return good(CHECK, "off");
    }
    let stopped = (period - runtime) as f64 / 1e3;
    let found = format!("a thread that spins under FIFO is stopped {stopped} ms in each {} ms", period as f64 / 1e3);
    if !needs.spins {
        return good(CHECK, format!("{found}; no stage does"));
    }
    bad(
        CHECK,
        found,
        "wait = \"event\" in the machine file; or put kernel.sched_rt_runtime_us=-1 in /etc/sysctl.d/hydraxis.conf, \
         type `sysctl --system`, and from Linux 6.12 on echo 0 > /sys/kernel/debug/sched/fair_server/cpuN/runtime for \
         the core",
    )
}

/// Whether memory can be locked.
pub fn locking(tried: &Result<(), String>) -> Finding {
    const CHECK: &str = "locked memory";
    match tried {
        Ok(()) => good(CHECK, "this process has locked its memory"),
        Err(error) => bad(CHECK, format!("refused: {error}"), "see the memory limit above"),
    }
}

/// Whether memory can be swapped to a disk, from where it comes back only after milliseconds.
pub fn swap(system: &System, needs: &Needs, locking: &Result<(), String>) -> Finding {
    const CHECK: &str = "swap";
    let Some(text) = system.text("/proc/swaps") else { return unknown(CHECK, "/proc/swaps cannot be read", "") };
    let areas: Vec<&str> = text.lines().skip(1).filter_map(|line| line.split_whitespace().next()).collect();
    if areas.is_empty() {
        return good(CHECK, "none");
    }
    let found = format!("on {}", areas.join(", "));
    if needs.lock_memory && locking.is_ok() {
        return good(CHECK, format!("{found}; the stages lock their memory"));
    }
    bad(
        CHECK,
        found,
        "set realtime.lock_memory = true in the machine file, or type `swapoff -a` and take it out of /etc/fstab",
    )
}

/// Whether shared memory exists, is large enough, and can be written by this user.
pub fn shared_memory(system: &System) -> Finding {
    const CHECK: &str = "shared memory";
    let Some(mounts) = system.text("/proc/mounts") else { return unknown(CHECK, "/proc/mounts cannot be read", "") };
    let is_mounted = mounts.lines().any(|line| line.split_whitespace().nth(1) == Some("/dev/shm"));
    if !is_mounted {
        return bad(CHECK, "/dev/shm is not mounted", "mount -t tmpfs -o mode=1777 tmpfs /dev/shm");
    }
    let folder = system.path("/dev/shm");
    let probe = folder.join(format!("hydraxis-doctor-{}", std::process::id()));
    let written = std::fs::write(&probe, "").and_then(|()| std::fs::remove_file(&probe));
    if let Err(error) = written {
        return bad(CHECK, format!("no file can be created in /dev/shm: {error}"), "chmod 1777 /dev/shm");
    }
    let Ok(space) = statvfs(&folder) else { return unknown(CHECK, "/dev/shm does not tell its size", "") };
    shared_memory_of(space.f_blocks * space.f_frsize, space.f_bavail * space.f_frsize)
}

/// Judges shared memory by its size and its free part, bytes.
pub fn shared_memory_of(size: u64, free: u64) -> Finding {
    const CHECK: &str = "shared memory";
    let found = format!("/dev/shm has {} of {} MB free", free >> 20, size >> 20);
    if free >= SHARED_MEMORY {
        return good(CHECK, found);
    }
    bad(
        CHECK,
        found,
        "see with `ls -l /dev/shm` who uses it, type `hydraxis clean`; or mount -o remount,size=256M /dev/shm",
    )
}

/// Whether dead groups occupy memory.
pub fn leftovers(groups: &[FoundGroup]) -> Finding {
    const CHECK: &str = "leftovers";
    let count = |state: GroupState| groups.iter().filter(|group| group.state == state).count();
    let (dead, unclear) = (count(GroupState::Dead), count(GroupState::Unknown));
    let found = format!("groups: {} alive, {dead} dead, {unclear} unknown", count(GroupState::Alive));
    match (dead, unclear) {
        (0, 0) => good(CHECK, found),
        (0, _) => unknown(CHECK, found, "hydraxis clean --dry-run"),
        _ => bad(CHECK, found, "hydraxis clean"),
    }
}

/// Whether other users can reach files of groups, or have files where groups have theirs.
pub fn other_users(exposed: &[Exposed]) -> Finding {
    const CHECK: &str = "other users";
    let list = |foreign: bool| {
        let found: Vec<String> =
            exposed.iter().filter(|path| path.is_foreign == foreign).map(ToString::to_string).collect();
        found.join(", ")
    };
    match (list(false), list(true)) {
        (open, foreign) if open.is_empty() && foreign.is_empty() => {
            good(CHECK, "none has files where groups have theirs")
        }
        (open, foreign) if open.is_empty() => unknown(
            CHECK,
            format!("belongs to another user: {foreign}"),
            "a group of that user, or in the way of one of yours: then remove it as that user or as root",
        ),
        (open, foreign) => bad(
            CHECK,
            format!(
                "other users have rights to {open}{}",
                if foreign.is_empty() { String::new() } else { format!("; belongs to another user: {foreign}") }
            ),
            "end the group, type `hydraxis clean`, remove with `rm -r` what is left, and start the group again",
        ),
    }
}

/// Whether a running group loses its shared memory when its user logs out.
pub fn logout(system: &System) -> Finding {
    const CHECK: &str = "logout";
    let user = system.status("Uid").and_then(|ids| ids.split_whitespace().next()?.parse::<u32>().ok());
    if user.is_some_and(|user| user < FIRST_ORDINARY_USER) {
        return good(CHECK, "a user of the system keeps its shared memory");
    }
    let mut files = vec!["/etc/systemd/logind.conf".to_owned()];
    for folder in ["/usr/lib/systemd/logind.conf.d", "/etc/systemd/logind.conf.d"] {
        files.extend(system.names(folder).into_iter().map(|name| format!("{folder}/{name}")));
    }
    let texts: Vec<String> = files.iter().filter_map(|file| system.text(file)).collect();
    if texts.is_empty() {
        let advice = "where logind runs, see RemoveIPC in `man logind.conf`";
        return unknown(CHECK, "/etc/systemd/logind.conf cannot be read", advice);
    }
    // The last setting counts. Without a setting logind removes the memory.
    let lines = texts.iter().flat_map(|text| text.lines());
    let last = lines.filter_map(|line| line.trim().strip_prefix("RemoveIPC=")).next_back();
    if last.is_some_and(|value| ["no", "false", "0", "off"].contains(&value.trim())) {
        return good(CHECK, "RemoveIPC=no");
    }
    bad(
        CHECK,
        "logind removes a user's shared memory at the last logout, under a running group",
        "put RemoveIPC=no in /etc/systemd/logind.conf and type `systemctl restart systemd-logind`, or run as a system \
         user (a number below 1000)",
    )
}
