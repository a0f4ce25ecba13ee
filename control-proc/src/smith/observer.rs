//! Where the axis is, and where it will be when a command of now has acted, by the commissioned model.
//!
//! ```text
//! x(k)   = w(k) + exp(-T/tau) (x(k-1) - w(k))          v(k) = c(x(k))          Y(k) = Y(k-1) + T v(k)
//! y_e(k) = y_e(k-1) + Y(k-n) - Y(k-n-1) + T d(k-1)     as expected
//! r(k)   = y(k) - y_e(k),   y_e(k) += (1 - b^2) r(k),   d(k) = d(k-1) + (1 - b)^2 r(k)/T          b = exp(-T/T_o)
//! y_p(k) = y_e(k) + Y(k) - Y(k-n) + tau v(k) + (t_d + tau) d(k)
//! ```
//!
//! y measured position in m, w acting command behind the play of the hysteresis ([`Play`]), c static curve in m/s, n =
//! t_d/T dead time in ticks with straight lines between the ticks, tau time constant in s, T period in s; d speed in
//! m/s that the model does not explain, T_o time constant of the observer in s. Both poles of the observer are b.

use pipeline::{
    hammerstein::{MAX_DELAY, Play},
    machine::Commissioned,
};

/// The observer of one axis.
#[derive(Debug, Clone)]
pub struct Observer {
    model: Commissioned,
    period: f64,
    /// exp(-T/tau).
    kept: f64,
    /// b.
    pole: f64,
    play: Play,
    x: f64,
    /// v.
    speed: f64,
    /// Y of the last ticks, a ring.
    ways: Vec<f64>,
    /// Index of the newest of them.
    newest: usize,
    /// y_e; none before the first position.
    position: Option<f64>,
    /// d.
    unexplained: f64,
}

impl Observer {
    /// By `model`, with T_o of `time` s; `period` in s.
    pub fn new(model: &Commissioned, time: f64, period: f64) -> Self {
        let dead_ticks = ((model.dead_time / period) as usize).min(MAX_DELAY);
        Self {
            model: model.clone(),
            period,
            kept: if model.time_constant > 0.0 { (-period / model.time_constant).exp() } else { 0.0 },
            pole: (-period / time).exp(),
            play: Play::new(model.hysteresis),
            x: 0.0,
            speed: 0.0,
            ways: vec![0.0; dead_ticks + 3],
            newest: 0,
            position: None,
            unexplained: 0.0,
        }
    }

    /// Forgets the past: the axis stands, and the spool is in the middle.
    pub fn reset(&mut self) {
        self.play = Play::new(self.model.hysteresis);
        self.ways.fill(0.0);
        (self.x, self.speed, self.position, self.unexplained) = (0.0, 0.0, None, 0.0);
    }

    /// Takes in a position in m, `elapsed` ticks after the last one; `command` has been on the valve since.
    pub fn update(&mut self, elapsed: u64, position: f64, command: f64) {
        // After a gap that is longer than what the ring holds the model has come to a steady speed.
        for _ in 0..elapsed.clamp(1, self.ways.len() as u64) {
            self.advance(command);
        }
        let expected = self.position.unwrap_or(position);
        let residual = position - expected;
        self.position = Some(expected + (1.0 - self.pole * self.pole) * residual);
        self.unexplained += (1.0 - self.pole).powi(2) * residual / self.period;
    }

    /// y_p, m; none before the first position.
    pub fn predicted(&self) -> Option<f64> {
        let underway = self.ways[self.newest] - self.delayed();
        let coming = self.model.time_constant * self.speed + self.model.reaction() * self.unexplained;
        Some(self.position? + underway + coming)
    }

    /// A tick of the model with `command` on the valve.
    fn advance(&mut self, command: f64) {
        let acting = self.play.acting(command);
        self.x = acting + self.kept * (self.x - acting);
        self.speed = self.model.speed(self.x);
        let before = self.delayed();
        let way = self.ways[self.newest] + self.period * self.speed;
        self.newest = (self.newest + 1) % self.ways.len();
        self.ways[self.newest] = way;
        let moved = self.delayed() - before;
        if let Some(position) = &mut self.position {
            *position += moved + self.period * self.unexplained;
        }
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
