//! The page: one line a row, residuals as measured.

use crate::papers::row::{Domain, Row};
use std::fmt::Write as _;
use std::path::PathBuf;

/// What the checks of a row measured, over all scenes.
#[derive(Clone, Debug, Default)]
pub struct Measured {
    /// Scenes that were compared.
    pub scenes: usize,
    /// Largest residual in units of n·ε·κ, f64 and double-double.
    pub plain: f64,
    pub wide: f64,
    /// On trees that branch on two levels: the smallest relative residual of a statement about chains.
    pub on_trees: Option<f64>,
    /// Largest relative residual of what is printed.
    pub printed: Option<f64>,
    /// Left side, as an operator shows it.
    pub expression: String,
    /// Multiplications and additions a body, on a chain of hinges.
    pub cost: Option<u64>,
}

const HEAD: &str = "# The two papers, line by line

Every numbered equation, lemma and unnumbered identity about operators and recursions of the two papers, as it holds, with what the print
has wrong. Each line is executed: `cargo test -p phipsi-recursion --test all papers` evaluates both sides on chains, on trees that branch on
three levels, on forests and free bases, with joints of one to six degrees of freedom, in f64 and in double-double numbers;
`PHIPSI_WRITE_PAGES=1` before the command writes this page. *Paper 1* is Rodriguez, \"Random field estimation approach to robot dynamics\", IEEE
Transactions on Systems, Man, and Cybernetics 20 (1990); *paper 2* is Jain and Rodriguez, \"Computational robot dynamics using spatial
operators\", ICRA 2000.

- **expression**: the left side as the library shows it, where it is an operator; it evaluates as sweeps. Joints and bodies: [Conventions](conventions.md).
- **f64, dd**: the largest difference of the two sides in units of n·ε·κ, with the ε of each number (2.2e-16, 4.9e-32). n counts bodies and
  degrees of freedom; κ is the measured answer of the left side to relative changes of all inputs, or of its largest term where terms cancel, times
  what an elimination may lose: the largest product of diagonal entries of 𝓜 and 𝓜⁻¹ (at least the ratio of composite to articulated inertia of a
  hinge). Allowed is BUDGET.
- **cost**: multiplications and additions of one application of the left side, for each body of a long chain of hinges.
- *Chains*: holds where nothing branches; on trees that branch on two levels it must fail, and the line says by how much. The next line has the form for trees.
- *Free*: one tree on a free base.
- *print*: what is wrong there; a number is the relative residual of the printed form.

Not lines: figures, prose about filters, and flexible links (paper 2 §3.2), which has no equation. Sampled covariances, with their rate
1/√N, are tested in `crates/recursion/tests/estimation.rs`; times are on [the next page](papers_cost.md), pictures in [Paper 1 on an
arm](random_field.md).
";

fn path() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../docs/src/papers.md")
}

fn cell(text: &str) -> String {
    text.replace('|', "\\|")
}

/// The page with residuals.
pub fn text(rows: &[(Row, Measured)], budget: f64, extra: &str) -> String {
    let mut out = HEAD.replace("BUDGET", &format!("{budget}"));
    for (paper, title) in
        [("1", "## Paper 1: random field estimation"), ("2", "## Paper 2: spatial operators")]
    {
        let _ = write!(
            out,
            "\n{title}\n\n| number | statement | expression | functions | holds on | print | f64 | dd | cost |\n|---|---|---|---|---|---|---|---|---|\n"
        );
        for (row, measured) in rows.iter().filter(|(row, _)| row.number.starts_with(paper)) {
            let number = row.number.split_once(' ').map_or(row.number, |(_, n)| n);
            let domain = match (row.domain, measured.on_trees) {
                (Domain::Chains, Some(off)) => format!("chains; trees: {off:.1e} off"),
                (Domain::Chains, None) => "chains".into(),
                (Domain::Free, _) => "free".into(),
                (Domain::Trees, _) => "trees".into(),
            };
            let print = match (row.print, measured.printed) {
                ("", _) => "–".into(),
                (words, None) => words.to_string(),
                (words, Some(off)) => format!("{words} [{off:.1e}]"),
            };
            let expression =
                if measured.expression.is_empty() { "–".into() } else { measured.expression.clone() };
            let cost = measured.cost.map_or("–".into(), |c| c.to_string());
            let _ = writeln!(
                out,
                "| {number} | {} | {} | {} | {domain} | {} | {:.1e} | {:.1e} | {cost} |",
                cell(row.statement),
                cell(&expression),
                cell(row.functions),
                cell(&print),
                measured.plain,
                measured.wide
            );
        }
    }
    out + extra
}

/// Without what is measured: numbers with an exponent.
fn skeleton(text: &str) -> String {
    let number = |word: &str| {
        let bare = word.trim_matches(|c: char| !c.is_ascii_alphanumeric() && c != '-' && c != '.');
        bare.contains('e') && bare.parse::<f64>().is_ok()
    };
    text.lines()
        .map(|line| line.split(' ').map(|w| if number(w) { "#" } else { w }).collect::<Vec<_>>().join(" "))
        .collect::<Vec<_>>()
        .join("\n")
}

/// Writes the page if that is wanted, otherwise compares it.
pub fn write_or_compare(text: &str) {
    if std::env::var_os("PHIPSI_WRITE_PAGES").is_some() {
        std::fs::write(path(), text).unwrap_or_else(|error| panic!("{}: {error}", path().display()));
        return;
    }
    let have =
        std::fs::read_to_string(path()).unwrap_or_else(|error| panic!("{}: {error}", path().display()));
    let (have, want) = (skeleton(&have), skeleton(text));
    if let Some((number, (a, b))) = have.lines().zip(want.lines()).enumerate().find(|(_, (a, b))| a != b) {
        panic!(
            "docs/src/papers.md is stale at line {}: it has\n{a}\nwhere the checks give\n{b}\nPHIPSI_WRITE_PAGES=1 writes it again",
            number + 1
        );
    }
    assert_eq!(
        have.lines().count(),
        want.lines().count(),
        "docs/src/papers.md is stale: PHIPSI_WRITE_PAGES=1 writes it again"
    );
}
