//! The machine's end: takes a stop at any time, and moves axes while a person at the machine lets it.

use std::{
    collections::BTreeMap,
    fs::File,
    io,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::sleep,
    time::{Duration, Instant},
};

use pipeline::{
    MAX_AXES,
    channel::{Board, Prefix, is_joined, remove_leftovers},
};
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
    protocol::{ARM, Answer, Arm, Ask, BEAT, Beat, CHALLENGE, Challenge, DISARM, Disarm, Disarmed, LONGEST, Token},
    relay::{End, Relay, board, expect_axes, expect_off, states, stop_axes},
    shared::{NO_GROUP, Shared},
};
use crate::{
    connection::ConnectionError,
    group::only_one,
    key::Place,
    settings::{Commands, Settings},
};

/// Time between two looks for a seat, and for the group.
const LOOK: Duration = Duration::from_millis(5);
const GROUP_APART: Duration = Duration::from_millis(250);

/// Why the machine takes no commands.
#[derive(Debug, Error)]
pub enum CommandError {
    /// The settings allow none.
    #[error("[commands]: found none in the settings; allowed: a table with `journal` and `axes`")]
    NoCommands,
    /// No axis may be moved.
    #[error("[commands.axes]: found none in the settings; allowed: a table for each axis that may be moved")]
    NoAxes,
    /// The consent is too short or too long.
    #[error("--for {found}: allowed: 1s to {longest}, as `commands.longest-consent` says")]
    Time {
        /// What was asked for.
        found: humantime::FormattedDuration,
        /// What is allowed.
        longest: humantime::FormattedDuration,
    },
    /// No group runs, or the axes of the settings are not those of the group.
    #[error("{0}")]
    Group(String),
    /// Somebody has given consent already.
    #[error("group \"{0}\": another `hydraxis-fleet consent` runs; end that one first")]
    Given(Prefix),
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
        matches!(self, Self::NoCommands | Self::NoAxes | Self::Time { .. })
    }
}

/// Lets stations disarm the machine until `stop` is set, also where the journal cannot be written.
///
/// # Errors
/// The settings have no commands, or Zenoh refuses something.
pub fn listen(settings: &Settings, stop: &AtomicBool) -> Result<(), CommandError> {
    let shared = shared(settings.prefix(), allowed(settings)?, Instant::now());
    shared.journal.tell(&Entry { what: "listen", text: "begun".to_owned(), ..Entry::default() });
    let Some(session) = settings.connection().open_unless(|| stop.load(Ordering::Relaxed))? else { return Ok(()) };
    let _disarm = answer(&session, &settings.place(), DISARM, &shared, disarm)?;
    while !stop.load(Ordering::Relaxed) {
        sleep(LOOK);
    }
    Ok(session.close().wait()?)
}

/// Lets one station at a time move the axes of the settings in the group that runs, for `time` or until `stop` is set.
///
/// # Errors
/// The settings have no commands or no axis, no group runs or it has other axes, somebody has given consent already,
/// the time is too short or too long, the journal cannot be written, or Zenoh refuses something.
pub fn consent(settings: &Settings, time: Duration, stop: &AtomicBool) -> Result<(), CommandError> {
    let commands = allowed(settings)?;
    if commands.axes.is_empty() {
        return Err(CommandError::NoAxes);
    }
    if !(Duration::from_secs(1)..=commands.longest_consent).contains(&time) {
        let [found, longest] = [time, commands.longest_consent].map(humantime::format_duration);
        return Err(CommandError::Time { found, longest });
    }
    let prefix = settings.prefix().or_else(only_one);
    let prefix = prefix.ok_or_else(|| CommandError::Group(NO_GROUP.to_owned()))?;
    let board = board(&prefix).map_err(CommandError::Group)?;
    expect_axes(&board, &commands.axes).map_err(CommandError::Group)?;
    let only =
        File::open(prefix.folder()).map_err(|error| CommandError::Group(format!("group \"{prefix}\": {error}")))?;
    only.try_lock().map_err(|_| CommandError::Given(prefix.clone()))?;
    let until = Instant::now() + time;
    let shared = shared(Some(prefix), commands, until);
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
    let why = serve(&shared, &board, commands, until, stop);
    shared.desk().withdraw(Instant::now());
    shared.journal.tell(&Entry { what: "consent", text: why, ..Entry::default() });
    Ok(session.close().wait()?)
}

/// Serves one seat after the other. Returns why the consent is over.
fn serve(shared: &Shared, board: &Board, commands: &Commands, until: Instant, stop: &AtomicBool) -> String {
    let (emergencies, mut looked) = (board.asked()[MAX_AXES], Instant::now());
    loop {
        if stop.load(Ordering::Relaxed) {
            return "taken back".to_owned();
        }
        if Instant::now() >= until {
            return "over: its time has passed".to_owned();
        }
        if board.asked()[MAX_AXES] != emergencies {
            return "taken back: an emergency stop was asked for".to_owned();
        }
        // A consent is for one run of the group.
        if looked.elapsed() > GROUP_APART {
            looked = Instant::now();
            if !is_joined(board.prefix()) {
                return "over: the group has ended".to_owned();
            }
        }
        let Some(wanted) = shared.desk().wanted(Instant::now()) else {
            sleep(LOOK);
            continue;
        };
        let windows = wanted.targets.keys().filter_map(|axis| Some((axis.clone(), *commands.axes.get(axis)?)));
        let end = match Relay::open(board.prefix(), &windows.collect(), wanted.stops) {
            Ok(relay) => relay.serve(shared, stop),
            Err(end) => end,
        };
        // The relay may have been the last member of a group that ended meanwhile.
        let _ = remove_leftovers(board.prefix());
        let (End::Seat(why) | End::AtMachine(why)) = &end;
        shared.desk().end(why);
        shared.show(BTreeMap::new());
        let station = Some(wanted.station.to_string());
        shared.journal.tell(&Entry { what: "end", station, text: why.clone(), targets: None });
        if let End::AtMachine(why) = end {
            return format!("taken back: {why}");
        }
    }
}

fn allowed(settings: &Settings) -> Result<&Commands, CommandError> {
    settings.commands.as_ref().ok_or(CommandError::NoCommands)
}

fn shared(group: Option<Prefix>, commands: &Commands, until: Instant) -> Arc<Shared> {
    let (journal, desk) = (Journal::new(commands.journal.clone()), Desk::new(until, commands.axes.clone()));
    Arc::new(Shared::new(group, journal, desk))
}

/// Answers one kind of question for as long as what is returned lives. `answer` gets what was read of a question.
fn answer<Q: DeserializeOwned + 'static, A: Serialize + 'static>(
    session: &Session,
    place: &Place,
    of: &'static str,
    shared: &Arc<Shared>,
    answer: fn(&Shared, Result<Q, String>) -> Result<A, String>,
) -> Result<Queryable<()>, zenoh::Error> {
    let (shared, key) = (Arc::clone(shared), place.key(of));
    let own = key.clone();
    let callback = move |query: Query| {
        let answered = expect_key(&query, &own).and_then(|()| answer(&shared, question(&query)));
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

/// A question to several machines at once is none.
fn expect_key(query: &Query, key: &str) -> Result<(), String> {
    let found = query.key_expr();
    if found.as_str() == key { Ok(()) } else { Err(format!("found the key {found}; allowed: {key}")) }
}

fn question<Q: DeserializeOwned>(query: &Query) -> Result<Q, String> {
    let payload = query.payload().map(|payload| payload.to_bytes()).unwrap_or_default();
    if payload.len() > LONGEST {
        return Err(format!("found {} bytes; allowed: {LONGEST}", payload.len()));
    }
    serde_json::from_slice(&payload).map_err(|error| error.to_string())
}

/// Stops what is named. A stop is not refused for its form: one that cannot be read, or names an axis that is not
/// there, stops all axes.
fn disarm(shared: &Shared, disarm: Result<Disarm, String>) -> Result<Disarmed, String> {
    let prefix = shared.prefix()?;
    let board = Board::find(&prefix).map_err(|error| error.to_string())?;
    let board = board.ok_or_else(|| format!("no group \"{prefix}\" runs"))?;
    let names: Vec<&str> = board.machine().names().collect();
    let (station, named, note) = match disarm {
        Ok(disarm) => {
            let place = |axis: &String| names.iter().position(|name| name == axis);
            let named = disarm.axes.iter().map(place).collect::<Option<Vec<usize>>>();
            (Some(disarm.station.to_string()), named, String::new())
        }
        Err(error) => (None, None, format!("; the question cannot be read: {error}")),
    };
    let axes = named.filter(|named| !named.is_empty()).unwrap_or_else(|| (0..names.len()).collect());
    let stopped = stop_axes(&board, axes.iter().copied());
    let of = axes.iter().map(|axis| names[*axis]).collect::<Vec<_>>().join(", ");
    let text = format!("{of}: {}{note}", stopped.as_ref().err().map_or("off", String::as_str));
    shared.journal.note(&Entry { what: "disarm", station, text, targets: None });
    stopped.map(|()| states(&board))
}

fn challenge(shared: &Shared, ask: Result<Ask, String>) -> Result<Challenge, String> {
    let (ask, token, stops) = (ask?, random()?, board(&shared.prefix()?)?.asked());
    let challenge = shared.desk().challenge(&ask.station, token, stops, Instant::now());
    challenge.map(|challenge| Challenge { challenge }).map_err(|refusal| refusal.to_string())
}

fn arm(shared: &Shared, arm: Result<Arm, String>) -> Result<Challenge, String> {
    let (arm, token, board) = (arm?, random()?, board(&shared.prefix()?)?);
    let armed = shared.desk().arm(&arm, token, board.asked(), Instant::now());
    let challenge = armed.map_err(|refusal| refusal.to_string())?;
    let (station, targets) = (Some(arm.station.to_string()), Some(arm.targets.clone()));
    let ready = expect_off(&board, arm.targets.keys()).and_then(|()| {
        // What cannot be written down is not done.
        let entry = Entry { what: "arm", station, targets, text: "accepted".to_owned() };
        let written = shared.journal.write(&entry);
        written.map_err(|error| format!("the journal of the machine cannot be written: {error}"))
    });
    ready.inspect_err(|why| shared.desk().end(why)).map(|()| Challenge { challenge })
}

fn beat(shared: &Shared, beat: Result<Beat, String>) -> Result<Answer, String> {
    let (beat, token) = (beat?, random()?);
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
