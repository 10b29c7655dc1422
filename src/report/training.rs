//! What training the predictor came to, as text.

use crate::predictor::{CLASSES, Judgement, TrainReport};
use comfy_table::{Cell, CellAlignment, Table, presets};

/// Figures of both nets beside those of every fixed w.
pub fn describe_training(report: &TrainReport) -> String {
    let best: Vec<String> = CLASSES.iter().zip(report.best).map(|(w, count)| format!("w = {w}: {count}")).collect();
    let mut table = Table::new();
    table.load_preset(presets::UTF8_HORIZONTAL_ONLY);
    table.set_header(["chosen by", "right, unseen samples", "error", "right, unseen models", "error"]);
    let mut row = |name: String, samples: &Judgement, models: &Judgement| {
        let cells = [percent(samples.accuracy), times(samples.excess), percent(models.accuracy), times(models.excess)];
        let numbers = cells.into_iter().map(|cell| Cell::new(cell).set_alignment(CellAlignment::Right));
        table.add_row(std::iter::once(Cell::new(name)).chain(numbers));
    };
    row("the paper's net (3-4-5)".to_owned(), &report.net, &report.net_on_new_models);
    row("the net that sees the shape".to_owned(), &report.shape_net, &report.shape_net_on_new_models);
    for (class, w) in CLASSES.iter().enumerate() {
        row(format!("always w = {w}"), &report.fixed[class], &report.fixed_on_all[class]);
    }
    format!(
        "{} samples of {} models; the best w is most often: {}\n{table}\n\
         right: how often the w of least error is named. error: what the choice leaves, over what the best w would, geometric mean.\n\
         Unseen samples are a random fifth, of models that the nets know; for unseen models each is left out of a training once.\n",
        report.samples,
        report.models,
        best.join(", "),
    )
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

fn times(factor: f64) -> String {
    format!("×{factor:.3}")
}
