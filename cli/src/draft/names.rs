//! What the name of a file says of the body in it.

/// What a body is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Bone,
    Muscle,
}

/// A bone that names tell.
#[derive(Debug)]
pub struct KnownBone {
    /// Its name in a scene.
    pub name: &'static str,
    /// Words of which a file's name has one.
    words: &'static [&'static str],
    /// Range of its longest side, from a child to a tall adult [m].
    pub length: [f64; 2],
}

const fn bone(
    name: &'static str,
    words: &'static [&'static str],
    least: f64,
    most: f64,
) -> KnownBone {
    KnownBone {
        name,
        words,
        length: [least, most],
    }
}

/// The bones of limbs and trunk. Lengths leave room for children and for scans that cut a bone off.
pub const BONES: [KnownBone; 17] = [
    bone("femur", &["femur", "femora", "thighbone"], 0.1, 0.6),
    bone("tibia", &["tibia", "shinbone"], 0.08, 0.5),
    bone("fibula", &["fibula"], 0.08, 0.5),
    bone("patella", &["patella", "kneecap"], 0.015, 0.07),
    bone("talus", &["talus", "astragalus"], 0.02, 0.08),
    bone("calcaneus", &["calcaneus", "heelbone"], 0.03, 0.11),
    bone("foot", &["foot", "feet"], 0.1, 0.35),
    bone("humerus", &["humerus"], 0.08, 0.45),
    bone("radius", &["radius"], 0.06, 0.35),
    bone("ulna", &["ulna"], 0.06, 0.35),
    bone("scapula", &["scapula"], 0.06, 0.25),
    bone("clavicle", &["clavicle", "clavicula"], 0.05, 0.22),
    bone("hand", &["hand"], 0.06, 0.25),
    bone("sacrum", &["sacrum"], 0.04, 0.2),
    bone(
        "spine",
        &["spine", "vertebra", "vertebrae", "lumbar"],
        0.02,
        0.9,
    ),
    bone("skull", &["skull", "cranium", "mandible"], 0.05, 0.35),
    bone(
        "hip bone",
        &[
            "hip",
            "pelvis",
            "coxae",
            "coxa",
            "innominate",
            "ilium",
            "hemipelvis",
        ],
        0.08,
        0.4,
    ),
];

/// Words of bones that no joint here needs.
const OTHER_BONES: [&str; 9] = [
    "bone",
    "bones",
    "os",
    "rib",
    "ribs",
    "sternum",
    "metatarsal",
    "metacarpal",
    "phalanx",
];

/// Beginnings of words in names of muscles.
const MUSCLES: [&str; 56] = [
    "muscle",
    "muscul",
    "glut",
    "iliacus",
    "iliopsoas",
    "psoas",
    "biceps",
    "triceps",
    "brachial",
    "brachiorad",
    "rectus",
    "vastus",
    "quadriceps",
    "quadratus",
    "semimemb",
    "semitend",
    "hamstring",
    "gracilis",
    "sartorius",
    "adductor",
    "abductor",
    "pectine",
    "piriform",
    "obturator",
    "gemell",
    "tensor",
    "soleus",
    "gastroc",
    "tibialis",
    "peroneus",
    "fibularis",
    "popliteus",
    "plantaris",
    "extensor",
    "flexor",
    "pronator",
    "supinator",
    "anconeus",
    "coracobrach",
    "deltoid",
    "subscap",
    "infraspin",
    "supraspin",
    "teres",
    "pectoral",
    "latissimus",
    "trapez",
    "serratus",
    "rhomboid",
    "levator",
    "erector",
    "multifid",
    "masseter",
    "temporalis",
    "longissimus",
    "iliocost",
];

/// The joints, as `joint::JOINTS` names them, that a muscle crosses whose name has words with these
/// beginnings. The first row that fits holds.
const CROSSED: [(&[&str], &[&str]); 42] = [
    (&["biceps", "short", "femor"], &["knee"]),
    (&["biceps", "femor"], &["hip", "knee"]),
    (&["biceps"], &["shoulder", "elbow"]),
    (&["triceps", "long"], &["shoulder", "elbow"]),
    (&["triceps", "surae"], &["knee", "ankle"]),
    (&["triceps"], &["elbow"]),
    (&["rectus", "femor"], &["hip", "knee"]),
    (&["quadratus", "femor"], &["hip"]),
    (&["glut"], &["hip"]),
    (&["iliacus"], &["hip"]),
    (&["iliopsoas"], &["hip"]),
    (&["psoas"], &["hip"]),
    (&["adductor", "poll"], &[]),
    (&["adductor", "hall"], &[]),
    (&["adductor"], &["hip"]),
    (&["pectine"], &["hip"]),
    (&["piriform"], &["hip"]),
    (&["obturator"], &["hip"]),
    (&["gemell"], &["hip"]),
    (&["gracilis"], &["hip", "knee"]),
    (&["sartorius"], &["hip", "knee"]),
    (&["tensor", "fasc"], &["hip", "knee"]),
    (&["semimemb"], &["hip", "knee"]),
    (&["semitend"], &["hip", "knee"]),
    (&["vastus"], &["knee"]),
    (&["popliteus"], &["knee"]),
    (&["gastroc"], &["knee", "ankle"]),
    (&["plantaris"], &["knee", "ankle"]),
    (&["soleus"], &["ankle"]),
    (&["tibialis"], &["ankle"]),
    (&["peroneus"], &["ankle"]),
    (&["fibularis"], &["ankle"]),
    (&["deltoid"], &["shoulder"]),
    (&["subscap"], &["shoulder"]),
    (&["infraspin"], &["shoulder"]),
    (&["supraspin"], &["shoulder"]),
    (&["teres", "m"], &["shoulder"]),
    (&["latissimus"], &["shoulder"]),
    (&["coracobrach"], &["shoulder"]),
    (&["brachiorad"], &["elbow"]),
    (&["brachialis"], &["elbow"]),
    (&["anconeus"], &["elbow"]),
];

/// A test whether the name of a muscle has words with all these beginnings.
fn beginnings(muscle: &str) -> impl Fn(&[&str]) -> bool {
    let words = words(muscle);
    move |begins| {
        let has = |begin: &&str| words.iter().any(|word| word.starts_with(begin));
        begins.iter().all(has)
    }
}

/// Whether a muscle crosses a joint, by its name; `None` if that does not tell.
pub fn crosses(muscle: &str, joint: &str) -> Option<bool> {
    let has = beginnings(muscle);
    let row = CROSSED.iter().find(|(begins, _)| has(begins));
    row.map(|(_, joints)| joints.contains(&joint))
}

/// Where a muscle ends that does not end on the nearest part of the bones that a joint turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownInsertion {
    /// The bone, as in [`BONES`].
    pub bone: &'static str,
    /// The part of its length, from the end at the joint, that has the insertion; `None` for anywhere. A
    /// tendon that the mesh lacks leads there.
    pub along: Option<[f64; 2]>,
}

const fn ends_on(bone: &'static str, along: Option<[f64; 2]>) -> KnownInsertion {
    KnownInsertion { bone, along }
}

/// Beginnings of words of the names of muscles, the joint, and where they end. The tuberosity of a radius of
/// 24 cm begins 25 mm from its head and is 22 mm long \[mazzocca2007\].
const INSERTIONS: [(&[&str], &str, KnownInsertion); 3] = [
    (
        &["biceps", "brachi"],
        "elbow",
        ends_on("radius", Some([0.1, 0.2])),
    ),
    (&["brachialis"], "elbow", ends_on("ulna", None)),
    (&["biceps", "femor"], "knee", ends_on("fibula", None)),
];

/// Where a muscle ends that crosses a joint, by their names.
pub fn insertion(muscle: &str, joint: &str) -> Option<KnownInsertion> {
    let has = beginnings(muscle);
    let of = |row: &&(&[&str], &str, KnownInsertion)| row.1 == joint && has(row.0);
    INSERTIONS.iter().find(of).map(|row| row.2)
}

/// Architecture of muscles, as `pliant fibres --aponeurosis` names it, with beginnings of words of their
/// names. The first row that fits holds.
const ARCHITECTURE: [(&[&str], &str); 26] = [
    (&["rectus", "femor"], "bipennate"),
    (&["soleus"], "multipennate"),
    (&["deltoid"], "multipennate"),
    (&["subscap"], "multipennate"),
    (&["infraspin"], "multipennate"),
    (&["vastus"], "pennate"),
    (&["semimemb"], "pennate"),
    (&["biceps", "femor"], "pennate"),
    (&["gastroc"], "pennate"),
    (&["tibialis"], "pennate"),
    (&["peroneus"], "pennate"),
    (&["fibularis"], "pennate"),
    (&["extensor"], "pennate"),
    (&["flexor"], "pennate"),
    (&["glut"], "parallel"),
    (&["iliacus"], "parallel"),
    (&["psoas"], "parallel"),
    (&["gracilis"], "parallel"),
    (&["sartorius"], "parallel"),
    (&["semitend"], "parallel"),
    (&["adductor"], "parallel"),
    (&["pectine"], "parallel"),
    (&["tensor", "fasc"], "parallel"),
    (&["biceps"], "parallel"),
    (&["brachialis"], "parallel"),
    (&["brachiorad"], "parallel"),
];

/// Name of the architecture of a muscle that textbooks of anatomy give, by its name.
pub fn architecture(muscle: &str) -> Option<&'static str> {
    let has = beginnings(muscle);
    let row = ARCHITECTURE.iter().find(|(begins, _)| has(begins));
    row.map(|(_, name)| *name)
}

/// The words of a name, in small letters: it is divided at all but letters, and before a capital letter
/// after a small one.
fn words(name: &str) -> Vec<String> {
    let mut all = vec![String::new()];
    let mut is_small = false;
    for c in name.chars() {
        let begins = c.is_uppercase() && is_small;
        if begins || !c.is_alphabetic() {
            all.push(String::new());
        }
        if c.is_alphabetic()
            && let Some(word) = all.last_mut()
        {
            word.extend(c.to_lowercase());
        }
        is_small = c.is_lowercase();
    }
    all.retain(|word| !word.is_empty());
    all
}

/// The bone that a name tells.
pub fn known_bone(name: &str) -> Option<&'static KnownBone> {
    let words = words(name);
    let tells = |bone: &&KnownBone| {
        bone.words
            .iter()
            .any(|w| words.iter().any(|word| word == w))
    };
    BONES.iter().find(tells)
}

/// What a name tells of a body, and the word that does; `None` if it tells nothing. A muscle is often
/// named after a bone, and not the other way round.
pub fn kind(name: &str) -> Option<(Kind, String)> {
    let words = words(name);
    let muscle = words
        .iter()
        .find(|word| MUSCLES.iter().any(|begin| word.starts_with(begin)));
    if let Some(word) = muscle {
        return Some((Kind::Muscle, word.clone()));
    }
    let is_bone = |word: &&String| {
        let mut known = BONES.iter().flat_map(|bone| bone.words).chain(&OTHER_BONES);
        known.any(|known| known == word)
    };
    let bone = words.iter().find(is_bone);
    bone.map(|word| (Kind::Bone, word.clone()))
}

/// Whether the name says that the body is of the right (true) or of the left side.
pub fn is_right(name: &str) -> Option<bool> {
    words(name).iter().find_map(|word| match word.as_str() {
        "r" | "right" | "dexter" | "dextra" => Some(true),
        "l" | "left" | "sinister" | "sinistra" => Some(false),
        _ => None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_several_sources_tell_what_a_body_is() {
        let is = |name: &str, told: Option<(Kind, &str)>| {
            let found = kind(name);
            let found = found.as_ref().map(|(kind, word)| (*kind, word.as_str()));
            assert_eq!(found, told, "{name}");
        };
        is("Femur.r", Some((Kind::Bone, "femur")));
        is("Hip_bone.r", Some((Kind::Bone, "hip")));
        is("r_pelvis", Some((Kind::Bone, "pelvis")));
        is("vertebrae_L5", Some((Kind::Bone, "vertebrae")));
        is("TibiaLeft", Some((Kind::Bone, "tibia")));
        is("os metatarsale 1", Some((Kind::Bone, "os")));
        is(
            "Long_head_of_biceps_femoris.r",
            Some((Kind::Muscle, "biceps")),
        );
        is("gluteus_maximus_left", Some((Kind::Muscle, "gluteus")));
        is("hip_flexors", Some((Kind::Muscle, "flexors")));
        is("ExtensorCarpiUlnaris", Some((Kind::Muscle, "extensor")));
        is("tibialis anterior", Some((Kind::Muscle, "tibialis")));
        is("Psoas_major.r", Some((Kind::Muscle, "psoas")));
        // Names that tell nothing: a part of a word is no word.
        is("segment_1", None);
        is("shipment", None);
        is("cosmos", None);
        is("", None);
    }

    #[test]
    fn names_tell_the_bone_on_which_a_muscle_ends() {
        for (muscle, joint, bone) in [
            ("Long_head_of_biceps_brachii.r", "elbow", Some("radius")),
            ("Brachialis_muscle.r", "elbow", Some("ulna")),
            ("biceps femoris left", "knee", Some("fibula")),
            ("biceps femoris left", "hip", None),
            ("Rectus_femoris", "knee", None),
            ("biceps", "elbow", None),
        ] {
            let found = insertion(muscle, joint).map(|found| found.bone);
            assert_eq!(found, bone, "{muscle} {joint}");
        }
    }

    #[test]
    fn names_tell_which_joints_a_muscle_crosses() {
        let joints = |name: &str| -> Vec<&str> {
            let all = super::super::joint::JOINTS.iter().map(|joint| joint.name);
            all.filter(|joint| crosses(name, joint) == Some(true))
                .collect()
        };
        for (name, crossed) in [
            ("Vastus_lateralis_muscle.r", &["knee"][..]),
            ("Long_head_of_biceps_femoris.r", &["hip", "knee"]),
            ("Short_head_of_biceps_femoris.r", &["knee"]),
            ("Short_head_of_biceps_brachii.r", &["shoulder", "elbow"]),
            ("Segmentation_rectus femoris left", &["hip", "knee"]),
            ("soleus", &["ankle"]),
            ("Medial_head_of_gastrocnemius.r", &["knee", "ankle"]),
            ("Brachialis_muscle.r", &["elbow"]),
            ("SemimembranosusLeft", &["hip", "knee"]),
            ("Teres_minor.r", &["shoulder"]),
        ] {
            assert_eq!(joints(name), crossed, "{name}");
        }
        for unknown in ["segment_1", "Semispinalis_capitis", "Tensor_tympani.l"] {
            assert_eq!(crosses(unknown, "hip"), None, "{unknown}");
        }
        assert_eq!(crosses("Adductor_hallucis.r", "hip"), Some(false));
        assert_eq!(crosses("Vastus_medialis", "hip"), Some(false));
        // Names of joints, and words of muscles that are known.
        for (begins, joints) in CROSSED {
            assert!(kind(begins[0]).is_some(), "{begins:?}");
            for joint in joints {
                assert!(super::super::joint::known(joint).is_some(), "{joint}");
            }
        }
    }

    #[test]
    fn bones_and_sides() {
        let name = |file| known_bone(file).map(|bone| bone.name);
        assert_eq!(name("Hip_bone.r"), Some("hip bone"));
        assert_eq!(name("femur_left"), Some("femur"));
        assert_eq!(name("lumbar-spine"), Some("spine"));
        assert_eq!(name("rib 3"), None);
        assert_eq!(is_right("Femur.r"), Some(true));
        assert_eq!(is_right("l_tibia"), Some(false));
        assert_eq!(is_right("femur"), None);
    }
}
