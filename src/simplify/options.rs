//! What to build: targets, algorithm, policies.

/// Options of one simplification run. `Options::default()` gives 50, 25 and 12.5 %.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The levels, finest first. Each continues from the one before.
    pub levels: Vec<Target>,
    /// No level gets fewer triangles than this.
    pub min_triangles: usize,
    /// How edges are ranked and in which order they collapse.
    pub algorithm: Algorithm,
    /// `Passes` is faster, `Queue` keeps the strict order of costs.
    pub schedule: Schedule,
    /// QFVP's w: how much the angle between the normals at an edge's ends counts.
    pub qfvp_w: FeatureWeight,
    /// How QFVP's normals follow collapses.
    pub qfvp_normals: NormalUpdate,
    /// FMS's α: how much a vertex gains in weight as collapses change the surface around it.
    pub fms_alpha: f32,
    /// Whether vertices may move, or only go.
    pub placement: Placement,
    /// How much time a level may take to become better than what the collapses alone give.
    pub effort: Effort,
    /// How much Gaussian curvature counts, relative to what is usual in the [`Mode`]; 0 turns it off. In paper mode 1 is ESQEM's a = 0.01.
    pub curvature_weight: f32,
    /// ESQEM's `b`: edges longer than `b` times the mean edge length are split after the collapses; `None` splits nothing.
    pub split_factor: Option<f32>,
    /// Open borders.
    pub border: EdgePolicy,
    /// Attribute seams: edges with different attributes on either side.
    pub seam: EdgePolicy,
    /// Borders between groups (materials).
    pub material_border: EdgePolicy,
    /// Cards, small open parts such as leaves, go as a whole, and those that stay grow until all cover the area that they had. With
    /// [`Placement::Subset`] they do not grow.
    pub keep_area: bool,
    /// How much attributes count against positions.
    pub attribute_weights: AttributeWeights,
}

/// What ends a level: the first of the given rules that binds. A target without any rule ends at once.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Target {
    /// Share of the source's triangles, in (0, 1].
    pub ratio: Option<f64>,
    /// Number of triangles.
    pub triangles: Option<usize>,
    /// Largest distance from the source surface, object units.
    pub error: Option<f64>,
}

impl Target {
    /// A share of the source's triangles.
    pub fn ratio(ratio: f64) -> Self {
        Self { ratio: Some(ratio), ..Self::default() }
    }

    /// A number of triangles.
    pub fn triangles(triangles: usize) -> Self {
        Self { triangles: Some(triangles), ..Self::default() }
    }

    /// The count that the counting rules ask for, of a source with this many triangles: the first that binds on the way down is the
    /// largest. `least` where only an error ends the level, the source's count where nothing does.
    pub fn count(&self, source: usize, least: usize) -> usize {
        let ratio = self.ratio.map(|r| (source as f64 * r).round() as usize);
        let without_count = if self.error.is_some() { least } else { source };
        [ratio, self.triangles].into_iter().flatten().max().unwrap_or(without_count)
    }
}

/// The cost and placement of a collapse.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Algorithm {
    /// Quadric error with Gaussian curvature, and a split pass (Zhang 2022).
    Esqem(Mode),
    /// Quadric error metrics (Garland & Heckbert 1997).
    Qem,
    /// Quadric error times a power of the angle between the normals at an edge's ends: the cost of a progressive mesh for mobile devices.
    Qfvp,
    /// Edge length² and relative curvature, by vertex: no quadrics (Meng & Song 2007).
    Fms,
    /// Edge length times curvature, one end moves onto the other (Melax 1998).
    Melax,
}

impl Algorithm {
    /// The schedule that the algorithm was made for: fast passes where results do not suffer, its paper's order otherwise.
    pub fn natural_schedule(self) -> Schedule {
        match self {
            Self::Esqem(Mode::Enhanced) | Self::Qem => Schedule::Passes,
            Self::Esqem(Mode::Paper) | Self::Qfvp | Self::Melax => Schedule::Queue,
            Self::Fms => Schedule::Vertices,
        }
    }
}

/// QFVP's exponent w.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum FeatureWeight {
    /// This one, from 0 (the quadric error alone) to 2.
    Fixed(f64),
    /// What the paper's net names for the source's triangles and those of the last level.
    #[default]
    Auto,
    /// What a net names that looks at the shape as well.
    Shape,
}

/// How QFVP's normals follow collapses.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum NormalUpdate {
    /// The mean of both ends, weighted by their numbers of faces (eq. 11).
    #[default]
    Linear,
    /// Anew from the faces, at the joined point and around it.
    Recompute,
}

/// How close to the paper an algorithm stays.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum Mode {
    /// Memoryless quadrics, volume-preserving placement, curvature multiplied into the cost, splits on the source surface.
    #[default]
    Enhanced,
    /// Accumulated quadrics, `Q + ω·K` with `ω = a·Q_avg/K_avg` (eq. 12, 13), one midpoint split pass.
    Paper,
}

/// In which order edges collapse.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum Schedule {
    /// Rank all edges, collapse greedily where nothing nearby has changed yet, repeat.
    #[default]
    Passes,
    /// One collapse at a time, always the cheapest.
    Queue,
    /// One collapse at a time, the cheapest of the vertex that is lightest. Weights further away than its neighbours lag behind (FMS).
    Vertices,
}

/// Where the vertex of a collapsed edge goes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum Placement {
    /// Where the error is least, with attributes solved for that place.
    #[default]
    Optimal,
    /// To one end of the edge, which stays as it is: levels are made of source vertices alone, so that they need only an index buffer of their own.
    /// Nothing is split or refined.
    Subset,
}

/// How much time a level may take.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Effort {
    /// Collapses only.
    Fast,
    /// Collapses in a stricter order, then refinement of the levels that have samples enough: those below about a seventh of the source.
    #[default]
    Default,
    /// Collapses in nearly strict order, then more refinement, of all levels up to half of the source.
    Best,
}

/// What may happen to a kind of edge.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum EdgePolicy {
    /// No care is taken of its shape beyond what the surface itself asks.
    Free,
    /// Its shape costs: it moves only where that is cheap.
    #[default]
    Preserve,
    /// Its vertices do not move.
    Lock,
}

/// Weight of attribute errors relative to position errors; 1 is the automatic normalisation, 0 ignores the attribute.
///
/// At weight 1 an attribute is scaled so that one preset serves small and large meshes: UVs by their density, normals
/// and colours by the length of the edge at hand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttributeWeights {
    /// Normals.
    pub normal: f32,
    /// Texture coordinates, all sets.
    pub tex_coord: f32,
    /// Colours, all sets.
    pub color: f32,
}

impl Default for AttributeWeights {
    fn default() -> Self {
        Self { normal: 1.0, tex_coord: 1.0, color: 1.0 }
    }
}

impl Default for Options {
    fn default() -> Self {
        Self {
            levels: vec![Target::ratio(0.5), Target::ratio(0.25), Target::ratio(0.125)],
            min_triangles: 4,
            algorithm: Algorithm::Esqem(Mode::Enhanced),
            schedule: Schedule::Passes,
            qfvp_w: FeatureWeight::Auto,
            qfvp_normals: NormalUpdate::Linear,
            fms_alpha: 1.0,
            placement: Placement::Optimal,
            effort: Effort::Default,
            curvature_weight: 1.0,
            split_factor: Some(4.0 / 3.0),
            border: EdgePolicy::Preserve,
            seam: EdgePolicy::Preserve,
            material_border: EdgePolicy::Preserve,
            keep_area: false,
            attribute_weights: AttributeWeights::default(),
        }
    }
}
