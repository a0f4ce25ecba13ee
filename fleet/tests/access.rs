//! Who may do what through a router with the rules of `examples/router.json5`, by certificates that are made here.

mod harness;

use std::{
    fs,
    path::{Path, PathBuf},
    sync::mpsc::channel,
    thread::sleep,
    time::Duration,
};

use harness::{Bridge, Plant, Router, free_port, heard::Heard, wait_for};
use hydraxis_fleet::{
    connection::{Connection, Tls},
    content::name_of,
    plant::{request::Request, simulated},
};
use pipeline::{cdr, machine::Machine, message::ValveCommand};
use rcgen::{BasicConstraints, CertificateParams, CertifiedIssuer, DnType, IsCa, KeyPair};
use zenoh::{Config, Wait, query::Query};

/// Time in which something that is not allowed would have come: what is allowed comes in milliseconds.
const SILENCE: Duration = Duration::from_secs(2);
const ASKED: &str = "hydraxis/v1/quarry/ex-07/@plant";
const SAMPLES: &str = "hydraxis/v1/quarry/ex-07/telemetry/encoder-sample";

/// An authority with the certificates that it has signed.
struct Authority {
    folder: tempfile::TempDir,
    issuer: CertifiedIssuer<'static, KeyPair>,
}

impl Authority {
    fn new() -> Self {
        let mut parameters = CertificateParams::new(Vec::new()).unwrap();
        parameters.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        parameters.distinguished_name.push(DnType::CommonName, "authority of the test");
        let issuer = CertifiedIssuer::self_signed(parameters, KeyPair::generate().unwrap()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("ca.pem"), issuer.pem()).unwrap();
        Self { folder, issuer }
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Signs a certificate with this common name.
    fn sign(&self, common_name: &str) -> Tls {
        let mut parameters = CertificateParams::new(vec!["localhost".to_owned()]).unwrap();
        parameters.distinguished_name.push(DnType::CommonName, common_name);
        let key = KeyPair::generate().unwrap();
        let certificate = parameters.signed_by(&key, &self.issuer).unwrap();
        let files = [self.file(&format!("{common_name}.pem")), self.file(&format!("{common_name}.key"))];
        fs::write(&files[0], certificate.pem()).unwrap();
        fs::write(&files[1], key.serialize_pem()).unwrap();
        let [certificate, key] = files;
        Tls { ca: self.file("ca.pem"), certificate, key }
    }
}

struct Site {
    authority: Authority,
    router: Router,
}

impl Site {
    /// The router of the example, at an address and with files of the test.
    fn new() -> Self {
        let authority = Authority::new();
        let tls = authority.sign("router");
        let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/router.json5");
        let text = fs::read_to_string(example).unwrap();
        let address = format!("tls/127.0.0.1:{}", free_port());
        let quoted = |path: &Path| format!("\"{}\"", path.display());
        let text = text
            .replace("\"tls/0.0.0.0:7447\"", &format!("\"{address}\""))
            .replace("\"ca.pem\"", &quoted(&tls.ca))
            .replace("\"router.pem\"", &quoted(&tls.certificate))
            .replace("\"router.key\"", &quoted(&tls.key));
        Self { authority, router: Router::of(&text, &address.replace("127.0.0.1", "localhost")) }
    }

    /// The table of settings for somebody with this common name.
    fn settings(&self, common_name: &str) -> String {
        let Tls { ca, certificate, key } = self.authority.sign(common_name);
        let [ca, certificate, key] = [ca, certificate, key].map(|path| path.display().to_string());
        format!("[tls]\nca = \"{ca}\"\ncertificate = \"{certificate}\"\nkey = \"{key}\"\n")
    }

    fn connection(&self, common_name: &str) -> Connection {
        Connection { router: vec![self.router.address.clone()], tls: Some(self.authority.sign(common_name)) }
    }
}

#[test]
fn a_viewer_sees_the_machine_and_asks_it() {
    let site = Site::new();
    let viewer = Heard::new(&site.connection("quarry.viewer"));
    let tls = site.settings("quarry.ex-07");
    let _bridge = Bridge::new(&site.router.address, &format!("fleet{}-none", std::process::id()), &tls);
    wait_for("the state", || (viewer.all().of("status").len() > 2).then_some(()));
    wait_for("the token", || viewer.all().machine()?.is_alive.then_some(()));
    let answers = viewer.session.get("hydraxis/v1/quarry/ex-07/status").timeout(Duration::from_secs(5)).wait().unwrap();
    let answer = answers.recv().unwrap().into_result().unwrap();
    assert!(answer.payload().try_to_string().unwrap().contains("\"machine\":\"ex-07\""));
}

/// Whether a viewer hears what somebody with this common name puts under a key.
fn is_heard(site: &Site, common_name: &str, key: &str) -> bool {
    let viewer = site.connection("quarry.viewer").open().unwrap();
    let heard = viewer.declare_subscriber("hydraxis/v1/quarry/**").wait().unwrap();
    let other = site.connection(common_name).open().unwrap();
    // What the machine itself says is heard; so the way is open by the time at which the others have spoken.
    let machine = site.connection("quarry.ex-07").open().unwrap();
    wait_for("the machine", || {
        machine.put(SAMPLES, "machine").wait().unwrap();
        heard.try_recv().unwrap()
    });
    (0..5).for_each(|_| other.put(key, "other").wait().unwrap());
    sleep(SILENCE);
    let said = std::iter::from_fn(|| heard.try_recv().unwrap());
    said.into_iter().any(|sample| sample.payload().to_bytes() == "other".as_bytes())
}

#[test]
fn only_a_machine_itself_speaks_under_its_keys() {
    let site = Site::new();
    assert!(is_heard(&site, "quarry.ex-07", SAMPLES));
    for (who, key) in [
        ("quarry.viewer", SAMPLES),
        ("quarry.viewer", "hydraxis/v1/quarry/ex-07/@command/arm"),
        ("harbour.ex-07", SAMPLES),
        ("quarry.ex-07", "hydraxis/v1/quarry/ex-08/telemetry/encoder-sample"),
    ] {
        assert!(!is_heard(&site, who, key), "{who} under {key}");
    }
}

#[test]
fn somebody_of_another_site_and_a_machine_see_no_machine() {
    let site = Site::new();
    let machine = site.connection("quarry.ex-07").open().unwrap();
    let (viewer, foreign, other) = (
        site.connection("quarry.viewer").open().unwrap(),
        site.connection("harbour.viewer").open().unwrap(),
        site.connection("quarry.ex-07").open().unwrap(),
    );
    let listen = |session: &zenoh::Session| session.declare_subscriber("hydraxis/v1/quarry/**").wait().unwrap();
    let (seen, of_foreign, of_other) = (listen(&viewer), listen(&foreign), listen(&other));
    wait_for("the viewer", || {
        machine.put(SAMPLES, "machine").wait().unwrap();
        seen.try_recv().unwrap()
    });
    (0..5).for_each(|_| machine.put(SAMPLES, "machine").wait().unwrap());
    sleep(SILENCE);
    assert!(of_foreign.try_recv().unwrap().is_none() && of_other.try_recv().unwrap().is_none());
}

#[test]
fn only_an_operator_commands_a_machine() {
    const DISARM: &str = "hydraxis/v1/quarry/ex-07/@command/disarm";
    let site = Site::new();
    let machine = site.connection("quarry.ex-07").open().unwrap();
    let asked = machine.declare_queryable("hydraxis/v1/quarry/ex-07/@command/*").wait().unwrap();
    let questions = |common_name: &str, key: &str| {
        let other = site.connection(common_name).open().unwrap();
        let answers = other.get(key).timeout(SILENCE).wait().unwrap();
        let mut questions = 0;
        while let Ok(Some(query)) = asked.recv_timeout(SILENCE) {
            questions += 1;
            query.reply(DISARM, "off").wait().unwrap();
        }
        (questions, answers.recv().is_ok_and(|answer| answer.into_result().is_ok()))
    };
    assert_eq!(questions("quarry.operator", DISARM), (1, true));
    for (who, key) in [
        ("quarry.viewer", DISARM),
        // Keys that stand for those of commands as well.
        ("quarry.viewer", "hydraxis/v1/quarry/ex-07/**"),
        ("quarry.viewer", "hydraxis/v1/quarry/ex-07/@command/*"),
        ("quarry.viewer", "hydraxis/v1/*/*/@command/disarm"),
        ("harbour.operator", DISARM),
        ("quarry.ex-08", DISARM),
        ("quarry.ex-07", DISARM),
        ("quarry.operator", "hydraxis/v1/*/ex-07/@command/disarm"),
    ] {
        assert_eq!(questions(who, key), (0, false), "{who} asks {key}");
    }
    // An operator only commands: it does not speak as the machine, and sees no telemetry.
    assert!(!is_heard(&site, "quarry.operator", SAMPLES));
    let operator = site.connection("quarry.operator").open().unwrap();
    let seen = operator.declare_subscriber("hydraxis/v1/quarry/**").wait().unwrap();
    (0..5).for_each(|_| machine.put(SAMPLES, "machine").wait().unwrap());
    sleep(SILENCE);
    assert!(seen.try_recv().unwrap().is_none());
}

/// The answers to somebody with this common name who asks for reading 0 of a plant with this seed.
fn answers(site: &Site, common_name: &str, key: &str, seed: u64) -> Vec<Result<(), String>> {
    let session = site.connection(common_name).open().unwrap();
    let request = Request { run: 1, reading: 0, seed, machine: simulated(&Machine::load(None, &[]).unwrap()) };
    let mut payload = Vec::new();
    cdr::encode(&ValveCommand::default(), &mut payload);
    let query = session.get(key).payload(payload).encoding(name_of::<ValveCommand>());
    let answers = query.attachment(&request.to_bytes()[..]).timeout(SILENCE).wait().unwrap();
    let heard = answers.iter().map(|answer| match answer.into_result() {
        Ok(_) => Ok(()),
        Err(error) => Err(error.payload().try_to_string().unwrap().into_owned()),
    });
    // That nobody has answered in time is said by Zenoh itself.
    heard.filter(|answer| answer != &Err("Timeout".to_owned())).collect()
}

#[test]
fn only_the_machine_asks_its_plant_and_only_the_plant_answers() {
    let site = Site::new();
    // Whoever has no right to be the plant is there first.
    let viewer = site.connection("quarry.viewer").open().unwrap();
    let callback = |query: Query| {
        let _ = query.reply_err("a viewer").wait();
    };
    let _false_plant = viewer.declare_queryable(ASKED).complete(true).callback(callback).wait().unwrap();
    assert_eq!(answers(&site, "quarry.ex-07", ASKED, 7), []);

    let plant = Plant::new(&site.router.address, &site.settings("quarry.ex-07.plant"), &[]);
    for who in ["quarry.viewer", "quarry.ex-07.plant", "quarry.ex-08", "harbour.ex-07"] {
        for key in [ASKED, "hydraxis/v1/quarry/ex-07/**", "hydraxis/v1/quarry/*/@plant", "hydraxis/v1/**"] {
            assert_eq!(answers(&site, who, key, 7), [], "{who} asks {key}");
        }
    }
    assert!(!plant.said().contains("has begun"), "{}", plant.said());
    let refused = answers(&site, "quarry.ex-07", ASKED, 8);
    let refusal = refused[0].as_ref().unwrap_err();
    assert!(refusal.starts_with("found seed 8, where the plant has seed 7; "), "{refusal}");
    assert_eq!(answers(&site, "quarry.ex-07", ASKED, 7), [Ok(())]);
}

/// Whether somebody with these files of TLS gets a connection.
fn is_connected(address: &str, ca: &Path, own: Option<&Tls>) -> bool {
    let mut tls = serde_json::json!({ "root_ca_certificate": ca, "enable_mtls": own.is_some() });
    if let Some(own) = own {
        tls["connect_certificate"] = own.certificate.display().to_string().into();
        tls["connect_private_key"] = own.key.display().to_string().into();
    }
    let config = serde_json::json!({
        "mode": "client",
        "connect": { "endpoints": [address], "timeout_ms": 0, "exit_on_failure": true },
        "scouting": { "multicast": { "enabled": false } },
        "transport": { "link": { "tls": tls } },
    });
    let config = Config::from_json5(&config.to_string()).unwrap();
    let (said, heard) = channel();
    // A try may hang in its handshake.
    std::thread::spawn(move || said.send(zenoh::open(config).wait().is_ok()));
    heard.recv_timeout(Duration::from_secs(15)).unwrap_or(false)
}

#[test]
fn nobody_without_a_certificate_of_the_authority_gets_a_connection() {
    let site = Site::new();
    let (address, ca) = (&site.router.address, site.authority.file("ca.pem"));
    assert!(is_connected(address, &ca, Some(&site.authority.sign("quarry.viewer"))));
    assert!(!is_connected(address, &ca, None), "no certificate");
    let other = Authority::new();
    assert!(!is_connected(address, &ca, Some(&other.sign("quarry.viewer"))), "of another authority");
    // A router that another authority has signed is no router of this site.
    assert!(!is_connected(address, &other.file("ca.pem"), Some(&site.authority.sign("quarry.viewer"))));
}
