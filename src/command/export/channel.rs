//! All numbers of a channel, a row for each message.

use crate::{
    failure::Failure,
    recording::{
        controller_state,
        reading::ReadMessage,
        schema::{Column, Kind, Value},
    },
};

use super::{Rows, sheet::Sheet, table::Heading, units::unit};

/// The table of one channel.
pub(super) struct ChannelTable {
    channel: String,
    /// Axes that were asked for; none for all.
    asked: Vec<String>,
    /// Columns with their names in the table.
    columns: Vec<(String, Column)>,
    begin_ns: Option<u64>,
}

impl ChannelTable {
    pub(super) fn new(channel: String, asked: Vec<String>) -> Self {
        Self { channel, asked, columns: Vec::new(), begin_ns: None }
    }

    /// Name of a column in the table; none for an axis that the machine does not have, or that was not asked for.
    fn name(&self, column: &str, axes: &[String]) -> Option<String> {
        let is_asked = |axis: &String| self.asked.is_empty() || self.asked.contains(axis);
        let Some((axis, field)) = self.of_axis(column, axes) else { return Some(column.to_owned()) };
        axis.filter(|axis| is_asked(axis)).map(|axis| format!("{axis}{field}"))
    }

    /// Axis and field of a column that is of an axis; no axis of one that the machine does not have.
    fn of_axis<'a>(&self, column: &'a str, axes: &'a [String]) -> Option<(Option<&'a String>, &'a str)> {
        if self.channel == controller_state::CHANNEL {
            let of = |axis: &'a String| Some((axis, column.strip_prefix(axis)?));
            let (axis, field) = axes.iter().filter_map(of).find(|(_, field)| field.starts_with('.'))?;
            return Some((Some(axis), field));
        }
        let rest = ["axes[", "encoders["].iter().find_map(|array| column.strip_prefix(array))?;
        let (index, field) = rest.split_once(']')?;
        Some((index.parse().ok().and_then(|index: usize| axes.get(index)), field))
    }

    /// Refuses axes that were asked for of a channel that has none.
    fn expect_axes(&self, all: &[Column], axes: &[String]) -> Result<(), Failure> {
        if self.asked.is_empty() || all.iter().any(|column| self.of_axis(&column.name, axes).is_some()) {
            return Ok(());
        }
        let channel = &self.channel;
        Err(Failure::usage(format!(
            "--axis: found a channel without axes, {channel}; allowed: this channel without --axis"
        )))
    }
}

impl Rows for ChannelTable {
    fn message(&mut self, message: &ReadMessage, axes: &[String], out: &mut Sheet) -> Result<(), Failure> {
        let begin = *self.begin_ns.get_or_insert(message.log_ns);
        if !message.channel.carries(&self.channel) {
            return Ok(());
        }
        if self.columns.is_empty() {
            self.expect_axes(&message.channel.columns, axes)?;
            let named = |column: &Column| Some((self.name(&column.name, axes)?, column.clone()));
            self.columns = message.channel.columns.iter().filter_map(named).collect();
        }
        out.headings(|| {
            let of = |(name, column): &(String, Column)| {
                Heading::new(name.clone(), unit(&self.channel, &column.name), column.kind())
            };
            let log_time = Heading::new("log_time", "ns", Kind::Unsigned(8));
            [log_time].into_iter().chain(self.columns.iter().map(of)).collect()
        });
        let t = message.log_ns.saturating_sub(begin) as f64 * 1e-9;
        out.row(t, || {
            let values = self.columns.iter().map(|(_, column)| column.value(&message.bytes));
            [Some(Value::Unsigned(message.log_ns))].into_iter().chain(values).collect()
        })
    }

    fn finish(&mut self, _: &mut Sheet) -> Result<(), Failure> {
        Ok(())
    }
}
