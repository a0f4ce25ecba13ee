//! When a stage that has died is started again, and when that is given up.
//!
//! ```text
//! wait(n) = min(0.2 s * 2^n, 5 s)      n deaths in a row before this one, each soon after its start
//! ```
//!
//! Trap: a stage that dies at once each time would be started for ever, and one that dies once a week would be given up
//! after five weeks: deaths count within a window only.

use std::time::{Duration, Instant};

/// Wait before the first restart.
const FIRST_WAIT: Duration = Duration::from_millis(200);
/// Longest wait.
const LONGEST_WAIT: Duration = Duration::from_secs(5);
/// A stage that has lived so long begins with the first wait again.
const LONG_LIFE: Duration = Duration::from_secs(10);
/// Restarts within [`WINDOW`] after which the next death ends the run.
pub const MOST_RESTARTS: usize = 5;
/// Time that restarts are counted over.
pub const WINDOW: Duration = Duration::from_secs(30);

/// The deaths of one stage.
#[derive(Debug, Default)]
pub struct History {
    in_a_row: u32,
    restarts: Vec<Instant>,
}

impl History {
    /// Takes in a death at `now` of a stage that has lived for `lived`: how long to wait with the restart, or none when
    /// there have been too many.
    pub fn died(&mut self, now: Instant, lived: Duration) -> Option<Duration> {
        self.restarts.retain(|restart| now.duration_since(*restart) < WINDOW);
        if self.restarts.len() >= MOST_RESTARTS {
            return None;
        }
        self.restarts.push(now);
        if lived >= LONG_LIFE {
            self.in_a_row = 0;
        }
        let wait = FIRST_WAIT.saturating_mul(2u32.saturating_pow(self.in_a_row)).min(LONGEST_WAIT);
        self.in_a_row += 1;
        Some(wait)
    }
}

/// The tick with which a source of samples goes on that has sent tick `last` a time `since` ago: the one that is due
/// next, as if it had never been away.
pub fn next_tick(last: Option<u64>, since: Duration, period: Duration) -> u64 {
    let passed = u64::try_from(since.as_nanos() / period.as_nanos().max(1)).unwrap_or(u64::MAX);
    last.map_or(0, |last| last.saturating_add(passed).saturating_add(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHORT: Duration = Duration::from_millis(50);

    #[test]
    fn waits_double_and_the_sixth_death_within_the_window_is_the_last() {
        let (mut history, mut now) = (History::default(), Instant::now());
        for wait in [200, 400, 800, 1600, 3200].map(Duration::from_millis) {
            assert_eq!(history.died(now, SHORT), Some(wait));
            now += wait + SHORT;
        }
        assert_eq!(history.died(now, SHORT), None);
    }

    #[test]
    fn a_long_life_begins_anew_and_old_deaths_are_forgotten() {
        let (mut history, mut now) = (History::default(), Instant::now());
        for _ in 0..100 {
            assert_eq!(history.died(now, LONG_LIFE), Some(FIRST_WAIT));
            now += WINDOW / 4;
        }
    }

    #[test]
    fn waits_have_a_longest() {
        let (mut history, mut now) = (History::default(), Instant::now());
        let waits = (0..40).map(|_| {
            now += WINDOW / 5;
            history.died(now, SHORT)
        });
        assert_eq!(waits.last(), Some(Some(LONGEST_WAIT)));
    }

    #[test]
    fn ticks_go_on_where_they_would_be_and_never_repeat() {
        let period = Duration::from_millis(10);
        assert_eq!(next_tick(None, Duration::from_secs(9), period), 0);
        assert_eq!(next_tick(Some(41), Duration::ZERO, period), 42);
        assert_eq!(next_tick(Some(41), Duration::from_millis(305), period), 72);
    }
}
