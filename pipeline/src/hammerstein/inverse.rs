//! The inverse of N on its monotone interval.
//!
//! A polynomial that is fitted to a valve is not monotone everywhere: it turns back beyond the data, and inside a dead
//! band it can fall before it rises. So the inverse is that of the branch's running maximum
//!
//! ```text
//! M(v) = max over 0 <= w <= v of s N(w)
//! ```
//!
//! where s = +1 or -1 is the direction in which both branches reach further. M is monotone, and N^-1(x) is the smallest
//! command that reaches x. The inverse jumps over a dip and over the calibrated dead band. Beyond the largest value of
//! the branch it stays at the command that reaches this value. A branch of hinges is solved on the straight line that
//! contains x, a polynomial by bisection between its turning points.

use super::{Basis, MAX_ORDER, Nonlinearity};

/// One branch as a function of a command's magnitude, >= 0: with v = magnitude - dead band it is
/// c_1 phi_1(v) + .. + c_r phi_r(v) for v > 0, else 0.
#[derive(Clone, Copy)]
struct Branch {
    coefficients: [f64; MAX_ORDER],
    order: usize,
    basis: Basis,
    dead_band: f64,
}

/// Real roots, sorted by size; a polynomial of order 5 has at most 5 of them.
#[derive(Clone, Copy, Default)]
struct Roots {
    values: [f64; MAX_ORDER],
    len: usize,
}

impl Roots {
    fn push(&mut self, value: f64) {
        if self.len < MAX_ORDER {
            self.values[self.len] = value;
            self.len += 1;
        }
    }

    fn as_slice(&self) -> &[f64] {
        &self.values[..self.len]
    }
}

impl Nonlinearity {
    /// The smallest command in `range` (which holds 0) that gives `x`, or the command nearest to giving it.
    ///
    /// Returns 0 for an `x` that is not finite or that the branch of its sign cannot give at all.
    pub fn invert(&self, x: f64, range: (f64, f64)) -> f64 {
        let s = self.orientation(range);
        if !x.is_finite() || s == 0.0 {
            return 0.0;
        }
        if s * x >= 0.0 { self.positive(s).reach(s * x, range.1) } else { -self.negative(s).reach(-s * x, -range.0) }
    }

    /// s M(u), of which [`Self::invert`] is the inverse: N(u) without its dips. It is 0 where N turns the wrong way
    /// inside a dead band.
    pub fn monotone(&self, u: f64, range: (f64, f64)) -> f64 {
        let s = self.orientation(range);
        if u >= 0.0 { s * self.positive(s).highest(u) } else { -s * self.negative(s).highest(-u) }
    }

    /// The values of x that commands in `range` can give on the monotone interval, lowest and highest.
    pub fn reachable(&self, range: (f64, f64)) -> (f64, f64) {
        let s = self.orientation(range);
        let up = self.positive(s).highest(range.1);
        let down = self.negative(s).highest(-range.0);
        if s >= 0.0 { (-down, up) } else { (-up, down) }
    }

    /// +1 when x rises with u over `range`, -1 when it falls, 0 when it does neither.
    ///
    /// This is the direction in which the weaker of the two branches reaches further. Where the weaker branch reaches
    /// nothing in either direction, the stronger one decides. So a branch that turns back far from zero does not
    /// decide.
    pub fn orientation(&self, range: (f64, f64)) -> f64 {
        let reach = |s| {
            let (up, down) = (self.positive(s).highest(range.1), self.negative(s).highest(-range.0));
            (up.min(down), up.max(down))
        };
        let (rising, falling) = (reach(1.0), reach(-1.0));
        if rising > falling {
            1.0
        } else if falling > rising {
            -1.0
        } else {
            0.0
        }
    }

    /// s N(u) for u >= 0.
    fn positive(&self, s: f64) -> Branch {
        let dead_band = self.input.dead_band.1;
        Branch { coefficients: self.f.map(|c| s * c), order: self.order, basis: self.input.basis, dead_band }
    }

    /// -s N(-u) for u >= 0.
    fn negative(&self, s: f64) -> Branch {
        let mut coefficients = self.g.map(|c| s * c);
        // Hinges are odd functions, as odd powers are.
        if self.input.basis == Basis::Powers {
            coefficients.iter_mut().skip(1).step_by(2).for_each(|even_power| *even_power = -*even_power);
        }
        let dead_band = self.input.dead_band.0;
        Branch { coefficients, order: self.order, basis: self.input.basis, dead_band }
    }
}

impl Branch {
    fn coefficients(&self) -> &[f64] {
        &self.coefficients[..self.order]
    }

    /// The value at v >= 0.
    fn evaluate(&self, v: f64) -> f64 {
        match &self.basis {
            Basis::Powers => self.coefficients().iter().rev().fold(0.0, |sum, c| (sum + c) * v),
            Basis::Hinges(knots) => self.coefficients().iter().zip(knots).map(|(c, k)| c * (v - k).max(0.0)).sum(),
        }
    }

    /// Points in (0, end) between which the branch is monotone.
    fn turning_points(&self, end: f64) -> Roots {
        match &self.basis {
            Basis::Powers => {
                let mut slope = [0.0; MAX_ORDER];
                for (i, (slope, c)) in slope.iter_mut().zip(self.coefficients()).enumerate() {
                    *slope = (i + 1) as f64 * c;
                }
                roots(&slope[..self.order], end)
            }
            Basis::Hinges(knots) => {
                let mut inside = Roots::default();
                knots[..self.order]
                    .iter()
                    .filter(|knot| **knot > 0.0 && **knot < end)
                    .for_each(|knot| inside.push(*knot));
                inside
            }
        }
    }

    /// The largest value that magnitudes in [0, limit] give, at least 0.
    fn highest(&self, limit: f64) -> f64 {
        self.peak(self.opening(limit)).1
    }

    /// v of the magnitude `limit`.
    fn opening(&self, limit: f64) -> f64 {
        (limit - self.dead_band).max(0.0)
    }

    /// The v of the largest value in [0, end], and that value; (0, 0) when the branch never rises above 0.
    fn peak(&self, end: f64) -> (f64, f64) {
        let turning = self.turning_points(end);
        (turning.as_slice().iter().copied().chain([end]))
            .map(|v| (v, self.evaluate(v)))
            .fold((0.0, 0.0), |best, new| if new.1 > best.1 { new } else { best })
    }

    /// The smallest magnitude in [0, limit] with a value of at least `target` >= 0, or that of the highest value.
    fn reach(&self, target: f64, limit: f64) -> f64 {
        let v = self.solve(target, self.opening(limit));
        // For the smallest v the command must still be beyond the dead band.
        if v > 0.0 { (self.dead_band + v).max(self.dead_band.next_up()).min(limit) } else { 0.0 }
    }

    /// The smallest v in [0, end] with a value of at least `target` >= 0, or the v of the highest value.
    fn solve(&self, target: f64, end: f64) -> f64 {
        if target == 0.0 {
            return 0.0;
        }
        let mut before = 0.0;
        for &v in self.turning_points(end).as_slice().iter().chain([&end]) {
            let value = self.evaluate(v);
            if value >= target {
                return match self.basis {
                    Basis::Powers => bisect(before, v, |v| self.evaluate(v) - target),
                    Basis::Hinges(_) => {
                        let start = self.evaluate(before);
                        before + (v - before) * ((target - start) / (value - start))
                    }
                };
            }
            before = v;
        }
        self.peak(end).0
    }
}

/// Roots in (0, end) of c[0] + c[1] v + .. where the sign changes: between two neighbouring turning points there
/// is at most one, so the roots of the derivative isolate those of the polynomial.
fn roots(c: &[f64], end: f64) -> Roots {
    let mut found = Roots::default();
    if c.len() < 2 {
        return found;
    }
    if c.len() <= 3 {
        return quadratic_roots([c[0], c[1], c.get(2).copied().unwrap_or(0.0)], end);
    }
    let mut slope = [0.0; MAX_ORDER];
    for i in 1..c.len() {
        slope[i - 1] = i as f64 * c[i];
    }
    let evaluate = |v: f64| c.iter().rev().fold(0.0, |sum, c| sum * v + c);
    let turning = roots(&slope[..c.len() - 1], end);
    let mut before = 0.0;
    for &v in turning.as_slice().iter().chain([&end]) {
        let (low, high) = (evaluate(before), evaluate(v));
        if (low < 0.0 && high > 0.0) || (low > 0.0 && high < 0.0) {
            let rising = if high > 0.0 { 1.0 } else { -1.0 };
            found.push(bisect(before, v, |v| rising * evaluate(v)));
        }
        before = v;
    }
    found
}

/// Roots in (0, end) of c[0] + c[1] v + c[2] v^2 where the sign changes, by the formula without cancellation; c[2] may
/// be zero.
fn quadratic_roots([c, b, a]: [f64; 3], end: f64) -> Roots {
    let mut found = Roots::default();
    let discriminant = b * b - 4.0 * a * c;
    // A double root touches zero and changes no sign.
    if discriminant > 0.0 {
        let q = -0.5 * (b + discriminant.sqrt().copysign(b));
        let (one, two) = (q / a, c / q);
        for root in [one.min(two), one.max(two)] {
            // Division by zero gives infinity or NaN, which is not inside the interval either.
            if root > 0.0 && root < end {
                found.push(root);
            }
        }
    }
    found
}

/// The zero of a function that is negative at `low` and not negative at `high`, to the last bit that bisection finds.
fn bisect(mut low: f64, mut high: f64, function: impl Fn(f64) -> f64) -> f64 {
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return high;
        }
        if function(middle) < 0.0 {
            low = middle;
        } else {
            high = middle;
        }
        if high - low <= f64::EPSILON * high {
            return high;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hammerstein::InputMap;
    use proptest::prelude::*;

    const RANGE: (f64, f64) = (-1.0, 1.0);

    fn nonlinearity(f: &[f64], g: &[f64]) -> Nonlinearity {
        let mut n = Nonlinearity { order: f.len(), f: [0.0; 5], g: [0.0; 5], input: InputMap::PAPER };
        n.f[..f.len()].copy_from_slice(f);
        n.g[..g.len()].copy_from_slice(g);
        n
    }

    #[test]
    fn table_2_is_inverted_inside_its_turning_points() {
        let n = nonlinearity(&[1.0, 0.0924, -0.0133], &[1.0, 0.0924, -0.0133]);
        for u in [-3.0, -1.0, -0.2, 0.0, 1e-6, 0.5, 3.0, 7.5] {
            assert!((n.invert(n.evaluate(u), (-10.0, 10.0)) - u).abs() < 1e-12, "{u}");
        }
        // Its turning points, to the digits that the paper's coefficients give: -3.20 and 7.83.
        assert!((n.invert(1e3, (-10.0, 10.0)) - 7.83).abs() < 0.01);
        assert!((n.invert(-1e3, (-10.0, 10.0)) + 3.20).abs() < 0.01);
    }

    #[test]
    fn a_dip_of_the_dead_band_is_jumped_over() {
        // Falls until 0.155, is back at zero at 0.276, rises to 0.85.
        let n = nonlinearity(&[-0.4, 1.55, -0.3], &[1.0, 0.0, 0.0]);
        let u = n.invert(1e-9, RANGE);
        assert!(u > 0.25 && n.evaluate(u) >= 1e-9, "{u}");
        assert!(n.evaluate(u - 1e-6) < 1e-9);
    }

    #[test]
    fn without_its_dips_it_is_zero_inside_a_dead_band_and_itself_beyond() {
        // Below zero for commands up to 0.5 either way.
        let n = nonlinearity(&[-1.0, 2.0], &[-1.0, -2.0]);
        for (u, x) in [(0.0, 0.0), (0.2, 0.0), (-0.4, 0.0), (0.8, 0.48), (-0.8, -0.48)] {
            assert!((n.monotone(u, RANGE) - x).abs() < 1e-12, "{u}: {}", n.monotone(u, RANGE));
        }
        assert_eq!(nonlinearity(&[0.0], &[0.0]).monotone(0.3, RANGE), 0.0);
    }

    #[test]
    fn a_falling_characteristic_is_inverted_too() {
        let n = nonlinearity(&[-2.0, 0.0, -0.5], &[-1.0, 0.0, -0.1]);
        assert_eq!(n.orientation(RANGE), -1.0);
        for u in [-0.9, -0.1, 0.1, 0.9] {
            assert!((n.invert(n.evaluate(u), RANGE) - u).abs() < 1e-12, "{u}");
        }
        let (low, high) = n.reachable(RANGE);
        assert!((low + 2.5).abs() < 1e-12 && (high - 1.1).abs() < 1e-12, "{low} {high}");
    }

    #[test]
    fn what_cannot_be_reached_is_approached_and_nonsense_is_neutral() {
        let n = nonlinearity(&[1.0, 0.0, -1.0], &[1.0, 0.0, 0.0]);
        let peak = (1.0f64 / 3.0).sqrt();
        assert!((n.invert(5.0, RANGE) - peak).abs() < 1e-9);
        assert_eq!(n.invert(f64::NAN, RANGE), 0.0);
        assert_eq!(n.invert(f64::INFINITY, RANGE), 0.0);
        assert_eq!(nonlinearity(&[0.0], &[0.0]).invert(0.3, RANGE), 0.0);
    }

    #[test]
    fn the_calibrated_dead_band_is_jumped_over() {
        let mut n = nonlinearity(&[1.0, 0.0, 0.5], &[1.0, 0.0, 0.5]);
        n.input.dead_band = (0.1, 0.2);
        assert_eq!(n.invert(0.0, RANGE), 0.0);
        for x in [1e-300, 1e-12, 0.3] {
            let (up, down) = (n.invert(x, RANGE), n.invert(-x, RANGE));
            assert!(up > 0.2 && n.evaluate(up) > 0.0, "{x} {up}");
            assert!(down < -0.1 && n.evaluate(down) < 0.0, "{x} {down}");
            assert!((n.evaluate(up) - x).abs() < 1e-15 && (n.evaluate(down) + x).abs() < 1e-15, "{x}");
        }
        // Commands that end within the band reach nothing.
        assert_eq!(n.reachable((-0.1, 0.2)), (0.0, 0.0));
        assert_eq!((n.orientation((-0.1, 0.2)), n.invert(0.3, (-0.1, 0.2))), (0.0, 0.0));
        assert_eq!(n.invert(9.0, (-0.9, 0.7)), 0.7);
    }

    #[test]
    fn straight_lines_are_inverted_exactly() {
        let mut n = nonlinearity(&[0.25, 1.0, -2.0], &[-0.5, 1.5, 0.0]);
        n.input.basis = Basis::hinges(&[0.0, 0.25, 0.75]).unwrap();
        // 0.0625 at 0.25, 0.6875 at 0.75, and down from there.
        for (x, u) in [(0.03125, 0.125), (0.0625, 0.25), (0.375, 0.5), (0.6875, 0.75), (5.0, 0.75)] {
            assert_eq!(n.invert(x, RANGE), u, "{x}");
        }
        // Below zero it dips until 0.25 and is back at zero at 0.375.
        assert_eq!(n.invert(-0.125, RANGE), -0.5);
        assert_eq!(n.reachable(RANGE), (-0.625, 0.6875));
    }

    /// The calibrated dead band, and the widths between the knots if there are any.
    fn inputs() -> impl Strategy<Value = InputMap> {
        let hinges = prop::collection::vec(0.001f64..0.3, 5).prop_map(|widths| {
            let knots = widths.iter().scan(0.0, |knot, width| Some(std::mem::replace(knot, *knot + width)));
            Basis::hinges(&knots.collect::<Vec<f64>>()).unwrap()
        });
        let band = || prop_oneof![Just(0.0), 0.0f64..0.6];
        ((band(), band()), prop_oneof![Just(Basis::Powers), hinges])
            .prop_map(|(dead_band, basis)| InputMap { dead_band, basis })
    }

    proptest! {
        #[test]
        fn the_inverse_gives_x_back_wherever_it_is_reachable(
            f in prop::collection::vec(-2.0f64..2.0, 5),
            g in prop::collection::vec(-2.0f64..2.0, 5),
            input in inputs(),
            share in -1.0f64..1.0,
        ) {
            let n = Nonlinearity { input, ..nonlinearity(&f, &g) };
            let (low, high) = n.reachable(RANGE);
            prop_assert!(low <= 0.0 && high >= 0.0);
            let x = if share < 0.0 { -share * low } else { share * high };
            let u = n.invert(x, RANGE);
            prop_assert!((-1.0..=1.0).contains(&u));
            prop_assert!((n.evaluate(u) - x).abs() < 1e-9, "x {x} u {u} N {}", n.evaluate(u));
            prop_assert!(u == 0.0 || u > input.dead_band.1 || u < -input.dead_band.0, "{u}");
            prop_assert!((n.monotone(u, RANGE) - x).abs() < 1e-9, "x {x} u {u} M {}", n.monotone(u, RANGE));
            // Nothing smaller gives as much.
            for i in 0..100 {
                let smaller = u * i as f64 / 100.0;
                let s = n.orientation(RANGE) * if u < 0.0 { -1.0 } else { 1.0 };
                prop_assert!(s * n.evaluate(smaller) <= s * x + 1e-9);
            }
        }
    }
}
