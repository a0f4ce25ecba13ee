//! A schema in the form of ROS 2 as columns: names, types and places of all numbers of a message.
//!
//! All arrays of a message have a fixed length. So every number has a fixed place in its CDR, and a recording can be
//! read by the schemas in it, whatever version has written it.
//!
//! Source: OMG DDS-XTYPES 1.3, 7.4.3 (XCDR version 1).

use std::collections::BTreeMap;

use thiserror::Error;

/// Bytes before the first number: byte order and options.
pub const ENCAPSULATION: usize = 4;
/// Most columns of a message: a schema of nested arrays could ask for any number.
const MOST_COLUMNS: usize = 100_000;
/// Most bytes of the names of all columns of a message.
const MOST_NAMES: usize = 16 << 20;
/// Deepest nesting of structs.
const DEEPEST: usize = 16;
/// Length of the line of `=` before the definition of a struct.
const RULER: &str = "================";

/// Why a schema cannot be read.
#[derive(Debug, Error, PartialEq, Eq)]
pub enum SchemaError {
    /// A line is not a field.
    #[error("found the line \"{0}\"; allowed: TYPE NAME, or TYPE[N] NAME")]
    Line(String),
    /// A type is neither a number nor defined in the schema.
    #[error("found the type \"{0}\"; allowed: uint8, uint32, uint64, int64, float64, or a struct of the schema")]
    Type(String),
    /// It is deeper or larger than any message.
    #[error("found more than {MOST_COLUMNS} numbers, {DEEPEST} levels of structs or {MOST_NAMES} bytes of names")]
    Size,
    /// It has nothing in common with the messages of a channel.
    #[error("found no field of the messages of this channel")]
    Foreign,
}

/// Type of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Unsigned, of so many bytes.
    Unsigned(usize),
    /// Signed, 8 bytes.
    Signed,
    /// Floating point, 8 bytes.
    Float,
}

impl Kind {
    fn of(name: &str) -> Option<Self> {
        Some(match name {
            "uint8" => Self::Unsigned(1),
            "uint32" => Self::Unsigned(4),
            "uint64" => Self::Unsigned(8),
            "int64" => Self::Signed,
            "float64" => Self::Float,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::Unsigned(size) => size,
            Self::Signed | Self::Float => 8,
        }
    }
}

/// A number of a message.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Value {
    /// Unsigned.
    Unsigned(u64),
    /// Signed.
    Signed(i64),
    /// Floating point.
    Float(f64),
}

impl Value {
    /// The bits of an unsigned number; 0 for another one.
    pub fn as_u64(self) -> u64 {
        if let Self::Unsigned(value) = self { value } else { 0 }
    }
}

impl std::fmt::Display for Value {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Unsigned(value) => write!(f, "{value}"),
            Self::Signed(value) => write!(f, "{value}"),
            Self::Float(value) => write!(f, "{value}"),
        }
    }
}

/// One number of a message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Column {
    /// Its field, with those that it is in: `axes[1].position`.
    pub name: String,
    kind: Kind,
    /// First byte in the CDR.
    offset: usize,
}

impl Column {
    /// Its bytes in the CDR.
    pub fn bytes(&self) -> std::ops::Range<usize> {
        self.offset..self.offset + self.kind.size()
    }

    /// Whether another column has the same name and type.
    pub fn is_same(&self, other: &Self) -> bool {
        (&self.name, self.kind) == (&other.name, other.kind)
    }

    /// Type of the number.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// The value in a message; none where the message is too short.
    pub fn value(&self, message: &[u8]) -> Option<Value> {
        let bytes = message.get(self.bytes())?;
        let mut wide = [0; 8];
        wide[..bytes.len()].copy_from_slice(bytes);
        Some(match self.kind {
            Kind::Unsigned(_) => Value::Unsigned(u64::from_le_bytes(wide)),
            Kind::Signed => Value::Signed(i64::from_le_bytes(wide)),
            Kind::Float => Value::Float(f64::from_le_bytes(wide)),
        })
    }
}

/// The columns of a message.
///
/// # Errors
/// The schema has something that no message of Hydraxis has.
pub fn columns(schema: &str) -> Result<Vec<Column>, SchemaError> {
    let mut structs: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    let mut name = "";
    let mut lines = schema.lines();
    while let Some(line) = lines.next() {
        let line = line.trim();
        if line.starts_with(RULER) {
            let title = lines.next().unwrap_or_default().trim();
            name = title.strip_prefix("MSG:").ok_or_else(|| SchemaError::Line(title.to_owned()))?.trim();
        } else if !line.is_empty() && !line.starts_with('#') {
            structs.entry(name).or_default().push(line);
        }
    }
    let mut walk = Walk { structs: &structs, columns: Vec::new(), end: 0, names: 0 };
    walk.fields("", "", 0)?;
    Ok(walk.columns)
}

/// The columns of a message of this version.
#[cfg(test)]
pub fn columns_of<M: pipeline::message::Message>() -> Vec<Column> {
    columns(&super::cdr::schema::<M>()).expect("its own schema")
}

/// A walk over all numbers of a message, in the order of their bytes.
struct Walk<'a> {
    /// Lines of all structs by name; the message itself has none.
    structs: &'a BTreeMap<&'a str, Vec<&'a str>>,
    columns: Vec<Column>,
    /// Bytes so far, counted from behind the encapsulation.
    end: usize,
    /// Bytes of all names so far.
    names: usize,
}

impl Walk<'_> {
    /// The fields of a struct, whose names begin with `prefix`.
    fn fields(&mut self, name: &str, prefix: &str, depth: usize) -> Result<(), SchemaError> {
        let lines = self.structs.get(name).ok_or_else(|| SchemaError::Type(name.to_owned()))?;
        if depth > DEEPEST {
            return Err(SchemaError::Size);
        }
        for line in lines {
            let bad = || SchemaError::Line((*line).to_owned());
            let (kind, field) = line.split_once(char::is_whitespace).ok_or_else(bad)?;
            let field = field.trim();
            match kind.split_once('[') {
                None => self.field(kind, format!("{prefix}{field}"), depth)?,
                Some((kind, count)) => {
                    let count: usize = count.strip_suffix(']').and_then(|count| count.parse().ok()).ok_or_else(bad)?;
                    // Arrays of nothing could be nested until their walk never ends.
                    if count == 0 {
                        return Err(bad());
                    }
                    if count > MOST_COLUMNS {
                        return Err(SchemaError::Size);
                    }
                    (0..count).try_for_each(|i| self.field(kind, format!("{prefix}{field}[{i}]"), depth))?;
                }
            }
        }
        Ok(())
    }

    fn field(&mut self, kind: &str, name: String, depth: usize) -> Result<(), SchemaError> {
        let Some(kind) = Kind::of(kind) else { return self.fields(kind, &format!("{name}."), depth + 1) };
        self.names += name.len();
        if self.columns.len() >= MOST_COLUMNS || self.names > MOST_NAMES {
            return Err(SchemaError::Size);
        }
        let begin = self.end.next_multiple_of(kind.size());
        self.end = begin + kind.size();
        self.columns.push(Column { name, kind, offset: ENCAPSULATION + begin });
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::{super::cdr, *};
    use pipeline::message::{
        CoefficientSnapshot, EncoderSample, MachineState, Message, Reference, Request, StageHealth, ValveCommand,
    };

    fn expect_all_bytes<M: Message>() {
        let columns = columns(&cdr::schema::<M>()).unwrap();
        let mut bytes = Vec::new();
        cdr::encode(&M::default(), &mut bytes);
        let last = columns.last().unwrap();
        assert_eq!(last.offset + last.kind.size(), bytes.len(), "{}", M::CHANNEL);
        assert!(last.value(&bytes[..bytes.len() - 1]).is_none());
    }

    #[test]
    fn the_columns_of_every_message_are_all_its_bytes() {
        expect_all_bytes::<EncoderSample>();
        expect_all_bytes::<ValveCommand>();
        expect_all_bytes::<CoefficientSnapshot>();
        expect_all_bytes::<Reference>();
        expect_all_bytes::<Request>();
        expect_all_bytes::<StageHealth>();
        expect_all_bytes::<MachineState>();
    }

    #[test]
    fn values_come_back() {
        let mut sample = EncoderSample::default();
        (sample.header.sequence, sample.header.axis_count) = (1 << 60, 7);
        sample.axes[1].position = -0.1;
        let mut bytes = Vec::new();
        cdr::encode(&sample, &mut bytes);
        let columns = columns(&cdr::schema::<EncoderSample>()).unwrap();
        let value = |name: &str| columns.iter().find(|column| column.name == name).unwrap().value(&bytes).unwrap();
        assert_eq!(value("header.sequence"), Value::Unsigned(1 << 60));
        assert_eq!(value("header.axis_count"), Value::Unsigned(7));
        assert_eq!(value("axes[1].position"), Value::Float(-0.1));
        assert_eq!(value("axes[1].position").to_string(), "-0.1");
    }

    #[test]
    fn schemas_that_no_message_has_are_refused() {
        let refused = |schema: &str| columns(schema).unwrap_err();
        assert_eq!(refused("string name\n"), SchemaError::Type("string".to_owned()));
        assert_eq!(refused("uint8[] data\n"), SchemaError::Line("uint8[] data".to_owned()));
        assert_eq!(refused("nonsense\n"), SchemaError::Line("nonsense".to_owned()));
        assert_eq!(refused("uint8[999999999999] data\n"), SchemaError::Size);
        let ruler = "=".repeat(80);
        assert_eq!(refused(&format!("a/B b\n{ruler}\nMSG: a/B\na/B[2] b\n")), SchemaError::Size);
        assert_eq!(refused(&format!("a/B b\n{ruler}\nfloat64 b\n")), SchemaError::Line("float64 b".to_owned()));
        assert_eq!(refused(""), SchemaError::Type(String::new()));
        assert_eq!(refused("uint8[0] a\n"), SchemaError::Line("uint8[0] a".to_owned()));
        let nothing = format!("a/B[9999] b\n{ruler}\nMSG: a/B\na/C[9999] c\n{ruler}\nMSG: a/C\nuint8[0] d\n");
        assert_eq!(refused(&nothing), SchemaError::Line("uint8[0] d".to_owned()));
        assert_eq!(refused(&format!("uint8[9999] {}\n", "n".repeat(9999))), SchemaError::Size);
    }
}
