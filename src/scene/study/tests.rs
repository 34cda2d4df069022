use super::*;
use crate::scene::no_variables;

const HEAD: &str = "scene = \"distance\"\n";

fn read(text: &str) -> Read<StudyFile> {
    StudyFile::parse(
        text,
        "s.toml",
        Path::new("."),
        &[],
        &["time_s", "volume_error"],
        no_variables,
    )
}

fn keys(changes: &[StudyChange]) -> Vec<(&str, &str)> {
    changes
        .iter()
        .map(|c| (c.key.as_str(), c.value.as_str()))
        .collect()
}

#[test]
fn values_are_written_as_behind_set() {
    let study = read(&format!(
        "{HEAD}frames = [9, 1]\nmeasures = [\"time_s\"]\ncombine = \"one at a time\"
        [set]\n\"effects.damping.rate\" = \"5 1/s\"\nsolver.pbd.stretch = 1e-7\nframes = 20
        [vary]\n\"solver.pbd.iterations\" = [1, 3]\n\"muscle.0.force.0.force\" = [[\"0 N\", \"-1 N\", \"0 N\"]]
        effects.gravity = [\"off\", {{ acceleration = [\"0 m/s2\", \"0 m/s2\", \"0 m/s2\"] }}]
        [reference]\nsolver.pbd.iterations = 100\n"
    ))
    .unwrap();
    assert_eq!(
        (study.name.as_str(), study.frames, study.combine),
        ("s", Some(vec![1, 9]), Combine::OneAtATime)
    );
    let set = [
        ("effects.damping.rate", "5 1/s"),
        ("solver.pbd.stretch", "1e-7"),
        ("frames", "20"),
    ];
    assert_eq!(keys(&study.set), set);
    let varied: Vec<_> = study.vary.iter().flat_map(|v| keys(&v.values)).collect();
    let expected = [
        ("solver.pbd.iterations", "1"),
        ("solver.pbd.iterations", "3"),
        ("muscle.0.force.0.force", "[\"0 N\", \"-1 N\", \"0 N\"]"),
        ("effects.gravity", "off"),
        (
            "effects.gravity",
            "{acceleration = [\"0 m/s2\", \"0 m/s2\", \"0 m/s2\"]}",
        ),
    ];
    assert_eq!(varied, expected);
    assert_eq!(keys(&study.reference), [("solver.pbd.iterations", "100")]);
}

#[test]
fn changes_apply_in_the_order_set_command_line_vary() {
    let text = format!(
        "{HEAD}[set]\nframes = 20\niterations = 5\n[vary]\n\"solver.pbd.stretch\" = [0.5, 1]\n"
    );
    let more = ["frames=30".to_owned()];
    let study =
        StudyFile::parse(&text, "s.toml", Path::new("."), &more, &[], no_variables).unwrap();
    let scene = study.scene_with(&[&study.vary[0].values[0]]).unwrap();
    let crate::scene::Content::Muscles(scene) = scene else {
        panic!()
    };
    assert_eq!((scene.frames, scene.solver.iterations()), (30, 5));
    let crate::scene::Solver::Pbd(pbd) = scene.solver else {
        panic!()
    };
    assert_eq!(pbd.stretch, 0.5);
    // Under a varied key a change from the command line would be lost.
    let more = ["solver.pbd.stretch=0.3".to_owned()];
    let alone = format!("combine = \"one at a time\"\n{text}")
        .replace("iterations = 5", "solver.pbd.stretch = 0.2");
    assert!(
        StudyFile::parse(&alone, "s.toml", Path::new("."), &more, &[], no_variables).is_ok(),
        "there it is that of the base"
    );
    let error =
        StudyFile::parse(&text, "s.toml", Path::new("."), &more, &[], no_variables).unwrap_err();
    assert!(
        error.terse().contains("error[E053]")
            && error
                .terse()
                .contains("`solver.pbd.stretch` is given twice"),
        "{error:?}"
    );
}

#[test]
fn what_is_wrong_is_told_at_its_place() {
    let vary = "[vary]\niterations = [1, 3]\n";
    let with = |text: &str| format!("{HEAD}{text}\n{vary}");
    let many = (0..5).map(|k| {
        format!(
            "k{k} = [{}]\n",
            (0..10).map(|v| v.to_string()).collect::<Vec<_>>().join(",")
        )
    });
    let many = format!("{HEAD}[vary]\n{}", many.collect::<String>());
    // 65 keys of two values: 2^65 combinations.
    let countless = format!(
        "{HEAD}[vary]\n{}",
        (0..65)
            .map(|k| format!("k{k} = [0, 1]\n"))
            .collect::<String>()
    );
    let cases: Vec<(String, &str, &str)> = vec![
        (
            vary.to_owned(),
            "s.toml:1:1: error[E055]",
            "`scene` is missing",
        ),
        (
            HEAD.to_owned(),
            "s.toml:1:1: error[E055]",
            "`vary` is missing",
        ),
        (
            with("colour = 3"),
            "s.toml:2:1: error[E052]",
            "unknown key `colour`",
        ),
        (
            with("frames = []"),
            "s.toml:2:10: error[E065]",
            "the list is empty",
        ),
        (
            with("frames = [1, 1]"),
            "s.toml:2:14: error[E051]",
            "each frame once",
        ),
        (with("frames = [-1]"), "s.toml:2:11: error[E051]", "-1"),
        (
            with("frames = [1, 601]"),
            "s.toml:2:10: error[E051]",
            "frames from 0 to 600",
        ),
        (
            with("combine = \"any\""),
            "s.toml:2:11: error[E063]",
            "one at a time",
        ),
        (
            with("measures = [\"tim_s\"]"),
            "s.toml:2:13: error[E063]",
            "did you mean `time_s`",
        ),
        (
            with("[set]\niterations = 3"),
            "s.toml:5:1: error[E053]",
            "`iterations` is given twice",
        ),
        (
            with("[set]\niteration = 3"),
            "s.toml:3:13: error[E052]",
            "unknown key `iteration`",
        ),
        (
            with("[set]\nsolver.pbd.stretch = 2"),
            "s.toml:3:22: error[E051]",
            "solver.pbd.stretch: `2` is not",
        ),
        (
            with("[set]\nstretch = 1979-05-27"),
            "s.toml:3:11: error[E054]",
            "a date or time",
        ),
        (
            with("[set]\nstretch = \"\""),
            "s.toml:3:11: error[E051]",
            "not empty",
        ),
        (
            with("[set]\nsolver = \"xpbd\"\naccuracy = \"1 mm\""),
            "s.toml:1:9: error[E068]",
            "asks for an accuracy",
        ),
        (
            format!("{HEAD}[vary]\n"),
            "s.toml:2:1: error[E055]",
            "a key with its values",
        ),
        (
            format!("{HEAD}[vary]\niterations = []"),
            "s.toml:3:14: error[E065]",
            "at least one value",
        ),
        (
            format!("{HEAD}[vary]\niterations = 3"),
            "s.toml:3:14: error[E054]",
            "a list of values",
        ),
        (
            format!("{HEAD}[vary]\niterations = [1, 3, 1]"),
            "s.toml:3:21: error[E051]",
            "each value once",
        ),
        (
            format!("{HEAD}[vary]\niterations = [1]\niterations = [2]"),
            "s.toml:4:1: error[E053]",
            "given twice",
        ),
        (
            format!("scene = \"distanse\"\n{vary}"),
            "s.toml:1:9: error[E063]",
            "did you mean `distance`",
        ),
        (
            format!("scene = \"no.toml\"\n{vary}"),
            "s.toml:1:9: error[E060]",
            "no file",
        ),
        (many, "s.toml:2:1: error[E051]", "100000 combinations"),
        (
            countless,
            "s.toml:2:1: error[E051]",
            "more combinations than can be counted",
        ),
        ("scene = ".to_owned(), "s.toml:1:", "error[E057]"),
    ];
    for (text, place, part) in cases {
        let error = read(&text).map(|s| s.name).unwrap_err().terse();
        assert!(
            error.starts_with(place) && error.contains(part),
            "{text}\n{error}\nwanted {place} {part}"
        );
    }
}

#[test]
fn what_a_combination_makes_wrong_is_told_at_its_value() {
    let study = read(&format!(
        "{HEAD}[vary]\niterations = [1, 0]\n\"effects.contact.thickness\" = [\"1 mm\", 3]\n"
    ))
    .unwrap();
    let error = |k: usize, v: usize| {
        study
            .scene_with(&[&study.vary[k].values[v]])
            .unwrap_err()
            .terse()
    };
    assert!(
        error(0, 1).starts_with("s.toml:3:18: error[E051]: solver.pbd.iterations: `0`"),
        "{}",
        error(0, 1)
    );
    assert!(
        error(1, 1).starts_with("s.toml:4:40: error[E050]: effects.contact.thickness: "),
        "{}",
        error(1, 1)
    );
    // Only the scene's own text is wrong, after a change has removed a part that it needs.
    let study = read(&format!(
        "{HEAD}[vary]\nframe_rate = [\"60 Hz\", \"off\"]\n"
    ))
    .unwrap();
    let error = study
        .scene_with(&[&study.vary[0].values[1]])
        .unwrap_err()
        .terse();
    assert!(
        error.starts_with("s.toml:3:24: error[E068]") && error.contains("with frame_rate = off"),
        "{error}"
    );
    assert!(error.contains("`frame_rate` is missing"), "{error}");
}

#[test]
fn only_keys_that_need_quotes_have_them() {
    for (key, toml) in [
        ("edge_length", "edge_length"),
        ("a-7", "a-7"),
        ("a b", "\"a b\""),
        ("a.b", "\"a.b\""),
        ("", "\"\""),
    ] {
        assert_eq!(super::toml_key(key).as_deref(), Some(toml));
    }
}
