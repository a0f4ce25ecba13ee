//! Four axes that move the bucket's teeth together.

use mechanism::AXES;
use pipeline::{
    machine::{Machine, ReferenceSource, TipPiece, TipShape, TipTask, TipWithout},
    message::{AxisMode, Request, ValveCommand, control_flag, sample_fault},
};

use super::sample;
use crate::{Controller, tip::TipPlan};

/// Axes that are where their references were a tick before.
struct Ideal {
    controller: Controller,
    plan: TipPlan,
    positions: [f64; AXES],
    sequence: u64,
    /// An axis whose encoder has failed.
    failed: Option<usize>,
    /// How far the bucket drifts from its reference within 1 s, m: slowly enough for an axis at rest.
    beside: f64,
    /// Amplitude with which the bucket swings about its reference once in a second, m.
    swing: f64,
    /// How far the axes lag in the middle of their way to the begin, m.
    lag: f64,
}

impl Ideal {
    fn new() -> Self {
        let mut machine = Machine::load(None, &[]).unwrap();
        let pieces = vec![TipPiece { shape: TipShape::Line([5.7, 0.0]), pitch: None, free: None }];
        machine.tip = Some(TipTask {
            start: [7.2, 0.0],
            pitch: -115.0,
            speed: 0.5,
            free: None,
            rounding: 0.0,
            file: None,
            pieces,
            without: TipWithout::default(),
        });
        machine.axes.iter_mut().for_each(|axis| axis.reference = ReferenceSource::Tip);
        let plan = TipPlan::of(&machine).unwrap().unwrap();
        let first: Vec<f64> = (0..AXES).map(|axis| plan.points(axis)[0].1).collect();
        let positions = std::array::from_fn(|i| first[i] + 0.02 * (i as f64 - 1.0));
        let controller = Controller::new(&machine).unwrap();
        Self { controller, plan, positions, sequence: 0, failed: None, beside: 0.0, swing: 0.0, lag: 0.0 }
    }

    fn tick(&mut self) -> ValveCommand {
        let mut sample = sample(self.sequence, &self.positions);
        if let Some(axis) = self.failed {
            sample.axes[axis].faults = sample_fault::ENCODER;
        }
        let command = self.controller.update(&sample, None, None);
        for (position, axis) in self.positions.iter_mut().zip(&command.axes) {
            *position = axis.reference;
        }
        self.positions[3] -= self.beside * (self.sequence as f64 / 100.0).min(1.0);
        self.positions[3] += self.swing * (0.02 * std::f64::consts::PI * self.sequence as f64).sin();
        let part = ((self.sequence as f64 - 20.0) / 150.0).clamp(0.0, 1.0);
        let lag = self.lag * (std::f64::consts::PI * part).sin().powi(2);
        self.positions.iter_mut().for_each(|position| *position -= lag);
        self.sequence += 1;
        command
    }

    fn go_on(&mut self, ticks: usize) {
        for _ in 0..ticks {
            self.tick();
        }
    }

    /// The next tick, with a request for this mode of these axes.
    fn ask(&mut self, axes: impl IntoIterator<Item = usize>, mode: AxisMode) -> ValveCommand {
        let mut request = Request { session: 1, ..Request::default() };
        request.header.axis_count = AXES as u32;
        (request.header.sequence, request.header.number) = (self.sequence.saturating_sub(1), self.sequence + 1);
        axes.into_iter().for_each(|axis| request.axes[axis].mode = mode as u32);
        self.controller.ask(&request);
        self.tick()
    }

    /// Ticks until the teeth are on their way, 1000 at most.
    fn await_way(&mut self) -> usize {
        let on_the_way = |controller: &Controller| controller.on_the_way().is_some_and(|(start, now)| now >= start);
        (0..1000)
            .take_while(|_| {
                self.tick();
                !on_the_way(&self.controller)
            })
            .count()
    }
}

#[test]
fn the_axes_begin_together_once_all_of_them_are_at_the_begin_and_trace_the_plan() {
    let mut ideal = Ideal::new();
    ideal.controller.arm();
    let waited = ideal.await_way();
    // 0.2 s to settle, 2 s to the begin of the way, 1.5 s there, and the preview.
    assert!((360..550).contains(&waited), "{waited}");
    let ticks = (ideal.plan.duration() / 0.01) as usize;
    for k in 0..ticks {
        for axis in 0..AXES {
            let planned = ideal.plan.points(axis)[k].1;
            assert!((ideal.positions[axis] - planned).abs() < 1e-3, "{axis} {k}");
        }
        ideal.tick();
    }
}

/// Ticks from arming until the teeth are on their way.
fn waited(mut ideal: Ideal) -> usize {
    ideal.controller.arm();
    ideal.await_way()
}

#[test]
fn an_axis_that_comes_no_closer_begins_late_and_one_that_is_far_away_never() {
    let waited = |beside: f64| waited(Ideal { beside, ..Ideal::new() });
    let in_time = waited(1.8e-3);
    assert!(in_time < 520, "{in_time}");
    for beside in [2.5e-3, 9.5e-3] {
        let late = waited(beside);
        assert!((450..=550).contains(&(late - in_time)), "{beside} m: {late} and {in_time} ticks");
    }
    assert_eq!(waited(10.5e-3), 1000);
}

#[test]
fn an_axis_that_passes_the_begin_of_the_way_has_not_come_to_it() {
    let waited = |swing: f64| waited(Ideal { swing, ..Ideal::new() });
    let still = waited(0.0);
    assert!(waited(1e-3) < still + 50);
    // Within 2 mm for no longer than 0.23 s.
    let late = waited(3e-3);
    assert!((450..=550).contains(&(late - still)), "{late} and {still} ticks");
}

/// All axes go to the begin at once, and the pump cannot give what they ask for.
#[test]
fn what_an_axis_lacks_on_its_way_to_the_begin_is_not_made_good_on_the_way() {
    let commands = |lag: f64| {
        let mut ideal = Ideal { lag, ..Ideal::new() };
        // Every axis comes to the begin in the direction in which it goes on.
        for (axis, position) in ideal.positions.iter_mut().enumerate() {
            let points = ideal.plan.points(axis);
            *position = points[0].1 - 0.05 * (points[50].1 - points[0].1).signum();
        }
        ideal.controller.arm();
        let errors = (0..170).map(|_| ideal.tick().axes[1].error.abs()).fold(0.0, f64::max);
        assert!(errors >= 0.9 * lag.abs(), "{errors} m");
        ideal.await_way();
        (0..200).map(|_| ideal.tick().axes.map(|axis| axis.command)).collect::<Vec<_>>()
    };
    let usual = commands(0.0);
    for axis in 1..AXES {
        assert!(usual.iter().any(|commands| commands[axis].abs() > 0.4), "{axis}");
        for lag in [-0.05, 0.05] {
            let off = commands(lag).iter().zip(&usual).map(|(a, b)| (a[axis] - b[axis]).abs()).fold(0.0, f64::max);
            assert!(off < 1e-3, "{axis}, {lag} m: {off}");
        }
    }
}

/// One second after arming, on the way to the begin.
#[test]
fn an_axis_that_stops_before_the_begin_stops_the_others_as_well() {
    let stopped = |stop: &dyn Fn(&mut Ideal)| {
        let mut ideal = Ideal::new();
        // 0.2 m to the begin.
        ideal.positions = std::array::from_fn(|i| ideal.plan.points(i)[0].1 - 0.2);
        ideal.controller.arm();
        ideal.go_on(100);
        stop(&mut ideal);
        let before = ideal.positions;
        let command = (0..300).map(|_| ideal.tick()).last().unwrap();
        for axis in 0..3 {
            assert_eq!(command.axes[axis].operation, AxisMode::Hold as u32, "{axis}");
            assert!((ideal.positions[axis] - before[axis]).abs() < 0.05, "{axis}: {before:?}, {:?}", ideal.positions);
        }
        let stand = ideal.positions;
        ideal.tick();
        assert_eq!(ideal.positions[..3], stand[..3]);
        ideal
    };
    stopped(&|ideal| _ = ideal.ask([3], AxisMode::Manual));
    stopped(&|ideal| _ = ideal.ask([3], AxisMode::Hold));
    let mut ideal = stopped(&|ideal| ideal.failed = Some(3));
    ideal.failed = None;
    ideal.controller.disarm();
    ideal.controller.arm();
    assert!(ideal.await_way() < 1000);
}

#[test]
fn axes_whose_references_are_far_ahead_stop_where_they_are() {
    let stopped = |stop: &dyn Fn(&mut Ideal)| {
        let mut ideal = Ideal { lag: 0.06, ..Ideal::new() };
        ideal.positions = std::array::from_fn(|i| ideal.plan.points(i)[0].1 - 0.2);
        ideal.controller.arm();
        ideal.go_on(95);
        let before = ideal.positions;
        assert!(ideal.tick().axes.iter().take(AXES).all(|axis| axis.error > 0.05), "{before:?}");
        ideal.lag = 0.0;
        stop(&mut ideal);
        let command = (0..300).map(|_| ideal.tick()).last().unwrap();
        for axis in 0..3 {
            assert_eq!(command.axes[axis].operation, AxisMode::Hold as u32, "{axis}");
            assert!((ideal.positions[axis] - before[axis]).abs() < 0.05, "{axis}: {before:?}, {:?}", ideal.positions);
        }
    };
    stopped(&|ideal| _ = ideal.ask([3], AxisMode::Off));
    stopped(&|ideal| _ = ideal.ask(0..AXES, AxisMode::Hold));
}

#[test]
fn an_axis_that_tracks_alone_stands_until_all_of_them_do() {
    let mut ideal = Ideal::new();
    ideal.controller.arm();
    ideal.ask(0..3, AxisMode::Hold);
    let stand = ideal.positions;
    ideal.go_on(300);
    let command = ideal.ask([0], AxisMode::Track);
    assert_eq!(command.axes[3].operation, AxisMode::Track as u32);
    ideal.go_on(300);
    assert_eq!(ideal.positions, stand);
    ideal.ask([1, 2], AxisMode::Track);
    assert!((300..900).contains(&ideal.await_way()));
    for axis in 0..AXES {
        assert!((ideal.positions[axis] - ideal.plan.points(axis)[0].1).abs() < 2e-3, "{axis}");
    }
}

#[test]
fn the_others_come_to_a_stand_and_hold_when_one_axis_leaves_the_way_and_all_begin_anew() {
    let mut ideal = Ideal::new();
    ideal.controller.arm();
    ideal.await_way();
    (0..150).for_each(|_| {
        ideal.tick();
    });
    ideal.failed = Some(3);
    let stopped = (0..100).take_while(|_| ideal.tick().axes[3].flags & control_flag::LATCHED == 0).count();
    assert!(stopped < 100);
    let before = ideal.positions;
    let command = (0..200).map(|_| ideal.tick()).last().unwrap();
    assert_eq!(ideal.controller.on_the_way(), None);
    for (axis, before) in before.iter().enumerate().take(3) {
        assert_eq!(command.axes[axis].operation, AxisMode::Hold as u32, "{axis}");
        assert!((ideal.positions[axis] - before).abs() < 0.1, "{axis}");
    }
    let stand = ideal.positions;
    (0..50).for_each(|_| {
        ideal.tick();
    });
    assert_eq!(ideal.positions, stand);
    ideal.failed = None;
    ideal.controller.disarm();
    ideal.controller.arm();
    assert!(ideal.await_way() > 220);
    for axis in 0..AXES {
        assert!((ideal.positions[axis] - ideal.plan.points(axis)[0].1).abs() < 2e-3, "{axis}");
    }
}
