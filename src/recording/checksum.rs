//! A checksum in every recorded message, so that a changed bit is found in what no replay computes: requests,
//! references, health of the stages, times of clocks.
//!
//! ```text
//! message as CDR | up to 3 zero bytes | checksum = CRC-32 of all bytes before it
//! ```
//!
//! Two single changed bits never have the same CRC-32, so it tells which bit was changed. It stands in the schema as
//! the last field, `checksum`, and any program can compare it: `zlib.crc32` of Python is the same function.
//!
//! Source: IEEE 802.3, 3.2.9.
//!
//! Trap: it finds damage, not forgery. Who changes a message on purpose can write its checksum, too.

use super::schema::ENCAPSULATION;

/// The line of a schema.
const LINE: &str = "uint32 checksum\n";
/// Begin of the definition of the first struct in a schema.
const DEFINITION: &str = "====";
/// Bytes of a checksum.
const LENGTH: usize = 4;

/// A schema whose message has a checksum behind its last field.
pub fn schema(mut schema: String) -> String {
    let end = schema.find(DEFINITION).unwrap_or(schema.len());
    schema.insert_str(end, LINE);
    schema
}

/// Adds the checksum to a message.
pub fn seal(bytes: &mut Vec<u8>) {
    let length = bytes.len() - ENCAPSULATION;
    bytes.resize(ENCAPSULATION + length.next_multiple_of(LENGTH), 0);
    bytes.extend(crc32fast::hash(bytes).to_le_bytes());
}

/// Whether a message is as it was sealed.
pub fn is_whole(bytes: &[u8]) -> bool {
    bytes.split_last_chunk::<LENGTH>().is_some_and(|(message, sum)| crc32fast::hash(message).to_le_bytes() == *sum)
}

/// The message as it was before one bit of it was changed; none where more than one was.
pub fn mended(bytes: &[u8]) -> Option<Vec<u8>> {
    let mut bytes = bytes.to_vec();
    for bit in 0..8 * bytes.len() {
        bytes[bit / 8] ^= 1 << (bit % 8);
        if is_whole(&bytes) {
            return Some(bytes);
        }
        bytes[bit / 8] ^= 1 << (bit % 8);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::{cdr, schema::columns};
    use pipeline::message::{Request, StageHealth};

    #[test]
    fn every_changed_bit_is_found_and_mended() {
        let mut request = Request { session: 7, ..Request::default() };
        request.axes[1].command = 0.25;
        let mut sealed = Vec::new();
        cdr::encode(&request, &mut sealed);
        seal(&mut sealed);
        assert!(is_whole(&sealed) && !is_whole(&sealed[..sealed.len() - 1]) && !is_whole(&[]));
        for bit in 0..8 * sealed.len() {
            let mut changed = sealed.clone();
            changed[bit / 8] ^= 1 << (bit % 8);
            assert!(!is_whole(&changed));
            // To look for the bit takes a while.
            if bit % 61 == 0 {
                assert_eq!(mended(&changed).as_ref(), Some(&sealed), "bit {bit}");
            }
        }
        let mut twice = sealed.clone();
        (twice[30], twice[70]) = (!twice[30], !twice[70]);
        assert_eq!(mended(&twice), None);
    }

    #[test]
    fn the_checksum_is_the_last_field_of_the_schema_and_the_crc_of_what_is_before() {
        let columns = columns(&schema(cdr::schema::<StageHealth>())).unwrap();
        let mut bytes = Vec::new();
        cdr::encode(&StageHealth::default(), &mut bytes);
        seal(&mut bytes);
        let last = columns.last().unwrap();
        assert_eq!((last.name.as_str(), last.bytes().end), ("checksum", bytes.len()));
        // The check value of this CRC.
        assert_eq!(crc32fast::hash(b"123456789"), 0xcbf4_3926);
    }
}
