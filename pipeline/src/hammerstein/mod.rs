//! The Hammerstein model of one axis: a static nonlinearity N in front of a linear difference equation.
//!
//! ```text
//! x(k) = N(u(k)) = f_1 u + ... + f_r u^r   for u >= 0,   g_1 u + ... + g_r u^r   for u < 0        (11)
//! y(k) = -a_1 y(k-1) - ... - a_na y(k-na) + b_0 x(k-nk) + ... + b_nb x(k-nk-nb)                   (12)
//! ```
//!
//! u valve command, x intermediate value, y output; numbers in brackets are the equations of the paper that the
//! README names. Trap: b and N are known only up to a common factor, and f_1 = 1 fixes it, so a model of a valve
//! with a wide dead band can have small or negative f_1 before scaling: judge b N(u), never b alone.

mod inverse;
mod nonlinearity;
mod poles;

pub use nonlinearity::Nonlinearity;

use iceoryx2::prelude::ZeroCopySend;

use crate::layout::shared_struct;

/// Highest order of A and number of coefficients of B that a model can have.
pub const MAX_LINEAR: usize = 5;
/// Highest order of the polynomials of N.
pub const MAX_ORDER: usize = 5;
/// Longest delay nk, samples.
pub const MAX_DELAY: usize = 64;

/// The orders of a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct Structure {
    /// Order of A, 1 to 5.
    pub na: usize,
    /// Order of B, 0 to 4: B has `nb` + 1 coefficients.
    pub nb: usize,
    /// Delay from command to output, samples, 1 to 64: 1 means that y(k) answers u(k-1).
    pub nk: usize,
    /// Order r of the polynomials, 1 to 5.
    pub order: usize,
}

impl Structure {
    /// The paper's choice for the boom: na = 3, nb = 1, nk = 1, r = 3.
    pub const PAPER: Self = Self { na: 3, nb: 1, nk: 1, order: 3 };

    /// Number of linear coefficients, na + nb + 1.
    pub const fn linear_len(&self) -> usize {
        self.na + self.nb + 1
    }

    /// Number of coefficients of the over-parametrised form (14), both branches: na + 2 r (nb + 1).
    pub const fn full_len(&self) -> usize {
        self.na + 2 * self.order * (self.nb + 1)
    }

    /// Samples of the past that a prediction needs.
    pub const fn memory(&self) -> usize {
        if self.na > self.nk + self.nb { self.na } else { self.nk + self.nb }
    }
}

shared_struct! {
    /// The coefficients of a Hammerstein model; unused entries are zero.
    #[type_name("hydraxis.Coefficients/1")]
    pub struct Coefficients {
        /// Order of A.
        pub na: u32,
        /// Order of B.
        pub nb: u32,
        /// Delay, samples.
        pub nk: u32,
        /// Order of the polynomials.
        pub order: u32,
        /// a_1 .. a_na.
        pub a: [f64; MAX_LINEAR],
        /// b_0 .. b_nb.
        pub b: [f64; MAX_LINEAR],
        /// f_1 .. f_r, for u >= 0.
        pub f: [f64; MAX_ORDER],
        /// g_1 .. g_r, for u < 0.
        pub g: [f64; MAX_ORDER],
    }
}

impl Coefficients {
    /// Table 2 of the paper, its model of a boom; g is not printed there, so the positive branch serves for both.
    ///
    /// Traps: its slowest pole is at 0.963, no integrator though the output is a position; its zero at -1.157 lies
    /// outside the unit circle, so whatever inverts B is unstable.
    pub const TABLE_2: Self = Self {
        na: 3,
        nb: 1,
        nk: 1,
        order: 3,
        a: [-0.9923, 0.0236, 0.0042, 0.0, 0.0],
        b: [0.7237, 0.8375, 0.0, 0.0, 0.0],
        f: [1.0, 0.0924, -0.0133, 0.0, 0.0],
        g: [1.0, 0.0924, -0.0133, 0.0, 0.0],
    };

    /// All zero, of the given structure.
    pub fn zero(structure: Structure) -> Self {
        Self {
            na: structure.na as u32,
            nb: structure.nb as u32,
            nk: structure.nk as u32,
            order: structure.order as u32,
            ..Self::default()
        }
    }

    /// The structure, or `None` when the numbers are outside what a model can have (a foreign or empty message).
    pub fn structure(&self) -> Option<Structure> {
        let structure =
            Structure { na: self.na as usize, nb: self.nb as usize, nk: self.nk as usize, order: self.order as usize };
        let valid = (1..=MAX_LINEAR).contains(&structure.na)
            && structure.nb < MAX_LINEAR
            && (1..=MAX_DELAY).contains(&structure.nk)
            && (1..=MAX_ORDER).contains(&structure.order);
        valid.then_some(structure)
    }

    /// a_1 .. a_na.
    pub fn a(&self) -> &[f64] {
        &self.a[..(self.na as usize).min(MAX_LINEAR)]
    }

    /// b_0 .. b_nb.
    pub fn b(&self) -> &[f64] {
        &self.b[..(self.nb as usize + 1).min(MAX_LINEAR)]
    }

    /// The static half N.
    pub fn nonlinearity(&self) -> Nonlinearity {
        Nonlinearity { order: (self.order as usize).min(MAX_ORDER), f: self.f, g: self.g }
    }

    /// Whether every coefficient is finite.
    pub fn is_finite(&self) -> bool {
        [self.a, self.b, self.f, self.g].iter().flatten().all(|c| c.is_finite())
    }

    /// One step of (12).
    ///
    /// `outputs` holds y(k-1), y(k-2), .. and `intermediate` x(k-nk), x(k-nk-1), .., newest first, at least na
    /// and nb + 1 of them.
    pub fn predict_one(&self, outputs: &[f64], intermediate: &[f64]) -> f64 {
        let autoregressive: f64 = self.a().iter().zip(outputs).map(|(a, y)| a * y).sum();
        let driven: f64 = self.b().iter().zip(intermediate).map(|(b, x)| b * x).sum();
        driven - autoregressive
    }

    /// h steps of (12): measured outputs up to k, the model's own after, inputs as applied.
    ///
    /// `outputs` holds y(k), y(k-1), .., newest first, at least na; `inputs` the commands in the order of time
    /// from u(k+1-nk-nb) on, at least h + nb of them; `predicted` receives y(k+1) .. y(k+h).
    pub fn predict(&self, outputs: &[f64], inputs: &[f64], predicted: &mut [f64]) {
        let (nonlinearity, nb) = (self.nonlinearity(), self.nb as usize);
        for step in 0..predicted.len() {
            let autoregressive: f64 = (self.a().iter().enumerate())
                .map(|(i, a)| a * if step > i { predicted[step - 1 - i] } else { outputs[i - step] })
                .sum();
            let driven: f64 =
                (self.b().iter().enumerate()).map(|(j, b)| b * nonlinearity.evaluate(inputs[step + nb - j])).sum();
            predicted[step] = driven - autoregressive;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn h_steps_are_one_step_repeated() {
        let mut model = Coefficients::TABLE_2;
        model.nk = 4;
        let structure = model.structure().unwrap();
        let inputs: Vec<f64> = (0..40).map(|k| (k as f64 * 0.7).sin()).collect();
        let nonlinearity = model.nonlinearity();
        // y(-1) = 0.3, y(-2) = -0.1, y(-3) = 0.2; inputs[0] is u(-nk-nb).
        let mut outputs = vec![0.3, -0.1, 0.2];
        for k in 0..30 {
            let newest = k + structure.nb;
            let x: Vec<f64> = (0..=structure.nb).map(|j| nonlinearity.evaluate(inputs[newest - j])).collect();
            let y = model.predict_one(&outputs, &x);
            outputs.insert(0, y);
        }
        let mut predicted = [0.0; 30];
        model.predict(&[0.3, -0.1, 0.2], &inputs, &mut predicted);
        for (k, y) in predicted.iter().enumerate() {
            assert_eq!(*y, outputs[29 - k], "step {k}");
        }
    }

    #[test]
    fn static_gain_of_table_2() {
        // With x = 1 held: y -> (b0 + b1) / (1 + a1 + a2 + a3).
        let mut model = Coefficients::TABLE_2;
        model.f = [1.0, 0.0, 0.0, 0.0, 0.0];
        let mut predicted = vec![0.0; 2000];
        model.predict(&[0.0; 3], &vec![1.0; 2001], &mut predicted);
        assert!((predicted[1999] - (0.7237 + 0.8375) / 0.0355).abs() < 1e-9, "{}", predicted[1999]);
    }

    #[test]
    fn a_structure_outside_its_limits_is_none() {
        assert_eq!(Coefficients::TABLE_2.structure(), Some(Structure::PAPER));
        assert_eq!(Coefficients::default().structure(), None);
        for broken in [
            Coefficients { na: 6, ..Coefficients::TABLE_2 },
            Coefficients { nb: 5, ..Coefficients::TABLE_2 },
            Coefficients { nk: 65, ..Coefficients::TABLE_2 },
            Coefficients { nk: 0, ..Coefficients::TABLE_2 },
            Coefficients { order: u32::MAX, ..Coefficients::TABLE_2 },
        ] {
            assert_eq!(broken.structure(), None);
        }
    }
}
