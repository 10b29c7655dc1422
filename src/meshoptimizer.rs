//! The one door to the C++ library: checks every index and length, then calls it.
//!
//! The crate's functions are safe by name only: an out-of-range index is a segfault, a short lock or attribute array
//! a read past its end, a NaN position undefined hashing. Everything here refuses such input with an error.

use crate::error::{Error, Kind, Result};
pub use meshopt::SimplifyOptions as Flags;
use meshopt::{SimplifyVertex, VertexDataAdapter, typed_to_bytes};

/// The library's own limit.
pub const MAX_ATTRIBUTES: usize = 32;

/// No error limit: the triangle target decides alone.
const ANY_ERROR: f32 = f32::MAX;

/// A mesh for the simplifier. Attributes are optional: no weights, no attributes.
#[derive(Debug, Clone, Copy, Default)]
pub struct Input<'a> {
    /// Finite.
    pub positions: &'a [[f32; 3]],
    /// Vertices that share a position are the wedges of one corner.
    pub triangles: &'a [[u32; 3]],
    /// `weights.len()` finite numbers a vertex.
    pub attributes: &'a [f32],
    /// Cost of an error of 1 in each attribute, where 1 is a position error as large as the mesh; ≥ 0.
    pub weights: &'a [f32],
    /// Vertices whose attribute seams `Flags::Permissive` must respect: empty, or one flag a vertex.
    pub protected: &'a [bool],
}

/// What [`simplify_with_update`] returns: triangles with the vertices they refer to, moved.
#[derive(Debug, Clone)]
pub struct Updated {
    /// As many as in the input; only those in use have a meaning.
    pub positions: Vec<[f32; 3]>,
    /// In the input's layout.
    pub attributes: Vec<f32>,
    /// The triangles left.
    pub triangles: Vec<[u32; 3]>,
}

/// Collapses edges until at most `target` triangles are left or nothing more may collapse. The vertices stay as they
/// are.
///
/// # Errors
/// [`Kind::Malformed`] when an index is out of range, an array has the wrong length or a number is not finite.
pub fn simplify(input: &Input, target: usize, flags: Flags) -> Result<Vec<[u32; 3]>> {
    input.check()?;
    if input.triangles.len() <= target {
        return Ok(input.triangles.to_vec());
    }
    let indices = meshopt::simplify_with_attributes_and_locks(
        input.triangles.as_flattened(),
        &adapt(input.positions)?,
        input.attributes,
        input.weights,
        size_of_val(input.weights),
        &input.locks(),
        target * 3,
        ANY_ERROR,
        flags,
        None,
    );
    Ok(group_triangles(&indices))
}

/// Like [`simplify`], but moves vertices and changes attributes of weight > 0 for the best fit.
///
/// # Errors
/// As [`simplify`].
pub fn simplify_with_update(input: &Input, target: usize, flags: Flags) -> Result<Updated> {
    input.check()?;
    let mut indices = input.triangles.as_flattened().to_vec();
    let mut positions = input.positions.to_vec();
    let mut attributes = input.attributes.to_vec();
    if input.triangles.len() > target {
        let count = meshopt::simplify_with_update(
            &mut indices,
            &mut positions,
            &mut attributes,
            input.weights,
            size_of_val(input.weights),
            Some(&input.locks()),
            target * 3,
            ANY_ERROR,
            flags,
            None,
        );
        indices.truncate(count);
    }
    Ok(Updated { positions, attributes, triangles: group_triangles(&indices) })
}

/// Bare library calls for one mesh: everything around them is done beforehand, so that a clock sees nothing else.
pub struct BareCalls<'a> {
    input: Input<'a>,
    vertices: VertexDataAdapter<'a>,
    locks: Vec<SimplifyVertex>,
    flags: Flags,
    update: bool,
}

impl<'a> BareCalls<'a> {
    /// Checks `input` and prepares what the library wants beside it; with `update` vertices move.
    ///
    /// # Errors
    /// [`Kind::Malformed`] when an index is out of range, an array has the wrong length or a number is not finite.
    pub fn new(input: Input<'a>, flags: Flags, update: bool) -> Result<Self> {
        input.check()?;
        Ok(Self { input, vertices: adapt(input.positions)?, locks: input.locks(), flags, update })
    }

    /// Calls the library for each of `targets` (triangles): each call gets what the one before left. Gives the
    /// triangles left at last.
    pub fn run_chain(&self, targets: &[usize]) -> usize {
        if self.update { self.run_chain_with_update(targets) } else { self.run_chain_on_indices(targets) }
    }

    /// All levels share the source's vertices. (`Sparse` would make the calls on small levels 3 to 5 % faster.)
    fn run_chain_on_indices(&self, targets: &[usize]) -> usize {
        let source = self.input.triangles.as_flattened();
        let mut level: Option<Vec<u32>> = None;
        for &target in targets {
            level = Some(self.call(level.as_deref().unwrap_or(source), target * 3));
        }
        level.map_or(source.len(), |level| level.len()) / 3
    }

    /// What the library overwrites is copied, once for a chain.
    fn run_chain_with_update(&self, targets: &[usize]) -> usize {
        let Input { weights, .. } = self.input;
        let mut indices = self.input.triangles.as_flattened().to_vec();
        let (mut positions, mut attributes) = (self.input.positions.to_vec(), self.input.attributes.to_vec());
        for &target in targets {
            let count = meshopt::simplify_with_update(
                &mut indices,
                &mut positions,
                &mut attributes,
                weights,
                size_of_val(weights),
                Some(&self.locks),
                target * 3,
                ANY_ERROR,
                self.flags,
                None,
            );
            indices.truncate(count);
        }
        indices.len() / 3
    }

    /// `indices` are the input's or come from the library.
    fn call(&self, indices: &[u32], target: usize) -> Vec<u32> {
        let Input { attributes, weights, .. } = self.input;
        if weights.is_empty() && self.flags.is_empty() {
            return meshopt::simplify(indices, &self.vertices, target, ANY_ERROR, self.flags, None);
        }
        meshopt::simplify_with_attributes_and_locks(
            indices,
            &self.vertices,
            attributes,
            weights,
            size_of_val(weights),
            &self.locks,
            target,
            ANY_ERROR,
            self.flags,
            None,
        )
    }
}

/// Orders `triangles` for the GPU's vertex cache and renumbers their vertices in the order of first use. Returns, for
/// each new vertex, the old one: what the vertex arrays are to be gathered by. Unused vertices are left out.
///
/// # Errors
/// [`Kind::Malformed`] when an index is not below `vertex_count`.
pub fn optimize_order(triangles: &mut [[u32; 3]], vertex_count: usize) -> Result<Vec<u32>> {
    check_indices(triangles, vertex_count)?;
    meshopt::optimize_vertex_cache_in_place(triangles.as_flattened_mut(), vertex_count);
    Ok(renumber_by_use(triangles, vertex_count))
}

/// Renumbers the vertices of `triangles` in the order of first use; the result as of [`optimize_order`].
///
/// # Panics
/// When an index is not below `vertex_count`.
pub fn renumber_by_use(triangles: &mut [[u32; 3]], vertex_count: usize) -> Vec<u32> {
    const UNUSED: u32 = u32::MAX;
    let mut new = vec![UNUSED; vertex_count];
    let mut old = Vec::new();
    for vertex in triangles.as_flattened_mut() {
        let number = &mut new[*vertex as usize];
        if *number == UNUSED {
            *number = old.len() as u32;
            old.push(*vertex);
        }
        *vertex = *number;
    }
    old
}

impl Input<'_> {
    fn check(&self) -> Result<()> {
        let vertices = self.positions.len();
        check_indices(self.triangles, vertices)?;
        if let Some(vertex) = self.positions.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
            return Err(malformed(format!("the position of vertex {vertex} is not finite")));
        }
        if self.weights.len() > MAX_ATTRIBUTES {
            return Err(malformed(format!("{} attribute weights, at most {MAX_ATTRIBUTES} work", self.weights.len())));
        }
        if !self.weights.iter().all(|w| w.is_finite() && *w >= 0.0) {
            return Err(malformed("an attribute weight is negative or not finite".into()));
        }
        if Some(self.attributes.len()) != vertices.checked_mul(self.weights.len()) {
            let (found, width) = (self.attributes.len(), self.weights.len());
            return Err(malformed(format!(
                "{found} attribute numbers, expected {width} for each of {vertices} vertices"
            )));
        }
        if let Some(i) = self.attributes.iter().position(|x| !x.is_finite()) {
            return Err(malformed(format!("an attribute of vertex {} is not finite", i / self.weights.len())));
        }
        if !self.protected.is_empty() && self.protected.len() != vertices {
            return Err(malformed(format!("{} vertex flags, expected none or {vertices}", self.protected.len())));
        }
        Ok(())
    }

    /// One for each vertex, always: the library reads them unasked.
    fn locks(&self) -> Vec<SimplifyVertex> {
        let lock = |&protect: &bool| if protect { SimplifyVertex::Protect } else { SimplifyVertex::None };
        let mut locks: Vec<_> = self.protected.iter().map(lock).collect();
        locks.resize(self.positions.len(), SimplifyVertex::None);
        locks
    }
}

fn check_indices(triangles: &[[u32; 3]], vertex_count: usize) -> Result<()> {
    // Internally the library counts corners and wedges in 32 bits.
    if triangles.len() > u32::MAX as usize / 3 || vertex_count > u32::MAX as usize / 3 {
        return Err(Error::new(Kind::Limit, "the mesh is too large for meshoptimizer"));
    }
    let outside = |&(_, t): &(usize, &[u32; 3])| t.iter().any(|&v| v as usize >= vertex_count);
    match triangles.iter().enumerate().find(outside) {
        Some((i, t)) => Err(malformed(format!("triangle {i} has the vertices {t:?}, but there are {vertex_count}"))),
        None => Ok(()),
    }
}

fn adapt(positions: &[[f32; 3]]) -> Result<VertexDataAdapter<'_>> {
    VertexDataAdapter::new(typed_to_bytes(positions), size_of::<[f32; 3]>(), 0)
        .map_err(|error| Error::new(Kind::Internal, error.to_string()))
}

fn group_triangles(indices: &[u32]) -> Vec<[u32; 3]> {
    indices.as_chunks().0.to_vec()
}

fn malformed(message: String) -> Error {
    Error::new(Kind::Malformed, message)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
    const HALVES: [[u32; 3]; 2] = [[0, 1, 2], [0, 2, 3]];

    fn refuses(input: Input) -> String {
        let all = [simplify(&input, 1, Flags::None).err(), simplify_with_update(&input, 1, Flags::None).err()];
        let messages: Vec<_> = all.into_iter().map(|error| error.expect("must be refused").message).collect();
        assert!(messages.iter().all(|m| *m == messages[0]));
        messages[0].clone()
    }

    #[test]
    fn bad_input_is_refused_before_the_library_sees_it() {
        let good = Input { positions: &SQUARE, triangles: &HALVES, ..Input::default() };
        assert_eq!(
            refuses(Input { triangles: &[[0, 1, 2], [1, 2, 4]], ..good }),
            "triangle 1 has the vertices [1, 2, 4], but there are 4"
        );
        assert!(
            refuses(Input { positions: &[[0.0; 3], [f32::NAN; 3], [0.0; 3], [0.0; 3]], ..good }).contains("vertex 1")
        );
        assert!(refuses(Input { attributes: &[0.0; 7], weights: &[1.0, 1.0], ..good }).contains("7 attribute numbers"));
        assert!(refuses(Input { attributes: &[0.0; 4], ..good }).contains("expected 0"));
        assert!(
            refuses(Input { attributes: &[0.0, 0.0, f32::INFINITY, 0.0], weights: &[1.0], ..good })
                .contains("vertex 2")
        );
        assert!(refuses(Input { attributes: &[0.0; 4], weights: &[-1.0], ..good }).contains("weight"));
        assert!(refuses(Input { attributes: &[0.0; 132], weights: &[1.0; 33], ..good }).contains("33"));
        assert!(refuses(Input { protected: &[true; 3], ..good }).contains("3 vertex flags"));
        assert_eq!(optimize_order(&mut [[0, 1, 9]], 3).unwrap_err().kind, Kind::Malformed);
    }

    #[test]
    fn empty_and_small_meshes_pass_through() {
        assert!(simplify(&Input::default(), 0, Flags::None).unwrap().is_empty());
        assert!(simplify_with_update(&Input::default(), 0, Flags::None).unwrap().triangles.is_empty());
        assert!(optimize_order(&mut [], 5).unwrap().is_empty());
        let square = Input { positions: &SQUARE, triangles: &HALVES, ..Input::default() };
        assert_eq!(simplify(&square, 7, Flags::None).unwrap(), HALVES);
    }

    #[test]
    fn every_option_takes_extreme_input() {
        let positions = [[f32::MAX, 0.0, 0.0], [-f32::MAX, 1e-40, 0.0], [0.0, f32::MIN, 1.0], [0.0; 3]];
        let triangles = [[0, 1, 2], [0, 0, 1], [3, 3, 3], [2, 1, 3], [2, 1, 3]];
        let attributes = [f32::MAX; 4];
        let input = Input {
            positions: &positions,
            triangles: &triangles,
            attributes: &attributes,
            weights: &[1.0],
            protected: &[true; 4],
        };
        for flags in (0..512).map(Flags::from_bits_truncate) {
            for target in 0..5 {
                assert!(simplify(&input, target, flags).unwrap().len() <= 5);
                assert!(simplify_with_update(&input, target, flags).unwrap().triangles.len() <= 5);
            }
        }
    }

    #[test]
    fn order_follows_first_use_and_drops_the_unused() {
        let mut triangles = [[7, 5, 2], [2, 5, 3]];
        let old = optimize_order(&mut triangles, 9).unwrap();
        let back: Vec<[u32; 3]> = triangles.iter().map(|t| t.map(|v| old[v as usize])).collect();
        assert_eq!(triangles.as_flattened()[..3], [0, 1, 2]);
        assert_eq!(old.len(), 4);
        for triangle in [[7, 5, 2], [2, 5, 3]] {
            assert!(back.iter().any(|t| (0..3).any(|r| [t[r], t[(r + 1) % 3], t[(r + 2) % 3]] == triangle)));
        }
    }
}
