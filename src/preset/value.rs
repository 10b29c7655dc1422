//! What may stand right of an equals sign: numbers with their ranges, levels, coverage, error bounds, gates, patterns.
//!
//! A value outside its range never gets past this module: each type checks while it is read, so that the TOML reader
//! puts the value's own place into the error. A second line in a message is its help (see [`super::source`]).

use super::number::{LENGTH, PERCENT, Share};
use super::{Coverage, ErrorBound, Severity};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::MapAccessDeserializer;
use serde::de::{DeserializeSeed, Error, IntoDeserializer, MapAccess, SeqAccess, Unexpected, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::borrow::Cow;
use std::cmp::Ordering;
use std::fmt;
use std::marker::PhantomData;
use std::ops::Range;

/// A value that knows where it stands, for checks that need several values. Compares by value alone.
#[derive(Debug, Clone)]
pub struct Placed<T> {
    /// The value.
    pub value: T,
    /// Its bytes in the file.
    pub span: Range<usize>,
}

impl<T: PartialEq> PartialEq for Placed<T> {
    fn eq(&self, other: &Self) -> bool {
        self.value == other.value
    }
}

impl<T: Eq> Eq for Placed<T> {}

impl<T: Ord> PartialOrd for Placed<T> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl<T: Ord> Ord for Placed<T> {
    fn cmp(&self, other: &Self) -> Ordering {
        self.value.cmp(&other.value)
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Placed<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let spanned = toml::Spanned::<T>::deserialize(deserializer)?;
        Ok(Self { span: spanned.span(), value: spanned.into_inner() })
    }
}

impl<T: Serialize> Serialize for Placed<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.value.serialize(serializer)
    }
}

impl<T: JsonSchema> JsonSchema for Placed<T> {
    fn inline_schema() -> bool {
        T::inline_schema()
    }
    fn schema_name() -> Cow<'static, str> {
        T::schema_name()
    }
    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        T::json_schema(generator)
    }
}

impl<'de> Deserialize<'de> for ErrorBound {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ErrorBoundVisitor)
    }
}

struct ErrorBoundVisitor;

impl Visitor<'_> for ErrorBoundVisitor {
    type Value = ErrorBound;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a length above 0 in object units such as 0.02, or a part of the diagonal such as \"0.5%\"")
    }

    fn visit_f64<E: Error>(self, length: f64) -> Result<ErrorBound, E> {
        if LENGTH.holds(length) {
            Ok(ErrorBound::Units(length))
        } else {
            Err(E::invalid_value(Unexpected::Float(length), &self))
        }
    }

    fn visit_i64<E: Error>(self, length: i64) -> Result<ErrorBound, E> {
        self.visit_f64(length as f64)
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<ErrorBound, E> {
        text.strip_suffix('%')
            .and_then(|number| number.trim().parse().ok())
            .filter(|&percent| PERCENT.holds(percent))
            .map(ErrorBound::Percent)
            .ok_or_else(|| E::invalid_value(Unexpected::Str(text), &self))
    }
}

impl Serialize for ErrorBound {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Units(length) => serializer.serialize_f64(*length),
            Self::Percent(percent) => serializer.collect_str(&format_args!("{percent}%")),
        }
    }
}

impl JsonSchema for ErrorBound {
    fn inline_schema() -> bool {
        true
    }
    fn schema_name() -> Cow<'static, str> {
        "ErrorBound".into()
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "anyOf": [
                LENGTH.json_schema(),
                { "type": "string", "pattern": r"^\s*\+?[0-9]*\.?[0-9]+([eE][+-]?[0-9]+)?\s*%$" },
            ]
        })
    }
}

impl<'de> Deserialize<'de> for Coverage {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(CoverageVisitor)
    }
}

struct CoverageVisitor;

impl<'de> Visitor<'de> for CoverageVisitor {
    type Value = Coverage;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("\"auto\", or a falling list of numbers such as [0.5, 0.2]")
    }

    fn visit_str<E: Error>(self, word: &str) -> Result<Coverage, E> {
        match word {
            "auto" => Ok(Coverage::Auto),
            _ => Err(E::invalid_value(Unexpected::Str(word), &self)),
        }
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Coverage, A::Error> {
        let mut numbers = Vec::new();
        while let Some(number) = list.next_element_seed(SwitchVisitor { larger: numbers.last().copied() })? {
            numbers.push(number);
        }
        Ok(Coverage::Explicit(numbers))
    }
}

/// Reads one coverage number, which has to be smaller than the one before.
struct SwitchVisitor {
    larger: Option<f64>,
}

impl<'de> DeserializeSeed<'de> for SwitchVisitor {
    type Value = f64;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<f64, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl Visitor<'_> for SwitchVisitor {
    type Value = f64;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        Share::INTERVAL.expecting(f)
    }

    fn visit_f64<E: Error>(self, number: f64) -> Result<f64, E> {
        let number = Share::INTERVAL.visit_f64(number)?;
        match self.larger {
            Some(larger) if number >= larger => Err(E::custom(
                "coverage has to fall from level to level\ncoarser levels are for smaller sizes on screen",
            )),
            _ => Ok(number),
        }
    }

    fn visit_i64<E: Error>(self, number: i64) -> Result<f64, E> {
        self.visit_f64(number as f64)
    }
}

impl Serialize for Coverage {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Auto => serializer.serialize_str("auto"),
            Self::Explicit(numbers) => numbers.serialize(serializer),
        }
    }
}

impl JsonSchema for Coverage {
    fn inline_schema() -> bool {
        true
    }
    fn schema_name() -> Cow<'static, str> {
        "Coverage".into()
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "anyOf": [{ "const": "auto" }, { "type": "array", "items": Share::INTERVAL.json_schema() }] })
    }
}

/// A limit and what happens beyond it. In TOML the limit alone (which then fails the build),
/// `{ value = …, on = "warn" }`, or `false` for no gate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Gate<T> {
    /// Nothing is checked.
    Off,
    /// The limit, and what happens beyond it.
    At(T, Severity),
}

impl<T> Gate<T> {
    /// The limit, unless the gate is off.
    pub fn limit(self) -> Option<(T, Severity)> {
        match self {
            Self::Off => None,
            Self::At(limit, on) => Some((limit, on)),
        }
    }
}

/// A gate with both parts.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct GateTable<T> {
    /// The limit: what is beyond breaks the gate.
    value: T,
    /// What a broken gate does.
    #[serde(default = "fail")]
    #[schemars(extend("default" = "fail"))]
    on: Severity,
}

fn fail() -> Severity {
    Severity::Fail
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Gate<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(GateVisitor(PhantomData))
    }
}

struct GateVisitor<T>(PhantomData<T>);

impl<'de, T: Deserialize<'de>> Visitor<'de> for GateVisitor<T> {
    type Value = Gate<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a limit, a table such as { value = 1, on = \"warn\" }, or false for no gate")
    }

    fn visit_bool<E: Error>(self, on: bool) -> Result<Gate<T>, E> {
        if on { Err(E::invalid_value(Unexpected::Bool(on), &self)) } else { Ok(Gate::Off) }
    }

    fn visit_f64<E: Error>(self, limit: f64) -> Result<Gate<T>, E> {
        T::deserialize(limit.into_deserializer()).map(|limit| Gate::At(limit, Severity::Fail))
    }

    fn visit_i64<E: Error>(self, limit: i64) -> Result<Gate<T>, E> {
        T::deserialize(limit.into_deserializer()).map(|limit| Gate::At(limit, Severity::Fail))
    }

    fn visit_str<E: Error>(self, limit: &str) -> Result<Gate<T>, E> {
        T::deserialize(limit.into_deserializer()).map(|limit| Gate::At(limit, Severity::Fail))
    }

    fn visit_map<A: MapAccess<'de>>(self, table: A) -> Result<Gate<T>, A::Error> {
        let gate = GateTable::<T>::deserialize(MapAccessDeserializer::new(table))?;
        Ok(Gate::At(gate.value, gate.on))
    }
}

impl<T: Serialize + Copy> Serialize for Gate<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match *self {
            Self::Off => serializer.serialize_bool(false),
            Self::At(value, on) => GateTable { value, on }.serialize(serializer),
        }
    }
}

impl<T: JsonSchema> JsonSchema for Gate<T> {
    fn schema_name() -> Cow<'static, str> {
        format!("{}Gate", T::schema_name()).into()
    }
    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let table = GateTable::<T>::json_schema(generator);
        json_schema!({ "anyOf": [T::json_schema(generator), table, { "const": false }] })
    }
}

/// One value or a list of them. Each keeps its place; a single value has that of the whole.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(transparent)]
pub struct OneOrMore<T>(pub Vec<T>);

impl<'de, T: Deserialize<'de>> Deserialize<'de> for OneOrMore<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(OneOrMoreVisitor(PhantomData)).map(Self)
    }
}

struct OneOrMoreVisitor<T>(PhantomData<T>);

impl<'de, T: Deserialize<'de>> Visitor<'de> for OneOrMoreVisitor<T> {
    type Value = Vec<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a string or a list of strings")
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Vec<T>, E> {
        Ok(vec![T::deserialize(text.into_deserializer())?])
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Vec<T>, A::Error> {
        let mut items = Vec::new();
        while let Some(item) = list.next_element()? {
            items.push(item);
        }
        Ok(items)
    }
}

impl<T: JsonSchema> JsonSchema for OneOrMore<T> {
    fn inline_schema() -> bool {
        true
    }
    fn schema_name() -> Cow<'static, str> {
        format!("{}List", T::schema_name()).into()
    }
    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let item = generator.subschema_for::<T>();
        json_schema!({ "anyOf": [item, { "type": "array", "items": item }] })
    }
}
