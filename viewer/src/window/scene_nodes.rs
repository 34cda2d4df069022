//! Data for the graphics card: surfaces coloured by a field, bones, lines and points.

use std::sync::Arc;

use kiss3d::prelude::{
    AlphaMode, Color, Light, LightType, Polyline3d, Pose3, Quat, SceneNode3d, Texture,
    TextureManager, Vec2, Vec3, Window,
};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

use crate::colour::Colouring;
use crate::snapshot::{BodyShot, Shot, Stage, Tissue};
use pliant::mesh::measures::volume;
use pliant::mesh::{Topology, TriangleMesh};
use pliant_render::colour::{self, Rgb};
use pliant_render::{ColourMap, Frame};

/// Steps of a colour map in its texture.
const STEPS: usize = 256;

/// Colours of points: attached, in contact, fixed, dragged, picked.
const HELD: Rgb = [0.25, 0.55, 0.95];
const TOUCHING: Rgb = [1.0, 0.55, 0.1];
const FIXED: Rgb = [0.95, 0.2, 0.9];
const DRAGGED: Rgb = [1.0, 1.0, 0.2];
const PICKED: Rgb = [0.95, 0.1, 0.1];

/// Visible objects and their style.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewSettings {
    /// Opacity of bones, 0 to 1.
    pub bones: f32,
    /// Opacity of skin and implants, 0 to 1.
    pub skin: f32,
    /// Edges over surfaces.
    pub wireframe: bool,
    /// Fibres; bodies are then translucent.
    pub fibres: bool,
    /// Attached vertices.
    pub attachments: bool,
    /// Vertices in contact.
    pub contacts: bool,
    /// Direction of the light, rotated to the right and up from the eye [rad].
    pub light: (f64, f64),
}

impl Default for ViewSettings {
    fn default() -> Self {
        let (bones, skin) = (0.45, 0.8);
        Self {
            bones,
            skin,
            wireframe: false,
            fibres: true,
            attachments: false,
            contacts: false,
            light: (-0.5, 0.6),
        }
    }
}

/// The nodes of a stage.
pub struct SceneNodes {
    root: SceneNode3d,
    light: SceneNode3d,
    bodies: Vec<SceneNode3d>,
    bones: Vec<SceneNode3d>,
    stage: Arc<Stage>,
    map: Arc<Texture>,
    serial: Option<u64>,
}

fn vec3(p: &Point3<f64>) -> Vec3 {
    Vec3::new(p.x as f32, p.y as f32, p.z as f32)
}

pub fn pose(isometry: &Isometry3<f64>) -> Pose3 {
    let t = isometry.translation.vector;
    Pose3::from_parts(vec3(&Point3::from(t)), quaternion(&isometry.rotation))
}

fn quaternion(q: &UnitQuaternion<f64>) -> Quat {
    Quat::from_xyzw(q.i as f32, q.j as f32, q.k as f32, q.w as f32)
}

/// A screen colour as linear light, the space of the graphics card.
pub fn ink(colour: Rgb, opacity: f32) -> Color {
    let [r, g, b] = colour.map(linear);
    Color::new(r, g, b, opacity)
}

/// A component of sRGB as linear light (IEC 61966-2-1).
fn linear(c: f32) -> f32 {
    let c = f64::from(c);
    let light = if c <= 0.04045 {
        c / 12.92
    } else {
        libm::pow((c + 0.055) / 1.055, 2.4)
    };
    light as f32
}

impl SceneNodes {
    /// An empty scene with a light.
    pub fn new() -> Self {
        let mut root = SceneNode3d::empty();
        let light = root.add_directional_light(Vec3::new(0.0, 0.0, -1.0));
        Self {
            root,
            light,
            bodies: Vec::new(),
            bones: Vec::new(),
            stage: Arc::default(),
            map: map(),
            serial: None,
        }
    }

    /// Adds invisible objects of each kind: drivers prepare a kind on its first use.
    pub fn rehearse(&mut self) {
        let point = vec![Vec3::ZERO; 3];
        for opacity in [1.0, 0.5] {
            let uvs = Some(vec![Vec2::ZERO; 3]);
            let mut node = self.add(point.clone(), vec![[0, 1, 2]], Some(vec![Vec3::Z; 3]), uvs);
            node.set_texture(self.map.clone());
            node.set_color(ink(colour::BONE, opacity));
            node.set_alpha_mode(if opacity < 1.0 {
                AlphaMode::Blend
            } else {
                AlphaMode::Opaque
            });
            // The first stage removes them.
            self.bodies.push(node);
        }
    }

    /// The same as [`Self::rehearse`] for lines and points.
    pub fn rehearse_lines(window: &mut Window) {
        let nothing = ink(colour::BONE, 0.0);
        window.draw_polyline(
            &Polyline3d::new(vec![Vec3::ZERO; 2])
                .with_color(nothing)
                .with_width(1.0),
        );
        window.draw_point(Vec3::ZERO, nothing, 0.0);
    }

    /// The root node for rendering.
    pub fn root(&mut self) -> &mut SceneNode3d {
        &mut self.root
    }

    /// Creates the nodes of another stage.
    fn set(&mut self, stage: &Arc<Stage>) {
        self.bodies
            .iter_mut()
            .chain(&mut self.bones)
            .for_each(SceneNode3d::remove);
        self.bodies.clear();
        self.bones.clear();
        for body in &stage.bodies {
            let count = body
                .triangles
                .iter()
                .flatten()
                .max()
                .map_or(0, |v| *v as usize + 1);
            let vertices = vec![Vec3::ZERO; count];
            let normals = Some(vec![Vec3::Z; count]);
            let uvs = Some(vec![Vec2::ZERO; count]);
            let mut node = self.add(vertices, body.triangles.clone(), normals, uvs);
            node.set_texture(self.map.clone());
            self.bodies.push(node);
        }
        for (_, mesh) in &stage.bones {
            let vertices = mesh.vertices.iter().map(vec3).collect();
            let mut node = self.add(vertices, mesh.triangles.clone(), Some(normals(mesh)), None);
            node.set_color(ink(colour::BONE, 1.0));
            // The far side of a translucent body would also be visible, at twice the cost.
            node.enable_backface_culling(is_solid(mesh));
            self.bones.push(node);
        }
        self.stage = stage.clone();
    }

    fn add(
        &mut self,
        vertices: Vec<Vec3>,
        faces: Vec<[u32; 3]>,
        normals: Option<Vec<Vec3>>,
        uvs: Option<Vec<Vec2>>,
    ) -> SceneNode3d {
        let mesh = kiss3d::resource::GpuMesh3d::new(vertices, faces, normals, uvs, true);
        let mut node = self
            .root
            .add_mesh(std::rc::Rc::new(std::cell::RefCell::new(mesh)), Vec3::ONE);
        node.enable_backface_culling(false);
        node.set_roughness(0.7);
        node.set_metallic(0.0);
        node
    }

    /// Updates the nodes to a shot if it is new or `afresh` is true.
    pub fn update(&mut self, shot: &Shot, serial: u64, colouring: &Colouring, afresh: bool) {
        let other_stage = !Arc::ptr_eq(&shot.stage, &self.stage);
        if other_stage {
            self.set(&shot.stage);
        }
        if self.serial == Some(serial) && !other_stage && !afresh {
            return;
        }
        self.serial = Some(serial);
        for (node, (body, stage)) in self
            .bodies
            .iter_mut()
            .zip(shot.bodies.iter().zip(&shot.stage.bodies))
        {
            if stage.triangles.is_empty() {
                continue;
            }
            let count = stage
                .triangles
                .iter()
                .flatten()
                .max()
                .map_or(0, |v| *v as usize + 1);
            node.modify_vertices(&mut |x| {
                x.iter_mut()
                    .zip(&body.positions[..count.min(body.positions.len())])
                    .for_each(|(x, p)| *x = vec3(p));
            });
            let normals = vertex_normals(&body.positions, &stage.triangles, count);
            node.modify_normals(&mut |n| n.copy_from_slice(&normals));
            let places = places(body, colouring);
            node.modify_uvs(&mut |uv| {
                uv.iter_mut()
                    .enumerate()
                    .for_each(|(v, uv)| *uv = Vec2::new(places.get(v).map_or(0.0, |p| *p), 0.5));
            });
        }
        for (node, bone) in self.bones.iter_mut().zip(&shot.bones) {
            node.set_pose(pose(&bone.pose));
        }
    }

    /// Sets colours, opacities and light.
    pub fn style(
        &mut self,
        settings: &ViewSettings,
        shot: &Shot,
        colouring: &Colouring,
        rotation: &UnitQuaternion<f64>,
    ) {
        self.light.set_light(Some(light(settings.light, rotation)));
        for ((node, stage), body) in self
            .bodies
            .iter_mut()
            .zip(&shot.stage.bodies)
            .zip(&shot.bodies)
        {
            let has_fibres = settings.fibres && !stage.fibres.is_empty();
            let opacity = match stage.tissue {
                Tissue::Skin => settings.skin,
                Tissue::Bone => settings.bones,
                _ if has_fibres => 0.75,
                _ => 1.0,
            };
            let has_field =
                stage.tissue != Tissue::Bone && !colouring.field.values(body).is_empty();
            // The colour multiplies the texture.
            let tint = if has_field {
                [1.0; 3]
            } else {
                colour_of(stage.tissue)
            };
            node.set_texture(if has_field {
                self.map.clone()
            } else {
                TextureManager::get_global_manager(|m| m.get_default())
            });
            node.set_color(ink(tint, opacity));
            node.set_alpha_mode(if opacity < 1.0 {
                AlphaMode::Blend
            } else {
                AlphaMode::Opaque
            });
            node.set_lines_width(if settings.wireframe { 1.0 } else { 0.0 }, false);
            node.set_lines_color(Some(ink([0.05; 3], 1.0)));
        }
        for node in &mut self.bones {
            node.set_color(ink(colour::BONE, settings.bones));
            node.set_alpha_mode(if settings.bones < 1.0 {
                AlphaMode::Blend
            } else {
                AlphaMode::Opaque
            });
            node.set_visible(settings.bones > 0.0);
            node.set_lines_width(if settings.wireframe { 1.0 } else { 0.0 }, false);
            node.set_lines_color(Some(ink([0.3; 3], 1.0)));
        }
    }

    /// Draws lines and points, which are new for each picture.
    pub fn overlay(&self, window: &mut Window, shot: &Shot, settings: &ViewSettings) {
        for (body, stage) in shot.bodies.iter().zip(&shot.stage.bodies) {
            let x = |v: &u32| body.positions.get(*v as usize).map(vec3);
            if settings.fibres {
                for line in stage.fibres.at(&body.positions) {
                    let line = Polyline3d::new(line.iter().map(vec3).collect());
                    window.draw_polyline(&line.with_color(ink(colour::FIBRE, 1.0)).with_width(1.0));
                }
            }
            if stage.triangles.is_empty() {
                for [a, b] in &stage.edges {
                    if let (Some(a), Some(b)) = (x(a), x(b)) {
                        window.draw_line(a, b, ink(colour::MUSCLE, 1.0), 2.0, false);
                    }
                }
            }
            let sets: [(bool, &[u32], Rgb); 3] = [
                (settings.attachments, &stage.held, HELD),
                (settings.contacts, &body.touching, TOUCHING),
                (true, &body.fixed, FIXED),
            ];
            for (_, vertices, ink_of) in sets.into_iter().filter(|(shown, ..)| *shown) {
                vertices
                    .iter()
                    .filter_map(x)
                    .for_each(|p| window.draw_point(p, ink(ink_of, 1.0), 6.0));
            }
            if let Some((vertex, to)) = &body.dragged
                && let Some(from) = x(vertex)
            {
                window.draw_line(from, vec3(to), ink(DRAGGED, 1.0), 3.0, false);
                window.draw_point(vec3(to), ink(DRAGGED, 1.0), 8.0);
            }
        }
        if let Some(probe) = &shot.probe
            && let Some(p) = shot
                .bodies
                .get(probe.body)
                .and_then(|b| b.positions.get(probe.vertex))
        {
            window.draw_point(vec3(p), ink(PICKED, 1.0), 10.0);
        }
    }
}

/// Strength of the light.
const LIGHT: f32 = 2.6;

/// Texture coordinates of a body's values; empty without the field.
fn places(body: &BodyShot, colouring: &Colouring) -> Vec<f32> {
    let values = colouring.field.values(body);
    let at = |value: &f64| {
        let place = ColourMap::place(*value, colouring.range);
        // Half a step inside both ends, since textures repeat.
        let inner = |t: f64| (0.5 + t.clamp(0.0, 1.0) * (STEPS - 1) as f64) / (STEPS + 1) as f64;
        if place.is_nan() {
            (STEPS as f32 + 0.5) / (STEPS + 1) as f32
        } else {
            inner(place) as f32
        }
    };
    values.iter().map(at).collect()
}

/// The colour map as a texture of one row; the last step is the colour of NaN.
fn map() -> Arc<Texture> {
    let step = |k: usize| match k {
        STEPS.. => colour::NO_VALUE,
        _ => ColourMap::Viridis.colour(k as f64 / (STEPS - 1) as f64),
    };
    let mut frame = Frame::plain((STEPS + 1) as u32, 1, [0.0; 3]);
    (0..=STEPS).for_each(|k| frame.paste(k, 0, &Frame::plain(1, 1, step(k))));
    TextureManager::get_global_manager(|manager| {
        manager.set_generate_mipmaps(false);
        match frame.to_png() {
            Ok(png) => manager.add_image_from_memory(&png, "colour map"),
            // Grey then shows that there are no colours.
            Err(_) => manager.get_default(),
        }
    })
}

/// True if a surface is closed and oriented outward.
fn is_solid(mesh: &TriangleMesh) -> bool {
    let topology = Topology::new(mesh);
    topology.is_closed() && topology.is_oriented() && volume(&mesh.vertices, &mesh.triangles) > 0.0
}

/// Normals of a mesh at rest.
fn normals(mesh: &TriangleMesh) -> Vec<Vec3> {
    vertex_normals(&mesh.vertices, &mesh.triangles, mesh.vertices.len())
}

/// Normals of the first `count` vertices, weighted by area.
fn vertex_normals(x: &[Point3<f64>], triangles: &[[u32; 3]], count: usize) -> Vec<Vec3> {
    let mut sums = vec![Vector3::zeros(); count];
    for corners in triangles {
        let [a, b, c] = corners.map(|v| x[v as usize]);
        let area = (b - a).cross(&(c - a));
        corners.iter().for_each(|v| sums[*v as usize] += area);
    }
    let unit = |n: &Vector3<f64>| n.try_normalize(0.0).unwrap_or_else(Vector3::z);
    sums.iter().map(|n| vec3(&Point3::from(unit(n)))).collect()
}

/// A light from an angle to the right and an angle above the line of sight [rad].
fn light((right, up): (f64, f64), rotation: &UnitQuaternion<f64>) -> Light {
    let turn = UnitQuaternion::from_euler_angles(0.0, right, 0.0)
        * UnitQuaternion::from_euler_angles(-up, 0.0, 0.0);
    let from = rotation * (turn * Vector3::z());
    Light {
        light_type: LightType::Directional(-vec3(&Point3::from(from))),
        intensity: LIGHT,
        ..Light::default()
    }
}

/// The colour of a body without a field.
fn colour_of(tissue: Tissue) -> Rgb {
    match tissue {
        Tissue::Muscle => colour::MUSCLE,
        Tissue::Bone => colour::BONE,
        Tissue::Skin => [0.93, 0.76, 0.66],
        Tissue::Implant => [0.55, 0.75, 0.95],
        Tissue::Plain => [0.7, 0.7, 0.75],
    }
}
