//! A group: all channels of one run, apart from those of any other.

use std::{
    fmt,
    fs::{File, OpenOptions},
    os::unix::fs::MetadataExt,
    path::{Path, PathBuf},
    str::FromStr,
    time::{Duration, Instant},
};

use iceoryx2::{
    node::NodeView,
    prelude::*,
    service::builder::publish_subscribe::{
        PublishSubscribeCreateError, PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
    },
    service::port_factory::publish_subscribe::PortFactory as PublishSubscribe,
};

use super::{ChannelError, Listener, Notifier, Publisher, Reader, service::Service};
use crate::message::Message;

/// Readers that one channel takes: the stages, the supervisor, and clients that watch.
const MAX_SUBSCRIBERS: usize = 16;
/// Processes that one channel takes.
const MAX_NODES: usize = 32;
/// How long opening is tried while another process creates or removes the same channel.
const OPEN_PATIENCE: Duration = Duration::from_secs(2);
/// How long freeing the places of killed members is tried.
const BURIAL_PATIENCE: Duration = Duration::from_millis(500);
/// What the name of a group's folder starts with.
pub(super) const FOLDER: &str = "hydraxis.";
/// File in the group's folder that every member keeps locked.
pub(super) const MEMBERS: &str = "members";
/// Attribute that holds the layout's fingerprint.
const LAYOUT_ATTRIBUTE: &str = "hydraxis.layout";

/// The name of a group; it becomes part of file names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Prefix(String);

impl FromStr for Prefix {
    type Err = ChannelError;

    fn from_str(text: &str) -> Result<Self, ChannelError> {
        let valid =
            (1..=32).contains(&text.len()) && text.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_');
        if valid { Ok(Self(text.to_owned())) } else { Err(ChannelError::Prefix { found: text.to_owned() }) }
    }
}

impl fmt::Display for Prefix {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl Prefix {
    /// A prefix that no other running process has.
    pub fn of_this_process() -> Self {
        Self(format!("hydraxis-{}", std::process::id()))
    }

    /// Folder of the group's static files.
    pub fn folder(&self) -> PathBuf {
        std::env::temp_dir().join(format!("{FOLDER}{}", self.0))
    }

    /// What the names of the group's shared memory start with. The dot keeps prefix `a` apart from prefix `ab`.
    pub(super) fn file_prefix(&self) -> String {
        format!("{}.", self.0)
    }
}

/// Somebody in a group.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Member {
    /// As it joined: a stage's name, `supervisor`, or a client's.
    pub name: String,
    /// Its process.
    pub pid: u32,
    /// False for one that was killed and has not been buried.
    pub is_alive: bool,
}

/// One process' membership in a group.
pub struct Group {
    prefix: Prefix,
    node: Node<Service>,
    /// Locked, shared, for as long as the membership lasts: the kernel lets go of it also when the process is killed.
    _membership: File,
}

impl Group {
    /// Joins the group, under a name that tells who this is.
    ///
    /// # Errors
    /// The group's files cannot be created.
    pub fn join(prefix: &Prefix, name: &str) -> Result<Self, ChannelError> {
        // The library's own messages would go to the terminal from within the loop; errors are returned to us.
        set_log_level(LogLevel::Fatal);
        let refuse = |reason: String| ChannelError::Join { prefix: prefix.to_string(), reason };
        let folder = prefix.folder();
        let membership = join_members(&folder).map_err(|error| match folder.metadata() {
            Ok(found) if !found.is_dir() => refuse(format!(
                "found {}, which is no folder; allowed: a group's folder, or nothing: remove it, or take another --prefix",
                folder.display()
            )),
            _ => refuse(format!("{}: {error}", folder.display())),
        })?;
        let mut config = Config::default();
        config.global.prefix = FileName::new(prefix.file_prefix().as_bytes()).map_err(|e| refuse(format!("{e:?}")))?;
        let root = iceoryx2::prelude::Path::new(folder.as_os_str().as_encoded_bytes());
        config.global.set_root_path(&root.map_err(|e| refuse(format!("{e:?}")))?);
        // Cleaning up after a dead process takes milliseconds: the supervisor's work, never a stage's.
        config.global.node.cleanup_dead_nodes_on_creation = false;
        config.global.node.cleanup_dead_nodes_on_destruction = false;
        config.global.service.cleanup_dead_nodes_on_open = false;
        let node = NodeBuilder::new()
            .name(&NodeName::new(name).map_err(|e| refuse(format!("{e:?}")))?)
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create()
            .map_err(|error| refuse(format!("{error:?}")))?;
        Ok(Self { prefix: prefix.clone(), node, _membership: membership })
    }

    /// The group's name.
    pub fn prefix(&self) -> &Prefix {
        &self.prefix
    }

    /// Frees the places on the channels that killed members still hold. Takes milliseconds: not for a stage's loop.
    pub fn bury_the_dead(&self) {
        // Another process may be at it as well; whoever opens a channel then sees what came of it.
        self.node.blocking_cleanup_dead_nodes(BURIAL_PATIENCE);
    }

    /// Who is in the group, by the names that they joined under, the killed among them. Looks at files: not for a
    /// stage's loop.
    pub fn members(&self) -> Vec<Member> {
        let mut members = Vec::new();
        // A member that is just leaving ends the list early; it is a look, and the next one sees more.
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
    /// The channel has another layout, or has its writers already.
    pub fn publisher<M: Message>(&self) -> Result<Publisher<M>, ChannelError> {
        let port = self
            .open::<M>()?
            .publisher_builder()
            .max_loaned_samples(1)
            .create()
            .map_err(|error| self.cannot_open::<M>(format!("{error:?}")))?;
        Ok(Publisher::new(port))
    }

    /// Opens the channel of `M` for reading.
    ///
    /// # Errors
    /// The channel has another layout, or has its readers already.
    pub fn reader<M: Message>(&self) -> Result<Reader<M>, ChannelError> {
        Reader::new(self.open::<M>()?).map_err(|reason| self.cannot_open::<M>(reason))
    }

    /// Opens the event that goes with the channel of `M`, to wake its listeners.
    ///
    /// # Errors
    /// The event cannot be opened.
    pub fn notifier<M: Message>(&self) -> Result<Notifier, ChannelError> {
        let event = self.open_event::<M>()?;
        let notifier = event.notifier_builder().create();
        Ok(Notifier::new(notifier.map_err(|error| self.cannot_open::<M>(format!("{error:?}")))?, M::CHANNEL))
    }

    /// Opens the event that goes with the channel of `M`, to wait for its notifiers.
    ///
    /// # Errors
    /// The event cannot be opened.
    pub fn listener<M: Message>(&self) -> Result<Listener, ChannelError> {
        let event = self.open_event::<M>()?;
        let listener = event.listener_builder().create();
        Ok(Listener::new(listener.map_err(|error| self.cannot_open::<M>(format!("{error:?}")))?, M::CHANNEL))
    }

    fn cannot_open<M: Message>(&self, reason: String) -> ChannelError {
        ChannelError::Open { prefix: self.prefix.to_string(), channel: M::CHANNEL, reason }
    }

    fn open<M: Message>(&self) -> Result<PublishSubscribe<Service, M, ()>, ChannelError> {
        let service = format!("hydraxis/{}", M::CHANNEL);
        let internal = |reason: String| self.cannot_open::<M>(reason);
        let name = ServiceName::new(&service).map_err(|error| internal(format!("{error:?}")))?;
        let key = LAYOUT_ATTRIBUTE.try_into().map_err(|error| internal(format!("{error:?}")))?;
        let value = format!("{:016x}", M::LAYOUT);
        let value = value.as_str().try_into().map_err(|error| internal(format!("{error:?}")))?;
        let layout = AttributeVerifier::new().require(&key, &value).map_err(|error| internal(format!("{error:?}")))?;

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
            match opened {
                Ok(service) => return Ok(service),
                Err(error) if is_foreign(&error) => {
                    return Err(ChannelError::ForeignLayout {
                        prefix: self.prefix.to_string(),
                        channel: M::CHANNEL,
                        reason: format!("{error:?}"),
                    });
                }
                Err(error) if is_passing(&error) && Instant::now() < until => {
                    std::thread::sleep(Duration::from_millis(1));
                }
                Err(error) => return Err(internal(format!("{error:?}"))),
            }
        }
    }

    fn open_event<M: Message>(
        &self,
    ) -> Result<iceoryx2::service::port_factory::event::PortFactory<Service>, ChannelError> {
        let service = format!("hydraxis/{}", M::CHANNEL);
        let name = ServiceName::new(&service).map_err(|error| self.cannot_open::<M>(format!("{error:?}")))?;
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
                Err(error) => return Err(self.cannot_open::<M>(format!("{error:?}"))),
            }
        }
    }
}

/// Opens and locks the file that tells that a group has members, in a folder that stays.
fn join_members(folder: &Path) -> std::io::Result<File> {
    loop {
        std::fs::create_dir_all(folder)?;
        let path = folder.join(MEMBERS);
        let file = match OpenOptions::new().create(true).truncate(false).write(true).open(&path) {
            // The last member is just leaving, and takes the folder with it.
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => continue,
            opened => opened?,
        };
        file.lock_shared()?;
        // Between opening and locking it may have been removed: then the lock is on a file that nobody else sees.
        if is_still(&file, &path) {
            return Ok(file);
        }
    }
}

/// Whether an open file is the one that now has this name.
pub(super) fn is_still(file: &File, path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|seen| file.metadata().is_ok_and(|own| own.ino() == seen.ino()))
}

fn is_foreign(error: &PublishSubscribeOpenOrCreateError) -> bool {
    use PublishSubscribeOpenError as Open;
    matches!(
        error,
        PublishSubscribeOpenOrCreateError::PublishSubscribeOpenError(
            Open::IncompatibleTypes | Open::IncompatibleAttributes | Open::VersionMismatch
        )
    )
}

/// Whether another process is in the middle of creating or removing the channel.
fn is_passing(error: &PublishSubscribeOpenOrCreateError) -> bool {
    use PublishSubscribeCreateError as Create;
    use PublishSubscribeOpenError as Open;
    matches!(
        error,
        PublishSubscribeOpenOrCreateError::PublishSubscribeOpenError(
            Open::ServiceInCorruptedState | Open::IsMarkedForDestruction | Open::HangsInCreation | Open::DoesNotExist
        ) | PublishSubscribeOpenOrCreateError::PublishSubscribeCreateError(
            Create::AlreadyExists | Create::IsBeingCreatedByAnotherInstance | Create::HangsInCreation
        ) | PublishSubscribeOpenOrCreateError::SystemInFlux
    )
}
