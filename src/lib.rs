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
pub mod measure;
pub mod mesh;
#[allow(dead_code)]
mod meshoptimizer;
pub mod pipeline;
pub mod preset;
pub mod report;
pub mod simplify;

pub use error::{Error, Kind, Result};
pub use pipeline::{BuildOptions, Observer, Unobserved, build, compare, inspect};
pub use report::Report;
pub use simplify::simplify;
