//! A campaign of stops: whatever else happens on the computer, every stop is acted on. The time that it takes is
//! measured.
//!
//! ```text
//! arm the axes | begin conditions drawn at random | stop | first neutral command | end the conditions
//!                                                   0 -------------> t
//! ```
//!
//! t counts from before the program of the stop is started, or from before the signal or the counter on the board is
//! raised, to the time at which control-proc sent the first command that is neutral for all axes to stop. From then on
//! every command must stay so until the axes are armed again. An emergency stop must stay latched until it is reset.
//!
//! Half of the programs are started by a shell with a real-time priority, where that is to be had. The bound counts for
//! them: when an ordinary program gets a core, nothing guarantees.
//!
//! `HYDRAXIS_STOPS` is the number of stops of the long form, `HYDRAXIS_STOPS_SEED` repeats what was drawn, and
//! `HYDRAXIS_STOPS_REPORT` names a file for the times.

mod conditions;
mod figures;
mod shell;
mod watched;

use std::process::{Child, Command};

use pipeline::stage::StageKind;
use rustix::process::Signal;

use crate::harness::{Dice, alone, is_running, place::in_own_place, signal, variable};
use conditions::{Conditions, Held, Kills};
use figures::Figures;
use shell::FirstShell;
use watched::{AXES, Asked, NAMES, Watched, now};

/// Stops of the short form: enough for every condition and every way of stopping.
const FEW: u64 = 100;
/// Stops of the long form.
const MANY: u64 = 10_000;
/// Longest time until the first neutral command while a controller runs, ms; asserted in the long form only.
const BOUND: f64 = 100.0;
/// Where a stop comes from: a shell with a real-time priority.
const FIRST: &str = "shell with priority";
/// Stops between two writings of the report.
const REPORTED: u64 = 100;

/// How a stop is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Way {
    /// `hydraxis disarm --axis NAME`.
    Axis,
    /// `hydraxis disarm`.
    All,
    /// `hydraxis disarm` without a name.
    Everywhere,
    /// `hydraxis disarm --emergency`.
    Emergency,
    /// SIGUSR2 to control-proc.
    Signal,
    /// The counter on the board, raised by this process.
    Raised,
    /// That of the emergency stop.
    RaisedEmergency,
}

impl Way {
    fn draw(dice: &mut Dice, is_private: bool, can_signal: bool) -> Self {
        match dice.below(16) {
            0..7 => Self::Axis,
            7..9 => Self::All,
            9 if is_private => Self::Everywhere,
            9..11 => Self::Emergency,
            11..13 if can_signal => Self::Signal,
            15 => Self::RaisedEmergency,
            _ => Self::Raised,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Axis => "disarm --axis",
            Self::All => "disarm --prefix",
            Self::Everywhere => "disarm of all groups",
            Self::Emergency => "disarm --emergency",
            Self::Signal => "SIGUSR2",
            Self::Raised => "counter raised",
            Self::RaisedEmergency => "counter of emergency raised",
        }
    }

    fn is_emergency(self) -> bool {
        matches!(self, Self::Emergency | Self::RaisedEmergency)
    }

    fn origin(self) -> &'static str {
        if self.is_shell() { "shell" } else { "raise" }
    }

    fn is_shell(self) -> bool {
        matches!(self, Self::Axis | Self::All | Self::Everywhere | Self::Emergency)
    }
}

struct Campaign {
    watched: Watched,
    dice: Dice,
    figures: Figures,
    kills: Kills,
    is_private: bool,
    stops: u64,
    shell: Option<FirstShell>,
}

impl Campaign {
    fn start(test: &'static str, is_private: bool, count: u64) -> Self {
        let dice = Dice::new(test, "HYDRAXIS_STOPS_SEED", &format!("{count} stops"));
        let watched = Watched::start("campaign");
        let (figures, kills, shell) = (Figures::default(), Kills::default(), FirstShell::start());
        Self { watched, dice, figures, kills, is_private, stops: 0, shell }
    }

    /// One stop; none is made where nothing is armed when the conditions have begun.
    fn stop(&mut self) {
        self.watched.poll();
        if self.watched.armed().is_empty() || self.dice.once_in(4) {
            self.watched.arm();
        }
        let conditions = Conditions::draw(&mut self.dice, &mut self.kills, self.is_private);
        self.watched.step = format!("stop {}, {:?}", self.stops, conditions.names());
        let held = conditions.begin(&mut self.watched, &mut self.dice);
        self.watched.poll();
        let armed = self.watched.armed();
        if armed.is_empty() {
            return held.end(&mut self.watched);
        }
        self.measure(&conditions, &armed, held);
        self.stops += 1;
    }

    fn measure(&mut self, conditions: &Conditions, armed: &[usize], held: Held) {
        let is_down = conditions.is_control_down();
        let can_signal = !is_down && is_running(self.watched.pid(StageKind::ControlProc));
        let way = Way::draw(&mut self.dice, self.is_private, can_signal);
        let mut axes = [false; AXES];
        match way {
            Way::Axis | Way::Raised => axes[self.dice.one_of(armed)] = true,
            Way::Emergency | Way::RaisedEmergency => axes.fill(true),
            Way::All | Way::Everywhere | Way::Signal => armed.iter().for_each(|axis| axes[*axis] = true),
        }
        self.watched.step = format!("stop {} of {axes:?} by {}, {:?}", self.stops, way.name(), conditions.names());
        let is_first = way.is_shell() && self.shell.is_some() && self.dice.once_in(2);
        let mut child = self.ask(way, axes, is_first);
        let mut held = Some(held);
        if conditions.keep_control_down() {
            // The next controller starts when there is room, mostly after the end of the conditions. Until then the
            // program says that nobody answers.
            if let Some(mut child) = child.take() {
                self.watched.finish(&mut child);
            }
            held.take().into_iter().for_each(|held| held.end(&mut self.watched));
        }
        let Some((time, since_raise)) = self.watched.answer() else {
            println!("{}", self.figures.table());
            self.watched.fail("not acted on");
        };
        if let Some(child) = &mut child {
            let status = self.watched.finish(child);
            assert!(status.success() || is_down, "{}: {status}", self.watched.step);
        }
        let from = if is_first { FIRST } else { way.origin() };
        self.note(from, way, conditions, time, since_raise);
        held.into_iter().for_each(|held| held.end(&mut self.watched));
    }

    fn ask(&mut self, way: Way, axes: [bool; AXES], is_first: bool) -> Option<Child> {
        let chosen = || (0..AXES).filter(|axis| axes[*axis]);
        let names = chosen().flat_map(|axis| ["--axis", NAMES[axis]]);
        let command = match way {
            Way::Axis => self.watched.command(&[&["disarm"], &names.collect::<Vec<_>>()[..]].concat()),
            Way::Emergency => self.watched.command(&["disarm", "--emergency"]),
            Way::Everywhere => watched::everywhere(),
            _ => self.watched.command(&["disarm"]),
        };
        self.watched.expect(Asked { axes, is_emergency: way.is_emergency(), at_ns: now() });
        match way {
            Way::Signal => signal(self.watched.pid(StageKind::ControlProc), Signal::USR2),
            Way::Raised => drop(self.watched.board.stop(chosen())),
            Way::RaisedEmergency => drop(self.watched.board.emergency_stop()),
            _ => return Some(self.spawn(command, is_first)),
        }
        None
    }

    fn spawn(&self, mut command: Command, is_first: bool) -> Child {
        match self.shell.as_ref().filter(|_| is_first) {
            Some(shell) => shell.spawn(command),
            None => command.spawn().unwrap(),
        }
    }

    fn note(&mut self, from: &str, way: Way, conditions: &Conditions, time: f64, since_raise: Option<f64>) {
        if conditions.keep_control_down() {
            return self.figures.take("control-proc down, memory full: until the next one's first command", time);
        }
        if conditions.is_control_down() {
            return self.figures.take("control-proc down: until the next one's first command", time);
        }
        self.figures.take(format!("{from}, all"), time);
        if let Some(since_raise) = since_raise.filter(|_| way.is_shell()) {
            self.figures.take(format!("{from}, from the counter on the board on"), since_raise);
            self.figures.take(format!("{from}, until the counter on the board is raised"), time - since_raise);
        }
        self.figures.take(format!("{from}, {}", way.name()), time);
        let names = conditions.names();
        for name in &names {
            self.figures.take(format!("{from}, with {name}"), time);
        }
        match names.len() {
            0 => self.figures.take(format!("{from}, nothing else"), time),
            1 => {}
            _ => self.figures.take(format!("{from}, with several of them"), time),
        }
        if time > BOUND {
            self.dice.note(&format!("{time:.1} ms, {since_raise:.1?} of it since the raise: {}", self.watched.step));
        }
    }

    /// Makes so many stops. Returns the times.
    fn run(mut self, count: u64) -> Figures {
        let report: String = variable("HYDRAXIS_STOPS_REPORT", String::new());
        while self.stops < count {
            self.stop();
            if !report.is_empty() && self.stops.is_multiple_of(REPORTED) {
                std::fs::write(&report, format!("{} stops\n{}", self.stops, self.figures.table())).unwrap();
            }
        }
        self.dice.note(&format!("{count} stops\n{}", self.figures.table()));
        self.watched.end();
        self.figures
    }
}

#[test]
fn stops_are_acted_on_whatever_else_happens() {
    let _cores = alone();
    in_own_place("campaign::stops_are_acted_on_whatever_else_happens", |is_private| {
        let figures = Campaign::start("stops", is_private, FEW).run(FEW);
        assert!(figures.median("shell, all").is_some() && figures.median("raise, all").is_some());
    });
}

#[test]
#[ignore = "takes an hour"]
fn of_many_stops_each_is_acted_on_in_time() {
    let _cores = alone();
    in_own_place("campaign::of_many_stops_each_is_acted_on_in_time", |is_private| {
        let count = variable("HYDRAXIS_STOPS", MANY);
        let campaign = Campaign::start("many stops", is_private, count);
        let has_shell = campaign.shell.is_some();
        let figures = campaign.run(count);
        let shell = if has_shell { FIRST } else { Way::All.origin() };
        for from in [shell, Way::Raised.origin()] {
            assert_eq!(figures.above(&format!("{from}, all"), BOUND), 0, "{from}: above {BOUND} ms");
        }
    });
}
