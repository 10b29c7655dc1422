//! The papers' tables beside ours, and what became of their claims: the model, and as text.

use super::text::{add_row, indent, significant, start_table};
use crate::predictor::CLASSES;
use serde::Serialize;
use std::fmt::Write;

/// A ratio of times counts as the claimed one within this share of it: other machines and other code decide about more.
const RATIO_TOLERANCE: f64 = 0.1;
/// The same for a saving, in shares of the whole.
const SAVING_TOLERANCE: f64 = 0.05;

/// Everything `gltf-lod papers` finds out. Errors are Hausdorff distances for coordinates from −1 to 1, times are seconds.
#[derive(Debug, Clone, Default, Serialize)]
pub struct PapersReport {
    /// ESQEM (Zhang 2022) against QEM.
    pub esqem: Vec<CurvatureRow>,
    /// QFVP's table 1: the error by w.
    pub qfvp: Vec<QfvpRow>,
    /// Which w the nets pick for the rows of `qfvp`.
    pub picks: Vec<PickRow>,
    /// QEM, Melax, QFVP and FMS at the same reduction.
    pub speeds: Vec<SpeedRow>,
    /// QFVP's normals: recomputed or followed linearly.
    pub updates: Vec<UpdateRow>,
    /// FMS (Meng & Song 2007) against QEM.
    pub fms: Vec<ReductionRow>,
    /// QFVP's tables 4 and 5 as printed: their models are not at hand.
    pub published: Vec<PublishedQfvp>,
    /// Models left out because they are too large for this look.
    pub left_out: Vec<&'static str>,
    /// What the papers claim, and what is found here.
    pub claims: Vec<Claim>,
}

/// A model that was reduced.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Subject {
    /// Its name.
    pub model: &'static str,
    /// Its triangles.
    pub triangles: usize,
    /// It is a made model in place of one that is missing: its figures say nothing of the paper's.
    pub stands_in: bool,
}

/// Errors of QEM and ESQEM at equal counts.
#[derive(Debug, Clone, Serialize)]
pub struct CurvatureRow {
    /// The model.
    pub subject: Subject,
    /// Triangles left.
    pub triangles: usize,
    /// QEM's error.
    pub qem: f64,
    /// ESQEM's, in paper mode.
    pub esqem: f64,
    /// The same without edges split: its collapses alone.
    pub unsplit: f64,
    /// QEM's and ESQEM's distances between vertices alone, which some take for that of the surfaces.
    pub between_vertices: [f64; 2],
}

/// Errors of QFVP for w = 0, 0.5, 1, 1.5 and 2.
#[derive(Debug, Clone, Serialize)]
pub struct QfvpRow {
    /// The model.
    pub subject: Subject,
    /// Triangles left.
    pub triangles: usize,
    /// Ours.
    pub errors: [f64; 5],
    /// The least error of w = 2.5 and 3, which are outside of the paper's interval.
    pub beyond: f64,
    /// The paper's, if the model is in its table.
    pub published: Option<[f64; 5]>,
}

/// The w that each predictor picks, and the error that it leaves.
#[derive(Debug, Clone, Serialize)]
pub struct PickRow {
    /// The model.
    pub subject: Subject,
    /// Triangles left.
    pub triangles: usize,
    /// The best of the five values of w, and its error.
    pub best: (f64, f64),
    /// The paper's net.
    pub net: (f64, f64),
    /// The net that sees the shape.
    pub shape_net: (f64, f64),
}

/// Errors and times of QEM, Melax, QFVP and FMS, in this order.
#[derive(Debug, Clone, Default, Serialize)]
pub struct SpeedRow {
    /// The model.
    pub subject: Subject,
    /// Triangles left.
    pub triangles: usize,
    /// Errors.
    pub errors: [f64; 4],
    /// Times.
    pub seconds: [f64; 4],
}

/// QFVP with normals recomputed and followed linearly, in this order.
#[derive(Debug, Clone, Serialize)]
pub struct UpdateRow {
    /// The model.
    pub subject: Subject,
    /// Triangles left.
    pub triangles: usize,
    /// Errors.
    pub errors: [f64; 2],
    /// Times.
    pub seconds: [f64; 2],
}

/// QEM and FMS, in this order.
#[derive(Debug, Clone, Serialize)]
pub struct ReductionRow {
    /// The model.
    pub subject: Subject,
    /// Triangles left.
    pub triangles: usize,
    /// Errors.
    pub errors: [f64; 2],
    /// Times.
    pub seconds: [f64; 2],
}

/// A row of QFVP's tables 4 and 5: QEM, Melax, QFVP.
#[derive(Debug, Clone, Serialize)]
pub struct PublishedQfvp {
    /// The model.
    pub model: &'static str,
    /// Its triangles.
    pub before: usize,
    /// Triangles left.
    pub after: usize,
    /// Seconds on a Celeron of 1.5 GHz.
    pub seconds: [f64; 3],
    /// Errors.
    pub errors: [f64; 3],
}

impl PublishedQfvp {
    /// A row as printed.
    pub const fn new(model: &'static str, before: usize, after: usize, seconds: [f64; 3], errors: [f64; 3]) -> Self {
        Self { model, before, after, seconds, errors }
    }
}

/// What a paper claims, and what is found.
#[derive(Debug, Clone, Serialize)]
pub struct Claim {
    /// The paper.
    pub paper: &'static str,
    /// Its claim.
    pub claim: &'static str,
    /// What we measured.
    pub found: String,
    /// Whether that is what the paper says; `None` where only stand-ins were measured.
    pub holds: Option<bool>,
}

impl PapersReport {
    /// Compares the rows with the papers' claims. Stand-ins do not count.
    pub fn check_claims(&mut self) {
        self.claims = [self.check_esqem(), self.check_exponents(), self.check_speeds(), self.check_fms()].concat();
    }

    fn check_esqem(&self) -> Vec<Claim> {
        let gone = |row: &CurvatureRow| 1.0 - row.triangles as f64 / row.subject.triangles as f64;
        let rows = |above: bool| real(&self.esqem, |r| r.subject).filter(move |row| (gone(row) > 0.75) == above);
        let ratios = |above: bool, of: fn(&CurvatureRow) -> f64| rows(above).map(of).collect::<Vec<f64>>();
        let claim = |claim, above: bool, holds: fn(f64) -> bool| {
            let errors = ratios(above, |row| ratio(row.esqem, row.qem));
            Claim {
                paper: "ESQEM",
                claim,
                found: format!(
                    "{} of QEM's; {} without splits, {} between vertices alone",
                    list_times(&errors),
                    list_times(&ratios(above, |row| ratio(row.unsplit, row.qem))),
                    list_times(&ratios(above, |row| ratio(row.between_vertices[1], row.between_vertices[0]))),
                ),
                holds: all(&errors, holds),
            }
        };
        vec![
            claim("above 75 % reduction its error is below QEM's", true, |r| r < 1.0),
            claim("below 75 % it is slightly above", false, |r| r >= 1.0),
        ]
    }

    fn check_exponents(&self) -> Vec<Claim> {
        let rows: Vec<&QfvpRow> = real(&self.qfvp, |r| r.subject).collect();
        let best: Vec<usize> = rows.iter().map(|row| least(&row.errors)).collect();
        let beyond = rows.iter().zip(&best).filter(|(row, best)| row.beyond < row.errors[**best]).count();
        let count = |class: usize| best.iter().filter(|b| **b == class).count();
        let counts: Vec<String> = (0..CLASSES.len())
            .filter(|class| count(*class) > 0)
            .map(|class| format!("w = {} in {} rows", CLASSES[class], count(class)))
            .collect();
        vec![
            Claim {
                paper: "QFVP",
                claim: "the best w lies in [0, 2]",
                found: format!("w = 2.5 or 3 would be better in {beyond} of {} rows", rows.len()),
                holds: (!rows.is_empty()).then_some(beyond == 0),
            },
            Claim {
                paper: "QFVP",
                claim: "the best w differs by model",
                found: format!("the best is {}", counts.join(", ")),
                holds: (!rows.is_empty()).then_some(counts.len() > 1),
            },
        ]
    }

    fn check_speeds(&self) -> Vec<Claim> {
        let rows: Vec<&SpeedRow> = real(&self.speeds, |r| r.subject).collect();
        let ratios = |over: usize, under: usize, of: fn(&SpeedRow) -> [f64; 4]| -> Vec<f64> {
            rows.iter().map(|row| ratio(of(row)[over], of(row)[under])).collect()
        };
        let [qem, melax, qfvp, fms] = [0, 1, 2, 3];
        let time = |over, under| ratios(over, under, |row| row.seconds);
        let error = |over, under| ratios(over, under, |row| row.errors);
        let takes = |claim, ratios: Vec<f64>, claimed: f64| Claim {
            paper: "QFVP",
            claim,
            found: format!("×{:.2}, the median of {}", median(&ratios), list_times(&ratios)),
            holds: (!ratios.is_empty()).then(|| (median(&ratios) / claimed - 1.0).abs() <= RATIO_TOLERANCE),
        };
        let errors = [error(qfvp, qem), error(qfvp, melax)];
        let savings: Vec<f64> =
            real(&self.updates, |r| r.subject).map(|row| 1.0 - row.seconds[1] / row.seconds[0]).collect();
        let saving = savings.iter().sum::<f64>() / savings.len().max(1) as f64;
        let fastest: Vec<f64> = rows
            .iter()
            .map(|row| row.seconds[fms] / row.seconds[..fms].iter().copied().fold(f64::INFINITY, f64::min))
            .collect();
        vec![
            takes("takes 1.07 × QEM's time", time(qfvp, qem), 1.073),
            takes("takes 0.45 × Melax's time", time(qfvp, melax), 0.453),
            Claim {
                paper: "QFVP",
                claim: "its error is below QEM's and Melax's",
                found: format!("{} of QEM's, {} of Melax's", list_times(&errors[0]), list_times(&errors[1])),
                holds: all(&errors.concat(), |r| r < 1.0),
            },
            Claim {
                paper: "QFVP",
                claim: "linear normals save 23.7 % of the time",
                found: format!("{:.1} %", 100.0 * saving),
                holds: (!savings.is_empty()).then(|| (saving - 0.237).abs() <= SAVING_TOLERANCE),
            },
            Claim {
                paper: "FMS",
                claim: "is the fastest",
                found: format!("{} of the next fastest one's time", list_times(&fastest)),
                holds: all(&fastest, |r| r < 1.0),
            },
        ]
    }

    fn check_fms(&self) -> Vec<Claim> {
        let rows: Vec<&ReductionRow> = real(&self.fms, |r| r.subject).collect();
        let errors: Vec<f64> = rows.iter().map(|row| ratio(row.errors[1], row.errors[0])).collect();
        vec![Claim {
            paper: "FMS",
            claim: "is slightly less accurate than QEM",
            found: format!("its error is {} of QEM's", list_times(&errors)),
            // Slightly: not twice as far.
            holds: all(&errors, |r| (1.0..2.0).contains(&r)),
        }]
    }
}

/// The rows whose model is the paper's own.
fn real<T>(rows: &[T], subject: impl Fn(&T) -> Subject) -> impl Iterator<Item = &T> {
    rows.iter().filter(move |row| !subject(row).stands_in)
}

fn all(ratios: &[f64], holds: impl Fn(f64) -> bool) -> Option<bool> {
    (!ratios.is_empty()).then(|| ratios.iter().all(|r| holds(*r)))
}

/// Of two errors or times; as near to 1 as can be told where both are nothing.
fn ratio(over: f64, under: f64) -> f64 {
    over.max(f64::EPSILON) / under.max(f64::EPSILON)
}

fn least(errors: &[f64; 5]) -> usize {
    (1..errors.len()).fold(0, |best, i| if errors[i] < errors[best] { i } else { best })
}

/// The middle one, or the upper of two: one odd model decides nothing. NaN of none.
fn median(ratios: &[f64]) -> f64 {
    let mut sorted = ratios.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
}

fn geometric_mean(ratios: &[f64]) -> f64 {
    (ratios.iter().map(|r| r.ln()).sum::<f64>() / ratios.len().max(1) as f64).exp()
}

fn list_times(ratios: &[f64]) -> String {
    let list: Vec<String> = ratios.iter().map(|r| format!("×{r:.2}")).collect();
    if list.is_empty() { "-".to_owned() } else { list.join(", ") }
}

/// All tables, then the claims.
pub fn describe_papers(report: &PapersReport) -> String {
    let mut text = String::from(
        "Errors: two-sided Hausdorff distance, coordinates scaled to −1 … 1. Times: CPU seconds of one thread\n\
         of this machine, the least of several runs. (made) marks a made model in place of a missing one.\n\n",
    );
    describe_esqem(report, &mut text);
    describe_qfvp(report, &mut text);
    describe_speeds(report, &mut text);
    describe_fms(report, &mut text);
    if !report.left_out.is_empty() {
        _ = writeln!(text, "left out as too large: {}\n", report.left_out.join(", "));
    }
    text += "Claims\n";
    for Claim { paper, claim, found, holds } in &report.claims {
        let holds = holds.map_or("not measured", |holds| if holds { "holds" } else { "DIFFERS" });
        _ = writeln!(text, "  {holds:12} {paper}: {claim}\n{:15}{found}", "");
    }
    text
}

fn name(subject: &Subject) -> String {
    format!("{}{}", subject.model, if subject.stands_in { " (made)" } else { "" })
}

fn reduction(subject: &Subject, triangles: usize) -> String {
    format!("{} → {triangles}", subject.triangles)
}

fn describe_esqem(report: &PapersReport, text: &mut String) {
    *text += "ESQEM against QEM (Zhang 2022, table 1; its errors are printed as curves only)\n";
    let mut table =
        start_table(&["model", "triangles", "gone", "QEM", "ESQEM", "ratio", "no splits", "vertices alone"]);
    for row in &report.esqem {
        let gone = 100.0 * (1.0 - row.triangles as f64 / row.subject.triangles as f64);
        add_row(
            &mut table,
            &[
                name(&row.subject),
                reduction(&row.subject, row.triangles),
                format!("{gone:.1} %"),
                error(row.qem),
                error(row.esqem),
                format!("×{:.2}", ratio(row.esqem, row.qem)),
                format!("×{:.2}", ratio(row.unsplit, row.qem)),
                format!("×{:.2}", ratio(row.between_vertices[1], row.between_vertices[0])),
            ],
        );
    }
    *text += &(indent(&table) + "\n");
}

fn describe_qfvp(report: &PapersReport, text: &mut String) {
    *text += "QFVP by w (its table 1: the paper's figures below ours; * is the least of a row)\n";
    let mut table = start_table(&["model", "triangles", "", "w = 0", "0.5", "1", "1.5", "2"]);
    let mut add = |model: String, triangles: String, whose: &str, errors: &[f64; 5]| {
        let mut cells = vec![model, triangles, whose.to_owned()];
        let best = least(errors);
        cells.extend(errors.iter().enumerate().map(|(i, e)| error(*e) + if i == best { "*" } else { "" }));
        add_row(&mut table, &cells);
    };
    for row in &report.qfvp {
        add(name(&row.subject), reduction(&row.subject, row.triangles), "ours", &row.errors);
        if let Some(published) = &row.published {
            add(String::new(), String::new(), "paper", published);
        }
    }
    *text += &(indent(&table) + "\n");

    *text += "Who picks w (pick: error)\n";
    let mut table = start_table(&["model", "triangles", "best", "3-4-5 net", "net that sees the shape"]);
    for row in &report.picks {
        let show = |(w, e): (f64, f64)| format!("{w}: {}", error(e));
        let picks = [row.best, row.net, row.shape_net].map(show);
        let mut cells = vec![name(&row.subject), reduction(&row.subject, row.triangles)];
        cells.extend(picks);
        add_row(&mut table, &cells);
    }
    let excess = |of: fn(&PickRow) -> f64| geometric_mean(&report.picks.iter().map(of).collect::<Vec<f64>>());
    let fixed = |class: usize| {
        geometric_mean(
            &report.qfvp.iter().map(|r| ratio(r.errors[class], r.errors[least(&r.errors)])).collect::<Vec<f64>>(),
        )
    };
    let all: Vec<String> = CLASSES.iter().enumerate().map(|(c, w)| format!("w = {w} ×{:.2}", fixed(c))).collect();
    *text += &indent(&table);
    _ = writeln!(
        text,
        "  over the best w, geometric mean: 3-4-5 net ×{:.2}, net that sees the shape ×{:.2};\n  always {}\n",
        excess(|r| ratio(r.net.1, r.best.1)),
        excess(|r| ratio(r.shape_net.1, r.best.1)),
        all.join(", "),
    );
}

fn describe_speeds(report: &PapersReport, text: &mut String) {
    *text += "Times (QFVP's table 4 as printed below ours)\n";
    let heads = ["model", "triangles", "QEM", "Melax", "QFVP", "FMS", "QFVP/QEM", "QFVP/Melax", "FMS/QEM"];
    let mut table = start_table(&heads);
    let mut add = |model: String, triangles: String, seconds: &[f64]| {
        let cell = |i: usize| seconds.get(i).map_or("-".to_owned(), |s| significant(*s));
        let over = |a: usize, b: usize| seconds.get(a).map_or("-".to_owned(), |s| format!("×{:.2}", s / seconds[b]));
        let mut cells = vec![model, triangles];
        cells.extend((0..4).map(cell).chain([over(2, 0), over(2, 1), over(3, 0)]));
        add_row(&mut table, &cells);
    };
    for row in &report.speeds {
        add(name(&row.subject), reduction(&row.subject, row.triangles), &row.seconds);
    }
    for row in &report.published {
        add(format!("{} (paper)", row.model), format!("{} → {}", row.before, row.after), &row.seconds);
    }
    *text += &(indent(&table) + "\n");

    *text += "Errors at those counts (QFVP's table 5 as printed below ours)\n";
    let mut table = start_table(&["model", "triangles", "QEM", "Melax", "QFVP", "FMS"]);
    let mut add = |model: String, triangles: String, errors: &[f64]| {
        let mut cells = vec![model, triangles];
        cells.extend((0..4).map(|i| errors.get(i).map_or("-".to_owned(), |e| error(*e))));
        add_row(&mut table, &cells);
    };
    for row in &report.speeds {
        add(name(&row.subject), reduction(&row.subject, row.triangles), &row.errors);
    }
    for row in &report.published {
        add(format!("{} (paper)", row.model), format!("{} → {}", row.before, row.after), &row.errors);
    }
    *text += &(indent(&table) + "\n");

    *text += "QFVP's normals, w = 0.5: recomputed / followed linearly\n";
    let mut table = start_table(&["model", "triangles", "seconds", "saved", "errors"]);
    for row in &report.updates {
        add_row(
            &mut table,
            &[
                name(&row.subject),
                reduction(&row.subject, row.triangles),
                row.seconds.map(significant).join(" / "),
                format!("{:.1} %", 100.0 * (1.0 - row.seconds[1] / row.seconds[0])),
                row.errors.map(error).join(" / "),
            ],
        );
    }
    *text += &(indent(&table) + "\n");
}

fn describe_fms(report: &PapersReport, text: &mut String) {
    *text += "FMS against QEM (Meng & Song 2007, §4; the paper has pictures and curves only)\n";
    let mut table = start_table(&["model", "triangles", "errors", "seconds", "FMS/QEM"]);
    for row in &report.fms {
        add_row(
            &mut table,
            &[
                name(&row.subject),
                reduction(&row.subject, row.triangles),
                row.errors.map(error).join(" / "),
                row.seconds.map(significant).join(" / "),
                format!("×{:.2}", row.seconds[1] / row.seconds[0]),
            ],
        );
    }
    *text += &(indent(&table) + "\n");
}

/// As many digits as the papers print.
fn error(value: f64) -> String {
    format!("{value:.6}")
}
