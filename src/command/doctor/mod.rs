//! `hydraxis doctor`: whether this computer is fit for real time, what is not fit, and what to do about it.
//!
//! Trap: a computer that is fast on average may still be late now and then, and a measurement of seconds does not see a
//! delay that comes once an hour. So the doctor judges the settings of the kernel as well as a measurement.
//!
//! Runs in a process of its own, before a machine works.

mod arguments;
mod cores;
mod finding;
mod kept;
mod kernel;
mod latency;
mod rights;
mod system;
#[cfg(test)]
mod tests;

use pipeline::{
    channel::{exposed, groups},
    stage::{lock_memory, schedule},
};
use rustix::mm::munlockall;
use serde::Serialize;

use crate::{
    arguments::load_bare,
    failure::Failure,
    report::{
        output::Output,
        table::{nanoseconds, progress, table},
    },
};
pub use arguments::DoctorArguments;
use finding::{Finding, Needs, Verdict};
pub use kept::Kept;
pub use latency::LARGEST_PART;
use latency::{WakeUpLatency, judge, measure};
use system::System;

/// Rights that this process asked the kernel for, to see whether it gets them.
struct Tried {
    fifo: Result<(), String>,
    lock: Result<(), String>,
}

/// The report, as JSON has it.
#[derive(Debug, Serialize)]
struct DoctorReport {
    findings: Vec<Finding>,
    latency: Vec<WakeUpLatency>,
    good: usize,
    bad: usize,
    unknown: usize,
}

/// Runs the command.
pub fn run(arguments: &DoctorArguments) -> Result<(), Failure> {
    let needs = Needs::of(&load_bare(&arguments.machine, None)?);
    let output = Output::open(arguments.json.as_deref())?;
    let system = System::here();
    let priority = needs.priority.unwrap_or(1);
    let tried = Tried {
        // On a thread of its own, so that this thread keeps its priority.
        fifo: std::thread::spawn(move || schedule(priority).map_err(|error| error.to_string()))
            .join()
            .unwrap_or_else(|_| Err("the thread died".to_owned())),
        lock: lock_memory().map_err(|error| error.to_string()),
    };
    let mut findings = examine(&system, &needs, &tried);
    findings.push(rights::leftovers(&groups()));
    findings.push(rights::other_users(&exposed()));

    let bar = progress(2 * 10 * arguments.seconds as u64, "tenths of a second of wake-ups");
    let busy = std::thread::available_parallelism().map_or(1, usize::from);
    let latency = [0, busy].map(|load| measure(&needs, arguments.seconds, load, &bar));
    bar.finish_and_clear();
    if tried.lock.is_ok() {
        // A failure does no harm: the end of the process unlocks the memory.
        let _ = munlockall();
    }
    kept::keep(&latency);
    findings.extend(latency.iter().map(|latency| judge(latency, &needs)));

    let count = |verdict: Verdict| findings.iter().filter(|finding| finding.verdict == verdict).count();
    let (good, bad, unknown) = (count(Verdict::Good), count(Verdict::Bad), count(Verdict::Unknown));
    let report = DoctorReport { findings, latency: latency.into(), good, bad, unknown };
    output.write(|| text(&report), &report)?;
    if bad == 0 { Ok(()) } else { Err(Failure::run("not fit for real time: see the lines that are bad")) }
}

/// All findings but those about leftovers and wake-ups.
fn examine(system: &System, needs: &Needs, tried: &Tried) -> Vec<Finding> {
    vec![
        kernel::preemption(system),
        kernel::clock_source(system),
        kernel::hypervisor(system),
        kernel::huge_pages(system),
        cores::isolated(system, needs),
        cores::tickless(system, needs),
        cores::interrupts(system, needs),
        cores::governor(system, needs),
        cores::idle_states(system, needs),
        rights::priority_limit(system, needs),
        rights::scheduling(system, &tried.fifo),
        rights::throttling(system, needs),
        rights::memory_limit(system),
        rights::locking(&tried.lock),
        rights::swap(system, needs, &tried.lock),
        rights::shared_memory(system),
        rights::logout(system),
    ]
}

fn text(report: &DoctorReport) -> String {
    let width = report.findings.iter().map(|finding| finding.check.len()).max().unwrap_or_default();
    let line = |finding: &Finding| {
        let advice = if finding.advice.is_empty() { String::new() } else { format!(" -> {}", finding.advice) };
        format!("{:8}{:width$}  {}{advice}\n", finding.verdict.name(), finding.check, finding.found)
    };
    let row = |latency: &WakeUpLatency| {
        let percentiles = &latency.percentiles;
        let scheduler = if latency.fifo { "FIFO" } else { "ordinary" };
        let mut row =
            vec![if latency.load == 0 { "none".to_owned() } else { format!("{} busy threads", latency.load) }];
        row.push(scheduler.to_owned());
        row.push(latency.core.map_or_else(|| "any".to_owned(), |core| core.to_string()));
        row.push(percentiles.count.to_string());
        row.extend([percentiles.p50, percentiles.p99, percentiles.p99_9, percentiles.max].map(nanoseconds));
        row
    };
    let header = ["load", "scheduler", "core", "wake-ups", "late p50", "p99", "p99.9", "max"];
    format!(
        "{}\n{}\n\n{} good, {} bad, {} unknown\n",
        report.findings.iter().map(line).collect::<String>(),
        table(&header, report.latency.iter().map(row).collect()),
        report.good,
        report.bad,
        report.unknown
    )
}
