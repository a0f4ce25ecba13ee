//! Messages to the service manager: READY, STATUS, WATCHDOG and STOPPING, by the protocol of `sd_notify(3)`.
//!
//! Without `NOTIFY_SOCKET` in the environment nothing is sent. A thread of its own sends, so that the supervisor never
//! waits for a service manager that does not read. Messages that do not fit into the queue are dropped.
//!
//! Trap: a watchdog that a timer feeds only shows that the timer works. This watchdog is fed after fresh heartbeats of
//! all stages have been seen.

use std::{
    sync::mpsc::{SyncSender, sync_channel},
    thread::{JoinHandle, sleep},
    time::{Duration, Instant},
};

use sd_notify::NotifyState;

/// Messages that may wait for the service manager.
const QUEUE: usize = 16;
/// Messages to the watchdog within the time after which the service manager would act.
const FEEDS: u32 = 4;
/// Time in which the last message must be sent.
const CLOSING: Duration = Duration::from_millis(200);

/// A message that waits to be sent.
enum Message {
    Ready,
    Status(String),
    Watchdog,
    Stopping,
}

/// The connection to the service manager, if there is one.
pub struct ServiceManager {
    queue: Option<SyncSender<Message>>,
    sender: Option<JoinHandle<()>>,
    /// Period of the messages to the watchdog, and when the next one is due.
    feed: Option<(Duration, Instant)>,
    is_ready: bool,
}

impl ServiceManager {
    /// Connects as the environment says.
    pub fn new() -> Self {
        let mut manager = Self { queue: None, sender: None, feed: None, is_ready: false };
        if std::env::var_os("NOTIFY_SOCKET").is_some() {
            let (queue, messages) = sync_channel(QUEUE);
            let send = move || {
                for message in messages {
                    let state = match &message {
                        Message::Ready => NotifyState::Ready,
                        Message::Status(text) => NotifyState::Status(text),
                        Message::Watchdog => NotifyState::Watchdog,
                        Message::Stopping => NotifyState::Stopping,
                    };
                    // A service manager that cannot be reached notices the missing messages by itself.
                    let _ = sd_notify::notify(&[state]);
                }
            };
            manager.sender = Some(std::thread::spawn(send));
            manager.queue = Some(queue);
            manager.feed = sd_notify::watchdog_enabled().map(|longest| (longest / FEEDS, Instant::now()));
        }
        manager
    }

    /// Reports that all stages are ready. Only the first call sends.
    pub fn ready(&mut self) {
        if !std::mem::replace(&mut self.is_ready, true) {
            self.send(Message::Ready);
        }
    }

    /// Reports a line about the state of the run.
    pub fn status(&self, line: &str) {
        self.send(Message::Status(line.trim().to_owned()));
    }

    /// Feeds the watchdog when it is time. Call this after all heartbeats were seen to be fresh.
    pub fn alive(&mut self) {
        let now = Instant::now();
        if let Some((period, next)) = &mut self.feed
            && now >= *next
        {
            *next = now + *period;
            self.send(Message::Watchdog);
        }
    }

    /// Reports that the stages are being ended.
    pub fn stopping(&self) {
        self.send(Message::Stopping);
    }

    fn send(&self, message: Message) {
        if let Some(sender) = &self.queue {
            let _ = sender.try_send(message);
        }
    }
}

impl Drop for ServiceManager {
    fn drop(&mut self) {
        self.queue = None;
        let until = Instant::now() + CLOSING;
        while self.sender.as_ref().is_some_and(|sender| !sender.is_finished()) && Instant::now() < until {
            sleep(Duration::from_millis(1));
        }
    }
}
