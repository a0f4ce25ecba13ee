//! Settings of the fuzzy forgetting factor: `[fuzzy]`.

use std::path::Path;

use super::{
    document::{Document, Section},
    error::MachineError,
};

/// Universes, memberships and rules of the fuzzy forgetting factor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fuzzy {
    /// Error that counts as 3 (PB), in the unit of the output. Without it, [`Self::UNIVERSE_IN_RESIDUALS`] times the
    /// standard deviation of the residuals of offline identification.
    pub error_universe: Option<f64>,
    /// Change of the error that counts as 3 (PB). Without it, half of the error universe, as in the paper.
    pub variation_universe: Option<f64>,
    /// Half-width of the curves near zero (NS, ZO, PS), in steps between neighbouring terms.
    pub curve_width: f64,
    /// Half-width of the triangles outside (NB, NM, PM, PB), in steps between neighbouring terms.
    pub triangle_width: f64,
    /// Table 1: one row per term of the change of error, one column per term of the error, NB to PB each.
    pub rules: [[Level; 7]; 7],
}

/// A linguistic term of the output: one forgetting factor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Level {
    /// 0.75
    VS,
    /// 0.80
    MS,
    /// 0.85
    S,
    /// 0.90
    B,
    /// 0.95
    MB,
    /// 1.00
    VB,
}

impl Level {
    /// All terms, the one with the smallest factor first.
    pub const ALL: [Self; 6] = [Self::VS, Self::MS, Self::S, Self::B, Self::MB, Self::VB];

    /// The forgetting factor that the term stands for.
    pub const fn factor(self) -> f64 {
        [0.75, 0.80, 0.85, 0.90, 0.95, 1.0][self as usize]
    }

    fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|level| format!("{level:?}") == name)
    }
}

impl Fuzzy {
    /// Error universe of [`Self::RESIDUALS`], in standard deviations of the offline residual. The paper's 4 mm are 40
    /// counts of an encoder with 0.1 mm. With this value an error of ordinary noise stays well inside ZO, whatever the
    /// unit of the output is.
    pub const UNIVERSE_IN_RESIDUALS: f64 = 40.0;

    /// Table 1 and the basic universes [-4, 4] and [-2, 2] as printed. The paper prints no unit. The universes are
    /// taken as millimetres, because e is an error of the displacement, and are given here in metres, the unit of the
    /// positions. The paper prints no widths either.
    pub const PAPER: Self = {
        use Level::{B, MB, MS, S, VB, VS};
        Self {
            error_universe: Some(4e-3),
            variation_universe: Some(2e-3),
            curve_width: 1.0,
            triangle_width: 1.0,
            rules: [
                [VS, VS, MS, S, B, MB, MB],
                [VS, MS, S, B, MB, VB, B],
                [MS, S, B, MB, MB, VB, S],
                [S, S, VB, VB, VB, S, MS],
                [S, B, MB, VB, B, S, MS],
                [S, MB, MB, MB, S, MS, VS],
                [MB, MB, VB, S, S, VS, VS],
            ],
        }
    };

    /// Table 1 on universes that follow the residual of offline identification: what `[fuzzy]` is without keys.
    pub const RESIDUALS: Self = Self { error_universe: None, variation_universe: None, ..Self::PAPER };

    /// Reads a file that has the keys of `[fuzzy]` at its top level.
    ///
    /// # Errors
    /// All problems of the file at once, or that it cannot be read.
    pub fn load(file: &Path) -> Result<Self, MachineError> {
        let text = super::read_file(file, "a TOML file with the keys of [fuzzy]")?;
        let document = Document::parse(&text, Vec::new());
        let fuzzy = Self::read(document.root());
        document.into_result(&file.display().to_string(), fuzzy)
    }

    pub(super) fn read(mut section: Section) -> Self {
        let paper = Self::PAPER;
        let allowed = "7 rows (change of error NB to PB) of 7 terms (error NB to PB) out of VS, MS, S, B, MB, VB";
        let rules = section
            .key("rules", "Rule table: one row per term of the change of error, one column per term of the error")
            .rule("Table 1 of the paper")
            .optional_text_table(allowed);
        let rules = rules.map(|rows| {
            let rules = parse_rules(&rows);
            if rules.is_none() {
                section.refuse("rules", "another shape or term", allowed);
            }
            rules.unwrap_or(paper.rules)
        });
        let fuzzy = Self {
            error_universe: section
                .key("error_universe", "Error that counts as PB (3) for estimator = \"rules\"")
                .rule("40 times the residual of offline identification")
                .optional_number(1e-12..=1e12, "units of the output"),
            variation_universe: section
                .key("variation_universe", "Change of the error that counts as PB (3) for estimator = \"rules\"")
                .rule("half of error_universe")
                .optional_number(1e-12..=1e12, "units of the output"),
            // A width below 0.5 leaves gaps in which no rule fires; a width of 3 covers half of the universe.
            curve_width: section
                .key("curve_width", "Half-width of the curved memberships near zero (NS, ZO, PS)")
                .number_or(paper.curve_width, 0.6..=3.0, "steps"),
            triangle_width: section
                .key("triangle_width", "Half-width of the triangular memberships outside (NB, NM, PM, PB)")
                .number_or(paper.triangle_width, 0.6..=3.0, "steps"),
            rules: rules.unwrap_or(paper.rules),
        };
        section.finish();
        fuzzy
    }
}

fn parse_rules(rows: &[Vec<String>]) -> Option<[[Level; 7]; 7]> {
    let mut rules = [[Level::VB; 7]; 7];
    if rows.len() != 7 || rows.iter().any(|row| row.len() != 7) {
        return None;
    }
    for (rule, name) in rules.iter_mut().flatten().zip(rows.iter().flatten()) {
        *rule = Level::from_name(name)?;
    }
    Some(rules)
}
