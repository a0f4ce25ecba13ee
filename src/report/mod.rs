//! Figures at the end of a command: tables for people, JSON for programs, and where both go.

pub mod control_loop;
pub mod figures;
pub mod output;
pub mod table;
