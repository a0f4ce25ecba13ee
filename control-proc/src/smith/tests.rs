use super::*;
use crate::tests::models::{at_knots, commissioned};
use pipeline::hammerstein::Coefficients;

const PERIOD: f64 = 0.01;

fn settings(kp: f64, ki: f64) -> Control {
    let control = crate::tests::machine(1).axes[0].control;
    let law = Law::Smith(SmithSettings { kp, ki, observer_time: 0.1 });
    Control { law, command_rate: 1e3, dead_band: commissioned().compensated_dead_band(), ..control }
}

/// The commissioned model as a plant, with a gain and a dead time of its own, m.
struct Plant {
    gain: f64,
    spool: f64,
    position: f64,
    underway: std::collections::VecDeque<f64>,
}

impl Plant {
    fn new(gain: f64, dead_ticks: usize) -> Self {
        Self { gain, spool: 0.0, position: 0.0, underway: std::iter::repeat_n(0.0, dead_ticks).collect() }
    }

    fn step(&mut self, command: f64) {
        self.underway.push_back(command);
        let acting = self.underway.pop_front().unwrap_or(command);
        self.spool = acting + (self.spool - acting) * (-PERIOD / commissioned().time_constant).exp();
        self.position += PERIOD * self.gain * commissioned().speed(self.spool);
    }
}

/// Largest error from 5 s on, m, on moves to and fro of 0.1 m at 0.1 m/s, with rests, for 20 s.
fn largest_error(smith: &mut Smith, plant: &mut Plant) -> f64 {
    let reference = |tick: usize| {
        let t = (tick as f64 * PERIOD) % 4.0;
        0.1 * if t < 1.0 {
            t
        } else if t < 2.0 {
            1.0
        } else if t < 3.0 {
            3.0 - t
        } else {
            0.0
        }
    };
    let (mut last, mut largest) = (0.0, 0.0f64);
    for tick in 0..2000 {
        let references: Vec<f64> = (tick..tick + smith.ahead() + 1).map(reference).collect();
        smith.observe(1, plant.position, last);
        last = smith.update(None, &references, (last, LastBy::Law)).unwrap();
        if tick > 500 {
            largest = largest.max((references[0] - plant.position).abs());
        }
        plant.step(last);
    }
    largest
}

#[test]
fn only_an_axis_whose_file_asks_for_it_has_one() {
    let control = Control { law: Law::Predictive, ..settings(5.0, 0.0) };
    assert!(Smith::new(&control, &commissioned(), PERIOD).is_none());
}

#[test]
fn the_position_of_the_plant_is_foreseen() {
    let mut observer = Observer::new(&commissioned(), 0.1, PERIOD);
    let mut plant = Plant::new(1.0, 5);
    let (mut foreseen, mut seen) = (Vec::new(), Vec::new());
    for tick in 0..300 {
        observer.update(1, plant.position, if tick == 0 { 0.0 } else { 0.3 });
        foreseen.push(observer.predicted().unwrap());
        seen.push(plant.position);
        plant.step(0.3);
    }
    // At a steady speed: dead time and lag are 9.5 ticks.
    for tick in 100..280 {
        let then = 0.5 * (seen[tick + 9] + seen[tick + 10]);
        assert!((foreseen[tick] - then).abs() < 1e-4, "{tick}: {} {then}", foreseen[tick]);
    }
}

#[test]
fn a_gain_that_the_dead_time_forbids_holds_with_the_prediction() {
    // kp times the steepest slope times dead time and lag is 1.3: without prediction the loop swings ever more.
    let kp = 20.0;
    let mut smith = Smith::new(&settings(kp, 0.0), &commissioned(), PERIOD).unwrap();
    let predicted = largest_error(&mut smith, &mut Plant::new(1.0, 5));
    assert!(predicted < 6e-3, "{predicted}");
    // And with 1.4 times the gain, and with half more dead time.
    for mut plant in [Plant::new(1.4, 5), Plant::new(1.0, 7)] {
        let mut smith = Smith::new(&settings(10.0, 0.0), &commissioned(), PERIOD).unwrap();
        let error = largest_error(&mut smith, &mut plant);
        assert!(error < 0.015, "{error}");
    }
}

#[test]
fn taking_over_does_not_change_the_command() {
    let mut smith = Smith::new(&settings(10.0, 0.0), &commissioned(), PERIOD).unwrap();
    for last in [0.5, -0.4, 0.0] {
        smith.observe(1, 0.3, last);
        let command = smith.update(None, &[0.302; 20], (last, LastBy::Other)).unwrap();
        assert!((command - last).abs() < 1e-9, "{last}: {command}");
    }
}

#[test]
fn commands_that_are_not_sent_leave_no_trace() {
    let mut smith = Smith::new(&settings(10.0, 5.0), &commissioned(), PERIOD).unwrap();
    smith.observe(1, 0.3, 0.0);
    let first = smith.update(None, &[0.31; 20], (0.0, LastBy::Law));
    smith.discard();
    // A rest of a minute, 10 mm beside the reference.
    for _ in 0..6000 {
        smith.observe(1, 0.3, 0.0);
        smith.update(None, &[0.31; 20], (0.0, LastBy::Law));
        smith.discard();
    }
    assert_eq!(smith.update(None, &[0.31; 20], (0.0, LastBy::Law)), first);
}

#[test]
fn an_adapted_curve_that_is_the_commissioned_one_shifts_nothing() {
    let model = commissioned();
    let curve = AdaptedCurve::new(&model, PERIOD);
    let (approved, range) = (at_knots(&model, PERIOD), (-1.0, 1.0));
    let approved = Approved { model: &approved, range };
    for speed in [0.3, 0.05, 0.01, -0.01, -0.2] {
        assert!(curve.shift(&approved, speed).abs() < 1e-5, "{speed}: {}", curve.shift(&approved, speed));
    }
    // A valve that has become a third slower needs more command, and no less than nothing at rest.
    let slow = Coefficients { b: approved.model.b.map(|b| b / 1.5), ..*approved.model };
    let slow = Approved { model: &slow, range };
    assert!(curve.shift(&slow, 0.2) > 0.05 && curve.shift(&slow, -0.2) < -0.05);
    assert_eq!(curve.shift(&slow, 0.0), 0.0);
    let dead = Coefficients { b: approved.model.b.map(|_| 0.0), ..*approved.model };
    assert_eq!(curve.shift(&Approved { model: &dead, range }, 0.2), 0.0);
}
