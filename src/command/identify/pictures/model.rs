//! The models themselves: the curve of the valve over the commands, the answer to a held command, the poles.
//!
//! ```text
//! travel(u) = y(h) - y(0) by (12) from rest, with the command u held and without drift  =  G N(u)
//! sigma     = |G / B(1)| s |R^-T c|,   c' theta = B(1) N(u)
//! ```
//!
//! h horizon in samples, G travel for N = 1, theta products of the over-parametrised form (14), R its triangle, s
//! standard deviation of its residual, c features of u at all lags. b and N share a factor, which the travel does not
//! depend on. Trap: sigma is that of the curve of the valve; A is taken as known.

use ident_proc::Identifier;
use pipeline::{hammerstein::Coefficients, machine::IdentifiedOutput};
use plotters::prelude::{Color, RGBColor};

use super::{
    Picture, Shown,
    style::{ADAPTIVE, GREY, HELD, area, line},
};
use crate::{
    model::response::{held_command, poles, travel_of_one},
    report::chart::{COLOURS, Chart, HALF, Mark, Series, tick},
};

/// Points of a curve, and bars of the histogram.
const POINTS: usize = 200;
const BARS: usize = 40;
/// Part of the height of the picture that the highest bar has.
const HIGHEST_BAR: f64 = 0.35;
/// Standard deviations of the band: 95 %.
const BAND: f64 = 2.0;
/// Length of the answer to a held command, in horizons, and its bounds in samples.
const ANSWER: usize = 4;
const ANSWER_SAMPLES: (usize, usize) = (20, 4000);
/// Width over height of the panel of [`HALF`].
const ASPECT: f64 = 590.0 / 380.0;
/// Farthest pole that is shown.
const FARTHEST: f64 = 2.0;
/// The command of an answer, as a part of the highest and of the lowest one.
const PART: f64 = 0.5;

/// All pictures of the models.
pub fn all(shown: &Shown<'_>) -> Vec<Picture> {
    let snapshot = shown.identifier.snapshot();
    let (held, adaptive) = (&snapshot.classical, &snapshot.adaptive);
    let curve_text = format!(
        "Travel within {} of a command that is held, from rest: the curve N(u) of the valve. The band is two standard \
         deviations of the held curve. The bars show how often each command occurred, as the root of its count. \
         Without bars the curves are extrapolated.",
        shown.ahead
    );
    let [low, high] = commands(shown);
    let answer_text = format!(
        "The commands {:.3} and {:.3} are held from 0 s on: half of the highest and half of the lowest one.",
        PART * high,
        PART * low
    );
    let poles_text = "A pole on the circle neither grows nor fades: 1 is an integrator, as between speed and position. \
                      Outside of it predictions grow without end.";
    vec![
        Picture { chart: curve(shown, held, adaptive), caption: curve_text },
        Picture { chart: answers(shown, held, adaptive), caption: answer_text },
        Picture { chart: circle(held, adaptive), caption: poles_text.to_owned() },
    ]
}

/// Lowest and highest command of the record.
fn commands(shown: &Shown<'_>) -> [f64; 2] {
    let inputs = shown.record.inputs.iter().copied().filter(|u| u.is_finite());
    let (low, high) = inputs.fold((0.0f64, 0.0f64), |(low, high), u| (low.min(u), high.max(u)));
    [low, high]
}

fn curve(shown: &Shown<'_>, held: &Coefficients, adaptive: &Coefficients) -> Chart {
    let [low, high] = commands(shown);
    let (low, high) = if high > low { (low, high) } else { (-1.0, 1.0) };
    let commands: Vec<f64> = (0..=POINTS).map(|i| low + (high - low) * i as f64 / POINTS as f64).collect();
    let gain = |model: &Coefficients| travel_of_one(model, shown.settings.horizon);
    let of = |model: &Coefficients| {
        let (gain, nonlinearity) = (gain(model), model.nonlinearity());
        commands.iter().map(|u| (*u, gain * nonlinearity.evaluate(*u))).collect::<Vec<_>>()
    };
    let scale = (gain(held) / held.b().iter().sum::<f64>()).abs();
    let deviation = |u: f64| BAND * scale * deviation(shown.identifier, shown.settings.output, shown.record.period, u);
    let (held, adaptive) = (of(held), of(adaptive));
    let mut band: Vec<(f64, f64)> = held.iter().map(|(u, x)| (*u, x + deviation(*u))).collect();
    band.extend(held.iter().rev().map(|(u, x)| (*u, x - deviation(*u))));
    let band: Vec<(f64, f64)> = if band.iter().all(|point| point.1.is_finite()) { band } else { Vec::new() };
    let lines = || held.iter().chain(&adaptive).map(|point| point.1).filter(|x| x.is_finite());
    let (bottom, top) = lines().fold((0.0f64, 0.0f64), |(low, high), x| (low.min(x), high.max(x)));
    let space = 0.1 * (top - bottom).max(1e-12);
    let frame = [(low, high), (bottom - space, top + space)];
    let series = vec![
        area("", histogram(&shown.record.inputs, (low, high), frame[1]), GREY.mix(0.35)),
        area("", band, HELD.mix(0.25)),
        line("", vec![(low, 0.0), (high, 0.0)], GREY, 1),
        line("held model", held, HELD, 4),
        line("adaptive, in the end", adaptive, ADAPTIVE, 4),
    ];
    Chart {
        title: format!("N(u), as the travel within {}", shown.ahead),
        size: HALF,
        labels: ["command u".to_owned(), shown.output.replace("output", "travel")],
        tick,
        y_tick: None,
        series,
        notes: Vec::new(),
        frame: Some(frame),
    }
}

/// The corners of the bars, at the lower edge of the picture.
fn histogram(inputs: &[f64], (low, high): (f64, f64), (bottom, top): (f64, f64)) -> Vec<(f64, f64)> {
    let mut counts = [0u32; BARS];
    for u in inputs.iter().filter(|u| u.is_finite()) {
        let bar = (BARS as f64 * (u - low) / (high - low)) as usize;
        counts[bar.min(BARS - 1)] += 1;
    }
    // The root shows rare commands as well.
    let size = |count: u32| f64::from(count).sqrt();
    let most = counts.iter().copied().max().map_or(1.0, size).max(1.0);
    let width = (high - low) / BARS as f64;
    let bars = counts.iter().enumerate().filter(|(_, count)| **count > 0).flat_map(|(i, count)| {
        let (left, height) = (low + i as f64 * width, HIGHEST_BAR * (top - bottom) * size(*count) / most);
        let right = left + 0.9 * width;
        let upper = bottom + height;
        [(left, bottom), (left, upper), (right, upper), (right, bottom), (right, f64::NAN)]
    });
    bars.collect()
}

/// Standard deviation of B(1) N(u) of the classical model over repeated records, before its products are separated, in
/// the unit of the position; NaN without one.
fn deviation(identifier: &Identifier, output: IdentifiedOutput, period: f64, u: f64) -> f64 {
    let Some(offline) = identifier.offline() else { return f64::NAN };
    let Some(structure) = offline.coefficients.structure() else { return f64::NAN };
    let (data, held) = (identifier.batch().data(), identifier.batch().held());
    let lags = structure.nb + 1;
    let mut features = vec![0.0; 2 * structure.order];
    structure.input.features(u, &mut features);
    let feature = |i: usize| i.checked_sub(structure.na).and_then(|i| features.get(i / lags)).copied();
    let mut z = vec![0.0; data.len()];
    // R' z = c, with a lower triangle R'.
    for j in (0..data.len()).filter(|j| !held[*j]) {
        let known: f64 = (0..j).map(|i| data.entry(i, j) * z[i]).sum();
        z[j] = (feature(j).unwrap_or_default() - known) / data.entry(j, j);
    }
    let length = z.iter().map(|z| z * z).sum::<f64>().sqrt();
    let unit = match output {
        IdentifiedOutput::Position => 1.0,
        IdentifiedOutput::Velocity => period,
    };
    unit * offline.residual_sigma * length
}

fn answers(shown: &Shown<'_>, held: &Coefficients, adaptive: &Coefficients) -> Chart {
    let steps = (ANSWER * shown.settings.horizon).clamp(ANSWER_SAMPLES.0, ANSWER_SAMPLES.1);
    let period = shown.record.period;
    let [low, high] = commands(shown);
    let of = |name: &str, model: &Coefficients, u: f64, colour: RGBColor| {
        let outputs = held_command(model, PART * u, steps);
        let points = outputs.iter().enumerate().filter(|(_, y)| y.abs() < 1e12);
        line(name, points.map(|(k, y)| (k as f64 * period, *y)).collect(), colour, 4)
    };
    let series = vec![
        line("", vec![(0.0, 0.0), (steps as f64 * period, 0.0)], GREY, 1),
        of("held model", held, high, HELD),
        of("adaptive, in the end", adaptive, high, ADAPTIVE),
        of("", held, low, HELD),
        of("", adaptive, low, ADAPTIVE),
    ];
    Chart {
        title: "Answer to a command that is held".to_owned(),
        size: HALF,
        labels: ["time, s".to_owned(), shown.output.clone()],
        tick,
        y_tick: None,
        series,
        notes: Vec::new(),
        frame: None,
    }
}

fn circle(held: &Coefficients, adaptive: &Coefficients) -> Chart {
    let round: Vec<(f64, f64)> =
        (0..=POINTS).map(|i| (std::f64::consts::TAU * i as f64 / POINTS as f64).sin_cos()).collect();
    let of = |name: &str, model: &Coefficients, mark, colour| {
        let points = poles(model).into_iter().filter(|(re, im)| re.abs() <= FARTHEST && im.abs() <= FARTHEST);
        Series { name: name.to_owned(), points: points.collect(), colour, mark }
    };
    let series = vec![
        line("", vec![(-ASPECT * FARTHEST, 0.0), (ASPECT * FARTHEST, 0.0)], GREY.mix(0.5), 1),
        line("", vec![(0.0, -FARTHEST), (0.0, FARTHEST)], GREY.mix(0.5), 1),
        line("unit circle", round, GREY, 2),
        of("held model", held, Mark::Dot(10), HELD.mix(0.8)),
        of("adaptive, in the end", adaptive, Mark::Cross(10), COLOURS[0].into()),
    ];
    let points = || series[3..].iter().flat_map(|series| &series.points);
    let farthest = points().map(|(re, im)| (re.abs() / ASPECT).max(im.abs())).fold(1.0, f64::max);
    let radius = 1.15 * farthest;
    let clipped: Vec<Series> = series
        .into_iter()
        .map(|series| {
            let inside = |(x, y): (f64, f64)| (x.clamp(-ASPECT * radius, ASPECT * radius), y.clamp(-radius, radius));
            Series { points: series.points.iter().copied().map(inside).collect(), ..series }
        })
        .collect();
    Chart {
        title: "Poles".to_owned(),
        size: HALF,
        labels: ["real part", "imaginary part"].map(String::from),
        tick,
        y_tick: None,
        series: clipped,
        notes: Vec::new(),
        frame: Some([(-ASPECT * radius, ASPECT * radius), (-radius, radius)]),
    }
}
