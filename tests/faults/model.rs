//! Rows 16 to 24: faults of the identifier.
//!
//! In lock-step the test plays the identifier ([`identified`]): its core gets the samples and commands of the group,
//! and its snapshots are spoilt before they are sent. Trap: the classical model replaces a refused adaptive one, so
//! both are spoilt.

mod identified;
mod real_time;

use pipeline::{
    hammerstein::Coefficients,
    machine::Machine,
    message::{AxisMode, AxisSnapshot, Request, control_flag},
};

use crate::harness::channel::AXES;
use identified::{Identified, SPOILT, is_by_model, number};

/// Settings of the built-in machine in warm oil, with a short training.
pub fn trained_soon() -> Vec<String> {
    training("3s").into_iter().chain(["scenario=nominal".to_owned()]).collect()
}

/// Settings with this length of the training.
pub fn training(length: &str) -> [String; AXES] {
    ["boom", "arm", "telescope", "bucket"].map(|axis| format!("axis.{axis}.identification.training={length}"))
}

/// Settings as arguments of a command.
pub fn set(settings: &[String]) -> Vec<&str> {
    settings.iter().flat_map(|setting| ["--set", setting]).collect()
}

/// The built-in machine with these settings.
fn machine(settings: &[String]) -> Machine {
    let pairs = settings.iter().map(|setting| setting.split_once('=').unwrap());
    let pairs: Vec<(String, String)> = pairs.map(|(key, value)| (key.to_owned(), value.to_owned())).collect();
    Machine::four_axes(&pairs).unwrap()
}

/// Every number of a model, also those that its orders leave unused.
fn numbers(model: &mut Coefficients) -> Vec<&mut f64> {
    let Coefficients { a, b, f, g, drift, dead_band, knots, .. } = model;
    let all = a.iter_mut().chain(b).chain(f).chain(g).chain([drift]).chain(dead_band).chain(knots);
    all.collect()
}

/// An approved model of another axis: 0.6 m/s at full command, behind a lag.
fn plain(model: &mut Coefficients) {
    numbers(model).into_iter().for_each(|number| *number = 0.0);
    model.a[..2].copy_from_slice(&[-1.8, 0.8]);
    (model.b[0], model.f[0], model.g[0]) = (0.6 * 0.01 * 0.2, 1.0, 1.0);
}

/// Row 16: a model with a number that is not finite, or with denormal ones, is never used.
#[test]
fn row_16_a_model_that_is_not_finite_is_never_used() {
    let mut identified = Identified::start("row-16", &[]);
    let count = numbers(&mut Coefficients::default()).len();
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for first in (0..count).step_by(AXES) {
            identified.refused(&format!("{bad} from number {first} on"), |axis, model| {
                *numbers(model).swap_remove((first + axis) % count) = bad;
                &["not-finite"]
            });
        }
    }
    let denormal = f64::from_bits(1 << 20);
    identified.refused("denormal b", |_, model| {
        model.b.iter_mut().for_each(|b| *b = denormal);
        &["unreachable", "direction"]
    });
    identified.refused("denormal curves", |_, model| {
        model.f.iter_mut().chain(&mut model.g).for_each(|c| *c = denormal);
        &["unreachable", "direction"]
    });
    identified.refused("all denormal", |_, model| {
        numbers(model).into_iter().for_each(|number| *number = denormal);
        model.dead_band = [0.0; 2];
        &["unreachable", "direction"]
    });
}

/// Row 17: a model with a pole outside of the unit circle is never used.
#[test]
fn row_17_an_unstable_model_is_never_used() {
    let mut identified = Identified::start("row-17", &[]);
    for pole in [1.03, 1.1, 2.0, -1.03, -1.5] {
        identified.refused(&format!("pole {pole}"), |_, model| {
            plain(model);
            // (1 - pole z^-1) (1 - 0.8 z^-1)
            model.a[..2].copy_from_slice(&[-0.8 - pole, 0.8 * pole]);
            &["unstable"]
        });
    }
}

/// Row 17: an oscillating pole within the unit circle is accepted, and the commands stay within their limits. It is not
/// refused, since the model of a healthy axis has a pole at -0.6 too, which comes from the noise of its encoder.
#[test]
fn row_17_an_oscillating_model_keeps_the_commands_within_their_limits() {
    let mut identified = Identified::start("row-17-swing", &[]);
    for pole in [-0.6, -0.99] {
        let mut before = identified.command;
        let mut largest = 0.0f64;
        for k in 0..40 {
            let command = identified.step(|snapshot| {
                for axis in &mut snapshot.axes[..AXES] {
                    for model in [&mut axis.adaptive, &mut axis.classical] {
                        plain(model);
                        // (1 - z^-1) (1 - pole z^-1), with the same final speed.
                        model.a[..2].copy_from_slice(&[-1.0 - pole, pole]);
                        model.b[0] = 0.6 * 0.01 * (1.0 - pole);
                    }
                }
            });
            for (axis, before) in command.axes[..AXES].iter().zip(&before.axes) {
                let moved = (axis.command - before.command).abs();
                largest = largest.max(moved);
                assert!(axis.command.abs() <= 1.0 && moved <= 0.1 + 1e-9, "pole {pole}, tick {k}: {moved}");
                assert_eq!(axis.flags & control_flag::LATCHED, 0, "pole {pole}, tick {k}");
            }
            before = command;
        }
        eprintln!("row 17: pole {pole}: commands moved by {largest:.3} in a tick at the most");
        identified.steps(100);
    }
}

/// Row 18: a model of the wrong direction, without gain, or of an implausible speed is never used.
#[test]
fn row_18_a_model_of_the_wrong_direction_or_without_gain_is_never_used() {
    // Commissioned values of the boom. The other axes are not commissioned.
    let commissioned = [
        "dead_time=0.02",
        "time_constant=0.06",
        "dead_band_extend=0.1",
        "dead_band_retract=0.08",
        "openings=[0.1, 0.9]",
        "speeds_extend=[0.04, 0.36]",
        "speeds_retract=[0.06, 0.54]",
        "fit_percent=99.0",
    ]
    .map(|setting| format!("axis.boom.commissioned.{setting}"));
    let commissioned: Vec<&str> = commissioned.iter().map(String::as_str).collect();
    let mut identified = Identified::start("row-18", &commissioned);
    identified.refused("b turned round", |_, model| {
        model.b.iter_mut().for_each(|b| *b = -*b);
        &["direction"]
    });
    identified.refused("no b", |_, model| {
        model.b = [0.0; 5];
        &["unreachable"]
    });
    for factor in [0.1, 10.0] {
        identified.refused(&format!("boom {factor} times as fast, the others as good as not at all"), |axis, model| {
            model.b.iter_mut().for_each(|b| *b *= if axis == 0 { factor } else { 1e-4 });
            if axis == 0 { &["speed", "unreachable"] } else { &["unreachable"] }
        });
    }
}

/// Row 19: a valve curve that turns back is refused, or used up to the point where it turns.
#[test]
fn row_19_a_curve_that_turns_back_is_refused_or_used_up_to_that_point() {
    let mut identified = Identified::start("row-19", &[]);
    for (f, g) in [(-20.0, 0.0), (0.0, 20.0), (-20.0, 20.0)] {
        identified.refused(&format!("N = u {f:+} u^2 above and {g:+} u^2 below"), |_, model| {
            plain(model);
            (model.f[1], model.g[1]) = (f, g);
            &["unreachable", "direction"]
        });
    }
    identified.refused("one branch falls", |_, model| {
        plain(model);
        model.g[0] = -1.0;
        &["unreachable", "direction"]
    });
    // u - u^2 / 0.6 rises up to 0.3.
    let turns = |axis: &mut AxisSnapshot| {
        for model in [&mut axis.adaptive, &mut axis.classical] {
            plain(model);
            (model.f[1], model.g[1]) = (-1.0 / 0.6, 1.0 / 0.6);
        }
    };
    for k in 0..60 {
        let command = identified.step(|snapshot| snapshot.axes[..AXES].iter_mut().for_each(turns));
        // At its rate limit the command takes ten ticks to get there.
        for axis in command.axes[..AXES].iter().filter(|axis| k > 10 && is_by_model(axis)) {
            assert!(axis.command.abs() <= 0.3 + 1e-9, "tick {k}: {}", axis.command);
        }
    }
    assert!(identified.command.axes[..AXES].iter().any(is_by_model), "it was used");
}

/// Row 20: an adaptive model that predicts worse than the classical one is replaced by it.
#[test]
fn row_20_a_model_that_predicts_worse_is_replaced_by_the_classical_one() {
    let mut identified = Identified::start("row-20", &[]);
    let mut held = identified.twin.clone();
    let mut instead = identified.sent;
    let before = identified.command;
    for k in 0..=20 {
        let command = identified.step(|snapshot| {
            for axis in &mut snapshot.axes[..AXES] {
                // Its reported errors are twice as large.
                axis.classical_errors.h_step.count = axis.classical_errors.h_step.count.max(200);
                axis.adaptive_errors.h_step = axis.classical_errors.h_step;
                axis.adaptive_errors.h_step.m2 = 4.0 * axis.adaptive_errors.h_step.m2.max(1e-12);
                axis.adaptive.b.iter_mut().for_each(|b| *b *= 2.0);
            }
        });
        let expected = held.update(&identified.sample, instead.as_ref(), None);
        for (i, (axis, expected)) in command.axes[..AXES].iter().zip(&expected.axes).enumerate() {
            assert_eq!(axis.command.to_bits(), expected.command.to_bits(), "axis {i}, tick {k}");
            assert_eq!(axis.flags & control_flag::MODEL_REFUSED != 0, k > 0, "axis {i}, tick {k}");
            let worse = number("worse");
            assert_eq!(axis.rejected_snapshots[worse], before.axes[i].rejected_snapshots[worse] + k, "axis {i}");
        }
        let mut next = identified.good;
        next.axes.iter_mut().for_each(|axis| axis.adaptive = axis.classical);
        instead = Some(next);
    }
    identified.accepted("worse");
}

/// Largest error that counts as none, m: two counts of an encoder.
const AT_TARGET: f64 = 2e-4;

/// Row 21: a change of the model changes the command by its rate limit at most.
#[test]
fn row_21_a_change_of_model_keeps_the_rate_limit() {
    let mut identified = Identified::start("row-21", &[]);
    let rate = 0.1 + 1e-9;
    let change = |axis: &mut AxisSnapshot, factor: f64| {
        [&mut axis.adaptive, &mut axis.classical].into_iter().flat_map(|model| &mut model.b).for_each(|b| *b *= factor);
    };
    let (mut largest, mut at_target) = ([0.0f64; 2], 0);
    for holds in [false, true] {
        if holds {
            let mut request = Request { session: 1, ..Request::default() };
            request.axes[..AXES].iter_mut().for_each(|axis| axis.mode = AxisMode::Hold as u32);
            identified.request = Some(request);
            identified.steps(400);
        }
        for round in 0..12 {
            let factor = [2.0, 0.5, 4.0][round % 3];
            let mut before =
                identified.step(|snapshot| snapshot.axes[..AXES].iter_mut().for_each(|a| change(a, factor)));
            for _ in 0..8 {
                let mut without = identified.twin.clone();
                let usual = identified.good;
                let command =
                    identified.step(|snapshot| snapshot.axes[..AXES].iter_mut().for_each(|axis| change(axis, factor)));
                let usual = without.update(&identified.sample, Some(&usual), None);
                for (i, axis) in command.axes[..AXES].iter().enumerate() {
                    let moved = (axis.command - before.axes[i].command).abs();
                    // At rest the valve is closed at once, without regard to the rate limit.
                    let is_shut = holds && axis.command == 0.0;
                    assert!(moved <= rate || is_shut, "holds {holds}, round {round}, axis {i}: {moved}");
                    let apart = (axis.command - usual.axes[i].command).abs();
                    let place = if holds && axis.error.abs() < AT_TARGET { 1 } else { 0 };
                    largest[place] = largest[place].max(apart);
                    at_target += place;
                }
                before = command;
            }
            identified.steps(10);
        }
    }
    eprintln!("row 21: apart by {:.4} on the way, {:.4} in {at_target} ticks at the target", largest[0], largest[1]);
    assert!(at_target > 50);
    // 2 % of the range from -1 to 1.
    assert!(largest[1] <= 0.04, "{}", largest[1]);
}

/// Row 22: a torn snapshot, or one of another structure or other axes, is never used.
#[test]
fn row_22_a_torn_snapshot_or_one_of_other_axes_is_never_used() {
    let mut identified = Identified::start("row-22", &[]);
    // The first half of one model and the second half of another one, whose b and curves are negative.
    identified.refused("torn between b and the curves", |_, model| {
        model.f.iter_mut().chain(&mut model.g).for_each(|c| *c = -*c);
        &["direction"]
    });
    identified.refused("torn between the curves", |_, model| {
        plain(model);
        model.g[0] = -1.0;
        &["unreachable", "direction"]
    });
    identified.refused("torn within A", |_, model| {
        plain(model);
        model.a[1] = 0.3;
        &["unstable"]
    });
    identified.refused("another structure", |axis, model| {
        *[&mut model.na, &mut model.nb, &mut model.nk, &mut model.order][axis] = u32::MAX;
        &["structure"]
    });
    // A snapshot of fewer axes than the machine has: the other axes go on with their last approved model.
    for count in [0, 2] {
        let mut without = identified.twin.clone();
        let last_good = identified.sent;
        for k in 0..SPOILT {
            let command = identified.step(|snapshot| {
                snapshot.header.axis_count = count;
                snapshot.axes[count as usize..].iter_mut().for_each(|axis| plain(&mut axis.adaptive));
                snapshot.axes[count as usize..].iter_mut().for_each(|axis| plain(&mut axis.classical));
            });
            let expected = without.update(&identified.sample, last_good.as_ref(), None);
            for (i, axis) in command.axes[..AXES].iter().enumerate().skip(count as usize) {
                assert_eq!(axis.command.to_bits(), expected.axes[i].command.to_bits(), "{count} axes: axis {i}");
                assert_eq!(axis.flags & control_flag::NO_MODEL != 0, k > 0, "{count} axes: axis {i}");
            }
        }
        identified.accepted("all axes again");
    }
}
