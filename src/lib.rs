//! Builds measured levels of detail into glTF files.

pub mod asset;
mod attributes;
pub mod baseline;
mod bvh;
mod curvature;
pub mod emit;
pub mod error;
pub mod measure;
pub mod mesh;
#[allow(dead_code)]
mod meshoptimizer;
pub mod preset;
pub mod simplify;

pub use error::{Error, Kind, Result};
