//! Faults of a CAN bus, its devices and messages, injected while an axis moves: it becomes neutral, and nothing goes on
//! by itself. The devices are those of `hydraxis can simulate` on a pseudo terminal.

use std::{
    path::Path,
    process::{Child, Stdio},
    time::Duration,
};

use pipeline::{
    channel::Reader,
    message::{EncoderReading, ValveCommand, control_flag},
    stage::StageKind,
};

use crate::{
    harness::{
        FOUR_AXES,
        bus::{self, Spoiled},
        channel::{AXES, await_message},
        hydraxis,
        running::Running,
        shared, wait_for,
    },
    source::PATIENT,
};

/// The boom moves by hand at this command: the program that drives it.
fn drive(devices: &mut Spoiled, prefix: &str, command: &str) -> Child {
    let words =
        ["operate", "--axis", "boom", "--mode", "manual", "--duration", "60s", "--enable", "--command", command];
    wait_for("an axis that moves", || {
        let _ = hydraxis().args(["reset", "--prefix", prefix]).output();
        devices.lines();
        let mut driving = hydraxis();
        driving.args(words).args(["--prefix", prefix]).stdout(Stdio::null()).stderr(Stdio::null());
        let mut driving = driving.spawn().unwrap();
        // On a busy computer its requests may be late, which ends it.
        while driving.try_wait().unwrap().is_none() {
            if devices.lines().iter().any(|line| line.ends_with("boom.valve: open")) {
                return Some(driving);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        None
    })
}

/// Waits until all devices are well now. A fault that a valve keeps is over once it was acknowledged.
fn await_well(readings: &mut Reader<EncoderReading>, prefix: &str) {
    wait_for("devices that are well", || {
        let _ = hydraxis().args(["reset", "--prefix", prefix]).output();
        let reading = readings.newest().unwrap().if_new()?;
        let is_well = reading.encoders[..AXES].iter().all(|value| value.error == 0) && reading.emergency_stop == 0;
        is_well.then_some(())
    });
}

/// Whatever happens to bus or devices while an axis moves: its valve becomes neutral, it is latched, and nothing opens
/// after that, also when all is well again, until it was acknowledged and armed.
fn expect_no_motion_after(test: &str, machine: &str, (at, more): (&Path, &[String]), faults: &[(&str, u32)]) {
    let _cores = shared();
    let mut devices = Spoiled::start(machine, at, more);
    let mut arguments = [&PATIENT[..], &["--duration", "10min", machine]].concat();
    arguments.extend(more.iter().map(String::as_str));
    let kinds = [StageKind::SensorProc, StageKind::IdentProc, StageKind::ControlProc];
    let mut running = Running::spawn(test, &arguments, &kinds, |_| ());
    let channels = running.group.join();
    let (mut readings, mut commands) = (channels.reader().unwrap(), channels.reader().unwrap());
    let prefix = running.group.prefix.to_string();
    for (i, (fault, cause)) in faults.iter().enumerate() {
        await_well(&mut readings, &prefix);
        let mut driving = drive(&mut devices, &prefix, if i % 2 == 0 { "0.6" } else { "-0.6" });
        // Those from before may show the fault before.
        commands.newest().unwrap();
        devices.spoil(fault);
        devices.await_line("boom.valve: neutral");
        await_message(&mut commands, fault, |command: &ValveCommand| command.axes[0].flags & cause != 0);
        std::thread::sleep(Duration::from_millis(500));
        devices.spoil(&format!("{} well", &fault[..fault.find(' ').unwrap()]));
        std::thread::sleep(Duration::from_secs(2));
        let opened: Vec<String> = devices.lines().into_iter().filter(|line| line.ends_with(": open")).collect();
        assert!(opened.is_empty(), "after {fault}: {opened:?}");
        let _ = driving.kill();
        driving.wait().unwrap();
    }
    let said = running.interrupt();
    assert!(said.stderr.contains(" foreign frames, "), "{}", said.stderr);
}

#[test]
fn no_axis_moves_after_a_fault_of_bus_or_devices_before_it_is_acknowledged() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path().join("bus");
    let faults = [
        "boom.encoder mute",
        "boom.encoder number 99",
        "boom.encoder number 12",
        "boom.valve restart",
        "boom.valve fail 5000",
        "bus off",
        "bus full",
        "bus unplugged",
    ]
    .map(|fault| (fault, control_flag::FEEDBACK));
    let more = bus::arguments(&bus::settings(&at));
    expect_no_motion_after("can-faults", FOUR_AXES, (&at, &more), &faults);
}

#[test]
fn no_axis_moves_after_a_fault_of_messages_before_it_is_acknowledged() {
    let folder = tempfile::tempdir().unwrap();
    let (at, machine) = (folder.path().join("bus"), folder.path().join("machine.toml"));
    let text = std::fs::read_to_string(FOUR_AXES).unwrap();
    std::fs::write(&machine, format!("{text}\n{}", bus::messages(&at))).unwrap();
    let feedback = [
        "boom.encoder mute",
        "boom.encoder hung",
        "boom.encoder wrong",
        "boom.valve mute",
        "machine cut-off",
        "bus unplugged",
    ]
    .map(|fault| (fault, control_flag::FEEDBACK));
    let faults = [&feedback[..], &[("machine stopped", control_flag::EMERGENCY_STOP)]].concat();
    let more = ["--set", "source.kind=can", "--set", "timing.drive_timeout=200ms"].map(str::to_owned);
    expect_no_motion_after("message-faults", machine.to_str().unwrap(), (&at, &more), &faults);
}
