//! What one quadratic programme of a predictive controller costs, ours and Clarabel's, in the same run.
//!
//! `cargo bench --bench qp`; `--quick` for a short run, `--json FILE` for programs. The programmes are those of an axis
//! in closed loop, half of them of the model of the paper's Table 2, half of an integrating one, with N moves, bounds
//! and rate limits; with one model throughout, and with a new one, hence a new Hessian, at every sample. All solve the
//! same one in turn. Ours either begins from nothing, as after a pause, or resumes with the working set of the sample
//! before, as a controller does; an interior point method such as Clarabel's has nothing to resume with. Clarabel either
//! gets new data or is made anew, at its default tolerance; making what it is given is not timed. Ratios are of p50, to
//! ours from nothing.

mod arguments;
#[path = "../control-proc/tests/quadratic/axis.rs"]
mod axis;
mod figures;
#[path = "../control-proc/tests/quadratic/peer.rs"]
mod peer;

use std::{fs, hint::black_box, time::Instant};

use clarabel::solver::IPSolver;
use control_proc::predictive::quadratic::{Problem, Solver, Status};
use serde_json::{Value, json};

use arguments::Arguments;
use axis::Axis;
use figures::{Figures, head};
use peer::{Form, settings};

const OURS: &str = "ours, from nothing";
const RESUMED: &str = "ours, resumed";
const UPDATED: &str = "Clarabel, new data";
const ANEW: &str = "Clarabel, anew";
/// Clarabel's default.
const TOLERANCE: f64 = 1e-8;

fn timed(times: &mut Vec<f64>, solve: impl FnOnce()) {
    let start = Instant::now();
    solve();
    times.push(start.elapsed().as_nanos() as f64);
}

/// Times all contestants with N moves; prints their table and returns it.
fn compare<const N: usize>(samples: usize, new_model: bool) -> Vec<Value> {
    let (mut solver, mut resuming) = (Solver::<N, N>::new(), Solver::<N, N>::new());
    let (mut ours, mut resumed, mut updated, mut anew) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let (mut iterations, mut most, mut active) = (0, 0, 0);
    for mut axis in [Axis::table_2(1), Axis::integrating(4)] {
        let mut peer = None;
        for sample in 0..samples / 2 {
            if new_model || sample == 0 {
                axis.vary();
            }
            let problem: Problem<N, N> = axis.problem();
            let form = Form::new(&problem);
            // The structure is that of the first programme.
            let peer = peer.get_or_insert_with(|| form.solver(settings(TOLERANCE)));
            let (mut solution, mut other) = (None, None);
            let mut contestants: [&mut dyn FnMut(); 4] = [
                &mut || timed(&mut ours, || solution = Some(solver.solve(black_box(&problem)))),
                &mut || timed(&mut resumed, || other = Some(resuming.resume(black_box(&problem)))),
                &mut || {
                    timed(&mut updated, || {
                        peer.update_data(&form.p, &form.q, &form.a, &form.b).expect("the same structure");
                        peer.solve();
                    });
                },
                &mut || timed(&mut anew, || form.solver(settings(TOLERANCE)).solve()),
            ];
            (0..4).for_each(|turn| contestants[(sample + turn) % 4]());
            let solution = solution.expect("had its turn");
            for ours in [Some(&solution), other.as_ref()].into_iter().flatten() {
                assert_eq!(ours.status, Status::Solved);
                let difference = cost(&problem, &ours.x) - peer.solution.obj_val;
                // Clarabel is the less exact one.
                assert!(difference < 1e-6 * peer.solution.obj_val.abs().max(1e-3), "a cost higher by {difference}");
            }
            iterations += solution.iterations;
            most = most.max(solution.iterations);
            active += usize::from(solution.active > 0);
            axis.advance(solution.x[0]);
        }
    }
    let count = ours.len() as f64;
    let (iterations, active) = (iterations as f64 / count, active as f64 / count);
    let model = if new_model { "new models" } else { "one model" };
    head(&format!("N = {N}, {model}"), "    / ours");
    let all = [(OURS, ours), (RESUMED, resumed), (UPDATED, updated), (ANEW, anew)]
        .map(|(name, times)| (name, Figures::new(times)));
    let first = all[0].1.p50;
    let rows = all.iter().map(|(name, figures)| {
        let ratio = figures.p50 / first;
        figures.print(name);
        println!(" {ratio:>9.1}");
        let mut json = figures.json(name);
        (json["n"], json["model"], json["to_ours"]) = (json!(N), json!(model), json!(ratio));
        json
    });
    let mut rows: Vec<Value> = rows.collect();
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

fn load() -> String {
    let text = fs::read_to_string("/proc/loadavg").unwrap_or_default();
    text.split(' ').next().unwrap_or_default().to_owned()
}

fn main() {
    let arguments = Arguments::read();
    let samples = if arguments.quick { 200 } else { 20_000 };
    let before = load();
    let mut figures = Vec::new();
    for new_model in [false, true] {
        figures.extend(compare::<10>(samples, new_model));
        figures.extend(compare::<20>(samples, new_model));
        figures.extend(compare::<40>(samples, new_model));
    }
    let after = load();
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
    if let Some(file) = arguments.json {
        let text = serde_json::to_string_pretty(&json!({ "load": [before, after], "figures": figures }));
        fs::write(file, text.expect("plain figures")).expect("the file for the figures");
    }
}
