//! The modes off, manual, hold, track and commission, and the changes between them.

use pipeline::{
    channel::Stop,
    hammerstein::Coefficients,
    machine::{Law, SmithSettings},
    message::{AxisMode, AxisRequest, ControlMode, EncoderSample, Request, ValveCommand, control_flag},
};
use proptest::prelude::*;

use super::{
    Loop, SINES, machine, machine_with,
    models::{actuator, commission_without_dead_band},
    sample, snapshot,
};
use crate::Controller;

/// Largest change of the command from tick to tick by a request.
const RATE: f64 = 0.1 + 1e-12;
/// Largest change of the command where the axis is at its reference: 2 % of the range.
const BUMP: f64 = 0.02;

/// A disarmed axis in its loop, and the program that operates it.
pub struct Operated {
    pub(super) axis: Loop,
    session: u64,
    number: u64,
    pub(super) enable: u32,
    pub(super) hold_to_run: bool,
    /// Gains of the fallback that are asked for; 0 for none.
    pub(super) gain: f64,
    /// The model of the snapshots, if any come.
    model: Option<Coefficients>,
}

impl Operated {
    pub fn new() -> Self {
        Self::of(&machine(1))
    }

    /// With snapshots of the exact model of the plant.
    fn modelled() -> Self {
        let mut operated = Self::new();
        operated.axis.plant = super::plant::Actuator::new(0.6, 0.0);
        Self { model: Some(actuator()), ..operated }
    }

    pub(super) fn of(machine: &pipeline::machine::Machine) -> Self {
        let mut axis = Loop::new(machine, 0.05);
        axis.controller = Controller::new(machine).unwrap();
        Self { axis, session: 1, number: 0, enable: 0, hold_to_run: false, gain: 0.0, model: None }
    }

    /// The next message of the program, made from the newest sample.
    fn request(&mut self, mode: AxisMode, command: f64, target: Option<f64>) -> Request {
        let mut request = Request { session: self.session, ..Request::default() };
        request.header.axis_count = 1;
        request.header.sequence = self.axis.sequence.saturating_sub(1);
        request.header.number = self.number;
        self.number += 1;
        request.axes[0] = AxisRequest {
            mode: mode as u32,
            enable: self.enable,
            command,
            target: target.unwrap_or(0.0),
            has_target: u32::from(target.is_some()),
            hold_to_run: u32::from(self.hold_to_run),
            gain: self.gain,
        };
        request
    }

    /// One tick with a request.
    pub fn ask(&mut self, mode: AxisMode, command: f64, target: Option<f64>) -> ValveCommand {
        let request = self.request(mode, command, target);
        self.axis.controller.ask(&request);
        self.tick()
    }

    /// One tick with a request; `change` may change the sample.
    pub(super) fn ask_with(
        &mut self,
        mode: AxisMode,
        command: f64,
        change: impl FnOnce(&mut EncoderSample),
    ) -> ValveCommand {
        let request = self.request(mode, command, None);
        self.axis.controller.ask(&request);
        self.axis.tick_with(None, None, change)
    }

    fn tick(&mut self) -> ValveCommand {
        let fresh = self.model.map(|model| snapshot(self.axis.sequence.saturating_sub(1), model));
        self.axis.tick(fresh.as_ref())
    }

    pub fn asks(&mut self, ticks: usize, mode: AxisMode, command: f64, target: Option<f64>) -> Vec<ValveCommand> {
        (0..ticks).map(|_| self.ask(mode, command, target)).collect()
    }

    /// Arms the axis by a request and lets it settle.
    pub fn enable(&mut self, mode: AxisMode) {
        self.ask(mode, 0.0, None);
        self.enable += 1;
        let settled = self.asks(22, mode, 0.0, None);
        assert!(settled[..20].iter().all(|command| command.axes[0].command == 0.0), "settling is neutral");
        assert_eq!(settled[21].axes[0].operation, mode as u32);
        assert_eq!(settled[21].axes[0].flags & (control_flag::SETTLING | control_flag::DISARMED), 0);
    }

    fn is_off(&mut self) -> bool {
        let axis = self.axis.controller.neutral(0).axes[0];
        axis.operation == AxisMode::Off as u32 && axis.flags & control_flag::DISARMED != 0
    }
}

#[test]
fn nothing_moves_before_an_enable() {
    for mode in [AxisMode::Manual, AxisMode::Hold, AxisMode::Track, AxisMode::Commission] {
        let mut axis = Operated::new();
        // The first message of a program does not enable, whatever its number is.
        axis.enable = 7;
        let command = if mode.is_direct() { 0.5 } else { 0.0 };
        for command in axis.asks(300, mode, command, Some(0.9)) {
            assert_eq!((command.axes[0].command, command.axes[0].operation), (0.0, AxisMode::Off as u32));
            assert_ne!(command.axes[0].flags & control_flag::DISARMED, 0);
        }
        axis.enable(mode);
        axis.asks(50, mode, command, Some(0.9));
        assert!(axis.axis.plant.position != 0.6, "{mode:?} moves once it is enabled");
    }
}

#[test]
fn an_edge_counts_only_within_a_session_and_between_messages_in_a_row() {
    // Another program has another number, in its first message or in a later one.
    let mut axis = Operated::new();
    for (session, number) in [(2, 0), (3, 100)] {
        axis.asks(5, AxisMode::Manual, 0.5, None);
        (axis.session, axis.number) = (session, number);
        axis.enable += 1;
        axis.asks(30, AxisMode::Manual, 0.5, None);
        assert!(axis.is_off());
    }
    // After a pause that is longer than the time-out there is no edge either.
    axis.axis.run(12, None);
    axis.enable += 1;
    axis.asks(30, AxisMode::Manual, 0.5, None);
    assert!(axis.is_off());
    // The edge of a message that is refused is lost.
    axis.enable += 1;
    axis.ask(AxisMode::Manual, f64::NAN, None);
    axis.asks(30, AxisMode::Manual, 0.5, None);
    assert!(axis.is_off());
    axis.enable += 1;
    axis.asks(30, AxisMode::Manual, 0.5, None);
    assert!(!axis.is_off());
}

#[test]
fn an_old_message_does_not_move_the_axis_however_often_it_comes() {
    let mut axis = Operated::new();
    axis.ask(AxisMode::Manual, 0.5, None);
    let before = axis.request(AxisMode::Manual, 0.5, None);
    axis.enable = 1;
    let mut edge = axis.request(AxisMode::Manual, 0.5, None);
    axis.axis.run(11, None);
    for k in 0..100 {
        let old = if k % 2 == 0 { before } else { edge };
        axis.axis.controller.ask(&old);
        assert_eq!(axis.axis.tick(None).axes[0].command, 0.0);
    }
    // A message from the future does not move it either.
    edge.header.sequence += 1000;
    edge.header.number += 10;
    axis.axis.controller.ask(&edge);
    axis.axis.run(30, None);
    assert!(axis.is_off());
}

#[test]
fn a_controller_that_is_restarted_is_off() {
    let mut axis = Operated::new();
    axis.enable(AxisMode::Manual);
    axis.asks(50, AxisMode::Manual, 0.3, None);
    axis.axis.controller = Controller::new(&machine(1)).unwrap();
    for command in axis.asks(100, AxisMode::Manual, 0.3, None) {
        assert_eq!(command.axes[0].command, 0.0);
    }
    assert!(axis.is_off());
    axis.enable(AxisMode::Manual);
    assert!(axis.ask(AxisMode::Manual, 0.3, None).axes[0].command > 0.0);
}

#[test]
fn a_direct_mode_commands_within_the_limits_and_stops_with_its_program() {
    // The command of a commissioning is neutral after `feedback_timeout`, three periods; both modes are off after 0.1
    // s.
    for (mode, lasts, who) in
        [(AxisMode::Manual, 10, ControlMode::Manual), (AxisMode::Commission, 3, ControlMode::Commission)]
    {
        let mut axis = Operated::new();
        axis.enable(mode);
        let commands = axis.asks(20, mode, 0.3, None);
        let expected = [0.1, 0.2, 0.3, 0.3];
        for (command, expected) in commands.iter().zip(expected) {
            assert!((command.axes[0].command - expected).abs() < 1e-12, "{}", command.axes[0].command);
            assert_eq!((command.axes[0].mode, command.axes[0].flags), (who as u32, 0));
        }
        // The last message was made from the sample before the last.
        let after = axis.axis.run(30, None);
        let first = |is: fn(&&ValveCommand) -> bool| after.iter().take_while(|command| !is(command)).count();
        assert_eq!(first(|command| command.axes[0].command == 0.0), lasts - 1, "{mode:?}");
        assert_eq!(first(|command| command.axes[0].operation == AxisMode::Off as u32), 9, "{mode:?}");
        assert_ne!(after[29].axes[0].flags & control_flag::REQUEST_STOPPED, 0);
        // Requests that come again do not move the axis.
        assert!(axis.asks(50, mode, 0.3, None).iter().all(|command| command.axes[0].command == 0.0));
        axis.enable(mode);
    }
}

#[test]
fn with_hold_to_run_every_mode_ends_with_its_program() {
    let mut ruled = machine(1);
    ruled.axes[0].control.hold_to_run = true;
    for mode in [AxisMode::Hold, AxisMode::Track] {
        for (machine, asks, ends) in
            [(machine(1), false, false), (machine(1), true, true), (ruled.clone(), false, true)]
        {
            let mut axis = Operated::of(&machine);
            axis.hold_to_run = asks;
            axis.enable(mode);
            let before = axis.asks(100, mode, 0.0, None);
            assert!(before.iter().all(|command| command.axes[0].operation == mode as u32), "{mode:?} goes on");
            let after = axis.axis.run(30, None);
            let off = after.iter().position(|command| command.axes[0].operation == AxisMode::Off as u32);
            assert_eq!(off, ends.then_some(9), "{mode:?}, asked {asks}");
            if ends {
                assert_ne!(after[29].axes[0].flags & control_flag::REQUEST_STOPPED, 0);
                let again = axis.asks(50, mode, 0.0, None);
                assert!(again.iter().all(|command| command.axes[0].command == 0.0), "nothing arms it again");
            }
        }
    }
}

/// Somebody takes over to move another axis, and leaves again.
#[test]
fn a_program_that_asks_nothing_of_an_axis_does_not_take_hold_to_run_from_it() {
    let mut axis = Operated::new();
    axis.hold_to_run = true;
    axis.enable(AxisMode::Hold);
    (axis.session, axis.number, axis.hold_to_run) = (2, 0, false);
    for _ in 0..100 {
        let mut request = axis.request(AxisMode::Unchanged, 0.0, None);
        request.takes_over = 1;
        axis.axis.controller.ask(&request);
        assert_eq!(axis.tick().axes[0].operation, AxisMode::Hold as u32, "it goes on while somebody operates");
    }
    let after = axis.axis.run(30, None);
    assert_eq!(after.iter().position(|command| command.axes[0].operation == AxisMode::Off as u32), Some(9));
}

/// An axis that is armed by the start of the program alone has nobody who holds it.
#[test]
fn under_the_rule_an_axis_does_not_move_without_a_program() {
    let mut machine = machine_with(SINES, SINES);
    machine.axes[0].control.hold_to_run = true;
    let mut axis = Loop::new(&machine, 0.05);
    assert!(axis.run(300, None).iter().all(|command| command.axes[0].command == 0.0));
}

#[test]
fn a_stop_ends_a_mode_and_what_was_asked_before_it_arms_nothing() {
    let mut axis = Operated::new();
    axis.enable(AxisMode::Hold);
    axis.asks(50, AxisMode::Hold, 0.0, None);
    // A program that presses its lever in the moment of the stop has not seen it.
    axis.enable += 1;
    let late = axis.request(AxisMode::Hold, 0.0, None);
    axis.axis.controller.stop(Stop { axes: 1, emergency: false });
    axis.axis.controller.ask(&late);
    assert!((0..50).all(|_| axis.tick().axes[0].operation == AxisMode::Off as u32));
    axis.enable(AxisMode::Hold);
    assert_eq!(axis.ask(AxisMode::Hold, 0.0, None).axes[0].operation, AxisMode::Hold as u32, "asked after the stop");
    axis.axis.controller.stop(Stop { axes: 0, emergency: true });
    let command = axis.ask(AxisMode::Hold, 0.0, None);
    assert_eq!((command.cut_off, command.axes[0].command), (1, 0.0));
    axis.axis.controller.stop(Stop::ALL);
    assert_ne!(axis.tick().axes[0].flags & control_flag::EMERGENCY_STOP, 0, "a stop releases no latch");
}

/// A program that asks for off when it ends, or all the time, acknowledges no fault.
#[test]
fn an_emergency_stop_is_released_only_by_an_off_that_begins_after_it() {
    let is_kept =
        |command: ValveCommand| command.cut_off == 1 && command.axes[0].flags & control_flag::EMERGENCY_STOP != 0;
    let mut axis = Operated::new();
    axis.enable(AxisMode::Manual);
    axis.asks(20, AxisMode::Manual, 0.3, None);
    // An off that was on its way.
    let late = axis.request(AxisMode::Off, 0.0, None);
    axis.axis.controller.stop(Stop { axes: 0, emergency: true });
    axis.axis.controller.ask(&late);
    assert!((0..5).all(|_| is_kept(axis.tick())));
    assert!(axis.asks(20, AxisMode::Off, 0.0, None).into_iter().all(is_kept), "it has begun before the stop");
    axis.ask(AxisMode::Unchanged, 0.0, None);
    assert!(!is_kept(axis.ask(AxisMode::Off, 0.0, None)), "it has begun after the stop");
    axis.axis.controller.stop(Stop { axes: 0, emergency: true });
    assert!(axis.asks(20, AxisMode::Off, 0.0, None).into_iter().all(is_kept), "it goes on all the time");
    // Another program, whose first message counts for nothing.
    axis.session += 1;
    assert!(axis.asks(20, AxisMode::Off, 0.0, None).into_iter().all(is_kept));
}

#[test]
fn a_soft_limit_is_not_overrun_in_manual() {
    for (command, limit) in [(1.0, 1.284), (-1.0, 0.05)] {
        let mut axis = Operated::new();
        axis.enable(AxisMode::Manual);
        let mut farthest = 0.6;
        for sent in axis.asks(3000, AxisMode::Manual, command, None) {
            farthest = axis.axis.plant.position;
            assert!(sent.axes[0].command * command >= 0.0);
        }
        let beyond = (farthest - limit) * command;
        assert!((-0.02..=0.002).contains(&beyond), "{} mm", 1e3 * beyond);
        let sent = axis.ask(AxisMode::Manual, command, None).axes[0];
        assert_ne!(sent.flags & control_flag::SOFT_LIMIT, 0);
        // Commands away from the limit are free.
        let sent = axis.asks(5, AxisMode::Manual, -0.4 * command, None)[4].axes[0];
        assert_eq!((sent.command, sent.flags), (-0.4 * command, 0));
    }
}

#[test]
fn hold_goes_to_its_set_point_and_stays() {
    let mut axis = Operated::modelled();
    axis.enable(AxisMode::Hold);
    assert!(axis.asks(100, AxisMode::Hold, 0.0, None).iter().all(|command| command.axes[0].command == 0.0));
    let commands = axis.asks(800, AxisMode::Hold, 0.0, Some(0.9));
    let references: Vec<f64> = commands.iter().map(|command| command.axes[0].reference).collect();
    let fastest = references.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
    assert!(fastest <= 0.25 * 0.01 + 1e-12, "{fastest}");
    assert_eq!(references[799], 0.9);
    assert!((axis.axis.plant.position - 0.9).abs() < 1e-3, "{}", axis.axis.plant.position);
    // Hold goes on without requests.
    let after: Vec<_> = (0..300).map(|_| axis.tick().axes[0]).collect();
    assert_eq!((after[299].operation, after[299].mode), (AxisMode::Hold as u32, ControlMode::Model as u32));
    assert!((axis.axis.plant.position - 0.9).abs() < 1e-3);
}

#[test]
fn a_senseless_request_is_refused_counted_and_flagged_and_changes_nothing() {
    let mut axis = Operated::new();
    axis.enable(AxisMode::Hold);
    axis.asks(400, AxisMode::Hold, 0.0, Some(0.7));
    let wrong: [fn(&mut Request); 12] = [
        |request| request.axes[0].target = f64::NAN,
        |request| request.axes[0].target = f64::INFINITY,
        |request| request.axes[0].target = 1.2841,
        |request| request.axes[0].target = 0.0499,
        |request| request.axes[0].has_target = 2,
        |request| request.axes[0].command = f64::NAN,
        |request| request.axes[0].command = 1.01,
        |request| request.axes[0].mode = 6,
        |request| request.axes[0].mode = u32::MAX,
        |request| request.header.axis_count = 0,
        |request| request.header.axis_count = 9,
        |request| request.header.sequence -= 20,
    ];
    for (i, spoil) in wrong.into_iter().enumerate() {
        let mut request = axis.request(AxisMode::Manual, 0.5, Some(0.8));
        spoil(&mut request);
        axis.axis.controller.ask(&request);
        for _ in 0..3 {
            let command = axis.axis.tick(None).axes[0];
            assert_ne!(command.flags & control_flag::REQUEST, 0, "{i}");
            assert_eq!(command.refused_requests, i as u32 + 1);
            assert_eq!((command.operation, command.reference), (AxisMode::Hold as u32, 0.7), "{i}");
        }
        // A sound request is accepted again.
        let command = axis.ask(AxisMode::Hold, 0.0, Some(0.7)).axes[0];
        assert_eq!((command.flags & control_flag::REQUEST, command.refused_requests), (0, i as u32 + 1));
    }
}

#[test]
fn off_is_neutral_at_once_and_lasts_until_an_enable() {
    for mode in [AxisMode::Manual, AxisMode::Hold, AxisMode::Track, AxisMode::Commission] {
        let mut axis = Operated::new();
        axis.enable(mode);
        axis.asks(60, mode, 0.3, Some(0.9));
        assert_eq!(axis.ask(AxisMode::Off, 0.0, None).axes[0].command, 0.0);
        assert!(axis.is_off());
        assert!(axis.asks(60, mode, 0.3, Some(0.9)).iter().all(|command| command.axes[0].command == 0.0));
    }
}

#[test]
fn a_fault_latches_in_every_mode_until_off_and_an_enable() {
    for mode in [AxisMode::Manual, AxisMode::Hold, AxisMode::Track, AxisMode::Commission] {
        let mut axis = Operated::new();
        axis.enable(mode);
        axis.asks(60, mode, 0.3, Some(0.9));
        axis.axis.controller.feedback_lost();
        // Neither more requests nor an edge alone release the latch.
        axis.asks(30, mode, 0.3, None);
        axis.enable += 1;
        for command in axis.asks(60, mode, 0.3, None) {
            assert_eq!(command.axes[0].command, 0.0);
            assert_ne!(command.axes[0].flags & control_flag::FEEDBACK, 0);
        }
        axis.ask(AxisMode::Off, 0.0, None);
        assert!(axis.is_off());
        axis.enable(mode);
    }
}

#[test]
fn armed_axes_track_and_take_requests() {
    let mut axis = Operated::modelled();
    axis.axis.controller.arm();
    assert_eq!((0..50).map(|_| axis.tick().axes[0].operation).max(), Some(AxisMode::Track as u32));
    axis.ask(AxisMode::Hold, 0.0, Some(0.8));
    (0..600).for_each(|_| _ = axis.tick());
    assert!((axis.axis.plant.position - 0.8).abs() < 1e-3);
}

#[test]
fn a_request_for_no_change_does_not_change_the_commands() {
    let mut plain = Loop::new(&machine(1), 0.05);
    let mut asked = Operated::new();
    asked.axis.controller.arm();
    for (one, other) in plain.run(600, None).iter().zip(asked.asks(600, AxisMode::Unchanged, 0.0, None)) {
        assert_eq!(one.axes[0].command.to_bits(), other.axes[0].command.to_bits());
    }
}

/// After a motion in manual the axis comes to a stand where its reference does.
#[test]
fn a_motion_in_manual_is_braked_by_the_next_mode() {
    for (next, command) in [(AxisMode::Hold, 0.4), (AxisMode::Track, -0.4)] {
        let mut axis = Operated::of(&machine_with(SINES, "kind = \"hold\"\n"));
        axis.enable(AxisMode::Manual);
        let last = axis.asks(80, AxisMode::Manual, command, None)[79].axes[0].command;
        let from = axis.axis.plant.position;
        let commands = axis.asks(400, next, 0.0, None);
        assert!((commands[0].axes[0].command - last).abs() <= BUMP, "{} after {last}", commands[0].axes[0].command);
        let errors = commands.iter().map(|command| command.axes[0].error.abs()).fold(0.0, f64::max);
        assert!(errors < 0.02, "{errors} m behind");
        let way = (axis.axis.plant.position - from) * command.signum();
        assert!((0.02..0.15).contains(&way), "{way} m");
        assert_eq!(commands[399].axes[0].command, 0.0);
    }
}

/// A Smith predictor foresees the position from the commands of all modes. One that had not seen a motion in manual
/// would brake the axis late and by too much.
#[test]
fn a_smith_predictor_has_seen_the_motion_in_manual() {
    let mut machine = machine_with(SINES, "kind = \"hold\"\n");
    let axis = &mut machine.axes[0];
    // The plant of `modelled`, which has no dead band.
    commission_without_dead_band(axis, [0.06, 0.6]);
    axis.control.law = Law::Smith(SmithSettings { kp: 12.0, ki: 0.0, observer_time: 0.1 });
    let mut operated = Operated { model: Some(actuator()), ..Operated::of(&machine) };
    operated.axis.plant = super::plant::Actuator::new(0.3, 0.0);
    operated.enable(AxisMode::Hold);
    operated.asks(100, AxisMode::Hold, 0.0, None);
    operated.asks(150, AxisMode::Manual, 0.5, None);
    let commands = operated.asks(400, AxisMode::Hold, 0.0, None);
    let by_model = commands.iter().filter(|command| command.axes[0].mode == ControlMode::Model as u32).count();
    let errors = commands.iter().map(|command| command.axes[0].error.abs()).fold(0.0, f64::max);
    assert!(by_model > 200 && errors < 0.02, "{by_model} ticks by the model, {errors} m behind");
}

proptest! {
    /// Modes in any order, at any time, with a model and without one.
    #[test]
    fn no_change_of_mode_makes_the_command_jump(
        steps in prop::collection::vec((1u32..6, -1.0f64..1.0, prop::option::of(0.05f64..1.284), 1usize..150), 1..12),
        by_model: bool,
    ) {
        let mut axis = if by_model { Operated::modelled() } else { Operated::new() };
        axis.enable(AxisMode::Hold);
        let (mut last, mut before, mut has_commissioned) = (0.0, AxisMode::Hold, false);
        for (mode, command, target, ticks) in steps {
            let mode = AxisMode::from_number(mode).unwrap();
            if axis.is_off() && mode != AxisMode::Off {
                axis.enable(mode);
                (last, before) = (0.0, mode);
            }
            has_commissioned &= before == AxisMode::Commission;
            for k in 0..ticks {
                let sent = axis.ask(mode, command, target).axes[0];
                let step = (sent.command - last).abs();
                prop_assert!(sent.command.is_finite() && sent.command.abs() <= 1.0);
                // A command may change to neutral at once, and near a soft limit.
                let stops = sent.command == 0.0 || sent.flags & control_flag::SOFT_LIMIT != 0;
                // The other direction of a commissioning begins at neutral, but not that of the mode before it.
                let turns = has_commissioned && mode == AxisMode::Commission && sent.command.abs() <= RATE;
                has_commissioned = mode == AxisMode::Commission && (has_commissioned || sent.command * command >= 0.0);
                prop_assert!(step <= RATE || stops || turns, "{before:?} to {mode:?}: {step}");
                let (to, from) = (mode as u32, before);
                if k == 0 && to != from as u32 && !mode.is_direct() && mode != AxisMode::Off && !stops {
                    // Where an error was there before, the controller may use its whole rate.
                    let bound = if from.is_direct() { BUMP } else { RATE };
                    prop_assert!(step <= bound, "{from:?} to {mode:?}: {step} at an error of {}", sent.error);
                }
                last = sent.command;
            }
            before = mode;
        }
    }
}

#[test]
fn every_axis_has_a_mode_of_its_own() {
    let mut controller = Controller::new(&machine(2)).unwrap();
    let ask = |k: u64, enable| {
        let mut request = Request { session: 1, ..Request::default() };
        (request.header.sequence, request.header.number, request.header.axis_count) = (k, k, 2);
        request.axes[1] = AxisRequest { mode: AxisMode::Manual as u32, enable, command: 0.3, ..AxisRequest::default() };
        request
    };
    for k in 0..60 {
        controller.ask(&ask(k, u32::from(k > 1)));
        // The second axis moves by one count of its encoder.
        let command = controller.update(&sample(k, &[0.6, 0.6 + 1e-4 * k as f64]), None, None);
        assert_eq!((command.axes[0].command, command.axes[0].operation), (0.0, AxisMode::Off as u32));
        assert_eq!(command.axes[1].command != 0.0, k >= 22, "{k}");
    }
}
