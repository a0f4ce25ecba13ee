//! `hydraxis status --watch` on a terminal: a running group on a screen of its own, with keys.
//!
//! The screen fits into 80 columns and 24 lines. When the group ends it says so, keeps what was last known, and comes
//! back with the next group of that name.

mod look;
mod screen;
mod views;

use std::{
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

use pipeline::{channel::Prefix, stage::monotonic_ns};
use ratatui::{
    DefaultTerminal,
    crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers},
};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use crate::{
    failure::Failure,
    group::live::{Live, Search},
};
use screen::{Screen, Shown, Tab};

/// Time between two looks at the channels and at the keys.
const POLL: Duration = Duration::from_millis(50);
/// Time between two pictures.
const FRAME: Duration = Duration::from_millis(200);

/// Watches a group until `stop` is set or the user ends it. False when there is no terminal to draw on.
///
/// # Errors
/// The terminal cannot be drawn on or read any more.
pub fn watch(prefix: &Prefix, stop: &AtomicBool) -> Result<bool, Failure> {
    let live = Live::join(prefix, "status")?;
    let Ok(mut terminal) = ratatui::try_init() else {
        live.leave();
        return Ok(false);
    };
    let mut watch = Watch {
        prefix: prefix.clone(),
        live: Some(live),
        shown: Shown::new(prefix),
        search: Search::new(Some(prefix.clone())),
    };
    let ended = watch.run(&mut terminal, stop);
    if let Some(live) = watch.live {
        live.leave();
    }
    if is_terminal_gone(Duration::ZERO) {
        // Its destructor would tell so on the terminal, which ends in a panic.
        std::mem::forget(terminal);
    } else {
        ratatui::restore();
    }
    ended.map(|()| true)
}

/// Waits for a key, and says whether the terminal is gone.
///
/// Trap: crossterm reads a terminal that is gone without end, whatever the time-out, and says nothing.
fn is_terminal_gone(longest: Duration) -> bool {
    let input = std::io::stdin();
    let mut terminal = [PollFd::new(&input, PollFlags::IN)];
    let timeout = Timespec { tv_sec: 0, tv_nsec: longest.as_nanos() as i64 };
    // A signal ends the wait as well.
    let has_answer = poll(&mut terminal, Some(&timeout)).is_ok_and(|answers| answers > 0);
    has_answer && terminal[0].revents().intersects(PollFlags::HUP | PollFlags::ERR | PollFlags::NVAL)
}

/// The group that is watched, and what is shown of it.
struct Watch {
    prefix: Prefix,
    /// None while there is no group.
    live: Option<Live>,
    shown: Shown,
    search: Search,
}

impl Watch {
    fn run(&mut self, terminal: &mut DefaultTerminal, stop: &AtomicBool) -> Result<(), Failure> {
        let mut drawn = None;
        while !stop.load(Ordering::Relaxed) {
            self.read();
            let mut is_due = drawn.is_none_or(|drawn: Instant| drawn.elapsed() > FRAME);
            if is_terminal_gone(POLL) {
                return Ok(());
            }
            // Windows that change their size are events without input.
            if event::poll(Duration::ZERO).map_err(Failure::run)? {
                match event::read().map_err(Failure::run)? {
                    Event::Key(key) if key.kind != KeyEventKind::Release => {
                        if is_end(key) {
                            return Ok(());
                        }
                        self.key(key);
                        is_due = true;
                    }
                    Event::Resize(..) => is_due = true,
                    _ => {}
                }
            }
            if is_due {
                drawn = Some(Instant::now());
                self.collect();
                let shown = &mut self.shown;
                terminal.draw(|frame| Screen(shown).draw(frame)).map_err(Failure::run)?;
            }
        }
        Ok(())
    }

    /// Reads the channels, leaves a group that has ended, and looks for the next one.
    fn read(&mut self) {
        match &mut self.live {
            Some(live) => {
                let gone = match live.step() {
                    Ok(_) => live.is_over().then(|| "the group has ended".to_owned()),
                    Err(error) => Some(error.to_string()),
                };
                live.learn();
                if let Some(why) = gone {
                    self.shown.absent = Some(why);
                    if let Some(live) = self.live.take() {
                        live.leave();
                    }
                }
            }
            None => {
                // Until there is one, the reason is the end of the group before.
                let Some(Ok(prefix)) = self.search.look() else { return };
                if let Ok(live) = Live::join(&prefix, "status") {
                    self.live = Some(live);
                    self.shown = Shown { tab: self.shown.tab, ..Shown::new(&self.prefix) };
                }
            }
        }
    }

    /// Takes over the figures of now.
    fn collect(&mut self) {
        let Some(live) = &mut self.live else { return };
        self.shown.report = Some(live.report());
        self.shown.period = live.machine().as_ref().ok().map(|machine| machine.timing.period);
        let state = live.state().map(|state| {
            let age = monotonic_ns().saturating_sub(state.header.sent_ns);
            (state.header.sequence, Duration::from_nanos(age))
        });
        self.shown.state = state;
        let (told, number) = live.told();
        if number != self.shown.told {
            self.shown.told = number;
            self.shown.events = told.iter().map(|told| (told.unix_ms, told.event.clone())).collect();
        }
    }

    fn key(&mut self, key: KeyEvent) {
        let shown = &mut self.shown;
        match key.code {
            KeyCode::Char(number @ '1'..='5') => shown.go(Tab::ALL[number as usize - '1' as usize]),
            KeyCode::Tab | KeyCode::Right => shown.go(shown.tab.next(1)),
            KeyCode::BackTab | KeyCode::Left => shown.go(shown.tab.next(Tab::ALL.len() - 1)),
            KeyCode::Down | KeyCode::Char('j') => shown.scroll = shown.scroll.saturating_add(1),
            KeyCode::Up | KeyCode::Char('k') => shown.scroll = shown.scroll.saturating_sub(1),
            KeyCode::PageDown => shown.scroll = shown.scroll.saturating_add(10),
            KeyCode::PageUp => shown.scroll = shown.scroll.saturating_sub(10),
            KeyCode::Home => shown.scroll = 0,
            _ => {}
        }
    }
}

/// Whether a key ends the program. Ctrl-C comes as a key here, since the terminal gives all keys to the program.
fn is_end(key: KeyEvent) -> bool {
    let is_control = key.modifiers.contains(KeyModifiers::CONTROL);
    matches!(key.code, KeyCode::Char('q') | KeyCode::Esc) || (is_control && key.code == KeyCode::Char('c'))
}
