//! Answers to questions over the network: state, models, events, recordings.

use std::sync::Arc;

use pipeline::{cdr, message::CoefficientSnapshot};
use serde_json::json;
use zenoh::{
    Session, Wait,
    bytes::Encoding,
    query::{Query, Queryable},
};

use super::known::{Known, Models, Shared};
use crate::{
    content,
    key::{EVENTS, MODEL, Place, RECORDINGS, STATUS},
};

/// Answers for as long as what is returned lives.
///
/// # Errors
/// Zenoh refuses a key.
pub fn declare(session: &Session, place: &Place, shared: &Arc<Shared>) -> Result<Vec<Queryable<()>>, zenoh::Error> {
    let answer = |of: &str, answer: fn(&Known, &Place, &Query) -> Result<(), zenoh::Error>| {
        let (shared, place, key) = (Arc::clone(shared), place.clone(), place.key(of));
        let callback = move |query: Query| {
            // Whoever has asked may be gone, and then no answer reaches anybody.
            let _ = answer(&shared.known(), &place, &query);
        };
        session.declare_queryable(key).callback(callback).wait()
    };
    Ok(vec![
        answer(STATUS, |known, place, query| {
            send_json(query, place.key(STATUS), content::STATUS, known.status.clone())
        })?,
        answer(EVENTS, |known, place, query| {
            send_json(query, place.key(EVENTS), content::EVENT, json!(known.events).to_string().into_bytes())
        })?,
        answer(RECORDINGS, recordings)?,
        answer(MODEL, |known, place, query| match &known.model {
            Some(models) => send_models(query, place.key(MODEL), models),
            None => no_answer(query, "no models yet"),
        })?,
        answer(&format!("{MODEL}/*"), |known, place, query| {
            known.earlier.iter().try_for_each(|models| {
                let key = place.key(&format!("{MODEL}/{}", models.0.number));
                // A question may be about one of them.
                if query.key_expr().as_str() == key || query.key_expr().is_wild() {
                    return send_models(query, key, models);
                }
                Ok(())
            })
        })?,
    ])
}

fn recordings(known: &Known, place: &Place, query: &Query) -> Result<(), zenoh::Error> {
    match &known.recordings {
        Some(Ok(list)) => {
            send_json(query, place.key(RECORDINGS), content::RECORDINGS, json!(list).to_string().into_bytes())
        }
        Some(Err(error)) => no_answer(query, error),
        None => no_answer(query, "no folder of recordings is named, or it was not looked at yet"),
    }
}

fn send_json(query: &Query, key: String, schema: &str, bytes: Vec<u8>) -> Result<(), zenoh::Error> {
    query.reply(key, bytes).encoding(content::name_of_json(schema)).wait()
}

fn send_models(query: &Query, key: String, (stamp, models): &Models) -> Result<(), zenoh::Error> {
    let mut bytes = Vec::new();
    cdr::encode(&**models, &mut bytes);
    let encoding = content::name_of::<CoefficientSnapshot>();
    query.reply(key, bytes).encoding(encoding).attachment(&stamp.to_bytes()[..]).wait()
}

fn no_answer(query: &Query, why: &str) -> Result<(), zenoh::Error> {
    query.reply_err(why).encoding(Encoding::TEXT_PLAIN).wait()
}
