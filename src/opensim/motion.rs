//! Tables of OpenSim: values of coordinates over time (`.mot`, `.sto`).

use std::path::Path;

use super::document::{ModelError, TABLE, text_of};
use super::model::Model;
use crate::spelling::shown;

/// Values over time.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionTable {
    /// Name of the file, for messages.
    pub file: String,
    /// Names of the columns without `time`.
    pub columns: Vec<String>,
    /// Times \[s\], ascending.
    pub times: Vec<f64>,
    /// Values of each time, as in the file.
    pub rows: Vec<Vec<f64>>,
    /// True if angles are in degrees.
    pub in_degrees: bool,
}

impl MotionTable {
    /// Reads a table from a file.
    ///
    /// # Errors
    /// A file that cannot be read, or that is no table of OpenSim.
    pub fn read(path: &Path) -> Result<Self, ModelError> {
        Self::parse(&text_of(path)?, &path.display().to_string())
    }

    /// The same as [`Self::read`] for a text; `file` appears in messages.
    ///
    /// Angles are in degrees where the header has `inDegrees=yes`. Without `inDegrees` they are in
    /// degrees under the old header of SIMM, with `datacolumns` or `range`, and otherwise in radians,
    /// as in OpenSim.
    ///
    /// # Errors
    /// See [`Self::read`].
    pub fn parse(text: &str, file: &str) -> Result<Self, ModelError> {
        let fail = |line: usize, message: String| {
            let line = u32::try_from(line).unwrap_or(0);
            ModelError::at(file, [line, 0], TABLE, message)
        };
        let mut lines = text.lines().enumerate().map(|(k, l)| (k + 1, l));
        let (mut in_degrees, mut is_old) = (None, false);
        loop {
            let Some((number, line)) = lines.next() else {
                return Err(ModelError::whole(file, TABLE, "no line `endheader`"));
            };
            let line = line.trim();
            if line.eq_ignore_ascii_case("endheader") {
                break;
            }
            let word = line.split_ascii_whitespace().next().unwrap_or_default();
            is_old |= ["datacolumns", "datarows", "range"].contains(&word);
            if let Some((key, value)) = line.split_once('=')
                && key.trim().eq_ignore_ascii_case("inDegrees")
            {
                in_degrees = match value.trim().to_ascii_lowercase().as_str() {
                    "yes" => Some(true),
                    "no" => Some(false),
                    other => {
                        let message =
                            format!("inDegrees is `{}`, neither yes nor no", shown(other));
                        return Err(fail(number, message));
                    }
                };
            }
        }
        let mut lines = lines.filter(|(_, line)| !line.trim().is_empty());
        let Some((number, names)) = lines.next() else {
            return Err(ModelError::whole(file, TABLE, "no names of columns"));
        };
        let words = |line: &str| -> Vec<String> {
            match line.contains('\t') {
                true => line
                    .trim_end_matches(['\t', '\r'])
                    .split('\t')
                    .map(|w| w.trim().to_owned())
                    .collect(),
                false => line.split_ascii_whitespace().map(str::to_owned).collect(),
            }
        };
        let names = words(names);
        if names
            .first()
            .is_none_or(|first| !first.eq_ignore_ascii_case("time"))
        {
            let found = names.first().map_or("", String::as_str);
            return Err(fail(
                number,
                format!("the first column is `{}`, not `time`", shown(found)),
            ));
        }
        let (mut times, mut rows) = (Vec::new(), Vec::new());
        for (number, line) in lines {
            let values = words(line);
            if values.len() != names.len() {
                let message = format!("{} values for {} columns", values.len(), names.len());
                return Err(fail(number, message));
            }
            let parsed: Result<Vec<f64>, ModelError> = values
                .iter()
                .zip(&names)
                .map(|(word, name)| {
                    // Columns of other quantities can lack values; those of a motion cannot.
                    word.parse::<f64>().map_err(|_| {
                        let message = format!(
                            "`{}` in the column `{}` is no number",
                            shown(word),
                            shown(name)
                        );
                        fail(number, message)
                    })
                })
                .collect();
            let mut parsed = parsed?;
            let row = parsed.split_off(1);
            let time = parsed[0];
            if !time.is_finite() || times.last().is_some_and(|last| !(time > *last)) {
                return Err(fail(
                    number,
                    format!("the time {time} does not come after the one before"),
                ));
            }
            times.push(time);
            rows.push(row);
        }
        if times.is_empty() {
            return Err(ModelError::whole(file, TABLE, "the table has no rows"));
        }
        Ok(Self {
            file: file.to_owned(),
            columns: names[1..].to_vec(),
            times,
            rows,
            in_degrees: in_degrees.unwrap_or(is_old),
        })
    }

    /// First and last time \[s\].
    pub fn span(&self) -> [f64; 2] {
        [self.times[0], self.times[self.times.len() - 1]]
    }

    /// The coordinates of a model that have a column: the index of each with the one of its column.
    ///
    /// # Errors
    /// No column names a coordinate, or a value is not finite.
    pub fn coordinates(&self, model: &Model) -> Result<Vec<(usize, usize)>, ModelError> {
        let mut found = Vec::new();
        for (k, coordinate) in model.coordinates.iter().enumerate() {
            let of = |column: &String| {
                let plain = column.strip_suffix("/value").unwrap_or(column);
                plain == coordinate.name || plain == coordinate.path
                    // Models of one family differ in the names of their joints.
                    || column.ends_with(&format!("/{}/value", coordinate.name))
            };
            if let Some(column) = self.columns.iter().position(of) {
                if let Some(row) = self.rows.iter().position(|row| !row[column].is_finite()) {
                    let message = format!(
                        "the column `{}` is not finite at the time {} s",
                        shown(&self.columns[column]),
                        self.times[row]
                    );
                    return Err(ModelError::whole(&self.file, TABLE, message));
                }
                found.push((k, column));
            }
        }
        if found.is_empty() {
            let message = format!(
                "no column is a coordinate of the model {} (its coordinates are {})",
                shown(&model.name),
                crate::spelling::listed(model.coordinates.iter().map(|c| c.name.as_str()))
            );
            return Err(ModelError::whole(&self.file, TABLE, message));
        }
        Ok(found)
    }

    /// The values of all coordinates of a model at a time \[s\], linear between two rows: defaults
    /// for coordinates without a column, functions for coupled ones. Times outside of the table
    /// have the values of its ends. `columns` are those of [`Self::coordinates`].
    pub fn values(&self, model: &Model, columns: &[(usize, usize)], time: f64) -> Vec<f64> {
        let next = self.times.partition_point(|t| *t <= time);
        let (before, after) = match next {
            0 => (0, 0),
            next if next == self.times.len() => (next - 1, next - 1),
            next => (next - 1, next),
        };
        let span = self.times[after] - self.times[before];
        let share = if span > 0.0 {
            (time - self.times[before]) / span
        } else {
            0.0
        };
        let mut values: Vec<f64> = model.coordinates.iter().map(|c| c.default).collect();
        for &(coordinate, column) in columns {
            let [from, to] = [before, after].map(|row| self.rows[row][column]);
            let value = from + (to - from) * share;
            let degrees = self.in_degrees && model.coordinates[coordinate].in_degrees;
            values[coordinate] = if degrees { value.to_radians() } else { value };
        }
        model.couple(&mut values);
        values
    }
}
