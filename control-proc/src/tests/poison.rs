//! Ten thousand poisoned snapshots among good ones.
//!
//! A poisoned model is one that no axis can have: not finite, denormal, unstable, of the wrong direction, of another
//! structure, with a curve that turns back before it has moved the axis, or torn. A torn model has the first half of
//! one good model and the second half of another, and is wrong in one of these ways. The judge looks at the model, not
//! at the origin of its bytes: a torn model with sound coefficients is used like any other, and a curve that turns back
//! later is used up to there.

use pipeline::{
    hammerstein::{Coefficients, Structure},
    message::{CoefficientSnapshot, ControlMode, control_flag},
};
use rand_pcg::{
    Pcg64,
    rand_core::{Rng, SeedableRng},
};

use super::{Loop, machine, models::actuator, snapshot};

const POISONED: usize = 10_000;
/// The most good snapshots in a row before the next poisoned ones.
const GOOD: usize = 30;

/// From 0 to 1.
fn uniform(random: &mut Pcg64) -> f64 {
    (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

fn below(random: &mut Pcg64, count: usize) -> usize {
    (uniform(random) * count as f64) as usize
}

/// Another good model of the same structure: b and both curves negative, and a faster valve.
fn other() -> Coefficients {
    let mut model = actuator();
    model.a[..2].copy_from_slice(&[-1.3, 0.3]);
    model.b[0] = -0.6 * 0.01 * 0.7;
    (model.f[0], model.g[0]) = (-1.0, -1.0);
    model
}

/// A poisoned model; `way` is one of [`WAYS`].
fn poisoned(way: usize, random: &mut Pcg64) -> Coefficients {
    let mut model = actuator();
    let sign = if random.next_u64() & 1 == 0 { 1.0 } else { -1.0 };
    let size = uniform(random);
    match way {
        0 | 1 => {
            let bad = [f64::NAN, sign * f64::INFINITY][way];
            let values = [&mut model.a[..], &mut model.b[..], &mut model.f[..], &mut model.g[..]].into_iter();
            // The first two of each, but for b1, which the model does not have.
            let values = values.flat_map(|values| values.iter_mut().take(2));
            *values.enumerate().filter(|(k, _)| *k != 3).nth(below(random, 7)).unwrap().1 = bad;
        }
        2 => {
            let denormal = f64::from_bits(1 + random.next_u64() % (1 << 52));
            match below(random, 3) {
                0 => model.b[0] = denormal,
                1 => (model.f[0], model.g[0]) = (denormal, denormal),
                _ => [&mut model.a[..2], &mut model.b[..1]].into_iter().flatten().for_each(|c| *c = sign * denormal),
            }
        }
        // A pole outside the limit, on either side.
        3 => {
            let pole = sign * (1.03 + size);
            (model.a[0], model.a[1]) = (-0.8 - pole, 0.8 * pole);
        }
        4 => model.b[0] *= -0.1 - size,
        // N turns back before 1/40 of the command, on either side.
        5 if sign > 0.0 => model.f[1] = -20.0 - size,
        5 => model.g[1] = 20.0 + size,
        6 => {
            let (na, nb, nk, order) =
                [(1, 0, 5, 3), (2, 2, 5, 3), (2, 0, 4, 3), (2, 0, 5, 2), (5, 4, 5, 3)][below(random, 5)];
            model = Coefficients::zero(Structure { na, nb, nk, order, ..Structure::PAPER });
            (model.a[0], model.b[0], model.f[0], model.g[0]) = (-1.0, 0.006, 1.0, 1.0);
        }
        7 => {
            let Coefficients { na, nb, nk, order, .. } = &mut model;
            *[na, nb, nk, order].into_iter().nth(below(random, 4)).unwrap() = u32::MAX;
        }
        // Torn in the middle of A: poles at 1.61 and 0.19.
        8 => model.a[1] = other().a[1],
        // Torn after b, or between the two curves: a positive command retracts, at least on one side.
        9 => (model.f, model.g) = (other().f, other().g),
        _ => model.g = other().g,
    }
    model
}

const WAYS: usize = 11;

/// Results of a run.
struct Seen {
    /// Largest error after the way to the target, m.
    largest_error: f64,
    model_ticks: usize,
    commands: Vec<f64>,
}

/// A loop with good snapshots, and with bursts of poisoned ones or, in their place, of none.
fn run(poison: bool) -> Seen {
    let mut random = Pcg64::seed_from_u64(7);
    let mut axis = Loop::new(&machine(1), 0.05);
    let mut seen = Seen { largest_error: 0.0, model_ticks: 0, commands: Vec::new() };
    let (mut sent, mut good, mut burst) = (0, GOOD, 0);
    while sent < POISONED {
        if good == 0 && burst == 0 {
            burst = 1 + below(&mut random, 20);
            good = 1 + below(&mut random, GOOD);
        }
        let made_after = axis.sequence.saturating_sub(1);
        let command = if burst > 0 {
            let (way, held) = (sent % WAYS, below(&mut random, WAYS));
            let mut bad: CoefficientSnapshot = snapshot(made_after, poisoned(way, &mut random));
            // Otherwise the classical model would be used instead.
            bad.axes[0].classical = poisoned(held, &mut random);
            (burst, sent) = (burst - 1, sent + 1);
            let command = axis.tick(poison.then_some(&bad)).axes[0];
            let said = if poison { control_flag::MODEL_REFUSED } else { control_flag::NO_MODEL };
            assert_ne!(command.flags & said, 0, "way {way}, held {held}");
            command
        } else {
            good -= 1;
            axis.tick(Some(&snapshot(made_after, actuator()))).axes[0]
        };
        assert_eq!(command.flags & control_flag::LATCHED, 0);
        seen.model_ticks += usize::from(command.mode == ControlMode::Model as u32);
        seen.commands.push(command.command);
        if axis.sequence > 300 {
            seen.largest_error = seen.largest_error.max(command.error.abs());
        }
    }
    seen
}

#[test]
fn the_second_model_is_approved_by_itself() {
    let mut axis = Loop::new(&machine(1), 0.0);
    axis.run(40, Some(other()));
    assert_eq!(axis.tick(Some(&snapshot(39, other()))).axes[0].mode, ControlMode::Model as u32);
}

#[test]
fn ten_thousand_poisoned_snapshots_change_no_command() {
    let (with, without) = (run(true), run(false));
    let share = with.model_ticks as f64 / with.commands.len() as f64;
    println!("largest error {:.2} mm, {:.0} % by the model", with.largest_error * 1e3, share * 100.0);
    assert_eq!(with.model_ticks, without.model_ticks);
    assert!(share > 0.9, "the last approved model stays in use: {share} of the ticks");
    for (k, (a, b)) in with.commands.iter().zip(&without.commands).enumerate() {
        assert_eq!(a.to_bits(), b.to_bits(), "tick {k}");
    }
    // The fallback alone, with this reference.
    let mut fallback = Loop::new(&machine(1), 0.05);
    let errors = fallback.run(3000, None).split_off(300);
    let largest = errors.iter().fold(0.0f64, |largest, command| largest.max(command.axes[0].error.abs()));
    assert!(with.largest_error < 1.1 * largest, "{} m, the fallback alone {largest} m", with.largest_error);
}
