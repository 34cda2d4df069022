//! Tables, plots, html.
