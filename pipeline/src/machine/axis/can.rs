//! The CAN devices of an axis: `[axis.NAME.can]`.

use crate::machine::document::Section;

/// Devices of an axis on the CAN bus.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CanDevices {
    /// Number of the encoder's node.
    pub encoder: u8,
    /// What has the position.
    pub object: CanPosition,
    /// Whether the position has a sign.
    pub is_signed: bool,
    /// Whether the position grows while the axis retracts.
    pub is_reversed: bool,
    /// Position of the encoder at count 0.
    pub zero: i64,
    /// Whether alarms and warnings travel with the position.
    pub has_alarms: bool,
    /// Whether the mapping of the messages cannot be written.
    pub is_fixed: bool,
    /// Number of the valve's node; only a machine whose drive is another one has none.
    pub valve: Option<u8>,
    /// Set point at command 1; negative where a positive one retracts.
    pub full_scale: i16,
    /// How much further out than commanded the spool may be, as a part of full scale; `None`: is not compared.
    pub spool_tolerance: Option<f64>,
}

/// Which position of the encoder is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CanPosition {
    /// 6004h of an encoder.
    Position,
    /// 6008h of an encoder, 64 bits.
    HighPrecision,
    /// A slope of an inclinometer.
    Slope(Slope),
}

/// Slopes of an inclinometer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Slope {
    /// 6010h, 16 bits.
    Long16,
    /// 6020h, 16 bits.
    Lateral16,
    /// 6110h, 32 bits.
    Long32,
    /// 6120h, 32 bits.
    Lateral32,
}

/// Names of slopes in the machine file; none is an encoder.
const SLOPES: [(&str, Option<Slope>); 5] = [
    ("none", None),
    ("long16", Some(Slope::Long16)),
    ("lateral16", Some(Slope::Lateral16)),
    ("long32", Some(Slope::Long32)),
    ("lateral32", Some(Slope::Lateral32)),
];
/// Largest zero of an encoder: floating point numbers of this size are whole.
const MAX_ZERO: f64 = 9e15;
/// Largest number of a node.
const MAX_NODE: usize = 127;
/// Set point of 100 % that the profile of fluid power has.
const FULL_SCALE: f64 = 16_384.0;
/// Part of full scale by which a spool may be out, after Danfoss PVE: 12 %.
const SPOOL_TOLERANCE: f64 = 0.12;

impl CanDevices {
    /// `has_valve`: the drive of the machine is CAN. `is_inclinometer`: the axis has one.
    pub(super) fn read(mut section: Section, has_valve: bool, is_inclinometer: bool) -> Self {
        let encoder = section.key("encoder", "Number of the encoder's node").optional_integer(1..=MAX_NODE);
        if encoder.is_none() && !section.is_present("encoder") {
            section.refuse("encoder", "nothing", "1 to 127, the number of a node");
        }
        let slope = section
            .key("slope", "Which slope of an inclinometer (CiA 410) is read, with encoder.kind = \"inclinometer\"")
            .rule("\"long16\" with an inclinometer, else \"none\": an encoder (CiA 406)")
            .choice_or(is_inclinometer.then_some(Slope::Long16), &SLOPES);
        if slope.is_some() && !is_inclinometer {
            section.refuse("slope", "a slope", "\"none\", but with encoder.kind = \"inclinometer\"");
        }
        let is_signed = section
            .key("signed", "Whether the encoder's position has a sign")
            .rule("true with a slope, else false")
            .flag_or(slope.is_some());
        let (is_reversed, zero) = mounting(&mut section);
        let is_precise = section
            .key("high_precision", "Whether the position of 64 bits, 6008h, is read in the place of 6004h")
            .flag_or(false);
        let has_alarms = section
            .key("alarms", "Whether alarms and warnings, 6503h and 6505h, travel with every position")
            .rule("true, but with high_precision or a slope")
            .flag_or(!is_precise && slope.is_none());
        if has_alarms && is_precise {
            section.refuse("alarms", "true", "false with high_precision: a message has 64 bits");
        }
        let is_fixed = section
            .key("fixed_mapping", "Whether the devices' mappings cannot be written, and are compared only")
            .flag_or(false);
        let valve = section
            .key("valve", "Number of the valve's node, with drive.kind = \"can\"")
            .optional_integer(1..=MAX_NODE);
        if valve.is_none() && has_valve && !section.is_present("valve") {
            section.refuse("valve", "nothing", "1 to 127, the number of a node: drive.kind is \"can\"");
        }
        let full_scale = section
            .key("full_scale", "Set point of the valve at command 1; negative where a positive set point retracts")
            .number_or(FULL_SCALE, -32_767.0..=32_767.0, "");
        if full_scale.abs() < 1.0 {
            section.refuse("full_scale", full_scale.to_string(), "-32767 to -1, or 1 to 32767");
        }
        let has_feedback = section
            .key("spool_feedback", "Whether the valve measures its spool, so that it is compared with the set point")
            .flag_or(true);
        let tolerance = section
            .key("spool_tolerance", "How much further out than commanded the spool may be, as a part of full_scale")
            .number_or(SPOOL_TOLERANCE, 0.01..=1.0, "");
        section.finish();
        let node = |number: usize| number as u8;
        Self {
            // In the place of a refused number one that no device has.
            encoder: encoder.map_or(0, node),
            object: match slope {
                Some(slope) => CanPosition::Slope(slope),
                None if is_precise => CanPosition::HighPrecision,
                None => CanPosition::Position,
            },
            is_signed,
            is_reversed,
            zero,
            has_alarms,
            is_fixed,
            valve: valve.map(node),
            full_scale: full_scale as i16,
            spool_tolerance: has_feedback.then_some(tolerance),
        }
    }

    /// Numbers of its nodes, without one that was refused.
    pub(in crate::machine) fn nodes(&self) -> impl Iterator<Item = u8> {
        [Some(self.encoder), self.valve].into_iter().flatten().filter(|node| *node > 0)
    }
}

/// How the encoder is mounted: whether it is reversed, and its zero.
fn mounting(section: &mut Section) -> (bool, i64) {
    let is_reversed = section
        .key(
            "reversed",
            "Whether the encoder's position grows while the axis retracts; as `hydraxis can calibrate` finds",
        )
        .flag_or(false);
    let zero = section
        .key("zero", "Position of the encoder at count 0 of the axis; as `hydraxis can calibrate` finds")
        .number_or(0.0, -MAX_ZERO..=MAX_ZERO, "");
    if zero.fract() != 0.0 {
        section.refuse("zero", zero.to_string(), "a whole number of counts");
    }
    (is_reversed, zero as i64)
}
