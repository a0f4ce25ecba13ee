//! Lock-step gives the same bits every time, in four processes and in one.

use crate::harness::{
    FOUR_AXES, TestGroup, hydraxis, machine_file,
    mechanism::{EXCAVATOR, joint_sensors},
    replay::expect_same_bits,
    report,
};

#[test]
fn four_processes_repeat_bit_for_bit_and_equal_one_process() {
    let arguments = [FOUR_AXES, "--duration", "15s", "--seed", "7"];
    let first = report(&[&["run", "--lockstep"], &arguments[..]].concat());
    let second = report(&[&["run", "--lockstep"], &arguments[..]].concat());
    let simulated = report(&[&["simulate"], &arguments[..]].concat());
    assert_eq!(first, second);
    assert_eq!(first, simulated);
    assert_eq!(first["ticks"], 1500);
    for stage in ["plant-sim", "sensor-proc", "ident-proc", "control-proc"] {
        assert_eq!(first["stages"][stage]["samples"], 1500, "{stage}");
        assert_eq!(first["stages"][stage]["lost"], 0, "{stage}");
    }
    // The run was a real one: models were trained and controlled the axes, which tracked within 0.1 m.
    for axis in ["boom", "arm", "telescope", "bucket"] {
        let axis = &first["axes"][axis];
        assert_eq!(axis["identification"]["updates"], 700);
        assert!(axis["tracking_by_model"]["count"].as_u64().unwrap() > 500, "{axis}");
        assert!(axis["tracking"]["rmse"].as_f64().unwrap() < 0.1, "{axis}");
    }

    let other = report(&["simulate", FOUR_AXES, "--duration", "15s", "--seed", "8"]);
    assert_ne!(first["axes"], other["axes"], "another seed is another run");
}

#[test]
fn sensors_at_joints_and_pressures_give_the_same_bits_in_four_processes_and_in_one() {
    let mut settings = joint_sensors("inclinometer", 1e-4);
    for axis in ["boom", "arm", "bucket"] {
        let mut set = |key: &str, value: &str| settings.push((format!("axis.{axis}.{key}"), value.to_owned()));
        set("plant.angle_noise", "1e-4");
        set("plant.angle_bandwidth", "10");
        set("pressure.resolution", "1e4");
        set("plant.pressure_noise", "1e4");
    }
    let settings: Vec<String> = settings.iter().map(|(key, value)| format!("{key}={value}")).collect();
    let settings: Vec<&str> = settings.iter().flat_map(|setting| ["--set", setting.as_str()]).collect();
    let arguments = [&[EXCAVATOR, "--duration", "6s", "--seed", "5"], &settings[..]].concat();
    let simulated = report(&[&["simulate"], &arguments[..]].concat());
    assert_eq!(report(&[&["run", "--lockstep"], &arguments[..]].concat()), simulated);
    let bare = report(&["simulate", EXCAVATOR, "--duration", "6s", "--seed", "5"]);
    assert_ne!(bare["axes"], simulated["axes"], "the sensors have an effect");
}

#[test]
fn two_groups_side_by_side_do_not_see_each_other() {
    let alone = report(&["simulate", "--duration", "6s", "--seed", "3"]);
    let other_alone = report(&["simulate", "--duration", "6s", "--seed", "4"]);
    let run = |name: &str, seed: &'static str| {
        let group = TestGroup::new(name);
        std::thread::spawn(move || {
            let prefix = group.prefix.to_string();
            report(&["run", "--lockstep", "--duration", "6s", "--seed", seed, "--prefix", &prefix])
        })
    };
    let (one, two) = (run("one", "3"), run("two", "4"));
    assert_eq!(one.join().unwrap(), alone);
    assert_eq!(two.join().unwrap(), other_alone);
}

#[test]
fn another_program_takes_the_place_of_a_stage() {
    let folder = tempfile::tempdir().unwrap();
    // A shell script that writes its arguments to a file and then replaces itself by the stage.
    let mark = folder.path().join("mark");
    let script = format!("echo \"$@\" > {}; exec {} plant-sim \"$@\"", mark.display(), env!("CARGO_BIN_EXE_hydraxis"));
    let stage = format!("[stage.plant-sim]\ncommand = [\"/bin/sh\", \"-c\", '''{script}''', \"sh\"]\n\n[source]");
    let file = machine_file(folder.path(), "[source]", &stage);
    let file = file.to_str().unwrap();
    let swapped = report(&["run", file, "--lockstep", "--duration", "3s", "--seed", "5"]);
    assert_eq!(swapped, report(&["simulate", FOUR_AXES, "--duration", "3s", "--seed", "5"]));
    let given = std::fs::read_to_string(&mark).unwrap();
    for expected in [file, "--prefix", "--lockstep", "--ticks 300", "--seed 5"] {
        assert!(given.contains(expected), "{given}");
    }

    let refused = hydraxis().args(["simulate", file]).output().unwrap();
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("stage.plant-sim.command"));
}

#[test]
fn a_record_through_the_processes_is_the_record_in_one_process() {
    let folder = tempfile::tempdir().unwrap();
    let record = folder.path().join("record.csv");
    let (mut y, mut speed, mut text) = (0.5, 0.0, "t,u,y\n".to_owned());
    for k in 0..3000 {
        let t = f64::from(k) * 0.002;
        let u = 0.6 * (3.0 * t).sin() + 0.3 * (17.0 * t).cos();
        text += &format!("{t:.3},{u:.6},{y:.6}\n");
        speed += 0.1 * (u * if u > 0.0 { 0.4 } else { 0.3 } - speed);
        y += 0.002 * speed;
    }
    std::fs::write(&record, text).unwrap();
    expect_same_bits(&record, "2ms", 1200);
}
