//! Rows 37 to 40: the date, busy cores, files of killed groups, foreign files, and changes of oil, load and valves.

use std::{
    path::{Path, PathBuf},
    process::{Command, Output},
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::{Duration, Instant, SystemTime},
};

use pipeline::{
    channel::Reader,
    machine::{Machine, Scenario},
    message::{ControlMode, StageHealth, ValveCommand, bit_names, control_flag},
    stage::StageKind,
};
use rustix::process::Signal;
use serde_json::Value;

use crate::{
    clock::judge,
    harness::{FOUR_AXES, TestGroup, alone, channel::AXES, hydraxis, running::Running, shared, signal, wait_for},
    model::set,
};

const NOTHING: Vec<PathBuf> = Vec::new();

/// A library whose clock for the date changes with every call: right, an hour ahead, an hour behind, and so on. Other
/// clocks are not changed. At the end it appends the number of calls to a file.
const JUMPING_CLOCK: &str = r#"
#define _GNU_SOURCE
#include <stdio.h>
#include <stdlib.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

static unsigned looks;

static long shift(void) {
    const char *first = getenv("JUMP_FIRST");
    unsigned look = __atomic_fetch_add(&looks, 1, __ATOMIC_RELAXED) + (first ? atoi(first) : 0);
    return look % 3 == 0 ? 0 : look % 3 == 1 ? 3600 : -3600;
}

int clock_gettime(clockid_t id, struct timespec *now) {
    int result = syscall(SYS_clock_gettime, id, now);
    if (result == 0 && (id == CLOCK_REALTIME || id == CLOCK_REALTIME_COARSE)) now->tv_sec += shift();
    return result;
}

int gettimeofday(struct timeval *now, void *zone) {
    struct timespec exact;
    int result = clock_gettime(CLOCK_REALTIME, &exact);
    now->tv_sec = exact.tv_sec;
    now->tv_usec = exact.tv_nsec / 1000;
    return result;
}

time_t time(time_t *place) {
    struct timespec exact;
    clock_gettime(CLOCK_REALTIME, &exact);
    if (place) *place = exact.tv_sec;
    return exact.tv_sec;
}

__attribute__((destructor)) static void tell(void) {
    const char *name = getenv("JUMP_LOG");
    FILE *log = name ? fopen(name, "a") : NULL;
    if (log) { fprintf(log, "%u\n", looks); fclose(log); }
}
"#;

/// Compiles the library of that clock in a folder of the test.
fn jumping_clock(folder: &Path) -> PathBuf {
    let (source, library) = (folder.join("clock.c"), folder.join("clock.so"));
    std::fs::write(&source, JUMPING_CLOCK).unwrap();
    let built = Command::new("cc").args(["-shared", "-fPIC", "-O1", "-o"]).args([&library, &source]).output().unwrap();
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    library
}

fn stdout(output: &Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Row 37: a clock whose date jumps by an hour changes no figure of a run in lock-step.
#[test]
fn row_37_a_jumping_date_changes_no_figure_in_lock_step() {
    let folder = tempfile::tempdir().unwrap();
    let (library, log) = (jumping_clock(folder.path()), folder.path().join("looks"));
    let dated = |first: &str| {
        let date = Command::new("date").arg("+%s").env("LD_PRELOAD", &library).env("JUMP_FIRST", first).output();
        let date: i64 = stdout(&date.unwrap()).trim().parse().unwrap();
        date - SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap().as_secs() as i64
    };
    for (first, shift) in [("0", 0i64), ("1", 3600), ("2", -3600)] {
        assert!(dated(first).abs_diff(shift) < 60, "the clock of the test is {shift} s off");
    }

    let run = |jumps: bool| {
        let mut command = hydraxis();
        command.args(["run", FOUR_AXES, "--lockstep", "--duration", "20s", "--json", "-"]);
        if jumps {
            command.env("LD_PRELOAD", &library).env("JUMP_LOG", &log);
        }
        let report: Value = serde_json::from_str(&stdout(&command.output().unwrap())).unwrap();
        report
    };
    let (jumped, steady) = thread::scope(|scope| {
        let jumped = scope.spawn(|| run(true));
        (run(false), jumped.join().unwrap())
    });
    assert!(steady["axes"]["boom"]["tracking_by_model"]["count"].as_u64().unwrap() > 500);
    // All figures of all axes. The rest of the report is times.
    assert_eq!(jumped["axes"], steady["axes"]);
    let looks = std::fs::read_to_string(&log).unwrap();
    assert!(looks.lines().count() >= 5, "the supervisor and its stages had it: {looks:?}");
    eprintln!("row 37: looks at the date, by process: {}", looks.lines().collect::<Vec<_>>().join(", "));
}

/// The causes for which any axis is latched.
fn latched(command: &ValveCommand) -> Vec<&'static str> {
    let flags = command.axes[..AXES].iter().fold(0, |flags, axis| flags | axis.flags);
    bit_names(flags & control_flag::LATCHED, &control_flag::NAMES).collect()
}

/// Row 37: a clock whose date jumps by an hour latches nothing and stops no stage in real time.
#[test]
fn row_37_a_jumping_date_changes_nothing_in_real_time() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    let library = jumping_clock(folder.path());
    // With this time-out a busy computer latches nothing by itself.
    let arguments = ["--duration", "60s", "--set", "timing.feedback_timeout=5s", "--json", "-"];
    let mut running = Running::spawn("row-37", &arguments, &StageKind::ALL, |command| {
        command.env("LD_PRELOAD", &library);
    });
    let channels = running.group.join();
    let mut commands: Reader<ValveCommand> = channels.reader().unwrap();
    let (mut ticks, mut moved) = (0, false);
    wait_for("motion, and two seconds of commands", || {
        while let Some(command) = commands.read().unwrap().if_new() {
            assert!(latched(command).is_empty(), "{:?}", latched(command));
            moved |= command.axes[..AXES].iter().all(|axis| axis.command != 0.0);
            ticks += 1;
        }
        (moved && ticks > 200).then_some(())
    });
    drop((commands, channels));
    let said = running.interrupt();
    assert!(!said.stderr.contains("killed") && !said.stderr.contains("starts again"), "{}", said.stderr);
    let report: Value = serde_json::from_str(&said.stdout).unwrap();
    for (name, stage) in report["stages"].as_object().unwrap() {
        assert_eq!(stage["restarts"], 0, "{name}");
    }
}

/// Row 38: with busy programs on all cores, every command is within its limits, or neutral for a cause.
#[test]
fn row_38_with_busy_cores_every_command_is_within_its_limits() {
    let _cores = alone();
    let machine = Machine::four_axes(&[]).unwrap();
    let arguments = ["--duration", "60s", "--set", "scenario=nominal", "--json", "-"];
    let mut running = Running::start_with("row-38", &arguments);
    let channels = running.group.join();
    let mut commands: Reader<ValveCommand> = channels.reader().unwrap();
    let mut health: Reader<StageHealth> = channels.reader().unwrap();
    let (stop, mut gaps, mut ticks) = (AtomicBool::new(false), 0, 0);
    let mut last: Option<ValveCommand> = None;
    let mut causes = Vec::new();
    thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                while !stop.load(Ordering::Relaxed) {
                    std::hint::spin_loop();
                }
            });
        }
        let end = Instant::now() + Duration::from_secs(4);
        // The busy threads have to end before a failure can end the test.
        let seen = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            while Instant::now() < end {
                while let Some(command) = commands.read().unwrap().if_new() {
                    let passed =
                        last.map_or(0, |last| command.header.sequence.saturating_sub(last.header.sequence + 1));
                    (gaps, ticks) = (gaps + passed, ticks + 1);
                    judge_bounds(&machine, last.as_ref(), command, passed);
                    last = Some(*command);
                    causes.extend(latched(command));
                }
                thread::sleep(Duration::from_millis(1));
            }
        }));
        stop.store(true, Ordering::Relaxed);
        seen.unwrap();
    });
    causes.sort_unstable();
    causes.dedup();
    while health.read().unwrap().if_new().is_some() {}
    drop((commands, health, channels));
    let said = running.interrupt();
    let report: Value = serde_json::from_str(&said.stdout).unwrap();
    let mut told = format!("row 38: {ticks} commands, {gaps} ticks without one, latched by {causes:?}; missed:");
    for kind in StageKind::ALL {
        let stage = &report["stages"][kind.name()];
        let missed = stage["missed_deadlines"].as_u64().unwrap();
        let causes = ["late_input", "late_release", "long_work"].map(|cause| stage["missed_by_cause"][cause].as_u64());
        let by_cause: u64 = causes.into_iter().map(Option::unwrap).sum();
        assert_eq!(missed, by_cause, "{}: every miss has a cause", kind.name());
        told += &format!(" {} {missed}", kind.name());
        // A tick without a command was missed by the controller, or by a stage before it.
        if kind == StageKind::ControlProc {
            assert!(missed >= gaps, "{missed} misses, {gaps} gaps");
        }
    }
    eprintln!("{told}");
    assert!(ticks > 20);
}

/// Expects that every axis follows within its limits, or is neutral for a cause.
fn judge_bounds(machine: &Machine, last: Option<&ValveCommand>, command: &ValveCommand, passed: u64) {
    for (i, (axis, setup)) in command.axes.iter().zip(&machine.axes).enumerate() {
        let place = format!("tick {}, axis {i}: {} {:#x}", command.header.sequence, axis.command, axis.flags);
        let control = &setup.control;
        if axis.mode == ControlMode::Neutral as u32 {
            let causes = control_flag::LATCHED | control_flag::SETTLING | control_flag::DISARMED;
            assert!(axis.command == 0.0 && axis.flags & causes != 0, "{place}");
            continue;
        }
        assert_eq!(axis.flags & control_flag::LATCHED, 0, "{place}");
        assert!(axis.command.abs() <= control.command_limit, "{place}");
        if let Some(last) = last.filter(|last| last.axes[i].mode != ControlMode::Neutral as u32) {
            let step = control.command_rate * machine.timing.period.as_secs_f64() * (1 + passed) as f64;
            // At rest and at an end stop the valve is closed at once.
            let is_shut = axis.command.abs() < last.axes[i].command.abs();
            assert!(is_shut || (axis.command - last.axes[i].command).abs() <= step + 1e-9, "{place}");
        }
    }
}

/// Row 39: the next run of a killed group removes its files.
#[test]
fn row_39_the_next_run_removes_the_files_of_a_killed_group() {
    let _cores = shared();
    let mut running = Running::start("row-39");
    for pid in running.pids.into_iter().chain([running.supervisor.id()]) {
        signal(pid, Signal::KILL);
    }
    running.supervisor.wait().unwrap();
    wait_for("the end of all", || running.none_runs().then_some(()));
    assert!(!running.group.files().is_empty(), "they could not clean up");
    let prefix = running.group.prefix.to_string();
    let status = hydraxis().args(["status", "--prefix", &prefix]).output().unwrap();
    assert_eq!(status.status.code(), Some(1));
    assert!(stderr(&status).contains(&format!("no group \"{prefix}\" runs; start one with")), "{}", stderr(&status));

    let started = Instant::now();
    let again = hydraxis().args(["run", "--prefix", &prefix, "--lockstep", "--duration", "100ms"]).output().unwrap();
    let took = started.elapsed();
    assert!(again.status.success(), "{}", stderr(&again));
    judge("row 39", "start, ten ticks and end after", took, Duration::from_secs(2));
    assert_eq!(running.group.files(), NOTHING);
}

/// Row 39: a command that finds no group says so, and what to type.
#[test]
fn row_39_without_a_group_a_command_says_what_to_type() {
    let group = TestGroup::new("row-39-none");
    let prefix = group.prefix.to_string();
    let expected = format!("no group \"{prefix}\" runs; start one with: hydraxis run MACHINE.toml --prefix {prefix}");
    let commands: [&[&str]; 5] = [&["status"], &["operate", "--mode", "hold"], &["arm"], &["disarm"], &["reset"]];
    for arguments in commands {
        let started = Instant::now();
        let output = hydraxis().args(arguments).args(["--prefix", &prefix]).output().unwrap();
        judge("row 39", arguments[0], started.elapsed(), Duration::from_secs(2));
        assert_eq!(output.status.code(), Some(1), "{arguments:?}");
        assert!(stderr(&output).contains(&expected), "{arguments:?}: {}", stderr(&output));
    }
    assert_eq!(group.files(), NOTHING);
}

/// Row 39: a stage alone waits for the others, and `status` and `arm` tell what is missing.
#[test]
fn row_39_a_stage_alone_waits_and_commands_say_what_is_missing() {
    let mut group = TestGroup::new("row-39-alone");
    let prefix = group.prefix.to_string();
    group.start(StageKind::ControlProc, &["--arm"]);
    let shown = wait_for("the stage", || {
        let output = hydraxis().args(["status", "--json", "-", "--prefix", &prefix]).output().unwrap();
        output.status.success().then(|| stdout(&output))
    });
    let shown: Value = serde_json::from_str(&shown).unwrap();
    let stages = shown["stages"].as_object().unwrap();
    assert_eq!(stages["control-proc"]["state"], "ready");
    assert!(stages["control-proc"]["channels"]["encoder-sample"]["age_ns"].is_null(), "nobody has sent");
    let others = stages.iter().filter(|(name, _)| *name != "control-proc");
    assert!(others.clone().all(|(_, stage)| stage.is_null()), "{:?}", others.collect::<Vec<_>>());
    let started = Instant::now();
    let output = hydraxis().args(["arm", "--prefix", &prefix]).output().unwrap();
    judge("row 39", "arm without a sensor", started.elapsed(), Duration::from_secs(2));
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("no sample within") && stderr(&output).contains("sensor"), "{}", stderr(&output));
}

/// Row 39: a foreign file at the path of the group's folder is named and left alone.
#[test]
fn row_39_a_foreign_file_at_the_folders_path_is_named_and_left_alone() {
    let group = TestGroup::new("row-39-file");
    let (prefix, file) = (group.prefix.to_string(), group.prefix.folder());
    std::fs::write(&file, "foreign").unwrap();
    let commands: [&[&str]; 2] = [&["run", "--duration", "1s"], &["control-proc"]];
    let outputs = commands.map(|arguments| hydraxis().args(arguments).args(["--prefix", &prefix]).output().unwrap());
    let left = std::fs::read_to_string(&file).unwrap();
    std::fs::remove_file(&file).unwrap();
    assert_eq!(left, "foreign");
    for (arguments, output) in commands.iter().zip(&outputs) {
        let said = stderr(output);
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {said}");
        assert!(said.contains(&format!("found {}", file.display())), "{arguments:?}: {said}");
        assert!(said.contains("take another --prefix"), "{arguments:?}: {said}");
    }
    assert_eq!(group.files(), NOTHING);
}

/// When the reference begins to stand, and from when on the axes are observed, s. The last change of a scenario ends at
/// 16 s.
const STANDS: f64 = 17.0;
const WATCHED: f64 = 26.0;
const END: f64 = 32.0;

/// Writes a trajectory for all axes: to and fro about the middle, then at rest a little away from it.
fn trajectory(folder: &Path, machine: &Machine) -> PathBuf {
    let names: Vec<&str> = machine.axes.iter().map(|axis| axis.name.as_str()).collect();
    let mut text = format!("t,{}\n", names.join(","));
    let times = (0..7).map(|k| 2.5 * f64::from(k)).chain([STANDS]);
    for (t, part) in times.zip([0.0, 1.0, -0.6, 0.4, 0.0, 1.0, -0.6, 0.5]) {
        let positions = machine.axes.iter().map(|axis| {
            let (low, high) = axis.soft_limits;
            format!("{}", 0.5 * (low + high) + part * 0.15f64.min(0.2 * (high - low)))
        });
        text += &format!("{t},{}\n", positions.collect::<Vec<_>>().join(","));
    }
    let file = folder.join("path.csv");
    std::fs::write(&file, text).unwrap();
    file
}

/// Runs a scenario through the processes. Returns what is wrong with it.
fn hold(scenario: &str, machine: &Machine, file: &Path) -> Vec<String> {
    let mut settings: Vec<String> = Vec::new();
    for axis in &machine.axes {
        settings.push(format!("axis.{}.reference.kind=trajectory", axis.name));
        settings.push(format!("axis.{}.reference.file={}", axis.name, file.display()));
    }
    let duration = format!("{END}s");
    let arguments = ["--lockstep", "--duration", &duration, "--scenario", scenario];
    let name = format!("row-40-{scenario}");
    let mut running = Running::spawn(&name, &[&arguments, &set(&settings)[..]].concat(), &[], |_| ());
    let channels = running.group.join();
    let mut commands: Reader<ValveCommand> = channels.reader().unwrap();
    let (mut wrong, mut largest, mut seen) = (Vec::new(), [0.0f64; AXES], 0);
    let mut rest = [(f64::INFINITY, f64::NEG_INFINITY); AXES];
    while running.supervisor.try_wait().unwrap().is_none() {
        while let Some(command) = commands.read().unwrap().if_new() {
            if !latched(command).is_empty() && wrong.is_empty() {
                wrong.push(format!("{scenario}: tick {} latched {:?}", command.header.sequence, latched(command)));
            }
            let t = command.header.sequence as f64 * 0.01;
            for (i, axis) in command.axes[..AXES].iter().enumerate() {
                largest[i] = largest[i].max(axis.error.abs());
                if t > WATCHED && t < END - 0.1 {
                    rest[i] = (rest[i].0.min(axis.error), rest[i].1.max(axis.error));
                }
            }
            seen += u64::from(t > WATCHED);
        }
        thread::sleep(Duration::from_millis(2));
    }
    drop((commands, channels));
    running.expect_end(0);
    assert!(seen > 300, "{scenario}: {seen} ticks were watched");
    for (i, setup) in machine.axes.iter().enumerate() {
        let (low, high) = (1e3 * rest[i].0, 1e3 * rest[i].1);
        let told = format!(
            "{scenario} {}: {:.1} mm off at the most, at rest {low:.2} to {high:.2} mm",
            setup.name,
            1e3 * largest[i]
        );
        eprintln!("row 40: {told}");
        // A limit cycle of 2 mm or more would show as such a range of the error.
        if largest[i] > setup.control.following_error || high - low > 2.0 {
            wrong.push(told);
        }
    }
    wrong
}

/// Row 40: in every scenario the axes follow within their limit and come to rest without a limit cycle.
#[test]
fn row_40_in_every_scenario_the_axes_follow_and_come_to_rest() {
    let folder = tempfile::tempdir().unwrap();
    let machine = Machine::four_axes(&[]).unwrap();
    let file = trajectory(folder.path(), &machine);
    let scenarios: Vec<Scenario> =
        Scenario::built_in().into_iter().filter(|scenario| scenario.commands.is_empty()).collect();
    assert!(scenarios.iter().flat_map(|scenario| &scenario.changes).all(|change| change.end < STANDS));
    // All scenarios side by side, since the processes of a group in lock-step mostly wait.
    let wrong: Vec<String> = thread::scope(|scope| {
        let runs: Vec<_> =
            (scenarios.iter()).map(|scenario| scope.spawn(|| hold(&scenario.name, &machine, &file))).collect();
        runs.into_iter().flat_map(|run| run.join().unwrap()).collect()
    });
    assert!(wrong.is_empty(), "{wrong:#?}");
}
