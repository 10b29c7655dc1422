//! From merged keys to the settings of one mesh.

use super::level::Level;
use super::model::{GateKeys, Keys, WeightKeys};
use super::number::{Count, Multiple, Weight};
use super::value::Gate;
use super::{Gates, Maker, Settings, Severity};
use crate::error::{Error, Kind, Result};
use crate::simplify;

/// The settings that `keys` give. `default.toml` sets every key, so none is missing.
pub fn resolve(keys: &Keys) -> Result<Settings> {
    let levels = &required(keys.levels.as_ref(), "levels")?.value.0;
    Ok(Settings {
        skip: None,
        maker: resolve_maker(keys)?,
        simplify: resolve_simplify(keys)?,
        levels: levels.iter().map(Level::target).collect(),
        min_source_triangles: required(keys.min_source_triangles, "min_source_triangles")?.get(),
        // A preset says what has to be saved, the settings what may be kept.
        min_saving: 1.0 - required(keys.min_saving, "min_saving")?.get(),
        screen_height: required(keys.screen_height, "screen_height")?.get(),
        pixel_tolerance: required(keys.pixel_tolerance, "pixel_tolerance")?.get(),
        coverage: required(keys.coverage.as_ref(), "coverage")?.value.clone(),
        basis: required(keys.basis, "basis")?,
        cull_coverage: required(keys.cull_coverage, "cull_coverage")?.get(),
        gates: keys.gates.map(resolve_gates).unwrap_or_default(),
        layout: required(keys.layout.as_ref(), "layout")?.value,
        existing: required(keys.existing.as_ref(), "existing")?.value,
        naming: required(keys.naming.as_ref(), "naming")?.value.template().to_owned(),
        samples: required(keys.samples, "samples")?.get(),
    })
}

fn resolve_maker(keys: &Keys) -> Result<Maker> {
    let own = required(keys.algorithm.as_ref(), "algorithm")?.value.in_mode(required(keys.mode, "mode")?);
    Ok(if own.is_some() { Maker::Simplify } else { Maker::Meshopt })
}

fn resolve_simplify(keys: &Keys) -> Result<simplify::Options> {
    let mode = required(keys.mode, "mode")?;
    let algorithm = required(keys.algorithm.as_ref(), "algorithm")?.value.in_mode(mode);
    let algorithm = algorithm.unwrap_or_else(|| simplify::Options::default().algorithm);
    let split_factor = required(keys.split_factor, "split_factor")?;
    Ok(simplify::Options {
        levels: Vec::new(),
        min_triangles: required(keys.min_triangles, "min_triangles")?.get(),
        algorithm,
        schedule: required(keys.schedule, "schedule")?.resolve(algorithm),
        qfvp_w: required(keys.qfvp_w, "qfvp_w")?.0,
        qfvp_normals: required(keys.qfvp_normals, "qfvp_normals")?.into(),
        fms_alpha: required(keys.fms_alpha, "fms_alpha")?.get() as f32,
        placement: required(keys.placement, "placement")?.into(),
        effort: required(keys.effort, "effort")?.into(),
        curvature_weight: required(keys.curvature_weight, "curvature_weight")?.get() as f32,
        split_factor: split_factor.0.map(|factor| factor as f32),
        border: required(keys.border, "border")?.into(),
        seam: required(keys.seam, "seam")?.into(),
        material_border: required(keys.material_border, "material_border")?.into(),
        keep_area: required(keys.keep_area, "keep_area")?,
        attribute_weights: resolve_weights(required(keys.attribute_weights, "attribute_weights")?)?,
    })
}

fn resolve_weights(keys: WeightKeys) -> Result<simplify::AttributeWeights> {
    let weight = |weight: Option<Weight>, key| Ok::<_, Error>(required(weight, key)?.get() as f32);
    Ok(simplify::AttributeWeights {
        normal: weight(keys.normal, "attribute_weights.normal")?,
        tex_coord: weight(keys.tex_coord, "attribute_weights.tex_coord")?,
        color: weight(keys.color, "attribute_weights.color")?,
    })
}

fn resolve_gates(keys: GateKeys) -> Gates {
    Gates {
        max_error: keys.max_error.and_then(Gate::limit),
        max_rms_vs_meshopt: keys.max_rms_vs_meshopt.and_then(Gate::limit).map(first(Multiple::get)),
        max_gap_edges: keys.max_gap_edges.and_then(Gate::limit).map(first(Count::get)),
    }
}

fn first<T, U>(convert: impl Fn(T) -> U) -> impl Fn((T, Severity)) -> (U, Severity) {
    move |(limit, on)| (convert(limit), on)
}

fn required<T>(value: Option<T>, key: &str) -> Result<T> {
    value.ok_or_else(|| Error::new(Kind::Internal, format!("config/default.toml does not set `{key}`")))
}
