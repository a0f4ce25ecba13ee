//! Release jitter of sensor-proc beside that of a bare loop on `clock_nanosleep`.

use std::{num::NonZeroU64, thread, time::Duration};

use pipeline::{
    latency::{LatencyRecorder, Percentiles},
    stage::{StageKind, monotonic_ns, schedule, sleep_until},
};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use crate::{
    PERIOD,
    group::{Running, health_of},
    table::{ratio, show},
};

/// Priority of both sides, where this process may set it.
const PRIORITY: u8 = 60;

/// Release jitter of sensor-proc, and of the bare loop for `time`.
pub fn measure(time: Duration) -> Value {
    let fifo = thread::spawn(|| schedule(PRIORITY).is_ok()).join().unwrap_or(false);
    let priority = format!("stage.sensor-proc.priority={PRIORITY}");
    let settings: Vec<&str> = fifo.then_some(priority.as_str()).into_iter().collect();
    let (_running, _group, mut health) = Running::real_time("jitter", &settings);
    let before = health_of(StageKind::SensorProc, &mut health, monotonic_ns());
    let pid = Pid::from_raw(before.pid as i32).expect("a process");
    kill_process(pid, Signal::USR1).expect("our own process");
    let bare = thread::spawn(move || bare_loop(time, fifo)).join().expect("the loop ends");
    let ours = health_of(StageKind::SensorProc, &mut health, monotonic_ns()).release_jitter;
    let class = if fifo { format!("SCHED_FIFO {PRIORITY}") } else { "no priority".to_owned() };
    let title = format!("Release jitter, period {PERIOD:?}, {class}");
    let ratios = [("p99.9 by bare loop", ratio(ours.p99_9, bare.p99_9)), ("p50", ratio(ours.p50, bare.p50))];
    show(&title, &[("sensor-proc", ours), ("bare clock_nanosleep", bare)], &ratios)
}

/// Jitter of a loop that only sleeps, released half a period after now, with [`PRIORITY`] where `fifo` is set.
fn bare_loop(time: Duration, fifo: bool) -> Percentiles {
    if fifo {
        let _ = schedule(PRIORITY);
    }
    let _ = rustix::thread::set_current_timer_slack(NonZeroU64::new(1));
    let (period, mut recorder) = (PERIOD.as_nanos() as u64, LatencyRecorder::new());
    let (begin, ticks) = (monotonic_ns() + period / 2, (time.as_nanos() as u64) / period);
    for tick in 1..=ticks {
        let due = begin + tick * period;
        sleep_until(due);
        recorder.record(monotonic_ns().saturating_sub(due));
    }
    recorder.percentiles()
}
