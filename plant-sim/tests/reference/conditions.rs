//! Changes of a parameter by a scenario, by the equations in `plant_sim::conditions` and `plant_sim::hydraulics::oil`.
//!
//! ```text
//! factor(t) = product of 1 + (factor - 1) c(t)        value(t) = value_0 + sum of (value - value before) c(t)
//! log10 log10(nu + 0.7) = a - b log10 T
//! ```

use pipeline::machine::{Change, Oil, Parameter};

/// The changes of a scenario for one axis at one time.
pub struct Conditions<'a> {
    pub changes: &'a [Change],
    pub axis: usize,
    /// s
    pub time: f64,
}

impl Conditions<'_> {
    fn of(&self, parameter: Parameter) -> impl Iterator<Item = (f64, f64)> {
        let mine = move |change: &&Change| change.parameter == parameter && change.axis.is_none_or(|a| a == self.axis);
        self.changes.iter().filter(mine).map(|change| {
            let length = change.end - change.start;
            let part = if self.time < change.start {
                0.0
            } else if length == 0.0 {
                1.0
            } else {
                ((self.time - change.start) / length).min(1.0)
            };
            (change.to, part)
        })
    }

    pub fn factor(&self, parameter: Parameter) -> f64 {
        self.of(parameter).map(|(to, part)| 1.0 + (to - 1.0) * part).product()
    }

    pub fn value(&self, parameter: Parameter, at_first: f64) -> f64 {
        let mut before = at_first;
        let mut value = at_first;
        for (to, part) in self.of(parameter) {
            value += (to - before) * part;
            before = to;
        }
        value
    }

    /// nu divided by that at the temperature of the machine file.
    pub fn viscosity(&self, oil: &Oil) -> f64 {
        walther(oil.viscosity, self.value(Parameter::Temperature, oil.temperature))
            / walther(oil.viscosity, oil.temperature)
    }
}

/// nu, mm2/s, through the points of a data sheet at 40 and 100 degrees Celsius.
fn walther((at_40, at_100): (f64, f64), celsius: f64) -> f64 {
    let ordinate = |nu: f64| (nu + 0.7).log10().log10();
    let abscissa = |celsius: f64| (celsius + 273.15).log10();
    let b = (ordinate(at_40) - ordinate(at_100)) / (abscissa(100.0) - abscissa(40.0));
    let a = ordinate(at_100) + b * abscissa(100.0);
    10f64.powf(10f64.powf(a - b * abscissa(celsius))) - 0.7
}
