//! The encoding of scenes. Each structure is destructured field by field. A new field does not
//! compile here until it is encoded or excluded explicitly.

use super::content::{
    BallSpec, FillCourse, ImplantFill, LatticeScene, ObstacleSpec, RestCourse, SkinScene, SkinSpec,
    SkinSurface, SpringsDamping, Support,
};
use super::effects::{EFFECTS, material_constants};
use super::keys::KeyValue;
use super::{
    Accuracy, AreaSpec, AtVertices, AttachmentSpec, Bonding, BoneSpec, Capsule, Effects, Interface,
    Joint, Key, Limits, Mass, Material, Motion, Muscle, Scene, Solver, Source,
};
use crate::encode::{Encode, Encoder, hash_of};
use crate::mesh::repair;
use crate::skin::implant::Implant;
use crate::skin::layers::Tissue;
use crate::skin::plan::{ImplantPlace, ImplantSpec};
use crate::skin::settle::SettleMethod;
use crate::springs::lattice::Stiffness;

impl Encode for Scene {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self {
            name,
            frames,
            frame_rate,
            up,
            bones,
            opensim,
            capsules,
            muscles,
            interfaces,
            most_held,
            effects,
            solver,
            adapts_steps,
            accuracy,
            mesh_error,
            limits,
            origin: _,
        } = self;
        to.field("name", name);
        to.field("frames", frames);
        to.field("frame_rate", frame_rate);
        to.field("up", up);
        to.field("bone", bones);
        if let Some(drive) = opensim {
            to.field("opensim", &**drive);
        }
        to.field("capsule", capsules);
        to.field("muscle", muscles);
        to.field("interface", interfaces);
        to.field("most_held", most_held);
        to.field("effects", effects);
        to.field("solver", solver);
        to.field("adapts_steps", adapts_steps);
        to.field("accuracy", accuracy);
        to.field("mesh_error", mesh_error);
        to.field("limits", limits);
    }
}

impl Encode for Effects {
    fn encode(&self, to: &mut Encoder<'_>) {
        for spec in &EFFECTS {
            to.field(spec.key, &spec.values(self));
        }
    }
}

impl Encode for Solver {
    fn encode(&self, to: &mut Encoder<'_>) {
        to.choice(self.spec().key);
        for (key, value) in self.settings() {
            to.field(key.key, &value);
        }
    }
}

impl Encode for KeyValue {
    fn encode(&self, to: &mut Encoder<'_>) {
        match self {
            Self::Number(number) => number.encode(to),
            Self::Whole(number) => number.encode(to),
            Self::Vector(vector) => vector.encode(to),
            Self::Order(order) => to.choice(order.name()),
            Self::Names(_, chosen) => chosen.encode(to),
        }
    }
}

impl Encode for Accuracy {
    fn encode(&self, to: &mut Encoder<'_>) {
        match self {
            Self::Length(length) => to.field("length", length),
            Self::Share(share) => to.field("share", share),
            Self::OfMotion(share) => to.field("of_motion", share),
        }
    }
}

impl Encode for Limits {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self {
            jitter,
            snap,
            lift_off,
            thickness,
            hinge,
        } = self;
        to.field("jitter", jitter);
        to.field("snap", snap);
        to.field("lift_off", lift_off);
        to.field("thickness", thickness);
        to.field("hinge", hinge);
    }
}

impl Encode for Source {
    fn encode(&self, to: &mut Encoder<'_>) {
        match self {
            Self::File { path, scale } => {
                to.field("path", path);
                to.field("scale", scale);
            }
            Self::Shape(name) => to.field("shape", name),
            Self::Given { mesh, scale, .. } => {
                let hash = hash_of(&(&mesh.vertices, &mesh.triangles));
                to.field("mesh", &format!("{hash:032x}"));
                to.field("scale", scale);
            }
        }
    }
}

impl Encode for repair::RepairOptions {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self {
            merge_within,
            close_holes,
            cut_handles,
            keep_largest,
        } = self;
        to.field("merge_within", merge_within);
        to.field("close_holes", close_holes);
        to.field("cut_handles", cut_handles);
        to.field("keep_largest", keep_largest);
    }
}

impl Encode for BoneSpec {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self {
            name,
            surface,
            repair,
            edge_length,
            motion,
        } = self;
        to.field("name", name);
        to.field("surface", surface);
        to.field("repair", repair);
        to.field("edge_length", edge_length);
        to.field("motion", motion);
    }
}

impl Encode for Motion {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self {
            keys,
            joint,
            linear,
        } = self;
        to.field("keys", keys);
        to.field("joint", joint);
        to.field("linear", linear);
    }
}

impl Encode for Joint {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self {
            name,
            centre,
            axis,
            path,
        } = self;
        to.field("name", name);
        to.field("centre", centre);
        to.field("axis", axis);
        to.field("path", path);
    }
}

impl Encode for Key {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self { frame, pose } = self;
        to.field("frame", frame);
        to.field("pose", pose);
    }
}

impl Encode for Capsule {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self {
            name,
            bone,
            segment,
            radius,
        } = self;
        to.field("name", name);
        to.field("bone", bone);
        to.field("segment", segment);
        to.field("radius", radius);
    }
}

impl Encode for Muscle {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self {
            name,
            surface,
            repair,
            edge_length,
            material,
            attachments,
            fibres,
            fibre_count,
            activation,
            forces,
            displacements,
        } = self;
        to.field("name", name);
        to.field("surface", surface);
        to.field("repair", repair);
        to.field("edge_length", edge_length);
        to.field("material", material);
        to.field("attachment", attachments);
        to.field("fibres", fibres);
        to.field("fibre_count", fibre_count);
        to.field("activation", activation);
        to.field("force", forces);
        to.field("displace", displacements);
    }
}

impl Encode for Interface {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self { between, bond } = self;
        to.field("between", between);
        to.field("bond", bond);
    }
}

impl Encode for Bonding {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self { stiffness, within } = self;
        to.field("stiffness", stiffness);
        to.field("within", within);
    }
}

impl Encode for Material {
    fn encode(&self, to: &mut Encoder<'_>) {
        match &self.mass {
            Mass::Density(density) => to.field("density", density),
            Mass::PerVertex(mass) => to.field("vertex_mass", mass),
        }
        for constant in material_constants() {
            to.field(constant.key.key, &constant.value(self));
        }
    }
}

impl Encode for AttachmentSpec {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self { bone, area, limit } = self;
        to.field("bone", bone);
        match area {
            AreaSpec::Near(within) => to.field("near", within),
            AreaSpec::Patch {
                source,
                component,
                within,
            } => {
                to.field("patch", source);
                to.field("component", component);
                to.field("within", within);
            }
            AreaSpec::Vertices(vertices) => to.field("vertices", vertices),
        }
        to.field("limit", limit);
    }
}

impl Encode for AtVertices {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self { vertices, vector } = self;
        to.field("vertices", vertices);
        to.field("vector", vector);
    }
}

impl Encode for SkinScene {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self {
            name,
            frames,
            days,
            skin,
            under,
            obstacles,
            origin: _,
        } = self;
        to.field("name", name);
        to.field("frames", frames);
        to.field("days", days);
        to.field("skin", skin);
        match under {
            Support::Implants(implants) => to.field("implant", implants),
            Support::Ball(ball) => to.field("ball", ball),
        }
        to.field("obstacle", obstacles);
    }
}

impl Encode for SkinSpec {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self {
            name,
            surface,
            repair,
            stretch_limit,
            up,
            method,
        } = self;
        to.field("name", name);
        match surface {
            SkinSurface::Source(source) => to.field("surface", source),
            SkinSurface::Sheet { side, cells } => {
                to.field("side", side);
                to.field("cells", cells);
            }
        }
        to.field("repair", repair);
        to.field("stretch_limit", stretch_limit);
        to.field("up", up);
        let method = method.map(|method| match method {
            SettleMethod::Newton => "newton",
            SettleMethod::QuasiStatic => "l-bfgs",
        });
        to.field("method", &method);
    }
}

impl Encode for ImplantFill {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self {
            name,
            order,
            fill,
            course,
        } = self;
        to.field("name", name);
        to.field("order", order);
        to.field("fill", fill);
        match course {
            FillCourse::Evenly => to.field("course", "evenly"),
            FillCourse::Frames => to.field("course", "frames"),
            FillCourse::Days => to.field("course", "days"),
            FillCourse::Target(area) => to.field("target_area", area),
        }
    }
}

impl Encode for BallSpec {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self {
            radius,
            from,
            to: end,
            order,
        } = self;
        to.field("radius", radius);
        to.field("from", from);
        to.field("to", end);
        to.field("order", order);
    }
}

impl Encode for ImplantSpec {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self {
            place,
            implant,
            long,
            tissue,
            edge,
        } = self;
        match place {
            ImplantPlace::Vertex(vertex) => to.field("vertex", vertex),
            ImplantPlace::Point(point) => to.field("point", point),
        }
        let Implant {
            shape,
            base,
            volume,
            membrane,
        } = implant;
        to.field("shape", shape.name());
        to.field("base", base);
        to.field("volume", volume);
        to.field("membrane", membrane);
        to.field("long", long);
        let Tissue {
            modulus,
            thickness,
            depth,
            bond,
            pocket,
        } = tissue;
        to.field("modulus", modulus);
        to.field("thickness", thickness);
        to.field("depth", depth);
        to.field("bond", bond);
        to.field("pocket", pocket);
        to.field("edge", edge);
    }
}

impl Encode for ObstacleSpec {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self {
            name,
            surface,
            repair,
        } = self;
        to.field("name", name);
        to.field("surface", surface);
        to.field("repair", repair);
    }
}

impl Encode for LatticeScene {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self {
            name,
            frames,
            frame_rate,
            points,
            side,
            neighbours,
            stiffness,
            mass,
            damping,
            drag,
            release,
            rest,
            origin: _,
        } = self;
        to.field("name", name);
        to.field("frames", frames);
        to.field("frame_rate", frame_rate);
        to.field("points", points);
        to.field("side", side);
        to.field("neighbours", &neighbours.count());
        to.field("stiffness", stiffness);
        to.field("mass", mass);
        to.field("damping", damping);
        to.field("drag", drag);
        to.field("release", release);
        to.field("rest", rest);
    }
}

impl Encode for Stiffness {
    fn encode(&self, to: &mut Encoder<'_>) {
        match self {
            Self::Reciprocal => to.choice("reciprocal"),
            Self::Uniform(stiffness) => stiffness.encode(to),
        }
    }
}

impl Encode for SpringsDamping {
    fn encode(&self, to: &mut Encoder<'_>) {
        match self {
            Self::Share(share) => share.encode(to),
            Self::Absolute(damping) => to.field("absolute", damping),
        }
    }
}

impl Encode for RestCourse {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self {
            shrink,
            held,
            integrator,
            time_step,
            adaptive,
            tolerance,
            is_single: _,
            device,
            method,
        } = self;
        to.field("shrink", shrink);
        to.field("held", held);
        to.field("integrator", integrator);
        to.field("time_step", time_step);
        to.field("adaptive", adaptive);
        to.field("tolerance", tolerance);
        to.choice(self.precision());
        to.field("device", device);
        to.field("method", method);
    }
}

#[cfg(test)]
mod tests;
