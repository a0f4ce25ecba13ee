//! Figures at the end of a command: tables for people, JSON for programs, and the outputs that both go to.
//!
//! Nothing here runs beside the loop or in a stage. A command fills a report after its work is done.

pub mod block;
pub mod chart;
pub mod control_loop;
pub mod events;
pub mod figures;
pub mod margins;
pub mod motion;
pub mod output;
pub mod page;
pub mod rows;
pub mod status;
pub mod table;
pub mod teeth;
pub mod why;
