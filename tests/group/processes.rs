//! Processes of a group: signals, killed processes, late and killed readers.

use std::time::{Duration, Instant};

use crate::harness::{
    TestGroup, alone, files, hydraxis, is_running, running::Running, shared, signal, succeed, wait_for,
};
use pipeline::{
    channel::Publisher,
    message::{CoefficientSnapshot, EncoderReading, EncoderSample, Header, StageHealth},
    stage::{StageKind, monotonic_ns},
};
use rustix::process::Signal;

#[test]
fn ctrl_c_stops_all_four_within_a_second_and_leaves_nothing() {
    let _cores = shared();
    let mut running = Running::start("ctrl-c");
    assert!(running.pids.iter().all(|pid| is_running(*pid)));
    assert!(!running.group.files().is_empty());
    let started = Instant::now();
    signal(running.supervisor.id(), Signal::INT);
    wait_for("the supervisor to end", || running.supervisor.try_wait().unwrap());
    let took = started.elapsed();
    running.expect_orderly_end();
    assert!(running.none_runs(), "{:?}", running.pids);
    assert!(took < Duration::from_secs(1), "{took:?}");
    assert_eq!(running.group.files(), Vec::<std::path::PathBuf>::new());
}

#[test]
fn a_killed_stage_that_is_not_to_be_started_again_ends_the_run_and_is_named() {
    let _cores = shared();
    let mut running = Running::start_with("killed", &["--duration", "60s", "--set", "stage.ident-proc.restart=never"]);
    signal(running.pid(StageKind::IdentProc), Signal::KILL);
    let text = running.expect_end(1).stderr;
    assert!(text.contains("ident-proc killed by SIGKILL"), "{text}");
    assert!(running.none_runs());
    assert_eq!(running.group.files(), Vec::<std::path::PathBuf>::new());
}

#[test]
fn a_stopped_stage_in_lock_step_ends_the_run_after_a_bound() {
    let mut running = Running::start_with("stalled", &["--lockstep", "--duration", "100000s"]);
    signal(running.pid(StageKind::IdentProc), Signal::STOP);
    let text = running.expect_end(1).stderr;
    assert!(text.contains("no stage has worked for 10s") && text.contains("ident-proc"), "{text}");
    assert!(running.none_runs(), "a stopped stage is killed when it does not end");
    assert_eq!(running.group.files(), Vec::<std::path::PathBuf>::new());
}

#[test]
fn stages_do_not_outlive_a_killed_supervisor_and_the_next_run_cleans_up() {
    let _cores = shared();
    let mut running = Running::start("orphans");
    let started = Instant::now();
    signal(running.supervisor.id(), Signal::KILL);
    running.supervisor.wait().unwrap();
    wait_for("the stages to die with their supervisor", || running.none_runs().then_some(()));
    let took = started.elapsed();
    assert!(took < Duration::from_secs(1), "{took:?}");
    let again = ["run", "--prefix", &running.group.prefix.to_string(), "--lockstep", "--duration", "1s"];
    succeed(&again);
    assert_eq!(running.group.files(), Vec::<std::path::PathBuf>::new());
}

#[test]
fn stages_started_by_hand_find_each_other_and_the_last_one_leaves_nothing() {
    use StageKind::{ControlProc, IdentProc, PlantSim, SensorProc};
    for order in [[PlantSim, IdentProc, ControlProc, SensorProc], [ControlProc, SensorProc, PlantSim, IdentProc]] {
        let mut group = TestGroup::new("hand");
        for kind in order {
            group.start(kind, &["--lockstep", "--ticks", "300", "--arm"]);
        }
        group.expect_end();
        assert_eq!(group.files(), Vec::<std::path::PathBuf>::new());
    }
}

#[test]
fn a_late_reader_gets_the_current_snapshot() {
    let mut group = TestGroup::new("late");
    let channels = group.join();
    let readings = channels.publisher::<EncoderReading>().unwrap();
    let mut snapshots = channels.reader::<CoefficientSnapshot>().unwrap();
    group.start_all_but(StageKind::PlantSim, &["--lockstep"]);
    for sequence in 0..50 {
        let now = monotonic_ns();
        let header = Header { sequence, acquired_ns: now, sent_ns: now, axis_count: 4, ..Header::default() };
        readings.send(&EncoderReading { header, ..EncoderReading::default() }).unwrap();
        wait_for("the snapshot", || {
            readings.greet();
            snapshots.reach(sequence).unwrap().then_some(())
        });
    }
    // Nothing more is sent, so that the late reader gets the current snapshot.
    let mut late = channels.reader::<CoefficientSnapshot>().unwrap();
    let first = wait_for("the current snapshot", || late.read().unwrap().if_new().copied());
    assert_eq!(Some(&first), snapshots.last());
    assert_eq!(first.header.sequence, 49);
}

/// Median and 99th percentile of the time that one send takes.
fn send_times(publisher: &Publisher<EncoderSample>, sequence: &mut u64) -> (u64, u64) {
    let mut times: Vec<u64> = (0..20_000)
        .map(|_| {
            let mut sample = EncoderSample::default();
            sample.header.sequence = *sequence;
            *sequence += 1;
            let started = monotonic_ns();
            publisher.send(&sample).unwrap();
            monotonic_ns() - started
        })
        .collect();
    times.sort_unstable();
    (times[10_000], times[19_800])
}

#[test]
fn a_stopped_or_killed_reader_does_not_slow_a_writer() {
    let _cores = alone();
    let mut group = TestGroup::new("reader");
    let channels = group.join();
    let publisher = channels.publisher::<EncoderSample>().unwrap();
    // The reader is a stage: control-proc in lock-step, which reads one sample and waits for a snapshot.
    let mut health = channels.reader::<StageHealth>().unwrap();
    group.start(StageKind::ControlProc, &["--lockstep"]);
    let reader = wait_for("the reader", || health.read().unwrap().if_new().map(|health| health.pid));
    let mut sequence = 0;
    send_times(&publisher, &mut sequence);
    let living = send_times(&publisher, &mut sequence);
    signal(reader, Signal::STOP);
    let stopped = send_times(&publisher, &mut sequence);
    signal(reader, Signal::KILL);
    wait_for("the reader to die", || (!is_running(reader)).then_some(()));
    let killed = send_times(&publisher, &mut sequence);
    eprintln!("send, ns, p50 and p99: living {living:?}, stopped {stopped:?}, killed {killed:?}");
    // A writer that waited would take milliseconds. Medians of one run are compared.
    for (name, times) in [("stopped", stopped), ("killed", killed)] {
        assert!(times.0 < 5 * living.0.max(200), "{name}: {times:?} against {living:?}");
    }
}

#[test]
fn a_second_group_of_the_same_name_is_refused() {
    let _cores = shared();
    let running = Running::start("twice");
    let second =
        hydraxis().args(["run", "--duration", "1s", "--prefix", &running.group.prefix.to_string()]).output().unwrap();
    assert_eq!(second.status.code(), Some(1));
    let text = String::from_utf8_lossy(&second.stderr);
    assert!(text.contains("group") && text.contains("running"), "{text}");
    assert!(running.pids.iter().all(|pid| is_running(*pid)), "the first group goes on");
    assert!(!files(&running.group.prefix).is_empty(), "and keeps its memory");
}
