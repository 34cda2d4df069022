//! Why a surface has no map to the sphere.

use crate::mesh::MeshError;

/// What keeps a surface from being mapped to the sphere, and where.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SphereError {
    /// Indices or coordinates are none.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// No tetrahedron's worth of points.
    #[error(
        "{vertices} vertices and {triangles} triangles; a closed surface needs at least 4 of each"
    )]
    TooFew {
        /// Number of vertices.
        vertices: usize,
        /// Number of triangles.
        triangles: usize,
    },
    /// An edge with one triangle.
    #[error(
        "the surface is open: {edges} edges have one triangle only, the first between vertices {} and {}; fill the hole",
        first[0], first[1]
    )]
    Open {
        /// Number of such edges.
        edges: usize,
        /// The first of them.
        first: [u32; 2],
    },
    /// An edge with three or more triangles.
    #[error("the edge between vertices {} and {} has {triangles} triangles; it must have two", edge[0], edge[1])]
    Edge {
        /// Its vertices.
        edge: [u32; 2],
        /// Its triangles.
        triangles: usize,
    },
    /// Two triangles that run their edge the same way.
    #[error(
        "triangles {} and {} at the edge between vertices {} and {} are turned against each other; turn one round",
        triangles[0], triangles[1], edge[0], edge[1]
    )]
    Turned {
        /// The edge.
        edge: [u32; 2],
        /// The two triangles.
        triangles: [u32; 2],
    },
    /// A vertex at which several fans of triangles touch.
    #[error("at vertex {vertex} parts of the surface touch in one point; split it")]
    Vertex {
        /// The vertex.
        vertex: u32,
    },
    /// A vertex of no triangle.
    #[error("{count} vertices belong to no triangle, the first is vertex {vertex}; drop them")]
    Unused {
        /// The first such vertex.
        vertex: u32,
        /// How many there are.
        count: usize,
    },
    /// Several surfaces.
    #[error(
        "{pieces} separate surfaces, where there must be one; vertex {vertex} is the first that is not joined to vertex 0"
    )]
    Pieces {
        /// How many.
        pieces: usize,
        /// The first vertex of the second piece.
        vertex: u32,
    },
    /// Handles.
    #[error(
        "the surface has {genus} {} (V - E + F = {euler}); only one without (V - E + F = 2) can be mapped to the sphere",
        if *genus == 1 { "handle" } else { "handles" }
    )]
    Genus {
        /// Number of handles.
        genus: i64,
        /// V - E + F.
        euler: i64,
    },
    /// No centre inside the body was found.
    #[error("no centre inside the body: the surface winds {winding} times about ({}, {}, {}) m", at[0], at[1], at[2])]
    Centre {
        /// Winding number there.
        winding: i32,
        /// The best place \[m\].
        at: [f64; 3],
    },
    /// Relaxation fell into a cap in every attempt.
    #[error(
        "relaxation collapsed in all {attempts} attempts: nothing came nearer than {gap} to the antipode of vertex {anchor}; \
         use the robust map"
    )]
    Collapsed {
        /// Attempts made.
        attempts: usize,
        /// The anchor of the last attempt that was missed most.
        anchor: u32,
        /// Distance from its antipode to the nearest vertex, on the unit sphere.
        gap: f64,
    },
    /// Relaxation left triangles turned in.
    #[error(
        "{flipped} of {triangles} triangles are still turned in after {sweeps} sweeps, the first is triangle {triangle}; \
         use the robust map"
    )]
    Flipped {
        /// How many.
        flipped: usize,
        /// Of how many.
        triangles: usize,
        /// The first.
        triangle: u32,
        /// Sweeps made in the last attempt.
        sweeps: usize,
    },
    /// A map was given in which triangles are not positively oriented.
    #[error(
        "{flipped} triangles of the map are not turned outward, the first is triangle {triangle}"
    )]
    NotPositive {
        /// How many.
        flipped: usize,
        /// The first.
        triangle: u32,
    },
    /// A map was given that covers the sphere more than once.
    #[error("the map covers the sphere {times} times, where once is wanted")]
    Covers {
        /// How often.
        times: f64,
    },
    /// A point of a map that is given is not on the unit sphere.
    #[error("vertex {vertex} lies at {radius} from the centre of the map, where 1 is wanted")]
    Radius {
        /// The vertex.
        vertex: u32,
        /// Its distance from the centre.
        radius: f64,
    },
    /// No room for a vertex that doubles can tell from its neighbours.
    #[error(
        "no room on the sphere for vertex {vertex} between its neighbours, with {placed} of {vertices} vertices placed; where \
         a body has few vertices around and many along, give it more around or fewer along"
    )]
    Crowded {
        /// The vertex.
        vertex: u32,
        /// Vertices placed before.
        placed: usize,
        /// All of them.
        vertices: usize,
    },
    /// No edge can be contracted, which a triangulated sphere never does.
    #[error("no edge at vertex {vertex} can be contracted, with {left} vertices left")]
    Stuck {
        /// A vertex that is left.
        vertex: u32,
        /// How many are left.
        left: usize,
    },
}
