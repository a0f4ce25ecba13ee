//! The residuals one step ahead: over time, their correlation, their spectrum.
//!
//! ```text
//! P(f) = mean over segments of 2 T |sum_n w(n) e(n) exp(-2 pi i f n T)|^2 / sum_n w(n)^2
//! ```
//!
//! e residual without its mean, w Hann's window, T period in s, f frequency in Hz. Segments overlap by half and lie
//! between gaps (Welch, IEEE Transactions on Audio and Electroacoustics 15, 1967). White residuals have the same power
//! at all frequencies.

use std::f64::consts::PI;

use ident_proc::validation::whiteness::Whiteness;

use super::{
    Picture, Shown,
    style::{ADAPTIVE, GREY, HELD, line},
};
use crate::report::chart::{Chart, HALF, Mark, Series, WIDE, tick};

/// Lags of the correlation, and samples of a segment of the spectrum.
const LAGS: usize = 25;
const SEGMENT: usize = 256;
/// Fewest samples of a segment, and most segments.
const SHORTEST: usize = 32;
const MOST_SEGMENTS: usize = 200;

/// The residuals of one model.
struct Of {
    name: &'static str,
    colour: plotters::prelude::RGBColor,
    residuals: Vec<f64>,
}

/// All pictures of the residuals.
pub fn all(shown: &Shown<'_>) -> Vec<Picture> {
    let residuals = |predicted: &[f64]| shown.course.residuals(&shown.record.outputs, predicted);
    let both = [
        Of { name: "held model", colour: HELD, residuals: residuals(&shown.course.held.one_step) },
        Of { name: "adaptive model", colour: ADAPTIVE, residuals: residuals(&shown.course.adaptive.one_step) },
    ];
    let caption = |text: &str| text.to_owned();
    let mut pictures = vec![Picture {
        chart: over_time(shown, &both),
        caption: caption("What was measured minus what was predicted from the sample before. Outliers are left out."),
    }];
    if let Some(chart) = correlation(&both) {
        let text = "1 of 100 lags of white residuals is outside of the lines. A model whose residuals stay inside has \
                    found all that they contain.";
        pictures.push(Picture { chart, caption: caption(text) });
    }
    if let Some(chart) = spectrum(shown, &both) {
        let text = "White residuals have the same power at all frequencies. A peak is a swing that the model does not \
                    have.";
        pictures.push(Picture { chart, caption: caption(text) });
    }
    pictures
}

fn over_time(shown: &Shown<'_>, both: &[Of; 2]) -> Chart {
    let rows = (shown.settings.training.min(shown.record.outputs.len() - 1), shown.record.outputs.len());
    let of = |Of { name, colour, residuals }: &Of| line(name, shown.axis.line(residuals, rows), *colour, 2);
    Chart {
        title: "Residuals, one step ahead".to_owned(),
        size: WIDE,
        labels: ["time, s".to_owned(), shown.error.clone()],
        tick,
        y_tick: None,
        series: both.iter().map(of).collect(),
        notes: Vec::new(),
        frame: None,
    }
}

fn correlation(both: &[Of; 2]) -> Option<Chart> {
    let mut series = Vec::new();
    let mut bound = 0.0;
    for Of { name, colour, residuals } in both {
        let finite: Vec<f64> = residuals.iter().copied().filter(|residual| residual.is_finite()).collect();
        let Whiteness { correlations, bound_99, .. } = Whiteness::new(&finite, LAGS, 0)?;
        bound = bound_99;
        let points: Vec<(f64, f64)> = correlations.iter().enumerate().map(|(i, r)| ((i + 1) as f64, *r)).collect();
        series.push(line(name, points.clone(), *colour, 2));
        series.push(Series { mark: Mark::Dot(5), ..line("", points, *colour, 1) });
    }
    let level = |name: &str, y: f64, width| line(name, vec![(0.0, y), (LAGS as f64, y)], GREY, width);
    series.extend([level("99 % bound", bound, 2), level("", -bound, 2), level("", 0.0, 1)]);
    Some(Chart {
        title: "Autocorrelation of the residuals".to_owned(),
        size: HALF,
        labels: ["lag, samples", "correlation"].map(String::from),
        tick,
        y_tick: None,
        series,
        notes: Vec::new(),
        frame: None,
    })
}

fn spectrum(shown: &Shown<'_>, both: &[Of; 2]) -> Option<Chart> {
    let period = shown.record.period;
    let mut powers = Vec::new();
    for Of { residuals, .. } in both {
        powers.push(power(residuals, &shown.record.begins, period)?);
    }
    // In dB of the mean power of the held model's residuals.
    let reference = powers[0].iter().map(|(_, power)| power).sum::<f64>() / powers[0].len() as f64;
    let decibels = |points: &[(f64, f64)]| {
        points.iter().map(|(frequency, power)| (*frequency, 10.0 * (power / reference).log10())).collect()
    };
    let of = |(Of { name, colour, .. }, points): (&Of, &Vec<(f64, f64)>)| line(name, decibels(points), *colour, 3);
    Some(Chart {
        title: "Spectrum of the residuals".to_owned(),
        size: HALF,
        labels: ["frequency, Hz", "power, dB of the held model's mean"].map(String::from),
        tick,
        y_tick: None,
        series: both.iter().zip(&powers).map(of).collect(),
        notes: Vec::new(),
        frame: None,
    })
}

/// Frequency and power; `None` where no stretch is long enough, or all residuals are zero.
fn power(residuals: &[f64], begins: &[bool], period: f64) -> Option<Vec<(f64, f64)>> {
    let mut runs: Vec<Vec<f64>> = vec![Vec::new()];
    for (residual, begins) in residuals.iter().zip(begins) {
        if *begins || !residual.is_finite() {
            runs.push(Vec::new());
        }
        if let Some(run) = runs.last_mut().filter(|_| residual.is_finite()) {
            run.push(*residual);
        }
    }
    let longest = runs.iter().map(Vec::len).max()?;
    let length = SEGMENT.min(longest);
    if length < SHORTEST {
        return None;
    }
    let segments: Vec<&[f64]> = runs.iter().flat_map(|run| run.windows(length).step_by(length / 2)).collect();
    let every = segments.len().div_ceil(MOST_SEGMENTS);
    let turn: Vec<(f64, f64)> = (0..length).map(|n| (2.0 * PI * n as f64 / length as f64).sin_cos()).collect();
    let window: Vec<f64> = turn.iter().map(|(_, cos)| 0.5 * (1.0 - cos)).collect();
    let weight: f64 = window.iter().map(|w| w * w).sum();
    let mut powers = vec![0.0; length / 2];
    let used: Vec<&[f64]> = segments.into_iter().step_by(every).collect();
    for segment in &used {
        let mean = segment.iter().sum::<f64>() / length as f64;
        let weighted: Vec<f64> = segment.iter().zip(&window).map(|(e, w)| (e - mean) * w).collect();
        for (m, power) in powers.iter_mut().enumerate() {
            let sum = weighted.iter().enumerate().fold((0.0, 0.0), |(re, im), (n, e)| {
                let (sin, cos) = turn[(m + 1) * n % length];
                (re + e * cos, im + e * sin)
            });
            *power += 2.0 * period * (sum.0 * sum.0 + sum.1 * sum.1) / (weight * used.len() as f64);
        }
    }
    let frequency = |m: usize| (m + 1) as f64 / (length as f64 * period);
    powers
        .iter()
        .all(|power| *power > 0.0)
        .then(|| powers.iter().enumerate().map(|(m, power)| (frequency(m), *power)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spectrum_has_the_power_of_the_signal_at_its_frequency() {
        // A sine of amplitude 3 at 5 Hz, sampled at 100 Hz: power 4.5.
        let sine: Vec<f64> = (0..4000).map(|k| 3.0 * (2.0 * PI * 5.0 * f64::from(k) * 0.01).sin()).collect();
        let begins: Vec<bool> = (0..4000).map(|k| k == 0 || k == 1111).collect();
        let points = power(&sine, &begins, 0.01).unwrap();
        let highest = points.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
        assert!((highest.0 - 5.0).abs() < 0.3, "{highest:?}");
        let all: f64 = points.iter().map(|(_, power)| power).sum::<f64>() * points[0].0;
        assert!((all / 4.5 - 1.0).abs() < 0.02, "{all}");
        assert!(power(&sine[..20], &begins[..20], 0.01).is_none());
        assert!(power(&[0.0; 100], &[false; 100], 0.01).is_none());
    }
}
