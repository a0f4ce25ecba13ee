//! How late this computer wakes a thread that sleeps until a point in time, as a stage does.
//!
//! ```text
//! latency(k) = time at which the thread runs again - (begin + k * interval)
//! ```
//!
//! in ns; measured twice, first on the computer as it is, then with a busy thread per core beside.
//!
//! Trap: a deadline that is missed by more than an interval makes the next ones late as well. All of them count,
//! because a control loop would be late at all of them too.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
    thread::{sleep, spawn},
    time::Duration,
};

use indicatif::ProgressBar;
use pipeline::{
    latency::{LatencyRecorder, Percentiles},
    stage::{monotonic_ns, pin, schedule, sleep_until},
};
use rustix::thread::set_current_timer_slack;
use serde::Serialize;

use super::finding::{Finding, Needs, bad, good};

/// Longest time between two wake-ups, so that a second has at least a thousand of them.
const LONGEST_INTERVAL: Duration = Duration::from_millis(1);
/// Priority where the machine file asks for none: the middle of the range.
const PRIORITY: u8 = 50;
/// The 99.9th percentile of the latency must be at most the period divided by this number: a tick wakes four stages one
/// after the other, and their work and the drive of the valve need time as well.
pub const LARGEST_PART: u32 = 4;
/// Numbers that a busy thread changes: more than the caches of a core hold, so that memory is busy too.
const LOAD_NUMBERS: usize = 1 << 20;

/// One of the two measurements.
#[derive(Debug, Clone, Serialize)]
pub struct WakeUpLatency {
    /// Number of busy threads beside the measured one.
    pub load: usize,
    /// Whether the measured thread had SCHED_FIFO.
    pub fifo: bool,
    /// Core of the measured thread; none when it was free to move.
    pub core: Option<usize>,
    /// The latencies.
    #[serde(flatten)]
    pub percentiles: Percentiles,
}

/// Measures for `seconds` with `load` busy threads beside.
pub fn measure(needs: &Needs, seconds: usize, load: usize, bar: &ProgressBar) -> WakeUpLatency {
    let interval = needs.period.min(LONGEST_INTERVAL);
    let count = (seconds as f64 / interval.as_secs_f64()) as u64;
    let (done, stop) = (Arc::<AtomicU64>::default(), Arc::<AtomicBool>::default());
    let busy: Vec<_> = (0..load)
        .map(|_| {
            let stop = Arc::clone(&stop);
            spawn(move || keep_busy(&stop))
        })
        .collect();
    let sleeper = spawn({
        let (needs, done) = (needs.clone(), Arc::clone(&done));
        move || wake_up(&needs, interval, count, &done)
    });
    let before = bar.position();
    while !sleeper.is_finished() {
        sleep(Duration::from_millis(100));
        bar.set_position(before + done.load(Ordering::Relaxed) * seconds as u64 * 10 / count);
    }
    bar.set_position(before + seconds as u64 * 10);
    stop.store(true, Ordering::Relaxed);
    busy.into_iter().for_each(|thread| drop(thread.join()));
    let (fifo, core, percentiles) = sleeper.join().expect("the thread only sleeps and counts");
    WakeUpLatency { load, fifo, core, percentiles }
}

/// Sleeps until one deadline after another. Returns whether it had SCHED_FIFO, its core, and its latencies.
fn wake_up(needs: &Needs, interval: Duration, count: u64, done: &AtomicU64) -> (bool, Option<usize>, Percentiles) {
    let mut recorder = LatencyRecorder::new();
    // A stage asks for the same. Without these rights the latencies without them are measured.
    let _ = set_current_timer_slack(std::num::NonZeroU64::new(1));
    let core = needs.cores.first().copied().filter(|core| pin(*core).is_ok());
    let fifo = schedule(needs.priority.unwrap_or(PRIORITY)).is_ok();
    let mut deadline = monotonic_ns();
    for k in 0..count {
        deadline += interval.as_nanos() as u64;
        sleep_until(deadline);
        recorder.record(monotonic_ns().saturating_sub(deadline));
        done.store(k + 1, Ordering::Relaxed);
    }
    (fifo, core, recorder.percentiles())
}

/// Works on more memory than the caches hold, until `stop`.
fn keep_busy(stop: &AtomicBool) {
    let mut numbers = vec![1_u64; LOAD_NUMBERS];
    while !stop.load(Ordering::Relaxed) {
        for number in &mut numbers {
            *number = number.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        }
        std::hint::black_box(&mut numbers);
    }
}

/// Judges a measurement by the period of the machine.
pub fn judge(latency: &WakeUpLatency, needs: &Needs) -> Finding {
    let check = if latency.load == 0 { "wake-up" } else { "wake-up under load" };
    let limit = needs.period / LARGEST_PART;
    let p99_9 = Duration::from_nanos(latency.percentiles.p99_9);
    let milliseconds = |duration: Duration| duration.as_secs_f64() * 1e3;
    let found = format!("p99.9 {:.3} ms; a quarter of the period is {} ms", milliseconds(p99_9), milliseconds(limit));
    if p99_9 <= limit {
        return good(check, found);
    }
    bad(
        check,
        found,
        "mend the bad lines above and measure again; or take a longer period, timing.period in the machine file",
    )
}

#[cfg(test)]
mod tests {
    use super::{
        super::finding::Verdict::{Bad, Good},
        *,
    };

    #[test]
    fn every_wake_up_counts_and_is_judged_by_the_period() {
        let needs = Needs {
            period: Duration::from_millis(10),
            cores: vec![],
            priority: None,
            spins: false,
            lock_memory: false,
        };
        let bar = ProgressBar::hidden();
        let mut latency = measure(&needs, 1, 1, &bar);
        assert_eq!((latency.percentiles.count, latency.load, bar.position()), (1000, 1, 10));
        assert!(latency.percentiles.p50 > 0 && latency.percentiles.max >= latency.percentiles.p99_9);

        latency.percentiles.p99_9 = 2_500_000;
        assert_eq!(judge(&latency, &needs).verdict, Good);
        latency.percentiles.p99_9 = 2_500_001;
        let found = judge(&latency, &needs);
        assert_eq!((found.verdict, found.check), (Bad, "wake-up under load"));
        assert_eq!(found.found, "p99.9 2.500 ms; a quarter of the period is 2.5 ms");
        assert!(found.advice.contains("timing.period"));
        let slow = Needs { period: Duration::from_millis(20), ..needs };
        assert_eq!(judge(&latency, &slow).verdict, Good);
    }
}
