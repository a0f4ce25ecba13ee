//! Says when a valve opens, and when it is neutral again after a fault.

use pipeline::MAX_AXES;

use super::devices::Devices;

/// What the valves did when they were looked at last.
pub struct Watch {
    begun_ns: u64,
    /// When the last fault was injected, ns.
    fault_ns: Option<u64>,
    is_open: [bool; MAX_AXES],
}

impl Watch {
    /// All valves are neutral at this time, ns.
    pub fn new(now_ns: u64) -> Self {
        Self { begun_ns: now_ns, fault_ns: None, is_open: [false; MAX_AXES] }
    }

    /// A fault was injected.
    pub fn note_fault(&mut self, fault: &str, now_ns: u64) {
        self.fault_ns = Some(now_ns);
        eprintln!("{:.3} s {fault}", self.seconds(now_ns));
    }

    /// Says which valves have opened or closed since the last look.
    pub fn look(&mut self, devices: &Devices, now_ns: u64) {
        let time = self.seconds(now_ns);
        for ((was_open, opening), name) in self.is_open.iter_mut().zip(devices.openings()).zip(devices.names()) {
            match (std::mem::replace(was_open, opening != 0.0), opening != 0.0, self.fault_ns) {
                (false, true, _) => eprintln!("{time:.3} s {name}.valve: open"),
                (true, false, Some(fault_ns)) => {
                    let after_ms = (now_ns - fault_ns) as f64 * 1e-6;
                    eprintln!("{time:.3} s {name}.valve: neutral, {after_ms:.0} ms after the last line");
                }
                (true, false, None) => eprintln!("{time:.3} s {name}.valve: neutral"),
                _ => {}
            }
        }
    }

    fn seconds(&self, now_ns: u64) -> f64 {
        (now_ns - self.begun_ns) as f64 * 1e-9
    }
}
