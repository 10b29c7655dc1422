//! One triangle primitive: its index list as triangles, over those of its vertices that they use.

use super::accessor::{Reader, Select};
use super::geometry::Component;
use crate::error::{Error, Result};

/// What a primitive's mode makes of its indices.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mode {
    List,
    Strip,
    Fan,
}

impl Mode {
    /// `Err` with the plural of what is drawn for points and lines.
    pub fn of(mode: u64) -> Result<Self, &'static str> {
        match mode {
            0 => Err("points"),
            1..=3 => Err("lines"),
            5 => Ok(Self::Strip),
            6 => Ok(Self::Fan),
            _ => Ok(Self::List),
        }
    }

    /// Triangles that `corners` indices make, at most.
    pub fn triangles(self, corners: usize) -> usize {
        match self {
            Self::List => corners / 3,
            Self::Strip | Self::Fan => corners.saturating_sub(2),
        }
    }

    /// The triangles of an index list, all with the winding of the first. Strips and fans lose the triangles that
    /// name a vertex twice: those only steer the strip.
    fn assemble(self, corners: &[u32]) -> Vec<[u32; 3]> {
        match self {
            Self::List => corners.as_chunks::<3>().0.to_vec(),
            Self::Strip => {
                let pairs = corners.windows(3).zip([false, true].into_iter().cycle());
                let triangles = pairs.filter_map(|(w, odd)| match *w {
                    [a, b, c] => Some(if odd { [a, c, b] } else { [a, b, c] }),
                    _ => None,
                });
                triangles.filter(is_proper).collect()
            }
            Self::Fan => {
                let Some((&first, rest)) = corners.split_first() else { return Vec::new() };
                let triangles = rest.windows(2).filter_map(|w| match *w {
                    [a, b] => Some([a, b, first]),
                    _ => None,
                });
                triangles.filter(is_proper).collect()
            }
        }
    }
}

fn is_proper(&[a, b, c]: &[u32; 3]) -> bool {
    a != b && b != c && c != a
}

/// The triangles of a primitive over the vertices they use.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Faces {
    /// Numbered from 0 in the order of the accessors.
    pub triangles: Vec<[u32; 3]>,
    /// The used elements of the primitive's accessors, ascending; `None` when all are.
    pub used: Option<Vec<u32>>,
    /// Vertices: all elements or the used ones.
    pub vertices: usize,
    /// Indices at the end of a list that make no triangle.
    pub left_over: usize,
}

impl Faces {
    pub fn select(&self) -> Select<'_> {
        self.used.as_deref().map_or(Select::All, Select::Only)
    }

    /// The element of the accessors that `vertex` came from.
    pub fn element(&self, vertex: usize) -> usize {
        self.used.as_ref().and_then(|used| used.get(vertex)).map_or(vertex, |&element| element as usize)
    }
}

/// Turns a primitive's indices into [`Faces`]. Keeps its scratch memory from primitive to primitive: hundreds of them
/// may share one large set of accessors.
#[derive(Debug, Default)]
pub(super) struct Assembler {
    /// New number of each element; `UNUSED` outside of a call.
    renumbered: Vec<u32>,
}

const UNUSED: u32 = u32::MAX;

impl Assembler {
    /// The faces of a primitive at `place` with `count` vertices.
    pub fn read(&mut self, mode: Mode, indices: Option<&Reader>, count: usize, place: &str) -> Result<Faces> {
        let mut corners = Vec::new();
        match indices {
            Some(reader) => reader.read_unsigned(Select::All, &mut corners)?,
            None => corners.extend(0..u32::try_from(count).unwrap_or(u32::MAX)),
        }
        if let Some(reader) = indices {
            check_corners(mode, &corners, reader.header.component, count, place)?;
        }
        let left_over = if mode == Mode::List { corners.len() % 3 } else { 0 };
        let triangles = mode.assemble(&corners);
        drop(corners);
        Ok(self.compact(triangles, count, left_over))
    }

    fn compact(&mut self, mut triangles: Vec<[u32; 3]>, count: usize, left_over: usize) -> Faces {
        if self.renumbered.len() < count {
            self.renumbered.resize(count, UNUSED);
        }
        let mut used = Vec::new();
        for &element in triangles.as_flattened() {
            if let Some(slot) = self.renumbered.get_mut(element as usize).filter(|slot| **slot == UNUSED) {
                *slot = 0;
                used.push(element);
            }
        }
        if used.len() == count {
            self.renumbered.iter_mut().take(count).for_each(|slot| *slot = UNUSED);
            return Faces { triangles, used: None, vertices: count, left_over };
        }
        used.sort_unstable();
        for (number, &element) in (0..).zip(&used) {
            if let Some(slot) = self.renumbered.get_mut(element as usize) {
                *slot = number;
            }
        }
        for corner in triangles.as_flattened_mut() {
            *corner = self.renumbered.get(*corner as usize).copied().unwrap_or(UNUSED);
        }
        for &element in &used {
            if let Some(slot) = self.renumbered.get_mut(element as usize) {
                *slot = UNUSED;
            }
        }
        Faces { triangles, vertices: used.len(), used: Some(used), left_over }
    }
}

/// Every index must name a vertex, and none may be the value that restarts a primitive: GPUs drop what follows it.
fn check_corners(mode: Mode, corners: &[u32], component: Component, count: usize, place: &str) -> Result<()> {
    let restart = match component {
        Component::U8 => u32::from(u8::MAX),
        Component::U16 => u32::from(u16::MAX),
        _ => u32::MAX,
    };
    let largest = corners.iter().copied().max().unwrap_or(0);
    if corners.is_empty() || ((largest as usize) < count && largest != restart) {
        return Ok(());
    }
    let wrong = |corner: u32| corner as usize >= count || corner == restart;
    let Some((at, &corner)) = corners.iter().enumerate().find(|(_, corner)| wrong(**corner)) else { return Ok(()) };
    let user = match (mode, corners.chunks(3).nth(at / 3)) {
        (Mode::List, Some(triangle)) => format!("triangle {} {triangle:?}", at / 3),
        _ => format!("index {at}"),
    };
    let place = format!("{place}/indices");
    let error = if corner as usize >= count {
        Error::malformed(place, format!("{user} names vertex {corner}, but there are {count}"))
    } else {
        Error::malformed(place, format!("{user} names vertex {corner}, the value that restarts a primitive"))
    };
    Err(if corner == restart { error.help("glTF has no primitive restart: use a larger index type") } else { error })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_alternate_and_fans_turn_around_the_first() {
        assert_eq!(Mode::List.assemble(&[0, 1, 2, 3, 4]), [[0, 1, 2]]);
        assert_eq!(Mode::Strip.assemble(&[0, 1, 2, 3, 4]), [[0, 1, 2], [1, 3, 2], [2, 3, 4]]);
        assert_eq!(Mode::Fan.assemble(&[0, 1, 2, 3]), [[1, 2, 0], [2, 3, 0]]);
        assert_eq!(Mode::Strip.assemble(&[0, 1]), [[0; 3]; 0]);
        assert_eq!(Mode::Fan.assemble(&[]), [[0; 3]; 0]);
    }

    #[test]
    fn a_stitched_strip_keeps_its_winding_and_loses_the_stitches() {
        let triangles = Mode::Strip.assemble(&[0, 1, 2, 3, 3, 4, 4, 5, 6]);
        assert_eq!(triangles, [[0, 1, 2], [1, 3, 2], [4, 5, 6]]);
    }

    #[test]
    fn only_used_vertices_stay_in_accessor_order() {
        let mut assembler = Assembler::default();
        for _ in 0..2 {
            let faces = assembler.compact(vec![[7, 2, 9], [9, 2, 4]], 10, 0);
            assert_eq!(faces.triangles, [[2, 0, 3], [3, 0, 1]]);
            assert_eq!(faces.used.as_deref(), Some(&[2, 4, 7, 9][..]));
            assert_eq!(faces.element(2), 7);
            let all = assembler.compact(vec![[2, 0, 1]], 3, 0);
            assert_eq!((all.used, all.vertices), (None, 3));
        }
    }

    #[test]
    fn wrong_indices_are_named_with_their_triangle() {
        let check = |mode, corners: &[u32], count| {
            check_corners(mode, corners, Component::U8, count, "/p").map_err(|e| e.to_string())
        };
        assert_eq!(check(Mode::List, &[0, 1, 2], 3), Ok(()));
        assert_eq!(check(Mode::List, &[], 0), Ok(()));
        let corners = [0, 1, 2, 0, 3, 1];
        let message = "/p/indices: triangle 1 [0, 3, 1] names vertex 3, but there are 3";
        assert_eq!(check(Mode::List, &corners, 3).unwrap_err(), message);
        assert_eq!(check(Mode::Fan, &corners, 3).unwrap_err(), "/p/indices: index 4 names vertex 3, but there are 3");
        assert!(check(Mode::List, &[0, 1, 255], 256).unwrap_err().contains("the value that restarts a primitive"));
    }
}
