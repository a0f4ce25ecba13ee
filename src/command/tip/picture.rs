//! The picture of a planned task: the machine at begin, middle and end of the way, and below it the four cylinders over
//! time. Dashed lines are soft limits, where they are near; grey ones lie between two pieces.

use std::fmt::Write as _;

use control_proc::tip::{TipPlan, account::Account};
use mechanism::{AXES, Mechanism, Vector};
use pipeline::machine::Machine;

use crate::report::{
    chart::one_scale,
    motion::{
        outline::{GROUND, View, line},
        side::{Drawn, Side},
    },
    page::escaped,
};

/// Width, height of the machine, and of each panel below it.
const WIDTH: f64 = 1000.0;
const MACHINE: f64 = 620.0;
const PANEL: f64 = 110.0;
/// Space above the machine, and between two panels.
const HEAD: f64 = 50.0;
const GAP: f64 = 34.0;
/// Edges of the panels.
const LEFT: f64 = 90.0;
const RIGHT: f64 = 960.0;
/// Space around the machine, m.
const MARGIN: f64 = 0.4;
/// Part of the time at which the machine is drawn, and how strong.
const POSES: [(f64, f64); 3] = [(0.0, 0.35), (0.5, 0.65), (1.0, 1.0)];
/// Least range of a panel, m.
const LEAST: f64 = 0.02;
/// Largest number of points of a line.
const POINTS: usize = 250;
const WAY: &str = "#d55e00";
const POSITION: &str = "#0072b2";
const FAINT: &str = "#d0d0d0";
const DASHED: &str = " stroke-dasharray=\"6 4\"";

/// Draws a plan for this machine.
pub fn picture(machine: &Machine, mechanism: &Mechanism, plan: &TipPlan, account: &Account) -> String {
    let height = HEAD + MACHINE + AXES as f64 * (PANEL + GAP) + GAP;
    let title = format!(
        "{}: {:.2} m in {:.1} s, {:.0} kg in the bucket",
        machine.name,
        plan.travel(),
        plan.duration(),
        mechanism.masses.payload.mass
    );
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" font-family=\"sans-serif\" \
         font-size=\"16\">\n<rect width=\"{WIDTH}\" height=\"{height}\" fill=\"white\"/>\n"
    );
    text(&mut svg, (20.0, 30.0), "start", &escaped(&title));
    draw_machine(&mut svg, mechanism, plan);
    for (axis, settings) in machine.axes.iter().enumerate().take(AXES) {
        let top = HEAD + MACHINE + GAP + axis as f64 * (PANEL + GAP);
        let label = format!("axis.{}, m", settings.name);
        panel(&mut svg, top, &escaped(&label), (plan, account), axis, settings.soft_limits);
    }
    text(&mut svg, (RIGHT, height - 0.3 * GAP), "end", &format!("time, 0 to {:.1} s", plan.duration()));
    svg + "</svg>\n"
}

fn text(svg: &mut String, (x, y): (f64, f64), anchor: &str, text: &str) {
    let _ = writeln!(svg, "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{text}</text>");
}

fn draw_machine(svg: &mut String, mechanism: &Mechanism, plan: &TipPlan) {
    let side = Side::new(mechanism);
    let positions = plan.positions();
    let last = positions.len() - 1;
    let pose = |part: f64| side.drawn(&positions[(part * last as f64).round() as usize]);
    let poses: Vec<(Drawn, f64)> = POSES.iter().map(|(part, opacity)| (pose(*part), *opacity)).collect();
    let way: Vec<Vector> =
        (0..=POINTS).map(|k| plan.way().place(plan.way().length() * k as f64 / POINTS as f64).at).collect();
    let ground = Vector::default();
    let all = || poses.iter().flat_map(|(drawn, _)| drawn.points()).chain(&way).chain([&ground]);
    let span = |of: fn(&Vector) -> f64| {
        let edges = |(low, high): (f64, f64), at: &Vector| (low.min(of(at)), high.max(of(at)));
        all().fold((f64::INFINITY, f64::NEG_INFINITY), edges)
    };
    let [x, z] = one_scale([span(|at| at.x), span(|at| at.z)], MARGIN, WIDTH / MACHINE);
    let scale = WIDTH / (x.1 - x.0);
    let view = View { origin: (-scale * x.0, HEAD + scale * z.1), scale };
    line(svg, &[(0.0, view.origin.1), (WIDTH, view.origin.1)], GROUND, 2.0, "");
    for (drawn, opacity) in &poses {
        view.machine(svg, drawn, *opacity);
    }
    let way: Vec<_> = way.iter().map(|at| view.at(*at)).collect();
    line(svg, &way, WAY, 2.5, "");
}

/// One cylinder over time.
fn panel(
    svg: &mut String,
    top: f64,
    label: &str,
    (plan, account): (&TipPlan, &Account),
    axis: usize,
    limits: (f64, f64),
) {
    let points = plan.points(axis);
    let edges = |(low, high): (f64, f64), point: &(f64, f64)| (low.min(point.1), high.max(point.1));
    let (low, high) = points.iter().fold((f64::INFINITY, f64::NEG_INFINITY), edges);
    let space = (0.08 * (high - low)).max(0.5 * (LEAST - (high - low))).max(0.0);
    let (bottom, most) = (low - space, high + space);
    let x = |t: f64| LEFT + (RIGHT - LEFT) * t / plan.duration().max(f64::MIN_POSITIVE);
    let y = |position: f64| top + PANEL * (most - position) / (most - bottom);
    let mut passed = 0.0;
    for piece in &account.pieces {
        line(svg, &[(x(passed), top), (x(passed), top + PANEL)], FAINT, 1.0, "");
        passed += piece.time;
    }
    line(svg, &[(x(passed), top), (x(passed), top + PANEL)], FAINT, 1.0, "");
    for limit in [limits.0, limits.1].into_iter().filter(|limit| (bottom..=most).contains(limit)) {
        line(svg, &[(LEFT, y(limit)), (RIGHT, y(limit))], WAY, 1.0, DASHED);
    }
    let every = points.len().div_ceil(POINTS);
    let drawn: Vec<_> = points.iter().step_by(every).chain(points.last()).map(|(t, at)| (x(*t), y(*at))).collect();
    line(svg, &drawn, POSITION, 2.0, "");
    text(svg, (LEFT, top - 8.0), "start", label);
    let edges = if high - low < 5e-4 { vec![low] } else { vec![low, high] };
    for edge in edges {
        text(svg, (LEFT - 8.0, y(edge) + 5.0), "end", &format!("{edge:.3}"));
    }
}
