//! The TOML model: every key of a preset file, in one list.
//!
//! A file, a named preset and a rule take the same keys. serde's `flatten` would express that, but it loses the places of
//! errors and the check for unknown keys, so a macro writes the list into each of the three tables and into [`Keys`], where
//! layers meet. The doc comments below are what an editor shows (they go into `config/preset.schema.json`).

use super::level::Levels;
use super::number::{
    Count, Exponent, Multiple, PartialShare, Pixels, Samples, ScreenPixels, SplitFactor, Triangles, Weight,
};
use super::pattern::{NamePattern, Naming, PathPattern};
use super::value::{Gate, OneOrMore, Placed};
use super::{Basis, Coverage, ErrorBound};
use crate::emit::{Existing, Layout};
use crate::simplify;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::de::value::StrDeserializer;
use serde::de::{IntoDeserializer, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;
use std::ops::Range;

/// Hands the list of keys to the macro `$then`, after `$head`.
macro_rules! each_key {
    ($then:ident { $($head:tt)* }) => { $then! { { $($head)* }
        /// `true` leaves these meshes as they are.
        skip: Placed<bool>,

        /// The levels, finest first. A number is the share of the source's triangles to keep; a table names other rules:
        /// `ratio`, `triangles`, `error`, `pixels` with `at`. The first rule that binds ends the level. An empty list makes no levels.
        levels: Placed<Levels>,

        /// Triangles below which no level goes. At least 1.
        min_triangles: Triangles,

        /// Meshes with fewer triangles get no levels: there is nothing to gain.
        min_source_triangles: Count,

        /// Share of triangles that a level has to save against the one above it, from 0 to 0.99. A level that saves less is dropped.
        min_saving: PartialShare,

        /// How edges are ranked.
        algorithm: Placed<Algorithm>,

        /// How close to its paper the algorithm stays. Only `esqem` has a choice.
        mode: Mode,

        /// The order of collapses. `"auto"` is the one that the algorithm was made for.
        schedule: Schedule,

        /// `qfvp` only: its exponent w, how much the angle between the normals at an edge's ends counts, from 0 (plain quadrics) to 2.
        /// `"auto"` asks a small neural net that goes by the triangle counts of source and last level, `"shape"` one that also looks at the
        /// mesh.
        qfvp_w: Exponent,

        /// `qfvp` only: how the normals of vertices follow collapses.
        qfvp_normals: NormalUpdate,

        /// `fms` only: its α, how much heavier a vertex becomes as the surface around it changes, from 0 to 1000. Higher values spread
        /// the collapses more evenly.
        fms_alpha: Weight,

        /// Whether vertices may move, or only go.
        placement: Placement,

        /// How much time a level may take to become better than what the collapses alone give.
        effort: Effort,

        /// How much Gaussian curvature counts, from 0 to 1000; 0 switches it off, 1 is usual (in paper mode the paper's
        /// a = 0.01). Higher values keep horns, claws and rims longer and flat parts shorter.
        curvature_weight: Weight,

        /// After the collapses, edges longer than this many mean edge lengths are split (1 to 100; the paper has 4/3).
        /// `false` or `0` splits nothing.
        split_factor: SplitFactor,

        /// Open borders of the surface.
        border: EdgePolicy,

        /// Seams: edges where normals, texture coordinates or colours differ on either side.
        seam: EdgePolicy,

        /// Borders between materials. `lock` wherever primitives are drawn or swapped apart from each other.
        material_border: EdgePolicy,

        /// Cards, small open parts such as leaves and blades of grass, go as a whole, and those that stay grow about their stems or centres,
        /// threefold at most, until all cover the area that they had. Texture coordinates stay. With `placement = "subset"` they do not grow.
        keep_area: bool,

        /// How much attributes count against positions.
        attribute_weights: WeightKeys,

        /// Where switch values come from: `"auto"` computes them from each level's measured error, `screen_height` and
        /// `pixel_tolerance`; a list such as `[0.5, 0.2, 0.08]` sets them: entry i is the coverage below which level i + 1 is shown.
        coverage: Placed<Coverage>,

        /// What a coverage number measures: the share of the screen's height, or of its area.
        basis: Basis,

        /// Height of the screen in pixels that switch values are made for, 1 to 100000.
        screen_height: ScreenPixels,

        /// Error on screen, in pixels, at which a level may come in: above 0, at most 1000. 1 is invisible in motion, 0.5 on
        /// closest inspection; larger values switch earlier.
        pixel_tolerance: Pixels,

        /// Coverage below which nothing is drawn any more, from 0 to 0.99; 0 draws the last level for ever.
        cull_coverage: PartialShare,

        /// What happens to levels that a file has already. Holds for whole files.
        existing: Placed<Existing>,

        /// Where the data of levels goes. Holds for whole files.
        layout: Placed<Layout>,

        /// Names of level nodes; `{name}` is the node's own name, `{level}` is 1 for the finest level. Holds for whole files.
        naming: Placed<Naming>,

        /// Points on each surface at which the error of a level is measured, 100 to 10000000. More take longer and find
        /// smaller peaks.
        samples: Samples,

        /// Checks that can fail the build.
        gates: GateKeys,
    } };
}

macro_rules! define_keys {
    ({} $($(#[$meta:meta])* $key:ident: $Type:ty,)*) => {
        /// The keys that a file, a preset or a rule sets: what layers are made of.
        #[derive(Debug, Clone, Default, PartialEq, Serialize)]
        pub struct Keys { $(
            $(#[$meta])*
            #[serde(skip_serializing_if = "Option::is_none")]
            pub $key: Option<$Type>,
        )* }

        impl Keys {
            /// What `nearer` sets wins.
            pub fn overlay(&mut self, nearer: &Self) {
                $( self.$key.overlay(&nearer.$key); )*
            }
        }
    };
}

macro_rules! define_table {
    ({ $(#[$table:meta])* $Name:ident { $($own:tt)* } } $($(#[$meta:meta])* $key:ident: $Type:ty,)*) => {
        #[derive(Debug, Clone, Default, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields)]
        $(#[$table])*
        pub struct $Name {
            $($own)*
            $( $(#[$meta])* pub $key: Option<$Type>, )*
        }

        impl $Name {
            /// The keys that every table has.
            pub fn keys(&self) -> Keys {
                Keys { $( $key: self.$key.clone(), )* }
            }
        }
    };
}

each_key!(define_keys {});

each_key!(define_table {
    /// Settings of gltf-lod. They hold for this file's directory and everything below it.
    #[schemars(title = "gltf-lod.toml")]
    File {
        /// One line that says what this is for.
        pub description: Option<String>,

        /// Presets that these settings build on, by name: built-in ones or tables `[preset.NAME]`. Later ones in a list win over
        /// earlier ones, the keys beside `extends` over all of them.
        pub extends: Option<Placed<OneOrMore<String>>>,

        /// Files that are not glTF and are copied to the output, as path patterns like those of a rule's `path`. The list in the
        /// nearest file replaces all others.
        pub copy: Option<OneOrMore<PathPattern>>,

        /// Named presets `[preset.NAME]`, for `extends` here and below, and for `--preset`.
        pub preset: Option<BTreeMap<Placed<String>, Preset>>,

        /// Exceptions, each under `[[rule]]`: what a rule sets wins over the keys of its file and over the rules before it.
        pub rule: Option<Rules>,
    }
});

each_key!(define_table {
    /// A named set of settings.
    Preset {
        /// One line that says what the preset is for.
        pub description: Option<String>,

        /// Presets that this one builds on, by name: built-in ones or tables `[preset.NAME]`. Later ones in a list win over
        /// earlier ones, the keys beside `extends` over all of them.
        pub extends: Option<Placed<OneOrMore<String>>>,

        /// Files that are not glTF and are copied to the output, as path patterns like those of a rule's `path`. The list in the
        /// nearest file replaces all others.
        pub copy: Option<OneOrMore<PathPattern>>,

        /// Exceptions, each under `[[preset.NAME.rule]]`.
        pub rule: Option<Rules>,
    }
});

each_key!(define_table {
    /// Settings for some meshes: those that fulfil every condition (`path`, `node`, `mesh`, `material`).
    Rule {
        /// Only files whose path matches. Relative to this file's directory; `*` stops at `/`, `**` does not; a pattern without
        /// `/` matches file names in every directory below. One pattern or a list of which one has to match.
        pub path: Option<OneOrMore<PathPattern>>,

        /// Only meshes that a node with such a name draws. One pattern or a list of which one has to match.
        pub node: Option<OneOrMore<NamePattern>>,

        /// Only meshes with such a name. One pattern or a list of which one has to match.
        pub mesh: Option<OneOrMore<NamePattern>>,

        /// Only meshes that use a material with such a name. One pattern or a list of which one has to match.
        pub material: Option<OneOrMore<NamePattern>>,

        /// Presets that this rule builds on, by name: built-in ones or tables `[preset.NAME]`. What they say of whole files
        /// (`existing`, `layout`, `naming`) counts only where `path` is the rule's only condition.
        pub extends: Option<Placed<OneOrMore<String>>>,
    }
});

impl Keys {
    /// A key among these that holds for whole files and so cannot differ from mesh to mesh, with its place.
    pub fn find_file_wide(&self) -> Option<(&'static str, Range<usize>)> {
        let Self { existing, layout, naming, .. } = self;
        let existing = existing.as_ref().map(|key| ("existing", key.span.clone()));
        let layout = layout.as_ref().map(|key| ("layout", key.span.clone()));
        let naming = naming.as_ref().map(|key| ("naming", key.span.clone()));
        existing.or(layout).or(naming)
    }

    /// The keys that may differ from mesh to mesh.
    pub fn without_file_wide(&self) -> Self {
        Self { existing: None, layout: None, naming: None, ..self.clone() }
    }
}

/// Tables `[[rule]]` in their order, with their places.
#[derive(Debug, Clone, Default)]
pub struct Rules(pub Vec<Placed<Rule>>);

impl<'de> Deserialize<'de> for Rules {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(RulesVisitor).map(Self)
    }
}

struct RulesVisitor;

impl<'de> Visitor<'de> for RulesVisitor {
    type Value = Vec<Placed<Rule>>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a table `[[rule]]` with double brackets, since there may be several")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Self::Value, A::Error> {
        let mut rules = Vec::new();
        while let Some(rule) = list.next_element()? {
            rules.push(rule);
        }
        Ok(rules)
    }
}

impl JsonSchema for Rules {
    fn inline_schema() -> bool {
        true
    }
    fn schema_name() -> Cow<'static, str> {
        "Rules".into()
    }
    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        Vec::<Rule>::json_schema(generator)
    }
}

/// How edges are ranked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Algorithm {
    /// Quadric error with Gaussian curvature, and splits of long edges (Zhang 2022): keeps tips, rims and thin parts.
    Esqem,
    /// Plain quadric error metrics (Garland & Heckbert 1997).
    Qem,
    /// Quadric error times a power of the angle between the normals at an edge's ends; vertices stay on their edge. Keeps features of
    /// very coarse levels.
    Qfvp,
    /// Edge lengths and curvature alone, vertex by vertex (Meng & Song 2007): simple, less exact.
    Fms,
    /// Edge length times curvature (Melax 1998): levels whose vertices are all vertices of the source.
    Melax,
    /// What meshoptimizer makes of the mesh, by the best of its modes at each triangle count. Seams and material borders cannot be locked.
    Meshopt,
}

/// How close to its paper an algorithm stays.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// What measures best.
    Enhanced,
    /// What the paper says, to compare with its tables.
    Paper,
}

/// The order of collapses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Schedule {
    /// What suits the algorithm: passes for `esqem` and `qem`, the queue for `esqem` in paper mode, `qfvp` and `melax`, vertices for `fms`.
    Auto,
    /// Ranks all edges, collapses the cheapest that do not touch each other, and repeats: fast.
    Passes,
    /// Always the cheapest edge of all: slower, in strict order.
    Queue,
    /// Always the cheapest edge of the lightest vertex: a smaller queue, whose order lags a little behind.
    Vertices,
}

/// How normals follow collapses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum NormalUpdate {
    /// The mean of both ends, weighted by their numbers of faces.
    Linear,
    /// Anew from the faces: slower.
    Recompute,
}

/// Where the vertex of a collapsed edge goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Placement {
    /// Where the error is least: the best shape for the triangles.
    Optimal,
    /// To one of the edge's ends: levels share the source's vertices and add an index buffer only, which takes the least memory. Nothing is split
    /// or refined.
    Subset,
}

/// How much time a level may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Effort {
    /// Collapses only.
    Fast,
    /// Collapses, then refinement of the worst spots.
    Default,
    /// Refinement for as long as it gains: many times slower.
    Best,
}

/// What may happen to a kind of edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum EdgePolicy {
    /// They move like any other edge.
    Free,
    /// They move only where that hardly changes their shape.
    Preserve,
    /// Their vertices never move. Levels may then miss their targets.
    Lock,
}

/// How much attributes count against positions. 1 is automatic: it suits small and large meshes alike; 0 ignores the
/// attribute; up to 1000.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WeightKeys {
    /// Normals: shading.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub normal: Option<Weight>,
    /// Texture coordinates, all sets: textures that must not swim.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tex_coord: Option<Weight>,
    /// Vertex colours, all sets.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub color: Option<Weight>,
}

/// Checks of every level. Each is a limit (beyond it the build fails), `{ value = LIMIT, on = "warn" }`, or `false` for none.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GateKeys {
    /// Largest distance between a level and the source: object units, or a string such as "2%" of the bounding box's diagonal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_error: Option<Gate<ErrorBound>>,
    /// Largest RMS error relative to meshoptimizer's at the same number of triangles: 1 is as good.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_rms_vs_meshopt: Option<Gate<Multiple>>,
    /// Most edges at which a level has come apart.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_gap_edges: Option<Gate<Count>>,
}

/// How a nearer layer changes a value: values and lists are replaced, tables are merged key by key.
trait Layered: Clone {
    fn overlay(&mut self, nearer: &Self) {
        self.clone_from(nearer);
    }
}

impl<T: Layered> Layered for Option<T> {
    fn overlay(&mut self, nearer: &Self) {
        match (self, nearer) {
            (_, None) => {}
            (Some(value), Some(nearer)) => value.overlay(nearer),
            (none, Some(nearer)) => *none = Some(nearer.clone()),
        }
    }
}

impl Layered for WeightKeys {
    fn overlay(&mut self, nearer: &Self) {
        self.normal.overlay(&nearer.normal);
        self.tex_coord.overlay(&nearer.tex_coord);
        self.color.overlay(&nearer.color);
    }
}

impl Layered for GateKeys {
    fn overlay(&mut self, nearer: &Self) {
        self.max_error.overlay(&nearer.max_error);
        self.max_rms_vs_meshopt.overlay(&nearer.max_rms_vs_meshopt);
        self.max_gap_edges.overlay(&nearer.max_gap_edges);
    }
}

macro_rules! replaced {
    ($($Type:ty),* $(,)?) => { $( impl Layered for $Type {} )* };
}

replaced!(
    bool,
    Placed<bool>,
    Placed<Levels>,
    Placed<Coverage>,
    Placed<Algorithm>,
    Mode,
    Schedule,
    Exponent,
    NormalUpdate,
    Placement,
    Effort,
    EdgePolicy,
    Basis,
    Placed<Existing>,
    Placed<Layout>,
    Placed<Naming>,
    Weight,
    SplitFactor,
    Pixels,
    ScreenPixels,
    PartialShare,
    Triangles,
    Count,
    Samples,
    Gate<ErrorBound>,
    Gate<Multiple>,
    Gate<Count>,
);

impl Algorithm {
    /// The algorithm that TOML calls `name`.
    ///
    /// # Errors
    /// In words, as for an unknown value in a file.
    pub fn from_name(name: &str) -> Result<Self, String> {
        read_name(name)
    }

    /// The algorithm in the simplifier's terms; `None` for meshoptimizer, which is another simplifier.
    pub fn in_mode(self, mode: Mode) -> Option<simplify::Algorithm> {
        Some(match self {
            Self::Esqem => simplify::Algorithm::Esqem(match mode {
                Mode::Enhanced => simplify::Mode::Enhanced,
                Mode::Paper => simplify::Mode::Paper,
            }),
            Self::Qem => simplify::Algorithm::Qem,
            Self::Qfvp => simplify::Algorithm::Qfvp,
            Self::Fms => simplify::Algorithm::Fms,
            Self::Melax => simplify::Algorithm::Melax,
            Self::Meshopt => return None,
        })
    }
}

impl Schedule {
    /// The schedule in the simplifier's terms.
    pub fn resolve(self, algorithm: simplify::Algorithm) -> simplify::Schedule {
        match self {
            Self::Auto => algorithm.natural_schedule(),
            Self::Passes => simplify::Schedule::Passes,
            Self::Queue => simplify::Schedule::Queue,
            Self::Vertices => simplify::Schedule::Vertices,
        }
    }
}

impl From<NormalUpdate> for simplify::NormalUpdate {
    fn from(update: NormalUpdate) -> Self {
        match update {
            NormalUpdate::Linear => Self::Linear,
            NormalUpdate::Recompute => Self::Recompute,
        }
    }
}

impl From<Placement> for simplify::Placement {
    fn from(placement: Placement) -> Self {
        match placement {
            Placement::Optimal => Self::Optimal,
            Placement::Subset => Self::Subset,
        }
    }
}

impl Effort {
    /// The effort that TOML calls `name`.
    ///
    /// # Errors
    /// As [`Algorithm::from_name`].
    pub fn from_name(name: &str) -> Result<Self, String> {
        read_name(name)
    }
}

/// Reads a name as a value in a file would be read.
fn read_name<T: serde::de::DeserializeOwned>(name: &str) -> Result<T, String> {
    let name: StrDeserializer<'_, serde::de::value::Error> = name.into_deserializer();
    T::deserialize(name).map_err(|error| error.to_string())
}

impl From<Effort> for simplify::Effort {
    fn from(effort: Effort) -> Self {
        match effort {
            Effort::Fast => Self::Fast,
            Effort::Default => Self::Default,
            Effort::Best => Self::Best,
        }
    }
}

impl From<EdgePolicy> for simplify::EdgePolicy {
    fn from(policy: EdgePolicy) -> Self {
        match policy {
            EdgePolicy::Free => Self::Free,
            EdgePolicy::Preserve => Self::Preserve,
            EdgePolicy::Lock => Self::Lock,
        }
    }
}
