//! Tasks of the teeth drawn at random, in reach of the machine and out of it.
//!
//! A task starts in a rectangle in and around the reach of the built-in machine. Each of its one to three pieces is a
//! line or an arc in any direction, and one in three turns the bucket. A task depends on its number and the seed alone.

use std::ops::RangeInclusive;

use pipeline::machine::{TipFree, TipPiece, TipShape, TipTask, TipWithout};

use super::super::drawn::Draw;

/// Where tasks start, m, and their pitch, degrees.
const FORWARD: RangeInclusive<f64> = 3.0..=8.5;
const UP: RangeInclusive<f64> = -2.5..=4.0;
const PITCH: RangeInclusive<f64> = -150.0..=-60.0;
/// Speed of the teeth, m/s.
const SPEED: RangeInclusive<f64> = 0.1..=0.6;
/// Heaviest load, kg; half of the tasks have none.
const MOST_PAYLOAD: f64 = 1500.0;
/// Most pieces of a task.
const MOST_PIECES: f64 = 3.0;
/// Length of a line, and radius of an arc, m; angle of an arc, degrees.
const LENGTH: RangeInclusive<f64> = 0.3..=3.0;
const RADIUS: RangeInclusive<f64> = 0.5..=2.0;
const ANGLE: RangeInclusive<f64> = 30.0..=360.0;
/// Part of the pieces that are arcs, part that turn the bucket, and by how much at most, degrees.
const ARCS: f64 = 0.3;
const TURNS: f64 = 1.0 / 3.0;
const TURN: f64 = 40.0;

/// A task, the load in the bucket, and a number from 0 to 1 that chooses the scenario.
pub struct DrawnTask {
    /// The task.
    pub task: TipTask,
    /// kg.
    pub payload: f64,
    /// From 0 to 1.
    pub scenario: f64,
}

impl DrawnTask {
    /// Task number `number` of this seed.
    pub fn new(seed: u64, number: u64) -> Self {
        let mut draw = Draw::new(seed, number);
        let start = [draw.even(FORWARD), draw.even(UP)];
        let (pitch, speed) = (draw.even(PITCH), draw.even(SPEED));
        let payload = (2.0 * draw.unit() - 1.0).max(0.0) * MOST_PAYLOAD;
        let scenario = draw.unit();
        let count = 1 + (MOST_PIECES * draw.unit()) as usize;
        let (mut at, mut turned) = (start, pitch);
        let pieces = (0..count).map(|_| {
            let shape = shape(&mut draw, &mut at);
            let turns = draw.unit() < TURNS;
            turned += draw.even(-TURN..=TURN) * f64::from(u8::from(turns));
            TipPiece { shape, pitch: turns.then_some(turned), free: None }
        });
        let pieces = pieces.collect();
        Self {
            task: TipTask {
                start,
                pitch,
                speed,
                free: None,
                rounding: 0.0,
                file: None,
                pieces,
                without: TipWithout::default(),
            },
            payload,
            scenario,
        }
    }
}

/// A piece that begins at `at`, which becomes its end.
fn shape(draw: &mut Draw, at: &mut [f64; 2]) -> TipShape {
    let (is_arc, heading) = (draw.unit() < ARCS, draw.even(-180.0..=180.0).to_radians());
    let beside = |length: f64, angle: f64| [length * angle.cos(), length * angle.sin()];
    let plus = |a: [f64; 2], b: [f64; 2]| [a[0] + b[0], a[1] + b[1]];
    if !is_arc {
        *at = plus(*at, beside(draw.even(LENGTH), heading));
        return TipShape::Line(*at);
    }
    let radius = draw.even(RADIUS);
    let center = plus(*at, beside(radius, heading));
    let angle = draw.even(ANGLE) * if draw.unit() < 0.5 { -1.0 } else { 1.0 };
    // From the centre the begin lies the other way.
    *at = plus(center, beside(-radius, heading + angle.to_radians()));
    TipShape::Arc { center, angle }
}

/// A task as a table of a machine file.
pub fn toml(task: &TipTask) -> String {
    let TipTask { start: [x, z], pitch, speed, free, rounding, .. } = task;
    let mut text = format!("[tip]\nstart = [{x}, {z}]\npitch = {pitch}\nspeed = \"{speed} m/s\"\n");
    text += &by_hand(*free);
    text += &if *rounding > 0.0 { format!("rounding = {rounding}\n") } else { String::new() };
    for piece in &task.pieces {
        let shape = match piece.shape {
            TipShape::Line([x, z]) => format!("to = [{x}, {z}]\n"),
            TipShape::Arc { center: [x, z], angle } => format!("center = [{x}, {z}]\nangle = {angle}\n"),
        };
        let pitch = piece.pitch.map_or(String::new(), |pitch| format!("pitch = {pitch}\n"));
        text += &format!("[[tip.piece]]\n{shape}{pitch}{}", by_hand(piece.free));
    }
    text
}

/// The key of a position that a person chose.
fn by_hand(free: Option<TipFree>) -> String {
    match free {
        Some(TipFree::Telescope(position)) => format!("telescope = {position}\n"),
        Some(TipFree::Boom(position)) => format!("boom = {position}\n"),
        None => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use pipeline::machine::{BUILT_IN, Machine};

    use super::*;

    #[test]
    fn a_task_as_a_table_of_a_machine_file_is_read_as_the_same_task() {
        let (before, rest) = BUILT_IN.split_once("\n[tip]\n").unwrap();
        let (_, rest) = rest.split_once("\npiece = ").and_then(|(_, rest)| rest.split_once('\n')).unwrap();
        for number in 0..20 {
            let task = DrawnTask::new(5, number).task;
            let text = format!("{before}\n{}{rest}", toml(&task));
            let machine = Machine::parse(&text, "excavator.toml", Path::new("."), &[]).unwrap();
            assert_eq!(machine.tip, Some(task));
        }
    }

    #[test]
    fn pieces_hang_together_and_a_task_depends_on_its_number_and_the_seed() {
        let mut arcs = 0;
        for number in 0..200 {
            let drawn = DrawnTask::new(5, number);
            assert_eq!(drawn.task, DrawnTask::new(5, number).task);
            assert_ne!(drawn.task, DrawnTask::new(6, number).task);
            assert!((1..=3).contains(&drawn.task.pieces.len()) && (0.0..=1500.0).contains(&drawn.payload));
            let way = control_proc::tip::way::Way::new(&drawn.task, 1.5).unwrap();
            let mut from = drawn.task.start;
            for piece in &drawn.task.pieces {
                match piece.shape {
                    TipShape::Line(to) => from = to,
                    TipShape::Arc { center, angle } => {
                        let turn = mechanism::Rotation::by(angle.to_radians());
                        let begin = mechanism::Vector { x: from[0] - center[0], z: from[1] - center[1] };
                        let end = turn * begin;
                        assert!(RADIUS.contains(&(begin.norm() - 1e-12)) || (begin.norm() - 0.5).abs() < 1e-9);
                        from = [center[0] + end.x, center[1] + end.z];
                        arcs += 1;
                    }
                }
            }
            let end = way.place(way.length()).at;
            assert!((end.x - from[0]).hypot(end.z - from[1]) < 1e-9);
        }
        assert!((80..160).contains(&arcs), "{arcs}");
    }
}
