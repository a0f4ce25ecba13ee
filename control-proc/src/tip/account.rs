//! What a plan asks of the machine, piece by piece: for whoever looks at a task before it runs.
//!
//! Speeds are those from period to period. A piece has the periods in whose middle the teeth are on it; a piece that is
//! shorter than a period has the one in which the teeth pass it.

use mechanism::AXES;
use pipeline::machine::{Machine, TipFree};

use super::{
    TipPlan,
    freedom::Freedom,
    named,
    posture::Cylinders,
    timing::{Limit, Timing},
};

/// Distance of places between which rates of the cylinders are taken, m.
const STEP: f64 = 5e-3;
/// Part of the allowed speed below which the teeth are on the way to it.
const REACHED: f64 = 0.95;
/// Speed of the boom that is a standstill, m/s.
const STILL: f64 = 1e-6;

/// One cylinder along a piece.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisAccount {
    /// Lowest and highest position, m.
    pub range: (f64, f64),
    /// Largest speed, m/s.
    pub speed: f64,
}

/// One piece of a task.
#[derive(Debug, Clone, PartialEq)]
pub struct PieceAccount {
    /// Number of the piece in the task.
    pub number: usize,
    /// Length of the way of the teeth, m; 0 where the bucket turns and the teeth stay in place.
    pub length: f64,
    /// s.
    pub time: f64,
    /// Largest speed of the teeth, m/s.
    pub speed: f64,
    /// Change of the pitch from begin to end, rad.
    pub turn: f64,
    /// Largest rate of the pitch, rad/s.
    pub turn_rate: f64,
    /// What bounds the motion where it is fastest.
    pub limit: Limit,
    /// The cylinders.
    pub axes: [AxisAccount; AXES],
    /// How often the boom turns round while the teeth move.
    pub reversals: usize,
    /// Largest flow of the cylinders, m3/s.
    pub flow: f64,
    /// Largest part of its allowed force that a cylinder holds, and its axis.
    pub load: (f64, usize),
    /// Least distance of a cylinder from a soft limit, m, and its axis.
    pub room: (f64, usize),
}

impl PieceAccount {
    fn new(number: usize) -> Self {
        let axis = AxisAccount { range: (f64::INFINITY, f64::NEG_INFINITY), speed: 0.0 };
        Self {
            number,
            length: 0.0,
            time: 0.0,
            speed: 0.0,
            turn: 0.0,
            turn_rate: 0.0,
            limit: Limit::Task,
            axes: [axis; AXES],
            reversals: 0,
            flow: 0.0,
            load: (0.0, 0),
            room: (f64::INFINITY, 0),
        }
    }
}

/// What a plan asks of its machine.
#[derive(Debug, Clone, PartialEq)]
pub struct Account {
    /// The pieces, in their order.
    pub pieces: Vec<PieceAccount>,
    /// Flow that a task may ask for, m3/s; none where no pump is known.
    pub allowed_flow: Option<f64>,
}

impl TipPlan {
    /// What the plan asks of the machine for which it was made; `None` for one without teeth.
    pub fn account(&self, machine: &Machine) -> Option<Account> {
        let (mechanism, task) = (machine.mechanism.as_ref()?, machine.tip.as_ref()?);
        let cylinders = Cylinders::new(machine, mechanism);
        let timing = Timing::new(machine, task);
        let runs = self.way.runs();
        let (spans, end) = (self.way.spans(), self.way.length());
        let mut pieces: Vec<PieceAccount> = Vec::new();
        // Largest speed along s of the last piece, m/s.
        let mut fastest = 0.0;
        // The run, and the direction in which the boom moved last.
        let mut boom = (usize::MAX, 0.0_f64);
        for (s, positions) in self.lengths.windows(2).zip(self.positions.windows(2)) {
            let middle = 0.5 * (s[0] + s[1]) - 1e-9;
            let run = runs.partition_point(|run| run.1 <= middle);
            // At the end all pieces have been passed.
            let passed = if s[1] < end { middle } else { end };
            let now = spans.partition_point(|(_, span)| span.1 <= passed).min(spans.len() - 1);
            let speeds: [f64; AXES] = std::array::from_fn(|i| (positions[1][i] - positions[0][i]) / self.period);
            let speed = (s[1] - s[0]) / self.period;
            // The pieces that the teeth have passed since the middle of the period before have this one.
            for i in now.min(pieces.len())..=now {
                let (number, (begin, end)) = spans[i];
                if i == pieces.len() {
                    pieces.push(self.still(number, (begin, end)));
                    fastest = 0.0;
                }
                let piece = &mut pieces[i];
                piece.add(&cylinders, &positions[0], &speeds);
                piece.add(&cylinders, &positions[1], &speeds);
                piece.flow = piece.flow.max(timing.filled(&speeds));
                let inside = if (begin..end).contains(&middle) { middle } else { 0.5 * (begin + end) };
                let (along, turning) = self.way.rates(inside);
                piece.speed = piece.speed.max(speed * along.norm());
                piece.turn_rate = piece.turn_rate.max(speed * turning.abs());
                if speed > fastest {
                    fastest = speed;
                    piece.limit = self.limit(&cylinders, &timing, runs[run.min(runs.len() - 1)], middle, speed);
                }
            }
            let Some(piece) = pieces.last_mut() else { continue };
            if boom.0 != run {
                boom = (run, 0.0);
            }
            if speeds[0].abs() > STILL {
                piece.reversals += usize::from(boom.1 * speeds[0] < 0.0);
                boom.1 = speeds[0];
            }
        }
        let flow = timing.flow();
        Some(Account { pieces, allowed_flow: flow.is_finite().then_some(flow) })
    }

    /// A piece of the task from s to s, m, whose motion is not known yet.
    fn still(&self, number: usize, (begin, end): (f64, f64)) -> PieceAccount {
        PieceAccount {
            length: self.way.travel(end) - self.way.travel(begin),
            time: self.time(end) - self.time(begin),
            turn: self.way.place(end).pitch - self.way.place(begin).pitch,
            ..PieceAccount::new(number)
        }
    }

    /// Time at which the teeth are at s, m, in s.
    fn time(&self, s: f64) -> f64 {
        if s >= self.way.length() {
            return self.duration();
        }
        let k = self.lengths.partition_point(|length| *length < s);
        let Some(before) = k.checked_sub(1).map(|k| self.lengths[k]) else { return 0.0 };
        self.period * (k as f64 - (self.lengths[k] - s) / (self.lengths[k] - before))
    }

    /// What bounds the speed of the teeth at s, m, where it is `speed`, m/s.
    fn limit(&self, cylinders: &Cylinders, timing: &Timing, run: (f64, f64), s: f64, speed: f64) -> Limit {
        let end = run.1 - 1e-9 * (run.1 - run.0);
        let s = s.clamp(run.0 + STEP, (end - STEP).max(run.0 + STEP));
        let at = |s: f64| {
            let s = s.clamp(run.0, end);
            cylinders.positions(&self.way.place(s), self.freedom.at(s)).unwrap_or([f64::NAN; AXES])
        };
        let [before, here, after] = [at(s - STEP), at(s), at(s + STEP)];
        let rates = std::array::from_fn(|i| (after[i] - before[i]) / (2.0 * STEP));
        let bends = std::array::from_fn(|i| (after[i] - 2.0 * here[i] + before[i]) / (STEP * STEP));
        let (square, limit) = timing.bound(&here, &rates, &bends);
        if speed < REACHED * square.sqrt() { Limit::Acceleration(timing.slowest(&rates)) } else { limit }
    }

    /// Which axis was free, and what was chosen, in a sentence.
    pub fn chosen(&self, machine: &Machine) -> String {
        let task = machine.tip.as_ref();
        let name = |axis: usize| machine.axes.get(axis).map_or("", |axis| axis.name.as_str());
        let (boom, telescope) = (name(0), name(2));
        let span = |axis: usize| {
            let all = || self.positions.iter().map(|positions| positions[axis]);
            (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max))
        };
        let (low, high) = span(0);
        let turns = match self.freedom.reversals() {
            1 => "1 reversal".to_owned(),
            reversals => format!("{reversals} reversals"),
        };
        let by_hand = task.map_or(0, |task| task.pieces.iter().filter(|piece| piece.free.is_some()).count());
        let by_hand = match by_hand {
            0 => String::new(),
            1 => ", which a person chose at the end of 1 piece".to_owned(),
            count => format!(", which a person chose at the ends of {count} pieces"),
        };
        let range = format!("{low:.3} to {high:.3} m");
        match (&self.freedom, task.and_then(|task| task.free)) {
            (Freedom::Telescope(position), _) => {
                format!("By hand: axis.{telescope} stays at {position} m (tip.telescope), and axis.{boom} follows.")
            }
            (_, Some(TipFree::Boom(position))) => format!("By hand: axis.{boom} stays at {position} m (tip.boom)."),
            _ if low == high => format!("Chosen: axis.{boom} stays at {low:.3} m{by_hand}."),
            (freedom, _) if freedom.points() == 2 => {
                format!("Chosen: axis.{boom} moves evenly along each run, {range}{by_hand}.")
            }
            _ => format!("Chosen: axis.{boom} follows a curve, {range}, with {turns} while the teeth move{by_hand}."),
        }
    }

    /// A piece in words: where it is in the machine file, or the rows of its file.
    pub fn piece_name(machine: &Machine, number: usize) -> String {
        named(machine, number)
    }
}

impl PieceAccount {
    fn add(&mut self, cylinders: &Cylinders, positions: &[f64; AXES], speeds: &[f64; AXES]) {
        let margins = cylinders.margins(&cylinders.at(positions));
        self.load = if margins.load.0 > self.load.0 { margins.load } else { self.load };
        self.room = if margins.room.0 < self.room.0 { margins.room } else { self.room };
        for (axis, (position, speed)) in self.axes.iter_mut().zip(positions.iter().zip(speeds)) {
            axis.range = (axis.range.0.min(*position), axis.range.1.max(*position));
            axis.speed = axis.speed.max(speed.abs());
        }
    }
}
