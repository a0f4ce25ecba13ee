//! The secret that a page needs to operate axes.
//!
//! It is made at the start of the program, and goes with the page's address behind a `#`, which browsers do not send.
//! Comparing takes the same time for every wrong text. After [`MOST_WRONG`] wrong ones within [`WINDOW`] none is taken
//! any more until the time has passed, except for a page that operates already.

use std::{
    fmt::Write as _,
    fs::File,
    hint::black_box,
    io::{self, Read},
    time::{Duration, Instant},
};

/// Random bytes of a token.
const BYTES: usize = 32;
/// Wrong tokens after which none is taken.
const MOST_WRONG: u32 = 10;
/// Time over which they are counted.
const WINDOW: Duration = Duration::from_secs(60);

/// What is thought of a token that a request brings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// It is the one.
    Right,
    /// It is another one.
    Wrong,
    /// There have been too many wrong ones: it was not looked at.
    TooMany,
}

/// The token of this program.
pub struct Token {
    text: String,
    wrong: u32,
    since: Instant,
}

impl Token {
    /// A new one.
    ///
    /// # Errors
    /// The system gives no random numbers.
    pub fn new() -> io::Result<Self> {
        let mut bytes = [0; BYTES];
        File::open("/dev/urandom")?.read_exact(&mut bytes)?;
        let mut text = String::new();
        for byte in bytes {
            // Writing to a string cannot fail.
            let _ = write!(text, "{byte:02x}");
        }
        Ok(Self { text, wrong: 0, since: Instant::now() })
    }

    /// For the person at the terminal.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Judges what a request has brought at this time. `operates`: it comes from a page that operates already.
    pub fn judge(&mut self, said: Option<&str>, operates: bool, now: Instant) -> Verdict {
        if now.saturating_duration_since(self.since) >= WINDOW {
            (self.wrong, self.since) = (0, now);
        }
        if self.wrong >= MOST_WRONG && !operates {
            return Verdict::TooMany;
        }
        if is_same(said.unwrap_or_default().as_bytes(), self.text.as_bytes()) {
            return Verdict::Right;
        }
        self.wrong = self.wrong.saturating_add(1);
        Verdict::Wrong
    }
}

/// Compares without telling by its time where the first difference is.
fn is_same(said: &[u8], own: &[u8]) -> bool {
    let differences = said.iter().zip(own).fold(0, |all, (a, b)| black_box(all | (a ^ b)));
    said.len() == own.len() && differences == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_tokens_differ_and_only_the_own_one_is_right() {
        let (mut token, other) = (Token::new().unwrap(), Token::new().unwrap());
        let text = token.text().to_owned();
        assert!(text.len() == 2 * BYTES && text != other.text());
        let now = Instant::now();
        assert_eq!(token.judge(Some(&text), false, now), Verdict::Right);
        for wrong in [None, Some(""), Some(&text[1..]), Some(other.text()), Some(&*format!("{text}0"))] {
            assert_eq!(token.judge(wrong, false, now), Verdict::Wrong, "{wrong:?}");
        }
    }

    #[test]
    fn after_too_many_wrong_ones_only_a_page_that_operates_is_heard() {
        let mut token = Token::new().unwrap();
        let (text, now) = (token.text().to_owned(), Instant::now());
        (0..MOST_WRONG).for_each(|_| assert_eq!(token.judge(Some("x"), false, now), Verdict::Wrong));
        assert_eq!(token.judge(Some(&text), false, now), Verdict::TooMany);
        assert_eq!(token.judge(Some(&text), true, now), Verdict::Right);
        assert_eq!(token.judge(Some("x"), true, now), Verdict::Wrong);
        assert_eq!(token.judge(Some(&text), false, now + 2 * WINDOW), Verdict::Right);
    }
}
