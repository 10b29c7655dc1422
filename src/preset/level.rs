//! Levels in TOML: `levels = [0.5, { triangles = 500 }]` or tables `[[levels]]`.

use super::number::{Pixels, Share, Triangles};
use super::{ErrorBound, LevelTarget, PixelBound};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::MapAccessDeserializer;
use serde::de::{DeserializeSeed, Error, MapAccess, SeqAccess, Unexpected, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::borrow::Cow;
use std::fmt;

/// One level. It ends at the first of its rules that binds.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Level {
    /// Share of the source's triangles to keep, above 0, at most 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    ratio: Option<Share>,
    /// Triangles to keep.
    #[serde(skip_serializing_if = "Option::is_none")]
    triangles: Option<Triangles>,
    /// Largest distance from the source: a number in object units, or a string such as "0.5%" of the bounding box's diagonal.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<ErrorBound>,
    /// Largest error in pixels on screen, at the size that `at` gives.
    #[serde(skip_serializing_if = "Option::is_none")]
    pixels: Option<Pixels>,
    /// The size for `pixels`: share of the screen's height that the mesh's bounding sphere covers.
    #[serde(skip_serializing_if = "Option::is_none")]
    at: Option<Share>,
}

impl Level {
    /// A share of the source's triangles.
    fn keep(ratio: Share) -> Self {
        Self { ratio: Some(ratio), ..Self::default() }
    }

    /// What is missing in this level by itself, as title and help.
    fn check(&self) -> Result<(), &'static str> {
        match (self.pixels, self.at) {
            (Some(_), None) => Err("`pixels` needs `at`\n\
                                    add the size on screen at which they are counted, e.g. `at = 0.25` for a quarter of its height"),
            (None, Some(_)) => Err("`at` belongs to `pixels`\nadd e.g. `pixels = 1`, or remove `at`"),
            _ if self.target() == LevelTarget::default() => {
                Err("this level has no rule that ends it\nadd `ratio`, `triangles`, `error` or `pixels`")
            }
            _ => Ok(()),
        }
    }

    /// Why this level cannot follow `finer`: it must ask for less in no way, and for more in at least one where they compare.
    fn check_after(&self, finer: &Self) -> Result<(), String> {
        let slack = |level: &Self| Some(level.pixels?.get() / level.at?.get());
        let compared = [
            ("ratio", falling(finer.ratio, self.ratio)),
            ("triangles", falling(finer.triangles, self.triangles)),
            ("error", self.error.and_then(|coarse| rising(finer.error?, coarse))),
            ("pixels", falling(slack(self), slack(finer))),
        ];
        let wrong = compared.iter().find(|(_, order)| *order == Some(Order::Wrong));
        let equal = compared.iter().find(|(_, order)| *order == Some(Order::Same));
        let right = compared.iter().any(|(_, order)| *order == Some(Order::Right));
        match (wrong, equal) {
            (Some((rule, _)), _) => Err(format!("by its `{rule}` this level is finer than the one before")),
            (None, Some((rule, _))) if !right => Err(format!("by its `{rule}` this level equals the one before")),
            _ => Ok(()),
        }
    }

    /// The level in the library's terms.
    pub fn target(&self) -> LevelTarget {
        LevelTarget {
            ratio: self.ratio.map(Share::get),
            triangles: self.triangles.map(Triangles::get),
            error: self.error,
            pixels: self.pixels.zip(self.at).map(|(pixels, at)| PixelBound { pixels: pixels.get(), at: at.get() }),
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Order {
    Right,
    Same,
    Wrong,
}

fn falling<T: PartialOrd>(before: Option<T>, after: Option<T>) -> Option<Order> {
    let (before, after) = before.zip(after)?;
    Some(if after < before {
        Order::Right
    } else if after == before {
        Order::Same
    } else {
        Order::Wrong
    })
}

/// Bounds in different units do not compare.
fn rising(fine: ErrorBound, coarse: ErrorBound) -> Option<Order> {
    match (fine, coarse) {
        (ErrorBound::Units(fine), ErrorBound::Units(coarse))
        | (ErrorBound::Percent(fine), ErrorBound::Percent(coarse)) => falling(Some(coarse), Some(fine)),
        _ => None,
    }
}

impl fmt::Display for Level {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut rules = Vec::new();
        rules.extend(self.ratio.map(|ratio| format!("{}%", percent(ratio.get()))));
        rules.extend(self.triangles.map(|triangles| format!("{} triangles", triangles.get())));
        rules.extend(self.error.map(|error| match error {
            ErrorBound::Units(length) => format!("error {length}"),
            ErrorBound::Percent(percent) => format!("error {percent}%"),
        }));
        let pixels = self.pixels.zip(self.at);
        rules.extend(pixels.map(|(pixels, at)| format!("{} px at {}%", pixels.get(), percent(at.get()))));
        f.write_str(&rules.join(" or "))
    }
}

/// `share` in percent, without the digits that binary fractions add (0.07 is not 7.000000000000001 %).
fn percent(share: f64) -> f64 {
    (share * 1e8).round() / 1e6
}

/// The levels, finest first, each coarser than the one before.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Levels(pub Vec<Level>);

impl Levels {
    /// Levels that keep these shares of the triangles.
    ///
    /// # Errors
    /// A share out of range or not below the one before, in words.
    pub fn from_ratios(ratios: &[f64]) -> Result<Self, String> {
        let mut levels = Vec::new();
        for &ratio in ratios {
            let visitor = LevelVisitor { finer: levels.last() };
            let level = visitor.visit_f64::<serde::de::value::Error>(ratio).map_err(|error| error.to_string())?;
            levels.push(level);
        }
        Ok(Self(levels))
    }
}

impl<'de> Deserialize<'de> for Levels {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(LevelsVisitor).map(Self)
    }
}

struct LevelsVisitor;

impl<'de> Visitor<'de> for LevelsVisitor {
    type Value = Vec<Level>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a list of levels such as [0.5, 0.25], or tables `[[levels]]` with double brackets")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Self::Value, A::Error> {
        let mut levels = Vec::new();
        while let Some(level) = list.next_element_seed(LevelVisitor { finer: levels.last() })? {
            levels.push(level);
        }
        Ok(levels)
    }
}

/// Reads one level and compares it with the one before, so that the error stands at the level.
struct LevelVisitor<'a> {
    finer: Option<&'a Level>,
}

impl LevelVisitor<'_> {
    fn accept<E: Error>(&self, level: Level) -> Result<Level, E> {
        level.check().map_err(E::custom)?;
        if let Some(finer) = self.finer {
            let help = "levels go from fine to coarse";
            level.check_after(finer).map_err(|title| E::custom(format_args!("{title}\n{help}")))?;
        }
        Ok(level)
    }
}

impl<'de> DeserializeSeed<'de> for LevelVisitor<'_> {
    type Value = Level;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Level, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for LevelVisitor<'_> {
    type Value = Level;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a level: a share of the triangles above 0 and at most 1, or a table such as { error = \"0.5%\" }")
    }

    fn visit_f64<E: Error>(self, ratio: f64) -> Result<Level, E> {
        if let Ok(share) = Share::try_from(ratio) {
            return self.accept(Level::keep(share));
        }
        if ratio > 1.0 && ratio.fract() == 0.0 {
            let title = format_args!("a level's number is a share of the triangles, at most 1; found `{ratio}`");
            return Err(E::custom(format_args!("{title}\nfor a number of triangles write {{ triangles = {ratio} }}")));
        }
        Err(E::invalid_value(Unexpected::Float(ratio), &self))
    }

    fn visit_i64<E: Error>(self, ratio: i64) -> Result<Level, E> {
        self.visit_f64(ratio as f64)
    }

    fn visit_map<A: MapAccess<'de>>(self, table: A) -> Result<Level, A::Error> {
        let level = Level::deserialize(MapAccessDeserializer::new(table))?;
        self.accept(level)
    }
}

impl JsonSchema for Levels {
    fn inline_schema() -> bool {
        true
    }
    fn schema_name() -> Cow<'static, str> {
        "Levels".into()
    }
    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let level = generator.subschema_for::<Level>();
        json_schema!({ "type": "array", "items": { "anyOf": [Share::INTERVAL.json_schema(), level] } })
    }
}
