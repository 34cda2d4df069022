//! What makes a surface a muscle: where it is held.

pub mod attachments;
