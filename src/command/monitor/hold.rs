//! Axes that are armed for as long as a page holds a button down.
//!
//! ```text
//! page --press, then beats--> lease --a thread each 5 ms: is it over?--> stop
//!                              \--> operator: one request for every sample, hold to run --> control-proc
//!
//! end of the lease = stamp of the newest beat + LEASE
//! ```
//!
//! A stamp is the server's time that the page has got last and sends back. So the lease counts from a time at which the
//! page was alive, however long its message was on its way: what a network has kept back moves nothing.
//!
//! At the end of the lease the axes are stopped over the board. When this process dies or hangs, its requests stop, and
//! the controller disarms the axes by itself after 0.1 s.

use std::{
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

use pipeline::{
    channel::{Prefix, remove_leftovers},
    message::AxisMode,
};

use crate::{
    failure::Failure,
    group::operator::{Operator, board},
    teeth::{MovableTeeth, TeethPlace},
};

/// Time from a stamp to the end of the lease that it gives. With the tick that follows, and the command that it takes,
/// an axis is off within 0.3 s.
pub const LEASE: Duration = Duration::from_millis(220);
/// Time between two looks at the lease.
const LOOK: Duration = Duration::from_millis(5);

/// What the axes are to do while the button is held.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wanted {
    /// Hold, track or manual.
    pub mode: AxisMode,
    /// Where to hold, m; without one the axis holds where it comes to a stand.
    pub target: Option<f64>,
    /// Valve command of the mode manual.
    pub command: f64,
    /// Where the teeth go, by all four axes in the mode track.
    pub teeth: Option<TeethPlace>,
}

/// How far a press has come.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Phase {
    /// The controller has not taken it yet.
    Arming,
    /// The axes are in the mode.
    Held,
    /// The axes are off; why, where it was not the end of the lease.
    Ended(String),
}

#[derive(Debug)]
struct Now {
    until: Instant,
    wanted: Wanted,
    phase: Phase,
    /// Where the teeth are on their way, in words.
    told: String,
}

/// A button that is held down on a page.
#[derive(Debug)]
pub struct Hold {
    /// Number that the page has given it.
    pub id: u64,
    prefix: Prefix,
    axes: Vec<usize>,
    now: Mutex<Now>,
    stop: Arc<AtomicBool>,
}

impl Hold {
    /// Begins to arm these axes of a group, with a lease from this time on.
    ///
    /// # Errors
    /// The system gives no thread.
    pub fn begin(
        id: u64,
        prefix: Prefix,
        axes: Vec<usize>,
        wanted: Wanted,
        stamp: Instant,
    ) -> Result<Arc<Self>, Failure> {
        let now = Mutex::new(Now { until: stamp + LEASE, wanted, phase: Phase::Arming, told: String::new() });
        let hold = Arc::new(Self { id, prefix, axes, now, stop: Arc::new(AtomicBool::new(false)) });
        let watched = Arc::clone(&hold);
        thread::Builder::new().name("lease".to_owned()).spawn(move || watched.watch()).map_err(Failure::run)?;
        let operated = Arc::clone(&hold);
        thread::Builder::new().name("operator".to_owned()).spawn(move || operated.run()).map_err(Failure::run)?;
        Ok(hold)
    }

    /// Takes in a beat of the page with its stamp. A lease that is over stays so. Returns how far the press has come,
    /// and where the teeth are on their way, in words.
    pub fn beat(&self, stamp: Instant, target: Option<f64>, command: f64) -> (Phase, String) {
        let mut now = self.now();
        if !self.is_released() && Instant::now() < now.until {
            now.until = now.until.max(stamp + LEASE);
            (now.wanted.target, now.wanted.command) = (target, command);
        }
        (now.phase.clone(), now.told.clone())
    }

    /// Ends the lease.
    pub fn release(&self) {
        self.stop.store(true, Ordering::Release);
    }

    /// Whether the lease is over.
    pub fn is_released(&self) -> bool {
        self.stop.load(Ordering::Acquire)
    }

    /// Whether the axes are off again.
    pub fn is_over(&self) -> bool {
        matches!(self.now().phase, Phase::Ended(_))
    }

    fn now(&self) -> MutexGuard<'_, Now> {
        // Nothing is half done at any place where a thread could panic.
        self.now.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Ends the lease in time.
    fn watch(&self) {
        while !self.is_released() {
            if Instant::now() >= self.now().until {
                self.release();
            }
            thread::sleep(LOOK);
        }
    }

    fn run(&self) {
        let outcome = self.operate();
        self.release();
        let _ = remove_leftovers(&self.prefix);
        self.now().phase = Phase::Ended(outcome.err().map(|failure| failure.to_string()).unwrap_or_default());
    }

    /// Arms the axes, sends requests until the end of the lease, and disarms the axes.
    fn operate(&self) -> Result<(), Failure> {
        let board = board(&self.prefix)?;
        let mut operator = Operator::join(&self.prefix, false, Arc::clone(&self.stop))?;
        let mut outcome = Ok(());
        if !operator.stopping() {
            outcome = self.stream(&mut operator);
        }
        board.stop(self.axes.iter().copied());
        operator.disarm(&self.axes)?;
        outcome
    }

    fn stream(&self, operator: &mut Operator) -> Result<(), Failure> {
        if let Some(axis) = self.axes.iter().find(|axis| !operator.latched_by(**axis).is_empty()) {
            return Err(Failure::run(format!("{}; look at why, then reset it", operator.state(*axis))));
        }
        let Wanted { mode, teeth, .. } = self.now().wanted;
        if let Some(place) = teeth {
            return self.move_teeth(place, operator);
        }
        self.ask(operator);
        if !operator.change(&self.axes, mode)? {
            return Ok(());
        }
        self.now().phase = Phase::Held;
        while let Some(sample) = operator.sample()? {
            self.ask(operator);
            operator.ask(&sample)?;
            while operator.command()?.is_some() {}
            let has_left = |axis: &&usize| operator.last(**axis).is_some_and(|last| last.operation != mode as u32);
            if let Some(axis) = self.axes.iter().find(has_left) {
                return Err(Failure::run(operator.state(*axis)));
            }
        }
        Ok(())
    }

    /// Moves the teeth to a place, and holds them there.
    fn move_teeth(&self, place: TeethPlace, operator: &mut Operator) -> Result<(), Failure> {
        let teeth = MovableTeeth::new(&self.prefix)?;
        // What the machine cannot do is refused before anything is armed.
        teeth.plan(place, operator)?;
        let Some(mut moving) = teeth.begin(place, operator)? else { return Ok(()) };
        self.now().phase = Phase::Held;
        while let Some(sample) = operator.sample()? {
            let (at, _) = moving.step(operator, &sample)?;
            self.now().told = moving.told(&at);
        }
        Ok(())
    }

    /// Puts what is wanted now into the next request.
    fn ask(&self, operator: &mut Operator) {
        let wanted = self.now().wanted;
        for axis in &self.axes {
            let request = operator.axis(*axis);
            request.command = wanted.command;
            request.target = wanted.target.unwrap_or_default();
            request.has_target = u32::from(wanted.target.is_some());
            request.hold_to_run = 1;
        }
    }
}
