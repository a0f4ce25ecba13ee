//! A thousand random targets, many of them just at a soft limit, given by another program.
//!
//! The program leads each axis there at a random speed, without a jump of speed or acceleration, its preview between
//! one tick and all that a message holds; the next target may come on the way, and is gone to from there.

use pipeline::{
    MAX_AXES,
    machine::{ModelChoice, ReferenceSource},
    message::{ControlMode, MAX_PREVIEW, Reference},
};
use rand_pcg::{
    Pcg64,
    rand_core::{Rng, SeedableRng},
};

use super::{ClosedLoop, machine};

/// How far beyond a soft limit an axis may be, m.
const ALLOWED: f64 = 2e-3;
/// For all axes together, and for each choice of model.
const TARGETS: usize = 500;

fn uniform(random: &mut Pcg64, low: f64, high: f64) -> f64 {
    low + (high - low) * (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

/// The way of one axis: start + (target - start) s(r), s as in the controller's own blend.
#[derive(Clone, Copy)]
struct Way {
    start: f64,
    target: f64,
    /// Ticks so far, those of the way, and those until the next target.
    ticks: u32,
    length: f64,
    left: u32,
}

impl Way {
    fn after(&self, ticks: u32) -> f64 {
        let r = (f64::from(self.ticks + ticks.min(self.left)) / self.length).min(1.0);
        self.start + (self.target - self.start) * r * r * r * (10.0 + r * (6.0 * r - 15.0))
    }
}

/// What the axes have done.
#[derive(Debug)]
struct Seen {
    /// The farthest beyond a soft limit, m; negative within.
    beyond: f64,
    /// The nearest to an end stop, m; negative in it.
    gap: f64,
    /// Share of the ticks that models controlled.
    by_model: f64,
}

/// Goes to all targets.
fn go(model: ModelChoice, seed: u64) -> Seen {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut machine = machine("nominal", model, |_| ReferenceSource::Channel);
    for axis in &mut machine.axes {
        let (low, high) = axis.soft_limits;
        axis.plant.as_mut().unwrap().initial_position = uniform(&mut random, low, high);
        // Some ways are faster than the axis, which would be stopped for it.
        axis.control.following_error = axis.stroke;
    }
    let axes = machine.axes.clone();
    let period = machine.timing.period.as_secs_f64();
    let mut ways = [Way { start: 0.0, target: 0.0, ticks: 0, length: 1.0, left: 100 }; MAX_AXES];
    for (way, axis) in ways.iter_mut().zip(&axes) {
        way.start = axis.plant.as_ref().unwrap().initial_position;
        way.target = way.start;
    }
    let mut closed = ClosedLoop::new(machine, seed);
    let (mut targets, mut by_model, mut ticks) = (0, 0u32, 0u32);
    let (mut beyond, mut gap) = (f64::NEG_INFINITY, f64::INFINITY);
    while targets < TARGETS {
        let preview = uniform(&mut random, 1.0, MAX_PREVIEW as f64 + 1.0) as u32;
        let mut reference = Reference { preview, ..Reference::default() };
        (reference.header.sequence, reference.header.axis_count) = (closed.tick, axes.len() as u32);
        for ((way, axis), positions) in ways.iter_mut().zip(&axes).zip(&mut reference.positions) {
            if way.left == 0 {
                let (low, high) = axis.soft_limits;
                way.start = way.after(0);
                way.target = match uniform(&mut random, 0.0, 4.0) as u32 {
                    0 => low,
                    1 => high,
                    _ => uniform(&mut random, low, high),
                };
                let speed = uniform(&mut random, 0.05, 1.0) * axis.max_speed;
                // The steepest slope of s is 15/8.
                way.length = (15.0 / 8.0 * (way.target - way.start).abs() / (speed * period)).max(50.0);
                way.left = (way.length * uniform(&mut random, 1.0, 2.0)) as u32;
                way.ticks = 0;
                targets += 1;
            }
            (0..preview).for_each(|k| positions[k as usize] = way.after(k));
            (way.ticks, way.left) = (way.ticks + 1, way.left - 1);
        }
        let command = closed.tick(Some(&reference));
        assert!(!closed.controller.is_latched(), "{}: {:?}", closed.tick, command.axes.map(|axis| axis.flags));
        for (i, (axis, state)) in axes.iter().zip(closed.plant.axes()).enumerate() {
            let (low, high) = axis.soft_limits;
            beyond = beyond.max(state.position - high).max(low - state.position);
            gap = gap.min(state.position).min(axis.stroke - state.position);
            by_model += u32::from(command.axes[i].mode == ControlMode::Model as u32);
            ticks += 1;
        }
    }
    let seen = Seen { beyond, gap, by_model: f64::from(by_model) / f64::from(ticks) };
    println!("{model:?}: {seen:?}");
    seen
}

/// Whether no axis was farther beyond a soft limit than allowed, though the limits were gone to.
fn expect_within(seen: &Seen) {
    assert!(seen.beyond.abs() <= ALLOWED && seen.gap > 0.0, "{seen:?}");
}

#[test]
fn five_hundred_targets_lead_no_axis_of_the_fallback_beyond_a_soft_limit() {
    expect_within(&go(ModelChoice::None, 1));
}

#[test]
fn five_hundred_targets_lead_no_axis_of_the_model_beyond_a_soft_limit() {
    let seen = go(ModelChoice::Adaptive, 2);
    expect_within(&seen);
    assert!(seen.by_model > 0.2, "{seen:?}");
}
