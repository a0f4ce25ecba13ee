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
//! - [`beside`]: times of all stages while a recorder runs, and while a thousand clients come to the page, beside the
//!   times while nothing does.
//!
//! `--only SECTION` measures one of `jitter`, `hops`, `watchers`, `recorder`, `clients`.
//!
//! Trap: on cores that other programs use, too, those programs cause the largest values. The comparison therefore is
//! one of ratios, and the two sides take turns or run at once.

#[path = "../arguments/mod.rs"]
mod arguments;
mod beside;
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

/// What can be measured.
const SECTIONS: [&str; 5] = ["jitter", "hops", "watchers", "recorder", "clients"];

fn main() {
    let arguments = Arguments::read(&SECTIONS);
    let quick = arguments.quick;
    let seconds = |short, long| Duration::from_secs(if quick { short } else { long });
    let rounds = |short, long| if quick { short } else { long };
    let mut sections = Vec::new();
    for section in SECTIONS.into_iter().filter(|name| arguments.only.as_deref().is_none_or(|only| only == *name)) {
        sections.push(match section {
            "jitter" => jitter::measure(seconds(3, 60)),
            "hops" => hops::measure(if quick { 2_000 } else { 50_000 }),
            "watchers" => watchers::measure(rounds(2, 20), seconds(1, 3)),
            "recorder" => beside::recorder(rounds(2, 40), seconds(1, 2)),
            _ => beside::clients(rounds(2, 40), seconds(1, 2)),
        });
    }
    println!("load {}", report::load());
    report::write(arguments.json.as_deref(), &json!(sections));
}
