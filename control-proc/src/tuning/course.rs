//! The course on which controllers are tuned and compared, the same for every axis but for its size.
//!
//! ```text
//! g(t) = center + direction s p(t)          s = min((high - low) / 1.234 m, v / (2 * 0.1875 m/s))
//!
//! 0 to 8 s      training: three sines of 0.15, 0.31 and 0.73 Hz that fade in and out, then rest
//! 8 to 45 s     smooth moves of 0.3 and -0.35 m, three periods of 0.2 Hz and 50 mm, 5 mm/s to and fro, rests
//! ```
//!
//! p course in m of an axis with soft limits 1.234 m apart, s size, `low` and `high` soft limits in m, v the speed in
//! m/s that the axis reaches in its slower direction; the smooth moves are 10 r^3 - 15 r^4 + 6 r^5 and reach 0.1875
//! m/s. Half of v is left to errors and to a machine that has grown slower, while training too: a course that a cold machine
//! cannot follow would measure the pump. Axes with odd numbers go the other way, so
//! that they do not all extend at once and the pump does not decide the comparison.
//!
//! The trap: a course without rests and creeping hides what dead bands do; one of sines alone hides the feed-forward.

use std::f64::consts::TAU;

use crate::target::blend::smooth;

/// From where on errors count, s: what is before is for offline identification.
pub const TRAINING: f64 = 8.0;
/// Where the course ends, s.
pub const END: f64 = 45.0;
/// Distance of the soft limits for which it is written, m.
const RANGE: f64 = 1.234;
/// Fastest speed of the smooth moves, m/s.
const FASTEST: f64 = 0.1875;
/// Points are this far apart, s.
const STEP: f64 = 0.01;

/// Points (s, m) with straight lines between them for the axis with this number, its soft limits in m, and the speed
/// in m/s that it reaches both ways.
pub fn course(index: usize, (low, high): (f64, f64), speed: f64) -> Vec<(f64, f64)> {
    let size = ((high - low) / RANGE).min(0.5 * speed / FASTEST);
    let direction = if index.is_multiple_of(2) { 1.0 } else { -1.0 };
    let place = |t: f64| if t < TRAINING { training(t, index) } else { judged(t - TRAINING) };
    let points = (0..=(END / STEP).round() as usize).map(|i| i as f64 * STEP);
    points.map(|t| (t, 0.5 * (low + high) + direction * size * place(t))).collect()
}

/// p over the training; axes meet their sines at different phases.
fn training(t: f64, index: usize) -> f64 {
    let shift = index as f64;
    let sines = [(0.08, 0.15, 0.0), (0.03, 0.31, 1.0), (0.012, 0.73, 2.0)];
    let sum: f64 = sines.iter().map(|(amplitude, f, phase)| amplitude * (TAU * f * t + phase + shift).sin()).sum();
    smooth(t / 2.0) * smooth((7.5 - t) / 1.5) * sum
}

/// p, t s after the training.
fn judged(t: f64) -> f64 {
    match t {
        ..9.0 => 0.3 * smooth((t - 1.0) / 3.0) - 0.35 * smooth((t - 5.5) / 3.5),
        ..10.5 => -0.05,
        ..25.5 => -0.05 * (TAU * 0.2 * (t - 10.5)).cos(),
        ..27.0 => -0.05,
        ..35.0 => -0.05 + 0.005 * creep(t - 27.0),
        _ => -0.05,
    }
}

/// 2 s there, 4 s back, 2 s there, at 1/s.
fn creep(t: f64) -> f64 {
    if t < 2.0 { t } else { (4.0 - t).max(t - 8.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_stays_in_its_limits_and_below_half_the_speed_and_never_jumps() {
        for index in 0..4 {
            for (limits, speed) in [((0.05, 1.284), 0.4), ((0.1, 0.3), 1.0), ((0.05, 1.07), 0.1)] {
                let points = course(index, limits, speed);
                assert_eq!((points[0].0, points[points.len() - 1].0), (0.0, END));
                assert!(points.iter().all(|point| (limits.0..=limits.1).contains(&point.1)));
                let fastest = points.windows(2).map(|p| (p[1].1 - p[0].1).abs() / STEP);
                let fastest = fastest.fold(0.0, f64::max);
                assert!(fastest <= 0.5001 * speed, "{fastest} of {speed}");
            }
        }
    }

    #[test]
    fn it_rests_between_its_parts_and_creeps_both_ways() {
        let points = course(0, (0.05, 1.284), 1.0);
        let speed = |t: f64| (points[(t / STEP) as usize + 1].1 - points[(t / STEP) as usize].1) / STEP;
        for t in [7.6, 8.5, 12.8, 18.0, 34.5, 44.0] {
            assert_eq!(speed(t), 0.0, "{t} s");
        }
        for (t, expected) in [(36.0, 5e-3), (39.0, -5e-3), (42.0, 5e-3), (10.5, 0.1875)] {
            assert!((speed(t) - expected).abs() < 1e-4, "{t} s: {}", speed(t));
        }
    }
}
