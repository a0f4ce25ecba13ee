//! Samples that are missing or unusable.

use std::time::Duration;

use pipeline::message::{AxisMode, ControlMode, EncoderSample, Reference, Request, control_flag, sample_fault};
use proptest::prelude::*;

use super::{Loop, machine, models::actuator, sample, snapshot};
use crate::Controller;

/// A loop that has followed with the model for 3 s.
fn moving() -> Loop {
    let mut axis = Loop::new(&machine(1), 0.0);
    axis.run(300, Some(actuator()));
    axis
}

fn fault(bits: u32) -> impl Fn(&mut EncoderSample) {
    move |sample| sample.axes[0].faults = bits
}

/// Whether the axis stays neutral and latched over 100 healthy ticks after another `arm`.
fn stays_latched(axis: &mut Loop) -> bool {
    axis.controller.arm();
    axis.run(100, Some(actuator())).iter().all(|command| {
        let axis = command.axes[0];
        axis.command == 0.0 && axis.mode == ControlMode::Neutral as u32 && axis.flags & control_flag::FEEDBACK != 0
    })
}

#[test]
fn two_unusable_samples_are_bridged_and_the_third_latches() {
    for bit in [sample_fault::SPEED, sample_fault::ENCODER, sample_fault::STALE] {
        let mut axis = moving();
        let before = axis.tick(None).axes[0].command;
        for _ in 0..2 {
            assert_eq!(axis.tick_with(None, None, fault(bit)).axes[0].command, before);
        }
        assert_eq!(axis.tick(None).axes[0].flags & control_flag::FEEDBACK, 0);
        for _ in 0..2 {
            assert_eq!(axis.tick_with(None, None, fault(bit)).axes[0].flags & control_flag::FEEDBACK, 0);
        }
        assert_eq!(axis.tick_with(None, None, fault(bit)).axes[0].command, 0.0);
        assert!(stays_latched(&mut axis));
    }
}

#[test]
fn an_axis_waits_at_neutral_for_readings_that_fail_to_come_until_the_time_out() {
    let mut machine = machine(1);
    machine.timing.feedback_timeout = 10 * machine.timing.period;
    let moving = || {
        let mut axis = Loop::new(&machine, 0.0);
        axis.run(300, Some(actuator()));
        axis
    };
    let mut axis = moving();
    for _ in 0..20 {
        let before = axis.tick(Some(&snapshot(axis.sequence - 1, actuator()))).axes[0].command;
        for blind in 1..10 {
            let command = axis.tick_with(None, None, fault(sample_fault::STALE)).axes[0];
            assert_eq!(command.command, if blind < 3 { before } else { 0.0 }, "blind {blind}");
            assert_eq!(command.flags & control_flag::LATCHED, 0, "blind {blind}");
        }
        let commands = axis.run(100, Some(actuator()));
        assert!(commands.iter().all(|command| command.axes[0].flags & control_flag::LATCHED == 0));
        assert!(commands[99].axes[0].error.abs() < 0.01, "{}", commands[99].axes[0].error);
    }
    for _ in 0..9 {
        axis.tick_with(None, None, fault(sample_fault::STALE));
    }
    let command = axis.tick_with(None, None, fault(sample_fault::STALE)).axes[0];
    assert_ne!(command.flags & control_flag::FEEDBACK, 0);
    assert!(stays_latched(&mut axis));
    // What is implausible is not waited for.
    let mut axis = moving();
    for bit in [sample_fault::SPEED, sample_fault::STALE, sample_fault::SPEED, sample_fault::STALE] {
        assert_eq!(axis.tick_with(None, None, fault(bit)).axes[0].flags & control_flag::LATCHED, 0);
    }
    assert_ne!(axis.tick_with(None, None, fault(sample_fault::SPEED)).axes[0].flags & control_flag::FEEDBACK, 0);
}

/// Fastest speed of an axis, m/s, from its positions over 50 ms.
fn fastest(positions: &[f64]) -> f64 {
    positions.windows(6).map(|pair| (pair[5] - pair[0]).abs() / 0.05).fold(0.0, f64::max)
}

#[test]
fn an_axis_does_not_lurch_after_a_silence_in_which_its_reference_went_on() {
    for reference in [super::SINES, "kind = \"channel\"\n", "kind = \"hold\"\n"] {
        let mut machine = super::machine_with(super::SINES, reference);
        machine.timing.feedback_timeout = 40 * machine.timing.period;
        for silence in 4..40 {
            let mut axis = Loop::new(&machine, 0.0);
            // The reference of the channel moves with 0.2 m/s.
            let channel = |tick: u64| {
                let mut reference = Reference { preview: 1, ..Reference::default() };
                (reference.header.sequence, reference.header.axis_count) = (tick, 1);
                reference.positions[0][0] = 0.6 + 2e-3 * tick.saturating_sub(100) as f64;
                reference
            };
            let mut positions = Vec::new();
            let mut last = 0.0;
            for tick in 0..500u64 {
                let bits = if (200..200 + silence).contains(&tick) { sample_fault::STALE } else { 0 };
                let fresh = snapshot(tick.saturating_sub(1), actuator());
                let command = axis.tick_with(Some(&fresh), Some(&channel(tick)), fault(bits)).axes[0];
                assert_eq!(command.flags & control_flag::LATCHED, 0);
                positions.push(axis.plant.position);
                last = command.error;
            }
            // An axis that rests goes on resting.
            assert!(reference != "kind = \"hold\"\n" || positions.iter().all(|position| *position == 0.6));
            let (before, after) = (fastest(&positions[..200]), fastest(&positions[200..]));
            let more = if reference.contains("channel") { 0.08 } else { 0.02 };
            assert!(after < before.max(0.23) + more, "{reference}, {silence} ticks: {before} m/s, then {after} m/s");
            let range = positions.iter().fold((0.6f64, 0.6f64), |(low, high), p| (low.min(*p), high.max(*p)));
            assert!(reference != super::SINES || (range.0 > 0.528 && range.1 < 0.772), "{silence} ticks: {range:?}");
            assert!(last.abs() < 0.02, "{reference}, {silence} ticks: {last} m");
        }
    }
}

#[test]
fn an_axis_does_not_lurch_after_a_gap_in_the_samples() {
    let mut machine = machine(1);
    machine.timing.feedback_timeout = 100 * machine.timing.period;
    for (begin, gap) in (200..500).step_by(20).flat_map(|begin| [6, 20, 50, 90].map(|gap| (begin, gap))) {
        let mut axis = Loop::new(&machine, 0.0);
        axis.run(begin, Some(actuator()));
        // No samples and no commands: the drive is neutral after its own time-out of 50 ms.
        let last = axis.tick(None).axes[0].command;
        (0..gap).for_each(|k| axis.plant.step(if k < 5 { last } else { 0.0 }));
        axis.sequence += gap;
        let stands = axis.plant.position;
        let mut positions = vec![stands];
        for _ in 0..300 {
            axis.run(1, Some(actuator()));
            positions.push(axis.plant.position);
        }
        let (first, rest) = (fastest(&positions[..60]), fastest(&positions[60..]));
        assert!(first < if gap > 10 { 0.13 } else { 0.33 }, "tick {begin}, gap of {gap}: {first} m/s");
        assert!(rest < 0.25, "tick {begin}, gap of {gap}: {rest} m/s");
    }
}

#[test]
fn an_axis_that_goes_to_a_set_point_does_not_lurch_after_a_silence() {
    let mut machine = super::machine_with(super::SINES, "kind = \"hold\"\n");
    machine.timing.feedback_timeout = 40 * machine.timing.period;
    for silence in 4..40 {
        let mut axis = Loop::new(&machine, 0.0);
        axis.run(100, Some(actuator()));
        let mut request = Request { session: 1, ..Request::default() };
        request.header.axis_count = 1;
        request.axes[0].mode = AxisMode::Hold as u32;
        (request.axes[0].has_target, request.axes[0].target) = (1, 1.0);
        let mut positions = Vec::new();
        for tick in 100..600 {
            if tick == 100 {
                request.header.sequence = tick;
                axis.controller.ask(&request);
            }
            let bits = if (160..160 + silence).contains(&tick) { sample_fault::STALE } else { 0 };
            axis.tick_with(Some(&snapshot(tick - 1, actuator())), None, fault(bits));
            positions.push(axis.plant.position);
        }
        let (before, after) = (fastest(&positions[..60]), fastest(&positions[60..]));
        assert!(before > 0.2, "{before} m/s");
        assert!(after < 0.28, "{silence} ticks: {before} m/s, then {after} m/s");
        assert!((positions[499] - 1.0).abs() < 2e-3, "{silence} ticks: {} m", positions[499]);
    }
}

#[test]
fn an_axis_that_loses_its_reference_is_stopped_as_early_with_gaps_in_its_samples_as_without() {
    let mut machine = machine(1);
    machine.axes[0].control.following_error = 0.005;
    let stopped = |unusable: usize, of: usize, cause: u32| {
        let mut axis = Loop::new(&machine, 0.0);
        axis.run(300, Some(actuator()));
        let stands = axis.plant.position;
        (0..200).find(|k| {
            let bits = if k % of < unusable { sample_fault::STALE } else { 0 };
            // It trembles where it stands, while the reference goes on.
            let blocked = |sample: &mut EncoderSample| {
                sample.axes[0].position = stands + if k % 2 == 0 { 1e-3 } else { -1e-3 };
                sample.axes[0].faults = bits;
            };
            axis.tick_with(None, None, blocked).axes[0].flags & cause != 0
        })
    };
    let whole = stopped(0, 4, control_flag::FOLLOWING).expect("stopped");
    let gaps = stopped(1, 4, control_flag::FOLLOWING).expect("stopped with gaps");
    assert!(gaps.abs_diff(whole) <= 6, "{whole} ticks, with gaps {gaps}");
    // With two unusable samples in three the feedback itself is the fault.
    assert!(stopped(2, 3, control_flag::FEEDBACK).expect("stopped") < whole);
}

#[test]
fn bridged_samples_do_not_disturb_the_model() {
    let (mut spoilt, mut whole) = (moving(), moving());
    let fresh = |axis: &Loop| snapshot(axis.sequence - 1, actuator());
    for k in 0..100 {
        let model = fresh(&whole);
        let good = whole.tick(Some(&model)).axes[0];
        let bits = if k % 10 < 2 { sample_fault::STALE } else { 0 };
        let bad = spoilt.tick_with(Some(&model), None, fault(bits)).axes[0];
        assert!((good.command - bad.command).abs() < 0.2, "tick {k}: {} {}", good.command, bad.command);
    }
    assert!((whole.plant.position - spoilt.plant.position).abs() < 2e-3);
}

#[test]
fn a_position_outside_the_stroke_latches_at_once() {
    let mut axis = moving();
    assert_eq!(axis.tick_with(None, None, fault(sample_fault::RANGE)).axes[0].command, 0.0);
    assert!(stays_latched(&mut axis));
}

#[test]
fn a_long_fault_of_a_disarmed_axis_does_not_latch_it_once_it_is_armed() {
    let mut axis = moving();
    axis.controller.disarm();
    for _ in 0..1000 {
        axis.tick_with(None, None, fault(sample_fault::ENCODER));
    }
    axis.run(50, Some(actuator()));
    axis.controller.arm();
    let commands = axis.run(100, Some(actuator()));
    assert!(commands.iter().all(|command| command.axes[0].flags & control_flag::LATCHED == 0));
    assert_eq!(commands[99].axes[0].flags & control_flag::SETTLING, 0);
}

#[test]
fn positions_that_are_not_finite_are_unusable() {
    let mut axis = moving();
    for _ in 0..3 {
        let command = axis.tick_with(None, None, |sample| sample.axes[0].position = f64::NAN).axes[0];
        assert!(command.command.is_finite() && command.error.is_finite());
    }
    assert!(stays_latched(&mut axis));
}

#[test]
fn a_sample_without_the_axis_is_unusable() {
    let mut axis = moving();
    for _ in 0..3 {
        axis.tick_with(None, None, |sample| sample.header.axis_count = 0);
    }
    assert!(stays_latched(&mut axis));
}

#[test]
fn a_stuck_encoder_of_a_driven_axis_latches() {
    let mut axis = moving();
    let frozen = axis.plant.position;
    let ticks = (0..300).take_while(|&k| {
        let command = axis.tick_with(None, None, |sample| {
            sample.axes[0].position = frozen;
            sample.axes[0].faults = if k >= 30 { sample_fault::STUCK } else { 0 };
        });
        command.axes[0].flags & control_flag::FEEDBACK == 0
    });
    let ticks = ticks.count();
    assert!((30..100).contains(&ticks), "{ticks}");
    assert!(stays_latched(&mut axis));
}

#[test]
fn an_axis_that_rests_may_stand_still() {
    let machine = super::machine_with(super::SINES, "kind = \"hold\"\n");
    let mut axis = Loop::new(&machine, 0.1);
    for _ in 0..1000 {
        let command = axis.tick_with(None, None, fault(sample_fault::STUCK)).axes[0];
        assert_eq!((command.command, command.flags & control_flag::FEEDBACK), (0.0, 0));
    }
}

#[test]
fn commands_in_the_dead_band_of_the_valve_do_not_latch_without_compensation() {
    // With commands within the dead band of the valve and a margin the axis stands, and so does the encoder.
    let mut machine = super::machine_with(super::SINES, "kind = \"hold\"\n");
    let axis = &mut machine.axes[0];
    (axis.control.dead_band.extend, axis.control.dead_band.retract) = (0.0, 0.0);
    axis.control.ki = 0.0;
    axis.commissioned = Some(super::models::commissioned());
    for (command, latches) in [(0.1, false), (-0.1, false), (0.2, true), (-0.2, true)] {
        let mut axis = Loop::new(&machine, 0.9);
        axis.run(50, None);
        axis.plant.position -= command / 4.0;
        let commands: Vec<_> = (0..200).map(|_| axis.tick_with(None, None, fault(sample_fault::STUCK))).collect();
        let latched = commands.iter().any(|command| command.axes[0].flags & control_flag::FEEDBACK != 0);
        assert_eq!(latched, latches, "{command}");
    }
}

#[test]
fn a_short_gap_is_bridged_and_one_of_the_time_out_latches() {
    let mut axis = moving();
    axis.sequence += 2;
    assert_ne!(axis.tick(None).axes[0].command, 0.0);
    axis.sequence += 3;
    assert_eq!(axis.tick(None).axes[0].command, 0.0);
    assert!(stays_latched(&mut axis));
}

#[test]
fn an_old_sample_repeats_the_last_command_and_three_latch() {
    let mut axis = moving();
    let last = axis.tick(None);
    for k in 0..2 {
        let again = axis.controller.update(&sample(300 - k, &[0.1]), None, None);
        assert_eq!((again.header.sequence, again.axes[0].command), (300, last.axes[0].command));
    }
    assert_eq!(axis.controller.update(&sample(5, &[0.1]), None, None).axes[0].command, 0.0);
    assert!(stays_latched(&mut axis));
}

#[test]
fn lost_feedback_latches_until_disarmed_and_armed() {
    let mut axis = moving();
    axis.controller.feedback_lost();
    assert!(axis.controller.is_latched());
    let neutral = axis.controller.neutral(300);
    assert_eq!((neutral.header.sequence, neutral.header.axis_count), (300, 1));
    assert_eq!((neutral.axes[0].command, neutral.axes[0].flags), (0.0, control_flag::FEEDBACK));
    assert!(stays_latched(&mut axis));

    axis.controller.disarm();
    assert_eq!(axis.controller.neutral(0).axes[0].flags, control_flag::DISARMED);
    for command in axis.run(50, Some(actuator())) {
        assert_eq!((command.axes[0].command, command.axes[0].flags), (0.0, control_flag::DISARMED));
    }
    axis.controller.arm();
    let commands = axis.run(300, Some(actuator()));
    assert!(commands[..20].iter().all(|c| c.axes[0].command == 0.0));
    assert_eq!(commands[299].axes[0].mode, ControlMode::Model as u32);
    assert_eq!(commands[299].axes[0].flags, 0);
}

#[test]
fn a_source_that_starts_again_is_taken_up_after_disarming() {
    let mut axis = moving();
    axis.sequence = 0;
    axis.run(10, None);
    axis.controller.disarm();
    axis.controller.arm();
    axis.sequence = 0;
    let commands = axis.run(100, None);
    assert_eq!(commands[99].axes[0].mode, ControlMode::Fallback as u32);
    assert_eq!(commands[99].header.sequence, 99);
}

#[test]
fn settling_starts_again_with_every_implausible_sample() {
    let mut axis = Loop::new(&machine(1), 0.0);
    for k in 0..200 {
        let bits = if k % 15 == 14 { sample_fault::SPEED } else { 0 };
        let command = axis.tick_with(None, None, fault(bits)).axes[0];
        assert_eq!((command.command, command.mode), (0.0, ControlMode::Neutral as u32));
        assert_eq!(command.flags, control_flag::SETTLING | control_flag::NO_MODEL);
    }
}

/// Ticks for which an axis settles with a missing sample at these ticks, at 1 kHz; none where it does not within 2 s.
fn settling_ticks(is_missing: impl Fn(usize) -> bool) -> Option<usize> {
    let mut machine = machine(1);
    machine.timing.period = Duration::from_millis(1);
    let mut axis = Loop::new(&machine, 0.0);
    let bits = |k| if is_missing(k) { sample_fault::STALE } else { 0 };
    (0..2000).position(|k| axis.tick_with(None, None, fault(bits(k))).axes[0].flags & control_flag::SETTLING == 0)
}

#[test]
fn a_missing_sample_takes_back_a_part_of_the_settling() {
    let healthy = settling_ticks(|_| false).unwrap();
    assert_eq!(healthy, 200);
    assert_eq!(settling_ticks(|k| k == 150), Some(healthy + 51), "a quarter, and its own tick");
    assert_eq!(settling_ticks(|k| (150..154).contains(&k)), Some(154 + healthy), "all of it");
    assert!(settling_ticks(|k| k % 100 == 99).is_some(), "one in a hundred");
    assert_eq!(settling_ticks(|k| k % 50 == 49), None, "one in fifty");
    assert_eq!(settling_ticks(|k| k % 2 == 1), None, "one in two");
}

proptest! {
    /// For any samples in any order, a disarmed axis is exactly neutral, and an armed axis is finite and inside both
    /// limits.
    #[test]
    fn the_command_stays_allowed_for_all_samples(
        steps in prop::collection::vec((0u64..5, any::<f64>(), 0u32..32, 0u32..10), 200),
        armed: bool,
    ) {
        let mut controller = Controller::new(&machine(1)).unwrap();
        if armed {
            controller.arm();
        }
        let (mut sequence, mut last) = (0, 0.0);
        for (k, (ahead, wild, faults, kind)) in steps.into_iter().enumerate() {
            sequence += if kind == 0 { ahead } else { 1 };
            let position = match kind { 1 if k > 60 => wild, 2 => 1.2, _ => 0.65 };
            let mut sample = sample(sequence, &[position]);
            sample.axes[0].faults = if kind == 3 && k > 60 { faults } else { 0 };
            let command = controller.update(&sample, Some(&snapshot(sequence, actuator())), None).axes[0];
            prop_assert!(command.command.is_finite() && command.command.abs() <= 1.0);
            // Towards neutral before a soft limit, and to it, a command may go at once.
            let u = command.command;
            let is_limited = command.flags & control_flag::SOFT_LIMIT != 0;
            let slows_down = is_limited && u * last >= 0.0 && u.abs() < f64::abs(last);
            prop_assert!((u - last).abs() <= 0.1 + 1e-12 || u == 0.0 || slows_down, "{last} to {u}");
            prop_assert!(armed || command.command == 0.0);
            last = command.command;
        }
    }
}

#[test]
fn an_axis_that_does_not_settle_is_latched_before_anybody_has_forgotten_it() {
    let settling = control_flag::SETTLING | control_flag::NO_MODEL;
    let rests = |k: u64| k % 15 == 14;
    let mut axis = Loop::new(&machine(1), 0.0);
    let flags: Vec<u32> = (0..210)
        .map(|k| axis.tick_with(None, None, fault(if rests(k) { sample_fault::SPEED } else { 0 })).axes[0].flags)
        .collect();
    assert_eq!(flags.iter().position(|flags| *flags != settling), Some(200), "2 s at 10 ms");
    assert!(flags[200..].iter().all(|flags| flags & control_flag::LATCHED == control_flag::FEEDBACK));
    // Without samples for the most of it, and for the cause that has kept it last.
    let mut axis = Loop::new(&machine(1), 0.0);
    axis.tick(None);
    axis.controller.lose(control_flag::DEADLINE);
    axis.sequence += 1000;
    let command = axis.tick(None);
    assert_eq!(command.axes[0].flags & control_flag::LATCHED, control_flag::DEADLINE);
    // Armed again, it has all of the time.
    axis.controller.disarm();
    axis.controller.arm();
    assert!(axis.run(100, None).iter().all(|command| command.axes[0].flags & control_flag::LATCHED == 0));
}

/// A loop that has settled for 0.1 s.
fn settling() -> Loop {
    let mut axis = Loop::new(&machine(1), 0.05);
    axis.controller.disarm();
    axis.tick(None);
    axis.controller.arm();
    assert!(axis.run(10, None).iter().all(|command| command.axes[0].flags & control_flag::SETTLING != 0));
    axis
}

#[test]
fn a_fault_during_settling_latches_and_nothing_moves_when_it_is_over() {
    for bits in [sample_fault::STALE, sample_fault::ENCODER, sample_fault::RANGE] {
        let mut axis = settling();
        axis.run(1, None);
        let latched = (0..3).map(|_| axis.tick_with(None, None, fault(bits)).axes[0].flags).last().unwrap();
        assert_eq!(latched & control_flag::LATCHED, control_flag::FEEDBACK, "{bits}");
        assert!(stays_latched(&mut axis), "{bits}");
    }
}

#[test]
fn an_axis_that_settles_begins_anew_when_samples_or_commands_come_too_late() {
    let mut axis = Loop::new(&machine(1), 0.05);
    axis.controller.disarm();
    axis.tick(None);
    axis.controller.arm();
    let settles = |axis: &mut Loop| axis.tick(None).axes[0].flags & control_flag::SETTLING != 0;
    let first = (0..100).take_while(|_| settles(&mut axis)).count();
    axis.controller.disarm();
    axis.tick(None);
    axis.controller.arm();
    for cause in [control_flag::FEEDBACK, control_flag::DEADLINE] {
        assert!((0..first - 1).all(|_| settles(&mut axis)));
        axis.controller.lose(cause);
        assert!(!axis.controller.is_latched());
    }
    assert_eq!((0..100).take_while(|_| settles(&mut axis)).count(), first, "all of it again");
    // No sample came for a tenth of a second.
    axis.controller.disarm();
    axis.tick(None);
    axis.controller.arm();
    assert!((0..first - 1).all(|_| settles(&mut axis)));
    axis.sequence += 10;
    assert_eq!((0..100).take_while(|_| settles(&mut axis)).count(), first, "all of it again");
    axis.controller.lose(control_flag::DEADLINE);
    assert!(axis.controller.is_latched(), "it follows now");
}

#[test]
fn an_axis_that_settles_latches_after_a_silence_as_long_as_settling() {
    // The program that reads the sensor was stopped or killed, or this one was stopped; no sample came meanwhile.
    for (silence, latches) in [(18, false), (20, true), (50, true), (180, true)] {
        for is_noticed in [true, false] {
            let mut axis = settling();
            if is_noticed {
                axis.controller.feedback_lost();
            }
            axis.sequence += silence;
            let flags = axis.tick(None).axes[0].flags & control_flag::LATCHED;
            assert_eq!(flags, if latches { control_flag::FEEDBACK } else { 0 }, "{silence} ticks");
            assert!(!latches || stays_latched(&mut axis), "{silence} ticks");
        }
    }
}

#[test]
fn an_axis_that_is_armed_before_the_first_sample_bears_a_silence_while_stages_start() {
    let mut axis = Loop::new(&machine(1), 0.05);
    for _ in 0..3 {
        axis.tick(None);
        axis.sequence += 50;
    }
    let settles = |axis: &mut Loop| axis.tick(None).axes[0].flags & control_flag::SETTLING != 0;
    assert_eq!((0..100).take_while(|_| settles(&mut axis)).count(), 20);
    assert!(!axis.controller.is_latched());
}

#[test]
fn an_axis_that_is_armed_while_a_fault_stands_is_latched() {
    let mut axis = Loop::new(&machine(1), 0.0);
    axis.controller.disarm();
    (0..100).for_each(|_| assert_ne!(axis.tick_with(None, None, fault(sample_fault::STALE)).axes[0].flags, 0));
    axis.controller.arm();
    let flags: Vec<u32> =
        (0..3).map(|_| axis.tick_with(None, None, fault(sample_fault::STALE)).axes[0].flags).collect();
    assert!(flags[..2].iter().all(|flags| flags & control_flag::LATCHED == 0), "{flags:?}");
    assert_eq!(flags[2] & control_flag::LATCHED, control_flag::FEEDBACK);
}
