//! The load: forces of the machine on the piston by gravity, elasticity and contact.
//!
//! ```text
//! F_L(y) = c_0 + c_1 x + c_2 x^2 + F_ext + K (x - L/2)        x = min(max(y, 0), L)
//! ```
//!
//! F_L force against extension, N; y position, m; L stroke, m; K stiffness in equation (9), N/m; F_ext force that a
//! scenario adds, N. The parabola goes through the force at both ends and in the middle of the stroke. An engineer can
//! measure these forces: they are A1 p1 - A2 p2 of the axis at rest. Inside an end stop the force is that at the stop,
//! because a parabola that falls faster than the stop's spring rises would pull the piston through the stop.
//!
//! Why a parabola: a cylinder that turns a joint is pinned at the distances a and b from the joint. It has the length
//! l = l_0 + y, the angle gamma between a and b with cos(gamma) = (a^2 + b^2 - l^2)/(2 a b), and the lever arm
//! a b sin(gamma)/l. A weight W whose centre is at the distance R from the joint, at the angle gamma + phi to the
//! horizontal, needs the force
//!
//! ```text
//! F_L = W R cos(gamma + phi) l/(a b sin(gamma))
//! ```
//!
//! For linkages of an excavator's boom the parabola stays within 3.5 % of this force; a test shows it.
//!
//! Trap: the mass that acts on the cylinder changes with the lever arm, too. This model keeps the mass constant.

use pipeline::machine::Plant;

use crate::lanes::{LANES, Lanes, lanes, positive};

/// Load of one axis (`T = f64`) or of four (`T = Lanes`): the coefficients of F_L(y) as one parabola.
#[derive(Debug, Clone, Copy)]
pub struct Load<T> {
    /// Force at position 0, N.
    pub force: T,
    /// Slope of the force at position 0, N/m.
    pub slope: T,
    /// Half the second derivative of the force, N/m2.
    pub curvature: T,
    /// L, m.
    pub stroke: T,
}

impl Load<f64> {
    /// Load of `plant` with `stroke` m. `gravity` is a factor of the force by gravity, `external` is F_ext in N.
    pub fn new(plant: &Plant, stroke: f64, gravity: f64, external: f64) -> Self {
        let force = plant.load_force;
        let (first, middle, last) = (gravity * force.retracted, gravity * force.middle, gravity * force.extended);
        let elasticity = plant.load_stiffness;
        Self {
            force: first + external - 0.5 * elasticity * stroke,
            slope: (4.0 * middle - 3.0 * first - last) / stroke + elasticity,
            curvature: 2.0 * (first - 2.0 * middle + last) / (stroke * stroke),
            stroke,
        }
    }

    /// Force against extension at `position` m, N.
    pub fn at(&self, position: f64) -> f64 {
        let within = position.clamp(0.0, self.stroke);
        self.force + within * (self.slope + within * self.curvature)
    }

    /// Largest absolute slope of the force, N/m.
    pub fn steepest(&self) -> f64 {
        self.slope.abs().max((self.slope + 2.0 * self.curvature * self.stroke).abs())
    }

    /// Largest absolute force, N: at an end of the stroke or at the vertex of the parabola.
    pub fn largest(&self) -> f64 {
        let turn = -0.5 * self.slope / self.curvature;
        let turn = if turn.is_finite() { turn } else { 0.0 };
        [0.0, turn, self.stroke].map(|position| self.at(position).abs()).into_iter().fold(0.0, f64::max)
    }
}

impl Load<Lanes> {
    /// Puts four axes side by side.
    pub fn pack(axes: &[Load<f64>; LANES]) -> Self {
        Self {
            force: lanes(axes, |load| load.force),
            slope: lanes(axes, |load| load.slope),
            curvature: lanes(axes, |load| load.curvature),
            stroke: lanes(axes, |load| load.stroke),
        }
    }

    /// Force against extension at `position` m, N.
    #[inline]
    pub fn at(&self, position: Lanes) -> Lanes {
        let within = positive(position).fast_min(self.stroke);
        self.force + within * (self.slope + within * self.curvature)
    }
}

#[cfg(test)]
mod tests {
    use pipeline::machine::{LoadForce, Machine};

    use super::*;

    fn boom() -> (Plant, f64) {
        let machine = Machine::four_axes(&[]).unwrap();
        (machine.axes[0].plant.clone().unwrap(), machine.axes[0].stroke)
    }

    #[test]
    fn the_parabola_meets_the_given_forces_at_both_ends_and_in_the_middle() {
        let (mut plant, stroke) = boom();
        plant.load_force = LoadForce { retracted: 1e5, middle: 1.3e5, extended: -2e4 };
        plant.load_stiffness = 3e4;
        let load = Load::new(&plant, stroke, 2.0, 5e3);
        let elastic = 3e4 * 0.5 * stroke;
        let (first, last) = (2e5 - elastic, -4e4 + elastic);
        for (position, expected) in
            [(-1.0, first), (0.0, first), (0.5 * stroke, 2.6e5), (stroke, last), (stroke + 1.0, last)]
        {
            assert!((load.at(position) - expected - 5e3).abs() < 1e-6, "{position}");
            let four = Load::pack(&[load; LANES]).at(Lanes::splat(position)).to_array();
            assert_eq!(four, [load.at(position); LANES]);
        }
    }

    #[test]
    fn a_parabola_approximates_gravity_on_a_booms_linkage() {
        // Machines of about 20 t: pins at a and b, cylinder of length l_0 when retracted. The boom swings by 95 to 127
        // degrees, as far below the horizontal as above it.
        let (mut plant, stroke) = boom();
        for (a, b, l_0) in [(0.85, 2.4, 1.75), (0.75, 2.4, 1.75), (0.9, 2.5, 1.8), (0.8, 2.3, 1.7)] {
            let gamma = |y: f64| -> f64 { ((a * a + b * b - (l_0 + y) * (l_0 + y)) / (2.0f64 * a * b)).acos() };
            let phi = -0.5 * (gamma(0.0) + gamma(stroke));
            let gravity = |y: f64| 60e3 * (gamma(y) + phi).cos() * (l_0 + y) / (a * b * gamma(y).sin());
            plant.load_force =
                LoadForce { retracted: gravity(0.0), middle: gravity(0.5 * stroke), extended: gravity(stroke) };
            let load = Load::new(&plant, stroke, 1.0, 0.0);
            let positions = || (0..=100).map(|i| 0.01 * f64::from(i) * stroke);
            assert!(positions().all(|y| gravity(y).is_finite()));
            let largest = positions().map(gravity).fold(0.0, f64::max);
            let worst = positions().map(|y| (load.at(y) - gravity(y)).abs()).fold(0.0, f64::max);
            println!("{:?}: within {:.2} % of {largest:.0} N", plant.load_force, 100.0 * worst / largest);
            assert!(worst < 0.035 * largest);
        }
    }
}
