//! Events: how a stage that shares its core is woken instead of polling.

use std::time::Duration;

use iceoryx2::port::{
    listener::{Listener, ListenerWaitError},
    notifier::Notifier,
};

use super::{ChannelError, service::Service};

/// Wakes whoever listens on a channel.
pub struct Bell {
    notifier: Notifier<Service>,
    channel: &'static str,
}

impl Bell {
    pub(super) fn new(notifier: Notifier<Service>, channel: &'static str) -> Self {
        Self { notifier, channel }
    }

    /// Wakes all listeners; does not wait for them.
    ///
    /// # Errors
    /// The library refuses the event: not possible within the limits of the channel.
    pub fn ring(&self) -> Result<(), ChannelError> {
        let refuse = |reason| ChannelError::Send { channel: self.channel, reason };
        self.notifier.notify().map(|_| ()).map_err(|error| refuse(format!("{error:?}")))
    }
}

/// Waits for a [`Bell`].
pub struct Ear {
    listener: Listener<Service>,
    channel: &'static str,
}

impl Ear {
    pub(super) fn new(listener: Listener<Service>, channel: &'static str) -> Self {
        Self { listener, channel }
    }

    /// Sleeps until the bell has rung since the last wait, at most for `longest`.
    ///
    /// # Errors
    /// The library cannot wait. A signal is no error; it ends the wait.
    pub fn wait(&self, longest: Duration) -> Result<(), ChannelError> {
        match self.listener.timed_wait(|_| {}, longest) {
            Ok(_) | Err(ListenerWaitError::InterruptSignal) => Ok(()),
            Err(error) => Err(ChannelError::Receive { channel: self.channel, reason: format!("{error:?}") }),
        }
    }
}
