//! The stages and how each of them runs: `[stage.NAME]` and `[realtime]`.

use std::time::Duration;

use super::document::Section;

/// How long `spin-then-event` polls by default: twice the work of one stage.
const DEFAULT_SPIN: Duration = Duration::from_micros(200);
/// Longest time that `spin-then-event` may poll: a longer one is better a `spin`.
const LONGEST_SPIN: Duration = Duration::from_millis(10);

/// The four stages, in the order of the data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StageKind {
    /// Simulation of the machine.
    PlantSim = 0,
    /// Acquisition of the encoders.
    SensorProc = 1,
    /// Identification.
    IdentProc = 2,
    /// Control.
    ControlProc = 3,
}

impl StageKind {
    /// All stages, in the order of the data.
    pub const ALL: [Self; 4] = [Self::PlantSim, Self::SensorProc, Self::IdentProc, Self::ControlProc];

    /// Name of the stage, which is also its subcommand.
    pub const fn name(self) -> &'static str {
        ["plant-sim", "sensor-proc", "ident-proc", "control-proc"][self as usize]
    }
}

/// Rights of real time, and what happens when one that is asked for cannot be had.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Realtime {
    /// For the `core` of a stage.
    pub affinity: Rights,
    /// For the `priority` of a stage, and for `wakeup_latency`.
    pub scheduling: Rights,
    /// For locked memory.
    pub memory: Rights,
    /// Whether the stages lock their memory.
    pub lock_memory: bool,
    /// Longest time that a core may take to wake up from an idle state; without it the kernel decides.
    pub wakeup_latency: Option<Duration>,
}

/// What happens when a right cannot be had.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rights {
    /// Warn and go on.
    Warn,
    /// Do not start.
    Strict,
}

/// How one stage runs.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct StageSettings {
    /// Core that the stage stays on.
    pub core: Option<usize>,
    /// SCHED_FIFO priority, 1 to 99; without it the ordinary scheduler.
    pub priority: Option<u8>,
    /// How the stage waits for its input in real time.
    pub wait: Wait,
    /// Another program that runs in the stage's place.
    pub command: Option<Vec<String>>,
    /// What `hydraxis run` does in real time when the stage ends before its time.
    pub restart: Restart,
}

/// What happens to a stage that has ended before its time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Restart {
    /// The run ends.
    #[default]
    Never,
    /// The stage is started again, within bounds.
    OnFailure,
}

/// How a stage waits for its input, or for its timer, in real time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Wait {
    /// Sleeps until the notification of the publisher, or until the time of the timer: for shared cores.
    #[default]
    Event,
    /// Polls without a pause: for a core that no other stage uses.
    Spin,
    /// Polls for this long and then sleeps until the notification: for inputs that come close together. For a timer the
    /// stage first sleeps, and polls for this long before the time.
    SpinThenEvent(Duration),
}

impl Realtime {
    pub(super) fn read(mut section: Section) -> Self {
        let choices = [("warn", Rights::Warn), ("strict", Rights::Strict)];
        let all = section
            .key("rights", "What happens when a right cannot be had: warn and go on, or do not start")
            .choice_or(Rights::Warn, &choices);
        let mut one = |name, meaning| section.key(name, meaning).rule("rights").choice_or(all, &choices);
        let affinity = one("affinity", "What happens when a stage cannot have its core");
        let scheduling = one("scheduling", "What happens when a stage cannot have its priority or wakeup_latency");
        let memory = one("memory", "What happens when a stage cannot lock its memory");
        let realtime = Self {
            affinity,
            scheduling,
            memory,
            lock_memory: section
                .key("lock_memory", "Whether the stages lock their memory, so that no page is swapped out")
                .flag_or(false),
            wakeup_latency: section
                .key(
                    "wakeup_latency",
                    "Longest time that a core may take to wake up from an idle state, by /dev/cpu_dma_latency; \
                     without it the kernel decides",
                )
                .optional_duration(Duration::ZERO..=Duration::from_millis(100)),
        };
        section.finish();
        realtime
    }
}

/// The program of the key `command`, with its arguments; an empty list is refused.
pub(super) fn program(section: &mut Section, meaning: &'static str, allowed: &str) -> Option<Vec<String>> {
    let words = section.key("command", meaning).optional_texts(allowed);
    if words.as_ref().is_some_and(Vec::is_empty) {
        section.refuse("command", "an empty list", allowed);
    }
    words
}

impl StageSettings {
    /// `is_real`: a real machine stands in the place of plant-sim; `has_program`: its program is that of the source.
    pub(super) fn read(mut section: Section, kind: StageKind, is_real: bool, has_program: bool) -> Self {
        let is_rig = is_real && kind == StageKind::PlantSim;
        // A simulated machine that starts again would jump to its initial position.
        let restart = if kind == StageKind::PlantSim && !is_rig { Restart::Never } else { Restart::OnFailure };
        let command = program(
            &mut section,
            "Another program that runs in the stage's place, with its arguments",
            "a program and its arguments, such as [\"python3\", \"my_plant.py\"]",
        );
        if is_rig && has_program && command.is_some() {
            section.refuse("command", "a program", "source.command, with source.kind = \"external\"");
        }
        let spin = section
            .key("spin", "How long wait = \"spin-then-event\" polls before it sleeps; 200us without this key")
            .optional_duration(Duration::from_micros(1)..=LONGEST_SPIN);
        let choices = [
            ("event", Wait::Event),
            ("spin", Wait::Spin),
            ("spin-then-event", Wait::SpinThenEvent(spin.unwrap_or(DEFAULT_SPIN))),
        ];
        let wait = section
            .key("wait", "How the stage waits in real time: sleeping, polling, or polling first and then sleeping")
            .choice_or(Wait::Event, &choices);
        if spin.is_some() && !matches!(wait, Wait::SpinThenEvent(_)) {
            section.refuse("spin", "a time without its way of waiting", "with wait = \"spin-then-event\"");
        }
        let settings = Self {
            core: section.key("core", "Core that the stage stays on").optional_integer(0..=1023),
            priority: section
                .key("priority", "SCHED_FIFO priority of the stage; without it the ordinary scheduler")
                .optional_integer(1..=99)
                .map(|priority| priority as u8),
            wait,
            command,
            restart: section
                .key(
                    "restart",
                    "What happens when the stage ends before its time: it is started again, or the run ends",
                )
                .rule("\"on-failure\"; \"never\" for a simulated machine")
                .choice_or(restart, &[("on-failure", Restart::OnFailure), ("never", Restart::Never)]),
        };
        section.finish();
        settings
    }
}
