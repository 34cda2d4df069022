//! The software renderer.
