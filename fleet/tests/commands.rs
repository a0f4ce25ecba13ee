//! Commands over the network, at a real group through a real router.

mod harness;

use std::{
    fs,
    path::PathBuf,
    process::Stdio,
    thread::sleep,
    time::{Duration, Instant},
};

use harness::{Group, Router, Running, fleet, hydraxis, wait_for};
use hydraxis_fleet::command::DEAD_MAN;
use pipeline::{
    channel::{Group as Member, Reader},
    message::{AxisCommand, AxisMode, EncoderSample, ValveCommand, control_flag},
    stage::monotonic_ns,
};
use serde_json::{Value, json};
use zenoh::{Session, Wait};

/// Within this time of a loss the axis is off at the valve.
const OFF: Duration = Duration::from_millis(300);
/// Time in which an axis that must not move again would have moved.
const SILENCE: Duration = Duration::from_millis(1500);
const ROOT: &str = "hydraxis/v1/quarry/ex-07/@command";

/// A machine of which the boom may be moved, and its group.
struct Machine {
    router: Router,
    folder: tempfile::TempDir,
    commands: Reader<ValveCommand>,
    samples: Reader<EncoderSample>,
    axis: usize,
    _member: Member,
    group: Group,
}

impl Machine {
    fn new(name: &str) -> Self {
        let router = Router::new();
        let arguments = ["--off", "--set", "timing.feedback_timeout=400ms", "--duration", "10min"];
        let group = Group::run(name, &arguments);
        let prefix = group.prefix.parse().unwrap();
        let board = wait_for("the group", || pipeline::channel::Board::find(&prefix).ok().flatten());
        let axis = board.machine().names().position(|name| name == "boom").unwrap();
        let status = || hydraxis().args(["status", "--prefix", &group.prefix]).output().unwrap().status.success();
        wait_for("the stages", || status().then_some(()));
        let member = Member::join(&prefix, "test").unwrap();
        let (commands, samples) = (member.reader().unwrap(), member.reader().unwrap());
        let folder = tempfile::tempdir().unwrap();
        let machine = Self { router, folder, commands, samples, axis, _member: member, group };
        let text = format!(
            "site = \"quarry\"\nmachine = \"ex-07\"\ngroup = \"{}\"\nrouter = [\"{}\"]\n[commands]\n\
             journal = \"journal\"\n[commands.axes.boom]\nfrom = 0.55\nto = 0.8\nspeed = 0.02\n",
            machine.group.prefix, machine.router.address
        );
        fs::write(machine.settings(), text).unwrap();
        machine
    }

    fn settings(&self) -> PathBuf {
        self.folder.path().join("fleet.toml")
    }

    /// `hydraxis-fleet consent`, or `listen`, once it is connected.
    fn at_machine(&self, arguments: &[&str]) -> Running {
        let mut command = fleet();
        command.arg(arguments[0]).arg(self.settings()).args(&arguments[1..]);
        let process = Running(command.stderr(Stdio::null()).spawn().unwrap());
        let session = self.session();
        wait_for("the machine", || ask(&session, "disarm", &json!({ "station": "test" })).ok());
        process
    }

    fn consent(&self) -> Running {
        self.at_machine(&["consent", "--for", "5min"])
    }

    fn session(&self) -> Session {
        self.router.connection().open().unwrap()
    }

    fn station(&self, target: &str) -> Running {
        let mut command = fleet();
        command.args(["operate", "quarry/ex-07", "--station", "office", "--enable", "--to", target, "--router"]);
        command.arg(&self.router.address);
        Running(command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap())
    }

    /// The newest command of the boom, and when it was sent.
    fn boom(&mut self) -> Option<(AxisCommand, u64)> {
        let command = self.commands.newest().unwrap().if_new()?;
        Some((command.axes[self.axis], command.header.sent_ns))
    }

    fn wait_until_it_follows(&mut self) {
        wait_for("the boom follows", || {
            let (boom, _) = self.boom()?;
            (boom.operation == AxisMode::Hold as u32 && boom.flags & control_flag::SETTLING == 0).then_some(())
        });
    }

    /// Time from `since_ns` to the first neutral command of the disarmed boom.
    fn off_after(&mut self, since_ns: u64) -> Duration {
        wait_for("the boom is off", || {
            let (boom, sent_ns) = self.boom().filter(|(boom, _)| is_off(boom))?;
            assert_eq!(boom.command, 0.0);
            Some(Duration::from_nanos(sent_ns.saturating_sub(since_ns)))
        })
    }

    fn expect_off(&mut self) {
        let until = Instant::now() + SILENCE;
        while Instant::now() < until {
            assert!(self.boom().is_none_or(|(boom, _)| is_off(&boom)), "it is armed again");
            sleep(Duration::from_millis(5));
        }
    }

    fn position(&mut self) -> f64 {
        wait_for("a sample", || self.samples.newest().unwrap().if_new().map(|sample| sample.axes[self.axis].position))
    }

    fn journal(&self) -> Vec<Value> {
        let text = fs::read_to_string(self.folder.path().join("journal")).unwrap();
        text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }

    fn texts(&self, what: &str) -> Vec<String> {
        let journal = self.journal().into_iter().filter(|line| line["what"] == what);
        journal.map(|line| line["text"].as_str().unwrap().to_owned()).collect()
    }
}

fn is_off(boom: &AxisCommand) -> bool {
    boom.flags & control_flag::DISARMED != 0
}

fn ask(session: &Session, of: &str, question: &Value) -> Result<Value, String> {
    ask_key(session, &format!("{ROOT}/{of}"), question.to_string())
}

fn ask_key(session: &Session, key: &str, question: String) -> Result<Value, String> {
    let answers = session.get(key).payload(question).timeout(Duration::from_secs(2)).wait().unwrap();
    match answers.recv().map_err(|_| "no answer".to_owned())?.into_result() {
        Ok(sample) => Ok(serde_json::from_slice(&sample.payload().to_bytes()).unwrap()),
        Err(error) => Err(error.payload().try_to_string().unwrap().into_owned()),
    }
}

/// Takes the seat; the challenge for the first beat.
fn arm(session: &Session, target: f64) -> Value {
    let challenge = ask(session, "challenge", &json!({ "station": "test" })).unwrap()["challenge"].clone();
    let question = json!({ "station": "test", "challenge": challenge, "targets": { "boom": target } });
    ask(session, "arm", &question).unwrap()["challenge"].clone()
}

#[test]
fn an_axis_goes_slowly_to_its_target_and_is_off_at_the_end() {
    let mut machine = Machine::new("moves");
    let _consent = machine.consent();
    let began = machine.position();
    let mut station = machine.station("boom=0.7");
    machine.wait_until_it_follows();
    let (moves, mut furthest) = (Instant::now(), began);
    while moves.elapsed() < Duration::from_secs(5) {
        let position = machine.position();
        // The set point goes at 20 mm/s; half a second, and 10 mm, are for the loop.
        let reached = began + 0.02 * (moves.elapsed().as_secs_f64() + 0.5) + 0.01;
        assert!(position < reached, "at {position} m after {:?}", moves.elapsed());
        furthest = position.max(furthest);
    }
    assert!((furthest - 0.7).abs() < 0.01, "from {began} to {furthest} m");
    assert!(machine.boom().is_some_and(|(boom, _)| !is_off(&boom)));
    let since = monotonic_ns();
    station.signal("INT");
    machine.off_after(since);
    assert!(station.0.wait().unwrap().success());
    assert_eq!(machine.texts("arm"), ["accepted"]);
    let end = wait_for("the end", || machine.texts("end").pop());
    assert_eq!(end, "a stop was asked for");
    machine.expect_off();
}

#[test]
fn an_axis_is_off_after_each_loss_and_stays_off() {
    let mut machine = Machine::new("losses");
    let mut slowest = Duration::ZERO;
    // More rounds than one are for those who measure.
    let rounds = std::env::var("HYDRAXIS_ROUNDS").map_or(1, |rounds| rounds.parse().unwrap());
    let losses = [
        ("station", "STOP"),
        ("station", "KILL"),
        ("station", "HUP"),
        ("router", "STOP"),
        ("consent", "STOP"),
        ("consent", "KILL"),
        ("consent", "TERM"),
    ];
    for (who, signal) in losses.into_iter().cycle().take(rounds * losses.len()) {
        let consent = machine.consent();
        let station = machine.station("boom=0.7");
        machine.wait_until_it_follows();
        let since = monotonic_ns();
        match who {
            "station" => station.signal(signal),
            "router" => machine.router.process.signal(signal),
            _ => consent.signal(signal),
        }
        let off = machine.off_after(since);
        println!("{who} {signal}: off after {off:?}");
        slowest = slowest.max(off);
        sleep(DEAD_MAN);
        // What was suspended goes on, with all that waits for it.
        if signal == "STOP" {
            [&station, &consent, &machine.router.process].into_iter().for_each(|process| process.signal("CONT"));
        }
        machine.expect_off();
        let end = machine.texts("end").pop();
        match (who, signal) {
            ("station", "HUP") => assert_eq!(end.unwrap(), "a stop was asked for"),
            ("station" | "router", _) => assert_eq!(end.unwrap(), "the station was silent for 150ms"),
            _ => {}
        }
    }
    assert!(slowest < OFF, "{slowest:?}");
}

#[test]
fn a_person_at_the_machine_takes_it_back_at_once() {
    let mut machine = Machine::new("taken");
    let mut consent = machine.consent();
    let mut station = machine.station("boom=0.7");
    machine.wait_until_it_follows();
    let since = monotonic_ns();
    machine.group.command(&["disarm"]);
    assert!(machine.off_after(since) < OFF);
    assert!(!station.0.wait().unwrap().success());
    machine.expect_off();
    assert_eq!(machine.texts("end").last().unwrap(), "a stop was asked for");

    let mut station = machine.station("boom=0.7");
    machine.wait_until_it_follows();
    let mut local = hydraxis();
    local.args(["operate", "--prefix", &machine.group.prefix, "--axis", "boom", "--mode", "hold", "--take-over"]);
    let mut local = Running(local.stdout(Stdio::null()).spawn().unwrap());
    // The consent is over, and what was armed from elsewhere is off, although a program goes on that could keep it.
    wait_for("the end of the consent", || (!consent.is_running()).then_some(()));
    assert!(!station.0.wait().unwrap().success());
    assert!(machine.texts("consent").last().unwrap().contains("a program at the machine has taken over"));
    machine.expect_off();
    local.signal("INT");
    local.0.wait().unwrap();
}

#[test]
fn what_is_armed_at_the_machine_is_not_taken_and_not_switched_off() {
    let mut machine = Machine::new("local");
    let _consent = machine.consent();
    machine.group.command(&["arm", "--axis", "boom"]);
    let session = machine.session();
    let challenge = ask(&session, "challenge", &json!({ "station": "test" })).unwrap()["challenge"].clone();
    let question = json!({ "station": "test", "challenge": challenge, "targets": { "boom": 0.7 } });
    let refused = ask(&session, "arm", &question).unwrap_err();
    assert!(refused.contains("axis.boom: track") && refused.contains("allowed: off and not latched"), "{refused}");
    sleep(SILENCE);
    assert!(machine.boom().is_some_and(|(boom, _)| boom.operation == AxisMode::Track as u32));
}

#[test]
fn a_stop_voids_what_waits_on_its_way_and_an_emergency_stop_the_consent() {
    let mut machine = Machine::new("stops");
    let mut consent = machine.consent();
    let session = machine.session();
    let challenge = || ask(&session, "challenge", &json!({ "station": "test" })).unwrap()["challenge"].clone();
    let question = |challenge: &Value| json!({ "station": "test", "challenge": challenge, "targets": { "boom": 0.7 } });
    let before = challenge();
    // A stop that names no axis of the machine, or nothing that can be read, stops all.
    ask(&session, "disarm", &json!({ "station": "test", "axes": ["bom"] })).unwrap();
    assert!(ask(&session, "arm", &question(&before)).unwrap_err().contains("a stop was asked for since"));
    let before = challenge();
    ask(&session, "disarm", &json!("no such thing")).unwrap();
    assert!(ask(&session, "arm", &question(&before)).unwrap_err().contains("a stop was asked for since"));
    machine.expect_off();

    let station = machine.station("boom=0.7");
    machine.wait_until_it_follows();
    machine.group.command(&["disarm", "--emergency"]);
    wait_for("the end of the consent", || (!consent.is_running()).then_some(()));
    drop(station);
    machine.group.command(&["reset"]);
    machine.expect_off();
    // One that nobody uses ends with it as well, and there is one at a time.
    let mut consent = machine.consent();
    let mut second = fleet();
    second.arg("consent").arg(machine.settings()).args(["--for", "1min"]);
    let second = second.output().unwrap();
    assert!(String::from_utf8_lossy(&second.stderr).contains("another `hydraxis-fleet consent` runs"));
    machine.group.command(&["disarm", "--emergency"]);
    wait_for("the end of the consent", || (!consent.is_running()).then_some(()));
}

#[test]
fn commands_that_are_repeated_late_or_forged_arm_nothing() {
    let mut machine = Machine::new("forged");
    let _consent = machine.consent();
    let session = machine.session();
    let first = ask(&session, "challenge", &json!({ "station": "test" })).unwrap()["challenge"].clone();
    let question = json!({ "station": "test", "challenge": first, "targets": { "boom": 0.7 } });
    sleep(Duration::from_millis(600));
    assert!(ask(&session, "arm", &question).unwrap_err().contains("older than 500ms"));
    let beat = |challenge: &Value| json!({ "challenge": challenge, "targets": { "boom": 0.7 } });
    for (of, question, why) in [
        ("arm", json!({ "station": "test", "challenge": "0".repeat(32), "targets": { "boom": 0.7 } }), "not given"),
        ("arm", json!({ "station": "test", "challenge": "7", "targets": { "boom": 0.7 } }), "32 hexadecimal digits"),
        ("arm", json!({ "station": "test", "mode": "manual" }), "unknown field `mode`"),
        ("arm", json!([1]), "invalid"),
        ("challenge", json!({ "station": "a".repeat(5000) }), "bytes; allowed: 4096"),
        ("challenge", json!({ "station": "../x" }), "small letters"),
        ("beat", beat(&json!("0".repeat(32))), "until they are armed again"),
    ] {
        let refused = ask(&session, of, &question).unwrap_err();
        assert!(refused.contains(why), "{of}: {refused}");
    }
    let wide = ask_key(&session, "hydraxis/v1/quarry/*/@command/challenge", json!({ "station": "test" }).to_string());
    assert!(wide.unwrap_err().contains("allowed: hydraxis/v1/quarry/ex-07/@command/challenge"));
    assert!(machine.boom().is_none_or(|(boom, _)| is_off(&boom)));

    // A beat that is sent again and again keeps nothing.
    let challenge = arm(&session, 0.7);
    let since = monotonic_ns();
    ask(&session, "beat", &beat(&challenge)).unwrap();
    let mut refusals = 0;
    for _ in 0..20 {
        refusals += u32::from(ask(&session, "beat", &beat(&challenge)).is_err());
        sleep(Duration::from_millis(20));
    }
    assert_eq!(refusals, 20);
    wait_for("the end", || machine.texts("end").last().filter(|why| why.contains("silent")).cloned());
    assert!(Duration::from_nanos(monotonic_ns() - since) < Duration::from_secs(5));
    // A seat that is taken, and a right beat that was held up.
    let challenge = arm(&session, 0.7);
    assert!(ask(&session, "challenge", &json!({ "station": "other" })).unwrap_err().contains("\"test\" operates"));
    sleep(DEAD_MAN + Duration::from_millis(50));
    assert!(ask(&session, "beat", &beat(&challenge)).unwrap_err().contains("silent for 150ms"));
    machine.expect_off();
}

#[test]
fn without_consent_a_machine_is_only_stopped_and_without_a_journal_nothing_is_armed() {
    let mut machine = Machine::new("listens");
    let session = machine.session();
    {
        let _listen = machine.at_machine(&["listen"]);
        assert!(ask(&session, "challenge", &json!({ "station": "test" })).is_err());
        let mut local = hydraxis();
        local.args(["operate", "--prefix", &machine.group.prefix, "--axis", "boom", "--mode", "hold", "--enable"]);
        let _local = Running(local.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap());
        machine.wait_until_it_follows();
        let axes = ask(&session, "disarm", &json!({ "station": "test", "axes": ["boom"] })).unwrap();
        assert_eq!(axes["axes"]["boom"], "off (disarmed)");
        assert!(wait_for("a command", || machine.boom().filter(|(boom, _)| is_off(boom))).0.command == 0.0);
    }
    let _consent = machine.consent();
    let journal = machine.folder.path().join("journal");
    fs::remove_file(&journal).unwrap();
    fs::create_dir(&journal).unwrap();
    let challenge = ask(&session, "challenge", &json!({ "station": "test" })).unwrap()["challenge"].clone();
    let question = json!({ "station": "test", "challenge": challenge, "targets": { "boom": 0.7 } });
    let refused = ask(&session, "arm", &question).unwrap_err();
    assert!(refused.contains("journal of the machine cannot be written"), "{refused}");
    machine.expect_off();
}
