//! Tables, plots, html; and the files of a run.

pub mod folder;
pub mod frames;
pub mod record;
pub mod results;
pub mod summary;
