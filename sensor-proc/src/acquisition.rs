//! Acquisition: encoder counts are converted to positions, positions and chamber pressures are checked; the result is
//! the sample of a tick.
//!
//! A position that is computed from the sensors of other axes is unusable while one of their positions is: it gets the
//! fault `ENCODER`.

use pipeline::{
    machine::Machine,
    message::{AxisSample, EncoderReading, EncoderSample, EncoderValue},
};

use crate::{
    conversion::Conversion,
    plausibility::{Plausibility, Value, pressure::PressureCheck},
};

/// How long before its tick a reading was made, ticks. Its sensors were read at some time after the begin of the
/// reading (`acquired_ns`) and before it was sent (`sent_ns`): a program may lose its core in between.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Age {
    /// If they were read at once.
    pub most: f64,
    /// If they were read at last.
    pub least: f64,
}

/// Conversion and checks of all axes.
#[derive(Debug, Clone)]
pub struct Acquisition {
    checks: Vec<Plausibility>,
    pressures: Vec<PressureCheck>,
    conversion: Conversion,
    /// Tick of the last sample.
    last: Option<u64>,
    /// Of the last reading.
    age: Age,
    /// Emergency stop in the last reading that counts; 0 while released.
    emergency_stop: u32,
}

impl Acquisition {
    /// Acquisition of all axes of a machine.
    pub fn new(machine: &Machine) -> Self {
        Self {
            checks: machine.axes.iter().map(|axis| Plausibility::new(axis, machine.timing.period)).collect(),
            pressures: machine.axes.iter().map(|axis| PressureCheck::new(axis.pressure.as_ref())).collect(),
            conversion: Conversion::new(machine),
            last: None,
            age: Age::default(),
            emergency_stop: 0,
        }
    }

    /// The sample of tick `sequence` from the reading of this tick, or without one.
    ///
    /// A reading with a wrong number of axes counts as no reading, but a pressed emergency stop in it counts. Without a
    /// reading the emergency stop keeps its last value. The times of the header stay zero; the process fills them in.
    pub fn update(&mut self, sequence: u64, reading: Option<&EncoderReading>) -> EncoderSample {
        self.update_aged(sequence, reading, Age::default())
    }

    /// As [`Self::update`], with a reading of this age. An axis that was read late has had more time for its way to the
    /// next reading than the ticks between the two.
    pub fn update_aged(&mut self, sequence: u64, reading: Option<&EncoderReading>, age: Age) -> EncoderSample {
        let ticks = self.last.replace(sequence).map_or(1, |last| sequence.saturating_sub(last));
        let caught_up = if reading.is_some() { std::mem::replace(&mut self.age, age).most - age.least } else { 0.0 };
        let whole = caught_up.max(0.0).trunc();
        let (elapsed, more) = (ticks.saturating_add(whole as u64), caught_up.max(0.0) - whole);
        let pressed = reading.map_or(0, |reading| reading.emergency_stop);
        let reading = reading.filter(|reading| reading.header.axis_count as usize == self.checks.len());
        if reading.is_some() || pressed != 0 {
            self.emergency_stop = pressed;
        }
        let mut sample = EncoderSample { emergency_stop: self.emergency_stop, ..EncoderSample::default() };
        sample.header.sequence = sequence;
        sample.header.axis_count = self.checks.len() as u32;
        let positions = reading.map(|reading| self.conversion.positions(&reading.encoders));
        for (i, check) in self.checks.iter_mut().enumerate() {
            let encoder = reading.map(|reading| &reading.encoders[i]);
            let needs = self.conversion.needs(i);
            let others = || (0..i).filter(|other| needs & (1 << other) != 0).map(|other| &sample.axes[other]);
            let is_read =
                |encoder: &EncoderValue| encoder.error != EncoderValue::NOT_READ && !others().any(AxisSample::is_stale);
            let value = encoder
                .zip(positions)
                .filter(|(encoder, _)| is_read(encoder))
                .map(|(encoder, positions)| Value { position: positions[i], raw: encoder.counts as f64 });
            let has_error = encoder.is_some_and(|encoder| !matches!(encoder.error, 0 | EncoderValue::NOT_READ));
            let is_wrong = has_error || others().any(|other| other.usable().is_none() && !other.is_stale());
            sample.axes[i] = check.judge_value(elapsed, more, value, is_wrong);
            self.pressures[i].judge(encoder, &mut sample.axes[i]);
        }
        sample
    }
}

/// Whether the position of any axis of the sample is unusable. A mark that the position has not changed does not count.
pub fn is_implausible(sample: &EncoderSample) -> bool {
    sample.axes.iter().any(|axis| axis.usable().is_none())
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::message::sample_fault;

    #[test]
    fn counts_become_metres() {
        let machine = Machine::four_axes(&[]).unwrap();
        let mut acquisition = Acquisition::new(&machine);
        let mut reading = EncoderReading::default();
        reading.header.axis_count = 4;
        reading.encoders[0] = EncoderValue { counts: 6500, ..EncoderValue::default() };
        reading.encoders[3] = EncoderValue { counts: 5500, error: 7, ..EncoderValue::default() };
        let sample = acquisition.update(9, Some(&reading));
        assert_eq!((sample.header.sequence, sample.header.axis_count), (9, 4));
        assert!((sample.axes[0].position - 0.65).abs() < 1e-12);
        assert_eq!(sample.axes[3].faults, sample_fault::ENCODER);
        assert!(is_implausible(&sample));

        let none = acquisition.update(10, None);
        assert!(none.axes[..4].iter().all(|axis| axis.faults & sample_fault::STALE != 0));
        reading.header.axis_count = 3;
        let foreign = acquisition.update(11, Some(&reading));
        assert!(foreign.axes[..4].iter().all(|axis| axis.faults & sample_fault::STALE != 0));
    }

    #[test]
    fn an_emergency_stop_is_passed_on_until_a_reading_shows_it_released() {
        let machine = Machine::four_axes(&[]).unwrap();
        let mut acquisition = Acquisition::new(&machine);
        let mut reading = EncoderReading { emergency_stop: 1, ..EncoderReading::default() };
        assert_eq!(acquisition.update(0, None).emergency_stop, 0);
        // A pressed stop counts in any reading, a released one only in a reading with the right number of axes.
        assert_eq!(acquisition.update(1, Some(&reading)).emergency_stop, 1);
        assert_eq!(acquisition.update(2, None).emergency_stop, 1);
        reading.emergency_stop = 0;
        assert_eq!(acquisition.update(3, Some(&reading)).emergency_stop, 1);
        reading.header.axis_count = 4;
        assert_eq!(acquisition.update(4, Some(&reading)).emergency_stop, 0);
    }

    #[test]
    fn an_axis_that_was_read_late_has_had_the_time_until_the_next_reading() {
        let machine = Machine::four_axes(&[]).unwrap();
        let now = Age::default();
        let faults = |age: f64, way: i64| {
            let mut acquisition = Acquisition::new(&machine);
            let mut sample = |tick, counts, age: Age| {
                let mut reading = EncoderReading::default();
                reading.header.axis_count = 4;
                reading.encoders[..4].fill(EncoderValue { counts, ..EncoderValue::default() });
                acquisition.update_aged(tick, Some(&reading), age).axes[0].faults
            };
            // 0.6 m/s of at most 1 m/s; then acquisition stands still for 30 ticks of 10 ms.
            (0..5).for_each(|tick| assert_eq!(sample(tick, 6000 + 60 * tick as i64, now), 0));
            assert_eq!(sample(34, 6300, Age { most: age, least: age }), 0, "the reading that waited");
            let next = sample(35, 6300 + way, now);
            // From then on a tick is a tick.
            assert_eq!(sample(36, 6300 + way + 60, now), next);
            assert_ne!(sample(37, 6300 + way + 260, now), 0);
            next
        };
        assert_eq!(faults(29.0, 30 * 60), 0);
        assert_ne!(faults(0.0, 30 * 60), 0, "a jump of 0.18 m in a tick");
        assert_ne!(faults(29.0, 32 * 100), 0, "more than the axis moves in that time");
    }

    #[test]
    fn missed_ticks_count_as_time() {
        let machine = Machine::four_axes(&[]).unwrap();
        let mut acquisition = Acquisition::new(&machine);
        let mut sample = |tick, counts| {
            let mut reading = EncoderReading::default();
            reading.header.axis_count = 4;
            reading.encoders[..4].fill(EncoderValue { counts, ..EncoderValue::default() });
            acquisition.update(tick, Some(&reading)).axes[0]
        };
        sample(0, 6000);
        // 10.4 mm are too fast for one tick of 1 m/s but not for two. 20 mm in two ticks would be too fast for an axis
        // that was at rest before.
        let later = sample(2, 6104);
        assert_eq!(later.faults, 0);
        assert!((later.velocity - 0.52).abs() < 1e-9, "{}", later.velocity);
    }

    /// Regression: an axis near its largest speed latched when its program had lost the core for less than a period.
    #[test]
    fn a_reading_that_took_long_leaves_its_axis_the_time_in_which_it_was_made() {
        let machine = Machine::four_axes(&[]).unwrap();
        // Ages in ms of two readings, the ticks of 10 ms between them, and the time in which the axis moved.
        let faults = |first: (f64, f64), second: (f64, f64), ticks: u64, moved: f64| {
            let mut acquisition = Acquisition::new(&machine);
            let mut sample = |tick, counts, (most, least): (f64, f64)| {
                let mut reading = EncoderReading::default();
                reading.header.axis_count = 4;
                reading.encoders[..4].fill(EncoderValue { counts, ..EncoderValue::default() });
                let age = Age { most: 0.1 * most, least: 0.1 * least };
                acquisition.update_aged(tick, Some(&reading), age).axes[0].faults
            };
            // 0.95 m/s of at most 1 m/s, in counts of 0.1 mm.
            (0..5).for_each(|tick| assert_eq!(sample(tick, 3000 + 95 * tick as i64, first), 0));
            sample(4 + ticks, 3380 + (9.5 * moved) as i64, second)
        };
        // Begun 9 ms before its tick and read at once; the next one is read right at its tick.
        assert_eq!(faults((9.0, 0.0), (0.0, 0.0), 1, 19.0), 0);
        assert_ne!(faults((0.0, 0.0), (0.0, 0.0), 1, 19.0), 0, "a jump");
        // The next one is begun early, and its program loses the core for 17 ms before it reads.
        assert_eq!(faults((1.0, 1.0), (18.0, 1.0), 2, 20.0), 0);
        assert_eq!(faults((5.0, 5.0), (18.0, 1.0), 2, 24.0), 0);
        assert_ne!(faults((5.0, 5.0), (18.0, 1.0), 2, 34.0), 0, "more than the axis moves in that time");
    }
}
