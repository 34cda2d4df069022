//! Attachments of muscles.

pub mod attachments;
