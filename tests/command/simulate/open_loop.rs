//! The plant under given commands: those of a file, and those of the scenario `open-loop`.

use std::{
    io::{BufRead, BufReader, Read},
    process::Stdio,
    time::Duration,
};

use pipeline::{machine::Machine, message::ValveCommand};
use plant_sim::PlantSim;

use super::{
    cli, folder_with,
    harness::{self, FOUR_AXES},
    trajectory,
};

/// Times after the first row, ns, and commands of boom and bucket. The first row is at 3 s.
const ROWS: [(u64, f64, f64); 7] = [
    (0, 0.25, 0.0),
    (13_700_000, 0.5, -0.7),
    (13_710_000, -1.0, 0.3),
    (500_000_000, 0.123456789, 1.0),
    (500_123_000, -0.3, 0.1),
    (1_900_000_000, 0.0, 0.2),
    (2_200_000_001, 0.1, 0.0),
];

#[test]
fn an_open_loop_is_the_plant_called_directly_bit_for_bit() {
    let time = |ns: u64| format!("{}.{:09}", 3 + ns / 1_000_000_000, ns % 1_000_000_000);
    let lines = ROWS.map(|(ns, boom, bucket)| format!("{boom},{},{bucket}\n", time(ns)));
    let folder = folder_with("u.csv", &format!("boom,t,bucket\n{}", lines.concat()));
    let found = trajectory(folder.path(), &[FOUR_AXES, "--open-loop", "u.csv", "--scenario", "everything"]);

    let machine = Machine::four_axes(&[("scenario".to_owned(), "everything".to_owned())]).unwrap();
    let mut plant = PlantSim::new(&machine, 1).unwrap();
    let mut command = ValveCommand::default();
    for (row, (ns, boom, bucket)) in ROWS.into_iter().enumerate() {
        let mut rest = Duration::from_nanos(ns - if row > 0 { ROWS[row - 1].0 } else { 0 });
        // The command is repeated before the drive's time-out.
        while rest > Duration::ZERO {
            let part = rest.min(Duration::from_millis(40));
            plant.command(&command);
            plant.advance(part);
            rest -= part;
        }
        (command.axes[0].command, command.axes[3].command) = (boom, bucket);
        let mut expected = vec![time(ns).parse().unwrap(), plant.supply_pressure()];
        for (axis, command) in plant.axes().iter().zip(&command.axes) {
            expected.extend([command.command, axis.position, axis.velocity, axis.piston_pressure]);
            expected.extend([axis.rod_pressure, axis.spool_position, axis.piston_flow, axis.rod_flow]);
        }
        let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&found.rows[row]), bits(&expected), "row {row}");
    }
    assert_eq!(found.rows.len(), ROWS.len());
}

#[test]
fn a_row_is_held_longer_than_the_drive_waits() {
    let folder = folder_with("u.csv", "t,boom\n0,0.3\n1,0.3\n2,0.3\n");
    let arguments = [FOUR_AXES, "--open-loop", "u.csv", "--scenario", "nominal"];
    let position = trajectory(folder.path(), &arguments).column("boom.position");
    assert!(position[2] - position[1] > 0.1, "{position:?}");
    assert!((position[2] - position[1]) > 0.95 * (position[1] - position[0]), "{position:?}");
}

#[test]
fn axes_without_a_column_stay_neutral_and_are_named() {
    let folder = folder_with("u.csv", "t,arm\n0,0.4\n1,0.4\n");
    let output = cli::run(folder.path(), &["simulate", "--open-loop", "u.csv"]);
    assert_eq!(String::from_utf8(output.stderr).unwrap(), "without a column, neutral: boom, telescope, bucket\n");
    let found = super::Trajectory::read(&String::from_utf8(output.stdout).unwrap());
    assert_eq!(found.column("boom.command"), [0.0, 0.0]);
    assert_eq!(found.column("boom.spool_position"), [0.0, 0.0]);
    assert_eq!(found.column("arm.command"), [0.4, 0.4]);
}

#[test]
fn one_row_is_the_machine_at_rest() {
    let folder = folder_with("u.csv", "t,boom\n-7.5,0.3\n");
    let found = trajectory(folder.path(), &["--open-loop", "u.csv"]);
    assert_eq!(found.rows.len(), 1);
    assert_eq!((found.column("t")[0], found.column("boom.position")[0]), (-7.5, 0.65));
}

#[test]
fn a_files_commands_take_the_place_of_the_scenarios() {
    let folder = folder_with("u.csv", "t,boom,arm,telescope,bucket\n0,0.3,0,0,0\n0.5,0.3,0,0,0\n");
    let run = |scenario| trajectory(folder.path(), &["--open-loop", "u.csv", "--scenario", scenario]);
    assert_eq!(run("open-loop"), run("nominal"));
    assert_ne!(run("cold-start"), run("nominal"), "its changes act all the same");
}

#[test]
fn the_scenarios_commands_last_as_long_as_asked() {
    let folder = tempfile::tempdir().unwrap();
    let short = trajectory(folder.path(), &["--scenario", "open-loop", "--duration", "3s"]);
    let long = trajectory(folder.path(), &["--scenario", "open-loop"]);
    assert_eq!((short.rows.len(), long.rows.len()), (300, 2000));
    assert_eq!(short.rows[..], long.rows[..300]);
    assert_eq!(long.column("boom.command"), long.column("bucket.command"));
}

/// The dead band of the boom of the four axes.
const DEAD_BAND: std::ops::RangeInclusive<f64> = -0.08..=0.10;

#[test]
fn the_boom_stands_in_its_dead_band_and_sinks_under_a_symmetric_command() {
    let folder = tempfile::tempdir().unwrap();
    let found =
        trajectory(folder.path(), &[FOUR_AXES, "--scenario", "open-loop", "--duration", "60.01s", "--axis", "boom"]);
    let (command, position) = (found.column("boom.command"), found.column("boom.position"));
    for (now, half_a_period_later) in command.iter().zip(&command[1000..]) {
        assert!((now + half_a_period_later).abs() < 1e-9, "the command is symmetric");
    }
    for period in [0, 2000, 4000] {
        let rise = position[period + 2000] - position[period];
        println!("20 s of the command move the boom by {:.2} mm", 1e3 * rise);
        assert!((-0.040..-0.025).contains(&rise), "{rise}");
    }

    let spool = found.column("boom.spool_position");
    let mut rests = 0;
    for rest in position
        .iter()
        .zip(spool)
        .collect::<Vec<_>>()
        .chunk_by(|a, b| DEAD_BAND.contains(&a.1) == DEAD_BAND.contains(&b.1))
    {
        let (low, high) = rest.iter().fold((f64::MAX, f64::MIN), |(low, high), (y, _)| (low.min(**y), high.max(**y)));
        if !DEAD_BAND.contains(&rest[0].1) {
            assert!(high - low > 0.02, "between two rests it moves: {low} {high}");
        } else if rest.len() > 20 {
            println!("{:.2} s in the dead band: {:.3} mm", 0.01 * rest.len() as f64, 1e3 * (high - low));
            // Leakage deflects the bristles of the friction model by 0.2 mm, and the axis slips once at most.
            assert!(high - low < 0.35e-3, "{low} {high}");
            rests += 1;
        }
    }
    assert_eq!(rests, 7);
}

#[test]
fn the_picture_of_the_documentation_is_what_is_drawn() {
    let drawn = cli::success(
        tempfile::tempdir().unwrap().path(),
        &["simulate", FOUR_AXES, "--scenario", "open-loop", "--duration", "60s", "--axis", "boom", "--plot", "-"],
    );
    let kept = include_str!("../../../docs/src/open-loop.svg");
    assert!(
        drawn == kept,
        "hydraxis simulate examples/four-axes.toml --scenario open-loop --duration 60s --axis boom \
         --plot docs/src/open-loop.svg draws it anew"
    );
}

#[test]
fn a_closed_standard_output_ends_the_run_without_an_error() {
    // Both runs would take far too long if they did not end with their reader.
    for arguments in [&["--scenario", "open-loop", "--duration", "10h"][..], &["--duration", "3s", "--trajectory", "-"]]
    {
        let mut command = harness::hydraxis();
        command.arg("simulate").args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        assert!(line.starts_with("t,supply_pressure,boom.command,"), "{line}");
        let status = harness::wait_for("the end", || child.try_wait().unwrap());
        let mut errors = String::new();
        child.stderr.take().unwrap().read_to_string(&mut errors).unwrap();
        assert_eq!((status.code(), errors.as_str()), (Some(0), ""), "{arguments:?}");
    }
}
