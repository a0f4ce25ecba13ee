//! Time of the tip's part of a tick: the way in time of four axes, their references with the preview, and where the
//! teeth are.
//!
//! `cargo bench --bench tip`. The machine is the built-in one, whose file has a level cut.

use std::{hint::black_box, path::Path as File, time::Instant};

use control_proc::{
    axis::AxisController,
    reference::{References, path::Path},
    tip::watch::TipWatch,
    trajectory_file::read_references,
};
use hdrhistogram::Histogram;
use pipeline::machine::{BUILT_IN, Machine};

const AXES: usize = 4;
const ROUNDS: usize = 100;
/// What the 99th percentile of the tip's part may be, ns.
const BOUND_NS: u64 = 20_000;

fn machine() -> Machine {
    let settings = ["boom", "arm", "telescope", "bucket"]
        .map(|axis| (format!("axis.{axis}.reference.kind"), "\"tip\"".to_owned()));
    Machine::parse(BUILT_IN, "excavator.toml", File::new("examples"), &settings).expect("the machine is sound")
}

/// The tip's part of every tick of the task, round after round.
fn references(machine: &Machine) -> Histogram<u64> {
    let period = machine.timing.period.as_secs_f64();
    let mut generator = read_references(machine).expect("the references of the machine file");
    generator.begin_tip(Some(0.0));
    let plan = generator.plan().expect("a task").clone();
    let ticks = (plan.duration() / period) as u64;
    let axes = machine.axes.iter().enumerate();
    let ahead = axes.clone().map(|(i, axis)| AxisController::new(i, axis, &machine.timing, 0).ahead()).max();
    let ahead = ahead.expect("axes");
    let mut watch = TipWatch::new(machine.mechanism.as_ref().expect("a mechanism"));
    let mut times = Histogram::<u64>::new_with_bounds(1, 1_000_000_000, 3).expect("bounds");
    for _ in 0..ROUNDS {
        let mut path = Path::new(ahead, period, 3);
        let mut references: Vec<References> =
            axes.clone().map(|(i, axis)| References::new(i, axis, period, ahead, ahead)).collect();
        for (i, axis) in references.iter_mut().enumerate() {
            axis.begin(0.0, generator.position(i, 0.0).expect("an axis of the teeth"), &generator);
        }
        for tick in 0..ticks {
            let begun = Instant::now();
            path.advance(tick, (false, watch.pace()), |tick| {
                references.iter().map(|axis| axis.rate(tick, &generator)).fold(1.0, f64::min)
            });
            let mut positions = [0.0; AXES];
            for (axis, position) in references.iter_mut().zip(&mut positions) {
                axis.update((tick, 1), 0.0, path.ticks(), &generator, None);
                *position = axis.positions()[0];
            }
            let t = (period * path.ticks()[0]).min(plan.duration());
            black_box(watch.update(Some(positions), &positions, Some((&plan, t))));
            times.saturating_record(begun.elapsed().as_nanos() as u64);
        }
    }
    times
}

fn main() {
    let times = references(&machine());
    let at = |quantile| times.value_at_quantile(quantile) as f64 * 1e-3;
    println!(
        "tip references of four axes, {} ticks: p50 {:.2} us, p99 {:.2} us, p99.9 {:.2} us, max {:.2} us",
        times.len(),
        at(0.5),
        at(0.99),
        at(0.999),
        times.max() as f64 * 1e-3
    );
    let verdict = if times.value_at_quantile(0.99) < BOUND_NS { "holds" } else { "missed" };
    println!("p99 under {} us: {verdict}", BOUND_NS / 1000);
}
