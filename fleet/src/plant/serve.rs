//! The plant behind a key of the router.

use std::{sync::Mutex, time::Instant};

use pipeline::{
    cdr,
    machine::Machine,
    message::{EncoderReading, ValveCommand},
};
use plant_sim::PlantError;
use thiserror::Error;
use zenoh::{
    Session, Wait,
    bytes::{Encoding, ZBytes},
    query::{Query, Queryable},
};

use super::{
    host::Host,
    request::{END, Request},
    simulated,
};
use crate::{
    content,
    key::{PLANT, Place},
};

/// Why a plant cannot be served.
#[derive(Debug, Error)]
pub enum ServeError {
    /// The machine cannot be simulated.
    #[error(transparent)]
    Plant(#[from] PlantError),
    /// Zenoh refuses the key.
    #[error("Zenoh: {0}")]
    Zenoh(#[from] zenoh::Error),
}

/// Answers requests to the plant of this machine for as long as what is returned lives. The beginning and the end of
/// a run are printed.
///
/// # Errors
/// The machine cannot be simulated, or Zenoh refuses the key.
pub fn serve(session: &Session, place: &Place, machine: &Machine, seed: u64) -> Result<Queryable<()>, ServeError> {
    let key = place.key(PLANT);
    let host = Mutex::new(Host::new(machine, seed)?);
    let callback = move |query: Query| {
        // A thread that has panicked may have left a step half done: then nobody is answered any more.
        let Ok(mut host) = host.lock() else { return };
        let before = host.run();
        let answer = answer(&mut host, &query);
        tell(before, host.run());
        // Whoever has asked may be gone, and then no answer reaches anybody.
        let _ = reply(&query, answer);
    };
    let queryable = session.declare_queryable(&key).complete(true).callback(callback).wait()?;
    println!("the plant of {}, {:016x}, with seed {seed} waits at {key}", machine.name, simulated(machine));
    Ok(queryable)
}

fn answer(host: &mut Host, query: &Query) -> Result<Option<EncoderReading>, String> {
    let bytes = |bytes: Option<&ZBytes>| bytes.map(|bytes| bytes.to_bytes().into_owned()).unwrap_or_default();
    let request = Request::of(&bytes(query.attachment())).ok_or("found no request; allowed: those of a stage")?;
    let command = if request.reading == END {
        ValveCommand::default()
    } else {
        let encoding = query.encoding().map(Encoding::to_string).unwrap_or_default();
        content::message(&encoding, &bytes(query.payload())).map_err(|error| error.to_string())?
    };
    host.answer(&request, &command, Instant::now()).map_err(|refusal| refusal.to_string())
}

fn reply(query: &Query, answer: Result<Option<EncoderReading>, String>) -> Result<(), zenoh::Error> {
    match answer {
        Ok(Some(reading)) => {
            let mut bytes = Vec::new();
            cdr::encode(&reading, &mut bytes);
            let encoding = content::name_of::<EncoderReading>();
            query.reply(query.key_expr(), bytes).encoding(encoding).express(true).wait()
        }
        Ok(None) => Ok(()),
        Err(why) => query.reply_err(why).encoding(Encoding::TEXT_PLAIN).wait(),
    }
}

/// Prints which run has ended and which has begun.
fn tell(before: Option<(u64, u64)>, after: Option<(u64, u64)>) {
    let number = |run: Option<(u64, u64)>| run.map(|(number, _)| number);
    if number(before) == number(after) {
        return;
    }
    if let Some((number, last)) = before {
        println!("run {number} has ended with reading {last}");
    }
    if let Some(number) = number(after) {
        println!("run {number} has begun");
    }
}
