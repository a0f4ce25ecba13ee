//! All numbers of a channel, a row for each message.

use crate::{
    failure::Failure,
    recording::{
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
        let arrays = ["axes[", "encoders["];
        let Some(rest) = arrays.iter().find_map(|array| column.strip_prefix(array)) else {
            return Some(column.to_owned());
        };
        let (index, field) = rest.split_once(']')?;
        let axis = axes.get(index.parse::<usize>().ok()?)?;
        (self.asked.is_empty() || self.asked.contains(axis)).then(|| format!("{axis}{field}"))
    }
}

impl Rows for ChannelTable {
    fn message(&mut self, message: &ReadMessage, axes: &[String], out: &mut Sheet) -> Result<(), Failure> {
        let begin = *self.begin_ns.get_or_insert(message.log_ns);
        if !message.channel.carries(&self.channel) {
            return Ok(());
        }
        if self.columns.is_empty() {
            let named = |column: &Column| Some((self.name(&column.name, axes)?, column.clone()));
            self.columns = message.channel.columns.iter().filter_map(named).collect();
        }
        out.headings(|| {
            let of = |(name, column): &(String, Column)| {
                Heading::new(name.clone(), unit(&self.channel, &column.name), column.kind())
            };
            let log_time = Heading::new("log_time", "ns", Kind::Unsigned(8));
            [log_time].into_iter().chain(self.columns.iter().map(of)).collect()
        })?;
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
