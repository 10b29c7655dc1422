//! The command line: the only place that prints.

mod args;
mod progress;
mod run;

pub use run::{parse, run};
