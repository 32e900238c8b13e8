//! The table of results as text, CSV, Markdown and HTML.

use super::judge::{Row, Verdict};

/// Names of the columns.
const HEAD: [&str; 12] = [
    "case",
    "parameter",
    "method",
    "accel",
    "expected",
    "measured",
    "error",
    "relative",
    "z",
    "verdict",
    "seconds",
    "note",
];

/// `1.234567`, `1.2345e-9`; nothing for what is not a number.
fn number(v: f64, digits: usize) -> String {
    match v {
        v if v.is_nan() => String::new(),
        0.0 => "0".into(),
        v if (1e-4..1e7).contains(&v.abs()) => format!("{v:.digits$}"),
        v => format!("{v:.digits$e}"),
    }
}

impl Row {
    /// The row's cells, in the order of the table.
    pub fn cells(&self) -> [String; 12] {
        let relative = self.relative_error.filter(|r| r.is_finite()).map_or(String::new(), |r| format!("{r:+.1e}"));
        let timed = self.verdict != Verdict::NotYet;
        [
            self.case.into(),
            self.parameter.clone(),
            self.method.clone(),
            self.accel.into(),
            number(self.expected, 6),
            number(self.measured, 6),
            if self.standard_error > 0.0 { format!("{:.1e}", self.standard_error) } else { String::new() },
            relative,
            self.z.filter(|_| timed).map_or(String::new(), |z| format!("{z:.1}")),
            self.verdict.name().into(),
            if timed { format!("{:.2}", self.seconds) } else { String::new() },
            self.note.clone(),
        ]
    }

    /// One line of text.
    pub fn line(&self) -> String {
        let [case, parameter, method, accel, expected, measured, error, relative, z, verdict, seconds, note] =
            self.cells();
        let error = if error.is_empty() { String::new() } else { format!("± {error}") };
        format!(
            "{verdict:7} {case:14} {parameter:34} {method:13} {accel:6} {expected:>13} {measured:>13} {error:9} {relative:>8} {z:>4} {seconds:>6} s  {note}"
        )
        .trim_end()
        .to_owned()
    }
}

/// How many rows of each verdict, for example `312 passed, 0 failed, 0 too slow, 9 not yet possible`.
pub fn summary_line(rows: &[Row]) -> String {
    let count = |v| rows.iter().filter(|r| r.verdict == v).count();
    format!(
        "{} passed, {} failed, {} too slow, {} not yet possible",
        count(Verdict::Pass),
        count(Verdict::Fail),
        count(Verdict::Slow),
        count(Verdict::NotYet)
    )
}

/// Comma-separated values with a head.
pub fn csv(rows: &[Row]) -> String {
    let field =
        |s: &str| if s.contains([',', '"', '\n']) { format!("\"{}\"", s.replace('"', "\"\"")) } else { s.into() };
    let mut out = format!("{},limit\n", HEAD.join(","));
    for row in rows {
        let cells: Vec<String> = row.cells().iter().map(|c| field(c)).collect();
        out += &format!(
            "{},{}\n",
            cells.join(","),
            if row.limit.is_finite() { row.limit.to_string() } else { String::new() }
        );
    }
    out
}

/// A table for Markdown.
pub fn markdown(rows: &[Row]) -> String {
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let mut out = line(&HEAD.map(String::from));
    out += &format!("|{}\n", "---|".repeat(HEAD.len()));
    for row in rows {
        out += &line(&row.cells().map(|c| c.replace('|', "\\|")));
    }
    out
}

/// A page of its own.
pub fn html(rows: &[Row], title: &str, stiffness: &str) -> String {
    let escape = |s: &str| s.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    let mut out = format!(
        "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><title>{0}</title>\n<style>\
         body{{font:14px sans-serif;margin:2em}}table{{border-collapse:collapse}}\
         td,th{{padding:.15em .6em;text-align:left;border-bottom:1px solid #ddd;white-space:nowrap}}\
         td:nth-child(n+5):nth-child(-n+9),td:nth-child(11){{text-align:right;font-variant-numeric:tabular-nums}}\
         .pass{{color:#060}}.fail,.slow{{background:#fdd;font-weight:bold}}.not{{color:#777}}</style>\n\
         <h1>{0}</h1>\n<p>{1}</p>\n<table>\n<tr>",
        escape(title),
        summary_line(rows)
    );
    out.extend(HEAD.iter().map(|h| format!("<th>{h}</th>")));
    out += "</tr>\n";
    for row in rows {
        let class = match row.verdict {
            Verdict::Pass => "pass",
            Verdict::Fail => "fail",
            Verdict::Slow => "slow",
            Verdict::NotYet => "not",
        };
        out += &format!("<tr class=\"{class}\">");
        out.extend(row.cells().iter().map(|c| format!("<td>{}</td>", escape(c))));
        out += "</tr>\n";
    }
    out + "</table>\n" + stiffness + "</html>\n"
}
