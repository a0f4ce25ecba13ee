//! The conditions of an axis: the factors and values to which a scenario has changed the axis' parameters at one time,
//! and what the bucket of a mechanism works on. Only [`acting`] allocates, at construction.
//!
//! ```text
//! c(t) = clamp((t - start)/(end - start), 0, 1)
//! factor(t) = product over the changes of 1 + (factor - 1) c(t)
//! value(t)  = value_0 + sum over the changes of (value - value before) c(t)
//! ```
//!
//! t, start and end in s; c part of the change that has happened. A change with start = end is a step. A temperature
//! acts through the viscosity nu of the oil by Walther's law ([`crate::hydraulics::oil`]). nu is relative to the
//! viscosity at the temperature of the machine file, `[oil] temperature`:
//!
//! | parameter | proportional to | reason |
//! |---|---|---|
//! | viscous friction | nu | shear of an oil film |
//! | leakage | 1/nu | laminar flow in a gap |
//! | valve time constant | nu^(1/2) | assumed: flow in the pilot line between laminar, nu^1, and turbulent, nu^0 |
//!
//! Trap: a parameter that jumps between the stages of one Runge-Kutta step costs the method its order. Conditions are
//! therefore constant during a step, with their values in its middle. A change that is a step acts from the integration
//! step on whose middle is not before it.

use mechanism::AXES;
use pipeline::machine::{Change, Oil, Parameter, Scenario};

use crate::hydraulics::oil::viscosity;

/// Factors of the parameters of one axis at one time, and the values that a scenario sets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conditions {
    /// Factor of the rated flow.
    pub flow_gain: f64,
    /// Factor of all friction.
    pub friction: f64,
    /// Factor of the mass.
    pub mass: f64,
    /// Factor of the load force.
    pub load_force: f64,
    /// Factor of the valve's time constant; it includes the influence of the oil's viscosity.
    pub valve_time_constant: f64,
    /// Factor of both dead bands.
    pub dead_band: f64,
    /// Factor of the hysteresis.
    pub hysteresis: f64,
    /// Factor of internal and external leakage and of that of the spool, without the influence of the oil's viscosity.
    pub leakage: f64,
    /// Force against extension, divided by supply pressure times piston area.
    pub external_force: f64,
    /// Factor of the pump's largest pressure.
    pub supply_pressure: f64,
    /// Factor of the pump's largest flow and of its power.
    pub pump_flow: f64,
    /// Factor of the oil's bulk modulus.
    pub bulk_modulus: f64,
    /// Factor of the air in the oil.
    pub air: f64,
    /// Viscosity of the oil divided by that at the temperature of the machine file.
    pub viscosity: f64,
}

impl Conditions {
    /// Conditions under which every parameter has the value of the machine file.
    pub const NOMINAL: Self = Self {
        flow_gain: 1.0,
        friction: 1.0,
        mass: 1.0,
        load_force: 1.0,
        valve_time_constant: 1.0,
        dead_band: 1.0,
        hysteresis: 1.0,
        leakage: 1.0,
        external_force: 0.0,
        supply_pressure: 1.0,
        pump_flow: 1.0,
        bulk_modulus: 1.0,
        air: 1.0,
        viscosity: 1.0,
    };

    /// Conditions of the axis with the number `axis` at `time` s.
    pub fn at(changes: &[Change], oil: &Oil, axis: usize, time: f64) -> Self {
        Self::with(changes, oil.temperature, axis, time, |temperature| relative_viscosity(oil, temperature))
    }

    /// [`Self::at`], when the machine file holds for `file_temperature` and `viscosity` returns the viscosity of the
    /// oil at a temperature divided by that: a caller that asks for several axes can keep it.
    pub fn with(
        changes: &[Change],
        file_temperature: f64,
        axis: usize,
        time: f64,
        viscosity: impl Fn(f64) -> f64,
    ) -> Self {
        let mut conditions = Self::NOMINAL;
        let (mut temperature, mut last_temperature) = (file_temperature, file_temperature);
        let mut last_force = 0.0;
        for change in changes.iter().filter(|change| change.axis.is_none_or(|index| index == axis)) {
            let part = part(change, time);
            match conditions.factor(change.parameter) {
                Some(factor) => *factor *= 1.0 + (change.to - 1.0) * part,
                None if change.parameter == Parameter::Temperature => {
                    temperature += (change.to - last_temperature) * part;
                    last_temperature = change.to;
                }
                None if change.parameter == Parameter::ExternalForce => {
                    conditions.external_force += (change.to - last_force) * part;
                    last_force = change.to;
                }
                // Of the machine and not of an axis: [`Work`].
                None => {}
            }
        }
        if temperature != file_temperature {
            conditions.viscosity = viscosity(temperature);
            conditions.valve_time_constant *= conditions.viscosity.sqrt();
        }
        conditions
    }

    /// The factor of `parameter`, or `None` where a change sets the value of the parameter.
    fn factor(&mut self, parameter: Parameter) -> Option<&mut f64> {
        Some(match parameter {
            Parameter::FlowGain => &mut self.flow_gain,
            Parameter::Friction => &mut self.friction,
            Parameter::Mass => &mut self.mass,
            Parameter::LoadForce => &mut self.load_force,
            Parameter::ValveTimeConstant => &mut self.valve_time_constant,
            Parameter::DeadBand => &mut self.dead_band,
            Parameter::Hysteresis => &mut self.hysteresis,
            Parameter::Leakage => &mut self.leakage,
            Parameter::SupplyPressure => &mut self.supply_pressure,
            Parameter::PumpFlow => &mut self.pump_flow,
            Parameter::BulkModulus => &mut self.bulk_modulus,
            Parameter::Air => &mut self.air,
            Parameter::ExternalForce | Parameter::Temperature | Parameter::Payload | Parameter::Soil => return None,
        })
    }
}

/// What the bucket of the mechanism works on at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Work {
    /// Mass that the bucket carries, kg.
    pub payload: f64,
    /// Strength of the soil as a part of that in the machine file.
    pub soil: f64,
}

impl Work {
    /// At `time` s, when the bucket carries `payload` kg before all changes.
    pub fn at(changes: &[Change], payload: f64, time: f64) -> Self {
        let value = |parameter, first: f64| {
            let own = changes.iter().filter(|change| change.parameter == parameter);
            let follow = |(value, last), change: &Change| (value + (change.to - last) * part(change, time), change.to);
            own.fold((first, first), follow).0
        };
        Self { payload: value(Parameter::Payload, payload), soil: value(Parameter::Soil, 0.0) }
    }
}

/// `scenario` on a machine with `axes` axes. Where soil acts on the teeth of a mechanism (`has_soil`), no other
/// external force acts on the axes of the mechanism.
pub fn acting(scenario: &Scenario, axes: usize, has_soil: bool) -> Scenario {
    let on_axes = |change: Change| {
        let acts = move |axis: &usize| *axis >= AXES || change.parameter != Parameter::ExternalForce || !has_soil;
        let all = 0..axes;
        let axes = match change.axis {
            None if all.clone().all(|axis| acts(&axis)) => vec![None],
            None => all.filter(acts).map(Some).collect(),
            Some(axis) => Some(axis).filter(acts).map(Some).into_iter().collect(),
        };
        axes.into_iter().map(move |axis| Change { axis, ..change })
    };
    Scenario { changes: scenario.changes.iter().copied().flat_map(on_axes).collect(), ..scenario.clone() }
}

/// Viscosity of `oil` at `temperature` degrees Celsius divided by that at the temperature of the machine file.
pub fn relative_viscosity(oil: &Oil, temperature: f64) -> f64 {
    viscosity(oil.viscosity, temperature) / viscosity(oil.viscosity, oil.temperature)
}

/// c, part of a change that has happened.
fn part(change: &Change, time: f64) -> f64 {
    if time < change.start {
        0.0
    } else if time >= change.end {
        1.0
    } else {
        (time - change.start) / (change.end - change.start)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OIL: Oil = Oil { bulk_modulus: 1.4e9, air: 0.01, temperature: 50.0, viscosity: (46.0, 6.8) };

    fn change(parameter: Parameter, start: f64, end: f64, to: f64) -> Change {
        Change { axis: None, parameter, start, end, to }
    }

    #[test]
    fn a_ramp_is_linear_and_stays_at_its_end() {
        let ramp = [change(Parameter::FlowGain, 8.0, 16.0, 0.6)];
        for (time, expected) in [(0.0, 1.0), (8.0, 1.0), (12.0, 0.8), (16.0, 0.6), (1e6, 0.6)] {
            let conditions = Conditions::at(&ramp, &OIL, 0, time);
            assert!((conditions.flow_gain - expected).abs() < 1e-12, "{time} s: {conditions:?}");
            assert_eq!(Conditions { flow_gain: 1.0, ..conditions }, Conditions::NOMINAL);
        }
    }

    #[test]
    fn a_change_without_length_is_a_step() {
        let step = [change(Parameter::Mass, 2.0, 2.0, 3.0)];
        assert_eq!(Conditions::at(&step, &OIL, 0, 1.999).mass, 1.0);
        assert_eq!(Conditions::at(&step, &OIL, 0, 2.0).mass, 3.0);
    }

    #[test]
    fn factors_of_one_parameter_multiply_and_values_follow_each_other() {
        let leakage = [change(Parameter::Leakage, 1.0, 1.0, 2.0), change(Parameter::Leakage, 2.0, 2.0, 4.0)];
        assert_eq!(Conditions::at(&leakage, &OIL, 0, 3.0).leakage, 8.0);
        let force = [change(Parameter::ExternalForce, 1.0, 2.0, 0.4), change(Parameter::ExternalForce, 3.0, 4.0, -0.2)];
        for (time, expected) in [(0.5, 0.0), (1.5, 0.2), (2.5, 0.4), (3.5, 0.1), (5.0, -0.2)] {
            let found = Conditions::at(&force, &OIL, 0, time).external_force;
            assert!((found - expected).abs() < 1e-12, "{time}: {found}");
        }
    }

    #[test]
    fn payload_and_soil_follow_their_values() {
        let work = [
            change(Parameter::Payload, 1.0, 2.0, 1500.0),
            change(Parameter::Soil, 2.0, 4.0, 1.0),
            change(Parameter::Payload, 3.0, 3.0, 0.0),
        ];
        for (time, payload, soil) in [(0.0, 200.0, 0.0), (1.5, 850.0, 0.0), (2.5, 1500.0, 0.25), (3.0, 0.0, 0.5)] {
            assert_eq!(Work::at(&work, 200.0, time), Work { payload, soil }, "{time} s");
            assert_eq!(Conditions::at(&work, &OIL, 0, time), Conditions::NOMINAL);
        }
    }

    #[test]
    fn a_change_of_one_axis_leaves_the_others_alone() {
        let one = [Change { axis: Some(2), ..change(Parameter::Mass, 0.0, 0.0, 3.0) }];
        let mass = [0, 1, 2, 3].map(|axis| Conditions::at(&one, &OIL, axis, 1.0).mass);
        assert_eq!(mass, [1.0, 1.0, 3.0, 1.0]);
    }

    #[test]
    fn cold_oil_is_viscous_and_makes_the_valve_slow() {
        let cold = [change(Parameter::Temperature, 0.0, 0.0, 5.0)];
        let conditions = Conditions::at(&cold, &OIL, 0, 0.0);
        let expected = viscosity(OIL.viscosity, 5.0) / viscosity(OIL.viscosity, 50.0);
        assert_eq!(conditions.viscosity, expected);
        assert!((10.0..20.0).contains(&expected), "{expected}");
        assert_eq!(conditions.valve_time_constant, expected.sqrt());
        let warm = Conditions::at(&[cold[0], change(Parameter::Temperature, 8.0, 16.0, 50.0)], &OIL, 0, 16.0);
        assert!((warm.viscosity - 1.0).abs() < 1e-12);
    }
}
