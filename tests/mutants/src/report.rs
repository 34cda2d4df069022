//! The scores of folders and the mistakes that no test found.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use std::{fs, io};

use crate::draw::Mutant;
use crate::judge::Verdict;

/// What was judged so far, by number.
pub fn known(judged: &Path) -> BTreeMap<u32, Verdict> {
    let text = fs::read_to_string(judged).unwrap_or_default();
    let one = |line: &str| {
        let (id, verdict) = line.split_once('\t')?;
        Some((id.parse().ok()?, Verdict::of_text(verdict)?))
    };
    text.lines().filter_map(one).collect()
}

/// The commit of the sources, and its date.
///
/// # Errors
/// Without git.
pub fn commit(root: &Path) -> io::Result<String> {
    let format = ["log", "-1", "--format=%h %cs"];
    let told = Command::new("git").args(format).current_dir(root).output()?;
    Ok(String::from_utf8_lossy(&told.stdout).trim().to_owned())
}

/// Mistakes that change no result, with the reason: lines of file, what stands there, what would, reason.
fn equivalent(root: &Path) -> Vec<[String; 4]> {
    let text = fs::read_to_string(root.join("tests/mutants/equivalent.tsv")).unwrap_or_default();
    let lines = text.lines().filter_map(|line| {
        let parts: Vec<String> = line.split('\t').map(str::to_owned).collect();
        parts.try_into().ok()
    });
    lines.collect()
}

/// One line, with single spaces.
fn flat(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Writes `tests/mutants/results.tsv` and prints the table of scores.
///
/// # Errors
/// A file that cannot be written.
pub fn write(root: &Path, drawn: &[Mutant], judged: &BTreeMap<u32, Verdict>) -> io::Result<()> {
    let known = equivalent(root);
    let mut lines = String::from("file\tline\tstands\twould\tverdict\tby\n");
    let mut scores: BTreeMap<&str, [usize; 4]> = BTreeMap::new();
    for mutant in drawn {
        let Some(verdict) = judged.get(&mutant.id) else { continue };
        let (right, wrong) = (flat(&mutant.right), flat(&mutant.site.wrong));
        let same = |e: &&[String; 4]| e[0] == mutant.file && e[1] == right && e[2] == wrong;
        let told = known.iter().find(same).filter(|_| !matches!(verdict, Verdict::Killed(_)));
        let (place, text) = match (verdict, told) {
            (_, Some([.., reason])) => (3, format!("equivalent\t{reason}")),
            (Verdict::Killed(_), _) => (0, verdict.to_text()),
            (Verdict::Survived(_), _) => (1, verdict.to_text()),
            (Verdict::Unreached, _) => (2, verdict.to_text()),
        };
        scores.entry(&mutant.folder).or_default()[place] += 1;
        lines += &format!("{}\t{}\t{right}\t{wrong}\t{text}\n", mutant.file, mutant.site.line);
    }
    fs::write(root.join("tests/mutants/results.tsv"), lines)?;
    let commit = fs::read_to_string(root.join("target/mutants/commit.txt")).unwrap_or_default();
    println!("Sources of {commit}; {} of {} judged.\n", judged.len(), drawn.len());
    println!("| folder | made | found | not found | not reached | equivalent | found of the rest |");
    println!("|---|---|---|---|---|---|---|");
    let mut total = [0; 4];
    let line = |folder: &str, [found, missed, unreached, same]: [usize; 4]| {
        let rest = found + missed + unreached;
        let share = 100.0 * found as f64 / rest.max(1) as f64;
        println!("| {folder} | {} | {found} | {missed} | {unreached} | {same} | {share:.0} % |", rest + same);
    };
    for (folder, score) in &scores {
        (0..4).for_each(|k| total[k] += score[k]);
        line(folder, *score);
    }
    line("all", total);
    Ok(())
}
