//! Publishers and readers of the messages, over iceoryx2.
//!
//! All processes of one run join one [`Group`] by its prefix; groups with different prefixes share nothing. Every
//! channel is publish-subscribe with explicit limits, safe overflow and a history of one:
//!
//! - a publisher never waits for a reader: a reader that is slow, stopped or dead loses its oldest messages;
//! - a reader counts its lost messages by the numbers that the publisher gives them;
//! - a late reader gets the newest message at the publisher's next [`Publisher::send`] or [`Publisher::greet`].
//!
//! A foreign layout is refused on opening: the type's name carries a version, and its fingerprint
//! ([`crate::layout`]) is an attribute of the channel.
//!
//! | file | what it holds | runs in a loop |
//! |---|---|---|
//! | `prefix`, `group`, `members` | joining a group and opening its channels | no |
//! | `board` | the machine of a group, and the stops that were asked for | its stops: yes |
//! | `publisher`, `reader`, `event` | the ends of a channel and of its event | yes: no allocation, no lock |
//! | `service`, `recycled` | the flavour of iceoryx2, which sends without allocating | yes |
//! | `folder`, `claim` | the private folder of a group, and the claim of a run on it | no |
//! | `storage` | shared memory that is allocated when it is made, and private | no |
//! | `names`, `leftovers` | files of dead groups | no |
//! | `room` | room for a stage that starts again | no |
//! | `error` | one error type for each operation | |

mod board;
mod claim;
mod error;
mod event;
mod folder;
mod group;
mod leftovers;
mod members;
mod names;
mod prefix;
mod publisher;
mod reader;
mod recycled;
mod room;
mod service;
mod storage;

pub use board::{Board, BoardError, GroupMachine, Stop, Stops, Ticket};
pub use claim::Claim;
pub use error::{
    ChannelError, ChannelName, ClaimError, JoinError, LibraryOpenError, ListenerError, NotifierError, NotifyError,
    OpenError, OpenReason, PublisherError, ReaderError, ReceiveError, RemoveError, SendError, WaitError,
};
pub use event::{Listener, Notifier};
pub use folder::{Exposed, Foreign, UnusableFolder};
pub use group::{Group, Member};
pub use leftovers::{FoundGroup, GroupState, boards, exposed, groups, is_joined, remove_leftovers};
pub use prefix::{Prefix, PrefixError, place};
pub use publisher::Publisher;
pub use reader::{Read, Reader};
pub use room::{MARGIN as ROOM_MARGIN, Room, rooms};

#[cfg(test)]
mod tests;
