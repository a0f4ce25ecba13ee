//! Values that are allowed and hardly meant: times, delays and counts that do not fit to each other or to the computer.
//!
//! ```text
//! t_d > (n_k + n_b - 1) T          the model's inputs end before the axis reacts
//! t_f < 2 T, t_o < 2 T             one late sample stops the axes, one late command shuts the valves
//! t_f <= T                          the next sample is too late always, so no axis can be armed
//! t_f, t_o, t_h > 1 s and 10 T      an axis goes on by itself, a valve stays open, a device is missed for so long
//! r > v_max T                      at its largest speed the axis moves less than a count in a period
//! b < 2 r                          noise at an end of the stroke makes positions implausible
//! e >= e_f                         the axis rests at an error that is a fault
//! J_99.9 > T/4,  T + J > t_f       this computer is too late for the period, or for the time-out
//! ```
//!
//! t_d dead time s; T period s; n_k and n_b of the model's structure; t_f `feedback_timeout` and t_o `drive_timeout`
//! s, t_h `can.heartbeat` s; r length of a count m; v_max `max_speed` m/s; b `tolerance` m; e `rest_band` and e_f
//! `following_error` m; J_99.9 and J the 99.9th percentile and the largest lateness of the wake-ups that `hydraxis
//! doctor` measured last, s.
//!
//! All of them are warnings: such a machine runs.

use std::time::Duration;

use pipeline::machine::{Axis, Estimator, Machine, Timing};

use crate::command::doctor::{Kept, LARGEST_PART};

/// Least time-out in periods: a sample that comes a little late is none for the tick before.
const LEAST_PERIODS: u32 = 2;
/// Longest time-out, where it is longer than [`MOST_PERIODS`]: a person beside the machine has stopped waiting.
const LONGEST: Duration = Duration::from_secs(1);
/// Most periods of a time-out.
const MOST_PERIODS: u32 = 10;
/// Least tolerance in counts of the encoder: noise and rounding move a position by one count either way.
const LEAST_COUNTS: f64 = 2.0;

/// One warning for each value of the machine file that does not fit to the others.
pub fn doubtful(machine: &Machine) -> Vec<String> {
    let timing = &machine.timing;
    let of_axes = machine.axes.iter().flat_map(|axis| {
        [late(axis, timing), coarse(axis, timing), narrow(axis), resting(axis, timing)].into_iter().flatten()
    });
    hasty(timing).chain(patient(machine)).chain(of_axes).collect()
}

/// One warning for each time that is too short for this computer, as `hydraxis doctor` has found it.
pub fn beyond_computer(timing: &Timing, kept: &Kept) -> Vec<String> {
    [too_fast(timing, kept), too_strict(timing, kept)].into_iter().flatten().collect()
}

/// A dead time that is longer than the delay and the inputs of the model.
fn late(axis: &Axis, timing: &Timing) -> Option<String> {
    // The grey box has its delay from the commissioned model.
    let identification = &axis.identification;
    let (table, dead_time) = match (&axis.commissioned, &axis.plant) {
        _ if identification.estimator == Estimator::GreyBox => return None,
        (Some(model), _) => ("commissioned", model.dead_time),
        (None, Some(plant)) => ("plant", plant.dead_time),
        (None, None) => return None,
    };
    let (name, structure, period) = (&axis.name, identification.structure, timing.period.as_secs_f64());
    let horizon = (structure.nk + structure.nb - 1) as f64 * period;
    let least = (dead_time / period).floor() as usize + 1;
    (dead_time > horizon).then(|| {
        format!(
            "axis.{name}.identification.nk: found {}, and nb {}: the inputs of the model end {} ms before a sample, \
             and axis.{name}.{table}.dead_time is {} ms; asked for: nk of {least} or more, or a longer timing.period",
            structure.nk,
            structure.nb,
            millis(horizon),
            millis(dead_time)
        )
    })
}

/// Counts that are longer than the way in a period.
fn coarse(axis: &Axis, timing: &Timing) -> Option<String> {
    let Axis { name, encoder, max_speed, .. } = axis;
    let (way, found) = (max_speed * timing.period.as_secs_f64(), encoder.resolution);
    let key = if encoder.angle.is_some() { "angle_resolution" } else { "resolution" };
    (found > way).then(|| {
        format!(
            "axis.{name}.encoder.{key}: found counts of {} mm, and the axis moves {} mm in a period of {} ms at \
             max_speed, so its speed is seen in jumps; asked for: counts of {} mm or less, or a timing.period of {} ms \
             or more",
            millis(found),
            millis(way),
            millis(timing.period.as_secs_f64()),
            millis(way),
            millis(found / max_speed)
        )
    })
}

/// A tolerance of less than the noise of the encoder.
fn narrow(axis: &Axis) -> Option<String> {
    let Axis { name, encoder, .. } = axis;
    let least = LEAST_COUNTS * encoder.resolution;
    (encoder.tolerance < least).then(|| {
        format!(
            "axis.{name}.encoder.tolerance: found {} mm, and a count is {} mm: noise at an end of the stroke would \
             make a good position implausible; asked for: {} mm or more, {LEAST_COUNTS} counts",
            millis(encoder.tolerance),
            millis(encoder.resolution),
            millis(least)
        )
    })
}

/// An axis that rests at an error at which it is stopped.
fn resting(axis: &Axis, timing: &Timing) -> Option<String> {
    let (name, most) = (&axis.name, axis.control.following_error);
    let found = axis.motion_limits(timing.period.as_secs_f64()).rest_band;
    (found >= most).then(|| {
        format!(
            "axis.{name}.control.rest_band: found {} mm, with counts of {} mm: the axis rests at errors up to it, and \
             axis.{name}.control.following_error of {} mm stops the axis; asked for: a rest_band of less than that, \
             from finer counts of axis.{name}.encoder where it is 2 counts, or a larger following_error",
            millis(found),
            millis(axis.encoder.resolution),
            millis(most)
        )
    })
}

/// Time-outs that one late sample or command exceeds.
fn hasty(timing: &Timing) -> impl Iterator<Item = String> {
    let Timing { period, feedback_timeout, drive_timeout, .. } = *timing;
    let least = period * LEAST_PERIODS;
    let of_samples = match feedback_timeout > period {
        true => "one sample that is late or lost stops the axes",
        false => "the next sample is always too late, so no axis can be armed",
    };
    let times = [
        ("feedback_timeout", feedback_timeout, of_samples),
        ("drive_timeout", drive_timeout, "the drive shuts the valves before a command that is a little late"),
    ];
    times.into_iter().filter(move |(_, found, _)| *found < least).map(move |(key, found, why)| {
        format!(
            "timing.{key}: found {} ms with a period of {} ms: {why}; asked for: {} ms or more, {LEAST_PERIODS} \
             periods",
            millis(found.as_secs_f64()),
            millis(period.as_secs_f64()),
            millis(least.as_secs_f64())
        )
    })
}

/// Time-outs in which a person takes the machine for stopped.
fn patient(machine: &Machine) -> impl Iterator<Item = String> {
    let timing = &machine.timing;
    let most = LONGEST.max(timing.period * MOST_PERIODS);
    let feedback = "an axis waits so long for its sensor, and goes on by itself";
    let drive = "a valve stays open for so long when nobody commands it any more";
    let heartbeat = "a device is set up, and missed, after the first one that is due";
    let times = [
        Some(("timing.feedback_timeout", timing.feedback_timeout, feedback)),
        Some(("timing.drive_timeout", timing.drive_timeout, drive)),
        machine.can.as_ref().map(|bus| ("can.heartbeat", bus.heartbeat, heartbeat)),
    ];
    times.into_iter().flatten().filter(move |(_, found, _)| *found > most).map(move |(key, found, why)| {
        let [found, most] = [found, most].map(|time| time.as_secs_f64());
        format!("{key}: found {} ms: {why}; asked for: {} ms or less", millis(found), millis(most))
    })
}

/// A period that is too short for the wake-ups of this computer.
fn too_fast(timing: &Timing, kept: &Kept) -> Option<String> {
    let late = Duration::from_nanos(kept.p99_9_ns);
    (late > timing.period / LARGEST_PART).then(|| {
        format!(
            "timing.period: found {} ms, and this computer woke 1 in 1000 threads later than {} ms ({}); asked for: {} \
             ms or more, {LARGEST_PART} times that, or a computer that `hydraxis doctor` finds fit",
            millis(timing.period.as_secs_f64()),
            millis(late.as_secs_f64()),
            kept.when(),
            (late * LARGEST_PART).as_millis() + 1
        )
    })
}

/// A time-out that a late wake-up of this computer exceeds.
fn too_strict(timing: &Timing, kept: &Kept) -> Option<String> {
    let least = timing.period + Duration::from_nanos(kept.max_ns);
    (timing.feedback_timeout < least).then(|| {
        format!(
            "timing.feedback_timeout: found {} ms, and this computer woke a thread {} ms late ({}), with a period of \
             {} ms: the axes would have stopped; asked for: {} ms or more, or a computer that `hydraxis doctor` finds \
             fit",
            millis(timing.feedback_timeout.as_secs_f64()),
            millis(1e-9 * kept.max_ns as f64),
            kept.when(),
            millis(timing.period.as_secs_f64()),
            least.as_millis() + 1
        )
    })
}

/// A time in ms or a length in mm, to three digits behind the point.
fn millis(value: f64) -> f64 {
    (1e6 * value).round() / 1e3
}
