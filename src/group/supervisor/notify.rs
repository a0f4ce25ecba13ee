//! What the service manager is told: READY, STATUS, WATCHDOG, STOPPING, by the protocol of `sd_notify(3)`.
//!
//! Nothing happens without `NOTIFY_SOCKET` in the environment. A thread of its own sends, so that a service manager
//! that does not read holds nobody up; what it has no time for is left out.
//!
//! Trap: a watchdog that is fed by a timer tells that the timer works. This one is fed by whoever has just seen fresh
//! heartbeats of all stages.

use std::{
    sync::mpsc::{SyncSender, sync_channel},
    thread::{JoinHandle, sleep},
    time::{Duration, Instant},
};

use sd_notify::NotifyState;

/// Messages that may wait for the service manager.
const QUEUE: usize = 16;
/// Feeds within the time after which the service manager would act.
const FEEDS: u32 = 4;
/// How long the last message may take.
const CLOSING: Duration = Duration::from_millis(200);

enum News {
    Ready,
    Status(String),
    Watchdog,
    Stopping,
}

/// The way to the service manager, if there is one.
pub struct Notifier {
    news: Option<SyncSender<News>>,
    sender: Option<JoinHandle<()>>,
    feed: Option<(Duration, Instant)>,
    is_ready: bool,
}

impl Notifier {
    /// By the environment.
    pub fn new() -> Self {
        let mut notifier = Self { news: None, sender: None, feed: None, is_ready: false };
        if std::env::var_os("NOTIFY_SOCKET").is_some() {
            let (news, coming) = sync_channel(QUEUE);
            let send = move || {
                for news in coming {
                    let state = match &news {
                        News::Ready => NotifyState::Ready,
                        News::Status(text) => NotifyState::Status(text),
                        News::Watchdog => NotifyState::Watchdog,
                        News::Stopping => NotifyState::Stopping,
                    };
                    // A service manager that cannot be reached will see that nothing comes.
                    let _ = sd_notify::notify(&[state]);
                }
            };
            notifier.sender = Some(std::thread::spawn(send));
            notifier.news = Some(news);
            notifier.feed = sd_notify::watchdog_enabled().map(|longest| (longest / FEEDS, Instant::now()));
        }
        notifier
    }

    /// All stages are ready; only the first time counts.
    pub fn ready(&mut self) {
        if !std::mem::replace(&mut self.is_ready, true) {
            self.send(News::Ready);
        }
    }

    /// One line for a person who asks how it goes.
    pub fn status(&self, line: &str) {
        self.send(News::Status(line.trim().to_owned()));
    }

    /// All heartbeats are fresh: feeds the watchdog when it is time.
    pub fn alive(&mut self) {
        let now = Instant::now();
        if let Some((period, next)) = &mut self.feed
            && now >= *next
        {
            *next = now + *period;
            self.send(News::Watchdog);
        }
    }

    /// The stages are being ended.
    pub fn stopping(&self) {
        self.send(News::Stopping);
    }

    fn send(&self, news: News) {
        if let Some(sender) = &self.news {
            let _ = sender.try_send(news);
        }
    }
}

impl Drop for Notifier {
    fn drop(&mut self) {
        self.news = None;
        let until = Instant::now() + CLOSING;
        while self.sender.as_ref().is_some_and(|sender| !sender.is_finished()) && Instant::now() < until {
            sleep(Duration::from_millis(1));
        }
    }
}
