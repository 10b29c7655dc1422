//! One record as bytes, both ways. Writer and reader stand side by side: each line of one answers a line of the other.

use super::code::{Fault, Number, Reader, Residuals, write_unsigned};
use super::state::{Added, Record, Split, State};
use smallvec::SmallVec;

/// The first byte of a record.
mod header {
    /// Number of faces; at 3, the rest of the number follows.
    pub const FACES: u8 = 3;
    /// The number of splits follows, otherwise it is 1.
    pub const SPLITS: u8 = 4;
    /// The number of added vertices follows, otherwise it is 0.
    pub const ADDED: u8 = 8;
    /// The vertices at the first, at the second end are the source's.
    pub const EXACT: [u8; 2] = [16, 32];
    /// The first split has a shape of its own, otherwise two children, one at each end.
    pub const SHAPE: u8 = 64;
    pub const UNUSED: u8 = 128;
}

const POSITION: usize = 3;
/// How far along the corners at a vertex a neighbour may be named, so that a reader's work is bounded by the bytes it reads.
const FARTHEST: usize = 8192;

/// Appends a record for `state` as it is before it.
pub(super) fn write_record(state: &State, record: &Record, bytes: &mut Vec<u8>) {
    let many = usize::from(header::FACES);
    let has_shape = record.splits.first().is_some_and(|s| s.children[..] != [0, 1]);
    let flags = [
        (record.splits.len() != 1, header::SPLITS),
        (!record.added.is_empty(), header::ADDED),
        (record.exact[0], header::EXACT[0]),
        (record.exact[1], header::EXACT[1]),
        (has_shape, header::SHAPE),
    ];
    let first = flags.iter().filter(|f| f.0).fold(record.faces.len().min(many) as u8, |byte, f| byte | f.1);
    bytes.push(first);
    if record.faces.len() >= many {
        write_unsigned((record.faces.len() - many) as u32, bytes);
    }
    if record.splits.len() != 1 {
        write_unsigned(record.splits.len() as u32, bytes);
    }
    if !record.added.is_empty() {
        write_unsigned(record.added.len() as u32, bytes);
    }
    for (index, split) in record.splits.iter().enumerate() {
        write_split(state, split, index > 0 || has_shape, bytes);
    }
    let (made, locals) = write_rows(state, record, bytes);
    for &face in &record.faces {
        write_face(state, record, &made, &locals, face, bytes);
    }
}

/// Reads a record for `state` as it is before it. `room` is how many numbers its vertices may have: runs of zeros make many of few bytes.
pub(super) fn read_record(state: &State, room: usize, reader: &mut Reader) -> Result<Record, Fault> {
    let first = reader.byte()?;
    if first & header::UNUSED != 0 {
        return Err(Fault::Malformed("a flag that is not known"));
    }
    let count = |flag: u8, otherwise: u32, reader: &mut Reader| {
        if first & flag != 0 { reader.unsigned() } else { Ok(otherwise) }
    };
    let mut faces = u32::from(first & header::FACES);
    if first & header::FACES == header::FACES {
        faces = faces.saturating_add(reader.unsigned()?);
    }
    let splits = count(header::SPLITS, 1, reader)?;
    let added = count(header::ADDED, 0, reader)?;
    let mut record = Record { exact: header::EXACT.map(|flag| first & flag != 0), ..Record::default() };
    // Nothing is reserved: the bytes run out long before a count that lies.
    for index in 0..splits {
        let split = read_split(state, index > 0 || first & header::SHAPE != 0, reader)?;
        record.splits.push(split);
    }
    let made = read_rows(state, &mut record, added, room, reader)?;
    for _ in 0..faces {
        let face = read_face(state, &record, &made, reader)?;
        record.faces.push(face);
    }
    Ok(record)
}

fn write_split(state: &State, split: &Split, with_shape: bool, bytes: &mut Vec<u8>) {
    write_unsigned(state.vertex_count() as u32 - 1 - split.vertex, bytes);
    if with_shape {
        match split.children[..] {
            [end] => write_unsigned(u32::from(end), bytes),
            [0, 1] => write_unsigned(2, bytes),
            _ => {
                write_unsigned(split.children.len() as u32 + 1, bytes);
                bytes.extend_from_slice(&split.children);
            }
        }
    }
    let bits = owner_bits(split.children.len());
    let (mut word, mut filled) = (0u64, 0);
    for &owner in &split.owners {
        word |= u64::from(owner) << filled;
        filled += bits;
        while filled >= 8 {
            bytes.push(word as u8);
            word >>= 8;
            filled -= 8;
        }
    }
    if filled > 0 {
        bytes.push(word as u8);
    }
}

fn read_split(state: &State, with_shape: bool, reader: &mut Reader) -> Result<Split, Fault> {
    let back = reader.unsigned()?;
    let vertex = (state.vertex_count() as u32).checked_sub(back).and_then(|v| v.checked_sub(1));
    let vertex = vertex.ok_or(Fault::Malformed("a split of a vertex that is not there"))?;
    let mut split = Split { vertex, ..Split::default() };
    match if with_shape { reader.unsigned()? } else { 2 } {
        end @ 0..=1 => split.children.push(end as u8),
        2 => split.children.extend([0, 1]),
        more => {
            for _ in 1..more {
                match reader.byte()? {
                    end @ 0..=1 => split.children.push(end),
                    _ => return Err(Fault::Malformed("a child at neither end of its split")),
                }
            }
        }
    }
    if split.children.len() < 2 {
        return Ok(split);
    }
    let bits = owner_bits(split.children.len());
    let (mut word, mut filled) = (0u64, 0);
    for _ in state.ring(vertex) {
        while filled < bits {
            word |= u64::from(reader.byte()?) << filled;
            filled += 8;
        }
        let owner = (word & ((1 << bits) - 1)) as u32;
        if owner as usize >= split.children.len() {
            return Err(Fault::Malformed("a corner for a child that is not there"));
        }
        split.owners.push(owner);
        word >>= bits;
        filled -= bits;
    }
    Ok(split)
}

/// Bits that tell so many children apart.
fn owner_bits(children: usize) -> u32 {
    usize::BITS - (children - 1).leading_zeros()
}

/// A vertex that a record makes.
#[derive(Debug, Clone, Copy)]
struct Made {
    id: u32,
    group: u32,
    /// Where its row is in [`Record::rows`].
    start: usize,
    /// Split and child; none for an added vertex.
    origin: Option<(usize, usize)>,
}

/// What is known of the ends of a split while its children's rows are coded.
#[derive(Debug, Default)]
struct Ends {
    /// Where the first row at each end is: it has the position.
    first: [Option<usize>; 2],
    /// Where the first row of this split at the first end is.
    sibling: Option<usize>,
}

impl Ends {
    /// The prediction for the number `i` of a child at `end`, given the rows so far.
    fn predict(&self, number: Number, i: usize, end: u8, joined: i32, rows: &[i32]) -> i32 {
        let other = if i < POSITION { self.first[0] } else { self.sibling };
        match other {
            Some(start) if end == 1 => number.mirror(joined, rows[start + i]),
            _ => joined,
        }
    }

    fn learn(&mut self, end: u8, start: usize) {
        self.first[usize::from(end)].get_or_insert(start);
        if end == 0 {
            self.sibling.get_or_insert(start);
        }
    }
}

fn write_rows(state: &State, record: &Record, bytes: &mut Vec<u8>) -> (Vec<Made>, Locals) {
    let (mut made, mut ends, mut start) = (Vec::new(), Ends::default(), 0);
    let mut residuals = Residuals::default();
    let mut next = state.vertex_count() as u32;
    for (index, split) in record.splits.iter().enumerate() {
        ends.sibling = None;
        let group = state.group(split.vertex);
        let (layout, joined) = (state.layout(group), state.row(split.vertex));
        for (child, &end) in split.children.iter().enumerate() {
            let exact = record.exact[usize::from(end)];
            let known = if ends.first[usize::from(end)].is_some() { POSITION } else { 0 };
            for i in known..layout.len() {
                let predicted = ends.predict(layout[i], i, end, joined[i], &record.rows);
                residuals.write(layout[i].residual(exact, predicted, record.rows[start + i]), bytes);
            }
            ends.learn(end, start);
            made.push(Made {
                id: child_id(split.vertex, child, &mut next),
                group,
                start,
                origin: Some((index, child)),
            });
            start += layout.len();
        }
    }
    residuals.end(bytes);
    let mut locals = Locals::of(&made);
    for added in &record.added {
        write_reference(&locals, added.predictor, bytes);
        let (group, predictor) = find_row(state, record, &made, locals.find(added.predictor).ok_or(added.predictor));
        let named = if group == added.group { 0 } else { added.group + 1 };
        write_unsigned(named << 1 | u32::from(added.exact), bytes);
        for (i, number) in state.layout(added.group).iter().enumerate() {
            let predicted = predict_added(group == added.group, i, predictor);
            residuals.write(number.residual(added.exact, predicted, record.rows[start + i]), bytes);
        }
        residuals.end(bytes);
        // New ids only grow.
        locals.sorted.push((next, made.len()));
        made.push(Made { id: next, group: added.group, start, origin: None });
        next += 1;
        start += state.layout(added.group).len();
    }
    (made, locals)
}

fn read_rows(
    state: &State,
    record: &mut Record,
    added: u32,
    room: usize,
    reader: &mut Reader,
) -> Result<Vec<Made>, Fault> {
    let check_room = |record: &Record| {
        if record.rows.len() <= room {
            Ok(())
        } else {
            Err(Fault::Malformed("more vertices than the limit on memory allows"))
        }
    };
    let (mut made, mut ends, mut residuals) = (Vec::new(), Ends::default(), Residuals::default());
    let mut next = state.vertex_count() as u32;
    for (index, split) in record.splits.iter().enumerate() {
        ends.sibling = None;
        let group = state.group(split.vertex);
        let (layout, joined) = (state.layout(group), state.row(split.vertex));
        for (child, &end) in split.children.iter().enumerate() {
            let exact = record.exact[usize::from(end)];
            let start = record.rows.len();
            if let Some(first) = ends.first[usize::from(end)] {
                record.rows.extend_from_within(first..first + POSITION);
            }
            for i in record.rows.len() - start..layout.len() {
                let predicted = ends.predict(layout[i], i, end, joined[i], &record.rows);
                record.rows.push(restore(layout[i], exact, predicted, residuals.read(reader)?)?);
            }
            check_room(record)?;
            ends.learn(end, start);
            made.push(Made {
                id: child_id(split.vertex, child, &mut next),
                group,
                start,
                origin: Some((index, child)),
            });
        }
    }
    residuals.check_end()?;
    for _ in 0..added {
        let reference = read_reference(state, &made, reader)?;
        let predictor = reference.map_or_else(|absolute| absolute, |local| made[local].id);
        let named = reader.unsigned()?;
        let (own, exact) = (find_row(state, record, &made, reference).0, named & 1 == 1);
        let group = if named >> 1 == 0 { own } else { (named >> 1) - 1 };
        if group as usize >= state.group_count() {
            return Err(Fault::Malformed("a vertex of a primitive that is not there"));
        }
        let start = record.rows.len();
        for (i, &number) in state.layout(group).iter().enumerate() {
            let predicted = predict_added(own == group, i, find_row(state, record, &made, reference).1);
            record.rows.push(restore(number, exact, predicted, residuals.read(reader)?)?);
        }
        residuals.check_end()?;
        check_room(record)?;
        record.added.push(Added { group, exact, predictor });
        made.push(Made { id: next, group, start, origin: None });
        next += 1;
    }
    Ok(made)
}

fn restore(number: Number, exact: bool, predicted: i32, residual: i32) -> Result<i32, Fault> {
    number.restore(exact, predicted, residual).ok_or(Fault::Malformed("a number that is not finite"))
}

fn child_id(vertex: u32, child: usize, next: &mut u32) -> u32 {
    if child == 0 {
        return vertex;
    }
    *next += 1;
    *next - 1
}

/// Vertices of another primitive have the position in common only.
fn predict_added(same_group: bool, i: usize, predictor: &[i32]) -> i32 {
    if same_group || i < POSITION { predictor[i] } else { 0 }
}

/// Group and row of a vertex: one the record has made, or one from before the record.
fn find_row<'a>(state: &'a State, record: &'a Record, made: &[Made], at: Result<usize, u32>) -> (u32, &'a [i32]) {
    match at {
        Ok(local) => {
            let Made { group, start, .. } = made[local];
            (group, &record.rows[start..start + state.layout(group).len()])
        }
        Err(absolute) => (state.group(absolute), state.row(absolute)),
    }
}

/// The vertices that a record has made so far, by id.
struct Locals {
    sorted: SmallVec<[(u32, usize); 8]>,
}

impl Locals {
    fn of(made: &[Made]) -> Self {
        let mut sorted: SmallVec<_> = made.iter().enumerate().map(|(local, m)| (m.id, local)).collect();
        sorted.sort_unstable();
        Self { sorted }
    }

    fn find(&self, id: u32) -> Option<usize> {
        self.sorted.binary_search_by_key(&id, |s| s.0).ok().map(|at| self.sorted[at].1)
    }
}

/// Vertices that the record has made come first in the count, then all that were there.
fn write_reference(locals: &Locals, id: u32, bytes: &mut Vec<u8>) {
    let made = locals.sorted.len() as u32;
    write_unsigned(locals.find(id).map_or(made + id, |local| local as u32), bytes);
}

fn read_reference(state: &State, made: &[Made], reader: &mut Reader) -> Result<Result<usize, u32>, Fault> {
    let number = reader.unsigned()?;
    let local = number as usize;
    if local < made.len() {
        return Ok(Ok(local));
    }
    let absolute = local - made.len();
    if absolute < state.vertex_count() { Ok(Err(absolute as u32)) } else { Err(Fault::Malformed(NO_VERTEX)) }
}

const NO_VERTEX: &str = "a vertex that is not there";

/// A face over both children of one split and a vertex that was their neighbour before is one number, any other three.
fn write_face(state: &State, record: &Record, made: &[Made], locals: &Locals, face: [u32; 3], bytes: &mut Vec<u8>) {
    match find_short_form(state, record, made, locals, face) {
        Some(code) => write_unsigned(code, bytes),
        None => {
            write_unsigned(0, bytes);
            face.iter().for_each(|&id| write_reference(locals, id, bytes));
        }
    }
}

fn find_short_form(state: &State, record: &Record, made: &[Made], locals: &Locals, face: [u32; 3]) -> Option<u32> {
    let origins = face.map(|id| locals.find(id).and_then(|local| made[local].origin));
    let pair = |k: usize| match (origins[k], origins[(k + 1) % 3]) {
        (Some((a, from)), Some((b, to))) if a == b && from != to && record.splits[a].children.len() == 2 => {
            Some((k, a, from))
        }
        _ => None,
    };
    let (k, split, turned) = (0..3).find_map(pair)?;
    let (third, vertex) = (face[(k + 2) % 3], record.splits[split].vertex);
    let corners = (2 * state.ring(vertex).len()).min(FARTHEST);
    let number = (0..corners).find(|&n| state.neighbour(vertex, n) == Some(third) && locals.find(third).is_none())?;
    u32::try_from(1 + ((number * record.splits.len() + split) * 2 + turned)).ok()
}

fn read_face(state: &State, record: &Record, made: &[Made], reader: &mut Reader) -> Result<[u32; 3], Fault> {
    let corners = match reader.unsigned()?.checked_sub(1) {
        Some(code) => read_short_form(state, record, made, code as usize)?,
        None => {
            let mut corners = [(0, 0); 3];
            for corner in &mut corners {
                let reference = read_reference(state, made, reader)?;
                let id = reference.map_or_else(|absolute| absolute, |local| made[local].id);
                *corner = (id, find_row(state, record, made, reference).0);
            }
            corners
        }
    };
    match corners.map(|(_, group)| group) {
        [a, b, c] if a == b && b == c => Ok(corners.map(|(id, _)| id)),
        _ => Err(Fault::Malformed("a face over vertices of several primitives")),
    }
}

/// The corners of a face, each with its group.
fn read_short_form(state: &State, record: &Record, made: &[Made], code: usize) -> Result<[(u32, u32); 3], Fault> {
    let (splits, turned) = (record.splits.len(), code % 2 == 1);
    let (number, index) = match splits {
        0 => (FARTHEST, 0),
        _ => (code / 2 / splits, code / 2 % splits),
    };
    let third = (number < FARTHEST).then(|| state.neighbour(record.splits[index].vertex, number)).flatten();
    let third = third.ok_or(Fault::Malformed("a face at a neighbour that is not there"))?;
    if record.splits[index].children.len() != 2 {
        return Err(Fault::Malformed("a face between children that are not two"));
    }
    let first = made.partition_point(|m| m.origin.is_some_and(|(split, _)| split < index));
    let [a, b] = [made[first], made[first + 1]].map(|m| (m.id, m.group));
    let third = (third, state.group(third));
    Ok(if turned { [b, a, third] } else { [a, b, third] })
}
