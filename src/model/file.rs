//! The model file: an identified model as TOML.
//!
//! Numbers are written so that they read back exactly. A file is refused with its line where a number is not finite,
//! where lists do not fit together, and where it is of another kind or version.

use std::{fmt::Write as _, path::Path};

use pipeline::{
    bounded,
    hammerstein::{Basis, Coefficients, InputMap, MAX_A, MAX_DELAY, MAX_LINEAR, MAX_ORDER, Structure},
    nearest::did_you_mean_file,
};
use serde::Deserialize;
use thiserror::Error;

use super::{IdentifiedModel, Origin};

/// What `kind` says in these files.
const KIND: &str = "identified";
/// The version of these files.
const VERSION: i64 = 1;
/// What may stand in the place of a file that is no such model.
const ALLOWED: &str = "a model that `hydraxis identify --model-out FILE.toml` has written";
/// Longest horizon, samples.
const MAX_HORIZON: usize = 1_000_000;

/// Why a model file is refused.
#[derive(Debug, Error)]
#[error("{file}{}: found {found}; allowed: {allowed}", .line.map_or_else(String::new, |line| format!(":{line}")))]
pub struct ModelFileError {
    file: String,
    line: Option<usize>,
    found: String,
    allowed: String,
}

/// Kind and version, which are read first: the rest of another kind or version is another one.
#[derive(Deserialize)]
struct Head {
    kind: Option<toml::Value>,
    version: Option<toml::Value>,
}

/// The whole file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    #[serde(rename = "kind")]
    _kind: String,
    #[serde(rename = "version")]
    _version: i64,
    model: WrittenModel,
    origin: WrittenOrigin,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenModel {
    period: f64,
    horizon: usize,
    unit: Option<String>,
    commands: [f64; 2],
    delay: usize,
    a: Vec<f64>,
    b: Vec<f64>,
    f: Vec<f64>,
    g: Vec<f64>,
    drift: Option<f64>,
    dead_band: [f64; 2],
    knots: Option<Vec<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenOrigin {
    recordings: String,
    estimator: String,
    verdict: String,
}

impl IdentifiedModel {
    /// The text of the file.
    pub fn text(&self) -> String {
        let Self { coefficients: model, period, horizon, unit, commands, origin } = self;
        let order = model.order as usize;
        let mut text = format!(
            "# Written by `hydraxis identify`; read by `hydraxis predict`.\n\
             # x(k) = f_1 v + .. + f_r v^r for v >= 0, g_1 v + .. + g_r v^r for v < 0; v: the command beyond the dead \
             band.\n\
             # y(k) = -a_1 y(k-1) - .. + b_0 x(k-delay) + b_1 x(k-delay-1) + .. + drift\n\
             kind = \"{KIND}\"\nversion = {VERSION}\n\n[model]\n\
             period = {period:?}    # s\nhorizon = {horizon}    # samples\n"
        );
        // Writing to a string cannot fail.
        if let Some(unit) = unit {
            let _ = writeln!(text, "unit = {}    # of the output", quoted(unit));
        }
        let _ = write!(
            text,
            "commands = {commands:?}    # lowest and highest of the identification\ndelay = {}    # samples\n\
             a = {:?}\nb = {:?}\nf = {:?}\ng = {:?}\n",
            model.nk,
            model.a(),
            model.b(),
            &model.f[..order],
            &model.g[..order]
        );
        if model.has_drift == 1 {
            let _ = writeln!(text, "drift = {:?}    # for each sample", model.drift);
        }
        let _ = writeln!(text, "dead_band = {:?}    # magnitudes below and above zero", model.dead_band);
        if let Basis::Hinges(knots) = model.nonlinearity().input.basis {
            let _ =
                writeln!(text, "knots = {:?}    # sign(v) max(0, |v| - knot) in the place of powers", &knots[..order]);
        }
        let Origin { recordings, estimator, verdict } = origin;
        let [recordings, estimator, verdict] = [recordings, estimator, verdict].map(|text| quoted(text));
        let _ = write!(text, "\n[origin]\nrecordings = {recordings}\nestimator = {estimator}\nverdict = {verdict}\n");
        text
    }

    /// Reads a file.
    ///
    /// # Errors
    /// The file cannot be read, or is no model of this kind and version.
    pub fn read(path: &Path) -> Result<Self, ModelFileError> {
        let file = path.display().to_string();
        let text = bounded::read_text(path, bounded::SETTINGS).map_err(|error| ModelFileError {
            file: file.clone(),
            line: None,
            found: format!("a file that cannot be read ({error})"),
            allowed: format!("{ALLOWED}{}", did_you_mean_file(path)),
        })?;
        Self::parse(&text, &file)
    }

    /// The model of a text; `file` is its name in errors.
    ///
    /// # Errors
    /// The text is no model of this kind and version.
    pub fn parse(text: &str, file: &str) -> Result<Self, ModelFileError> {
        let refuse =
            |line, found: String, allowed: String| ModelFileError { file: file.to_owned(), line, found, allowed };
        let malformed = |error: toml::de::Error| {
            let line = error.span().map(|span| text[..span.start.min(text.len())].matches('\n').count() + 1);
            refuse(line, error.message().to_owned(), ALLOWED.to_owned())
        };
        let head: Head = toml::from_str(text).map_err(malformed)?;
        match head.kind {
            Some(toml::Value::String(kind)) if kind == KIND => {}
            Some(kind) => return Err(refuse(line_of(text, "kind"), format!("kind = {kind}"), ALLOWED.to_owned())),
            None => {
                let found = "a file without kind = \"identified\"".to_owned();
                return Err(refuse(None, found, format!("{ALLOWED}; `hydraxis commission` writes others")));
            }
        }
        if head.version != Some(toml::Value::Integer(VERSION)) {
            let found = head.version.map_or("no version".to_owned(), |version| format!("version = {version}"));
            return Err(refuse(line_of(text, "version"), found, format!("version = {VERSION}")));
        }
        let written: Written = toml::from_str(text).map_err(malformed)?;
        written.model.check().map_err(|(key, found, allowed)| refuse(line_of(text, key), found, allowed))?;
        written
            .model
            .model(written.origin)
            .ok_or_else(|| refuse(None, "numbers that are no model".to_owned(), format!("{ALLOWED}, without changes")))
    }
}

impl WrittenModel {
    /// The first key that is wrong, what was found, and what is allowed.
    fn check(&self) -> Result<(), (&'static str, String, String)> {
        let Self { period, horizon, delay, commands, a, b, f, g, drift, dead_band, knots, .. } = self;
        let knots = knots.as_deref().unwrap_or_default();
        let drift = drift.as_slice();
        let lists: [(&str, &[f64]); 9] = [
            ("period", std::slice::from_ref(period)),
            ("commands", commands),
            ("a", a),
            ("b", b),
            ("f", f),
            ("g", g),
            ("drift", drift),
            ("dead_band", dead_band),
            ("knots", knots),
        ];
        for (key, list) in lists {
            if let Some(value) = list.iter().find(|value| !value.is_finite()) {
                return Err((key, format!("{key} with {value}"), "finite numbers".to_owned()));
            }
        }
        let lengths = [("a", a.len(), MAX_A), ("b", b.len(), MAX_LINEAR), ("f", f.len(), MAX_ORDER)];
        for (key, found, most) in lengths {
            if !(1..=most).contains(&found) {
                return Err((key, format!("{key} with {found} numbers"), format!("1 to {most} numbers")));
            }
        }
        for (key, list) in [("g", g.as_slice()), ("knots", knots)] {
            if list.len() != f.len() && (key == "g" || !list.is_empty()) {
                return Err((key, format!("{key} with {} numbers", list.len()), format!("{}, as f has", f.len())));
            }
        }
        let within = |key, fits: bool, found: String, allowed: &str| {
            if fits { Ok(()) } else { Err((key, format!("{key} = {found}"), allowed.to_owned())) }
        };
        let delays = format!("1 to {MAX_DELAY} samples");
        let horizons = format!("1 to {MAX_HORIZON} samples");
        within("period", *period > 0.0, format!("{period}"), "more than 0 s")?;
        within("delay", (1..=MAX_DELAY).contains(delay), format!("{delay}"), &delays)?;
        within("horizon", (1..=MAX_HORIZON).contains(horizon), format!("{horizon}"), &horizons)?;
        within("commands", commands[0] <= commands[1], format!("{commands:?}"), "the lowest, then the highest")?;
        let in_band = dead_band.iter().all(|magnitude| (0.0..1.0).contains(magnitude));
        within("dead_band", in_band, format!("{dead_band:?}"), "two magnitudes of at least 0 and less than 1")?;
        let rising = knots.is_empty() || Basis::hinges(knots).is_some();
        within("knots", rising, format!("{knots:?}"), "numbers that rise from at least 0")
    }

    /// The model; `None` where the numbers are outside the limits of a model.
    fn model(self, origin: WrittenOrigin) -> Option<IdentifiedModel> {
        let basis = match &self.knots {
            Some(knots) => Basis::hinges(knots)?,
            None => Basis::Powers,
        };
        let structure = Structure {
            na: self.a.len(),
            nb: self.b.len().checked_sub(1)?,
            nk: self.delay,
            order: self.f.len(),
            integrator: false,
            drift: self.drift.is_some(),
            input: InputMap { dead_band: (self.dead_band[0], self.dead_band[1]), basis },
        };
        let mut coefficients = Coefficients::zero(structure);
        coefficients.a[..self.a.len()].copy_from_slice(&self.a);
        coefficients.b[..self.b.len()].copy_from_slice(&self.b);
        coefficients.f[..self.f.len()].copy_from_slice(&self.f);
        coefficients.g[..self.g.len()].copy_from_slice(&self.g);
        coefficients.drift = self.drift.unwrap_or_default();
        (coefficients.structure() == Some(structure)).then_some(IdentifiedModel {
            coefficients,
            period: self.period,
            horizon: self.horizon,
            unit: self.unit,
            commands: self.commands,
            origin: Origin { recordings: origin.recordings, estimator: origin.estimator, verdict: origin.verdict },
        })
    }
}

/// The line on which a key stands.
fn line_of(text: &str, key: &str) -> Option<usize> {
    let is_key = |line: &str| line.split_once('=').is_some_and(|(before, _)| before.trim() == key);
    text.lines().position(is_key).map(|place| place + 1)
}

/// A text in quotes.
fn quoted(text: &str) -> toml::Value {
    toml::Value::String(text.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model() -> IdentifiedModel {
        let input = InputMap { dead_band: (0.05, 0.1), basis: Basis::hinges(&[0.0, 0.3]).unwrap() };
        let structure = Structure { na: 2, nb: 1, nk: 4, order: 2, integrator: false, drift: true, input };
        let mut coefficients = Coefficients::zero(structure);
        coefficients.a[..2].copy_from_slice(&[-1.7, 0.1 + 0.2]);
        coefficients.b[..2].copy_from_slice(&[1e-300, -5e22]);
        coefficients.f[..2].copy_from_slice(&[1.0, 0.25]);
        coefficients.g[..2].copy_from_slice(&[0.5, -1.0 / 3.0]);
        coefficients.drift = 1e-7;
        let origin = Origin {
            recordings: "a \"b\"\n\\c.csv".to_owned(),
            estimator: "auto".to_owned(),
            verdict: "usable".to_owned(),
        };
        let unit = Some("m".to_owned());
        IdentifiedModel { coefficients, period: 0.01, horizon: 50, unit, commands: [-0.8, 0.9], origin }
    }

    #[test]
    fn a_model_reads_back_exactly() {
        let written = model();
        assert_eq!(IdentifiedModel::parse(&written.text(), "m.toml").unwrap(), written);
        let plain = IdentifiedModel { coefficients: Coefficients::TABLE_2, unit: None, ..written };
        assert_eq!(IdentifiedModel::parse(&plain.text(), "m.toml").unwrap(), plain);
    }

    #[test]
    fn a_damaged_file_is_refused_or_a_model() {
        let text = model().text();
        let places: Vec<usize> = text.char_indices().map(|(place, _)| place).collect();
        for place in places {
            let damaged = ["", "-", "9", "]"].map(|sign| format!("{}{sign}{}", &text[..place], &text[place + 1..]));
            for damaged in damaged.iter().map(String::as_str).chain([&text[..place]]) {
                if let Ok(read) = IdentifiedModel::parse(damaged, "m.toml") {
                    assert!(read.coefficients.is_finite() && read.coefficients.structure().is_some(), "{damaged}");
                    assert!(read.period > 0.0 && read.horizon > 0, "{damaged}");
                }
            }
        }
    }

    #[test]
    fn what_is_wrong_in_a_file_is_named_with_its_place() {
        let text = model().text();
        let changes = [
            ("period = 0.01", "period = nan", ":8: found period with NaN; allowed: finite numbers"),
            ("period = 0.01", "period = 0", ":8: found period = 0; allowed: more than 0 s"),
            ("period = 0.01", "period = \"1\"", ":8: found invalid type: string"),
            ("a = [-1.7,", "a = [inf,", ":13: found a with inf; allowed: finite numbers"),
            ("a = [", "a = [0, 0, 0, 0, 0, 0, ", ":13: found a with 8 numbers; allowed: 1 to 7 numbers"),
            ("g = [0.5, ", "g = [", ":16: found g with 1 numbers; allowed: 2, as f has"),
            ("knots = [0.0, 0.3]", "knots = [0.3, 0.3]", "found knots = [0.3, 0.3]; allowed: numbers that rise"),
            ("knots = [0.0, 0.3]", "knots = [0.3]", "found knots with 1 numbers; allowed: 2, as f has"),
            ("delay = 4", "delay = 0", "found delay = 0; allowed: 1 to 1024 samples"),
            ("delay = 4", "delay = -1", "found invalid value: integer `-1`"),
            ("horizon = 50", "horizon = 0", "found horizon = 0; allowed: 1 to 1000000 samples"),
            ("[0.05, 0.1]", "[0.05, 1.0]", "found dead_band = [0.05, 1.0]; allowed: two magnitudes"),
            ("[-0.8, 0.9]", "[0.9, -0.8]", "found commands = [0.9, -0.8]; allowed: the lowest, then the highest"),
            ("version = 1", "version = 2\nnew = 3", ":5: found version = 2; allowed: version = 1"),
            ("kind = \"identified\"", "kind = \"other\"", ":4: found kind = \"other\"; allowed: a model that"),
            ("kind = \"identified\"\n", "", "found a file without kind = \"identified\"; allowed: a model that"),
            ("f = [1.0, 0.25]\n", "", "found missing field `f`; allowed: a model that"),
            ("[model]", "[model]\nspeed = 1", "found unknown field `speed`"),
            ("[model]", "[model", "allowed: a model that"),
        ];
        for (from, to, expected) in changes {
            assert!(text.contains(from), "{from}");
            let error = IdentifiedModel::parse(&text.replacen(from, to, 1), "m.toml").expect_err(to).to_string();
            assert!(error.starts_with("m.toml") && error.contains(expected), "{to}: {error}");
        }
    }
}
