//! The solver of quadratic programmes, held against Clarabel's and against the conditions of a minimum.
//!
//! Costs are compared, not x: of an ill-conditioned H both costs agree to the last digits while the x do not.

mod axis;
mod peer;
mod random;

use axis::Axis;
use clarabel::solver::{IPSolver, SolverStatus};
use control_proc::predictive::quadratic::{Problem, Solution, Solver, Status};
use peer::{Form, settings};
use rand_pcg::{Pcg64, rand_core::SeedableRng};
use random::{degenerate, dense, dot, infeasible};

/// What is left of the conditions of a minimum, each by the size of what should cancel in it.
fn residual<const N: usize, const M: usize>(problem: &Problem<N, M>, solution: &Solution<N, M>) -> f64 {
    let Solution { x, bound_multipliers, row_multipliers, .. } = solution;
    let (mut stationarity, mut size) = (0.0f64, f64::MIN_POSITIVE);
    for (i, v) in bound_multipliers.iter().enumerate() {
        let products = (0..N).map(|k| problem.hessian[i.min(k)][i.max(k)] * x[k]);
        let pulls = (0..M).map(|k| -problem.rows[k][i] * row_multipliers[k]);
        let terms = || products.clone().chain(pulls.clone()).chain([problem.gradient[i], -v]);
        stationarity = stationarity.max(terms().sum::<f64>().abs());
        size = size.max(terms().map(f64::abs).sum());
    }
    let mut worst = stationarity / size;
    let (largest, (_, whole)) = (reach(problem, x), cost(problem, x));
    let mut check = |value: f64, lower: f64, upper: f64, multiplier: f64, norm: f64| {
        let (violation, limit) =
            if lower - value > value - upper { (lower - value, lower) } else { (value - upper, upper) };
        if violation > 0.0 {
            worst = worst.max(violation / (limit.abs() + norm * largest));
        }
        let slack = if multiplier > 0.0 { value - lower } else { upper - value };
        if multiplier != 0.0 {
            worst = worst.max((multiplier * slack).abs() / whole);
        }
    };
    for i in 0..N {
        check(x[i], problem.lower[i], problem.upper[i], bound_multipliers[i], 1.0);
    }
    for (k, row) in problem.rows.iter().enumerate() {
        let norm = row.iter().map(|c| c.abs()).sum();
        check(dot(row, x), problem.row_lower[k], problem.row_upper[k], row_multipliers[k], norm);
    }
    worst
}

/// How large the elements of x are or may be; 1 is the unit of all problems here.
fn reach<const N: usize, const M: usize>(problem: &Problem<N, M>, x: &[f64; N]) -> f64 {
    let numbers = x.iter().chain(&problem.lower).chain(&problem.upper).filter(|x| x.is_finite());
    numbers.fold(1.0, |largest, x| largest.max(x.abs()))
}

/// The cost, and the size of what it is the sum of for an x of this reach.
fn cost<const N: usize, const M: usize>(problem: &Problem<N, M>, x: &[f64; N]) -> (f64, f64) {
    let (mut cost, mut size) = (dot(&problem.gradient, x), 0.0);
    for i in 0..N {
        for k in 0..N {
            let part = x[i] * problem.hessian[i.min(k)][i.max(k)] * x[k] / 2.0;
            cost += part;
            size += part.abs();
        }
        size += problem.gradient[i].abs() * reach(problem, x);
    }
    (cost, size)
}

/// What many problems have shown.
#[derive(Debug, Default)]
struct Seen {
    problems: usize,
    solved: usize,
    infeasible: usize,
    /// Clarabel has not solved it to its tolerance, nor refused it.
    unsure: usize,
    residual: f64,
    cost: f64,
    iterations: usize,
    most: f64,
}

impl Seen {
    fn compare<const N: usize, const M: usize>(
        &mut self,
        solver: &mut Solver<N, M>,
        problem: &Problem<N, M>,
    ) -> Solution<N, M> {
        // From the working set of the problem before, which among random ones is of no use at all; then from nothing.
        let resumed = solver.resume(problem);
        let solution = solver.solve(problem);
        self.expect_same(problem, &resumed, &solution);
        // Its tolerances are absolute where the numbers are small: it gets a gradient of 1.
        let largest = problem.gradient.iter().fold(0.0f64, |largest, g| largest.max(g.abs()));
        let mut unit = problem.clone();
        unit.hessian.iter_mut().flatten().chain(&mut unit.gradient).for_each(|value| *value /= largest);
        let mut peer = Form::new(&unit).solver(settings(1e-12));
        peer.solve();
        self.problems += 1;
        self.iterations += solution.iterations;
        self.most = self.most.max(solution.iterations as f64 / N as f64);
        let theirs = peer.solution.status;
        let told = || format!("N = {N}, M = {M}, number {}: {theirs:?}, {solution:?}, {problem:?}", self.problems);
        match solution.status {
            Status::Solved => {
                let residual = residual(problem, &solution);
                assert!(residual < 1e-8, "{residual} {}", told());
                self.residual = self.residual.max(residual);
                self.solved += 1;
                assert!(theirs != SolverStatus::PrimalInfeasible, "{}", told());
                if theirs == SolverStatus::Solved {
                    let x: [f64; N] = peer.solution.x.as_slice().try_into().unwrap();
                    let ((ours, parts), (other, _)) = (cost(problem, &solution.x), cost(problem, &x));
                    let difference = (ours - other).abs() / parts;
                    assert!(difference < 1e-9, "{ours} {other} {difference} {}", told());
                    self.cost = self.cost.max(difference);
                } else {
                    self.unsure += 1;
                }
            }
            Status::Infeasible => {
                self.infeasible += 1;
                assert!(theirs != SolverStatus::Solved, "{}", told());
                if theirs != SolverStatus::PrimalInfeasible {
                    self.unsure += 1;
                }
            }
            _ => panic!("{}", told()),
        }
        solution
    }

    /// Both are minima: each keeps the conditions, and the costs are one.
    fn expect_same<const N: usize, const M: usize>(
        &self,
        problem: &Problem<N, M>,
        resumed: &Solution<N, M>,
        solution: &Solution<N, M>,
    ) {
        let told = || format!("N = {N}, M = {M}, number {}: {resumed:?}, {solution:?}, {problem:?}", self.problems);
        assert_eq!(resumed.status, solution.status, "{}", told());
        if solution.status == Status::Solved {
            let residual = residual(problem, resumed);
            assert!(residual < 1e-8, "{residual} {}", told());
            let ((one, parts), (two, _)) = (cost(problem, &resumed.x), cost(problem, &solution.x));
            assert!((one - two).abs() < 1e-9 * parts, "{one} {two} {}", told());
        }
    }

    fn report(&self, what: &str) {
        assert!(self.unsure <= self.problems / 20, "{what}: {self:?}");
        println!("{what}: {self:?}, mean iterations {:.2}", self.iterations as f64 / self.problems as f64);
    }
}

/// Axes in closed loop, a new model at every sample; 500 samples each.
fn axes<const N: usize, const M: usize>(problems: usize) -> Seen {
    let (mut seen, mut solver) = (Seen::default(), Solver::<N, M>::new());
    for seed in 0..(problems / 500) as u64 {
        let mut axis = if seed % 3 == 0 { Axis::table_2(seed) } else { Axis::integrating(seed) };
        for _ in 0..500 {
            axis.vary();
            let problem = axis.problem();
            let solution = seen.compare(&mut solver, &problem);
            axis.advance(solution.x[0]);
        }
    }
    seen.report(&format!("axes, N = {N}, M = {M}"));
    seen
}

fn random<const N: usize, const M: usize>(problems: usize, make: fn(&mut Pcg64) -> Problem<N, M>, what: &str) -> Seen {
    let (mut seen, mut solver) = (Seen::default(), Solver::<N, M>::new());
    let mut random = Pcg64::seed_from_u64(N as u64);
    for _ in 0..problems {
        seen.compare(&mut solver, &make(&mut random));
    }
    seen.report(&format!("{what}, N = {N}, M = {M}"));
    seen
}

#[test]
fn rate_limited_axes_agree_with_clarabel() {
    let all =
        [axes::<1, 1>(2000), axes::<2, 2>(3000), axes::<5, 5>(6000), axes::<10, 10>(12000), axes::<20, 20>(12000)];
    for seen in all {
        assert_eq!(seen.infeasible, 0);
    }
}

#[test]
fn axes_with_limits_of_their_position_agree_with_clarabel() {
    axes::<5, 10>(5000);
    axes::<20, 40>(5000);
    axes::<31, 62>(2000);
}

#[test]
fn any_condition_agrees_with_clarabel() {
    random::<1, 0>(2000, dense, "dense");
    random::<2, 3>(5000, dense, "dense");
    random::<5, 5>(10000, dense, "dense");
    random::<10, 5>(8000, dense, "dense");
    random::<20, 10>(5000, dense, "dense");
    random::<31, 31>(1000, dense, "dense");
}

#[test]
fn degenerate_constraints_agree_with_clarabel() {
    random::<1, 2>(2000, degenerate, "degenerate");
    random::<2, 4>(5000, degenerate, "degenerate");
    random::<5, 8>(5000, degenerate, "degenerate");
    random::<10, 10>(3000, degenerate, "degenerate");
    random::<20, 20>(1000, degenerate, "degenerate");
}

#[test]
fn what_is_infeasible_is_called_so_by_both() {
    let all = [
        random::<1, 3>(1000, infeasible, "infeasible"),
        random::<5, 5>(3000, infeasible, "infeasible"),
        random::<20, 10>(2000, infeasible, "infeasible"),
    ];
    for seen in all {
        assert_eq!(seen.solved, 0);
    }
}
