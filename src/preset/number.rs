//! Numbers with their ranges. A number outside its range never gets past this module.

use crate::simplify::FeatureWeight;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Error, Unexpected, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::borrow::Cow;
use std::fmt;

/// Numbers from or above `low`, up to `high`.
#[derive(Debug, Clone, Copy)]
pub struct Interval {
    low: f64,
    /// `low` itself is outside.
    open: bool,
    high: f64,
}

impl Interval {
    pub fn holds(&self, number: f64) -> bool {
        (if self.open { number > self.low } else { number >= self.low }) && number <= self.high
    }

    pub fn json_schema(&self) -> Schema {
        let low = if self.open { "exclusiveMinimum" } else { "minimum" };
        let mut schema = json_schema!({ "type": "number" });
        schema.insert(low.to_owned(), self.low.into());
        if self.high < f64::MAX {
            schema.insert("maximum".to_owned(), self.high.into());
        }
        schema
    }
}

impl Visitor<'_> for Interval {
    type Value = f64;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a number {} {}", if self.open { "above" } else { "from" }, self.low)?;
        match (self.high < f64::MAX, self.open) {
            (true, true) => write!(f, " and at most {}", self.high),
            (true, false) => write!(f, " to {}", self.high),
            (false, _) => Ok(()),
        }
    }

    fn visit_f64<E: Error>(self, number: f64) -> Result<f64, E> {
        if self.holds(number) { Ok(number) } else { Err(E::invalid_value(Unexpected::Float(number), &self)) }
    }

    fn visit_i64<E: Error>(self, number: i64) -> Result<f64, E> {
        // Integers beyond 2^53 lose digits that no preset cares for.
        self.visit_f64(number as f64)
    }
}

/// A length in object units.
pub const LENGTH: Interval = Interval { low: 0.0, open: true, high: f64::MAX };

/// A length in percent of the bounding box's diagonal.
pub const PERCENT: Interval = Interval { low: 0.0, open: true, high: 100.0 };

macro_rules! number {
    ($($(#[$meta:meta])* $Name:ident: $bound:ident $low:literal to $high:expr;)*) => { $(
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Serialize)]
        #[serde(transparent)]
        pub struct $Name(f64);

        impl $Name {
            pub const INTERVAL: Interval = Interval { low: $low, open: number!(@open $bound), high: $high };

            /// The number.
            pub fn get(self) -> f64 {
                self.0
            }
        }

        impl TryFrom<f64> for $Name {
            type Error = serde::de::value::Error;

            fn try_from(number: f64) -> Result<Self, Self::Error> {
                Self::INTERVAL.visit_f64(number).map(Self)
            }
        }

        impl<'de> Deserialize<'de> for $Name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                deserializer.deserialize_any(Self::INTERVAL).map(Self)
            }
        }

        impl JsonSchema for $Name {
            fn inline_schema() -> bool {
                true
            }
            fn schema_name() -> Cow<'static, str> {
                stringify!($Name).into()
            }
            fn json_schema(_: &mut SchemaGenerator) -> Schema {
                Self::INTERVAL.json_schema()
            }
        }
    )* };
    (@open above) => { true };
    (@open from) => { false };
}

number! {
    /// A share of something: 1 is all of it.
    Share: above 0.0 to 1.0;
    /// A share that may be nothing, but not everything.
    PartialShare: from 0.0 to 0.99;
    /// Pixels on screen.
    Pixels: above 0.0 to 1000.0;
    /// Pixels of a whole screen.
    ScreenPixels: from 1.0 to 100_000.0;
    /// A factor on something automatic: 1 leaves it, 0 switches it off.
    Weight: from 0.0 to 1000.0;
    /// How many times as large as something else.
    Multiple: above 0.0 to 1000.0;
}

/// Whole numbers from `low` to `high`.
#[derive(Debug, Clone, Copy)]
struct Whole {
    low: u32,
    high: u32,
}

impl Visitor<'_> for Whole {
    type Value = u32;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a whole number from {}", self.low)?;
        if self.high < u32::MAX { write!(f, " to {}", self.high) } else { Ok(()) }
    }

    fn visit_i64<E: Error>(self, number: i64) -> Result<u32, E> {
        match u32::try_from(number) {
            Ok(number) if (self.low..=self.high).contains(&number) => Ok(number),
            _ => Err(E::invalid_value(Unexpected::Signed(number), &self)),
        }
    }
}

macro_rules! whole {
    ($($(#[$meta:meta])* $Name:ident: from $low:literal to $high:expr;)*) => { $(
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
        #[serde(transparent)]
        pub struct $Name(u32);

        impl $Name {
            const RANGE: Whole = Whole { low: $low, high: $high };

            /// The number.
            pub fn get(self) -> usize {
                self.0 as usize
            }
        }

        impl<'de> Deserialize<'de> for $Name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                deserializer.deserialize_any(Self::RANGE).map(Self)
            }
        }

        impl JsonSchema for $Name {
            fn inline_schema() -> bool {
                true
            }
            fn schema_name() -> Cow<'static, str> {
                stringify!($Name).into()
            }
            fn json_schema(_: &mut SchemaGenerator) -> Schema {
                json_schema!({ "type": "integer", "minimum": Self::RANGE.low, "maximum": Self::RANGE.high })
            }
        }
    )* };
}

whole! {
    /// A number of triangles, at least one.
    Triangles: from 1 to u32::MAX;
    /// A number of things that may be none.
    Count: from 0 to u32::MAX;
    /// Samples of the ruler: fewer say nothing, more only take time.
    Samples: from 100 to 10_000_000;
}

/// QFVP's exponent w: a number, or who predicts it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exponent(pub FeatureWeight);

impl Exponent {
    const INTERVAL: Interval = Interval { low: 0.0, open: false, high: 2.0 };
}

impl<'de> Deserialize<'de> for Exponent {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ExponentVisitor).map(Self)
    }
}

struct ExponentVisitor;

impl Visitor<'_> for ExponentVisitor {
    type Value = FeatureWeight;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        Exponent::INTERVAL.expecting(f)?;
        f.write_str(", \"auto\" or \"shape\"")
    }

    fn visit_str<E: Error>(self, word: &str) -> Result<Self::Value, E> {
        match word {
            "auto" => Ok(FeatureWeight::Auto),
            "shape" => Ok(FeatureWeight::Shape),
            _ => Err(E::invalid_value(Unexpected::Str(word), &self)),
        }
    }

    fn visit_f64<E: Error>(self, w: f64) -> Result<Self::Value, E> {
        if Exponent::INTERVAL.holds(w) {
            Ok(FeatureWeight::Fixed(w))
        } else {
            Err(E::invalid_value(Unexpected::Float(w), &self))
        }
    }

    fn visit_i64<E: Error>(self, w: i64) -> Result<Self::Value, E> {
        self.visit_f64(w as f64)
    }
}

impl Serialize for Exponent {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0 {
            FeatureWeight::Fixed(w) => serializer.serialize_f64(w),
            FeatureWeight::Auto => serializer.serialize_str("auto"),
            FeatureWeight::Shape => serializer.serialize_str("shape"),
        }
    }
}

impl JsonSchema for Exponent {
    fn inline_schema() -> bool {
        true
    }
    fn schema_name() -> Cow<'static, str> {
        "Exponent".into()
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "anyOf": [{ "enum": ["auto", "shape"] }, Self::INTERVAL.json_schema()] })
    }
}

/// Where long edges begin, in mean edge lengths; `None` splits nothing. In TOML 0 or `false` are none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SplitFactor(pub Option<f64>);

impl SplitFactor {
    const INTERVAL: Interval = Interval { low: 1.0, open: false, high: 100.0 };
}

impl<'de> Deserialize<'de> for SplitFactor {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(SplitFactorVisitor).map(Self)
    }
}

struct SplitFactorVisitor;

impl Visitor<'_> for SplitFactorVisitor {
    type Value = Option<f64>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        SplitFactor::INTERVAL.expecting(f)?;
        f.write_str(", or false for no splits")
    }

    fn visit_bool<E: Error>(self, on: bool) -> Result<Self::Value, E> {
        if on { Err(E::invalid_value(Unexpected::Bool(on), &self)) } else { Ok(None) }
    }

    fn visit_f64<E: Error>(self, factor: f64) -> Result<Self::Value, E> {
        match factor {
            0.0 => Ok(None),
            _ if SplitFactor::INTERVAL.holds(factor) => Ok(Some(factor)),
            _ => Err(E::invalid_value(Unexpected::Float(factor), &self)),
        }
    }

    fn visit_i64<E: Error>(self, factor: i64) -> Result<Self::Value, E> {
        self.visit_f64(factor as f64)
    }
}

impl Serialize for SplitFactor {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0 {
            Some(factor) => serializer.serialize_f64(factor),
            None => serializer.serialize_bool(false),
        }
    }
}

impl JsonSchema for SplitFactor {
    fn inline_schema() -> bool {
        true
    }
    fn schema_name() -> Cow<'static, str> {
        "SplitFactor".into()
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "anyOf": [{ "enum": [false, 0] }, Self::INTERVAL.json_schema()] })
    }
}
