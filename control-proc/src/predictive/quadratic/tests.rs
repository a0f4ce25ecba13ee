//! Answers by hand, degenerate constraints by name, and whatever can be typed.

use std::array::from_fn;

use proptest::prelude::*;

use super::*;

const FREE: f64 = f64::INFINITY;

fn identity<const N: usize>() -> [[f64; N]; N] {
    from_fn(|i| from_fn(|k| f64::from(u8::from(i == k))))
}

fn solve<const N: usize, const M: usize>(problem: &Problem<N, M>) -> Solution<N, M> {
    Solver::new().solve(problem)
}

fn close(one: &[f64], two: &[f64]) {
    assert!(one.iter().zip(two).all(|(one, two)| (one - two).abs() < 1e-12), "{one:?} {two:?}");
}

/// Nearest to (3, 2) with x1 + x2 <= 2 and x1 <= 1.
fn corner() -> Problem<2, 1> {
    let mut problem = Problem::new(identity(), [-3.0, -2.0]);
    problem.upper[0] = 1.0;
    problem.rows[0] = [1.0, 1.0];
    problem.row_upper[0] = 2.0;
    problem
}

#[test]
fn without_limits_it_is_the_linear_system() {
    let solution = solve(&Problem::<2, 0>::new([[4.0, 1.0], [1.0, 3.0]], [-1.0, -2.0]));
    close(&solution.x, &[1.0 / 11.0, 7.0 / 11.0]);
    assert_eq!((solution.status, solution.iterations, solution.active), (Status::Solved, 0, 0));
}

#[test]
fn the_lower_triangle_is_not_read() {
    let solution = solve(&Problem::<2, 0>::new([[4.0, 1.0], [f64::NAN, 3.0]], [-1.0, -2.0]));
    close(&solution.x, &[1.0 / 11.0, 7.0 / 11.0]);
}

#[test]
fn a_corner_has_both_multipliers() {
    let solution = solve(&corner());
    close(&solution.x, &[1.0, 1.0]);
    // x + g = (-2, -1) = v + (w, w).
    close(&solution.bound_multipliers, &[-1.0, 0.0]);
    close(&solution.row_multipliers, &[-1.0]);
    assert_eq!((solution.status, solution.active), (Status::Solved, 2));
}

#[test]
fn a_lower_limit_has_a_positive_multiplier() {
    let mut problem = Problem::<1, 0>::new([[2.0]], [0.0]);
    problem.lower = [3.0];
    let solution = solve(&problem);
    assert_eq!((solution.x, solution.bound_multipliers), ([3.0], [6.0]));
}

#[test]
fn the_paper_s_example() {
    // Goldfarb and Idnani, section 5: minimise 6 x1 + 2 (x1^2 - x1 x2 + x2^2) with x1, x2 >= 0 and x1 + x2 >= 2.
    let mut problem = Problem::<2, 1>::new([[4.0, -2.0], [-2.0, 4.0]], [6.0, 0.0]);
    problem.lower = [0.0; 2];
    problem.rows[0] = [1.0, 1.0];
    problem.row_lower[0] = 2.0;
    let solution = solve(&problem);
    close(&solution.x, &[0.5, 1.5]);
    close(&solution.row_multipliers, &[5.0]);
    assert_eq!((solution.status, solution.active), (Status::Solved, 1));
}

#[test]
fn a_rate_limit_delays_a_step() {
    let mut problem = Problem::<4, 4>::new(identity(), [-1.0; 4]);
    for k in 0..4 {
        problem.rows[k][k] = 1.0;
        if k > 0 {
            problem.rows[k][k - 1] = -1.0;
        }
        (problem.row_lower[k], problem.row_upper[k]) = (-0.3, 0.3);
    }
    let solution = solve(&problem);
    close(&solution.x, &[0.3, 0.6, 0.9, 1.0]);
}

#[test]
fn a_row_that_is_there_twice_counts_once() {
    let mut problem = Problem::<2, 3>::new(identity(), [-3.0, -2.0]);
    problem.rows = [[1.0, 1.0], [1.0, 1.0], [-2.0, -2.0]];
    (problem.row_upper, problem.row_lower[2]) = ([2.0, 2.0, FREE], -4.0);
    let solution = solve(&problem);
    close(&solution.x, &[1.5, 0.5]);
    assert_eq!((solution.status, solution.active), (Status::Solved, 1));
}

#[test]
fn equalities_that_follow_from_each_other_are_met() {
    let mut problem = Problem::<3, 3>::new(identity(), [0.0; 3]);
    problem.rows = [[1.0, 1.0, 0.0], [0.0, 1.0, 1.0], [1.0, 2.0, 1.0]];
    (problem.row_lower, problem.row_upper) = ([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]);
    let solution = solve(&problem);
    close(&solution.x, &[0.0, 1.0, 1.0]);
    problem.row_lower[2] = 3.1;
    problem.row_upper[2] = 3.1;
    assert_eq!(solve(&problem).status, Status::Infeasible);
}

#[test]
fn bounds_without_room_leave_a_point() {
    let mut problem = Problem::<3, 1>::new(identity(), [5.0, -5.0, 1.0]);
    (problem.lower, problem.upper) = ([1.0, 2.0, -3.0], [1.0, 2.0, -3.0]);
    problem.rows[0] = [1.0; 3];
    (problem.row_lower[0], problem.row_upper[0]) = (0.0, 0.0);
    let solution = solve(&problem);
    assert_eq!((solution.status, solution.x), (Status::Solved, [1.0, 2.0, -3.0]));
    // The row follows from the bounds, so that the multipliers are not unique; their pull is.
    close(&solution.bound_multipliers.map(|v| v + solution.row_multipliers[0]), &[6.0, -3.0, -2.0]);
}

#[test]
fn more_active_limits_than_variables_are_no_trouble() {
    // A pyramid's top: five rows through (0, 0, 1), three of which can be in the working set.
    let mut problem = Problem::<3, 5>::new(identity(), [0.0, 0.0, -3.0]);
    problem.rows = [[1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, -1.0, 1.0], [0.0, 0.0, 1.0]];
    problem.row_upper = [1.0; 5];
    let solution = solve(&problem);
    assert_eq!(solution.status, Status::Solved);
    close(&solution.x, &[0.0, 0.0, 1.0]);
}

#[test]
fn what_cannot_be_met_is_infeasible() {
    let mut crossed = Problem::<2, 1>::new(identity(), [0.0; 2]);
    (crossed.lower[0], crossed.upper[0]) = (1.0, 0.0);
    assert_eq!(solve(&crossed).status, Status::Infeasible);
    let mut beyond = corner();
    beyond.lower[1] = FREE;
    assert_eq!(solve(&beyond).status, Status::Infeasible);
    let mut nothing = corner();
    (nothing.rows[0], nothing.row_lower[0]) = ([0.0; 2], 1.0);
    assert_eq!(solve(&nothing).status, Status::Infeasible);
    let mut apart = corner();
    apart.row_lower[0] = 2.0;
    apart.upper[1] = 0.5;
    assert_eq!(solve(&apart).status, Status::Infeasible);
}

#[test]
fn the_limit_of_iterations_leaves_a_lower_bound_of_the_cost() {
    let mut solver = Solver { iteration_limit: 1, ..Solver::new() };
    let solution = solver.solve(&corner());
    assert_eq!((solution.status, solution.iterations, solution.active), (Status::IterationLimit, 1, 1));
    let cost = |x: [f64; 2]| 0.5 * (x[0] * x[0] + x[1] * x[1]) - 3.0 * x[0] - 2.0 * x[1];
    assert!(cost(solution.x) < cost([1.0, 1.0]));
    solver.iteration_limit = 2;
    assert_eq!(solver.solve(&corner()).status, Status::Solved);
}

#[test]
fn what_is_not_convex_or_not_finite_is_refused() {
    for hessian in [[[1.0, 2.0], [2.0, 1.0]], [[0.0; 2]; 2], [[1.0, 1.0], [1.0, 1.0]], [[-1.0, 0.0], [0.0, 1.0]]] {
        assert_eq!(solve(&Problem { hessian, ..corner() }).status, Status::NotConvex);
    }
    for bad in [f64::NAN, FREE, -FREE] {
        let mut problems = [corner(), corner(), corner(), corner()];
        problems[0].hessian[0][1] = bad;
        problems[1].hessian[1][1] = bad;
        problems[2].gradient[0] = bad;
        problems[3].rows[0][1] = bad;
        for problem in problems {
            let solution = solve(&problem);
            assert_eq!((solution.status, solution.x), (Status::NotFinite, [0.0; 2]), "{problem:?}");
        }
    }
    let mut problem = corner();
    problem.row_upper[0] = f64::NAN;
    assert_eq!(solve(&problem).status, Status::NotFinite);
}

#[test]
fn neither_units_nor_the_problem_before_matter() {
    let mut solver = Solver::new();
    let first = solver.solve(&corner());
    solver.solve(&Problem::new([[f64::NAN; 2]; 2], [1.0; 2]));
    assert_eq!(solver.solve(&corner()), first);
    // x1 in units 2^20 times as small, the row in units 2^-20.
    let unit = f64::from(1 << 20);
    let mut problem = corner();
    problem.hessian[0][0] /= unit * unit;
    problem.gradient[0] /= unit;
    problem.upper[0] *= unit;
    problem.rows[0] = [1.0 / unit / unit, 1.0 / unit];
    problem.row_upper[0] /= unit;
    let solution = solve(&problem);
    close(&[solution.x[0] / unit, solution.x[1]], &first.x);
}

#[test]
fn a_solve_that_resumes_begins_with_the_working_set_of_the_last_one() {
    let mut solver = Solver::new();
    let first = solver.solve(&corner());
    assert_eq!((first.iterations, first.active), (2, 2));
    let again = solver.resume(&corner());
    assert_eq!((again.status, again.iterations, again.active), (Status::Solved, 0, 2));
    close(&again.x, &first.x);
    // Without the limits nothing is held; then there is nothing to begin with, nor after what has no minimum.
    assert_eq!(solver.resume(&Problem::new(identity(), [-3.0, -2.0])).active, 0);
    assert_eq!(solver.resume(&corner()), first);
    solver.resume(&Problem::new([[f64::NAN; 2]; 2], [1.0; 2]));
    assert_eq!(solver.resume(&corner()), first);
}

/// Whatever a double can be, the usual among it.
fn anything() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -10.0..10.0,
        2 => (-3i8..4).prop_map(f64::from),
        1 => prop::num::f64::ANY,
        1 => (-300i32..300).prop_map(|exponent| 10f64.powi(exponent)),
        1 => prop_oneof![Just(f64::NAN), Just(FREE), Just(-FREE), Just(f64::MAX), Just(5e-324)],
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn nothing_panics_and_what_is_solved_is_in_its_bounds(
        values in prop::collection::vec(anything(), 60),
        diagonal in 0.0..20.0,
        wild in prop::collection::vec(0usize..60, 0..4),
    ) {
        // A few wild values among tame ones reach further than wild ones alone.
        let tame = |k: usize| {
            let value = values[k];
            if wild.contains(&k) || (value.abs() <= 10.0 && value != 0.0) { value } else { 1.0 }
        };
        for value in [&tame as &dyn Fn(usize) -> f64, &|k| values[k]] {
            let mut problem = Problem::<4, 4>::new(
                from_fn(|i| from_fn(|k| value(i * 4 + k) + if i == k { diagonal } else { 0.0 })),
                from_fn(|i| value(16 + i)),
            );
            problem.rows = from_fn(|i| from_fn(|k| value(20 + i * 4 + k)));
            for i in 0..4 {
                let (one, two) = (value(36 + i), value(40 + i));
                (problem.lower[i], problem.upper[i]) = (one.min(two), if i == 3 { two } else { one.max(two) });
                (problem.row_lower[i], problem.row_upper[i]) = (value(44 + i).min(value(48 + i)), value(52 + i));
            }
            let mut solver = Solver::new();
            let solution = solver.solve(&problem);
            prop_assert!(solution.iterations <= solver.iteration_limit + 4);
            prop_assert!(solution.x.iter().all(|x| x.is_finite()));
            if solution.status == Status::Solved {
                for i in 0..4 {
                    prop_assert!(problem.lower[i] <= solution.x[i] && solution.x[i] <= problem.upper[i]);
                }
            }
            let resumed = solver.resume(&problem);
            prop_assert!(resumed.x.iter().all(|x| x.is_finite()));
            prop_assert_eq!(solver.solve(&problem), solution);
        }
    }
}
