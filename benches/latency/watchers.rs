//! Time from sample to command of a real-time group while watchers attach to it and detach.

use std::{
    thread::sleep,
    time::{Duration, Instant},
};

use pipeline::{
    channel::Reader,
    latency::LatencyRecorder,
    message::{EncoderSample, MachineState, StageHealth, ValveCommand},
};
use serde_json::Value;

use crate::{
    PERIOD,
    group::Running,
    table::{ratio, show},
};

/// Number of times that a watcher attaches and detaches.
const WATCHERS: usize = 1000;

/// Attaches to the slow channels of a group as `hydraxis status` does, reads once, and detaches.
fn watch(group: &Running) {
    let watcher = group.join();
    let mut health: Reader<StageHealth> = watcher.reader().expect("a place");
    let mut states: Reader<MachineState> = watcher.reader().expect("a place");
    health.newest().expect("a channel");
    states.newest().expect("a channel");
}

/// Times of the group in `rounds` rounds, in each of which every side has `time`.
pub fn measure(rounds: usize, time: Duration) -> Value {
    let (running, group, _health) = Running::real_time("watch", &[]);
    // Attaching to a group without processes costs the watchers as much work on the same cores.
    let empty = Running::new("empty");
    let _empty = empty.join();
    let mut samples: Reader<EncoderSample> = group.reader().expect("a place");
    let mut commands: Reader<ValveCommand> = group.reader().expect("a place");
    let mut sides: [LatencyRecorder; 3] = std::array::from_fn(|_| LatencyRecorder::new());
    let looks = WATCHERS.div_ceil(rounds);
    let mut attached = 0;
    for _ in 0..rounds {
        for (side, recorder) in sides.iter_mut().enumerate() {
            let begin = Instant::now();
            let mut looked = 0;
            // Messages that were sent before belong to the side before.
            samples.newest().expect("a channel");
            commands.newest().expect("a channel");
            while begin.elapsed() < time {
                let due = begin.elapsed().as_secs_f64() / time.as_secs_f64() * looks as f64;
                if side > 0 && looked < looks && looked as f64 <= due {
                    looked += 1;
                    watch(if side == 1 { &empty } else { &running });
                    attached += usize::from(side == 2);
                }
                sleep(Duration::from_millis(5));
                record(&mut samples, &mut commands, recorder);
            }
        }
    }
    let [alone, elsewhere, watched] = sides.map(|side| side.percentiles());
    show(
        &format!("Sample to command in real time, period {PERIOD:?}, {attached} watchers come and go"),
        &[("nobody comes", alone), ("to another group, same cores", elsewhere), ("to this group", watched)],
        &[
            ("p99, this group by another one", ratio(watched.p99, elsewhere.p99)),
            ("p99, this group by nobody", ratio(watched.p99, alone.p99)),
            ("p50, this group by nobody", ratio(watched.p50, alone.p50)),
        ],
    )
}

/// Records the times from sample to command of all commands that have arrived.
fn record(samples: &mut Reader<EncoderSample>, commands: &mut Reader<ValveCommand>, recorder: &mut LatencyRecorder) {
    while let Some(command) = commands.read().expect("a channel").if_new().copied() {
        if samples.reach(command.header.sequence).expect("a channel")
            && let Some(sample) = samples.last()
            && sample.header.sequence == command.header.sequence
        {
            recorder.record(command.header.sent_ns.saturating_sub(sample.header.sent_ns));
        }
    }
}
