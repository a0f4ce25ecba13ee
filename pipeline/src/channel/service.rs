//! The service type of the channels: the `ipc` service of iceoryx2 with two parts replaced.
//!
//! All shared memory is [`Reserved`]: allocated when it is made, and private.
//!
//! At every send, iceoryx2 allocates a small reference-counted block on the heap for the lent message. [`Recycled`]
//! uses the block of the last send again, so that sending allocates nothing. Memory layout and protocol are those of
//! `ipc`, so clients in other languages, which use `ipc`, see no difference.

use std::{fmt::Debug, time::Duration};

use iceoryx2::unique_id_generator::unique_system_id::UniqueSystemId;
use iceoryx2_bb_elementary_traits::{testing::abandonable::Abandonable, zero_copy_send::ZeroCopySend};
use iceoryx2_bb_lock_free::mpmc::counting_bit_set::RelocatableCountingBitSet;
use iceoryx2_cal::{
    bag,
    event::trigger::{State, unix_datagram_socket::GenericUnixDatagramSocketTrigger},
    hash, monitoring, reactor,
    resizable_shared_memory::dynamic::DynamicMemory,
    serialize,
    shared_memory::common::details::{AllocatorDetails, Memory},
    shm_allocator::{bump_allocator::BumpAllocator, pool_allocator::PoolAllocator},
    static_storage,
    zero_copy_connection::common::details::{Connection, SharedManagementData},
};

use super::{recycled::Recycled, storage::Reserved};

/// How long opening is tried again while another process creates or removes the same thing.
pub(super) const OPEN_PATIENCE: Duration = Duration::from_secs(2);

/// Shared memory that an allocator of iceoryx2 divides.
type ReservedMemory<Allocator> = Memory<Allocator, Reserved<AllocatorDetails<Allocator>>>;

/// The service type of all channels.
#[derive(Debug, Clone)]
pub struct Service {}

impl iceoryx2::service::Service for Service {
    type StaticStorage = static_storage::recommended::Ipc;
    type ConfigSerializer = serialize::recommended::Recommended;
    type PersistentDynamicStorage<T: Debug + Send + Sync + ZeroCopySend + 'static> = Reserved<T>;
    type Bag = bag::recommended::Recommended;
    type DynamicStorage<T: Debug + Send + Sync + ZeroCopySend + 'static> = Reserved<T>;
    type ServiceNameHasher = hash::recommended::Recommended;
    type SharedMemory = ReservedMemory<PoolAllocator>;
    type ResizableSharedMemory = DynamicMemory<PoolAllocator, ReservedMemory<PoolAllocator>>;
    type Connection = Connection<Reserved<SharedManagementData>>;
    type Event =
        GenericUnixDatagramSocketTrigger<RelocatableCountingBitSet, Reserved<State<RelocatableCountingBitSet, ()>>>;
    type Monitoring = monitoring::recommended::Ipc;
    type Reactor = reactor::recommended::Ipc;
    type ArcThreadSafetyPolicy<T: Send + Debug + Abandonable> = Recycled<T>;
    type BlackboardMgmt<KeyType: Send + Sync + Debug + ZeroCopySend + 'static> = Reserved<KeyType>;
    type BlackboardPayload = ReservedMemory<BumpAllocator>;
    type UniqueId = UniqueSystemId;
}

impl iceoryx2::service::internal::ServiceInternal<Service> for Service {}
