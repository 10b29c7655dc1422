//! The checks a mesh must pass before anything indexes into it.

use super::Mesh;
use crate::error::{Error, Kind, Result};

impl Mesh {
    /// Checks lengths, index ranges, finite positions and that no vertex serves two groups.
    ///
    /// # Errors
    /// [`Kind::Malformed`] naming the first array, triangle or vertex that breaks a rule.
    pub fn validate(&self) -> Result<()> {
        let vertices = self.positions.len();
        if u32::try_from(vertices).is_err() || self.triangles.len() >= 1 << 30 {
            return Err(Error::new(Kind::Limit, "more than 2^32 vertices or 2^30 triangles in one mesh"));
        }
        if !self.groups.is_empty() {
            expect_length("groups", self.groups.len(), self.triangles.len())?;
        }
        for (i, attribute) in self.attributes.iter().enumerate() {
            expect_length(&format!("attributes[{i}].values"), attribute.values.len(), vertices * attribute.width)?;
        }
        if let Some(skin) = &self.skin {
            expect_length("skin.joints", skin.joints.len(), vertices * skin.influences)?;
            expect_length("skin.weights", skin.weights.len(), vertices * skin.influences)?;
        }
        if let Some(v) = self.positions.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
            return Err(malformed(format!("position of vertex {v} is not finite: {:?}", self.positions[v])));
        }
        self.validate_triangles()
    }

    fn validate_triangles(&self) -> Result<()> {
        let vertices = self.positions.len();
        if !self.has_groups() && self.triangles.as_flattened().iter().all(|&v| (v as usize) < vertices) {
            return Ok(());
        }
        let mut group_of = vec![u32::MAX; vertices];
        for (t, triangle) in self.triangles.iter().enumerate() {
            for &v in triangle {
                let Some(group) = group_of.get_mut(v as usize) else {
                    return Err(malformed(format!("triangle {t} names vertex {v}, but there are {vertices} vertices")));
                };
                if *group != u32::MAX && *group != self.group(t) {
                    let message = format!("vertex {v} is used by groups {} and {}", *group, self.group(t));
                    return Err(malformed(message).help("give each group vertices of its own"));
                }
                *group = self.group(t);
            }
        }
        Ok(())
    }
}

fn expect_length(what: &str, found: usize, expected: usize) -> Result<()> {
    if found == expected {
        return Ok(());
    }
    Err(malformed(format!("{what} has {found} entries, expected {expected}")))
}

fn malformed(message: String) -> Error {
    Error::new(Kind::Malformed, message)
}
