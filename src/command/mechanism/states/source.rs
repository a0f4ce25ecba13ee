//! The text of a file of states, and its JSON.
//!
//! Trap: JSON leaves open what a key means that is given twice, and parsers take one of the two without a word. Here
//! it is refused.

use std::{
    fmt, fs,
    io::{self, Read},
    path::Path,
};

use serde::{
    Deserialize, Deserializer,
    de::{Error, MapAccess, SeqAccess, Visitor},
};
use serde_json::{Map, Value, error::Category};

/// Longest file, bytes: some hundred thousand states. A file that does not end would fill the memory.
const LONGEST: u64 = 1 << 26;

/// The mark at the begin of the file that some editors write.
const BYTE_ORDER_MARK: char = '\u{feff}';

/// Reads the file, or standard input for `-`.
///
/// # Errors
/// What was found and what is allowed, where the file cannot be read or is no JSON.
pub fn read(file: &Path) -> Result<Value, String> {
    let unreadable = |error: io::Error| {
        format!("found a file that cannot be read ({error}); allowed: a JSON file with states, or - for standard input")
    };
    let source: Box<dyn Read> = match file {
        file if file == Path::new("-") => Box::new(io::stdin()),
        file => Box::new(fs::File::open(file).map_err(unreadable)?),
    };
    let mut bytes = Vec::new();
    source.take(LONGEST + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    if bytes.len() as u64 > LONGEST {
        return Err(format!("found more than {LONGEST} bytes; allowed: up to that many"));
    }
    let text = String::from_utf8(bytes).map_err(|error| format!("found no text: {error}; allowed: JSON in UTF-8"))?;
    parse(text.strip_prefix(BYTE_ORDER_MARK).unwrap_or(&text))
}

fn parse(text: &str) -> Result<Value, String> {
    let parsed: Result<Unique, _> = serde_json::from_str(text);
    parsed.map(|value| value.0).map_err(|error| match error.classify() {
        Category::Data => format!("found {error}; allowed: each key once"),
        _ => format!("found no JSON: {error}; allowed: JSON, which has no NaN and no infinity"),
    })
}

/// A value in whose objects every key is given once.
struct Unique(Value);

impl<'de> Deserialize<'de> for Unique {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(OfAnyKind).map(Self)
    }
}

struct OfAnyKind;

impl<'de> Visitor<'de> for OfAnyKind {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a value of JSON")
    }

    fn visit_unit<E: Error>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_bool<E: Error>(self, value: bool) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_str<E: Error>(self, value: &str) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Value, A::Error> {
        let mut list = Vec::new();
        while let Some(Unique(item)) = items.next_element()? {
            list.push(item);
        }
        Ok(Value::Array(list))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<Value, A::Error> {
        let mut object = Map::new();
        while let Some(key) = entries.next_key::<String>()? {
            if object.contains_key(&key) {
                return Err(Error::custom(format!("the key \"{key}\" twice")));
            }
            let Unique(value) = entries.next_value()?;
            object.insert(key, value);
        }
        Ok(Value::Object(object))
    }
}
