//! Plans on the built-in excavator.

use pipeline::machine::{TipPiece, TipShape};

use super::*;

/// The five tasks that are compared: level cuts with the telescope still and moving, slopes, a circle.
fn task(start: [f64; 2], pitch: f64, shape: TipShape, telescope: Option<f64>) -> TipTask {
    TipTask { start, pitch, speed: 0.5, telescope, pieces: vec![TipPiece { shape, pitch: None }] }
}

fn planned(task: TipTask) -> Result<TipPlan, TipError> {
    let mut machine = Machine::load(None, &[]).unwrap();
    machine.tip = Some(task);
    TipPlan::of(&machine).map(Option::unwrap)
}

#[test]
fn the_cuts_of_the_built_in_excavator_are_planned() {
    let tasks = [
        task([7.2, 0.0], -115.0, TipShape::Line([3.7, 0.0]), Some(0.6)),
        task([7.2, 0.0], -115.0, TipShape::Line([3.7, 0.0]), None),
        task([7.25, 0.2], -115.0, TipShape::Line([4.22, -1.55]), None),
        task([7.5, -0.5], -110.0, TipShape::Line([4.47, 1.25]), None),
        task([7.0, -0.5], -115.0, TipShape::Arc { center: [6.0, -0.5], angle: -360.0 }, None),
    ];
    for task in tasks {
        let plan = planned(task.clone()).unwrap();
        let ends: Vec<[f64; AXES]> = vec![plan.positions[0], *plan.positions.last().unwrap()];
        println!("{:?} {:.2} m in {:.2} s: {ends:.3?}", task.pieces[0].shape, plan.way.length(), plan.duration());
        let mut fastest = [0.0f64; AXES];
        for pair in plan.positions.windows(2) {
            for i in 0..AXES {
                fastest[i] = fastest[i].max((pair[1][i] - pair[0][i]).abs() / plan.period);
            }
        }
        println!("   fastest {fastest:.3?}");
    }
}
