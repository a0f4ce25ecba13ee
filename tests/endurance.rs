//! Files, descriptors and memory do not grow, neither over many groups nor within one, and the loops meet no page
//! fault.
//!
//! The tests are short by default. `HYDRAXIS_ENDURANCE_CYCLES` (100), `HYDRAXIS_ENDURANCE_MODEL_MINUTES` (60, in
//! lock-step) and `HYDRAXIS_ENDURANCE_MINUTES` (10, in real time) make them long; use the release profile then.
//!
//! Trap: resident memory is not allocated memory. A page counts from its first use on. This holds for the program's
//! code, and for the channels: a reader that falls behind makes its writer use a slot for the first time. So two sizes
//! have to stay constant to the page: the private memory of a process, and the shared memory that the channels took at
//! start.

mod harness;

use std::{
    fs::File,
    thread::sleep,
    time::{Duration, Instant},
};

use harness::{
    PATIENCE, TestGroup, alone, files, hydraxis, processes,
    running::{Running, is_orderly},
    shared, variable, wait_for,
};
use pipeline::{
    channel::Reader,
    message::StageHealth,
    stage::{StageKind, monotonic_ns},
};

/// The number after a word in `/proc/PID/status`, kB.
fn status(pid: u32, word: &str) -> u64 {
    let text = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
    let line = text.lines().find_map(|line| line.strip_prefix(word)).unwrap();
    line.trim_start_matches(':').trim_end_matches("kB").trim().parse().unwrap()
}

/// Resources of a process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Holds {
    own_kb: u64,
    data_kb: u64,
    descriptors: usize,
    threads: u64,
}

impl Holds {
    fn of(pid: u32) -> Self {
        Self {
            own_kb: status(pid, "RssAnon"),
            data_kb: status(pid, "VmData"),
            descriptors: descriptors(pid),
            threads: status(pid, "Threads"),
        }
    }

    /// Without descriptors that are open for a moment only: the supervisor lists folders once a second.
    fn lasting(pid: u32) -> Self {
        let mut least = Self::of(pid);
        for _ in 0..10 {
            sleep(Duration::from_millis(20));
            least.descriptors = least.descriptors.min(descriptors(pid));
        }
        least
    }
}

fn descriptors(pid: u32) -> usize {
    std::fs::read_dir(format!("/proc/{pid}/fd")).unwrap().count()
}

/// The supervisor and its stages, by name.
fn members(running: &Running) -> Vec<(&'static str, u32)> {
    let stages = StageKind::ALL.into_iter().map(|kind| (kind.name(), running.pid(kind)));
    [("supervisor", running.supervisor.id())].into_iter().chain(stages).collect()
}

/// Files in shared memory and where groups have their folders.
fn all_files() -> Vec<std::path::PathBuf> {
    let folders = std::collections::BTreeSet::from(["/dev/shm".into(), pipeline::channel::place()]);
    let own = format!("t{}-", std::process::id());
    let paths =
        folders.iter().flat_map(|folder| std::fs::read_dir(folder).unwrap().flatten()).map(|entry| entry.path());
    // Only files of this test process: others may work on the same computer.
    paths.filter(|path| path.to_string_lossy().contains(&own)).collect()
}

#[test]
fn groups_that_come_and_go_leave_nothing_and_take_no_more_each_time() {
    let _cores = alone();
    let cycles = variable("HYDRAXIS_ENDURANCE_CYCLES", 5.0) as usize;
    let group = TestGroup::new("cycles");
    let prefix = group.prefix.to_string();
    let folder = tempfile::tempdir().unwrap();
    let said = folder.path().join("said");
    let mut peaks: Vec<[u64; 5]> = Vec::new();
    let mut before = None;
    for cycle in 0..cycles {
        let clock = if cycle % 2 == 0 { &["--duration", "0.3s"][..] } else { &["--duration", "2s", "--lockstep"] };
        let mut supervisor = hydraxis()
            .args(["run", "--prefix", &prefix])
            .args(clock)
            .stdout(std::process::Stdio::null())
            .stderr(File::create(&said).unwrap())
            .spawn()
            .unwrap();
        let mut peak = [0; 5];
        let ended = wait_for("the group to end", || {
            let text = std::fs::read_to_string(format!("/proc/{0}/task/{0}/children", supervisor.id()));
            let children = text.unwrap_or_default();
            for pid in std::iter::once(supervisor.id()).chain(children.split(' ').filter_map(|pid| pid.parse().ok())) {
                take_peak(pid, &mut peak);
            }
            supervisor.try_wait().unwrap()
        });
        let text = std::fs::read_to_string(&said).unwrap();
        assert!(is_orderly(ended, &text), "cycle {cycle}: {ended}\n{text}");
        peaks.push(peak);
        assert_eq!(all_files(), Vec::<std::path::PathBuf>::new(), "cycle {cycle}");
        assert_eq!(files(&group.prefix), Vec::<std::path::PathBuf>::new(), "cycle {cycle}");
        assert_eq!(processes(&group.prefix), Vec::<String>::new(), "cycle {cycle}");
        let now = descriptors(std::process::id());
        assert_eq!(*before.get_or_insert(now), now, "descriptors of this process, cycle {cycle}");
    }
    println!("{cycles} cycles; peaks of supervisor, plant-sim, sensor-proc, ident-proc, control-proc, kB:");
    let (first, last) = peaks.split_at(cycles / 2);
    for (name, half) in [("first half", first), ("second half", last)] {
        println!("  {name}: {:?}", means(half));
    }
    // No group leaves anything by which the next one could take more. Which pages a process has used differs a little.
    for (before, after) in means(first).iter().zip(means(last)) {
        assert!(after < 1.1 * before, "{before} kB grow to {after} kB");
    }
}

fn means(peaks: &[[u64; 5]]) -> [f64; 5] {
    std::array::from_fn(|i| peaks.iter().map(|peak| peak[i] as f64).sum::<f64>() / peaks.len() as f64)
}

/// Updates the peak of a process of the group, which the command line names.
fn take_peak(pid: u32, peaks: &mut [u64; 5]) {
    // The process may have ended meanwhile.
    let Ok(line) = std::fs::read_to_string(format!("/proc/{pid}/cmdline")) else { return };
    let Ok(text) = std::fs::read_to_string(format!("/proc/{pid}/status")) else { return };
    let names = ["run", "plant-sim", "sensor-proc", "ident-proc", "control-proc"];
    let place = names.iter().position(|name| line.split('\0').nth(1) == Some(name));
    let peak = text.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim_end_matches("kB").trim().parse().ok());
    if let Some((place, peak)) = place.zip(peak) {
        peaks[place] = peaks[place].max(peak);
    }
}

/// Reads heartbeats until all stages have worked this tick.
fn await_tick(health: &mut Reader<StageHealth>, tick: u64, patience: Duration) {
    let until = Instant::now() + patience;
    let mut least = [0; 4];
    while least.iter().skip(1).any(|of| *of < tick) {
        while let Some(health) = health.read().unwrap().if_new() {
            least[health.stage as usize] = health.header.sequence;
        }
        assert!(Instant::now() < until, "waited {patience:?} for tick {tick}: {least:?}");
        sleep(Duration::from_millis(5));
    }
}

/// Notes the resources of all processes after `warm_up` ticks, and expects the same ones at ten later ticks until
/// `ticks`.
fn expect_constant(test: &str, arguments: &[&str], warm_up: u64, ticks: u64) {
    let running = Running::start_with(test, &[&["--duration", "100000s"], arguments].concat());
    let channels = running.group.join();
    let mut health: Reader<StageHealth> = channels.reader().unwrap();
    // In lock-step a tick takes a millisecond at most, and ten on a busy computer.
    let patience = PATIENCE + Duration::from_millis(20 * ticks);
    await_tick(&mut health, warm_up, patience);
    let look = || members(&running).into_iter().map(|(name, pid)| (name, Holds::lasting(pid))).collect::<Vec<_>>();
    let touched = || members(&running).into_iter().map(|(_, pid)| status(pid, "VmRSS")).collect::<Vec<_>>();
    let shared = || running.group.files().iter().map(|file| std::fs::metadata(file).unwrap().len()).sum::<u64>() / 1024;
    let (before, shared_before, touched_before) = (look(), shared(), touched());
    let started = monotonic_ns();
    let mut changes = Vec::new();
    for part in 1..=10 {
        await_tick(&mut health, warm_up + (ticks - warm_up) * part / 10, patience);
        let now = look();
        for (then, now) in before.iter().zip(&now).filter(|(then, now)| then != now) {
            changes.push(format!("part {part} of 10: {then:?} has become {:?}", now.1));
        }
        assert_eq!(shared(), shared_before, "kB of shared memory, part {part} of 10");
    }
    println!(
        "{test}: from tick {warm_up} to {ticks} in {:.1} s: {before:?}; shared {shared_before} kB; VmRSS was \
         {touched_before:?} kB and is {:?} kB",
        (monotonic_ns() - started) as f64 * 1e-9,
        touched()
    );
    assert_eq!(changes, Vec::<String>::new());
    end(running, channels, health);
}

/// Ends a group by SIGINT and expects that no file is left.
fn end(mut running: Running, channels: pipeline::channel::Group, health: Reader<StageHealth>) {
    drop((health, channels));
    running.interrupt();
    assert_eq!(running.group.files(), Vec::<std::path::PathBuf>::new());
}

#[test]
fn memory_is_constant_to_the_page_in_lock_step() {
    let _cores = shared();
    let minutes = variable("HYDRAXIS_ENDURANCE_MODEL_MINUTES", 1.0);
    expect_constant("constant-lock", &["--lockstep"], 1000, (6000.0 * minutes) as u64);
}

#[test]
fn memory_is_constant_to_the_page_in_real_time() {
    let _cores = shared();
    let minutes = variable("HYDRAXIS_ENDURANCE_MINUTES", 1.0 / 6.0);
    // The memory of a black box is bounded, but grows while a busy computer makes its messages come in bursts. The list
    // of events is bounded too: models take control before the warm-up is over, and after that nothing happens.
    expect_constant("constant-real", &["--no-black-box"], 1600, 1600 + (6000.0 * minutes) as u64);
}

/// Minor and major page faults of a process' main thread.
fn page_faults(pid: u32) -> (u64, u64) {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/task/{pid}/stat")).unwrap();
    // The state is field 3. It follows the name, which may contain spaces and ends at the last bracket.
    let fields: Vec<&str> = stat.rsplit(") ").next().unwrap().split(' ').collect();
    (fields[10 - 3].parse().unwrap(), fields[12 - 3].parse().unwrap())
}

#[test]
fn the_loops_of_the_stages_meet_no_page_fault() {
    let _cores = shared();
    let locked = ["--set", "realtime.lock_memory=true"];
    let running = Running::start_with("faults", &[&["--duration", "100000s"], &locked[..]].concat());
    let channels = running.group.join();
    let mut health: Reader<StageHealth> = channels.reader().unwrap();
    await_tick(&mut health, 500, PATIENCE);
    let look = || StageKind::ALL.map(|kind| (kind.name(), page_faults(running.pid(kind))));
    let before = look();
    await_tick(&mut health, 1000, PATIENCE);
    let after = look();
    let locked = StageKind::ALL.map(|kind| status(running.pid(kind), "VmLck"));
    println!("minor and major page faults: {before:?}, then {after:?}; locked {locked:?} kB");
    assert_eq!(before, after);
    end(running, channels, health);
}
