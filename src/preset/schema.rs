//! The JSON schema of preset files, for editors. Generated from the types; `config/preset.schema.json` is its checked-in copy.

use super::builtin;
use super::model::File;
use schemars::generate::SchemaSettings;
use serde_json::{Map, Value, json};

/// The JSON schema of a preset file, as text that ends in a newline.
///
/// Draft 7, which is what TOML editors know. Defaults are those of `config/default.toml`.
pub fn schema_text() -> String {
    let mut schema = SchemaSettings::draft07().into_generator().into_root_schema_for::<File>().to_value();
    simplify(&mut schema);
    if let Some(Value::Object(properties)) = schema.get_mut("properties") {
        add_defaults(properties);
    }
    format!("{schema:#}\n")
}

/// Makes what schemars says of Rust true of TOML: there is no null (an optional key is absent), and a line break in a doc
/// comment means nothing.
fn simplify(schema: &mut Value) {
    match schema {
        Value::Array(items) => items.iter_mut().for_each(simplify),
        Value::Object(members) => {
            members.values_mut().for_each(simplify);
            if let Some(Value::String(text)) = members.get_mut("description") {
                *text = text.replace('\n', " ");
            }
            remove_null_type(members);
            remove_null_choice(members);
        }
        _ => {}
    }
}

/// `{ type: [T, null] }` → `{ type: T }`
fn remove_null_type(members: &mut Map<String, Value>) {
    let Some(Value::Array(types)) = members.get_mut("type") else { return };
    types.retain(|name| name != "null");
    if let [only] = types.as_slice() {
        let only = only.clone();
        members.insert("type".to_owned(), only);
    }
}

/// `{ anyOf: [S, null], … }` → `{ allOf: [S], … }`: draft 7 ignores what stands beside a bare `$ref`.
fn remove_null_choice(members: &mut Map<String, Value>) {
    let null = json!({ "type": "null" });
    let Some(Value::Array(choices)) =
        members.get_mut("anyOf").filter(|choices| choices.as_array().is_some_and(|all| all.contains(&null)))
    else {
        return;
    };
    choices.retain(|choice| *choice != null);
    let choices = std::mem::take(choices);
    members.shift_remove("anyOf");
    match choices.as_slice() {
        [Value::Object(only)] if !only.contains_key("$ref") => {
            for (key, value) in only {
                members.entry(key.clone()).or_insert_with(|| value.clone());
            }
        }
        [_] => {
            members.insert("allOf".to_owned(), choices.into());
        }
        _ => {
            members.insert("anyOf".to_owned(), choices.into());
        }
    }
}

fn add_defaults(properties: &mut Map<String, Value>) {
    let Ok(Value::Object(defaults)) = serde_json::to_value(builtin::default_keys()) else { return };
    for (key, default) in defaults {
        if let Some(Value::Object(property)) = properties.get_mut(&key) {
            property.insert("default".to_owned(), default);
        }
    }
}
