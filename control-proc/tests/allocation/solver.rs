//! Solving quadratic programmes does not allocate.

use std::hint::black_box;

use control_proc::predictive::quadratic::{Problem, Solver, Status};

use crate::allocations;

#[test]
fn a_thousand_solves_allocate_nothing() {
    const N: usize = 20;
    let mut solver = Solver::<N, N>::new();
    let mut hessian = [[0.0; N]; N];
    (0..N).for_each(|i| hessian[i][i..].iter_mut().for_each(|h| *h = 0.5));
    let (mut steps, mut refused) = (0, 0);
    let before = allocations();
    for k in 0..1000 {
        let mut problem: Problem<N, N> = Problem::new(hessian, [0.0; N]);
        for i in 0..N {
            problem.hessian[i][i] = 1.0 + 0.01 * ((k + i) % 7) as f64;
            problem.gradient[i] = 10.0 * ((k * N + i) as f64).sin();
            (problem.lower[i], problem.upper[i]) = (-1.0, 1.0);
            problem.rows[i][i] = 1.0;
            if i > 0 {
                problem.rows[i][i - 1] = -1.0;
            }
            (problem.row_lower[i], problem.row_upper[i]) = (-0.2, 0.2);
        }
        if k % 10 == 0 {
            // The rates do not allow this bound.
            problem.lower[0] = 0.5;
        }
        let solution = black_box(solver.solve(black_box(&problem)));
        steps += solution.iterations;
        refused += usize::from(solution.status == Status::Infeasible);
    }
    assert_eq!(allocations() - before, 0);
    assert!(steps > 1000 && refused == 100, "{steps} {refused}");
}
