//! What the crate promises, one file a promise; `docs/verification.md` says which property is shown where.
// `!(error <= tolerance)` is also true for NaN: that is why controls are written so.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

mod accuracy;
mod biceps;
mod bodies;
mod broad_phase;
mod checkpoint;
mod conserved_volume;
mod constraints;
mod contact;
mod degenerate;
mod determinism;
mod drift;
mod effects;
mod enclosed_volume;
mod equilibrium;
mod errata;
mod fibres;
mod filled;
#[path = "../io.rs"]
mod io;
mod lanes;
mod lattice;
mod moment_arms;
mod morph;
mod oracles;
mod scene;
mod scenes;
mod skin;
mod solvers;
mod springs;
mod tolerances;
