//! The files that come with gltf-lod.

use super::*;
use serde_json::Value;

#[test]
fn every_preset_gives_settings() {
    let names: Vec<_> = list().iter().map(|preset| preset.name).collect();
    assert_eq!(names, ["default", "mobile", "hero", "prop", "character", "terrain", "foliage"]);
    for PresetInfo { name, description, levels, .. } in list() {
        let flags = Flags { preset: Some(name.into()), ..Flags::default() };
        let settings = read_with(&flags, &[], "x.glb").unwrap().settings(&MeshNames::default()).unwrap();
        assert!(!settings.levels.is_empty() && !levels.is_empty() && description.len() > 20, "{name}");
        assert!(settings.min_source_triangles > 12, "{name} would simplify a cube away");
    }
    assert_eq!(list()[0].levels, "50%, 25%, 12.5%");
}

#[test]
fn defaults_stand_in_one_place() {
    let settings = settings(&[], "x.glb");
    assert_eq!(settings, Settings::default());
    assert_eq!(ratios(&settings), [0.5, 0.25, 0.125]);
    assert_eq!(settings.simplify, simplify::Options { levels: Vec::new(), ..simplify::Options::default() });
    assert_eq!(settings.maker, Maker::default());
    assert_eq!(settings.samples, crate::measure::Sampling::default().samples);
    assert_eq!((settings.layout, settings.existing), (Layout::default(), Existing::default()));
    // A naming that works, and no key that only some preset sets.
    assert_eq!(settings.naming, "{name}_LOD{level}");
}

#[test]
fn the_template_of_init_is_a_preset_and_so_is_all_that_it_comments_out() {
    assert_eq!(settings(&[("gltf-lod.toml", init_text())], "x.glb"), Settings::default());
    let is_setting = |line: &str| {
        line.starts_with('[')
            || line.split_once(" = ").is_some_and(|(key, _)| key.chars().all(|c| c.is_ascii_lowercase() || c == '_'))
    };
    let mut text = String::new();
    let mut uncommented = 0;
    for line in init_text().lines() {
        match line.strip_prefix("# ").filter(|line| is_setting(line)) {
            Some(setting) => {
                text += setting;
                uncommented += 1;
            }
            None => text += line,
        }
        text.push('\n');
    }
    assert_eq!(uncommented, 24, "{text}");
    let all = read(&[("gltf-lod.toml", &text)], "characters/x.glb");
    assert_eq!(all.settings(&mesh("UCX_wall")).unwrap().skip.as_deref(), Some("`skip` in gltf-lod.toml, line 51"));
    assert_eq!(all.settings(&mesh("wall")).unwrap().levels.len(), 5, "character");
}

#[test]
fn the_schema_is_up_to_date() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/preset.schema.json");
    if std::env::var_os("UPDATE_SCHEMA").is_some() {
        fs::write(&path, schema_text()).unwrap();
    }
    let checked_in = fs::read_to_string(&path).unwrap_or_default();
    assert!(checked_in == schema_text(), "the types have changed: run the tests once with UPDATE_SCHEMA=1");
}

/// What is wrong with `value` by `schema`, if anything. Knows the words that this schema uses, and fails on any other.
fn find_fault(root: &Value, schema: &Value, value: &Value) -> Option<String> {
    let number = |bound: &Value, holds: fn(f64, f64) -> bool| {
        value
            .as_f64()
            .is_some_and(|value| !holds(value, bound.as_f64().unwrap()))
            .then(|| format!("{value} breaks {bound}"))
    };
    let any = |choices: &Value| {
        let faults: Option<Vec<String>> =
            choices.as_array().unwrap().iter().map(|choice| find_fault(root, choice, value)).collect();
        faults.map(|faults| format!("none of: {}", faults.join("; ")))
    };
    let fault = |(word, rule): (&String, &Value)| match word.as_str() {
        "$schema" | "title" | "description" | "default" | "definitions" | "pattern" | "minLength" => None,
        "$ref" => find_fault(root, root.pointer(rule.as_str().unwrap().strip_prefix('#').unwrap()).unwrap(), value),
        "type" => {
            let holds = match rule.as_str().unwrap() {
                "object" => value.is_object(),
                "array" => value.is_array(),
                "string" => value.is_string(),
                "boolean" => value.is_boolean(),
                "integer" => value.is_i64() || value.is_u64(),
                "number" => value.is_number(),
                other => panic!("type {other}"),
            };
            (!holds).then(|| format!("{value} is no {rule}"))
        }
        "properties" => {
            let members = value.as_object().into_iter().flatten();
            members
                .filter_map(|(key, value)| Some((rule.get(key)?, value)))
                .find_map(|(rule, value)| find_fault(root, rule, value))
        }
        "additionalProperties" => {
            let known = |key: &String| schema.get("properties").is_some_and(|properties| properties.get(key).is_some());
            let mut others = value.as_object().into_iter().flatten().filter(|(key, _)| !known(key));
            match rule {
                Value::Bool(false) => others.next().map(|(key, _)| format!("unknown key {key}")),
                rule => others.find_map(|(_, value)| find_fault(root, rule, value)),
            }
        }
        "required" => rule
            .as_array()
            .unwrap()
            .iter()
            .find(|key| value.is_object() && value.get(key.as_str().unwrap()).is_none())
            .map(|key| format!("no {key}")),
        "items" => value.as_array().into_iter().flatten().find_map(|value| find_fault(root, rule, value)),
        "anyOf" | "oneOf" => any(rule),
        "allOf" => rule.as_array().unwrap().iter().find_map(|rule| find_fault(root, rule, value)),
        "enum" => (!rule.as_array().unwrap().contains(value)).then(|| format!("{value} is not in {rule}")),
        "const" => (rule != value).then(|| format!("{value} is not {rule}")),
        "minimum" => number(rule, |value, bound| value >= bound),
        "maximum" => number(rule, |value, bound| value <= bound),
        "exclusiveMinimum" => number(rule, |value, bound| value > bound),
        other => panic!("the schema uses `{other}`"),
    };
    schema.as_object().unwrap().iter().find_map(fault)
}

#[test]
fn the_schema_takes_what_is_right_and_refuses_what_is_wrong() {
    let schema: Value = serde_json::from_str(&schema_text()).unwrap();
    let fault = |text: &str| find_fault(&schema, &schema, &toml::from_str::<Value>(text).unwrap());
    for preset in list() {
        assert_eq!(fault(preset.text), None, "{}", preset.name);
    }
    for right in [
        init_text(),
        "levels = [0.5, { triangles = 3 }, { error = '1%' }]\nsplit_factor = 0\ncoverage = [0.5, 0.2]",
        "copy = 'a'\nextends = ['a', 'b']\n[gates]\nmax_error = false\nmax_gap_edges = { value = 3 }",
        "[preset.a]\nskip = true\n[[preset.a.rule]]\nmesh = ['a', 'b']\nborder = 'lock'",
    ] {
        assert_eq!(fault(right), None, "{right}");
        assert!(
            read_with(&Flags::default(), &[(FILE_NAME, &right.replace("extends = ['a', 'b']", ""))], "x.glb").is_ok()
        );
    }
    for wrong in [
        "levles = [1]",
        "levels = [0]",
        "levels = [{ rato = 1 }]",
        "coverage = 'Auto'",
        "border = 'locked'",
        "split_factor = true",
        "samples = 1",
        "[gates]\nmax_error = { on = 'warn' }",
        "[gates]\nmax_gap_edges = -1",
        "[[rule]]\nmehs = 'a'",
        "[preset.a]\nx = 1",
    ] {
        assert!(fault(wrong).is_some(), "{wrong}");
    }
}
