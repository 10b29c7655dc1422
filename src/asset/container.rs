//! GLB chunks. Plain `.gltf` is a container without chunks.

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
