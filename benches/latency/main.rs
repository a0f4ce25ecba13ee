//! Times of the pipeline beside what the computer allows, both sides in one run.
//!
//! `cargo bench --bench latency`; `--quick` for a short run, `--json FILE` for programs.
//!
//! - [`jitter`]: release jitter of sensor-proc, beside a bare loop on `clock_nanosleep` with equal period and priority
//!   that is released half a period later.
//! - [`hops`]: reading to command through two processes in lock-step, beside two hops between threads that do nothing
//!   else, and the work of the two processes.
//! - [`watchers`]: sample to command of a real-time group while watchers attach and detach, beside the time while they
//!   attach to another group on the same cores, and the time while nobody attaches.
//!
//! Trap: on cores that other programs use, too, those programs cause the largest values. The comparison therefore is
//! one of ratios, and the two sides take turns or run at once.

#[path = "../arguments/mod.rs"]
mod arguments;
mod group;
mod hops;
mod jitter;
#[path = "../report/mod.rs"]
mod report;
mod table;
mod watchers;

use std::time::Duration;

use serde_json::json;

use arguments::Arguments;

/// Period of the real-time groups: a fifth of the built-in machine's, for more samples.
const PERIOD: Duration = Duration::from_millis(2);

fn main() {
    let arguments = Arguments::read();
    let quick = arguments.quick;
    let seconds = |short, long| Duration::from_secs(if quick { short } else { long });
    let sections = [
        jitter::measure(seconds(3, 60)),
        hops::measure(if quick { 2_000 } else { 50_000 }),
        watchers::measure(if quick { 2 } else { 20 }, seconds(1, 3)),
    ];
    println!("load {}", report::load());
    report::write(arguments.json.as_deref(), &json!(sections));
}
