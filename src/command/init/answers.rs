//! Values of the rig from flags, and from questions where a flag is missing and a person can be asked.

use std::{
    io::{self, BufRead, Write},
    ops::RangeInclusive,
};

use pipeline::nearest::did_you_mean;

use super::quantity::Quantity;
use crate::failure::Failure;

/// A person at a terminal.
pub struct Dialogue<'d> {
    /// Where the answers come from.
    pub input: &'d mut dyn BufRead,
    /// Where the questions go.
    pub output: &'d mut dyn Write,
}

/// Everything that was given, and what is wrong with it.
pub struct Answers<'d> {
    dialogue: Option<Dialogue<'d>>,
    /// Flags that are needed and were not given.
    missing: Vec<&'static str>,
    problems: Vec<String>,
}

impl<'d> Answers<'d> {
    /// With a dialogue, what is missing is asked for.
    pub fn new(dialogue: Option<Dialogue<'d>>) -> Self {
        Self { dialogue, missing: Vec::new(), problems: Vec::new() }
    }

    /// Notes that a flag was refused.
    pub fn refuse(&mut self, flag: &str, found: &str, allowed: impl AsRef<str>) {
        let problem = format!("{flag}: found \"{found}\"; allowed: {}", allowed.as_ref());
        if !self.problems.contains(&problem) {
            self.problems.push(problem);
        }
    }

    /// Notes that a flag is needed.
    pub fn require(&mut self, flag: &'static str) {
        if !self.missing.contains(&flag) {
            self.missing.push(flag);
        }
    }

    /// Whether a person can be asked.
    pub fn can_ask(&self) -> bool {
        self.dialogue.is_some()
    }

    /// A text that `parse` takes, of which it says what is allowed otherwise. An empty answer is the default.
    ///
    /// # Errors
    /// The input has ended, or the question cannot be written.
    pub fn ask<T>(
        &mut self,
        question: &str,
        default: &str,
        parse: impl Fn(&str) -> Result<T, String>,
    ) -> Result<Option<T>, Failure> {
        let Some(Dialogue { input, output }) = &mut self.dialogue else { return Ok(None) };
        let told = |error: io::Error| Failure::run(format!("the questions cannot be asked: {error}"));
        loop {
            write!(output, "{question} [{default}]: ").and_then(|()| output.flush()).map_err(told)?;
            let mut line = String::new();
            if input.read_line(&mut line).map_err(told)? == 0 {
                return Err(Failure::usage(format!("the answers ended at \"{question}\"; nothing was written")));
            }
            let answer = if line.trim().is_empty() { default } else { line.trim() };
            match parse(answer) {
                Ok(value) => return Ok(Some(value)),
                Err(allowed) => writeln!(output, "  found \"{answer}\"; allowed: {allowed}").map_err(told)?,
            }
        }
    }

    /// The value of a quantity in `range`: from its flag, by a question, or `default`. `axis` is the axis that it
    /// belongs to among all `axes`.
    ///
    /// # Errors
    /// The dialogue has ended.
    pub fn value(
        &mut self,
        quantity: &Quantity,
        typed: Option<&str>,
        (axis, axes): (Option<&str>, &[String]),
        range: RangeInclusive<f64>,
        default: f64,
    ) -> Result<f64, Failure> {
        if let Some(typed) = typed {
            let Some(text) = self.of_axis(quantity.flag, typed, axis, axes) else { return Ok(default) };
            let found = quantity.of_flag(text);
            let value = found.filter(|value| range.contains(value));
            if value.is_none() {
                self.refuse(quantity.flag, text, quantity.allowed(&range, found, quantity.unit));
            }
            return Ok(value.unwrap_or(default));
        }
        if quantity.is_asked && self.can_ask() {
            let of = axis.filter(|_| axes.len() > 1).map(|axis| format!("{axis}: ")).unwrap_or_default();
            let question = format!("{of}{}, {}", quantity.words, quantity.shown);
            let parse = |answer: &str| {
                let found = quantity.of_answer(answer);
                let value = found.filter(|value| range.contains(value));
                value.ok_or_else(|| quantity.allowed(&range, found, quantity.shown))
            };
            let asked = self.ask(&question, &quantity.number(default), parse)?;
            return Ok(asked.unwrap_or(default));
        }
        if quantity.is_required {
            self.require(quantity.flag);
        }
        Ok(default)
    }

    /// The part of `VALUE` or `NAME=VALUE,NAME=VALUE` that belongs to an axis; without one, the only value.
    fn of_axis<'t>(&mut self, flag: &str, typed: &'t str, axis: Option<&str>, axes: &[String]) -> Option<&'t str> {
        if !typed.contains('=') {
            return Some(typed);
        }
        let Some(axis) = axis else {
            self.refuse(flag, typed, "one value, which is for all axes");
            return None;
        };
        let parts: Vec<(&str, &str)> =
            typed.split(',').map(|part| part.split_once('=').unwrap_or(("", part))).collect();
        for (name, _) in &parts {
            if !axes.iter().any(|axis| axis == name.trim()) {
                let hint = did_you_mean(name.trim(), axes.iter().map(String::as_str));
                let allowed = format!("one value, or NAME=VALUE for each of the axes {}{hint}", axes.join(", "));
                self.refuse(flag, typed, allowed);
                return None;
            }
        }
        let found = parts.iter().rfind(|(name, _)| name.trim() == axis).map(|(_, value)| *value);
        if found.is_none() {
            self.refuse(flag, typed, format!("a value for axis {axis} as well"));
        }
        found
    }

    /// Nothing, if all that is needed was given and nothing was refused.
    ///
    /// # Errors
    /// All problems, one on each line.
    pub fn verdict(&self) -> Result<(), Failure> {
        let mut problems = self.problems.clone();
        if !self.missing.is_empty() {
            problems.push(format!(
                "missing: {}; allowed: all of them, or a terminal on which init can ask",
                self.missing.join(", ")
            ));
        }
        if problems.is_empty() { Ok(()) } else { Err(Failure::usage(problems.join("\n"))) }
    }
}

#[cfg(test)]
mod tests {
    use super::{
        super::quantity::{BORE, STROKE},
        *,
    };

    #[test]
    fn a_wrong_answer_is_asked_again_and_an_empty_one_is_the_default() {
        let (mut input, mut output) = (&b"5 kg\n5\n63\n\n"[..], Vec::new());
        let mut answers = Answers::new(Some(Dialogue { input: &mut input, output: &mut output }));
        let axes = ["boom".to_owned(), "arm".to_owned()];
        let mut value =
            |axis: &str, default| answers.value(&BORE, None, (Some(axis), &axes), 0.025..=0.5, default).unwrap();
        assert_eq!(value("boom", 0.05), 0.063);
        assert_eq!(value("arm", 0.05), 0.05);
        answers.verdict().unwrap();
        let said = String::from_utf8(output).unwrap();
        assert!(
            said.starts_with("boom: bore of the cylinder, mm [50]:   found \"5 kg\"; allowed: 25 mm to 500 mm"),
            "{said}"
        );
        assert!(said.contains("found \"5\"; allowed: 25 mm to 500 mm, as a number in mm or with one of the units m,"));
        assert_eq!(said.matches("boom: bore").count(), 3);
    }

    #[test]
    fn answers_that_end_are_refused() {
        let (mut input, mut output) = (&b""[..], Vec::new());
        let mut answers = Answers::new(Some(Dialogue { input: &mut input, output: &mut output }));
        let failure = answers.value(&STROKE, None, (Some("a"), &["a".to_owned()]), 0.05..=10.0, 0.5).unwrap_err();
        assert!(failure.to_string().contains("nothing was written"), "{failure}");
    }
}
