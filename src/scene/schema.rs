//! Every key of a scene with its place, for the reader and for the overrides.

/// The keys of one table.
#[derive(Debug)]
pub(super) struct Schema {
    pub(super) keys: &'static [(&'static str, Kind)],
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
    pub(super) fn get(&self, key: &str) -> Option<Kind> {
        self.keys
            .iter()
            .find(|(name, _)| *name == key)
            .map(|&(_, kind)| kind)
    }

    pub(super) fn names(&self) -> impl Iterator<Item = &'static str> {
        self.keys.iter().map(|&(name, _)| name)
    }

    /// All keys, as messages list them.
    pub(super) fn known(&self) -> String {
        self.names().collect::<Vec<_>>().join(", ")
    }
}

use Kind::{List, Plain, Text};

/// The document.
pub(super) const ROOT: Schema = Schema {
    keys: &[
        ("name", Text),
        ("frames", Plain),
        ("frame_rate", Text),
        ("accuracy", Text),
        ("bone", List(&BONE)),
        ("capsule", List(&CAPSULE)),
        ("muscle", List(&MUSCLE)),
        ("effects", Kind::Table(&EFFECTS)),
        ("solver", Kind::Table(&SOLVER)),
        ("skin", List(&SKIN)),
        ("sheet", Kind::Table(&SHEET)),
        ("implant", List(&IMPLANT)),
        ("ball", Kind::Table(&BALL)),
        ("obstacle", List(&OBSTACLE)),
        ("lattice", Kind::Table(&LATTICE)),
    ],
};

const SKIN: Schema = Schema {
    keys: &[
        ("name", Text),
        ("mesh", Text),
        ("shape", Text),
        ("unit", Text),
        ("repair", Plain),
        ("close_holes", Plain),
        ("keep_largest", Plain),
        ("merge_within", Text),
        ("edge_length", Text),
        ("thickness", Text),
        ("modulus", Text),
        ("stretch_limit", Plain),
        ("method", Text),
    ],
};

const SHEET: Schema = Schema {
    keys: &[("side", Text), ("cells", Plain)],
};

const IMPLANT: Schema = Schema {
    keys: &[
        ("name", Text),
        ("at", Plain),
        ("near_vertex", Plain),
        ("shape", Text),
        ("base", Text),
        ("long", Plain),
        ("depth", Text),
        ("volume", Text),
        ("fill", List(&FILL)),
        ("shell", Text),
    ],
};

const FILL: Schema = Schema {
    keys: &[("frame", Plain), ("volume", Text)],
};

const BALL: Schema = Schema {
    keys: &[
        ("radius", Text),
        ("from", Plain),
        ("to", Plain),
        ("depth", Text),
    ],
};

const OBSTACLE: Schema = Schema {
    keys: &[
        ("name", Text),
        ("mesh", Text),
        ("shape", Text),
        ("unit", Text),
        ("repair", Plain),
        ("close_holes", Plain),
        ("keep_largest", Plain),
        ("merge_within", Text),
    ],
};

const LATTICE: Schema = Schema {
    keys: &[
        ("points", Plain),
        ("side", Text),
        ("neighbours", Plain),
        ("stiffness", Text),
        ("mass", Text),
        ("damping", Plain),
        ("drag", Plain),
        ("release", Plain),
    ],
};

const BONE: Schema = Schema {
    keys: &[
        ("name", Text),
        ("mesh", Text),
        ("shape", Text),
        ("unit", Text),
        ("repair", Plain),
        ("close_holes", Plain),
        ("keep_largest", Plain),
        ("merge_within", Text),
        ("motion", Kind::Table(&MOTION)),
    ],
};

const MOTION: Schema = Schema {
    keys: &[
        ("joint", Plain),
        ("centre", Plain),
        ("axis", Plain),
        ("keys", List(&KEY)),
    ],
};

const KEY: Schema = Schema {
    keys: &[
        ("frame", Plain),
        ("angle", Text),
        ("slide", Text),
        ("axis", Plain),
        ("translation", Plain),
    ],
};

const CAPSULE: Schema = Schema {
    keys: &[
        ("name", Text),
        ("bone", Text),
        ("from", Plain),
        ("to", Plain),
        ("radius", Text),
    ],
};

const MUSCLE: Schema = Schema {
    keys: &[
        ("name", Text),
        ("mesh", Text),
        ("shape", Text),
        ("unit", Text),
        ("repair", Plain),
        ("close_holes", Plain),
        ("keep_largest", Plain),
        ("merge_within", Text),
        ("edge_length", Text),
        ("material", Kind::Table(&MATERIAL)),
        ("attachment", List(&ATTACHMENT)),
        ("fibres", Kind::Table(&FIBRES)),
        ("force", List(&FORCE)),
        ("displace", List(&DISPLACE)),
    ],
};

const MATERIAL: Schema = Schema {
    keys: &[
        ("density", Text),
        ("vertex_mass", Text),
        ("stretch", Text),
        ("bending", Text),
        ("bulk", Text),
    ],
};

const ATTACHMENT: Schema = Schema {
    keys: &[
        ("bone", Text),
        ("near", Text),
        ("patch", Text),
        ("unit", Text),
        ("within", Text),
        ("vertices", Plain),
        ("limit", Plain),
    ],
};

const FIBRES: Schema = Schema {
    keys: &[("lines", Text), ("unit", Text), ("shape", Plain)],
};

const FORCE: Schema = Schema {
    keys: &[("vertices", Plain), ("force", Plain)],
};

const DISPLACE: Schema = Schema {
    keys: &[("vertices", Plain), ("by", Plain)],
};

/// Effects.
pub(super) const EFFECTS: Schema = Schema {
    keys: &[
        ("stretch", Kind::Table(&NOTHING)),
        ("bending", Kind::Table(&NOTHING)),
        ("volume", Kind::Table(&VOLUME)),
        ("anisotropy", Kind::Table(&ANISOTROPY)),
        ("contact", Kind::Table(&CONTACT)),
        ("gravity", Kind::Table(&GRAVITY)),
        ("damping", Kind::Table(&DAMPING)),
    ],
};

const NOTHING: Schema = Schema { keys: &[] };
const VOLUME: Schema = Schema {
    keys: &[("pressure", Plain)],
};
const ANISOTROPY: Schema = Schema {
    keys: &[("strength", Plain), ("power", Plain)],
};
const CONTACT: Schema = Schema {
    keys: &[("thickness", Text), ("friction", Plain)],
};
const GRAVITY: Schema = Schema {
    keys: &[("acceleration", Plain)],
};
const DAMPING: Schema = Schema {
    keys: &[("rate", Text)],
};

/// Solver.
pub(super) const SOLVER: Schema = Schema {
    keys: &[
        ("xpbd", Kind::Table(&XPBD)),
        ("pbd", Kind::Table(&PBD)),
        ("quasi_static", Kind::Table(&MINIMISATION)),
        ("implicit_euler", Kind::Table(&MINIMISATION)),
    ],
};

const MINIMISATION: Schema = Schema {
    keys: &[
        ("substeps", Plain),
        ("iterations", Plain),
        ("tolerance", Plain),
    ],
};

const XPBD: Schema = Schema {
    keys: &[
        ("substeps", Plain),
        ("iterations", Plain),
        ("order", Text),
        ("tolerance", Plain),
    ],
};

const PBD: Schema = Schema {
    keys: &[
        ("substeps", Plain),
        ("iterations", Plain),
        ("stretch", Plain),
        ("bending", Plain),
        ("volume", Plain),
        ("velocity_damping", Plain),
        ("order", Text),
        ("tolerance", Plain),
    ],
};
