//! Which program operates the machine: one at a time.
//!
//! A session is one life of a program that sends requests. The first one operates until it has been silent for
//! [`STREAM_TIMEOUT`], or until another one takes over. A session that another one has followed is over for good:
//! a program that hung and goes on must not move axes that somebody else operates by then.

use pipeline::message::Request;

#[cfg(doc)]
use crate::axis::requests::STREAM_TIMEOUT;

/// Sessions that are remembered to be over; a program must hang through as many others to be forgotten.
const OVER: usize = 16;

/// The session that operates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Current {
    session: u64,
    /// Tick of its last message.
    seen_at: u64,
}

/// The programs that send requests.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Operators {
    /// Ticks after which a session counts as silent.
    silent_ticks: u64,
    current: Option<Current>,
    over: [Option<u64>; OVER],
    next: usize,
}

impl Operators {
    /// Before the first message; a session is silent after so many ticks without one.
    pub fn new(silent_ticks: u64) -> Self {
        Self { silent_ticks, current: None, over: [None; OVER], next: 0 }
    }

    /// Whether a message that came at this tick is from the program that operates.
    pub fn admit(&mut self, request: &Request, tick: u64) -> bool {
        let session = request.session;
        if self.over.contains(&Some(session)) {
            return false;
        }
        if let Some(current) = self.current.filter(|current| current.session != session) {
            let is_silent = tick.abs_diff(current.seen_at) > self.silent_ticks;
            if !is_silent && request.takes_over != 1 {
                return false;
            }
            self.over[self.next] = Some(current.session);
            self.next = (self.next + 1) % OVER;
        }
        self.current = Some(Current { session, seen_at: tick });
        true
    }

    /// The session that operates, or did last; 0 before the first.
    pub fn session(&self) -> u64 {
        self.current.map_or(0, |current| current.session)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(session: u64, takes_over: u32) -> Request {
        Request { session, takes_over, ..Request::default() }
    }

    #[test]
    fn one_operates_until_it_is_silent() {
        let mut operators = Operators::new(10);
        assert_eq!(operators.session(), 0);
        assert!(operators.admit(&request(7, 0), 100) && !operators.admit(&request(8, 0), 105));
        assert!(operators.admit(&request(7, 0), 106) && !operators.admit(&request(8, 0), 116));
        assert_eq!(operators.session(), 7);
        assert!(operators.admit(&request(8, 0), 117));
        assert_eq!(operators.session(), 8);
        // The first one goes on after it has hung.
        assert!(!operators.admit(&request(7, 0), 118) && !operators.admit(&request(7, 1), 500));
        assert_eq!(operators.session(), 8);
    }

    #[test]
    fn a_program_that_takes_over_operates_at_once_and_the_one_before_is_over() {
        let mut operators = Operators::new(10);
        assert!(operators.admit(&request(7, 0), 100) && operators.admit(&request(8, 1), 100));
        assert!(!operators.admit(&request(7, 0), 101) && operators.admit(&request(8, 1), 101));
        assert!(!operators.admit(&request(7, 0), 200), "also when the new one is silent");
        assert!(operators.admit(&request(9, 0), 200));
    }

    #[test]
    fn ticks_that_begin_anew_end_no_session_too_late() {
        let mut operators = Operators::new(10);
        assert!(operators.admit(&request(7, 0), 1000) && operators.admit(&request(8, 0), 3));
    }
}
