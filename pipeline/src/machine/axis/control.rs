//! How an axis is controlled: `[axis.NAME.control]`.

use std::time::Duration;

use super::{
    commissioned::Commissioned,
    dead_band::DeadBand,
    limits::{LimitSettings, Nature},
    plan::PlanSettings,
};
use crate::{
    hammerstein::MAX_DELAY,
    machine::document::{Section, Shown},
};

/// How one axis is controlled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Control {
    /// Proportional gain of the fallback, command per metre.
    pub kp: f64,
    /// Integral gain of the fallback, command per metre and second.
    pub ki: f64,
    /// Whether the fallback adds velocity feed-forward by the commissioned model.
    pub feedforward: bool,
    /// zeta_p: by how much the fallback makes the damping ratio of the load's swing greater, by the chamber pressures;
    /// 0 where it does not.
    pub pressure_damping: f64,
    /// Time constant with which a load-sensing pump follows, s, by the table `supply`; 0 with another pump.
    pub pump_response: f64,
    /// Dead band of the valve that the fallback compensates.
    pub dead_band: DeadBand,
    /// Largest magnitude of a command.
    pub command_limit: f64,
    /// Fastest change of a command, 1/s.
    pub command_rate: f64,
    /// Largest following error for a reference that stands, m; a larger error for too long is a fault.
    pub following_error: f64,
    /// Speed up to which motion that nobody has commanded is drift, m/s.
    pub drift: f64,
    /// Which model controls.
    pub model: ModelChoice,
    /// What is given of the plan of the predictive controller.
    pub plan: PlanSettings,
    /// How the model controls.
    pub law: Law,
    /// What is given of the limits of the motion.
    pub limits: LimitSettings,
    /// Whether references that ask for more than this axis can give go on more slowly along their path.
    pub slow_references: bool,
    /// Whether the axis is disarmed in every mode when the requests to it stop.
    pub hold_to_run: bool,
    /// Whether the loop loses authority when it swings. No key of the machine file: only a comparison leaves it out, so
    /// that a baseline is what it would be elsewhere.
    pub caution: bool,
    /// What a comparison leaves out of the fallback's feed-forward.
    pub without: FallbackWithout,
}

/// Measures beside the feed-forward that a comparison leaves out, to show what each of them is worth.
/// No key of the machine file: every machine has all of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FallbackWithout {
    /// The inverse of the valve's hysteresis.
    pub hysteresis: bool,
    /// What the feed-forward lacks is learned in motion.
    pub learning: bool,
    /// The load in the feed-forward, and gains by the mass that moves.
    pub load: bool,
    /// The damping by chamber pressures.
    pub damping: bool,
}

/// Part of `max_speed` that is drift: a worn telescope under load has 1.5 %.
const DRIFT: f64 = 0.02;

/// What the control of an axis needs from the rest of the axis.
pub(super) struct Owner<'a> {
    /// Name of the axis.
    pub name: &'a str,
    pub commissioned: Option<&'a Commissioned>,
    /// Whether pressures of both chambers are measured, and the areas of the piston are known.
    pub has_forces: bool,
    /// `max_speed`, m/s.
    pub max_speed: f64,
    /// Length of one count of the encoder, m; NaN where it is not known yet.
    pub resolution: f64,
    pub period: Duration,
}

/// How a model controls an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Law {
    /// By a plan: predictive control.
    Predictive,
    /// By a Smith predictor on the commissioned model, with the adapted curve.
    Smith(SmithSettings),
}

/// Settings of the Smith predictor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SmithSettings {
    /// Proportional gain, command per metre.
    pub kp: f64,
    /// Integral gain, command per metre and second.
    pub ki: f64,
    /// Time constant of the observer, s.
    pub observer_time: f64,
}

/// Which model controls.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModelChoice {
    /// The adaptive model, updated online.
    Adaptive,
    /// The classical model, identified offline and held.
    Classical,
    /// No model: the fallback always controls.
    None,
}

impl Control {
    /// zeta_p that is in use: 0 in a comparison without the damping.
    pub fn damping_in_use(&self) -> f64 {
        if self.without.damping { 0.0 } else { self.pressure_damping }
    }

    pub(super) fn read(mut section: Section, owner: &Owner) -> Self {
        let Owner { name, commissioned, max_speed, resolution, period, .. } = *owner;
        let dead_band = read_dead_band(&mut section, commissioned);
        let models =
            [("adaptive", ModelChoice::Adaptive), ("classical", ModelChoice::Classical), ("none", ModelChoice::None)];
        let mut control = Self {
            kp: section.key("kp", "Proportional gain of the fallback").number(0.0..=1e4, "1/m"),
            ki: section.key("ki", "Integral gain of the fallback").number(0.0..=1e5, "1/(m s)"),
            feedforward: read_feedforward(&mut section, name, commissioned, period),
            pressure_damping: read_pressure_damping(&mut section, owner),
            pump_response: 0.0,
            dead_band,
            command_limit: section.key("command_limit", "Largest magnitude of a command").number(1e-3..=1.0, ""),
            command_rate: section.key("command_rate", "Fastest change of a command").number(1e-3..=1e4, "1/s"),
            following_error: section
                .key(
                    "following_error",
                    "Largest following error for a reference that stands; 0.2 s of the reference's speed are added, \
                     and a larger error for 200 ms is a fault",
                )
                .number_or(0.03, 1e-4..=100.0, "m"),
            drift: section
                .key("drift", "Speed up to which motion that nobody has commanded is drift, and no fault")
                .rule("0.02 times max_speed")
                .number_or_derived(Some(DRIFT * max_speed), 1e-5..=10.0, "m/s"),
            model: section
                .key("model", "Model that controls; with none the fallback always controls")
                .choice_or(ModelChoice::Adaptive, &models),
            plan: PlanSettings::read(&mut section, commissioned, period),
            law: read_law(&mut section, name, commissioned, period),
            limits: LimitSettings::default(),
            slow_references: read_slow_references(&mut section, name, commissioned),
            hold_to_run: section
                .key(
                    "hold_to_run",
                    "Whether the axis is disarmed in every mode 0.1 s after the requests to it have stopped: then it \
                     is armed only while `hydraxis operate` runs",
                )
                .flag_or(false),
            caution: true,
            without: FallbackWithout::default(),
        };
        let (command_rate, period) = (control.command_rate, period.as_secs_f64());
        let nature = Nature { commissioned, max_speed, command_rate, resolution, period };
        control.limits = LimitSettings::read(&mut section, &nature);
        section.finish();
        control
    }
}

/// `pressure_damping`, which needs the force of the cylinder, and the swing and the mass of a commissioned model.
fn read_pressure_damping(section: &mut Section, owner: &Owner) -> f64 {
    let meaning =
        "By how much the fallback makes the damping ratio of the load's swing greater, by the chamber pressures";
    let more = section.key("pressure_damping", meaning).number_or(0.0, 0.0..=1.0, "");
    let Owner { name, commissioned, has_forces, .. } = *owner;
    let swings = commissioned.is_some_and(|model| model.natural_frequency > 0.0 && model.mass.is_finite());
    let lacking = match (has_forces, swings) {
        (true, true) => return more,
        (false, _) => format!("[axis.{name}.pressure] and the areas of [axis.{name}.plant]"),
        (true, false) => format!("natural_frequency and mass of [axis.{name}.commissioned]"),
    };
    if more > 0.0 {
        let allowed = format!("0 without {lacking}; the gains of its model file swing then: commission anew");
        section.refuse("pressure_damping", more.to_string(), allowed);
    }
    0.0
}

/// The dead band that the fallback compensates; its default is a part of the commissioned one.
fn read_dead_band(section: &mut Section, commissioned: Option<&Commissioned>) -> DeadBand {
    let default = commissioned.map(Commissioned::compensated_dead_band);
    DeadBand {
        extend: section
            .key("dead_band_extend", "Dead band that the fallback compensates while extending")
            .rule("0.9 times commissioned.dead_band_extend; required without it")
            .number_or_derived(default.map(|band| band.extend), 0.0..=0.9, ""),
        retract: section
            .key("dead_band_retract", "Dead band that the fallback compensates while retracting, as a magnitude")
            .rule("0.9 times commissioned.dead_band_retract; required without it")
            .number_or_derived(default.map(|band| band.retract), 0.0..=0.9, ""),
    }
}

/// `law`, whose Smith predictor needs a commissioned model whose dead time and lag are within the preview of the
/// references.
fn read_law(section: &mut Section, name: &str, commissioned: Option<&Commissioned>, period: Duration) -> Law {
    let is_smith = section
        .key("law", "How the model controls: by a plan, or by a Smith predictor on the commissioned model")
        .choice_or(false, &[("predictive", false), ("smith", true)]);
    let kp = section.key("smith_kp", "Proportional gain of the Smith predictor").optional_number(0.0..=1e4, "1/m");
    let ki = section.key("smith_ki", "Integral gain of the Smith predictor").number_or(0.0, 0.0..=1e5, "1/(m s)");
    let observer_time = section
        .key("observer_time", "Time constant with which the Smith predictor believes the encoder")
        .rule(OBSERVER_RULE)
        .optional_number(1e-4..=10.0, "s");
    if !is_smith {
        return Law::Predictive;
    }
    let Some(model) = commissioned else {
        let allowed =
            "\"predictive\", or a commissioned model: `--model MODEL.toml`, as `hydraxis commission` writes it";
        section.refuse("law", format!("\"smith\" without [axis.{name}.commissioned]"), allowed);
        return Law::Predictive;
    };
    let longest = MAX_DELAY as f64 * period.as_secs_f64();
    if model.reaction() > longest {
        let found = format!("\"smith\" with dead_time + time_constant of {} s", model.reaction());
        section.refuse("law", found, format!("\"predictive\", or up to {MAX_DELAY} periods, {longest} s"));
    }
    let Some(kp) = kp else {
        // A gain that is present was refused when it was read.
        if !section.is_present("smith_kp") {
            section.refuse("smith_kp", "nothing", "a gain in 1/m, from 0 to 10000, where law is \"smith\"");
        }
        return Law::Predictive;
    };
    let usual = model.observer_time(period.as_secs_f64());
    if observer_time.is_none() {
        section.derive("observer_time", usual.shown(), OBSERVER_RULE);
    }
    Law::Smith(SmithSettings { kp, ki, observer_time: observer_time.unwrap_or(usual) })
}

const OBSERVER_RULE: &str =
    "commissioned.dead_time + time_constant + half a period, at least 60 ms; with law = \"smith\"";

/// `slow_references`, which needs the speeds of a commissioned model.
fn read_slow_references(section: &mut Section, name: &str, commissioned: Option<&Commissioned>) -> bool {
    let meaning = "Whether the generators of all axes go on more slowly along their path where they ask for more than \
                   this axis can give";
    let slows = section.key("slow_references", meaning).flag_or(false);
    if slows && commissioned.is_none() {
        section.refuse(
            "slow_references",
            format!("true without [axis.{name}.commissioned]"),
            "false, or a commissioned model: `--model MODEL.toml`, as `hydraxis commission` writes it",
        );
    }
    slows
}

/// `feedforward`, which needs a commissioned model whose dead time and lag are within the preview of the references.
fn read_feedforward(section: &mut Section, name: &str, commissioned: Option<&Commissioned>, period: Duration) -> bool {
    let feedforward = section
        .key(
            "feedforward",
            "Whether the fallback adds velocity feed-forward by the commissioned model, and learns what this lacks",
        )
        .flag_or(false);
    if !feedforward {
        return false;
    }
    let longest = MAX_DELAY as f64 * period.as_secs_f64();
    match commissioned {
        None => section.refuse(
            "feedforward",
            format!("true without [axis.{name}.commissioned]"),
            "false, or a commissioned model: `--model MODEL.toml`, as `hydraxis commission` writes it",
        ),
        Some(model) if model.reaction() > longest => section.refuse(
            "feedforward",
            format!("true with dead_time + time_constant of {} s", model.reaction()),
            format!("false, or up to {MAX_DELAY} periods, {longest} s"),
        ),
        Some(_) => {}
    }
    feedforward
}

#[cfg(test)]
mod tests {
    use crate::machine::Machine;

    #[test]
    fn damping_by_pressures_needs_transducers_and_a_load_that_swings() {
        let load = |settings: &[(&str, &str)]| {
            let settings: Vec<_> =
                settings.iter().map(|(key, value)| (format!("axis.boom.{key}"), (*value).to_owned())).collect();
            Machine::load(None, &settings)
        };
        let (damping, transducers) = (("control.pressure_damping", "0.3"), ("pressure.resolution", "1e3"));
        assert_eq!(load(&[damping, transducers]).unwrap().axes[0].control.pressure_damping, 0.3);
        let refused = |settings: &[(&str, &str)]| load(settings).unwrap_err().to_string();
        let text = refused(&[damping]);
        assert!(text.contains("axis.boom.control.pressure_damping: found 0.3"), "{text}");
        assert!(text.contains("allowed: 0 without [axis.boom.pressure] and the areas of [axis.boom.plant]"), "{text}");
        let text = refused(&[damping, transducers, ("commissioned.natural_frequency", "0")]);
        assert!(text.contains("allowed: 0 without natural_frequency and mass of [axis.boom.commissioned]"), "{text}");
        let text = refused(&[("control.pressure_damping", "2"), transducers]);
        assert!(text.contains("axis.boom.control.pressure_damping: found 2"), "{text}");
    }
}
