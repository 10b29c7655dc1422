//! The report as JSON: stable key order, relative paths, times in one place that can be left out.

use super::model::Report;
use serde_json::{Map, Value, json};

/// The report as indented JSON, ending with a newline.
///
/// Everything but the last key, `times` (seconds: `total`, and one for each file), depends on inputs, presets and version only.
/// `times` is there when the observer kept time and `with_times` asks for it.
pub fn to_json(report: &Report, with_times: bool) -> String {
    // A report holds strings, numbers and lists: nothing that JSON cannot express.
    let mut value = serde_json::to_value(report).unwrap_or_default();
    if let (true, Some(total), Some(object)) = (with_times, report.elapsed, value.as_object_mut()) {
        let seconds = |file: &super::FileReport| Some((file.path.clone(), json!(file.elapsed?.as_secs_f64())));
        let files: Map<String, Value> = report.files.iter().filter_map(seconds).collect();
        object.insert("times".into(), json!({ "total": total.as_secs_f64(), "files": files }));
    }
    format!("{value:#}\n")
}
