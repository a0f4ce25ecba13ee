//! The figures of a planned task: each piece of the way, each cylinder, and what was chosen.

use control_proc::tip::{
    TipPlan,
    account::{Account, PieceAccount},
    timing::Limit,
};
use mechanism::AXES;
use pipeline::machine::Machine;
use serde::Serialize;

use crate::report::table::table;

/// L/min in a m3/s.
const LITRES: f64 = 6e4;
/// Positions that are closer are one, m: an axis that stands.
const SAME: f64 = 5e-4;

/// The figures; SI units, and degrees.
#[derive(Debug, Serialize)]
pub struct TipReport {
    machine: String,
    /// kg.
    payload: f64,
    /// Way of the teeth, m, and the speed that the task asks for, m/s.
    length: f64,
    speed: f64,
    /// s.
    duration: f64,
    /// Flow that a task may ask for, m3/s.
    allowed_flow: Option<f64>,
    pieces: Vec<PieceReport>,
    /// Which axis was free, and what was chosen.
    chosen: String,
    #[serde(skip)]
    axes: Vec<String>,
}

#[derive(Debug, Serialize)]
struct PieceReport {
    piece: String,
    /// Way of the teeth, m; 0 where the bucket turns and the teeth stay in place.
    length: f64,
    time: f64,
    /// Largest speed of the teeth, m/s.
    speed: f64,
    /// Change of the pitch, degrees, and its largest rate, degrees/s.
    turn: f64,
    turn_rate: f64,
    /// What bounds the motion where it is fastest.
    limited_by: String,
    /// How often the boom turns round while the teeth move.
    reversals: usize,
    flow: f64,
    /// Largest part of its allowed force that a cylinder holds, and its axis.
    load: f64,
    load_axis: String,
    /// Least distance of a cylinder from a soft limit, m, and its axis.
    room: f64,
    room_axis: String,
    axes: Vec<AxisReport>,
}

#[derive(Debug, Serialize)]
struct AxisReport {
    name: String,
    /// Lowest and highest position, m.
    range: [f64; 2],
    /// Largest speed, m/s.
    speed: f64,
}

impl TipReport {
    /// Of a plan for this machine.
    pub fn new(machine: &Machine, plan: &TipPlan, account: &Account) -> Self {
        let axes: Vec<String> = machine.axes.iter().take(AXES).map(|axis| axis.name.clone()).collect();
        Self {
            machine: machine.name.clone(),
            payload: machine.mechanism.map_or(0.0, |mechanism| mechanism.masses.payload.mass),
            length: plan.travel(),
            speed: machine.tip.as_ref().map_or(f64::NAN, |task| task.speed),
            duration: plan.duration(),
            allowed_flow: account.allowed_flow,
            pieces: account.pieces.iter().map(|piece| PieceReport::new(machine, &axes, piece)).collect(),
            chosen: plan.chosen(machine),
            axes,
        }
    }

    /// As tables.
    pub fn tables(&self) -> String {
        let allowed = self.allowed_flow.map_or(String::new(), |flow| format!(" of {:.0}", LITRES * flow));
        let flow = format!("flow{allowed}, l/min");
        let header = [
            "piece",
            "way, m",
            "time, s",
            "teeth, m/s",
            "turn, deg",
            "deg/s",
            "limited by",
            "reversals",
            &flow,
            "force",
            "room, mm",
        ];
        let pieces = self.pieces.iter().map(PieceReport::row).collect();
        let mut cylinders = vec!["piece".to_owned()];
        for axis in &self.axes {
            cylinders.extend([format!("{axis}, m"), "mm/s".to_owned()]);
        }
        let cylinders: Vec<&str> = cylinders.iter().map(String::as_str).collect();
        format!(
            "{}, {:.0} kg in the bucket. The teeth: {:.3} m in {:.2} s.\n\n{}\n\nCylinders, and their largest \
             speeds:\n{}\n\n{}\n",
            self.machine,
            self.payload,
            self.length,
            self.duration,
            table(&header, pieces),
            table(&cylinders, self.pieces.iter().map(PieceReport::cylinders).collect()),
            self.chosen
        )
    }
}

impl PieceReport {
    fn new(machine: &Machine, axes: &[String], piece: &PieceAccount) -> Self {
        let axis = |(name, axis): (&String, &control_proc::tip::account::AxisAccount)| AxisReport {
            name: name.clone(),
            range: [axis.range.0, axis.range.1],
            speed: axis.speed,
        };
        Self {
            piece: TipPlan::piece_name(machine, piece.number),
            length: piece.length,
            time: piece.time,
            speed: piece.speed,
            turn: piece.turn.to_degrees(),
            turn_rate: piece.turn_rate.to_degrees(),
            limited_by: told(piece.limit, axes),
            reversals: piece.reversals,
            flow: piece.flow,
            load: piece.load.0,
            load_axis: axes[piece.load.1].clone(),
            room: piece.room.0,
            room_axis: axes[piece.room.1].clone(),
            axes: axes.iter().zip(&piece.axes).map(axis).collect(),
        }
    }

    /// The piece without the file, which stands in its words for each row.
    fn short(&self) -> &str {
        self.piece.rsplit(": ").next().unwrap_or_default()
    }

    fn row(&self) -> Vec<String> {
        vec![
            self.short().to_owned(),
            format!("{:.3}", self.length),
            format!("{:.2}", self.time),
            format!("{:.3}", self.speed),
            // A rounding error below 0 is no turn.
            format!("{:.1}", (10.0 * self.turn).round() / 10.0 + 0.0),
            format!("{:.1}", self.turn_rate),
            self.limited_by.clone(),
            format!("{}", self.reversals),
            format!("{:.0}", LITRES * self.flow),
            format!("{:.0} % {}", 1e2 * self.load, self.load_axis),
            format!("{:.0} {}", 1e3 * self.room, self.room_axis),
        ]
    }

    fn cylinders(&self) -> Vec<String> {
        let mut row = vec![self.short().to_owned()];
        for AxisReport { range: [low, high], speed, .. } in &self.axes {
            let range = if high - low < SAME { format!("{low:.3}") } else { format!("{low:.3} .. {high:.3}") };
            row.extend([range, format!("{:.0}", 1e3 * speed)]);
        }
        row
    }
}

/// What bounds a speed, in words.
fn told(limit: Limit, axes: &[String]) -> String {
    match limit {
        Limit::Task => "task".to_owned(),
        Limit::Speed(axis) => format!("{} speed", axes[axis]),
        Limit::SoftLimit(axis) => format!("{} soft limit", axes[axis]),
        Limit::Acceleration(axis) => format!("{} acceleration", axes[axis]),
        Limit::Flow => "pump flow".to_owned(),
        Limit::Wall => "wall".to_owned(),
    }
}
