//! Tables and numbers as text.

use std::fmt::Write;

/// One part of the report.
#[derive(Debug, Clone, Default)]
pub(super) struct Section {
    pub(super) title: String,
    /// What is measured, and by which commands.
    pub(super) text: String,
    pub(super) head: Vec<String>,
    pub(super) rows: Vec<Vec<String>>,
    /// File names of plots, from where the report is.
    pub(super) plots: Vec<(String, String)>,
}

impl Section {
    pub(super) fn new(title: &str, text: &str, head: &[&str]) -> Section {
        Section {
            title: title.to_owned(),
            text: text.to_owned(),
            head: head.iter().map(|cell| (*cell).to_owned()).collect(),
            ..Section::default()
        }
    }

    pub(super) fn row(&mut self, cells: Vec<String>) {
        debug_assert_eq!(cells.len(), self.head.len(), "{}", self.title);
        self.rows.push(cells);
    }

    pub(super) fn markdown(&self) -> String {
        let mut out = format!("## {}\n\n{}\n\n", self.title, self.text.trim());
        let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
        if self.rows.is_empty() {
            out += "Nothing to measure in this run.\n\n";
        } else {
            out += &line(&self.head);
            out += &format!("|{}\n", "---|".repeat(self.head.len()));
            self.rows.iter().for_each(|row| out += &line(row));
            out.push('\n');
        }
        for (file, what) in &self.plots {
            let _ = writeln!(out, "![{what}]({file})\n");
        }
        out
    }
}

/// With a comma between thousands, without decimals.
pub(super) fn whole(value: f64) -> String {
    let digits = format!("{:.0}", value.abs());
    let mut out = if value <= -0.5 { "-".to_owned() } else { String::new() };
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

/// With so many decimals; a dash where there is no number.
pub(super) fn fixed(value: f64, decimals: usize) -> String {
    if value.is_finite() { format!("{value:.decimals$}") } else { "–".to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_and_numbers_are_aligned_with_their_heads() {
        assert_eq!(["1,234,567", "12", "-1,000"], [1234567.4, 12.0, -1000.0].map(whole));
        assert_eq!((fixed(1.256, 2), fixed(f64::NAN, 1)), ("1.26".to_owned(), "–".to_owned()));
        let mut section = Section::new("Title", " What. ", &["a", "b"]);
        section.row(vec!["1".into(), "2".into()]);
        section.plots.push(("p.svg".into(), "a plot".into()));
        let text = "## Title\n\nWhat.\n\n| a | b |\n|---|---|\n| 1 | 2 |\n\n![a plot](p.svg)\n\n";
        assert_eq!(section.markdown(), text);
        let without = Section::new("Title", "What.", &["a"]).markdown();
        assert_eq!(without, "## Title\n\nWhat.\n\nNothing to measure in this run.\n\n");
    }
}
