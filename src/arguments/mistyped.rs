//! What clap refuses, said as every other refusal: place, what was found, what is allowed, and what to type next.
//!
//! clap itself names the place and the mistake in a form of its own, and shows neither all options nor all commands.

use clap::{
    Arg, Command, Error,
    error::{ContextKind, ContextValue, ErrorKind},
};
use pipeline::nearest::{nearest, question};

/// The text about a command line that clap has refused; none for help and version, which clap shows. `typed` is the
/// command line without the program.
pub fn refusal(error: &Error, program: &Command, typed: &[String]) -> Option<String> {
    let (path, command) = meant(program, typed);
    let text = Refused { error, command }.text()?;
    let next = match one(error, ContextKind::InvalidSubcommand) {
        Some(file) if file.ends_with(".toml") => format!("{path} check {file}"),
        _ => format!("{path} --help"),
    };
    Some(format!("{text}\nnext: {next}"))
}

/// The command that was meant, with the words that lead to it.
fn meant<'c>(program: &'c Command, typed: &[String]) -> (String, &'c Command) {
    let (mut path, mut command) = (program.get_name().to_owned(), program);
    for word in typed {
        let Some(next) = command.find_subcommand(word) else { break };
        path += &format!(" {word}");
        command = next;
    }
    (path, command)
}

/// An error of clap, and the command that it is about.
struct Refused<'e> {
    error: &'e Error,
    command: &'e Command,
}

impl Refused<'_> {
    fn text(&self) -> Option<String> {
        let places = all(self.error, ContextKind::InvalidArg);
        let place = places.first().map(|place| name(place)).unwrap_or_default();
        let text = match self.error.kind() {
            ErrorKind::DisplayHelp
            | ErrorKind::DisplayVersion
            | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => return None,
            ErrorKind::InvalidSubcommand => self.subcommand(),
            ErrorKind::UnknownArgument => self.unknown(place),
            ErrorKind::MissingRequiredArgument => {
                let lines: Vec<String> = places.iter().map(|place| self.nothing(place)).collect();
                lines.join("\n")
            }
            ErrorKind::ArgumentConflict => {
                let others: Vec<&str> = all(self.error, ContextKind::PriorArg)
                    .into_iter()
                    .map(name)
                    .filter(|other| *other != place)
                    .collect();
                if others.is_empty() {
                    format!("{place}: found more than once; allowed: once")
                } else {
                    format!("{place}: found with {}; allowed: without it", others.join(" and "))
                }
            }
            ErrorKind::InvalidValue | ErrorKind::ValueValidation => self.value(place, places.first()?),
            // Kinds that no argument of this program can have today.
            _ => self.error.to_string().lines().next().unwrap_or_default().to_owned(),
        };
        Some(text)
    }

    /// An unknown subcommand.
    fn subcommand(&self) -> String {
        let found = one(self.error, ContextKind::InvalidSubcommand).unwrap_or_default();
        let names: Vec<&str> = self.command_names().collect();
        format!("command: found \"{found}\"; allowed: {}{}", self.commands(), hint(found, &names))
    }

    fn command_names(&self) -> impl Iterator<Item = &str> {
        self.command.get_subcommands().map(Command::get_name)
    }

    fn commands(&self) -> String {
        format!("one of {}", self.command_names().collect::<Vec<_>>().join(", "))
    }

    /// An unknown option, or an argument too many.
    fn unknown(&self, place: &str) -> String {
        let options: Vec<String> = self.arguments().filter_map(Arg::get_long).map(|long| format!("--{long}")).collect();
        let options: Vec<&str> = options.iter().map(String::as_str).collect();
        if self.command.has_subcommands() {
            return format!("{place}: found an option before the command; allowed: first {}", self.commands());
        }
        if place.starts_with('-') {
            let hint = hint(place, &options);
            return format!("{place}: found an unknown option; allowed: one of {}{hint}", options.join(", "));
        }
        let names: Vec<String> = self.arguments().filter(|argument| argument.is_positional()).map(shown).collect();
        let allowed: Vec<&str> = names.iter().map(String::as_str).chain(options).collect();
        format!("{place}: found one argument too many; allowed: only {}", allowed.join(", "))
    }

    /// An argument, or the value of an option, that is missing.
    fn nothing(&self, place: &str) -> String {
        let place = name(place);
        let Some(argument) = self.argument(place) else { return format!("{place}: found nothing; allowed: a value") };
        let is_needed = self.error.kind() == ErrorKind::MissingRequiredArgument && !argument.is_required_set();
        let needed = if is_needed { ", and another option here needs it" } else { "" };
        let allowed = match choices(argument) {
            names if names.is_empty() => {
                format!("{} ({})", shown(argument), argument.get_help().map(ToString::to_string).unwrap_or_default())
            }
            names => format!("one of {}", names.join(", ")),
        };
        format!("{place}: found nothing{needed}; allowed: {allowed}")
    }

    /// A value that its option, or its place, does not have.
    fn value(&self, place: &str, whole: &str) -> String {
        let found = one(self.error, ContextKind::InvalidValue).unwrap_or_default();
        let names = all(self.error, ContextKind::ValidValue);
        if found.is_empty() && self.error.kind() == ErrorKind::InvalidValue {
            return self.nothing(whole);
        }
        if !names.is_empty() {
            let hint = hint(found, &names);
            return format!("{place}: found \"{found}\"; allowed: one of {}{hint}", names.join(", "));
        }
        let said = std::error::Error::source(self.error).map(ToString::to_string).unwrap_or_default();
        match said.find("allowed: ") {
            Some(allowed) => format!("{place}: found \"{found}\"; {}", &said[allowed..]),
            None => format!("{place}: found \"{found}\": {said}"),
        }
    }

    /// The arguments that a user sees.
    fn arguments(&self) -> impl Iterator<Item = &Arg> {
        self.command.get_arguments().filter(|argument| !argument.is_hide_set())
    }

    /// The argument with this name: an option with its dashes, or the name of a value.
    fn argument(&self, name: &str) -> Option<&Arg> {
        self.arguments().find(|argument| match name.strip_prefix("--") {
            Some(long) => argument.get_long() == Some(long),
            None => argument.is_positional() && value_name(argument) == name,
        })
    }
}

/// The nearest names as a question; where none is near, those that begin with what was typed.
fn hint(typed: &str, names: &[&str]) -> String {
    let near = nearest(typed, names.iter().copied());
    if near.is_empty() && typed.len() > 1 {
        return question(names.iter().copied().filter(|name| name.starts_with(typed)));
    }
    question(near)
}

/// Names of the values that an argument can have; none where it has no such names.
fn choices(argument: &Arg) -> Vec<String> {
    if !argument.get_action().takes_values() {
        return Vec::new();
    }
    let values = argument.get_possible_values().into_iter().filter(|value| !value.is_hide_set());
    values.map(|value| value.get_name().to_owned()).collect()
}

fn value_name(argument: &Arg) -> String {
    let given = argument.get_value_names().and_then(|names| names.first()).map(ToString::to_string);
    given.unwrap_or_else(|| argument.get_id().as_str().to_uppercase())
}

/// An argument as the help shows it, such as `--mode MODE`.
fn shown(argument: &Arg) -> String {
    let value = value_name(argument);
    match argument.get_long() {
        Some(long) if argument.get_action().takes_values() => format!("--{long} {value}"),
        Some(long) => format!("--{long}"),
        None => value,
    }
}

/// The name of an argument of which clap shows `--mode <MODE>`, `<SHELL>` or `[MACHINE.toml]`.
fn name(shown: &str) -> &str {
    let first = if shown.starts_with('-') { shown.split([' ', '=', '[']).next().unwrap_or(shown) } else { shown };
    first.trim_start_matches(['<', '[']).trim_end_matches(['.', '>', ']'])
}

/// A text that clap keeps about its error.
fn one(error: &Error, kind: ContextKind) -> Option<&str> {
    all(error, kind).first().copied()
}

/// The texts that clap keeps about its error.
fn all(error: &Error, kind: ContextKind) -> Vec<&str> {
    match error.get(kind) {
        Some(ContextValue::String(text)) => vec![text],
        Some(ContextValue::Strings(texts)) => texts.iter().map(String::as_str).collect(),
        _ => Vec::new(),
    }
}
