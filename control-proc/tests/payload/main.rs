//! The payload by the chamber pressures, in closed loop on the simulated excavator.

use control_proc::Controller;
use pipeline::machine::{Machine, model_settings_in};
use plant_sim::PlantSim;
use sensor_proc::Acquisition;

/// The built-in excavator with transducers at its boom; all of its axes move.
fn excavator(scenario: &str) -> Machine {
    let mut settings = model_settings_in(include_str!("../../../examples/excavator-model.toml"), "model").unwrap();
    let more = [
        ("axis.boom.pressure.resolution", "1e3"),
        ("axis.boom.plant.pressure_noise", "2e4"),
        ("mechanism.payload.heaviest", "3000"),
        ("scenario", scenario),
    ];
    settings.extend(more.map(|(key, value)| (key.to_owned(), value.to_owned())));
    Machine::load(None, &settings).unwrap()
}

/// The payload, kg, that the commands tell at every tick of 25 s.
fn told(scenario: &str, seed: u64) -> Vec<f64> {
    let machine = excavator(scenario);
    let mut plant = PlantSim::new(&machine, seed).unwrap();
    let (mut acquisition, mut controller) = (Acquisition::new(&machine), Controller::new(&machine).unwrap());
    controller.arm();
    let tick = |tick: u64| {
        let sample = acquisition.update(tick, Some(&plant.read()));
        let command = controller.update(&sample, None, None);
        plant.command(&command);
        plant.advance(machine.timing.period);
        command.teeth.payload
    };
    (0..2500).map(tick).collect()
}

fn largest(errors: impl Iterator<Item = f64>) -> f64 {
    errors.map(f64::abs).fold(0.0, f64::max)
}

#[test]
fn a_load_that_comes_in_motion_is_known_in_seconds() {
    for seed in 1..=3 {
        let told = told("payload", seed);
        let empty = largest(told[..1000].iter().copied());
        let loaded = largest(told[1400..].iter().map(|mass| mass - 1500.0));
        println!("seed {seed}: {empty:.0} kg while empty, within {loaded:.0} kg from 4 s after 1500 kg on");
        assert!(empty < 150.0 && loaded < 150.0, "{seed}: {empty} {loaded}");
    }
}

#[test]
fn aerated_oil_and_worn_valves_are_no_payload() {
    for scenario in ["aeration", "valve-wear"] {
        let empty = largest(told(scenario, 1).into_iter());
        println!("{scenario}: {empty:.0} kg");
        assert!(empty < 300.0, "{scenario}: {empty}");
    }
}
