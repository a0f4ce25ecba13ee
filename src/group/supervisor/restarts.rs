//! When a stage that has died is started again, and after how many deaths the supervisor gives up.
//!
//! ```text
//! wait(n) = min(0.2 s * 2^n, 5 s)      n: deaths in a row before this one, each less than 10 s after its start
//! ```
//!
//! Trap: without a limit, a stage that dies at once would be started for ever; with a limit on all deaths, a stage that
//! dies once a week would be given up after five weeks. So only the deaths within a window count.

use std::time::{Duration, Instant};

/// Wait before the first restart.
const FIRST_WAIT: Duration = Duration::from_millis(200);
/// Longest wait.
const LONGEST_WAIT: Duration = Duration::from_secs(5);
/// After a life of this length the next wait is the first one again.
const LONG_LIFE: Duration = Duration::from_secs(10);
/// Most restarts within [`WINDOW`]. One more death ends the run.
pub const MOST_RESTARTS: usize = 5;
/// Time over which restarts are counted.
pub const WINDOW: Duration = Duration::from_secs(30);

/// The restarts of one stage, the oldest first.
#[derive(Debug, Default)]
pub struct RestartHistory {
    in_a_row: u32,
    restarts: Vec<Instant>,
}

impl RestartHistory {
    /// Records a death at `now` after a life of `lived`. Returns the time to wait before the restart, or nothing when
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

/// The tick at which a source of samples goes on when its last tick was `last`, sent `since` ago: the tick that would
/// be due next without the interruption.
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
        let (mut history, mut now) = (RestartHistory::default(), Instant::now());
        for wait in [200, 400, 800, 1600, 3200].map(Duration::from_millis) {
            assert_eq!(history.died(now, SHORT), Some(wait));
            now += wait + SHORT;
        }
        assert_eq!(history.died(now, SHORT), None);
    }

    #[test]
    fn after_a_long_life_waits_begin_anew_and_old_deaths_do_not_count() {
        let (mut history, mut now) = (RestartHistory::default(), Instant::now());
        for _ in 0..100 {
            assert_eq!(history.died(now, LONG_LIFE), Some(FIRST_WAIT));
            now += WINDOW / 4;
        }
    }

    #[test]
    fn waits_are_bounded() {
        let (mut history, mut now) = (RestartHistory::default(), Instant::now());
        let waits = (0..40).map(|_| {
            now += WINDOW / 5;
            history.died(now, SHORT)
        });
        assert_eq!(waits.last(), Some(Some(LONGEST_WAIT)));
    }

    #[test]
    fn ticks_go_on_where_they_would_be_without_the_interruption() {
        let period = Duration::from_millis(10);
        assert_eq!(next_tick(None, Duration::from_secs(9), period), 0);
        assert_eq!(next_tick(Some(41), Duration::ZERO, period), 42);
        assert_eq!(next_tick(Some(41), Duration::from_millis(305), period), 72);
    }
}
