//! The machine's end: takes a stop at any time, and moves axes while a person at the machine lets it.

use std::{
    collections::BTreeMap,
    io,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::sleep,
    time::{Duration, Instant},
};

use pipeline::channel::Board;
use rustix::rand::{GetRandomFlags, getrandom};
use serde::{Serialize, de::DeserializeOwned};
use thiserror::Error;
use zenoh::{
    Session, Wait,
    bytes::Encoding,
    query::{Query, Queryable},
};

use super::{
    desk::Desk,
    journal::{Entry, Journal},
    protocol::{ARM, Answer, Arm, Ask, BEAT, Beat, CHALLENGE, Challenge, DISARM, Disarm, LONGEST, Token},
    relay::{End, Relay, states, stop_axes},
    shared::Shared,
};
use crate::{
    connection::ConnectionError,
    key::Place,
    settings::{Commands, Settings},
};

/// Time between two looks for a seat.
const LOOK: Duration = Duration::from_millis(5);

/// Why the machine takes no commands.
#[derive(Debug, Error)]
pub enum CommandError {
    /// The settings allow none.
    #[error("[commands]: found none in the settings; allowed: a table with `journal` and `axes`")]
    NoCommands,
    /// No axis may be moved.
    #[error("[commands.axes]: found none in the settings; allowed: a table for each axis that may be moved")]
    NoAxes,
    /// The consent is too long.
    #[error("--for {found}: allowed: at most {longest}, as `commands.longest-consent` says")]
    TooLong {
        /// What was asked for.
        found: humantime::FormattedDuration,
        /// What is allowed.
        longest: humantime::FormattedDuration,
    },
    /// The journal cannot be written.
    #[error("commands.journal: {0}")]
    Journal(#[from] io::Error),
    /// The router cannot be reached like this.
    #[error(transparent)]
    Connection(#[from] ConnectionError),
    /// Zenoh refuses a key.
    #[error("Zenoh: {0}")]
    Zenoh(#[from] zenoh::Error),
}

impl CommandError {
    /// Whether a file or an argument is wrong.
    pub fn is_usage(&self) -> bool {
        matches!(self, Self::NoCommands | Self::NoAxes | Self::TooLong { .. })
    }
}

/// Lets stations disarm the machine until `stop` is set.
///
/// # Errors
/// The settings have no commands, the journal cannot be written, or Zenoh refuses something.
pub fn listen(settings: &Settings, stop: &AtomicBool) -> Result<(), CommandError> {
    let shared = shared(settings, allowed(settings)?, Instant::now());
    shared.journal.write(&Entry { what: "listen", text: "begun".to_owned(), ..Entry::default() })?;
    let Some(session) = settings.connection().open_unless(|| stop.load(Ordering::Relaxed))? else { return Ok(()) };
    let _disarm = answer(&session, &settings.place(), DISARM, &shared, disarm)?;
    while !stop.load(Ordering::Relaxed) {
        sleep(LOOK);
    }
    Ok(session.close().wait()?)
}

/// Lets one station at a time move the axes of the settings, for `time` or until `stop` is set.
///
/// # Errors
/// As [`listen`]; the settings name no axis, or allow only a shorter time.
pub fn consent(settings: &Settings, time: Duration, stop: &AtomicBool) -> Result<(), CommandError> {
    let commands = allowed(settings)?;
    if commands.axes.is_empty() {
        return Err(CommandError::NoAxes);
    }
    if time > commands.longest_consent {
        let [found, longest] = [time, commands.longest_consent].map(humantime::format_duration);
        return Err(CommandError::TooLong { found, longest });
    }
    let until = Instant::now() + time;
    let shared = shared(settings, commands, until);
    let text = format!("given for {}", humantime::format_duration(time));
    shared.journal.write(&Entry { what: "consent", text, ..Entry::default() })?;
    let (connection, place) = (settings.connection(), settings.place());
    let Some(session) = connection.open_unless(|| stop.load(Ordering::Relaxed))? else { return Ok(()) };
    let _questions = [
        answer(&session, &place, DISARM, &shared, disarm)?,
        answer(&session, &place, CHALLENGE, &shared, challenge)?,
        answer(&session, &place, ARM, &shared, arm)?,
        answer(&session, &place, BEAT, &shared, beat)?,
    ];
    let why = serve(&shared, commands, until, stop);
    shared.desk().withdraw(Instant::now());
    shared.journal.write(&Entry { what: "consent", text: why, ..Entry::default() })?;
    Ok(session.close().wait()?)
}

/// Serves one seat after the other. Returns why the consent is over.
fn serve(shared: &Shared, commands: &Commands, until: Instant, stop: &AtomicBool) -> String {
    loop {
        if stop.load(Ordering::Relaxed) {
            return "taken back".to_owned();
        }
        if Instant::now() >= until {
            return "over: its time has passed".to_owned();
        }
        let Some(wanted) = shared.desk().wanted(Instant::now()) else {
            sleep(LOOK);
            continue;
        };
        let windows = wanted.targets.keys().filter_map(|axis| Some((axis.clone(), *commands.axes.get(axis)?)));
        let relay =
            shared.prefix().map_err(End::Seat).and_then(|prefix| Relay::open(&prefix, &windows.clone().collect()));
        let end = match relay {
            Ok(relay) => relay.serve(shared, stop),
            Err(end) => end,
        };
        let (End::Seat(why) | End::AtMachine(why)) = &end;
        shared.desk().end(why);
        shared.show(BTreeMap::new());
        let entry = Entry { what: "end", station: Some(wanted.station.to_string()), text: why.clone(), targets: None };
        if let Err(error) = shared.journal.write(&entry) {
            eprintln!("{error}");
        }
        if let End::AtMachine(why) = end {
            return format!("taken back: {why}");
        }
    }
}

fn allowed(settings: &Settings) -> Result<&Commands, CommandError> {
    settings.commands.as_ref().ok_or(CommandError::NoCommands)
}

fn shared(settings: &Settings, commands: &Commands, until: Instant) -> Arc<Shared> {
    let (journal, desk) = (Journal::new(commands.journal.clone()), Desk::new(until, commands.axes.clone()));
    Arc::new(Shared::new(settings.prefix(), journal, desk))
}

/// Answers one kind of question for as long as what is returned lives.
fn answer<Q: DeserializeOwned + 'static, A: Serialize + 'static>(
    session: &Session,
    place: &Place,
    of: &'static str,
    shared: &Arc<Shared>,
    answer: fn(&Shared, Q) -> Result<A, String>,
) -> Result<Queryable<()>, zenoh::Error> {
    let (shared, key) = (Arc::clone(shared), place.key(of));
    let own = key.clone();
    let callback = move |query: Query| {
        let answered = question(&query, &own).and_then(|question| answer(&shared, question));
        // Whoever has asked may be gone, and then no answer reaches anybody.
        let _ = match answered.and_then(|answer| serde_json::to_vec(&answer).map_err(|error| error.to_string())) {
            Ok(bytes) => query.reply(own.as_str(), bytes).encoding(Encoding::APPLICATION_JSON).wait(),
            Err(why) => {
                shared.journal.note(&Entry { what: "refused", text: format!("{of}: {why}"), ..Entry::default() });
                query.reply_err(why).encoding(Encoding::TEXT_PLAIN).wait()
            }
        };
    };
    session.declare_queryable(key).callback(callback).wait()
}

/// Reads a question. One to several machines at once is none.
fn question<Q: DeserializeOwned>(query: &Query, key: &str) -> Result<Q, String> {
    if query.key_expr().as_str() != key {
        return Err(format!("found the key {}; allowed: {key}", query.key_expr()));
    }
    let payload = query.payload().map(|payload| payload.to_bytes()).unwrap_or_default();
    if payload.len() > LONGEST {
        return Err(format!("found {} bytes; allowed: {LONGEST}", payload.len()));
    }
    serde_json::from_slice(&payload).map_err(|error| error.to_string())
}

fn disarm(shared: &Shared, disarm: Disarm) -> Result<super::protocol::Disarmed, String> {
    let prefix = shared.prefix()?;
    let board = Board::find(&prefix).map_err(|error| error.to_string())?;
    let board = board.ok_or_else(|| format!("no group \"{prefix}\" runs"))?;
    let machine = board.machine();
    let names: Vec<&str> = machine.names().collect();
    let place = |axis: &String| {
        let found = names.iter().position(|name| name == axis);
        found.ok_or_else(|| format!("axis \"{axis}\"; allowed: {}", names.join(", ")))
    };
    let axes: Vec<usize> = if disarm.axes.is_empty() {
        (0..names.len()).collect()
    } else {
        disarm.axes.iter().map(place).collect::<Result<_, _>>()?
    };
    let stopped = stop_axes(&board, axes.iter().copied());
    let of = axes.iter().map(|axis| names[*axis]).collect::<Vec<_>>().join(", ");
    let text = format!("{of}: {}", stopped.as_ref().err().map_or("off", String::as_str));
    shared.journal.note(&Entry { what: "disarm", station: Some(disarm.station.to_string()), text, targets: None });
    stopped.map(|()| states(&board))
}

fn challenge(shared: &Shared, ask: Ask) -> Result<Challenge, String> {
    let token = random()?;
    let challenge = shared.desk().challenge(&ask.station, token, Instant::now());
    challenge.map(|challenge| Challenge { challenge }).map_err(|refusal| refusal.to_string())
}

fn arm(shared: &Shared, arm: Arm) -> Result<Challenge, String> {
    let token = random()?;
    let (station, targets) = (Some(arm.station.to_string()), Some(arm.targets.clone()));
    let armed = shared.desk().arm(&arm, token, Instant::now());
    armed.as_ref().map_err(ToString::to_string)?;
    // What cannot be written down is not done.
    let written = shared.journal.write(&Entry { what: "arm", station, targets, text: "accepted".to_owned() });
    if let Err(error) = &written {
        shared.desk().end(&format!("the journal of the machine cannot be written: {error}"));
        return Err(shared.desk().ended().to_owned());
    }
    armed.map(|challenge| Challenge { challenge }).map_err(|refusal| refusal.to_string())
}

fn beat(shared: &Shared, beat: Beat) -> Result<Answer, String> {
    let token = random()?;
    let (before, challenge) = {
        let mut desk = shared.desk();
        let before = desk.wanted(Instant::now());
        (before, desk.beat(&beat, token, Instant::now()).map_err(|refusal| refusal.to_string())?)
    };
    if let Some(wanted) = before.filter(|wanted| wanted.targets != beat.targets) {
        let (station, targets) = (Some(wanted.station.to_string()), Some(beat.targets));
        shared.journal.note(&Entry { what: "target", station, targets, text: "accepted".to_owned() });
    }
    Ok(Answer { challenge, axes: shared.view() })
}

fn random() -> Result<Token, String> {
    let mut bytes = [0; 16];
    match getrandom(&mut bytes, GetRandomFlags::empty()) {
        Ok(16) => Ok(Token(u128::from_le_bytes(bytes))),
        _ => Err("the machine has no random numbers".to_owned()),
    }
}
