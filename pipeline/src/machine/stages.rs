//! The stages and how each of them runs: `[stage.NAME]` and `[realtime]`.

use std::time::Duration;

use super::document::Section;

/// How long `spin-then-event` polls where the machine file does not say: twice what one stage takes.
const DEFAULT_SPIN: Duration = Duration::from_micros(200);
/// Beyond this a spin is no short one any more.
const LONGEST_SPIN: Duration = Duration::from_millis(10);

/// The four stages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StageKind {
    /// The simulated machine.
    PlantSim = 0,
    /// Encoder acquisition.
    SensorProc = 1,
    /// Identification.
    IdentProc = 2,
    /// Control.
    ControlProc = 3,
}

impl StageKind {
    /// All of them, in the order of the data.
    pub const ALL: [Self; 4] = [Self::PlantSim, Self::SensorProc, Self::IdentProc, Self::ControlProc];

    /// Its name, which is also its subcommand.
    pub const fn name(self) -> &'static str {
        ["plant-sim", "sensor-proc", "ident-proc", "control-proc"][self as usize]
    }
}

/// Scheduling rights: what happens when one that is asked for is not to be had.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Realtime {
    /// A stage's `core`.
    pub affinity: Rights,
    /// A stage's `priority`.
    pub scheduling: Rights,
    /// Locked memory.
    pub memory: Rights,
    /// Whether the memory of the stages is to be locked.
    pub lock_memory: bool,
    /// The longest that a core may take to wake from an idle state; without it as the kernel likes.
    pub wakeup_latency: Option<Duration>,
}

/// What happens when a right is not to be had.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rights {
    /// Say so and go on.
    Warn,
    /// Do not start.
    Strict,
}

/// How one stage runs.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct StageSettings {
    /// Core to stay on.
    pub core: Option<usize>,
    /// SCHED_FIFO priority, 1 to 99; the ordinary scheduler without one.
    pub priority: Option<u8>,
    /// How it waits for its input in real time.
    pub wait: Wait,
    /// Another program in its place.
    pub command: Option<Vec<String>>,
    /// What `hydraxis run` does when it ends before its time, in real time.
    pub restart: Restart,
}

/// What becomes of a stage that has ended before its time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Restart {
    /// It ends the run.
    #[default]
    Never,
    /// It is started again, within bounds.
    OnFailure,
}

/// How a stage waits for its input, or for its timer, in real time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Wait {
    /// Sleeps until the sender's event, or until its time: for cores that are shared.
    #[default]
    Event,
    /// Polls without a pause: for a core of its own.
    Spin,
    /// Polls for this long, and then sleeps until the event: for inputs that come close together. A timer is slept for
    /// first, and polled for the last bit.
    SpinThenEvent(Duration),
}

impl Realtime {
    pub(super) fn read(mut section: Section) -> Self {
        let choices = [("warn", Rights::Warn), ("strict", Rights::Strict)];
        let all = section.choice_or("rights", Rights::Warn, &choices);
        let realtime = Self {
            affinity: section.choice_or("affinity", all, &choices),
            scheduling: section.choice_or("scheduling", all, &choices),
            memory: section.choice_or("memory", all, &choices),
            lock_memory: section.flag_or("lock_memory", false),
            wakeup_latency: section.optional_duration("wakeup_latency", Duration::ZERO..=Duration::from_millis(100)),
        };
        section.finish();
        realtime
    }
}

impl StageSettings {
    pub(super) fn read(mut section: Section, kind: StageKind) -> Self {
        // A simulated machine that began anew would jump.
        let restart = if kind == StageKind::PlantSim { Restart::Never } else { Restart::OnFailure };
        let command =
            section.optional_texts("command", "a program and its arguments, such as [\"python3\", \"my_plant.py\"]");
        if command.as_ref().is_some_and(Vec::is_empty) {
            section.refuse("command", "an empty list", "a program and its arguments");
        }
        let spin = section.optional_duration("spin", Duration::from_micros(1)..=LONGEST_SPIN);
        let choices = [
            ("event", Wait::Event),
            ("spin", Wait::Spin),
            ("spin-then-event", Wait::SpinThenEvent(spin.unwrap_or(DEFAULT_SPIN))),
        ];
        let wait = section.choice_or("wait", Wait::Event, &choices);
        if spin.is_some() && !matches!(wait, Wait::SpinThenEvent(_)) {
            section.refuse("spin", "a time without its way of waiting", "with wait = \"spin-then-event\"");
        }
        let settings = Self {
            core: section.optional_integer("core", 0..=1023),
            priority: section.optional_integer("priority", 1..=99).map(|priority| priority as u8),
            wait,
            command,
            restart: section.choice_or(
                "restart",
                restart,
                &[("on-failure", Restart::OnFailure), ("never", Restart::Never)],
            ),
        };
        section.finish();
        settings
    }
}
