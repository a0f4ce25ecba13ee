//! The report on generated records: ratios of h-step errors, over all records, by class and by period.

use serde::Serialize;

use super::{class::Class, trial::Trial};
use crate::report::table::{number, table};

/// Ratio by the best constant factor from which on `auto` counts as worse.
const WORSE: f64 = 1.05;
/// Number of the worst records that the tables list.
const LISTED: usize = 12;

/// All figures.
#[derive(Debug, Serialize)]
pub struct GeneratedReport {
    seed: u64,
    half: Option<&'static str>,
    all: Vec<Ratios>,
    classes: Vec<ClassRow>,
    rates: Vec<RateRow>,
    records: Vec<Trial>,
    records_of_rates: Vec<Trial>,
}

/// One quotient of two h-step errors over many records.
#[derive(Debug, Clone, Serialize)]
struct Ratios {
    name: &'static str,
    records: usize,
    geometric_mean: f64,
    /// 99 % of the records have a ratio of at most this.
    percent_99: f64,
    worst: f64,
    /// Number of the record with the worst ratio.
    worst_record: u64,
    above_1_05: usize,
}

/// One class.
#[derive(Debug, Serialize)]
struct ClassRow {
    class: Class,
    ratios: Vec<Ratios>,
}

/// One period of the table of rates.
#[derive(Debug, Serialize)]
struct RateRow {
    period_s: f64,
    ratios: Vec<Ratios>,
}

type Quotient = (&'static str, fn(&Trial) -> Option<f64>);

/// The quotients of the report.
const QUOTIENTS: [Quotient; 7] = [
    ("auto / best constant", |trial| Some(trial.auto / trial.best.as_ref()?.sigma)),
    ("auto / held", |trial| Some(trial.auto / trial.held)),
    ("auto / still", |trial| Some(trial.auto / trial.still)),
    ("auto / mixture", |trial| Some(trial.auto / trial.mixture)),
    ("auto / without wild", |trial| Some(trial.auto / trial.without_wild?)),
    ("2nd half: auto / best constant", |trial| known(trial.second_half?.auto / trial.second_half?.best)),
    ("2nd half: constant of 1st / best", |trial| known(trial.second_half?.known / trial.second_half?.best)),
];

/// A quotient of the second half, unless the first half hides it.
fn known(quotient: f64) -> Option<f64> {
    Some(quotient).filter(|quotient| !quotient.is_nan())
}

impl Ratios {
    /// None without a record that has this quotient. A quotient that is not a number counts as infinite.
    fn new((name, quotient): &Quotient, trials: &[&Trial]) -> Option<Self> {
        let ratio = |trial: &&Trial| {
            quotient(trial).map(|ratio| (if ratio.is_nan() { f64::INFINITY } else { ratio }, trial.number))
        };
        let mut ratios: Vec<(f64, u64)> = trials.iter().filter_map(ratio).collect();
        ratios.sort_by(|one, two| one.0.total_cmp(&two.0));
        let (worst, worst_record) = *ratios.last()?;
        let count = ratios.len();
        let mean = ratios.iter().map(|(ratio, _)| ratio.ln()).sum::<f64>() / count as f64;
        Some(Self {
            name,
            records: count,
            geometric_mean: mean.exp(),
            percent_99: ratios[(0.99 * count as f64).ceil() as usize - 1].0,
            worst,
            worst_record,
            above_1_05: ratios.iter().filter(|(ratio, _)| *ratio > WORSE).count(),
        })
    }

    fn all(trials: &[&Trial]) -> Vec<Self> {
        QUOTIENTS.iter().filter_map(|quotient| Self::new(quotient, trials)).collect()
    }

    fn of<'a>(name: &str, ratios: &'a [Self]) -> Option<&'a Self> {
        ratios.iter().find(|ratios| ratios.name == name)
    }
}

impl GeneratedReport {
    /// The report on these records, and on those of the table of rates.
    pub fn new(seed: u64, half: Option<&'static str>, records: Vec<Trial>, records_of_rates: Vec<Trial>) -> Self {
        let every: Vec<&Trial> = records.iter().collect();
        let class = |class: Class| {
            let trials: Vec<&Trial> = records.iter().filter(|trial| trial.class == class).collect();
            (!trials.is_empty()).then(|| ClassRow { class, ratios: Ratios::all(&trials) })
        };
        let mut periods: Vec<f64> = records_of_rates.iter().map(|trial| trial.period_s).collect();
        periods.sort_by(f64::total_cmp);
        periods.dedup();
        let rate = |period_s: f64| {
            let trials: Vec<&Trial> =
                records_of_rates.iter().filter(|trial| trial.period_s.total_cmp(&period_s).is_eq()).collect();
            RateRow { period_s, ratios: Ratios::all(&trials) }
        };
        Self {
            seed,
            half,
            all: Ratios::all(&every),
            classes: Class::ALL.into_iter().filter_map(class).collect(),
            rates: periods.into_iter().map(rate).collect(),
            records,
            records_of_rates,
        }
    }

    /// The tables.
    pub fn tables(&self) -> String {
        let row = |ratios: &Ratios| {
            vec![
                ratios.name.to_owned(),
                ratios.records.to_string(),
                figure(ratios.geometric_mean),
                figure(ratios.percent_99),
                figure(ratios.worst),
                ratios.worst_record.to_string(),
                ratios.above_1_05.to_string(),
            ]
        };
        let header = ["ratio of h-step errors", "records", "mean", "99 %", "worst", "of record", "above 1.05"];
        let mut text = format!("{}\n", table(&header, self.all.iter().map(row).collect()));
        let classes = self.classes.iter().map(|row| named(row.class.name().to_owned(), &row.ratios));
        text += &by("class", classes.collect());
        if !self.rates.is_empty() {
            let rates = self.rates.iter().map(|row| named(format!("{:.0} ms", 1e3 * row.period_s), &row.ratios));
            text += &by("same plants at", rates.collect());
        }
        text + &self.worst()
    }

    fn worst(&self) -> String {
        let by_best = |trial: &Trial| QUOTIENTS[0].1(trial).filter(|ratio| ratio.is_nan() || *ratio > WORSE);
        let mut worst: Vec<(f64, &Trial)> =
            self.records.iter().filter_map(|trial| Some((by_best(trial)?, trial))).collect();
        if worst.is_empty() {
            return String::new();
        }
        worst.sort_by(|one, two| two.0.total_cmp(&one.0));
        let row = |(ratio, trial): &(f64, &Trial)| {
            let best = trial.best.as_ref().map(|best| format!("{}, {:?}", best.factor, best.form).to_lowercase());
            vec![
                trial.number.to_string(),
                trial.class.name().to_owned(),
                format!("{:.0} ms", 1e3 * trial.period_s),
                trial.horizon.to_string(),
                figure(*ratio),
                figure(trial.auto / trial.mixture),
                figure(trial.auto / trial.held),
                figure(trial.auto / trial.still),
                best.unwrap_or_default(),
                number(trial.auto),
            ]
        };
        let header =
            ["record", "class", "period", "horizon", "/ best", "/ mixture", "/ held", "/ still", "best", "auto"];
        format!("\n{}\n", table(&header, worst.iter().take(LISTED).map(row).collect()))
    }
}

fn figure(ratio: f64) -> String {
    if ratio < 1e4 { format!("{ratio:.3}") } else { number(ratio) }
}

/// A row of the tables by class and by period: mean and worst of each quotient.
fn named(name: String, ratios: &[Ratios]) -> Vec<String> {
    let mut row = vec![name];
    for (quotient, _) in &QUOTIENTS[..4] {
        let found = Ratios::of(quotient, ratios);
        row.extend(
            [found.map(|r| r.geometric_mean), found.map(|r| r.worst)].map(|v| v.map_or_else(String::new, figure)),
        );
    }
    row
}

fn by(name: &str, rows: Vec<Vec<String>>) -> String {
    let header = [name, "/ best", "worst", "/ held", "worst", "/ still", "worst", "/ mixture", "worst"];
    format!("\n{}\n", table(&header, rows))
}
