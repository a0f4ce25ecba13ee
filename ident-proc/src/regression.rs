//! The model as a linear regression, in either of its two forms.
//!
//! ```text
//! y(k) = phi(k)' theta                                                                             (13)
//! full:    phi = (-y(k-1) .. -y(k-na),  u+(k-nk) .. u+(k-nk-nb), u+^2(k-nk) ..,  the same with u-)  (14)
//! linear:  phi = (-y(k-1) .. -y(k-na),  x(k-nk) .. x(k-nk-nb)),   x = N(u) with held f and g
//! ```
//!
//! u+ is u where it is >= 0 and else zero, u- the reverse: the paper writes (14) for one sign only. theta of the
//! full form is (a, C_10 .. C_1nb, C_20 .., C_r0 .. C_rnb) and then the same for g; of the linear form (a, b). With
//! hinges these stand in the place of the powers. A drift is one more coefficient, the last, of a regressor that is 1.
//!
//! Both are one thing: `width` features per command, and one coefficient for each feature at each of nb + 1 lags.
//!
//! With the integrator the outputs of phi and the target are increments, dy(k) = y(k) - y(k-1); the features are
//! what they are, and predictions are of y. Trap: that takes na + 1 outputs of the past.

use pipeline::{
    hammerstein::{Nonlinearity, Structure},
    machine::Form,
};

use crate::history::History;

/// How a command becomes features.
#[derive(Debug, Clone, Copy)]
pub enum Features {
    /// x = N(u).
    Intermediate(Nonlinearity),
    /// phi_1 .. phi_r for u >= 0, u to u^r if they are powers, then the same for u < 0.
    Basis,
}

/// The regression of one structure and form.
#[derive(Debug, Clone, Copy)]
pub struct Regression {
    structure: Structure,
    features: Features,
}

impl Regression {
    /// The over-parametrised form (14).
    pub fn full(structure: Structure) -> Self {
        Self { structure, features: Features::Basis }
    }

    /// The linear form with held nonlinearity.
    pub fn linear(structure: Structure, nonlinearity: Nonlinearity) -> Self {
        Self { structure, features: Features::Intermediate(nonlinearity) }
    }

    /// The structure.
    pub fn structure(&self) -> Structure {
        self.structure
    }

    /// Features per command in a form.
    pub fn width_of(form: Form, structure: Structure) -> usize {
        match form {
            Form::Linear => 1,
            Form::Full => 2 * structure.order,
        }
    }

    /// Features per command.
    pub fn width(&self) -> usize {
        match self.features {
            Features::Intermediate(_) => 1,
            Features::Basis => 2 * self.structure.order,
        }
    }

    /// Number of coefficients.
    pub fn len(&self) -> usize {
        self.structure.na + self.width() * (self.structure.nb + 1) + self.structure.drift as usize
    }

    /// Never: na is at least 1.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Writes the features of one command.
    pub fn features(&self, u: f64, features: &mut [f64]) {
        match self.features {
            Features::Intermediate(nonlinearity) => features[0] = nonlinearity.evaluate(u),
            Features::Basis => self.structure.input.features(u, features),
        }
    }

    /// What phi(k)' theta is to give, from y(k) and `outputs` = y(..k-1), oldest first.
    pub fn target(&self, y: f64, outputs: &[f64]) -> f64 {
        match outputs.last() {
            Some(before) if self.structure.integrator => y - before,
            _ => y,
        }
    }

    /// Writes phi(k) from `outputs` = y(..k-1) and `commands` = features of u(..k-1), both oldest first.
    ///
    /// Needs [`Structure::past_outputs`] outputs and nk + nb commands.
    pub fn regressor(&self, outputs: &[f64], commands: &[f64], phi: &mut [f64]) {
        let Structure { na, nb, nk, .. } = self.structure;
        if self.structure.integrator {
            for (phi, pair) in phi[..na].iter_mut().zip(outputs.windows(2).rev()) {
                *phi = pair[0] - pair[1];
            }
        } else {
            for (phi, y) in phi[..na].iter_mut().zip(outputs.iter().rev()) {
                *phi = -y;
            }
        }
        let width = self.width();
        let newest = commands.len() / width - nk;
        for j in 0..=nb {
            let features = &commands[(newest - j) * width..(newest - j + 1) * width];
            for (power, feature) in features.iter().enumerate() {
                phi[na + power * (nb + 1) + j] = *feature;
            }
        }
        phi[na + width * (nb + 1)..].fill(1.0);
    }

    /// One step: y(k) from phi(k)' theta without writing phi; slices as for [`Self::regressor`].
    fn step(&self, theta: &[f64], outputs: &[f64], commands: &[f64]) -> f64 {
        let Structure { na, nb, nk, .. } = self.structure;
        let (a, driven) = theta.split_at(na);
        let mut y: f64 = if self.structure.integrator {
            let increments: f64 = a.iter().zip(outputs.windows(2).rev()).map(|(a, pair)| a * (pair[0] - pair[1])).sum();
            outputs[outputs.len() - 1] + increments
        } else {
            a.iter().zip(outputs.iter().rev()).map(|(a, y)| -a * y).sum()
        };
        let width = self.width();
        let newest = commands.len() / width - nk;
        for j in 0..=nb {
            let features = &commands[(newest - j) * width..(newest - j + 1) * width];
            for (power, feature) in features.iter().enumerate() {
                y += driven[power * (nb + 1) + j] * feature;
            }
        }
        if self.structure.drift { y + driven[width * (nb + 1)] } else { y }
    }

    /// One step with `theta` from the past in two histories.
    pub fn predict_one(&self, theta: &[f64], outputs: &History, commands: &History) -> f64 {
        let Structure { nb, nk, .. } = self.structure;
        self.step(theta, outputs.latest(self.structure.past_outputs()), commands.latest(nk + nb))
    }

    /// The prediction of y(k) made at k-h with `theta`: outputs measured up to k-h, the model's own after, commands
    /// as they were applied.
    ///
    /// `outputs` = y(..k-1) with at least p + h - 1 values, p = [`Structure::past_outputs`], `commands` = features of
    /// u(..k-1) with at least nk + nb + h - 1, `path` holds p + h numbers and is overwritten.
    pub fn predict_ahead(
        &self,
        theta: &[f64],
        h: usize,
        outputs: &History,
        commands: &History,
        path: &mut [f64],
    ) -> f64 {
        let Structure { nb, nk, .. } = self.structure;
        let (past, width) = (self.structure.past_outputs(), self.width());
        path[..past].copy_from_slice(&outputs.latest(past + h - 1)[..past]);
        let commands = commands.latest(nk + nb + h - 1);
        for step in 0..h {
            let (known, future) = path.split_at_mut(past + step);
            future[0] = self.step(theta, &known[step..], &commands[..(nk + nb + step) * width]);
        }
        path[past + h - 1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::hammerstein::{Basis, Coefficients, InputMap};

    const STRUCTURE: Structure = Structure { na: 3, nb: 1, nk: 2, order: 3, ..Structure::PAPER };

    /// The structure with each of its options, and with all of them.
    fn structures() -> [Structure; 6] {
        let dead_band = InputMap { dead_band: (0.1, 0.2), ..InputMap::PAPER };
        let hinges = InputMap { basis: Basis::hinges(&[0.0, 0.3, 0.6]).unwrap(), ..InputMap::PAPER };
        [
            STRUCTURE,
            Structure { integrator: true, ..STRUCTURE },
            Structure { drift: true, ..STRUCTURE },
            Structure { input: dead_band, ..STRUCTURE },
            Structure { input: hinges, ..STRUCTURE },
            Structure {
                integrator: true,
                drift: true,
                input: InputMap { basis: hinges.basis, ..dead_band },
                ..STRUCTURE
            },
        ]
    }

    fn model(structure: Structure) -> Coefficients {
        let mut model = Coefficients::zero(structure);
        if structure.drift {
            model.drift = 0.07;
        }
        model.a[..3].copy_from_slice(&[-1.4, 0.6, -0.15]);
        model.b[..2].copy_from_slice(&[0.3, 0.2]);
        model.f[..3].copy_from_slice(&[1.0, 0.5, -0.2]);
        model.g[..3].copy_from_slice(&[0.8, -0.3, 0.1]);
        model
    }

    fn full_theta(model: &Coefficients) -> Vec<f64> {
        let mut theta = model.a().to_vec();
        for branch in [model.f, model.g] {
            for c in &branch[..3] {
                theta.extend(model.b().iter().map(|b| c * b));
            }
        }
        theta
    }

    #[test]
    fn both_forms_say_what_the_model_says() {
        structures().into_iter().for_each(expect_the_models_predictions);
    }

    fn expect_the_models_predictions(structure: Structure) {
        let model = model(structure);
        let drift = &[model.drift][..structure.drift as usize];
        // What is published of it: with the integrator multiplied in.
        let published = if structure.integrator { model.integrated() } else { model };
        let inputs: Vec<f64> = (0..60).map(|k| (k as f64 * 0.9).sin()).collect();
        let outputs: Vec<f64> = (0..60).map(|k| (k as f64 * 0.31).cos()).collect();
        let linear = [model.a(), model.b(), drift].concat();
        let full = [&full_theta(&model)[..], drift].concat();
        assert_eq!((full.len(), linear.len()), (structure.full_len(), structure.linear_len()));
        let forms =
            [(Regression::full(structure), full), (Regression::linear(structure, model.nonlinearity()), linear)];
        for (regression, theta) in forms {
            assert_eq!(theta.len(), regression.len());
            let (mut y, mut u) = (History::new(60, 1), History::new(60, regression.width()));
            outputs.iter().for_each(|v| y.push(*v));
            inputs.iter().for_each(|v| u.push_with(|slot| regression.features(*v, slot)));
            // y(60) from y(..59) and u(..59).
            let x: Vec<f64> = (0..2).map(|j| model.nonlinearity().evaluate(inputs[60 - 2 - j])).collect();
            let newest: Vec<f64> = outputs.iter().rev().take(4).copied().collect();
            let expected = published.predict_one(&newest, &x);
            let mut phi = vec![0.0; regression.len()];
            let past = structure.past_outputs();
            regression.regressor(y.latest(past), u.latest(3), &mut phi);
            let found: f64 = phi.iter().zip(&theta).map(|(p, t)| p * t).sum();
            assert!((found - regression.target(expected, y.latest(past))).abs() < 1e-14);
            assert!((regression.predict_one(&theta, &y, &u) - expected).abs() < 1e-14);

            // y(60) as predicted at 60 - 7 = 53, against the model's own h-step prediction.
            let mut path = vec![0.0; past + 7];
            let ahead = regression.predict_ahead(&theta, 7, &y, &u, &mut path);
            let mut predicted = [0.0; 7];
            let newest = [53, 52, 51, 50].map(|k| outputs[k]);
            published.predict(&newest, &inputs[53 + 1 - 2 - 1..], &mut predicted);
            assert!((ahead - predicted[6]).abs() < 1e-13, "{ahead} {}", predicted[6]);
        }
    }
}
