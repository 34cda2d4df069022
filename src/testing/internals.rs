//! The internals of the library that its tests and benches examine, in the rooms of the library. They
//! can change without notice.

/// Internals of `accuracy`.
pub mod accuracy {
    pub use crate::accuracy::candidates::Candidate;
    pub use crate::accuracy::choice::reaches;
    pub use crate::accuracy::trajectory::Trajectory;
}

/// Internals of `constraints`.
pub mod constraints {
    pub use crate::constraints::blocks::Block;
    pub use crate::constraints::direction::Direction;
    pub use crate::constraints::fibre_distance::FibreDistance;
    pub use crate::constraints::kernel::{Kernel, LaneConstraint, MOST_NUMBERS, Periodic};
    pub use crate::constraints::lanes::{Lane, Several, SimdWidth};
    pub use crate::constraints::potential::Memory;
    pub use crate::constraints::second::Second;
}

/// Internals of `contact`.
pub mod contact {
    pub use crate::contact::ccd::{Advance, advance};
    pub use crate::contact::comparison::detection::{Errors, Method, Prepared, methods, timed};
    pub use crate::contact::comparison::responses::{MovedBone, compare_responses};
    pub use crate::contact::comparison::{Query, queries};
    pub use crate::contact::escape_field::EscapeField;
    pub use crate::contact::gap::{difference, height, lower};
    pub use crate::contact::penetration_response::{Length, PenetrationResponse};
    pub use crate::contact::response::Counts;

    /// Internals of `contact::broad_phase`.
    pub mod broad_phase {
        pub use crate::contact::broad_phase::*;
    }
}

/// Internals of `fibres`.
pub mod fibres {
    pub use crate::fibres::attachment::MuscleEnd;
    pub use crate::fibres::solid::Closed;
    pub use crate::fibres::template::{Grid, Sampling};

    /// Internals of `fibres::springs`.
    pub mod springs {
        pub use crate::fibres::springs::network::rest;
        pub use crate::fibres::springs::*;
    }

    /// Internals of `fibres::slices`.
    pub mod slices {
        pub use crate::fibres::slices::contour::Slicer;
        pub use crate::fibres::slices::coordinates::{Outline, on_square};
        pub use crate::fibres::slices::*;
    }
}

/// Internals of `geometric`.
pub mod geometric {
    pub use crate::geometric::chain::Caps;
    pub use crate::geometric::frame::{Frame, FrameError, Placed};
    pub use crate::geometric::surface::{Fineness, surface};
}

/// Internals of `io`.
pub mod io {
    /// Internals of `io::ply`.
    pub mod ply {
        pub use crate::io::ply::*;
    }

    /// Internals of `io::stl`.
    pub mod stl {
        pub use crate::io::stl::*;
    }

    /// Internals of `io::vtk`.
    pub mod vtk {
        pub use crate::io::vtk::*;
    }
}

/// Internals of `mesh`.
pub mod mesh {
    pub use crate::mesh::sum::{NeumaierSum, tree_sum};
    pub use crate::mesh::winding::{WindingTree, winding_number_direct};

    /// Internals of `mesh::order`.
    pub mod order {
        pub use crate::mesh::order::*;
    }
}

/// Internals of `moment_arms`.
pub mod moment_arms {
    pub use crate::moment_arms::names::means;
}

/// Internals of `morph`.
pub mod morph {
    pub use crate::morph::correspondence::Alike;
    pub use crate::morph::locate::Locator;
    pub use crate::morph::overlay::Overlay;
    pub use crate::morph::overlay::{OverlayError, OverlayOrigin, arcs_cross};
    pub use crate::morph::pose::Start;
    pub use crate::morph::sphere::SphereMap;

    /// Internals of `morph::register`.
    pub mod register {
        pub use crate::morph::register::fit::draws_needed;
        pub use crate::morph::register::icp::{Measure, PairWeight, Reject};
        pub use crate::morph::register::nonrigid::Bent;
    }

    /// Internals of `morph::sphere`.
    pub mod sphere {
        pub use crate::morph::sphere::centre::{bounding_sphere, inside_near};
        pub use crate::morph::sphere::surface::{solid_angle, turn};
        pub use crate::morph::sphere::*;
    }

    /// Internals of `morph::align`.
    pub mod align {
        pub use crate::morph::align::*;
    }
}

/// Internals of `scene`.
pub mod scene {
    pub use crate::scene::effects::material_constants;
    pub use crate::scene::keys::{KeyKind, Limit};
}

/// Internals of `simulation`.
pub mod simulation {
    pub use crate::simulation::equilibrium::Equilibrium;

    /// Internals of `simulation::audit`.
    pub mod audit {
        pub use crate::simulation::audit::*;
    }
}

/// Internals of `skin`.
pub mod skin {
    pub use crate::skin::implant::upper;
    pub use crate::skin::layers::springs_of;
    pub use crate::skin::plan::over_ball;
    pub use crate::skin::settle::{FilledImplant, SkinSystem};
    pub use crate::skin::soundness::MovedSurface;
    pub use crate::skin::support_surface::SupportSurface;
}

/// Internals of `solvers`.
pub mod solvers {
    pub use crate::solvers::energy::Inertia;
    pub use crate::solvers::sparse::Factor;
}

/// Internals of `springs`.
pub mod springs {
    /// Internals of `springs::cloth_patterns`.
    pub mod cloth_patterns {
        pub use crate::springs::cloth_patterns::*;
    }

    pub use crate::springs::anchors::anchors;
    pub use crate::springs::angular::{AngularSpring, angular_springs};
    pub use crate::springs::buckling::{Buckling, Strips};
    pub use crate::springs::layers::{LayerMaterial, layers};
    pub use crate::springs::spring_set::PairError;
    pub use crate::springs::volume::{CentreSprings, TrueVolume, VolumeError};

    /// Internals of `springs::lattice`.
    pub mod lattice {
        pub use crate::springs::lattice::stability::{largest_stiffness, stability_limit};
    }

    /// Internals of `springs::contact`.
    pub mod contact {
        pub use crate::springs::contact::edges::{
            Crossing, Edge, EdgeOwners, Found, Sheet, crossing, crossings_of,
        };
        pub use crate::springs::contact::hierarchy::{BoundKind, Hierarchy};
        pub use crate::springs::contact::impulse::{ContactPart, impulse};
        pub use crate::springs::contact::voxels::{VoxelError, VoxelGrid};
        pub use crate::springs::contact::*;
    }

    /// Internals of `springs::mass`.
    pub mod mass {
        pub use crate::springs::mass::*;
    }

    /// Internals of `springs::stiffness`.
    pub mod stiffness {
        pub use crate::springs::stiffness::*;
    }
}

/// Internals of `simd`.
pub mod simd {
    pub use crate::simd::*;
}

/// Internals of `rest`.
pub mod rest {
    pub use crate::rest::*;
}

/// Internals of `particles`.
pub mod particles {
    pub use crate::particles::*;
}

/// Internals of `encode`.
pub mod encode {
    pub use crate::encode::*;
}
