//! Every finding on systems that are fit, that are not, and whose files cannot be read.

use std::{collections::BTreeMap, path::Path, time::Duration};

use pipeline::channel::{Exposed, FoundGroup, GroupState};

use super::{
    Tried, examine,
    finding::{
        Finding, Needs,
        Verdict::{self, Bad, Good, Unknown},
    },
    rights::{leftovers, other_users},
    system::System,
};

const LIMITS: &str = "\
Limit                     Soft Limit           Hard Limit           Units
Max locked memory         LOCK                 unlimited            bytes
Max realtime priority     RTPRIO               0
";
const CPU: &str = "/sys/devices/system/cpu";

/// A system made of files in a folder.
struct Fake {
    folder: tempfile::TempDir,
}

impl Fake {
    fn empty() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    /// A system on which nothing is bad: four cores, two of them for the stages.
    fn fit() -> Self {
        let fake = Self::empty();
        let limits = LIMITS.replace("LOCK  ", "unlimited").replace("RTPRIO", "95    ");
        for (path, text) in [
            ("/proc/version", "Linux version 6.12.1-rt (x@y) #1 SMP PREEMPT_RT Debian"),
            ("/sys/kernel/realtime", "1\n"),
            ("/sys/devices/system/clocksource/clocksource0/current_clocksource", "tsc\n"),
            ("/proc/cpuinfo", "processor\t: 0\nflags\t\t: fpu vme de tsc\n"),
            ("/sys/kernel/mm/transparent_hugepage/enabled", "always [madvise] never\n"),
            ("/sys/devices/system/cpu/online", "0-3\n"),
            ("/sys/devices/system/cpu/isolated", "2-3\n"),
            ("/sys/devices/system/cpu/nohz_full", "2-3\n"),
            ("/proc/irq/default_smp_affinity", "00000000,00000003\n"),
            ("/proc/self/limits", &limits),
            ("/proc/self/status", "Name:\tx\nUid:\t1000\t1000\nCapEff:\t0000000000000000\n"),
            ("/proc/sys/kernel/sched_rt_runtime_us", "-1\n"),
            ("/proc/sys/kernel/sched_rt_period_us", "1000000\n"),
            ("/proc/swaps", "Filename\tType\tSize\tUsed\tPriority\n"),
            ("/proc/mounts", "proc /proc proc rw 0 0\ntmpfs /dev/shm tmpfs rw 0 0\n"),
            ("/etc/systemd/logind.conf", "[Login]\n#RemoveIPC=yes\n"),
            ("/etc/systemd/logind.conf.d/hydraxis.conf", "[Login]\nRemoveIPC=no\n"),
        ] {
            fake.write(path, text);
        }
        for core in 0..4 {
            fake.write(&format!("{CPU}/cpu{core}/cpufreq/scaling_governor"), "performance\n");
            fake.idle_state(core, 0, "POLL", 0);
            fake.idle_state(core, 1, "C1", 2);
        }
        std::fs::create_dir_all(fake.path("/dev/shm")).unwrap();
        fake
    }

    fn idle_state(&self, core: usize, state: usize, name: &str, latency: i64) {
        let folder = format!("{CPU}/cpu{core}/cpuidle/state{state}");
        self.write(&format!("{folder}/name"), name);
        self.write(&format!("{folder}/latency"), &latency.to_string());
        self.write(&format!("{folder}/disable"), "0");
    }

    fn path(&self, path: &str) -> std::path::PathBuf {
        self.folder.path().join(path.trim_start_matches('/'))
    }

    fn write(&self, path: &str, text: &str) {
        let path = self.path(path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }

    fn remove(&self, path: &str) {
        std::fs::remove_file(self.path(path)).unwrap();
    }

    fn findings(&self, needs: &Needs, tried: &Tried) -> BTreeMap<&'static str, Finding> {
        let findings = examine(&System::under(self.folder.path()), needs, tried);
        findings.into_iter().map(|finding| (finding.check, finding)).collect()
    }

    /// The finding of one check with the usual needs and rights.
    fn finding(&self, check: &str) -> Finding {
        self.findings(&needs(), &allowed()).remove(check).unwrap()
    }
}

/// Two stages with cores of their own, one of which spins under FIFO.
fn needs() -> Needs {
    Needs { period: Duration::from_millis(10), cores: vec![2, 3], priority: Some(80), spins: true, lock_memory: true }
}

fn needs_nothing() -> Needs {
    Needs { cores: vec![], priority: None, spins: false, lock_memory: false, ..needs() }
}

fn allowed() -> Tried {
    Tried { fifo: Ok(()), lock: Ok(()) }
}

fn refused() -> Tried {
    Tried { fifo: Err("EPERM".to_owned()), lock: Err("ENOMEM".to_owned()) }
}

#[track_caller]
fn expect(finding: &Finding, verdict: Verdict, found: &str, advice: &str) {
    assert_eq!(finding.verdict, verdict, "{finding:?}");
    assert!(finding.found.contains(found), "no {found:?} in {finding:?}");
    assert!(finding.advice.contains(advice), "no {advice:?} in {finding:?}");
    assert!(verdict != Bad || !finding.advice.is_empty(), "bad without advice: {finding:?}");
}

#[test]
fn a_fit_system_gets_only_good_findings_without_advice() {
    let findings = Fake::fit().findings(&needs(), &allowed());
    assert_eq!(findings.len(), 17);
    for finding in findings.values() {
        assert_eq!((finding.verdict, finding.advice.as_str()), (Good, ""), "{finding:?}");
    }
}

#[test]
fn files_that_cannot_be_read_give_unknown_and_no_panic() {
    let findings = Fake::empty().findings(&needs(), &allowed());
    for (check, finding) in &findings {
        let tried = ["SCHED_FIFO", "locked memory"].contains(check);
        assert_eq!(finding.verdict, if tried { Good } else { Unknown }, "{finding:?}");
    }
    // Files with another content.
    let fake = Fake::fit();
    for entry in [
        "/sys/devices/system/cpu/isolated",
        "/sys/devices/system/cpu/nohz_full",
        "/proc/irq/default_smp_affinity",
        "/proc/self/limits",
        "/proc/sys/kernel/sched_rt_runtime_us",
        "/sys/kernel/mm/transparent_hugepage/enabled",
    ] {
        fake.write(entry, "(null)x");
    }
    fake.write("/proc/sys/kernel/sched_rt_period_us", "0");
    let findings = fake.findings(&needs(), &allowed());
    for check in ["isolated cores", "tickless cores", "interrupts", "priority limit", "memory limit", "FIFO throttling"]
    {
        assert_eq!(findings[check].verdict, Unknown, "{:?}", findings[check]);
    }
}

#[test]
fn every_kernel_without_preempt_rt_is_bad() {
    let fake = Fake::fit();
    fake.remove("/sys/kernel/realtime");
    expect(&fake.finding("preemption"), Good, "PREEMPT_RT", "");
    fake.write("/proc/version", "Linux version 6.1 #1 SMP Debian");
    expect(&fake.finding("preemption"), Bad, "a kernel without preemption", "linux-image-rt-amd64");
    fake.write("/proc/version", "Linux version 6.1 #1 SMP PREEMPT Debian");
    expect(&fake.finding("preemption"), Bad, "PREEMPT, without RT", "CONFIG_PREEMPT_RT=y");
    fake.write("/proc/version", "Linux version 6.1 #1 SMP PREEMPT_DYNAMIC Debian");
    expect(&fake.finding("preemption"), Bad, "the model cannot be read", "/sys/kernel/debug/sched/preempt");
    fake.write("/proc/cmdline", "quiet preempt=none preempt=voluntary");
    expect(&fake.finding("preemption"), Bad, "PREEMPT_DYNAMIC voluntary", "preempt=full");
    fake.write("/sys/kernel/debug/sched/preempt", "none voluntary (full) lazy");
    expect(&fake.finding("preemption"), Bad, "PREEMPT_DYNAMIC full, without RT", "linux-image-rt-amd64");
    fake.write("/sys/kernel/realtime", "1");
    expect(&fake.finding("preemption"), Good, "PREEMPT_RT", "");
}

#[test]
fn clock_hypervisor_and_huge_pages_are_judged() {
    let fake = Fake::fit();
    fake.write("/sys/devices/system/clocksource/clocksource0/current_clocksource", "hpet\n");
    expect(&fake.finding("clock source"), Bad, "hpet", "dmesg");
    fake.write("/proc/cpuinfo", "processor : 0\nflags : fpu hypervisor tsc\n");
    expect(&fake.finding("hypervisor"), Bad, "virtual machine", "run on the machine itself");
    fake.write("/proc/cpuinfo", "processor : 0\nFeatures : fp asimd\n");
    expect(&fake.finding("hypervisor"), Unknown, "no flags", "no virtual machine");
    fake.write("/sys/kernel/mm/transparent_hugepage/enabled", "[always] madvise never\n");
    expect(&fake.finding("huge pages"), Bad, "always", "transparent_hugepage=madvise");
}

#[test]
fn cores_are_compared_with_those_that_the_stages_ask_for() {
    let fake = Fake::fit();
    fake.write("/sys/devices/system/cpu/isolated", "3\n");
    expect(&fake.finding("isolated cores"), Bad, "3; the stages ask for 2-3", "isolcpus=managed_irq,domain,2-3");
    fake.write("/sys/devices/system/cpu/isolated", "\n");
    expect(&fake.finding("isolated cores"), Bad, "none; the stages ask for 2-3", "/etc/default/grub");
    fake.write("/sys/devices/system/cpu/online", "0-2\n");
    expect(&fake.finding("isolated cores"), Bad, "ask for 2-3, this machine has 0-2", "stage.NAME.core");
    fake.write("/sys/devices/system/cpu/nohz_full", "\n");
    expect(&fake.finding("tickless cores"), Bad, "none; the stages ask for 2-3", "nohz_full=2-3");
    fake.write("/proc/irq/default_smp_affinity", "f\n");
    expect(&fake.finding("interrupts"), Bad, "cores 0-3, which includes cores of the stages", "irqaffinity=0-1");
    fake.write("/proc/irq/default_smp_affinity", "c\n");
    expect(&fake.finding("interrupts"), Bad, "cores 2-3", "leave a core to everything else");

    let findings = fake.findings(&needs_nothing(), &allowed());
    expect(&findings["isolated cores"], Unknown, "no stage asks for a core", "stage.NAME.core");
    expect(&findings["tickless cores"], Unknown, "no stage asks for a core", "");
    expect(&findings["interrupts"], Unknown, "no stage asks for a core", "");
}

#[test]
fn only_used_cores_must_be_fast_and_leave_idle_states_quickly() {
    let fake = Fake::fit();
    fake.write(&format!("{CPU}/cpu0/cpufreq/scaling_governor"), "powersave\n");
    fake.idle_state(0, 2, "C10", 900);
    assert_eq!(fake.finding("frequency governor").verdict, Good);
    assert_eq!(fake.finding("idle states").verdict, Good);
    // Stages that ask for no core run on any core.
    let findings = fake.findings(&needs_nothing(), &allowed());
    expect(&findings["frequency governor"], Bad, "powersave on cores 0", "cpupower --cpu 0 frequency-set");
    expect(&findings["idle states"], Bad, "C10 of core 0, takes 900 us", "--disable-by-latency 50");

    fake.write(&format!("{CPU}/cpu3/cpufreq/scaling_governor"), "schedutil\n");
    expect(&fake.finding("frequency governor"), Bad, "schedutil on cores 3", "cpupower --cpu 3");
    fake.idle_state(2, 2, "C6", 51);
    expect(&fake.finding("idle states"), Bad, "this user may not open /dev/cpu_dma_latency", "intel_idle.max_cstate=0");
    fake.write("/dev/cpu_dma_latency", "");
    expect(&fake.finding("idle states"), Bad, "this user may open /dev/cpu_dma_latency", "with 0 written to it");
    fake.write(&format!("{CPU}/cpu2/cpuidle/state2/disable"), "1\n");
    expect(&fake.finding("idle states"), Good, "C1 of core 2, takes 2 us", "");
    fake.idle_state(2, 2, "C3", 50);
    assert_eq!(fake.finding("idle states").verdict, Good);
}

#[test]
fn rights_are_judged_by_limits_capabilities_and_an_attempt() {
    let fake = Fake::fit();
    fake.write("/proc/self/limits", &LIMITS.replace("LOCK", "8388608").replace("RTPRIO", "79"));
    let findings = fake.findings(&needs(), &refused());
    expect(&findings["priority limit"], Bad, "79; 80 is needed", "@realtime - rtprio 95");
    expect(&findings["memory limit"], Bad, "8192 kB may be locked", "@realtime - memlock unlimited");
    expect(&findings["SCHED_FIFO"], Bad, "refused: EPERM", "see the priority limit");
    expect(&findings["locked memory"], Bad, "refused: ENOMEM", "see the memory limit");
    // A process with the capability is refused for another reason.
    fake.write("/proc/self/status", "Uid:\t0\t0\nCapEff:\t000001ffffffffff\n");
    let findings = fake.findings(&needs(), &refused());
    expect(&findings["priority limit"], Good, "CAP_SYS_NICE", "");
    expect(&findings["memory limit"], Good, "CAP_IPC_LOCK", "");
    expect(&findings["SCHED_FIFO"], Bad, "in spite of CAP_SYS_NICE: EPERM", "RT group scheduling");
}

#[test]
fn a_stage_that_spins_under_fifo_is_stopped_by_the_throttle() {
    let fake = Fake::fit();
    fake.write("/proc/sys/kernel/sched_rt_runtime_us", "950000\n");
    expect(&fake.finding("FIFO throttling"), Bad, "stopped 50 ms in each 1000 ms", "kernel.sched_rt_runtime_us=-1");
    let findings = fake.findings(&Needs { spins: false, ..needs() }, &allowed());
    expect(&findings["FIFO throttling"], Good, "no stage does", "");
    fake.write("/proc/sys/kernel/sched_rt_runtime_us", "1000000\n");
    expect(&fake.finding("FIFO throttling"), Good, "off", "");
}

#[test]
fn swap_logout_and_shared_memory_are_judged() {
    let fake = Fake::fit();
    fake.write("/proc/swaps", "Filename Type Size Used Priority\n/dev/sda2 partition 100 5 -2\n");
    expect(&fake.finding("swap"), Good, "on /dev/sda2; the stages lock their memory", "");
    expect(&fake.findings(&needs(), &refused())["swap"], Bad, "on /dev/sda2", "swapoff -a");
    expect(&fake.findings(&needs_nothing(), &allowed())["swap"], Bad, "on /dev/sda2", "realtime.lock_memory = true");

    fake.remove("/etc/systemd/logind.conf.d/hydraxis.conf");
    expect(&fake.finding("logout"), Bad, "at the last logout", "RemoveIPC=no in /etc/systemd/logind.conf");
    fake.write("/proc/self/status", "Uid:\t999\t999\n");
    expect(&fake.finding("logout"), Good, "a user of the system", "");

    fake.write("/proc/mounts", "proc /proc proc rw 0 0\n");
    expect(&fake.finding("shared memory"), Bad, "not mounted", "mount -t tmpfs");
    fake.write("/proc/mounts", "tmpfs /dev/shm tmpfs rw 0 0\n");
    assert_eq!(std::fs::read_dir(fake.path("/dev/shm")).unwrap().count(), 0, "the probe is gone");
    std::fs::remove_dir(fake.path("/dev/shm")).unwrap();
    expect(&fake.finding("shared memory"), Bad, "no file can be created in /dev/shm", "chmod 1777 /dev/shm");
    expect(&super::rights::shared_memory_of(64 << 20, 32 << 20), Good, "32 of 64 MB free", "");
    expect(&super::rights::shared_memory_of(64 << 20, (32 << 20) - 1), Bad, "31 of 64 MB free", "remount,size=256M");
}

#[test]
fn dead_groups_are_bad() {
    let group = |prefix: &str, state| FoundGroup {
        prefix: prefix.parse().unwrap(),
        state,
        files: vec![Path::new("/dev/shm/x").to_owned()],
    };
    expect(&leftovers(&[group("a", GroupState::Alive)]), Good, "1 alive, 0 dead", "");
    expect(&leftovers(&[group("a", GroupState::Unknown)]), Unknown, "1 unknown", "clean --dry-run");
    expect(
        &leftovers(&[group("a", GroupState::Dead), group("b", GroupState::Unknown)]),
        Bad,
        "1 dead",
        "hydraxis clean",
    );
}

#[test]
fn files_that_others_can_write_are_bad_and_those_of_others_unknown() {
    let path = |path: &str, is_foreign, mode| Exposed { path: path.into(), owner: 65534, is_foreign, mode };
    let (open, foreign) = (path("/dev/shm/a", false, 0o666), path("/tmp/hydraxis.b", true, 0o700));
    expect(&other_users(&[]), Good, "none", "");
    expect(&other_users(std::slice::from_ref(&foreign)), Unknown, "/tmp/hydraxis.b (user 65534, mode 0700)", "as root");
    expect(&other_users(&[foreign, open]), Bad, "/dev/shm/a (user 65534, mode 0666)", "hydraxis clean");
}
