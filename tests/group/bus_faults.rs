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

/// Bus, machine file and settings of a group with its devices.
struct Setting {
    folder: tempfile::TempDir,
    machine: String,
    more: Vec<String>,
}

impl Setting {
    /// The axes of [`FOUR_AXES`] by CANopen. `is_busy`: with the times of a busy computer.
    fn canopen(is_busy: bool) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mut settings = bus::settings(&folder.path().join("bus"));
        settings.retain(|(key, _)| is_busy || !bus::TIMES.contains(&key.as_str()));
        Self { folder, machine: FOUR_AXES.to_owned(), more: bus::arguments(&settings) }
    }

    /// The axes of [`FOUR_AXES`] by messages of a machine of its own. `is_busy`: with the times of a busy computer.
    fn messages(is_busy: bool) -> Self {
        let drive_timeout = is_busy.then_some("timing.drive_timeout=200ms");
        Self::of_tables(bus::messages, drive_timeout.into_iter().map(str::to_owned))
    }

    /// The axes of [`FOUR_AXES`] by auxiliary valves of J1939. `is_busy`: with the times of a busy computer.
    fn auxiliary_valves(is_busy: bool) -> Self {
        let example = include_str!("../../examples/auxiliary-valves.toml");
        let tables = |at: &Path| example.replacen("\"can0\"", &format!("\"{}\"", at.display()), 1);
        let drive_timeout = if is_busy { "800ms" } else { "200ms" };
        Self::of_tables(tables, [format!("timing.drive_timeout={drive_timeout}")])
    }

    /// The axes of [`FOUR_AXES`] with the tables of a bus at this path, and more settings.
    fn of_tables(tables: impl Fn(&Path) -> String, more: impl IntoIterator<Item = String>) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let machine = folder.path().join("machine.toml");
        let text = std::fs::read_to_string(FOUR_AXES).unwrap();
        std::fs::write(&machine, format!("{text}\n{}", tables(&folder.path().join("bus")))).unwrap();
        let settings = ["source.kind=can".to_owned()].into_iter().chain(more);
        let more = settings.flat_map(|setting| ["--set".to_owned(), setting]).collect();
        Self { folder, machine: machine.to_str().unwrap().to_owned(), more }
    }

    /// Starts the devices, and a group with these further arguments.
    fn start(&self, test: &str, times: &[&str]) -> (Spoiled, Running) {
        let devices = Spoiled::start(&self.machine, &self.folder.path().join("bus"), &self.more);
        let mut arguments = [times, &["--duration", "20min", &self.machine]].concat();
        arguments.extend(self.more.iter().map(String::as_str));
        let kinds = [StageKind::SensorProc, StageKind::IdentProc, StageKind::ControlProc];
        (devices, Running::spawn(test, &arguments, &kinds, |_| ()))
    }
}

/// Ends a fault.
fn mend(devices: &mut Spoiled, fault: &str) {
    devices.spoil(&format!("{} well", &fault[..fault.find(' ').unwrap()]));
}

/// Whatever happens to bus or devices while an axis moves: its valve becomes neutral, it is latched, and nothing opens
/// after that, also when all is well again, until it was acknowledged and armed.
fn expect_no_motion_after(test: &str, setting: &Setting, faults: &[(&str, u32)]) {
    let _cores = shared();
    let (mut devices, mut running) = setting.start(test, &PATIENT);
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
        mend(&mut devices, fault);
        std::thread::sleep(Duration::from_secs(2));
        let opened: Vec<String> = devices.lines().into_iter().filter(|line| line.ends_with(": open")).collect();
        assert!(opened.is_empty(), "after {fault}: {opened:?}");
        let _ = driving.kill();
        driving.wait().unwrap();
    }
    let said = running.interrupt();
    assert!(said.stderr.contains(" foreign frames, "), "{}", said.stderr);
}

const OF_DEVICES: [&str; 8] = [
    "boom.encoder mute",
    "boom.encoder number 99",
    "boom.encoder number 12",
    "boom.valve restart",
    "boom.valve fail 5000",
    "bus off",
    "bus full",
    "bus unplugged",
];
const OF_MESSAGES: [&str; 6] = [
    "boom.encoder mute",
    "boom.encoder hung",
    "boom.encoder wrong",
    "boom.valve mute",
    "machine cut-off",
    "bus unplugged",
];

#[test]
fn no_axis_moves_after_a_fault_of_bus_or_devices_before_it_is_acknowledged() {
    let faults = OF_DEVICES.map(|fault| (fault, control_flag::FEEDBACK));
    expect_no_motion_after("can-faults", &Setting::canopen(true), &faults);
}

#[test]
fn no_axis_moves_after_a_fault_of_messages_before_it_is_acknowledged() {
    let feedback = OF_MESSAGES.map(|fault| (fault, control_flag::FEEDBACK));
    let faults = [&feedback[..], &[("machine stopped", control_flag::EMERGENCY_STOP)]].concat();
    expect_no_motion_after("message-faults", &Setting::messages(true), &faults);
}

/// Prints how long after each fault the valve of the moving axis is neutral, ms: minimum, median and maximum. The group
/// has its usual times, and SCHED_FIFO where that is allowed.
fn print_times(test: &str, setting: &Setting, faults: &[&str]) {
    const TIMES: usize = 10;
    const LONGEST: f64 = 1000.0;
    let priorities: Vec<String> =
        StageKind::ALL.iter().map(|stage| format!("stage.{}.priority=50", stage.name())).collect();
    let settings: Vec<&str> = priorities.iter().flat_map(|priority| ["--set", priority]).collect();
    let (mut devices, mut running) = setting.start(test, &settings);
    let channels = running.group.join();
    let mut readings = channels.reader().unwrap();
    let prefix = running.group.prefix.to_string();
    for fault in faults {
        let mut times: Vec<f64> = (0..TIMES)
            .map(|i| {
                await_well(&mut readings, &prefix);
                let mut driving = drive(&mut devices, &prefix, if i % 2 == 0 { "0.6" } else { "-0.6" });
                devices.spoil(fault);
                let line = devices.await_line("boom.valve: neutral");
                mend(&mut devices, fault);
                let _ = driving.kill();
                driving.wait().unwrap();
                line.split("neutral, ").nth(1).and_then(|after| after.split(' ').next()?.parse().ok()).unwrap()
            })
            .collect();
        times.sort_by(f64::total_cmp);
        println!("{fault}: {:.0}, {:.0}, {:.0} ms", times[0], times[TIMES / 2], times[TIMES - 1]);
        assert!(times[TIMES - 1] < LONGEST, "{fault}: {times:?}");
    }
    running.interrupt();
}

#[test]
fn no_axis_moves_after_a_fault_of_auxiliary_valves_before_it_is_acknowledged() {
    let faults = ["boom.encoder mute", "boom.valve mute", "bus unplugged"].map(|fault| (fault, control_flag::FEEDBACK));
    expect_no_motion_after("auxiliary-faults", &Setting::auxiliary_valves(true), &faults);
}

#[test]
#[ignore = "takes ten minutes, and cores that others leave alone"]
fn how_long_after_a_fault_of_the_bus_a_valve_is_neutral() {
    let more = ["boom.valve mute", "boom.encoder restart", "boom.encoder emergency 5000"];
    let devices = [&OF_DEVICES[..], &more, &["boom.encoder alarm 1", "boom.encoder double"]].concat();
    print_times("can-times", &Setting::canopen(false), &devices);
    print_times("auxiliary-times", &Setting::auxiliary_valves(false), &["boom.encoder mute", "boom.valve mute"]);
    print_times("message-times", &Setting::messages(false), &[&OF_MESSAGES[..], &["machine stopped"]].concat());
}
