use super::*;
use pipeline::machine::Machine;

const PERIOD: Duration = Duration::from_millis(10);

/// The boom: stroke 1.334 m, 1 m/s, counts of 0.1 mm, stuck after 300 ms.
fn boom() -> Plausibility {
    Plausibility::new(&Machine::four_axes(&[]).unwrap().axes[0], PERIOD)
}

#[test]
fn a_moving_axis_has_no_fault_and_the_right_velocity() {
    let mut check = boom();
    for k in 0..100 {
        let sample = check.judge(1, Some(0.5 + 0.004 * f64::from(k)), false);
        assert_eq!(sample.faults, 0);
        assert_eq!(sample.position, 0.5 + 0.004 * f64::from(k));
        assert!(k == 0 || (sample.velocity - 0.4).abs() < 1e-9);
    }
}

#[test]
fn each_fault_keeps_the_last_good_position() {
    for (position, error, expected) in [
        (Some(1.340), false, sample_fault::SPEED),
        (Some(-0.006), false, sample_fault::SPEED),
        (Some(f64::NAN), false, sample_fault::RANGE),
        (Some(f64::INFINITY), false, sample_fault::RANGE),
        (Some(0.75), false, sample_fault::SPEED),
        (Some(0.6), true, sample_fault::ENCODER),
        (None, false, sample_fault::STALE),
    ] {
        let mut check = boom();
        check.judge(1, Some(0.6), false);
        let sample = check.judge(1, position, error);
        assert_eq!((sample.faults, sample.position), (expected, 0.6), "{position:?}");
    }
}

#[test]
fn an_axis_that_leaves_its_stroke_is_out_of_range_at_once_and_after_a_jump_with_the_second_position() {
    for (last, inside, outside) in [(1.333, 1.3389, 1.3391), (0.001, -0.0049, -0.0051)] {
        let mut check = boom();
        check.judge(1, Some(last), false);
        assert_eq!(check.judge(1, Some(inside), false).faults, 0);
        assert_eq!(check.judge(1, Some(outside), false).faults, sample_fault::RANGE);
    }
    let mut check = boom();
    check.judge(1, Some(0.6), false);
    assert_eq!(check.judge(1, Some(2.0), false).faults, sample_fault::SPEED);
    assert_eq!(check.judge(1, Some(2.0), false).faults, sample_fault::RANGE);
    // There is no position before the first one, so the first one is no jump.
    assert_eq!(boom().judge(1, Some(2.0), false).faults, sample_fault::RANGE);
}

#[test]
fn positions_at_the_limits_pass() {
    let mut check = boom();
    assert_eq!(check.judge(1, Some(1.3389), false).faults, 0);
    assert_eq!(check.judge(1, Some(1.3289), false).faults, 0, "10 mm in 10 ms are 1 m/s");
    assert_eq!(check.judge(1, Some(1.3180), false).faults, sample_fault::SPEED);
    // Two ticks after the last good position 20.9 mm are possible, but the axis was almost at rest before.
    assert_eq!(check.judge(1, Some(1.3180), false).faults, sample_fault::SPEED);
    assert_eq!(check.judge(1, Some(1.3184), false).faults, 0, "10.5 mm from there");
}

/// True positions and samples of an axis that moves at `speed` m/s. `error` of the tick, m, is added to the position
/// that is checked.
fn checked(speed: f64, ticks: u32, error: impl Fn(u32) -> f64) -> Vec<(f64, AxisSample)> {
    let mut check = boom();
    let counted = |y: f64| (y * 1e4).round() * 1e-4;
    (0..ticks)
        .map(|k| {
            let y = 0.4 + speed * 0.01 * f64::from(k);
            (y, check.judge(1, Some(counted(y + error(k))), false))
        })
        .collect()
}

#[test]
fn one_position_far_off_is_implausible_and_the_next_is_always_good() {
    for speed in [0.0, 0.25, -0.25] {
        for bit in 0..14 {
            for sign in [-1.0, 1.0] {
                let error = sign * 1e-4 * f64::from(1 << bit);
                let checked = checked(speed, 40, |k| if k == 20 { error } else { 0.0 });
                for (k, (y, sample)) in checked.iter().enumerate() {
                    // The distance in one tick at 1 m/s and five counts.
                    let is_dropped = k == 20 && error.abs() > 0.0105;
                    assert!(!is_dropped || sample.faults != 0, "{speed} {error} {k}");
                    assert!(k == 20 || sample.faults & sample_fault::UNUSABLE == 0, "{speed} {error} {k}");
                    assert!(is_dropped || (sample.position - y).abs() < error.abs() + 1e-4);
                }
            }
        }
    }
}

#[test]
fn a_step_of_twenty_millimetres_is_implausible_until_the_controller_has_latched() {
    for speed in [0.0, 0.2, -0.2] {
        for step in [0.02, -0.02] {
            // The axis comes to rest within some ticks, as it does when its controller has latched.
            let mut check = boom();
            let (mut y, mut v) = (0.6f64, speed);
            for k in 0..40 {
                if k >= 20 {
                    v *= 0.7;
                }
                y += v * 0.01;
                let seen = y + if k >= 20 { step } else { 0.0 };
                let sample = check.judge(1, Some((seen * 1e4).round() * 1e-4), false);
                assert_eq!(sample.faults & sample_fault::SPEED != 0, k >= 20, "{speed} {step} {k}");
            }
            // After half a second at rest the position is the new base, with zero speed.
            let ticks = (0..100).take_while(|_| check.judge(1, Some(y + step), false).faults & 7 != 0).count();
            assert!((25..=35).contains(&ticks), "{ticks}");
            let sample = check.judge(1, Some(y + step), false);
            assert_eq!((sample.position, sample.velocity), (y + step, 0.0));
        }
    }
}

#[test]
fn an_encoder_that_keeps_jumping_gets_no_new_base() {
    let mut check = boom();
    check.judge(1, Some(0.6), false);
    for k in 0..1000 {
        let position = 0.8 + 0.02 * f64::from(k % 2);
        assert_eq!(check.judge(1, Some(position), false).faults, sample_fault::SPEED);
    }
    // An encoder that reports an error now and then gets no new base, nor does one with missing readings.
    for k in 0..1000 {
        assert_ne!(check.judge(1, Some(0.8), k % 40 == 0).faults & sample_fault::UNUSABLE, 0);
    }
    for k in 0..1000 {
        let position = if k % 40 == 0 { None } else { Some(0.8) };
        assert_ne!(check.judge(1, position, false).faults & sample_fault::UNUSABLE, 0);
    }
}

#[test]
fn without_readings_the_plausible_distance_grows_with_time() {
    let mut check = boom();
    check.judge(1, Some(0.6), false);
    for _ in 0..3 {
        assert_eq!(check.judge(1, None, false).faults, sample_fault::STALE);
    }
    assert_eq!(check.clone().judge(1, Some(0.641), false).faults, sample_fault::SPEED);
    assert_eq!(check.judge(1, Some(0.64), false).faults, 0);
    // The plausible distance grows with missed ticks, too.
    assert_eq!(check.judge(5, Some(0.69), false).faults, 0);
    assert_eq!(check.judge(u64::MAX, Some(0.2), false).faults, 0);
}

#[test]
fn a_position_that_does_not_change_is_marked_as_stuck() {
    let mut check = boom();
    for k in 0..40 {
        let sample = check.judge(1, Some(0.5), false);
        assert_eq!(sample.faults & sample_fault::STUCK != 0, k >= 30, "tick {k}");
        assert_eq!((sample.position, sample.unchanged), (0.5, k));
    }
    assert_eq!(check.judge(1, Some(0.5001), false).faults, 0);
}

/// Time until the axis runs away that does nothing but what `position` says after a second at rest, s.
fn runs_away(period: Duration, position: impl Fn(f64) -> f64) -> Option<f64> {
    let mut check = Plausibility::new(&Machine::four_axes(&[]).unwrap().axes[0], period);
    let rest = (1.0 / period.as_secs_f64()) as u32;
    let counts = |y: f64| (y / 1e-4).round() * 1e-4;
    (0..3 * rest).find_map(|k| {
        let time = (f64::from(k) - f64::from(rest)) * period.as_secs_f64();
        let faults = check.judge(1, Some(counts(position(time.max(0.0)))), false).faults;
        (faults & sample_fault::RUNAWAY != 0).then_some(time)
    })
}

#[test]
fn an_axis_that_falls_faster_than_it_can_move_runs_away() {
    for (ms, within) in [(1, 0.08), (2, 0.08), (5, 0.08), (10, 0.08), (20, 0.16), (50, 0.4)] {
        for speed in [1.7, 3.0, -5.0] {
            let time = runs_away(Duration::from_millis(ms), |t| 0.6 + speed * t).unwrap();
            assert!(time <= within, "{ms} ms, {speed} m/s: {time} s");
        }
    }
    // It begins to fall by its weight.
    let fall = |t: f64| 1.2 - (0.5 * 9.81 * t * t).min(3.0 * t);
    assert!(runs_away(PERIOD, fall).unwrap() <= 0.25);
}

#[test]
fn an_encoder_that_errs_does_not_run_away() {
    assert_eq!(runs_away(PERIOD, |t| if t > 0.0 { 0.9 } else { 0.6 }), None, "a cable that slips");
    let noise = |t: f64| (4e4 * (9170.0 * t).sin()).fract();
    assert_eq!(runs_away(PERIOD, |t| 0.6 + 0.02 * noise(t)), None, "noise");
    assert_eq!(runs_away(PERIOD, |t| 0.6 + 0.1 * (t / 0.05).floor().min(5.0)), None, "steps");
    assert_eq!(runs_away(PERIOD, |t| 0.6 + 0.95 * t.min(0.7)), None, "the fastest speed");
}
