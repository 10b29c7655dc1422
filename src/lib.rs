//! Builds measured levels of detail into glTF files.

pub mod asset;
mod attributes;
pub mod baseline;
pub mod bench;
mod bvh;
pub mod coverage;
mod curvature;
pub mod discover;
pub mod emit;
pub mod error;
mod lanes;
pub mod measure;
pub mod mesh;
#[allow(dead_code)]
mod meshoptimizer;
pub mod pipeline;
pub mod predictor;
pub mod preset;
mod progressive;
mod random;
pub mod report;
mod shapes;
pub mod simplify;
mod tasks;

pub use error::{Error, Kind, Result};
pub use pipeline::{
    BuildOptions, Clock, Observer, PapersOptions, ProgressiveOptions, RebuildOptions, TrainOptions, TrainOutcome,
    Unobserved, build, compare, inspect, papers, progressive, rebuild, train_w,
};
pub use report::Report;
pub use simplify::simplify;
