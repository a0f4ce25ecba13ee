//! Gains of a running group that are changed from the page: within their range, while the axis is off, and for as long
//! as the controller lives.

use pipeline::{
    channel::{Group, Reader},
    message::{MachineState, ValveCommand, control_flag},
};
use rustix::process::Signal;
use serde_json::json;

use super::control::Operated;
use crate::harness::{shared, signal, wait_for};

/// The built-in machine with its model: only the gains of a commissioned axis may be changed.
const MACHINE: [&str; 3] = [
    concat!(env!("CARGO_MANIFEST_DIR"), "/examples/excavator.toml"),
    "--model",
    concat!(env!("CARGO_MANIFEST_DIR"), "/examples/excavator-model.toml"),
];

#[test]
fn gains_are_changed_within_their_range_while_the_axis_is_off() {
    let _cores = shared();
    let mut operated = Operated::start_with("control-gains", &MACHINE);
    let server = operated.address;
    let channels: Group = operated.running.group.join();
    let mut states: Reader<MachineState> = channels.reader().unwrap();
    let [least, largest] = wait_for("the range of the gains", || {
        states.newest().unwrap();
        states.last().map(|state| state.axes[0].gain_range).filter(|range| range[0] < 1.0)
    });
    // The monitor gets the range with a state of the axes.
    wait_for("gains of 0.5", || {
        let (status, said) = operated.say(server, "gain", &json!({"axis": "boom", "gain": 0.5}));
        (status == 200 && said["gain"] == 0.5).then_some(())
    });
    let gains = |command: ValveCommand| [0, 1, 2, 3].map(|axis| command.axes[axis].gain);
    assert_eq!(gains(operated.newest()), [0.5, 1.0, 1.0, 1.0], "only the boom");
    for (expected, body) in [
        (422, json!({"axis": "boom", "gain": 0.999 * least})),
        (422, json!({"axis": "boom", "gain": 1.001 * largest})),
        (422, json!({"axis": "boom", "gain": 0.0})),
        (422, json!({"axis": "nose", "gain": 0.5})),
        (400, json!({"axis": "boom", "gain": "1"})),
        (400, json!({"axis": "boom", "gain": 1.0, "kp": 3.0})),
        (400, json!({})),
    ] {
        let (status, said) = operated.say(server, "gain", &body);
        assert_eq!(status, expected, "{body}: {said}");
    }
    assert_eq!(operated.ask(server, "gain", &json!({"axis": "boom", "gain": 1.0}), None).0, 403, "without the token");
    assert_eq!(gains(operated.newest())[0], 0.5);

    // The axis is armed with them.
    let id = operated.hold(server);
    assert_eq!(gains(operated.newest())[0], 0.5);
    operated.say(server, "release", &json!({"hold": id}));
    wait_for("the boom to be off", || {
        let boom = operated.newest().axes[0];
        (boom.flags & control_flag::DISARMED != 0).then(|| assert_eq!(boom.gain, 0.5))
    });

    // A controller that starts again has the gains of the machine file.
    signal(operated.running.pids[3], Signal::KILL);
    wait_for("the gains of the machine file", || (operated.newest().axes[0].gain == 1.0).then_some(()));
    assert_ne!(operated.newest().axes[0].flags & control_flag::DISARMED, 0);
}
