//! A generated record: what an axis that was never seen before has sent to a logger.

use std::ops::RangeInclusive;

use pipeline::{
    hammerstein::{MAX_DELAY, Structure},
    machine::{Estimator, Form, Fuzzy, GREY_BOX_MEMORY, Identification, IdentifiedOutput, Split},
};

use super::{class::Class, course::Course, plant::Plant};
use crate::command::bench::drawn::Draw;

/// Periods, s.
const PERIOD: RangeInclusive<f64> = 1e-3..=0.1;
/// Periods of the class `fast`, s.
const FAST: RangeInclusive<f64> = 1e-3..=5e-3;
/// Periods of the class `slow`, s.
const SLOW: RangeInclusive<f64> = 0.1..=1.0;
/// Period, s, from which on the plant may be slower, so that there is something to see.
const PLANT_PERIOD: f64 = 0.02;
/// Horizon of the errors, s. Where it has few samples it may be up to [`LONG_HORIZON`] samples.
const HORIZON: f64 = 0.5;
/// Samples.
const LONG_HORIZON: f64 = 10.0;
/// Part of the record for training.
const TRAINING: f64 = 0.4;
/// Samples of a record: this many, and as many more as its time needs.
const LEAST_SAMPLES: f64 = 3000.0;
/// Length of a record in s. At 2 ms and less, half of it: such a record has 30 000 samples all the same.
const LENGTH: f64 = 80.0;
/// Shortest period of the table of rates, s: the dead time of its plants is no longer than this period allows.
pub const SHORTEST_PERIOD: f64 = 1e-3;
/// Noise of an encoder, in counts.
const NOISE: f64 = 0.3;
/// Streams of random numbers of a record: of its plant, of its course and of its logger.
const STREAMS: u64 = 3;

/// One record.
#[derive(Debug, Clone)]
pub struct Record {
    /// Its number in the set.
    pub number: u64,
    /// Its class.
    pub class: Class,
    /// s.
    pub period: f64,
    /// Samples of the prediction horizon.
    pub horizon: usize,
    /// Delay of the model, samples: that of the plant at the start.
    pub delay: usize,
    /// Commands u(k).
    pub inputs: Vec<f64>,
    /// Outputs y(k) in the unit of the record.
    pub outputs: Vec<f64>,
    /// Outputs without their wild samples, where the record has some.
    pub without_wild: Option<Vec<f64>>,
}

impl Record {
    /// Record number `number` of the set with this seed. Its class follows from its number.
    pub fn draw(seed: u64, number: u64) -> Self {
        let class = Class::of(number);
        let mut draw = Draw::new(seed, STREAMS * number);
        let period = match class {
            Class::Fast => draw.log(FAST),
            Class::Slow => draw.log(SLOW),
            _ => draw.log(PERIOD),
        };
        let period = 1e-3 * (1e3 * period).round();
        let slowness = draw.log(1.0..=(period / PLANT_PERIOD).max(1.0));
        let horizon = draw.even(HORIZON..=(LONG_HORIZON * period).max(HORIZON));
        let plant = Plant::draw(&mut draw, class, slowness, (MAX_DELAY as f64 - 4.0) * period);
        Self::log(seed, number, &plant, period, horizon)
    }

    /// The record of plant number `number` of the table of rates, at this period in s.
    pub fn at_period(seed: u64, number: u64, period: f64) -> Self {
        let class = match number / 2 % 4 {
            0 => Class::Constant,
            1 => Class::Payload,
            2 => Class::WarmUp,
            _ => Class::Delay,
        };
        let mut draw = Draw::new(seed, STREAMS * number);
        let plant = Plant::draw(&mut draw, class, 1.0, (MAX_DELAY as f64 - 4.0) * SHORTEST_PERIOD);
        Self::log(seed, number, &plant, period, HORIZON)
    }

    fn log(seed: u64, number: u64, plant: &Plant, period: f64, horizon: f64) -> Self {
        let length = plant.slowness * if period < 2.5e-3 { 0.5 * LENGTH } else { LENGTH };
        let samples = (length / period).max(LEAST_SAMPLES) as usize;
        let course_draw = Draw::new(seed, STREAMS * number + 1);
        let mut course = Course::new(course_draw, plant, period, samples as f64 * period);
        let (inputs, positions) = plant.run(|time, position| course.command(time, position), period, samples);
        let mut logger = Logger { draw: Draw::new(seed, STREAMS * number + 2), class: plant.class };
        let (inputs, outputs, without_wild) = logger.log(plant.stroke, inputs, positions);
        Self {
            number,
            class: plant.class,
            period,
            horizon: ((horizon / period).round() as usize).max(1),
            delay: 1 + (plant.dead_time / period).floor() as usize,
            inputs,
            outputs,
            without_wild,
        }
    }

    /// How the record is identified with this estimator, in this form.
    pub fn settings(&self, estimator: Estimator, form: Form) -> Identification {
        Identification {
            structure: Structure { nk: self.delay, ..Structure::PAPER },
            output: IdentifiedOutput::Position,
            period: self.period,
            training: (TRAINING * self.inputs.len() as f64) as usize,
            horizon: self.horizon,
            form,
            split: Split::Als,
            estimator,
            fuzzy: Fuzzy::RESIDUALS,
            hysteresis: 0.0,
            memory: GREY_BOX_MEMORY,
            start: None,
        }
    }
}

/// Turns positions into what a logger has written.
struct Logger {
    draw: Draw,
    class: Class,
}

impl Logger {
    /// Commands and outputs in the units of the record; for the classes with wild samples also outputs without them.
    fn log(
        &mut self,
        stroke: f64,
        mut inputs: Vec<f64>,
        positions: Vec<f64>,
    ) -> (Vec<f64>, Vec<f64>, Option<Vec<f64>>) {
        let counts = if self.class == Class::Quantised { self.draw.log(150.0..=1e3) } else { self.draw.log(3e3..=1e5) };
        let count = stroke / counts;
        let mut outputs: Vec<f64> =
            positions.iter().map(|p| count * (p / count + NOISE * self.normal()).round()).collect();
        if self.class == Class::Offsets {
            self.offset(stroke, &mut outputs);
        }
        let mut without_wild = None;
        if matches!(self.class, Class::Dropouts | Class::Spikes) {
            without_wild = Some(outputs.clone());
            self.make_wild(stroke, &mut outputs);
        }
        let (of_input, of_output) = self.units(stroke, count);
        inputs.iter_mut().for_each(|u| *u *= of_input);
        outputs.iter_mut().chain(without_wild.iter_mut().flatten()).for_each(|y| *y *= of_output);
        (inputs, outputs, without_wild)
    }

    /// Factors on command and output.
    fn units(&mut self, stroke: f64, count: f64) -> (f64, f64) {
        if self.class != Class::Units {
            return (1.0, 1.0);
        }
        let of_input = [1.0, 10.0, 100.0][(3.0 * self.draw.unit()) as usize];
        let of_output = [1e3, 90.0 / stroke, 10.0 / stroke, 1.0 / count][(4.0 * self.draw.unit()) as usize];
        (of_input, of_output)
    }

    /// Sets the encoder to another zero some times.
    fn offset(&mut self, stroke: f64, outputs: &mut [f64]) {
        for _ in 0..3 {
            let from = (self.draw.even(0.1..=0.95) * outputs.len() as f64) as usize;
            let sign = if self.draw.unit() < 0.5 { -1.0 } else { 1.0 };
            let by = sign * stroke * self.draw.log(0.02..=0.3);
            outputs[from..].iter_mut().for_each(|y| *y += by);
        }
    }

    /// Dropouts of 1 to 12 samples, the first of them long, or spikes of one sample, the first of them early.
    fn make_wild(&mut self, stroke: f64, outputs: &mut [f64]) {
        let last = outputs.len() - 20;
        let wild = 3 + (12.0 * self.draw.unit()) as usize;
        let reading = [0.0, 2.0 * stroke][usize::from(self.draw.unit() < 0.5)];
        for i in 0..wild {
            let first = if i == 0 { self.draw.even(0.02..=0.5) } else { self.draw.even(0.02..=1.0) };
            let at = (first * last as f64) as usize;
            if self.class == Class::Dropouts {
                let length = if i == 0 { 12 } else { self.draw.log(1.0..=12.0) as usize };
                outputs[at..at + length].fill(reading);
            } else {
                let sign = if self.draw.unit() < 0.5 { -1.0 } else { 1.0 };
                outputs[at] += sign * stroke * self.draw.log(0.05..=2.0);
            }
        }
    }

    /// Of a normal distribution with variance 1 (Box and Muller).
    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.draw.unit()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.draw.unit()).cos()
    }
}
