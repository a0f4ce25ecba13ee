//! Finds the events of a recording: with causes and limits where the machine is known, else by their names.

use pipeline::{
    MAX_AXES,
    channel::Prefix,
    machine::Machine,
    message::{AxisCommand, ControlMode, EncoderSample, StageHealth, ValveCommand, bit_names, control_flag},
    stage::StageKind,
};

use crate::report::events::{Event, Events, LATCH, RESTART};

/// Events that are kept.
const MOST: usize = 1000;

/// The events of a recording, in the order of time.
#[derive(Debug, Default)]
pub struct Found {
    pub list: Vec<Event>,
    /// Events that were too many for the list.
    pub left_out: u64,
}

impl Found {
    fn add(&mut self, event: Event) {
        if self.list.len() < MOST {
            self.list.push(event);
        } else {
            self.left_out += 1;
        }
    }

    fn add_new(&mut self, t: f64, axis: Option<&str>, kind: &'static str, text: String, is_fault: bool) {
        let (axis, next) = (axis.map(str::to_owned), String::new());
        self.add(Event { time_s: t, axis, kind, text, next, is_fault, more: 0 });
    }
}

/// Finds events.
pub struct Watch {
    found: Found,
    /// None where the machine is not known.
    events: Option<Box<Events>>,
    /// Latching faults and commander of each axis in the last command.
    seen: [Option<(u32, u32)>; MAX_AXES],
}

impl Watch {
    /// For a recording of this group, with the machine if it is known.
    pub fn new(machine: Option<&Machine>, group: &str) -> Self {
        let prefix = group.parse::<Prefix>().unwrap_or_else(|_| Prefix::of_this_process());
        let events = machine.map(|machine| Box::new(Events::new(machine, &prefix)));
        Self { found: Found::default(), events, seen: [None; MAX_AXES] }
    }

    /// Looks at a command of `t` s for the axes with these names.
    pub fn command<'a>(
        &mut self,
        t: f64,
        command: &ValveCommand,
        sample: Option<&EncoderSample>,
        names: impl Iterator<Item = &'a str>,
    ) {
        match &mut self.events {
            Some(events) => events.command(command, sample),
            None => names.enumerate().for_each(|(i, name)| self.axis(t, i, name, &command.axes[i])),
        }
        self.take(t);
    }

    /// Looks at a heartbeat; `before` is the last one of another process of the same stage.
    pub fn health(&mut self, t: f64, health: &StageHealth, before: Option<&StageHealth>) {
        if let Some(events) = &mut self.events {
            events.health(health);
            self.take(t);
        }
        if let Some(before) = before {
            let name = StageKind::ALL.get(health.stage as usize).map_or("?", |kind| kind.name());
            let text = format!("{name}: process {} took the place of process {}", health.pid, before.pid);
            self.found.add_new(t, None, RESTART, text, true);
        }
    }

    /// Takes over what is new, with the time of the recording.
    fn take(&mut self, t: f64) {
        let Some(events) = &mut self.events else { return };
        for event in events.news() {
            self.found.add(Event { time_s: t, ..event.clone() });
        }
    }

    fn axis(&mut self, t: f64, index: usize, name: &str, axis: &AxisCommand) {
        let latched = axis.flags & control_flag::LATCHED;
        let (before, mode) = self.seen[index].replace((latched, axis.mode)).unwrap_or((0, axis.mode));
        let came = latched & !before;
        if came != 0 {
            let faults: Vec<&str> = bit_names(came, &control_flag::NAMES).collect();
            self.found.add_new(t, Some(name), LATCH, faults.join(", "), true);
        }
        if axis.mode != mode {
            let text = format!("{}, after {}", ControlMode::name(axis.mode), ControlMode::name(mode));
            self.found.add_new(t, Some(name), "controller", text, false);
        }
    }

    /// All events.
    pub fn finish(mut self) -> Found {
        self.found.left_out += self.events.map_or(0, |events| events.left_out());
        self.found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_machine_events_have_the_names_of_their_flags() {
        let mut watch = Watch::new(None, "no group name!");
        let mut command = ValveCommand::default();
        watch.command(0.0, &command, None, ["boom", "arm"].into_iter());
        (command.axes[1].flags, command.axes[1].mode) = (control_flag::STALL, ControlMode::Manual as u32);
        watch.command(1.5, &command, None, ["boom", "arm"].into_iter());
        watch.command(1.6, &command, None, ["boom", "arm"].into_iter());
        let health = StageHealth { stage: 1, pid: 8, ..StageHealth::default() };
        watch.health(2.0, &health, Some(&StageHealth { pid: 7, ..health }));
        let lines: Vec<String> = watch.finish().list.iter().map(Event::line).collect();
        let expected = [
            "1.500 s axis.arm: latch: stall",
            "1.500 s axis.arm: controller: manual, after neutral",
            "2.000 s restart: sensor-proc: process 8 took the place of process 7",
        ];
        assert_eq!(lines, expected);
    }

    #[test]
    fn events_of_a_known_machine_have_the_time_of_the_recording() {
        let machine = Machine::load(None, &[]).unwrap();
        let mut watch = Watch::new(Some(&machine), "demo");
        let mut command = ValveCommand::default();
        command.header.sequence = 1_000_000;
        watch.command(0.0, &command, None, std::iter::empty());
        command.axes[0].flags = control_flag::STALL;
        (command.axes[0].latched_by, command.axes[0].latches) = (control_flag::STALL, 1);
        watch.command(0.25, &command, None, std::iter::empty());
        let list = watch.finish().list;
        assert_eq!((list[0].kind, list[0].time_s), (LATCH, 0.25));
        assert!(list[0].next.contains("hydraxis reset --prefix demo --axis boom"), "{}", list[0].next);
    }
}
