//! References that ask for more than the axes or the pump can give.
//!
//! ```text
//! |v| > c                    faster than the commissioned axis was measured at `command_limit`
//! |v| > v_s(g)               faster than the soft stop lets the axis go there
//! sum of A |v| > Q           more oil at one time than the pump gives
//! ```
//!
//! g position m and v speed m/s of a reference, looked at from tick to tick; c largest measured speed m/s that way; v_s
//! speed m/s from which the soft stop stops before the soft limit ([`EndStops`]); A area m2 that the pump fills, less
//! the area whose oil comes back over a regeneration; Q flow m3/s of the pump.
//!
//! And a task of the teeth that the machine cannot do, while no axis follows it; one that is followed is refused.
//!
//! All of them are warnings: such a machine runs, and its axes lag behind or are stopped by their following error. What
//! an axis can give is a measurement, which temperature and load change. An axis with `slow_references` has no such
//! lag.

use control_proc::{
    protection::end_stops::EndStops, reference::generator::ReferenceGenerator, tip::TipPlan,
    trajectory_file::read_references,
};
use pipeline::machine::{Axis, Machine, Plant, ReferenceSource};

/// Time over which periodic references are looked at, s.
const LONG: f64 = 600.0;
/// Most points of a reference that are looked at.
const MOST_POINTS: f64 = 1e6;
/// Speed, m/s, by which a reference may exceed that of the axis: less is rounding.
const ROUNDING: f64 = 1e-6;
/// Speed, m/s, by which a reference may exceed that of the soft stop: one that ends at its limit has some speed in the
/// last tick.
const CREEP: f64 = 0.01;

/// What a reference asks for at one time.
#[derive(Clone, Copy)]
struct Demand {
    /// s.
    time: f64,
    /// m.
    position: f64,
    /// m/s.
    speed: f64,
}

/// One warning for each reference that asks for more than its axis can give, and for the pump. Empty for references
/// that cannot be read.
pub fn excesses(machine: &Machine) -> Vec<String> {
    let Ok(generator) = read_references(machine) else { return Vec::new() };
    let period = machine.timing.period.as_secs_f64();
    let ends = (0..machine.axes.len()).filter_map(|axis| generator.end(axis));
    let length = ends.fold(LONG, f64::max);
    let step = period.max(length / MOST_POINTS);
    let times = || (0..(length / step) as u64).map(|tick| tick as f64 * step);
    let of_axes = machine.axes.iter().enumerate().flat_map(|(i, axis)| {
        let demands = || times().filter_map(|time| demand(&generator, i, time, step));
        [too_fast(axis, demands()), too_near(axis, period, demands())].into_iter().flatten()
    });
    let mut warnings: Vec<String> = of_axes.collect();
    warnings.extend(short_of_oil(machine, &generator, times(), step));
    warnings.extend(impossible_task(machine));
    warnings
}

/// A task of the teeth that no axis follows yet, and that the machine cannot do.
fn impossible_task(machine: &Machine) -> Option<String> {
    if machine.axes.iter().any(|axis| axis.reference == ReferenceSource::Tip) {
        return None;
    }
    let problem = TipPlan::of_task(machine).err()?;
    Some(format!("{problem}; no axis follows this task now"))
}

fn demand(generator: &ReferenceGenerator, axis: usize, time: f64, step: f64) -> Option<Demand> {
    let position = generator.position(axis, time)?;
    Some(Demand { time, position, speed: (generator.position(axis, time + step)? - position) / step })
}

/// The demand that exceeds its bound most, if one does by more than `allowance` m/s.
fn worst(demands: impl Iterator<Item = Demand>, bound: impl Fn(&Demand) -> f64, allowance: f64) -> Option<Demand> {
    let excess = |demand: &Demand| demand.speed.abs() - bound(demand);
    let exceeding = demands.filter(|demand| excess(demand) > allowance);
    // Of equal demands, as rounds repeat them, the first.
    exceeding.reduce(|worst, next| if excess(&next) > excess(&worst) + ROUNDING { next } else { worst })
}

/// Faster than the commissioned axis.
fn too_fast(axis: &Axis, demands: impl Iterator<Item = Demand>) -> Option<String> {
    let model = axis.commissioned.as_ref().filter(|_| !axis.control.slow_references)?;
    let (retract, extend) = model.tested_speeds(axis.control.command_limit);
    let bound = |demand: &Demand| if demand.speed > 0.0 { extend } else { retract };
    let worst = worst(demands, bound, ROUNDING)?;
    Some(format!(
        "{}: found {:.3} m/s {} at {} s; allowed: up to {:.3} m/s, which the commissioned axis was measured to reach \
         within command_limit: a slower reference, or axis.{}.control.slow_references = true",
        key(axis),
        worst.speed.abs(),
        if worst.speed > 0.0 { "extending" } else { "retracting" },
        rounded(worst.time),
        bound(&worst),
        axis.name
    ))
}

/// Faster than the soft stop allows near a soft limit.
fn too_near(axis: &Axis, period: f64, demands: impl Iterator<Item = Demand>) -> Option<String> {
    if axis.control.slow_references {
        return None;
    }
    let stops = EndStops::new(axis, period);
    let bound = |demand: &Demand| stops.stopping_speed(demand.speed, demand.position);
    let worst = worst(demands, bound, CREEP)?;
    let (low, high) = axis.soft_limits;
    Some(format!(
        "{}: found {:.3} m/s at {:.3} m at {} s; allowed: up to {:.3} m/s there, from which the soft stop stops before \
         the soft limit {} m: a slower reference, one that ends farther from it, a larger \
         axis.{}.control.stop_deceleration, or axis.{}.control.slow_references = true",
        key(axis),
        worst.speed.abs(),
        worst.position,
        rounded(worst.time),
        bound(&worst),
        if worst.speed > 0.0 { high } else { low },
        axis.name,
        axis.name
    ))
}

/// All references together ask for more oil than the pump gives.
fn short_of_oil(
    machine: &Machine,
    generator: &ReferenceGenerator,
    times: impl Iterator<Item = f64>,
    step: f64,
) -> Option<String> {
    let flow = machine.hydraulics?.supply.flow;
    let asked = |time| -> f64 {
        let flow = |(i, axis): (usize, &Axis)| {
            let (plant, demand) = (axis.plant.as_ref()?, demand(generator, i, time, step)?);
            Some(oil(plant, demand.speed))
        };
        machine.axes.iter().enumerate().filter_map(flow).sum()
    };
    let (mut worst, mut short, mut all) = ((0.0, flow), 0u64, 0u64);
    for time in times {
        let asked = asked(time);
        (short, all) = (short + u64::from(asked > flow), all + 1);
        if asked > worst.1 {
            worst = (time, asked);
        }
    }
    (short > 0).then(|| {
        format!(
            "supply.flow: found {flow:.3e} m3/s, and references that together ask for more in {:.1} % of their time, \
             most at {} s; allowed: {:.3e} m3/s or more, or slower references",
            100.0 * short as f64 / all as f64,
            rounded(worst.0),
            worst.1
        )
    })
}

/// Oil that a cylinder takes from the pump at this speed (m/s), m3/s. What comes back over a regeneration is at most
/// what the other chamber drains.
fn oil(plant: &Plant, speed: f64) -> f64 {
    let (filled, drained, regeneration) = if speed > 0.0 {
        (plant.piston_area, plant.rod_area, plant.ports.regeneration.extend)
    } else {
        (plant.rod_area, plant.piston_area, plant.ports.regeneration.retract)
    };
    let back = if regeneration > 0.0 { drained } else { 0.0 };
    (filled - back).max(0.0) * speed.abs()
}

/// The key that says how fast the reference is.
fn key(axis: &Axis) -> String {
    let key = match axis.reference {
        ReferenceSource::Sines { .. } => ".sines",
        ReferenceSource::Ramps(_) => ".positions",
        ReferenceSource::Trajectory { .. } => ".file",
        ReferenceSource::Hold | ReferenceSource::Channel | ReferenceSource::Tip => "",
    };
    format!("axis.{}.reference{key}", axis.name)
}

/// A time in s, to two digits behind the point.
fn rounded(time: f64) -> f64 {
    (100.0 * time).round() / 100.0
}
