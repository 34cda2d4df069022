//! Names of muscles in tables.

/// Full names of muscles, and the beginnings of their column names in tables, without signs between
/// letters.
const KNOWN: &[(&[&str], &[&str])] = &[
    (
        &["gluteus", "maximus"],
        &["gluteusmaximus", "glutmax", "glmax"],
    ),
    (
        &["gluteus", "medius"],
        &["gluteusmedius", "glutmed", "glmed"],
    ),
    (
        &["gluteus", "minimus"],
        &["gluteusminimus", "glutmin", "glmin"],
    ),
    (&["iliacus"], &["iliacus"]),
    (&["psoas"], &["psoas"]),
    (
        &["rectus", "femoris"],
        &["rectusfemoris", "rectfem", "recfem"],
    ),
    (&["semimembranosus"], &["semimem"]),
    (&["semitendinosus"], &["semiten"]),
    (&["long", "biceps", "femoris"], &["bifemlh", "bflh"]),
    (&["short", "biceps", "femoris"], &["bifemsh", "bfsh"]),
    (&["adductor", "magnus"], &["adductormagnus", "addmag"]),
    (&["adductor", "longus"], &["adductorlongus", "addlong"]),
    (&["adductor", "brevis"], &["adductorbrevis", "addbrev"]),
    (&["pectineus"], &["pect"]),
    (&["gracilis"], &["grac"]),
    (&["sartorius"], &["sar"]),
    (&["piriformis"], &["piri", "peri"]),
    (
        &["tensor", "fasciae", "latae"],
        &["tensorfasciaelatae", "tfl"],
    ),
    (&["vastus", "intermedius"], &["vastusintermedius", "vasint"]),
    (&["vastus", "lateralis"], &["vastuslateralis", "vaslat"]),
    (&["vastus", "medialis"], &["vastusmedialis", "vasmed"]),
    (&["medial", "gastrocnemius"], &["gasmed", "medgas"]),
    (&["lateral", "gastrocnemius"], &["gaslat", "latgas"]),
    (&["soleus"], &["soleus"]),
];

/// Whether a name in a table denotes a muscle of a scene: `glut_max2_r` and `r_gluteus_maximus`
/// mean `gluteus maximus`.
///
/// ```
/// use pliant::moment_arms::means;
/// assert!(means("glut_max2_r", "gluteus maximus") && means("r_psoas", "psoas major"));
/// assert!(!means("glut_med1_r", "gluteus maximus"));
/// ```
pub fn means(column: &str, muscle: &str) -> bool {
    let muscle = muscle.to_lowercase();
    let column = plain(column);
    let of_name = |words: &[&str]| words.iter().all(|w| muscle.contains(w));
    let known = KNOWN
        .iter()
        .filter(|(words, _)| of_name(words))
        .flat_map(|(_, begins)| begins.iter());
    // A muscle outside the list can have the same name in both.
    let own = plain(&muscle);
    known.into_iter().any(|begin| column.starts_with(begin))
        || (!own.is_empty() && column.starts_with(&own))
}

/// Lower-case letters and digits only, without a prefix for the side.
fn plain(name: &str) -> String {
    let name = name.to_lowercase();
    let name = ["r_", "l_"]
        .iter()
        .find_map(|side| name.strip_prefix(side))
        .unwrap_or(&name)
        .to_owned();
    name.chars().filter(|c| c.is_ascii_alphanumeric()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_the_known_tables() {
        let pairs = [
            ("glmax1_r", "gluteus maximus"),
            ("psoas_mean_subj2", "Psoas major"),
            ("rect_fem_r", "rectus femoris"),
            ("bifemlh_r", "long head of biceps femoris"),
            ("addmagDist_r", "adductor magnus"),
            ("gluteus", "gluteus"),
            ("My-Muscle 3", "my muscle"),
        ];
        for (column, muscle) in pairs {
            assert!(means(column, muscle), "{column} {muscle}");
        }
        for (column, muscle) in [
            ("bflh_r", "short head of biceps femoris"),
            ("iliacus_r", "psoas"),
            ("x", ""),
        ] {
            assert!(!means(column, muscle), "{column} {muscle}");
        }
    }
}
