//! The service type of the channels: the `ipc` service of iceoryx2 with one part replaced.
//!
//! At every send, iceoryx2 allocates a small reference-counted block on the heap for the lent message. [`Recycled`]
//! uses the block of the last send again, so that sending allocates nothing. Memory layout and protocol are those of
//! `ipc`, so clients in other languages, which use `ipc`, see no difference.

use std::fmt::Debug;

use iceoryx2::unique_id_generator::unique_system_id::UniqueSystemId;
use iceoryx2_bb_elementary_traits::{testing::abandonable::Abandonable, zero_copy_send::ZeroCopySend};
use iceoryx2_cal::{
    bag, dynamic_storage, event, hash, monitoring, reactor, resizable_shared_memory, serialize, shared_memory,
    shm_allocator::{bump_allocator::BumpAllocator, pool_allocator::PoolAllocator},
    static_storage, zero_copy_connection,
};

use super::recycled::Recycled;

/// The service type of all channels.
#[derive(Debug, Clone)]
pub struct Service {}

impl iceoryx2::service::Service for Service {
    type StaticStorage = static_storage::recommended::Ipc;
    type ConfigSerializer = serialize::recommended::Recommended;
    type PersistentDynamicStorage<T: Debug + Send + Sync + ZeroCopySend + 'static> =
        dynamic_storage::recommended::PersistentIpc<T>;
    type Bag = bag::recommended::Recommended;
    type DynamicStorage<T: Debug + Send + Sync + ZeroCopySend + 'static> = dynamic_storage::recommended::Ipc<T>;
    type ServiceNameHasher = hash::recommended::Recommended;
    type SharedMemory = shared_memory::recommended::Ipc<PoolAllocator>;
    type ResizableSharedMemory = resizable_shared_memory::recommended::Ipc<PoolAllocator>;
    type Connection = zero_copy_connection::recommended::Ipc;
    type Event = event::recommended::Ipc;
    type Monitoring = monitoring::recommended::Ipc;
    type Reactor = reactor::recommended::Ipc;
    type ArcThreadSafetyPolicy<T: Send + Debug + Abandonable> = Recycled<T>;
    type BlackboardMgmt<KeyType: Send + Sync + Debug + ZeroCopySend + 'static> =
        dynamic_storage::recommended::Ipc<KeyType>;
    type BlackboardPayload = shared_memory::recommended::Ipc<BumpAllocator>;
    type UniqueId = UniqueSystemId;
}

impl iceoryx2::service::internal::ServiceInternal<Service> for Service {}
