//! One axis: `[axis.NAME]`.
//!
//! | file | table | what it says |
//! |---|---|---|
//! | `encoder` | `[axis.NAME.encoder]` | the position sensor |
//! | `can` | `[axis.NAME.can]` | encoder and valve on a CAN bus |
//! | `pressure` | `[axis.NAME.pressure]` | the pressure transducers |
//! | `commissioned`, `overrun` | `[axis.NAME.commissioned]` | the model that `hydraxis commission` has found |
//! | `hardware` | | what that model depends on: it recognises another machine |
//! | `identification`, `estimator` | `[axis.NAME.identification]` | how the axis is identified |
//! | `control`, `plan` | `[axis.NAME.control]` | how the axis is controlled; the predictive controller's plan |
//! | `limits` | `[axis.NAME.control]` | the limits of its motion |
//! | `reference` | `[axis.NAME.reference]` | where the reference comes from |
//! | `plant`, `ports` | `[axis.NAME.plant]` | the simulated axis; its valves and hoses beyond one spool |
//! | `sensor_errors` | `[axis.NAME.plant]` | what the simulated sensors do beyond their resolution |
//!
//! Dead band and dead time of the commissioned model are the defaults of identification and control.

mod can;
mod commissioned;
mod control;
mod dead_band;
mod encoder;
mod estimator;
mod hardware;
mod identification;
mod limits;
mod overrun;
mod plan;
mod plant;
mod ports;
mod pressure;
mod reference;
mod sensor_errors;

use std::path::Path;

pub use can::{CanDevices, CanPosition, CanSignals, LEAST_SET_POINT, Slope};
pub use commissioned::{COMPENSATED, Commissioned, MOST_POINTS};
use control::Owner;
pub use control::{Control, FallbackWithout, Law, ModelChoice, SmithSettings};
pub use dead_band::DeadBand;
pub use encoder::{AngleKind, AngleSensor, Encoder};
pub use estimator::Estimator;
pub use hardware::Hardware;
pub use identification::{
    Form, GREY_BOX_MEMORY, Identification, IdentifiedOutput, SMITH_MEMORY, Split, Start, shortest_training,
};
use limits::Nature;
pub use limits::{LimitSettings, MotionLimits};
pub use overrun::Overrun;
pub use plan::{MAX_HORIZON, MAX_MOVES, MAX_RESPONSE, MoveWeight, Plan, PlanSettings};
pub use plant::{LoadForce, Plant, ValveCurve};
pub use ports::{Directions, LoadHolding, Ports};
pub use pressure::PressureTransducers;
use reference::Limits;
pub use reference::{ReferenceSource, Sine};
pub use sensor_errors::SensorErrors;
use sensor_errors::Sensors;

use super::{
    document::Section,
    fuzzy::Fuzzy,
    source::{Drive, Source},
    timing::Timing,
};
use crate::{MAX_NAME, nearest::nearest};

/// What the tables of the axes need from the rest of the machine file.
pub(super) struct Shared<'a> {
    pub timing: &'a Timing,
    pub source: &'a Source,
    pub drive: Drive,
    pub fuzzy: Fuzzy,
    /// Folder that paths in the machine file are relative to.
    pub folder: &'a Path,
    /// Names of the axes whose mass and load are those of the mechanism.
    pub carried: &'a [String],
}

/// One axis of the machine.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// Name of the axis: that of its table.
    pub name: String,
    /// Travel of the piston, m; positions run from 0 to it.
    pub stroke: f64,
    /// Fastest speed of the axis, m/s; a faster position signal is implausible.
    pub max_speed: f64,
    /// Lowest and highest position that a reference may ask for, m.
    pub soft_limits: (f64, f64),
    /// The position sensor.
    pub encoder: Encoder,
    /// Encoder and valve on the CAN bus, if they are there.
    pub can: Option<CanDevices>,
    /// The pressure transducers at both chambers, if there are any.
    pub pressure: Option<PressureTransducers>,
    /// How the axis is identified.
    pub identification: Identification,
    /// How the axis is controlled.
    pub control: Control,
    /// The commissioned model, if there is one.
    pub commissioned: Option<Commissioned>,
    /// What that model was measured on, if the model file says it: the [`Hardware::text`] of that time.
    pub measured_on: Option<String>,
    /// What a model of this axis depends on.
    pub hardware: Hardware,
    /// Where the reference comes from.
    pub reference: ReferenceSource,
    /// The simulated axis; only source `sim` needs it.
    pub plant: Option<Plant>,
    /// Columns of a record with command and position; only source `replay` needs them.
    pub columns: (String, String),
}

/// Names of the axes, in the order of the file. A table without a key of its own, with the name of another axis but for
/// a few letters, is none: its name is mistyped.
pub(super) fn names(axes: &Section) -> Vec<String> {
    let (whole, parts): (Vec<String>, Vec<String>) = axes.names().into_iter().partition(|name| axes.has_values(name));
    let is_stray = |name: &String| parts.contains(name) && !nearest(name, whole.iter().map(String::as_str)).is_empty();
    axes.names().into_iter().filter(|name| !is_stray(name)).collect()
}

impl Axis {
    pub(super) fn read(name: &str, mut section: Section, shared: &Shared) -> Self {
        let is_name = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_');
        if !is_name || !(1..=MAX_NAME).contains(&name.len()) {
            section.refuse("", format!("axis name \"{name}\""), "1 to 32 letters, digits, - and _");
        }
        let stroke =
            section.key("stroke", "Travel of the piston; positions run from 0 to it").number(1e-3..=100.0, "m");
        let max_speed = section
            .key("max_speed", "Fastest speed of the axis; a faster position signal is implausible")
            .number(1e-3..=1000.0, "m/s");
        let soft_limits = read_soft_limits(&mut section, stroke);
        let carried = shared.carried.iter().position(|carried| carried == name);
        let encoder = section.section("encoder");
        let is_overridden = encoder.is_set("kind");
        let encoder = Encoder::read(encoder, carried);
        let can = section.section("can");
        let has_devices = can.is_given() || *shared.source == Source::Can;
        let is_inclinometer = encoder.angle.is_some_and(|sensor| sensor.kind == AngleKind::Inclinometer);
        let can = has_devices.then(|| CanDevices::read(can, shared.drive == Drive::Can, is_inclinometer));
        let pressure = PressureTransducers::read(section.section("pressure"));
        section.renamed("forgetting", "identification.estimator");
        let mut commissioned = section.section("commissioned");
        let meaning = "What the model was measured on; written by `hydraxis commission`, and compared with the machine";
        let is_commissioned = commissioned.is_given();
        let measured_on = is_commissioned.then(|| commissioned.key("measured_on", meaning).optional_text()).flatten();
        let commissioned = Commissioned::read(commissioned);
        let model = commissioned.as_ref();
        let identification =
            Identification::read(section.section("identification"), name, model, shared.timing.period, shared.fuzzy);
        let period = shared.timing.period;
        let has_forces = pressure.is_some() && section.is_present("plant");
        let owner = Owner { name, commissioned: model, has_forces, max_speed, resolution: encoder.resolution, period };
        let control = Control::read(section.section("control"), &owner);
        let limits = Limits { soft_limits, max_speed };
        let reference = ReferenceSource::read(section.section("reference"), limits, shared.folder, name);
        let kind = encoder.angle.map(|sensor| sensor.kind);
        let sensors = Sensors { kind, is_overridden, has_pressures: pressure.is_some() };
        let plant = read_plant(section.section("plant"), stroke, carried.is_some(), sensors, shared.source);
        let columns = read_columns(&mut section);
        section.finish();
        Self {
            name: name.to_owned(),
            stroke,
            max_speed,
            soft_limits,
            encoder,
            can,
            pressure,
            identification,
            control,
            commissioned,
            measured_on,
            hardware: Hardware::default(),
            reference,
            plant,
            columns,
        }
    }

    /// Whether pressures of both chambers are measured, and the areas of the piston are known.
    pub fn measures_force(&self) -> bool {
        self.pressure.is_some() && self.plant.is_some()
    }

    /// The limits of the motion, for a command every `period` s.
    pub fn motion_limits(&self, period: f64) -> MotionLimits {
        self.control.limits.limits(&Nature {
            commissioned: self.commissioned.as_ref(),
            max_speed: self.max_speed,
            command_rate: self.control.command_rate,
            resolution: self.encoder.resolution,
            period,
        })
    }
}

/// The simulated axis; only source `sim` needs it.
fn read_plant(section: Section, stroke: f64, is_carried: bool, sensors: Sensors, source: &Source) -> Option<Plant> {
    if section.is_given() {
        return Some(Plant::read(section, stroke, is_carried, sensors));
    }
    if *source == Source::Sim {
        section.refuse("", "nothing", "a table with the simulated axis: source is \"sim\"");
    }
    None
}

fn read_soft_limits(section: &mut Section, stroke: f64) -> (f64, f64) {
    let limits = section
        .key("soft_limits", "Lowest and highest position that a reference may ask for")
        .allows("[low, high] with 0 <= low < high <= stroke")
        .numbers(-100.0..=100.0, "m", 2);
    match limits[..] {
        [low, high] if 0.0 <= low && low < high && high <= stroke => (low, high),
        [] => (0.0, stroke),
        _ => {
            let allowed = format!("[low, high] with 0 <= low < high <= stroke ({stroke})");
            section.refuse("soft_limits", format!("{limits:?}"), allowed);
            (0.0, stroke)
        }
    }
}

fn read_columns(section: &mut Section) -> (String, String) {
    let allowed = "[\"input column\", \"output column\"]";
    let columns = section
        .key("columns", "Columns of the record with command and position of this axis, with source.kind = \"replay\"")
        .rule("[\"u\", \"y\"]")
        .optional_texts(allowed);
    match columns.as_deref() {
        None => ("u".to_owned(), "y".to_owned()),
        Some([input, output]) => (input.clone(), output.clone()),
        Some(other) => {
            section.refuse("columns", format!("{} names", other.len()), allowed);
            (String::new(), String::new())
        }
    }
}
