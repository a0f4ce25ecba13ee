//! A small axis: dead band, dead time, first-order valve, integrator.
//!
//! ```text
//! q(k) = 0.8 q(k-1) + 0.2 N_d(u(k-5))        y(k) = y(k-1) + 0.6 m/s * 10 ms * q(k)
//! ```
//!
//! q spool position, u command, y position in m. N_d subtracts the dead band from the command.

pub struct Actuator {
    pub position: f64,
    dead_band: f64,
    spool: f64,
    underway: [f64; 5],
}

impl Actuator {
    pub fn new(position: f64, dead_band: f64) -> Self {
        Self { position, dead_band, spool: 0.0, underway: [0.0; 5] }
    }

    /// From y(k) and u(k) to y(k+1).
    pub fn step(&mut self, command: f64) {
        self.underway.rotate_right(1);
        self.underway[0] = command;
        let delayed = self.underway[4];
        let open = (delayed.abs() - self.dead_band).max(0.0).copysign(delayed);
        self.spool = 0.8 * self.spool + 0.2 * open;
        self.position += 0.6 * 0.01 * self.spool;
    }
}
