//! Parsers of option values. Their errors state the accepted values.

use std::fmt;
use std::str::FromStr;

use clap::ValueEnum;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use glam::DVec3;
use voxsplat::Background;
use voxsplat::appearance::ChannelChoice;
use voxsplat::error::Error;
use voxsplat::image::Region;
use voxsplat::kernel::Kernel;
use voxsplat::settings::{Level, Response};
use voxsplat::transfer::{ControlPoint, GradientPoint, TransferFunction, Window};
use voxsplat::volume::Units;

/// The value of `--painter`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum PainterArg {
    Auto,
    Quads,
    Tiles,
}

/// The value of `--light`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum LightArg {
    Off,
    /// Whether it follows the eye.
    Studio(bool),
    /// A light with its colour.
    One(PlaceArg, [f64; 3]),
}

/// Where a light is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum PlaceArg {
    Eye,
    /// Azimuth and elevation in degrees, as of an eye.
    From(f64, f64),
    /// A place in the world.
    At([f64; 3]),
}

/// Parses a value of the library. The error is without the option's name, which `clap` adds.
pub(crate) fn library<T: FromStr<Err: Into<Error>>>(text: &str) -> Result<T, String> {
    text.parse().map_err(|error: T::Err| reason(error.into()))
}

/// The message of an error without the setting's name.
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

/// Parses pixels, `WxH` or one number for both.
/// Parses `XxYxZ`, numbers from 1 on.
pub(crate) fn grid(text: &str) -> Result<[u32; 3], String> {
    let numbers: Option<Vec<u32>> = text.split('x').map(|number| number.parse().ok().filter(|&n| n > 0)).collect();
    expect(numbers.and_then(|numbers| numbers.try_into().ok()), "expected XxYxZ, such as 2x2x4")
}

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
    /// The first and the last.
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

/// Parses `N`, `FIRST-LAST` or `all`.
pub(crate) fn time(text: &str) -> Result<TimeArg, String> {
    let number = |text: &str| text.trim().parse::<u32>().ok().filter(|number| *number < u32::MAX);
    let time = match text.split_once('-') {
        _ if text == "all" => Some(TimeArg::All),
        None => number(text).map(TimeArg::One),
        Some((first, last)) => {
            let ends = number(first).zip(number(last)).filter(|(first, last)| first <= last);
            ends.map(|(first, last)| TimeArg::Range(first, last))
        }
    };
    expect(time, "N, FIRST-LAST or all, time points counted from 0")
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

/// Parses `off`, `studio`, `studio:eye`, or `headlight`, `AZ,EL` or `@X,Y,Z` with `:INTENSITY`, `:#RRGGBB` or
/// `:INTENSITY,#RRGGBB`.
pub(crate) fn light(text: &str) -> Result<LightArg, String> {
    let expected = "off, studio, studio:eye, headlight, AZ,EL in degrees or @X,Y,Z; the last three with :INTENSITY or \
                    :#RRGGBB";
    let (place, color) = text.split_once(':').map_or((text, None), |(place, color)| (place, Some(color)));
    let place = match (place, color) {
        ("off", None) => return Ok(LightArg::Off),
        ("studio", None) => return Ok(LightArg::Studio(false)),
        ("studio", Some("eye")) => return Ok(LightArg::Studio(true)),
        ("headlight", _) => Some(PlaceArg::Eye),
        _ => match place.strip_prefix('@') {
            Some(point) => finite(point).map(PlaceArg::At),
            None => finite(place).map(|[azimuth, elevation]| PlaceArg::From(azimuth, elevation)),
        },
    };
    let place = expect(place, expected)?;
    let mut light = [1.0; 3];
    for part in color.into_iter().flat_map(|color| color.split(',')) {
        let factors = match (number(part), part.parse()) {
            (Ok(intensity), _) => Some([intensity; 3]),
            (Err(_), Ok(Background::Color(color))) => Some(color),
            _ => None,
        };
        light.iter_mut().zip(expect(factors, expected)?).for_each(|(light, factor)| *light *= factor);
    }
    Ok(LightArg::One(place, light))
}

/// Parses ambient, diffuse, specular and shininess.
pub(crate) fn material(text: &str) -> Result<[f64; 4], String> {
    expect(list(text), "four numbers AMBIENT,DIFFUSE,SPECULAR,SHININESS")
}

/// The value of `--shadows`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Shadows {
    /// `None`: the light's own, or 1.
    pub(crate) strength: Option<f64>,
    pub(crate) exact: bool,
}

/// Parses `on`, `off`, a number or `exact`.
pub(crate) fn shadows(text: &str) -> Result<Shadows, String> {
    let strength = |text| match text {
        "on" => Ok(Some(1.0)),
        "off" => Ok(Some(0.0)),
        _ => expect(number(text).ok().map(Some), "on, off, exact or a number from 0 to 1"),
    };
    let (is_exact, text) = match text.split_once(':') {
        Some(("exact", text)) => (true, Some(text)),
        _ => (text == "exact", (text != "exact").then_some(text)),
    };
    Ok(Shadows { strength: text.map(strength).transpose()?.flatten(), exact: is_exact })
}

/// The value of `--occlusion`: a distance in voxels, or none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Occlusion(pub(crate) Option<f64>);

/// Parses `off` or a number.
pub(crate) fn occlusion(text: &str) -> Result<Occlusion, String> {
    match text {
        "off" => Ok(Occlusion(None)),
        _ => expect(number(text).ok().map(Some).map(Occlusion), "off or a radius in voxels"),
    }
}

/// The value of `--gradient-opacity`; off has no points.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct GradientOpacity(pub(crate) Vec<GradientPoint>);

/// Parses `off`, or pairs `MAGNITUDE:OPACITY`.
pub(crate) fn gradient_opacity(text: &str) -> Result<GradientOpacity, String> {
    if text == "off" {
        return Ok(GradientOpacity(Vec::new()));
    }
    let point = |pair: &str| {
        let (magnitude, opacity) = pair.split_once(':')?;
        Some(GradientPoint { magnitude: number(magnitude.trim()).ok()?, opacity: number(opacity.trim()).ok()? })
    };
    let points: Option<Vec<GradientPoint>> = text.split(',').map(point).collect();
    let points =
        expect(points, "off, or MAGNITUDE:OPACITY pairs such as 10:0,50:1, magnitudes in values per world unit")?;
    // The validity of the points does not depend on the rest of the transfer function.
    let any = ControlPoint { value: 0.0, color: [1.0; 3], opacity: 1.0 };
    let transfer = TransferFunction::new(vec![any], None).and_then(|any| any.with_gradient_opacity(points));
    transfer.map(|transfer| GradientOpacity(transfer.gradient_opacity().to_vec())).map_err(reason)
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

/// Parses a finite number over 0.
pub(crate) fn positive(text: &str) -> Result<f64, String> {
    expect(number(text).ok().filter(|&n| n > 0.0), &format!("a number over 0{}", unit(text)))
}

/// Parses a finite number, 0 or over.
pub(crate) fn tolerance(text: &str) -> Result<f64, String> {
    expect(number(text).ok().filter(|&n| n >= 0.0), "a number, 0 or over")
}

/// Parses `auto` or a number.
pub(crate) fn level(text: &str) -> Result<Level, String> {
    match text {
        "auto" => Ok(Level::Auto),
        _ => expect(text.parse().ok().map(Level::At), "auto, or a number from 0 to 12"),
    }
}

/// Parses `gaussian[:SIGMA,RADIUS]` or `kaiser-bessel[:RADIUS,ALPHA]`.
pub(crate) fn kernel(text: &str) -> Result<Kernel, String> {
    let kernel = match name_and_pair(text)? {
        ("gaussian", None) => Kernel::default(),
        ("gaussian", Some([sigma, radius])) => Kernel::Gaussian { sigma, radius },
        ("kaiser-bessel", None) => Kernel::KAISER_BESSEL,
        ("kaiser-bessel", Some([radius, alpha])) => Kernel::KaiserBessel { radius, alpha },
        _ => return Err("expected gaussian[:SIGMA,RADIUS] or kaiser-bessel[:RADIUS,ALPHA]".to_owned()),
    };
    kernel.validate().map(|()| kernel).map_err(reason)
}

/// Parses `absorption`, `depth`, `window[:LOW,HIGH]` or `film[:EXPOSURE,GAMMA]`.
pub(crate) fn response(text: &str) -> Result<Response, String> {
    let response = match name_and_pair(text)? {
        ("absorption", None) => Response::Absorption,
        ("depth", None) => Response::Depth,
        ("window", None) => Response::WINDOW,
        ("window", Some([low, high])) => Response::Window { low, high },
        ("film", None) => Response::FILM,
        ("film", Some([exposure, gamma])) => Response::Film { exposure, gamma },
        _ => return Err("expected absorption, depth, window[:LOW,HIGH] or film[:EXPOSURE,GAMMA]".to_owned()),
    };
    response.validate().map(|()| response).map_err(reason)
}

/// Parses `N` or `N:COLOUR`.
pub(crate) fn channel(text: &str) -> Result<ChannelChoice, String> {
    let (number, color) = text.split_once(':').map_or((text, None), |(number, color)| (number, Some(color)));
    let color = match color.map(str::parse) {
        None => Some(None),
        Some(Ok(Background::Color(color))) => Some(Some(color)),
        Some(_) => None,
    };
    let channel = number.parse().ok().zip(color).map(|(number, color)| ChannelChoice { number, color });
    expect(channel, "N or N:COLOUR, channels counted from 0")
}

/// Parses `NAME` or `NAME:NUMBER,NUMBER`.
fn name_and_pair(text: &str) -> Result<(&str, Option<[f64; 2]>), String> {
    let Some((name, numbers)) = text.split_once(':') else { return Ok((text, None)) };
    Ok((name, Some(expect(list(numbers), &format!("two numbers after {name}:, found {numbers:?}"))?)))
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
    fn channels_have_a_number_and_maybe_a_colour() {
        assert_eq!(channel("2"), Ok(ChannelChoice { number: 2, color: None }));
        assert_eq!(channel("0:#ff0000"), Ok(ChannelChoice { number: 0, color: Some([1.0, 0.0, 0.0]) }));
        for bad in ["", "-1", "a", "1:", "1:transparent", "1.5"] {
            let error = channel(bad).unwrap_err();
            assert!(error.starts_with("expected N or N:COLOUR"), "{bad}: {error}");
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

    #[test]
    fn gradient_opacities() {
        let point = |magnitude, opacity| GradientPoint { magnitude, opacity };
        assert_eq!(gradient_opacity("1:0, 2.5:1"), Ok(GradientOpacity(vec![point(1.0, 0.0), point(2.5, 1.0)])));
        assert_eq!(gradient_opacity("off"), Ok(GradientOpacity(Vec::new())));
        for (bad, expected) in [
            ("", "expected off, or"),
            ("1", "expected off, or"),
            ("1:2", "opacity"),
            ("2:0,1:1", "magnitude"),
            ("a:1", "expected off, or"),
            ("-1:0", "magnitude"),
        ] {
            let error = gradient_opacity(bad).unwrap_err();
            assert!(error.contains(expected), "{bad}: {error}");
        }
    }

    #[test]
    fn kernels() {
        assert_eq!(kernel("gaussian"), Ok(Kernel::default()));
        assert_eq!(kernel("gaussian:0.7,2.5"), Ok(Kernel::Gaussian { sigma: 0.7, radius: 2.5 }));
        assert_eq!(kernel("kaiser-bessel:2,8"), Ok(Kernel::KaiserBessel { radius: 2.0, alpha: 8.0 }));
        for (bad, expected) in [
            ("box", "expected gaussian[:SIGMA,RADIUS]"),
            ("gaussian:", "expected two numbers"),
            ("gaussian:1", "expected two numbers"),
            ("gaussian:0,2", "sigma"),
            ("kaiser-bessel:99,2", "radius"),
            ("gaussian:nan,1", "sigma"),
        ] {
            let error = kernel(bad).unwrap_err();
            assert!(error.contains(expected), "{bad}: {error}");
        }
    }

    #[test]
    fn responses() {
        for given in [Response::Absorption, Response::Depth, Response::WINDOW, Response::FILM] {
            assert_eq!(response(&given.to_string()), Ok(given));
        }
        assert_eq!(response("film"), Ok(Response::FILM));
        for (bad, expected) in [
            ("white", "expected absorption, depth"),
            ("depth:1,2", "expected absorption, depth"),
            ("window:4,1", "the lower one first"),
            ("film:0,3", "an exposure of 0"),
            ("film:8", "expected two numbers"),
        ] {
            let error = response(bad).unwrap_err();
            assert!(error.contains(expected), "{bad}: {error}");
        }
    }
}
