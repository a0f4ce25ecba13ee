//! `hydraxis disarm`: stops the axes of one group, or of all groups of this user.
//!
//! The stop goes over the board of the group, which needs no place on a channel. It is asked for before anything else
//! is done; the answer is waited for afterwards.

use std::{
    thread::sleep,
    time::{Duration, Instant},
};

use pipeline::{
    channel::{Board, GroupState, Prefix, Ticket, boards, groups},
    message::control_flag,
    stage::schedule,
};

use super::{DisarmArguments, arm::next};
use crate::{
    arguments::axes_of,
    failure::{Failure, Failures},
    group::operator::{board, state},
    report::output::show,
};

/// Time in which a controller must act, and the same in periods, of which the longer one counts.
const PATIENCE: Duration = Duration::from_secs(1);
const PERIODS: u32 = 3;
/// Time between two looks at the board.
const POLL: Duration = Duration::from_micros(200);
/// Priority of SCHED_FIFO while it stops: before every ordinary program, and behind the stages that have one.
const PRIORITY: u8 = 1;

/// Disarms all axes but the latched ones.
pub fn disarm(arguments: &DisarmArguments) -> Result<(), Failure> {
    // Without the right to it the stop comes as soon as an ordinary program can.
    let _ = schedule(PRIORITY);
    let asked = match &arguments.prefix {
        Some(prefix) => vec![ask(board(prefix)?, arguments)?],
        None => ask_all(arguments)?,
    };
    let mut failures = Failures::default();
    let mut text = String::new();
    for (board, axes, ticket) in &asked {
        let several = if asked.len() > 1 { format!("group \"{}\"\n", board.prefix()) } else { String::new() };
        if failures.take(await_answer(board, ticket)).is_some() {
            text += &format!("{several}{}", states(board, axes));
        }
    }
    show(&text)?;
    failures.verdict(Some(()))
}

type Asked = (Board, Vec<usize>, Ticket);

/// Asks one group to stop.
fn ask(board: Board, arguments: &DisarmArguments) -> Result<Asked, Failure> {
    let axes = axes_of(board.machine().names(), &arguments.axes)?;
    let ticket = if arguments.emergency { board.emergency_stop() } else { board.stop(axes.iter().copied()) };
    Ok((board, axes, ticket))
}

/// Asks every group of this user to stop. Returns those that run.
fn ask_all(arguments: &DisarmArguments) -> Result<Vec<Asked>, Failure> {
    // The board of another user's group cannot be opened; that group is theirs to stop.
    let (mut asked, mut others) = (Vec::new(), String::new());
    for prefix in boards() {
        match Board::find(&prefix) {
            Ok(board) => board.into_iter().try_for_each(|board| ask(board, arguments).map(|one| asked.push(one)))?,
            Err(error) => others += &format!("\n{error}"),
        }
    }
    let alive: Vec<Prefix> =
        groups().into_iter().filter(|group| group.state == GroupState::Alive).map(|group| group.prefix).collect();
    let running: Vec<Asked> = asked.into_iter().filter(|(board, ..)| alive.contains(board.prefix())).collect();
    if running.is_empty() {
        return Err(Failure::run(format!("no group of this user runs: nothing to disarm{others}")));
    }
    Ok(running)
}

fn await_answer(board: &Board, ticket: &Ticket) -> Result<(), Failure> {
    let patience = PATIENCE.max(PERIODS * Duration::from_nanos(board.machine().period_ns));
    let until = Instant::now() + patience;
    while !board.is_done(ticket) {
        if Instant::now() >= until {
            return Err(Failure::run(format!(
                "group \"{}\": asked to stop, not answered within {}: control-proc does not run or hangs, and then \
                 drives go neutral by themselves; `hydraxis status --prefix {0}` shows it. Cut the pressure off by \
                 hand if anything moves",
                board.prefix(),
                humantime::format_duration(patience)
            )));
        }
        sleep(POLL);
    }
    Ok(())
}

/// A line for each axis, and what to type next for the latched ones.
fn states(board: &Board, axes: &[usize]) -> String {
    let machine = board.machine();
    let mut text = String::new();
    for axis in axes {
        let (flags, operation) = board.state(*axis);
        text += &format!("{}\n", state(machine.name(*axis), flags, operation));
    }
    let is_latched = |axis: &usize| board.state(*axis).0 & control_flag::LATCHED != 0;
    let latched: Vec<usize> = axes.iter().copied().filter(is_latched).collect();
    text + &next(machine, &latched, "reset", board.prefix())
}
