//! One axis: `[axis.NAME]`.

mod commissioned;
mod control;
mod dead_band;
mod encoder;
mod estimator;
mod identification;
mod plant;
mod reference;

use std::path::Path;

pub use commissioned::{Commissioned, MOST_POINTS};
pub use control::{Control, ModelChoice};
pub use dead_band::DeadBand;
pub use encoder::Encoder;
pub use estimator::Estimator;
pub use identification::{Form, Identification, IdentifiedOutput, Split, shortest_training};
pub use plant::{LoadForce, Plant, ValveCurve};
pub use reference::{ReferenceSource, Sine};

use super::{document::Section, fuzzy::Fuzzy, source::Source, timing::Timing};

/// One axis of the machine.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// Its name, the table's.
    pub name: String,
    /// Travel of the piston, m; the position runs from 0 to it.
    pub stroke: f64,
    /// Fastest speed that the axis can reach, m/s; anything faster is not believed.
    pub max_speed: f64,
    /// Lowest and highest position that a reference may ask for, m.
    pub soft_limits: (f64, f64),
    /// The position encoder.
    pub encoder: Encoder,
    /// How it is identified.
    pub identification: Identification,
    /// How it is controlled.
    pub control: Control,
    /// What commissioning has found of it.
    pub commissioned: Option<Commissioned>,
    /// Where its target comes from.
    pub reference: ReferenceSource,
    /// The simulated axis; only source `sim` needs it.
    pub plant: Option<Plant>,
    /// Columns of a record: input and output; only source `replay` needs them.
    pub columns: (String, String),
}

impl Axis {
    pub(super) fn read(
        name: &str,
        mut section: Section,
        timing: &Timing,
        source: &Source,
        fuzzy: Fuzzy,
        folder: &Path,
    ) -> Self {
        if name.is_empty() || !name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_') {
            section.refuse("", format!("axis name \"{name}\""), "letters, digits, - and _");
        }
        let stroke = section.number("stroke", 1e-3..=100.0, "m");
        let max_speed = section.number("max_speed", 1e-3..=1000.0, "m/s");
        let limits = section.numbers("soft_limits", -100.0..=100.0, "m", 2);
        let soft_limits = match limits[..] {
            [low, high] if 0.0 <= low && low < high && high <= stroke => (low, high),
            [] => (0.0, stroke),
            _ => {
                section.refuse(
                    "soft_limits",
                    format!("{limits:?}"),
                    format!("[low, high] with 0 <= low < high <= stroke ({stroke})"),
                );
                (0.0, stroke)
            }
        };
        let encoder = Encoder::read(section.section("encoder"));
        section.renamed("forgetting", "identification.estimator");
        let mut identification = Identification::read(section.section("identification"), timing.period, fuzzy);
        let commissioned = Commissioned::read(section.section("commissioned"));
        match &commissioned {
            Some(model) if identification.estimator == Estimator::GreyBox => {
                identification.structure = model.structure(identification.structure, timing.period);
            }
            _ => {}
        }
        if let Err((found, allowed)) = identification.check_estimator(name, commissioned.is_some()) {
            section.refuse("identification.estimator", found, allowed);
        }
        let control = Control::read(section.section("control"), name, commissioned.as_ref(), timing.period);
        let reference = ReferenceSource::read(section.section("reference"), soft_limits, max_speed, folder, name);
        let plant = section.section("plant");
        let plant = if plant.is_given() {
            Some(Plant::read(plant, stroke))
        } else {
            if *source == Source::Sim {
                plant.refuse("", "nothing", "a table with the simulated axis: source is \"sim\"");
            }
            None
        };
        let columns = section.optional_texts("columns", "[\"input column\", \"output column\"]");
        let columns = match columns.as_deref() {
            None => ("u".to_owned(), "y".to_owned()),
            Some([input, output]) => (input.clone(), output.clone()),
            Some(other) => {
                section.refuse("columns", format!("{} names", other.len()), "[\"input column\", \"output column\"]");
                (String::new(), String::new())
            }
        };
        section.finish();
        Self {
            name: name.to_owned(),
            stroke,
            max_speed,
            soft_limits,
            encoder,
            identification,
            control,
            commissioned,
            reference,
            plant,
            columns,
        }
    }
}
