//! `hydraxis-fleet router`: a router of Zenoh out of its own configuration file, as `zenohd` would be.
//!
//! It serves small sites and trials. It has no plugins and no storages.

use std::path::Path;

use thiserror::Error;
use zenoh::{Config, Session, Wait};

/// Why a router does not start.
#[derive(Debug, Error)]
pub enum RouterError {
    /// The file is no configuration.
    #[error("{file}: {source}")]
    File {
        /// The file.
        file: String,
        /// What Zenoh said.
        source: zenoh::Error,
    },
    /// It is of another kind of node.
    #[error("{file}: mode: found {found}; allowed: \"router\"")]
    Mode {
        /// The file.
        file: String,
        /// The mode in it.
        found: String,
    },
    /// It cannot listen, or Zenoh refuses something of it.
    #[error("Zenoh: {0}")]
    Zenoh(#[from] zenoh::Error),
}

/// Starts a router.
///
/// # Errors
/// The file is no configuration of a router, or its address is taken.
pub fn open(path: &Path) -> Result<Session, RouterError> {
    let file = path.display().to_string();
    let config = Config::from_file(path).map_err(|source| RouterError::File { file: file.clone(), source })?;
    let found = config.get_json("mode").unwrap_or_default();
    if found != "\"router\"" {
        return Err(RouterError::Mode { file, found });
    }
    Ok(zenoh::open(config).wait()?)
}
