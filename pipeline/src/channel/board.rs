//! The board of a group: which machine it runs, and the stops that were asked for.
//!
//! ```text
//! any program --off, emergency--> counters --> control-proc, every tick --acted on--> counters --> any program
//! ```
//!
//! A stop must not depend on what a request depends on: a free place on a channel, free memory, a program that answers.
//! So it has no channel. The board is one page of shared memory that is taken when the group starts. To ask for a stop
//! is to raise a counter on it, which any number of programs can do at the same time, also programs that have never
//! been members of the group. Nothing on the board can arm an axis.
//!
//! The flags of the last command are on the board too, so that a stop can be seen to have worked.
//!
//! In lock-step a recorder tells here how far it has read, so that the loop can wait for it: a run that can be repeated
//! bit for bit is recorded whole.
//!
//! The machine is on the board so that names of axes come from the group that runs, never from a file that another
//! program has read: with another order of axes, another axis would move.
//!
//! [`Stops`] runs in the loop of control-proc: loads and stores of a few words.

use std::path::PathBuf;

use iceoryx2::prelude::*;
use iceoryx2_bb_concurrency::atomic::{AtomicU32, AtomicU64, Ordering};
use iceoryx2_cal::{
    dynamic_storage::{DynamicStorage, DynamicStorageBuilder, DynamicStorageOpenOrCreateError},
    named_concept::{NamedConceptBuilder, NamedConceptConfiguration, NamedConceptMgmt},
};
use thiserror::Error;

use super::{
    folder::{Foreign, owned},
    names::{BOARD, memory},
    prefix::Prefix,
    service::OPEN_PATIENCE,
    storage::Reserved,
};
use crate::{MAX_AXES, MAX_NAME, layout::shared_struct, machine::Machine, message::ValveCommand};

/// Parts of [`BOARD`](super::names::BOARD) for iceoryx2, which puts the line before them.
const NAME: &str = "board";
const ENDING: &str = ".stop";

shared_struct! {
    /// The machine of a group, as far as its clients need it.
    #[type_name("hydraxis.GroupMachine/2")]
    pub struct GroupMachine {
        /// [`Machine::fingerprint`].
        pub fingerprint: u64,
        /// [`Machine::hardware`].
        pub hardware: u64,
        /// Control period, ns.
        pub period_ns: u64,
        /// Number of axes; the entries beyond it are zero.
        pub axis_count: u64,
        /// Names of the axes in ASCII, filled up with zeros.
        pub names: [[u8; MAX_NAME]; MAX_AXES],
        /// Soft limits of the axes, m.
        pub soft_limits: [[f64; 2]; MAX_AXES],
        /// Dead bands that the fallback compensates while extending and retracting, as magnitudes.
        pub dead_bands: [[f64; 2]; MAX_AXES],
    }
}

impl GroupMachine {
    fn new(machine: &Machine) -> Self {
        let mut found = Self {
            fingerprint: machine.fingerprint(),
            hardware: machine.hardware(),
            period_ns: machine.timing.period.as_nanos() as u64,
            axis_count: machine.axes.len().min(MAX_AXES) as u64,
            ..Self::default()
        };
        for (i, axis) in machine.axes.iter().take(MAX_AXES).enumerate() {
            let name = &axis.name.as_bytes()[..axis.name.len().min(MAX_NAME)];
            found.names[i][..name.len()].copy_from_slice(name);
            found.soft_limits[i] = axis.soft_limits.into();
            found.dead_bands[i] = [axis.control.dead_band.extend, axis.control.dead_band.retract];
        }
        found
    }

    /// Names of the axes.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        (0..(self.axis_count as usize).min(MAX_AXES)).map(|axis| self.name(axis))
    }

    /// The first thing in which this machine and `other` differ, of both.
    fn difference(&self, other: &Self) -> (String, String) {
        let of_both = |told: &dyn Fn(&Self) -> String| (told(self), told(other));
        let names = of_both(&|machine| format!("axes {}", machine.names().collect::<Vec<_>>().join(", ")));
        let period = of_both(&|machine| format!("period {} ms", 1e-6 * machine.period_ns as f64));
        let limits = (0..MAX_AXES).map(|axis| {
            of_both(&|machine| {
                let [low, high] = machine.soft_limits[axis];
                format!("axis.{} with soft limits {low} to {high} m", machine.name(axis))
            })
        });
        let hardware = of_both(&|machine| format!("strokes, speeds and encoders {:016x}", machine.hardware));
        let settings = of_both(&|machine| format!("settings {:016x}", machine.fingerprint));
        let mut all = [names, period].into_iter().chain(limits).chain([hardware]);
        all.find(|(own, other)| own != other).unwrap_or(settings)
    }

    /// Name of an axis.
    pub fn name(&self, axis: usize) -> &str {
        let name = &self.names[axis];
        let length = name.iter().position(|byte| *byte == 0).unwrap_or(MAX_NAME);
        std::str::from_utf8(&name[..length]).unwrap_or("?")
    }
}

/// What is in shared memory.
#[derive(Debug, ZeroCopySend)]
#[repr(C)]
#[type_name("hydraxis.Board/3")]
pub struct Page {
    machine: GroupMachine,
    /// Stops asked for, of each axis and of all with cut-off; and those that control-proc has acted on.
    off: [AtomicU32; MAX_AXES],
    emergency: AtomicU32,
    off_done: [AtomicU32; MAX_AXES],
    emergency_done: AtomicU32,
    /// Emergency stops that a person has reset.
    emergency_reset: AtomicU32,
    /// Of the last command: flags and mode of each axis, as in its message.
    flags: [AtomicU32; MAX_AXES],
    operation: [AtomicU32; MAX_AXES],
    /// Ticks whose messages a recorder has read, in lock-step.
    recorded: AtomicU64,
}

/// Why there is no board of a group.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum BoardError {
    /// The group runs another machine.
    #[error(
        "group \"{prefix}\" runs another machine: {present}, where this program has {own}; allowed: the machine file \
         and settings that the group was started with"
    )]
    OtherMachine {
        /// The group.
        prefix: Prefix,
        /// What is different of the machine of the group.
        present: String,
        /// What is different of the machine of this program.
        own: String,
    },
    /// The group is another user's.
    #[error(
        "group \"{prefix}\" runs as user {owner}; allowed: commands of that user: type `sudo -u '#{owner}'` before \
         this one"
    )]
    Foreign {
        /// The group.
        prefix: Prefix,
        /// User that it belongs to.
        owner: u32,
    },
    /// The shared memory cannot be had.
    #[error("group \"{prefix}\": its board in shared memory cannot be used: {source:?}")]
    Library {
        /// The group.
        prefix: Prefix,
        /// What iceoryx2 said.
        source: DynamicStorageOpenOrCreateError,
    },
}

impl BoardError {
    fn of(prefix: &Prefix, source: DynamicStorageOpenOrCreateError) -> Self {
        let is_board = |path: &PathBuf| path.to_string_lossy().ends_with(BOARD);
        match memory(prefix).into_iter().find(is_board).map(|path| owned(&path)) {
            Some(Err(Foreign::Owner { owner, .. })) => Self::Foreign { prefix: prefix.clone(), owner },
            _ => Self::Library { prefix: prefix.clone(), source },
        }
    }
}

/// The board of one group.
#[derive(Debug)]
pub struct Board {
    prefix: Prefix,
    page: Reserved<Page>,
}

/// A stop that was asked for: the counters at which it has been acted on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ticket {
    off: [Option<u32>; MAX_AXES],
    emergency: Option<u32>,
}

impl Board {
    /// The board of a group that runs this machine; made if there is none.
    ///
    /// # Errors
    /// The group runs another machine, or shared memory cannot be had.
    pub fn of(prefix: &Prefix, machine: &Machine) -> Result<Self, BoardError> {
        let board = Self::open(prefix, Some(GroupMachine::new(machine)))?;
        board.expect_machine(machine)?;
        Ok(board)
    }

    /// Whether the group runs this machine, models, gains and references included.
    ///
    /// # Errors
    /// It runs another one.
    pub fn expect_machine(&self, machine: &Machine) -> Result<(), BoardError> {
        let own = GroupMachine::new(machine);
        if self.machine().fingerprint == own.fingerprint { Ok(()) } else { Err(self.other(&own)) }
    }

    /// Whether the group has the axes of this machine: models, gains and references may differ.
    ///
    /// # Errors
    /// It has others.
    pub fn expect_hardware(&self, machine: &Machine) -> Result<(), BoardError> {
        let own = GroupMachine::new(machine);
        if self.machine().hardware == own.hardware { Ok(()) } else { Err(self.other(&own)) }
    }

    fn other(&self, own: &GroupMachine) -> BoardError {
        let (present, own) = self.machine().difference(own);
        BoardError::OtherMachine { prefix: self.prefix.clone(), present, own }
    }

    /// The board of a group that runs, or none.
    ///
    /// # Errors
    /// Shared memory cannot be had.
    pub fn find(prefix: &Prefix) -> Result<Option<Self>, BoardError> {
        match Reserved::<Page>::does_exist_cfg(&name(), &config(prefix)) {
            Ok(true) => Self::open(prefix, None).map(Some),
            _ => Ok(None),
        }
    }

    fn open(prefix: &Prefix, machine: Option<GroupMachine>) -> Result<Self, BoardError> {
        let zero = || [const { AtomicU32::new(0) }; MAX_AXES];
        let opened = <Reserved<Page> as DynamicStorage<Page>>::Builder::new(&name())
            .config(&config(prefix))
            .has_ownership(false)
            .timeout(OPEN_PATIENCE)
            .initializer(|page, _| {
                let Some(machine) = machine else { return false };
                page.write(Page {
                    machine,
                    off: zero(),
                    emergency: AtomicU32::new(0),
                    off_done: zero(),
                    emergency_done: AtomicU32::new(0),
                    emergency_reset: AtomicU32::new(0),
                    flags: zero(),
                    operation: zero(),
                    recorded: AtomicU64::new(0),
                });
                true
            })
            .open_or_create();
        match opened {
            Ok(page) => Ok(Self { prefix: prefix.clone(), page }),
            Err(source) => Err(BoardError::of(prefix, source)),
        }
    }

    /// The group.
    pub fn prefix(&self) -> &Prefix {
        &self.prefix
    }

    /// The machine of the group.
    pub fn machine(&self) -> &GroupMachine {
        &self.page.get().machine
    }

    /// Flags and mode of an axis, as in the last command of the group.
    pub fn state(&self, axis: usize) -> (u32, u32) {
        let page = self.page.get();
        (page.flags[axis].load(Ordering::Acquire), page.operation[axis].load(Ordering::Acquire))
    }

    /// Tells that a recorder has read all messages of so many ticks.
    pub fn set_recorded(&self, ticks: u64) {
        self.page.get().recorded.store(ticks, Ordering::Release);
    }

    /// Number of ticks whose messages a recorder has read.
    pub fn recorded(&self) -> u64 {
        self.page.get().recorded.load(Ordering::Acquire)
    }

    /// Numbers of stops that were asked for so far: of each axis, and of all with cut-off.
    pub fn asked(&self) -> [u32; MAX_AXES + 1] {
        let page = self.page.get();
        std::array::from_fn(|i| page.off.get(i).unwrap_or(&page.emergency).load(Ordering::Acquire))
    }

    /// Asks to disarm these axes. A latched axis stays latched.
    pub fn stop(&self, axes: impl IntoIterator<Item = usize>) -> Ticket {
        let mut ticket = Ticket { off: [None; MAX_AXES], emergency: None };
        for axis in axes.into_iter().filter(|axis| *axis < MAX_AXES) {
            ticket.off[axis] = Some(raise(&self.page.get().off[axis]));
        }
        ticket
    }

    /// Asks for an emergency stop: all axes are latched, and the pilot pressure is cut off, until a person resets them.
    pub fn emergency_stop(&self) -> Ticket {
        Ticket { off: [None; MAX_AXES], emergency: Some(raise(&self.page.get().emergency)) }
    }

    /// Whether control-proc has sent the command that a stop has asked for.
    pub fn is_done(&self, ticket: &Ticket) -> bool {
        let page = self.page.get();
        let reached = |asked: Option<u32>, done: &AtomicU32| {
            asked.is_none_or(|asked| done.load(Ordering::Acquire).wrapping_sub(asked) as i32 >= 0)
        };
        ticket.off.iter().zip(&page.off_done).all(|(asked, done)| reached(*asked, done))
            && reached(ticket.emergency, &page.emergency_done)
    }
}

/// What control-proc has to stop.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Stop {
    /// Axes to disarm, bit by bit.
    pub axes: u32,
    /// Latch all axes and cut off the pilot pressure.
    pub emergency: bool,
}

impl Stop {
    /// All axes are to be disarmed.
    pub const ALL: Self = Self { axes: u32::MAX, emergency: false };

    /// Whether anything is to be stopped.
    pub fn is_any(self) -> bool {
        self != Self::default()
    }
}

/// The stops on the board as control-proc sees them.
///
/// A stop that the process before had not acted on counts for the next one, and so does an emergency stop that nobody
/// has reset.
#[derive(Debug)]
pub struct Stops {
    board: Board,
    off: [u32; MAX_AXES],
    emergency: u32,
}

impl Stops {
    /// Of the group with this board.
    pub fn new(board: Board) -> Self {
        let page = board.page.get();
        let off = std::array::from_fn(|axis| page.off_done[axis].load(Ordering::Acquire));
        let emergency = page.emergency_reset.load(Ordering::Acquire);
        Self { board, off, emergency }
    }

    /// What was asked for since the last call.
    pub fn take(&mut self) -> Stop {
        let page = self.board.page.get();
        let mut stop = Stop::default();
        for (i, (seen, asked)) in self.off.iter_mut().zip(&page.off).enumerate() {
            let asked = asked.load(Ordering::Acquire);
            stop.axes |= u32::from(*seen != asked) << i;
            *seen = asked;
        }
        let asked = page.emergency.load(Ordering::Acquire);
        stop.emergency = std::mem::replace(&mut self.emergency, asked) != asked;
        stop
    }

    /// The command that all stops taken so far ask for has been sent.
    pub fn done(&self, command: &ValveCommand) {
        let page = self.board.page.get();
        for (i, axis) in command.axes.iter().enumerate() {
            page.flags[i].store(axis.flags, Ordering::Release);
            page.operation[i].store(axis.operation, Ordering::Release);
        }
        for (seen, done) in self.off.iter().zip(&page.off_done) {
            done.store(*seen, Ordering::Release);
        }
        page.emergency_done.store(self.emergency, Ordering::Release);
    }

    /// No axis is latched by an emergency stop any more.
    pub fn reset(&self) {
        self.board.page.get().emergency_reset.store(self.emergency, Ordering::Release);
    }
}

fn raise(counter: &AtomicU32) -> u32 {
    counter.fetch_add(1, Ordering::AcqRel).wrapping_add(1)
}

fn name() -> FileName {
    FileName::new(NAME.as_bytes()).expect("a constant")
}

fn config(prefix: &Prefix) -> <Reserved<Page> as NamedConceptMgmt>::Configuration {
    let group = FileName::new(prefix.file_prefix().as_bytes()).expect("a prefix has letters, digits, - and _");
    let ending = FileName::new(ENDING.as_bytes()).expect("a constant");
    <Reserved<Page> as NamedConceptMgmt>::Configuration::default().prefix(&group).suffix(&ending)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::channel::remove_leftovers;

    struct Own(Prefix);

    impl Own {
        fn new(name: &str) -> Self {
            Self(format!("t{}-{name}", std::process::id()).parse().unwrap())
        }
    }

    impl Drop for Own {
        fn drop(&mut self) {
            std::fs::create_dir_all(self.0.folder()).unwrap();
            std::fs::write(self.0.folder().join("members"), "").unwrap();
            assert!(!remove_leftovers(&self.0).unwrap().is_empty());
            assert!(Board::find(&self.0).unwrap().is_none(), "the board is left");
        }
    }

    fn machine() -> Machine {
        Machine::load(None, &[]).unwrap()
    }

    #[test]
    fn a_stop_reaches_the_controller_once_and_is_answered() {
        let own = Own::new("board-stop");
        assert!(Board::find(&own.0).unwrap().is_none());
        let mut stops = Stops::new(Board::of(&own.0, &machine()).unwrap());
        assert_eq!(stops.take(), Stop::default());
        let client = Board::find(&own.0).unwrap().unwrap();
        let (first, second) = (client.stop([1]), client.stop([0, 1]));
        assert!(!client.is_done(&first));
        assert_eq!(client.asked()[..3], [1, 2, 0]);
        assert_eq!(stops.take(), Stop { axes: 0b11, emergency: false });
        assert_eq!(stops.take(), Stop::default());
        assert!(!client.is_done(&first));
        stops.done(&ValveCommand::default());
        assert!(client.is_done(&first) && client.is_done(&second));
        let ticket = client.emergency_stop();
        assert_eq!(client.asked()[MAX_AXES], 1);
        assert_eq!(stops.take(), Stop { axes: 0, emergency: true });
        stops.done(&ValveCommand::default());
        assert!(client.is_done(&ticket));
    }

    #[test]
    fn a_controller_that_is_started_again_takes_what_the_one_before_had_not_done() {
        let own = Own::new("board-again");
        let again = || Stops::new(Board::of(&own.0, &machine()).unwrap());
        let client = Board::of(&own.0, &machine()).unwrap();
        let mut stops = again();
        client.stop([2]);
        client.emergency_stop();
        stops.take();
        assert_eq!(again().take(), Stop { axes: 0b100, emergency: true });
        stops.done(&ValveCommand::default());
        // Only a person ends an emergency stop.
        assert_eq!(again().take(), Stop { axes: 0, emergency: true });
        stops.reset();
        assert_eq!(again().take(), Stop::default());
    }

    #[test]
    fn another_machine_is_refused_with_both_named() {
        let own = Own::new("board-other");
        let board = Board::of(&own.0, &machine()).unwrap();
        let mut other = machine();
        other.axes.swap(0, 3);
        let error = Board::of(&own.0, &other).unwrap_err().to_string();
        assert!(error.contains("axes boom, arm, telescope, bucket, where"), "{error}");
        assert!(error.contains("axes bucket, arm, telescope, boom;"), "{error}");
        // What is simulated does not matter to whom it moves.
        let mut same = machine();
        same.name = "another name".into();
        same.axes[0].plant = other.axes[1].plant.clone();
        assert!(Board::of(&own.0, &same).is_ok());
        let mut slower = machine();
        slower.axes[1].control.kp *= 0.5;
        let error = Board::of(&own.0, &slower).unwrap_err().to_string();
        assert!(error.contains("runs another machine: settings "), "{error}");
        assert!(board.expect_hardware(&slower).is_ok());
        slower.axes[1].soft_limits.0 += 0.01;
        let error = board.expect_hardware(&slower).unwrap_err().to_string();
        assert!(error.contains("axis.arm with soft limits"), "{error}");
    }

    #[test]
    fn stops_of_many_programs_at_the_same_time_are_all_counted() {
        let own = Own::new("board-many");
        let mut stops = Stops::new(Board::of(&own.0, &machine()).unwrap());
        let tickets: Vec<Ticket> = std::thread::scope(|scope| {
            let clients = (0..8).map(|axis| {
                let prefix = &own.0;
                scope.spawn(move || {
                    let board = Board::find(prefix).unwrap().unwrap();
                    (0..1000).map(|_| board.stop([axis])).last().unwrap()
                })
            });
            let clients: Vec<_> = clients.collect();
            clients.into_iter().map(|client| client.join().unwrap()).collect()
        });
        assert_eq!(stops.take().axes, 0xff);
        stops.done(&ValveCommand::default());
        let client = Board::find(&own.0).unwrap().unwrap();
        assert!(tickets.iter().all(|ticket| client.is_done(ticket)));
        assert_eq!(tickets[3].off[3], Some(1000));
    }
}
