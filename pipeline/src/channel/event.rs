//! Events: they wake a stage that sleeps instead of polling, because other stages share its core.

use std::time::Duration;

use iceoryx2::port::{
    listener::{Listener as ListenerPort, ListenerWaitError},
    notifier::Notifier as NotifierPort,
};

use super::{
    error::{NotifyError, WaitError},
    service::Service,
};

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
    /// iceoryx2 refuses the event; this does not happen within the limits of the channel.
    pub fn notify(&self) -> Result<(), NotifyError> {
        self.port.notify().map(|_| ()).map_err(|source| NotifyError { channel: self.channel, source })
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
    /// iceoryx2 cannot wait. A signal is no error; it ends the wait.
    pub fn wait(&self, longest: Duration) -> Result<(), WaitError> {
        match self.port.timed_wait(|_| {}, longest) {
            Ok(_) | Err(ListenerWaitError::InterruptSignal) => Ok(()),
            Err(source) => Err(WaitError { channel: self.channel, source }),
        }
    }
}
