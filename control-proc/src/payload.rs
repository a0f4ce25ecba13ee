//! The mass that the bucket carries, by the chamber pressures.
//!
//! ```text
//! f_i = p_1i A_1i - p_2i A_2i = g_i + m l_i + sum_j (M_ij + m N_ij) a_j + friction
//! m   = (<sum_i l_i (f_i - g_i)> - <P'>) / (<sum_i l_i^2> + <Q'>)           0 <= m <= heaviest
//! <P'> = (P - <P>) / tau        P = sum_ij l_i M_ij v_j        Q = sum_ij l_i N_ij v_j
//! ```
//!
//! f force of a cylinder in N, p_1 and p_2 pressures of piston side and rod side in Pa, A their areas in m2; g force in
//! N that the machine with an empty bucket asks for at its speeds and M its mass matrix in kg, l in N/kg and N what a
//! kilogram in the bucket adds to them; v speeds of the cylinders in m/s and a accelerations in m/s2; <> first-order
//! filter with the time constant tau of 1 s. The sums over i go over the axes with transducers, away from their end
//! stops: a piston that leans on its end stop bears nothing by its pressures. Friction is not known; over both
//! directions it cancels.
//!
//! Traps: what pushes the teeth, such as soil, looks like less or more in the bucket. A posture in which the payload
//! pulls at no cylinder tells nothing of it: the estimate stays.
//!
//! Runs in the loop: nothing here allocates after construction.

use mechanism::{AXES, Mechanism, PreparedMechanism, Vector};
use pipeline::{
    machine::{Axis, Machine},
    message::EncoderSample,
};

use crate::cylinder::Cylinder;

/// tau, s.
const TIME: f64 = 1.0;
/// Root of the least <sum l^2> of which a mass is told, N/kg: twice what it weighs.
const LEAST_LEVER: f64 = 20.0;
/// Way from an end stop within which the pressures of an axis are left out, m.
const AT_END: f64 = 5e-3;
/// Mass by which l is measured, kg.
const PROBE: f64 = 1e3;

/// Sums over the axes, each with what an empty bucket gives and what a kilogram in it adds.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Sums {
    /// sum l (f - g), N2/kg, and sum l^2, N2/kg2.
    held: [f64; 2],
    /// P, N m/s, and Q, N m/(s kg).
    momentum: [f64; 2],
}

/// The estimate of the payload.
#[derive(Debug, Clone, PartialEq)]
pub struct Payload {
    empty: PreparedMechanism,
    probed: PreparedMechanism,
    cylinders: [Option<Cylinder>; AXES],
    /// kg.
    heaviest: f64,
    /// Part of a new value in the filters.
    new: f64,
    /// None before the first sample with readings.
    filtered: Option<Sums>,
    /// m, kg.
    mass: f64,
}

impl Payload {
    /// Of a machine whose file says up to which mass the payload is estimated.
    pub fn of(machine: &Machine) -> Option<Self> {
        let (mechanism, heaviest) = (machine.mechanism?, machine.heaviest_payload?);
        let axes: &[Axis; AXES] = machine.axes.first_chunk()?;
        Some(Self {
            empty: carrying(mechanism, 0.0),
            probed: carrying(mechanism, PROBE),
            cylinders: axes.each_ref().map(|axis| Cylinder::of(axis).filter(|_| axis.measures_force())),
            heaviest,
            new: 1.0 - (-machine.timing.period.as_secs_f64() / TIME).exp(),
            filtered: None,
            mass: mechanism.masses.payload.mass,
        })
    }

    /// m, kg: that of the machine file before the first sample.
    pub fn mass(&self) -> f64 {
        self.mass
    }

    /// Takes in the pressures of a sample, with the cylinders at `positions` m and `speeds` m/s.
    pub fn update(&mut self, sample: &EncoderSample, positions: &[f64; AXES], speeds: &[f64; AXES]) {
        let Some(sums) = self.sums(sample, positions, speeds) else { return };
        let begin = Sums { held: [sums.held[1] * self.mass, sums.held[1]], ..sums };
        let filtered = self.filtered.get_or_insert(begin);
        for k in 0..2 {
            filtered.held[k] += self.new * (sums.held[k] - filtered.held[k]);
            filtered.momentum[k] += self.new * (sums.momentum[k] - filtered.momentum[k]);
        }
        let moved = |k: usize| (sums.momentum[k] - filtered.momentum[k]) / TIME;
        let (known, weight) = (filtered.held[0] - moved(0), filtered.held[1] + moved(1));
        if weight > LEAST_LEVER * LEAST_LEVER {
            self.mass = (known / weight).clamp(0.0, self.heaviest);
        }
    }

    /// The sums of a sample; none where no cylinder has readings, or one that is no number.
    fn sums(&self, sample: &EncoderSample, positions: &[f64; AXES], speeds: &[f64; AXES]) -> Option<Sums> {
        let pose = self.empty.pose(positions);
        let empty = self.empty.dynamics(&pose, speeds, Vector::default());
        let probed = self.probed.dynamics(&pose, speeds, Vector::default());
        let mut sums = Sums::default();
        for (i, cylinder) in self.cylinders.iter().enumerate() {
            let cylinder = cylinder.filter(|cylinder| cylinder.is_free(positions[i], AT_END));
            let Some((cylinder, pressures)) = cylinder.zip(sample.axes[i].pressures()) else { continue };
            let force = cylinder.force(pressures);
            let lever = (probed.load[i] - empty.load[i]) / PROBE;
            sums.held[0] += lever * (force - empty.load[i]);
            sums.held[1] += lever * lever;
            for (j, speed) in speeds.iter().enumerate() {
                let more = (probed.mass[i][j] - empty.mass[i][j]) / PROBE;
                sums.momentum[0] += lever * empty.mass[i][j] * speed;
                sums.momentum[1] += lever * more * speed;
            }
        }
        let [force, momentum] = [sums.held[0], sums.momentum[0]];
        (sums.held[1] > 0.0 && force.is_finite() && momentum.is_finite()).then_some(sums)
    }
}

/// A machine with this mass in its bucket, kg.
pub fn carrying(mut mechanism: Mechanism, mass: f64) -> PreparedMechanism {
    mechanism.masses.payload.mass = mass;
    mechanism.prepared()
}

#[cfg(test)]
mod tests {
    use mechanism::postures;
    use pipeline::message::AxisSample;

    use super::*;

    /// The built-in excavator with transducers at boom and arm.
    fn excavator(mass: f64, heaviest: f64) -> Machine {
        let number = |value: f64| value.to_string();
        let resolution = |axis: &str| (format!("axis.{axis}.pressure.resolution"), "1e3".to_owned());
        let settings = [
            ("mechanism.payload.mass".to_owned(), number(mass)),
            ("mechanism.payload.heaviest".to_owned(), number(heaviest)),
            resolution("boom"),
            resolution("arm"),
        ];
        Machine::load(None, &settings).unwrap()
    }

    /// A sample of cylinders that push with these forces, N; NaN is one without a reading.
    fn sample(machine: &Machine, forces: [f64; AXES]) -> EncoderSample {
        let mut sample = EncoderSample::default();
        for ((entry, axis), force) in sample.axes.iter_mut().zip(&machine.axes).zip(forces) {
            let plant = axis.plant.as_ref().unwrap();
            let back = 1e6;
            let piston = (force + back * plant.rod_area) / plant.piston_area;
            *entry = AxisSample {
                piston_pressure: piston,
                rod_pressure: back,
                has_pressures: u32::from(force.is_finite()),
                ..AxisSample::default()
            };
        }
        sample
    }

    /// What the cylinders push with while the machine carries `mass` kg and moves so, N.
    fn forces(machine: &Machine, mass: f64, motion: (&[f64; AXES], &[f64; AXES], &[f64; AXES])) -> [f64; AXES] {
        let truth = carrying(machine.mechanism.unwrap(), mass);
        let (positions, speeds, accelerations) = motion;
        let dynamics = truth.dynamics(&truth.pose(positions), speeds, Vector::default());
        let moved = |i: usize| (0..AXES).map(|j| dynamics.mass[i][j] * accelerations[j]).sum::<f64>();
        std::array::from_fn(|i| dynamics.load[i] + moved(i))
    }

    const STILL: [f64; AXES] = [0.0; AXES];
    const OUT: [f64; AXES] = [0.5, 0.3, 0.8, 0.6];

    #[test]
    fn the_forces_of_a_machine_at_rest_tell_its_payload_in_every_posture() {
        let machine = excavator(0.0, 3000.0);
        let mut told = 0;
        for positions in postures([0.1; AXES], [1.2, 1.3, 1.1, 1.0], 3) {
            for mass in [0.0, 250.0, 1500.0, 2900.0] {
                let mut payload = Payload::of(&machine).unwrap();
                let sample = sample(&machine, forces(&machine, mass, (&positions, &STILL, &STILL)));
                // Five time constants.
                (0..500).for_each(|_| payload.update(&sample, &positions, &STILL));
                let is_known = payload.filtered.unwrap().held[1] > LEAST_LEVER * LEAST_LEVER;
                let expected = if is_known { mass } else { 0.0 };
                assert!((payload.mass() - expected).abs() <= 0.008 * mass + 0.01, "{positions:?} {mass} {payload:?}");
                told += u32::from(is_known);
            }
        }
        assert!(told > 4 * 81 / 2, "{told}");
    }

    #[test]
    fn bodies_that_accelerate_are_no_payload() {
        let machine = excavator(1200.0, 3000.0);
        let mut payload = Payload::of(&machine).unwrap();
        let (mut worst, mut pushed) = (0.0_f64, 0.0_f64);
        for tick in 0..1500 {
            // Boom and arm swing by 50 mm at 0.5 Hz: +-0.16 m/s.
            let (w, t) = (std::f64::consts::PI, f64::from(tick) * 0.01);
            let of = |scale: f64| [scale, -scale, 0.0, 0.0];
            let (speeds, accelerations) = (of(0.05 * w * (w * t).cos()), of(-0.05 * w * w * (w * t).sin()));
            let way = of(0.05 * (w * t).sin());
            let positions = std::array::from_fn(|i| OUT[i] + way[i]);
            let moving = forces(&machine, 1200.0, (&positions, &speeds, &accelerations));
            payload.update(&sample(&machine, moving), &positions, &speeds);
            worst = worst.max((payload.mass() - 1200.0).abs());
            let [held, more] = [1200.0, 1201.0].map(|mass| forces(&machine, mass, (&positions, &speeds, &STILL))[0]);
            pushed = pushed.max(((moving[0] - held) / (more - held)).abs());
        }
        // What the boom pushes the bodies with weighs as much as a ton.
        assert!(pushed > 900.0 && worst < 0.15 * pushed, "{pushed} {worst}");
    }

    #[test]
    fn without_readings_at_end_stops_and_beyond_the_limits_nothing_wrong_is_told() {
        let machine = excavator(700.0, 1000.0);
        let mut payload = Payload::of(&machine).unwrap();
        assert_eq!(payload.mass(), 700.0);
        let mut feed = |forces: [f64; AXES], positions: &[f64; AXES]| {
            (0..800).for_each(|_| payload.update(&sample(&machine, forces), positions, &STILL));
            payload.mass()
        };
        let with = |mass: f64| forces(&machine, mass, (&OUT, &STILL, &STILL));
        assert_eq!(feed([f64::NAN; AXES], &OUT), 700.0, "no readings");
        assert!((feed(with(300.0), &OUT) - 300.0).abs() < 1.0);
        // Boom and arm lean on their end stops.
        let stopped = [0.0, machine.axes[1].stroke, OUT[2], OUT[3]];
        assert!((feed(with(900.0), &stopped) - 300.0).abs() < 1.0);
        assert_eq!(feed(with(5000.0), &OUT), 1000.0);
        assert_eq!(feed(with(-900.0), &OUT), 0.0);
        assert!((feed(with(300.0), &OUT) - 300.0).abs() < 1.0);
        // One reading that is no number does not spoil the others.
        let mut one = sample(&machine, with(300.0));
        one.axes[0].piston_pressure = f64::NAN;
        payload.update(&one, &OUT, &STILL);
        payload.update(&sample(&machine, with(300.0)), &[f64::NAN; AXES], &STILL);
        assert!((payload.mass() - 300.0).abs() < 1.0, "{payload:?}");
    }

    #[test]
    fn a_machine_without_the_key_has_no_estimate() {
        assert_eq!(Payload::of(&Machine::load(None, &[]).unwrap()), None);
        assert_eq!(Payload::of(&Machine::four_axes(&[]).unwrap()), None);
    }
}
