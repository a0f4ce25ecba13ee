//! Many machines on one screen, and a simulated machine on another computer, over Zenoh.
//!
//! ```text
//! group --bridge--> router of the site --> top, record, programs of yours
//! group <--stage--> router of the site <--> plant
//! ```
//!
//! | file | what |
//! |---|---|
//! | `key` | names of sites and machines, and keys |
//! | `stamp` | the attachment of every message: run, number, time |
//! | `content` | payloads and their encodings |
//! | `settings`, `connection` | the file of a bridge, and how a router is reached |
//! | `group` | the group on this machine, read only |
//! | `pace`, `events`, `ring`, `recordings` | what is published, when, and what waits for it |
//! | `bridge` | from the group to the network |
//! | `kernel` | clock, priority and memory |
//! | `say` | lines for whoever operates |
//! | `fleet`, `listen` | what a receiver knows, and how old it is |
//! | `top`, `page` | all machines in a table, and in a browser |
//! | `command` | commands over the network, with the feature `commands` |
//! | `plant` | the simulated machine on another computer, in lock-step with the group |
//! | `record` | all machines into files at the site |
//! | `router` | a router for small sites and trials |
//! | `bench` | many simulated machines on one router |

pub mod bench;
pub mod bridge;
#[cfg(feature = "commands")]
pub mod command;
pub mod connection;
pub mod content;
pub mod events;
pub mod fleet;
pub mod group;
pub mod kernel;
pub mod key;
pub mod listen;
pub mod pace;
pub mod page;
pub mod plant;
pub mod record;
pub mod recordings;
pub mod ring;
pub mod router;
pub mod say;
pub mod settings;
pub mod stamp;
pub mod top;
