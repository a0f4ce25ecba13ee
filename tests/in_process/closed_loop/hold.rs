//! A minute of standing still after a move, in every scenario of the closed loop.
//!
//! The axes move until all of a scenario's changes are over, and so that models have something to learn from; then a last
//! move, and the target stands. Quiet is a command that is neutral most of the time and changes its direction no oftener
//! than once in ten seconds; a limit cycle would be seen in both, and in the position.

use pipeline::machine::{ModelChoice, ReferenceSource, Scenario};

use super::{ClosedLoop, machine};

/// When the target begins to stand, s: the last change of a scenario ends at 16 s.
const STANDS: f64 = 22.0;
/// When the axis has to have settled, s: a fallback comes the last millimetre by its integral alone.
const SETTLED: f64 = 37.0;
/// How long it is watched then, s.
const WATCHED: f64 = 60.0;
/// m.
const NEAR: f64 = 1e-3;
/// Largest amplitude, half of the travel from one end to the other, that is no limit cycle, m.
const CYCLE: f64 = 0.5e-3;
const LEAST_NEUTRAL: f64 = 0.9;
const MOST_REVERSALS: usize = 6;

/// To and fro about the middle, 0.15 m either way at most, then a little away from it for good.
fn moves((low, high): (f64, f64)) -> ReferenceSource {
    let (middle, reach) = (0.5 * (low + high), 0.15f64.min(0.2 * (high - low)));
    let mut points: Vec<(f64, f64)> =
        (0..8).map(|k| (2.5 * f64::from(k), middle + reach * [0.0, 1.0, -0.6, 0.4][k as usize % 4])).collect();
    points.extend([(STANDS, middle + 0.5 * reach), (1000.0, middle + 0.5 * reach)]);
    ReferenceSource::Ramps(points)
}

/// The scenarios of the closed loop.
fn scenarios() -> Vec<Scenario> {
    Scenario::built_in().into_iter().filter(|scenario| scenario.commands.is_empty()).collect()
}

/// Holds in these scenarios; what is wrong, a line for each axis.
fn hold(model: ModelChoice, scenarios: &[Scenario], is_right: fn(&Seen) -> bool) -> Vec<String> {
    let mut wrong = Vec::new();
    for scenario in scenarios {
        assert!(scenario.changes.iter().all(|change| change.end < STANDS), "{}", scenario.name);
        let machine = machine(&scenario.name, model, moves);
        let period = machine.timing.period.as_secs_f64();
        let targets: Vec<f64> = machine
            .axes
            .iter()
            .map(|axis| match moves(axis.soft_limits) {
                ReferenceSource::Ramps(points) => points[points.len() - 1].1,
                _ => unreachable!(),
            })
            .collect();
        let names: Vec<String> = machine.axes.iter().map(|axis| axis.name.clone()).collect();
        let mut closed = ClosedLoop::new(machine, 1);
        while (closed.tick as f64) < SETTLED / period {
            closed.tick(None);
        }
        let mut seen = vec![Seen::default(); targets.len()];
        while (closed.tick as f64) < (SETTLED + WATCHED) / period {
            let command = closed.tick(None);
            for (i, seen) in seen.iter_mut().enumerate() {
                seen.take(closed.plant.axes()[i].position - targets[i], command.axes[i].command);
            }
        }
        for (name, seen) in names.iter().zip(&seen) {
            let told = format!("{} {name}: {}", scenario.name, seen.told());
            println!("{told}");
            if !is_right(seen) {
                wrong.push(told);
            }
        }
    }
    wrong
}

/// What one axis has done.
#[derive(Clone, Default)]
struct Seen {
    ticks: usize,
    neutral: usize,
    reversals: usize,
    /// Sign of the last command that was not neutral.
    direction: f64,
    /// Position less target, m.
    lowest: f64,
    highest: f64,
}

impl Seen {
    fn take(&mut self, error: f64, command: f64) {
        if self.ticks == 0 {
            (self.lowest, self.highest) = (error, error);
        }
        self.ticks += 1;
        (self.lowest, self.highest) = (self.lowest.min(error), self.highest.max(error));
        if command == 0.0 {
            self.neutral += 1;
        } else {
            self.reversals += usize::from(self.direction * command < 0.0);
            self.direction = command.signum();
        }
    }

    fn is_near(&self) -> bool {
        self.lowest.abs().max(self.highest.abs()) <= NEAR
    }

    fn is_steady(&self) -> bool {
        self.is_near()
            && self.highest - self.lowest <= 2.0 * CYCLE
            && self.neutral as f64 >= LEAST_NEUTRAL * self.ticks as f64
            && self.reversals <= MOST_REVERSALS
    }

    fn told(&self) -> String {
        format!(
            "{:.2} to {:.2} mm from the target, neutral {:.1} % of the time, {} reversals",
            self.lowest * 1e3,
            self.highest * 1e3,
            100.0 * self.neutral as f64 / self.ticks as f64,
            self.reversals
        )
    }
}

#[test]
fn the_model_holds_for_a_minute_unless_the_valve_itself_changes() {
    let same_valve = |scenario: &Scenario| !["dead-band-drift", "valve-wear", "everything"].contains(&&*scenario.name);
    let scenarios: Vec<Scenario> = scenarios().into_iter().filter(same_valve).collect();
    assert_eq!(scenarios.len(), 6);
    let wrong = hold(ModelChoice::Adaptive, &scenarios, Seen::is_steady);
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn the_model_stays_within_a_millimetre_for_a_minute_in_every_scenario() {
    let wrong = hold(ModelChoice::Adaptive, &scenarios(), Seen::is_near);
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
#[ignore = "fails: with grown dead bands and worn valves it is not quiet, and the worn telescope swings by 0.9 mm"]
fn the_model_holds_for_a_minute_in_every_scenario() {
    let wrong = hold(ModelChoice::Adaptive, &scenarios(), Seen::is_steady);
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
#[ignore = "fails: with worn valves the arm and the bucket swing, and the bucket is 3.9 mm off under everything"]
fn the_fallback_holds_for_a_minute_in_every_scenario() {
    let wrong = hold(ModelChoice::None, &scenarios(), Seen::is_steady);
    assert!(wrong.is_empty(), "{wrong:#?}");
}
