//! The motion that the commissioned model expects of the commands.
//!
//! ```text
//! x(k) = w(k) + exp(-T/tau) (x(k-1) - w(k))          v(k) = g c(x(k))          Y(k) = Y(k-1) + T v(k)
//! ```
//!
//! w acting command behind the play of the hysteresis ([`Play`]), c static curve in m/s, g what the load makes of it
//! ([`Load`]), tau time constant in s, T period in s. The axis has made the way Y(k-n) m after tick k; n = t_d/T dead
//! time in ticks, with straight lines between the ticks.

use pipeline::{
    hammerstein::{MAX_DELAY, Play},
    machine::Commissioned,
};

use crate::load::Load;

/// The expected motion of one axis.
#[derive(Debug, Clone)]
pub struct ExpectedMotion {
    model: Commissioned,
    period: f64,
    /// exp(-T/tau).
    kept: f64,
    play: Play,
    load: Load,
    x: f64,
    /// v.
    speed: f64,
    /// Y of the last ticks, a ring.
    ways: Vec<f64>,
    /// Index of the newest of them.
    newest: usize,
}

impl ExpectedMotion {
    /// By `model`, of an axis that stands with the spool in the middle; `period` in s.
    pub fn new(model: &Commissioned, period: f64) -> Self {
        let dead_ticks = ((model.dead_time / period) as usize).min(MAX_DELAY);
        Self {
            model: model.clone(),
            period,
            kept: if model.time_constant > 0.0 { (-period / model.time_constant).exp() } else { 0.0 },
            play: Play::new(model.hysteresis),
            load: Load::USUAL,
            x: 0.0,
            speed: 0.0,
            ways: vec![0.0; dead_ticks + 3],
            newest: 0,
        }
    }

    /// The axis bears this load from now on.
    pub fn bear(&mut self, load: Load) {
        self.load = load;
    }

    /// The axis stands, with the spool in the middle.
    pub fn reset(&mut self) {
        self.play = Play::new(self.model.hysteresis);
        self.ways.fill(0.0);
        (self.x, self.speed) = (0.0, 0.0);
    }

    /// Goes on from where `other` is, which has the same model.
    pub fn follow(&mut self, other: &Self) {
        (self.play, self.x, self.speed, self.newest) = (other.play, other.x, other.speed, other.newest);
        self.ways.copy_from_slice(&other.ways);
    }

    /// The way of `elapsed` ticks with `command` on the valve, m. After a gap that is longer than dead time and three
    /// ticks the model has come to a steady speed.
    pub fn advance(&mut self, elapsed: u64, command: f64) -> f64 {
        let before = self.delayed();
        for _ in 0..elapsed.clamp(1, self.ways.len() as u64) {
            let acting = self.play.acting(command);
            self.x = acting + self.kept * (self.x - acting);
            self.speed = self.load.faster(self.x) * self.model.speed(self.x);
            let way = self.ways[self.newest] + self.period * self.speed;
            self.newest = (self.newest + 1) % self.ways.len();
            self.ways[self.newest] = way;
        }
        self.delayed() - before
    }

    /// What the commands so far still move the axis by, m, before the lag is over.
    pub fn underway(&self) -> f64 {
        self.ways[self.newest] - self.delayed()
    }

    /// v, m/s.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// The commissioned model.
    pub fn model(&self) -> &Commissioned {
        &self.model
    }

    /// Y(k-n).
    fn delayed(&self) -> f64 {
        let (count, ticks) = (self.ways.len(), self.model.dead_time / self.period);
        let whole = (ticks as usize).min(count - 3);
        let part = (ticks - whole as f64).min(1.0);
        let ago = |ticks: usize| self.ways[(self.newest + count - ticks) % count];
        (1.0 - part) * ago(whole) + part * ago(whole + 1)
    }
}
