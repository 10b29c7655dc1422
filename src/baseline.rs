//! meshoptimizer at the same triangle count: what every level of ours is compared with.
//!
//! The whole mesh goes in as one index buffer, so that group borders are seams and stay closed. Vertices that are
//! equal in everything are merged first, as the library's manual asks: otherwise it takes each of them for a seam.

use crate::error::{Error, Kind, Result};
use crate::measure::{Ruler, Sampling};
use crate::mesh::{Mesh, Semantic};
pub use crate::meshoptimizer::BareCalls;
use crate::meshoptimizer::{self, Flags, Input, MAX_ATTRIBUTES};
use glam::{DVec2, DVec3, Vec3};

/// How often a run that ended below its target is repeated.
const RETRIES: usize = 4;

/// meshoptimizer's result for one target.
#[derive(Debug, Clone)]
pub struct Baseline {
    /// The simplified mesh.
    pub mesh: Mesh,
    /// The settings that gave it, e.g. `attributes` or `attributes+permissive+prune`: [`Settings::name`].
    pub settings: String,
    /// Whether the triangle target was met (within 1 % + 2 triangles).
    pub reached: bool,
}

/// How to run meshoptimizer. The default is its plainest mode.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Settings {
    /// Normals, colours and texture coordinates count, not only positions. Without any of them in the mesh: no effect.
    pub attributes: bool,
    /// Edges may collapse across seams, but not across group borders.
    pub permissive: bool,
    /// Small disconnected parts may vanish.
    pub prune: bool,
    /// Open borders stay as they are.
    pub lock_border: bool,
    /// Vertices move and attributes change for the best fit, instead of a choice among the source's vertices.
    pub update: bool,
}

impl Settings {
    /// What the settings are called in reports: what is on, joined by `+`; `plain` if nothing is.
    pub fn name(self) -> String {
        let parts = [
            (self.attributes, "attributes"),
            (self.permissive, "permissive"),
            (self.prune, "prune"),
            (self.lock_border, "lock-border"),
            (self.update, "update"),
        ];
        let on: Vec<&str> = parts.into_iter().filter_map(|(on, name)| on.then_some(name)).collect();
        if on.is_empty() { "plain".to_owned() } else { on.join("+") }
    }

    fn flags(self) -> Flags {
        let flag = |on: bool, flag: Flags| if on { flag } else { Flags::None };
        flag(self.permissive, Flags::Permissive)
            | flag(self.prune, Flags::Prune)
            | flag(self.lock_border, Flags::LockBorder)
    }
}

/// Simplifies the whole of `mesh` (all groups as one index buffer, so that group borders are seams) to `triangles` by
/// meshoptimizer's best comparable settings: see [`simplify_by`].
///
/// # Errors
/// [`Kind::Malformed`] when an index of `mesh` is out of range, an array has the wrong length or a number is not
/// finite.
pub fn simplify(mesh: &Mesh, triangles: usize) -> Result<Baseline> {
    check_mesh(mesh)?;
    simplify_by(mesh, triangles, &Ruler::new(mesh, Sampling::for_triangles(triangles)), false)
}

/// [`simplify`] with a ruler at hand, made for `mesh`; with `lock_border` under the rule that open borders stay.
///
/// Attributes are always on. Runs with and without `permissive`, with and without `update`; if none of the four meets
/// the target, `permissive+prune` as well, with and without `update`. Among those that meet it, the one with the
/// smallest two-sided RMS distance wins; if none does, the one that comes closest.
///
/// # Errors
/// As [`simplify`].
pub fn simplify_by(mesh: &Mesh, triangles: usize, ruler: &Ruler, lock_border: bool) -> Result<Baseline> {
    let prepared = Prepared::new(mesh)?;
    let base = Settings { attributes: !prepared.weights.is_empty(), lock_border, ..Settings::default() };
    let permissive = Settings { permissive: true, ..base };
    let mut found = Vec::new();
    for stage in [&[base, permissive][..], &[Settings { prune: true, ..permissive }]] {
        for &settings in stage {
            for update in [false, true] {
                let baseline = prepared.run(triangles, Settings { update, ..settings })?;
                if !found.iter().any(|other: &Baseline| other.mesh == baseline.mesh) {
                    found.push(baseline);
                }
            }
        }
        if found.iter().any(|baseline| baseline.reached) {
            break;
        }
    }
    let best_miss = found.iter().map(|b| miss(b, triangles)).min().unwrap_or(0);
    found.retain(|b| if best_miss == 0 { b.reached } else { miss(b, triangles) == best_miss });
    if found.len() > 1 {
        let rms: Vec<f64> = found.iter().map(|b| ruler.rough_rms(&b.mesh)).collect();
        let best = (0..found.len()).min_by(|&a, &b| rms[a].total_cmp(&rms[b])).unwrap_or(0);
        found.swap(0, best);
    }
    found.into_iter().next().ok_or_else(|| Error::new(Kind::Internal, "no settings were tried"))
}

/// Simplifies `mesh` to `triangles` by these settings alone. Give it the level before instead of the source for a
/// chain.
///
/// # Errors
/// As [`simplify`].
pub fn simplify_with(mesh: &Mesh, triangles: usize, settings: Settings) -> Result<Baseline> {
    Prepared::new(mesh)?.run(triangles, settings)
}

/// Triangles that a result is away from the target; 0 if it counts as met. Worse than any other: nothing left at all,
/// as pruning may do.
fn miss(baseline: &Baseline, target: usize) -> usize {
    match baseline.mesh.triangles.len() {
        _ if baseline.reached => 0,
        0 => usize::MAX,
        found => found.abs_diff(target),
    }
}

fn is_met(found: usize, target: usize) -> bool {
    found.abs_diff(target) <= target / 100 + 2
}

/// A mesh as the library wants it, to be simplified more than once.
pub struct Prepared {
    mesh: Mesh,
    /// The group of each vertex.
    groups: Vec<u32>,
    /// Whether the position of each vertex belongs to several groups.
    protected: Vec<bool>,
    channels: Vec<Channel>,
    /// The channels' values, vertex by vertex, and their weights.
    values: Vec<f32>,
    weights: Vec<f32>,
}

/// An attribute that counts: its place in [`Mesh::attributes`], and the numbers of it that count.
struct Channel {
    attribute: usize,
    width: usize,
}

impl Prepared {
    /// Merges equal vertices, separates groups and weighs attributes.
    ///
    /// # Errors
    /// As [`simplify`].
    pub fn new(mesh: &Mesh) -> Result<Self> {
        check_mesh(mesh)?;
        let mut mesh = merge_equal_vertices(&separate_groups(mesh));
        mesh.attributes.retain(|attribute| !matches!(attribute.semantic, Semantic::Pose(_)));
        let groups = find_vertex_groups(&mesh);
        let (channels, weights) = weigh_attributes(&mesh);
        let mut values = Vec::with_capacity(mesh.positions.len() * weights.len());
        for vertex in 0..mesh.positions.len() {
            for channel in &channels {
                let attribute = &mesh.attributes[channel.attribute];
                values.extend(&attribute.values[vertex * attribute.width..][..channel.width]);
            }
        }
        let protected = find_group_borders(&mesh, &groups);
        Ok(Self { mesh, groups, protected, channels, values, weights })
    }

    /// Whether the mesh has attributes that count: without, [`Settings::attributes`] has no effect.
    pub fn has_attributes(&self) -> bool {
        !self.weights.is_empty()
    }

    /// The library's calls with these settings and nothing around them: for timing.
    ///
    /// # Errors
    /// As [`simplify`].
    pub fn bare_calls(&self, settings: Settings) -> Result<BareCalls<'_>> {
        BareCalls::new(self.input(settings), settings.flags(), settings.update)
    }

    fn input(&self, settings: Settings) -> Input<'_> {
        let (attributes, weights) =
            if settings.attributes { (&*self.values, &*self.weights) } else { Default::default() };
        Input {
            positions: &self.mesh.positions,
            triangles: &self.mesh.triangles,
            attributes,
            weights,
            protected: &self.protected,
        }
    }

    /// Simplifies to `target` triangles.
    ///
    /// One step of the library can take many triangles, so that it ends below the target: then what to ask for is
    /// bisected, and the result that comes closest from below counts.
    ///
    /// # Errors
    /// As [`simplify`].
    pub fn run(&self, target: usize, settings: Settings) -> Result<Baseline> {
        let target = target.min(self.mesh.triangles.len());
        let mut best = self.run_once(target, target, settings)?;
        let (mut enough, mut limit) = (target, 2 * target - best.mesh.triangles.len().min(target));
        for _ in 0..RETRIES {
            let found = best.mesh.triangles.len();
            if best.reached || found == 0 || enough >= limit {
                break;
            }
            let wanted = (enough + limit).div_ceil(2);
            let other = self.run_once(wanted, target, settings)?;
            if other.mesh.triangles.len() > target {
                limit = wanted - 1;
                continue;
            }
            enough = wanted;
            if other.mesh.triangles.len() > found {
                best = other;
            }
        }
        Ok(best)
    }

    fn run_once(&self, wanted: usize, target: usize, settings: Settings) -> Result<Baseline> {
        let input = self.input(settings);
        let flags = settings.flags();
        let mesh = if settings.update {
            let updated = meshoptimizer::simplify_with_update(&input, wanted, flags)?;
            let mut source = Mesh { positions: updated.positions, ..self.mesh.clone() };
            self.store_values(&mut source, &updated.attributes, input.weights.len());
            extract(&source, updated.triangles, &self.groups)
        } else {
            extract(&self.mesh, meshoptimizer::simplify(&input, wanted, flags)?, &self.groups)
        };
        let reached = is_met(mesh.triangles.len(), target);
        Ok(Baseline { mesh, settings: settings.name(), reached })
    }

    /// Puts the `width` values of each vertex back into the attributes they came from.
    fn store_values(&self, mesh: &mut Mesh, values: &[f32], width: usize) {
        let mut start = 0;
        for channel in self.channels.iter().take_while(|_| width > 0) {
            let attribute = &mut mesh.attributes[channel.attribute];
            for (old, new) in attribute.values.chunks_exact_mut(attribute.width).zip(values.chunks_exact(width)) {
                old[..channel.width].copy_from_slice(&new[start..start + channel.width]);
                if attribute.semantic == Semantic::Normal {
                    let unit = Vec3::from_slice(old).normalize_or_zero();
                    old[..3].copy_from_slice(&unit.to_array());
                }
            }
            start += channel.width;
        }
    }
}

/// The attributes that count, with meshoptimizer's own proportions (its `gltfpack` gives normals 0.5 and colours 1,
/// where 1 is a position error as large as the mesh). Texture coordinates: a slip costs what the same distance on the
/// surface would.
fn weigh_attributes(mesh: &Mesh) -> (Vec<Channel>, Vec<f32>) {
    let mut channels = Vec::new();
    let mut weights = Vec::new();
    for (index, attribute) in mesh.attributes.iter().enumerate() {
        let (width, weight) = match attribute.semantic {
            Semantic::Normal => (3, 0.5),
            Semantic::Color(_) => (attribute.width, 1.0),
            Semantic::TexCoord(_) if attribute.width == 2 => (2, weigh_tex_coords(mesh, &attribute.values)),
            _ => continue,
        };
        if width <= attribute.width && weight > 0.0 && weights.len() + width <= MAX_ATTRIBUTES {
            channels.push(Channel { attribute: index, width });
            weights.extend(std::iter::repeat_n(weight, width));
        }
    }
    (channels, weights)
}

/// Surface length, as a share of the mesh's extent, of a unit of UV; 0 where there is no UV area.
fn weigh_tex_coords(mesh: &Mesh, values: &[f32]) -> f32 {
    let position = |v: u32| DVec3::from(mesh.positions[v as usize].map(f64::from));
    let tex_coord = |v: u32| DVec2::from([0, 1].map(|i| f64::from(values[v as usize * 2 + i])));
    let (mut surface, mut chart) = (0.0, 0.0);
    for t in &mesh.triangles {
        let [a, b, c] = t.map(position);
        surface += (b - a).cross(c - a).length();
        let [a, b, c] = t.map(tex_coord);
        chart += (b - a).perp_dot(c - a).abs();
    }
    let (lo, hi) = mesh.bounds();
    let extent = f64::from((hi - lo).max_element());
    let weight = (surface / chart).sqrt() / extent;
    if weight.is_finite() { weight as f32 } else { 0.0 }
}

/// The triangles with the vertices they use. A triangle that got vertices of several groups goes to the commonest,
/// with copies of the others.
fn extract(mesh: &Mesh, mut triangles: Vec<[u32; 3]>, vertex_groups: &[u32]) -> Mesh {
    let group = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| vertex_groups[v as usize]);
        if b == c { b } else { a }
    };
    let groups = if mesh.groups.is_empty() { Vec::new() } else { triangles.iter().map(group).collect() };
    let old = meshoptimizer::renumber_by_use(&mut triangles, mesh.positions.len());
    separate_groups(&Mesh { triangles, groups, ..gather_vertices(mesh, &old) })
}

/// Gives each group its own copy of the vertices that several groups share.
fn separate_groups(mesh: &Mesh) -> Mesh {
    if mesh.groups.is_empty() {
        return mesh.clone();
    }
    let mut uses: Vec<(u32, u32, u32)> = mesh
        .triangles
        .as_flattened()
        .iter()
        .enumerate()
        .map(|(corner, &v)| (v, mesh.groups[corner / 3], corner as u32))
        .collect();
    uses.sort_unstable();
    let mut old: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    let mut triangles = mesh.triangles.clone();
    for of_vertex in uses.chunk_by(|a, b| a.0 == b.0) {
        for of_group in of_vertex.chunk_by(|a, b| a.1 == b.1).skip(1) {
            of_group.iter().for_each(|&(.., corner)| triangles.as_flattened_mut()[corner as usize] = old.len() as u32);
            old.push(of_group[0].0);
        }
    }
    Mesh { triangles, groups: mesh.groups.clone(), ..gather_vertices(mesh, &old) }
}

/// Makes one of all vertices that are equal in every array and group; drops unused ones.
fn merge_equal_vertices(mesh: &Mesh) -> Mesh {
    let groups = find_vertex_groups(mesh);
    let words = |v: usize| {
        let mut words = vec![groups[v]];
        let mut add = |values: &[f32], width: usize| {
            words.extend(values[v * width..][..width].iter().map(|x| (x + 0.0).to_bits()))
        };
        add(mesh.positions.as_flattened(), 3);
        mesh.attributes.iter().for_each(|a| add(&a.values, a.width));
        if let Some(skin) = &mesh.skin {
            add(&skin.weights, skin.influences);
            words.extend(skin.joints[v * skin.influences..][..skin.influences].iter().map(|&j| u32::from(j)));
        }
        words
    };
    let keys: Vec<Vec<u32>> = (0..mesh.positions.len()).map(words).collect();
    let mut order: Vec<u32> = (0..keys.len() as u32).collect();
    order.sort_unstable_by(|&a, &b| keys[a as usize].cmp(&keys[b as usize]).then(a.cmp(&b)));
    let mut first = vec![0; keys.len()];
    for equal in order.chunk_by(|&a, &b| keys[a as usize] == keys[b as usize]) {
        equal.iter().for_each(|&v| first[v as usize] = equal[0]);
    }
    let mut triangles: Vec<_> = mesh.triangles.iter().map(|t| t.map(|v| first[v as usize])).collect();
    let old = meshoptimizer::renumber_by_use(&mut triangles, keys.len());
    Mesh { triangles, groups: mesh.groups.clone(), ..gather_vertices(mesh, &old) }
}

/// The vertex arrays of a mesh whose vertex `i` is `old[i]` of this one; no triangles.
fn gather_vertices(mesh: &Mesh, old: &[u32]) -> Mesh {
    let mut gathered =
        Mesh { positions: gather(mesh.positions.as_flattened(), 3, old).as_chunks().0.to_vec(), ..Mesh::default() };
    gathered.attributes.clone_from(&mesh.attributes);
    for attribute in &mut gathered.attributes {
        attribute.values = gather(&attribute.values, attribute.width, old);
    }
    gathered.skin.clone_from(&mesh.skin);
    if let Some(skin) = &mut gathered.skin {
        skin.joints = gather(&skin.joints, skin.influences, old);
        skin.weights = gather(&skin.weights, skin.influences, old);
    }
    gathered
}

fn gather<T: Copy>(values: &[T], width: usize, old: &[u32]) -> Vec<T> {
    old.iter().flat_map(|&v| &values[v as usize * width..][..width]).copied().collect()
}

fn find_vertex_groups(mesh: &Mesh) -> Vec<u32> {
    let mut groups = vec![0; mesh.positions.len()];
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        triangle.iter().for_each(|&v| groups[v as usize] = mesh.group(t));
    }
    groups
}

/// Vertices whose position belongs to more than one group.
fn find_group_borders(mesh: &Mesh, groups: &[u32]) -> Vec<bool> {
    let key = |v: u32| mesh.positions[v as usize].map(|x| (x + 0.0).to_bits());
    let mut order: Vec<u32> = (0..groups.len() as u32).collect();
    order.sort_unstable_by_key(|&v| (key(v), v));
    let mut border = vec![false; groups.len()];
    for same in order.chunk_by(|&a, &b| key(a) == key(b)) {
        let mixed = same.iter().any(|&v| groups[v as usize] != groups[same[0] as usize]);
        same.iter().for_each(|&v| border[v as usize] = mixed);
    }
    border
}

fn check_mesh(mesh: &Mesh) -> Result<()> {
    let vertices = mesh.positions.len();
    let expect = |what: &str, found: usize, width: usize, count: usize| {
        if Some(found) == count.checked_mul(width) {
            return Ok(());
        }
        Err(Error::new(Kind::Malformed, format!("{what} has {found} values, expected {width} for each of {count}")))
    };
    for attribute in &mesh.attributes {
        expect(&format!("attribute {:?}", attribute.semantic), attribute.values.len(), attribute.width, vertices)?;
    }
    if let Some(skin) = &mesh.skin {
        expect("skin.joints", skin.joints.len(), skin.influences, vertices)?;
        expect("skin.weights", skin.weights.len(), skin.influences, vertices)?;
    }
    if !mesh.groups.is_empty() {
        expect("groups", mesh.groups.len(), 1, mesh.triangles.len())?;
    }
    if let Some(vertex) = mesh.positions.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
        return Err(Error::new(Kind::Malformed, format!("the position of vertex {vertex} is not finite")));
    }
    match mesh.triangles.iter().position(|t| t.iter().any(|&v| v as usize >= vertices)) {
        Some(t) => Err(Error::new(
            Kind::Malformed,
            format!("triangle {t} has the vertices {:?}, but there are {vertices}", mesh.triangles[t]),
        )),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Attribute;

    const SAMPLING: Sampling = Sampling { samples: 2_000, seed: 1 };

    /// A latitude-longitude sphere of 4 n (n − 1) triangles, no vertex shared. Only `faceted` gives its corners
    /// different normals.
    fn sphere(n: u32, faceted: bool) -> Mesh {
        let at = |ring: u32, segment: u32| {
            let polar = std::f32::consts::PI * ring as f32 / n as f32;
            let azimuth = std::f32::consts::PI * (segment % (2 * n)) as f32 / n as f32;
            let radius = if ring == 0 || ring == n { 0.0 } else { polar.sin() };
            Vec3::new(radius * azimuth.cos(), radius * azimuth.sin(), polar.cos())
        };
        let mut mesh = Mesh::default();
        let mut normals = Vec::new();
        for (ring, segment) in (0..n).flat_map(|ring| (0..2 * n).map(move |segment| (ring, segment))) {
            let quad = [at(ring, segment), at(ring + 1, segment), at(ring + 1, segment + 1), at(ring, segment + 1)];
            let halves = [(ring + 1 < n, [0, 1, 2]), (ring > 0, [0, 2, 3])];
            for (_, triangle) in halves.into_iter().filter(|(there, _)| *there) {
                let first = mesh.positions.len() as u32;
                let corners = triangle.map(|i| quad[i]);
                let flat = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
                mesh.positions.extend(corners.map(|p| p.to_array()));
                normals.extend(corners.iter().flat_map(|&p| if faceted { flat } else { p }.to_array()));
                mesh.triangles.push([first, first + 1, first + 2]);
            }
        }
        mesh.attributes.push(Attribute { semantic: Semantic::Normal, width: 3, values: normals });
        mesh
    }

    fn check(mesh: &Mesh) {
        check_mesh(mesh).unwrap();
        assert_eq!(merge_equal_vertices(mesh).triangles.len(), mesh.triangles.len());
        let used: std::collections::BTreeSet<u32> = mesh.triangles.iter().flatten().copied().collect();
        assert_eq!(used.len(), mesh.positions.len());
    }

    #[test]
    fn a_smooth_sphere_meets_every_target() {
        let mesh = sphere(20, false);
        for target in [760, 380, 100, 20] {
            let baseline = simplify(&mesh, target).unwrap();
            assert!(baseline.reached && baseline.mesh.triangles.len() <= target, "{}", baseline.mesh.triangles.len());
            assert!(baseline.settings.starts_with("attributes"));
            check(&baseline.mesh);
        }
    }

    /// Every edge is a seam: only `permissive` gets anywhere.
    #[test]
    fn a_faceted_sphere_needs_permissive() {
        let mesh = sphere(12, true);
        let attributes = Settings { attributes: true, ..Settings::default() };
        assert!(!simplify_with(&mesh, 130, attributes).unwrap().reached);
        let baseline = simplify(&mesh, 130).unwrap();
        assert!(baseline.reached && baseline.settings.contains("permissive"), "{}", baseline.settings);
        assert_eq!(Ruler::new(&mesh, SAMPLING).measure(&baseline.mesh).gap_edges, 0);
        check(&baseline.mesh);
    }

    #[test]
    fn the_best_is_not_worse_than_any_that_was_tried() {
        let mesh = sphere(16, false);
        let ruler = Ruler::new(&mesh, SAMPLING);
        let best = ruler.measure(&simplify_by(&mesh, 120, &ruler, false).unwrap().mesh).rms();
        for (permissive, update) in [(false, false), (false, true), (true, false), (true, true)] {
            let settings = Settings { attributes: true, permissive, update, ..Settings::default() };
            let other = simplify_with(&mesh, 120, settings).unwrap();
            assert!(best <= ruler.measure(&other.mesh).rms(), "{}", other.settings);
        }
    }

    /// Every triangle is a group of its own: no vertex may leave its place.
    /// The calls that are timed are those that are measured.
    #[test]
    fn bare_calls_do_what_the_others_do() {
        let prepared = Prepared::new(&sphere(16, false)).unwrap();
        for (attributes, permissive, update) in
            [(false, false, false), (false, false, true), (true, false, false), (true, true, false), (true, true, true)]
        {
            let settings = Settings { attributes, permissive, update, ..Settings::default() };
            let calls = prepared.bare_calls(settings).unwrap();
            for target in [480, 240, 60] {
                let found = prepared.run_once(target, target, settings).unwrap().mesh.triangles.len();
                assert_eq!(calls.run_chain(&[target]), found, "{}", settings.name());
            }
            assert_eq!(calls.run_chain(&[]), 960);
            assert!((40..=60).contains(&calls.run_chain(&[480, 240, 60])), "{}", settings.name());
        }
    }

    #[test]
    fn an_impossible_target_is_reported() {
        let mesh = sphere(8, true);
        let mesh = Mesh { groups: (0..mesh.triangles.len() as u32).collect(), ..mesh };
        let baseline = simplify(&mesh, 50).unwrap();
        assert!(!baseline.reached && baseline.mesh.triangles.len() > 50, "{}", baseline.mesh.triangles.len());
    }

    /// The two halves of a sphere, one group each, vertices shared on the way in.
    #[test]
    fn groups_stay_apart_and_closed() {
        let mut mesh = sphere(16, false);
        mesh.groups = mesh.triangles.iter().map(|t| u32::from(mesh.positions[t[0] as usize][0] > 0.1)).collect();
        let mesh = Mesh { groups: mesh.groups.clone(), ..merge_equal_vertices(&Mesh { groups: Vec::new(), ..mesh }) };
        for permissive in [false, true] {
            for update in [false, true] {
                let settings = Settings { attributes: true, permissive, update, ..Settings::default() };
                let result = simplify_with(&mesh, 200, settings).unwrap().mesh;
                check(&result);
                for (t, triangle) in result.triangles.iter().enumerate() {
                    let groups = find_vertex_groups(&result);
                    assert!(triangle.iter().all(|&v| groups[v as usize] == result.group(t)));
                }
                assert!(result.groups.contains(&0) && result.groups.contains(&1));
                assert_eq!(Ruler::new(&mesh, SAMPLING).measure(&result).gap_edges, 0);
            }
        }
    }

    #[test]
    fn vertices_that_groups_share_are_copied() {
        let mesh = Mesh {
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]],
            triangles: vec![[0, 1, 2], [2, 1, 3]],
            groups: vec![4, 7],
            ..Mesh::default()
        };
        let apart = separate_groups(&mesh);
        assert_eq!(apart.positions.len(), 6);
        assert_eq!(apart.triangles, [[0, 1, 2], [5, 4, 3]]);
        assert_eq!(apart.positions[5], mesh.positions[2]);
    }

    #[test]
    fn malformed_meshes_are_refused() {
        let good = sphere(4, false);
        let mut bad = good.clone();
        bad.triangles[3][1] = 9999;
        assert_eq!(simplify(&bad, 10).unwrap_err().kind, Kind::Malformed);
        let mut bad = good.clone();
        bad.attributes[0].values.pop();
        assert_eq!(simplify(&bad, 10).unwrap_err().kind, Kind::Malformed);
        let bad = Mesh { groups: vec![0; 3], ..good.clone() };
        assert_eq!(simplify(&bad, 10).unwrap_err().kind, Kind::Malformed);
        let mut bad = good;
        bad.positions[2][0] = f32::NAN;
        assert_eq!(simplify(&bad, 10).unwrap_err().kind, Kind::Malformed);
    }
}
