//! Every key of a scene with its place, for the reader and for the overrides.

use super::content::{COMMON, KINDS};
use super::effects::{EFFECTS, material_constants};
use super::keys::KeySpec;
use super::solvers::SOLVERS;

/// The keys of one table.
#[derive(Debug)]
pub(super) enum Schema {
    /// The keys of all kinds of scenes.
    Root,
    /// These keys.
    Listed(&'static [(&'static str, Kind)]),
    /// The keys of an effect or a solver.
    Keys(&'static [KeySpec]),
    /// A table for each effect.
    Effects,
    /// A table for the solver; at most one may be there.
    Solvers,
    /// The material constants of a muscle.
    Material,
    /// Names from outside of the scene, each with such a value.
    Names(Kind),
}

/// Kind of the value of a key.
#[derive(Clone, Copy, Debug)]
pub(super) enum Kind {
    /// A text; an override needs no quotes.
    Text,
    /// Any other value.
    Plain,
    /// A table.
    Table(&'static Schema),
    /// A list of tables.
    List(&'static Schema),
}

impl Schema {
    /// Every key with what stands there.
    fn entries(&self) -> Vec<(&'static str, Kind)> {
        let mut all = Vec::new();
        match self {
            Self::Root => {
                all.extend(COMMON);
                all.extend(KINDS.iter().flat_map(|kind| kind.keys));
            }
            Self::Listed(keys) => all.extend_from_slice(keys),
            Self::Keys(keys) => all.extend(keys.iter().map(|key| (key.key, key.schema()))),
            Self::Effects => {
                all.extend(EFFECTS.iter().map(|e| (e.key, Kind::Table(&e.schema))));
            }
            Self::Solvers => {
                all.extend(SOLVERS.iter().map(|s| (s.key, Kind::Table(&s.schema))));
            }
            Self::Material => {
                all.extend([("density", Text), ("vertex_mass", Text)]);
                all.extend(material_constants().map(|c| (c.key.key, c.key.schema())));
            }
            Self::Names(_) => {}
        }
        all
    }

    pub(super) fn get(&self, key: &str) -> Option<Kind> {
        if let Self::Names(kind) = self {
            return Some(*kind);
        }
        self.entries()
            .into_iter()
            .find(|(name, _)| *name == key)
            .map(|(_, kind)| kind)
    }

    pub(super) fn names(&self) -> Vec<&'static str> {
        self.entries().into_iter().map(|(name, _)| name).collect()
    }

    /// All keys, as messages list them.
    pub(super) fn known(&self) -> String {
        self.names().join(", ")
    }
}

use Kind::{List, Plain, Text};

/// The document.
pub(super) const ROOT: Schema = Schema::Root;

pub(super) const SKIN: Schema = Schema::Listed(&[
    ("name", Text),
    ("mesh", Text),
    ("shape", Text),
    ("unit", Text),
    ("repair", Plain),
    ("close_holes", Plain),
    ("cut_handles", Text),
    ("keep_largest", Plain),
    ("merge_within", Text),
    ("edge_length", Text),
    ("thickness", Text),
    ("modulus", Text),
    ("bond", Text),
    ("pocket", Plain),
    ("stretch_limit", Plain),
    ("up", Plain),
    ("method", Text),
]);

pub(super) const SHEET: Schema = Schema::Listed(&[("side", Text), ("cells", Plain)]);

pub(super) const IMPLANT: Schema = Schema::Listed(&[
    ("name", Text),
    ("at", Plain),
    ("near_vertex", Plain),
    ("shape", Text),
    ("base", Text),
    ("long", Plain),
    ("depth", Text),
    ("volume", Text),
    ("fill", List(&FILL)),
    ("target_area", Text),
    ("shell", Text),
]);

const FILL: Schema = Schema::Listed(&[("frame", Plain), ("day", Plain), ("volume", Text)]);

pub(super) const BALL: Schema = Schema::Listed(&[
    ("radius", Text),
    ("from", Plain),
    ("to", Plain),
    ("depth", Text),
]);

pub(super) const OBSTACLE: Schema = Schema::Listed(&[
    ("name", Text),
    ("mesh", Text),
    ("shape", Text),
    ("unit", Text),
    ("repair", Plain),
    ("close_holes", Plain),
    ("cut_handles", Text),
    ("keep_largest", Plain),
    ("merge_within", Text),
]);

pub(super) const LATTICE: Schema = Schema::Listed(&[
    ("points", Plain),
    ("side", Text),
    ("neighbours", Plain),
    ("stiffness", Text),
    ("mass", Text),
    ("damping", Plain),
    ("drag", Plain),
    ("release", Plain),
    ("rest", Kind::Table(&REST)),
]);

const REST: Schema = Schema::Listed(&[
    ("shrink", Plain),
    ("held", Plain),
    ("integrator", Text),
    ("time_step", Text),
    ("adaptive", Plain),
    ("tolerance", Plain),
    ("precision", Text),
    ("device", Text),
    ("method", Text),
]);

pub(super) const BONE: Schema = Schema::Listed(&[
    ("name", Text),
    ("mesh", Text),
    ("shape", Text),
    ("unit", Text),
    ("repair", Plain),
    ("close_holes", Plain),
    ("cut_handles", Text),
    ("keep_largest", Plain),
    ("merge_within", Text),
    ("edge_length", Text),
    ("motion", Kind::Table(&MOTION)),
]);

const MOTION: Schema = Schema::Listed(&[
    ("joint", Plain),
    ("centre", Plain),
    ("axis", Plain),
    ("interpolation", Text),
    ("keys", List(&KEY)),
    ("path", List(&PATH)),
]);

const PATH: Schema = Schema::Listed(&[
    ("at", Text),
    ("angle", Text),
    ("slide", Text),
    ("axis", Plain),
    ("translation", Plain),
]);

const KEY: Schema = Schema::Listed(&[
    ("frame", Plain),
    ("angle", Text),
    ("slide", Text),
    ("axis", Plain),
    ("translation", Plain),
]);

pub(super) const OPENSIM: Schema = Schema::Listed(&[
    ("model", Text),
    ("bones", Kind::Table(&Schema::Names(Text))),
    ("at", Kind::Table(&Schema::Names(Text))),
    ("forward", Plain),
    ("centres", Kind::Table(&Schema::Names(Plain))),
    ("motion", Text),
    ("from", Text),
    ("to", Text),
    ("speed", Plain),
    ("lead_in", Plain),
]);

pub(super) const CAPSULE: Schema = Schema::Listed(&[
    ("name", Text),
    ("bone", Text),
    ("from", Plain),
    ("to", Plain),
    ("radius", Text),
]);

pub(super) const MUSCLE: Schema = Schema::Listed(&[
    ("name", Text),
    ("mesh", Text),
    ("shape", Text),
    ("unit", Text),
    ("repair", Plain),
    ("close_holes", Plain),
    ("cut_handles", Text),
    ("keep_largest", Plain),
    ("merge_within", Text),
    ("edge_length", Text),
    ("material", Kind::Table(&MATERIAL)),
    ("attachment", List(&ATTACHMENT)),
    ("fibres", Kind::Table(&FIBRES)),
    ("activation", Kind::Table(&ACTIVATION)),
    ("force", List(&FORCE)),
    ("displace", List(&DISPLACE)),
]);

pub(super) const INTERFACE: Schema = Schema::Listed(&[
    ("between", Plain),
    ("kind", Text),
    ("stiffness", Text),
    ("within", Text),
]);

const MATERIAL: Schema = Schema::Material;

const ATTACHMENT: Schema = Schema::Listed(&[
    ("bone", Text),
    ("near", Text),
    ("patch", Text),
    ("unit", Text),
    ("within", Text),
    ("vertices", Plain),
    ("limit", Plain),
]);

const FIBRES: Schema = Schema::Listed(&[
    ("lines", Text),
    ("unit", Text),
    ("shape", Plain),
    ("method", Text),
    ("count", Plain),
]);

const ACTIVATION: Schema = Schema::Listed(&[("keys", List(&SHORTENING))]);

const SHORTENING: Schema = Schema::Listed(&[("frame", Plain), ("shortening", Text)]);

const FORCE: Schema = Schema::Listed(&[("vertices", Plain), ("force", Plain)]);

const DISPLACE: Schema = Schema::Listed(&[("vertices", Plain), ("by", Plain)]);
