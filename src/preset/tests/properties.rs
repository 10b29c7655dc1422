//! Any text is read or refused, never a panic.

use super::super::file::PresetFile;
use super::super::source::Source;
use super::*;
use proptest::prelude::*;

/// Reads a text; if it is wrong the message has to be able to point at it.
fn check(text: &str) {
    if let Err(error) = PresetFile::parse(Source::new("x.toml", text)) {
        assert!(error.place.is_some() && !error.message.is_empty());
    }
}

/// Pieces of preset files, so that random texts get past the TOML parser.
fn piece() -> impl Strategy<Value = String> {
    let words = vec![
        "levels",
        "ratio",
        "error",
        "pixels",
        "at",
        "gates",
        "max_error",
        "value",
        "on",
        "rule",
        "path",
        "mesh",
        "preset",
        "extends",
        "coverage",
        "skip",
        "naming",
        "split_factor",
        "[",
        "]",
        "[[",
        "]]",
        "{",
        "}",
        " = ",
        ", ",
        "\n",
        "\r\n",
        ".",
        "'",
        "\"",
        "0.5",
        "-1",
        "500",
        "inf",
        "nan",
        "true",
        "false",
        "'a'",
        "'0.5%'",
        "'%'",
        "'{level}'",
        "'['",
        "'**'",
        "ä",
        "漢",
        "🦀",
        "\u{feff}",
        "#",
        "\0",
    ];
    prop_oneof![8 => prop::sample::select(words).prop_map(str::to_owned), 1 => any::<char>().prop_map(String::from)]
}

/// A right line with any value.
fn line() -> impl Strategy<Value = String> {
    let keys = vec![
        "levels",
        "coverage",
        "gates.max_error",
        "extends",
        "naming",
        "split_factor",
        "rule",
        "preset.a",
        "copy",
        "skip",
    ];
    let value = prop_oneof![
        Just("[0.5, {error = '1%'}]".to_owned()),
        Just("[[[{}]]]".to_owned()),
        any::<i64>().prop_map(|number| number.to_string()),
        any::<f64>().prop_map(|number| number.to_string()),
        any::<String>().prop_map(|text| toml::Value::String(text).to_string()),
        prop::collection::vec(any::<f32>(), 0..4).prop_map(|numbers| format!("{numbers:?}")),
    ];
    (prop::sample::select(keys), value).prop_map(|(key, value)| format!("{key} = {value}\n"))
}

proptest! {
    #[test]
    fn any_text_is_read_or_refused(text in any::<String>()) {
        check(&text);
    }

    #[test]
    fn any_pieces_are_read_or_refused(pieces in prop::collection::vec(piece(), 0..40)) {
        check(&pieces.concat());
    }

    #[test]
    fn any_values_are_read_or_refused(lines in prop::collection::vec(line(), 0..4)) {
        check(&lines.concat());
    }

    #[test]
    fn a_shipped_preset_with_a_wound_is_read_or_refused(preset in 0..7_usize, at in any::<prop::sample::Index>(), wound in piece()) {
        let mut text = list()[preset].text.to_owned();
        let at = text.char_indices().map(|(at, _)| at).nth(at.index(text.chars().count())).unwrap();
        text.insert_str(at, &wound);
        check(&text);
    }
}
