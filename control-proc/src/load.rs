//! What the loads of the axes do to their speeds and swings, by the mechanism and the payload of the machine file.
//!
//! ```text
//! g_i = max(1, sqrt(P_i / P_0i))          r_i = s_i min(1, sqrt(m_i / M_ii))          p_i = min(1, G_i(r_i) / G_i(1))
//! s_i = root of the part of the stiffness that the drained chamber has where g_i > 1, else 1        n_i = r_i / s_i^2
//! v_F = what the forces of the coming motion take of the speed (`forces`)
//! ```
//!
//! P_i force with which the load pulls in the direction of the motion, N, at rest and with the payload of the machine
//! file; P_0i the one from which on it overruns the axis ([`pipeline::machine::Overrun`]); M mass matrix of the
//! cylinders and m_i M_ii at the commissioning of the axis, kg; G(r) gain margin of the fallback whose load swings at r
//! times the frequency of the commissioning. The same command moves the axis g times as fast. A greater mass swings
//! slower on its spring of oil, and the gains are p times as large as those of the machine file, so that the margin
//! stays. A load that overruns its axis empties the chamber that is filled, and hangs on the oil of the other one alone
//! (`Cylinder::left`); until it is empty, g is less (`trapped`). With pressure feedback a newton counts n times as
//! much, so that the damping ratio stays.
//!
//! An axis of which no swing was found may swing under a greater mass, or on one chamber. Its swing is taken to be the
//! one of its oil (`Cylinder::frequency`), with a damping ratio of 0.1, and its gains leave a gain margin of 1.7, or as
//! much as at the commissioning where that was less:
//!
//! ```text
//! p_i = min(1, G_i(r_i) / min(1.7, G_i(1)))          s_i also where P_i / A > 2 MPa, A drained area in m2
//! ```
//!
//! Its r is by the frequency in the middle of the stroke, and greater towards the ends, where oil is stiffer. Behind a
//! valve that reacts slowly for such a swing, and without areas, volumes or oil, the gains stay.
//!
//! Runs in the loop: nothing here allocates after construction.

mod forces;
mod trapped;

use mechanism::{AXES, CylinderDynamics, PreparedMechanism, Vector};
use pipeline::{
    machine::{Axis, Commissioned, Control, Law, Machine, Oil, Overrun},
    message::{AxisSample, EncoderSample},
};

use crate::{
    cylinder::Cylinder,
    margins::{FAST_VALVE, LEAST_GAIN_MARGIN, Loop, mean_slope},
    payload::carrying,
};
use forces::Forces;
use trapped::Trapped;

/// T_F, s, of the slow part of a force: long beside a swing of 1 Hz, and short beside a change of posture.
pub const SLOW: f64 = 0.5;

/// Step of r at which p is known, and number of these steps: down to a sixth of the frequency of the commissioning.
const STEP: f64 = 0.05;
const STEPS: usize = 17;
/// g from which on the oil of one chamber alone carries the load.
const EMPTIED: f64 = 1.2;
/// Damping ratio of a swing that commissioning did not find.
const EXPECTED_DAMPING: f64 = 0.1;
/// Pressure of the drained chamber, Pa, from which on it alone is taken to carry a load whose swing was not found.
const HANGING: f64 = 2e6;

/// What the load does to one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Load {
    /// g of extending and of retracting.
    pub faster: [f64; 2],
    /// p at rest, of extending and of retracting.
    pub gain: [f64; 3],
    /// By how much a pressure counts more in the damping of the swing, in the same order.
    pub damping: [f64; 3],
    /// v_F: speed that the forces of the coming motion take, m/s.
    pub forces: f64,
}

impl Load {
    /// An axis whose load is not known, or is that of its commissioning.
    pub const USUAL: Self = Self { faster: [1.0; 2], gain: [1.0; 3], damping: [1.0; 3], forces: 0.0 };

    /// g of a motion in this direction.
    pub fn faster(&self, direction: f64) -> f64 {
        self.faster[usize::from(direction < 0.0)]
    }
}

/// Forces of the cylinders that hold the machine at rest, and its mass matrix, with the cylinders at `positions` m.
pub fn dynamics_at_rest(mechanism: &PreparedMechanism, positions: &[f64; AXES]) -> CylinderDynamics {
    mechanism.dynamics(&mechanism.pose(positions), &[0.0; AXES], Vector::default())
}

/// How the load of one axis changes what was commissioned.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Commissioning {
    overrun: Overrun,
    /// m, kg.
    mass: f64,
    /// p at r = 1, 1 - STEP, ..
    parts: [f64; STEPS + 1],
    /// None where areas and volumes are not known.
    cylinder: Option<Cylinder>,
    /// Whether no swing was found, and that of the cylinder's oil is expected.
    is_expected: bool,
}

impl Commissioning {
    /// An axis of which nothing is known.
    const NONE: Self = Self {
        overrun: Overrun::NONE,
        mass: f64::INFINITY,
        parts: [1.0; STEPS + 1],
        cylinder: None,
        is_expected: false,
    };

    fn of(axis: &Axis, oil: Option<&Oil>, period: f64) -> Self {
        let Some(model) = axis.commissioned.as_ref().filter(|_| !axis.control.without.load) else { return Self::NONE };
        let (overrun, cylinder) = (model.overrun, Cylinder::of(axis));
        let known = Self { overrun, cylinder, ..Self::NONE };
        if model.natural_frequency > 0.0 {
            return Self { mass: model.mass, parts: parts(&axis.control, model, period, f64::INFINITY), ..known };
        }
        let Some((cylinder, oil)) = cylinder.zip(oil).filter(|_| model.mass.is_finite()) else { return known };
        let natural_frequency = cylinder.frequency(model.mass, oil.bulk_modulus);
        let swinging = Commissioned { natural_frequency, damping: EXPECTED_DAMPING, ..model.clone() };
        let parts = parts(&axis.control, &swinging, period, LEAST_GAIN_MARGIN);
        let is_slow = |step: usize| model.reaction() * natural_frequency * relative(step) > FAST_VALVE;
        let parts = std::array::from_fn(|step| if is_slow(step) { 1.0 } else { parts[step] });
        Self { mass: model.mass, parts, is_expected: true, ..known }
    }

    /// What a load of this force (N) and mass (kg) does with the cylinder at `position` m.
    fn load(&self, force: f64, mass: f64, position: f64) -> Load {
        let faster = self.overrun.factors(force);
        let lighter = (self.mass / mass).sqrt().min(1.0);
        let softer = self.softer(force, faster, position);
        let expected = self.cylinder.filter(|_| self.is_expected);
        let stiffer = expected.map_or(1.0, |cylinder| cylinder.relative_frequency(position));
        Load {
            faster,
            gain: softer.map(|softer| self.part((lighter * softer * stiffer).min(1.0))),
            damping: softer.map(|softer| lighter / softer),
            forces: 0.0,
        }
    }

    /// s at rest, of extending and of retracting.
    fn softer(&self, force: f64, faster: [f64; 2], position: f64) -> [f64; 3] {
        let Some(cylinder) = self.cylinder else { return [1.0; 3] };
        let (left, drained) = (cylinder.left(position), cylinder.drained());
        let [extending, retracting] = [0, 1].map(|side| {
            let emptied = (faster[side] - 1.0) / (EMPTIED - 1.0);
            let pull = if side == 0 { -force } else { force };
            let hanging = if self.is_expected { pull / (HANGING * drained[side]) } else { 0.0 };
            1.0 + emptied.max(hanging).clamp(0.0, 1.0) * (left[side] - 1.0)
        });
        [1.0, extending, retracting]
    }

    /// p of this r.
    fn part(&self, r: f64) -> f64 {
        let steps = (1.0 - r) / STEP;
        let (whole, rest) = ((steps as usize).min(STEPS), steps.fract());
        let next = self.parts[(whole + 1).min(STEPS)];
        self.parts[whole] + rest * (next - self.parts[whole])
    }
}

/// p of the fallback of `control` around `model` at every step of r, so that its gain margin stays, or is `enough`.
fn parts(control: &Control, model: &Commissioned, period: f64, enough: f64) -> [f64; STEPS + 1] {
    let fallback = Control { law: Law::Predictive, ..*control };
    let gain_margin = |step: usize| {
        let slower = slower(model, relative(step));
        Loop::new(&fallback, &slower, mean_slope(model), period).margins().gain
    };
    let (usual, mut least) = (gain_margin(0).min(enough), 1.0f64);
    std::array::from_fn(|step| {
        least = least.min(gain_margin(step) / usual);
        least
    })
}

/// r of a step.
fn relative(step: usize) -> f64 {
    1.0 - STEP * step as f64
}

/// `model` with a load that swings at r times its frequency.
fn slower(model: &Commissioned, r: f64) -> Commissioned {
    let mut slower = Commissioned { natural_frequency: r * model.natural_frequency, ..model.clone() };
    slower.time_constant += slower.swing_delay() - model.swing_delay();
    slower
}

/// The loads of the axes of a mechanism.
#[derive(Debug, Clone, PartialEq)]
pub struct Loads {
    mechanism: PreparedMechanism,
    axes: [Commissioning; AXES],
    forces: [Option<Forces>; AXES],
    trapped: [Option<Trapped>; AXES],
    /// With an empty bucket and with the heaviest payload, where the payload is estimated.
    payloads: Option<[PreparedMechanism; 2]>,
    /// kg.
    heaviest: f64,
}

impl Loads {
    /// Of a machine with `[mechanism]` and its four axes; none for another one.
    pub fn of(machine: &Machine) -> Option<Self> {
        let axes: &[Axis; AXES] = machine.axes.first_chunk()?;
        let (period, mechanism) = (machine.timing.period.as_secs_f64(), machine.mechanism?);
        let oil = machine.hydraulics.as_ref().map(|hydraulics| &hydraulics.oil);
        let heaviest = machine.heaviest_payload;
        Some(Self {
            mechanism: mechanism.prepared(),
            payloads: heaviest.map(|heaviest| [0.0, heaviest].map(|mass| carrying(mechanism, mass))),
            heaviest: heaviest.unwrap_or(f64::INFINITY),
            axes: axes.each_ref().map(|axis| Commissioning::of(axis, oil, period)),
            forces: axes.each_ref().map(|axis| Forces::of(axis, period)),
            trapped: axes.each_ref().map(|axis| Trapped::of(axis, period)),
        })
    }

    /// Number of coming ticks whose references are used.
    pub fn ahead(&self) -> usize {
        self.forces.iter().flatten().map(Forces::ahead).max().unwrap_or_default()
    }

    /// What the loads do with the cylinders at `positions` m and `payload` kg in the bucket; without that, as much as
    /// the machine file says. `references` of the axes, m, begin with those of the last tick.
    pub fn at(
        &mut self,
        positions: &[f64; AXES],
        payload: Option<f64>,
        references: &[Option<&[f64]>; AXES],
    ) -> [Load; AXES] {
        let CylinderDynamics { mass, load } = self.dynamics(positions, &[0.0; AXES], payload);
        let mut all = std::array::from_fn(|i| self.axes[i].load(load[i], mass[i][i], positions[i]));
        let mut forces = self.forces;
        for (i, (load, forces)) in all.iter_mut().zip(&mut forces).enumerate() {
            let dynamics = |positions: &_, speeds: &_| self.dynamics(positions, speeds, payload);
            load.forces = forces.as_mut().map_or(0.0, |forces| forces.update(i, references, dynamics));
        }
        self.forces = forces;
        all
    }

    /// Lets the oil that the axes have trapped, by the pressures of `sample`, hold their loads back. `positions` and
    /// `references` as for [`Self::at`].
    pub fn hold_back(
        &mut self,
        all: &mut [Load; AXES],
        positions: &[f64; AXES],
        sample: &EncoderSample,
        references: &[Option<&[f64]>; AXES],
    ) {
        for (i, trapped) in self.trapped.iter_mut().enumerate() {
            let Some(trapped) = trapped else { continue };
            let pressures = sample.axes.get(i).and_then(AxisSample::pressures);
            all[i].faster = trapped.update(all[i].faster, positions[i], pressures, references[i]);
        }
    }

    /// Both force and mass are linear in the payload.
    fn dynamics(&self, positions: &[f64; AXES], speeds: &[f64; AXES], payload: Option<f64>) -> CylinderDynamics {
        let of = |of: &PreparedMechanism| of.dynamics(&of.pose(positions), speeds, Vector::default());
        let Some((payload, [empty, full])) = payload.zip(self.payloads.as_ref()) else { return of(&self.mechanism) };
        let (mut now, full) = (of(empty), of(full));
        let part = payload / self.heaviest;
        for i in 0..AXES {
            now.load[i] += part * (full.load[i] - now.load[i]);
            for j in 0..AXES {
                now.mass[i][j] += part * (full.mass[i][j] - now.mass[i][j]);
            }
        }
        now
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The arm hangs far out.
    const OUT: [f64; AXES] = [0.5, 0.3, 0.8, 0.6];

    /// The arm hangs down, the telescope is nearly in.
    const DOWN: [f64; AXES] = [0.85, 1.3, 0.15, 0.6];

    /// The built-in excavator with this payload, kg; without what commissioning found of loads and swings.
    fn excavator(payload: f64) -> Machine {
        let mut machine = Machine::load(None, &[]).unwrap();
        machine.mechanism.as_mut().unwrap().masses.payload.mass = payload;
        for model in machine.axes.iter_mut().filter_map(|axis| axis.commissioned.as_mut()) {
            (model.overrun, model.natural_frequency, model.mass) = (Overrun::NONE, 0.0, f64::INFINITY);
        }
        machine
    }

    /// Changes the commissioned model of the arm.
    fn arm(machine: &mut Machine, change: impl Fn(&mut Commissioned)) {
        change(machine.axes[1].commissioned.as_mut().unwrap());
    }

    #[test]
    fn a_payload_that_pulls_makes_an_axis_faster_and_a_heavy_one_takes_gain() {
        let at = |payload: f64, frequency: f64| {
            let mut machine = excavator(payload);
            arm(&mut machine, |model| {
                (model.overrun.extend, model.mass, model.natural_frequency) = (1e4, 2e4, frequency);
                (model.dead_time, model.time_constant, model.damping) = (0.0, 0.1, 0.1);
            });
            Loads::of(&machine).unwrap().at(&OUT, None, &[None; AXES])[1]
        };
        let (empty, loaded) = (at(0.0, 4.0), at(1500.0, 4.0));
        assert!(empty.faster[0] > 1.2 && loaded.faster[0] > 1.4 * empty.faster[0], "{empty:?} {loaded:?}");
        assert_eq!(loaded.faster[1], 1.0);
        assert_eq!((loaded.faster(0.1), loaded.faster(-0.1)), (loaded.faster[0], 1.0));
        let (light, heavy) = (empty.gain[0], loaded.gain[0]);
        assert!(light < 1.0 && heavy < 0.8 * light && heavy > 0.2, "{empty:?} {loaded:?}");
        // It falls inwards on its rod side alone.
        assert!(loaded.gain[1] < 0.8 * heavy && loaded.gain[2] == heavy, "{loaded:?}");
        assert!(loaded.damping[1] > 1.5 * loaded.damping[0] && loaded.damping[0] < 1.0, "{loaded:?}");
        assert_eq!(loaded.damping[0], loaded.damping[2]);
    }

    #[test]
    fn an_axis_of_which_no_swing_was_found_may_swing_on_its_oil() {
        let at = |payload: f64, change: &dyn Fn(&mut Axis)| {
            let mut machine = excavator(payload);
            let telescope = &mut machine.axes[2];
            (telescope.control.kp, telescope.control.ki) = (20.0, 20.0);
            let model = telescope.commissioned.as_mut().unwrap();
            (model.dead_time, model.time_constant, model.mass) = (0.03, 0.02, 1300.0);
            change(telescope);
            Loads::of(&machine).unwrap().at(&DOWN, None, &[None; AXES])[2].gain
        };
        let [rest, extending, retracting] = at(1500.0, &|_| {});
        assert!(extending < 0.8 && rest == 1.0 && retracting == 1.0, "it hangs on its rod side: {extending}");
        assert!(at(0.0, &|_| {})[1] > 1.1 * extending, "a light load swings faster");
        let slow = |axis: &mut Axis| axis.commissioned.as_mut().unwrap().time_constant = 0.3;
        let unknown = |axis: &mut Axis| axis.plant = None;
        let weightless = |axis: &mut Axis| axis.commissioned.as_mut().unwrap().mass = f64::INFINITY;
        let changes: [&dyn Fn(&mut Axis); 3] = [&slow, &unknown, &weightless];
        assert!(changes.iter().all(|change| at(1500.0, change) == [1.0; 3]));
    }

    #[test]
    fn the_gain_margin_of_the_commissioning_stays() {
        let mut machine = excavator(0.0);
        arm(&mut machine, |model| (model.natural_frequency, model.damping, model.dead_time) = (3.0, 0.1, 0.0));
        let (control, model) = (&machine.axes[1].control, machine.axes[1].commissioned.as_ref().unwrap());
        let parts = parts(control, model, 0.01, f64::INFINITY);
        assert_eq!(parts[0], 1.0);
        assert!(parts.is_sorted_by(|a, b| a >= b) && parts[STEPS] < 0.5, "{parts:?}");
        let margin = |r: f64, gain: f64| {
            let control = Control { kp: gain * control.kp, ki: gain * control.ki, law: Law::Predictive, ..*control };
            Loop::new(&control, &slower(model, r), mean_slope(model), 0.01).margins().gain
        };
        let (usual, slow) = (margin(1.0, 1.0), margin(0.5, parts[10]));
        assert!((slow / usual - 1.0).abs() < 1e-6, "{usual} {slow}");
    }

    #[test]
    fn an_estimated_payload_counts_as_one_of_the_machine_file() {
        let settings = [("mechanism.payload.heaviest", "3000"), ("axis.boom.pressure.resolution", "1e3")]
            .map(|(k, v)| (k.into(), v.into()));
        let (estimating, mut told) = (Machine::load(None, &settings).unwrap(), Machine::load(None, &[]).unwrap());
        for mass in [0.0, 400.0, 1500.0, 3000.0] {
            told.mechanism.as_mut().unwrap().masses.payload.mass = mass;
            let estimated = Loads::of(&estimating).unwrap().dynamics(&OUT, &[0.0; AXES], Some(mass));
            let expected = Loads::of(&told).unwrap().dynamics(&OUT, &[0.0; AXES], None);
            for i in 0..AXES {
                assert!((estimated.load[i] / expected.load[i] - 1.0).abs() < 1e-9, "{i} {mass}");
                assert!((estimated.mass[i][i] / expected.mass[i][i] - 1.0).abs() < 1e-9, "{i} {mass}");
            }
        }
    }

    #[test]
    fn without_a_mechanism_a_model_or_this_measure_nothing_changes() {
        assert_eq!(Loads::of(&Machine::four_axes(&[]).unwrap()), None);
        let mut machine = excavator(1500.0);
        let usual = [Load::USUAL; AXES];
        assert_eq!(Loads::of(&machine).unwrap().at(&OUT, None, &[None; AXES]), usual, "nothing was found");
        arm(&mut machine, |model| model.overrun.extend = 1e4);
        assert_ne!(Loads::of(&machine).unwrap().at(&OUT, None, &[None; AXES]), usual);
        machine.axes[1].control.without.load = true;
        assert_eq!(Loads::of(&machine).unwrap().at(&OUT, None, &[None; AXES]), usual);
        machine.axes.iter_mut().for_each(|axis| (axis.commissioned, axis.control.without.load) = (None, false));
        assert_eq!(Loads::of(&machine).unwrap().at(&OUT, None, &[None; AXES]), usual);
    }
}
