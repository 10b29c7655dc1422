//! Progressive meshes: a coarse base, and one record for each collapse that takes it back, coarse to fine (Hoppe 1996).
//!
//! `log` watches the collapses, `encode` turns what it saw into records, `state` is the mesh that both sides refine record by
//! record, `record` has the bytes of one, `decode` reads streams, `code` has the numbers' codes. Knows no glTF: a vertex is a row of integers (the bits of a
//! float, or a stored integer), a group is a set of vertices with one row layout. `docs/GLTFLOD_mesh_progressive.md` has the bytes.
//!
//! Vertices of the source come back bit for bit. What stands in between is rounded to a grid for each column: those
//! values are nobody's source, and on a grid they cost a byte instead of three.

mod code;
mod decode;
mod encode;
mod grid;
mod log;
mod record;
mod state;
#[cfg(test)]
mod tests;

pub(crate) use code::{Number, checksum};
pub(crate) use decode::{Most, Stop, refine};
pub(crate) use encode::{Chunk, encode};
pub(crate) use grid::Steps;
pub(crate) use log::Log;
pub(crate) use state::State;
