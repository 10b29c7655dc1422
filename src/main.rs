//! Command line of gltf-lod.

fn main() {}
