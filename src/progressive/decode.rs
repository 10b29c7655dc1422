//! Refines a mesh by a stream of records.

use super::code::{Fault, Reader};
use super::record::read_record;
use super::state::State;

/// Where refining ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct End {
    /// Records applied.
    pub records: usize,
    /// Bytes they took.
    pub bytes: usize,
    /// What stopped it.
    pub stop: Stop,
}

/// What stopped refining.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stop {
    /// Another record would have been one triangle too many.
    Target,
    /// All bytes are read.
    Bytes,
    /// The next record is not all there.
    Truncated,
    /// The next record is wrong; the mesh is not to be used.
    Malformed(&'static str),
}

/// How far to refine.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Most {
    /// Triangles of the mesh.
    pub triangles: usize,
    /// Numbers of all its vertices.
    pub numbers: usize,
}

/// Applies the records of `bytes` for as long as the mesh has no more than `most`. A record is applied in full or not at all.
pub(crate) fn refine(state: &mut State, bytes: &[u8], most: Most) -> End {
    let mut end = End { records: 0, bytes: 0, stop: Stop::Bytes };
    while end.bytes < bytes.len() {
        let mut reader = Reader::new(bytes, end.bytes);
        let room = most.numbers.saturating_sub(state.number_count());
        let record = match read_record(state, room, &mut reader) {
            Ok(record) => record,
            Err(Fault::Truncated) => return End { stop: Stop::Truncated, ..end },
            Err(Fault::Malformed(what)) => return End { stop: Stop::Malformed(what), ..end },
        };
        if state.faces().len().saturating_add(record.faces.len()) > most.triangles {
            return End { stop: Stop::Target, ..end };
        }
        if !state.apply(&record) {
            return End { stop: Stop::Malformed("a vertex is split twice"), ..end };
        }
        end.records += 1;
        end.bytes = reader.at;
    }
    end
}
