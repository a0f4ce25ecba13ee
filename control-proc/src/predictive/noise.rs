//! Estimate of the noise: what the model did not foresee of the past.
//!
//! ```text
//! A dy(k) = B dx(k-nk) + T e(k)                                 the model in differences, with its noise e
//! T = (1 - tau z^-1)^2,  tau = exp(-T_s/D),  D = max(D_0, min(2 D_0, D_s)),  D_0 = (nk - 1/2 + d) T_s
//! ```
//!
//! y position in m, x intermediate value, e innovation in m, D_0 dead time and lag of the model in s, D_s time of the
//! load's spring in s ([`pipeline::machine::Plan`]), T_s period in s, nk delay and d lag of the model in samples.
//!
//! T decides how fast the controller believes what its model did not foresee, and with that how wrong the model may be.
//! With one root at half of the dead time, the loop of a model with 150 ms of dead time oscillates at 1.4 times its
//! gain, or with 50 ms more of dead time. With two roots at the whole dead time it does so at 1.7 times its gain, or
//! with 130 ms more. Where the dead time is short, the spring of a loaded axis, some 5 Hz, is the limit: there 2 D_0
//! halves the error of a boom with payload.
//!
//! The newest e are computed anew with the model of every tick: what this model should have foreseen. If the e of an
//! earlier model were kept, the next model would compensate them once more.

use pipeline::hammerstein::Coefficients;

use super::history::{COMMANDS, History, TRIED};
use crate::model::response::{Ramp, residual};

/// Number of the newest e that are computed anew at every tick.
const AGAIN: usize = TRIED - 8;

/// D in multiples of D_0, up to D_s.
const SLOWER: f64 = 2.0;

/// e of the past.
#[derive(Debug, Clone, Copy)]
pub(super) struct Noise {
    /// D_s in ticks.
    spring_time: f64,
    /// The last two e before the [`AGAIN`] newest ones.
    older: [f64; 2],
    /// Outputs of the history that they are made of.
    taken: u64,
}

/// What the model says of the past.
pub(super) struct Past {
    /// x(k-1), x(k-2), ..
    pub intermediate: [f64; COMMANDS],
    /// What is known of T e(k+1), T e(k+2), m.
    pub coming: [f64; 2],
}

impl Noise {
    /// Nothing is known of the noise; `spring_time` is D_s in ticks.
    pub fn new(spring_time: f64) -> Self {
        Self { spring_time, older: [0.0; 2], taken: 0 }
    }

    /// Forgets the noise.
    pub fn reset(&mut self) {
        *self = Self::new(self.spring_time);
    }

    /// x and e of the past; `ramp` is that of the model's step response. `commands` holds u(k-1), u(k-2), .. for the
    /// outputs y(k), y(k-1), .. of the history. `None` for values that are not finite.
    pub fn past(&mut self, model: &Coefficients, ramp: Ramp, history: &History, commands: &[f64]) -> Option<Past> {
        let (outputs, count) = (history.outputs(), history.count());
        let structure = model.structure()?;
        let nonlinearity = model.nonlinearity();
        let mut intermediate = [0.0; COMMANDS];
        for (x, u) in intermediate.iter_mut().zip(commands).take(structure.nk + structure.nb + TRIED) {
            *x = nonlinearity.evaluate(*u);
        }
        let delay = structure.nk as f64 - 0.5 + ramp.bounded_lag();
        let tau = (-1.0 / delay.max((SLOWER * delay).min(self.spring_time))).exp();
        let (t_1, t_2) = (-2.0 * tau, tau * tau);
        let further = |[one, two]: [f64; 2], ago: usize| {
            [residual(model, &outputs[ago..], &intermediate[ago..]) - t_1 * one - t_2 * two, one]
        };
        let new = count.checked_sub(self.taken).and_then(|new| usize::try_from(new).ok());
        let new = new.filter(|new| *new <= TRIED - AGAIN);
        // Older e stay as the models of their time explained them. After a long gap, and in another history, there are
        // no older ones.
        let (leaving, older) = new.map_or((TRIED, [0.0; 2]), |new| (AGAIN + new, self.older));
        let older = (AGAIN..leaving).rev().fold(older, further);
        let [one, two] = (0..AGAIN).rev().fold(older, further);
        let coming = [t_1 * one + t_2 * two, t_2 * one];
        if !coming.iter().all(|noise| noise.is_finite()) {
            self.reset();
            return None;
        }
        *self = Self { older, taken: count, ..*self };
        Some(Past { intermediate, coming })
    }
}
