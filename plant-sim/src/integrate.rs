//! One step of the classical Runge-Kutta method of fourth order.
//!
//! ```text
//! z(t+h) = z + h/6 (k1 + 2 k2 + 2 k3 + k4)
//! k1 = g(z, X0)   k2 = g(z + h/2 k1, X1)   k3 = g(z + h/2 k2, X1)   k4 = g(z + h k3, X2)
//! ```
//!
//! z = (y, v, p1, p2), g its rates, X0, X1, X2 the valve's opening at t, t + h/2 and t + h, known beforehand.
//!
//! The trap: implicit methods promise larger steps, but friction and end stops are not smooth, and with them a
//! linearised method loses the motion. A fixed small explicit step does not, and it gives the same bits each time.

/// The step, ns: 100 us, short for the stiffest part, an almost balanced orifice at a chamber that is almost empty.
pub const STEP_NS: u64 = 100_000;

/// y m, v m/s, p1 Pa, p2 Pa.
pub type State = [f64; 4];

/// The state one step of `step` s later; `openings` at its begin, middle and end.
#[inline]
pub fn runge_kutta(z: State, openings: [f64; 3], step: f64, rates: impl Fn(State, f64) -> State) -> State {
    let moved = |by: State, time: f64| std::array::from_fn(|i| z[i] + time * by[i]);
    let k1 = rates(z, openings[0]);
    let k2 = rates(moved(k1, 0.5 * step), openings[1]);
    let k3 = rates(moved(k2, 0.5 * step), openings[1]);
    let k4 = rates(moved(k3, step), openings[2]);
    std::array::from_fn(|i| z[i] + step / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Error after 1 s of an undamped oscillator of 1 Hz.
    fn error(steps: u32) -> f64 {
        let omega = std::f64::consts::TAU;
        let mut z = [1.0, 0.0, 0.0, 0.0];
        for _ in 0..steps {
            z = runge_kutta(z, [0.0; 3], 1.0 / f64::from(steps), |z, _| [z[1], -omega * omega * z[0], 0.0, 0.0]);
        }
        (z[0] - 1.0).hypot(z[1] / omega)
    }

    #[test]
    fn halving_the_step_divides_the_error_by_sixteen() {
        let ratio = error(100) / error(200);
        assert!((ratio - 16.0).abs() < 1.0, "{ratio}");
    }
}
