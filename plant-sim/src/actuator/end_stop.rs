//! The end stops: springs with dampers that push the piston and never pull it.
//!
//! ```text
//! F_stop = max(0, -k_s y - c_s v) for y < 0,  -max(0, k_s (y - L) + c_s v) for y > L
//! ```
//!
//! F_stop force on the piston, N, positive in the direction of extension; y position, m; v speed, m/s; L stroke, m; k_s
//! stiffness, N/m; c_s damping, N s/m.
//!
//! Trap: a damper that could pull would hold the piston back when it leaves the stop.

use pipeline::machine::Plant;

use crate::lanes::{LANES, Lanes, lanes, positive};

/// End stops of one axis (`T = f64`) or of four (`T = Lanes`).
#[derive(Debug, Clone, Copy)]
pub struct EndStops<T> {
    /// L, m.
    pub stroke: T,
    /// k_s, N/m.
    pub stiffness: T,
    /// c_s, N s/m.
    pub damping: T,
}

impl EndStops<f64> {
    /// Stops of `plant` with `stroke` m between them.
    pub fn new(plant: &Plant, stroke: f64) -> Self {
        Self { stroke, stiffness: plant.end_stop_stiffness, damping: plant.end_stop_damping }
    }
}

impl EndStops<Lanes> {
    /// Puts four axes side by side.
    pub fn pack(axes: &[EndStops<f64>; LANES]) -> Self {
        Self {
            stroke: lanes(axes, |stops| stops.stroke),
            stiffness: lanes(axes, |stops| stops.stiffness),
            damping: lanes(axes, |stops| stops.damping),
        }
    }

    /// Force of the stops on the piston, N.
    #[inline]
    pub fn force(&self, position: Lanes, velocity: Lanes) -> Lanes {
        let damping = self.damping * velocity;
        let below = positive(-position);
        let above = positive(position - self.stroke);
        let touched = |depth: Lanes, force: Lanes| depth.simd_gt(Lanes::ZERO).select(positive(force), Lanes::ZERO);
        touched(below, self.stiffness * below - damping) - touched(above, self.stiffness * above + damping)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STOPS: EndStops<f64> = EndStops { stroke: 1.3, stiffness: 2e8, damping: 4e6 };

    fn force(position: f64, velocity: f64) -> f64 {
        EndStops::pack(&[STOPS; LANES]).force(Lanes::splat(position), Lanes::splat(velocity)).to_array()[0]
    }

    #[test]
    fn the_stops_push_towards_the_stroke_and_never_pull() {
        for (position, velocity, expected) in [
            (0.65, 1.0, 0.0),
            (0.0, -1.0, 0.0),
            (1.3, 1.0, 0.0),
            (-1e-3, 0.0, 2e5),
            (-1e-3, -0.1, 6e5),
            (-1e-3, 0.2, 0.0),
            (1.301, 0.0, -2e5),
            (1.301, 0.1, -6e5),
            (1.301, -0.2, 0.0),
        ] {
            assert!((force(position, velocity) - expected).abs() < 1e-3, "{position} {velocity}");
        }
    }

    #[test]
    fn a_mass_leaves_a_stop_slower_than_it_arrived() {
        let mass = 4e3;
        for speed in [0.01, 0.1, 0.5, 1.5] {
            let (mut y, mut v, step) = (1e-3, -speed, 1e-7);
            while v < 0.0 || y < 1e-3 {
                v += step * force(y, v) / mass;
                y += step * v;
            }
            println!("in at {speed} m/s, out at {v} m/s");
            assert!(v > 0.0 && v < speed, "{speed} {v}");
        }
    }
}
