//! Kernel and processor: preemption, clock, hypervisor, huge pages.

use super::{
    finding::{Finding, bad, good, unknown},
    system::System,
};

/// The preemption model of the kernel. Only PREEMPT_RT bounds the time that a thread waits for the kernel. The other
/// models differ only in the average.
pub fn preemption(system: &System) -> Finding {
    const CHECK: &str = "preemption";
    const ADVICE: &str = "install a PREEMPT_RT kernel and reboot: Debian `apt-get install linux-image-rt-amd64`, \
                          Ubuntu `pro enable realtime-kernel`, or build Linux 6.12 or newer with CONFIG_PREEMPT_RT=y";
    let version = system.text("/proc/version").unwrap_or_default();
    if system.text("/sys/kernel/realtime").as_deref() == Some("1") || version.contains("PREEMPT_RT") {
        return good(CHECK, "PREEMPT_RT");
    }
    if version.is_empty() {
        return unknown(CHECK, "/proc/version cannot be read", "look whether `uname -v` says PREEMPT_RT");
    }
    if !version.contains("PREEMPT") {
        return bad(CHECK, "a kernel without preemption", ADVICE);
    }
    if !version.contains("PREEMPT_DYNAMIC") {
        return bad(CHECK, "PREEMPT, without RT", ADVICE);
    }
    // The file has the present model in brackets. Without a choice at boot that is the default of the kernel.
    let in_force = system.text("/sys/kernel/debug/sched/preempt").and_then(|text| Some(bracketed(&text)?.to_owned()));
    let command_line = system.text("/proc/cmdline").unwrap_or_default();
    let asked = command_line.split_whitespace().filter_map(|word| word.strip_prefix("preempt=")).next_back();
    match in_force.as_deref().or(asked) {
        Some("full") => bad(CHECK, "PREEMPT_DYNAMIC full, without RT", ADVICE),
        Some(model) => {
            let until_then = "until then boot with the kernel parameter preempt=full";
            bad(CHECK, format!("PREEMPT_DYNAMIC {model}"), format!("{ADVICE}; {until_then}"))
        }
        None => bad(
            CHECK,
            "PREEMPT_DYNAMIC, the model cannot be read",
            format!(
                "{ADVICE}; until then look as root into /sys/kernel/debug/sched/preempt, and boot with preempt=full"
            ),
        ),
    }
}

/// The text in brackets, which is the present choice.
fn bracketed(text: &str) -> Option<&str> {
    text.split_once(['[', '(']).and_then(|(_, rest)| rest.split_once([']', ')'])).map(|(choice, _)| choice)
}

/// The clock that `clock_gettime` reads. A counter of the processor takes about 20 ns, a chip on the board 1 us and
/// more.
pub fn clock_source(system: &System) -> Finding {
    const CHECK: &str = "clock source";
    const FILE: &str = "/sys/devices/system/clocksource/clocksource0/current_clocksource";
    match system.text(FILE) {
        None => unknown(CHECK, format!("{FILE} cannot be read"), ""),
        Some(clock) if ["tsc", "arch_sys_counter", "kvm-clock", "riscv_clocksource"].contains(&clock.as_str()) => {
            good(CHECK, clock)
        }
        Some(clock) => bad(
            CHECK,
            clock,
            "type `dmesg | grep -i -e tsc -e clocksource` to see why the counter of the processor is not used; where \
             the firmware is known to keep it steady, boot with the kernel parameter tsc=reliable",
        ),
    }
}

/// Whether this is a virtual machine. Its host schedules the virtual cores, below the scheduler of this kernel.
pub fn hypervisor(system: &System) -> Finding {
    const CHECK: &str = "hypervisor";
    let text = system.text("/proc/cpuinfo").unwrap_or_default();
    let flags = text.lines().find_map(|line| line.strip_prefix("flags")?.split_once(':').map(|(_, flags)| flags));
    match flags {
        None => unknown(CHECK, "/proc/cpuinfo has no flags", "make sure that this is no virtual machine"),
        Some(flags) if flags.split_whitespace().any(|flag| flag == "hypervisor") => bad(
            CHECK,
            "this is a virtual machine: its host may stop it at any time, for any time",
            "run on the machine itself; or give every virtual core a core of its own, and the host a PREEMPT_RT kernel",
        ),
        Some(_) => good(CHECK, "none"),
    }
}

/// Transparent huge pages. The kernel assembles one while a thread waits for its memory.
pub fn huge_pages(system: &System) -> Finding {
    const CHECK: &str = "huge pages";
    const FILE: &str = "/sys/kernel/mm/transparent_hugepage/enabled";
    let text = system.text(FILE);
    match text.as_deref().and_then(bracketed) {
        None => unknown(CHECK, format!("{FILE} cannot be read"), ""),
        Some("always") => bad(
            CHECK,
            "transparent huge pages for every process (always)",
            format!("echo madvise > {FILE}, for good by the kernel parameter transparent_hugepage=madvise"),
        ),
        Some(choice) => good(CHECK, choice),
    }
}
