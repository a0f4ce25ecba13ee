//! Rows 11 to 15: faults of the controller.
//!
//! Rows 14 and 15 are a solver without a plan, and a command outside of the plan's limits. They cannot be injected from
//! outside, so their tests are in `control-proc`.

use std::time::Duration;

use pipeline::{
    channel::{Publisher, Reader},
    message::{AxisMode, EncoderSample, ValveCommand, control_flag},
    stage::{StageKind, monotonic_ns},
};
use rustix::process::Signal;

use crate::{
    clock::judge,
    feedback::Moving,
    harness::{TestGroup, channel::AXES, shared, signal, wait_for},
    script::{from_channel, is_latched},
};

/// Row 11: after `control-proc` is killed in motion, the drive stops the axis by its own time-out.
#[test]
fn row_11_the_drive_goes_neutral_by_itself_when_the_controller_is_killed() {
    let mut moving = Moving::start("row-11", &["--set", "stage.control-proc.restart=on-failure"]);
    let killed = monotonic_ns();
    signal(moving.running.pid(StageKind::ControlProc), Signal::KILL);
    let still = moving.last_motion(0);
    // The drive's time-out, five time constants of the valve, and its dead time.
    let bound = Duration::from_millis(50 + 250 + 20);
    judge("row 11", "kill to standstill", Duration::from_nanos(still.saturating_sub(killed)), bound);
}

/// Row 12: a controller that was started again is disarmed and commands neutral.
#[test]
fn row_12_a_restarted_controller_is_disarmed_and_commands_neutral() {
    let mut moving = Moving::start("row-12", &[]);
    let killed = monotonic_ns();
    signal(moving.running.pid(StageKind::ControlProc), Signal::KILL);
    moving.running.await_next(StageKind::ControlProc, &mut moving.health);
    let mut seen = 0;
    moving.await_command("a hundred commands of the new one", |command| {
        if command.header.sent_ns < killed {
            return false;
        }
        // The killed controller may have sent a last command after the clock was read.
        let is_new = command.header.number < 1000 && command.axes[0].flags & control_flag::DISARMED != 0;
        seen += u64::from(is_new);
        assert!(seen == 0 || is_new);
        for axis in command.axes[..AXES].iter().filter(|_| is_new) {
            assert_eq!(axis.command, 0.0, "{:#b}", axis.flags);
        }
        seen >= 100
    });
}

/// A controller in real time with a period of 100 ms. The test plays the acquisition.
struct Slow {
    group: TestGroup,
    samples: Publisher<EncoderSample>,
    commands: Reader<ValveCommand>,
    sequence: u64,
}

impl Slow {
    fn start(test: &str) -> Self {
        let mut group = TestGroup::new(test);
        let channels = group.join();
        let (samples, commands) = (channels.publisher().unwrap(), channels.reader().unwrap());
        let settings = ["timing.period=100ms", "timing.feedback_timeout=300ms"];
        let settings: Vec<&str> = settings.iter().flat_map(|setting| ["--set", *setting]).collect();
        // Without references the axes hold, so that constant positions are no fault.
        let held = from_channel();
        let held: Vec<&str> = held.iter().map(String::as_str).collect();
        group.start(StageKind::ControlProc, &[&["--arm"], &settings[..], &held].concat());
        let mut slow = Self { group, samples, commands, sequence: 0 };
        // The first commands come when the controller has started, and it settles for two ticks.
        let mut answered = 0;
        wait_for("a controller that follows", || {
            let follows = |command: ValveCommand| {
                command.axes[0].operation == AxisMode::Track as u32
                    && command.axes[0].flags & (control_flag::DISARMED | control_flag::SETTLING) == 0
            };
            answered = if slow.sample(0).is_some_and(follows) { answered + 1 } else { 0 };
            (answered > 2).then_some(())
        });
        slow
    }

    /// Sends a sample of this age, ms. Returns the command for it, if one comes within 60 ms.
    fn sample(&mut self, age: u64) -> Option<ValveCommand> {
        let now = monotonic_ns();
        let mut sample = EncoderSample::default();
        self.sequence += 1;
        sample.header.sequence = self.sequence;
        sample.header.axis_count = AXES as u32;
        (sample.header.acquired_ns, sample.header.sent_ns) = (now - age * 1_000_000, now);
        let positions = [0.65, 0.75, 0.6, 0.55];
        sample.axes.iter_mut().zip(positions).for_each(|(axis, position)| axis.position = position);
        self.samples.send(&sample).unwrap();
        let until = monotonic_ns() + 60_000_000;
        while monotonic_ns() < until {
            // Commands for earlier samples are skipped.
            if self.commands.reach(self.sequence).unwrap() {
                return self.commands.last().copied();
            }
            std::thread::sleep(Duration::from_micros(200));
        }
        None
    }
}

/// Row 13: three late commands in a row latch, two do not.
#[test]
fn row_13_three_late_commands_in_a_row_latch_and_two_do_not() {
    let _cores = shared();
    let mut slow = Slow::start("row-13");
    let is_latched_now = |command: Option<ValveCommand>| {
        command.is_some_and(|command| command.axes[..AXES].iter().all(|axis| is_latched(axis, control_flag::DEADLINE)))
    };
    // 150 ms are a period and a half: late. 50 ms are half a period: in time.
    for age in [150, 150, 50, 150, 150, 50] {
        assert!(!is_latched_now(slow.sample(age)), "{age} ms");
    }
    assert!(!is_latched_now(slow.sample(150)));
    assert!(!is_latched_now(slow.sample(150)));
    assert!(is_latched_now(slow.sample(150)), "the third in a row");
    for _ in 0..5 {
        assert!(is_latched_now(slow.sample(0)), "and it stays so");
    }
    drop(slow.group);
}
