//! Who may do what now: consent, challenges, and the one seat from which axes are moved.
//!
//! ```text
//! free --challenge, arm--> taken --beat, beat, ..--> taken
//!   ^                        | no beat for DEAD_MAN, a stop, a fault, the end of the consent
//!   +------------------------+
//! ```
//!
//! A seat that has ended is over: whoever wants to go on begins with a challenge. The desk has no clock; it is given
//! the time.

use std::{
    collections::{BTreeMap, VecDeque},
    time::{Duration, Instant},
};

use pipeline::MAX_AXES;
use thiserror::Error;

use super::protocol::{Arm, Beat, Token};
use crate::{key::Name, settings::Window};

/// Time without a beat after which a seat is over. With the 0.1 s of control-proc an axis is off within 0.3 s.
pub const DEAD_MAN: Duration = Duration::from_millis(150);
/// Time for which a challenge is good.
const CHALLENGE_LIFE: Duration = Duration::from_millis(500);
/// Challenges that are open at the same time; the oldest gives way.
const OPEN: usize = 8;

/// Numbers of the stops that were asked for at the machine, as its board counts them.
pub type Stops = [u32; MAX_AXES + 1];

/// Why a command is refused.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum Refusal {
    /// The time of the consent is over, or it was taken back.
    #[error("the consent of the machine is over")]
    NoConsent,
    /// Somebody else operates.
    #[error("station \"{0}\" operates the machine; allowed: one at a time")]
    Taken(Name),
    /// The challenge is not the one that was given last.
    #[error(
        "found a challenge that was not given, was used, or is older than {}; ask for another one",
        humantime::format_duration(CHALLENGE_LIFE)
    )]
    Challenge,
    /// The challenge of a beat is not the one of the last answer.
    #[error("found a challenge that is not that of the last answer")]
    Beat,
    /// A stop has come between challenge and arming: the arming may have waited on its way.
    #[error("a stop was asked for since the challenge was given; ask for another one")]
    Stopped,
    /// A beat of no seat.
    #[error("{0}; axes are off until they are armed again")]
    Over(String),
    /// An axis that must not be moved from elsewhere.
    #[error("axis \"{axis}\"; allowed: {allowed}")]
    Axis {
        /// The axis.
        axis: String,
        /// The axes of the settings.
        allowed: String,
    },
    /// A set point outside of what the settings allow.
    #[error("axis \"{axis}\": target {found} m; allowed: {from} to {to} m")]
    Target {
        /// The axis.
        axis: String,
        /// The set point.
        found: String,
        /// The lowest one.
        from: String,
        /// The highest one.
        to: String,
    },
    /// Other axes than those that were armed.
    #[error("found targets of {found}; allowed: those of {allowed}, which were armed")]
    OtherAxes {
        /// Axes of the beat.
        found: String,
        /// Axes of the seat.
        allowed: String,
    },
}

/// The one seat.
#[derive(Debug)]
struct Seat {
    station: Name,
    targets: BTreeMap<String, f64>,
    stops: Stops,
    challenge: Token,
    /// When the last beat came.
    heard: Instant,
}

/// What a seat asks for.
#[derive(Debug, Clone, PartialEq)]
pub struct Wanted {
    /// Who asks.
    pub station: Name,
    /// Set points by axis, m.
    pub targets: BTreeMap<String, f64>,
    /// Stops before the seat: another one ends it.
    pub stops: Stops,
}

/// A challenge that was given.
#[derive(Debug)]
struct Open {
    token: Token,
    station: Name,
    stops: Stops,
    given: Instant,
}

/// Consent, challenges and seat.
#[derive(Debug)]
pub struct Desk {
    until: Instant,
    windows: BTreeMap<String, Window>,
    open: VecDeque<Open>,
    seat: Option<Seat>,
    /// Why the last seat has ended.
    ended: String,
}

impl Desk {
    /// With a consent to these windows until a time.
    pub fn new(until: Instant, windows: BTreeMap<String, Window>) -> Self {
        Self { until, windows, open: VecDeque::new(), seat: None, ended: "no axis is armed from here".to_owned() }
    }

    /// Opens the challenge `token` for a station, at a time with these stops.
    ///
    /// # Errors
    /// The consent is over, or another station operates.
    pub fn challenge(&mut self, station: &Name, token: Token, stops: Stops, now: Instant) -> Result<Token, Refusal> {
        self.expect_free(now)?;
        if self.open.len() == OPEN {
            self.open.pop_front();
        }
        self.open.push_back(Open { token, station: station.clone(), stops, given: now });
        Ok(token)
    }

    /// Gives the seat to a station, at a time with these stops; `token` is for its first beat.
    ///
    /// # Errors
    /// The challenge is not good, a stop came after it, or what is asked for is not allowed.
    pub fn arm(&mut self, arm: &Arm, token: Token, stops: Stops, now: Instant) -> Result<Token, Refusal> {
        let found = self.open.iter().position(|open| (&open.token, &open.station) == (&arm.challenge, &arm.station));
        let found = found.and_then(|place| self.open.remove(place));
        self.expect_free(now)?;
        let is_good = |open: &Open| now.saturating_duration_since(open.given) <= CHALLENGE_LIFE;
        let open = found.filter(is_good).ok_or(Refusal::Challenge)?;
        if open.stops != stops {
            return Err(Refusal::Stopped);
        }
        self.expect_allowed(&arm.targets)?;
        self.open.clear();
        let (station, targets) = (arm.station.clone(), arm.targets.clone());
        self.seat = Some(Seat { station, targets, stops, challenge: token, heard: now });
        Ok(token)
    }

    /// Keeps the seat; `token` is for the next beat. A beat that is refused does not keep it.
    ///
    /// # Errors
    /// There is no seat any more, the challenge is not the last one, or the targets are not allowed.
    pub fn beat(&mut self, beat: &Beat, token: Token, now: Instant) -> Result<Token, Refusal> {
        if self.wanted(now).is_none() {
            return Err(Refusal::Over(self.ended.clone()));
        }
        self.expect_allowed(&beat.targets)?;
        let seat = self.seat.as_mut().ok_or(Refusal::NoConsent)?;
        if seat.challenge != beat.challenge {
            return Err(Refusal::Beat);
        }
        if !seat.targets.keys().eq(beat.targets.keys()) {
            let names = |targets: &BTreeMap<String, f64>| targets.keys().cloned().collect::<Vec<_>>().join(", ");
            return Err(Refusal::OtherAxes { found: names(&beat.targets), allowed: names(&seat.targets) });
        }
        (seat.targets, seat.challenge, seat.heard) = (beat.targets.clone(), token, now);
        Ok(token)
    }

    /// What is asked for now; none when nobody has the seat. Ends a seat whose time is over.
    pub fn wanted(&mut self, now: Instant) -> Option<Wanted> {
        if now >= self.until {
            self.end(&Refusal::NoConsent.to_string());
        }
        if self.seat.as_ref().is_some_and(|seat| now.saturating_duration_since(seat.heard) > DEAD_MAN) {
            self.end(&format!("the station was silent for {}", humantime::format_duration(DEAD_MAN)));
        }
        let Seat { station, targets, stops, .. } = self.seat.as_ref()?;
        Some(Wanted { station: station.clone(), targets: targets.clone(), stops: *stops })
    }

    /// Ends the seat, if somebody has it, and says why.
    pub fn end(&mut self, why: &str) {
        if self.seat.take().is_some() {
            self.ended = why.to_owned();
        }
    }

    /// Takes the consent back.
    pub fn withdraw(&mut self, now: Instant) {
        self.until = self.until.min(now);
    }

    /// Why the last seat has ended.
    pub fn ended(&self) -> &str {
        &self.ended
    }

    fn expect_free(&mut self, now: Instant) -> Result<(), Refusal> {
        if now >= self.until {
            return Err(Refusal::NoConsent);
        }
        self.wanted(now).map_or(Ok(()), |wanted| Err(Refusal::Taken(wanted.station)))
    }

    fn expect_allowed(&self, targets: &BTreeMap<String, f64>) -> Result<(), Refusal> {
        let names = || self.windows.keys().cloned().collect::<Vec<_>>().join(", ");
        if targets.is_empty() {
            return Err(Refusal::Axis { axis: "none".to_owned(), allowed: names() });
        }
        for (axis, target) in targets {
            let Some(Window { from, to, .. }) = self.windows.get(axis) else {
                return Err(Refusal::Axis { axis: axis.clone(), allowed: names() });
            };
            if !(from..=to).contains(&target) {
                let [found, from, to] = [target, from, to].map(f64::to_string);
                return Err(Refusal::Target { axis: axis.clone(), found, from, to });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);
    const STOPS: Stops = [7; MAX_AXES + 1];

    fn name(text: &str) -> Name {
        text.parse().unwrap()
    }

    fn targets(boom: f64) -> BTreeMap<String, f64> {
        BTreeMap::from([("boom".to_owned(), boom)])
    }

    fn arm(station: &str, challenge: u128, boom: f64) -> Arm {
        Arm { station: name(station), challenge: Token(challenge), targets: targets(boom) }
    }

    fn beat(challenge: u128, boom: f64) -> Beat {
        Beat { challenge: Token(challenge), targets: targets(boom) }
    }

    /// A consent of a minute, with the seat taken at `now`; its first beat needs challenge 2.
    fn taken(now: Instant) -> Desk {
        let mut desk = free(now);
        desk.challenge(&name("office"), Token(1), STOPS, now).unwrap();
        desk.arm(&arm("office", 1, 0.6), Token(2), STOPS, now).unwrap();
        desk
    }

    fn free(now: Instant) -> Desk {
        let window = Window { from: 0.5, to: 0.7, speed: 0.02 };
        Desk::new(now + 60_000 * MS, BTreeMap::from([("boom".to_owned(), window)]))
    }

    #[test]
    fn a_seat_lasts_as_long_as_its_beats_and_no_longer() {
        let now = Instant::now();
        let mut desk = taken(now);
        assert_eq!(desk.wanted(now).unwrap().targets, targets(0.6));
        for i in 0..100_u32 {
            let challenge = u128::from(i) + 2;
            desk.beat(&beat(challenge, 0.65), Token(challenge + 1), now + (i + 1) * 140 * MS).unwrap();
        }
        let last = now + 100 * 140 * MS;
        assert_eq!(desk.wanted(last + DEAD_MAN).unwrap().targets, targets(0.65));
        assert_eq!(desk.wanted(last + DEAD_MAN + MS), None);
        // A beat that comes then, however right, is too late; so is another one with the next challenge.
        let late = desk.beat(&beat(102, 0.65), Token(103), last + DEAD_MAN + MS);
        assert!(matches!(late, Err(Refusal::Over(why)) if why.contains("silent for 150ms")));
        assert!(desk.beat(&beat(103, 0.65), Token(104), last + DEAD_MAN + 2 * MS).is_err());
    }

    #[test]
    fn a_beat_that_is_repeated_keeps_nothing() {
        let now = Instant::now();
        let mut desk = taken(now);
        desk.beat(&beat(2, 0.6), Token(3), now + 100 * MS).unwrap();
        assert_eq!(desk.beat(&beat(2, 0.6), Token(4), now + 200 * MS), Err(Refusal::Beat));
        assert_eq!(desk.wanted(now + 251 * MS), None);
    }

    #[test]
    fn a_challenge_arms_once_within_its_time_and_for_its_station() {
        let now = Instant::now();
        let refused = Err(Refusal::Challenge);
        let mut desk = free(now);
        assert_eq!(desk.arm(&arm("office", 1, 0.6), Token(9), STOPS, now), refused, "never given");
        desk.challenge(&name("office"), Token(1), STOPS, now).unwrap();
        assert_eq!(desk.arm(&arm("harbour", 1, 0.6), Token(9), STOPS, now), refused, "of another station");
        assert_eq!(desk.arm(&arm("office", 1, 0.6), Token(9), STOPS, now + 501 * MS), refused, "too old");
        desk.challenge(&name("office"), Token(2), STOPS, now).unwrap();
        assert!(desk.arm(&arm("office", 2, 0.8), Token(9), STOPS, now).is_err(), "outside the window");
        assert_eq!(desk.arm(&arm("office", 2, 0.6), Token(9), STOPS, now), refused, "used for a refusal");
        desk.challenge(&name("office"), Token(3), STOPS, now).unwrap();
        desk.arm(&arm("office", 3, 0.6), Token(4), STOPS, now).unwrap();
        desk.end("a stop");
        assert_eq!(desk.arm(&arm("office", 3, 0.6), Token(9), STOPS, now), refused, "used");
        // Of many that were asked for, the newest are good.
        (10..30).for_each(|token| assert!(desk.challenge(&name("office"), Token(token), STOPS, now).is_ok()));
        assert_eq!(desk.arm(&arm("office", 21, 0.6), Token(9), STOPS, now), refused);
        assert!(desk.arm(&arm("office", 22, 0.6), Token(9), STOPS, now).is_ok());
    }

    #[test]
    fn a_stop_after_the_challenge_keeps_it_from_arming() {
        let now = Instant::now();
        for axis in 0..=MAX_AXES {
            let (mut desk, mut stops) = (free(now), STOPS);
            desk.challenge(&name("office"), Token(1), STOPS, now).unwrap();
            stops[axis] += 1;
            assert_eq!(desk.arm(&arm("office", 1, 0.6), Token(2), stops, now), Err(Refusal::Stopped));
            desk.challenge(&name("office"), Token(3), stops, now).unwrap();
            desk.arm(&arm("office", 3, 0.6), Token(4), stops, now).unwrap();
            assert_eq!(desk.wanted(now).unwrap().stops, stops);
        }
    }

    #[test]
    fn one_station_operates_at_a_time() {
        let now = Instant::now();
        let mut desk = free(now);
        desk.challenge(&name("harbour"), Token(7), STOPS, now).unwrap();
        desk.challenge(&name("office"), Token(1), STOPS, now).unwrap();
        desk.arm(&arm("office", 1, 0.6), Token(2), STOPS, now).unwrap();
        let taken = Refusal::Taken(name("office"));
        assert_eq!(desk.arm(&arm("harbour", 7, 0.6), Token(9), STOPS, now), Err(taken.clone()));
        assert_eq!(desk.challenge(&name("harbour"), Token(8), STOPS, now), Err(taken.clone()));
        // Not even the same station again.
        assert_eq!(desk.challenge(&name("office"), Token(8), STOPS, now), Err(taken));
        assert!(desk.challenge(&name("harbour"), Token(8), STOPS, now + 151 * MS).is_ok());
    }

    #[test]
    fn the_end_of_the_consent_ends_the_seat() {
        let now = Instant::now();
        let mut desk = taken(now);
        desk.withdraw(now + MS);
        assert!(desk.wanted(now).is_some());
        assert_eq!(desk.wanted(now + MS), None);
        assert!(desk.beat(&beat(2, 0.6), Token(3), now + MS).is_err());
        assert_eq!(desk.challenge(&name("office"), Token(8), STOPS, now + MS), Err(Refusal::NoConsent));
        desk.withdraw(now + 500 * MS);
        assert_eq!(
            desk.challenge(&name("office"), Token(8), STOPS, now + 2 * MS),
            Err(Refusal::NoConsent),
            "taken back once"
        );
    }

    #[test]
    fn axes_and_targets_that_the_settings_do_not_allow_are_refused() {
        let now = Instant::now();
        for (wrong, why) in [
            (targets(0.49), "target 0.49 m; allowed: 0.5 to 0.7 m"),
            (targets(f64::NAN), "target NaN m"),
            (targets(f64::INFINITY), "target inf m"),
            (BTreeMap::from([("arm".to_owned(), 0.6)]), "axis \"arm\"; allowed: boom"),
            (BTreeMap::new(), "axis \"none\"; allowed: boom"),
        ] {
            let mut desk = free(now);
            desk.challenge(&name("office"), Token(1), STOPS, now).unwrap();
            let arm = Arm { station: name("office"), challenge: Token(1), targets: wrong.clone() };
            let error = desk.arm(&arm, Token(2), STOPS, now).unwrap_err().to_string();
            assert!(error.contains(why), "{error}");
            let mut desk = taken(now);
            let beat = Beat { challenge: Token(2), targets: wrong };
            assert_eq!(desk.beat(&beat, Token(3), now).unwrap_err().to_string(), error);
            assert_eq!(desk.wanted(now).unwrap().targets, targets(0.6));
        }
    }
}
