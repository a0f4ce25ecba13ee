//! Hardware in the loop over the network: the simulated machine on one computer, the group on another, in lock-step.
//!
//! ```text
//! group --ValveCommand--> stage --request--> router --> plant
//! group <-EncoderReading- stage <--answer--- router <-- plant
//! ```
//!
//! | file | what |
//! |---|---|
//! | `request` | the attachment of a request |
//! | `host` | what the plant answers to which request |
//! | `serve` | the plant behind a key of the router |
//! | `remote` | the requests of the stage: sent, repeated, given up |
//! | `stage` | the stage in the place of `plant-sim` |
//!
//! The stage asks for one reading after the other: reading 0 begins a run, and reading k+1 comes with the command that
//! answers reading k. A request may be lost, be repeated or come late, and the plant makes each step once.
//!
//! Only numbers travel: the times of a reading are those of the computer that publishes it in its group.

pub mod host;
pub mod remote;
pub mod request;
pub mod serve;
pub mod stage;

use pipeline::{layout::named, machine::Machine};

/// Number by which two computers compare what they simulate: a hash of all that the plant is made of. Gains, models,
/// references and paths are not in it. Equal numbers with equal seeds give equal readings.
pub fn simulated(machine: &Machine) -> u64 {
    let Machine { timing, hydraulics, mechanism, soil, scenario, axes, .. } = machine;
    let axes: Vec<_> =
        axes.iter().map(|axis| (&axis.name, axis.stroke, &axis.encoder, &axis.pressure, &axis.plant)).collect();
    let times = (timing.period, timing.drive_timeout);
    named(&format!("{times:?} {hydraulics:?} {mechanism:?} {soil:?} {:?} {axes:?}", scenario.changes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_simulated_counts_and_what_controls_it_does_not() {
        let number = |key: &str, value: &str| {
            let machine = Machine::load(None, &[(key.to_owned(), value.to_owned())]).unwrap();
            simulated(&machine)
        };
        let own = simulated(&Machine::load(None, &[]).unwrap());
        for (key, value) in
            [("name", "\"another\""), ("axis.boom.control.kp", "3"), ("axis.arm.soft_limits", "[0.2, 0.9]")]
        {
            assert_eq!(number(key, value), own, "{key}");
        }
        for (key, value) in [
            ("mechanism.boom.mass", "2131"),
            ("axis.bucket.encoder.resolution", "2e-5"),
            ("scenario", "payload"),
            ("timing.drive_timeout", "60ms"),
            ("oil.temperature", "41"),
        ] {
            assert_ne!(number(key, value), own, "{key}");
        }
    }
}
