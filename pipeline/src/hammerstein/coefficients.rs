//! The coefficients of a model, and its predictions, eq. (12).

use iceoryx2::prelude::ZeroCopySend;

use super::{Basis, InputMap, MAX_A, MAX_DELAY, MAX_LINEAR, MAX_ORDER, Nonlinearity, Structure};
use crate::layout::shared_struct;

/// [`Coefficients::basis`] of powers.
const POWERS: u32 = 0;
/// [`Coefficients::basis`] of hinges.
const HINGES: u32 = 1;

shared_struct! {
    /// The coefficients of a Hammerstein model; unused entries are zero.
    ///
    /// An integrator that is part of the structure is multiplied into A, so users of the coefficients need not know of
    /// it.
    #[type_name("hydraxis.Coefficients/2")]
    pub struct Coefficients {
        /// Order of A.
        pub na: u32,
        /// Order of B.
        pub nb: u32,
        /// Delay, samples.
        pub nk: u32,
        /// Number of coefficients of N for each sign of u.
        pub order: u32,
        /// Basis of N: 0 powers, 1 hinges at `knots`.
        pub basis: u32,
        /// 1 when the model has a drift, else 0.
        pub has_drift: u32,
        /// a_1 .. a_na.
        pub a: [f64; MAX_A],
        /// b_0 .. b_nb.
        pub b: [f64; MAX_LINEAR],
        /// f_1 .. f_r, for u >= 0.
        pub f: [f64; MAX_ORDER],
        /// g_1 .. g_r, for u < 0.
        pub g: [f64; MAX_ORDER],
        /// c, in the unit of the output per sample.
        pub drift: f64,
        /// Dead band: largest magnitude below zero, and largest above zero, that does not open the valve.
        pub dead_band: [f64; 2],
        /// Magnitudes of the command beyond the dead band at which the r hinges begin, rising.
        pub knots: [f64; MAX_ORDER],
    }
}

impl Coefficients {
    /// The model of a boom in Table 2 of the paper. The table does not print g, so f is used for both branches.
    ///
    /// Traps: the slowest pole is at 0.963, so the model has no integrator although its output is a position. The zero
    /// at -1.157 lies outside the unit circle, so an inverse of B is unstable.
    pub const TABLE_2: Self = Self {
        na: 3,
        nb: 1,
        nk: 1,
        order: 3,
        basis: POWERS,
        has_drift: 0,
        a: [-0.9923, 0.0236, 0.0042, 0.0, 0.0, 0.0, 0.0],
        b: [0.7237, 0.8375, 0.0, 0.0, 0.0],
        f: [1.0, 0.0924, -0.0133, 0.0, 0.0],
        g: [1.0, 0.0924, -0.0133, 0.0, 0.0],
        drift: 0.0,
        dead_band: [0.0; 2],
        knots: [0.0; MAX_ORDER],
    };

    /// All coefficients zero, with the given orders, dead band and basis. An integrator is not multiplied in.
    pub fn zero(structure: Structure) -> Self {
        let InputMap { dead_band: (low, high), basis } = structure.input;
        let (basis, knots) = match basis {
            Basis::Powers => (POWERS, [0.0; MAX_ORDER]),
            Basis::Hinges(knots) => (HINGES, knots),
        };
        Self {
            na: structure.na as u32,
            nb: structure.nb as u32,
            nk: structure.nk as u32,
            order: structure.order as u32,
            basis,
            has_drift: structure.drift.into(),
            dead_band: [low, high],
            knots,
            ..Self::default()
        }
    }

    /// The structure, or `None` when the numbers are outside the limits of a model, as in a foreign or empty message.
    pub fn structure(&self) -> Option<Structure> {
        let [low, high] = self.dead_band;
        let knots = &self.knots[..(self.order as usize).min(MAX_ORDER)];
        let structure = Structure {
            na: self.na as usize,
            nb: self.nb as usize,
            nk: self.nk as usize,
            order: self.order as usize,
            integrator: false,
            drift: self.has_drift == 1,
            input: InputMap {
                dead_band: (low, high),
                basis: if self.basis == HINGES { Basis::hinges(knots)? } else { Basis::Powers },
            },
        };
        let valid = (1..=MAX_A).contains(&structure.na)
            && structure.nb < MAX_LINEAR
            && (1..=MAX_DELAY).contains(&structure.nk)
            && (1..=MAX_ORDER).contains(&structure.order)
            && self.basis <= HINGES
            && self.has_drift <= 1
            && self.dead_band.iter().all(|magnitude| (0.0..1.0).contains(magnitude));
        valid.then_some(structure)
    }

    /// The model of the sum of the output: A(z) (1 - z^-1), one order more.
    ///
    /// A model of the highest order has no room for another coefficient and is returned unchanged.
    pub fn integrated(&self) -> Self {
        let order = self.na as usize;
        if order >= MAX_A {
            return *self;
        }
        let mut model = Self { na: self.na + 1, ..*self };
        let mut before = 1.0;
        for (product, a) in model.a[..=order].iter_mut().zip(&self.a) {
            *product = a - before;
            before = *a;
        }
        model
    }

    /// a_1 .. a_na.
    pub fn a(&self) -> &[f64] {
        &self.a[..(self.na as usize).min(MAX_A)]
    }

    /// b_0 .. b_nb.
    pub fn b(&self) -> &[f64] {
        &self.b[..(self.nb as usize + 1).min(MAX_LINEAR)]
    }

    /// The static nonlinearity N.
    pub fn nonlinearity(&self) -> Nonlinearity {
        let basis = if self.basis == HINGES { Basis::Hinges(self.knots) } else { Basis::Powers };
        let input = InputMap { dead_band: (self.dead_band[0], self.dead_band[1]), basis };
        Nonlinearity { order: (self.order as usize).min(MAX_ORDER), f: self.f, g: self.g, input }
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        let input = self.dead_band.iter().chain(&self.knots);
        let all = self.a.iter().chain(&self.b).chain(&self.f).chain(&self.g).chain([&self.drift]).chain(input);
        all.copied().all(f64::is_finite)
    }

    /// One step of (12).
    ///
    /// `outputs` holds y(k-1), y(k-2), .. and `intermediate` x(k-nk), x(k-nk-1), .., newest first, at least na
    /// and nb + 1 of them.
    pub fn predict_one(&self, outputs: &[f64], intermediate: &[f64]) -> f64 {
        let autoregressive: f64 = self.a().iter().zip(outputs).map(|(a, y)| a * y).sum();
        let driven: f64 = self.b().iter().zip(intermediate).map(|(b, x)| b * x).sum();
        driven - autoregressive + self.drift
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
            predicted[step] = driven - autoregressive + self.drift;
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
            Coefficients { na: 8, ..Coefficients::TABLE_2 },
            Coefficients { nb: 5, ..Coefficients::TABLE_2 },
            Coefficients { nk: MAX_DELAY as u32 + 1, ..Coefficients::TABLE_2 },
            Coefficients { nk: 0, ..Coefficients::TABLE_2 },
            Coefficients { order: u32::MAX, ..Coefficients::TABLE_2 },
            Coefficients { basis: 2, ..Coefficients::TABLE_2 },
            Coefficients { has_drift: 2, ..Coefficients::TABLE_2 },
            Coefficients { dead_band: [1.0, 0.0], ..Coefficients::TABLE_2 },
            Coefficients { dead_band: [0.0, -0.1], ..Coefficients::TABLE_2 },
            Coefficients { dead_band: [f64::NAN, 0.0], ..Coefficients::TABLE_2 },
            Coefficients { basis: HINGES, ..Coefficients::TABLE_2 },
            Coefficients { basis: HINGES, knots: [0.0, 0.2, 0.1, 0.0, 0.0], ..Coefficients::TABLE_2 },
            Coefficients { basis: HINGES, knots: [0.0, 0.2, f64::NAN, 0.0, 0.0], ..Coefficients::TABLE_2 },
        ] {
            assert_eq!(broken.structure(), None, "{broken:?}");
        }
    }

    #[test]
    fn a_structure_is_what_its_coefficients_say() {
        let input = InputMap { dead_band: (0.05, 0.1), basis: Basis::hinges(&[0.0, 0.3]).unwrap() };
        for (integrator, drift, input) in [(false, false, InputMap::PAPER), (false, true, input), (true, true, input)] {
            let structure = Structure { na: 5, nb: 4, nk: MAX_DELAY, order: 2, integrator, drift, input };
            let model = Coefficients::zero(structure);
            let model = if integrator { model.integrated() } else { model };
            assert_eq!(model.structure(), Some(structure.published()));
            assert_eq!(model.nonlinearity().input, input);
        }
    }

    #[test]
    fn an_integrated_model_sums_up_what_the_model_says() {
        let model = Coefficients { drift: 0.03, has_drift: 1, ..Coefficients::TABLE_2 };
        let inputs: Vec<f64> = (0..41).map(|k| (k as f64 * 0.7).sin()).collect();
        let (mut speeds, mut positions) = ([0.0; 40], [0.0; 40]);
        model.predict(&[0.3, -0.1, 0.2], &inputs, &mut speeds);
        // y(0) = 7 after the same speeds.
        model.integrated().predict(&[7.0, 6.7, 6.8, 6.6], &inputs, &mut positions);
        let mut position = 7.0;
        for (k, speed) in speeds.iter().enumerate() {
            position += speed;
            assert!((positions[k] - position).abs() < 1e-10, "{k}: {} {position}", positions[k]);
        }
    }

    #[test]
    fn drift_is_added_at_every_step() {
        // y(k) = y(k-1) + c without input.
        let mut model =
            Coefficients::zero(Structure { na: 1, nb: 0, nk: 1, order: 1, drift: true, ..Structure::PAPER });
        (model.a[0], model.drift) = (-1.0, 0.25);
        let mut predicted = [0.0; 4];
        model.predict(&[1.0], &[0.0; 4], &mut predicted);
        assert_eq!(predicted, [1.25, 1.5, 1.75, 2.0]);
        assert_eq!(model.predict_one(&[1.0], &[0.0]), 1.25);
    }
}
