//! `hydraxis init`: a commented machine file for a rig, from flags or from a few questions.
//!
//! | file | what |
//! |---|---|
//! | `arguments` | the flags |
//! | `quantity` | the quantities: flag, question, unit |
//! | `answers` | values from flags and questions, and what is wrong with them |
//! | `rig` | what follows from them |
//! | `template` | the text of the file |
//!
//! Runs once, before the loop.

mod answers;
mod arguments;
mod quantity;
mod rig;
mod template;

use std::{
    fs::{self, OpenOptions},
    io::{IsTerminal, Write, stderr, stdin},
    path::Path,
};

use pipeline::{MAX_AXES, MAX_NAME, machine::Machine};

use self::{
    answers::{Answers, Dialogue},
    quantity::{
        BORE, DEAD_BAND, DEAD_TIME, DIGITS, LOAD, MASS, PERIOD, PRESSURE, RESOLUTION, ROD, SPEED, STROKE, VALVE_HZ,
        significant,
    },
    rig::Rig,
};
use super::check;
use crate::{failure::Failure, report::output::show};
pub use arguments::InitArguments;

/// Least length of a count of an encoder, m.
const FINEST: f64 = 1e-6;

/// Runs the command.
pub fn run(arguments: &InitArguments) -> Result<(), Failure> {
    expect_new(arguments)?;
    let (mut input, mut output) = (stdin().lock(), stderr());
    let is_terminal = stdin().is_terminal() && output.is_terminal();
    let dialogue = is_terminal.then_some(Dialogue { input: &mut input, output: &mut output });
    let (name, rigs) = rigs(arguments, Answers::new(dialogue))?;
    let [Rig { pressure, period, .. }, ..] = rigs[..] else {
        return Err(Failure::usage("--axes: found no axis; allowed: one name or more"));
    };
    let text =
        template::text(&template::Machine { name: &name, period, pressure, rigs: &rigs, source: &arguments.source });
    expect_sound(&text, &arguments.output)?;
    write(arguments, &text)?;
    let file = shell_word(&arguments.output);
    let sizes = rigs.iter().map(|Rig { name, stroke, bore, rod, speed, .. }| {
        let [stroke, bore, rod] = [(STROKE, *stroke), (BORE, *bore), (ROD, *rod)].map(|(of, value)| of.number(value));
        format!("  {name}: stroke {stroke} mm, bore {bore} mm, rod {rod} mm, up to {}\n", SPEED.text(*speed))
    });
    let commission =
        ("commission --enable".to_owned(), "while it runs: finds model and gains of the rig, into model.toml");
    let last = match arguments.source.as_str() {
        EXTERNAL => {
            [(format!("run {file}"), "waits for your program, which reads sensors and moves valves"), commission]
        }
        template::CAN => [(format!("can scan {file}"), "whether its devices answer; then `hydraxis run`"), commission],
        _ => [
            (format!("commission {file}"), "finds its model and better gains, into model.toml"),
            (format!("run {file} --model model.toml"), "in real time, with that model"),
        ],
    };
    let first = [
        (format!("check {file}"), "what the file describes"),
        (format!("simulate {file}"), "the twin with its fallback controller"),
    ];
    let next: Vec<_> = first.into_iter().chain(last).collect();
    let width = next.iter().map(|(command, _)| command.len()).max().unwrap_or_default();
    let next = next.iter().map(|(command, words)| format!("  hydraxis {command:width$}  {words}\n"));
    let text =
        format!("written: {file}, a twin of the rig\n{}next:\n{}", sizes.collect::<String>(), next.collect::<String>());
    Ok(show(&text)?)
}

/// A path as a word of a shell: in quotes where it has more than letters, digits and a few signs.
fn shell_word(path: &Path) -> String {
    let path = path.display().to_string();
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+:,@%".contains(c);
    if path.chars().all(is_plain) { path } else { format!("'{}'", path.replace('\'', "'\\''")) }
}

/// `--source` of a rig with a program of the user.
const EXTERNAL: &str = "external";

/// Refuses a file that exists, before anything is asked.
fn expect_new(arguments: &InitArguments) -> Result<(), Failure> {
    let path = &arguments.output;
    if path.is_dir() {
        return Err(Failure::usage(format!("--output: found {}, which is a folder; allowed: a file", path.display())));
    }
    if path.exists() && !arguments.force {
        let found = path.display();
        return Err(Failure::usage(format!(
            "--output: found {found}, which is there already; allowed: a new file, or --force"
        )));
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty() && !folder.is_dir());
    match folder {
        None => Ok(()),
        Some(folder) => Err(Failure::usage(format!(
            "--output: found {}; allowed: a file in a folder that exists, and {} does not",
            path.display(),
            folder.display()
        ))),
    }
}

fn write(arguments: &InitArguments, text: &str) -> Result<(), Failure> {
    let path = &arguments.output;
    let mut options = OpenOptions::new();
    if arguments.force {
        options.write(true).create(true).truncate(true);
    } else {
        // Another program may have written the file meanwhile.
        options.write(true).create_new(true);
    }
    let written = options.open(path).and_then(|mut file| {
        // A part of a file would keep the next `init` from writing a whole one.
        file.write_all(text.as_bytes()).inspect_err(|_| drop(fs::remove_file(path)))
    });
    written.map_err(|error| Failure::run(format!("--output: {} cannot be written: {error}", path.display())))
}

/// Refuses answers that are allowed one by one and do not fit together: all that `check` finds in the file.
fn expect_sound(text: &str, path: &Path) -> Result<(), Failure> {
    let name = path.display().to_string();
    let machine = Machine::parse(text, &name, Path::new("."), &[])?;
    let found = check::findings(&machine)?;
    if found.is_empty() {
        return Ok(());
    }
    Err(Failure::usage(format!(
        "these values do not fit together, nothing was written:\n{}\nallowed: other values for the flags behind them",
        found.join("\n")
    )))
}

/// Name of the machine, and its axes.
fn rigs(arguments: &InitArguments, mut answers: Answers) -> Result<(String, Vec<Rig>), Failure> {
    let axes = axes(arguments, &mut answers)?;
    let pressure = answers.value(&PRESSURE, arguments.pressure.as_deref(), (None, &axes), 5e6..=4e7, 21e6)?;
    let mut rigs = Vec::new();
    for name in &axes {
        rigs.push(rig(arguments, &mut answers, (name, &axes), pressure)?);
    }
    let reaction = rigs.iter().map(Rig::reaction).fold(f64::INFINITY, f64::min);
    let usual = match reaction {
        slow if slow > 0.04 => 10e-3,
        middling if middling > 0.015 => 5e-3,
        _ => 2e-3,
    };
    let period = answers.value(&PERIOD, arguments.period.as_deref(), (None, &axes), 1e-3..=50e-3, usual)?;
    for rig in &mut rigs {
        rig.period = significant(period, 4);
        resolve(arguments, &mut answers, rig, &axes)?;
    }
    if arguments.name.as_deref() == Some("") {
        answers.refuse("--name", "", "a text that names the machine, or no --name");
    }
    answers.verdict()?;
    let name = arguments.name.clone().unwrap_or_else(|| axes.join(" and "));
    Ok((name, rigs))
}

/// The names of the axes.
fn axes(arguments: &InitArguments, answers: &mut Answers) -> Result<Vec<String>, Failure> {
    const DEFAULT: &str = "cylinder";
    const ALLOWED: &str = "different names, with commas between them, each of 1 to 32 letters, digits, - and _";
    let parse = |text: &str| {
        let names: Vec<String> = text.split(',').map(|name| name.trim().to_owned()).collect();
        let is_letter = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        let is_name = |name: &String| (1..=MAX_NAME).contains(&name.len()) && name.chars().all(is_letter);
        let is_first = |(i, name): (usize, &String)| !names[..i].contains(name);
        let is_good = names.iter().all(is_name) && names.iter().enumerate().all(is_first) && names.len() <= MAX_AXES;
        if is_good { Ok(names) } else { Err(format!("1 to {MAX_AXES} {ALLOWED}")) }
    };
    match &arguments.axes {
        Some(text) => Ok(parse(text).unwrap_or_else(|allowed| {
            answers.refuse("--axes", text, allowed);
            vec![DEFAULT.to_owned()]
        })),
        None => {
            if !answers.can_ask() {
                answers.require("--axes");
            }
            let asked = answers.ask("names of the axes, with commas between them", DEFAULT, parse)?;
            Ok(asked.unwrap_or_else(|| vec![DEFAULT.to_owned()]))
        }
    }
}

/// One axis, without period and resolution.
fn rig(
    arguments: &InitArguments,
    answers: &mut Answers,
    (name, axes): (&str, &[String]),
    pressure: f64,
) -> Result<Rig, Failure> {
    let mut value = |quantity, typed: &Option<String>, range, default| {
        answers.value(quantity, typed.as_deref(), (Some(name), axes), range, default)
    };
    let stroke = value(&STROKE, &arguments.stroke, 0.05..=10.0, 0.5)?;
    let bore = value(&BORE, &arguments.bore, 0.025..=0.5, 0.05)?;
    // A thinner rod is no excavator's; a thicker one leaves no area to pull with.
    let rod = value(
        &ROD,
        &arguments.rod,
        significant(0.2 * bore, 3)..=significant(0.9 * bore, 3),
        significant(0.6 * bore, 2),
    )?;
    let valve_hz = value(&VALVE_HZ, &arguments.valve_hz, 1.0..=100.0, 8.0)?;
    let dead_time = value(&DEAD_TIME, &arguments.dead_time, 0.0..=1.0, 0.04)?;
    let travel = |seconds: f64| significant((stroke / seconds).min(3.0), 2);
    let speed = value(&SPEED, &arguments.speed, travel(60.0)..=travel(0.5), travel(3.0))?;
    let mut rig = Rig {
        name: name.to_owned(),
        stroke,
        bore,
        rod,
        valve_hz,
        dead_time,
        speed,
        mass: 1.0,
        load: 0.0,
        dead_band: 0.0,
        resolution: 0.0,
        pressure,
        period: 0.0,
    };
    let (extend, retract) = rig.forces();
    let masses = significant(1e-3 * extend, 2)..=significant((0.3 * extend).min(1e6), 2);
    rig.mass = value(&MASS, &arguments.mass, masses, significant(0.2 * extend / 9.81, 2))?;
    let loads = significant(-0.5 * retract, 2)..=significant(0.5 * extend, 2);
    rig.load = value(&LOAD, &arguments.load, loads, 0.0)?;
    rig.dead_band = value(&DEAD_BAND, &arguments.dead_band, 0.0..=0.6, 0.1)?;
    Ok(rig)
}

/// The resolution of the encoder, whose bounds follow from speed and period.
fn resolve(arguments: &InitArguments, answers: &mut Answers, rig: &mut Rig, axes: &[String]) -> Result<(), Failure> {
    let counts = FINEST..=coarsest(rig);
    let default = round(1e-4 * rig.stroke).clamp(*counts.start(), *counts.end());
    let name = rig.name.clone();
    let of = (Some(name.as_str()), axes);
    let resolution = answers.value(&RESOLUTION, arguments.resolution.as_deref(), of, counts, default)?;
    // What follows from it follows from the number in the file.
    rig.resolution = significant(resolution, DIGITS);
    Ok(())
}

/// Greatest length of a count, m: motion at a tenth of the largest speed is told from a stall, and at the largest speed
/// every period has a count.
fn coarsest(rig: &Rig) -> f64 {
    let longest = (5e-3 * rig.max_speed()).min(0.5 * rig.max_speed() * rig.period).min(1e-3);
    significant(longest, 2)
}

/// A number as scales have it: 1, 2 or 5 times a power of ten, not above `value`.
fn round(value: f64) -> f64 {
    let power = 10f64.powf(value.log10().floor());
    let digit = [5.0, 2.0, 1.0].into_iter().find(|digit| digit * power <= value).unwrap_or(1.0);
    significant(digit * power, 2)
}
