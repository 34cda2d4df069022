//! Reports for people: tables on the terminal, line plots as SVG, and one HTML file that holds everything.
//!
//! Plain data in, text out: a [`Report`] knows nothing of simulations. Every string is escaped; the HTML runs no script
//! and loads nothing from elsewhere.

mod html;
mod plot;
mod table;

pub use html::Report;
pub use plot::{LinePlot, Series};
pub use table::Table;

pub use crate::render::number;
