//! Random set points from another program, many of them at a soft limit: no axis overruns its limits.
//!
//! The program sends references that lead each axis to its set point at a random speed, without a jump of speed or
//! acceleration. The preview is between one tick and a whole message. The next set point may come before the axis has
//! arrived.

use pipeline::{
    MAX_AXES,
    machine::{Machine, ModelChoice, ReferenceSource},
    message::{ControlMode, MAX_PREVIEW, Reference},
};
use rand_pcg::{
    Pcg64,
    rand_core::{Rng, SeedableRng},
};

use super::{ClosedLoop, machine, machine_as_chosen};

/// Largest distance beyond a soft limit, m.
const ALLOWED: f64 = 2e-3;
/// Number of set points of all axes together.
const TARGETS: usize = 500;
/// Least number of them on the way to which a model controls, were they counted by its share of the time.
const BY_MODEL: f64 = 100.0;

fn uniform(random: &mut Pcg64, low: f64, high: f64) -> f64 {
    low + (high - low) * (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

/// The way of one axis: start + (target - start) s(r), with s(r) = 10 r^3 - 15 r^4 + 6 r^5.
#[derive(Clone, Copy)]
struct Way {
    start: f64,
    target: f64,
    /// Ticks so far; length of the way in ticks; ticks until the next set point.
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

/// Extremes over all axes and ticks.
#[derive(Debug)]
struct Seen {
    /// Largest distance beyond a soft limit, m; negative within the limits.
    beyond: f64,
    /// Least distance to an end stop, m.
    gap: f64,
    /// Share of the ticks in which a model controlled the axis.
    by_model: f64,
}

/// Leads the axes to so many set points.
fn go(mut machine: Machine, all: usize, seed: u64) -> Seen {
    let mut random = Pcg64::seed_from_u64(seed);
    for axis in &mut machine.axes {
        let (low, high) = axis.soft_limits;
        axis.plant.as_mut().unwrap().initial_position = uniform(&mut random, low, high);
        // Some references are faster than the axis. It must not latch for its following error.
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
    while targets < all {
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
    println!("{seen:?}");
    seen
}

/// Expects that the soft limits were reached, and that no axis was further beyond them than allowed.
fn expect_within(seen: &Seen) {
    assert!(seen.beyond.abs() <= ALLOWED && seen.gap > 0.0, "{seen:?}");
}

#[test]
fn five_hundred_targets_lead_no_axis_of_the_fallback_beyond_a_soft_limit() {
    expect_within(&go(machine("nominal", ModelChoice::None, |_| ReferenceSource::Channel), TARGETS, 1));
}

#[test]
fn five_hundred_targets_lead_no_axis_of_the_chosen_law_beyond_a_soft_limit() {
    let machine = machine_as_chosen("nominal", |_| ReferenceSource::Channel);
    let seen = go(machine, TARGETS, 2);
    expect_within(&seen);
    assert!(seen.by_model * TARGETS as f64 > BY_MODEL, "{seen:?}");
}

#[test]
fn a_thousand_targets_lead_no_axis_of_the_predictive_law_beyond_a_soft_limit() {
    // References that are faster than the axis soon cost it the trust of its supervision: it begins anew.
    let (starts, targets) = (10, 100);
    let machine = machine("nominal", ModelChoice::Adaptive, |_| ReferenceSource::Channel);
    let mut by_model = 0.0;
    for seed in 0..starts {
        let seen = go(machine.clone(), targets, 2 + seed);
        expect_within(&seen);
        by_model += seen.by_model * targets as f64;
    }
    assert!(by_model > BY_MODEL, "{by_model}");
}
