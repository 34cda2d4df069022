//! The inputs of a simulation's state as named hashes, so that a difference has a name.

use crate::constraints::distance::Distance;
use crate::encode::{Encode, Encoder, hash_of};
use crate::mesh::TriangleMesh;
use crate::scene::{Accuracy, AttachmentSpec, BoneSpec, Capsule, Muscle, Scene};
use crate::simulation::Simulation;
use crate::simulation::body::Body;
use crate::simulation::plan::MusclePlan;
use crate::solvers::Held;
use crate::state::{DecodeError, Hash, Reader, Value, Writer};

/// Hashes of all inputs of a simulation: the library, settings, motions, contents of meshes (not their file
/// names), and the plan. The number of frames is not included, as a run can
/// become longer, unless an accuracy is a share of their motion.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Fingerprint(Vec<(String, u128)>);

impl Fingerprint {
    /// The fingerprint of a simulation, equal at all its frames.
    #[must_use]
    pub fn of(simulation: &Simulation) -> Self {
        let mut print = Self::default();
        let Scene {
            name,
            frames,
            frame_rate,
            // Only pictures show it.
            up: _,
            bones,
            capsules,
            muscles,
            interfaces,
            // Only a check; changes no result.
            most_held: _,
            effects,
            solver,
            adapts_steps,
            accuracy,
            mesh_error,
            // They judge the motion and do not change it.
            limits: _,
            // The motions of the bones have it.
            opensim: _,
            origin: _,
        } = &simulation.scene;
        print.add("the library".to_owned(), &crate::DIGEST);
        print.add("the name of the scene".to_owned(), name);
        print.add("`frame_rate`".to_owned(), frame_rate);
        print.add("`effects`".to_owned(), effects);
        print.add("`solver`".to_owned(), solver);
        print.add("`substeps`, given or not".to_owned(), adapts_steps);
        print.add("`accuracy`".to_owned(), accuracy);
        print.add("`mesh_error`".to_owned(), mesh_error);
        if let Some(Accuracy::OfMotion(_)) = accuracy {
            // How far all frames move.
            print.add("`frames`, whose motion it is a share of".to_owned(), frames);
        }
        print.add("`interface`".to_owned(), interfaces);
        for (bone, mesh) in bones.iter().zip(&simulation.bones) {
            // Surface, repair and edge length determine the mesh.
            let BoneSpec {
                name,
                surface: _,
                repair: _,
                edge_length: _,
                motion,
            } = bone;
            print.add(format!("the motion of bone `{name}`"), motion);
            print.mesh(format!("the mesh of bone `{name}`"), mesh);
        }
        for capsule in capsules {
            let Capsule {
                name,
                bone: _,
                segment: _,
                radius: _,
            } = capsule;
            print.add(format!("capsule `{name}`"), capsule);
        }
        let plans = simulation.plan.muscles.iter();
        for ((muscle, body), plan) in muscles.iter().zip(&simulation.bodies).zip(plans) {
            print.muscle(muscle, body, plan);
        }
        print
    }

    fn muscle(&mut self, muscle: &Muscle, body: &Body, plan: &MusclePlan) {
        let Muscle {
            name,
            // These determine the mesh.
            surface: _,
            repair: _,
            edge_length: _,
            material,
            attachments,
            fibres: _,
            fibre_count: _,
            activation,
            forces,
            displacements,
        } = muscle;
        self.mesh(format!("the mesh of muscle `{name}`"), &body.rest);
        self.add(format!("the edges of muscle `{name}`"), &body.edges);
        self.add(format!("the material of muscle `{name}`"), material);
        // Patches determine the attached vertices.
        let mut bones = Vec::new();
        for AttachmentSpec {
            bone,
            area: _,
            limit: _,
        } in attachments
        {
            bones.push(*bone);
        }
        let held = Holding {
            bones,
            held: &body.system.held,
            inverse_mass: &body.system.particles.inverse_mass,
        };
        self.add(format!("the attachments of muscle `{name}`"), &held);
        self.add(
            format!("the fibres of muscle `{name}`"),
            &body.fibres.at(&body.rest.vertices),
        );
        self.add(format!("the activation of muscle `{name}`"), activation);
        self.add(format!("the forces on muscle `{name}`"), forces);
        self.add(
            format!("the displacements of muscle `{name}`"),
            displacements,
        );
        // Fixed vertices determine inverse masses; the rest shape is included as a mesh.
        let MusclePlan {
            effects,
            obstacles,
            partners,
            fixed: _,
            rest: _,
        } = plan;
        self.add(format!("the effects that run on muscle `{name}`"), effects);
        self.add(
            format!("the bones in reach of muscle `{name}` over all requested frames"),
            obstacles,
        );
        self.add(
            format!("the muscles that muscle `{name}` can meet"),
            partners,
        );
    }

    /// A part, by the hash of its encoding.
    fn add(&mut self, name: String, part: &impl Encode) {
        self.0.push((name, hash_of(part)));
    }

    fn mesh(&mut self, name: String, mesh: &TriangleMesh) {
        let TriangleMesh {
            vertices,
            triangles,
        } = mesh;
        let mut hash = Hash::default();
        hash.add(&(vertices.len() as u64).to_le_bytes());
        vertices
            .iter()
            .flat_map(|p| p.coords.iter())
            .for_each(|c| hash.add(&c.to_bits().to_le_bytes()));
        triangles
            .iter()
            .flatten()
            .for_each(|v| hash.add(&v.to_le_bytes()));
        self.0.push((name, hash.value()));
    }

    /// Names of the parts that are only in one of both, or differ.
    #[must_use]
    pub fn differs_from(&self, other: &Self) -> Vec<String> {
        let missing = |these: &Self, those: &Self| -> Vec<String> {
            let known: std::collections::HashSet<&(String, u128)> = those.0.iter().collect();
            these
                .0
                .iter()
                .filter(|part| !known.contains(part))
                .map(|(name, _)| name.clone())
                .collect()
        };
        let mut all = missing(self, other);
        let more: Vec<String> = missing(other, self)
            .into_iter()
            .filter(|name| !all.contains(name))
            .collect();
        all.extend(more);
        if all.is_empty() && self != other {
            all.push("the order of bones, capsules or muscles".to_owned());
        }
        all
    }
}

/// The fixed vertices of a muscle, with their bones.
struct Holding<'a> {
    bones: Vec<usize>,
    held: &'a [Held],
    inverse_mass: &'a [f64],
}

impl Encode for Holding<'_> {
    fn encode(&self, to: &mut Encoder<'_>) {
        to.field("bones", &self.bones);
        for Held {
            vertex,
            bone,
            local,
        } in self.held
        {
            to.field("vertex", vertex);
            to.field("bone", bone);
            to.field("local", local);
        }
        to.field("inverse_mass", self.inverse_mass);
    }
}

impl Encode for Distance {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self { points, rest } = self;
        to.field("points", points);
        to.field("rest", rest);
    }
}

impl Value for Fingerprint {
    const MIN_BYTES: usize = 8;

    fn encode(&self, to: &mut Writer) {
        to.list(&self.0);
    }

    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        Ok(Self(from.take()?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::icosphere;

    #[test]
    fn everything_of_a_mesh_counts() {
        let of = |mesh: &TriangleMesh| {
            let mut print = Fingerprint::default();
            print.mesh("a mesh".to_owned(), mesh);
            print
        };
        let ball = icosphere(0.1, 1);
        let same = of(&ball);
        assert_eq!(of(&ball.clone()), same);
        let mut moved = ball.clone();
        moved.vertices[3].y = f64::from_bits(moved.vertices[3].y.to_bits() + 1);
        let mut turned = ball.clone();
        turned.triangles[7].rotate_left(1);
        let mut fewer = ball;
        fewer.triangles.pop();
        for other in [moved, turned, fewer] {
            assert_ne!(of(&other), same);
        }
    }
}
