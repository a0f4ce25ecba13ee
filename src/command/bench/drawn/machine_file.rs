//! The machine file of a drawn machine, as an engineer with the data sheets would write it.
//!
//! | key | chosen as |
//! |---|---|
//! | `max_speed` | 1.5 times the speed of the faster direction with the valve fully open |
//! | `soft_limits` | 5 % of the stroke before either end |
//! | `kp` | 0.3 / (v t_r), until commissioning finds a better one |
//! | `following_error` | 30 mm, or 5 % of the stroke, or the way in 3 t_r at the largest speed of a task |
//! | `tolerance` of the encoder | 5 mm, or 5 counts |
//! | `command_rate` | 10/s |
//! | pump | half more flow than the faster direction needs |
//!
//! v speed of the slower direction m/s, t_r time from a command to its motion s ([`Rig::reaction`]).
//!
//! The change of the plant is a scenario of the file, [`SCENARIO`]. It is not chosen in the file, so that `commission`
//! sees the machine before it.

use std::{fmt::Write as _, path::Path};

use pipeline::machine::{Machine, MachineError, Target};

use super::{
    rig::{RETURN_PRESSURE, Rig},
    task::Task,
};

/// Name of the one axis.
pub const AXIS: &str = "rig";
/// Name of the scenario with the change of the plant.
pub const SCENARIO: &str = "change";
/// Pressure drop at which the flow of the valve is stated, Pa.
const RATED_DROP: f64 = 1e6;
/// Dead volumes of the cylinder, as a part of its displacement.
const DEAD_VOLUME: f64 = 0.1;
/// Standard deviation of the encoder's noise, in counts.
const NOISE_COUNTS: f64 = 0.3;
/// Part of the viscous friction up to which bristles are damped: the LuGre model loses energy at every speed below 1.
const BRISTLE_DAMPING: f64 = 0.8;

/// The machine that the file describes, with other values for some keys.
///
/// # Errors
/// A drawn value is not one that a machine file may have: an error of this program.
pub fn machine(rig: &Rig, task: Task, settings: &[(String, String)]) -> Result<Machine, MachineError> {
    Machine::parse(&text(rig, task), &format!("machine {}", rig.number), Path::new("."), settings)
}

/// Soft limits, m.
fn soft_limits(rig: &Rig) -> (f64, f64) {
    (0.05 * rig.stroke, 0.95 * rig.stroke)
}

/// The text of the file.
pub fn text(rig: &Rig, task: Task) -> String {
    let mut text = head(rig, task);
    let parts = [axis(rig), reference(rig, task), cylinder(rig), valve(rig)];
    parts.iter().for_each(|part| text += part);
    text
}

fn head(rig: &Rig, task: Task) -> String {
    let Rig { number, period_ms, pressure, change, .. } = rig;
    let flow = 1.5 * rig.areas().0 * fastest(rig);
    let mut changes = String::new();
    for (parameter, to) in &change.changes {
        let key = if matches!(parameter.target(), Target::Factor(_)) { "factor" } else { "value" };
        // Writing to a string cannot fail.
        let _ = writeln!(
            changes,
            "  {{ parameter = \"{}\", start = {:?}, end = {:?}, {key} = {to:?} }},",
            parameter.name(),
            change.start,
            change.end
        );
    }
    format!(
        "# Machine {number} of a drawn set, with the task \"{}\".\n\
         #   hydraxis commission FILE --out model.toml\n\
         #   hydraxis simulate FILE --model model.toml --scenario {SCENARIO}\n\
         name = \"machine {number}\"\n\n\
         [scenarios.{SCENARIO}]\nsummary = \"{}\"\nchanges = [\n{changes}]\n\n\
         [timing]\nperiod = \"{period_ms}ms\"\n\n[source]\nkind = \"sim\"\n\n\
         [supply]\npressure = {pressure:?}\nreturn_pressure = {RETURN_PRESSURE:?}\nflow = {flow:?}\n\n\
         [oil]\nbulk_modulus = 1.4e9\n",
        task.name(),
        change.name,
    )
}

/// Speed of the faster direction with the valve fully open, m/s.
fn fastest(rig: &Rig) -> f64 {
    let [extend, retract] = rig.speeds();
    extend.max(retract)
}

fn axis(rig: &Rig) -> String {
    let Rig { stroke, resolution, .. } = rig;
    let (low, high) = soft_limits(rig);
    let max_speed = 1.5 * fastest(rig);
    let kp = 0.3 / (rig.speed * rig.reaction());
    let following_error = (0.05 * stroke).max(0.03).max(3.0 * rig.reaction() * 0.3 * rig.speed);
    let tolerance = (5.0 * resolution).max(5e-3);
    format!(
        "\n[axis.{AXIS}]\nstroke = {stroke:?}\nmax_speed = {max_speed:?}\nsoft_limits = [{low:?}, {high:?}]\n\
         \n[axis.{AXIS}.encoder]\nresolution = {resolution:?}\ntolerance = {tolerance:?}\n\
         \n[axis.{AXIS}.identification]\ntraining = \"8s\"\n\
         \n[axis.{AXIS}.control]\nkp = {kp:?}\nki = 0.0\ndead_band_extend = 0.0\ndead_band_retract = 0.0\n\
         command_limit = 1.0\ncommand_rate = 10.0\nfollowing_error = {following_error:?}\n"
    )
}

fn reference(rig: &Rig, task: Task) -> String {
    let points = task.points(rig, soft_limits(rig));
    let (times, positions): (Vec<f64>, Vec<f64>) = points.into_iter().unzip();
    format!("\n[axis.{AXIS}.reference]\nkind = \"ramps\"\ntimes = {times:?}\npositions = {positions:?}\n")
}

fn cylinder(rig: &Rig) -> String {
    let (piston, rod) = rig.areas();
    let [piston_dead, rod_dead] = [piston, rod].map(|area| DEAD_VOLUME * area * rig.stroke);
    let coulomb = rig.coulomb_friction();
    let viscous = rig.viscous_friction();
    let damping = BRISTLE_DAMPING * viscous * (1.0 / (rig.static_ratio - 1.0)).min(1.0);
    format!(
        "\n[axis.{AXIS}.plant]\ninitial_position = {:?}\npiston_area = {piston:?}\nrod_area = {rod:?}\n\
         piston_dead_volume = {piston_dead:?}\nrod_dead_volume = {rod_dead:?}\n\
         mass = {:?}\nload_force = {:?}\nviscous_friction = {viscous:?}\ncoulomb_friction = {coulomb:?}\n\
         static_friction = {:?}\nstribeck_speed = 0.01\nbristle_damping = {damping:?}\ninternal_leakage = 2e-13\n",
        0.5 * rig.stroke,
        rig.mass(),
        rig.loads(),
        rig.static_ratio * coulomb,
    )
}

fn valve(rig: &Rig) -> String {
    let curve = if rig.is_s_shaped { "s" } else { "linear" };
    format!(
        "rated_flow = {:?}\nrated_pressure_drop = {RATED_DROP:?}\nvalve_curve = \"{curve}\"\n\
         dead_band_extend = {:?}\ndead_band_retract = {:?}\nsaturation_extend = {:?}\nsaturation_retract = {:?}\n\
         hysteresis = {:?}\nvalve_time_constant = {:?}\ndead_time = {:?}\nencoder_noise = {:?}\n",
        rig.valve_gain() * RATED_DROP.sqrt(),
        rig.dead_band.extend,
        rig.dead_band.retract,
        rig.saturation.extend,
        rig.saturation.retract,
        rig.hysteresis,
        rig.valve_time_constant(),
        rig.dead_time,
        NOISE_COUNTS * rig.resolution,
    )
}
