//! What a run found out: the model, as JSON and as text. Nothing here prints or writes a file.

mod inspect;
mod json;
mod model;
pub mod papers;
mod progressive;
mod text;
mod training;

pub use inspect::{InspectedLevel, InspectedLod, InspectedMesh, InspectedPrimitive, Inspection, describe_inspection};
pub use json::to_json;
pub(crate) use model::name_stop;
pub use model::{
    BaselineReport, BrokenGate, DroppedLevel, ErrorFigures, FileReport, LevelReport, MeshReport, Outcome, PosedFigures,
    Problem, Ratio, RefusalCounts, Report, Status, TargetReport, Totals, relative_name,
};
pub use papers::{PapersReport, describe_papers};
pub use progressive::{
    ProgressiveMeshReport, ProgressiveReport, RebuildReport, RebuiltMeshReport, describe_progressive, describe_rebuild,
};
pub use text::{Detail, describe_comparison, describe_file, describe_run};
pub(crate) use text::{add_row, count, indent, significant, start_table};
pub use training::describe_training;
