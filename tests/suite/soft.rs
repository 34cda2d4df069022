//! Scenes of soft bodies with given surfaces, for the tests of several properties.

use std::fmt::Write;

use nalgebra::{Point3, Vector3};
use pliant::TriangleMesh;
use pliant::scene::{Scene, parse};
use pliant::simulation::{Assets, Audit, AuditedSurface, CrossingCounts, Plan, Simulation};

/// A soft body of a scene: name, surface [m], held vertices, force on each vertex [N].
pub struct Soft {
    pub name: &'static str,
    pub mesh: TriangleMesh,
    pub held: Vec<u32>,
    /// The bone that holds them; `far` is at rest.
    pub bone: &'static str,
    pub force: [f64; 3],
}

impl Soft {
    pub fn new(name: &'static str, mesh: TriangleMesh) -> Self {
        Self {
            name,
            mesh,
            held: Vec::new(),
            bone: "far",
            force: [0.0; 3],
        }
    }
}

/// A surface moved by a vector [m].
pub fn moved(mut mesh: TriangleMesh, by: [f64; 3]) -> TriangleMesh {
    let by = Vector3::from(by);
    mesh.vertices.iter_mut().for_each(|x| *x += by);
    mesh
}

/// The text of a scene of these bodies, with a bone far away that holds their held vertices; `more`
/// has the effects and all else.
pub fn text(bodies: &[Soft], frames: usize, more: &str) -> String {
    let mut text = format!(
        "name = 'soft'\nframes = {frames}\nframe_rate = '60 Hz'\n[[bone]]\nname = 'far'\nshape = 'press-plate'\n\
         [bone.motion]\nkeys = [{{ frame = 0, translation = ['0 m', '-9 m', '0 m'] }}]\n"
    );
    for Soft {
        name,
        mesh,
        held,
        bone,
        force,
    } in bodies
    {
        let _ = writeln!(text, "[[muscle]]\nname = '{name}'\nshape = 'soft-cube'");
        if !held.is_empty() {
            let _ = writeln!(
                text,
                "[[muscle.attachment]]\nbone = '{bone}'\nlimit = '100 %'\nvertices = {held:?}"
            );
        }
        if *force != [0.0; 3] {
            let vertices: Vec<usize> = (0..mesh.vertices.len()).collect();
            let [x, y, z] = force;
            let _ = writeln!(
                text,
                "[[muscle.force]]\nvertices = {vertices:?}\nforce = ['{x} N', '{y} N', '{z} N']"
            );
        }
    }
    text + more
}

/// The scene of a text.
pub fn scene(text: &str) -> Scene {
    let mut scene = parse(text, "soft.toml", std::path::Path::new("."))
        .unwrap_or_else(|error| panic!("{}", error.terse()));
    scene.most_held = 1.0;
    scene
}

/// A simulation whose muscles have the surfaces of `bodies`.
pub fn simulation(scene: &Scene, bodies: &[Soft]) -> Simulation {
    let mut assets = Assets::load(scene).unwrap_or_else(|error| panic!("{}", error.terse()));
    for (asset, body) in assets.muscles.iter_mut().zip(bodies) {
        asset.mesh = body.mesh.clone();
    }
    let plan = Plan::new(scene, &assets);
    Simulation::with(scene.clone(), assets, plan)
        .unwrap_or_else(|error| panic!("{}", error.terse()))
}

/// Positions of a body [m].
pub fn positions(simulation: &Simulation, body: usize) -> &[Point3<f64>] {
    &simulation.bodies[body].system.particles.position
}

/// Mean position of a body [m].
pub fn mean(simulation: &Simulation, body: usize) -> Vector3<f64> {
    let x = positions(simulation, body);
    x.iter().map(|x| x.coords).sum::<Vector3<f64>>() / x.len() as f64
}

/// Crossings of all bodies, by the audit.
pub fn crossings(simulation: &Simulation) -> CrossingCounts {
    let surfaces: Vec<AuditedSurface<'_>> = simulation
        .bodies
        .iter()
        .map(|body| AuditedSurface {
            name: &body.name,
            rigid: false,
            vertices: &body.system.particles.position,
            triangles: &body.rest.triangles,
            held: &[],
        })
        .collect();
    let found = Audit::new().frame(&surfaces);
    assert!(found.complete && found.not_finite.is_empty(), "{found:?}");
    found.crossings
}

/// The bits of all positions and velocities.
pub fn bits(simulation: &Simulation) -> Vec<u64> {
    let particles = simulation.bodies.iter().map(|b| &b.system.particles);
    particles.flat_map(crate::bodies::bits).collect()
}
