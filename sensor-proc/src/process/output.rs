//! The samples of either source on their way out.

use pipeline::{
    channel::{Group, Notifier, Publisher},
    message::EncoderSample,
    stage::{Clock, StageError, Turn},
};

use crate::acquisition::is_implausible;

/// Publisher of the samples, and the notifier that wakes the stages that sleep.
pub struct Output {
    samples: Publisher<EncoderSample>,
    /// In real time only.
    notifier: Option<Notifier>,
}

impl Output {
    /// Joins the channel of the samples.
    ///
    /// # Errors
    /// The channel or its event cannot be used.
    pub fn new(group: &Group, clock: Clock) -> Result<Self, StageError> {
        let notifier = if clock == Clock::RealTime { Some(group.notifier::<EncoderSample>()?) } else { None };
        Ok(Self { samples: group.publisher()?, notifier })
    }

    /// Counts an implausible sample, completes the header, and sends. The sample was acquired at `acquired_ns` and was
    /// due at `due_ns`.
    ///
    /// # Errors
    /// The sample cannot be sent, or the notification fails.
    pub fn send(
        &self,
        turn: &mut Turn,
        sample: &mut EncoderSample,
        acquired_ns: u64,
        due_ns: u64,
    ) -> Result<(), StageError> {
        if is_implausible(sample) {
            turn.implausible();
        }
        let sequence = sample.header.sequence;
        turn.finish(&mut sample.header, sequence, acquired_ns, due_ns);
        self.samples.send(sample)?;
        if let Some(notifier) = &self.notifier {
            notifier.notify()?;
        }
        Ok(())
    }

    /// Hands the newest sample to readers that have joined since it was sent.
    pub fn greet(&self) {
        self.samples.greet();
    }
}
