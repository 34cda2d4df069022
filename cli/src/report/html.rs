//! The report as one HTML file.

use std::fmt::Write as _;

use super::output::Verdict;
use super::plot::LinePlot;
use super::table::Table;
use super::turntable::{self, Turntable};

/// The contents of a report.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Report {
    /// The heading.
    pub title: String,
    /// Subtitle.
    pub subtitle: String,
    /// Results of checks.
    pub verdict: Vec<Verdict>,
    /// Tables directly below the checks.
    pub lead: Vec<Table>,
    /// Findings that are neither right nor wrong, below the checks.
    pub findings: Vec<String>,
    /// Caption and bytes of each picture of a place where a check failed.
    pub places: Vec<(String, Vec<u8>)>,
    /// Caption and bytes (PNG or GIF) of each picture, shown side by side.
    pub pictures: Vec<(String, Vec<u8>)>,
    /// Caption and bytes of each picture of full width, one below the other.
    pub sheets: Vec<(String, Vec<u8>)>,
    /// Pictures with a slider.
    pub turntable: Option<Turntable>,
    /// Heading of the plots; "Over the run" if empty.
    pub plots_title: String,
    /// Plots, two in a row.
    pub plots: Vec<LinePlot>,
    /// Tables, one below the other.
    pub tables: Vec<Table>,
    /// Notes at the end.
    pub notes: Vec<String>,
}

const STYLE: &str = "\
:root{color-scheme:light dark;--page:#f4f5f7;--card:#fff;--ink:#1d2129;--soft:#5c6470;--line:#dfe2e7;--good:#1a7f4b;\
--bad:#c0341d;--good-back:#e5f4ec;--bad-back:#fbe9e5}
@media (prefers-color-scheme:dark){:root{--page:#15171b;--card:#1e2126;--ink:#e6e8eb;--soft:#9aa2ad;--line:#32373f;\
--good:#5fd09a;--bad:#ff8a73;--good-back:#173327;--bad-back:#3d201a}}
*{box-sizing:border-box}
body{margin:0;background:var(--page);color:var(--ink);font:15px/1.5 system-ui,-apple-system,'Segoe UI',Roboto,sans-serif}
main{max-width:1180px;margin:0 auto;padding:32px 24px 64px}
h1{font-size:28px;line-height:1.2;margin:0}
h2{font-size:18px;margin:36px 0 12px}
.subtitle{color:var(--soft);margin:6px 0 20px}
.card{background:var(--card);border:1px solid var(--line);border-radius:10px;padding:16px 18px;margin:0}
.grid{display:grid;gap:16px}
.pictures{grid-template-columns:repeat(auto-fill,minmax(min(100%,320px),1fr))}
.places{grid-template-columns:repeat(auto-fill,minmax(min(100%,480px),1fr))}
.plots{grid-template-columns:repeat(auto-fit,minmax(min(100%,480px),1fr))}
.pictures .card,.sheets .card{padding:0;overflow:hidden}
.pictures img,.sheets img{display:block;width:100%;height:auto;background:#fff}
figcaption{padding:10px 14px;color:var(--soft);border-top:1px solid var(--line)}
.plots svg{display:block;width:100%;height:auto}
.sum{font-size:17px;font-weight:600;padding:12px 18px;border-radius:10px;margin:0 0 12px}
.sum.pass{color:var(--good);background:var(--good-back)}
.sum.fail{color:var(--bad);background:var(--bad-back)}
.checks{list-style:none;padding:8px 18px}
.checks li{display:flex;gap:12px;padding:5px 0;border-top:1px solid var(--line)}
.checks li:first-child{border-top:0}
.checks b{flex:none;width:60px;font-size:13px;line-height:1.75}
.pass b{color:var(--good)}
.fail b{color:var(--bad)}
.found b{color:var(--soft)}
.scroll{overflow-x:auto;padding:6px 0}
table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums}
th,td{padding:6px 18px;text-align:left;vertical-align:top;border-top:1px solid var(--line)}
tr:first-child>*{border-top:0}
th{color:var(--soft);font-weight:600;font-size:13px}
.n{text-align:right;white-space:nowrap}
.notes{color:var(--soft)}
.next{display:block;color:var(--soft)}
@media print{:root{color-scheme:light;--page:#fff;--card:#fff;--ink:#000;--soft:#444;--line:#bbb;--good:#1a7f4b;--bad:#c0341d}\
main{max-width:none;padding:0}body{font-size:10pt}h2{break-after:avoid}.card{break-inside:avoid}\
.scroll{overflow:visible}.scroll table{font-size:8pt}th,td{padding:3px 6px}.n{white-space:normal}\
.pictures{grid-template-columns:1fr 1fr}.plots{grid-template-columns:1fr 1fr}.turntable{display:none}}
";

impl Report {
    /// The report as one self-contained HTML file: it loads nothing, has no script except that of
    /// the turntable, escapes every text, and is light or dark like the reader's system. Equal
    /// reports give equal bytes.
    pub fn to_html(&self) -> String {
        let title = escape(&self.title);
        // Even if an escape failed, the browser would run and load nothing else.
        let (script, style) = match self.turntable {
            Some(_) => (turntable::POLICY, turntable::STYLE),
            None => ("", ""),
        };
        let policy =
            format!("default-src 'none'; img-src data:; style-src 'unsafe-inline'{script}");
        let mut html = format!(
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta http-equiv=\"Content-Security-Policy\" content=\"{policy}\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <title>{title}</title>\n<style>\n{STYLE}{style}</style>\n</head>\n<body>\n<main>\n<h1>{title}</h1>\n"
        );
        if !self.subtitle.is_empty() {
            let _ = writeln!(html, "<p class=\"subtitle\">{}</p>", escape(&self.subtitle));
        }
        self.write_verdict(&mut html);
        self.lead
            .iter()
            .for_each(|table| write_table(&mut html, table));
        let failed = ("Where checks fail", "pictures places");
        write_pictures(&mut html, failed, &self.places);
        write_pictures(&mut html, ("Pictures", "pictures"), &self.pictures);
        let of_sheets = if self.pictures.is_empty() {
            "Pictures"
        } else {
            "Larger pictures"
        };
        write_pictures(&mut html, (of_sheets, "sheets"), &self.sheets);
        self.turntable
            .iter()
            .for_each(|table| table.write(&mut html));
        if !self.plots.is_empty() {
            let heading = if self.plots_title.is_empty() {
                "Over the run"
            } else {
                &self.plots_title
            };
            let _ = writeln!(
                html,
                "<h2>{}</h2>\n<div class=\"grid plots\">",
                escape(heading)
            );
            for plot in &self.plots {
                let _ = writeln!(html, "<figure class=\"card\">{}</figure>", plot.to_svg());
            }
            html += "</div>\n";
        }
        self.tables
            .iter()
            .for_each(|table| write_table(&mut html, table));
        if !self.notes.is_empty() {
            html += "<h2>Notes</h2>\n<ul class=\"notes\">\n";
            for note in &self.notes {
                let _ = writeln!(html, "<li>{}</li>", escape(note));
            }
            html += "</ul>\n";
        }
        html + "</main>\n</body>\n</html>\n"
    }

    fn write_verdict(&self, html: &mut String) {
        if self.verdict.is_empty() && self.findings.is_empty() {
            return;
        }
        let (all, failed) = (
            self.verdict.len(),
            self.verdict.iter().filter(|v| !v.passed).count(),
        );
        let (class, sum) = match (all, failed) {
            (0, 0) => ("found", "Nothing was checked".to_owned()),
            (1, 0) => ("pass", "The check passes".to_owned()),
            (_, 0) => ("pass", format!("All {all} checks pass")),
            _ => (
                "fail",
                format!(
                    "{failed} of {all} checks {}",
                    if failed == 1 { "fails" } else { "fail" }
                ),
            ),
        };
        let _ = writeln!(
            html,
            "<p class=\"sum {class}\">{sum}</p>\n<ul class=\"card checks\">"
        );
        // Failures come first.
        let (failed, passed): (Vec<_>, Vec<_>) = self.verdict.iter().partition(|v| !v.passed);
        for verdict in failed.into_iter().chain(passed) {
            let (class, mark) = if verdict.passed {
                ("pass", "✓ pass")
            } else {
                ("fail", "✗ fail")
            };
            let _ = writeln!(
                html,
                "<li class=\"{class}\"><b>{mark}</b><span>{}</span></li>",
                with_advice(verdict)
            );
        }
        for text in &self.findings {
            let _ = writeln!(
                html,
                "<li class=\"found\"><b>→ found</b><span>{}</span></li>",
                escape(text)
            );
        }
        html.push_str("</ul>\n");
    }
}

/// Writes pictures under a heading in a grid with a class.
fn write_pictures(
    html: &mut String,
    (heading, class): (&str, &str),
    pictures: &[(String, Vec<u8>)],
) {
    if pictures.is_empty() {
        return;
    }
    let _ = writeln!(html, "<h2>{heading}</h2>\n<div class=\"grid {class}\">");
    for (caption, bytes) in pictures {
        let kind = if bytes.starts_with(b"GIF8") {
            "gif"
        } else {
            "png"
        };
        let caption = escape(caption);
        let _ = writeln!(
            html,
            "<figure class=\"card\"><img alt=\"{caption}\" src=\"data:image/{kind};base64,{}\">\
             <figcaption>{caption}</figcaption></figure>",
            base64(bytes)
        );
    }
    html.push_str("</div>\n");
}

fn write_table(html: &mut String, table: &Table) {
    if !table.title.is_empty() {
        let _ = writeln!(html, "<h2>{}</h2>", escape(&table.title));
    }
    html.push_str("<div class=\"card scroll\"><table>\n");
    let numeric: Vec<bool> = (0..table.columns())
        .map(|column| table.is_numeric(column))
        .collect();
    let mut line = |tag: &str, row: &[String]| {
        html.push_str("<tr>");
        for (column, numeric) in numeric.iter().enumerate() {
            let class = if *numeric { " class=\"n\"" } else { "" };
            let cell = row.get(column).map(|text| escape(text)).unwrap_or_default();
            let _ = write!(html, "<{tag}{class}>{cell}</{tag}>");
        }
        html.push_str("</tr>\n");
    };
    if !table.header.is_empty() {
        line("th", &table.header);
    }
    table.rows.iter().for_each(|row| line("td", row));
    html.push_str("</table></div>\n");
}

/// A text escaped for HTML or SVG, in an element or in a quoted attribute.
pub(super) fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => escaped += "&amp;",
            '<' => escaped += "&lt;",
            '>' => escaped += "&gt;",
            '"' => escaped += "&quot;",
            '\'' => escaped += "&#39;",
            c if c.is_control() && c != '\n' && c != '\t' => escaped.push('\u{fffd}'),
            c => escaped.push(c),
        }
    }
    escaped
}

/// Bytes as base64 (RFC 4648, with padding).
pub(super) fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for group in bytes.chunks(3) {
        let word = (0..3).fold(0u32, |word, k| {
            (word << 8) | u32::from(group.get(k).copied().unwrap_or(0))
        });
        for k in 0..4 {
            let digit = DIGITS[(word >> (18 - 6 * k)) as usize & 63];
            text.push(if k <= group.len() {
                char::from(digit)
            } else {
                '='
            });
        }
    }
    text
}

/// A verdict as one line, with the advice for a failure.
fn with_advice(verdict: &Verdict) -> String {
    let mut text = escape(&verdict.to_text());
    if let Some(advice) = &verdict.what_to_do {
        let _ = write!(
            text,
            "<span class=\"next\">Next step: {}</span>",
            escape(advice)
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_of_the_rfc() {
        for (bytes, text) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
        assert_eq!(base64(&[0xff, 0xfe, 0xfd]), "//79");
    }

    fn evil_report() -> Report {
        let evil = || "\"><script src='http://x'>alert(1)</script>&\0".to_owned();
        let mut table = Table::new(evil(), [evil()]);
        table.row([evil(), evil()]);
        Report {
            title: evil(),
            subtitle: evil(),
            verdict: vec![Verdict::new(evil(), true), Verdict::new(evil(), false)],
            lead: vec![table.clone()],
            findings: Vec::new(),
            places: vec![(evil(), Vec::new())],
            pictures: vec![(evil(), b"\"><script>".to_vec())],
            sheets: vec![(evil(), Vec::new())],
            turntable: None,
            plots_title: evil(),
            plots: vec![
                LinePlot::new(evil(), evil())
                    .with(evil(), [(0.0, 0.0), (1.0, 1.0)])
                    .with_limit(evil(), 1.0),
            ],
            tables: vec![table],
            notes: vec![evil()],
        }
    }

    #[test]
    fn no_text_becomes_markup() {
        let html = evil_report().to_html();
        assert!(!html.contains("<script") && !html.contains("src='") && !html.contains('\0'));
        assert_eq!(
            html.matches("&lt;script src=&#39;http://x&#39;&gt;")
                .count(),
            26
        );
    }

    #[test]
    fn nothing_is_loaded_from_elsewhere() {
        let report = Report {
            plots: vec![LinePlot::new("t", "x").with("a", [(0.0, 1.0)])],
            ..Report::default()
        };
        let html = report
            .to_html()
            .replace("xmlns=\"http://www.w3.org/2000/svg\"", "");
        for word in [
            "http:", "https:", "url(", "@import", "<link", "<script", "href",
        ] {
            assert!(!html.contains(word), "{word}");
        }
    }

    #[test]
    fn elements_are_closed() {
        let html = evil_report().to_html();
        for tag in [
            "html", "head", "body", "main", "div", "figure", "table", "tr", "td", "th", "ul", "li",
            "svg", "g", "text",
        ] {
            let opened = html.matches(&format!("<{tag}>")).count()
                + html.matches(&format!("<{tag} ")).count();
            assert_eq!(opened, html.matches(&format!("</{tag}>")).count(), "{tag}");
        }
    }

    #[test]
    fn failures_come_first_and_are_counted() {
        let findings = vec!["4 cm2 are <stretched>".to_owned()];
        let html = Report {
            verdict: vec![Verdict::new("kept", true)],
            findings,
            ..Report::default()
        }
        .to_html();
        assert!(
            html.contains("The check passes") && !html.contains("class=\"fail\""),
            "a finding counts as a check"
        );
        assert!(html.contains("class=\"found\"") && html.contains("4 cm2 are &lt;stretched&gt;"));
        let verdict = vec![
            Verdict::new("volume kept", true),
            Verdict::new("no vertex in a bone", false).else_do("use more substeps"),
        ];
        let html = Report {
            verdict,
            ..Report::default()
        }
        .to_html();
        assert!(html.contains("1 of 2 checks fails"));
        assert!(html.find("no vertex in a bone") < html.find("volume kept"));
        assert!(
            html.contains("Next step: use more substeps"),
            "the advice of a failure"
        );
        let html = Report {
            verdict: vec![Verdict::new("volume kept", true)],
            ..Report::default()
        }
        .to_html();
        assert!(html.contains("The check passes"));
        assert!(!Report::default().to_html().contains("class=\"sum"));
    }
}
