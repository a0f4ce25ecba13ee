//! Supervision: a model that follows worse than the fallback would loses control.
//!
//! ```text
//! E <- E + (1 - exp(-n T/tau)) (e^2 - E)        V <- V + (1 - exp(-n T/tau)) (v_r^2 - V)
//! while the fallback controls     tau = 30 s,  means so far before that
//! while the model controls        tau = max(1 s, 3 (t_d + tau_l))/2,  the same
//! worse       E_m > 4 E_f max(V_m/V_f, 1) + e_0^2       after 2 tau of control, while the command is not at its limit
//! cautious    from the first time on, until the axis begins to follow anew
//! distrusted  from the second time on: for 5 s, and for twice as long each time, 80 s at most; or until the fallback
//!             has E_f >= E_m of then with V_f <= V_m of then
//! ```
//!
//! e following error m, v_r speed of the reference m/s, n ticks since the last look, T period s; t_d dead time and
//! tau_l time constant of the commissioned model s; e_0 1 mm or 4 counts, whichever is more; index f fallback, m model.
//! The error of the fallback is predicted from what it was, in proportion to the speed of the reference where that is
//! higher. 4 is twice the error. A cautious model controls without what was learned online, where its law can do that.
//!
//! While the reference stands, errors of more than twice what the fallback has in all count. So a loop that swings far
//! about a set point loses control, too.
//!
//! When the model loses control, the errors of the fallback are counted anew: the machine may have changed, and the
//! fallback with it. One that turns out to be no better gives control back.
//!
//! Trap: [`super::trust`] alone acts on errors of centimetres. A model can be five times worse than the fallback and
//! never reach them.

use crate::protection::following_error::Deviation;

/// Memory of the errors of the fallback, s.
const MEMORY: f64 = 30.0;
/// Least time over which the errors of the model count, s, and the same in reactions of the axis.
const LEAST_WINDOW: f64 = 1.0;
const REACTIONS: f64 = 3.0;
/// Mean square of the error that is worse, in parts of what the fallback has.
const WORSE: f64 = 4.0;
/// e_0 in m and in counts.
const FLOOR: f64 = 1e-3;
const FLOOR_COUNTS: f64 = 4.0;
/// First and longest time of distrust, s.
const DISTRUST: (f64, f64) = (5.0, 80.0);

/// What the supervision says of a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Confidence {
    /// The model may control.
    Full,
    /// The model may control with what was commissioned.
    Cautious,
    /// The fallback controls.
    None,
}

/// Means or sums of squares.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Squares {
    /// Of the error, m2.
    error: f64,
    /// Of the speed of the reference, m2/s2.
    speed: f64,
    /// Time that they are of, s.
    time: f64,
}

impl Squares {
    fn push(&mut self, deviation: &Deviation, time: f64, memory: f64) {
        // Before the memory is full these are the means so far.
        let part = (1.0 - (-time / memory).exp()).max(time / (self.time + time));
        self.error += part * (deviation.error * deviation.error - self.error);
        self.speed += part * (deviation.speed * deviation.speed - self.speed);
        self.time += time;
    }
}

/// The supervision of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Supervision {
    period: f64,
    /// tau of the model, s.
    memory: f64,
    /// e_0^2.
    floor: f64,
    fallback: Squares,
    model: Squares,
    /// Those of the model when it lost control.
    lost: Squares,
    /// Times that the model was worse since the axis began to follow.
    times: u32,
    /// Time for which the model is still distrusted, s.
    distrusted: f64,
}

impl Supervision {
    /// Of an axis with this reaction in s and count of the encoder in m, looked at every `period` s.
    pub fn new(reaction: f64, resolution: f64, period: f64) -> Self {
        Self {
            period,
            memory: 0.5 * LEAST_WINDOW.max(REACTIONS * reaction),
            floor: FLOOR.max(FLOOR_COUNTS * resolution).powi(2),
            fallback: Squares::default(),
            model: Squares::default(),
            lost: Squares::default(),
            times: 0,
            distrusted: 0.0,
        }
    }

    /// Forgets all: the axis begins to follow.
    pub fn reset(&mut self) {
        (self.fallback, self.model) = Default::default();
        (self.times, self.distrusted) = (0, 0.0);
    }

    /// Whether the model may control at this tick. `by_model`: it made the last command. `at_limit`: the last command
    /// was at its limit.
    pub fn update(&mut self, deviation: &Deviation, by_model: bool, at_limit: bool) -> Confidence {
        let time = deviation.elapsed as f64 * self.period;
        self.distrusted = (self.distrusted - time).max(0.0);
        if !by_model {
            self.fallback.push(deviation, time, MEMORY);
            self.model = Squares::default();
            if self.is_no_better() {
                self.distrusted = 0.0;
            }
        } else if !at_limit {
            self.model.push(deviation, time, self.memory);
        }
        if self.is_worse() {
            self.note();
        }
        self.confidence()
    }

    /// What the last tick said.
    pub fn confidence(&self) -> Confidence {
        match self.times {
            _ if self.distrusted > 0.0 => Confidence::None,
            0 => Confidence::Full,
            _ => Confidence::Cautious,
        }
    }

    fn is_worse(&self) -> bool {
        let Squares { error, speed, time } = self.model;
        // A fallback that has never been seen at a speed says nothing about speeds: then this is infinite or NaN.
        let faster = (speed / self.fallback.speed).max(1.0);
        time > 2.0 * self.memory && error > WORSE * self.fallback.error * faster + self.floor
    }

    /// Whether the fallback follows no better than the model that lost control.
    fn is_no_better(&self) -> bool {
        let Squares { error, speed, time } = self.fallback;
        self.distrusted > 0.0 && time > 2.0 * self.memory && error >= self.lost.error && speed <= self.lost.speed
    }

    fn note(&mut self) {
        let model = std::mem::take(&mut self.model);
        if self.times > 0 {
            (self.lost, self.fallback) = (model, Squares::default());
            let doubled = DISTRUST.0 * f64::from(1 << (self.times - 1).min(4));
            self.distrusted = doubled.min(DISTRUST.1);
        }
        self.times = self.times.saturating_add(1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: f64 = 0.01;

    fn at(error: f64, speed: f64) -> Deviation {
        Deviation { elapsed: 1, error, speed }
    }

    /// After 8 s of the fallback, with 2 mm of error at 0.1 m/s.
    fn supervision() -> Supervision {
        let mut supervision = Supervision::new(0.05, 1e-5, PERIOD);
        (0..800).for_each(|_| assert_eq!(supervision.update(&at(2e-3, 0.1), false, false), Confidence::Full));
        supervision
    }

    /// Confidence in a model with this error at each tick, as (seconds, confidence) of the changes.
    fn changes(supervision: &mut Supervision, ticks: usize, speed: f64, error: f64) -> Vec<(f64, Confidence)> {
        let mut by_model = true;
        let mut changes = vec![(0.0, Confidence::Full)];
        for tick in 0..ticks {
            // The fallback goes on as it was.
            let error = if by_model { error } else { 2e-3 };
            let confidence = supervision.update(&at(error, speed), by_model, false);
            by_model = confidence != Confidence::None;
            if confidence != changes[changes.len() - 1].1 {
                changes.push((tick as f64 * PERIOD, confidence));
            }
        }
        changes
    }

    #[test]
    fn a_model_that_is_worse_becomes_cautious_and_then_loses_control_within_two_seconds_each() {
        let changes = changes(&mut supervision(), 3000, 0.1, 5e-3);
        assert_eq!(changes[1].1, Confidence::Cautious);
        assert_eq!(changes[2].1, Confidence::None);
        assert!(changes[1].0 < 2.0 && changes[2].0 < 4.0, "{changes:?}");
        // Then 5 s, 10 s of the fallback.
        assert!((changes[3].0 - changes[2].0 - 5.0).abs() < 0.05, "{changes:?}");
        assert!((changes[5].0 - changes[4].0 - 10.0).abs() < 0.05, "{changes:?}");
    }

    #[test]
    fn a_model_that_is_no_worse_than_twice_keeps_control() {
        assert_eq!(changes(&mut supervision(), 3000, 0.1, 3.9e-3).len(), 1);
        // Below the floor nothing counts.
        assert_eq!(changes(&mut supervision(), 3000, 0.0, 0.9e-3).len(), 1);
    }

    #[test]
    fn a_fallback_that_is_no_better_gives_control_back_and_is_the_new_measure() {
        let mut supervision = supervision();
        let mut lost = 0;
        let mut by_model = true;
        for _ in 0..6000 {
            let error = if by_model { 5e-3 } else { 8e-3 };
            let before = by_model;
            by_model = supervision.update(&at(error, 0.1), by_model, false) != Confidence::None;
            lost += u32::from(before && !by_model);
        }
        assert!(lost == 1 && by_model, "{lost}");
    }

    #[test]
    fn a_swing_about_a_set_point_loses_control() {
        assert_eq!(changes(&mut supervision(), 1000, 0.0, 5e-3).last().map(|(_, last)| *last), Some(Confidence::None));
    }

    #[test]
    fn a_command_at_its_limit_and_a_fallback_that_never_moved_say_nothing() {
        let mut limited = supervision();
        assert!((0..3000).all(|_| limited.update(&at(0.02, 0.1), true, true) == Confidence::Full));
        let mut unknown = Supervision::new(0.05, 1e-5, PERIOD);
        assert!((0..3000).all(|_| unknown.update(&at(0.02, 0.1), true, false) == Confidence::Full));
    }

    #[test]
    fn time_counts_not_looks() {
        let mut supervision = supervision();
        let gap = Deviation { elapsed: 20, ..at(5e-3, 0.1) };
        let looks = (0..100).take_while(|_| supervision.update(&gap, true, false) == Confidence::Full).count();
        assert!((4..=9).contains(&looks), "{looks}");
    }
}
