//! The chain: one run from fine to coarse, a snapshot at each target.

use super::cards::Cards;
use super::deviation::Deviation;
use super::options::{Algorithm, Effort, Mode, Options, Placement, Schedule, Target};
use super::reducer::Reducer;
use super::refine::Refiner;
use super::shading::Shading;
use super::split::{faces_added, long_edges, split_at_midpoints};
use super::{Chain, Level, Refusals, Stop, passes, queue, vertices};
use crate::error::Result;
use crate::mesh::{Mesh, Semantic};

/// Triangles below which an effort takes the nearest of what it makes and what the efforts below it make: that takes no time to speak of.
const SMALL: usize = 5000;
/// Factor on the triangle count between two looks at an error target.
const ERROR_STEP: f64 = 0.93;

/// Simplifies `mesh` to every target of `options`, each level from the one before. Poses among its attributes guide; no level has them. Of meshes below
/// 5000 triangles, efforts above [`Effort::Fast`] make the levels of the efforts below as well and take the nearest to the source of each.
///
/// # Errors
/// [`Kind::Malformed`](crate::Kind::Malformed) when an index is out of range, an array has the wrong length or a position is not finite.
///
/// # Examples
/// ```
/// use gltf_lod::mesh::Mesh;
/// use gltf_lod::simplify::{Options, Target, simplify};
///
/// // A flat grid of 2 × 16 × 16 triangles: two would do.
/// let n = 17u32;
/// let positions = (0..n * n).map(|i| [(i % n) as f32, (i / n) as f32, 0.0]).collect();
/// let corner = |x, y| y * n + x;
/// let triangles = (0..n - 1)
///     .flat_map(|y| (0..n - 1).map(move |x| (x, y)))
///     .flat_map(|(x, y)| {
///         let [a, b, c, d] = [corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y + 1)];
///         [[a, b, c], [a, c, d]]
///     })
///     .collect();
/// let mesh = Mesh { positions, triangles, ..Mesh::default() };
///
/// let options = Options { levels: vec![Target::ratio(0.25), Target::triangles(8)], ..Options::default() };
/// let chain = simplify(&mesh, &options)?;
/// for (level, target) in chain.levels.iter().zip([128, 8]) {
///     assert!(level.mesh.triangles.len().abs_diff(target) <= 1);
/// }
/// # Ok::<(), gltf_lod::Error>(())
/// ```
pub fn simplify(mesh: &Mesh, options: &Options) -> Result<Chain> {
    mesh.validate()?;
    let mut chain = run(mesh, options);
    if is_refined(options) && mesh.triangles.len() < SMALL {
        let efforts = [Effort::Fast, Effort::Default].into_iter().filter(|effort| *effort < options.effort);
        let others = efforts.map(|effort| run(mesh, &Options { effort, ..options.clone() })).collect();
        take_nearest(&mut chain, others, &Deviation::new(mesh), options);
    }
    Ok(chain)
}

/// Of small meshes with few collapses chance has a say in each: takes levels of the `others` that are nearer to the source, where both have met the same
/// target.
fn take_nearest(chain: &mut Chain, others: Vec<Chain>, deviation: &Deviation, options: &Options) {
    let mut distances = vec![None; chain.levels.len()];
    for other in others {
        let levels = chain.levels.iter_mut().zip(other.levels).zip(&options.levels);
        for (((level, other), target), known) in levels.zip(&mut distances) {
            let same_count = level.mesh.triangles.len().abs_diff(other.mesh.triangles.len()) <= 1;
            if target.error.is_some() || level.stop != other.stop || !same_count || level.mesh == other.mesh {
                continue;
            }
            let distance = deviation.of(&other.mesh);
            if distance.is_nearer_than(known.get_or_insert_with(|| deviation.of(&level.mesh))) {
                (*level, *known) = (other, Some(distance));
            }
        }
    }
}

fn run(mesh: &Mesh, options: &Options) -> Chain {
    let mut reducer = Reducer::new(mesh, options);
    let refiner = is_refined(options).then(|| Refiner::new(&reducer.surface, options.effort));
    let is_fitted = options.algorithm == Algorithm::Esqem(Mode::Enhanced) && options.placement == Placement::Optimal;
    let shading = if is_fitted { Shading::new(mesh, &reducer.surface) } else { None };
    let cards = if options.keep_area { Cards::find(&reducer.surface, &reducer.edges) } else { None };
    // On large meshes even these are much.
    if options.placement == Placement::Optimal {
        reducer.surface.wedges.forget_origins();
    }
    if refiner.is_none() && shading.is_none() && cards.is_none() {
        reducer.surface.forget_heirs();
    }
    let workspace = passes::Workspace::default();
    let mut chain = Builder { mesh, options, reducer, workspace, deviation: None, refiner, shading, cards };
    Chain { levels: options.levels.iter().map(|target| chain.next_level(target)).collect() }
}

/// Whether levels are made better after their collapses.
fn is_refined(options: &Options) -> bool {
    options.algorithm == Algorithm::Esqem(Mode::Enhanced)
        && options.placement == Placement::Optimal
        && options.effort > Effort::Fast
}

struct Builder<'a> {
    mesh: &'a Mesh,
    options: &'a Options,
    reducer: Reducer,
    workspace: passes::Workspace,
    /// Built when first asked for.
    deviation: Option<Deviation>,
    refiner: Option<Refiner>,
    shading: Option<Shading<'a>>,
    cards: Option<Cards>,
}

impl Builder<'_> {
    fn next_level(&mut self, target: &Target) -> Level {
        self.reducer.refusals = Refusals::default();
        let least = self.options.min_triangles.clamp(1, self.mesh.triangles.len().max(1));
        let wanted = target.count(self.mesh.triangles.len(), least);
        let (snapshot, mut stop) = match target.error {
            Some(error) => self.reduce_within(error, wanted.max(least)),
            None => self.reduce_with_splits(wanted.max(least)),
        };
        if stop == Stop::Target && wanted < least {
            stop = Stop::Floor;
        }
        let Snapshot { mut mesh, source_vertices } = snapshot;
        mesh.attributes.retain(|attribute| !matches!(attribute.semantic, Semantic::Pose(_)));
        Level { mesh, source_vertices, stop, refusals: self.reducer.refusals }
    }

    /// The surface as it is, with the normals that suit it, and cards that make up for those that are gone.
    fn level_mesh(&self) -> Mesh {
        let surface = &self.reducer.surface;
        let mut mesh = surface.to_mesh();
        if let Some(shading) = &self.shading {
            shading.fit(surface, &mut mesh);
        }
        if let Some(cards) = &self.cards {
            cards.grow(surface, &mut mesh);
        }
        mesh
    }

    /// The surface as it is.
    fn snapshot(&self) -> Snapshot {
        let surface = &self.reducer.surface;
        match self.options.placement {
            Placement::Optimal => self.level_mesh().into(),
            Placement::Subset => {
                let (mesh, vertices) = surface.to_subset(self.mesh);
                Snapshot { mesh, source_vertices: Some(vertices) }
            }
        }
    }

    fn reduce(&mut self, triangles: usize) -> Stop {
        while self.reducer.surface.face_count() > triangles {
            let before = self.reducer.surface.face_count();
            match self.options.schedule {
                Schedule::Passes => passes::run(&mut self.reducer, &mut self.workspace, triangles),
                Schedule::Queue => queue::drain(&mut self.reducer, triangles),
                Schedule::Vertices => vertices::drain(&mut self.reducer, triangles),
            }
            if self.reducer.surface.face_count() == before {
                return Stop::Stuck;
            }
        }
        Stop::Target
    }

    /// Goes down in steps for as long as the measured distance stays below `error`. The step too far stays done: the next level is below it.
    fn reduce_within(&mut self, error: f64, triangles: usize) -> (Snapshot, Stop) {
        let mut kept = self.snapshot();
        loop {
            let count = self.reducer.surface.face_count();
            if count <= triangles {
                return (kept, Stop::Target);
            }
            let next = ((count as f64 * ERROR_STEP) as usize).min(count - 1).max(triangles);
            let stop = self.reduce(next);
            let tried = self.snapshot();
            if self.deviation().of(&tried.mesh).max > error {
                return (kept, Stop::Error);
            }
            kept = tried;
            if stop == Stop::Stuck {
                return (kept, stop);
            }
        }
    }

    fn reduce_with_splits(&mut self, triangles: usize) -> (Snapshot, Stop) {
        if self.options.placement == Placement::Subset {
            let stop = self.reduce(triangles);
            return (self.snapshot(), stop);
        }
        let (mesh, stop) = match (self.options.algorithm, self.options.split_factor) {
            (Algorithm::Esqem(Mode::Paper), Some(factor)) => self.split_as_in_paper(triangles, f64::from(factor)),
            _ if self.refiner.is_some() => self.reduce_and_refine(triangles),
            _ => {
                let stop = self.reduce(triangles);
                (self.level_mesh(), stop)
            }
        };
        (mesh.into(), stop)
    }

    /// Collapses past the target until the long edges' splits pay back exactly what is missing (ESQEM's equal counts).
    fn split_as_in_paper(&mut self, triangles: usize, factor: f64) -> (Mesh, Stop) {
        loop {
            let count = self.reducer.surface.face_count();
            let long = long_edges(&self.reducer.surface, factor);
            let added = faces_added(&self.reducer.surface, &long);
            if count + added <= triangles + 1 || count <= self.options.min_triangles {
                let mut surface = self.reducer.surface.clone();
                let mut stop = if count > triangles + 1 { Stop::Stuck } else { Stop::Target };
                if count < triangles {
                    split_at_midpoints(&mut surface, &long, triangles - count);
                    // The last few by which the two counts miss each other: the next longest edges.
                    while surface.face_count() + 1 < triangles {
                        let (rest, longest) = (triangles - surface.face_count(), long_edges(&surface, 0.0));
                        if split_at_midpoints(&mut surface, &longest, rest) == 0 {
                            stop = Stop::Stuck;
                            break;
                        }
                    }
                }
                return (surface.to_mesh(), stop);
            }
            // Less than what is missing: the long edges become fewer on the way.
            let step = ((count + added - triangles) as f64 / 2.5).ceil() as usize;
            if self.reduce(count.saturating_sub(step.max(2)).max(self.options.min_triangles)) == Stop::Stuck {
                return (self.reducer.surface.to_mesh(), Stop::Stuck);
            }
        }
    }

    /// Collapses, then makes the level better at the count it has. The chain goes on from the better level: its errors are not those of the
    /// collapses after it.
    fn reduce_and_refine(&mut self, triangles: usize) -> (Mesh, Stop) {
        let before = self.reducer.surface.face_count();
        let stop = self.reduce(triangles);
        let faces = self.reducer.surface.face_count();
        let Some(refiner) = self.refiner.as_mut().filter(|refiner| faces < before && refiner.can_judge(faces)) else {
            return (self.level_mesh(), stop);
        };
        let mut surface = self.reducer.surface.clone();
        if refiner.refine(&mut surface, self.reducer.locked(), self.reducer.cost.metric()) {
            self.reducer.adopt(surface);
            self.workspace.forget();
        }
        (self.level_mesh(), stop)
    }

    fn deviation(&mut self) -> &Deviation {
        self.deviation.get_or_insert_with(|| Deviation::new(self.mesh))
    }
}

/// A level in the making.
struct Snapshot {
    mesh: Mesh,
    source_vertices: Option<Vec<u32>>,
}

impl From<Mesh> for Snapshot {
    fn from(mesh: Mesh) -> Self {
        Self { mesh, source_vertices: None }
    }
}
