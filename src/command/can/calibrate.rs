//! `hydraxis can calibrate`: direction, scale and zero of an axis' encoder, as lines of the machine file.
//!
//! ```text
//! at the cylinder   y = s r_l (n - z)            two marks (y1, n1), (y2, n2): s r_l = (y2 - y1) / (n2 - n1)
//! at a joint        q = q_0 + s r (n - z)        the mechanism gives q of y, and z is 0
//! ```
//!
//! n position of the encoder; y of the piston, m; q angle of the joint or of the body, rad; s 1, or -1 where the
//! encoder is reversed; z its zero. Nothing is written to the encoder.

use std::{
    fmt::Write as _,
    io::{self, BufRead},
    time::Duration,
};

use can::{
    bus::Bus,
    canopen::{NodeId, signed},
};
use clap::Args;
use mechanism::{AXES, Joint};
use pipeline::machine::{AngleKind, AngleSensor, Axis, Machine};
use thiserror::Error;

use super::{
    bus::{BusArguments, duration},
    dialogue::Dialogue,
};
use crate::{
    arguments::{
        axes,
        values::{allowed_in, in_unit, position},
    },
    failure::Failure,
    report::output::show,
};

/// `can calibrate`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis can calibrate machine.toml --axis boom                        direction: move the axis by hand
  hydraxis can calibrate machine.toml --axis boom --mark 0               zero: the axis is fully retracted
  hydraxis can calibrate machine.toml --axis boom --mark 0 --mark 0.85   direction, scale and zero by two positions
  hydraxis can calibrate machine.toml --axis arm --mark 0 --mark 1.0 --at boom=0.4
                                                    a sensor at a joint: the mechanism leads from position to angle

A mark is a position of the piston, m, measured with a ruler from the fully retracted end. Before each mark the command
waits until the axis is there and Enter was typed. Move the axis by the machine's own levers, at low pressure, nobody
near. The marks should be far apart: an error of 1 mm over 1 m is one of 0.1 % of the scale.

An inclinometer on arm or bucket measures from level: --at says where the pistons of the axes before it stand.

Prints the lines for the machine file. Nothing is written, not to the encoder either. Refused while a group has the
bus.")]
pub struct CalibrateArguments {
    #[command(flatten)]
    bus: BusArguments,
    /// The axis
    #[arg(long, value_name = "AXIS")]
    axis: String,
    /// A position of the piston, m, at which the encoder is read; none, one or two of them
    #[arg(long = "mark", value_name = "METRES", num_args = 1, value_parser = position, allow_hyphen_values = true)]
    marks: Vec<f64>,
    /// Where the piston of another axis stands, m; with an inclinometer on arm or bucket
    #[arg(long = "at", value_name = "AXIS=METRES", value_parser = place)]
    places: Vec<(String, f64)>,
    /// How long the motion by hand is watched, without marks
    #[arg(long, default_value = "10s", value_parser = duration)]
    duration: Duration,
    /// Longest time that the encoder may take to answer
    #[arg(long, default_value = "500ms", value_parser = duration)]
    answer: Duration,
}

fn place(text: &str) -> Result<(String, f64), String> {
    let parts = text.split_once('=').and_then(|(axis, metres)| Some((axis.to_owned(), in_unit(metres, "m")?)));
    parts.ok_or_else(|| format!("allowed: an axis and a position, such as boom=0.4: {}", allowed_in("m")))
}

/// Reads of the encoder at a mark, and the pause between them.
const READS: usize = 10;
const PAUSE: Duration = Duration::from_millis(20);
/// Most counts by which the position may change meanwhile.
const STILL: i64 = 3;
/// Fewest counts that are a motion.
const MOVED: i64 = 10;

/// Why an encoder cannot be calibrated.
#[derive(Debug, Error)]
enum CalibrationError {
    #[error("--mark: found {0} of them; allowed: none, one or two")]
    Marks(usize),
    #[error("--mark: found {found}; allowed: 0 to {stroke} m, the stroke of axis.{axis}")]
    Mark { found: f64, axis: String, stroke: f64 },
    #[error("--mark: found {0} and {1}; allowed: positions that are 1 mm apart, and better far more")]
    Close(f64, f64),
    #[error(
        "node {node}: the position changes by {counts} counts while it is read; allowed: an axis that stands still"
    )]
    Moving { node: u8, counts: i64 },
    #[error("node {node}: the position has changed by {counts} counts; allowed: a motion of {MOVED} counts or more")]
    Still { node: u8, counts: i64 },
    #[error(
        "--at: found no position of axis.{0}; allowed: --at {0}=METRES, because the inclinometer measures from level"
    )]
    Place(String),
    #[error("--at: found axis {0}; allowed: an axis of the machine")]
    NoAxis(String),
    #[error("--at: found a position, and axis.{0} has no inclinometer; allowed: with an inclinometer only")]
    NoInclinometer(String),
    #[error("axis.{0}: the linkage does not close at this position; allowed: positions that the mechanism reaches")]
    Open(String),
    #[error("standard input has ended; allowed: Enter at each mark")]
    Ended,
}

/// A position of the piston, m, and the encoder's there.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Mark {
    piston: f64,
    raw: i64,
}

/// Runs the command.
pub fn run(arguments: &CalibrateArguments) -> Result<(), Failure> {
    let named = arguments.bus.named()?;
    let machine =
        named.machine.as_ref().ok_or_else(|| Failure::usage("MACHINE.toml: found nothing; allowed: a file"))?;
    let chosen = axes(machine, std::slice::from_ref(&arguments.axis))?;
    let axis = &machine.axes[chosen[0]];
    check(arguments, machine, axis).map_err(Failure::usage)?;
    let mut bus = named.open()?;
    let mut encoder = RawEncoder::of(axis, &mut *bus, arguments.answer)?;
    if arguments.marks.is_empty() {
        return by_hand(axis, &mut encoder, arguments.duration);
    }
    let mut marks = Vec::new();
    for piston in &arguments.marks {
        eprintln!("Move axis.{} to {piston} m, let it stand still, and press Enter.", axis.name);
        let mut line = String::new();
        if io::stdin().lock().read_line(&mut line).map_err(Failure::run)? == 0 {
            return Err(Failure::run(CalibrationError::Ended));
        }
        let raw = encoder.at_rest()?;
        eprintln!("{piston} m is {raw}");
        marks.push(Mark { piston: *piston, raw });
    }
    let lines = match axis.encoder.angle {
        None => linear(axis, &marks),
        Some(sensor) => angular(axis, &sensor, &marks, |piston| angle(arguments, machine, axis, &sensor, piston)),
    };
    Ok(show(&lines.map_err(Failure::run)?)?)
}

fn check(arguments: &CalibrateArguments, machine: &Machine, axis: &Axis) -> Result<(), CalibrationError> {
    if arguments.marks.len() > 2 {
        return Err(CalibrationError::Marks(arguments.marks.len()));
    }
    if let Some(found) = arguments.marks.iter().find(|mark| !(0.0..=axis.stroke).contains(*mark)) {
        return Err(CalibrationError::Mark { found: *found, axis: axis.name.clone(), stroke: axis.stroke });
    }
    if let &[one, two] = &arguments.marks[..]
        && (one - two).abs() < 1e-3
    {
        return Err(CalibrationError::Close(one, two));
    }
    if let Some((name, _)) =
        arguments.places.iter().find(|(name, _)| machine.axes.iter().all(|axis| axis.name != *name))
    {
        return Err(CalibrationError::NoAxis(name.clone()));
    }
    let sensor = axis.encoder.angle;
    if !arguments.places.is_empty() && sensor.is_none_or(|sensor| sensor.kind != AngleKind::Inclinometer) {
        return Err(CalibrationError::NoInclinometer(axis.name.clone()));
    }
    if let (Some(sensor), [first, ..]) = (sensor, &arguments.marks[..]) {
        angle(arguments, machine, axis, &sensor, *first)?;
    }
    Ok(())
}

/// The encoder as it is, without direction and zero.
struct RawEncoder<'b> {
    dialogue: Dialogue<'b>,
    node: NodeId,
    object: can::canopen::Mapped,
    is_signed: bool,
}

impl<'b> RawEncoder<'b> {
    fn of(axis: &Axis, bus: &'b mut dyn Bus, patience: Duration) -> Result<Self, Failure> {
        let missing = || Failure::usage(format!("axis.{}.can.encoder: found nothing; allowed: a node", axis.name));
        let wired = axis.can.as_ref().ok_or_else(missing)?;
        let node = wired.encoder.and_then(NodeId::new).ok_or_else(missing)?;
        let object = can_proc::position_object(wired).mapped();
        Ok(Self { dialogue: Dialogue { bus, patience }, node, object, is_signed: wired.is_signed })
    }

    fn read(&mut self) -> Result<i64, Failure> {
        let found = self.dialogue.number(self.node, self.object.object).map_err(Failure::run)?.unwrap_or_default();
        Ok(if self.is_signed { signed(found, self.object.bits) } else { found as i64 })
    }

    /// The middle of some reads.
    fn at_rest(&mut self) -> Result<i64, Failure> {
        let mut reads = Vec::new();
        for _ in 0..READS {
            reads.push(self.read()?);
            std::thread::sleep(PAUSE);
        }
        reads.sort_unstable();
        let counts = reads[READS - 1].saturating_sub(reads[0]);
        if counts > STILL {
            return Err(Failure::run(CalibrationError::Moving { node: self.node.number(), counts }));
        }
        Ok(reads[READS / 2])
    }
}

/// The direction, by a motion of a person.
fn by_hand(axis: &Axis, encoder: &mut RawEncoder<'_>, duration: Duration) -> Result<(), Failure> {
    let first = encoder.read()?;
    eprintln!("The encoder of axis.{} is at {first}. Extend the axis now, within {duration:?}.", axis.name);
    let until = std::time::Instant::now() + duration;
    let mut last = first;
    while std::time::Instant::now() < until {
        std::thread::sleep(PAUSE);
        last = encoder.read()?;
    }
    let counts = last.saturating_sub(first);
    if counts.abs() < MOVED {
        return Err(Failure::run(CalibrationError::Still { node: encoder.node.number(), counts }));
    }
    let is_reversed = counts < 0;
    Ok(show(&format!(
        "# axis.{}: from {first} to {last} while it was extended\n[axis.{}.can]\nreversed = {is_reversed}\n",
        axis.name, axis.name
    ))?)
}

/// Lines of an encoder at the cylinder.
fn linear(axis: &Axis, marks: &[Mark]) -> Result<String, CalibrationError> {
    let mut text = head(axis, marks);
    let way = match marks {
        &[one, two] => {
            let way = (two.piston - one.piston) / counts(axis, one, two)? as f64;
            let _ = write!(text, "[axis.{}.encoder]\nresolution = {:e}\n\n", axis.name, rounded(way.abs()));
            way
        }
        _ if axis.can.as_ref().is_some_and(|wired| wired.is_reversed) => -axis.encoder.resolution,
        _ => axis.encoder.resolution,
    };
    let zero = marks.first().map_or(0.0, |mark| mark.raw as f64 - mark.piston / way).round();
    let _ = write!(text, "[axis.{}.can]\nreversed = {}\nzero = {zero:.0}\n", axis.name, way < 0.0);
    Ok(text)
}

/// Lines of a sensor at a joint.
fn angular(
    axis: &Axis,
    sensor: &AngleSensor,
    marks: &[Mark],
    angle: impl Fn(f64) -> Result<f64, CalibrationError>,
) -> Result<String, CalibrationError> {
    let mut text = head(axis, marks);
    let wired = axis.can.as_ref();
    let mut way = sensor.resolution * if wired.is_some_and(|wired| wired.is_reversed) { -1.0 } else { 1.0 };
    let first = marks.first().copied().unwrap_or(Mark { piston: 0.0, raw: 0 });
    let first_angle = angle(first.piston)?;
    if let &[one, two] = marks {
        let turn = angle(two.piston)? - first_angle;
        // The shorter way round.
        let turn = (turn + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI;
        way = turn / counts(axis, one, two)? as f64;
    }
    let zero = first_angle - way * first.raw as f64;
    let _ = write!(
        text,
        "[axis.{}.encoder]\nangle_resolution = {:e}\nangle_zero = {:.6}\n\n[axis.{}.can]\nreversed = {}\nzero = 0\n",
        axis.name,
        rounded(way.abs()),
        zero,
        axis.name,
        way < 0.0
    );
    Ok(text)
}

fn counts(axis: &Axis, one: Mark, two: Mark) -> Result<i64, CalibrationError> {
    let counts = two.raw.saturating_sub(one.raw);
    let node = axis.can.as_ref().and_then(|wired| wired.encoder).unwrap_or_default();
    if counts.abs() < MOVED { Err(CalibrationError::Still { node, counts }) } else { Ok(counts) }
}

fn head(axis: &Axis, marks: &[Mark]) -> String {
    let marks: Vec<String> = marks.iter().map(|mark| format!("{} m is {}", mark.piston, mark.raw)).collect();
    format!("# axis.{}: {}\n", axis.name, marks.join(", "))
}

/// Six significant digits: more than any ruler has.
fn rounded(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
}

/// The angle that the sensor measures with the piston here, rad.
fn angle(
    arguments: &CalibrateArguments,
    machine: &Machine,
    axis: &Axis,
    sensor: &AngleSensor,
    piston: f64,
) -> Result<f64, CalibrationError> {
    let Some(mechanism) = &machine.mechanism else { return Err(CalibrationError::Open(axis.name.clone())) };
    let own = sensor.joint.axis();
    let mut positions = [0.0; AXES];
    for (i, position) in positions.iter_mut().enumerate() {
        let Some(other) = machine.axes.get(i) else { continue };
        let place = arguments.places.iter().find(|(name, _)| *name == other.name).map(|(_, metres)| *metres);
        let is_needed = sensor.kind == AngleKind::Inclinometer && Joint::of_axis(i).is_some() && i < own;
        *position = match place {
            _ if i == own => piston,
            Some(metres) => metres,
            None if is_needed => return Err(CalibrationError::Place(other.name.clone())),
            // The angle of a joint does not depend on the others.
            None => other.stroke / 2.0,
        };
    }
    let angle = sensor.rotation(&mechanism.prepared().pose(&positions)).angle();
    if angle.is_finite() { Ok(angle) } else { Err(CalibrationError::Open(axis.name.clone())) }
}
