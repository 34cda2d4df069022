//! Files of a run of a spring system.

use nalgebra::Point3;

use super::super::failure::Failure;
use super::pictures::Shown;
use crate::report::LinePlot;
use crate::report::folder::{Folder, FolderError};
use crate::report::output::{DataFile, OutputFile, Picture, Plot, RunOutput, measures};
use crate::report::springs::{Summary, settings};
use pliant::format::number;
use pliant::io::file_name;
use pliant::io::pvd::{Collection, Entry};
use pliant::io::vtp::{self, PolyData};
use pliant::simulation::SpringsRun;
use pliant::springs::StepRecord;
use pliant::springs::format::{self, SpringFile};

/// Greatest number of rows in the table of steps; a longer run keeps every second step, and so on.
const MOST_ROWS: usize = 20_000;

/// Greatest number of points of a plotted line.
const MOST_POINTS: usize = 1000;

/// Stored and written data of a run.
pub(super) struct Record {
    folder: Folder,
    name: String,
    lines: Vec<Vec<u32>>,
    triangles: Vec<[u32; 3]>,
    shown: Shown,
    rows: Vec<(StepRecord, f64)>,
    stride: usize,
    every: Option<u32>,
    series: Collection,
    /// The file of the system, with its fibres and areas.
    file: Option<SpringFile>,
    failed: Option<FolderError>,
}

impl Record {
    /// Starts with the initial state and writes it.
    pub(super) fn begin(
        folder: Folder,
        run: &SpringsRun,
        every: Option<u32>,
        file: Option<SpringFile>,
    ) -> Result<Self, Failure> {
        let start = run.start_positions();
        let mut record = Self {
            folder,
            name: file_name(&run.name),
            lines: run.lines.iter().map(|ends| ends.to_vec()).collect(),
            triangles: run.triangles.clone(),
            shown: Shown::behind_cut(&start, &run.lines, &run.rest_lengths),
            rows: Vec::new(),
            stride: 1,
            every,
            series: Collection::new(),
            file,
            failed: None,
        };
        record.put("start.vtp", run)?;
        if every.is_some() {
            record.frame(run)?;
        }
        Ok(record)
    }

    /// Adds a step; an error of writing a frame is reported at the end.
    pub(super) fn step(&mut self, run: &SpringsRun) {
        let step = &run.last;
        if step.step.is_multiple_of(self.stride) {
            self.rows.push((*step, run.time));
        }
        if self.rows.len() > MOST_ROWS {
            self.stride *= 2;
            let stride = self.stride;
            self.rows.retain(|(row, _)| row.step.is_multiple_of(stride));
        }
        let due = self
            .every
            .is_some_and(|every| step.step.is_multiple_of(every as usize));
        if due && self.failed.is_none() {
            self.failed = self.frame(run).err();
        }
    }

    fn frame(&mut self, run: &SpringsRun) -> Result<(), FolderError> {
        let file = format!("frames/{}_{:06}.vtp", self.name, run.last.step);
        self.put(&file, run)?;
        self.series.push(Entry {
            time: run.time,
            part: 0,
            name: self.name.clone(),
            file,
        });
        Ok(())
    }

    fn put(&self, file: &str, run: &SpringsRun) -> Result<(), FolderError> {
        // One after the other: those of a large lattice take most of the memory.
        let position = run.positions();
        let mut moved = Vec::with_capacity(3 * position.len());
        let start = run.start_positions();
        for (x, start) in position.iter().zip(&start) {
            moved.extend(<[f64; 3]>::from(x - start));
        }
        drop(start);
        let held = run.held().into_iter();
        let mut point_data = vec![
            ("displacement_m", moved),
            ("speed_m_s", run.speeds()),
            ("held", held.map(|held| f64::from(u8::from(held))).collect()),
        ];
        let areas = self.file.iter().flat_map(|file| {
            let SpringFile {
                origin, insertion, ..
            } = file;
            [("origin", origin), ("insertion", insertion)]
        });
        for (name, area) in areas.filter(|(_, area)| !area.is_empty()) {
            let mut is_in = vec![0.0; position.len()];
            area.iter().for_each(|&p| is_in[p as usize] = 1.0);
            point_data.push((name, is_in));
        }
        let data = PolyData {
            points: &position,
            triangles: &self.triangles,
            lines: &self.lines,
            point_data,
            ..PolyData::default()
        };
        let path = self.folder.claim(file)?;
        vtp::write(&path, &data).map_err(|source| FolderError::Io { path, source })
    }

    /// The folder of the results.
    pub(super) fn folder(&self) -> &Folder {
        &self.folder
    }

    /// The first frame that could not be written, as an error.
    pub(super) fn check(&mut self) -> Result<(), FolderError> {
        self.failed.take().map_or(Ok(()), Err)
    }

    /// The result.
    pub(super) fn output(
        &self,
        run: &SpringsRun,
        summary: &Summary,
        time_s: f64,
    ) -> Result<RunOutput<'_>, Failure> {
        let mut written = vec!["start.vtp".to_owned()];
        if run.is_finite() {
            self.put("end.vtp", run)?;
            written.push("end.vtp".to_owned());
            if let Some(file) = &self.file {
                let end = SpringFile {
                    position: run.positions().into_owned(),
                    ..file.clone()
                };
                let path = self.folder.claim("end.springs")?;
                format::write(&path, &end).map_err(|source| FolderError::Io { path, source })?;
                written.push("end.springs".to_owned());
                if !end.fibres.is_empty() {
                    let lines: Vec<_> = end.fibres.iter().map(|ends| ends.to_vec()).collect();
                    let data = PolyData {
                        points: &end.position,
                        lines: &lines,
                        ..PolyData::default()
                    };
                    let path = self.folder.claim("fibres.vtp")?;
                    vtp::write(&path, &data).map_err(|source| FolderError::Io { path, source })?;
                    written.push("fibres.vtp".to_owned());
                }
            }
        }
        let (start, end) = (run.start_positions(), run.positions());
        let mut states = vec![("start", &start[..])];
        if run.is_finite() {
            states.push(("end", &end));
        }
        let series = self
            .every
            .map(|_| OutputFile::new(format!("{}.pvd", self.name), |path| self.series.write(path)));
        let plot = |plot| Plot { file: None, plot };
        Ok(RunOutput {
            kind: "springs",
            name: run.name.clone(),
            measures: measures(summary),
            pictures: self.pictures(&states)?,
            title: format!("{}: a spring system", run.name),
            subtitle: format!("{} steps, {} s of computing", summary.steps, number(time_s)),
            text: format!("{}: {}\n", run.name, summary.end),
            tables_of_text: 1,
            tables: vec![settings(summary)],
            plots: self.plots(summary).into_iter().map(plot).collect(),
            time_s,
            data: vec![self.data()],
            files: series.into_iter().collect(),
            written,
            ..RunOutput::default()
        })
    }

    /// Draws each state, with its caption for the report.
    fn pictures(&self, states: &[(&str, &[Point3<f64>])]) -> Result<Vec<Picture>, FolderError> {
        let drawn = self.shown.pictures(states)?;
        let picture = |((name, _), bytes): (&(&str, &[Point3<f64>]), Vec<u8>)| Picture {
            file: format!("{name}.png"),
            caption: format!("{name}: springs behind a cut through the middle, coloured by strain"),
            bytes,
            wide: false,
        };
        Ok(states.iter().zip(drawn).map(picture).collect())
    }

    fn data(&self) -> DataFile<'_> {
        let columns = [
            "step",
            "time_s",
            "dt_s",
            "greatest_move_m",
            "kinetic_energy_j",
            "spring_energy_j",
            "residual_force_n",
        ];
        let row = |(r, time): &(StepRecord, f64)| {
            let numbers = [
                *time,
                r.dt,
                r.greatest_move,
                r.energy.kinetic,
                r.energy.stored,
                r.residual,
            ];
            let cells = numbers.iter().map(|n| format!("{n:?}"));
            std::iter::once(r.step.to_string()).chain(cells).collect()
        };
        DataFile::new("measures.csv", columns, self.rows.iter().map(row))
    }

    fn plots(&self, s: &Summary) -> Vec<LinePlot> {
        let line = |value: &dyn Fn(&StepRecord) -> f64| {
            let each = self.rows.len().div_ceil(MOST_POINTS).max(1);
            let points: Vec<(f64, f64)> = self
                .rows
                .iter()
                .map(|(r, _)| (r.step as f64, value(r)))
                .collect();
            let greatest = |some: &[(f64, f64)]| {
                some.iter()
                    .copied()
                    .reduce(|a, b| if b.1 > a.1 { b } else { a })
            };
            points.chunks(each).filter_map(greatest).collect::<Vec<_>>()
        };
        let plot = |title: &str| LinePlot::new(title, "step").logarithmic();
        let mut plots = vec![
            plot("Energy [J]")
                .with("kinetic", line(&|r| r.energy.kinetic))
                .with("springs", line(&|r| r.energy.stored)),
            plot("Greatest force on a free point [N]")
                .with("force", line(&|r| r.residual))
                .with_limit("at rest", s.residual_force_allowed_n),
            plot("Greatest move in a step [m]").with("move", line(&|r| r.greatest_move)),
        ];
        if s.adaptive {
            plots.push(plot("Step [s]").with("step", line(&|r| r.dt)));
        }
        plots
    }
}
