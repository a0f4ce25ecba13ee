use super::*;
use std::time::Duration;

use crate::hammerstein::{Basis, InputMap, Structure};

fn built_in_with(from: &str, to: &str) -> Result<Machine, MachineError> {
    assert!(FOUR_AXES.contains(from), "{from}");
    Machine::parse(&FOUR_AXES.replacen(from, to, 1), "m.toml", Path::new("."), &[])
}

/// The problems of a broken machine file as text; a machine that is accepted fails the test.
fn refusal(from: &str, to: &str) -> String {
    built_in_with(from, to).expect_err("the machine file is to be refused").to_string()
}

#[test]
fn the_built_in_machine_is_the_four_axis_excavator() {
    let machine = Machine::four_axes(&[]).unwrap();
    let names: Vec<&str> = machine.axes.iter().map(|axis| axis.name.as_str()).collect();
    assert_eq!(names, ["boom", "arm", "telescope", "bucket"]);
    assert_eq!(machine.timing.period, Duration::from_millis(10));
    assert_eq!(machine.axes[0].identification.training, 800);
    assert_eq!(machine.axes[0].identification.horizon, 50);
    assert_eq!(machine.scenario.name, "cold-start");
}

#[test]
fn reactions_have_defaults() {
    let machine = built_in_with("following_error = 0.15", "").unwrap();
    assert_eq!(machine.axes[0].control.following_error, 0.03);
    assert_eq!(machine.timing.model_lifetime, Duration::from_secs(30));
    // A model time-out that is longer than the default lifetime makes the lifetime longer.
    let machine = built_in_with("period = \"10ms\"", "period = \"10ms\"\nmodel_timeout = \"60s\"").unwrap();
    assert_eq!(machine.timing.model_lifetime, Duration::from_secs(60));
}

#[test]
fn an_unknown_key_is_refused_with_its_line() {
    let text = refusal("max_speed = 1.0 ", "max_sped = 1.0 ");
    let line = 1 + FOUR_AXES[..FOUR_AXES.find("max_speed = 1.0 ").unwrap()].matches('\n').count();
    assert!(text.contains(&format!("m.toml:{line}: axis.boom.max_sped: found an unknown key")), "{text}");
    assert!(text.contains("axis.boom.max_speed: found nothing; allowed: a number from 0.001 to 1000 m/s"), "{text}");
}

#[test]
fn every_kind_of_wrong_value_names_key_found_and_allowed() {
    for (from, to, expected) in [
        ("stroke = 1.334", "stroke = -1.3", "axis.boom.stroke: found -1.3; allowed: a number from 0.001 to 100 m"),
        ("stroke = 1.334", "stroke = nan", "axis.boom.stroke: found nan; allowed: a number"),
        ("stroke = 1.334", "stroke = +inf", "axis.boom.stroke: found +inf; allowed: a number"),
        ("stroke = 1.334", "stroke = \"1.3\"", "axis.boom.stroke: found \"1.3\"; allowed: a number"),
        ("stroke = 1.334", "stroke = \"1.3 s\"", "axis.boom.stroke: found \"1.3 s\"; allowed: a number"),
        ("period = \"10ms\"", "period = 10", "timing.period: found 10; allowed: a duration with its unit"),
        (
            "period = \"10ms\"",
            "period = \"10ms\"\nmodel_lifetime = \"1999ms\"",
            "timing.model_lifetime: found 1.999s; allowed: model_timeout, 2s, or longer",
        ),
        (
            "following_error = 0.15",
            "following_error = 0",
            "axis.boom.control.following_error: found 0; allowed: a number from 0.0001 to 100 m",
        ),
        ("period = \"10ms\"", "period = \"10 cm\"", "timing.period: found \"10 cm\"; allowed: a duration"),
        ("kind = \"sim\"", "kind = \"simm\"", "source.kind: found \"simm\"; allowed: \"sim\" or \"replay\""),
        ("lock_memory = false", "lock_memory = 0", "realtime.lock_memory: found 0; allowed: true or false"),
        (
            "estimator = \"auto\" ",
            "estimator = \"constant:1.5\" ",
            "axis.boom.identification.estimator: found \"constant:1.5\"",
        ),
        ("soft_limits = [0.05, 1.284]", "soft_limits = [1.2, 0.1]", "axis.boom.soft_limits: found [1.2, 0.1]"),
        (
            "amplitude = 0.12, frequency = 0.11",
            "amplitude = 1.2, frequency = 0.11",
            "axis.boom.reference.sines: found a reach",
        ),
        ("[axis.arm.control]", "[axis.arm.contrl]", "axis.arm.contrl: found an unknown key"),
        ("training = \"8s\"", "training = 3", "axis.boom.identification.training: found 3; allowed: 19 to"),
    ] {
        let text = refusal(from, to);
        assert!(text.contains(expected), "{to}\n{text}");
        assert!(text.starts_with("m.toml:"), "{text}");
    }
}

#[test]
fn two_axes_of_one_name_are_refused() {
    let text = refusal("[axis.arm]", "[axis.boom]");
    assert!(text.contains("m.toml:") && text.contains("duplicate key in \"[axis.boom]\""), "{text}");
    assert!(text.lines().all(|line| line.contains("duplicate key")), "only the broken line is named: {text}");
}

#[test]
fn zero_and_nine_axes_are_refused() {
    let start = FOUR_AXES.find("[axis.boom]").unwrap();
    let none = Machine::parse(&FOUR_AXES[..start], "m.toml", Path::new("."), &[]).unwrap_err().to_string();
    assert!(none.contains("axis: found 0 axes; allowed: 1 to 8 axes"), "{none}");

    let axis = &FOUR_AXES[FOUR_AXES.find("[axis.bucket]").unwrap()..];
    let mut nine = FOUR_AXES.to_owned();
    (0..5).for_each(|i| nine += &axis.replace("axis.bucket", &format!("axis.extra{i}")));
    let nine = Machine::parse(&nine, "m.toml", Path::new("."), &[]).unwrap_err().to_string();
    assert!(nine.contains("axis: found 9 axes"), "{nine}");
}

#[test]
fn all_problems_are_named_at_once_in_the_order_of_lines() {
    let text = FOUR_AXES.replacen("stroke = 1.334", "stroke = -1", 1).replacen("mass = 12e3", "mass = \"heavy\"", 1);
    let error = Machine::parse(&(text + "\nunknown = 3\n"), "m.toml", Path::new("."), &[]).unwrap_err();
    let keys: Vec<&str> = error.problems.iter().map(|problem| problem.key.as_str()).collect();
    // Problems that only follow from another problem are not named.
    assert_eq!(keys, ["axis.boom.stroke", "axis.arm.plant.mass", "axis.bucket.plant.unknown"]);
    assert!(
        error.problems.windows(2).all(|pair| pair[0].line.unwrap_or(usize::MAX) <= pair[1].line.unwrap_or(usize::MAX))
    );
}

#[test]
fn a_setting_takes_the_place_of_the_file() {
    let set = |key: &str, value: &str| Machine::four_axes(&[(key.to_owned(), value.to_owned())]);
    let machine = set("axis.boom.identification.estimator", "constant:0.99").unwrap();
    assert_eq!(machine.axes[0].identification.estimator, Estimator::Constant(0.99));
    assert_eq!(machine.axes[1].identification.estimator, Estimator::Auto);
    for text in ["auto", "paper", "rules", "constant:1", "fuzzy:0.9", "fortescue:2", "directional:0.5", "window:100000"]
    {
        let machine = set("axis.boom.identification.estimator", text).unwrap();
        assert_eq!(machine.axes[0].identification.estimator.to_string(), text);
    }
    assert_eq!(set("axis.arm.control.kp", "3").unwrap().axes[1].control.kp, 3.0);
    assert_eq!(set("timing.period", "5ms").unwrap().timing.period, Duration::from_millis(5));

    let text = set("axis.arm.control.kp", "nan").unwrap_err().to_string();
    assert!(text.contains("axis.arm.control.kp: found nan (from the command line)"), "{text}");
    let text = set("axis.arm.kq", "3").unwrap_err().to_string();
    assert!(text.contains("--set axis.arm.kq: found an unknown key"), "{text}");
}

#[test]
fn the_paper_separates_by_its_formula_and_refuses_what_is_not_its_own() {
    let set = |key: &str, value: &str| {
        let setting = |key: &str, value: &str| (format!("axis.boom.identification.{key}"), value.to_owned());
        Machine::four_axes(&[setting("estimator", "paper"), setting(key, value)])
    };
    let machine = set("horizon", "0.4s").unwrap();
    let splits: Vec<Split> = machine.axes.iter().map(|axis| axis.identification.split).collect();
    assert_eq!(splits[..2], [Split::Paper, Split::Als]);
    for (key, value) in [("form", "full"), ("split", "als"), ("output", "velocity")] {
        let text = set(key, value).unwrap_err().to_string();
        let expected = "axis.boom.identification.estimator: found \"paper\" with form";
        assert!(text.contains(expected) && text.contains("or estimator \"rules\""), "{key}: {text}");
        assert!(text.contains(&format!("{key} \"{value}\"")), "{key}: {text}");
    }
}

#[test]
fn the_old_key_of_the_estimator_is_refused_with_the_new_one() {
    let expected = "axis.boom.forgetting: found a key that has been renamed; \
                    allowed: axis.boom.identification.estimator, its new name";
    let text = refusal("max_speed = 1.0 ", "forgetting = \"auto\"\nmax_speed = 1.0 ");
    assert!(text.contains(expected) && text.lines().count() == 1, "{text}");
    let setting = [("axis.boom.forgetting".to_owned(), "paper".to_owned())];
    let text = Machine::four_axes(&setting).unwrap_err().to_string();
    assert!(text.contains(expected) && text.lines().count() == 1, "{text}");

    let expected = "axis.boom.identification.forgetting: found a key that has been renamed; \
                    allowed: axis.boom.identification.estimator, its new name";
    let text = refusal("training = \"8s\"", "forgetting = \"paper\"\ntraining = \"8s\"");
    assert!(text.contains(expected) && text.lines().count() == 1, "{text}");
}

#[test]
fn a_value_that_is_not_from_the_machine_file_is_refused_with_its_own_place() {
    // The file has good values of both keys; their lines would mislead.
    let set = |key: &str, value: &str| Machine::load(None, &[(key.to_owned(), value.to_owned())]).unwrap_err();
    let text = set("axis.boom.control.kp", "-1").to_string();
    assert!(text.starts_with("built-in machine: axis.boom.control.kp: found -1 (from the command line);"), "{text}");
    let text = set("axis.boom.soft_limits", "[0.5, 0.1]").to_string();
    let expected = "built-in machine: axis.boom.soft_limits: found [0.5, 0.1] (from the command line);";
    assert!(text.starts_with(expected), "{text}");

    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("model.toml");
    std::fs::write(&model, "[axis.boom.control]\n# too small\nkp = -1\nkq = 2\n").unwrap();
    let text = Machine::explain(None, Some(&model), &[]).unwrap_err().to_string();
    for expected in
        ["model.toml:3: axis.boom.control.kp: found -1;", "model.toml:4: axis.boom.control.kq: found an unknown key;"]
    {
        assert!(text.contains(expected) && !text.contains("--set"), "{text}");
    }
}

#[test]
fn a_dead_time_of_more_periods_than_a_model_has_is_refused_unless_nk_is_given() {
    let commissioned = "[axis.boom.commissioned]\ndead_time = 2.0\ntime_constant = 0.0\ndead_band_extend = 0.1\n\
                        dead_band_retract = 0.1\nopenings = [0.5]\nspeeds_extend = [0.2]\nspeeds_retract = [0.2]\n\
                        fit_percent = 90.0\n[axis.boom.encoder]";
    let with = |nk: &str, period: &str| {
        let text = FOUR_AXES.replacen("[axis.boom.encoder]", commissioned, 1).replacen("nk = 3 ", nk, 1);
        Machine::parse(&text.replacen("\"10ms\"", period, 1), "m.toml", Path::new("."), &[])
    };
    assert_eq!(with("", "\"2ms\"").unwrap().axes[0].identification.structure.nk, 1001);
    let text = with("", "\"1ms\"").unwrap_err().to_string();
    let expected = "axis.boom.identification.nk: found nothing, and 2001 from commissioned.dead_time of 2 s; \
                    allowed: 1 to 1024: a longer timing.period, or a dead time of up to 1.023 s";
    assert!(text.contains(expected) && text.lines().count() == 1, "{text}");
    assert_eq!(with("nk = 1024 ", "\"1ms\"").unwrap().axes[0].identification.structure.nk, 1024);
}

#[test]
fn a_curve_with_fewer_speeds_than_openings_is_refused() {
    let set = ("axis.boom.commissioned.speeds_extend".to_owned(), "[0.1]".to_owned());
    let text = Machine::load(None, &[set]).unwrap_err().to_string();
    let expected = "axis.boom.commissioned.speeds_extend: found [0.1] (from the command line); allowed: 6 rising";
    assert!(text.contains(expected) && text.lines().count() == 1, "{text}");
}

#[test]
fn the_kind_of_a_reference_can_be_set() {
    let set = |value: &str| Machine::four_axes(&[("axis.boom.reference.kind".to_owned(), value.to_owned())]);
    assert_eq!(set("hold").unwrap().axes[0].reference, ReferenceSource::Hold);
    let text = set("spline").unwrap_err().to_string();
    assert_eq!(text.lines().count(), 1, "{text}");
}

#[test]
fn whole_numbers_may_be_written_in_any_base() {
    assert_eq!(built_in_with("nk = 3 ", "nk = 0x4 ").unwrap().axes[0].identification.structure.nk, 4);
}

#[test]
fn the_options_of_the_structure_are_read() {
    let options = "training = \"8s\"\nintegrator = true\ndrift = true\ndead_band = [0.05, 0.1]\n\
                   knots = [0.0, 0.2, 0.5, 0.6]\noutput = \"velocity\" #";
    let identification = built_in_with("training = \"8s\"", options).unwrap().axes[0].identification.clone();
    let input = InputMap { dead_band: (0.05, 0.1), basis: Basis::hinges(&[0.0, 0.2, 0.5, 0.6]).unwrap() };
    let structure = Structure { nk: 3, order: 4, integrator: true, drift: true, input, ..Structure::PAPER };
    assert_eq!((identification.structure, identification.output), (structure, IdentifiedOutput::Velocity));
    assert_eq!(identification.period, 0.01);
    // One integrator is that of the structure, the other one leads from velocity to position.
    assert_eq!(identification.published(), Structure { na: 5, integrator: false, ..structure });

    let plain = Machine::four_axes(&[]).unwrap().axes[0].identification.clone();
    assert_eq!(plain.structure, Structure { nk: 3, ..Structure::PAPER });
    assert_eq!(plain.published(), plain.structure);
    let one = built_in_with("training = \"8s\"", "training = \"8s\"\ndead_band = 0.07 #").unwrap();
    assert_eq!(one.axes[0].identification.structure.input.dead_band, (0.07, 0.07));
}

#[test]
fn a_file_that_is_not_there_is_named() {
    let text = Machine::load(Some(Path::new("/nowhere/m.toml")), &[]).unwrap_err().to_string();
    assert!(text.starts_with("/nowhere/m.toml: found a file that cannot be read"), "{text}");
}

#[test]
fn another_rule_table_can_be_loaded() {
    let rows = ["[\"VB\", \"VB\", \"VB\", \"VB\", \"VB\", \"VB\", \"VS\"]"; 7].join(", ");
    let machine = built_in_with("[fuzzy]", &format!("[fuzzy]\nrules = [{rows}]")).unwrap();
    assert_eq!(machine.axes[2].identification.fuzzy.rules[3][6], Level::VS);
    let short = rows.replacen("\"VB\", ", "", 1);
    let text = refusal("[fuzzy]", &format!("[fuzzy]\nrules = [{short}]"));
    assert!(text.contains("fuzzy.rules: found another shape or term"), "{text}");
}

#[test]
fn feed_forward_needs_a_commissioned_model_that_answers_within_the_preview() {
    let control = "[axis.boom.control]\n";
    let with = |dead_time: &str| {
        format!(
            "[axis.boom.commissioned]\ndead_time = {dead_time}\ntime_constant = 0.05\ndead_band_extend = 0.1\n\
             dead_band_retract = 0.08\nopenings = [0.1]\nspeeds_extend = [0.05]\nspeeds_retract = [0.05]\n\
             fit_percent = 97.0\n{control}feedforward = true\n"
        )
    };
    let machine = built_in_with(control, &with("0.15")).unwrap();
    assert!(machine.axes[0].control.feedforward && !machine.axes[1].control.feedforward);
    let text = refusal(control, &format!("{control}feedforward = true\n"));
    assert!(text.contains("axis.boom.control.feedforward: found true without [axis.boom.commissioned]"), "{text}");
    assert!(text.contains("`--model MODEL.toml`"), "{text}");
    let text = refusal(control, &with("0.75").replace("time_constant = 0.05", "time_constant = 9.75"));
    assert!(text.contains("feedforward: found true with dead_time + time_constant of 10.5 s"), "{text}");
}

#[test]
fn all_stages_but_the_simulated_machine_start_again_by_default() {
    let setting = |value: &str| [("stage.ident-proc.restart".to_owned(), value.to_owned())];
    let restarts = |machine: &Machine| machine.stages.clone().map(|stage| stage.restart);
    let (never, again) = (Restart::Never, Restart::OnFailure);
    assert_eq!(restarts(&Machine::four_axes(&[]).unwrap()), [never, again, again, again]);
    assert_eq!(restarts(&Machine::four_axes(&setting("never")).unwrap()), [never, again, never, again]);
    let refused = Machine::four_axes(&setting("always")).unwrap_err().to_string();
    let expected =
        "stage.ident-proc.restart: found always (from the command line); allowed: \"on-failure\" or \"never\"";
    assert!(refused.contains(expected), "{refused}");
}

/// A machine file whose boom is commissioned; `changes` are made to the text of the built-in machine.
fn commissioned(changes: &[(&str, &str)]) -> Machine {
    let table = "[axis.boom.commissioned]\ndead_time = 0.04\ntime_constant = 0.05\ndead_band_extend = 0.1\n\
                 dead_band_retract = 0.08\nopenings = [0.1, 0.5]\nspeeds_extend = [0.05, 0.3]\n\
                 speeds_retract = [0.05, 0.3]\nfit_percent = 97.0\n";
    let mut text = FOUR_AXES.replacen("[axis.boom.control]\n", &format!("{table}[axis.boom.control]\n"), 1);
    for (from, to) in changes {
        assert!(text.contains(from), "{from}");
        text = text.replacen(from, to, 1);
    }
    Machine::parse(&text, "m.toml", Path::new("."), &[]).unwrap()
}

#[test]
fn the_commissioned_model_is_the_default_of_control_and_identification() {
    let absent = ("dead_band_extend = 0.08    # calibrated, a little less than the valve's\n", "");
    let boom = |changes: &[(&str, &str)]| commissioned(changes).axes[0].clone();
    let axis = boom(&[absent, ("nk = 3 ", "")]);
    assert_eq!((axis.control.dead_band.extend, axis.control.dead_band.retract), (0.9 * 0.1, 0.07));
    // Four periods of dead time, and the one in which the command is sent.
    assert_eq!(axis.identification.structure.nk, 5);
    assert_eq!(axis.identification.structure.input.dead_band, (0.08 - 0.01, 0.1 - 0.01));
    // A key that is given wins.
    let axis = boom(&[("nk = 3 ", "nk = 4\ndead_band = 0.02 #")]);
    assert_eq!((axis.control.dead_band.extend, axis.control.dead_band.retract), (0.08, 0.07));
    assert_eq!(axis.identification.structure.nk, 4);
    assert_eq!(axis.identification.structure.input.dead_band, (0.02, 0.02));
    // Without either there is no dead band for the fallback.
    let text = refusal(absent.0, "");
    assert!(
        text.contains("axis.boom.control.dead_band_extend: found nothing; allowed: a number from 0 to 0.9"),
        "{text}"
    );
}

#[test]
fn the_grey_box_has_the_structure_of_the_commissioned_model() {
    let axis = commissioned(&[("estimator = \"auto\"", "estimator = \"grey-box\"")]).axes[0].clone();
    let Structure { nk, order, input, .. } = axis.identification.structure;
    assert_eq!((nk, order, input.dead_band), (5, 3, (0.08 - 0.01, 0.1 - 0.01)));
    assert_eq!(input.basis, Basis::hinges(&[0.0, 0.05, 0.35 * 0.5]).unwrap());
}

/// The tables of an excavator's mechanism.
const MECHANISM: &str = include_str!("../../../examples/mechanism.toml");

/// The text of the built-in machine without what its axes move.
fn without_loads() -> String {
    let is_load = |line: &&str| ["mass =", "load_force =", "load_stiffness ="].iter().any(|key| line.starts_with(key));
    FOUR_AXES.lines().filter(|line| !is_load(line)).collect::<Vec<_>>().join("\n")
}

/// The built-in machine with [`MECHANISM`], which says what its axes move.
fn with_mechanism(from: &str, to: &str) -> Result<Machine, MachineError> {
    let text = format!("{}\n{MECHANISM}", without_loads());
    assert!(text.contains(from), "{from}");
    Machine::parse(&text.replacen(from, to, 1), "m.toml", Path::new("."), &[])
}

#[test]
fn an_axis_with_the_name_of_another_body_is_refused() {
    // The tables of the arm get the name of the boom, and those of the boom that of the arm.
    let text = without_loads().replace("[axis.boom", "[axis.x").replace("[axis.arm", "[axis.boom");
    let text = format!("{}\n{MECHANISM}", text.replace("[axis.x", "[axis.arm"));
    let refused = Machine::parse(&text, "m.toml", Path::new("."), &[]).unwrap_err().to_string();
    for expected in [
        "mechanism: found axis.arm as axis 1 of the machine; allowed: it as axis 2",
        "mechanism: found axis.boom as axis 2 of the machine; allowed: it as axis 1",
    ] {
        assert!(refused.contains(expected), "{refused}");
    }
}

#[test]
fn a_mechanism_takes_the_place_of_masses_and_loads() {
    let mechanism = with_mechanism("", "").unwrap().mechanism.unwrap();
    assert_eq!(mechanism.retracted, [1.87, 2.075, 0.0, 1.68]);
    assert_eq!(mechanism.masses.payload.center, ::mechanism::Vector::new(0.75, 0.22));
    // A payload without a centre lies at the bucket's centre of mass.
    let payload = with_mechanism("center = [0.75, 0.22]\n", "").unwrap().mechanism.unwrap().masses.payload;
    assert_eq!((payload.mass, payload.center), (0.0, mechanism.masses.bucket.center));

    let error = with_mechanism("piston_area = 0.0226", "mass = 40e3\npiston_area = 0.0226").unwrap_err().to_string();
    assert!(error.contains("axis.boom.plant.mass: found 40e3; allowed: no such key here: [mechanism]"), "{error}");
    let error = with_mechanism("[timing]", "[mechanisms]\n[timing]").unwrap_err().to_string();
    assert!(error.contains("mechanisms: found an unknown key"), "{error}");
    // Without the table, masses are needed.
    let error = refusal("mass = 40e3", "").to_string();
    assert!(error.contains("axis.boom.plant.mass: found nothing; allowed: a number from 1 to 1000000 kg"), "{error}");
}

#[test]
fn wrong_values_of_a_mechanism_name_key_found_and_allowed() {
    for (from, to, expected) in [
        (
            "foot = [0.23, 1.96]",
            "foot = [0.23]",
            "mechanism.boom.foot: found [0.23]; allowed: [x, z], two numbers from -100",
        ),
        ("foot = [0.23, 1.96]", "foot = [nan, 1]", "mechanism.boom.foot: found [nan, 1]; allowed: [x, z]"),
        ("length = 5.65", "length = 0", "mechanism.boom.length: found 0; allowed: a number from 0.001 to 100 m"),
        (
            "rocker_length = 0.700",
            "rocker = 0.7",
            "mechanism.bucket.rocker: found an unknown key; allowed: one of center,",
        ),
        ("mass = 660", "mass = 0", "mechanism.bucket.mass: found 0; allowed: a number from 0.001"),
        ("inertia = 280", "", "mechanism.telescope.inertia: found nothing; allowed: a number from 0 to"),
        (
            "[mechanism.payload]",
            "[mechanism.payload]\nheaviest = 0.5",
            "mechanism.payload.heaviest: found 0.5; allowed: a number from 1 to",
        ),
        (
            "[mechanism.payload]\nmass = 0 ",
            "[mechanism.payload]\nheaviest = 800\nmass = 900 ",
            "mechanism.payload.heaviest: found 800 kg; allowed: the mass of the payload, 900 kg, or more",
        ),
        (
            "[mechanism.payload]",
            "[mechanism.payload]\nheaviest = 800",
            "mechanism.payload.heaviest: found a payload to be estimated, without chamber pressures of boom or arm; \
             allowed: [axis.boom.pressure], or that of the arm, beside [axis.NAME.plant]",
        ),
        ("[mechanism.payload]", "[mechanism.load]", "mechanism.load: found an unknown key; allowed: one of arm, boom,"),
        (
            "[supply]",
            "[walls]\ndepth = -5\nheight = 3\nclearance = 0.3\npayload = 0\ncorner = [{ at = [1, 0.6] }]\n[supply]",
            "walls.height: found 3 m; allowed: above 5 m, the lowest place that depth leaves",
        ),
        (
            "[mechanism.payload]\nmass = 0 ",
            "[walls]\ndepth = 5\nclearance = 0.3\npayload = 100\ncorner = [{ at = [1, 0.6] }]\n\
             [mechanism.payload]\nmass = 900 ",
            "walls.payload: found 100 kg; allowed: mechanism.payload.mass, 900 kg, or more",
        ),
    ] {
        let error = with_mechanism(from, to).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn pins_that_do_not_let_a_cylinder_move_over_its_stroke_are_refused() {
    for (from, to, expected) in [
        (
            "cylinder_rod = [2.431, 0.982]",
            "cylinder_rod = [8.0, 0.982]",
            "mechanism.boom: found pins that close at no length from 1.850 to 3.224 m of the cylinder; allowed: pins \
             with which the cylinder turns the boom one way over its stroke of 1.334 m",
        ),
        // 0.823 m and 2.622 m between the pins: the boom cylinder is stretched at 3.445 m.
        (
            "cylinder_length = 1.870",
            "cylinder_length = 2.2",
            "mechanism.boom: found a dead centre at position 1.245 m, length 3.445 m",
        ),
        // 1.8 m is the shortest length.
        ("cylinder_length = 1.870", "cylinder_length = 1.819", "mechanism.boom: found a moment arm of 0.0"),
        ("cylinder_rod = [-0.843, 0.249]", "cylinder_rod = [-0.343, 0.249]", "mechanism.arm: found a dead centre at"),
        ("link_length = 0.600", "link_length = 0.500", "mechanism.bucket: found a dead centre at position"),
    ] {
        let error = with_mechanism(from, to).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
        assert_eq!(error.lines().count(), 1, "{error}");
    }
}

/// A loam for the teeth of [`MECHANISM`].
const SOIL: &str =
    "[soil]\nunit_weight = 18e3\ncohesion = 9e3\nwidth = 1.05\nfriction_angle = 30\nsteel_friction_angle = 20\n";

#[test]
fn soil_needs_a_mechanism_and_angles_that_leave_a_failure_plane() {
    let soil = with_mechanism("[timing]", &format!("{SOIL}[timing]")).unwrap().soil.unwrap();
    assert_eq!((soil.level, soil.rake_angle, soil.penetration_resistance), (0.0, 45.0, 0.0));
    let error = refusal("[timing]", &format!("{SOIL}[timing]"));
    assert!(error.contains("soil: found a table without [mechanism]; allowed: [mechanism] beside it"), "{error}");
    let steep = SOIL.replace("= 30", "= 50").replace("= 20", "= 25\nrake_angle = 100");
    let error = with_mechanism("[timing]", &format!("{steep}[timing]")).unwrap_err().to_string();
    assert!(error.contains("soil.rake_angle: found 100; allowed: up to 170 degrees together with"), "{error}");
}

#[test]
fn a_scenario_changes_only_what_the_machine_has() {
    let scenario = |parameter: &str, axis: &str| {
        let value = if parameter.starts_with("mass") || parameter.starts_with("load") { "factor" } else { "value" };
        let change = format!("{{ parameter = \"{parameter}\", {axis}start = 1, end = 2, {value} = 1 }}");
        format!("[scenarios.own]\nsummary = \"own\"\nchanges = [{change}]\n[timing]")
    };
    let carried = |parameter: &str| with_mechanism("[timing]", &scenario(parameter, "")).map_err(|e| e.to_string());
    let dug = |parameter: &str| {
        with_mechanism("[timing]", &(SOIL.to_owned() + &scenario(parameter, ""))).map_err(|e| e.to_string())
    };
    let alone = |parameter: &str| built_in_with("[timing]", &scenario(parameter, "")).map_err(|e| e.to_string());
    for (accepted, refused) in [
        (vec![alone("mass"), alone("load_force"), alone("external_force")], vec![alone("payload"), alone("soil")]),
        (
            vec![carried("payload"), carried("external_force")],
            vec![carried("mass"), carried("load_force"), carried("soil")],
        ),
        (vec![dug("payload"), dug("soil")], vec![dug("external_force")]),
    ] {
        accepted.into_iter().for_each(|machine| assert!(machine.is_ok(), "{machine:?}"));
        for error in refused.into_iter().map(Result::unwrap_err) {
            assert!(error.contains("scenarios.own.changes[0].parameter: found \""), "{error}");
        }
    }
    // An axis beyond the mechanism has a mass of its own.
    let error = with_mechanism("[timing]", &scenario("mass", "axis = \"arm\", ")).unwrap_err().to_string();
    assert!(error.contains("found \"mass\"; allowed: payload, or an axis whose mass [mechanism] does not"), "{error}");
    for name in ["payload", "digging", "everything"] {
        assert!(with_mechanism("scenario = \"cold-start\"", &format!("scenario = \"{name}\"")).is_ok(), "{name}");
    }
}
