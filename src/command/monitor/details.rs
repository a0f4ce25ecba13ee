//! What only somebody who looks closer needs: the models, and the way of a tick through the stages.
//!
//! ```text
//! travel(u) = G N(u)          over the horizon, from rest, m
//! hop       = time from the acquisition of a sample to the sending of a message that it has caused
//! ```
//!
//! These figures are on channels that stages read. So they are listened to only while a browser shows them.

use std::time::{Duration, Instant};

use pipeline::{
    channel::{ChannelError, Reader},
    hammerstein::Coefficients,
    message::{
        AxisSnapshot, CoefficientSnapshot, EncoderSample, MEMBERS, ModelErrors, ValveCommand, bit_names, model_fault,
    },
    statistics::ErrorStatistics,
};
use serde::Serialize;

use crate::{group::live::Live, model::response::travel_of_one, report::figures::CoefficientLists};

/// Nobody has asked for so long: nobody looks.
const LOOKED: Duration = Duration::from_secs(3);
/// Time between two frames.
const APART: Duration = Duration::from_millis(400);
/// Points of a curve.
const POINTS: usize = 80;
/// Classes of the histogram for each power of ten, and the powers: from 1 us to 1 s.
const CLASSES: usize = 8;
const POWERS: usize = 6;

/// The readers of the details, while somebody looks.
pub struct Details {
    samples: Reader<EncoderSample>,
    snapshots: Reader<CoefficientSnapshot>,
    commands: Reader<ValveCommand>,
    /// Counts of end-to-end latencies by class; the first and the last one take everything beyond.
    histogram: [u64; CLASSES * POWERS],
    framed: Option<Instant>,
}

/// What a browser gets.
#[derive(Debug, Serialize)]
struct Frame {
    axes: Vec<AxisFrame>,
    hops: Option<Hops>,
    /// Lower bounds of the classes, ns, and how many latencies were in each since somebody began to look.
    histogram: Vec<(f64, u64)>,
}

/// A tick that has gone all the way, ns since the acquisition of its sample.
#[derive(Debug, Serialize)]
struct Hops {
    tick: u64,
    sample: u64,
    snapshot: Option<u64>,
    command: u64,
}

#[derive(Debug, Serialize)]
struct AxisFrame {
    name: String,
    horizon: u32,
    updates: u64,
    forgetting_factor: f64,
    faults: Vec<&'static str>,
    /// Held, adaptive.
    models: [ModelFrame; 2],
    persistence_sigma: f64,
    /// Name and weight of each estimator that runs beside others; empty with a single one.
    weights: Vec<(&'static str, f64)>,
}

#[derive(Debug, Serialize)]
struct ModelFrame {
    coefficients: CoefficientLists,
    dead_band: [f64; 2],
    /// u, travel.
    curve: Vec<(f64, f64)>,
    one_step: Errors,
    h_step: Errors,
}

/// Running statistics; a browser forms those of a span from two of them.
#[derive(Debug, Serialize)]
struct Errors {
    count: u64,
    rmse: f64,
    sigma: f64,
}

impl From<&ErrorStatistics> for Errors {
    fn from(errors: &ErrorStatistics) -> Self {
        let (rmse, sigma) = (errors.rmse(), errors.sigma());
        Self { count: errors.count, rmse, sigma }
    }
}

/// Whether somebody who asked at this time still looks.
pub fn is_looked_at(asked: Option<Instant>) -> bool {
    asked.is_some_and(|asked| asked.elapsed() < LOOKED)
}

impl Details {
    /// Begins to listen.
    ///
    /// # Errors
    /// A channel cannot be opened.
    pub fn open(live: &Live) -> Result<Self, ChannelError> {
        let (samples, snapshots, commands) = (live.reader()?, live.reader()?, live.reader()?);
        Ok(Self { samples, snapshots, commands, histogram: [0; CLASSES * POWERS], framed: None })
    }

    /// Reads what has come. A frame, when the next one is due.
    ///
    /// # Errors
    /// A channel cannot be read.
    pub fn step(&mut self, names: &[&str]) -> Result<Option<impl Serialize + use<>>, ChannelError> {
        while self.samples.read()?.if_new().is_some() {}
        while self.snapshots.read()?.if_new().is_some() {}
        while let Some(command) = self.commands.read()?.if_new() {
            let latency = command.header.sent_ns.saturating_sub(command.header.acquired_ns);
            self.histogram[class(latency)] += 1;
        }
        if self.framed.is_some_and(|framed| framed.elapsed() < APART) {
            return Ok(None);
        }
        self.framed = Some(Instant::now());
        let snapshot = self.snapshots.last();
        let axes = snapshot.map(|snapshot| {
            names.iter().zip(&snapshot.axes).filter_map(|(name, axis)| axis_frame(name, axis)).collect()
        });
        let histogram = self.histogram.iter().enumerate().map(|(class, count)| (lower(class), *count)).collect();
        Ok(Some(Frame { axes: axes.unwrap_or_default(), hops: self.hops(), histogram }))
    }

    /// The hops of the newest tick whose command has been read.
    fn hops(&self) -> Option<Hops> {
        let command = self.commands.last()?.header;
        let sample = self.samples.last()?.header;
        let since = |ns: u64| ns.saturating_sub(command.acquired_ns);
        let snapshot = self.snapshots.last().map(|snapshot| snapshot.header);
        let is_same = |sequence: u64| sequence == command.sequence;
        Some(Hops {
            tick: command.sequence,
            sample: is_same(sample.sequence).then(|| since(sample.sent_ns))?,
            snapshot: snapshot.filter(|header| is_same(header.sequence)).map(|header| since(header.sent_ns)),
            command: since(command.sent_ns),
        })
    }
}

/// The class of a latency in ns.
fn class(latency: u64) -> usize {
    let class = CLASSES as f64 * (latency.max(1) as f64 / 1e3).log10();
    (class.max(0.0) as usize).min(CLASSES * POWERS - 1)
}

/// Lower bound of a class, ns.
fn lower(class: usize) -> f64 {
    1e3 * 10f64.powf(class as f64 / CLASSES as f64)
}

/// The models of an axis; none before its training has ended.
fn axis_frame(name: &str, axis: &AxisSnapshot) -> Option<AxisFrame> {
    axis.adaptive.structure()?;
    let span = if axis.command_high > axis.command_low { (axis.command_low, axis.command_high) } else { (-1.0, 1.0) };
    let model = |model: &Coefficients, errors: &ModelErrors| ModelFrame {
        coefficients: CoefficientLists::new(model),
        dead_band: model.dead_band,
        curve: curve(model, axis.horizon, span),
        one_step: (&errors.one_step).into(),
        h_step: (&errors.h_step).into(),
    };
    Some(AxisFrame {
        name: name.to_owned(),
        horizon: axis.horizon,
        updates: axis.updates,
        forgetting_factor: axis.forgetting_factor,
        faults: bit_names(axis.faults, &model_fault::NAMES).collect(),
        models: [model(&axis.classical, &axis.classical_errors), model(&axis.adaptive, &axis.adaptive_errors)],
        persistence_sigma: axis.persistence.sigma(),
        weights: weights(axis),
    })
}

fn weights(axis: &AxisSnapshot) -> Vec<(&'static str, f64)> {
    let all = || MEMBERS.into_iter().zip(axis.weights);
    if all().all(|(_, weight)| weight == 0.0) { Vec::new() } else { all().collect() }
}

/// The travel that a held command causes within the horizon, over the commands that the model has seen.
fn curve(model: &Coefficients, horizon: u32, (low, high): (f64, f64)) -> Vec<(f64, f64)> {
    let (gain, nonlinearity) = (travel_of_one(model, horizon as usize), model.nonlinearity());
    let at = |i: usize| low + (high - low) * i as f64 / POINTS as f64;
    (0..=POINTS).map(|i| (at(i), gain * nonlinearity.evaluate(at(i)))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_latency_is_in_the_class_that_holds_it() {
        assert_eq!((class(0), class(999), class(u64::MAX)), (0, 0, CLASSES * POWERS - 1));
        for latency in [1_001, 20_000, 333_333, 4_200_000, 999_999_999] {
            let class = class(latency);
            assert!(lower(class) <= latency as f64 && lower(class + 1) > latency as f64, "{latency}: {class}");
        }
    }
}
