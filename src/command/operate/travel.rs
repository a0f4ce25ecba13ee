//! How far an axis has moved under a manual command, and whether that shows a wrong sign of valve or encoder.
//!
//! Only motion while the valve has been open for a while shows a sign. A limit or a slow start keeps the command that
//! is sent smaller than the one that was asked for. Behind a shut valve an axis swings and leaks, and behind one that
//! has just opened it still does what was commanded before.

use pipeline::message::{AxisCommand, control_flag};

/// Least travel that counts as motion, m.
const MOVED: f64 = 1e-3;
/// Travel against the command beyond which no swing of the load explains it, m.
const SWING: f64 = 5e-3;
/// How far a command is beyond the dead band of a valve that is surely open.
const OPEN: f64 = 0.05;
/// Time for which it has been open before motion counts, ns: a pilot-operated valve reacts within 0.3 s, and a load of
/// 1 Hz has swung back by then.
const OPEN_NS: u64 = 700_000_000;

/// The travel of one axis under a command.
#[derive(Debug, Default)]
pub struct Travel {
    /// First and last usable position, m.
    ends: Option<(f64, f64)>,
    /// Travel while the valve was open for extending, and for retracting, m.
    driven: [f64; 2],
    /// Since when it is open for extending, and for retracting, ns.
    open_since: [Option<u64>; 2],
    /// What has made a command smaller than the one that was asked for.
    held_by: Option<&'static str>,
}

impl Travel {
    /// Takes in a position (m) at a time (ns), if it is usable, and the command that was sent for it. `dead_band`:
    /// while extending and retracting, as magnitudes.
    pub fn update(&mut self, (now, position): (u64, Option<f64>), sent: &AxisCommand, dead_band: [f64; 2]) {
        let holds = [(control_flag::WALL, "a virtual wall"), (control_flag::SOFT_LIMIT, "a soft limit")];
        let by = holds.iter().find(|(flag, _)| sent.flags & flag != 0).map(|(_, by)| *by);
        self.held_by = by.or(self.held_by);
        let sent = sent.command;
        let is_open = |direction: usize| {
            let along = if direction == 0 { sent } else { -sent };
            along >= dead_band[direction] + OPEN
        };
        self.open_since = [0, 1].map(|i| is_open(i).then(|| self.open_since[i].unwrap_or(now)));
        let Some(position) = position else { return };
        let (first, last) = self.ends.unwrap_or((position, position));
        self.ends = Some((first, position));
        for (driven, since) in self.driven.iter_mut().zip(self.open_since) {
            if since.is_some_and(|since| now.saturating_sub(since) >= OPEN_NS) {
                *driven += position - last;
            }
        }
    }

    /// The travel in words.
    ///
    /// # Errors
    /// The axis has moved against the command that was asked for.
    pub fn judged(&self, command: f64) -> Result<String, String> {
        let moved = self.ends.map_or(0.0, |(first, last)| last - first);
        let text = |moved: f64| format!("moved {:+.1} mm under the command {command:+}", 1e3 * moved);
        let driven = self.driven[usize::from(command < 0.0)];
        if driven * command < 0.0 && driven.abs() > SWING {
            Err(format!("{}; allowed: the same direction: are valve and encoder of the same sign?", text(driven)))
        } else if moved.abs() < MOVED && command != 0.0 {
            Ok(match self.held_by {
                Some(by) => format!("{}: {by} held it back", text(moved)),
                None => format!("{}: the command may be within the dead band of the valve", text(moved)),
            })
        } else {
            Ok(text(moved))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is said of an axis at these positions (mm), a second apart, with these commands sent, where `command` was
    /// asked for.
    fn judged(command: f64, ticks: &[(f64, f64)]) -> Result<String, String> {
        let mut travel = Travel::default();
        for (second, (position, sent)) in (0..).zip(ticks) {
            let sent = AxisCommand { command: *sent, ..AxisCommand::default() };
            travel.update((1_000_000_000 * second, Some(1e-3 * position)), &sent, [0.1, 0.1]);
        }
        travel.judged(command)
    }

    #[test]
    fn a_swing_or_a_leak_behind_a_shut_valve_is_no_wrong_sign() {
        let held = judged(-1.0, &[(500.0, 0.0), (501.3, -0.02), (520.0, -0.1)]);
        assert_eq!(held.unwrap(), "moved +20.0 mm under the command -1");
        let swings = judged(-1.0, &[(500.0, -0.3), (501.3, -0.3)]);
        assert_eq!(swings.unwrap(), "moved +1.3 mm under the command -1");
        let stands = judged(0.05, &[(500.0, 0.05), (500.4, 0.05)]);
        assert!(stands.unwrap().ends_with("the command may be within the dead band of the valve"));
        // The load still swings from the last command, against which the valve has just opened.
        let swings_on = judged(1.0, &[(500.0, -0.6), (500.0, 0.6), (480.0, -0.6), (480.0, 0.6), (460.0, 0.0)]);
        assert_eq!(swings_on.unwrap(), "moved -40.0 mm under the command +1");
    }

    #[test]
    fn what_held_an_axis_back_is_named() {
        let said = |flags: u32| {
            let mut travel = Travel::default();
            for second in 0..3 {
                let sent = AxisCommand { flags, ..AxisCommand::default() };
                travel.update((1_000_000_000 * second, Some(0.5)), &sent, [0.1, 0.1]);
            }
            travel.judged(1.0).unwrap()
        };
        assert_eq!(said(control_flag::WALL), "moved +0.0 mm under the command +1: a virtual wall held it back");
        assert_eq!(said(control_flag::SOFT_LIMIT), "moved +0.0 mm under the command +1: a soft limit held it back");
    }

    #[test]
    fn a_motion_against_the_command_through_an_open_valve_is_a_wrong_sign() {
        let backwards = judged(0.2, &[(500.0, 0.2), (480.0, 0.2)]).unwrap_err();
        assert!(backwards.starts_with("moved -20.0 mm under the command +0.2; allowed: the same"), "{backwards}");
        let until_a_wall = judged(-0.5, &[(500.0, -0.5), (540.0, -0.5), (539.0, 0.0)]);
        assert!(until_a_wall.is_err());
    }
}
