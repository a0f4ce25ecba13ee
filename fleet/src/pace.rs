//! How often a key is published. Messages in between are left out at the source, so that no thin link has to queue.

use std::time::{Duration, Instant};

/// The pace of one key.
#[derive(Debug, Clone)]
pub struct Pace {
    /// Time between two messages; none for a key that is never published.
    apart: Option<Duration>,
    due: Option<Instant>,
}

impl Pace {
    /// So many messages a second; 0 for none at all.
    pub fn per_second(rate: f64) -> Self {
        Self { apart: (rate > 0.0).then(|| Duration::from_secs_f64(1.0 / rate)), due: None }
    }

    /// Whether a message is due at this time. Then the next one is due a period later, whenever this one came.
    pub fn is_due(&mut self, now: Instant) -> bool {
        let Some(apart) = self.apart else { return false };
        if self.due.is_some_and(|due| now < due) {
            return false;
        }
        // After a pause nothing is made up for.
        let next = self.due.map(|due| due + apart).filter(|next| *next > now);
        self.due = Some(next.unwrap_or(now + apart));
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_rate_is_that_asked_for_and_a_pause_is_not_made_up_for() {
        let start = Instant::now();
        let at = |ms: u64| start + Duration::from_millis(ms);
        let mut pace = Pace::per_second(20.0);
        let count = (0..1000).step_by(8).filter(|ms| pace.is_due(at(*ms))).count();
        assert_eq!(count, 20);
        let count = (10_000..10_100).step_by(8).filter(|ms| pace.is_due(at(*ms))).count();
        assert_eq!(count, 2);
        assert!(!Pace::per_second(0.0).is_due(start));
    }
}
