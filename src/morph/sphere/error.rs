//! Errors of maps to the sphere.

use crate::mesh::MeshError;

/// The reason why a surface has no map to the sphere, with its place.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SphereError {
    /// Indices or coordinates are invalid.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// There are too few points for a tetrahedron.
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
    /// An edge has three or more triangles.
    #[error("the edge between vertices {} and {} has {triangles} triangles; it must have two", edge[0], edge[1])]
    Edge {
        /// Vertices of the edge.
        edge: [u32; 2],
        /// Number of its triangles.
        triangles: usize,
    },
    /// Two triangles traverse their edge in the same direction.
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
    /// Several fans of triangles touch at a vertex.
    #[error("at vertex {vertex} parts of the surface touch in one point; split it")]
    Vertex {
        /// The vertex.
        vertex: u32,
    },
    /// A vertex has no triangle.
    #[error("{count} vertices belong to no triangle, the first is vertex {vertex}; drop them")]
    Unused {
        /// The first such vertex.
        vertex: u32,
        /// Number of such vertices.
        count: usize,
    },
    /// There are several components.
    #[error(
        "{pieces} separate surfaces, where there must be one; vertex {vertex} is the first that is not joined to vertex 0"
    )]
    Pieces {
        /// Number of components.
        pieces: usize,
        /// The first vertex of the second component.
        vertex: u32,
    },
    /// The surface has handles.
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
    /// No point inside the body was found.
    #[error("no centre inside the body: the surface winds {winding} times about ({}, {}, {}) m", at[0], at[1], at[2])]
    Centre {
        /// Winding number at the best point.
        winding: i32,
        /// The best point \[m\].
        at: [f64; 3],
    },
    /// The relaxation collapsed in every attempt.
    #[error(
        "relaxation collapsed in all {attempts} attempts: nothing came nearer than {gap} to the antipode of vertex {anchor}; \
         use the robust map"
    )]
    Collapsed {
        /// Number of attempts.
        attempts: usize,
        /// The anchor of the last attempt with the greatest gap.
        anchor: u32,
        /// Distance from the antipode of that anchor to the nearest vertex, on the unit sphere.
        gap: f64,
    },
    /// Reversed triangles remain after the relaxation.
    #[error(
        "{flipped} of {triangles} triangles are still turned in after {sweeps} sweeps, the first is triangle {triangle}; \
         use the robust map"
    )]
    Flipped {
        /// Number of reversed triangles.
        flipped: usize,
        /// Number of all triangles.
        triangles: usize,
        /// The first reversed triangle.
        triangle: u32,
        /// Number of sweeps of the last attempt.
        sweeps: usize,
    },
    /// A given map has triangles that are not positively oriented.
    #[error(
        "{flipped} triangles of the map are not turned outward, the first is triangle {triangle}"
    )]
    NotPositive {
        /// Number of such triangles.
        flipped: usize,
        /// The first such triangle.
        triangle: u32,
    },
    /// A given map covers the sphere more than once.
    #[error("the map covers the sphere {times} times, where once is expected")]
    Covers {
        /// Number of covers.
        times: f64,
    },
    /// A point of a given map is not on the unit sphere.
    #[error("vertex {vertex} lies at {radius} from the centre of the map, where 1 is expected")]
    Radius {
        /// The vertex.
        vertex: u32,
        /// Distance of the point from the centre.
        radius: f64,
    },
    /// A vertex has no position that doubles can distinguish from its neighbours.
    #[error(
        "no room on the sphere for vertex {vertex} between its neighbours, with {placed} of {vertices} vertices placed; where \
         a body has few vertices around and many along, give it more around or fewer along"
    )]
    Crowded {
        /// The vertex.
        vertex: u32,
        /// Number of vertices placed before.
        placed: usize,
        /// Number of all vertices.
        vertices: usize,
    },
    /// No edge can be contracted, which is impossible for a triangulated sphere.
    #[error("no edge at vertex {vertex} can be contracted, with {left} vertices left")]
    Stuck {
        /// A remaining vertex.
        vertex: u32,
        /// Number of remaining vertices.
        left: usize,
    },
}
