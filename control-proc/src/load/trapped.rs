//! Oil that is trapped in the chamber that a motion fills, and keeps a load from overrunning its axis.
//!
//! ```text
//! g' = g + f (h - g) p/(p + p_a)          h = min(g, 1 - n + n g sqrt(1 + A_1 p/P))          n = k_2/(k_1 + k_2)
//! f  = min(1, max(0, 2 - x/(0.05 S)))
//! ```
//!
//! g by how much the load that pulls with P N makes the axis faster, and g' by how much it does now; 1 chamber that is
//! filled and 2 the one that is drained, A area in m2, k stiffness of their oil ([`Cylinder`]); p pressure of chamber
//! 1 in Pa, the least since the reference began to move, x the way that it has gone since in m, S stroke in m; p_a
//! [`SOFT`]. An axis that has been held by oil under pressure on both sides has to let that go before it falls. Until
//! then the flow into chamber 1, which no load makes faster, counts beside the one that the load presses out of chamber
//! 2: the piston goes with the mean of both, and the softer chamber gives way. Source: the balance of oil of both
//! chambers, A_1 v = Q_1 - V_1/B dp_1/dt and A_2 v = Q_2 + V_2/B dp_2/dt, under a force that does not change.
//!
//! Traps: with the present pressure in the place of the least one, a command that lets the pressure rise becomes larger
//! by that, and the axis swings. And a reading that stays high for ever must not make an axis faster for ever; hence f:
//! on a way of 0.05 S oil of 1.2 GPa loses 40 MPa and more, unless hoses hold half as much as the cylinder.
//!
//! Runs in the loop: nothing here allocates after construction.

use pipeline::machine::{Axis, Overrun};

use crate::cylinder::Cylinder;

/// Speed of the reference from which on the axis moves, m/s.
const MOVES: f64 = 1e-3;
/// p_a: below it a chamber is soft by the air in its oil, and about to be empty.
const SOFT: f64 = 1e6;
/// Part of the stroke from which on f falls, and over which it does.
const REACH: f64 = 0.05;

/// What one axis has trapped.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trapped {
    overrun: Overrun,
    cylinder: Cylinder,
    /// 0.05 S, m.
    reach: f64,
    /// T, s.
    period: f64,
    /// Whether the reference extends the axis (0) or retracts it (1); none while it stands.
    side: Option<usize>,
    /// Where that began, m.
    from: f64,
    /// p of extending and of retracting, Pa.
    least: [f64; 2],
}

impl Trapped {
    /// Of an axis whose overrunning loads, areas and volumes are known; `period` in s.
    pub fn of(axis: &Axis, period: f64) -> Option<Self> {
        let model = axis.commissioned.as_ref().filter(|_| !axis.control.without.load)?;
        let (overrun, reach) = (model.overrun, REACH * axis.stroke);
        let cylinder = Cylinder::of(axis)?;
        Some(Self { overrun, cylinder, reach, period, side: None, from: 0.0, least: [f64::INFINITY; 2] })
    }

    /// g' of extending and of retracting, of these g, for an axis at `position` m with these pressures of its piston
    /// side and rod side in Pa. `references` (m) begin with the last tick; without them, and without pressures, g' is
    /// g.
    pub fn update(
        &mut self,
        faster: [f64; 2],
        position: f64,
        pressures: Option<(f64, f64)>,
        references: Option<&[f64]>,
    ) -> [f64; 2] {
        let pressures = pressures.filter(|(piston, rod)| piston.is_finite() && rod.is_finite());
        let (Some((piston, rod)), Some(&[_, now, next, ..])) = (pressures, references) else {
            self.side = None;
            return faster;
        };
        let speed = (next - now) / self.period;
        let side = (speed.abs() >= MOVES).then_some(usize::from(speed < 0.0));
        if self.side != side {
            (self.side, self.from, self.least) = (side, now, [f64::INFINITY; 2]);
        }
        let way = (now - self.from).abs();
        let (areas, left) = (self.cylinder.drained(), self.cylinder.left(position));
        let overrun = [self.overrun.extend, self.overrun.retract];
        std::array::from_fn(|i| {
            let pressure = [piston, rod][i].max(0.0);
            let moves = side == Some(i);
            self.least[i] = if moves { self.least[i].min(pressure) } else { pressure };
            let (trapped, g) = (self.least[i], faster[i]);
            if g <= 1.0 {
                return g;
            }
            let pull = overrun[i] * g * g;
            let outlet = g * (1.0 + areas[1 - i] * trapped / pull).sqrt();
            let share = left[i] * left[i];
            let both = (1.0 - share + share * outlet).min(g);
            let fading = if moves { (2.0 - way / self.reach).clamp(0.0, 1.0) } else { 1.0 };
            g + fading * (both - g) * trapped / (trapped + SOFT)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::machine::Machine;

    const PERIOD: f64 = 0.01;
    const MIDDLE: f64 = 0.745;

    /// The arm of the built-in excavator, which a load of 10 kN begins to pull out.
    fn arm() -> Trapped {
        let mut axis = Machine::load(None, &[]).unwrap().axes.remove(1);
        axis.commissioned.as_mut().unwrap().overrun = Overrun { extend: 1e4, retract: 1e4 };
        Trapped::of(&axis, PERIOD).unwrap()
    }

    /// References of an axis that moves with `speed` m/s and is at `position` m.
    fn moving(position: f64, speed: f64) -> [f64; 3] {
        [-1.0, 0.0, 1.0].map(|tick| position + tick * speed * PERIOD)
    }

    #[test]
    fn a_load_overruns_its_axis_once_the_filled_chamber_is_empty() {
        let at =
            |piston: f64, rod: f64| arm().update([2.0, 2.0], MIDDLE, Some((piston, rod)), Some(&moving(MIDDLE, 0.0)));
        assert_eq!(at(0.0, 0.0), [2.0, 2.0]);
        let [extend, retract] = at(1e7, 0.0);
        // A_1 14.31e-3 m2, A_2 7.22e-3 m2, 2.5 l beside the stroke: k_1 / B = 15.6, k_2 / B = 6.6 mm.
        let [k_1, k_2] = [0.01431f64, 0.00722].map(|area| area * area / (2.5e-3 + area * 0.745));
        let share = k_2 / (k_1 + k_2);
        let both = 1.0 - share + share * 2.0 * (1.0f64 + 0.01431 * 1e7 / 4e4).sqrt();
        assert!(both < 2.0 && (extend - (2.0 + (both - 2.0) * 10.0 / 11.0)).abs() < 1e-9, "{extend} {both}");
        assert_eq!(retract, 2.0, "the rod side is empty");
        assert!(at(0.0, 1e6)[1] < 1.95 && at(0.0, 1e6)[0] == 2.0);
        assert_eq!(arm().update([1.0, 1.0], MIDDLE, Some((1e7, 1e7)), Some(&moving(MIDDLE, 0.0))), [1.0, 1.0]);
    }

    #[test]
    fn pressure_that_rises_in_a_motion_does_not_count_and_none_does_for_ever() {
        let mut arm = arm();
        let mut at = |position: f64, speed: f64, piston: f64| {
            arm.update([2.0, 1.0], MIDDLE, Some((piston, 1e7)), Some(&moving(position, speed)))[0]
        };
        let standing = at(0.5, 0.0, 2e6);
        assert_eq!(at(0.5, 0.1, 2e6), standing);
        let falling = at(0.5, 0.1, 5e5);
        assert!(falling > standing);
        assert_eq!(at(0.5, 0.1, 1e7), falling);
        // 0.05 times 1.49 m, half as much again, and twice as much.
        assert_eq!(at(0.5 + 0.0744, 0.1, 5e5), falling);
        let half = at(0.5 + 0.11175, 0.1, 5e5);
        assert!((half - 0.5 * (falling + 2.0)).abs() < 1e-9, "{half} {falling}");
        assert_eq!(at(0.5 + 0.15, 0.1, 1e7), 2.0);
        // The next motion begins anew.
        assert_eq!(at(0.7, 0.0, 2e6), standing);
    }

    #[test]
    fn without_pressures_or_references_the_load_counts_as_it_is() {
        let mut arm = arm();
        let still = moving(MIDDLE, 0.0);
        for pressures in [None, Some((f64::NAN, 1e7)), Some((1e7, f64::INFINITY))] {
            assert_eq!(arm.update([2.0, 3.0], MIDDLE, pressures, Some(&still)), [2.0, 3.0], "{pressures:?}");
        }
        assert_eq!(arm.update([2.0, 3.0], MIDDLE, Some((1e7, 1e7)), None), [2.0, 3.0]);
        assert_eq!(arm.update([2.0, 3.0], MIDDLE, Some((1e7, 1e7)), Some(&[0.1])), [2.0, 3.0]);
    }
}
