//! The shapes at rest of scans under a load: meshes, distances, JSON and a page.

use serde_json::json;

use super::output::{DataFile, OutputFile, Plot, RunOutput, Verdict};
use super::sensitivities::{rms, surfaces};
use super::{LinePlot, Table};
use pliant::format::number;
use pliant::io::{self, Encoding, WriteError, file_name};
use pliant::mesh::measures::max_or_nan;
use pliant::simulation::Unloaded;
use pliant_render::PictureError;

/// The result, for a frame and a tolerance [m].
///
/// # Errors
/// A picture that cannot be encoded.
pub fn output<'a>(
    name: &str,
    (frame, tolerance): (usize, f64),
    found: &'a Unloaded,
) -> Result<RunOutput<'a>, PictureError> {
    let (pictures, mut files) = surfaces(
        &found.bodies,
        (
            "Distance",
            "shape at rest, coloured by the distance of its equilibrium from the scan",
        ),
        "distance_m",
    )?;
    for (body, mesh, _) in &found.bodies {
        files.push(OutputFile::new(
            format!("{}.obj", file_name(body)),
            move |path| {
                io::write(path, mesh, &[], Encoding::Text)
                    .map(|_| ())
                    .map_err(|error| match error {
                        WriteError::Io { source, .. } => source,
                        other => std::io::Error::other(other),
                    })
            },
        ));
    }
    let heads = [
        "muscle",
        "RMS [mm]",
        "greatest [mm]",
        "volume at rest [cm3]",
    ];
    let mut table = Table::new("Distance of the equilibrium from the scan", heads);
    let mut verdicts = Vec::new();
    for (body, mesh, distances) in &found.bodies {
        let most = max_or_nan(distances.iter().copied());
        table.row([
            body.clone(),
            number(rms(distances) * 1e3),
            number(most * 1e3),
            number(mesh.volume() * 1e6),
        ]);
        verdicts.push(
            Verdict::at_most("distance of the equilibrium from the scan", most, tolerance)
                .in_unit("m")
                .at(body.as_str())
                .else_do("a stiffer material, a smaller load, or a greater --tolerance"),
        );
    }
    verdicts.push(
        Verdict::new(
            "the equilibrium of these shapes has converged",
            found.is_at_rest,
        )
        .else_do("another frame, a stiffer material, or a smaller load"),
    );
    let rounds = found.rounds.iter().enumerate();
    let line = rounds.clone().map(|(k, left)| (k as f64, left * 1e3));
    let plot = LinePlot::new("Greatest distance from the scan [mm]", "round")
        .with("", line)
        .with_limit("tolerance", tolerance * 1e3)
        .logarithmic();
    let rows: Vec<Vec<String>> = rounds
        .map(|(k, left)| vec![k.to_string(), left.to_string()])
        .collect();
    let bodies = found.bodies.iter().map(|(body, _, distances)| {
        json!({
            "body": body,
            "distance_rms_m": rms(distances),
            "distance_max_m": max_or_nan(distances.iter().copied()),
        })
    });
    Ok(RunOutput {
        kind: "unload",
        name: name.to_owned(),
        measures: json!({
            "frame": frame,
            "tolerance_m": tolerance,
            "rounds_m": found.rounds,
            "parted_m": found.parted,
            "bodies": bodies.collect::<Vec<_>>(),
        }),
        verdicts,
        findings: (found.parted > tolerance)
            .then(|| {
                format!(
                    "the scan lies in a bone or in another muscle: up to {} mm of it was moved at the start, and the equilibrium meets \
                     what came of it",
                    number(found.parted * 1e3)
                )
            })
            .into_iter()
            .collect(),
        title: format!("{name}: shapes at rest"),
        subtitle: format!("of scans under the load of frame {frame}, {} rounds", found.rounds.len()),
        tables_of_text: 1,
        tables: vec![table],
        plots: vec![Plot { file: None, plot }],
        pictures,
        explanations: vec![
            "A run that begins with such a shape comes to the scan. The first distance of the plot is how far the scan sags if it is \
             taken for the shape at rest."
                .to_owned(),
        ],
        data: vec![DataFile::new("unload.csv", ["round", "distance_max_m"], rows.into_iter())],
        files,
        ..RunOutput::default()
    })
}
