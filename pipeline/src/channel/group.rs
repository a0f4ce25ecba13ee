//! A group: all channels of one run, apart from those of any other.

use std::{
    fs::File,
    time::{Duration, Instant},
};

use iceoryx2::{
    node::NodeView,
    prelude::*,
    service::port_factory::{event::PortFactory as Event, publish_subscribe::PortFactory as PublishSubscribe},
};

use super::{
    Board, Listener, Notifier, Publisher, Reader,
    error::{ChannelName, JoinError, ListenerError, NotifierError, OpenError, OpenReason, PublisherError, ReaderError},
    members, names,
    prefix::Prefix,
    service::{OPEN_PATIENCE, Service},
};
use crate::message::Message;

/// Largest number of readers of one channel: the stages, the supervisor, and clients that watch.
pub(super) const MAX_SUBSCRIBERS: usize = 16;
/// Largest number of processes that use one channel.
const MAX_NODES: usize = 32;
/// How long freeing the places of killed members is tried.
const BURIAL_PATIENCE: Duration = Duration::from_millis(500);
/// Attribute of a channel that holds the fingerprint of its message's layout.
const LAYOUT_ATTRIBUTE: &str = "hydraxis.layout";

/// One member of a group.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Member {
    /// Name under which the member joined: a stage's name, `supervisor`, or the name of a client.
    pub name: String,
    /// Process id of the member.
    pub pid: u32,
    /// False for a member that was killed and whose places have not been freed.
    pub is_alive: bool,
}

/// The membership of one process in a group.
///
/// ```
/// use pipeline::{
///     channel::{Group, Prefix, Read, remove_leftovers},
///     message::EncoderSample,
/// };
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let prefix = Prefix::of_this_process();
/// let group = Group::join(&prefix, "example")?;
/// let publisher = group.publisher::<EncoderSample>()?;
/// let mut reader = group.reader::<EncoderSample>()?;
///
/// let mut sample = EncoderSample::default();
/// sample.header.sequence = 7;
/// sample.axes[0].position = 0.25;
/// publisher.send(&sample)?;
///
/// let Read::New(received) = reader.read()? else { panic!("the message has been sent") };
/// assert_eq!((received.header.sequence, received.axes[0].position), (7, 0.25));
/// assert!(matches!(reader.read()?, Read::Old(_)));
/// assert_eq!(reader.lost(), 0);
/// # drop((publisher, reader, group));
/// # remove_leftovers(&prefix)?;
/// # Ok(())
/// # }
/// ```
pub struct Group {
    prefix: Prefix,
    node: Node<Service>,
    /// Locked, shared, for as long as the membership lasts. The kernel releases the lock also when the process is
    /// killed.
    _membership: File,
}

impl Group {
    /// Joins the group under a name that tells the other members who this is.
    ///
    /// # Errors
    /// The group's files cannot be created.
    pub fn join(prefix: &Prefix, name: &str) -> Result<Self, JoinError> {
        // iceoryx2 would print its own messages to the terminal from within the loop; its errors are returned here.
        set_log_level(LogLevel::Fatal);
        let folder = prefix.folder();
        let unusable = |source| JoinError::Folder { prefix: prefix.clone(), source };
        // Before the folder is made, so that nothing is left behind.
        names::foreign_counter(prefix).map_or(Ok(()), |found| Err(unusable(found.into())))?;
        let membership = members::join(&folder).map_err(unusable)?;
        let refuse = |found: &str, source| JoinError::Name { prefix: prefix.clone(), found: found.to_owned(), source };
        let file_prefix = prefix.file_prefix();
        let mut config = Config::default();
        config.global.prefix = FileName::new(file_prefix.as_bytes()).map_err(|error| refuse(&file_prefix, error))?;
        let root = Path::new(folder.as_os_str().as_encoded_bytes());
        config.global.set_root_path(&root.map_err(|error| refuse(&folder.display().to_string(), error))?);
        // Cleaning up after a dead process takes milliseconds: the supervisor's work, never a stage's.
        config.global.node.cleanup_dead_nodes_on_creation = false;
        config.global.node.cleanup_dead_nodes_on_destruction = false;
        config.global.service.cleanup_dead_nodes_on_open = false;
        let node = NodeBuilder::new()
            .name(&NodeName::new(name).map_err(|error| refuse(name, error))?)
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create()
            .map_err(|source| match names::foreign(prefix) {
                // The storage refuses a file of another user.
                Some(found) => unusable(found.into()),
                None => JoinError::node(prefix.clone(), source),
            })?;
        names::make_private(prefix);
        Ok(Self { prefix: prefix.clone(), node, _membership: membership })
    }

    /// The group's name.
    pub fn prefix(&self) -> &Prefix {
        &self.prefix
    }

    /// Frees the places on the channels that killed members still hold. This takes milliseconds: not for a stage's
    /// loop.
    pub fn bury_the_dead(&self) {
        // Another process may be doing this as well; whoever opens a channel then sees the result.
        self.node.blocking_cleanup_dead_nodes(BURIAL_PATIENCE);
    }

    /// The members of the group, killed ones included. This reads files: not for a stage's loop.
    pub fn members(&self) -> Vec<Member> {
        let mut members = Vec::new();
        // A member that is leaving ends the list early; the next call sees the rest.
        let _ = Node::<Service>::list(self.node.config(), |state| {
            let (is_alive, details) = match &state {
                NodeState::Alive(view) => (true, view.details().as_ref()),
                NodeState::Dead(view) => (false, view.details().as_ref()),
                NodeState::Inaccessible(_) | NodeState::Undefined(_) => (false, None),
            };
            if let Some(details) = details {
                let pid = u32::try_from(details.process_id().value()).unwrap_or_default();
                members.push(Member { name: details.name().to_string(), pid, is_alive });
            }
            CallbackProgression::Continue
        });
        members
    }

    /// Opens the channel of `M` for writing.
    ///
    /// # Errors
    /// The channel cannot be opened, or has as many publishers as it takes: for most channels one.
    pub fn publisher<M: Message>(&self) -> Result<Publisher<M>, PublisherError> {
        let port = self.open::<M>()?.publisher_builder().max_loaned_samples(1).create();
        let refuse = |error| PublisherError::new(self.channel::<M>(), M::MAX_PUBLISHERS, error);
        Ok(Publisher::new(port.map_err(refuse)?, self.machine()))
    }

    /// Number of publishers on the channel of `M` now.
    ///
    /// # Errors
    /// The channel cannot be opened.
    pub fn publishers<M: Message>(&self) -> Result<usize, PublisherError> {
        Ok(self.open::<M>()?.dynamic_config().number_of_publishers())
    }

    /// Opens the channel of `M` for reading.
    ///
    /// # Errors
    /// The channel cannot be opened, or has as many readers as it takes.
    pub fn reader<M: Message>(&self) -> Result<Reader<M>, ReaderError> {
        let refuse = |error| ReaderError::new(self.channel::<M>(), MAX_SUBSCRIBERS, error);
        Reader::new(self.open::<M>()?, self.machine()).map_err(refuse)
    }

    /// Opens the event that goes with the channel of `M`, to wake its listeners.
    ///
    /// # Errors
    /// The event cannot be opened, or has as many notifiers as it takes.
    pub fn notifier<M: Message>(&self) -> Result<Notifier, NotifierError> {
        let port = self.open_event::<M>()?.notifier_builder().create();
        let refuse = |error| NotifierError::new(self.channel::<M>(), M::MAX_PUBLISHERS, error);
        Ok(Notifier::new(port.map_err(refuse)?, M::CHANNEL))
    }

    /// Opens the event that goes with the channel of `M`, to wait for its notifiers.
    ///
    /// # Errors
    /// The event cannot be opened, or has as many listeners as it takes.
    pub fn listener<M: Message>(&self) -> Result<Listener, ListenerError> {
        let port = self.open_event::<M>()?.listener_builder().create();
        let refuse = |error| ListenerError::new(self.channel::<M>(), MAX_SUBSCRIBERS, error);
        Ok(Listener::new(port.map_err(refuse)?, M::CHANNEL))
    }

    /// The machine of the group as messages name it; 0 while the group has none.
    fn machine(&self) -> u32 {
        Board::find(&self.prefix).ok().flatten().map_or(0, |board| board.machine().fingerprint as u32)
    }

    fn channel<M: Message>(&self) -> ChannelName {
        ChannelName { prefix: self.prefix.clone(), channel: M::CHANNEL }
    }

    fn open<M: Message>(&self) -> Result<PublishSubscribe<Service, M, ()>, OpenError> {
        let (name, layout) = (service_name::<M>(), layout::<M>());
        let until = Instant::now() + OPEN_PATIENCE;
        loop {
            let opened = self
                .node
                .service_builder(&name)
                .publish_subscribe::<M>()
                .max_publishers(M::MAX_PUBLISHERS)
                .max_subscribers(MAX_SUBSCRIBERS)
                .max_nodes(MAX_NODES)
                .subscriber_max_buffer_size(M::BUFFER)
                .subscriber_max_borrowed_samples(1)
                .history_size(1)
                .enable_safe_overflow(true)
                .open_or_create_with_attributes(&layout);
            let source = match opened {
                Ok(service) => return Ok(service),
                Err(source) => source,
            };
            match OpenReason::of_messages(&source) {
                OpenReason::Busy if Instant::now() < until => std::thread::sleep(Duration::from_millis(1)),
                reason => return Err(OpenError { channel: self.channel::<M>(), reason, source: source.into() }),
            }
        }
    }

    fn open_event<M: Message>(&self) -> Result<Event<Service>, OpenError> {
        let name = service_name::<M>();
        let until = Instant::now() + OPEN_PATIENCE;
        loop {
            let opened = self
                .node
                .service_builder(&name)
                .event()
                .max_notifiers(M::MAX_PUBLISHERS)
                .max_listeners(MAX_SUBSCRIBERS)
                .max_nodes(MAX_NODES)
                .open_or_create();
            match opened {
                Ok(service) => return Ok(service),
                Err(_) if Instant::now() < until => std::thread::sleep(Duration::from_millis(1)),
                Err(source) => {
                    let reason = OpenReason::of_event(&source);
                    return Err(OpenError { channel: self.channel::<M>(), reason, source: source.into() });
                }
            }
        }
    }
}

/// Name of the service of the channel of `M`.
fn service_name<M: Message>() -> ServiceName {
    ServiceName::new(&format!("hydraxis/{}", M::CHANNEL)).expect("the names of channels are constants and short")
}

/// The fingerprint of the layout of `M`, as an attribute that a channel must have.
fn layout<M: Message>() -> AttributeVerifier {
    let fits = "the attribute is a constant and a number";
    let key = LAYOUT_ATTRIBUTE.try_into().expect(fits);
    let value = format!("{:016x}", M::LAYOUT).as_str().try_into().expect(fits);
    AttributeVerifier::new().require(&key, &value).expect(fits)
}
