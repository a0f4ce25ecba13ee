//! The drive that feeds the valves: it holds the last command, and goes neutral when commands stop.
//!
//! Without a command for `timing.drive_timeout` of model time the drive commands neutral by itself, because a
//! controller that died must not leave a valve open. The next command revives the drive.

use pipeline::message::ValveCommand;

/// The drive of all axes.
#[derive(Debug, Clone)]
pub struct Drive {
    /// Commands that the drive holds, in [-1, 1].
    commands: Vec<f64>,
    /// Whether the pilot pressure is cut off.
    cut_off: bool,
    /// Model time at which the drive goes neutral, ns.
    ends_ns: u64,
    timeout_ns: u64,
}

impl Drive {
    /// A neutral drive of `axes` axes whose time-out has passed.
    pub fn new(axes: usize, timeout_ns: u64) -> Self {
        Self { commands: vec![0.0; axes], cut_off: false, ends_ns: 0, timeout_ns }
    }

    /// Takes the commands of all axes at the model time `now_ns`. A command that is not finite becomes neutral, one
    /// outside [-1, 1] is clamped. All are neutral while the pilot pressure is cut off.
    pub fn command(&mut self, command: &ValveCommand, now_ns: u64) {
        self.cut_off = command.cut_off != 0;
        for (held, axis) in self.commands.iter_mut().zip(&command.axes) {
            let is_command = axis.command.is_finite() && !self.cut_off;
            *held = if is_command { axis.command.clamp(-1.0, 1.0) } else { 0.0 };
        }
        self.ends_ns = now_ns.saturating_add(self.timeout_ns);
    }

    /// Time from `now_ns` until the drive goes neutral, ns; 0 when that time has passed.
    pub fn remaining_ns(&self, now_ns: u64) -> u64 {
        self.ends_ns.saturating_sub(now_ns)
    }

    /// Goes neutral after the time-out. A pilot pressure that is cut off stays cut off.
    pub fn go_neutral(&mut self) {
        self.commands.fill(0.0);
    }

    /// Commands that the drive holds, one for each axis, in [-1, 1].
    pub fn commands(&self) -> &[f64] {
        &self.commands
    }

    /// Whether the pilot pressure is cut off.
    pub fn is_cut_off(&self) -> bool {
        self.cut_off
    }
}
