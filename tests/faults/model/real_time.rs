//! Rows 23 and 24, in real time.

use std::time::{Duration, Instant};

use ident_proc::Identifiers;
use pipeline::{
    channel::{Group, Publisher, Reader},
    message::{
        AxisCommand, ChannelHealth, CoefficientSnapshot, ControlMode, EncoderSample, Header, Message, StageHealth,
        ValveCommand, control_flag,
    },
    stage::{StageKind, monotonic_ns},
};
use rustix::process::Signal;

use super::{identified::is_by_model, machine, set, trained_soon, training};
use crate::{
    clock::{judge, scaled},
    harness::{
        TestGroup, alone,
        channel::{AXES, send},
        running::Running,
        shared, signal, wait_for,
    },
};

/// Settings with which a busy computer latches nothing by itself.
fn patient(model: &[&str]) -> Vec<String> {
    let mut settings = trained_soon();
    settings.push("timing.feedback_timeout=5s".to_owned());
    settings.extend(model.iter().map(|setting| (*setting).to_owned()));
    settings
}

/// Axes for which a condition was seen, at the same time or not.
#[derive(Default)]
struct Each([bool; AXES]);

impl Each {
    /// Takes one more command. Returns whether the condition was seen of all axes.
    fn take(&mut self, command: &ValveCommand, is_it: impl Fn(&AxisCommand) -> bool) -> bool {
        self.0.iter_mut().zip(&command.axes).for_each(|(seen, axis)| *seen |= is_it(axis));
        self.0 == [true; AXES]
    }
}

/// Whether the axis follows by a model that is not old.
fn is_fine(axis: &AxisCommand) -> bool {
    is_by_model(axis) && axis.flags & (control_flag::MODEL_STALE | control_flag::HALF_SPEED) == 0
}

/// The longest gap between two commands that a reader has seen.
#[derive(Default)]
struct Gap {
    last: Option<u64>,
    longest: u64,
}

impl Gap {
    fn take(&mut self, header: &Header) {
        let gap = self.last.replace(header.sequence).map_or(0, |last| header.sequence.saturating_sub(last + 1));
        self.longest = self.longest.max(gap);
    }
}

/// Starts a group and waits until every axis has followed by its model. A computer that stood still for long enough
/// to latch an axis meanwhile gets another try. Returns the group, its channels, and the gaps until then.
fn start_by_model(settings: &[String]) -> (Running, Group, Reader<ValveCommand>, Gap) {
    for _ in 0..3 {
        let mut running = Running::start_with("row-23", &[&["--duration", "60s"], &set(settings)[..]].concat());
        let channels = running.group.join();
        let mut commands: Reader<ValveCommand> = channels.reader().unwrap();
        let (mut fine, mut gap) = (Each::default(), Gap::default());
        let follow = wait_for("models", || {
            let command = commands.read().unwrap().if_new()?;
            gap.take(&command.header);
            let latched = command.axes[..AXES].iter().any(|axis| axis.flags & control_flag::LATCHED != 0);
            if latched { Some(false) } else { fine.take(command, is_fine).then_some(true) }
        });
        if follow {
            return (running, channels, commands, gap);
        }
        eprintln!("row 23: an axis has latched before the fault, with a gap of {} commands", gap.longest);
        drop((commands, channels));
        running.interrupt();
    }
    panic!("in three groups an axis has latched before the fault");
}

/// Row 23: after `ident-proc` is killed, the axes go on with the last model, later at half speed.
#[test]
fn row_23_a_killed_identifier_stops_no_axis() {
    let _cores = shared();
    let (timeout, lifetime) = (Duration::from_millis(500), Duration::from_millis(1500));
    let mut settings = patient(&["timing.model_timeout=500ms", "timing.model_lifetime=1500ms"]);
    // The second identifier is trained at half speed: in 3 s a slow axis does not excite all columns.
    settings.extend(training("8s"));
    let (mut running, channels, mut commands, before) = start_by_model(&settings);
    let mut health = channels.reader().unwrap();
    let all = |command: &ValveCommand, is: &dyn Fn(&AxisCommand) -> bool| command.axes[..AXES].iter().all(is);
    // Gaps before the fault come from the computer.
    let mut after = Gap { longest: 0, ..before };
    signal(running.pid(StageKind::IdentProc), Signal::KILL);
    let killed = Instant::now();
    let (mut stale, mut slow, mut slow_ticks) = (None, None, 0);
    let mut fine = Each::default();
    wait_for("the next life's model", || {
        let command = commands.read().unwrap().if_new()?;
        after.take(&command.header);
        let at = killed.elapsed();
        for axis in &command.axes[..AXES] {
            // Only where the computer has kept sensor-proc from its core for that long.
            let is_silent = command.header.sent_ns.saturating_sub(command.header.acquired_ns) > 60_000_000;
            assert!(axis.mode != ControlMode::Neutral as u32 || is_silent, "after {at:?}: {:#x}", axis.flags);
            assert_eq!(axis.flags & control_flag::LATCHED, 0, "after {at:?}");
        }
        if all(command, &|axis| axis.flags & control_flag::MODEL_STALE != 0) {
            stale.get_or_insert(at);
        }
        if all(command, &|axis| axis.flags & control_flag::HALF_SPEED != 0) {
            slow.get_or_insert(at);
            slow_ticks += 1;
            // Half of the range from the smallest dead band to the limit, after 20 ticks for the way to it.
            assert!(slow_ticks < 20 || all(command, &|axis| axis.command.abs() < 0.55));
        }
        // Only models of the new ident-proc: those of the killed one are stale by then.
        (slow.is_some() && fine.take(command, is_fine)).then_some(())
    });
    let (stale, slow) = (stale.unwrap(), slow.unwrap());
    assert!(stale > timeout / 2 && slow > lifetime / 2 + timeout / 2, "{stale:?} {slow:?}");
    judge("row 23", "stale after", stale, timeout);
    judge("row 23", "at half speed after", slow, lifetime);
    let gaps = [before.longest, after.longest];
    eprintln!("row 23: {} ticks in a row without a command before, {} after", gaps[0], gaps[1]);
    let lost = Duration::from_millis(10) * gaps[1] as u32;
    assert!(lost <= scaled(Duration::from_millis(10) * gaps[0] as u32), "{gaps:?}");
    running.await_next(StageKind::IdentProc, &mut health);
    drop((commands, health, channels));
    running.interrupt();
}

/// All stages but ident-proc, whose core runs in the test, and a reader of what the controller does.
struct Flood {
    samples: Reader<EncoderSample>,
    /// Commands for the identifier.
    commands: Reader<ValveCommand>,
    /// Commands for the assertions.
    seen: Reader<ValveCommand>,
    health: Reader<StageHealth>,
    snapshots: Publisher<CoefficientSnapshot>,
    core: Identifiers,
    snapshot: CoefficientSnapshot,
    // Dropped last, since it removes what is left of the group.
    _channels: Group,
    _group: TestGroup,
}

/// Figures of the controller over a time with or without a flood.
#[derive(Clone, Copy)]
struct Figures {
    health: StageHealth,
    channel: ChannelHealth,
    /// Snapshots that were sent beyond one for each sample.
    more: u64,
}

impl Flood {
    fn start() -> Self {
        let settings = patient(&[]);
        let mut group = TestGroup::new("row-24");
        let channels = group.join();
        let (samples, commands) = (channels.reader().unwrap(), channels.reader().unwrap());
        let (seen, health) = (channels.reader().unwrap(), channels.reader().unwrap());
        let snapshots = channels.publisher().unwrap();
        group.start_all_but(StageKind::IdentProc, &[&["--arm"], &set(&settings)[..]].concat());
        Self {
            samples,
            commands,
            seen,
            health,
            snapshots,
            core: Identifiers::new(&machine(&settings)),
            snapshot: CoefficientSnapshot::default(),
            _channels: channels,
            _group: group,
        }
    }

    /// Sends one snapshot for every sample, and with `flood` one more at every call. Returns how many more.
    fn identify(&mut self, flood: bool) -> u64 {
        while let Some(sample) = self.samples.read().unwrap().if_new() {
            self.commands.reach(sample.header.sequence.saturating_sub(1)).unwrap();
            self.core.update(sample, self.commands.last(), &mut self.snapshot);
            send(&self.snapshots, self.snapshot, sample.header.sequence);
        }
        if let (true, Some(sample)) = (flood, self.samples.last()) {
            send(&self.snapshots, self.snapshot, sample.header.sequence);
        }
        u64::from(flood)
    }

    /// Waits until models control all axes. Returns the pid of the controller.
    fn await_models(&mut self) -> u32 {
        let mut fine = Each::default();
        wait_for("models", || {
            self.identify(false);
            let command: &ValveCommand = self.seen.read().unwrap().if_new()?;
            fine.take(command, is_by_model).then_some(())
        });
        wait_for("control-proc", || {
            self.identify(false);
            let health: &StageHealth = self.health.read().unwrap().if_new()?;
            (health.stage == StageKind::ControlProc as u32).then_some(health.pid)
        })
    }

    /// Resets the counters of the controller, and measures it over 150 ticks or more. No axis may latch or stop
    /// meanwhile.
    fn measure(&mut self, controller: u32, flood: bool) -> Figures {
        let since = monotonic_ns();
        signal(controller, Signal::USR1);
        let (mut more, mut ticks, mut last) = (0, 0, self.seen.last().map(|command| command.header.sequence));
        let health = wait_for("150 ticks", || {
            // One call per millisecond.
            let until = monotonic_ns() + 1_000_000;
            more += self.identify(flood);
            while let Some(command) = self.seen.read().unwrap().if_new() {
                ticks += 1;
                let sequence = command.header.sequence;
                assert!(last.is_none_or(|last| sequence > last), "one command for each sample: {sequence}, {last:?}");
                last = Some(sequence);
                for axis in &command.axes[..AXES] {
                    assert_eq!(axis.flags & (control_flag::LATCHED | control_flag::MODEL_STALE), 0);
                    assert_ne!(axis.mode, ControlMode::Neutral as u32);
                }
            }
            while monotonic_ns() < until {
                std::thread::sleep(Duration::from_micros(100));
            }
            let health: StageHealth = *self.health.read().unwrap().if_new()?;
            let is_it = health.stage == StageKind::ControlProc as u32 && health.since_ns >= since;
            (is_it && health.work.count >= 150 && health.wait.count >= 150).then_some(health)
        });
        let channel = health.channels().iter().find(|c| c.name() == CoefficientSnapshot::CHANNEL).copied().unwrap();
        eprintln!(
            "row 24: flood {flood}: {more} more for {ticks} commands, {} read, {} lost; p99 work {:.1?} wait {:.1?}",
            channel.received,
            channel.lost,
            Duration::from_nanos(health.work.p99),
            Duration::from_nanos(health.wait.p99)
        );
        Figures { health, channel, more }
    }
}

/// Row 24: a flood of snapshots does not delay the controller.
#[test]
fn row_24_a_flood_of_snapshots_delays_no_command() {
    let _cores = alone();
    let mut flood = Flood::start();
    let controller = flood.await_models();
    let calm = flood.measure(controller, false).health;
    let Figures { health: flooded, channel, more } = flood.measure(controller, true);
    assert!(more > 3 * flooded.samples, "a flood: {more} for {}", flooded.samples);
    // Snapshots on the way are neither read nor lost yet.
    let accounted = channel.received + channel.lost;
    assert!(accounted + 500 >= more && channel.received > flooded.samples, "{accounted} of {more}");
    // The median says more than the tail, which depends on the load of the computer.
    assert!(flooded.work.p50 <= 10 * calm.work.p50, "{} ns for {} ns", flooded.work.p50, calm.work.p50);
    judge("row 24", "work, p99", Duration::from_nanos(flooded.work.p99), Duration::from_nanos(calm.work.p99));
    judge("row 24", "wait, p99", Duration::from_nanos(flooded.wait.p99), Duration::from_nanos(calm.wait.p99));
}
