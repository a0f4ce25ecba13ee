//! Time of one quadratic programme of a predictive controller, ours and Clarabel's, in the same run.
//!
//! `cargo bench --bench qp`; `--quick` for a short run, `--json FILE` for programs. The programmes are those of an axis
//! in closed loop with N moves, bounds and rate limits. Half of them have the model of the paper's Table 2, half an
//! integrating model. One table has one model throughout, the other a new model, hence a new Hessian, at every sample.
//! All contestants solve the same programme in turn. Ours starts either from nothing, as after a pause, or resumes with
//! the working set of the sample before, as a controller does. An interior point method such as Clarabel's has nothing
//! to resume with; Clarabel either gets new data or is built anew, at its default tolerance. Preparing Clarabel's data
//! is not timed. Ratios are those of p50 to ours from nothing.

mod arguments;
#[path = "../control-proc/tests/quadratic/axis.rs"]
mod axis;
mod contest;
#[path = "../control-proc/tests/quadratic/peer.rs"]
mod peer;
mod report;

use std::hint::black_box;

use clarabel::solver::{DefaultSolver, IPSolver};
use control_proc::predictive::quadratic::{Problem, Solution, Solver, Status};
use serde_json::{Value, json};

use arguments::Arguments;
use axis::Axis;
use contest::{Contestant, head};
use peer::{Form, settings};

const OURS: &str = "ours, from nothing";
const RESUMED: &str = "ours, resumed";
const UPDATED: &str = "Clarabel, new data";
const ANEW: &str = "Clarabel, anew";
/// Clarabel's default.
const TOLERANCE: f64 = 1e-8;

/// All contestants, with programmes of N moves.
struct Contestants<const N: usize> {
    ours: Contestant<Solver<N, N>>,
    resumed: Contestant<Solver<N, N>>,
    /// Clarabel's solver, made from the first programme of an axis.
    updated: Contestant<Option<DefaultSolver<f64>>>,
    anew: Contestant<()>,
}

impl<const N: usize> Contestants<N> {
    fn new() -> Self {
        Self {
            ours: Contestant::new(OURS, Solver::new()),
            resumed: Contestant::new(RESUMED, Solver::new()),
            updated: Contestant::new(UPDATED, None),
            anew: Contestant::new(ANEW, ()),
        }
    }

    /// Lets all contestants solve `problem`, beginning with number `first`; returns our solution from nothing.
    fn solve(&mut self, problem: &Problem<N, N>, first: usize) -> Solution<N, N> {
        let form = Form::new(problem);
        self.updated.subject.get_or_insert_with(|| form.solver(settings(TOLERANCE)));
        let (mut solution, mut other) = (None, None);
        let mut contestants: [&mut dyn FnMut(); 4] = [
            &mut || solution = Some(self.ours.time(1, |solver| solver.solve(black_box(problem)))),
            &mut || other = Some(self.resumed.time(1, |solver| solver.resume(black_box(problem)))),
            &mut || {
                self.updated.time(1, |peer| {
                    let peer = peer.as_mut().expect("made above");
                    peer.update_data(&form.p, &form.q, &form.a, &form.b).expect("the structure of the first programme");
                    peer.solve();
                });
            },
            &mut || self.anew.time(1, |()| form.solver(settings(TOLERANCE)).solve()),
        ];
        (0..4).for_each(|turn| contestants[(first + turn) % 4]());
        let solution = solution.expect("had its turn");
        let least = self.updated.subject.as_ref().expect("made above").solution.obj_val;
        for ours in [Some(&solution), other.as_ref()].into_iter().flatten() {
            assert_eq!(ours.status, Status::Solved);
            let difference = cost(problem, &ours.x) - least;
            // Clarabel's solution is the less exact one.
            assert!(difference < 1e-6 * least.abs().max(1e-3), "a cost higher by {difference}");
        }
        solution
    }

    /// Prints the table under `title` and returns it.
    fn table(self, title: &str) -> Vec<Value> {
        head(title, "    / ours");
        let Self { ours, resumed, updated, anew } = self;
        let all = [ours.figures(), resumed.figures(), updated.figures(), anew.figures()];
        let first = all[0].1.p50;
        let rows = all.iter().map(|(name, figures)| {
            let ratio = figures.p50 / first;
            figures.print(name);
            println!(" {ratio:>9.1}");
            let mut json = figures.json(name);
            (json["n"], json["to_ours"]) = (json!(N), json!(ratio));
            json
        });
        rows.collect()
    }
}

/// Times all contestants with N moves; prints their table and returns it.
fn compare<const N: usize>(samples: usize, new_model: bool) -> Vec<Value> {
    let mut contestants = Contestants::<N>::new();
    let (mut count, mut iterations, mut most, mut active) = (0usize, 0, 0, 0);
    for mut axis in [Axis::table_2(1), Axis::integrating(4)] {
        contestants.updated.subject = None;
        for sample in 0..samples / 2 {
            if new_model || sample == 0 {
                axis.vary();
            }
            let solution = contestants.solve(&axis.problem(), sample);
            count += 1;
            iterations += solution.iterations;
            most = most.max(solution.iterations);
            active += usize::from(solution.active > 0);
            axis.advance(solution.x[0]);
        }
    }
    let (iterations, active) = (iterations as f64 / count as f64, active as f64 / count as f64);
    let model = if new_model { "new models" } else { "one model" };
    let mut rows = contestants.table(&format!("N = {N}, {model}"));
    rows.iter_mut().for_each(|row| row["model"] = json!(model));
    (rows[0]["iterations_mean"], rows[0]["iterations_max"]) = (json!(iterations), json!(most));
    println!(
        "ours from nothing: {iterations:.1} iterations in the mean, {most} at most; a limit active in {:.0} %",
        100.0 * active
    );
    rows
}

fn cost<const N: usize>(problem: &Problem<N, N>, x: &[f64; N]) -> f64 {
    let mut cost = 0.0;
    for i in 0..N {
        let beyond: f64 = (i + 1..N).map(|k| problem.hessian[i][k] * x[k]).sum();
        cost += x[i] * (0.5 * problem.hessian[i][i] * x[i] + beyond + problem.gradient[i]);
    }
    cost
}

fn main() {
    let arguments = Arguments::read(&[]);
    let samples = if arguments.quick { 200 } else { 20_000 };
    let before = report::load();
    let mut figures = Vec::new();
    for new_model in [false, true] {
        figures.extend(compare::<10>(samples, new_model));
        figures.extend(compare::<20>(samples, new_model));
        figures.extend(compare::<40>(samples, new_model));
    }
    let after = report::load();
    let p50 = |name: &str| {
        let figure = figures.iter().rfind(|figure| figure["n"] == 20 && figure["name"] == name);
        figure.and_then(|figure| figure["p50_ns"].as_f64()).unwrap_or(f64::NAN)
    };
    println!("\nload {before} before, {after} after");
    for ours in [OURS, RESUMED] {
        println!(
            "N = 20, new models, {ours}: {:.2} us p50 (aim: under 10 us), {:.1} x as fast as Clarabel with new data \
             (aim: at least 20)",
            p50(ours) * 1e-3,
            p50(UPDATED) / p50(ours),
        );
    }
    report::write(arguments.json.as_deref(), &json!({ "load": [before, after], "figures": figures }));
}
