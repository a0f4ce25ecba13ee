//! The CAN devices of an axis: `[axis.NAME.can]`.

use crate::machine::document::Section;

/// Least set point at command 1, counts. A valve with less would be moved in jerks.
pub const LEAST_SET_POINT: f64 = 50.0;

/// Devices of an axis on the CAN bus.
#[derive(Debug, Clone, PartialEq)]
pub struct CanDevices {
    /// Number of the encoder's node; `None` where the position is a signal.
    pub encoder: Option<u8>,
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
    /// Number of the valve's node; without one the command is a signal, or the drive of the machine is another one.
    pub valve: Option<u8>,
    /// Set point at command 1; negative where a positive one retracts.
    pub full_scale: i16,
    /// How much further out than commanded the spool may be, as a part of full scale; `None`: is not compared.
    pub spool_tolerance: Option<f64>,
    /// Signals of messages that are no CANopen.
    pub signals: CanSignals,
}

/// Names of signals such as `Message.Signal`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CanSignals {
    /// The position, in the place of an encoder's node.
    pub position: Option<String>,
    /// The command, in the place of a valve's node.
    pub command: Option<String>,
    /// Its direction, where the command has no sign.
    pub direction: Option<String>,
    /// By which the drive says that it follows the command.
    pub active: Option<String>,
    /// Set point at command 1, in the unit of the signal; negative where a positive one retracts.
    pub scale: f64,
    /// Pressures of piston side and rod side.
    pub pressures: Option<[String; 2]>,
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
        let valve = section
            .key("valve", "Number of the valve's node, with drive.kind = \"can\"")
            .optional_integer(1..=MAX_NODE);
        let signals = CanSignals::read(&mut section);
        expect_one(&section, ("encoder", encoder), ("position", &signals.position), true);
        expect_one(&section, ("valve", valve), ("command", &signals.command), has_valve);
        let (object, is_signed, has_alarms) = position(&mut section, is_inclinometer);
        let (is_reversed, zero) = mounting(&mut section);
        let is_fixed = section
            .key("fixed_mapping", "Whether the devices' mappings cannot be written, and are compared only")
            .flag_or(false);
        let full_scale = section
            .key("full_scale", "Set point of the valve at command 1; negative where a positive set point retracts")
            .number_or(FULL_SCALE, -32_767.0..=32_767.0, "");
        if full_scale.abs() < LEAST_SET_POINT {
            section.refuse("full_scale", full_scale.to_string(), "-32767 to -50, or 50 to 32767");
        }
        let has_feedback = section
            .key("spool_feedback", "Whether the valve measures its spool, so that it is compared with the set point")
            .flag_or(true);
        let tolerance = section
            .key("spool_tolerance", "How much further out than commanded the spool may be, as a part of full_scale")
            .number_or(SPOOL_TOLERANCE, 0.01..=1.0, "");
        if signals.command.is_some() {
            let of_a_valve = ["full_scale", "spool_feedback", "spool_tolerance"];
            section.exclude(&of_a_valve, false, "beside valve; with command it is command_scale that counts");
        } else {
            section.exclude(
                &["command_scale", "active"],
                false,
                "beside command; with valve it is full_scale that counts",
            );
        }
        section.finish();
        let node = |number: usize| number as u8;
        Self {
            encoder: encoder.map(node),
            object,
            is_signed,
            is_reversed,
            zero,
            has_alarms,
            is_fixed,
            valve: valve.map(node),
            full_scale: full_scale as i16,
            spool_tolerance: has_feedback.then_some(tolerance),
            signals,
        }
    }

    /// Numbers of its nodes, without one that was refused.
    pub(in crate::machine) fn nodes(&self) -> impl Iterator<Item = u8> {
        [self.encoder, self.valve].into_iter().flatten()
    }
}

impl CanSignals {
    fn read(section: &mut Section) -> Self {
        let position = section
            .key("position", "Signal with the position, such as \"Boom.Angle\", in the place of an encoder's node")
            .optional_text();
        let command = section
            .key("command", "Signal with the set point, such as \"Levers.Boom\", in the place of a valve's node")
            .optional_text();
        let direction = section
            .key("direction", "Signal with the direction of a set point without a sign: 0 neutral, 1 extend, 2 retract")
            .optional_text();
        if command.is_none() && direction.is_some() {
            section.refuse("direction", "a signal without command", "beside command, which has no sign then");
        }
        let active = section
            .key("active", "Signal that is not 0 while the drive follows the command; its time-out is proven by it")
            .optional_text();
        if command.is_some() && active.is_none() {
            let allowed =
                "a signal: without it the time-out of the drive cannot be proven, and the axis is never armed";
            section.refuse("active", "nothing", allowed);
        }
        let scale = section
            .key("command_scale", "Set point at command 1, in the unit of the signal; negative where that retracts")
            .number_or(1.0, -1e9..=1e9, "");
        if scale == 0.0 {
            section.refuse("command_scale", "0", "a number that is not 0");
        }
        let piston = section.key("piston_pressure", "Signal with the pressure of the piston side").optional_text();
        let rod = section.key("rod_pressure", "Signal with the pressure of the rod side").optional_text();
        if piston.is_some() != rod.is_some() {
            section.refuse("piston_pressure", "one pressure", "piston_pressure and rod_pressure, or neither");
        }
        let pressures = piston.zip(rod).map(|(piston, rod)| [piston, rod]);
        Self { position, command, direction, active, scale, pressures }
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

/// Refuses a node and a signal for the same thing, and neither of them where it is needed.
fn expect_one(section: &Section, node: (&str, Option<usize>), signal: (&str, &Option<String>), is_needed: bool) {
    match (node.1, signal.1) {
        // A number that was refused is there.
        (None, None) if is_needed && !section.is_present(node.0) => {
            let allowed = format!("1 to 127, the number of a node, or {}, the name of a signal", signal.0);
            section.refuse(node.0, "nothing", allowed);
        }
        (Some(_), Some(_)) => section.refuse(signal.0, "a signal", format!("{} or {}, not both", node.0, signal.0)),
        _ => {}
    }
}

/// What has the position of a node, whether it has a sign, and whether alarms travel with it.
fn position(section: &mut Section, is_inclinometer: bool) -> (CanPosition, bool, bool) {
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
    let is_precise = section
        .key("high_precision", "Whether the position of 64 bits, 6008h, is read in the place of 6004h")
        .flag_or(false);
    let has_alarms = section
        .key("alarms", "Whether alarms and warnings, 6503h and 6505h, travel with every position")
        .rule("true, but with high_precision or a slope")
        .flag_or(!is_precise && slope.is_none());
    if slope.is_some() && (!is_signed || is_precise || has_alarms) {
        let found = format!("signed = {is_signed}, high_precision = {is_precise}, alarms = {has_alarms}");
        section.refuse("slope", format!("a slope with {found}"), "true, false and false of these, as by default");
    }
    if has_alarms && is_precise {
        section.refuse("alarms", "true", "false with high_precision: a message has 64 bits");
    }
    let object = match slope {
        Some(slope) => CanPosition::Slope(slope),
        None if is_precise => CanPosition::HighPrecision,
        None => CanPosition::Position,
    };
    (object, is_signed, has_alarms)
}
