//! Colours of the screen. Every colour has a word beside it, so that nothing is lost without colours.

use ratatui::style::{Color, Modifier, Style};

/// Everything is as it should be.
pub const GOOD: Style = Style::new().fg(Color::Green);
/// Something is unusual.
pub const WARN: Style = Style::new().fg(Color::Yellow);
/// Something is wrong.
pub const BAD: Style = Style::new().fg(Color::Red).add_modifier(Modifier::BOLD);
/// Names of columns and keys.
pub const QUIET: Style = Style::new().add_modifier(Modifier::DIM);
/// The chosen tab.
pub const CHOSEN: Style = Style::new().add_modifier(Modifier::REVERSED);
/// What is old.
pub const OLD: Style = Style::new().add_modifier(Modifier::DIM);
