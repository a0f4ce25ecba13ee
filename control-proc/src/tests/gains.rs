//! Gains of the fallback that a request changes: only of an axis that is off, and only within their range.

use pipeline::message::{AxisCommand, AxisMode, control_flag};
use proptest::prelude::*;

use super::{machine, modes::Operated};

const RANGE: [f64; 2] = [0.25, 2.0];

/// An axis that is off, whose gains may be changed within [`RANGE`].
fn operated() -> Operated {
    let mut operated = Operated::new();
    operated.axis.controller.allow_gains([RANGE]);
    // The first message of a session changes nothing, whatever it asks for.
    operated.gain = 2.0;
    assert_eq!(ask(&mut operated, AxisMode::Unchanged, 2.0).gain, 1.0);
    operated
}

fn ask(operated: &mut Operated, mode: AxisMode, gain: f64) -> AxisCommand {
    operated.gain = gain;
    operated.ask(mode, 0.0, None).axes[0]
}

#[test]
fn gains_are_taken_within_their_range_while_the_axis_is_off() {
    let mut axis = operated();
    for gain in [0.25, 2.0, 0.5] {
        let answer = ask(&mut axis, AxisMode::Unchanged, gain);
        assert_eq!((answer.gain, answer.flags & control_flag::REQUEST), (gain, 0));
        // A message that asks for none leaves them as they are.
        assert_eq!(ask(&mut axis, AxisMode::Unchanged, 0.0).gain, gain);
    }
    for gain in [0.2499, 2.001, -1.0, f64::NAN, f64::INFINITY, f64::MIN_POSITIVE] {
        let before = axis.axis.controller.message().axes[0].refused_requests;
        let answer = ask(&mut axis, AxisMode::Unchanged, gain);
        assert_eq!((answer.gain, answer.refused_requests), (0.5, before + 1), "{gain}");
        assert_ne!(answer.flags & control_flag::REQUEST, 0);
    }
    // Without a commissioned model nobody knows what gains are safe.
    let mut axis = Operated::of(&machine(1));
    ask(&mut axis, AxisMode::Unchanged, 0.0);
    assert_eq!(ask(&mut axis, AxisMode::Unchanged, 0.9).gain, 1.0);
    assert_eq!(ask(&mut axis, AxisMode::Unchanged, 1.0).flags & control_flag::REQUEST, 0, "those it has");
}

#[test]
fn an_armed_axis_keeps_its_gains_and_is_switched_off_by_any_message() {
    let mut axis = operated();
    ask(&mut axis, AxisMode::Unchanged, 0.5);
    axis.gain = 0.0;
    axis.enable(AxisMode::Track);
    for mode in [AxisMode::Unchanged, AxisMode::Hold, AxisMode::Track] {
        let before = axis.axis.controller.message().axes[0];
        let answer = ask(&mut axis, mode, 1.0);
        assert_eq!((answer.gain, answer.operation), (0.5, before.operation), "{mode:?}");
        assert_eq!(answer.refused_requests, before.refused_requests + 1, "{mode:?}");
        // Naming the gains that it has changes nothing.
        assert_eq!(ask(&mut axis, AxisMode::Unchanged, 0.5).flags & control_flag::REQUEST, 0);
    }
    let off = ask(&mut axis, AxisMode::Off, f64::NAN);
    assert_eq!((off.operation, off.command, off.gain), (AxisMode::Off as u32, 0.0, 0.5), "off is taken all the same");
    assert_eq!(ask(&mut axis, AxisMode::Unchanged, 1.0).gain, 1.0, "and then gains are");
}

#[test]
fn the_axis_follows_more_closely_with_larger_gains() {
    // Without feed-forward the error is that part of the speed that the proportional gain has to make.
    let error = |gain: f64| {
        let mut axis = operated();
        ask(&mut axis, AxisMode::Unchanged, gain);
        axis.gain = 0.0;
        axis.enable(AxisMode::Track);
        let answers = axis.asks(1300, AxisMode::Track, 0.0, None);
        let squares = answers[300..].iter().map(|command| command.axes[0].error.powi(2));
        (squares.sum::<f64>() / 1000.0).sqrt()
    };
    let (half, whole, twice) = (error(0.5), error(1.0), error(2.0));
    assert!(half > 1.3 * whole && whole > 1.3 * twice, "{half} {whole} {twice}");
}

proptest! {
    #[test]
    fn whatever_is_asked_the_gains_stay_in_their_range_and_change_only_while_off(
        asks in prop::collection::vec((0u32..7, any::<f64>(), 0.0f64..3.0, any::<bool>(), 0u32..3), 1..60)
    ) {
        let mut axis = operated();
        let mut before = axis.axis.controller.message().axes[0];
        for (mode, wild, tame, is_wild, enable) in asks {
            axis.enable += enable / 2;
            let modes = [AxisMode::Unchanged, AxisMode::Off, AxisMode::Hold, AxisMode::Track, AxisMode::Unchanged];
            let mode = modes[mode as usize % modes.len()];
            let now = ask(&mut axis, mode, if is_wild { wild } else { tame });
            prop_assert!((RANGE[0]..=RANGE[1]).contains(&now.gain), "{}", now.gain);
            let was_off = before.operation == AxisMode::Off as u32;
            prop_assert!(now.gain == before.gain || was_off, "{} to {} while armed", before.gain, now.gain);
            before = now;
        }
    }
}
