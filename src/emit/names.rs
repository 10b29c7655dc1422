//! Names of new nodes and meshes: by the preset's pattern, each once.

use serde_json::Value;
use std::collections::{HashMap, HashSet};

/// The names that nodes (or meshes) have already.
pub(super) struct Names<'a> {
    pattern: &'a str,
    taken: HashSet<String>,
    /// The last number tried for a name, since thousands of nodes may have the same one.
    numbers: HashMap<String, u32>,
}

impl<'a> Names<'a> {
    /// `pattern` has `{name}` and `{level}` in it.
    pub fn new(pattern: &'a str, existing: &[Value]) -> Self {
        let taken = existing.iter().filter_map(|object| object.get("name")?.as_str()).map(str::to_owned).collect();
        Self { pattern, taken, numbers: HashMap::new() }
    }

    /// The name of `level` (0 is the source) of what is called `name`.
    pub fn level(&mut self, name: &str, level: usize) -> String {
        // The level first: a name may contain braces of its own.
        self.unique(&self.pattern.replace("{level}", &level.to_string()).replace("{name}", name))
    }

    /// `wanted`, or the first of `wanted_2`, `wanted_3`, … that is free.
    pub fn unique(&mut self, wanted: &str) -> String {
        let number = self.numbers.entry(wanted.to_owned()).or_insert(0);
        loop {
            *number += 1;
            let name = if *number == 1 { wanted.to_owned() } else { format!("{wanted}_{number}") };
            if self.taken.insert(name.clone()) {
                return name;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn names_follow_the_pattern_and_stay_unique() {
        let existing = [json!({"name": "chair_LOD1"}), json!({})];
        let mut names = Names::new("{name}_LOD{level}", &existing);
        assert_eq!(names.level("chair", 1), "chair_LOD1_2");
        assert_eq!(names.level("chair", 1), "chair_LOD1_3");
        assert_eq!(names.level("{level}", 2), "{level}_LOD2");
    }
}
