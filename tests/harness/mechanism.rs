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
