//! What can be wrong with the devices and messages of a machine file.

use can::canopen::MappingError;

/// Why a machine has no network of devices.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum WiringError {
    /// The machine file has no bus, or no devices of an axis.
    #[error("{0}: found nothing; allowed: a table, with source.kind = \"can\"")]
    Missing(String),
    /// The bus is none.
    #[error("can.interface: {0}")]
    Address(String),
    /// A message or signal is none, with its place, what was found, and what is allowed.
    #[error("{0}")]
    Text(String),
    /// A number is none of a node.
    #[error("axis.{axis}.can: found node {found}; allowed: 1 to 127")]
    Node {
        /// The axis.
        axis: String,
        /// The number.
        found: u8,
    },
    /// The messages of a device cannot be made.
    #[error("axis.{axis}.can: {source}")]
    Mapping {
        /// The axis.
        axis: String,
        /// What is wrong.
        #[source]
        source: MappingError,
    },
}
