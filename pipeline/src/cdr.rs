//! Messages as CDR, with a schema as ROS 2 writes it, both derived from the fields of the message.
//!
//! CDR is little-endian here: four bytes that say so, then every number at a multiple of its size, counted from behind
//! those four bytes. Arrays of arrays become one array, since the schema has no others.
//!
//! Source: OMG DDS-XTYPES 1.3, 7.4.3 (XCDR version 1).

use crate::{
    layout::{Field, Layout, Numbers, Shape, Sink},
    message::Message,
};

/// Package of all types.
const PACKAGE: &str = "hydraxis";
/// First bytes: little-endian, no options.
pub const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

struct Bytes<'a>(&'a mut Vec<u8>);

impl Sink for Bytes<'_> {
    fn number<const N: usize>(&mut self, bytes: [u8; N]) {
        let length = self.0.len() - ENCAPSULATION.len();
        self.0.resize(ENCAPSULATION.len() + length.next_multiple_of(N), 0);
        self.0.extend_from_slice(&bytes);
    }
}

/// Writes a message into `out`, in the place of what was there.
pub fn encode<L: Layout>(message: &L, out: &mut Vec<u8>) {
    out.clear();
    out.extend_from_slice(&ENCAPSULATION);
    append(message, out);
}

/// Adds fields to a message.
pub fn append<L: Layout>(fields: &L, out: &mut Vec<u8>) {
    fields.walk(&mut Bytes(out));
}

/// The numbers of a message, one after the other.
struct Given<'a> {
    bytes: &'a [u8],
    /// Where the next number may begin, counted from behind the encapsulation.
    next: usize,
}

impl Numbers for Given<'_> {
    fn number<const N: usize>(&mut self) -> Option<[u8; N]> {
        let begin = self.next.next_multiple_of(N);
        self.next = begin + N;
        let number = self.bytes.get(ENCAPSULATION.len() + begin..ENCAPSULATION.len() + begin + N)?;
        number.try_into().ok()
    }
}

/// Reads a message; none where the bytes end before it does, or have another encapsulation.
pub fn decode<M: Message>(bytes: &[u8]) -> Option<M> {
    let mut message = M::default();
    (bytes.get(..ENCAPSULATION.len())? == ENCAPSULATION).then_some(())?;
    message.fill(&mut Given { bytes, next: 0 })?;
    Some(message)
}

/// Name of the type of a message.
pub fn type_name<M: Message>() -> String {
    match M::SHAPE {
        Shape::Struct(name, _) => format!("{PACKAGE}/msg/{name}"),
        shape => unreachable!("a message is a struct, not {shape:?}"),
    }
}

/// The schema of a message: its fields, then those of every struct in it.
pub fn schema<L: Layout>() -> String {
    let mut found = Vec::new();
    find(&L::SHAPE, &mut found);
    let mut parts = found.iter().map(|(name, fields)| {
        let lines: String = fields.iter().map(line).collect();
        (*name, lines)
    });
    let (_, mut text) = parts.next().unwrap_or_default();
    for (name, lines) in parts {
        text += &format!("{}\nMSG: {PACKAGE}/{name}\n{lines}", "=".repeat(80));
    }
    text
}

/// Adds a struct and those in it, each once, the outer ones first.
fn find(shape: &Shape, found: &mut Vec<(&'static str, &'static [Field])>) {
    match shape {
        Shape::Number(_) => {}
        Shape::Array(of, _) => find(of, found),
        Shape::Struct(name, fields) => {
            if !found.iter().any(|(known, _)| known == name) {
                found.push((name, fields));
                fields.iter().for_each(|field| find(&field.shape, found));
            }
        }
    }
}

/// One line of a schema.
fn line(field: &Field) -> String {
    let (mut shape, mut count) = (&field.shape, None);
    while let Shape::Array(of, length) = shape {
        (shape, count) = (of, Some(count.unwrap_or(1) * length));
    }
    let name = match shape {
        Shape::Number("u8") => "uint8".to_owned(),
        Shape::Number("u32") => "uint32".to_owned(),
        Shape::Number("u64") => "uint64".to_owned(),
        Shape::Number("i64") => "int64".to_owned(),
        Shape::Number("f64") => "float64".to_owned(),
        Shape::Struct(name, _) => format!("{PACKAGE}/{name}"),
        other => unreachable!("a type without a name in the schema: {other:?}"),
    };
    let count = count.map(|count| format!("[{count}]")).unwrap_or_default();
    format!("{name}{count} {}\n", field.name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        MAX_AXES,
        message::{EncoderReading, EncoderSample, Reference, ValveCommand},
    };

    #[test]
    fn a_schema_names_every_field_and_every_struct_once() {
        assert_eq!(type_name::<EncoderReading>(), "hydraxis/msg/EncoderReading");
        let schema = schema::<EncoderReading>();
        let parts: Vec<&str> = schema.split(&format!("{}\n", "=".repeat(80))).collect();
        assert_eq!(parts.len(), 3, "{schema}");
        assert_eq!(
            parts[0],
            "hydraxis/Header header\nhydraxis/EncoderValue[8] encoders\nuint32 emergency_stop\nuint32 reserved\n"
        );
        assert!(parts[1].starts_with("MSG: hydraxis/Header\nuint64 sequence\n"), "{schema}");
        assert!(
            parts[2].starts_with("MSG: hydraxis/EncoderValue\nint64 counts\nfloat64 piston_pressure\n"),
            "{schema}"
        );
        let reference = super::schema::<Reference>();
        assert!(reference.contains(&format!("float64[{}] positions\n", 32 * MAX_AXES)), "{reference}");
        // A struct that is used twice is written once.
        let command = super::schema::<ValveCommand>();
        assert_eq!(command.matches("MSG: hydraxis/ErrorStatistics").count(), 1, "{command}");
    }

    #[test]
    fn numbers_stand_at_multiples_of_their_size() {
        let mut sample = EncoderSample::default();
        sample.header.sequence = 7;
        sample.axes[1].position = 0.25;
        sample.emergency_stop = 1;
        let mut bytes = vec![9; 3];
        encode(&sample, &mut bytes);
        assert_eq!(decode::<EncoderSample>(&bytes), Some(sample));
        assert_eq!(decode::<EncoderSample>(&bytes[..bytes.len() - 1]), None);
        assert_eq!(decode::<EncoderSample>(&[&[1], &bytes[1..]].concat()), None);
        // The structs are laid out like this in memory, too.
        assert_eq!(bytes.len(), 4 + size_of::<EncoderSample>());
        assert_eq!(bytes[..12], [0, 1, 0, 0, 7, 0, 0, 0, 0, 0, 0, 0]);
        let second = 4 + size_of_val(&sample.header) + size_of_val(&sample.axes[0]);
        assert_eq!(bytes[second..second + 8], 0.25f64.to_le_bytes());
        assert_eq!(bytes[bytes.len() - 8..], [1, 0, 0, 0, 0, 0, 0, 0]);
        let mut bytes = Bytes(&mut bytes);
        bytes.0.truncate(4);
        bytes.number(1u8.to_le_bytes());
        bytes.number(2u64.to_le_bytes());
        assert_eq!(bytes.0[4..], [1, 0, 0, 0, 0, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0]);
    }
}
