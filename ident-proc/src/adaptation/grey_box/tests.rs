use std::time::Duration;

use super::*;
use crate::sample::SlidingBuffer;
use pipeline::machine::{DeadBand, GREY_BOX_MEMORY, Overrun};

const PERIOD: f64 = 0.01;

fn commissioned() -> Commissioned {
    Commissioned {
        dead_time: 0.05,
        time_constant: 0.05,
        dead_band: DeadBand { extend: 0.1, retract: 0.08 },
        hysteresis: 0.0,
        natural_frequency: 0.0,
        damping: 0.2,
        // At the knots of the hinges.
        openings: vec![0.05, 0.175, 0.5],
        speeds_extend: vec![0.02, 0.12, 0.4],
        speeds_retract: vec![0.03, 0.14, 0.5],
        largest_tested: [f64::INFINITY; 2],
        overrun: Overrun::NONE,
        mass: f64::INFINITY,
        noise: 0.0,
        fit_percent: 99.0,
    }
}

/// An axis as it was commissioned, with other speeds, another lag and another dead band.
struct Axis {
    grey_box: GreyBox,
    row: RegressorRow,
    outputs: SlidingBuffer,
    commands: SlidingBuffer,
    structure: Structure,
    underway: Vec<f64>,
    spool: f64,
    y: f64,
    k: u64,
}

impl Axis {
    fn new() -> Self {
        let structure = commissioned().structure(Structure::PAPER, Duration::from_millis(10));
        let Structure { na, nb, nk, order, .. } = structure;
        Self {
            grey_box: GreyBox::new(structure, &commissioned(), PERIOD, GREY_BOX_MEMORY, None),
            row: RegressorRow::new(structure),
            outputs: SlidingBuffer::new(na, 1),
            commands: SlidingBuffer::new(nk + nb, 2 * order),
            structure,
            underway: vec![0.0; 5],
            spool: 0.0,
            y: 0.5,
            k: 0,
        }
    }

    /// Runs for `seconds` with commands up to about `size`. Speeds and lag of the axis are multiplied by `speeds` and
    /// `slower`, and its dead band is widened by `wider`.
    fn drive(&mut self, seconds: f64, size: f64, (speeds, slower, wider): (f64, f64, f64)) {
        for _ in 0..(seconds / PERIOD) as usize {
            let t = self.k as f64 * PERIOD;
            let u = size * ((2.0 * t).sin() + 0.7 * (5.3 * t + 1.0).sin());
            self.commands.push_with(|slot| self.structure.input.features(u, slot));
            self.underway.insert(0, u);
            let acting = self.underway.pop().unwrap();
            let lag = 0.05 * slower;
            for _ in 0..10 {
                self.spool += (acting - self.spool) * PERIOD / 10.0 / lag;
                let open = self.spool - self.spool.signum() * wider.min(self.spool.abs());
                self.y += speeds * commissioned().speed(open) * PERIOD / 10.0;
            }
            self.k += 1;
            let encoder = (1e4 * self.y).round() / 1e4;
            if self.outputs.len() == self.structure.na && self.commands.len() == self.structure.nk + self.structure.nb {
                self.row.fill(&self.outputs, &self.commands);
                self.grey_box.learn(encoder, &self.row);
            }
            self.outputs.push(encoder);
        }
    }

    /// Speed of the model at a command, m/s.
    fn speed(&self, u: f64) -> f64 {
        self.grey_box.model().nonlinearity().evaluate(u)
    }

    /// Lag of the model, s.
    fn lag(&self) -> f64 {
        let alpha = self.grey_box.model().a[1];
        PERIOD * alpha / (1.0 - alpha)
    }
}

fn near(found: f64, expected: f64, part: f64) -> bool {
    (found / expected - 1.0).abs() < part
}

#[test]
fn it_starts_from_the_commissioned_model() {
    let axis = Axis::new();
    for u in [0.3, 0.5, -0.3, -0.5] {
        assert!(near(axis.speed(u), commissioned().speed(u), 0.06), "{u}: {}", axis.speed(u));
    }
    // The dead time fills all samples of the delay but the one in which the command is sent.
    assert!(near(axis.lag(), 0.05, 1e-9), "{}", axis.lag());
}

#[test]
fn speeds_lag_and_dead_band_are_followed() {
    for (speeds, slower, wider) in
        [(1.0, 1.0, 0.0), (1.4, 1.0, 0.0), (0.75, 1.0, 0.0), (1.0, 2.5, 0.0), (0.75, 2.5, 0.0), (1.0, 1.0, 0.04)]
    {
        let mut axis = Axis::new();
        axis.drive(6.0, 0.35, (speeds, slower, wider));
        for u in [0.35, 0.5, -0.35, -0.5] {
            let expected = speeds * commissioned().speed(u - f64::signum(u) * wider);
            // The plant's lag is before its curve, the model's is behind it. The difference grows with the lag.
            let part = if slower > 1.0 { 0.2 } else { 0.1 };
            assert!(near(axis.speed(u), expected, part), "{speeds} {slower} {wider}, {u}: {}", axis.speed(u));
        }
        assert!(near(axis.lag(), 0.05 * slower, 0.3), "{speeds} {slower} {wider}: {} s", axis.lag());
    }
}

#[test]
fn it_goes_on_from_what_was_learned_before() {
    let mut before = Axis::new();
    before.drive(6.0, 0.35, (0.75, 2.0, 0.02));
    let learned = before.grey_box.model();
    let start = Start::of(&learned, &commissioned(), PERIOD).unwrap();
    let mut after = Axis::new();
    after.grey_box = GreyBox::new(before.structure, &commissioned(), PERIOD, GREY_BOX_MEMORY, Some(&start));
    for u in [0.12, 0.2, 0.35, 0.5, 0.8, -0.1, -0.3, -0.5] {
        assert!(near(after.speed(u), before.speed(u), 1e-9), "{u}: {}, {}", after.speed(u), before.speed(u));
    }
    assert!(near(after.lag(), before.lag(), 1e-9) && !near(after.lag(), Axis::new().lag(), 0.2), "{}", after.lag());
    // What has changed since is learned as from a cold start.
    after.drive(6.0, 0.35, (1.0, 1.0, 0.0));
    for u in [0.35, 0.5, -0.35, -0.5] {
        assert!(near(after.speed(u), commissioned().speed(u), 0.1), "{u}: {}", after.speed(u));
    }
    let none = Coefficients { a: [f64::NAN; 7], ..learned };
    assert_eq!(Start::of(&none, &commissioned(), PERIOD), None);
}

#[test]
fn what_was_learned_is_kept_at_rest_and_in_the_other_direction() {
    let mut axis = Axis::new();
    axis.drive(6.0, 0.35, (1.4, 1.0, 0.0));
    let before = (axis.speed(0.4), axis.speed(-0.4), axis.lag());
    // These commands stay inside the dead band.
    axis.drive(600.0, 0.03, (1.4, 1.0, 0.0));
    let after = (axis.speed(0.4), axis.speed(-0.4), axis.lag());
    assert!(
        near(after.0, before.0, 0.02) && near(after.1, before.1, 0.02) && near(after.2, before.2, 0.05),
        "{after:?}"
    );
}

#[test]
fn the_model_stays_finite_monotone_and_within_its_bounds() {
    let mut axis = Axis::new();
    // First the axis is blocked, then it moves four times as fast, then its position jumps.
    axis.drive(5.0, 0.5, (0.0, 1.0, 0.0));
    let stuck = axis.speed(0.5);
    assert!(stuck >= 0.5 * commissioned().speed(0.5), "{stuck}: below the floor of the speeds");
    axis.drive(5.0, 0.5, (4.0, 0.2, 0.0));
    axis.y += 0.3;
    axis.drive(1.0, 0.5, (1.0, 1.0, 0.0));
    axis.grey_box.interrupt();
    axis.drive(10.0, 0.5, (1.0, 1.0, 0.0));
    assert!(near(axis.speed(0.5), commissioned().speed(0.5), 0.1), "{}", axis.speed(0.5));
    let mut before = f64::NEG_INFINITY;
    for i in -20..=20 {
        let speed = axis.speed(f64::from(i) * 0.05);
        assert!(speed.is_finite() && speed >= before);
        before = speed;
    }
}

#[test]
fn predictions_start_from_the_motion_of_the_axis_and_not_from_the_noise_of_its_encoder() {
    let nominal = (1.0, 1.0, 0.0);
    let mut axis = Axis::new();
    axis.drive(6.0, 0.2, nominal);
    let (mut known, mut measured) = (0.0, 0.0);
    for _ in 0..1000 {
        let before = axis.y;
        axis.drive(PERIOD, 0.2, nominal);
        let counts = (1e4 * axis.y).round() - (1e4 * before).round();
        let moved = axis.y - before;
        known += (axis.grey_box.increment() - moved).powi(2);
        measured += (1e-4 * counts - moved).powi(2);
    }
    assert!(known < 0.25 * measured, "{known} {measured}");
    // An axis that is held up stands, whatever the commands explain.
    let (mut known, mut explained) = (0.0, 0.0);
    for _ in 0..300 {
        axis.drive(PERIOD, 0.2, (0.0, 1.0, 0.0));
        known += axis.grey_box.increment().powi(2);
        explained += axis.grey_box.increment.explained(&axis.grey_box.model).powi(2);
    }
    assert!(known < 0.1 * explained, "{known} {explained}");
}
