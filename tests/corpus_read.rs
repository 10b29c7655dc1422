//! Reads every real file of the corpus that `GLTF_LOD_CORPUS` names: valid files must give the geometry of every
//! mesh, invalid ones a clear error.

use gltf_lod::asset::{Asset, Geometry, Limits};
use std::path::{Path, PathBuf};

/// Files outside `invalid/` that cannot be read all the same: this one's buffer has no data anywhere.
const NO_DATA: [(&str, &str); 1] = [("CubeWithLOD.gltf", "/buffers/0: the buffer has neither a uri nor the BIN chunk")];

/// What `invalid/` must say; `None` for files that are odd but readable.
const INVALID: [(&str, Option<&str>); 11] = [
    (
        "AllIndicesOutOfRange.gltf",
        Some("/meshes/0/primitives/0/indices: triangle 0 [65535, 65535, 65535] names vertex"),
    ),
    ("BoxTextured.gltf", Some("/buffers/0: ")),
    ("RecursiveNodes.gltf", Some("/nodes/0: the node is below itself: nodes 0 → 1 → 0")),
    ("BoxWithInfinites.glb", Some("/meshes/0/primitives/0/attributes/POSITION: the position of vertex ")),
    ("BoxBadNormals.glb", None),
    ("Cube.gltf", Some("/bufferViews/2: ")),
    ("Invalid_Json.gltf", Some("not valid JSON")),
    ("invalid-buffer-index.gltf", Some("/bufferViews/1/buffer: names buffers[1]")),
    ("integer-out-of-bounds.gltf", Some("/bufferViews/0/byteLength: expected a whole number")),
    (
        "invalid-primitive-indices.gltf",
        Some("/bufferViews/0/buffer: names buffers[0], but the document has no buffers"),
    ),
    ("zero-sized-bin-chunk-issue-440.glb", None),
];

fn corpus() -> Option<PathBuf> {
    let corpus = std::env::var_os("GLTF_LOD_CORPUS").map(PathBuf::from);
    if corpus.is_none() {
        println!("skipped: GLTF_LOD_CORPUS is not set");
    }
    corpus
}

fn find_assets(root: &Path) -> Vec<PathBuf> {
    let entries = walkdir::WalkDir::new(root).sort_by_file_name().into_iter().map(|e| e.unwrap().into_path());
    entries.filter(|p| p.extension().is_some_and(|e| e == "gltf" || e == "glb")).collect()
}

fn read(path: &Path, root: &Path) -> gltf_lod::Result<(Asset, Vec<Geometry>)> {
    let limits = Limits::default();
    let asset = Asset::read(path, root, &limits)?;
    let meshes = asset.document.array("meshes").len();
    let geometries = (0..meshes).map(|m| asset.geometry(m, &limits)).collect::<Result<_, _>>()?;
    let _ = asset.scene();
    Ok((asset, geometries))
}

fn check_arrays(geometry: &Geometry) {
    let mesh = &geometry.mesh;
    let vertices = mesh.positions.len();
    assert_eq!(mesh.groups.len(), mesh.triangles.len());
    for (triangle, &group) in mesh.triangles.iter().zip(&mesh.groups) {
        let range = &geometry.primitives[group as usize].vertices;
        assert!(triangle.iter().all(|corner| range.contains(corner)), "a vertex belongs to one group");
    }
    for attribute in &mesh.attributes {
        assert_eq!(attribute.values.len(), vertices * attribute.width);
        assert!(attribute.values.iter().all(|x| x.is_finite()));
    }
    if let Some(skin) = &mesh.skin {
        assert_eq!((skin.joints.len(), skin.weights.len()), (vertices * skin.influences, vertices * skin.influences));
    }
}

#[test]
fn every_valid_file_gives_its_geometry() {
    let Some(corpus) = corpus() else { return };
    let (mut files, mut triangles) = (0, 0);
    for path in find_assets(&corpus).iter().filter(|p| !p.starts_with(corpus.join("invalid"))) {
        let name = path.file_name().unwrap().to_str().unwrap();
        let expected = NO_DATA.iter().find(|(file, _)| *file == name);
        match (read(path, &corpus), expected) {
            (Ok((asset, geometries)), None) => {
                geometries.iter().for_each(check_arrays);
                let found: usize = geometries.iter().map(|g| g.mesh.triangles.len()).sum();
                let over: Vec<_> = geometries.iter().flat_map(|g| &g.passed_over).map(|p| p.why.as_str()).collect();
                println!("{name}: {found} triangles, passed over: {over:?}");
                for warning in asset.warnings.iter().chain(geometries.iter().flat_map(|g| &g.warnings)) {
                    println!("    {warning}");
                }
                triangles += found;
                files += 1;
            }
            (Err(error), Some((_, fragment))) => assert!(error.to_string().contains(fragment), "{error}"),
            (Ok(_), Some(_)) => panic!("{name} was read"),
            (Err(error), None) => panic!("{error}"),
        }
    }
    println!("{files} files, {triangles} triangles");
    assert!(files > 0);
}

#[test]
fn every_invalid_file_gives_its_error() {
    let Some(corpus) = corpus() else { return };
    let paths = find_assets(&corpus.join("invalid"));
    assert_eq!(paths.len(), INVALID.len());
    for path in paths {
        let name = path.file_name().unwrap().to_str().unwrap();
        let (_, expected) = INVALID.iter().find(|(file, _)| *file == name).expect(name);
        match (read(&path, &corpus), expected) {
            (Ok((asset, geometries)), None) => {
                for warning in asset.warnings.iter().chain(geometries.iter().flat_map(|g| &g.warnings)) {
                    println!("{warning}");
                }
            }
            (Err(error), Some(fragment)) => {
                println!("{error}");
                assert!(error.to_string().contains(fragment), "{error}");
                assert!(error.file.is_some());
            }
            (result, _) => panic!("{name}: {:?}", result.map(|_| "was read")),
        }
    }
}
