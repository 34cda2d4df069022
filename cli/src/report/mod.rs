//! Reports: tables on the terminal, line plots as SVG, and one HTML file with everything; and the
//! files of a run.
//!
//! Data in, text out: a [`Report`] is independent of simulations. Every string is escaped. The HTML
//! has no script except that of a turntable, and loads nothing. The public modules convert a run to
//! files and to a report.

pub mod audit;
pub mod biceps;
pub mod fibres;
pub mod fit;
pub mod unload;
pub mod folder;
pub mod frames;
pub mod gathered;
mod html;
pub mod implant;
mod lattice;
mod measured;
pub mod moment_arms;
pub mod morph;
pub mod muscles;
pub mod output;
pub mod pictures;
mod places;
pub mod quality;
pub mod plan;
mod plot;
pub mod provenance;
pub mod record;
pub mod register;
pub mod results;
pub mod run;
pub mod sensitivities;
mod shots;
mod skin;
pub mod springs;
pub mod skin_accuracy;
pub mod work_precision;
mod table;
mod turntable;

pub use html::Report;
pub use plot::{LinePlot, Series};
pub use table::Table;
pub use turntable::{Side, Turntable};
