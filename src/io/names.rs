//! Names of the files of a run.

/// The file in the folder of a run that lists all other files of the run, a line each.
pub const LIST: &str = "pliant-files.txt";

/// The characters of a name that are safe in the name of a file and in a link to it.
pub fn file_name(name: &str) -> String {
    let safe = |c: char| {
        if c.is_alphanumeric() || "-_.".contains(c) {
            c
        } else {
            '_'
        }
    };
    name.chars().map(safe).collect()
}
