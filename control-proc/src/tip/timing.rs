//! How fast the teeth go along a run.
//!
//! ```text
//! x(s) = s'^2 <= min( v^2,  min_i (c_i/|q_i'|)^2,  (Q / sum_i A_i |q_i'|)^2,  min_i a_i / (2 |q_i''|) )
//! |s''| <= min_i (a_i - |q_i''| x) / |q_i'|
//! ```
//!
//! s length of the way in m, s' speed of the teeth in m/s, v speed of the task in m/s; q_i position of a cylinder in m,
//! q' and q'' its derivatives by s; c_i speed in m/s that the axis can give that way and there: 0.9 of the largest
//! measured one, and less near a soft limit ([`EndStops`]); a_i `stop_deceleration` in m/s2; Q nine tenths of the
//! pump's flow in m3/s, A_i area in m2 that the pump fills. x rises and falls as steeply as allowed, and is 0 at both
//! ends of the run. Near a virtual wall x is bounded as well: cylinders that went twice as fast would still stop before
//! it, with half of what a task leaves to a wall ([`Walls::margin`]).
//!
//! s(t) of these speeds has steps of the acceleration. Its mean over the time T_s has none. The mean is as long as the
//! run and stands at both ends:
//!
//! ```text
//! T_s = max( 2 max_i (a_i/j_i),  min( 1.4 max_i (1/f_i),  g t_r/20 ) )      g = max(0, (l/(v t_r) - 0.7)/0.3)
//! ```
//!
//! j_i `jerk` of an axis in m/s3, f_i natural frequency of its load in Hz as it was commissioned, l length of the run
//! in m and t_r its time in s. A mean over the period of a swing leaves nothing in its motion that excites it. Without
//! it the boom, which stands while the arm begins to move, swings on its oil. Source: Singer and Seering, ASME J. Dyn.
//! Syst. Meas. Control 112 (1990). Periods change with pose and load, and several axes swing together slower than each
//! by itself; hence 1.4. A run may become longer by a twentieth of its time, and by less the more the machine slows it
//! anyway.
//!
//! In a comparison without scaling ([`TipWithout`](pipeline::machine::TipWithout)) x is v^2 all along. Of all bounds
//! only the mean is left.

use mechanism::AXES;
use pipeline::machine::{Axis, Commissioned, Machine, TipTask};

use crate::protection::{end_stops::EndStops, walls::Walls};

/// Length between two points of the way at which speeds are worked out, m, and the least number of parts of a run.
const STEP: f64 = 0.01;
const LEAST_PARTS: usize = 100;
/// Part of the largest speed and flow that a task may ask for: the rest makes good what disturbances cost.
const GIVEN: f64 = 0.9;
/// Speed with which an axis may arrive at a soft limit, m/s.
const ARRIVAL: f64 = 0.01;
/// Speeds for which the way to a virtual wall has to do, in parts of the planned ones: controllers make good what they
/// are off their way.
const BEFORE_WALL: f64 = 2.0;
/// Periods of the slowest swing over which a way is averaged, and the largest part of a run's time for it.
const SWINGS: f64 = 1.4;
const SHARE: f64 = 0.05;
/// Part of the task's speed below which the mean speed of a run leaves no time for that.
const SLOWED: f64 = 0.7;
/// Slowest speed of the teeth, m/s, so that a run ends.
const LEAST_SPEED: f64 = 1e-3;

/// What bounds the speed of the teeth at a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Limit {
    /// The speed of the task.
    Task,
    /// The speed of an axis.
    Speed(usize),
    /// A soft limit of an axis is near.
    SoftLimit(usize),
    /// The acceleration of an axis.
    Acceleration(usize),
    /// The flow of the pump.
    Flow,
    /// A virtual wall is near.
    Wall,
}

/// What one axis can give.
struct Bounds {
    /// Fastest speeds, retracting and extending, m/s.
    speeds: (f64, f64),
    end_stops: EndStops,
    /// a, m/s2.
    acceleration: f64,
    /// j, m/s3.
    jerk: f64,
    /// 1/f, s; 0 for a load that does not swing.
    swing: f64,
    /// Areas that the pump fills, retracting and extending, m2.
    areas: (f64, f64),
}

impl Bounds {
    fn new(axis: &Axis, period: f64) -> Self {
        let measured = axis.commissioned.as_ref().map(|model| model.tested_speeds(axis.control.command_limit));
        let (retract, extend) = measured.unwrap_or((axis.max_speed, axis.max_speed));
        let limits = axis.motion_limits(period);
        Self {
            speeds: (GIVEN * retract.min(axis.max_speed), GIVEN * extend.min(axis.max_speed)),
            end_stops: EndStops::new(axis, period),
            acceleration: limits.stop_deceleration,
            jerk: limits.jerk,
            swing: axis.commissioned.as_ref().map_or(0.0, Commissioned::swing_period),
            areas: axis.plant.as_ref().map_or((0.0, 0.0), |plant| (plant.rod_area, plant.piston_area)),
        }
    }

    fn fastest(&self, sign: f64) -> f64 {
        if sign > 0.0 { self.speeds.1 } else { self.speeds.0 }
    }

    /// c with the cylinder at `position` m, by the sign of its speed.
    fn speed(&self, sign: f64, position: f64) -> f64 {
        self.fastest(sign).min(self.end_stops.stopping_speed(sign, position) + ARRIVAL)
    }
}

/// What the axes of a machine can give.
pub struct Timing {
    bounds: Vec<Bounds>,
    walls: Option<Walls>,
    /// Q, m3/s; infinite where no pump is known.
    flow: f64,
    /// v, m/s.
    speed: f64,
    /// T, s.
    period: f64,
    /// x is bounded by what the machine can give.
    scales: bool,
}

/// A run point by point: s in m, x in m2/s2.
struct Profile {
    step: f64,
    squares: Vec<f64>,
}

impl Timing {
    /// Of the first four axes of a machine, for this task.
    pub fn new(machine: &Machine, task: &TipTask) -> Self {
        let period = machine.timing.period.as_secs_f64();
        Self {
            bounds: machine.axes.iter().take(AXES).map(|axis| Bounds::new(axis, period)).collect(),
            walls: Walls::of(machine),
            flow: machine.hydraulics.map_or(f64::INFINITY, |hydraulics| GIVEN * hydraulics.supply.flow),
            speed: task.speed,
            period,
            scales: !task.without.scaling,
        }
    }

    /// s at every period from the begin of a run to its end, m; `positions` are those of the cylinders at s, m.
    pub fn run(&self, (begin, end): (f64, f64), positions: impl Fn(f64) -> [f64; AXES]) -> Vec<f64> {
        let parts = LEAST_PARTS.max(((end - begin) / STEP).ceil() as usize);
        let step = (end - begin) / parts as f64;
        let points: Vec<[f64; AXES]> = (0..=parts).map(|k| positions(begin + step * k as f64)).collect();
        let profile = if self.scales {
            self.profile(&points, step)
        } else {
            Profile { step, squares: vec![self.speed * self.speed; parts + 1] }
        };
        let smooth = self.smooth(&profile.sampled(self.period)).into_iter();
        let mut ways: Vec<f64> = smooth.map(|way| (begin + way).min(end)).collect();
        // The mean ends there but for rounding.
        if let Some(last) = ways.last_mut() {
            *last = end;
        }
        ways
    }

    /// The fastest x that is allowed at all points.
    fn profile(&self, points: &[[f64; AXES]], step: f64) -> Profile {
        let last = points.len() - 1;
        // Derivatives by s; at the ends those of the point beside them.
        let inner = |k: usize| k.clamp(1, last - 1);
        let first = |k: usize, i: usize| (points[inner(k) + 1][i] - points[inner(k) - 1][i]) / (2.0 * step);
        let second = |k: usize, i: usize| {
            let k = inner(k);
            (points[k + 1][i] - 2.0 * points[k][i] + points[k - 1][i]) / (step * step)
        };
        let all = |of: &dyn Fn(usize) -> f64| std::array::from_fn(of);
        let cap = |k: usize| {
            let (square, _) = self.bound(&points[k], &all(&|i| first(k, i)), &all(&|i| second(k, i)));
            square.max(LEAST_SPEED * LEAST_SPEED)
        };
        let rise = |k: usize, square: f64| {
            let axes =
                self.bounds.iter().enumerate().map(|(i, bounds)| {
                    (bounds.acceleration - second(k, i).abs() * square).max(0.0) / first(k, i).abs()
                });
            2.0 * step * axes.fold(f64::INFINITY, f64::min)
        };
        let mut squares: Vec<f64> = (0..=last).map(cap).collect();
        (squares[0], squares[last]) = (0.0, 0.0);
        for k in 1..=last {
            squares[k] = squares[k].min(squares[k - 1] + rise(k - 1, squares[k - 1]));
        }
        for k in (0..last).rev() {
            squares[k] = squares[k].min(squares[k + 1] + rise(k + 1, squares[k + 1]));
        }
        Profile { step, squares }
    }

    /// The largest x at a place, and what bounds it; `rates` are q' and `bends` q''.
    pub fn bound(&self, positions: &[f64; AXES], rates: &[f64; AXES], bends: &[f64; AXES]) -> (f64, Limit) {
        let mut least = (self.speed * self.speed, Limit::Task);
        let mut and = |square: f64, limit: Limit| {
            if square < least.0 {
                least = (square, limit);
            }
        };
        for (i, bounds) in self.bounds.iter().enumerate() {
            let sign = rates[i].signum();
            let speed = bounds.speed(sign, positions[i]);
            let limit = if speed < bounds.fastest(sign) { Limit::SoftLimit(i) } else { Limit::Speed(i) };
            and((speed / rates[i].abs()).powi(2), limit);
            and(bounds.acceleration / (2.0 * bends[i].abs()), Limit::Acceleration(i));
        }
        and((self.flow / self.filled(rates)).powi(2), Limit::Flow);
        and(self.before_walls(positions, *rates).powi(2), Limit::Wall);
        least
    }

    /// The axis that needs the longest to come to its speed, where their speeds are `rates`.
    pub fn slowest(&self, rates: &[f64; AXES]) -> usize {
        let time = |i: &usize| rates[*i].abs() / self.bounds[*i].acceleration;
        (0..AXES).max_by(|a, b| time(a).total_cmp(&time(b))).unwrap_or_default()
    }

    /// Flow in m3/s that the cylinders take at these speeds, m/s; in m2 for speeds by s.
    pub fn filled(&self, rates: &[f64; AXES]) -> f64 {
        let of =
            |(bounds, rate): (&Bounds, &f64)| rate.abs() * if *rate > 0.0 { bounds.areas.1 } else { bounds.areas.0 };
        self.bounds.iter().zip(rates).map(of).sum()
    }

    /// Q, m3/s; infinite where no pump is known.
    pub fn flow(&self) -> f64 {
        self.flow
    }

    /// Speed of the teeth with which virtual walls let the cylinders pass `positions`, m/s; `rates` are q'.
    fn before_walls(&self, positions: &[f64; AXES], rates: [f64; AXES]) -> f64 {
        let fast = rates.map(|rate| BEFORE_WALL * rate * self.speed);
        self.speed * self.walls.as_ref().map_or(1.0, |walls| walls.factor(positions, &fast, 0.5 * walls.margin()))
    }

    /// The mean over the time of smoothing of a way that stands before and after.
    fn smooth(&self, ways: &[f64]) -> Vec<f64> {
        let last = ways.last().copied().unwrap_or_default();
        let longest = |of: fn(&Bounds) -> f64| self.bounds.iter().map(of).fold(0.0, f64::max);
        let taken = self.period * ways.len() as f64;
        let spare = ((last / (self.speed * taken) - SLOWED) / (1.0 - SLOWED)).clamp(0.0, 1.0);
        let swing = (SWINGS * longest(|bounds| bounds.swing)).min(SHARE * spare * taken);
        let time = longest(|bounds| 2.0 * bounds.acceleration / bounds.jerk).max(swing);
        let width = ((time / self.period).ceil() as usize).max(1);
        let at = |k: usize| ways.get(k).copied().unwrap_or(last);
        let mut sum = 0.0;
        (0..ways.len() + width)
            .map(|k| {
                // Before the begin the way is 0.
                sum += at(k) - if k >= width { at(k - width) } else { 0.0 };
                sum / width as f64
            })
            .collect()
    }
}

impl Profile {
    /// The way at every period, m, from the begin to the first period after the end.
    fn sampled(&self, period: f64) -> Vec<f64> {
        let mut ways = vec![0.0];
        let mut passed = 0.0;
        for (k, pair) in self.squares.windows(2).enumerate() {
            let (from, to) = (pair[0].sqrt(), pair[1].sqrt());
            let time = 2.0 * self.step / (from + to);
            let acceleration = (to - from) / time;
            while let t = ways.len() as f64 * period - passed
                && t <= time
            {
                ways.push(self.step * k as f64 + t * (from + 0.5 * acceleration * t));
            }
            passed += time;
        }
        ways.push(self.step * (self.squares.len() - 1) as f64);
        ways
    }
}
