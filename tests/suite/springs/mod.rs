//! Spring systems: formulas of the sources compared with their numbers, forces with energies,
//! orders and limits of steps.

mod contact;
mod formulas;
mod forces;
mod integrators;
mod statements;
mod thesis;
