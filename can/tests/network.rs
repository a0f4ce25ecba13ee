//! A master and simulated devices on one bus, in simulated time: start-up, motion, and every fault.

use can::{
    Frame, Received,
    canopen::{Emergency, NodeId},
    device::{
        AxisDevices, AxisState, AxisTarget, Cause, Demand, Encoder, EncoderSettings, Fault, Network, NodeTiming,
        Outbox, PositionObject, Proof, Valve, ValveSettings,
    },
    simulated::{Flaw, SimulatedEncoder, SimulatedValve},
};
use embedded_can::Frame as _;
use proptest::prelude::*;

const AXES: usize = 2;
const MS: u64 = 1_000_000;
const SYNC_NS: u64 = 5 * MS;
const HEARTBEAT_NS: u64 = 50 * MS;
const TIMEOUT_MS: u16 = 50;
const FULL_SCALE: i16 = 16384;

fn node(number: usize) -> NodeId {
    NodeId::new(number as u8).unwrap()
}

fn encoder_settings(axis: usize) -> EncoderSettings {
    SimulatedEncoder::settings(node(10 + axis))
}

fn valve_settings(axis: usize) -> ValveSettings {
    SimulatedValve::settings(node(20 + axis), FULL_SCALE)
}

/// What the controller does with an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Mode {
    Disarmed,
    Latched,
    Settling,
    Armed(f64),
}

struct Bench {
    network: Network,
    encoders: Vec<SimulatedEncoder>,
    valves: Vec<SimulatedValve>,
    modes: [Mode; AXES],
    /// Whether the controller says anything.
    is_commanding: bool,
    /// Whether the master is there.
    is_alive: bool,
    now_ns: u64,
    /// Frames from the devices.
    replies: Outbox,
    sent: u64,
}

impl Bench {
    fn with(adapt: impl Fn(&mut EncoderSettings, &mut ValveSettings)) -> Self {
        let timing = NodeTiming { heartbeat_ns: HEARTBEAT_NS, answer_ns: 100 * MS };
        let devices = (0..AXES).map(|axis| {
            let (mut encoder, mut valve) = (encoder_settings(axis), valve_settings(axis));
            adapt(&mut encoder, &mut valve);
            let valve = Some(Valve::new(valve, timing).unwrap());
            AxisDevices { encoder: Some(Encoder::new(encoder, timing).unwrap()), valve }
        });
        Self {
            network: Network::new(devices.collect()),
            encoders: (0..AXES)
                .map(|axis| SimulatedEncoder::new(node(10 + axis), PositionObject::Position, 50))
                .collect(),
            valves: (0..AXES).map(|axis| SimulatedValve::new(node(20 + axis), FULL_SCALE)).collect(),
            modes: [Mode::Disarmed; AXES],
            is_commanding: true,
            is_alive: true,
            now_ns: 1_000_000_000,
            replies: Outbox::default(),
            sent: 0,
        }
    }

    fn new() -> Self {
        Self::with(|_, _| {})
    }

    /// A bench whose devices are all ready.
    fn ready() -> Self {
        let mut bench = Self::new();
        bench.run(1000);
        assert_eq!(bench.faults(), [None; AXES]);
        bench
    }

    fn targets(&self) -> [AxisTarget; AXES] {
        self.modes.map(|mode| match mode {
            Mode::Armed(command) => AxisTarget { demand: Demand::Follow(command), state: AxisState::Following },
            Mode::Settling => AxisTarget { demand: Demand::Follow(0.0), state: AxisState::Settling },
            Mode::Latched => AxisTarget { demand: Demand::Hold, state: AxisState::Latched },
            Mode::Disarmed => AxisTarget { demand: Demand::Hold, state: AxisState::Disarmed },
        })
    }

    /// Hands the frames of the master to the devices, and theirs to the master, until there are none.
    fn exchange(&mut self) {
        for _ in 0..100 {
            let frames: Vec<Frame> = self.network.outbox().frames().to_vec();
            self.network.outbox().clear();
            self.sent += frames.len() as u64;
            for frame in frames.iter().filter(|_| self.is_alive) {
                self.encoders.iter_mut().for_each(|encoder| encoder.take(frame, &mut self.replies));
                self.valves.iter_mut().for_each(|valve| valve.take(frame, self.now_ns, &mut self.replies));
            }
            let replies: Vec<Frame> = self.replies.frames().to_vec();
            self.replies.clear();
            if replies.is_empty() && frames.is_empty() {
                return;
            }
            for frame in replies.iter().filter(|_| self.is_alive) {
                self.network.take(&Received { frame: *frame, time_ns: self.now_ns }, self.now_ns);
            }
        }
        panic!("frames without an end");
    }

    /// One millisecond.
    fn step(&mut self) {
        self.now_ns += MS;
        for i in 0..AXES {
            self.encoders[i].step(self.now_ns, &mut self.replies);
            self.valves[i].step(self.now_ns, &mut self.replies);
        }
        if self.now_ns.is_multiple_of(SYNC_NS) && self.is_alive {
            if self.network.is_over(self.now_ns, SYNC_NS) {
                self.network.take_sample(self.now_ns - SYNC_NS);
            }
            self.network.begin(self.now_ns);
        }
        self.exchange();
        if self.now_ns.is_multiple_of(2 * SYNC_NS) && self.is_alive {
            let targets = self.is_commanding.then(|| self.targets());
            self.network.command(targets.as_ref().map(|targets| &targets[..]), self.now_ns);
        }
        self.exchange();
    }

    fn run(&mut self, milliseconds: u32) {
        (0..milliseconds).for_each(|_| self.step());
    }

    /// Milliseconds until something is so.
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

    fn cause(&self, axis: usize) -> Option<Cause> {
        self.faults()[axis].map(|fault| fault.cause)
    }

    /// Both axes follow.
    fn drive(&mut self) {
        self.modes = [Mode::Armed(0.5), Mode::Armed(-0.25)];
        self.run(20);
        assert_eq!(self.openings(), [0.5, -0.25]);
    }

    /// Both axes follow again, once they are well.
    fn drive_again(&mut self) {
        self.modes = [Mode::Disarmed; AXES];
        self.until("well", |bench| bench.faults() == [None; AXES]);
        self.drive();
    }

    fn openings(&self) -> [f64; AXES] {
        std::array::from_fn(|axis| self.valves[axis].opening())
    }

    /// The first axis has come to neutral for this cause, and the second one goes on. When the fault is over and a
    /// person has acknowledged it, the axis can be driven again, and does not move before.
    fn expect_stop(&mut self, cause: Cause, within_ms: u32) {
        let passed = self.until("neutral", |bench| bench.openings()[0] == 0.0 && bench.cause(0).is_some());
        assert!(passed <= within_ms, "{passed} ms");
        assert_eq!((self.cause(0), self.openings()[1]), (Some(cause), -0.25));
        // The controller has not noticed yet: nothing moves.
        self.run(1500);
        assert!(self.cause(0).is_some() && self.openings()[0] == 0.0, "{:?}", self.faults());
    }

    fn expect_recovery(&mut self) {
        self.modes[0] = Mode::Latched;
        self.run(1500);
        assert_eq!(self.openings()[0], 0.0);
        self.modes[0] = Mode::Disarmed;
        self.until("well", |bench| bench.cause(0).is_none());
        assert_eq!(self.openings()[0], 0.0);
        self.modes[0] = Mode::Armed(0.75);
        self.run(20);
        assert_eq!(self.openings(), [0.75, -0.25]);
    }
}

#[test]
fn devices_are_set_up_and_proven_and_positions_are_read() {
    let mut bench = Bench::new();
    assert_eq!(bench.cause(0), Some(Cause::Absent));
    let passed = bench.until("ready", |bench| bench.faults() == [None; AXES]);
    // The proof alone takes the drive's time-out.
    assert!((50..500).contains(&passed), "{passed} ms");
    for axis in 0..AXES {
        assert_eq!(bench.network.devices(axis).unwrap().valve.as_ref().unwrap().proof(), Proof::Passed);
    }
    for counts in [0, 12_345, -7, i64::from(i32::MAX)] {
        bench.encoders[1].set_counts(counts);
        bench.run(5);
        assert_eq!(bench.network.reading(1), Some((Some(counts), 0)));
    }
    assert_eq!((bench.network.counters().foreign, bench.network.outbox().dropped()), (0, 0));
}

#[test]
fn a_position_that_does_not_come_is_missing_in_the_sample_and_holds_no_axis() {
    let mut bench = Bench::ready();
    bench.drive();
    let trips = bench.network.counters().trips;
    bench.encoders[0].spoil(Some(Flaw::Mute));
    // Two SYNC without a position; the sample of the first is taken at the second, and that of the second at the next.
    bench.until("missing", |bench| bench.network.reading(0) == Some((None, 0)));
    assert_eq!((bench.faults(), bench.openings()), ([None; AXES], [0.5, -0.25]));
    assert!(bench.network.reading(1).is_some_and(|(counts, _)| counts.is_some()));
    bench.encoders[0].spoil(None);
    bench.run(2 * (SYNC_NS / MS) as u32);
    assert_eq!((bench.faults(), bench.openings()), ([None; AXES], [0.5, -0.25]));
    assert_eq!(bench.network.counters().trips, trips);
}

#[test]
fn an_axis_that_settles_moves_by_no_set_point() {
    let mut bench = Bench::ready();
    bench.drive();
    bench.is_commanding = false;
    let settling = AxisTarget { demand: Demand::Follow(0.5), state: AxisState::Settling };
    bench.network.command(Some(&[settling; AXES]), bench.now_ns);
    bench.run(2);
    assert_eq!(bench.openings(), [0.0; AXES]);
}

#[test]
fn nothing_moves_before_it_is_armed_and_everything_stops_at_the_end() {
    let mut bench = Bench::new();
    for _ in 0..1000 {
        bench.step();
        assert_eq!(bench.openings(), [0.0; AXES]);
    }
    bench.drive();
    bench.network.end(bench.now_ns);
    bench.exchange();
    assert_eq!(bench.openings(), [0.0; AXES]);
}

#[test]
fn a_master_that_is_started_beside_an_armed_controller_moves_nothing() {
    let mut bench = Bench::new();
    bench.modes = [Mode::Armed(0.5); AXES];
    for _ in 0..2000 {
        bench.step();
        assert_eq!(bench.openings(), [0.0; AXES]);
    }
    // An armed controller sees that nothing follows it.
    assert!(bench.faults().iter().all(Option::is_some));
    bench.modes = [Mode::Disarmed; AXES];
    bench.run(20);
    assert_eq!(bench.faults(), [None; AXES]);
    bench.drive();
}

#[test]
fn an_axis_that_is_armed_while_its_devices_are_set_up_follows_once_they_are_ready() {
    let mut bench = Bench::new();
    bench.modes = [Mode::Settling; AXES];
    bench.until("ready", |bench| bench.faults() == [None; AXES]);
    bench.drive();
}

#[test]
fn a_fault_of_an_axis_that_settles_holds_it_until_the_controller_has_latched_it() {
    let mut bench = Bench::ready();
    bench.drive();
    // However short it is: the controller latches at its third reading of it.
    for flaw in [Flaw::Mute, Flaw::Double] {
        bench.modes[0] = Mode::Settling;
        bench.run(20);
        bench.encoders[0].spoil(Some(flaw));
        bench.until("a fault", |bench| bench.cause(0).is_some());
        bench.encoders[0].spoil(None);
        bench.run(500);
        assert!(bench.cause(0).is_some());
        bench.modes[0] = Mode::Armed(0.5);
        bench.run(100);
        assert!(bench.cause(0).is_some());
        assert_eq!(bench.openings(), [0.0, -0.25]);
        for mode in [Mode::Latched, Mode::Disarmed, Mode::Settling] {
            bench.modes[0] = mode;
            bench.run(100);
            assert_eq!(bench.cause(0), None);
        }
        bench.drive();
    }
    bench.modes[0] = Mode::Settling;
    bench.run(20);
    bench.encoders[0].restart();
    bench.until("a fault", |bench| bench.cause(0).is_some());
    bench.run(500);
    assert_eq!((bench.cause(0), bench.openings()[0]), (Some(Cause::Restart), 0.0));
}

#[test]
fn a_fault_that_is_over_before_a_person_arms_the_axis_again_blocks_it_no_longer() {
    let mut bench = Bench::ready();
    bench.drive();
    bench.encoders[0].spoil(Some(Flaw::Mute));
    bench.until("a fault", |bench| bench.cause(0).is_some());
    for mode in [Mode::Latched, Mode::Disarmed] {
        bench.modes[0] = mode;
        bench.run(20);
        assert!(bench.cause(0).is_some(), "it stands");
    }
    bench.encoders[0].spoil(None);
    bench.until("well", |bench| bench.cause(0).is_none());
    bench.modes[0] = Mode::Settling;
    bench.run(20);
    assert_eq!((bench.cause(0), bench.openings()[0]), (None, 0.0));
    bench.drive();
}

#[test]
fn commands_beyond_the_range_and_those_that_are_no_numbers_are_bounded() {
    let mut bench = Bench::ready();
    for (command, expected) in [(7.0, 1.0), (-7.0, -1.0), (f64::NAN, 0.0), (f64::INFINITY, 0.0), (1e-9, 0.0)] {
        bench.modes[0] = Mode::Armed(command);
        bench.run(20);
        assert_eq!(bench.openings()[0], expected, "{command}");
    }
}

#[test]
fn a_controller_that_is_silent_holds_the_valves() {
    let mut bench = Bench::ready();
    bench.drive();
    bench.is_commanding = false;
    bench.run(11);
    assert_eq!(bench.openings(), [0.0; AXES]);
    assert_eq!(bench.faults(), [None; AXES]);
}

#[test]
fn a_master_that_dies_leaves_it_to_the_time_out_of_the_drive() {
    let mut bench = Bench::ready();
    bench.drive();
    bench.is_alive = false;
    let passed = bench.until("neutral", |bench| bench.openings() == [0.0; AXES]);
    assert!(passed <= u32::from(TIMEOUT_MS) + 6, "{passed} ms");
}

#[test]
fn a_valve_whose_time_out_does_not_act_is_refused() {
    let mut bench = Bench::new();
    bench.valves[0].spoil(Some(Flaw::NoTimeout));
    bench.run(1000);
    assert_eq!((bench.cause(0), bench.cause(1)), (Some(Cause::Proof), None));
    bench.modes = [Mode::Armed(0.5); AXES];
    bench.run(100);
    assert_eq!(bench.openings(), [0.0, 0.5]);
    // Repaired, and acknowledged.
    bench.valves[0].spoil(None);
    bench.modes[0] = Mode::Disarmed;
    bench.until("well", |bench| bench.cause(0).is_none());
}

#[test]
fn a_missing_heartbeat_stops_the_axis() {
    let mut bench = Bench::ready();
    bench.drive();
    bench.encoders[0].spoil(Some(Flaw::Mute));
    // Three positions are missed before the heartbeat is: one and a half of its periods.
    bench.expect_stop(Cause::Silent, 25);
    bench.encoders[0].spoil(None);
    bench.expect_recovery();
    bench.valves[0].spoil(Some(Flaw::Mute));
    bench.expect_stop(Cause::Heartbeat, 80);
    bench.valves[0].spoil(None);
    bench.expect_recovery();
}

#[test]
fn a_device_that_restarts_stops_the_axis_and_is_set_up_again() {
    let mut bench = Bench::ready();
    bench.drive();
    bench.encoders[0].restart();
    bench.expect_stop(Cause::Restart, 2);
    bench.expect_recovery();
    bench.valves[0].restart();
    bench.expect_stop(Cause::Restart, 2);
    bench.expect_recovery();
}

#[test]
fn an_emergency_or_an_alarm_stops_the_axis() {
    let mut bench = Bench::ready();
    bench.drive();
    bench.encoders[0].emergency(0x5000, &mut bench.replies);
    bench.expect_stop(Cause::Emergency, 1);
    bench.encoders[0].emergency(0, &mut bench.replies);
    bench.expect_recovery();
    bench.encoders[0].alarm(1);
    bench.expect_stop(Cause::Alarm, 5);
    bench.encoders[0].alarm(0);
    bench.expect_recovery();
}

#[test]
fn a_valve_with_a_fault_stops_the_axis_and_is_reset_once_it_is_acknowledged() {
    let mut bench = Bench::ready();
    bench.drive();
    bench.valves[0].fail(0x6300, &mut bench.replies);
    bench.expect_stop(Cause::Emergency, 1);
    bench.expect_recovery();
}

/// Set point 0 and hold, by somebody else.
fn foreign_hold() -> Frame {
    Frame::standard(0x200 + u16::from(node(20).number()), [3, 0, 0, 0])
}

#[test]
fn a_valve_that_stops_for_a_moment_does_not_go_on_by_itself() {
    let mut bench = Bench::ready();
    bench.drive();
    // This program hears nothing of it.
    bench.valves[0].take(&foreign_hold(), bench.now_ns, &mut bench.replies);
    bench.expect_stop(Cause::Valve, 6);
    bench.expect_recovery();
}

#[test]
fn set_points_of_somebody_else_hold_the_axis() {
    let mut bench = Bench::ready();
    bench.drive();
    let foreign = Received { frame: foreign_hold(), time_ns: bench.now_ns };
    bench.network.take(&foreign, bench.now_ns);
    bench.expect_stop(Cause::Sender, 1);
    bench.expect_recovery();
}

#[test]
fn a_spool_that_is_stuck_open_is_found() {
    let mut bench = Bench::ready();
    bench.drive();
    bench.valves[0].stick(Some(0.3));
    // Less far out than commanded is no fault.
    bench.run(1000);
    assert_eq!(bench.cause(0), None);
    bench.modes[0] = Mode::Armed(-0.2);
    let passed = bench.until("a fault", |bench| bench.cause(0) == Some(Cause::Spool));
    assert!((490..=520).contains(&passed), "{passed} ms");
    bench.valves[0].stick(None);
    bench.expect_recovery();
}

#[test]
fn two_devices_of_one_number_are_found() {
    let mut bench = Bench::ready();
    bench.drive();
    bench.encoders[0].spoil(Some(Flaw::Double));
    bench.expect_stop(Cause::Double, 30);
    bench.encoders[0].spoil(None);
    bench.expect_recovery();
}

#[test]
fn a_device_of_another_profile_or_scale_is_refused() {
    let mut bench = Bench::with(|encoder, _| {
        if encoder.node == node(10) {
            encoder.node = node(21);
        } else {
            encoder.step = Some(100);
        }
    });
    bench.run(1000);
    assert_eq!(bench.faults()[1], Some(Fault { cause: Cause::Scale, node: 11, detail: 50 }));
    assert_eq!(bench.faults()[0], Some(Fault { cause: Cause::Profile, node: 21, detail: 408 }));
}

#[test]
fn a_bus_that_was_gone_leaves_all_axes_held() {
    let mut bench = Bench::ready();
    bench.drive();
    bench.network.lose_bus(bench.now_ns);
    assert_eq!([bench.cause(0), bench.cause(1)], [Some(Cause::Bus); AXES]);
    // The drives stop by themselves or by the configuration, and nothing goes on.
    bench.run(60);
    for _ in 0..2000 {
        bench.step();
        assert_eq!(bench.openings(), [0.0; AXES]);
    }
    bench.drive_again();
}

#[test]
fn an_emergency_that_stands_is_not_forgotten_with_the_bus() {
    let mut bench = Bench::ready();
    bench.drive();
    bench.encoders[0].emergency(0x5000, &mut bench.replies);
    bench.expect_stop(Cause::Emergency, 1);
    bench.network.lose_bus(bench.now_ns);
    bench.modes = [Mode::Disarmed; AXES];
    bench.until("the other axis is well", |bench| bench.cause(1).is_none());
    bench.modes = [Mode::Armed(0.5), Mode::Disarmed];
    for _ in 0..2000 {
        bench.step();
        assert!(bench.openings()[0] == 0.0 && bench.cause(0).is_some(), "{:?}", bench.faults());
    }
    bench.modes[0] = Mode::Disarmed;
    bench.until("emergency", |bench| bench.cause(0) == Some(Cause::Emergency));
    bench.encoders[0].emergency(0, &mut bench.replies);
    bench.drive_again();
}

#[test]
fn an_emergency_whose_end_was_lost_is_asked_for_once_it_is_acknowledged() {
    let mut bench = Bench::ready();
    bench.drive();
    // A frame that no device has sent.
    let frame = Emergency { code: 0x5000, register: 1, maker: [0; 5] }.frame(node(10));
    bench.network.take(&Received { frame, time_ns: bench.now_ns }, bench.now_ns);
    bench.expect_stop(Cause::Emergency, 1);
    bench.expect_recovery();
}

#[test]
fn a_setting_that_is_not_kept_is_named() {
    // 65 s do not fit into the object.
    let timing = NodeTiming { heartbeat_ns: HEARTBEAT_NS, answer_ns: 100 * MS };
    let mut bench = Bench::new();
    // The position of 64 bits and a fixed mapping of 32 bits.
    let settings = EncoderSettings {
        object: PositionObject::HighPrecision,
        has_alarms: false,
        is_fixed: true,
        ..encoder_settings(0)
    };
    let encoder = Encoder::new(settings, timing).unwrap();
    bench.network = Network::new(vec![AxisDevices { encoder: Some(encoder), valve: None }]);
    bench.run(300);
    let fault = Fault::of(bench.network.reading(0).unwrap().1).unwrap();
    assert_eq!((fault.cause, fault.detail), (Cause::Setting, 0x1A00));
    let settings = EncoderSettings { object: PositionObject::HighPrecision, ..encoder_settings(0) };
    assert!(Encoder::new(settings, timing).is_err(), "64 bits and alarms are no message");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20))]

    /// Frames of a babbling device: no panic, and no valve that moves against its controller.
    #[test]
    fn random_frames_move_nothing(
        frames in prop::collection::vec((0_u16..0x800, any::<[u8; 8]>(), 0_usize..=8), 500), seed: u16
    ) {
        let mut bench = Bench::ready();
        for (i, (id, data, length)) in frames.into_iter().enumerate() {
            // Half of them are about the devices.
            let id = if i % 2 == 0 { (id & 0x780) | (10 + (seed ^ id) % 12) } else { id };
            let frame = Frame::standard_of(id, data, length);
            prop_assert!(frame.dlc() <= 8);
            bench.network.take(&Received { frame, time_ns: bench.now_ns }, bench.now_ns);
            bench.exchange();
            if i % 5 == 0 {
                bench.step();
            }
            prop_assert_eq!(bench.openings(), [0.0; AXES]);
        }
        prop_assert_eq!(bench.network.outbox().dropped(), 0);
    }
}
