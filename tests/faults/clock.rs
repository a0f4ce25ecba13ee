//! Bounds by the clock, on a machine that may have no real-time kernel and other work to do.

use std::time::Duration;

/// A stage may be woken so many times as late as its bound allows.
const FACTOR: u32 = 4;
/// And, however short the bound, by so much: what a busy machine was seen to take for one wake-up.
const ALLOWANCE: Duration = Duration::from_millis(150);

/// What is asserted in the place of a bound that holds with a real-time kernel.
pub fn scaled(bound: Duration) -> Duration {
    bound * FACTOR + ALLOWANCE
}

/// Prints and judges a reaction time.
pub fn judge(row: &str, what: &str, measured: Duration, bound: Duration) {
    let allowed = scaled(bound);
    eprintln!("{row}: {what} {measured:.1?}; bound {bound:.1?}, {allowed:.1?} without a real-time kernel");
    assert!(measured <= allowed, "{row}: {what} {measured:?} for {allowed:?}");
}
