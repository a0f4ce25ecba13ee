//! The arguments of `hydraxis operate`, `arm`, `disarm` and `reset`.

use std::time::Duration;

use clap::{Args, ValueEnum};
use pipeline::{channel::Prefix, message::AxisMode};

use crate::{
    arguments::values::{duration, in_unit, place, position, teeth_speed, valve_command},
    teeth::PITCHES,
};

/// The axes of a running group.
#[derive(Debug, Args)]
pub struct GroupAxes {
    /// Name of the group [default: the only group that runs]
    #[arg(long)]
    pub prefix: Option<Prefix>,
    /// Only this axis; may be given several times [default: all axes]
    #[arg(long = "axis", value_name = "NAME")]
    pub axes: Vec<String>,
    /// Take the place of a program that operates the group now: its requests have no effect any more
    #[arg(long)]
    pub take_over: bool,
}

/// `operate`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis run --prefix demo --off --duration 10min     a machine with all axes disarmed; then, in another terminal:
  hydraxis operate --prefix demo --axis boom --mode manual --command 0.2 --enable
  hydraxis operate --prefix demo --axis boom --mode hold --target 800mm --enable
  hydraxis operate --prefix demo --mode hold --leave    all axes stop, and hold the positions at which they stop
  hydraxis operate --prefix demo --mode off
  hydraxis operate --prefix demo --tip 6.2,-0.5 --pitch -100 --enable    the teeth go there in a straight line
  planner | hydraxis operate --prefix demo --tip - --enable    to the places that a program writes, one after the other
  hydraxis operate --prefix demo --take-over --mode hold --enable    although another program operates the group

Modes:
  off     disarmed: neutral at once. Also resets a latched fault. The axis moves again only with --enable
  manual  --command goes to the valve, limited in magnitude and rate, and slower the nearer a soft limit is
  hold    moves to --target, bounded in speed, acceleration and jerk, and stays there
  track   follows its reference: the generator of the machine file, or the reference channel

--tip moves boom, arm and bucket together, in mode track, where all four axes have reference.kind = \"channel\". The
telescope stays where it is. A place that the machine cannot reach is refused before anything is armed. The axes are off
as soon as this program dies or is suspended, as with --hold-to-run. With --leave or --duration the exit code is 1 where
the teeth end more than 30 mm from the place. Lines of `--tip -` are X,Z or X,Z,PITCH or X,Z,PITCH,SPEED.

A disarmed axis leaves `off` only with --enable, after a fault as well. A latch that --enable or `off` releases is shown
with its cause. An armed axis changes between the other modes without --enable. Ctrl-C disarms the axes. In manual, the
end of this program disarms them as well, within 0.1 s; an axis in hold or track goes on without this program, unless
--hold-to-run or the key control.hold_to_run ends it too. A group has one operator at a time; --take-over replaces it,
and the supervisor logs it. `hydraxis arm`, `disarm` and `reset` do the three usual operations with one command each,
for people and for scripts.")]
pub struct OperateArguments {
    /// Group and axes
    #[command(flatten)]
    pub group: GroupAxes,
    /// Mode that the axes change to
    #[arg(long, conflicts_with = "tip")]
    pub mode: Option<Mode>,
    /// Place to which the bucket's teeth go: forward of the centre of swing and above ground. With - places are read
    /// from standard input, one a line
    #[arg(long, value_name = "X,Z", value_parser = tip, allow_hyphen_values = true)]
    pub tip: Option<Tip>,
    /// Pitch of the bucket there, from the x axis to the teeth, in degrees; with --tip only [default: as it is]
    #[arg(long, value_name = "DEGREES", value_parser = pitch, allow_hyphen_values = true)]
    pub pitch: Option<f64>,
    /// Speed of the teeth; slower where an axis or the pump cannot follow [default: 0.1 m/s]
    #[arg(long, value_parser = teeth_speed, allow_hyphen_values = true)]
    pub speed: Option<f64>,
    /// Valve command in [-1, 1], positive extends; with --mode manual only
    #[arg(long, value_name = "U", value_parser = valve_command, allow_hyphen_values = true, conflicts_with = "tip")]
    pub command: Option<f64>,
    /// Position to hold, in m or with its unit, such as 300mm; with --mode hold only [default: where the axis stops]
    #[arg(long, value_name = "LENGTH", value_parser = position, allow_hyphen_values = true, conflicts_with = "tip")]
    pub target: Option<f64>,
    /// Arm the axes that are disarmed
    #[arg(long)]
    pub enable: bool,
    /// End as soon as the axes are in the mode, and leave them in it; with --mode hold and track only
    #[arg(long, conflicts_with = "duration")]
    pub leave: bool,
    /// Disarm the axes as well when this program dies or hangs, in every mode, within 0.1 s
    #[arg(long, conflicts_with = "leave")]
    pub hold_to_run: bool,
    /// Time in the mode, after which the axes are disarmed and the command ends [default: until Ctrl-C]
    #[arg(long, value_parser = duration, allow_hyphen_values = true)]
    pub duration: Option<Duration>,
}

/// `--tip`.
#[derive(Debug, Clone, Copy)]
pub enum Tip {
    /// To this place, m.
    Place([f64; 2]),
    /// To the places on standard input.
    Lines,
}

/// `--tip`.
fn tip(text: &str) -> Result<Tip, String> {
    if text == "-" { Ok(Tip::Lines) } else { place(text).map(Tip::Place) }
}

/// `--pitch`.
pub fn pitch(text: &str) -> Result<f64, String> {
    let degrees = in_unit(text, "degrees").filter(|degrees| PITCHES.contains(degrees));
    degrees.ok_or_else(|| "allowed: -360 to 360 degrees".to_owned())
}

impl OperateArguments {
    /// The mode that the axes change to.
    pub fn axis_mode(&self) -> AxisMode {
        self.mode.map_or(AxisMode::Track, AxisMode::from)
    }
}

/// `--mode`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Mode {
    /// Disarmed, valve neutral.
    Off,
    /// A valve command.
    Manual,
    /// A constant position.
    Hold,
    /// The reference.
    Track,
}

impl From<Mode> for AxisMode {
    fn from(mode: Mode) -> Self {
        match mode {
            Mode::Off => Self::Off,
            Mode::Manual => Self::Manual,
            Mode::Hold => Self::Hold,
            Mode::Track => Self::Track,
        }
    }
}

/// `arm`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis arm --prefix demo                            all axes follow their references, as with `run` without --off
  hydraxis arm --prefix demo --axis boom --mode hold    the boom holds its position

Arms the axes that are disarmed, waits until they are in the mode, and leaves them in it. The command refuses a latched
axis, which `hydraxis reset` releases, and an axis in another mode, which `hydraxis operate` changes; in both cases it
arms no axis. When an axis does not reach the mode, or at Ctrl-C, all axes that this command has armed are disarmed.")]
pub struct ArmArguments {
    /// Group and axes
    #[command(flatten)]
    pub group: GroupAxes,
    /// Mode that the axes change to
    #[arg(long, default_value = "track")]
    pub mode: ArmMode,
}

/// `--mode` of `arm`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ArmMode {
    /// Follow the reference.
    Track,
    /// Hold the present position.
    Hold,
}

impl From<ArmMode> for AxisMode {
    fn from(mode: ArmMode) -> Self {
        match mode {
            ArmMode::Track => Self::Track,
            ArmMode::Hold => Self::Hold,
        }
    }
}

/// `disarm`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis disarm                                  all axes of all groups of this user neutral, at once
  hydraxis disarm --prefix demo --axis bucket
  hydraxis disarm --emergency                      and latched, with the pilot pressure cut off

Works while another program operates the group, hangs, or has taken the last place on a channel, and with the memory
full: a stop has a path of its own. The axes move again only after `hydraxis arm` or `hydraxis operate --enable`, typed
after this command; one that was typed before it and suspended before it had looked at the group counts as typed after
it. A latched axis is neutral already and stays latched: `hydraxis reset` shows the fault and releases
the axis. This command is no emergency stop button, because it needs every program from here to the valve.")]
pub struct DisarmArguments {
    /// Name of the running group [default: all groups of this user]
    #[arg(long)]
    pub prefix: Option<Prefix>,
    /// Only this axis; may be given several times [default: all axes]
    #[arg(long = "axis", value_name = "NAME", requires = "prefix")]
    pub axes: Vec<String>,
    /// Latch all axes and cut off the pilot pressure, until `hydraxis reset`
    #[arg(long, conflicts_with = "axes")]
    pub emergency: bool,
}

/// `reset`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis reset --prefix demo                     shows which fault has latched which axis, and releases all axes
  hydraxis reset --prefix demo --axis boom

A fault latches an axis at neutral, so that it does not move again by itself while a person looks for the cause. Look
for the cause first. After a reset the axis is disarmed: it does not move before `hydraxis arm`. An axis that is not
latched keeps its mode.")]
pub struct ResetArguments {
    /// Group and axes
    #[command(flatten)]
    pub group: GroupAxes,
}
