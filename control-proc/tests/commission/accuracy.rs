//! What is found against what is true.

use super::*;
use control_proc::commission::analyse;

#[test]
fn all() {
    show(&under("nominal"));
    for d in [0.15, 0.3] {
    let mut machine = under("nominal");
    machine.axes.iter_mut().for_each(|axis| axis.plant.as_mut().unwrap().dead_time = d);
    show(&machine);
    }
    let mut machine = under("nominal");
    for p in machine.axes.iter_mut().map(|axis| axis.plant.as_mut().unwrap()) {
        p.valve_curve = pipeline::machine::ValveCurve::S;
        p.dead_band = pipeline::machine::DeadBand { extend: 0.38, retract: 0.35 };
        p.saturation = pipeline::machine::DeadBand { extend: 0.72, retract: 0.7 };
    }
    show(&machine);
    let mut machine = under("nominal");
    machine.scenario.changes = vec![pipeline::machine::Change { parameter: pipeline::machine::Parameter::Temperature, axis: None, start: 0.0, end: 0.0, to: 5.0 }];
    show(&machine);
}

fn show(machine: &Machine) {
    println!("-------");
    for axis in 0..machine.axes.len() {
        let run = Run::of(machine, axis, &Options::default(), 1);
        let started = std::time::Instant::now();
        println!("{} {} beyond {:.4} of {:?}", machine.axes[axis].name, run.reason(), run.beyond, run.experiment.window());
        match analyse(run.experiment.record()) {
            Ok(f) => {
                println!("   td {:.4} tau {:.4} d {:.4} {:.4} fit {:.2} {:?}", f.dead_time, f.time_constant, f.dead_band.extend, f.dead_band.retract, f.fit_percent, started.elapsed());
                for i in 0..f.openings.len() { print!(" {:.3}: {:.4} {:.4};", f.openings[i], f.speeds_extend[i], f.speeds_retract[i]); } println!();
            }
            Err(e) => println!("{e}"),
        }
    }
}
