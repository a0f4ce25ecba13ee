//! The text of a file, and what separates its fields.
//!
//! A separator is one that the first line has, and that gives the lines below at least as many fields. Separators
//! between quotes do not count. Where several separators are left, the order is semicolon, tab, comma, blanks, because
//! a comma may be a decimal comma, and a blank a part of a name.

use std::path::Path;

use pipeline::{
    bounded,
    columns::{TableError, TableProblem},
    nearest::did_you_mean_file,
};

/// Lines below the first one that the separator must suit.
const EXAMINED: usize = 50;
/// What a file may be.
const ALLOWED: &str = "a CSV file with a header, then one row per sample";

/// What separates two fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Separator {
    Semicolon,
    Tab,
    Comma,
    /// Any number of blanks or tabs.
    Blanks,
}

/// A file that has been read.
#[derive(Debug)]
pub(super) struct Text {
    pub(super) text: String,
    pub(super) encoding: &'static str,
    pub(super) separator: Separator,
}

impl Separator {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Semicolon => "semicolons",
            Self::Tab => "tabs",
            Self::Comma => "commas",
            Self::Blanks => "blanks",
        }
    }

    /// The byte that separates the fields of [`Text::text`].
    pub(super) fn byte(self) -> u8 {
        match self {
            Self::Semicolon => b';',
            Self::Tab | Self::Blanks => b'\t',
            Self::Comma => b',',
        }
    }

    /// Number of fields of a line.
    fn fields(self, line: &str) -> usize {
        if self == Self::Blanks {
            return line.split_whitespace().count();
        }
        let mut quoted = false;
        let separates = |byte: &u8| {
            quoted ^= *byte == b'"';
            !quoted && *byte == self.byte()
        };
        1 + line.as_bytes().iter().copied().filter(separates).count()
    }

    /// The separator of a text; commas where it has a single column.
    fn of(text: &str) -> Self {
        let mut lines = text.split(['\n', '\r']).filter(|line| !line.trim().is_empty());
        let header = lines.next().unwrap_or_default();
        let below: Vec<&str> = lines.take(EXAMINED).collect();
        let suits = |separator: Self, line: &str| match separator {
            Self::Blanks => separator.fields(line) == separator.fields(header),
            _ => separator.fields(line) >= separator.fields(header),
        };
        let mut best = (Self::Comma, None);
        for separator in [Self::Semicolon, Self::Tab, Self::Comma, Self::Blanks] {
            let suited = Some(below.iter().filter(|line| suits(separator, line)).count());
            if separator.fields(header) > 1 && suited > best.1 {
                best = (separator, suited);
            }
        }
        best.0
    }
}

impl Text {
    /// Reads a file.
    pub(super) fn read(file: &Path) -> Result<Self, TableError> {
        let refuse = |found: String, allowed: String| TableError {
            file: file.to_owned(),
            problems: vec![TableProblem { line: None, field: None, found, allowed }],
        };
        let bytes = bounded::read(file, bounded::TABLE).map_err(|error| {
            let found = format!("a file that cannot be read ({error})");
            refuse(found, format!("{ALLOWED}{}", did_you_mean_file(file)))
        })?;
        let (text, encoding) = decode(bytes)
            .map_err(|found| refuse(found.to_owned(), format!("{ALLOWED}, as text in UTF-8 or Latin-1")))?;
        if text.trim().is_empty() {
            return Err(refuse("an empty file".to_owned(), ALLOWED.to_owned()));
        }
        let separator = Separator::of(&text);
        let text = if separator == Separator::Blanks { with_tabs(&text) } else { text };
        Ok(Self { text, encoding, separator })
    }
}

/// The text of a file, and the name of its encoding.
fn decode(bytes: Vec<u8>) -> Result<(String, &'static str), &'static str> {
    if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
        return Err("text in UTF-16");
    }
    if bytes.contains(&0) {
        return Err("a file that is no text");
    }
    match String::from_utf8(bytes) {
        Ok(text) => match text.strip_prefix('\u{feff}') {
            Some(rest) => Ok((rest.to_owned(), "UTF-8 with a byte order mark")),
            None => Ok((text, "UTF-8")),
        },
        // The first 256 characters of Unicode are those of Latin-1.
        Err(error) => Ok((error.into_bytes().into_iter().map(char::from).collect(), "Latin-1")),
    }
}

/// The text with one tab for any number of blanks; each line stays where it is.
fn with_tabs(text: &str) -> String {
    let mut separated = String::with_capacity(text.len());
    for line in text.lines() {
        for (place, field) in line.split_whitespace().enumerate() {
            separated.push_str(if place > 0 { "\t" } else { "" });
            separated.push_str(field);
        }
        separated.push('\n');
    }
    separated
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_separator_is_the_one_that_gives_all_lines_their_fields() {
        for (text, separator) in [
            ("t,u,y\n0,1,2\n", Separator::Comma),
            ("t, u, y\n0, 1, 2\n", Separator::Comma),
            ("t;u;y\n0,0;1,5;2,5\n", Separator::Semicolon),
            ("t;u [a,b];y\n0,0;1,5;2,5\n", Separator::Semicolon),
            ("t,\"u; raw\",y\n0,1,2\n", Separator::Comma),
            ("t,u,y;z\n0,1,2\n", Separator::Comma),
            ("Time\tValve command\ty\n0\t1\t2\n", Separator::Tab),
            ("  t    u   y\n  0.0  1.5 2\n", Separator::Blanks),
            ("Time stamp,u\n2026-01-01 10:00:00,0.5\n", Separator::Comma),
            ("u\n1\n", Separator::Comma),
        ] {
            assert_eq!(Separator::of(text), separator, "{text}");
        }
    }

    #[test]
    fn bytes_that_are_no_utf_8_are_latin_1() {
        assert_eq!(decode(b"Winkel [\xb0]".to_vec()), Ok(("Winkel [°]".to_owned(), "Latin-1")));
        assert_eq!(decode("µ".into()), Ok(("µ".to_owned(), "UTF-8")));
        assert_eq!(decode(b"\xef\xbb\xbft".to_vec()), Ok(("t".to_owned(), "UTF-8 with a byte order mark")));
        assert_eq!(decode(b"\xff\xfet\0".to_vec()), Err("text in UTF-16"));
        assert_eq!(decode(b"t\0".to_vec()), Err("a file that is no text"));
    }

    #[test]
    fn blanks_become_tabs_and_lines_stay() {
        assert_eq!(with_tabs("  t   u\r\n\n 0  1 \n"), "t\tu\n\n0\t1\n");
    }
}
