//! What a receiver knows of all machines, and how old it is.
//!
//! Zenoh delivers what was queued before a frozen program or a lost link came back as it delivers what is new. So every
//! message is judged here:
//!
//! | of a message | is wrong when | then |
//! |---|---|---|
//! | encoding | it is not the one of its key | refused: `unknown` |
//! | attachment, payload | it has another length | refused: `malformed` |
//! | run and number | the number does not rise within a run | refused: `repeated` |
//! | run | it is another one, and the message is not fresh | refused: `repeated` |
//! | number | it leaves numbers out | taken; those left out are `lost` |
//! | time | it is older than the limit, or is still to come | taken with its age; `late` |
//!
//! The age is by the clocks of both computers, so both have to be set (NTP, PTP). A clock that is wrong makes messages
//! look old or still to come, and never fresh by more than the difference of the clocks.

use std::{collections::BTreeMap, time::Duration};

use pipeline::message::{CoefficientSnapshot, EncoderSample, MachineState, StageHealth, ValveCommand};
use serde_json::Value;

use crate::{
    content::{Content, ContentError},
    key::{ALIVE, Place},
    stamp::Stamp,
};

/// How far a clock may be ahead, ns: two clocks that are set by NTP differ by some milliseconds.
const AHEAD_NS: i64 = 100_000_000;

/// What became of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// It is new.
    Fresh,
    /// It is the newest of its key, and old.
    Late,
    /// Its encoding is not known.
    Unknown,
    /// It is not one message.
    Malformed,
    /// It was there before, or is of a run that is over.
    Repeated,
    /// Its key is none of a machine.
    Stranger,
}

/// Messages of a machine, by what became of them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub struct Counts {
    /// Taken.
    pub received: u64,
    /// Sent and never received, by the gaps in their numbers.
    pub lost: u64,
    /// Taken, and older than the limit when they came.
    pub late: u64,
    /// Refused for their encoding.
    pub unknown: u64,
    /// Refused for their length.
    pub malformed: u64,
    /// Refused because they were there before.
    pub repeated: u64,
    /// Starts of the bridge.
    pub restarts: u64,
}

/// The newest of a machine.
#[derive(Debug, Default)]
pub struct Newest {
    /// Positions.
    pub sample: Option<Box<EncoderSample>>,
    /// Valve commands.
    pub command: Option<Box<ValveCommand>>,
    /// Names, modes and models of the axes.
    pub state: Option<Box<MachineState>>,
    /// Heartbeats by stage.
    pub health: [Option<Box<StageHealth>>; 4],
    /// Models.
    pub model: Option<Box<CoefficientSnapshot>>,
    /// State of the bridge.
    pub status: Option<Value>,
    /// The last event.
    pub event: Option<Value>,
}

impl Newest {
    fn take(&mut self, content: Content) {
        match content {
            Content::Sample(sample) => self.sample = Some(sample),
            Content::Command(command) => self.command = Some(command),
            Content::State(state) => self.state = Some(state),
            Content::Health(health) => {
                if let Some(place) = self.health.get_mut(health.stage as usize) {
                    *place = Some(health);
                }
            }
            Content::Model(model) => self.model = Some(model),
            Content::Status(status) => self.status = Some(status),
            Content::Event(event) => self.event = Some(event),
        }
    }
}

/// A machine as a receiver sees it.
#[derive(Debug, Default)]
pub struct Machine {
    /// Whether the token of its bridge is there. It goes 2 s after the bridge has lost its link: it is no dead man.
    pub is_alive: bool,
    /// Messages by what became of them.
    pub counts: Counts,
    /// The newest of each kind.
    pub newest: Newest,
    /// Stamps of the newest messages by key.
    pub stamps: BTreeMap<String, Stamp>,
    /// Numbers of events and heartbeats rise like those of all keys; the run is common to all.
    run: Option<u64>,
}

impl Machine {
    /// Age of what stands under a key, ns; none before the first message. Negative where its time is still to come.
    pub fn age_ns(&self, key: &str, now_ns: i64) -> Option<i64> {
        Some(self.stamps.get(key)?.age_ns(now_ns))
    }

    /// Takes the numbers of a message; false where it was there before.
    fn number(&mut self, key: &str, stamp: Stamp, is_fresh: bool) -> bool {
        let is_same_run = self.run == Some(stamp.run);
        let before = self.stamps.get(key).filter(|before| before.run == stamp.run);
        if let Some(before) = before {
            if stamp.number <= before.number {
                return false;
            }
            self.counts.lost = self.counts.lost.saturating_add(stamp.number - before.number - 1);
        } else if self.run.is_some() && !is_same_run {
            // A bridge that has started again says so with messages that are new. Others are of a run that is over.
            if !is_fresh {
                return false;
            }
            self.counts.restarts += 1;
        }
        self.run = Some(stamp.run);
        true
    }
}

/// All machines.
#[derive(Debug)]
pub struct Fleet {
    limit_ns: i64,
    /// Messages under keys of no machine.
    pub strangers: u64,
    machines: BTreeMap<Place, Machine>,
}

impl Fleet {
    /// Of nobody yet; a message is fresh for so long.
    pub fn new(limit: Duration) -> Self {
        Self { limit_ns: limit.as_nanos() as i64, strangers: 0, machines: BTreeMap::new() }
    }

    /// All machines that were heard of.
    pub fn machines(&self) -> &BTreeMap<Place, Machine> {
        &self.machines
    }

    /// Messages of all machines together, by what became of them.
    pub fn counts(&self) -> Counts {
        self.machines.values().fold(Counts::default(), |sum, machine| Counts {
            received: sum.received + machine.counts.received,
            lost: sum.lost.saturating_add(machine.counts.lost),
            late: sum.late + machine.counts.late,
            unknown: sum.unknown + machine.counts.unknown,
            malformed: sum.malformed + machine.counts.malformed,
            repeated: sum.repeated + machine.counts.repeated,
            restarts: sum.restarts + machine.counts.restarts,
        })
    }

    /// Whether something of this age is fresh.
    pub fn is_fresh(&self, age_ns: i64) -> bool {
        (-AHEAD_NS..=self.limit_ns).contains(&age_ns)
    }

    /// A token has come or gone.
    pub fn alive(&mut self, key: &str, is_alive: bool) {
        if let Some((place, ALIVE)) = Place::of(key) {
            self.machines.entry(place).or_default().is_alive = is_alive;
        }
    }

    /// Takes a message that has come at `now_ns`.
    pub fn take(&mut self, key: &str, encoding: &str, payload: &[u8], attachment: &[u8], now_ns: i64) -> Verdict {
        let found = Place::of(key).and_then(|(place, of)| Some((place, of, Content::of(of, encoding, payload)?)));
        let Some((place, of, content)) = found else {
            self.strangers += 1;
            return Verdict::Stranger;
        };
        let stamp = Stamp::of(attachment);
        let is_fresh = stamp.is_some_and(|stamp| self.is_fresh(stamp.age_ns(now_ns)));
        let machine = self.machines.entry(place).or_default();
        let (content, stamp) = match (content, stamp) {
            (Ok(content), Some(stamp)) => (content, stamp),
            (Err(ContentError::Unknown { .. }), _) => {
                machine.counts.unknown += 1;
                return Verdict::Unknown;
            }
            (Err(ContentError::Malformed { .. }), _) | (_, None) => {
                machine.counts.malformed += 1;
                return Verdict::Malformed;
            }
        };
        if !machine.number(of, stamp, is_fresh) {
            machine.counts.repeated += 1;
            return Verdict::Repeated;
        }
        machine.stamps.insert(of.to_owned(), stamp);
        machine.counts.received += 1;
        machine.newest.take(content);
        // Models and events come when they change, so their age says nothing about the link.
        if is_fresh {
            return Verdict::Fresh;
        }
        machine.counts.late += 1;
        Verdict::Late
    }
}

#[cfg(test)]
mod tests {
    use pipeline::{cdr, message::EncoderSample};

    use super::*;
    use crate::content;

    const KEY: &str = "hydraxis/v1/quarry/ex-07/telemetry/encoder-sample";
    const SECOND: i64 = 1_000_000_000;

    struct Receiver {
        fleet: Fleet,
        now_ns: i64,
    }

    impl Receiver {
        fn new() -> Self {
            Self { fleet: Fleet::new(Duration::from_secs(1)), now_ns: 1000 * SECOND }
        }

        /// A sample of this age.
        fn take(&mut self, run: u64, number: u64, age_ns: i64) -> Verdict {
            let mut payload = Vec::new();
            cdr::encode(&EncoderSample::default(), &mut payload);
            let stamp = Stamp { run, number, utc_ns: self.now_ns - age_ns, clock_error_ns: 0 };
            let encoding = content::name_of::<EncoderSample>();
            self.fleet.take(KEY, &encoding, &payload, &stamp.to_bytes(), self.now_ns)
        }

        fn counts(&self) -> Counts {
            self.fleet.machines.values().next().unwrap().counts
        }
    }

    #[test]
    fn gaps_are_lost_and_what_was_there_before_is_refused() {
        let mut receiver = Receiver::new();
        for (number, verdict) in [
            (5, Verdict::Fresh),
            (6, Verdict::Fresh),
            (6, Verdict::Repeated),
            (9, Verdict::Fresh),
            (7, Verdict::Repeated),
            (10, Verdict::Fresh),
        ] {
            assert_eq!(receiver.take(1, number, 0), verdict, "{number}");
        }
        let expected = Counts { received: 4, lost: 2, repeated: 2, ..Counts::default() };
        assert_eq!(receiver.counts(), expected);
    }

    #[test]
    fn what_was_queued_for_long_is_never_fresh() {
        let mut receiver = Receiver::new();
        assert_eq!(receiver.take(1, 0, 0), Verdict::Fresh);
        assert_eq!(receiver.take(1, 1, 20 * SECOND), Verdict::Late);
        assert_eq!(receiver.take(1, 2, SECOND + 1), Verdict::Late);
        assert_eq!(receiver.take(1, 3, SECOND), Verdict::Fresh);
        // A time that is still to come says that a clock is wrong.
        assert_eq!(receiver.take(1, 4, -SECOND), Verdict::Late);
        assert_eq!(receiver.counts().late, 3);
        // It ages also when nothing comes any more.
        let machine = receiver.fleet.machines.values().next().unwrap();
        let age = machine.age_ns("telemetry/encoder-sample", receiver.now_ns + 5 * SECOND).unwrap();
        assert!(!receiver.fleet.is_fresh(age));
    }

    #[test]
    fn a_bridge_may_start_again_and_its_run_before_may_not_come_back() {
        let mut receiver = Receiver::new();
        assert_eq!(receiver.take(7, 100, 0), Verdict::Fresh);
        assert_eq!(receiver.take(8, 0, 0), Verdict::Fresh);
        // Recorded on the network and sent once more.
        assert_eq!(receiver.take(7, 101, 5 * SECOND), Verdict::Repeated);
        assert_eq!(receiver.take(8, 1, 0), Verdict::Fresh);
        let expected = Counts { received: 3, restarts: 1, repeated: 1, ..Counts::default() };
        assert_eq!(receiver.counts(), expected);
    }

    #[test]
    fn numbers_and_times_at_the_ends_of_their_range_are_judged_like_others() {
        let mut receiver = Receiver::new();
        receiver.now_ns = -1;
        assert_eq!(receiver.take(1, 0, i64::MAX), Verdict::Late, "the least time that there is");
        let machine = receiver.fleet.machines.values().next().unwrap();
        assert_eq!(machine.age_ns("telemetry/encoder-sample", 1000 * SECOND), Some(i64::MAX));
        for (run, number) in [(2, 0), (2, u64::MAX), (3, 0), (3, u64::MAX)] {
            assert_eq!(receiver.take(run, number, 0), Verdict::Fresh);
        }
        assert_eq!((receiver.counts().lost, receiver.fleet.counts().lost), (u64::MAX, u64::MAX));
    }

    #[test]
    fn another_encoding_length_or_key_is_refused_and_counted() {
        let mut receiver = Receiver::new();
        let (encoding, stamp) = (content::name_of::<EncoderSample>(), [0; 32]);
        let mut payload = Vec::new();
        cdr::encode(&EncoderSample::default(), &mut payload);
        let fleet = &mut receiver.fleet;
        let other = encoding.replace("EncoderSample:", "EncoderSample:0");
        assert_eq!(fleet.take(KEY, &other, &payload, &stamp, 0), Verdict::Unknown);
        assert_eq!(fleet.take(KEY, &encoding, &payload[1..], &stamp, 0), Verdict::Malformed);
        assert_eq!(fleet.take(KEY, &encoding, &payload, &stamp[1..], 0), Verdict::Malformed);
        let elsewhere = KEY.replace("encoder-sample", "request");
        assert_eq!(fleet.take(&elsewhere, &encoding, &payload, &stamp, 0), Verdict::Stranger);
        assert_eq!(fleet.strangers, 1);
        assert_eq!(receiver.counts(), Counts { unknown: 1, malformed: 2, ..Counts::default() });
    }

    #[test]
    fn a_token_that_comes_and_goes_is_seen() {
        let mut fleet = Fleet::new(Duration::from_secs(1));
        let key = "hydraxis/v1/quarry/ex-07/alive";
        let is_alive = |fleet: &Fleet| fleet.machines.values().next().unwrap().is_alive;
        fleet.alive(key, true);
        assert!(is_alive(&fleet));
        fleet.alive(key, false);
        assert!(!is_alive(&fleet));
    }
}
