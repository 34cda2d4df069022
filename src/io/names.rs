//! File names of a run.

/// The file in the folder of a run that lists all other files of the run, one per line.
pub const LIST: &str = "pliant-files.txt";

/// Keeps only the characters of a name that are safe in a file name and in a link to the file.
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
