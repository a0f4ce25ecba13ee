//! Sources and drives: what a group does with readings, whoever writes them. The same tests run against the simulated
//! machine, against a program that the supervisor starts, against one that is started by hand, and against devices on a
//! CAN bus. The program is plant-sim, which knows of no supervisor here; the devices are those of `hydraxis can
//! simulate` on a pseudo terminal. A recording takes the parts that need no controller: rate, times,
//! losses, a silence, and a restart.

use std::{
    fmt::Write,
    path::{Path, PathBuf},
    process::Child,
    time::Duration,
};

use pipeline::{
    channel::Reader,
    message::{ControlMode, EncoderReading, EncoderSample, StageHealth, ValveCommand, control_flag},
    stage::{StageKind, monotonic_ns},
};
use rustix::process::Signal;

use crate::harness::{
    FOUR_AXES,
    bus::{self, Devices},
    channel::{AXES, await_message},
    hydraxis,
    running::{Running, Said},
    shared, signal, wait_for,
};

/// So long that a busy computer does not latch the axes.
pub const PATIENT: [&str; 4] = ["--set", "timing.feedback_timeout=1s", "--set", "timing.period=20ms"];
const EXTERNAL: [&str; 2] = ["--set", "source.kind=external"];

/// Period of [`PATIENT`], ns.
const PERIOD_NS: u64 = 20_000_000;

/// Where the readings come from.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Writer<'w> {
    PlantSim,
    Started,
    ByHand,
    /// Devices on a CAN bus, at this link.
    Can(&'w Path),
    /// A recording.
    Replay(&'w Path),
}

/// A running group with its writer.
struct Rig {
    running: Running,
    by_hand: Option<Child>,
    /// Devices on a bus.
    devices: Option<Devices>,
    readings: Reader<EncoderReading>,
    samples: Reader<EncoderSample>,
    commands: Reader<ValveCommand>,
    health: Reader<StageHealth>,
}

impl Rig {
    fn start(test: &str, writer: Writer<'_>) -> Self {
        let recording = match writer {
            Writer::Replay(file) => format!("source.file=\"{}\"", file.display()),
            _ => String::new(),
        };
        let program = format!("source.command=[\"{}\", \"plant-sim\"]", env!("CARGO_BIN_EXE_hydraxis"));
        let mut arguments = PATIENT.to_vec();
        match writer {
            Writer::PlantSim => arguments.extend(["--off", "--duration", "10min"]),
            Writer::Started => arguments.extend([EXTERNAL[0], EXTERNAL[1], "--set", &program]),
            Writer::ByHand => arguments.extend(EXTERNAL),
            Writer::Can(_) => arguments.extend(["--duration", "10min"]),
            Writer::Replay(_) => arguments.extend(["--set", "source.kind=replay", "--set", &recording]),
        }
        let (mut on_bus, mut devices) = (Vec::new(), None);
        if let Writer::Can(at) = writer {
            on_bus = bus::arguments(&bus::settings(at));
            devices = Some(Devices::start(at));
        }
        arguments.extend(on_bus.iter().map(String::as_str));
        let kinds = [StageKind::SensorProc, StageKind::IdentProc, StageKind::ControlProc];
        let stages = if matches!(writer, Writer::Replay(_)) { &kinds[..2] } else { &kinds[..] };
        let running = Running::spawn(test, &arguments, stages, |_| ());
        let channels = running.group.join();
        let mut rig = Self {
            by_hand: None,
            devices,
            readings: channels.reader().unwrap(),
            samples: channels.reader().unwrap(),
            commands: channels.reader().unwrap(),
            health: channels.reader().unwrap(),
            running,
        };
        if writer == Writer::ByHand {
            rig.write_by_hand();
        }
        rig.command("a first command", |_| true);
        rig
    }

    fn write_by_hand(&mut self) {
        let mut command = hydraxis();
        let prefix = self.running.group.prefix.to_string();
        command.args(["plant-sim", FOUR_AXES, "--prefix", &prefix]).args(PATIENT);
        self.by_hand = Some(command.spawn().unwrap());
    }

    /// The process that writes.
    fn writer(&mut self) -> u32 {
        if let Some(child) = &self.by_hand {
            return child.id();
        }
        let health =
            await_message(&mut self.health, "a heartbeat", |health| health.stage == StageKind::PlantSim as u32);
        health.pid
    }

    fn command(&mut self, what: &str, is_it: impl FnMut(&ValveCommand) -> bool) -> ValveCommand {
        await_message(&mut self.commands, what, is_it)
    }

    /// `hydraxis` with the group's prefix.
    fn type_in(&self, words: &[&str]) -> String {
        let prefix = self.running.group.prefix.to_string();
        let output = hydraxis().args(words).args(["--prefix", &prefix]).output().unwrap();
        let text = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{words:?}: {text}");
        text
    }

    /// All axes hold.
    fn arm(&mut self) {
        self.type_in(&["arm", "--mode", "hold"]);
        self.command("axes that hold", |command| all(command, |flags| flags & control_flag::DISARMED == 0));
    }

    fn end(mut self) -> Said {
        if let Some(mut child) = self.by_hand.take() {
            signal(child.id(), Signal::INT);
            child.wait().unwrap();
        }
        self.running.interrupt()
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        if let Some(child) = &mut self.by_hand {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn all(command: &ValveCommand, is_so: impl Fn(u32) -> bool) -> bool {
    command.axes[..AXES].iter().all(|axis| is_so(axis.flags))
}

/// Nothing moves before it is armed.
fn expect_disarmed(rig: &mut Rig) {
    let command = rig.command("a command", |_| true);
    assert!(all(&command, |flags| flags & control_flag::DISARMED != 0));
    assert!(command.axes[..AXES].iter().all(|axis| axis.command == 0.0));
}

/// One sample for each period, but for those that a busy computer has skipped; none lost; times go on and are not those
/// of the future.
fn expect_samples(rig: &mut Rig) {
    let (mut last, mut count) = (0, 0);
    rig.samples.newest().unwrap();
    let first = rig.samples.last().copied().unwrap();
    let newest = await_message(&mut rig.samples, "samples of two seconds", |sample| {
        assert!(sample.header.acquired_ns >= last && sample.header.acquired_ns <= monotonic_ns());
        assert!(sample.header.sent_ns >= sample.header.acquired_ns);
        last = sample.header.acquired_ns;
        count += 1;
        sample.header.sequence >= first.header.sequence + 100
    });
    let took = newest.header.acquired_ns.saturating_sub(first.header.acquired_ns);
    assert!((1_900_000_000..2_300_000_000).contains(&took), "{took} ns for 100 samples");
    assert!(rig.samples.lost() == 0 && (50..=101).contains(&count), "{} lost, {count} read", rig.samples.lost());
}

fn expect_readings(rig: &mut Rig) {
    rig.readings.newest().unwrap();
    assert!(rig.readings.last().is_some_and(|reading| reading.header.axis_count as usize == AXES));
}

/// A writer that stops latches, and a writer that goes on releases nothing.
fn expect_timeout(rig: &mut Rig, writer: u32) {
    signal(writer, Signal::STOP);
    let is_latched = |flags: u32| flags & control_flag::FEEDBACK != 0;
    rig.command("a latch", |command| all(command, is_latched));
    // The supervisor starts a stage of its own again after 2 s without a heartbeat, and the latch came after 1 s.
    std::thread::sleep(Duration::from_millis(300));
    signal(writer, Signal::CONT);
    let until = monotonic_ns() + 500_000_000;
    rig.command("half a second after it", |command| {
        assert!(all(command, is_latched));
        command.header.sent_ns > until
    });
    let text = rig.type_in(&["reset"]);
    assert_eq!(text.matches("was latched by feedback").count(), AXES, "{text}");
}

fn expect_emergency_stop(rig: &mut Rig) {
    rig.type_in(&["disarm", "--emergency"]);
    rig.command("an emergency stop", |command| {
        command.cut_off == 1 && all(command, |flags| flags & control_flag::EMERGENCY_STOP != 0)
    });
    rig.type_in(&["reset"]);
}

/// Another life of the writer: readings come again, and the axes may be armed again.
fn expect_another_life(rig: &mut Rig, writer: u32) {
    signal(writer, Signal::KILL);
    if let Some(mut child) = rig.by_hand.take() {
        child.wait().unwrap();
        rig.write_by_hand();
    }
    wait_for("healthy samples", || {
        let sample = rig.samples.newest().unwrap().if_new()?;
        let is_healthy = sample.axes[..AXES].iter().all(|axis| axis.usable().is_some());
        (is_healthy && rig.readings.newest().unwrap().if_new().is_some()).then_some(())
    });
    rig.type_in(&["reset"]);
    rig.arm();
}

/// Rate, times, losses, arming, time-out, emergency stop and restart.
fn conform(test: &str, writer: Writer<'_>) -> Said {
    let _cores = shared();
    let mut rig = Rig::start(test, writer);
    expect_disarmed(&mut rig);
    expect_samples(&mut rig);
    expect_readings(&mut rig);
    rig.arm();
    let pid = rig.writer();
    expect_timeout(&mut rig, pid);
    rig.arm();
    expect_emergency_stop(&mut rig);
    // plant-sim under its own name ends the run, because a simulated machine would jump.
    if writer != Writer::PlantSim {
        expect_another_life(&mut rig, pid);
    }
    rig.end()
}

#[test]
fn the_simulated_machine_conforms() {
    let said = conform("conform-sim", Writer::PlantSim);
    assert!(!said.stderr.contains("source ("), "{}", said.stderr);
}

#[test]
fn a_program_that_the_supervisor_starts_conforms() {
    let said = conform("conform-started", Writer::Started);
    assert!(said.stderr.contains("plant-sim): no reading for the feedback time-out"), "{}", said.stderr);
    assert!(said.stderr.contains("plant-sim: started again"), "{}", said.stderr);
}

#[test]
fn a_program_that_is_started_by_hand_conforms() {
    let said = conform("conform-by-hand", Writer::ByHand);
    let name = "source (a program that is started by hand)";
    assert!(said.stderr.contains(&format!("{name}: no reading for the feedback time-out")), "{}", said.stderr);
    assert!(said.stderr.contains(&format!("{name}: well: ")), "{}", said.stderr);
}

#[test]
fn devices_on_a_can_bus_conform() {
    let folder = tempfile::tempdir().unwrap();
    let said = conform("conform-can", Writer::Can(&folder.path().join("bus")));
    assert!(said.stderr.contains("source (CAN bus "), "{}", said.stderr);
    assert!(said.stderr.contains("plant-sim: started again"), "{}", said.stderr);
}

/// The adapter is unplugged while the axes are armed, and plugged in again after some seconds.
#[test]
fn an_adapter_that_comes_back_arms_nothing() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path().join("bus");
    let mut rig = Rig::start("can-unplugged", Writer::Can(&at));
    rig.arm();
    rig.devices.take().unwrap().end();
    rig.command("a latch", |command| all(command, |flags| flags & control_flag::FEEDBACK != 0));
    std::thread::sleep(Duration::from_secs(4));
    rig.devices = Some(Devices::start(&at));
    rig.readings.newest().unwrap();
    await_message(&mut rig.readings, "readings of devices that are well", |reading| {
        reading.encoders[..AXES].iter().all(|value| value.error == 0)
    });
    rig.command("a second", |command| {
        assert!(command.axes[..AXES].iter().all(|axis| axis.command == 0.0), "{command:?}");
        all(command, |flags| flags & control_flag::FEEDBACK != 0)
    });
    rig.type_in(&["reset"]);
    rig.arm();
    let said = rig.end();
    assert!(said.stderr.contains(": the adapter is gone or the interface is down"), "{}", said.stderr);
    assert!(said.stderr.contains("; waits for it") && said.stderr.contains(": is back"), "{}", said.stderr);
}

#[test]
fn what_happens_is_told_with_time_axis_and_next_step() {
    let said = conform("conform-events", Writer::ByHand);
    for part in [
        " s axis.boom: mode: hold, after off",
        " s axis.boom: latch: feedback: found samples that are stale",
        "look at why, then type: hydraxis reset --prefix ",
        " s axis.boom: release: ",
        " s axis.boom: latch: emergency-stop: ",
    ] {
        assert!(said.stderr.contains(part), "{part}\n{}", said.stderr);
    }
}

#[test]
fn without_a_drive_no_controller_runs() {
    let _cores = shared();
    let program = format!("source.command=[\"{}\", \"plant-sim\"]", env!("CARGO_BIN_EXE_hydraxis"));
    let arguments = [&EXTERNAL[..], &["--set", "drive.kind=none", "--set", &program], &PATIENT].concat();
    let mut running = Running::spawn("no-drive", &arguments, &[StageKind::SensorProc, StageKind::IdentProc], |_| ());
    let channels = running.group.join();
    let mut samples: Reader<EncoderSample> = channels.reader().unwrap();
    await_message(&mut samples, "samples", |sample| sample.header.sequence > 20);
    assert_eq!(running.pid(StageKind::ControlProc), 0);
    drop((samples, channels));
    let said = running.interrupt();
    assert!(!said.stderr.contains("hydraxis arm"), "{}", said.stderr);
}

/// A recording of so many rows. All axes have its columns; the command tells the row.
fn recording(folder: &Path, rows: u32) -> PathBuf {
    let mut text = "t,u,y\n".to_owned();
    for row in 0..rows {
        let t = 1e-9 * PERIOD_NS as f64 * f64::from(row);
        writeln!(text, "{t:.3},{},{:.5}", command_of(row.into()), 0.6 + 0.1 * t.sin()).unwrap();
    }
    let file = folder.join("recording.csv");
    std::fs::write(&file, text).unwrap();
    file
}

/// The command of a row.
fn command_of(row: u64) -> f64 {
    row as f64 / 100_000.0
}

/// Commands are those of the recording, and no controller runs.
fn expect_recorded_commands(rig: &mut Rig) {
    for _ in 0..20 {
        let command = rig.command("a command of the recording", |_| true);
        let is_recorded = |axis: &pipeline::message::AxisCommand| {
            axis.mode == ControlMode::Replay as u32 && axis.command == command_of(command.header.sequence)
        };
        assert!(command.axes[..AXES].iter().all(is_recorded), "{command:?}");
    }
    assert_eq!(rig.running.pid(StageKind::ControlProc), 0);
    assert!(rig.readings.newest().unwrap().if_new().is_none());
}

/// A stage that gets no core for a second sends the rows of that second late. None is left out, and none is lost.
fn expect_late_rows(rig: &mut Rig) {
    let sensor = rig.running.pid(StageKind::SensorProc);
    signal(sensor, Signal::STOP);
    std::thread::sleep(Duration::from_secs(1));
    rig.samples.newest().unwrap();
    let mut before = rig.samples.last().copied().unwrap().header;
    assert!(monotonic_ns() - before.acquired_ns > 800_000_000, "a stopped stage sends nothing");
    signal(sensor, Signal::CONT);
    let end = before.sequence + 100;
    await_message(&mut rig.samples, "the rows that are late", |sample| {
        assert_eq!(sample.header.sequence, before.sequence + 1);
        assert!(sample.header.acquired_ns >= before.acquired_ns && sample.header.acquired_ns <= monotonic_ns());
        before = sample.header;
        before.sequence >= end
    });
    assert_eq!((rig.samples.lost(), rig.samples.restarts()), (0, 0));
}

/// After a restart the recording goes on at the row that is due by then.
fn expect_due_row(rig: &mut Rig) {
    rig.samples.newest().unwrap();
    let before = rig.samples.last().copied().unwrap().header;
    signal(rig.running.pid(StageKind::SensorProc), Signal::KILL);
    let next = await_message(&mut rig.samples, "the next life", |sample| sample.header.session != before.session);
    let rows = next.header.sequence.saturating_sub(before.sequence);
    let due = (next.header.acquired_ns - before.acquired_ns) / PERIOD_NS;
    assert!((rows..=rows + 25).contains(&due), "{rows} rows after {due} periods");
    assert!(rows >= 10, "{rows} rows: the first restart comes after 0.2 s");
    // The row that was due is read by a stage that had to start first; from then on rows are in time.
    let in_time = next.header.sequence + 50;
    rig.command("commands of the next life", |command| command.header.sequence >= in_time);
    expect_samples(rig);
}

#[test]
fn a_recording_conforms() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    let mut rig = Rig::start("conform-replay", Writer::Replay(&recording(folder.path(), 3000)));
    expect_recorded_commands(&mut rig);
    expect_samples(&mut rig);
    expect_late_rows(&mut rig);
    expect_due_row(&mut rig);
    let said = rig.end();
    assert!(said.stderr.contains("sensor-proc: started again"), "{}", said.stderr);
    assert!(!said.stderr.contains("source (") && !said.stderr.contains("hydraxis arm"), "{}", said.stderr);
}

#[test]
fn a_run_ends_with_the_last_row_of_its_recording() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    let file = format!("source.file=\"{}\"", recording(folder.path(), 200).display());
    let arguments = [&PATIENT[..], &["--set", "source.kind=replay", "--set", &file]].concat();
    let kinds = [StageKind::SensorProc, StageKind::IdentProc];
    let said = Running::spawn("replay-end", &arguments, &kinds, |_| ()).expect_end(0);
    assert!(said.stdout.contains("200 ticks, 4.0000 s of the machine in "), "{}", said.stdout);
    assert!(said.stdout.contains(": 0 lost."), "{}", said.stdout);
}
