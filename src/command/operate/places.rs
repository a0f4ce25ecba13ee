//! The places of `--tip`: the one that it names, or those on standard input, one a line.
//!
//! ```text
//! X,Z[,PITCH[,SPEED]]        as --tip, --pitch and --speed; an empty field is what these options say
//! ```
//!
//! Empty lines, lines that begin with `#`, and the names of the columns in the first other line are passed over. A
//! thread of its own reads the lines, since the axes need a request with every sample while none comes.

use std::{
    io::{BufRead, Read, stdin},
    sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel},
    thread,
};

use super::{
    OperateArguments,
    arguments::{Tip, pitch},
};
use crate::{
    arguments::values::{place, teeth_speed},
    failure::Failure,
    teeth::{SPEED, TeethPlace},
};

/// Names of the columns of a line.
const COLUMNS: &str = "x,z,pitch,speed";
/// Longest line, bytes.
const LONGEST: u64 = 200;

/// What a line may be.
const ALLOWED: &str = "allowed: X,Z or X,Z,PITCH or X,Z,PITCH,SPEED";

/// The places after the first one.
pub enum Places {
    /// None: the teeth stay there until the user ends it, or are left there.
    None {
        /// `--leave`.
        leave: bool,
    },
    /// Those of standard input, whose end is the end of the command.
    Lines(Receiver<Result<TeethPlace, Failure>>),
}

/// What there is of a next place.
pub enum Next {
    /// One.
    Place(TeethPlace),
    /// None so far.
    Wait,
    /// None any more.
    End,
}

impl Places {
    /// The first place of `--tip`, as soon as it is there, and those after it.
    ///
    /// # Errors
    /// There is none.
    pub fn of(tip: Tip, arguments: &OperateArguments) -> Result<(TeethPlace, Self), Failure> {
        let usual = TeethPlace { to: [0.0; 2], pitch: arguments.pitch, speed: arguments.speed.unwrap_or(SPEED) };
        if let Tip::Place(to) = tip {
            return Ok((TeethPlace { to, ..usual }, Self::None { leave: arguments.leave }));
        }
        // One is read ahead, the others stay in the pipe.
        let (sender, lines) = sync_channel(1);
        thread::spawn(move || read(&mut stdin().lock(), usual, &sender));
        let none = || Failure::usage("--tip: found no place on standard input; allowed: X,Z in m");
        let first = lines.recv().map_err(|_| none())??;
        Ok((first, Self::Lines(lines)))
    }

    /// The next one, without waiting.
    ///
    /// # Errors
    /// A line is no place, or cannot be read.
    pub fn next(&mut self) -> Result<Next, Failure> {
        let lines = match self {
            Self::None { leave } => return Ok(if *leave { Next::End } else { Next::Wait }),
            Self::Lines(lines) => lines,
        };
        match lines.try_recv() {
            Ok(place) => place.map(Next::Place),
            Err(TryRecvError::Empty) => Ok(Next::Wait),
            Err(TryRecvError::Disconnected) => Ok(Next::End),
        }
    }
}

/// Sends the places of `input`, up to its end or the first line that is none.
fn read(input: &mut impl BufRead, usual: TeethPlace, sender: &SyncSender<Result<TeethPlace, Failure>>) {
    let mut may_name = true;
    for number in 1.. {
        let mut line = Vec::new();
        let place = match input.by_ref().take(LONGEST).read_until(b'\n', &mut line) {
            Ok(0) => return,
            Ok(_) => text_of(&line).and_then(|line| place_of(line, &mut may_name, usual)).map_err(Failure::usage),
            Err(error) => Err(Failure::run(error)),
        };
        let place =
            place.map_err(|failure| failure.about(format!("--tip: line {number} of standard input"))).transpose();
        let Some(place) = place else { continue };
        let is_last = place.is_err();
        if sender.send(place).is_err() || is_last {
            return;
        }
    }
}

/// A line as text.
fn text_of(line: &[u8]) -> Result<&str, String> {
    if line.len() as u64 == LONGEST && !line.ends_with(b"\n") {
        return Err(format!("found more than {LONGEST} bytes; {ALLOWED}"));
    }
    let text = std::str::from_utf8(line);
    let text = text.map_err(|error| format!("found other text than UTF-8 ({error}); allowed: X,Z in m"))?;
    // A program that ends in the middle of a number has not said this place.
    if !text.ends_with('\n') && !text.trim().is_empty() {
        return Err(format!("found \"{text}\" without the end of its line; allowed: whole lines"));
    }
    Ok(text)
}

/// The place of a line; none where it has none. `may_name`: the line may name the columns, as no line before it did
/// that or was a place.
fn place_of(line: &str, may_name: &mut bool, usual: TeethPlace) -> Result<Option<TeethPlace>, String> {
    let line = line.trim_start_matches('\u{feff}').trim();
    if line.is_empty() || line.starts_with('#') {
        return Ok(None);
    }
    let names = line.replace(' ', "").to_lowercase();
    if std::mem::take(may_name) && names.starts_with("x,z") && COLUMNS.starts_with(&names) {
        return Ok(None);
    }
    let fields: Vec<&str> = line.split(',').map(str::trim).collect();
    let found = |error: String| format!("found \"{line}\"; {error}");
    if !(2..=4).contains(&fields.len()) {
        return Err(found(ALLOWED.into()));
    }
    let field = |index: usize| fields.get(index).filter(|field| !field.is_empty());
    Ok(Some(TeethPlace {
        to: place(&fields[..2].join(",")).map_err(found)?,
        pitch: field(2).map(|field| pitch(field).map_err(found)).transpose()?.or(usual.pitch),
        speed: field(3).map(|field| teeth_speed(field).map_err(found)).transpose()?.unwrap_or(usual.speed),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    const USUAL: TeethPlace = TeethPlace { to: [0.0; 2], pitch: None, speed: 0.1 };

    #[test]
    fn a_line_is_a_place_with_what_the_options_say_where_it_says_nothing() {
        let usual = TeethPlace { pitch: Some(-90.0), ..USUAL };
        let of = |line| place_of(line, &mut false, usual).unwrap().unwrap();
        assert_eq!(of("6.2, -0.5"), TeethPlace { to: [6.2, -0.5], ..usual });
        assert_eq!(of("6.2,-500mm,-100"), TeethPlace { to: [6.2, -0.5], pitch: Some(-100.0), ..usual });
        assert_eq!(of("6.2,-0.5,,0.3"), TeethPlace { to: [6.2, -0.5], speed: 0.3, ..usual });
    }

    /// What is sent of this input: the x of places, and the message of a failure.
    fn sent(input: &[u8]) -> Vec<Result<f64, String>> {
        let (sender, lines) = sync_channel(10);
        read(&mut &*input, USUAL, &sender);
        drop(sender);
        lines.iter().map(|place| place.map(|place| place.to[0]).map_err(|failure| failure.to_string())).collect()
    }

    #[test]
    fn lines_are_read_up_to_the_first_that_is_no_place() {
        assert_eq!(sent(b"\xef\xbb\xbfx,z\r\n6,0\r\n\n7,0\n"), [Ok(6.0), Ok(7.0)]);
        let cut = "--tip: line 2 of standard input: found \"6.5,-0\" without the end of its line; allowed: whole lines";
        assert_eq!(sent(b"6,0\n6.5,-0"), [Ok(6.0), Err(cut.to_owned())]);
        assert_eq!(sent(b""), []);
        for (bad, expected) in [
            (b"here".to_vec(), "found \"here\""),
            (vec![b'5'; 1000], "found more than 200 bytes"),
            (vec![0xff, b'\n'], "found other text than UTF-8"),
        ] {
            let found = sent(&[b"6,0\n", &bad[..], b"\n7,0\n"].concat());
            assert_eq!((found.len(), &found[0]), (2, &Ok(6.0)));
            let message = found[1].as_ref().unwrap_err();
            assert!(message.starts_with(&format!("--tip: line 2 of standard input: {expected}")), "{message}");
        }
    }

    #[test]
    fn names_of_columns_empty_lines_and_remarks_are_no_places() {
        for (line, mut may_name) in [("x,z,pitch", true), ("X, Z", true), ("", false), ("  ", true), ("# home", false)]
        {
            assert_eq!(place_of(line, &mut may_name, USUAL).unwrap(), None, "{line}");
        }
    }

    #[test]
    fn the_columns_are_named_before_the_first_place_also_after_remarks() {
        assert_eq!(sent(b"\xef\xbb\xbf# my places\n\nx,z\n6,0\n"), [Ok(6.0)]);
        for twice in [&b"x,z\nx,z\n"[..], b"6,0\nx,z\n"] {
            assert!(sent(twice).last().unwrap().is_err());
        }
    }

    #[test]
    fn what_is_no_place_is_refused_with_what_was_found() {
        for (line, allowed) in [
            ("x,z", "allowed: X,Z in m"),
            ("6.2", "allowed: X,Z or X,Z,PITCH or X,Z,PITCH,SPEED"),
            ("6.2,0,1,2,3", "allowed: X,Z or X,Z,PITCH or X,Z,PITCH,SPEED"),
            ("6.2,nan", "allowed: X,Z in m"),
            ("6.2,0,inf", "allowed: -360 to 360 degrees"),
            ("6.2,0,-100,0", "allowed: 0.001 to 10 m/s"),
        ] {
            let error = place_of(line, &mut false, USUAL).unwrap_err();
            assert!(error.starts_with(&format!("found \"{line}\"; {allowed}")), "{line}: {error}");
        }
    }
}
