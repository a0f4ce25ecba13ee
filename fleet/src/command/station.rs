//! The other end: a person at another computer who stops or moves axes of a machine.

use std::{
    collections::BTreeMap,
    sync::atomic::{AtomicBool, Ordering},
    thread::sleep,
    time::{Duration, Instant},
};

use serde::{Serialize, de::DeserializeOwned};
use thiserror::Error;
use zenoh::{
    Session, Wait,
    qos::{CongestionControl, Priority},
};

use super::protocol::{ARM, Answer, Arm, Ask, BEAT, Beat, CHALLENGE, Challenge, DISARM, Disarm, Disarmed};
use crate::key::{Name, Place};

/// Time between two beats.
const BEAT_PERIOD: Duration = Duration::from_millis(50);
/// Time in which the machine has to answer.
const ANSWER: Duration = Duration::from_millis(500);
/// Time in which it has to answer a stop: control-proc has a second.
const STOP_ANSWER: Duration = Duration::from_secs(2);

/// Why a machine does not do what a station asks.
#[derive(Debug, Error)]
pub enum StationError {
    /// The machine says no.
    #[error("{key}: {why}")]
    Refused {
        /// The question.
        key: String,
        /// Its reason.
        why: String,
    },
    /// Nobody answers.
    #[error(
        "{key}: nobody has answered within {}: the machine is not connected, does not take commands or has no \
         consent, or this certificate may not ask",
        humantime::format_duration(*.patience)
    )]
    NoAnswer {
        /// The question.
        key: String,
        /// How long it was waited for.
        patience: Duration,
    },
    /// The answer is of another version.
    #[error("{key}: found an answer of another version: {source}")]
    Answer {
        /// The question.
        key: String,
        /// What is wrong with it.
        source: serde_json::Error,
    },
    /// Zenoh refuses the question.
    #[error("Zenoh: {0}")]
    Zenoh(#[from] zenoh::Error),
}

/// A station for one machine.
pub struct Station<'a> {
    /// The connection.
    pub session: &'a Session,
    /// The machine.
    pub place: Place,
    /// What the station calls itself.
    pub name: Name,
}

impl Station<'_> {
    /// Stops axes; all where none is named.
    ///
    /// # Errors
    /// The machine does not answer, or refuses.
    pub fn disarm(&self, axes: Vec<String>) -> Result<Disarmed, StationError> {
        self.ask(DISARM, &Disarm { station: self.name.clone(), axes }, STOP_ANSWER)
    }

    /// Arms axes, moves them to these set points (m), and keeps them there until `stop` is set. They are off when it
    /// returns, as far as the machine could be told; without this station they are off by themselves.
    ///
    /// # Errors
    /// The machine refuses, does not answer, or has switched them off.
    pub fn operate(
        &self,
        targets: &BTreeMap<String, f64>,
        stop: &AtomicBool,
        tell: impl FnMut(&Answer),
    ) -> Result<(), StationError> {
        let operated = self.keep(targets, stop, tell);
        if operated.is_ok() {
            self.disarm(targets.keys().cloned().collect())?;
        }
        operated
    }

    fn keep(
        &self,
        targets: &BTreeMap<String, f64>,
        stop: &AtomicBool,
        mut tell: impl FnMut(&Answer),
    ) -> Result<(), StationError> {
        let Challenge { challenge } = self.ask(CHALLENGE, &Ask { station: self.name.clone() }, ANSWER)?;
        let arm = Arm { station: self.name.clone(), challenge, targets: targets.clone() };
        let Challenge { mut challenge } = self.ask(ARM, &arm, ANSWER)?;
        while !stop.load(Ordering::Relaxed) {
            let asked = Instant::now();
            let answer: Answer = self.ask(BEAT, &Beat { challenge, targets: targets.clone() }, ANSWER)?;
            challenge = answer.challenge;
            tell(&answer);
            sleep(BEAT_PERIOD.saturating_sub(asked.elapsed()));
        }
        Ok(())
    }

    /// Asks, and takes the first answer that is no refusal.
    fn ask<Q: Serialize, A: DeserializeOwned>(
        &self,
        of: &str,
        question: &Q,
        patience: Duration,
    ) -> Result<A, StationError> {
        let key = self.place.key(of);
        let wrong = |key: &str, source| StationError::Answer { key: key.to_owned(), source };
        let payload = serde_json::to_vec(question).map_err(|source| wrong(&key, source))?;
        let answers = self.session.get(&key).payload(payload).timeout(patience);
        let answers = answers.congestion_control(CongestionControl::Drop).priority(Priority::InteractiveHigh);
        let answers = answers.express(true).wait()?;
        let mut refused = None;
        while let Ok(answer) = answers.recv() {
            match answer.into_result() {
                Ok(sample) => {
                    return serde_json::from_slice(&sample.payload().to_bytes()).map_err(|source| wrong(&key, source));
                }
                Err(error) => refused = error.payload().try_to_string().ok().map(|why| why.into_owned()),
            }
        }
        match refused {
            // Zenoh itself says so.
            Some(why) if why == "Timeout" => Err(StationError::NoAnswer { key, patience }),
            Some(why) => Err(StationError::Refused { key, why }),
            None => Err(StationError::NoAnswer { key, patience }),
        }
    }
}
