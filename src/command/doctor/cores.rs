//! Cores: whether the cores that the stages ask for are reserved for them, and leave idle states fast enough.

use super::{
    finding::{Finding, Needs, bad, good, unknown},
    system::{System, list_of_cores},
};

/// Longest time to leave an idle state, us: about the time of a wake-up itself. A longer one shows in every wake-up.
const LONGEST_EXIT_US: i64 = 50;
/// Where kernel parameters are set permanently.
const PARAMETERS: &str = "in GRUB_CMDLINE_LINUX_DEFAULT of /etc/default/grub, then `update-grub` and reboot";

/// Compares the cores that the kernel keeps free of ordinary threads with those that the stages ask for.
pub fn isolated(system: &System, needs: &Needs) -> Finding {
    const CHECK: &str = "isolated cores";
    let Some(isolated) = system.cores("/sys/devices/system/cpu/isolated") else {
        return unknown(CHECK, "/sys/devices/system/cpu/isolated cannot be read", "");
    };
    let shown = if isolated.is_empty() { "none".to_owned() } else { list_of_cores(&isolated) };
    if needs.cores.is_empty() {
        let advice = "give the stages cores of their own: stage.NAME.core in the machine file";
        return unknown(CHECK, format!("{shown}; no stage asks for a core"), advice);
    }
    let asked = list_of_cores(&needs.cores);
    let online = system.cores("/sys/devices/system/cpu/online");
    if let Some(online) = online.filter(|online| needs.cores.iter().any(|core| !online.contains(core))) {
        let found = format!("the stages ask for {asked}, this machine has {}", list_of_cores(&online));
        return bad(CHECK, found, "ask for other cores: stage.NAME.core in the machine file");
    }
    if needs.cores.iter().all(|core| isolated.contains(core)) {
        return good(CHECK, format!("{shown}; the stages ask for {asked}"));
    }
    let parameters = format!("isolcpus=managed_irq,domain,{asked} nohz_full={asked} rcu_nocbs={asked}");
    bad(CHECK, format!("{shown}; the stages ask for {asked}"), format!("put {parameters} {PARAMETERS}"))
}

/// Compares the cores whose timer tick stops while one thread runs with those that the stages ask for.
pub fn tickless(system: &System, needs: &Needs) -> Finding {
    const CHECK: &str = "tickless cores";
    if needs.cores.is_empty() {
        return unknown(CHECK, "no stage asks for a core", "");
    }
    let asked = list_of_cores(&needs.cores);
    let Some(tickless) = system.cores("/sys/devices/system/cpu/nohz_full") else {
        let found = "/sys/devices/system/cpu/nohz_full cannot be read";
        return unknown(CHECK, found, "a kernel without CONFIG_NO_HZ_FULL interrupts its cores at every tick");
    };
    let shown = if tickless.is_empty() { "none".to_owned() } else { list_of_cores(&tickless) };
    if needs.cores.iter().all(|core| tickless.contains(core)) {
        return good(CHECK, shown);
    }
    bad(CHECK, format!("{shown}; the stages ask for {asked}"), format!("put nohz_full={asked} {PARAMETERS}"))
}

/// Which cores handle interrupts that are assigned to no core.
pub fn interrupts(system: &System, needs: &Needs) -> Finding {
    const CHECK: &str = "interrupts";
    const FILE: &str = "/proc/irq/default_smp_affinity";
    let Some(allowed) = system.text(FILE).as_deref().and_then(cores_of_mask) else {
        return unknown(CHECK, format!("{FILE} cannot be read"), "");
    };
    let found = format!("by default on cores {}", list_of_cores(&allowed));
    if needs.cores.is_empty() {
        return unknown(CHECK, format!("{found}; no stage asks for a core"), "");
    }
    if !needs.cores.iter().any(|core| allowed.contains(core)) {
        return good(CHECK, found);
    }
    let others: Vec<usize> = allowed.iter().copied().filter(|core| !needs.cores.contains(core)).collect();
    if others.is_empty() {
        return bad(CHECK, found, "leave a core to everything else: ask for fewer in the machine file");
    }
    let others = list_of_cores(&others);
    bad(
        CHECK,
        format!("{found}, which includes cores of the stages"),
        format!(
            "put irqaffinity={others} {PARAMETERS}; with irqbalance, IRQBALANCE_BANNED_CPULIST={} in \
                 /etc/default/irqbalance",
            list_of_cores(&needs.cores)
        ),
    )
}

/// The cores of a mask such as `ff,ffffffff`.
fn cores_of_mask(text: &str) -> Option<Vec<usize>> {
    let mut cores = Vec::new();
    for (word, digits) in text.rsplit(',').enumerate() {
        let bits = u32::from_str_radix(digits, 16).ok()?;
        cores.extend((0..32).filter(|bit| bits & (1 << bit) != 0).map(|bit| 32 * word + bit));
    }
    Some(cores)
}

/// The cores that the stages use: those that they ask for, or all.
fn used(system: &System, needs: &Needs) -> Vec<usize> {
    if needs.cores.is_empty() {
        system.cores("/sys/devices/system/cpu/online").unwrap_or_default()
    } else {
        needs.cores.clone()
    }
}

/// The frequency governor of the used cores. A governor that follows the load is slow when a stage wakes up.
pub fn governor(system: &System, needs: &Needs) -> Finding {
    const CHECK: &str = "frequency governor";
    let of = |core: usize| system.text(&format!("/sys/devices/system/cpu/cpu{core}/cpufreq/scaling_governor"));
    let governors: Vec<(usize, String)> =
        used(system, needs).into_iter().filter_map(|core| of(core).map(|governor| (core, governor))).collect();
    if governors.is_empty() {
        let found = "the kernel sets no frequency here";
        return unknown(CHECK, found, "choose the highest performance in the firmware, or on the host");
    }
    let (fit, unfit): (Vec<_>, Vec<_>) = governors.iter().partition(|(_, governor)| governor == "performance");
    let cores = |of: &[&(usize, String)]| list_of_cores(&of.iter().map(|(core, _)| *core).collect::<Vec<_>>());
    match unfit.first() {
        None => good(CHECK, format!("performance on cores {}", cores(&fit))),
        Some((_, governor)) => bad(
            CHECK,
            format!("{governor} on cores {}", cores(&unfit)),
            format!("cpupower --cpu {} frequency-set --governor performance", cores(&unfit)),
        ),
    }
}

/// The time to leave the deepest idle state of the used cores, and whether this user can forbid deep states.
pub fn idle_states(system: &System, needs: &Needs) -> Finding {
    const CHECK: &str = "idle states";
    const LATENCY: &str = "/dev/cpu_dma_latency";
    let mut deepest: Option<(i64, String)> = None;
    for core in used(system, needs) {
        let folder = format!("/sys/devices/system/cpu/cpu{core}/cpuidle");
        for state in system.names(&folder) {
            let is_off = system.number(&format!("{folder}/{state}/disable")) == Some(1);
            let Some(latency) = system.number(&format!("{folder}/{state}/latency")).filter(|_| !is_off) else {
                continue;
            };
            if deepest.as_ref().is_none_or(|(longest, _)| latency > *longest) {
                let name = system.text(&format!("{folder}/{state}/name")).unwrap_or(state);
                deepest = Some((latency, format!("{name} of core {core}")));
            }
        }
    }
    let Some((latency, name)) = deepest else {
        return unknown(CHECK, "the kernel shows none", "forbid deep ones (C-states) in the firmware, or on the host");
    };
    let found = format!("the deepest, {name}, takes {latency} us to leave");
    if latency <= LONGEST_EXIT_US {
        return good(CHECK, found);
    }
    let is_writable = std::fs::OpenOptions::new().write(true).open(system.path(LATENCY)).is_ok();
    let holding = if is_writable { "may" } else { "may not" };
    bad(
        CHECK,
        format!("{found}; this user {holding} open {LATENCY}"),
        format!(
            "cpupower idle-set --disable-by-latency {LONGEST_EXIT_US}; for good by the kernel parameters \
                 processor.max_cstate=1 intel_idle.max_cstate=0; or keep {LATENCY} open with 0 written to it"
        ),
    )
}
