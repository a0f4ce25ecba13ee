//! `hydraxis check --explain`: the effective value of every key, where it comes from, and what is allowed.

use comfy_table::CellAlignment;
use pipeline::machine::{EffectiveValue, Machine};

use super::CheckArguments;
use crate::{
    failure::Failure,
    report::{output::Output, table::table},
};

/// Longest text of a cell, characters. A longer one is cut.
const LONGEST_CELL: usize = 60;

/// Shows the effective values of a machine that has been checked.
pub fn run(arguments: &CheckArguments) -> Result<(), Failure> {
    let output = Output::open(arguments.json.as_deref())?;
    let bare = &arguments.machine.bare;
    let mut settings = bare.settings.clone();
    settings.extend(arguments.machine.scenario.iter().map(|name| ("scenario".to_owned(), name.clone())));
    let explained = Machine::explain(bare.machine.as_deref(), bare.model.as_deref(), &settings);
    let (_, values) = explained.map_err(Failure::usage)?;
    Ok(output.write(|| shown(&values), &values)?)
}

/// The values as a table for people.
fn shown(values: &[EffectiveValue]) -> String {
    let row = |value: &EffectiveValue| {
        let shown = match &value.value {
            Some(text) => format!("{} {}", cut(text), value.unit).trim_end().to_owned(),
            None => "none".to_owned(),
        };
        vec![value.key.clone(), shown, value.origin.to_string(), cut(&value.allowed)]
    };
    let mut table = table(&["key", "value", "from", "allowed"], values.iter().map(row).collect());
    table.column_iter_mut().for_each(|column| column.set_cell_alignment(CellAlignment::Left));
    format!("{}\n", table.trim_fmt())
}

/// A text that fits into a cell.
fn cut(text: &str) -> String {
    match text.char_indices().nth(LONGEST_CELL) {
        Some((end, _)) => format!("{}..", &text[..end]),
        None => text.to_owned(),
    }
}
