//! What the crate promises, one file a promise; `docs/verification.md` says which property is shown where.

mod accuracy;
mod biceps;
mod apart;
mod bodies;
mod bonded;
mod broad_phase;
mod built;
mod certified;
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
mod fascia;
mod fibres;
mod filled;
mod intervals;
#[path = "../io.rs"]
mod io;
mod lanes;
mod lattice;
mod laws;
mod minima;
mod moment_arms;
mod opensim;
mod mesh_error;
mod morph;
mod unload;
mod oracles;
mod pairs;
mod refinement;
mod scale;
mod scene;
mod scenes;
mod skin;
mod soft;
mod solvers;
mod spring_bodies;
mod springs;
mod step_control;
mod tangent;
mod tolerances;
mod tone;

/// Value of an environment variable; `PLIANT_DATA` that is not set is the folder `shared/data` beside the repository.
fn measured_data(name: &str) -> Option<std::ffi::OsString> {
    let beside = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    std::env::var_os(name)
        .or_else(|| (name == "PLIANT_DATA" && beside.is_dir()).then(|| beside.into()))
}
