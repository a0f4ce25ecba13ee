//! Machine files: the text of the built-in machine with other values.

use std::path::Path;

use pipeline::machine::{FOUR_AXES, Machine};
use toml::{Table, Value};

/// Keys of `[axis.NAME.plant]` with their values, and `stroke`, which is a key of `[axis.NAME]`.
pub type Edits = Vec<(&'static str, Value)>;

/// A machine under the scenario `everything`. Each of its axes is the built-in bucket with one of the edits in `axes`.
/// `hydraulics` gives other values of the tables `[supply]` and `[oil]`, such as `supply.flow`.
pub fn machine(axes: &[Edits], hydraulics: &[(&str, f64)]) -> Machine {
    let mut file: Table = FOUR_AXES.parse().unwrap();
    file.insert("scenario".to_owned(), "everything".into());
    for (key, value) in hydraulics {
        let (table, key) = key.split_once('.').unwrap();
        file[table].as_table_mut().unwrap().insert(key.to_owned(), Value::Float(*value));
    }
    let bucket = file["axis"]["bucket"].clone();
    let axes = axes.iter().enumerate().map(|(index, edits)| {
        let mut axis = bucket.as_table().unwrap().clone();
        let plant = axis["plant"].as_table_mut().unwrap();
        plant.insert("bristle_damping".to_owned(), Value::Float(0.0));
        plant.remove("bristle_stiffness");
        for (key, value) in edits {
            plant.insert((*key).to_owned(), value.clone());
        }
        if let Some(stroke) = plant.remove("stroke") {
            axis.insert("soft_limits".to_owned(), Value::Array(vec![Value::Float(0.0), stroke.clone()]));
            axis.insert("stroke".to_owned(), stroke);
        }
        axis["reference"] = Table::from_iter([("kind".to_owned(), Value::from("hold"))]).into();
        (format!("axis-{index}"), Value::Table(axis))
    });
    file["axis"] = Value::Table(axes.collect());
    let text = toml::to_string(&file).unwrap();
    Machine::parse(&text, "edge.toml", Path::new("."), &[]).unwrap_or_else(|error| panic!("{error}\n{text}"))
}
