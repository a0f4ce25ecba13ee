//! Why an operation on a group or a channel failed: one error type for each operation.
//!
//! | operation | error |
//! |---|---|
//! | join a group | [`JoinError`] |
//! | open a channel or its event | [`OpenError`], inside the four below |
//! | open a publisher, a reader | [`PublisherError`], [`ReaderError`] |
//! | open a notifier, a listener | [`NotifierError`], [`ListenerError`] |
//! | send, receive | [`SendError`], [`ReceiveError`] |
//! | notify, wait | [`NotifyError`], [`WaitError`] |
//! | claim a name for a run | [`ClaimError`] |
//! | remove the files of a group | [`RemoveError`] |
//!
//! The error of iceoryx2 is the `source()` of each of them. [`ChannelError`] holds any of them, for code that does
//! several of these operations.

use std::fmt;

use iceoryx2::{
    node::NodeCreationFailure,
    port::{
        LoanError, ReceiveError as LibraryReceiveError, SendError as LibrarySendError,
        listener::{ListenerCreateError, ListenerWaitError},
        notifier::{NotifierCreateError, NotifierNotifyError},
        publisher::PublisherCreateError,
        subscriber::SubscriberCreateError,
    },
    prelude::SemanticStringError,
    service::builder::{
        event::{EventCreateError, EventOpenError, EventOpenOrCreateError},
        publish_subscribe::{
            PublishSubscribeCreateError, PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
        },
    },
};
use thiserror::Error;

use super::{
    folder::{Foreign, UnusableFolder},
    prefix::Prefix,
};

/// A channel of a group, for messages.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChannelName {
    /// The group.
    pub prefix: Prefix,
    /// The channel.
    pub channel: &'static str,
}

impl fmt::Display for ChannelName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "channel \"{}\" of group \"{}\"", self.channel, self.prefix)
    }
}

/// Why a group could not be joined.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum JoinError {
    /// The group's folder, or a file of the group, cannot be used.
    #[error("group \"{prefix}\": {source}")]
    Folder {
        /// The group.
        prefix: Prefix,
        /// Why.
        source: UnusableFolder,
    },
    /// The name of the member, or the path of the folder, is none that iceoryx2 takes.
    #[error("group \"{prefix}\": \"{found}\" is too long or has characters that cannot be used")]
    Name {
        /// The group.
        prefix: Prefix,
        /// The name or path.
        found: String,
        /// What iceoryx2 said.
        source: SemanticStringError,
    },
    /// This user may not create the group's files.
    #[error("group \"{prefix}\": no permission to create its files; is it the group of another user?")]
    Permission {
        /// The group.
        prefix: Prefix,
        /// What iceoryx2 said.
        source: NodeCreationFailure,
    },
    /// iceoryx2 cannot make this process a member for another reason.
    #[error("group \"{prefix}\": cannot be joined: {source}")]
    Library {
        /// The group.
        prefix: Prefix,
        /// What iceoryx2 said.
        source: NodeCreationFailure,
    },
}

impl JoinError {
    pub(super) fn node(prefix: Prefix, source: NodeCreationFailure) -> Self {
        match source {
            NodeCreationFailure::InsufficientPermissions => Self::Permission { prefix, source },
            source => Self::Library { prefix, source },
        }
    }
}

/// Why a channel, or the event that goes with it, could not be opened.
#[derive(Debug, Error)]
#[error("{channel}: {reason}")]
pub struct OpenError {
    /// The channel.
    pub channel: ChannelName,
    /// The reason.
    pub reason: OpenReason,
    /// What iceoryx2 said.
    #[source]
    pub source: LibraryOpenError,
}

/// What iceoryx2 says about a channel that could not be opened.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LibraryOpenError {
    /// The channel of the messages.
    #[error(transparent)]
    Messages(#[from] PublishSubscribeOpenOrCreateError),
    /// The event that goes with the channel.
    #[error(transparent)]
    Event(#[from] EventOpenOrCreateError),
}

/// What kept a channel from being opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum OpenReason {
    /// The channel exists with another layout of its message.
    ForeignLayout,
    /// The channel exists with other limits.
    OtherLimits,
    /// This user may not use the channel.
    Permission,
    /// As many processes use the channel as it takes.
    TooManyProcesses,
    /// The files of the channel could not be created.
    NoRoom,
    /// Another process has been creating or removing the channel for too long.
    Busy,
    /// iceoryx2 failed for another reason.
    Library,
}

impl fmt::Display for OpenReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::ForeignLayout => {
                "another program has opened it with a message of another layout; all programs of a group must be of \
                 one version of Hydraxis"
            }
            Self::OtherLimits => {
                "another program has opened it with other limits; all programs of a group must be of one version of \
                 Hydraxis"
            }
            Self::Permission => "no permission to use it; is it the group of another user?",
            Self::TooManyProcesses => "as many processes use it as it takes; end one of them",
            Self::NoRoom => "its files could not be created; is there room in /dev/shm and in the temporary folder?",
            Self::Busy => {
                "another process has been creating or removing it for too long; remove the group with hydraxis clean"
            }
            Self::Library => "iceoryx2 cannot open it",
        })
    }
}

impl OpenReason {
    pub(super) fn of_messages(error: &PublishSubscribeOpenOrCreateError) -> Self {
        use PublishSubscribeCreateError as Create;
        use PublishSubscribeOpenError as Open;
        use PublishSubscribeOpenOrCreateError::{
            PublishSubscribeCreateError as Created, PublishSubscribeOpenError as Opened, SystemInFlux,
        };
        match error {
            Opened(Open::IncompatibleTypes | Open::IncompatibleAttributes | Open::VersionMismatch) => {
                Self::ForeignLayout
            }
            Opened(
                Open::IncompatibleMessagingPattern
                | Open::IncompatibleOverflowBehavior
                | Open::DoesNotSupportRequestedMinBufferSize
                | Open::DoesNotSupportRequestedMinHistorySize
                | Open::DoesNotSupportRequestedMinSubscriberBorrowedSamples
                | Open::DoesNotSupportRequestedAmountOfPublishers
                | Open::DoesNotSupportRequestedAmountOfSubscribers
                | Open::DoesNotSupportRequestedAmountOfNodes,
            ) => Self::OtherLimits,
            Opened(Open::InsufficientPermissions) | Created(Create::InsufficientPermissions) => Self::Permission,
            Opened(Open::ExceedsMaxNumberOfNodes) => Self::TooManyProcesses,
            Opened(Open::UnableToCreateServiceTag)
            | Created(Create::UnableToCreateServiceTag | Create::ServiceConfigCouldNotBeCreated) => Self::NoRoom,
            Opened(
                Open::ServiceInCorruptedState
                | Open::IsMarkedForDestruction
                | Open::HangsInCreation
                | Open::DoesNotExist,
            )
            | Created(Create::AlreadyExists | Create::IsBeingCreatedByAnotherInstance | Create::HangsInCreation)
            | SystemInFlux => Self::Busy,
            _ => Self::Library,
        }
    }

    pub(super) fn of_event(error: &EventOpenOrCreateError) -> Self {
        use EventCreateError as Create;
        use EventOpenError as Open;
        use EventOpenOrCreateError::{EventCreateError as Created, EventOpenError as Opened, SystemInFlux};
        match error {
            Opened(
                Open::IncompatibleMessagingPattern
                | Open::IncompatibleAttributes
                | Open::DoesNotSupportRequestedAmountOfNotifiers
                | Open::DoesNotSupportRequestedAmountOfListeners
                | Open::DoesNotSupportRequestedAmountOfNodes,
            ) => Self::OtherLimits,
            Opened(Open::InsufficientPermissions) | Created(Create::InsufficientPermissions) => Self::Permission,
            Opened(Open::ExceedsMaxNumberOfNodes) => Self::TooManyProcesses,
            Created(Create::UnableToCreateServiceTag | Create::ServiceConfigCouldNotBeCreated) => Self::NoRoom,
            Opened(Open::ServiceInCorruptedState | Open::HangsInCreation | Open::DoesNotExist)
            | Created(Create::AlreadyExists | Create::IsBeingCreatedByAnotherInstance)
            | SystemInFlux => Self::Busy,
            _ => Self::Library,
        }
    }
}

/// Declares the error of opening one end of a channel: the channel is not opened, has too many of this end, or the end
/// cannot be created.
macro_rules! end_error {
    (
        $(#[$meta:meta])* $name:ident, $source:ident, $end:literal, $too_many:ident
        $(, no room $no_room:ident)?
    ) => {
        $(#[$meta])*
        #[derive(Debug, Error)]
        #[non_exhaustive]
        pub enum $name {
            /// The channel cannot be opened.
            #[error(transparent)]
            Open(#[from] OpenError),
            #[doc = concat!("The channel has as many ", $end, "s as it takes.")]
            #[error("{channel}: found {most} {}, as many as it takes; end one of the programs", plural($end, *most))]
            $too_many {
                /// The channel.
                channel: ChannelName,
                /// The most that the channel takes.
                most: usize,
                /// What iceoryx2 said.
                source: $source,
            },
            $(
                /// There is no room for the shared memory.
                #[error("{channel}: no room for its shared memory; is /dev/shm full?")]
                $no_room {
                    /// The channel.
                    channel: ChannelName,
                    /// What iceoryx2 said.
                    source: $source,
                },
            )?
            /// iceoryx2 failed for another reason.
            #[error("{channel}: its {} cannot be created: {source}", $end)]
            Library {
                /// The channel.
                channel: ChannelName,
                /// What iceoryx2 said.
                source: $source,
            },
        }
    };
}

fn plural(end: &str, number: usize) -> String {
    if number == 1 { end.to_owned() } else { format!("{end}s") }
}

end_error! {
    /// Why a publisher could not be opened.
    PublisherError, PublisherCreateError, "publisher", TooManyPublishers, no room NoRoom
}
end_error! {
    /// Why a reader could not be opened.
    ReaderError, SubscriberCreateError, "reader", TooManyReaders
}
end_error! {
    /// Why a notifier could not be opened.
    NotifierError, NotifierCreateError, "notifier", TooManyNotifiers
}
end_error! {
    /// Why a listener could not be opened.
    ListenerError, ListenerCreateError, "listener", TooManyListeners, no room NoRoom
}

impl PublisherError {
    pub(super) fn new(channel: ChannelName, most: usize, source: PublisherCreateError) -> Self {
        match source {
            PublisherCreateError::ExceedsMaxSupportedPublishers => Self::TooManyPublishers { channel, most, source },
            PublisherCreateError::UnableToCreateDataSegment => Self::NoRoom { channel, source },
            source => Self::Library { channel, source },
        }
    }
}

impl ReaderError {
    pub(super) fn new(channel: ChannelName, most: usize, source: SubscriberCreateError) -> Self {
        match source {
            SubscriberCreateError::ExceedsMaxSupportedSubscribers => Self::TooManyReaders { channel, most, source },
            source => Self::Library { channel, source },
        }
    }
}

impl NotifierError {
    pub(super) fn new(channel: ChannelName, most: usize, source: NotifierCreateError) -> Self {
        match source {
            NotifierCreateError::ExceedsMaxSupportedNotifiers => Self::TooManyNotifiers { channel, most, source },
            source => Self::Library { channel, source },
        }
    }
}

impl ListenerError {
    pub(super) fn new(channel: ChannelName, most: usize, source: ListenerCreateError) -> Self {
        match source {
            ListenerCreateError::ExceedsMaxSupportedListeners => Self::TooManyListeners { channel, most, source },
            ListenerCreateError::ResourceCreationFailed => Self::NoRoom { channel, source },
            source => Self::Library { channel, source },
        }
    }
}

/// Why a message could not be sent.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SendError {
    /// iceoryx2 lends no memory for the message.
    #[error("channel \"{channel}\": cannot send: no memory for the message: {source}")]
    Loan {
        /// The channel.
        channel: &'static str,
        /// What iceoryx2 said.
        source: LoanError,
    },
    /// iceoryx2 does not deliver the message.
    #[error("channel \"{channel}\": cannot send: {source}")]
    Deliver {
        /// The channel.
        channel: &'static str,
        /// What iceoryx2 said.
        source: LibrarySendError,
    },
}

/// Why no message could be received.
#[derive(Debug, Error)]
#[error("channel \"{channel}\": cannot receive: {source}")]
pub struct ReceiveError {
    /// The channel.
    pub channel: &'static str,
    /// What iceoryx2 said.
    pub source: LibraryReceiveError,
}

/// Why the listeners of a channel could not be notified.
#[derive(Debug, Error)]
#[error("channel \"{channel}\": cannot notify: {source}")]
pub struct NotifyError {
    /// The channel.
    pub channel: &'static str,
    /// What iceoryx2 said.
    pub source: NotifierNotifyError,
}

/// Why a notification could not be waited for.
#[derive(Debug, Error)]
#[error("channel \"{channel}\": cannot wait for a notification: {source}")]
pub struct WaitError {
    /// The channel.
    pub channel: &'static str,
    /// What iceoryx2 said.
    pub source: ListenerWaitError,
}

/// Why the files of a group were not removed.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum RemoveError {
    /// The group has living members.
    #[error("group \"{prefix}\" is running; end it, or take another --prefix")]
    Alive {
        /// The group.
        prefix: Prefix,
    },
    /// Something else is in the place of the group's folder or of one of its files.
    #[error("group \"{prefix}\": {source}")]
    Foreign {
        /// The group.
        prefix: Prefix,
        /// What was found.
        source: Foreign,
    },
}

/// Why a name could not be claimed for a run.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ClaimError {
    /// Another run has the name.
    #[error(
        "group \"{prefix}\" is running: {holder} has the name; end it by Ctrl-C or SIGTERM, or take another --prefix"
    )]
    Taken {
        /// The group.
        prefix: Prefix,
        /// Number of the process, and since when.
        holder: String,
    },
    /// The group's folder, or a file of the group, cannot be used.
    #[error("group \"{prefix}\": {source}")]
    Folder {
        /// The group.
        prefix: Prefix,
        /// Why.
        source: UnusableFolder,
    },
}

/// Any failure of a group or a channel.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ChannelError {
    /// A group cannot be joined.
    #[error(transparent)]
    Join(#[from] JoinError),
    /// A publisher cannot be opened.
    #[error(transparent)]
    Publisher(#[from] PublisherError),
    /// A reader cannot be opened.
    #[error(transparent)]
    Reader(#[from] ReaderError),
    /// A notifier cannot be opened.
    #[error(transparent)]
    Notifier(#[from] NotifierError),
    /// A listener cannot be opened.
    #[error(transparent)]
    Listener(#[from] ListenerError),
    /// A message cannot be sent.
    #[error(transparent)]
    Send(#[from] SendError),
    /// No message can be received.
    #[error(transparent)]
    Receive(#[from] ReceiveError),
    /// The listeners cannot be notified.
    #[error(transparent)]
    Notify(#[from] NotifyError),
    /// A notification cannot be waited for.
    #[error(transparent)]
    Wait(#[from] WaitError),
}
