//! GLB chunks, both ways. Plain `.gltf` is a container without chunks.
//!
//! Told apart by the magic number, not by the file's name. Lengths are compared with the bytes that are there
//! before anything is allocated; unknown chunks are kept.

use crate::error::{Error, Kind, Result};

const MAGIC: [u8; 4] = *b"glTF";
const JSON: [u8; 4] = *b"JSON";
const BIN: [u8; 4] = *b"BIN\0";
const HEADER: usize = 12;
const CHUNK_HEADER: usize = 8;

/// How the asset is packed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Container {
    /// A `.gltf` file.
    Gltf,
    /// A `.glb` file; `others` are its chunks other than JSON and BIN, in order, kept as they are.
    Glb {
        /// Unknown chunks.
        others: Vec<Chunk>,
    },
}

/// An unknown chunk of a GLB file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Chunk {
    /// The four bytes of its type.
    pub kind: [u8; 4],
    /// Its payload.
    pub data: Vec<u8>,
    /// Whether it stood before the BIN chunk.
    pub before_bin: bool,
}

/// A file taken apart.
#[derive(Debug)]
pub(crate) struct Unpacked {
    pub container: Container,
    pub json: Vec<u8>,
    pub bin: Option<Vec<u8>>,
    /// Whether a GLB promises more bytes than there are.
    pub ends_early: bool,
    pub warnings: Vec<Error>,
}

/// Where a chunk lies in the file.
struct Span {
    kind: [u8; 4],
    data: std::ops::Range<usize>,
}

impl Container {
    /// Takes a file apart: GLB when it begins with the magic number, otherwise all of it is JSON.
    pub(crate) fn unpack(bytes: Vec<u8>) -> Result<Unpacked> {
        if bytes.is_empty() {
            return Err(Error::new(Kind::Malformed, "the file is empty"));
        }
        if bytes.starts_with(&MAGIC) {
            return unpack_glb(bytes);
        }
        let nothing = Vec::new();
        Ok(Unpacked { container: Self::Gltf, json: bytes, bin: None, ends_early: false, warnings: nothing })
    }

    /// As [`Container::unpack`], but the BIN chunk of a GLB may end early, or not have begun.
    pub(crate) fn unpack_prefix(mut bytes: Vec<u8>) -> Result<Unpacked> {
        let promised = read_u32(&bytes, 8).unwrap_or(0) as usize;
        if !bytes.starts_with(&MAGIC) || promised <= bytes.len() {
            return Self::unpack(bytes);
        }
        // The lengths are made those of what is there; a chunk header without a chunk goes.
        let last = find_last_chunk(&bytes)?;
        let data = last + CHUNK_HEADER;
        let end = if data > bytes.len() { last } else { bytes.len() };
        bytes.truncate(end);
        let total = length_field(end as u64)?;
        if let Some(field) = bytes.get_mut(8..12) {
            field.copy_from_slice(&total.to_le_bytes());
        }
        let left = length_field(end.saturating_sub(data) as u64)?;
        if let Some(field) = bytes.get_mut(last..last + 4) {
            field.copy_from_slice(&left.to_le_bytes());
        }
        Ok(Unpacked { ends_early: true, ..unpack_glb(bytes)? })
    }

    /// Puts a file together again: the unknown chunks go where they were, and everything is padded to 4 bytes.
    /// A plain `.gltf` is its JSON.
    ///
    /// # Errors
    /// [`Kind::Limit`] when a GLB would pass 4 GiB, which its lengths cannot express;
    /// [`Kind::Internal`] for a BIN chunk in a plain `.gltf`.
    pub fn pack(&self, json: &[u8], bin: Option<&[u8]>) -> Result<Vec<u8>> {
        let Self::Glb { others } = self else {
            return match bin {
                None => Ok(json.to_vec()),
                Some(_) => Err(Error::new(Kind::Internal, "a plain .gltf has no BIN chunk")),
            };
        };
        let mut chunks = vec![(JSON, json, b' ')];
        chunks.extend(others.iter().filter(|c| c.before_bin).map(|c| (c.kind, c.data.as_slice(), 0)));
        chunks.extend(bin.map(|bin| (BIN, bin, 0)));
        chunks.extend(others.iter().filter(|c| !c.before_bin).map(|c| (c.kind, c.data.as_slice(), 0)));
        let total = chunks.iter().map(|(_, data, _)| CHUNK_HEADER as u64 + padded(data.len())).sum::<u64>();
        let total = length_field(HEADER as u64 + total)?;

        let mut out = Vec::with_capacity(total as usize);
        out.extend_from_slice(&MAGIC);
        out.extend_from_slice(&2_u32.to_le_bytes());
        out.extend_from_slice(&total.to_le_bytes());
        for (kind, data, padding) in chunks {
            out.extend_from_slice(&length_field(padded(data.len()))?.to_le_bytes());
            out.extend_from_slice(&kind);
            out.extend_from_slice(data);
            out.resize(out.len().next_multiple_of(4), padding);
        }
        Ok(out)
    }
}

fn padded(length: usize) -> u64 {
    (length as u64).next_multiple_of(4)
}

fn length_field(length: u64) -> Result<u32> {
    u32::try_from(length).map_err(|_| {
        Error::new(Kind::Limit, format!("the GLB would have {length} bytes; its length fields end at 4 GiB"))
            .help("keep the asset as .gltf with separate .bin files, or split it")
    })
}

fn unpack_glb(mut bytes: Vec<u8>) -> Result<Unpacked> {
    let mut warnings = Vec::new();
    let end = read_header(&bytes, &mut warnings)?;
    let spans = find_chunks(&bytes, end)?;
    let Some((json, rest)) = spans.split_first().filter(|(first, _)| first.kind == JSON) else {
        let found = spans.first().map_or("no chunk at all".to_owned(), |s| format!("a {} chunk", show(s.kind)));
        return Err(at_byte(HEADER, format!("the first chunk of a GLB must be JSON, found {found}")));
    };
    let bin = rest.iter().position(|s| s.kind == BIN);
    let copy = |span: &Span| bytes.get(span.data.clone()).unwrap_or_default().to_vec();
    let json = copy(json);
    let others = rest.iter().enumerate().filter(|(i, _)| Some(*i) != bin);
    let others = others
        .map(|(i, span)| Chunk { kind: span.kind, data: copy(span), before_bin: bin.is_some_and(|b| i < b) })
        .collect();
    // The BIN chunk is most of the file: it stays in the memory it was read into.
    let bin = bin.and_then(|b| rest.get(b)).map(|span| {
        bytes.truncate(span.data.end);
        bytes.drain(..span.data.start);
        bytes
    });
    Ok(Unpacked { container: Container::Glb { others }, json, bin, ends_early: false, warnings })
}

/// Checks the header and gives the end of the GLB within `bytes`.
fn read_header(bytes: &[u8], warnings: &mut Vec<Error>) -> Result<usize> {
    let (Some(version), Some(length)) = (read_u32(bytes, 4), read_u32(bytes, 8)) else {
        return Err(at_byte(0, format!("a GLB header has {HEADER} bytes, the file has {}", bytes.len()))
            .help("the file is truncated: export or copy it again"));
    };
    if version != 2 {
        return Err(Error { kind: Kind::Unsupported, ..at_byte(4, format!("GLB version {version}, expected 2")) }
            .help("convert the asset to glTF 2.0 first"));
    }
    let length = length as usize;
    if length > bytes.len() {
        return Err(at_byte(8, format!("the GLB header promises {length} bytes, the file has {}", bytes.len()))
            .help("the file is truncated: export or copy it again"));
    }
    if length < HEADER + CHUNK_HEADER {
        return Err(at_byte(8, format!("the GLB header gives a length of {length} bytes; the least is 20")));
    }
    if length < bytes.len() {
        let message = format!("{} bytes after the end of the GLB are left out", bytes.len() - length);
        warnings.push(at_byte(length, message));
    }
    Ok(length)
}

/// Where the chunk that the file ends in begins, which must not be the first: without all of the JSON nothing is known.
fn find_last_chunk(bytes: &[u8]) -> Result<usize> {
    let mut at = HEADER;
    loop {
        let length = read_u32(bytes, at).map_or(u64::from(u32::MAX), u64::from);
        let next = at as u64 + CHUNK_HEADER as u64 + length;
        if next > bytes.len() as u64 || next == bytes.len() as u64 && at > HEADER {
            break;
        }
        at = next as usize;
    }
    if at == HEADER {
        let error = at_byte(bytes.len(), "the file ends before its JSON does".to_owned());
        return Err(error.help("the file is truncated: export or copy it again"));
    }
    Ok(at)
}

fn find_chunks(bytes: &[u8], end: usize) -> Result<Vec<Span>> {
    let mut spans = Vec::new();
    let mut at = HEADER;
    while at < end {
        let left = end - at;
        let header = read_u32(bytes, at).zip(bytes.get(at + 4..at + 8)).filter(|_| left >= CHUNK_HEADER);
        let Some((length, kind)) = header else {
            return Err(at_byte(at, format!("a chunk header has 8 bytes, the GLB ends after {left}")));
        };
        let kind = <[u8; 4]>::try_from(kind).unwrap_or_default();
        let start = at + CHUNK_HEADER;
        if length as usize > end - start {
            let message = format!("the {} chunk promises {length} bytes, {} are left", show(kind), end - start);
            return Err(at_byte(at, message).help("the file is truncated or its lengths are wrong: export it again"));
        }
        at = start + length as usize;
        spans.push(Span { kind, data: start..at });
    }
    Ok(spans)
}

fn read_u32(bytes: &[u8], at: usize) -> Option<u32> {
    let field = bytes.get(at..)?.first_chunk::<4>()?;
    Some(u32::from_le_bytes(*field))
}

fn show(kind: [u8; 4]) -> String {
    format!("\"{}\"", kind.escape_ascii())
}

fn at_byte(offset: usize, message: String) -> Error {
    Error::malformed(format!("byte {offset}"), message)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn glb() -> Container {
        Container::Glb { others: Vec::new() }
    }

    fn fails(bytes: &[u8], fragment: &str) {
        let message = Container::unpack(bytes.to_vec()).unwrap_err().to_string();
        assert!(message.contains(fragment), "{message}");
    }

    #[test]
    fn pack_and_unpack_are_inverse_up_to_padding() {
        let others = vec![
            Chunk { kind: *b"ABCD", data: vec![1, 2, 3, 4], before_bin: true },
            Chunk { kind: *b"EFGH", data: Vec::new(), before_bin: false },
        ];
        let container = Container::Glb { others };
        let bytes = container.pack(b"{}", Some(&[7; 5])).unwrap();
        assert_eq!(bytes.len() % 4, 0);
        let back = Container::unpack(bytes).unwrap();
        assert_eq!(back.container, container);
        assert_eq!(back.json, b"{}  ");
        assert_eq!(back.bin.unwrap(), [7, 7, 7, 7, 7, 0, 0, 0]);
        assert!(back.warnings.is_empty());
    }

    #[test]
    fn a_glb_without_bin_and_one_with_an_empty_bin_differ() {
        assert_eq!(Container::unpack(glb().pack(b"{}", None).unwrap()).unwrap().bin, None);
        assert_eq!(Container::unpack(glb().pack(b"{}", Some(&[])).unwrap()).unwrap().bin, Some(Vec::new()));
    }

    #[test]
    fn every_prefix_of_a_glb_is_refused() {
        let bytes = glb().pack(b"{\"a\":1}", Some(&[1, 2, 3, 4])).unwrap();
        for length in 4..bytes.len() {
            assert!(Container::unpack(bytes[..length].to_vec()).is_err(), "{length} bytes");
        }
    }

    #[test]
    fn lying_lengths_are_refused() {
        let good = glb().pack(b"{}", Some(&[1, 2, 3, 4])).unwrap();
        let with = |at: usize, field: u32| {
            let mut bytes = good.clone();
            bytes[at..at + 4].copy_from_slice(&field.to_le_bytes());
            bytes
        };
        fails(&with(4, 1), "GLB version 1, expected 2");
        fails(&with(8, 0), "length of 0 bytes");
        fails(&with(8, u32::MAX), "promises 4294967295 bytes");
        fails(&with(8, good.len() as u32 - 4), "the \"BIN\\x00\" chunk promises 4 bytes, 0 are left");
        fails(&with(12, u32::MAX), "the \"JSON\" chunk promises 4294967295 bytes");
        fails(&with(16, 0), "the first chunk of a GLB must be JSON");
        fails(b"", "empty");
    }

    #[test]
    fn bytes_after_the_end_are_left_out_with_a_warning() {
        let mut bytes = glb().pack(b"{}", Some(&[1, 2, 3, 4])).unwrap();
        bytes.push(b'\n');
        let unpacked = Container::unpack(bytes).unwrap();
        assert_eq!(unpacked.bin.unwrap(), [1, 2, 3, 4]);
        assert!(unpacked.warnings[0].to_string().contains("1 bytes after the end"));
    }
}
