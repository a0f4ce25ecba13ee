//! Publishers and readers of the messages, over iceoryx2.
//!
//! All processes of one run join one [`Group`] by its prefix; groups with different prefixes share nothing. Every
//! channel is publish-subscribe with explicit limits, safe overflow and a history of one:
//!
//! - a writer never waits for a reader: a reader that is slow, stopped or dead loses its oldest messages;
//! - a reader counts what it lost, by the numbers that the publisher gives them;
//! - a late reader gets the newest message at the writer's next [`Publisher::send`] or [`Publisher::greet`].
//!
//! A foreign layout is refused on opening: the type's name carries a version, and its fingerprint
//! ([`crate::layout`]) is an attribute of the channel.

mod event;
mod group;
mod leftovers;
mod publisher;
mod reader;
mod recycled;
mod service;

pub use event::{Listener, Notifier};
pub use group::{Group, Member, Prefix};
pub use leftovers::{FoundGroup, GroupState, groups, remove_leftovers};
pub use publisher::Publisher;
pub use reader::{Read, Reader};

/// Why a channel cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ChannelError {
    /// A prefix that cannot name files.
    #[error("prefix: found \"{found}\"; allowed: 1 to 32 letters, digits, - and _")]
    Prefix {
        /// What was given.
        found: String,
    },
    /// The group cannot be joined.
    #[error("group \"{prefix}\": cannot be joined: {reason}")]
    Join {
        /// The group.
        prefix: String,
        /// What the library says.
        reason: String,
    },
    /// A group whose files are to be removed or taken over has living members.
    #[error("group \"{prefix}\" is running; end it, or take another --prefix")]
    Alive {
        /// The group.
        prefix: String,
    },
    /// The channel exists with another layout of its message.
    #[error(
        "channel \"{channel}\" of group \"{prefix}\": another program has opened it with a message of another layout \
         ({reason}); all programs of a group must be of one version of Hydraxis"
    )]
    ForeignLayout {
        /// The group.
        prefix: String,
        /// The channel.
        channel: &'static str,
        /// What the library says.
        reason: String,
    },
    /// The channel cannot be opened.
    #[error("channel \"{channel}\" of group \"{prefix}\": cannot be opened: {reason}")]
    Open {
        /// The group.
        prefix: String,
        /// The channel.
        channel: &'static str,
        /// What the library says.
        reason: String,
    },
    /// A message cannot be sent.
    #[error("channel \"{channel}\": cannot send: {reason}")]
    Send {
        /// The channel.
        channel: &'static str,
        /// What the library says.
        reason: String,
    },
    /// A message cannot be received.
    #[error("channel \"{channel}\": cannot receive: {reason}")]
    Receive {
        /// The channel.
        channel: &'static str,
        /// What the library says.
        reason: String,
    },
}

#[cfg(test)]
mod tests;
