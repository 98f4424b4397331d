//! Parsers of option values. Their errors state the accepted values.

use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

use clap::ValueEnum;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use glam::DVec3;
use voxsplat::error::Error;
use voxsplat::image::Region;
use voxsplat::program::PlaneSpec;
use voxsplat::transfer::Window;
use voxsplat::volume::Units;

/// The value of `--painter`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum PainterArg {
    Auto,
    Quads,
    Tiles,
    Cpu,
}

/// Parses a value of the library. The error is without the option's name, which `clap` adds.
pub(crate) fn library<T: FromStr<Err: Into<Error>>>(text: &str) -> Result<T, String> {
    text.parse().map_err(|error: T::Err| reason(error.into()))
}

/// A value with the text that it was parsed from.
#[derive(Debug, Clone)]
pub(crate) struct Spelled<T> {
    pub(crate) text: String,
    pub(crate) value: T,
}

/// Parses a value of the library and keeps its text.
pub(crate) fn spelled<T: FromStr<Err: Into<Error>>>(text: &str) -> Result<Spelled<T>, String> {
    Ok(Spelled { text: text.to_owned(), value: library(text)? })
}

/// Returns the message of an error without the setting's name.
pub(crate) fn reason(error: Error) -> String {
    match error {
        Error::Setting { reason, .. } | Error::Transfer(reason) => reason,
        other => other.to_string(),
    }
}

/// Parses an enum of the library by its names. Help lists them.
pub(crate) fn one_of<T, const N: usize>(all: [T; N], name: fn(T) -> &'static str) -> impl TypedValueParser<Value = T>
where
    T: FromStr<Err: Into<Error>> + Clone + Send + Sync + 'static,
{
    PossibleValuesParser::new(all.map(name)).try_map(|text| library(&text))
}

/// Returns numbers parted by commas; `None` if there are not `N`.
pub(crate) fn list<T: FromStr, const N: usize>(text: &str) -> Option<[T; N]> {
    let numbers: Option<Vec<T>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    numbers?.try_into().ok()
}

/// Returns finite numbers parted by commas; `None` if there are not `N`.
fn finite<const N: usize>(text: &str) -> Option<[f64; N]> {
    list(text).filter(|numbers: &[f64; N]| numbers.iter().all(|number| number.is_finite()))
}

/// Returns a value, or an error that names the expected one.
pub(crate) fn expect<T>(value: Option<T>, expected: &str) -> Result<T, String> {
    value.ok_or_else(|| format!("expected {expected}"))
}

/// Parses a point or a direction, `X,Y,Z`.
pub(crate) fn vector(text: &str) -> Result<DVec3, String> {
    expect(finite(text).map(DVec3::from_array), "three numbers X,Y,Z")
}

/// Parses a window, `LEVEL,WIDTH`.
pub(crate) fn window(text: &str) -> Result<Window, String> {
    let window = list(text).map(|[level, width]| Window { level, width });
    expect(window.filter(|window| window.ends().is_ok()), "two numbers LEVEL,WIDTH, the width over 0")
}

/// Parses distances between samples, `X,Y,Z`.
pub(crate) fn spacing(text: &str) -> Result<[f64; 3], String> {
    expect(finite(text).filter(|spacing| spacing.iter().all(|s| *s > 0.0)), "three lengths over 0, X,Y,Z")
}

/// Parses numbers of samples, `X,Y,Z`.
pub(crate) fn dims(text: &str) -> Result<[u32; 3], String> {
    expect(list(text).filter(|dims| !dims.contains(&0)), "three whole numbers over 0, X,Y,Z")
}

/// Parses `XxYxZ`, numbers from 1 on.
pub(crate) fn grid(text: &str) -> Result<[u32; 3], String> {
    let numbers: Option<Vec<u32>> = text.split('x').map(|number| number.parse().ok().filter(|&n| n > 0)).collect();
    expect(numbers.and_then(|numbers| numbers.try_into().ok()), "XxYxZ, such as 2x2x4")
}

/// Parses pixels, `WxH` or one number for both.
pub(crate) fn size(text: &str) -> Result<[u32; 2], String> {
    let (width, height) = text.split_once(['x', 'X']).unwrap_or((text, text));
    let size = width.trim().parse().ok().zip(height.trim().parse().ok()).map(<[u32; 2]>::from);
    expect(size, "WIDTHxHEIGHT or one number for both, in pixels")
}

/// Parses a part of a picture, `X,Y,W,H`.
pub(crate) fn region(text: &str) -> Result<Region, String> {
    let region = list(text).map(|[x, y, width, height]| Region { x, y, width, height });
    let region = region.filter(|region| region.width > 0 && region.height > 0);
    expect(region, "four whole numbers X,Y,W,H, pixels from the top left, W and H over 0")
}

/// Parses a part of a whole, `I/N`, counted from 1.
pub(crate) fn part(text: &str) -> Result<[u32; 2], String> {
    let part = text.split_once('/').and_then(|(i, n)| Some([i.trim().parse().ok()?, n.trim().parse().ok()?]));
    expect(part.filter(|[i, n]| (1..=*n).contains(i)), "I/N, such as 2/8, I from 1 to N")
}

/// The value of `--time`: time points counted from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum TimeArg {
    One(u32),
    /// A range of time points: the first and the last.
    Range(u32, u32),
    All,
}

impl TimeArg {
    pub(crate) fn first(self) -> u32 {
        match self {
            Self::One(first) | Self::Range(first, _) => first,
            Self::All => 0,
        }
    }
}

impl fmt::Display for TimeArg {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::One(time) => write!(f, "{time}"),
            Self::Range(first, last) => write!(f, "{first}-{last}"),
            Self::All => f.write_str("all"),
        }
    }
}

/// Parses the first and the last number of `N` or `FIRST-LAST`.
fn ends(text: &str) -> Option<(u32, u32)> {
    let number = |text: &str| text.trim().parse::<u32>().ok().filter(|number| *number < u32::MAX);
    let (first, last) = text.split_once('-').unwrap_or((text, text));
    number(first).zip(number(last)).filter(|(first, last)| first <= last)
}

/// Parses `N`, `FIRST-LAST` or `all`.
pub(crate) fn time(text: &str) -> Result<TimeArg, String> {
    let time = match ends(text) {
        _ if text == "all" => Some(TimeArg::All),
        Some((first, last)) if text.contains('-') => Some(TimeArg::Range(first, last)),
        one => one.map(|(time, _)| TimeArg::One(time)),
    };
    expect(time, "N, FIRST-LAST or all, time points counted from 0")
}

/// Parses `N` or `FIRST-LAST`.
pub(crate) fn bricks(text: &str) -> Result<RangeInclusive<usize>, String> {
    let bricks = ends(text).map(|(first, last)| first as usize..=last as usize);
    expect(bricks, "N or FIRST-LAST, bricks counted from 0")
}

/// Parses `length=U`, `value=U`, or both parted by a comma.
pub(crate) fn units(text: &str) -> Result<Units, String> {
    let mut units = Units::default();
    for pair in text.split(',') {
        let (quantity, unit) = pair.split_once('=').unwrap_or_default();
        let kept = match quantity.trim() {
            "length" => Some(&mut units.length),
            "value" => Some(&mut units.value),
            _ => None,
        };
        let kept = kept.filter(|_| !unit.trim().is_empty());
        *expect(kept, "length=UNIT, value=UNIT or both, such as length=mm,value=HU")? = Some(unit.trim().to_owned());
    }
    Ok(units)
}

/// Parses ambient, diffuse, specular and shininess.
pub(crate) fn material(text: &str) -> Result<[f64; 4], String> {
    expect(list(text), "four numbers AMBIENT,DIFFUSE,SPECULAR,SHININESS")
}

/// Parses a finite number.
pub(crate) fn number(text: &str) -> Result<f64, String> {
    expect(finite(text).map(|[number]| number), &format!("a finite number{}", unit(text)))
}

/// Returns a hint if a number has a unit behind it.
fn unit(text: &str) -> &'static str {
    let number = text.trim_end_matches(|c: char| !c.is_ascii_digit() && c != '.');
    if number.len() < text.len() && number.parse::<f64>().is_ok() { ", without a unit" } else { "" }
}

/// Parses a whole number from `MIN` to `MAX`.
pub(crate) fn whole<T: TryFrom<u64>, const MIN: u64, const MAX: u64>(text: &str) -> Result<T, String> {
    let number = text.trim().parse().ok().filter(|number| (MIN..=MAX).contains(number));
    let range = if MAX == u64::MAX { format!(", {MIN} or more") } else { format!(" from {MIN} to {MAX}") };
    expect(number.and_then(|number: u64| T::try_from(number).ok()), &format!("a whole number{range}"))
}

/// Parses a number of bytes, with a unit of 1024 bytes, of 1024 of these, and so on.
pub(crate) fn bytes(text: &str) -> Result<u64, String> {
    let parsed = || {
        let number = text.trim().trim_end_matches(['B', 'b', 'i']);
        let power = number.chars().last().and_then(|unit| "KMGT".find(unit.to_ascii_uppercase()));
        let digits = if power.is_some() { &number[..number.len() - 1] } else { number };
        let unit = power.map_or(1, |power| 1_u64 << (10 * (power + 1)));
        let bytes = digits.trim().parse::<f64>().ok()? * unit as f64;
        (bytes.is_finite() && bytes >= 0.0).then_some(bytes as u64)
    };
    expect(parsed(), "a number of bytes such as 500M, 2G or 1.5T")
}

/// Parses a finite number over 0.
pub(crate) fn positive(text: &str) -> Result<f64, String> {
    expect(number(text).ok().filter(|&n| n > 0.0), &format!("a number over 0{}", unit(text)))
}

/// Parses a finite number, 0 or over.
pub(crate) fn tolerance(text: &str) -> Result<f64, String> {
    expect(number(text).ok().filter(|&n| n >= 0.0), "a number, 0 or over")
}

/// Parses a number of decibels, or `inf`.
pub(crate) fn decibels(text: &str) -> Result<f64, String> {
    if text == "inf" { Ok(f64::INFINITY) } else { expect(number(text).ok(), "a finite number or inf") }
}

/// Parses a share, 0 to 1.
pub(crate) fn share(text: &str) -> Result<f64, String> {
    expect(number(text).ok().filter(|share| (0.0..=1.0).contains(share)), "a number from 0 to 1")
}

/// Planes that one option gives.
#[derive(Debug, Clone)]
pub(crate) struct Planes(pub(crate) Vec<PlaneSpec>);

/// Parses a plane, or several names of planes parted by commas: a normal has commas of its own.
pub(crate) fn planes(text: &str) -> Result<Planes, String> {
    let one = |text: &str| library::<PlaneSpec>(text);
    let several = || text.split(',').map(one).collect();
    one(text).map(|plane| vec![plane]).or_else(|_| several()).map(Planes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes() {
        assert_eq!(size("640x480"), Ok([640, 480]));
        assert_eq!(size("512"), Ok([512, 512]));
        for bad in ["", "x", "10x", "-1", "1.5", "1x2x3"] {
            let error = size(bad).unwrap_err();
            assert!(error.starts_with("expected WIDTHxHEIGHT"), "{bad}: {error}");
        }
    }

    #[test]
    fn times() {
        for (text, given) in [("7", TimeArg::One(7)), ("0-12", TimeArg::Range(0, 12)), ("all", TimeArg::All)] {
            assert_eq!(time(text), Ok(given));
            assert_eq!(given.to_string(), text);
        }
        for bad in ["", "-1", "3-2", "1-", "ALL", "1,2", "1-2-3", "4294967295"] {
            let error = time(bad).unwrap_err();
            assert!(error.starts_with("expected N, FIRST-LAST or all"), "{bad}: {error}");
        }
    }

    #[test]
    fn units_of_lengths_and_values() {
        let both = Units { length: Some("µm".to_owned()), value: Some("HU".to_owned()) };
        assert_eq!(units("value=HU, length=µm"), Ok(both.clone()));
        assert_eq!(units("value=HU"), Ok(Units { length: None, ..both }));
        for bad in ["", "mm", "length=", "length=mm,width=3", "=mm"] {
            assert!(units(bad).unwrap_err().starts_with("expected length=UNIT"), "{bad}");
        }
    }

    #[test]
    fn numbers_of_bytes() {
        for (text, given) in [("7", 7), ("2K", 2048), ("1.5 GiB", 3 << 29), ("3mb", 3 << 20), ("1T", 1 << 40)] {
            assert_eq!(bytes(text), Ok(given));
        }
        for bad in ["", "G", "-1", "nan", "1E", "1X", "inf"] {
            assert!(bytes(bad).unwrap_err().starts_with("expected a number of bytes"), "{bad}");
        }
    }

    #[test]
    fn vectors() {
        assert_eq!(vector("-1,0, 2.5"), Ok(DVec3::new(-1.0, 0.0, 2.5)));
        for bad in ["", "1,2", "1,2,3,4", "1,nan,2", "a,b,c"] {
            let error = vector(bad).unwrap_err();
            assert!(error.starts_with("expected three numbers"), "{bad}: {error}");
        }
    }
}
