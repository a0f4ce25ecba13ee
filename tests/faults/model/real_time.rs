//! Rows 23 and 24, by the clock.

use std::time::{Duration, Instant};

use ident_proc::Identifiers;
use pipeline::{
    message::{
        AxisCommand, CoefficientSnapshot, ControlMode, EncoderSample, Header, Message, StageHealth, ValveCommand,
        control_flag,
    },
    stage::{StageKind, monotonic_ns},
};
use rustix::process::Signal;

use super::{identified::is_by_model, machine, set, trained_soon};
use crate::{
    clock::{judge, scaled},
    harness::{
        TestGroup, alone,
        channel::{AXES, send},
        running::Running,
        signal, wait_for,
    },
};

/// Settings with which a busy machine latches nothing by itself.
fn patient(model: &[&str]) -> Vec<String> {
    let mut settings = trained_soon();
    settings.push("timing.feedback_timeout=5s".to_owned());
    settings.extend(model.iter().map(|setting| (*setting).to_owned()));
    settings
}

/// The axes of which something has been seen, be it at different times.
#[derive(Default)]
struct Each([bool; AXES]);

impl Each {
    /// Looks at one more command; whether it has been seen of all.
    fn take(&mut self, command: &ValveCommand, is_it: impl Fn(&AxisCommand) -> bool) -> bool {
        self.0.iter_mut().zip(&command.axes).for_each(|(seen, axis)| *seen |= is_it(axis));
        self.0 == [true; AXES]
    }
}

#[test]
fn row_23_a_killed_identifier_stops_nobody() {
    let _alone = alone();
    let (timeout, lifetime) = (Duration::from_millis(500), Duration::from_millis(1500));
    let settings = patient(&["timing.model_timeout=500ms", "timing.model_lifetime=1500ms"]);
    let mut running = Running::start_with("row-23", &[&["--duration", "60s"], &set(&settings)[..]].concat());
    let channels = running.group.join();
    let (mut commands, mut health) = (channels.reader::<ValveCommand>().unwrap(), channels.reader().unwrap());
    let is_fine = |axis: &AxisCommand| {
        is_by_model(axis) && axis.flags & (control_flag::MODEL_STALE | control_flag::HALF_SPEED) == 0
    };
    let all = |command: &ValveCommand, is: &dyn Fn(&AxisCommand) -> bool| command.axes[..AXES].iter().all(is);
    // Gaps before the fault are the machine's own.
    let (mut last, mut gaps) = (None, [0u64; 2]);
    let mut count = |header: &Header, place: usize| {
        let gap = last.replace(header.sequence).map_or(0, |last: u64| header.sequence.saturating_sub(last + 1));
        gaps[place] = gaps[place].max(gap);
    };
    let mut fine = Each::default();
    wait_for("models", || {
        let command = commands.read().unwrap().if_new()?;
        count(&command.header, 0);
        fine.take(command, is_fine).then_some(())
    });
    signal(running.pid(StageKind::IdentProc), Signal::KILL);
    let killed = Instant::now();
    let (mut stale, mut slow, mut slow_ticks) = (None, None, 0);
    let mut fine = Each::default();
    wait_for("the next life's model", || {
        let command = commands.read().unwrap().if_new()?;
        count(&command.header, 1);
        let at = killed.elapsed();
        for axis in &command.axes[..AXES] {
            assert_ne!(axis.mode, ControlMode::Neutral as u32, "after {at:?}: {:#x}", axis.flags);
            assert_eq!(axis.flags & control_flag::LATCHED, 0, "after {at:?}");
        }
        if all(command, &|axis| axis.flags & control_flag::MODEL_STALE != 0) {
            stale.get_or_insert(at);
        }
        if all(command, &|axis| axis.flags & control_flag::HALF_SPEED != 0) {
            slow.get_or_insert(at);
            slow_ticks += 1;
            // Half of the way from the smallest dead band to the limit, once the command has come down to it.
            assert!(slow_ticks < 20 || all(command, &|axis| axis.command.abs() < 0.55));
        }
        // Only of the next life: the last model of the one before is stale by then.
        (slow.is_some() && fine.take(command, is_fine)).then_some(())
    });
    let (stale, slow) = (stale.unwrap(), slow.unwrap());
    assert!(stale > timeout / 2 && slow > lifetime / 2 + timeout / 2, "{stale:?} {slow:?}");
    judge("row 23", "stale after", stale, timeout);
    judge("row 23", "at half speed after", slow, lifetime);
    eprintln!("row 23: {} ticks in a row without a command before, {} after", gaps[0], gaps[1]);
    let lost = Duration::from_millis(10) * gaps[1] as u32;
    assert!(lost <= scaled(Duration::from_millis(10) * gaps[0] as u32), "{gaps:?}");
    running.await_next(StageKind::IdentProc, &mut health);
    drop((commands, health, channels));
    running.interrupt();
}

#[test]
fn row_24_a_flood_of_snapshots_delays_nobody() {
    let _alone = alone();
    let settings = patient(&[]);
    let machine = machine(&settings);
    let mut group = TestGroup::new("row-24");
    let channels = group.join();
    let (mut samples, mut commands) = (channels.reader::<EncoderSample>().unwrap(), channels.reader().unwrap());
    let (mut seen, mut health) = (channels.reader::<ValveCommand>().unwrap(), channels.reader().unwrap());
    let snapshots = channels.publisher::<CoefficientSnapshot>().unwrap();
    group.start_all_but(StageKind::IdentProc, &[&["--arm"], &set(&settings)[..]].concat());
    let mut core = Identifiers::new(&machine);
    let mut snapshot = CoefficientSnapshot::default();
    // One snapshot for every sample, and between them as many again as `flood` asks for.
    let mut identify = |flood: bool| {
        while let Some(sample) = samples.read().unwrap().if_new() {
            commands.reach(sample.header.sequence.saturating_sub(1)).unwrap();
            core.update(sample, commands.last(), &mut snapshot);
            send(&snapshots, snapshot, sample.header.sequence);
        }
        if let (true, Some(sample)) = (flood, samples.last()) {
            send(&snapshots, snapshot, sample.header.sequence);
        }
        u64::from(flood)
    };
    let mut fine = Each::default();
    wait_for("models", || {
        identify(false);
        let command: &ValveCommand = seen.read().unwrap().if_new()?;
        fine.take(command, is_by_model).then_some(())
    });
    let mut pid = 0;
    wait_for("control-proc", || {
        identify(false);
        let health: &StageHealth = health.read().unwrap().if_new()?;
        pid = health.pid;
        (health.stage == StageKind::ControlProc as u32).then_some(())
    });
    let mut figures = Vec::new();
    for flood in [false, true] {
        let since = monotonic_ns();
        signal(pid, Signal::USR1);
        let (mut sent, mut ticks, mut last) = (0, 0, seen.last().map(|command| command.header.sequence));
        let figure = wait_for("a second", || {
            // The wait itself is of a fraction of a millisecond; a millisecond is between two of these.
            let until = monotonic_ns() + 1_000_000;
            sent += identify(flood);
            while let Some(command) = seen.read().unwrap().if_new() {
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
            let health: StageHealth = *health.read().unwrap().if_new()?;
            let is_it = health.stage == StageKind::ControlProc as u32 && health.since_ns >= since;
            (is_it && health.work.count >= 150 && health.wait.count >= 150).then_some(health)
        });
        let channel = figure.channels().iter().find(|c| c.name() == CoefficientSnapshot::CHANNEL).copied().unwrap();
        eprintln!(
            "row 24: flood {flood}: {sent} more for {ticks} commands, {} read, {} lost; p99 work {:.1?} wait {:.1?}",
            channel.received,
            channel.lost,
            Duration::from_nanos(figure.work.p99),
            Duration::from_nanos(figure.wait.p99)
        );
        figures.push((figure, channel, sent));
    }
    let ((calm, ..), (flooded, channel, sent)) = (figures[0], figures[1]);
    assert!(sent > 3 * flooded.samples, "a flood: {sent} for {}", flooded.samples);
    // What is on the way is neither read nor lost yet.
    let accounted = channel.received + channel.lost;
    assert!(accounted + 500 >= sent && channel.received > flooded.samples, "{accounted} of {sent}");
    // The middle says more than the tail, of which a busy machine makes what it likes.
    assert!(flooded.work.p50 <= 10 * calm.work.p50, "{} ns for {} ns", flooded.work.p50, calm.work.p50);
    judge("row 24", "work, p99", Duration::from_nanos(flooded.work.p99), Duration::from_nanos(calm.work.p99));
    judge("row 24", "wait, p99", Duration::from_nanos(flooded.wait.p99), Duration::from_nanos(calm.wait.p99));
}
