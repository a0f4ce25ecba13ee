//! How far the bucket's teeth were from their way.
//!
//! ```text
//! e = distance of the teeth from the nearest place of the way          lag = s_planned - s(nearest place)
//! ```
//!
//! The ends belong to the way, so that overshoot past its end counts. The teeth are where the true positions of the
//! cylinders put them. The error counts from the begin of the motion to its planned end; before, the axes come to the
//! begin of the way. For its largest value the teeth are watched for [`AFTER`] more: they arrive late, and swing out.

use std::fmt;

use control_proc::{
    ReferenceError,
    protection::walls::Walls,
    tip::{TipPlan, watch::NEAR},
};
use mechanism::{AXES, PreparedMechanism, Vector};
use pipeline::{
    machine::Machine,
    message::{AxisCommand, control_flag},
    statistics::ErrorStatistics,
};
use plant_sim::PlantSim;
use serde::Serialize;

use super::table::number;

/// Time for which the teeth are watched after the planned end of their way, s.
pub const AFTER: f64 = 3.0;
/// Way before and after a place by which its direction is told, m.
const BESIDE: f64 = 1e-3;

/// A place of the teeth on their way.
#[derive(Debug, Clone, Copy)]
pub struct TracePoint {
    /// Length of the way, m.
    pub s: f64,
    /// The planned place, m.
    pub planned: Vector,
    /// Distance of the teeth, m, positive to the left of the way.
    pub error: f64,
    /// Positions of the cylinders, m.
    pub positions: [f64; AXES],
}

/// Errors of the teeth during a run.
#[derive(Debug, Clone)]
pub struct Teeth {
    plan: TipPlan,
    mechanism: PreparedMechanism,
    /// T, s.
    period: f64,
    /// Distance from the way, m.
    error: ErrorStatistics,
    /// Pitch minus the planned one, degrees.
    pitch: ErrorStatistics,
    /// Where the error was largest, m.
    worst: [f64; 2],
    is_done: bool,
    names: Vec<String>,
    /// Where the cylinders were at the last tick before the way, m.
    before: [f64; AXES],
    walls: Option<Walls>,
    /// Ticks so far.
    ticks: u64,
    stopped: Option<Stopped>,
}

/// What ended a task before its end.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Stopped {
    /// The first axis that a virtual wall has stopped.
    pub axis: String,
    /// The wall that the machine was nearest to, as a key of the machine file.
    pub wall: &'static str,
    /// When, s.
    pub time: f64,
}

impl fmt::Display for Stopped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "walls.{} stopped axis.{} at {:.2} s", self.wall, self.axis, self.time)
    }
}

/// The figures of a run; m, degrees and s.
#[derive(Debug, Clone, Serialize)]
pub struct TeethFigures {
    /// Root mean square of the distance from the way, m; none where the teeth have not begun.
    pub rms: Option<f64>,
    /// Largest distance from the way, up to [`AFTER`] after its planned end, m.
    pub max: Option<f64>,
    /// Where it was, `[x, z]` in m.
    pub max_at: Option<[f64; 2]>,
    /// Root mean square of the error of the pitch, degrees.
    pub pitch_rms: Option<f64>,
    /// Planned time of the motion, s.
    pub duration: f64,
    /// Length of the way, m.
    pub length: f64,
    /// The planned time has passed.
    pub is_done: bool,
    /// Where the teeth have not begun: the axis that is furthest from the begin of the way, and how far, m.
    pub awaited: Option<(String, f64)>,
    /// What has stopped a task that has not come to its end.
    pub stopped: Option<Stopped>,
    /// Statistics of the distance from the way, to be merged.
    #[serde(skip)]
    pub error: ErrorStatistics,
    /// Statistics of the error of the pitch, to be merged.
    #[serde(skip)]
    pub pitch: ErrorStatistics,
}

impl Teeth {
    /// Of a machine whose axes follow a task; none for another machine.
    ///
    /// # Errors
    /// The machine cannot do the task.
    pub fn of(machine: &Machine) -> Result<Option<Self>, ReferenceError> {
        let plan = TipPlan::of(machine)?;
        Ok(plan.zip(machine.mechanism.as_ref()).map(|(plan, mechanism)| Self {
            plan,
            mechanism: mechanism.prepared(),
            period: machine.timing.period.as_secs_f64(),
            error: ErrorStatistics::default(),
            pitch: ErrorStatistics::default(),
            worst: [f64::NAN; 2],
            is_done: false,
            names: machine.axes.iter().take(AXES).map(|axis| axis.name.clone()).collect(),
            before: [f64::NAN; AXES],
            walls: Walls::of(machine),
            ticks: 0,
            stopped: None,
        }))
    }

    /// The plan.
    pub fn plan(&self) -> &TipPlan {
        &self.plan
    }

    /// Whether the planned time has passed.
    pub fn is_done(&self) -> bool {
        self.is_done
    }

    /// Takes in a tick and its commands; `way` is [`control_proc::Controller::on_the_way`].
    pub fn observe(&mut self, way: Option<(f64, f64)>, plant: &PlantSim, commands: &[AxisCommand]) {
        let positions: [f64; AXES] = std::array::from_fn(|i| plant.axes()[i].position);
        if self.stopped.is_none() {
            self.stopped = self.stopped_by(&positions, commands);
        }
        self.ticks += 1;
        let Some(t) = way.map(|(start, now)| self.period * (now - start)).filter(|t| *t >= 0.0) else {
            self.before = positions;
            return;
        };
        let is_past = t > self.plan.duration();
        self.is_done |= is_past;
        if t > self.plan.duration() + AFTER {
            return;
        }
        let pose = self.mechanism.pose(&positions);
        let s = self.plan.length(t);
        let way = self.plan.way();
        let distance = way.distance(pose.tip, ((s - NEAR).max(0.0), (s + NEAR).min(way.length())));
        if distance > self.error.max {
            (self.error.max, self.worst) = (distance, [pose.tip.x, pose.tip.z]);
        }
        if is_past {
            return;
        }
        self.error.push(distance);
        let wanted = mechanism::Rotation::by(self.plan.place(t).pitch);
        self.pitch.push((pose.bucket * wanted.inverse()).angle().to_degrees());
    }

    /// The axis that a wall stops in this tick.
    fn stopped_by(&self, positions: &[f64; AXES], commands: &[AxisCommand]) -> Option<Stopped> {
        let axis = self.names.iter().zip(commands).find(|(_, axis)| axis.flags & control_flag::WALL != 0)?.0.clone();
        let (wall, _) = self.walls.as_ref()?.least_distance(positions)?;
        Some(Stopped { axis, wall, time: self.period * self.ticks as f64 })
    }

    /// The teeth of a tick as a picture shows them; none before the begin and after the end of the way.
    pub fn trace(&self, way: Option<(f64, f64)>, plant: &PlantSim) -> Option<TracePoint> {
        let t =
            way.map(|(start, now)| self.period * (now - start)).filter(|t| (0.0..=self.plan.duration()).contains(t))?;
        let positions: [f64; AXES] = std::array::from_fn(|i| plant.axes()[i].position);
        let (tip, s, way) = (self.mechanism.pose(&positions).tip, self.plan.length(t), self.plan.way());
        let beside = |by: f64| way.place((s + by).clamp(0.0, way.length())).at;
        let side = (beside(BESIDE) - beside(-BESIDE)).cross(tip - beside(0.0));
        let error = way.distance(tip, ((s - NEAR).max(0.0), (s + NEAR).min(way.length())));
        Some(TracePoint { s, planned: beside(0.0), error: error.copysign(side), positions })
    }

    /// The figures so far.
    pub fn figures(&self) -> TeethFigures {
        let has_begun = self.error.count > 0;
        TeethFigures {
            rms: has_begun.then(|| self.error.rmse()),
            max: has_begun.then_some(self.error.max),
            max_at: has_begun.then_some(self.worst),
            pitch_rms: has_begun.then(|| self.pitch.rmse()),
            duration: self.plan.duration(),
            length: self.plan.travel(),
            is_done: self.is_done,
            awaited: if has_begun { None } else { self.awaited() },
            stopped: self.stopped.clone().filter(|_| !self.is_done),
            error: self.error,
            pitch: self.pitch,
        }
    }

    /// The axis that is furthest from its begin of the way, and how far, m; none before the first tick.
    fn awaited(&self) -> Option<(String, f64)> {
        let away = self.names.iter().enumerate().filter_map(|(i, name)| {
            let (_, begin) = *self.plan.points(i).first()?;
            let error = (self.before[i] - begin).abs();
            error.is_finite().then(|| (name.clone(), error))
        });
        away.max_by(|a, b| a.1.total_cmp(&b.1))
    }
}

impl TeethFigures {
    /// A line for people.
    pub fn line(&self) -> String {
        let planned = format!("{} m in {} s", number(self.length), number(self.duration));
        let stopped = self.stopped.as_ref().map_or_else(String::new, |stopped| format!(" {stopped}."));
        match (self.rms, self.max, self.max_at, self.pitch_rms) {
            (Some(rms), Some(max), Some([x, z]), Some(pitch)) => format!(
                "Teeth, {planned}: {} mm rms and at most {} mm from their way, at [{x:.2}, {z:.2}] m; pitch {} degrees \
                 rms{}.{stopped}\n",
                number(1e3 * rms),
                number(1e3 * max),
                number(pitch),
                if self.is_done { "" } else { "; the run ended before the end of the way" }
            ),
            _ => {
                let awaited = self.awaited.as_ref().map(|(axis, error)| {
                    format!(" axis.{axis} was furthest from it at the end, {} mm.", number(1e3 * error))
                });
                format!(
                    "Teeth, {planned}: not begun; all four axes have to track, and to come to its begin first.{}\
                     {stopped}\n",
                    awaited.unwrap_or_default()
                )
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use pipeline::machine::ReferenceSource;

    use super::*;

    #[test]
    fn teeth_that_go_past_the_end_of_the_way_count_in_the_largest_error() {
        let mut machine = Machine::load(None, &[]).unwrap();
        machine.axes.iter_mut().for_each(|axis| axis.reference = ReferenceSource::Tip);
        let mut teeth = Teeth::of(&machine).unwrap().unwrap();
        let ends: [f64; AXES] = std::array::from_fn(|axis| teeth.plan().points(axis).last().unwrap().1);
        let mut plant = |past: f64| {
            for (axis, end) in machine.axes.iter_mut().zip(ends) {
                axis.plant.as_mut().unwrap().initial_position = end;
            }
            // The level cut ends near the machine: the arm draws the teeth on.
            machine.axes[1].plant.as_mut().unwrap().initial_position += past;
            PlantSim::new(&machine, 1).unwrap()
        };
        let duration = teeth.plan().duration();
        let commands = [AxisCommand::default(); AXES];
        let mut at = |t: f64, plant: &PlantSim| {
            teeth.observe(Some((0.0, t / 0.01)), plant, &commands);
            teeth.figures()
        };
        let end = at(duration, &plant(0.0));
        assert!(end.max.unwrap() < 1e-3 && !end.is_done);
        let past = at(duration + 0.4, &plant(0.02));
        assert!(past.max.unwrap() > 0.05 && past.is_done, "{past:?}");
        assert_eq!((past.rms, past.error.count), (end.rms, 1));
        assert_eq!(at(duration + AFTER + 0.1, &plant(0.04)).max, past.max);
    }
}
