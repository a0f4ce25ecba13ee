//! A machine whose positions, commands and interlocks are frames of a data base of its own, in simulated time:
//! start-up, motion, and every fault of a message.

use std::sync::LazyLock;

use can::{
    Frame, Received,
    device::{
        AxisDevices, AxisFrames, AxisState, AxisTarget, Cause, Demand, Fault, FrameDrive, FrameDriveSettings, Frames,
        Network, Receiver, SetPoint, SignalPosition,
    },
    frames::{Checksum, Database, Guard, Signal, Verdict},
};
use embedded_can::Frame as _;
use proptest::prelude::*;

const AXES: usize = 2;
const MS: u64 = 1_000_000;
const CYCLE_MS: u64 = 10;
const TIMEOUT_MS: u64 = 50;

const DBC: &str = "VERSION \"\"\n\nNS_ :\n\nBS_:\n\nBU_: Machine PC\n\n\
    BO_ 2566848512 Angles: 8 Machine\n SG_ Boom : 0|16@1- (0.0001,0) [0|0] \"rad\" PC\n \
    SG_ Arm : 16|16@1- (0.0001,0) [0|0] \"rad\" PC\n SG_ Alive : 56|8@1+ (1,0) [0|255] \"\" PC\n\n\
    BO_ 2566848513 State: 8 Machine\n SG_ Lock : 0|1@1+ (1,0) [0|1] \"\" PC\n SG_ Pilot : 1|1@1+ (1,0) [0|1] \"\" PC\n \
    SG_ Stop : 2|1@1+ (1,0) [0|1] \"\" PC\n SG_ Pressure : 8|8@1+ (0.2,0) [0|0] \"MPa\" PC\n \
    SG_ Rod : 16|8@1+ (0.2,0) [0|0] \"MPa\" PC\n\n\
    BO_ 2566848514 Levers: 8 PC\n SG_ Boom : 0|16@1- (0.001,0) [-1|1] \"\" Machine\n \
    SG_ Arm : 16|16@1- (0.001,0) [-1|1] \"\" Machine\n SG_ Enable : 32|2@1+ (1,0) [0|2] \"\" Machine\n \
    SG_ Alive : 40|8@1+ (1,0) [0|255] \"\" Machine\n SG_ Check : 48|8@1+ (1,0) [0|255] \"\" Machine\n";

fn database() -> &'static Database {
    static DATABASE: LazyLock<Database> = LazyLock::new(|| Database::parse(DBC).unwrap());
    &DATABASE
}

fn signal(name: &str) -> Signal {
    database().signal(name).unwrap().1.signal
}

fn frames() -> Frames {
    let database = database();
    let message = |name: &str| database.message(name).unwrap().clone();
    let alive = Guard { counter: Some(signal("Angles.Alive")), checksum: None };
    let angles = Receiver::new(message("Angles").layout, alive, 3 * CYCLE_MS * MS);
    let state = Receiver::new(message("State").layout, Guard::default(), 100 * MS);
    let set_point = |axis, name, scale| SetPoint {
        axis,
        signal: signal(name),
        scale,
        direction: None,
        active: (1, signal("State.Lock")),
    };
    let enable = signal("Levers.Enable");
    let drive = FrameDrive::new(FrameDriveSettings {
        message: message("Levers"),
        guard: Guard { counter: Some(signal("Levers.Alive")), checksum: Some((6, Checksum::Crc8J1850)) },
        set_points: vec![set_point(0, "Levers.Boom", 1.0), set_point(1, "Levers.Arm", -0.5)],
        active: vec![(enable, 1.0)],
        neutral: vec![(enable, 0.0)],
        off: vec![(enable, 2.0)],
        timeout_ns: TIMEOUT_MS * MS,
        period_ns: 0,
    });
    let position = |name, is_reversed, zero| AxisFrames {
        position: Some(SignalPosition { source: (0, signal(name)), is_reversed, zero }),
        pressures: Some([((1, signal("State.Pressure")), 1e6), ((1, signal("State.Rod")), 1e6)]),
    };
    Frames {
        receivers: vec![angles, state],
        drives: vec![drive],
        axes: vec![position("Angles.Boom", false, 0), position("Angles.Arm", true, 100)],
        emergency_stop: Some((1, signal("State.Stop"))),
        pilot: Some((1, signal("State.Pilot"))),
        ..Frames::default()
    }
}

/// What is wrong with the machine.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Flaw {
    MuteAngles,
    MuteState,
    HungCounter,
    NoTimeout,
    /// The drive hears nothing.
    Deaf,
    Short,
    PilotOff,
    Stopped,
}

/// The machine: valves that follow the levers, with a time-out of their own.
struct Machine {
    openings: [f64; AXES],
    heard_ns: u64,
    last_count: Option<i64>,
    enabled: bool,
    off: bool,
    alive: i64,
    raw: [i64; AXES],
    flaw: Option<Flaw>,
    refused: u64,
}

impl Machine {
    fn take(&mut self, frame: &Frame, now_ns: u64) {
        if frame.raw_id() != database().message("Levers").unwrap().layout.id || self.flaw == Some(Flaw::Deaf) {
            return;
        }
        let guard = Guard { counter: Some(signal("Levers.Alive")), checksum: Some((6, Checksum::Crc8J1850)) };
        let mut last = self.last_count;
        let verdict = guard.judge(frame.data(), &mut last);
        self.last_count = last;
        if verdict != Verdict::Good(0) {
            self.refused += 1;
            return;
        }
        self.heard_ns = now_ns;
        let enable = signal("Levers.Enable").raw(frame.data()).unwrap();
        (self.enabled, self.off) = (enable == 1, enable == 2);
        let value = |name| signal(name).value(frame.data()).unwrap();
        self.openings = if self.enabled { [value("Levers.Boom"), value("Levers.Arm")] } else { [0.0; AXES] };
    }

    fn step(&mut self, now_ns: u64) -> Vec<Frame> {
        if now_ns - self.heard_ns > TIMEOUT_MS * MS && self.flaw != Some(Flaw::NoTimeout) {
            (self.enabled, self.openings) = (false, [0.0; AXES]);
        }
        let mut frames = Vec::new();
        if !now_ns.is_multiple_of(CYCLE_MS * MS) {
            return frames;
        }
        let frame = |name: &str, data: [u8; 8], length: usize| {
            let id = embedded_can::ExtendedId::new(database().message(name).unwrap().layout.id).unwrap();
            Frame::new(id, &data[..length]).unwrap()
        };
        if self.flaw != Some(Flaw::MuteAngles) {
            self.alive += i64::from(self.flaw != Some(Flaw::HungCounter));
            let mut data = [0; 8];
            signal("Angles.Boom").put_raw(self.raw[0], &mut data);
            signal("Angles.Arm").put_raw(self.raw[1], &mut data);
            signal("Angles.Alive").put_raw(self.alive, &mut data);
            frames.push(frame("Angles", data, if self.flaw == Some(Flaw::Short) { 5 } else { 8 }));
        }
        if self.flaw != Some(Flaw::MuteState) {
            let mut data = [0; 8];
            signal("State.Lock").put_raw(i64::from(self.enabled), &mut data);
            signal("State.Pilot").put_raw(i64::from(self.flaw != Some(Flaw::PilotOff)), &mut data);
            signal("State.Stop").put_raw(i64::from(self.flaw == Some(Flaw::Stopped)), &mut data);
            signal("State.Pressure").put(12.0, &mut data);
            frames.push(frame("State", data, 8));
        }
        frames
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Mode {
    Disarmed,
    Latched,
    Armed(f64),
}

struct Bench {
    network: Network,
    machine: Machine,
    modes: [Mode; AXES],
    is_alive: bool,
    now_ns: u64,
    /// Numbers of frames of the levers that were sent.
    sent: u64,
}

impl Bench {
    fn new() -> Self {
        let devices = vec![AxisDevices { encoder: None, valve: None }; AXES];
        Self {
            network: Network::with_frames(devices, frames()),
            machine: Machine {
                openings: [0.0; AXES],
                heard_ns: 0,
                last_count: None,
                enabled: false,
                off: false,
                alive: 0,
                raw: [0; AXES],
                flaw: None,
                refused: 0,
            },
            modes: [Mode::Disarmed; AXES],
            is_alive: true,
            now_ns: 1_000_000_000,
            sent: 0,
        }
    }

    fn ready() -> Self {
        let mut bench = Self::new();
        bench.run(500);
        assert_eq!(bench.faults(), [None; AXES]);
        bench
    }

    fn step(&mut self) {
        self.now_ns += MS;
        for frame in self.machine.step(self.now_ns) {
            self.network.take(&Received { frame, time_ns: self.now_ns }, self.now_ns);
        }
        if self.is_alive && self.now_ns.is_multiple_of(5 * MS) {
            self.network.begin(self.now_ns);
        }
        if self.is_alive && self.now_ns.is_multiple_of(CYCLE_MS * MS) {
            let targets = self.modes.map(|mode| match mode {
                Mode::Armed(command) => AxisTarget { demand: Demand::Follow(command), state: AxisState::Following },
                Mode::Latched => AxisTarget { demand: Demand::Hold, state: AxisState::Latched },
                Mode::Disarmed => AxisTarget { demand: Demand::Hold, state: AxisState::Disarmed },
            });
            self.network.command(Some(&targets), self.now_ns);
            if self.network.is_ready(self.now_ns, CYCLE_MS * MS) {
                self.network.take_sample(self.now_ns);
            }
        }
        let frames: Vec<Frame> = self.network.outbox().frames().to_vec();
        self.network.outbox().clear();
        for frame in frames.iter().filter(|_| self.is_alive) {
            self.sent += 1;
            self.machine.take(frame, self.now_ns);
        }
    }

    fn run(&mut self, milliseconds: u32) {
        (0..milliseconds).for_each(|_| self.step());
    }

    fn until(&mut self, what: &str, is_so: impl Fn(&Self) -> bool) -> u32 {
        for passed in 0..30_000 {
            if is_so(self) {
                return passed;
            }
            self.step();
        }
        panic!("{what}: not within 30 s; {:?}", self.faults());
    }

    fn faults(&self) -> [Option<Fault>; AXES] {
        std::array::from_fn(|axis| Fault::of(self.network.reading(axis).unwrap().1))
    }

    fn cause(&self) -> Option<Cause> {
        self.faults()[0].map(|fault| fault.cause)
    }

    fn drive(&mut self) {
        self.modes = [Mode::Armed(0.5), Mode::Armed(0.25)];
        self.run(30);
        assert_eq!(self.machine.openings, [0.5, -0.125]);
    }

    /// The machine comes to neutral for this cause, and moves again only after it was acknowledged and armed.
    fn expect_stop_and_recovery(&mut self, flaw: Flaw, cause: Cause, within_ms: u32) {
        self.machine.flaw = Some(flaw);
        let passed = self.until("neutral", |bench| bench.cause() == Some(cause) && bench.machine.openings[0] == 0.0);
        assert!(passed <= within_ms, "{flaw:?}: {passed} ms");
        self.run(500);
        self.machine.flaw = None;
        self.run(500);
        assert_eq!(self.machine.openings[0], 0.0, "{flaw:?}");
        self.modes = [Mode::Latched; AXES];
        self.run(500);
        assert_eq!(self.machine.openings, [0.0; AXES]);
        self.modes = [Mode::Disarmed; AXES];
        self.until("well", |bench| bench.faults() == [None; AXES]);
        assert_eq!(self.machine.openings, [0.0; AXES]);
        self.drive();
    }
}

#[test]
fn positions_pressures_and_commands_are_signals() {
    let mut bench = Bench::new();
    assert_eq!(bench.cause(), Some(Cause::Absent));
    let passed = bench.until("ready", |bench| bench.faults() == [None; AXES]);
    // The proof alone takes the drive's time-out.
    assert!((50..300).contains(&passed), "{passed} ms");
    bench.machine.raw = [-1234, 40];
    bench.run(20);
    assert_eq!((bench.network.reading(0), bench.network.reading(1)), (Some((Some(-1234), 0)), Some((Some(60), 0))));
    assert_eq!(bench.network.pressures(1), Some([12e6, 0.0]));
    bench.drive();
    bench.run(300);
    assert_eq!((bench.machine.refused, bench.network.counters().foreign), (0, 0));
    // Off at the end.
    bench.network.end(bench.now_ns);
    bench.is_alive = false;
    let last = bench.network.outbox().frames().to_vec();
    last.iter().for_each(|frame| bench.machine.take(frame, bench.now_ns));
    assert_eq!((bench.machine.openings, bench.machine.off), ([0.0; AXES], true));
}

#[test]
fn nothing_moves_before_it_is_armed() {
    let mut bench = Bench::new();
    for _ in 0..1000 {
        bench.step();
        assert_eq!(bench.machine.openings, [0.0; AXES]);
    }
    for (command, expected) in [(7.0, 1.0), (-7.0, -1.0), (f64::NAN, 0.0), (f64::INFINITY, 0.0)] {
        bench.modes[0] = Mode::Armed(command);
        bench.run(20);
        assert_eq!(bench.machine.openings[0], expected, "{command}");
    }
}

#[test]
fn a_drive_whose_time_out_does_not_act_is_refused() {
    let mut bench = Bench::new();
    bench.machine.flaw = Some(Flaw::NoTimeout);
    bench.run(1000);
    assert_eq!(bench.cause(), Some(Cause::Proof));
    bench.modes = [Mode::Armed(0.5); AXES];
    for _ in 0..500 {
        bench.step();
        assert_eq!(bench.machine.openings, [0.0; AXES]);
    }
    bench.machine.flaw = None;
    bench.modes = [Mode::Disarmed; AXES];
    bench.until("well", |bench| bench.faults() == [None; AXES]);
    bench.drive();
}

#[test]
fn every_fault_of_a_message_stops_the_axes() {
    let mut bench = Bench::ready();
    bench.drive();
    // The time-out of the message, a cycle of it, and one of the bus.
    bench.expect_stop_and_recovery(Flaw::MuteAngles, Cause::Stale, 45);
    bench.expect_stop_and_recovery(Flaw::HungCounter, Cause::Counter, 45);
    bench.expect_stop_and_recovery(Flaw::Short, Cause::Checksum, 45);
    bench.expect_stop_and_recovery(Flaw::MuteState, Cause::Stale, 115);
    bench.expect_stop_and_recovery(Flaw::PilotOff, Cause::Pilot, 12);
    bench.machine.flaw = Some(Flaw::Stopped);
    bench.run(12);
    assert!(bench.network.is_stopped());
}

#[test]
fn a_message_that_does_not_come_twice_is_missing_in_the_sample_and_stops_no_axis() {
    let mut bench = Bench::ready();
    bench.drive();
    let openings = bench.machine.openings;
    bench.machine.flaw = Some(Flaw::MuteAngles);
    let readings: Vec<_> = (0..2 * CYCLE_MS).map(|_| (bench.run(1), bench.network.reading(0)).1).collect();
    assert!(readings.contains(&Some((None, 0))), "{readings:?}");
    bench.machine.flaw = None;
    bench.run(2 * CYCLE_MS as u32);
    assert_eq!((bench.cause(), bench.machine.openings), (None, openings));
}

#[test]
fn a_drive_that_has_stopped_by_itself_does_not_go_on_by_itself() {
    let mut bench = Bench::ready();
    bench.drive();
    // Its time-out, the message that says so, and a cycle of the bus.
    bench.expect_stop_and_recovery(Flaw::Deaf, Cause::Valve, TIMEOUT_MS as u32 + CYCLE_MS as u32 + 6);
    // It hears again right after that fault is due.
    bench.machine.flaw = Some(Flaw::Deaf);
    bench.run(2 * TIMEOUT_MS as u32 + CYCLE_MS as u32 + 6);
    bench.machine.flaw = None;
    for _ in 0..1000 {
        bench.step();
        assert_eq!(bench.machine.openings, [0.0; AXES]);
    }
    assert_eq!(bench.cause(), Some(Cause::Valve));
}

/// Regression: one that was back within its time-out went on moving.
#[test]
fn a_drive_that_stops_for_a_moment_does_not_go_on_by_itself() {
    for deaf_ms in ((TIMEOUT_MS + CYCLE_MS) as u32 + 1..2 * TIMEOUT_MS as u32 + 20).step_by(3) {
        let mut bench = Bench::ready();
        bench.drive();
        bench.machine.flaw = Some(Flaw::Deaf);
        bench.run(deaf_ms);
        assert_eq!(bench.machine.openings, [0.0; AXES], "its own time-out");
        bench.machine.flaw = None;
        for _ in 0..1000 {
            bench.step();
            // What was sent before the drive has said that it stopped is over with the next message.
            let is_told = bench.cause() == Some(Cause::Valve);
            assert!(!is_told || bench.machine.openings == [0.0; AXES], "{deaf_ms} ms");
        }
        assert_eq!(bench.cause(), Some(Cause::Valve), "{deaf_ms} ms");
        bench.modes = [Mode::Disarmed; AXES];
        bench.until("well", |bench| bench.faults() == [None; AXES]);
        bench.drive();
    }
}

/// Regression: the last message before a sample decided.
#[test]
fn an_emergency_stop_that_is_over_before_the_sample_counts() {
    let mut bench = Bench::ready();
    for flaw in [Some(Flaw::Stopped), None] {
        bench.machine.flaw = flaw;
        let at = bench.now_ns.next_multiple_of(CYCLE_MS * MS);
        for frame in bench.machine.step(at) {
            bench.network.take(&Received { frame, time_ns: at }, at);
        }
    }
    assert!(bench.network.is_stopped());
    bench.network.take_sample(bench.now_ns);
    assert!(!bench.network.is_stopped(), "released, and the sample has told of it");
}

#[test]
fn set_points_of_somebody_else_stop_the_axes() {
    let mut bench = Bench::ready();
    bench.drive();
    let id = embedded_can::ExtendedId::new(database().message("Levers").unwrap().layout.id).unwrap();
    let foreign = Received { frame: Frame::new(id, &[0; 8]).unwrap(), time_ns: bench.now_ns };
    bench.network.take(&foreign, bench.now_ns);
    bench.run(2);
    assert_eq!((bench.cause(), bench.machine.openings), (Some(Cause::Sender), [0.0; AXES]));
    bench.run(500);
    bench.modes = [Mode::Disarmed; AXES];
    bench.until("well", |bench| bench.faults() == [None; AXES]);
    bench.drive();
}

#[test]
fn a_master_that_dies_leaves_it_to_the_time_out_of_the_drive() {
    let mut bench = Bench::ready();
    bench.drive();
    bench.is_alive = false;
    let passed = bench.until("neutral", |bench| bench.machine.openings == [0.0; AXES]);
    assert!(passed <= TIMEOUT_MS as u32 + 1, "{passed} ms");
}

#[test]
fn a_bus_that_was_gone_is_proven_anew() {
    let mut bench = Bench::ready();
    bench.drive();
    bench.network.lose_bus(bench.now_ns);
    assert_eq!(bench.cause(), Some(Cause::Bus));
    for _ in 0..1000 {
        bench.step();
        assert!(bench.cause().is_some());
    }
    assert_eq!(bench.machine.openings, [0.0; AXES]);
    bench.modes = [Mode::Disarmed; AXES];
    bench.until("well", |bench| bench.faults() == [None; AXES]);
    bench.drive();
}

#[test]
fn a_message_that_does_not_come_holds_up_the_other_axes_once() {
    let receiver = |name: &str| Receiver::new(database().message(name).unwrap().layout, Guard::default(), 1000 * MS);
    let position = |receiver, name| AxisFrames {
        position: Some(SignalPosition { source: (receiver, signal(name)), is_reversed: false, zero: 0 }),
        pressures: None,
    };
    let frames = Frames {
        receivers: vec![receiver("Angles"), receiver("State")],
        axes: vec![position(0, "Angles.Boom"), position(1, "State.Rod")],
        patience_ns: 10 * MS,
        ..Frames::default()
    };
    let mut network = Network::with_frames(vec![AxisDevices { encoder: None, valve: None }; 2], frames);
    let mut waited = Vec::new();
    for ms in 0..100_u64 {
        for name in ["Angles", "State"].iter().filter(|name| ms % 10 == 0 && (**name == "Angles" || ms < 50)) {
            let id = embedded_can::ExtendedId::new(database().message(name).unwrap().layout.id).unwrap();
            let frame = Frame::new(id, &[0; 8]).unwrap();
            network.take(&Received { frame, time_ns: ms * MS }, ms * MS);
        }
        if network.is_ready(ms * MS, 5 * MS) {
            let (begun, _) = (network.take_sample(ms * MS), network.begin(ms * MS));
            waited.push(ms - begun / MS);
        }
    }
    assert_eq!(waited, [0, 0, 0, 0, 0, 1, 0, 0, 0, 0], "the last position came at 40 ms");
}

/// An auxiliary valve of ISO 11783-7: flow without a sign, a direction, at most every 100 ms.
fn auxiliary_valve() -> (Network, u32) {
    let database = Database::parse(
        "VERSION \"\"\n\nNS_ :\n\nBS_:\n\nBU_: T V\n\nBO_ 2365468710 AV0: 8 T\n \
         SG_ Flow : 0|8@1+ (0.4,0) [0|100] \"%\" V\n SG_ State : 16|4@1+ (1,0) [0|15] \"\" V\n \
         SG_ FailSafe : 22|2@1+ (1,0) [0|3] \"\" V\n\nBO_ 2365460518 AV0E: 8 V\n SG_ On : 0|1@1+ (1,0) [0|1] \"\" T\n",
    )
    .unwrap();
    let signal = |name: &str| database.signal(name).unwrap().1.signal;
    let settings = FrameDriveSettings {
        message: database.message("AV0").unwrap().clone(),
        guard: Guard::default(),
        set_points: vec![SetPoint {
            axis: 0,
            signal: signal("AV0.Flow"),
            scale: 100.0,
            direction: Some(signal("AV0.State")),
            active: (0, signal("AV0E.On")),
        }],
        active: vec![(signal("AV0.FailSafe"), 0.0)],
        neutral: Vec::new(),
        off: Vec::new(),
        timeout_ns: 400 * MS,
        period_ns: 100 * MS,
    };
    let receiver = Receiver::new(database.message("AV0E").unwrap().layout, Guard::default(), 300 * MS);
    let frames = Frames { receivers: vec![receiver], drives: vec![FrameDrive::new(settings)], ..Frames::default() };
    let network = Network::with_frames(vec![AxisDevices { encoder: None, valve: None }], frames);
    (network, database.message("AV0E").unwrap().layout.id)
}

#[test]
fn a_set_point_without_a_sign_has_a_direction() {
    let (mut network, id) = auxiliary_valve();
    let id = embedded_can::ExtendedId::new(id).unwrap();
    let (mut heard_ns, mut seen) = (0, Vec::new());
    for ms in 1..6000_u64 {
        let now_ns = ms * MS;
        if ms.is_multiple_of(50) {
            let is_on = u8::from(heard_ns > 0 && now_ns - heard_ns < 400 * MS);
            let frame = Frame::new(id, &[is_on, 0, 0, 0, 0, 0, 0, 0]).unwrap();
            network.take(&Received { frame, time_ns: now_ns }, now_ns);
        }
        if ms.is_multiple_of(10) {
            network.begin(now_ns);
            let (demand, state) = match ms {
                3000.. => (Demand::Follow(-0.5), AxisState::Following),
                2000.. => (Demand::Follow(0.25), AxisState::Following),
                _ => (Demand::Hold, AxisState::Disarmed),
            };
            network.command(Some(&[AxisTarget { demand, state }]), now_ns);
        }
        for frame in network.outbox().frames() {
            heard_ns = now_ns;
            seen.push((ms, [frame.data()[0], frame.data()[2]]));
        }
        network.outbox().clear();
    }
    assert_eq!(network.reading(0).unwrap().1, 0, "{:?}", Fault::of(network.reading(0).unwrap().1));
    // Nothing before it is armed; 25 % = 62.5 of 0.4 %, extend; then 50 % = 125 of them, retract.
    assert!(seen.iter().all(|(ms, data)| *ms >= 2000 || *data == [0, 0]));
    let first = seen.iter().find(|(ms, _)| *ms >= 2500).unwrap();
    assert_eq!((first.1, seen.last().unwrap().1), ([63, 1], [125, 2]));
    assert!(seen.windows(2).all(|pair| pair[1].0 - pair[0].0 >= 100), "{seen:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20))]

    #[test]
    fn random_frames_move_nothing(
        frames in prop::collection::vec((any::<bool>(), any::<[u8; 8]>(), 0_usize..=8), 300)
    ) {
        let mut bench = Bench::ready();
        let ids = ["Angles", "State"].map(|name| database().message(name).unwrap().layout.id);
        for (i, (which, data, length)) in frames.into_iter().enumerate() {
            let id = embedded_can::ExtendedId::new(ids[usize::from(which)]).unwrap();
            let frame = Frame::new(id, &data[..length]).unwrap();
            bench.network.take(&Received { frame, time_ns: bench.now_ns }, bench.now_ns);
            if i % 5 == 0 { bench.step(); }
            prop_assert_eq!(bench.machine.openings, [0.0; AXES]);
        }
    }
}
