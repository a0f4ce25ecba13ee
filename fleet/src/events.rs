//! What happens to a machine: changes of modes and flags of the axes, of the stages, and of who operates.
//!
//! Changes are found in every command that the group sends, not in those that are published. So a flag that stood for
//! one tick is told as well.

use pipeline::{
    message::{AxisMode, MachineState, StageHealth, StageState, ValveCommand, bit_names, control_flag},
    stage::StageKind,
};
use serde::Serialize;

/// Flags that come and go while an axis works well; their changes are no events.
const ORDINARY: u32 = control_flag::SETTLING | control_flag::SOFT_LIMIT | control_flag::SLOWED | control_flag::WALL;

/// One event.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Event {
    /// When it happened, ns since 1970 by the clock of the machine.
    pub utc_ns: i64,
    /// The axis; none for the whole group.
    pub axis: Option<String>,
    /// What has changed: `latch`, `flags`, `mode`, `operator`, `stage`, `lost`, `group`.
    pub kind: &'static str,
    /// From what to what.
    pub text: String,
}

/// Finds the events of a group.
#[derive(Default)]
pub struct Events {
    names: Vec<String>,
    command: Option<Box<ValveCommand>>,
    stages: [Option<(u32, u32, u64)>; 4],
}

impl Events {
    /// Takes the names of the axes.
    pub fn state(&mut self, state: &MachineState) {
        let count = (state.header.axis_count as usize).min(state.axes.len());
        self.names = state.axes[..count].iter().map(|axis| axis.name().to_owned()).collect();
    }

    /// Looks at a command, which was made at this time.
    pub fn command(&mut self, command: &ValveCommand, utc_ns: i64, mut tell: impl FnMut(Event)) {
        let before = self.command.replace(Box::new(*command));
        // The first command says how things are, and nothing has happened yet.
        let Some(before) = before else { return };
        if before.operator != command.operator {
            let text = format!("session {} operates, after {}", command.operator, before.operator);
            tell(Event { utc_ns, axis: None, kind: "operator", text });
        }
        let count = (command.header.axis_count as usize).min(command.axes.len());
        for (i, (before, now)) in before.axes.iter().zip(&command.axes).enumerate().take(count) {
            let axis = Some(self.names.get(i).cloned().unwrap_or_else(|| format!("{i}")));
            let mut tell = |kind, text| tell(Event { utc_ns, axis: axis.clone(), kind, text });
            if now.latches > before.latches {
                tell("latch", flags(now.latched_by));
            }
            if (before.flags ^ now.flags) & !ORDINARY != 0 {
                tell("flags", format!("{}, after {}", flags(now.flags), flags(before.flags)));
            }
            if before.operation != now.operation {
                tell("mode", format!("{}, after {}", mode(now.operation), mode(before.operation)));
            }
        }
    }

    /// Looks at a heartbeat, which was sent at this time.
    pub fn health(&mut self, health: &StageHealth, utc_ns: i64, mut tell: impl FnMut(Event)) {
        let Some(place) = self.stages.get_mut(health.stage as usize) else { return };
        let name = StageKind::ALL[health.stage as usize].name();
        let before = place.replace((health.pid, health.state, health.lost()));
        let Some((pid, state, lost)) = before else { return };
        let mut tell = |kind, text| tell(Event { utc_ns, axis: None, kind, text });
        if pid != health.pid {
            tell("stage", format!("{name}: process {} took the place of process {pid}", health.pid));
        } else if state != health.state {
            tell("stage", format!("{name}: {}, after {}", StageState::name(health.state), StageState::name(state)));
        }
        if pid == health.pid && health.lost() > lost {
            tell("lost", format!("{name}: {} messages", health.lost() - lost));
        }
    }
}

fn flags(bits: u32) -> String {
    let names: Vec<&str> = bit_names(bits, &control_flag::NAMES).collect();
    if names.is_empty() { "none".to_owned() } else { names.join(" ") }
}

/// Mode and flags of an axis in words.
pub fn in_words(bits: u32, operation: u32) -> String {
    let mode = mode(operation);
    if bits == 0 { mode.to_owned() } else { format!("{mode} ({})", flags(bits)) }
}

fn mode(number: u32) -> &'static str {
    AxisMode::from_number(number).map_or("unknown", AxisMode::name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(events: &mut Events, command: &ValveCommand) -> Vec<(Option<String>, &'static str, String)> {
        let mut told = Vec::new();
        events.command(command, 7, |event| told.push((event.axis, event.kind, event.text)));
        told
    }

    #[test]
    fn each_change_of_an_axis_is_told_once() {
        let mut events = Events::default();
        let mut state = MachineState::default();
        state.header.axis_count = 2;
        state.axes[1].set_name("arm");
        events.state(&state);
        let mut command = ValveCommand::default();
        command.header.axis_count = 2;
        command.axes[1].flags = control_flag::DISARMED;
        command.axes[1].operation = AxisMode::Off as u32;
        assert_eq!(told(&mut events, &command), []);
        assert_eq!(told(&mut events, &command), []);
        (command.axes[1].flags, command.axes[1].operation) = (control_flag::SETTLING, AxisMode::Track as u32);
        let arm = Some("arm".to_owned());
        assert_eq!(
            told(&mut events, &command),
            [
                (arm.clone(), "flags", "settling, after disarmed".to_owned()),
                (arm.clone(), "mode", "track, after off".to_owned())
            ]
        );
        command.axes[1].flags = 0;
        assert_eq!(told(&mut events, &command), []);
        (command.axes[1].flags, command.axes[1].latches) = (control_flag::STALL, 1);
        (command.axes[1].latched_by, command.operator) = (control_flag::STALL, 5);
        let kinds: Vec<&str> = told(&mut events, &command).into_iter().map(|(_, kind, _)| kind).collect();
        assert_eq!(kinds, ["operator", "latch", "flags"]);
        // Beyond the number of axes there is nothing.
        command.axes[2].flags = control_flag::STALL;
        assert_eq!(told(&mut events, &command), []);
    }

    #[test]
    fn a_stage_that_starts_again_or_loses_messages_is_told() {
        let mut events = Events::default();
        let mut health = StageHealth { stage: 2, pid: 7, channel_count: 1, state: 2, ..StageHealth::default() };
        let mut told = |health: &StageHealth| {
            let mut told = Vec::new();
            events.health(health, 0, |event| told.push(event.text));
            told
        };
        assert!(told(&health).is_empty());
        health.channels[0].lost = 3;
        assert_eq!(told(&health), ["ident-proc: 3 messages"]);
        health.state = 3;
        assert_eq!(told(&health), ["ident-proc: stopped, after running"]);
        (health.pid, health.channels[0].lost) = (8, 9);
        assert_eq!(told(&health), ["ident-proc: process 8 took the place of process 7"]);
        health.stage = 9;
        assert!(told(&health).is_empty());
    }
}
