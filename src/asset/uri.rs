//! URIs of a document: `data:` payloads, and relative references that stay inside the input directory.

use crate::error::{Error, Result};
use base64::engine::general_purpose::GeneralPurpose;
use base64::engine::{DecodePaddingMode, Engine, GeneralPurposeConfig};
use std::path::{Component, Path, PathBuf};

/// Exporters disagree about padding, and every loader reads all of them.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &base64::alphabet::STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true),
);

/// What a URI is.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Uri<'a> {
    /// `data:`; the text after the colon.
    Data(&'a str),
    /// Has any other scheme (`http`, `file`, a drive letter).
    Scheme(&'a str),
    /// A reference to a file beside the asset.
    Relative(&'a str),
}

pub(super) fn parse(uri: &str) -> Uri<'_> {
    let scheme = uri.split_once(':').filter(|(scheme, _)| {
        scheme.starts_with(|c: char| c.is_ascii_alphabetic())
            && scheme.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c))
    });
    match scheme {
        None => Uri::Relative(uri),
        Some((scheme, payload)) if scheme.eq_ignore_ascii_case("data") => Uri::Data(payload),
        Some((scheme, _)) => Uri::Scheme(scheme),
    }
}

/// The bytes of a `data:` URI, given what follows the colon.
pub(super) fn decode_data(payload: &str, place: &str) -> Result<Vec<u8>> {
    let Some((kind, text)) = payload.split_once(',') else {
        return Err(Error::malformed(place, "a data: URI without a comma holds no data"));
    };
    let bytes = percent_encoding::percent_decode_str(text);
    if !kind.trim_end().to_ascii_lowercase().ends_with(";base64") {
        return Ok(bytes.collect());
    }
    let text: std::borrow::Cow<[u8]> = bytes.into();
    BASE64.decode(&*text).map_err(|error| Error::malformed(place, format!("the data: URI is not base64: {error}")))
}

/// The directories that the files of one asset may lie in.
#[derive(Debug)]
pub(super) struct Directories {
    /// The asset's own, as it was named.
    asset: PathBuf,
    /// The same, without symbolic links.
    real: PathBuf,
    /// What files may not leave, without symbolic links: the input directory, and the asset's real directory where
    /// the asset itself is reached through a link (as build systems lay out their sandboxes).
    allowed: Vec<PathBuf>,
}

impl Directories {
    pub fn new(asset: &Path, root: &Path) -> Result<Self> {
        let directory = match asset.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        let root = if root.as_os_str().is_empty() { Path::new(".") } else { root };
        let canonical = |path: &Path| path.canonicalize().map_err(|error| Error::io(path, &error));
        let real = canonical(directory)?;
        let mut allowed = vec![canonical(root)?];
        if let Some(beside) = canonical(asset)?.parent() {
            allowed.push(beside.to_owned());
        }
        Ok(Self { asset: directory.to_owned(), real, allowed })
    }

    /// Where the file of a relative URI is: relative to the asset's directory, and whether it is there.
    /// Real files name their dependencies with `%20` or with spaces, so both readings are tried.
    pub fn resolve(&self, uri: &str, place: &str) -> Result<(PathBuf, bool)> {
        let decoded = percent_encoding::percent_decode_str(uri).decode_utf8();
        let decoded = decoded.map_err(|_| Error::malformed(place, format!("URI {uri:?} is not UTF-8 when decoded")))?;
        let readings = [decoded.to_string(), uri.to_owned(), decoded.replace('\\', "/")];
        let mut first = None;
        for reading in readings {
            // `./a.png` and `a.png` are one file.
            let relative: PathBuf = Path::new(&reading).components().filter(|c| *c != Component::CurDir).collect();
            self.check_inside(&relative, uri, place)?;
            let exists = self.asset.join(&relative).is_file();
            if exists {
                self.check_real(&relative, uri, place)?;
                return Ok((relative, true));
            }
            first.get_or_insert(relative);
        }
        Ok((first.unwrap_or_default(), false))
    }

    /// The path as asked for, before the file system is asked anything.
    fn check_inside(&self, relative: &Path, uri: &str, place: &str) -> Result<()> {
        if uri.is_empty() || uri.contains('\0') || uri.contains("%00") {
            return Err(Error::malformed(place, format!("URI {uri:?} names no file")));
        }
        let mut path = self.real.clone();
        for component in relative.components() {
            match component {
                Component::Normal(name) => path.push(name),
                Component::CurDir => {}
                Component::ParentDir => {
                    path.pop();
                    self.check_allowed(&path, uri, place)?;
                }
                Component::RootDir | Component::Prefix(_) => {
                    return Err(Error::malformed(place, format!("URI {uri:?} is absolute"))
                        .help("name the file relative to the asset"));
                }
            }
        }
        Ok(())
    }

    /// The path as the file system has it, symbolic links followed.
    fn check_real(&self, relative: &Path, uri: &str, place: &str) -> Result<()> {
        let path = self.asset.join(relative);
        let real = path.canonicalize().map_err(|error| Error::io(&path, &error))?;
        self.check_allowed(&real, uri, place)
    }

    fn check_allowed(&self, path: &Path, uri: &str, place: &str) -> Result<()> {
        if self.allowed.iter().any(|allowed| path.starts_with(allowed)) {
            return Ok(());
        }
        Err(Error::malformed(place, format!("URI {uri:?} leaves the input directory"))
            .help("name a directory as input that holds the asset and all its files"))
    }

    /// The path to read a resolved file from.
    pub fn locate(&self, relative: &Path) -> PathBuf {
        self.asset.join(relative)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn schemes_are_told_from_file_names() {
        assert_eq!(parse("data:;base64,AA"), Uri::Data(";base64,AA"));
        assert_eq!(parse("DATA:,x"), Uri::Data(",x"));
        assert_eq!(parse("http://a/b.bin"), Uri::Scheme("http"));
        assert_eq!(parse("C:\\a.bin"), Uri::Scheme("C"));
        assert_eq!(parse("a b:c.bin"), Uri::Relative("a b:c.bin"));
        assert_eq!(parse("../a.bin"), Uri::Relative("../a.bin"));
    }

    #[test]
    fn data_uris_are_decoded_with_and_without_padding() {
        for payload in [";base64,AQID", "application/octet-stream;base64,AQI", ";base64,AQI=", ";base64,AQI%3D"] {
            assert_eq!(decode_data(payload, "").unwrap()[..2], [1, 2], "{payload}");
        }
        assert_eq!(decode_data("text/plain,a%20b", "").unwrap(), b"a b");
        assert!(
            decode_data(";base64,!!", "/p").unwrap_err().to_string().starts_with("/p: the data: URI is not base64")
        );
        assert!(decode_data(";base64", "").is_err());
    }

    #[test]
    fn references_stay_inside_the_root() {
        let outside = tempfile::tempdir().unwrap();
        let root = outside.path().join("root");
        fs::create_dir_all(root.join("models")).unwrap();
        for name in ["root/models/a b.bin", "root/models/c%20d.bin", "root/shared.bin", "secret.bin"] {
            fs::write(outside.path().join(name), "x").unwrap();
        }
        fs::write(root.join("models/m.gltf"), "{}").unwrap();
        let directories = Directories::new(&root.join("models/m.gltf"), &root).unwrap();
        let resolve = |uri: &str| directories.resolve(uri, "/p").map_err(|e| e.to_string());

        assert_eq!(resolve("a%20b.bin").unwrap(), ("a b.bin".into(), true));
        assert_eq!(resolve("./a%20b.bin").unwrap(), ("a b.bin".into(), true));
        assert_eq!(resolve("a b.bin").unwrap(), ("a b.bin".into(), true));
        assert_eq!(resolve("c%20d.bin").unwrap(), ("c%20d.bin".into(), true), "the name as written, too");
        assert_eq!(resolve("../shared.bin").unwrap(), ("../shared.bin".into(), true));
        assert_eq!(resolve("..\\shared.bin").unwrap(), ("../shared.bin".into(), true));
        assert_eq!(resolve("none.bin").unwrap(), ("none.bin".into(), false));
        for uri in ["../../secret.bin", "..%2f../secret.bin", "../../../etc/passwd", "../../none"] {
            assert!(resolve(uri).unwrap_err().contains("leaves the input directory"), "{uri}");
        }
        assert!(resolve("/etc/passwd").unwrap_err().contains("is absolute"));
        assert!(resolve("%ff.bin").unwrap_err().contains("not UTF-8"));
        assert!(resolve("a%00.bin").unwrap_err().contains("names no file"));
        assert!(resolve("").unwrap_err().contains("names no file"));
    }

    #[cfg(unix)]
    #[test]
    fn symbolic_links_do_not_lead_out_unless_the_asset_is_linked_too() {
        use std::os::unix::fs::symlink;
        let outside = tempfile::tempdir().unwrap();
        let (root, store) = (outside.path().join("root"), outside.path().join("store"));
        fs::create_dir_all(&root).unwrap();
        fs::create_dir_all(&store).unwrap();
        for name in ["m.gltf", "m.bin"] {
            fs::write(store.join(name), "x").unwrap();
            symlink(store.join(name), root.join(name)).unwrap();
        }
        let linked = Directories::new(&root.join("m.gltf"), &root).unwrap();
        assert_eq!(linked.resolve("m.bin", "").unwrap(), ("m.bin".into(), true));
        fs::write(root.join("own.gltf"), "x").unwrap();
        let own = Directories::new(&root.join("own.gltf"), &root).unwrap();
        assert!(own.resolve("m.bin", "").unwrap_err().to_string().contains("leaves the input directory"));
    }
}
