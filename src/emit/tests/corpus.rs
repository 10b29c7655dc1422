//! Real files with made-up levels, every layout and policy; the checker judges them.

use super::sketch::{fake_lods, options};
use crate::asset::{Asset, Container, Limits};
use crate::emit::{Existing, Layout, Options, emit, verify, write};
use std::path::Path;

#[test]
fn real_files_keep_all_they_had() {
    let Ok(corpus) = std::env::var("GLTF_LOD_CORPUS") else {
        eprintln!("skipped: GLTF_LOD_CORPUS is not set");
        return;
    };
    let corpus = Path::new(&corpus);
    // For a look by other eyes, such as the Khronos validator's.
    let kept = std::env::var_os("GLTF_LOD_KEEP");
    let temporary = tempfile::tempdir().unwrap();
    let out = kept.as_deref().map_or(temporary.path(), Path::new);
    let mut files = 0;
    for entry in walkdir::WalkDir::new(corpus).sort_by_file_name() {
        let path = entry.unwrap().into_path();
        let is_gltf = path.extension().is_some_and(|e| e == "gltf" || e == "glb");
        if !is_gltf || path.strip_prefix(corpus).unwrap().starts_with("invalid") {
            continue;
        }
        let source = Asset::read(&path, corpus, &Limits::default()).unwrap();
        if source.container == Container::Gltf && source.buffers == [None] {
            eprintln!("without data: {}", path.display());
            continue;
        }
        for (layout, existing, name) in
            [(Layout::Append, Existing::Keep, "append"), (Layout::Progressive, Existing::Replace, "progressive")]
        {
            let options = Options { layout, existing, ..options() };
            let levels = |mesh| fake_lods(&source, mesh, 2);
            let lods: Vec<_> = (0..source.document.array("meshes").len()).map(levels).collect();
            let output = emit(&source, &lods, &options).unwrap();
            if let Err(problems) = verify::check_output(&source, &output) {
                panic!("{} {name}: {problems:#?}", path.display());
            }
            let relative = path.strip_prefix(corpus).unwrap().parent().unwrap();
            let directory = out.join(name).join(relative);
            write(&output, &directory).unwrap();
            let written = directory.join(path.file_name().unwrap());
            let written = Asset::read(&written, &out.join(name), &Limits::default()).unwrap();
            if let Err(problems) = verify::check(&source, &written) {
                panic!("{} {name}, read back: {problems:#?}", path.display());
            }
        }
        files += 1;
    }
    assert!(files > 0, "no files in {}", corpus.display());
}
