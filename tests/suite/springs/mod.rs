//! Spring systems: formulas of the sources against their numbers, forces against energies, orders and limits of steps.

mod contact;
mod formulas;
mod forces;
mod integrators;
mod statements;
mod thesis;
