//! Whether a group goes on, for whoever watches it from outside: all of its stages say that they have stopped, or
//! nobody says anything any more. Not for a stage's loop: it reads files.
//!
//! Trap: while a client is in a dead group, nobody can start a group of that name. So a group that is silent for only a
//! moment is left as soon as neither a stage nor its supervisor is in it. And a client that was suspended has not read
//! for as long, which says nothing about the group: between two looks a second of silence counts at most.

use std::time::{Duration, Instant};

use crate::{
    channel::Group,
    machine::StageKind,
    message::{StageHealth, StageState},
};

/// Name of the supervisor among the members of a group.
pub const SUPERVISOR: &str = "supervisor";
/// A group without a heartbeat for so long has ended.
const SILENCE: Duration = Duration::from_secs(3);
/// A group without a heartbeat for so long has ended if none of its stages and no supervisor is left.
const DOUBT: Duration = Duration::from_millis(300);
/// Most silence that counts between two looks.
const BETWEEN_LOOKS: Duration = Duration::from_secs(1);

/// What the heartbeats of a group say about its end.
#[derive(Debug, Clone)]
pub struct Life {
    looked: Instant,
    /// Time since the last heartbeat, as far as it counts.
    silence: Duration,
    /// What each stage said last that it does, a [`StageState`] as number; none before its first heartbeat.
    states: [Option<u32>; StageKind::ALL.len()],
}

impl Life {
    /// Of a group that was joined just now.
    pub fn begin() -> Self {
        Self { looked: Instant::now(), silence: Duration::ZERO, states: [None; StageKind::ALL.len()] }
    }

    /// Takes in a heartbeat.
    pub fn hear(&mut self, health: &StageHealth) {
        (self.looked, self.silence) = (Instant::now(), Duration::ZERO);
        if let Some(state) = self.states.get_mut(health.stage as usize) {
            *state = Some(health.state);
        }
    }

    /// Time since the last heartbeat, as far as it counts.
    pub fn silence(&self) -> Duration {
        self.silence_at(Instant::now())
    }

    fn silence_at(&self, now: Instant) -> Duration {
        self.silence + now.saturating_duration_since(self.looked).min(BETWEEN_LOOKS)
    }

    /// Whether the group has ended.
    pub fn is_over(&mut self, group: &Group) -> bool {
        let silence = self.look(Instant::now());
        self.have_stopped() || silence > SILENCE || (silence > DOUBT && is_deserted(group))
    }

    /// Counts the silence up to `now`, and returns it.
    fn look(&mut self, now: Instant) -> Duration {
        (self.silence, self.looked) = (self.silence_at(now), now);
        self.silence
    }

    /// Whether all stages that were heard have stopped.
    fn have_stopped(&self) -> bool {
        let mut known = self.states.iter().flatten().peekable();
        known.peek().is_some() && known.all(|state| *state == StageState::Stopped as u32)
    }
}

/// Whether no stage and no supervisor is in the group.
fn is_deserted(group: &Group) -> bool {
    let works = |name: &str| name == SUPERVISOR || StageKind::ALL.iter().any(|kind| kind.name() == name);
    !group.members().iter().any(|member| member.is_alive && works(&member.name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_in_which_a_client_was_suspended_is_no_silence_of_the_group() {
        let mut life = Life::begin();
        let begun = life.looked;
        assert!(life.look(begun + Duration::from_secs(60)) < SILENCE);
        let mut life = Life::begin();
        let silences = (1..=40).map(|i| life.look(begun + i * Duration::from_millis(100)));
        let silence = silences.last().unwrap();
        assert!(silence > SILENCE && silence <= Duration::from_secs(4), "{silence:?}");
    }

    #[test]
    fn a_group_has_stopped_when_all_stages_that_were_heard_say_so() {
        let mut life = Life::begin();
        assert!(!life.have_stopped(), "nobody was heard");
        let mut hear = |stage: u32, state: StageState| {
            life.hear(&StageHealth { stage, state: state as u32, ..StageHealth::default() });
            life.have_stopped()
        };
        assert!(!hear(0, StageState::Running));
        assert!(!hear(2, StageState::Stopped));
        assert!(hear(0, StageState::Stopped));
        assert!(hear(9, StageState::Running), "no such stage");
    }
}
