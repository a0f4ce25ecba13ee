//! An excavator with a mechanism, as a machine file.

/// The built-in machine with the pins and masses of a 20 t excavator.
pub fn excavator() -> String {
    let built_in = include_str!("../../examples/four-axes.toml");
    if built_in.contains("[mechanism.boom]") {
        return built_in.to_owned();
    }
    let is_load = |line: &&str| ["mass =", "load_force =", "load_stiffness ="].iter().any(|key| line.starts_with(key));
    let machine: Vec<&str> = built_in.lines().filter(|line| !is_load(line)).collect();
    format!("{}\n{}", machine.join("\n"), include_str!("../../examples/mechanism.toml"))
}

/// The file of the built-in machine, the excavator.
pub const EXCAVATOR: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/excavator.toml");

/// Settings that put sensors of this kind at the joints of boom, arm and bucket, with counts of `count` rad.
pub fn joint_sensors(kind: &str, count: f64) -> Vec<(String, String)> {
    let of_axis = |axis: &str| {
        let key = |key: &str| format!("axis.{axis}.encoder.{key}");
        [(key("kind"), kind.to_owned()), (key("angle_resolution"), count.to_string())]
    };
    ["boom", "arm", "bucket"].iter().flat_map(|axis| of_axis(axis)).collect()
}
