//! Messages of a group kept and written to files, beside the loop.
//!
//! ```text
//! channels --tapes: the last seconds of each--> black box --a latch, a death--> file (MCAP, CDR, zstd)
//! ```
//!
//! | file | what |
//! |---|---|
//! | `tape` | the last messages of one channel |
//! | `black_box` | when a file is written, and where |
//! | `file` | the file |
//! | `cdr` | a message as bytes, and its schema |

pub mod black_box;
mod cdr;
mod file;
pub mod tape;
