//! Tables, for the terminal and for the report.

/// A table of texts.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Table {
    /// Title; can be empty.
    pub title: String,
    /// Header of each column; can be empty.
    pub header: Vec<String>,
    /// Rows; a short one is padded with empty cells.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    /// A table without rows.
    pub fn new<T: Into<String>>(
        title: impl Into<String>,
        header: impl IntoIterator<Item = T>,
    ) -> Self {
        Self {
            title: title.into(),
            header: header.into_iter().map(Into::into).collect(),
            rows: Vec::new(),
        }
    }

    /// Adds a row.
    pub fn row<T: Into<String>>(&mut self, cells: impl IntoIterator<Item = T>) {
        self.rows.push(cells.into_iter().map(Into::into).collect());
    }

    /// The number of columns of the longest row.
    pub fn columns(&self) -> usize {
        self.rows
            .iter()
            .map(Vec::len)
            .chain([self.header.len()])
            .max()
            .unwrap_or(0)
    }

    /// True if a column contains only numbers, optionally with a unit: they are aligned to the
    /// right.
    pub(super) fn is_numeric(&self, column: usize) -> bool {
        let mut cells = self
            .rows
            .iter()
            .filter_map(|row| row.get(column))
            .filter(|cell| !cell.is_empty())
            .peekable();
        cells.peek().is_some()
            && cells.all(|cell| {
                let first = cell.split([' ', '%']).next().unwrap_or("");
                first == "-" || first.parse::<f64>().is_ok()
            })
    }

    /// The table as lines of text for a terminal, columns aligned, numbers to the right. Control
    /// characters are replaced, so that no text can control the terminal. Each character counts as
    /// one place.
    pub fn to_text(&self) -> String {
        let rows = || std::iter::once(&self.header).chain(&self.rows);
        let widths: Vec<usize> = (0..self.columns())
            .map(|column| {
                rows()
                    .map(|row| cell(row, column).chars().count())
                    .max()
                    .unwrap_or(0)
            })
            .collect();
        let numeric: Vec<bool> = (0..widths.len())
            .map(|column| self.is_numeric(column))
            .collect();
        let line = |row: &Vec<String>| {
            let cells = widths.iter().enumerate().map(|(column, width)| {
                let text = cell(row, column);
                if numeric[column] {
                    format!("{text:>width$}")
                } else {
                    format!("{text:<width$}")
                }
            });
            cells.collect::<Vec<_>>().join("  ").trim_end().to_owned() + "\n"
        };
        let mut text = String::new();
        if !self.title.is_empty() {
            text += &(tame(&self.title) + "\n");
        }
        if !self.header.is_empty() {
            text += &line(&self.header);
            text += &(widths
                .iter()
                .map(|width| "─".repeat(*width))
                .collect::<Vec<_>>()
                .join("  ")
                + "\n");
        }
        self.rows.iter().for_each(|row| text += &line(row));
        text
    }
}

/// The text of a cell; empty where the row ends earlier.
fn cell(row: &[String], column: usize) -> String {
    row.get(column).map(|text| tame(text)).unwrap_or_default()
}

fn tame(text: &str) -> String {
    text.chars()
        .map(|c| if c.is_control() { ' ' } else { c })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_aligned() {
        let mut table = Table::new("Effects", ["effect", "ms", "why"]);
        table.row(["stretch", "12.5", "requested"]);
        table.row(["bending", "3", ""]);
        table.row(["gravity"]);
        assert_eq!(
            table.to_text(),
            "Effects\neffect     ms  why\n───────  ────  ─────────\nstretch  12.5  requested\nbending     3\ngravity\n"
        );
    }

    #[test]
    fn a_text_cannot_steer_the_terminal() {
        let mut table = Table::new("a\x1b[2Jb", [""; 0]);
        table.row(["x\ny\u{9b}31m"]);
        assert!(
            table
                .to_text()
                .chars()
                .all(|c| c == '\n' || !c.is_control())
        );
        assert_eq!(table.to_text().lines().count(), 2);
    }

    #[test]
    fn an_empty_table_is_no_text() {
        assert_eq!(Table::default().to_text(), "");
        assert_eq!(Table::default().columns(), 0);
    }
}
