//! The poles of a model, and its answer to a command that is held.
//!
//! ```text
//! poles:   z^na + a_1 z^(na-1) + .. + a_na = 0
//! answer:  (12) from y = 0, with u(k) = u for k >= 0 and 0 before
//! ```
//!
//! The poles are found by Weierstrass' simultaneous iteration (Durand, 1960; Kerner, 1966). Trap: a pole of
//! multiplicity m is found to about the m-th root of the precision of a double.

use pipeline::hammerstein::Coefficients;

use super::prediction::ahead;

/// Rounds of the iteration; it converges quadratically to simple poles.
const ROUNDS: usize = 200;

/// A complex number: real and imaginary part.
pub type Pole = (f64, f64);

/// All poles of the model; none where a coefficient is not finite.
pub fn poles(model: &Coefficients) -> Vec<Pole> {
    let a = model.a();
    if !a.iter().all(|a| a.is_finite()) {
        return Vec::new();
    }
    let times = |p: Pole, q: Pole| (p.0 * q.0 - p.1 * q.1, p.0 * q.1 + p.1 * q.0);
    let over = |p: Pole, q: Pole| {
        let square = q.0 * q.0 + q.1 * q.1;
        ((p.0 * q.0 + p.1 * q.1) / square, (p.1 * q.0 - p.0 * q.1) / square)
    };
    // On a circle around the origin, and not symmetric to the real axis.
    let angle = |i: usize| 0.4 + std::f64::consts::TAU * i as f64 / a.len() as f64;
    let mut roots: Vec<Pole> = (0..a.len()).map(|i| (0.9 * angle(i).cos(), 0.9 * angle(i).sin())).collect();
    for _ in 0..ROUNDS {
        for i in 0..roots.len() {
            let z = roots[i];
            let value = a.iter().fold((1.0, 0.0), |sum, a| {
                let product = times(sum, z);
                (product.0 + a, product.1)
            });
            let others = roots.iter().enumerate().filter(|(j, _)| *j != i);
            let product = others.fold((1.0, 0.0), |product, (_, root)| times(product, (z.0 - root.0, z.1 - root.1)));
            let step = over(value, product);
            if step.0.is_finite() && step.1.is_finite() {
                roots[i] = (z.0 - step.0, z.1 - step.1);
            }
        }
    }
    roots
}

/// The outputs y(0) .. y(`steps`) after the command `u`.
pub fn held_command(model: &Coefficients, u: f64, steps: usize) -> Vec<f64> {
    let (na, reach) = (model.na as usize, (model.nk + model.nb) as usize);
    let mut inputs = vec![0.0; reach - 1];
    inputs.resize(reach + steps, u);
    let mut predicted = vec![0.0; steps];
    // The first prediction is that of y(1), which a command from 0 on may change.
    model.predict(&vec![0.0; na], &inputs, &mut predicted);
    predicted.insert(0, 0.0);
    predicted
}

/// Output after `steps` samples with N = 1 from the first one on, from rest and without drift.
pub fn travel_of_one(model: &Coefficients, steps: usize) -> f64 {
    let model = Coefficients { drift: 0.0, ..*model };
    let (na, reach) = (model.na as usize, (model.nk + model.nb) as usize);
    let x: Vec<f64> = (0..steps + model.nb as usize).map(|i| if i + 1 < reach { 0.0 } else { 1.0 }).collect();
    ahead(&model, &vec![0.0; na], &x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::hammerstein::Structure;

    #[test]
    fn poles_are_the_roots_that_the_polynomial_was_made_of() {
        // (z - 0.9) (z^2 - 1.2 z + 0.61): poles 0.9 and 0.6 +- 0.5 i.
        let mut model = Coefficients::zero(Structure::PAPER);
        model.a[..3].copy_from_slice(&[-2.1, 1.69, -0.549]);
        let mut found = poles(&model);
        found.sort_by(|a, b| a.1.total_cmp(&b.1));
        for (found, expected) in found.iter().zip([(0.6, -0.5), (0.9, 0.0), (0.6, 0.5)]) {
            assert!((found.0 - expected.0).abs() < 1e-9 && (found.1 - expected.1).abs() < 1e-9, "{found:?}");
        }
        model.a[1] = f64::NAN;
        assert!(poles(&model).is_empty());
        assert!(poles(&Coefficients::zero(Structure::PAPER)).iter().all(|pole| pole.0.hypot(pole.1) < 1e-3));
    }

    #[test]
    fn a_held_command_moves_the_output_after_the_delay() {
        // y(k) = y(k-1) + 0.5 u(k-3).
        let structure = Structure { na: 1, nb: 0, nk: 3, order: 1, ..Structure::PAPER };
        let mut model = Coefficients::zero(structure);
        (model.a[0], model.b[0], model.f[0], model.g[0]) = (-1.0, 0.5, 1.0, 2.0);
        assert_eq!(held_command(&model, 0.5, 5), [0.0, 0.0, 0.0, 0.25, 0.5, 0.75]);
        assert_eq!(held_command(&model, -0.4, 4), [0.0, 0.0, 0.0, -0.4, -0.8]);
        assert_eq!((travel_of_one(&model, 2), travel_of_one(&model, 5)), (0.0, 1.5));
    }
}
