//! The trends of the last minutes, in bounded memory.

use std::{collections::VecDeque, fmt::Write as _};

use pipeline::message::MachineState;

/// Rows that are kept: ten minutes of heartbeats.
const MOST: usize = 6000;
/// Signals of an axis, with their decimals.
const SIGNALS: [(&str, usize); 4] = [("position", 5), ("reference", 5), ("error", 6), ("command", 4)];

/// Time, ms since 1970, and the signals of all axes.
type Row = (u64, Vec<f64>);

/// The trends of one group.
#[derive(Debug)]
pub struct History {
    names: Vec<String>,
    rows: VecDeque<Row>,
}

impl History {
    /// Without rows.
    pub fn new() -> Self {
        Self { names: Vec::new(), rows: VecDeque::new() }
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.names.clear();
        self.rows.clear();
    }

    /// Adds the state of `unix_ms`.
    pub fn push(&mut self, unix_ms: u64, state: &MachineState) {
        let axes = &state.axes[..(state.header.axis_count as usize).min(state.axes.len())];
        if !axes.iter().map(|axis| axis.name()).eq(self.names.iter().map(String::as_str)) {
            self.clear();
            self.names = axes.iter().map(|axis| axis.name().to_owned()).collect();
        }
        if self.rows.len() >= MOST {
            self.rows.pop_front();
        }
        let values = axes.iter().flat_map(|axis| {
            let command = &axis.command;
            [axis.sample.usable().unwrap_or(f64::NAN), command.reference, command.error, command.command]
        });
        self.rows.push_back((unix_ms, values.collect()));
    }

    /// All rows as JSON: `{"t": [..], "boom": {"position": [..], ..}, ..}`. A value that is not finite is null.
    pub fn json(&self) -> String {
        let times: Vec<String> = self.rows.iter().map(|(t, _)| t.to_string()).collect();
        let mut text = format!("{{\"t\":[{}]", times.join(","));
        for (i, name) in self.names.iter().enumerate() {
            let name = serde_json::Value::from(name.as_str());
            // Writing to a string cannot fail.
            let _ = write!(text, ",{name}:{{");
            for (j, (signal, decimals)) in SIGNALS.iter().enumerate() {
                let _ = write!(text, "{}\"{signal}\":[", if j > 0 { "," } else { "" });
                for (k, (_, values)) in self.rows.iter().enumerate() {
                    let comma = if k > 0 { "," } else { "" };
                    let _ = match values.get(i * SIGNALS.len() + j).filter(|value| value.is_finite()) {
                        Some(value) => write!(text, "{comma}{value:.decimals$}"),
                        None => write!(text, "{comma}null"),
                    };
                }
                text.push(']');
            }
            text.push('}');
        }
        text + "}"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(names: &[&str], position: f64) -> MachineState {
        let mut state = MachineState::default();
        state.header.axis_count = names.len() as u32;
        for (axis, name) in state.axes.iter_mut().zip(names) {
            axis.set_name(name);
            axis.sample.position = position;
        }
        state
    }

    #[test]
    fn the_history_is_bounded_and_begins_anew_with_other_axes() {
        let mut history = History::new();
        for t in 0..MOST as u64 + 10 {
            history.push(t, &state(&["boom", "a\"b"], t as f64));
        }
        let json: serde_json::Value = serde_json::from_str(&history.json()).unwrap();
        let times = json["t"].as_array().unwrap();
        assert_eq!((times.len(), &times[0]), (MOST, &10.into()));
        assert_eq!(json["a\"b"]["position"][0], 10.0);
        assert_eq!(json["boom"]["command"].as_array().unwrap().len(), MOST);
        history.push(1, &state(&["arm"], f64::NAN));
        let json: serde_json::Value = serde_json::from_str(&history.json()).unwrap();
        assert_eq!((json["t"].to_string(), json["arm"]["position"].to_string()), ("[1]".into(), "[null]".into()));
        assert!(json["boom"].is_null());
    }
}
