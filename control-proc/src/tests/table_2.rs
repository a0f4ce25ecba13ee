//! The model of the paper's Table 2 under the whole controller. The plant is the difference equation itself.
//!
//! ```text
//! y(k) = -a1 y(k-1) - a2 y(k-2) - a3 y(k-3) + b0 x(k-1) + b1 x(k-2) + d        x = f(u)
//! ```
//!
//! y position, x = f(u) intermediate value, d load, constant from a certain tick on. Trap: the controller shuts the
//! valve where the reference stands still, which is right for an integrator. This plant is none and would sink, so its
//! reference always moves a little.

use std::path::Path;

use pipeline::{hammerstein::Coefficients, machine::Machine, message::ControlMode};

use super::{machine_text, sample, snapshot};
use crate::Controller;

/// Tick from which the load acts.
const LOADED: u64 = 1500;
const TICKS: u64 = 3000;
/// m per unit of y: the paper has no unit, and a full command makes 47 of them.
const UNIT: f64 = 0.01;
/// Decrease of y by the load at every tick, m: 28 mm at rest, for the gain of 1/0.0355.
const LOAD: f64 = -0.001;

/// Following error (m) and mode of each tick.
fn errors() -> Vec<(f64, u32)> {
    let mut text = machine_text(1);
    for (from, to) in [
        ("na = 2\nnb = 0\nnk = 5\norder = 3", "na = 3\nnb = 1\nnk = 1\norder = 3"),
        // The plant stands still under a constant command, which is no fault here.
        ("dead_band_extend = 0.08\ndead_band_retract = 0.07", "dead_band_extend = 0.9\ndead_band_retract = 0.9"),
        (super::SINES, "kind = \"ramps\"\ntimes = [0.0, 10.0, 20.0]\npositions = [0.15, 0.152, 0.15]\n"),
    ] {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    let machine = Machine::parse(&text, "test.toml", Path::new("."), &[]).unwrap();
    let mut controller = Controller::new(&machine).unwrap();
    controller.arm();
    let mut model = Coefficients::TABLE_2;
    model.b.iter_mut().for_each(|b| *b *= UNIT);
    let nonlinearity = model.nonlinearity();
    // The plant sinks until control begins.
    let (mut y, mut x) = ([0.15; 3], [0.0; 2]);
    let mut errors = Vec::new();
    for k in 0..TICKS {
        let command = controller.update(&sample(k, &[y[0]]), Some(&snapshot(k.saturating_sub(1), model)), None).axes[0];
        errors.push((command.error, command.mode));
        x.rotate_right(1);
        x[0] = nonlinearity.evaluate(command.command);
        let next = model.predict_one(&y, &x) + if k >= LOADED { LOAD } else { 0.0 };
        y.rotate_right(1);
        y[0] = next;
    }
    errors
}

#[test]
fn table_2_is_stable_and_without_offset_under_a_constant_load() {
    let errors = errors();
    for (settled, what) in [(1400..LOADED as usize, "without load"), (2900..TICKS as usize, "with it")] {
        for (error, mode) in &errors[settled] {
            assert_eq!(*mode, ControlMode::Model as u32, "{what}");
            assert!(error.abs() < 0.1e-3, "{what}: {error}");
        }
    }
    // The load acts: the error exceeds 1 mm before the controller corrects it.
    let most = errors[LOADED as usize..].iter().fold(0.0f64, |most, (error, _)| most.max(error.abs()));
    assert!(most > 0.001, "{most}");
}
