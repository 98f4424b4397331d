//! The spellings of enums, one each: messages, JSON and the command line all use it.

use strsim::osa_distance;

/// Returns a number of things whose plural ends in s: 1 slice, 2 slices.
pub fn counted(count: u64, thing: &str) -> String {
    format!("{count} {thing}{}", if count == 1 { "" } else { "s" })
}

/// Returns a number as people write it: up to four digits after the point, and powers of ten if it is very small or
/// very large.
#[must_use]
pub fn readable(value: f64) -> String {
    let trimmed = |text: &str| match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text.to_owned(),
    };
    match value.abs() {
        0.0 => "0".to_owned(),
        size if value == value.trunc() && size < 1e15 => format!("{value}"),
        size if (1e-3..1e9).contains(&size) => trimmed(&format!("{value:.4}")),
        _ => match format!("{value:.4e}").split_once('e') {
            Some((digits, power)) => format!("{}e{power}", trimmed(digits)),
            None => format!("{value}"),
        },
    }
}

/// Returns a share, 0 to 1, in percent with one digit after the point. A share that would round to none or to all is
/// named by its bound.
#[must_use]
pub fn percent(share: f64) -> String {
    match 100.0 * share {
        0.0 => "0 %".to_owned(),
        percent if percent < 0.1 => "under 0.1 %".to_owned(),
        percent if percent > 99.9 && percent < 100.0 => "over 99.9 %".to_owned(),
        percent => format!("{percent:.1} %"),
    }
}

/// Returns a text as HTML.
#[must_use]
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Returns whether a word is so near to a name that it counts as its misspelling: one letter in four may be wrong.
#[must_use]
pub fn is_near(word: &str, name: &str) -> bool {
    distance(word, name).is_some()
}

/// Returns the name that a word misspells, the most similar one.
pub fn nearest<'a>(word: &str, names: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let near = names.into_iter().filter_map(|name| Some((distance(word, name)?, name)));
    near.min_by_key(|(distance, _)| *distance).map(|(_, name)| name)
}

/// Returns the number of wrong letters if a word is near to a name.
fn distance(word: &str, name: &str) -> Option<usize> {
    let most = ((word.len() + 1) / 4).max(1);
    // A word of any length takes no time.
    let comparable = word.len() <= 2 * name.len() + 1;
    comparable.then(|| osa_distance(word, name)).filter(|distance| *distance <= most)
}

/// Names the variants of a field-less enum.
///
/// `spelled!` gives `ALL`, `name`, `Display` (which honours width and alignment) and `Serialize`. The `match` in `name`
/// has no wildcard, so a variant left out of the list does not compile.
#[macro_export]
macro_rules! spelled {
    ($type:ident { $($variant:ident: $name:literal),+ $(,)? }) => {
        impl $type {
            /// Every variant, in the order in which help and messages list them.
            pub const ALL: [Self; [$($name),+].len()] = [$(Self::$variant),+];

            /// Returns the spelling of the variant in messages, in JSON and on the command line.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)+
                }
            }
        }

        impl std::fmt::Display for $type {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.pad(self.name())
            }
        }

        impl serde::Serialize for $type {
            fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.serialize_str(self.name())
            }
        }
    };
}

/// Names the variants of an enum as `spelled!` does, and adds `Deserialize` and `FromStr`, which accept exactly the
/// names, with an error about the given setting. Where it is called, `Error` is an error with a variant `Setting {
/// name, reason }`.
#[macro_export]
macro_rules! named {
    ($setting:literal, $type:ident { $($variant:ident: $name:literal),+ $(,)? }) => {
        $crate::names::spelled! { $type { $($variant: $name),+ } }

        impl std::str::FromStr for $type {
            type Err = Error;

            fn from_str(text: &str) -> Result<Self, Self::Err> {
                Self::ALL.into_iter().find(|variant| variant.name() == text).ok_or_else(|| {
                    let reason = format!("{text:?}, expected {}", $crate::names::listed(&[$($name),+]));
                    Self::Err::Setting { name: $setting, reason }
                })
            }
        }

        impl<'de> serde::Deserialize<'de> for $type {
            fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                let name = String::deserialize(deserializer)?;
                name.parse().map_err(serde::de::Error::custom)
            }
        }
    };
}

pub use crate::{named, spelled};

/// Returns names in a sentence: "a", "a or b", "a, b or c".
pub fn listed(names: &[&str]) -> String {
    match names {
        [] => String::new(),
        [one] => (*one).to_owned(),
        [first @ .., last] => format!("{} or {last}", first.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::{is_near, nearest};
    use crate::formats::MissingSlices;
    use crate::volume::SampleType;

    #[test]
    fn every_name_reads_back() {
        for sample_type in SampleType::ALL {
            assert_eq!(sample_type.name().parse::<SampleType>().unwrap(), sample_type);
            assert_eq!(serde_json::to_string(&sample_type).unwrap(), format!("\"{sample_type}\""));
        }
        assert_eq!(SampleType::ALL.len(), 10);
    }

    #[test]
    fn a_wrong_name_is_told_the_right_ones() {
        let error = "Refuse".parse::<MissingSlices>().unwrap_err().to_string();
        assert_eq!(error, "missing_slices: \"Refuse\", expected refuse or interpolate");
    }

    #[test]
    fn a_letter_in_four_may_be_wrong() {
        for (word, other) in [("azimut", "azimuth"), ("sahdows", "shadows"), ("ligth", "light")] {
            assert!(is_near(word, other), "{word} {other}");
        }
        for (word, other) in [("slice", "size"), ("", "ab"), ("wobble", "zoom")] {
            assert!(!is_near(word, other), "{word} {other}");
        }
        assert_eq!(nearest("browm", ["brow", "brown", "blown"]), Some("brow"));
        assert_eq!(nearest("brownn", ["blown", "brown"]), Some("brown"));
        assert!(!is_near(&"brown".repeat(100_000), "brown"));
    }

    #[test]
    fn names_are_padded() {
        assert_eq!(format!("{:>4}|{:<4}|", SampleType::U8, SampleType::U8), "  u8|u8  |");
    }
}
