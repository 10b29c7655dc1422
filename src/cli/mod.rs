//! The command line: the only place that prints.

mod args;
mod instruments;
mod progress;
mod run;

pub use run::{parse, run};
