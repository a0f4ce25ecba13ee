//! Events: how a stage that shares its core is woken instead of polling.

use std::time::Duration;

use iceoryx2::port::{
    listener::{Listener as ListenerPort, ListenerWaitError},
    notifier::Notifier as NotifierPort,
};

use super::{ChannelError, service::Service};

/// Wakes all listeners of a channel.
pub struct Notifier {
    port: NotifierPort<Service>,
    channel: &'static str,
}

impl Notifier {
    pub(super) fn new(port: NotifierPort<Service>, channel: &'static str) -> Self {
        Self { port, channel }
    }

    /// Wakes all listeners; does not wait for them.
    ///
    /// # Errors
    /// The library refuses the event: not possible within the limits of the channel.
    pub fn notify(&self) -> Result<(), ChannelError> {
        let refuse = |reason| ChannelError::Send { channel: self.channel, reason };
        self.port.notify().map(|_| ()).map_err(|error| refuse(format!("{error:?}")))
    }
}

/// Waits for a [`Notifier`].
pub struct Listener {
    port: ListenerPort<Service>,
    channel: &'static str,
}

impl Listener {
    pub(super) fn new(port: ListenerPort<Service>, channel: &'static str) -> Self {
        Self { port, channel }
    }

    /// Sleeps until a notifier of the channel has notified since the last wait, at most for `longest`.
    ///
    /// # Errors
    /// The library cannot wait. A signal is no error; it ends the wait.
    pub fn wait(&self, longest: Duration) -> Result<(), ChannelError> {
        match self.port.timed_wait(|_| {}, longest) {
            Ok(_) | Err(ListenerWaitError::InterruptSignal) => Ok(()),
            Err(error) => Err(ChannelError::Receive { channel: self.channel, reason: format!("{error:?}") }),
        }
    }
}
