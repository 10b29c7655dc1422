//! The JSON schema of preset files, for editors. Generated from the types; `config/preset.schema.json` is its checked-in copy.

use super::model::File;
use schemars::generate::SchemaSettings;
use serde_json::Value;

/// The JSON schema of a preset file, as text that ends in a newline.
///
/// Draft 7, which is what TOML editors know.
pub fn schema_text() -> String {
    let schema = SchemaSettings::draft07().into_generator().into_root_schema_for::<File>();
    let mut schema = schema.to_value();
    remove_null(&mut schema);
    format!("{schema:#}\n")
}

/// TOML has no null: an optional key may be absent, nothing more.
fn remove_null(schema: &mut Value) {
    match schema {
        Value::Array(items) => items.iter_mut().for_each(remove_null),
        Value::Object(members) => {
            if let Some(Value::Array(types)) = members.get_mut("type") {
                types.retain(|name| name != "null");
                if let [only] = types.as_slice() {
                    members["type"] = only.clone();
                }
            }
            members.values_mut().for_each(remove_null);
        }
        _ => {}
    }
}
