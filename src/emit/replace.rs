//! Other triangles for a mesh: accessors and buffer views that only the old ones used take the new ones, so that no index changes
//! and no dead data stays behind.

use super::accessors::EncodedLevel;
use super::progressive::{accessors_by_user, index_at, views_of_accessor};
use crate::asset::Document;
use serde_json::{Map, Value};
use std::collections::BTreeSet;

/// A mesh and what its triangle primitives get; every one of them gets something.
pub(super) struct Replacement<'a> {
    pub mesh: usize,
    pub level: &'a EncodedLevel,
}

/// Buffer views of a document in which triangles were replaced.
#[derive(Debug, Default)]
pub(super) struct Views {
    /// Those of each replacement, still without a place in a buffer.
    pub new: Vec<Vec<usize>>,
    /// Those that nothing names any more.
    pub free: BTreeSet<usize>,
}

impl Views {
    /// A buffer view for new data: one that is free, otherwise a new one.
    pub fn take(&mut self, document: &mut Document) -> usize {
        self.free.pop_first().unwrap_or_else(|| document.push("bufferViews", Value::Null))
    }
}

/// Puts the replacements into the document. `released` are buffer views whose users are gone already.
pub(super) fn replace_triangles(
    document: &mut Document,
    replacements: &[Replacement<'_>],
    released: BTreeSet<usize>,
) -> Views {
    let replaced: BTreeSet<(usize, usize)> =
        replacements.iter().flat_map(|r| r.level.primitives.iter().map(|p| (r.mesh, p.source))).collect();
    let (old, others) = accessors_by_user(document, |mesh, primitive, _| replaced.contains(&(mesh, primitive)));
    let mut slots = Slots { free: &old - &others, released, filled: Vec::new() };
    for (number, replacement) in replacements.iter().enumerate() {
        slots.fill_mesh(document, number, replacement);
    }
    let named = named_views(document.root());
    let mut views = Views { new: Vec::new(), free: &slots.released - &named };
    for replacement in replacements {
        let new = replacement.level.views.iter().map(|_| views.take(document)).collect();
        views.new.push(new);
    }
    for (accessor, number, view) in slots.filled {
        document.set(&format!("/accessors/{accessor}"), "bufferView", views.new[number][view].into());
    }
    views
}

/// The places in primitives that name accessors.
struct Slots {
    /// Accessors that only replaced triangles use, and no slot has taken yet.
    free: BTreeSet<usize>,
    /// Buffer views of overwritten accessors.
    released: BTreeSet<usize>,
    /// Accessors with new content: which, of which replacement, in which of its views.
    filled: Vec<(usize, usize, usize)>,
}

impl Slots {
    fn fill_mesh(&mut self, document: &mut Document, number: usize, replacement: &Replacement<'_>) {
        let accessors = &replacement.level.accessors;
        for draft in &replacement.level.primitives {
            let place = format!("/meshes/{}/primitives/{}", replacement.mesh, draft.source);
            let attributes =
                draft.attributes.iter().map(|(name, a)| (format!("{place}/attributes"), name.as_str(), *a));
            let targets = draft.targets.iter().enumerate().flat_map(|(t, list)| {
                let place = format!("{place}/targets/{t}");
                list.iter().map(move |(name, a)| (place.clone(), name.as_str(), *a))
            });
            let indices = std::iter::once((place.clone(), "indices", draft.indices));
            for (object, slot, accessor) in attributes.chain(targets).chain(indices) {
                let index = self.fill(document, &object, slot, &accessors[accessor].json);
                self.filled.push((index, number, accessors[accessor].view));
            }
            if document.root().pointer(&place).is_some_and(|p| p.get("mode").is_some_and(|mode| mode != 4)) {
                document.set(&place, "mode", 4.into());
            }
        }
    }

    fn fill(&mut self, document: &mut Document, object: &str, slot: &str, content: &Map<String, Value>) -> usize {
        let old = document.root().pointer(object).and_then(|o| index_at(o, &format!("/{slot}")));
        let Some(index) = old.filter(|index| self.free.remove(index)) else {
            let index = document.push("accessors", content.clone().into());
            document.set(object, slot, index.into());
            return index;
        };
        let before = &document.array("accessors")[index];
        self.released.extend(views_of_accessor(before));
        let kept = ["name", "extras"].map(|member| Some((member.to_owned(), before.get(member)?.clone())));
        let accessor: Map<String, Value> = content.clone().into_iter().chain(kept.into_iter().flatten()).collect();
        document.replace(&format!("/accessors/{index}"), accessor.into());
        index
    }
}

/// All numbers that stand under the name `bufferView`, also in extensions.
fn named_views(value: &Value) -> BTreeSet<usize> {
    match value {
        Value::Object(object) => {
            let own = index_at(value, "/bufferView");
            own.into_iter().chain(object.values().flat_map(named_views)).collect()
        }
        Value::Array(array) => array.iter().flat_map(named_views).collect(),
        _ => BTreeSet::new(),
    }
}
