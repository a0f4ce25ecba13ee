//! Parameters that change over time.
//!
//! ```text
//! factor(t) = 1 + (factor - 1) clamp((t - start)/(end - start), 0, 1)
//! ```
//!
//! t, start and end in s; a schedule with start = end is a step. Schedules of the same parameter multiply.
//!
//! The trap: a parameter that jumps between the stages of one Runge-Kutta step costs the method its order. Factors are
//! therefore taken at times that are multiples of [`UPDATE_PERIOD_NS`], whatever the step is, and held between.

use pipeline::machine::{Parameter, Schedule};

/// How often factors are taken anew, ns: 1 ms, a whole number of steps, far shorter than a control period and too short
/// to see in a ramp. A schedule that is a step acts up to this much late.
pub const UPDATE_PERIOD_NS: u64 = 1_000_000;

/// What each parameter is multiplied by at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Factors {
    /// Of the rated flow.
    pub flow_gain: f64,
    /// Of viscous, Coulomb and static friction.
    pub friction: f64,
    /// Of the mass.
    pub mass: f64,
    /// Of the load force.
    pub load_force: f64,
    /// Of the supply pressure.
    pub supply_pressure: f64,
    /// Of the valve's time constant.
    pub valve_time_constant: f64,
    /// Of both dead bands.
    pub dead_band: f64,
    /// Of the bulk modulus.
    pub bulk_modulus: f64,
    /// Of internal and external leakage.
    pub leakage: f64,
}

impl Factors {
    /// Nothing changed yet.
    pub const ONE: Self = Self {
        flow_gain: 1.0,
        friction: 1.0,
        mass: 1.0,
        load_force: 1.0,
        supply_pressure: 1.0,
        valve_time_constant: 1.0,
        dead_band: 1.0,
        bulk_modulus: 1.0,
        leakage: 1.0,
    };

    /// Factors of `schedules` at `time` s.
    pub fn at(schedules: &[Schedule], time: f64) -> Self {
        let mut factors = Self::ONE;
        for schedule in schedules {
            *factors.of(schedule.parameter) *= factor(schedule, time);
        }
        factors
    }

    /// The factor of one parameter.
    pub fn of(&mut self, parameter: Parameter) -> &mut f64 {
        match parameter {
            Parameter::FlowGain => &mut self.flow_gain,
            Parameter::Friction => &mut self.friction,
            Parameter::Mass => &mut self.mass,
            Parameter::LoadForce => &mut self.load_force,
            Parameter::SupplyPressure => &mut self.supply_pressure,
            Parameter::ValveTimeConstant => &mut self.valve_time_constant,
            Parameter::DeadBand => &mut self.dead_band,
            Parameter::BulkModulus => &mut self.bulk_modulus,
            Parameter::Leakage => &mut self.leakage,
        }
    }
}

fn factor(schedule: &Schedule, time: f64) -> f64 {
    if time < schedule.start {
        1.0
    } else if time >= schedule.end {
        schedule.factor
    } else {
        1.0 + (schedule.factor - 1.0) * (time - schedule.start) / (schedule.end - schedule.start)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_is_linear_and_stays_at_its_end() {
        let ramp = [Schedule { parameter: Parameter::FlowGain, start: 8.0, end: 16.0, factor: 0.6 }];
        for (time, expected) in [(0.0, 1.0), (8.0, 1.0), (12.0, 0.8), (16.0, 0.6), (1e6, 0.6)] {
            let factors = Factors::at(&ramp, time);
            assert!((factors.flow_gain - expected).abs() < 1e-12, "{time} s: {factors:?}");
            assert_eq!(Factors { flow_gain: 1.0, ..factors }, Factors::ONE);
        }
    }

    #[test]
    fn a_schedule_without_length_is_a_step() {
        let step = [Schedule { parameter: Parameter::Mass, start: 2.0, end: 2.0, factor: 3.0 }];
        assert_eq!(Factors::at(&step, 1.999).mass, 1.0);
        assert_eq!(Factors::at(&step, 2.0).mass, 3.0);
    }

    #[test]
    fn schedules_of_the_same_parameter_multiply() {
        let of = |start, factor| Schedule { parameter: Parameter::Leakage, start, end: start, factor };
        assert_eq!(Factors::at(&[of(1.0, 2.0), of(2.0, 4.0)], 3.0).leakage, 8.0);
    }
}
