//! Reports for people: tables on the terminal, line plots as SVG, and one HTML file that holds everything; and the
//! files of a run.
//!
//! Plain data in, text out: a [`Report`] knows nothing of simulations. Every string is escaped; the HTML runs no script
//! but that of a turn-table and loads nothing from elsewhere. What turns a run into files and into a report is in the public modules.

pub mod biceps;
pub mod fibres;
pub mod folder;
pub mod frames;
pub mod gathered;
mod html;
pub mod implant;
mod lattice;
pub mod moment_arms;
pub mod morph;
pub mod output;
pub mod page;
pub mod pictures;
mod plot;
pub mod record;
pub mod register;
pub mod results;
pub mod run;
mod skin;
pub mod skin_accuracy;
pub mod summary;
pub mod work_precision;
mod table;
mod turntable;

pub use html::Report;
pub use plot::{LinePlot, Series};
pub use table::Table;
pub use turntable::{Side, Turntable};
