//! Messages with their signals: those of a DBC file, and those that are written in the machine file.
//!
//! A DBC file is read by the crate `can-dbc`. A message of more than 8 bytes is one of CAN FD, and so is one whose
//! attribute `VFrameFormat` says it. Signals that are there only for one value of a multiplexor are left out, and those
//! that are no integers, and the pseudo message of signals without one. Who names one of them is told so.

use std::collections::BTreeMap;

use can_dbc::{AttributeValue, ByteOrder, Dbc, MessageId, MultiplexIndicator, SignalExtendedValueType, ValueType};

use super::{Layout, Signal, SignalError};
use crate::MAX_DATA;

/// Pseudo message of DBC editors, which holds signals without a message.
const ORPHANS: &str = "VECTOR__INDEPENDENT_SIG_MSG";
/// Attribute of DBC editors with the kind of a message's frames, and its numbers of CAN FD: with 11 and with 29 bits.
const FRAME_FORMAT: &str = "VFrameFormat";
const FLEXIBLE: [u64; 2] = [14, 15];
/// Bit of an identifier of 29 bits in a DBC file.
const EXTENDED: u64 = 1 << 31;

/// A signal with its name and unit.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedSignal {
    /// Its name.
    pub name: String,
    /// Where it is.
    pub signal: Signal,
    /// Unit of its value; empty where none is given.
    pub unit: String,
}

/// A message.
#[derive(Debug, Clone, PartialEq)]
pub struct Message {
    /// Its name.
    pub name: String,
    /// How it is on the bus.
    pub layout: Layout,
    /// Its signals.
    pub signals: Vec<NamedSignal>,
}

/// Messages by their names.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Database {
    messages: Vec<Message>,
    /// Names such as `Message` and `Message.Signal` of what the file has and cannot be used, and why.
    left_out: BTreeMap<String, String>,
}

/// Why a DBC file cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DatabaseError {
    /// The text is none of a DBC file.
    #[error("line {line}: found \"{found}\"; allowed: {allowed}")]
    Syntax {
        /// Number of the line, from 1 on.
        line: usize,
        /// The line.
        found: String,
        /// What could stand there.
        allowed: String,
    },
    /// The file is read, and its contents contradict each other.
    #[error("found {0}; allowed: a DBC file whose messages and signals belong together")]
    Contents(String),
    /// A message has an identifier that CAN does not have.
    #[error(
        "line {line}: message {name}: found the identifier {found}; allowed: up to 2047, or 2147483648 and 29 bits"
    )]
    Identifier {
        /// Number of the line, from 1 on.
        line: usize,
        /// The message.
        name: String,
        /// The number.
        found: String,
    },
    /// A signal is none.
    #[error("line {line}: signal {message}.{name}: {source}")]
    Signal {
        /// Number of the line, from 1 on.
        line: usize,
        /// Its message.
        message: String,
        /// Its name.
        name: String,
        /// What is wrong with it.
        source: SignalError,
    },
    /// Two messages, or two signals of a message, have one name.
    #[error("{0}: found twice; allowed: one message of each name, and one signal of each name in a message")]
    Twice(String),
}

/// A name of no message or signal.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("found \"{found}\"; allowed: {allowed}")]
pub struct UnknownName {
    found: String,
    allowed: String,
}

impl Database {
    /// Reads a DBC file.
    ///
    /// # Errors
    /// The text is none, or a message or signal is none; the line is named.
    pub fn parse(text: &str) -> Result<Self, DatabaseError> {
        expect_identifiers(text)?;
        let dbc = Dbc::try_from(text).map_err(|error| explained(&error.to_string(), text))?;
        let mut database = Self::default();
        for message in dbc.messages.iter().filter(|message| message.name != ORPHANS) {
            if !Layout::has_length(message.size) {
                let why = format!("a message of 1 to 8, 12, 16, 20, 24, 32, 48 or 64 bytes; this has {}", message.size);
                database.left_out.insert(message.name.clone(), why);
                continue;
            }
            let (id, is_extended) = match message.id {
                MessageId::Standard(id) => (u32::from(id), false),
                MessageId::Extended(id) => (id, true),
            };
            let length = message.size as u8;
            let is_flexible = usize::from(length) > MAX_DATA || is_flexible(&dbc, message.id);
            let layout = Layout { id, is_extended, length, is_flexible };
            let mut found = Message { name: message.name.clone(), layout, signals: Vec::new() };
            for signal in &message.signals {
                if let Some(why) = unusable(&dbc, message.id, signal) {
                    database.left_out.insert(format!("{}.{}", message.name, signal.name), why.to_owned());
                    continue;
                }
                let kind = (signal.byte_order == ByteOrder::BigEndian, signal.value_type == ValueType::Signed);
                let scale = (signal.factor, signal.offset);
                let placed = Signal::new((signal.start_bit, signal.size), kind, scale, length);
                let placed = placed.map_err(|source| DatabaseError::Signal {
                    line: line_of(text, "SG_", &signal.name),
                    message: message.name.clone(),
                    name: signal.name.clone(),
                    source,
                })?;
                found.signals.push(NamedSignal {
                    name: signal.name.clone(),
                    signal: placed,
                    unit: signal.unit.clone(),
                });
            }
            database.add(found)?;
        }
        Ok(database)
    }

    /// Adds a message.
    ///
    /// # Errors
    /// There is one of its name, or two of its signals have one.
    pub fn add(&mut self, message: Message) -> Result<(), DatabaseError> {
        if self.message(&message.name).is_ok() {
            return Err(DatabaseError::Twice(message.name));
        }
        let names: Vec<&str> = message.signals.iter().map(|signal| signal.name.as_str()).collect();
        if let Some(twice) = names.iter().enumerate().find_map(|(i, name)| names[..i].contains(name).then_some(name)) {
            return Err(DatabaseError::Twice(format!("{}.{twice}", message.name)));
        }
        self.messages.push(message);
        Ok(())
    }

    /// All messages.
    pub fn messages(&self) -> &[Message] {
        &self.messages
    }

    /// The message of a name.
    ///
    /// # Errors
    /// There is none.
    pub fn message(&self, name: &str) -> Result<&Message, UnknownName> {
        self.messages.iter().find(|message| message.name == name).ok_or_else(|| {
            let names = self.messages.iter().map(|message| message.name.as_str());
            let unknown = || UnknownName { found: name.to_owned(), allowed: listed("a message", names) };
            self.left_out(name).unwrap_or_else(unknown)
        })
    }

    /// The error of a name whose message or signal is left out.
    fn left_out(&self, name: &str) -> Option<UnknownName> {
        let why = self.left_out.get(name)?;
        Some(UnknownName { found: name.to_owned(), allowed: why.clone() })
    }

    /// The signal of a name such as `Message.Signal`, and its message.
    ///
    /// # Errors
    /// There is none.
    pub fn signal(&self, name: &str) -> Result<(&Message, &NamedSignal), UnknownName> {
        let Some((message, signal)) = name.split_once('.') else {
            let allowed = "a message and its signal, such as Message.Signal".to_owned();
            return Err(UnknownName { found: name.to_owned(), allowed });
        };
        let message = self.message(message)?;
        let found = message.signal(signal);
        Ok((message, found.map_err(|error| self.left_out(name).unwrap_or(error))?))
    }
}

impl Message {
    /// The signal of a name.
    ///
    /// # Errors
    /// There is none.
    pub fn signal(&self, name: &str) -> Result<&NamedSignal, UnknownName> {
        self.signals.iter().find(|signal| signal.name == name).ok_or_else(|| {
            let names = self.signals.iter().map(|signal| signal.name.as_str());
            UnknownName { found: name.to_owned(), allowed: listed(&format!("a signal of {}", self.name), names) }
        })
    }
}

/// Whether an attribute says that a message is one of CAN FD.
fn is_flexible(dbc: &Dbc, message: MessageId) -> bool {
    match dbc.message_attribute(message, FRAME_FORMAT) {
        Some(AttributeValue::Uint(number)) => FLEXIBLE.contains(number),
        Some(AttributeValue::Int(number)) => u64::try_from(*number).is_ok_and(|number| FLEXIBLE.contains(&number)),
        Some(AttributeValue::String(name)) => name.ends_with("CAN_FD"),
        Some(AttributeValue::Double(_)) | None => false,
    }
}

/// Why a signal cannot be used: what is allowed.
fn unusable(dbc: &Dbc, message: MessageId, signal: &can_dbc::Signal) -> Option<&'static str> {
    let kind = dbc.extended_value_type_for_signal(message, &signal.name);
    if kind.is_some_and(|kind| *kind != SignalExtendedValueType::SignedOrUnsignedInteger) {
        return Some("a signal that is an integer; this one is a floating-point number (SIG_VALTYPE_)");
    }
    let is_always_there =
        matches!(signal.multiplexer_indicator, MultiplexIndicator::Plain | MultiplexIndicator::Multiplexor);
    (!is_always_there).then_some("a signal of every message; this one is there for one value of a multiplexor only")
}

/// Names for a message, the first ones of many.
fn listed<'n>(what: &str, names: impl Iterator<Item = &'n str>) -> String {
    let names: Vec<&str> = names.collect();
    match names.len() {
        0 => format!("{what}, and there is none"),
        1..=12 => format!("{what}: {}", names.join(", ")),
        many => format!("{what}: {}, .. ({many} of them)", names[..12].join(", ")),
    }
}

/// Refuses identifiers that the reader of DBC files would cut off.
fn expect_identifiers(text: &str) -> Result<(), DatabaseError> {
    for (i, line) in text.lines().enumerate() {
        let Some(rest) = line.trim_start().strip_prefix("BO_ ") else { continue };
        let mut words = rest.split_whitespace();
        let (Some(id), name) = (words.next(), words.next().unwrap_or_default()) else { continue };
        let is_sound = id.parse::<u64>().is_ok_and(|id| id <= 0x7FF || (EXTENDED..EXTENDED + (1 << 29)).contains(&id));
        let name = name.trim_end_matches(':').to_owned();
        // The pseudo message has a number of its own.
        if !is_sound && name != ORPHANS {
            return Err(DatabaseError::Identifier { line: i + 1, name, found: id.chars().take(20).collect() });
        }
    }
    Ok(())
}

/// Line of the first message or signal of a name; 1 where it is not found.
fn line_of(text: &str, keyword: &str, name: &str) -> usize {
    let is_it = |line: &str| {
        let mut words = line.split_whitespace();
        words.next() == Some(keyword) && words.next().map(|word| word.trim_end_matches(':')) == Some(name)
    };
    text.lines().position(is_it).map_or(1, |line| line + 1)
}

/// Lines of a DBC file as they are written, by their keywords.
const FORMS: [(&str, &str); 3] = [
    ("BO_", "BO_ NUMBER NAME: BYTES SENDER, below an empty line"),
    ("SG_", "SG_ NAME : START|BITS@ORDER SIGN (FACTOR,OFFSET) [LEAST|GREATEST] \"UNIT\" RECEIVER, below its BO_"),
    ("BU_:", "BU_: NAME NAME .."),
];
/// What is said of any other line.
const ANY_LINE: &str =
    "a line of a DBC file in its place, such as VERSION, BU_:, BO_, SG_, CM_ or VAL_, and all before it";

/// The parser's message with place, found and allowed. It begins with ` --> LINE:COLUMN`.
fn explained(error: &str, text: &str) -> DatabaseError {
    let place = error.split("--> ").nth(1).and_then(|rest| rest.split(':').next()?.trim().parse::<usize>().ok());
    let Some(line) = place else { return DatabaseError::Contents(error.to_owned()) };
    let found = text.lines().nth(line.saturating_sub(1)).unwrap_or_default().trim();
    // The parser names rules of its own.
    let form = FORMS.iter().find(|(keyword, _)| found.split_whitespace().next() == Some(keyword));
    let allowed = form.map_or(ANY_LINE, |(_, form)| *form).to_owned();
    DatabaseError::Syntax { line, found: found.chars().take(60).collect(), allowed }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DBC: &str = "VERSION \"\"\n\nNS_ :\n\nBS_:\n\nBU_: Machine PC\n\n\
                       BO_ 2566848513 Boom: 8 Machine\n SG_ Angle : 0|16@1- (0.0001,0) [-3|3] \"rad\" PC\n \
                       SG_ Alive : 56|8@1+ (1,0) [0|255] \"\" PC\n\nBO_ 291 Levers: 4 Machine\n \
                       SG_ Pilot : 7|16@0+ (0.1,-5) [0|0] \"MPa\" PC\n";

    #[test]
    fn signals_are_found_by_their_names() {
        let database = Database::parse(DBC).unwrap();
        let (message, angle) = database.signal("Boom.Angle").unwrap();
        let expected = Layout { id: 2_566_848_513 & 0x1FFF_FFFF, is_extended: true, length: 8, is_flexible: false };
        assert_eq!(message.layout, expected);
        assert_eq!((angle.unit.as_str(), angle.signal.value(&[0xF0, 0xD8])), ("rad", Some(-1.0)));
        let (levers, pilot) = database.signal("Levers.Pilot").unwrap();
        assert_eq!((levers.layout.id, levers.layout.is_extended), (291, false));
        assert_eq!(pilot.signal.value(&[0, 100, 0, 0]), Some(5.0));
        for (name, expected) in [
            ("Boom", "found \"Boom\"; allowed: a message and its signal, such as Message.Signal"),
            ("Bom.Angle", "found \"Bom\"; allowed: a message: Boom, Levers"),
            ("Boom.Angel", "found \"Angel\"; allowed: a signal of Boom: Angle, Alive"),
        ] {
            assert_eq!(database.signal(name).unwrap_err().to_string(), expected);
        }
    }

    #[test]
    fn what_cannot_be_used_is_refused_by_its_reason_where_it_is_named() {
        let text = format!(
            "{DBC}\nBO_ 292 Long: 63 Machine\n SG_ A : 0|8@1+ (1,0) [0|0] \"\" PC\n\nBO_ 293 Mixed: 8 Machine\n \
             SG_ Kind M : 0|8@1+ (1,0) [0|0] \"\" PC\n SG_ Way m1 : 8|16@1+ (1,0) [0|0] \"m\" PC\n \
             SG_ Float : 32|32@1- (1,0) [0|0] \"m\" PC\n\nSIG_VALTYPE_ 293 Float : 1;\n"
        );
        let database = Database::parse(&text).unwrap();
        assert!(database.signal("Mixed.Kind").is_ok());
        for (name, expected) in [
            ("Long.A", "found \"Long\"; allowed: a message of 1 to 8, 12, 16, 20, 24, 32, 48 or 64 bytes; this has 63"),
            ("Mixed.Way", "found \"Mixed.Way\"; allowed: a signal of every message; this one"),
            ("Mixed.Float", "found \"Mixed.Float\"; allowed: a signal that is an integer; this one"),
        ] {
            let said = database.signal(name).unwrap_err().to_string();
            assert!(said.starts_with(expected), "{said}");
        }
    }

    #[test]
    fn messages_of_can_fd_are_known_by_their_length_or_their_attribute() {
        let text = format!(
            "{DBC}\nBO_ 292 Long: 64 Machine\n SG_ A : 480|32@1- (1,0) [0|0] \"\" PC\n\nBO_ 293 Short: 8 Machine\n \
             SG_ B : 0|8@1+ (1,0) [0|0] \"\" PC\n\nBA_DEF_ BO_ \"VFrameFormat\" ENUM \"StandardCAN\",\"ExtendedCAN\";\n\
             BA_DEF_DEF_ \"VFrameFormat\" \"StandardCAN\";\nBA_ \"VFrameFormat\" BO_ 293 14;\n\
             BA_ \"VFrameFormat\" BO_ 291 0;\n"
        );
        let database = Database::parse(&text).unwrap();
        let is_flexible = |name: &str| database.message(name).unwrap().layout.is_flexible;
        assert_eq!(["Long", "Short", "Levers", "Boom"].map(is_flexible), [true, true, false, false]);
        let (long, signal) = database.signal("Long.A").unwrap();
        let mut data = [0; 64];
        signal.signal.put(-2.0, &mut data);
        assert_eq!((data[59], &data[60..]), (0, &[0xFE, 0xFF, 0xFF, 0xFF][..]));
        let frame = long.layout.frame(&data).unwrap();
        assert!(long.layout.is_of(&frame) && frame.format() == crate::Format::Flexible { is_fast: false });
        assert_eq!(long.layout.frame(&data[..9]), None);
    }

    #[test]
    fn a_line_that_is_none_is_named() {
        for (from, to, expected) in [
            ("SG_ Alive : 56|8@1+", "SG_ Alive : 56|8@7+", "line 11: found \"SG_ Alive"),
            (
                "BU_: Machine",
                "BU_ Machine",
                "line 7: found \"BU_ Machine PC\"; allowed: a line of a DBC file in its place",
            ),
            ("56|8@1+", "60|8@1+", "line 11: signal Boom.Alive: found bits up to byte 8"),
            ("(0.1,-5)", "(0,-5)", "line 14: signal Levers.Pilot: found the factor 0"),
            ("BO_ 291", "BO_ 4000", "line 13: message Levers: found the identifier 4000; allowed: up to 2047"),
            ("BO_ 291", "BO_ x291", "line 13: message Levers: found the identifier x291"),
        ] {
            let said = Database::parse(&DBC.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(said.starts_with(expected), "{said}");
            assert!(said.contains("; allowed: "), "{said}");
        }
        let twice = format!("{DBC}\nBO_ 5 Boom: 8 Machine\n SG_ A : 0|8@1+ (1,0) [0|0] \"\" PC\n");
        assert_eq!(Database::parse(&twice).unwrap_err(), DatabaseError::Twice("Boom".to_owned()));
        let twice = DBC.replacen("SG_ Alive", "SG_ Angle", 1);
        assert_eq!(Database::parse(&twice).unwrap_err(), DatabaseError::Twice("Boom.Angle".to_owned()));
    }
}
