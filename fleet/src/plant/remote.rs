//! The plant on another computer, as the stage sees it: a request is sent, repeated while no answer comes, and given
//! up after a while.
//!
//! Trap: a program that was suspended has heard no answer for as long. So not the time is counted, but the requests.

use std::{
    sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel},
    time::{Duration, Instant},
};

use humantime::format_duration;
use pipeline::{
    cdr,
    message::{EncoderReading, ValveCommand},
};
use thiserror::Error;
use zenoh::{
    Session, Wait,
    qos::CongestionControl,
    query::{ConsolidationMode, Reply},
};

use super::request::{END, Request};
use crate::content::{self, ContentError};

/// Time without an answer after which a request is sent once more.
const REPEAT: Duration = Duration::from_millis(500);
/// Longest time that the end of a run waits for the plant to hear of it.
const PARTING: Duration = Duration::from_millis(500);

/// Why the plant gives no further reading.
#[derive(Debug, Error)]
pub enum RemoteError {
    /// It has answered why.
    #[error("the plant at {key} refuses: {why}")]
    Refused {
        /// Its key.
        key: String,
        /// Its reason.
        why: String,
    },
    /// Nobody answers.
    #[error(
        "the plant at {key} has not answered {times} requests for reading {reading} within {}; allowed: an answer \
         within plant.patience of the settings: are `hydraxis-fleet plant` and the router running?",
        format_duration(*.patience)
    )]
    Silent {
        /// Its key.
        key: String,
        /// Number of the reading.
        reading: u64,
        /// Requests that were sent.
        times: u32,
        /// Time that was waited.
        patience: Duration,
    },
    /// The answer cannot be read.
    #[error("the plant at {key}: {source}")]
    Content {
        /// Its key.
        key: String,
        /// What is wrong.
        source: ContentError,
    },
}

/// A request without an answer.
struct Asked {
    reading: u64,
    /// The command that goes with it, as CDR.
    payload: Vec<u8>,
    since: Instant,
    last: Instant,
    times: u32,
}

/// The plant on another computer.
pub struct Remote {
    session: Session,
    key: String,
    /// What all requests have in common; its reading counts for none.
    common: Request,
    patience: Duration,
    asked: Option<Asked>,
    repeated: u64,
    answered: Sender<(u64, Reply)>,
    answers: Receiver<(u64, Reply)>,
}

impl Remote {
    /// The plant at `key`, whose requests have `run`, `seed` and `machine` of `common`, and have to be answered within
    /// `patience`.
    pub fn new(session: Session, key: String, common: Request, patience: Duration) -> Self {
        let (answered, answers) = channel();
        Self { session, key, common, patience, asked: None, repeated: 0, answered, answers }
    }

    /// Whether a request waits for its answer.
    pub fn is_asked(&self) -> bool {
        self.asked.is_some()
    }

    /// Asks for a reading. `command` answers the reading before.
    pub fn ask(&mut self, reading: u64, command: &ValveCommand) {
        let mut payload = Vec::new();
        cdr::encode(command, &mut payload);
        let now = Instant::now();
        self.send(reading, payload.clone());
        self.asked = Some(Asked { reading, payload, since: now, last: now, times: 1 });
    }

    /// Waits for the answer for a `slice` of time, and repeats the request when that is due; none while none comes.
    ///
    /// # Errors
    /// The plant refuses the request, answers what cannot be read, or has not answered for too long.
    pub fn answer(&mut self, slice: Duration) -> Result<Option<EncoderReading>, RemoteError> {
        match self.answers.recv_timeout(slice) {
            Ok((reading, reply)) => self.take(reading, reply),
            // The sender of this struct keeps the channel open.
            Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => self.repeat().map(|()| None),
        }
    }

    /// Takes an answer to a request for this reading; none where that is no longer asked for.
    fn take(&mut self, reading: u64, reply: Reply) -> Result<Option<EncoderReading>, RemoteError> {
        let Some(asked) = self.asked.take_if(|asked| asked.reading == reading) else { return Ok(None) };
        if asked.times > 1 {
            let (times, took) = (asked.times, asked.since.elapsed().as_secs_f64());
            eprintln!("the plant has answered for reading {reading} after {took:.1} s and {times} requests");
        }
        let key = || self.key.clone();
        let sample = reply.into_result().map_err(|error| {
            let why = error.payload().try_to_string().unwrap_or_default().into_owned();
            RemoteError::Refused { key: key(), why }
        })?;
        let answer = content::message(&sample.encoding().to_string(), &sample.payload().to_bytes());
        answer.map(Some).map_err(|source| RemoteError::Content { key: key(), source })
    }

    fn repeat(&mut self) -> Result<(), RemoteError> {
        let Some(asked) = self.asked.as_mut().filter(|asked| asked.last.elapsed() >= REPEAT) else { return Ok(()) };
        let (reading, times) = (asked.reading, asked.times);
        if REPEAT * times >= self.patience {
            let (key, patience) = (self.key.clone(), self.patience);
            return Err(RemoteError::Silent { key, reading, times, patience });
        }
        if times == 1 {
            eprintln!("no answer of the plant for reading {reading} within {}: asking again", format_duration(REPEAT));
        }
        (asked.last, asked.times) = (Instant::now(), times + 1);
        self.repeated += 1;
        let payload = asked.payload.clone();
        self.send(reading, payload);
        Ok(())
    }

    fn send(&self, reading: u64, payload: Vec<u8>) {
        let answered = self.answered.clone();
        let request = Request { reading, ..self.common };
        let query = self.session.get(&self.key).payload(payload).encoding(content::name_of::<ValveCommand>());
        let query = query.attachment(&request.to_bytes()[..]).consolidation(ConsolidationMode::None);
        // A link that is down must not hold the loop: the request is then lost, and repeated.
        let query = query.congestion_control(CongestionControl::Drop).express(true).timeout(self.patience);
        let sent = query.callback(move |reply| {
            // The stage may have ended.
            let _ = answered.send((reading, reply));
        });
        if let Err(error) = sent.wait() {
            eprintln!("a request for reading {reading} cannot be sent: {error}");
        }
    }

    /// Ends the run, so that the next one may begin at once. Returns how many requests were repeated.
    pub fn end(&mut self) -> u64 {
        let request = Request { reading: END, ..self.common };
        let query = self.session.get(&self.key).attachment(&request.to_bytes()[..]);
        let query = query.congestion_control(CongestionControl::Drop).express(true).timeout(PARTING);
        // A plant that does not hear of it makes room for the next run after a while.
        if let Ok(heard) = query.wait() {
            let _ = heard.recv_timeout(PARTING);
        }
        self.repeated
    }
}
